"""Blades of propellers as shares of the mean torque, against their cosines."""

import numpy as np

from jaxhb import Disk, Load, Shaft, Torque, build
from jaxhb.train.excitation import excitation


def test_blade_orders_are_shares_of_the_mean_torque_with_their_phase():
    """T = mean (1 + sum share cos(multiple x blades x theta + phase)), of a load and of
    a torque, at every speed.
    """
    rows = [(1, 0.05, 30.0), (2, 0.02, -45.0)]
    loaded = [
        Disk(name="a", inertia=1.0),
        Disk(name="b", inertia=1.0),
        Shaft(between=("a", "b"), stiffness=1e5),
    ]
    drive = Torque(disk="a", mean=100.0, scale=[(100.0, 1.0), (200.0, 4.0)])
    load = Load(disk="b", blades=4, blade_orders=rows)
    propeller = Torque(
        disk="b",
        mean=-100.0,
        blades=4,
        blade_orders=rows,
        scale=[(100.0, 1.0), (200.0, 4.0)],
    )
    for parts in ([drive, load], [drive, propeller]):
        train = build([*loaded, *parts], revolutions_per_cycle=1)
        for rpm, mean in ((100.0, -100.0), (200.0, -400.0)):
            torque = np.asarray(excitation(train, rpm, 8)[0])[1]
            expected = np.zeros(9, dtype=complex)
            expected[0] = mean
            for multiple, share, phase in rows:
                angle = np.deg2rad(phase)
                part = share * (np.cos(angle) + 1j * np.sin(angle))
                expected[4 * multiple] = mean * part / 2
            np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-12 * abs(mean))
