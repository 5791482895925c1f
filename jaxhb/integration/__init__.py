"""Time integration. Equations and a state go in; the states and forces of cycles, or a
closed orbit, come out.
"""

from jaxhb._jax import load

load()
