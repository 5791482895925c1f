"""The lift-off boundary: against closed forms of a pair, and against what marches do on
both sides of it.
"""

import numpy as np
import pytest

import jaxhb

HALF = 1e-4
NATURAL = 500.0


def pair(mean, amplitude, varying=()):
    """Two gears on a mesh of damping ratio 0.05, under a mean and an alternating force
    of order 1, N.
    """
    inertia = 1.0
    radius = 0.5
    mass = 2.0
    gears = [
        jaxhb.Disk(name=name, inertia=inertia, radius=radius, teeth=20) for name in "ab"
    ]
    mesh = jaxhb.Mesh(
        between=("a", "b"),
        stiffness=mass * NATURAL**2,
        damping=0.1 * mass * NATURAL,
        damping_law="always",
        backlash=2 * HALF,
        stiffness_orders=varying,
    )
    # Half of a torque on one gear bends the teeth, the other half turns both.
    torque = jaxhb.Torque(
        disk="a", mean=mean * radius, harmonics=[(1.0, 2 * amplitude * radius, 0.0)]
    )
    return jaxhb.build(
        [*gears, mesh, torque, jaxhb.Load(disk="b")],
        reference="a",
        revolutions_per_cycle=1,
    )


@pytest.mark.slow
def test_boundaries_over_the_mean_torque_are_a_closed_form():
    rpm = np.linspace(0.5, 1.5, 21) * NATURAL * 30 / np.pi
    means = [200.0, 400.0, 3000.0]
    boundary = jaxhb.lift_off(
        pair(200.0, 100.0), rpm=rpm, over="a:torque.mean", values=0.5 * np.array(means)
    )
    # Teeth part where the alternating elastic force, 100 N / |1 - r^2 + 0.1 i r|,
    # exceeds the mean one.
    for mean in means[:2]:
        b = 2 * (1 - 0.005)
        roots = np.sqrt(np.roots([1, -b, 1 - (100.0 / mean) ** 2]).real)
        of_mean = boundary.value == 0.5 * mean
        np.testing.assert_allclose(
            np.sort(boundary.rpm[of_mean]),
            np.sort(roots) * NATURAL * 30 / np.pi,
            rtol=1e-5,
        )
        assert boundary.parts[of_mean].tolist() == [True, False]
        assert set(boundary.mesh) == {"a|b"}
    assert boundary.never.tolist() == [1500.0]
    assert not len(boundary.always)


@pytest.mark.slow
def test_marches_part_on_one_side_of_the_boundary_alone():
    train = pair(400.0, 60.0, varying=[(1, 0.25, 0.0)])
    unit = NATURAL * 30 / np.pi
    boundary = jaxhb.lift_off(train, rpm=[0.6 * unit, 0.75 * unit, 0.95 * unit])
    (at,) = boundary.rpm
    assert boundary.parts.tolist() == [True]
    below, above = (jaxhb.steady_state(train, rpm=at * share) for share in (0.99, 1.01))
    assert (
        below.mesh("a|b").separated_fraction == 0 < above.mesh("a|b").separated_fraction
    )


def test_speeds_that_do_not_rise_are_refused():
    with pytest.raises(jaxhb.SceneError, match="two speeds or more that rise"):
        jaxhb.lift_off(pair(200.0, 100.0), rpm=[1000.0, 900.0])
