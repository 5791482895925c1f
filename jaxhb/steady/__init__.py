"""Steady states: motions of a train after it has run long enough. A train and speeds go
in; the kind of motion at each speed, and its numbers, come out.
"""

from jaxhb._jax import load

load()
