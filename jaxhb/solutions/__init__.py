"""Which periodic motion there is at a speed: plans, start strategies, Newton's method
until one leads there. A train and speeds go in, responses come out.
"""

from jaxhb._jax import load

load()
