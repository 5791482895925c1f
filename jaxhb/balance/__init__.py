"""One solve of fixed size by harmonic balance. The numbers of a problem and a plan go in; deflections, their
truncation error, their derivative and a status come out, and nothing is decided by values."""

from jaxhb._jax import load

load()
