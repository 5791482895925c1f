"""What the train does after it has run long enough. A train and speeds go in; the kind
of motion at each, and its numbers, come out.
"""

from jaxhb._jax import load

load()
