"""Which periodic motions coexist, and where they change. A train goes in, with a number
to vary; motions at one speed or along a branch, with their stability, come out.
"""

from jaxhb._jax import load

load()
