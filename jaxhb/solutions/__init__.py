"""Periodic motions at a speed: plans, start strategies, Newton's method until a start
leads there. A train and speeds go in, responses come out.
"""

from jaxhb._jax import load

load()
