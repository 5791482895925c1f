"""Transients: motion of a train in time while its speed changes or events disturb it.

From the verb down: ``transient`` (the verb), ``motion`` and ``history`` (the result and
its signals), ``timeline`` (speed over time, blocks of steps), ``torques`` (torques over
the speed), ``march`` (steps of a block), ``weights`` (modes in pairs, weights of a
step); ``events`` and ``loads`` (their torques).
"""

from jaxhb._jax import load

load()
