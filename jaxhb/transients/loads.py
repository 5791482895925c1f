"""Torques of loads over the speed, of transients in which the speed is free."""

from __future__ import annotations

import numpy as np

from jaxhb._jax import Array, Number, namespace
from jaxhb.train.tables import TrainArrays
from jaxhb.transients.polylines import polyline_at


def load_torques(train: TrainArrays, rpm: Number) -> Array:
    """Torque ``(..., n_loads)`` N m of each load, on its own shaft, at speeds ``rpm``
    ``(...)`` of the reference rotor; negative, as that of all loads: it brakes.

    By its law T is constant, ``T (n / N)^2`` of a propeller, with the sign of n, or ``T
    n / N`` of a generator, whose load is resistive and its excitation constant; or it
    lies between rows, and is constant outside them. 0 of loads without a law, whose
    ``topology.load_law`` is "". Differentiable by the numbers of the train and by rpm.

    Examples
    --------
    >>> from jaxhb import Disk, Load, build
    >>> train = build(
    ...     [
    ...         Disk(name="shaft", inertia=1.0),
    ...         Load(
    ...             disk="shaft", law="propeller", rated_torque=80.0, rated_rpm=1000.0
    ...         ),
    ...     ]
    ... )
    >>> load_torques(train, np.array([500.0, 1000.0])).tolist()
    [[-20.0], [-80.0]]
    """
    loads = train.loads
    xp = namespace(loads, rpm)
    laws = train.topology.load_law
    speed = xp.asarray(rpm, dtype=float)[..., None]
    torque = xp.zeros((*np.shape(rpm), len(laws)))

    def of_law(name: str) -> np.ndarray:
        return np.array([law == name for law in laws], dtype=bool)

    if loads.rated_torque is not None:
        rated = xp.asarray(loads.rated_torque)
        speeds = 0.0 if loads.rated_rpm is None else xp.asarray(loads.rated_rpm)
        # 1 where there is none: of what is not chosen derivatives are finite, too.
        relative = speed / xp.where(speeds > 0.0, speeds, 1.0)
        torque = xp.where(of_law("constant"), rated, torque)
        torque = xp.where(
            of_law("propeller"), rated * relative * xp.abs(relative), torque
        )
        torque = xp.where(of_law("generator"), rated * relative, torque)
    if loads.over_rpm is not None:
        rows = xp.asarray(loads.over_rpm)
        points = np.array(train.topology.load_points, dtype=int)
        between = polyline_at(speed, rows[..., 0], rows[..., 1], points)
        torque = xp.where(of_law("over_rpm"), between, torque)
    return -torque
