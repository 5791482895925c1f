"""The linear toolbox: modes, Holzer's table, characteristic polynomials, forced response, strength. A train goes in,
meshes taken in contact; tables, frequencies and amplitudes come out."""

from jaxhb._jax import load

load()
