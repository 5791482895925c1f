"""Answers: responses, signals, contact of the teeth, statuses, steady states.
Arrays of a solution go in; what an engineer reads by name comes out.
"""

from jaxhb._jax import load

load()
