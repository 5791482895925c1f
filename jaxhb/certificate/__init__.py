"""How far off a computed motion can be. A response goes in; a computed bound on its
distance from a motion of the train comes out.
"""

from jaxhb._jax import load

load()
