"""Certificates: a response goes in, and a computed bound on its distance from a motion
of the train comes out.
"""

from jaxhb._jax import load

load()
