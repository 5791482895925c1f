"""What an answer is: response, signals, contact of the teeth, status, steady state.
Arrays of a solution go in; what an engineer reads by name comes out.
"""

from jaxhb._jax import load

load()
