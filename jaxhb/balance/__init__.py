"""One solve of fixed size by harmonic balance. A train, a speed and a plan go in;
deflections, their truncation error, their derivative and a status come out, and nothing
is decided by values.
"""

from jaxhb._jax import load

load()
