"""The linear toolbox: modes, Holzer's table, characteristic polynomials, forced
response, strength. A train goes in, with its meshes in contact or linearised at their
load; tables, frequencies and amplitudes come out.
"""

from jaxhb._jax import load

load()
