"""Stability of the motion of a train: what becomes of a small disturbance. A periodic
motion goes in, Floquet multipliers come out.
"""

from jaxhb._jax import load

load()
