"""Loads from far below to far above the forces of the gap: a solution that converged
has the forces of the load.
"""

import dataclasses

import jax
import numpy as np
import pytest
from reference_data import DATA

import jaxhb
from jaxhb._jax import on_host
from jaxhb.results.status import Status
from jaxhb.solutions.planning import _mesh_forces_of_host
from jaxhb.steady.marching import Equations

PAIR = """
[scene]
name = "a pair far below its resonances"
revolutions_per_cycle = 1
reference = "a"
[[disk]]
name = "a"
inertia = 0.01
radius = 0.05
[[disk]]
name = "b"
inertia = 0.04
radius = 0.1
[[mesh]]
between = ["a", "b"]
stiffness = 1e8
backlash = 1e-4
[[torque]]
name = "drive"
disk = "a"
mean = 1.0
harmonics = [[1.0, 0.4, 0.1]]
[[torque]]
name = "brake"
disk = "b"
mean = -2.0
"""


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    path = tmp_path_factory.mktemp("pair") / "pair.toml"
    path.write_text(PAIR)
    return jaxhb.load_scene(path)


LOADS = 10.0 ** np.arange(-12, 1)
"""Over the force of the gap."""
SOLVED_WITHOUT_SPRING = np.append(LOADS[0], LOADS[4:])
"""Where no spring acts in the gap, no start leads to a motion under less than 1e-8, and
each search takes as long as all other solves together: one stands for them.
"""


@pytest.mark.parametrize(
    ("load", "epsilon", "transition", "method"),
    [
        *((load, 1e-3, 0.04, "reduced") for load in LOADS),
        *(
            pytest.param(load, epsilon, transition, method, marks=pytest.mark.slow)
            for loads, epsilon, transition, method in (
                (LOADS, 1e-3, 0.04, "chain"),
                (SOLVED_WITHOUT_SPRING, 0.0, 0.2, "reduced"),
                (SOLVED_WITHOUT_SPRING, 0.0, 0.2, "chain"),
            )
            for load in loads
        ),
    ],
)
def test_a_force_that_converged_is_right_however_small_the_load_is_beside_the_gap(
    pair, load, epsilon, transition, method
):
    """Slow motion: the teeth carry the mean torque over the radius, and half of its
    vibration as both gears are equally heavy along the teeth, whether they lie in the
    gap or in contact.
    """
    stiffness = 1e11
    backlash = 0.01
    torque = load * stiffness * backlash / 2 * 0.05
    train = pair.replace(
        {
            "a|b.stiffness": stiffness,
            "a|b.backlash": backlash,
            "a|b.epsilon": epsilon,
            "a|b.transition": transition,
            "drive.mean": torque,
            "brake.mean": -2 * torque,
            "drive.harmonics": [[0.4 * torque, 0.1 * torque]],
        }
    )
    response = jaxhb.solve(train, rpm=0.05, harmonics=16, method=method)
    status = Status(int(response.status))
    force = response.force("a", "b")
    mean = torque / 0.05
    amplitude = abs(0.4 + 0.1j) * torque / 0.05 / 2
    # Wholly in the gap or wholly in contact: two linear trains.
    if epsilon and not 1e-4 < load < 1e-1:
        assert status == Status.CONVERGED
    # Without a spring in the gap rounding leaves nothing of the smallest loads.
    if epsilon or load > 5e-8:
        assert status <= Status.TOLERANCE_NOT_MET
    if status <= Status.TOLERANCE_NOT_MET:
        actual = [force.mean, force.max, force.min]
        expected = [mean, mean + amplitude, mean - amplitude]
        largest = 1e-4 if status == Status.CONVERGED else 1e-2
        np.testing.assert_allclose(actual, expected, atol=largest * mean)


@pytest.mark.parametrize("method", ["reduced", "chain"])
@pytest.mark.parametrize(
    ("scene", "rpm", "largest"),
    [
        ("tiny_load.toml", 54863.54, 4.53552e-5),
        ("never_leaves_gap.toml", 0.10174, 0.982802),
    ],
)
def test_teeth_that_stay_in_the_gap_carry_the_torque_over_the_radius(
    scene, rpm, largest, method
):
    """The ``largest`` force is that of the linear pair with the stiffness of the gap,
    ``F + |F1| k/(k - m w^2)``.
    """
    train = jaxhb.load_scene(DATA / "scenes" / scene)
    response = jaxhb.check(jaxhb.solve(train, rpm=rpm, harmonics=16, method=method))
    radius = np.asarray(train.disks.radius)
    mass = np.asarray(train.disks.inertia) / np.asarray(train.disks.radius) ** 2
    torque = float(train.torques.mean[0])
    wave = abs(complex(*np.asarray(train.torques.harmonics)[0, 0]))
    frequency = 2 * np.pi * rpm / 60
    together = mass[0] * mass[1] / mass.sum()
    stiffness = 1e-3 * float(train.meshes.stiffness[0])
    mean = torque / radius[0]
    growth = stiffness / (stiffness - together * frequency**2)
    amplitude = wave / radius[0] * mass[1] / mass.sum() * growth
    force = response.force("a", "b")
    assert mean + amplitude == pytest.approx(largest, rel=1e-5)
    assert force.mean == pytest.approx(mean, rel=1e-6)
    assert force.max == pytest.approx(mean + amplitude, rel=1e-6)


@pytest.mark.parametrize(
    ("scene", "rpm"), [("tiny_load.toml", 54863.54), ("never_leaves_gap.toml", 0.10174)]
)
def test_plans_and_marches_know_the_forces_of_contact_however_far_the_train_turns(
    scene, rpm
):
    """Mean torque over the radius, and of the vibration what two masses leave for the
    spring between them.
    """
    train = jaxhb.load_scene(DATA / "scenes" / scene)
    radius = np.asarray(train.disks.radius)
    mass = np.asarray(train.disks.inertia) / np.asarray(train.disks.radius) ** 2
    stiffness = float(train.meshes.stiffness[0])
    together = mass[0] * mass[1] / mass.sum()
    real, imaginary = np.asarray(train.torques.harmonics)[0, 0]
    wave = complex(real, imaginary) / radius[0] * mass[1] / mass.sum()
    frequency = 2 * np.pi * rpm / 60
    vibration = wave * stiffness / (stiffness - together * frequency**2) / 2
    expected = [float(train.torques.mean[0]) / radius[0], vibration]
    planned = _mesh_forces_of_host(on_host(train), np.array([rpm]), 1)[0, 0]
    marched = stiffness * Equations(train).linear_motion([rpm]).deflection[0, 0, :2]
    np.testing.assert_allclose([planned, marched], [expected, expected], rtol=1e-9)


def light(pair, load):
    """The pair with a load of so many times the force of the gap, and the mean and the
    vibration of its tooth force.
    """
    stiffness = 1e11
    backlash = 0.01
    torque = load * stiffness * backlash / 2 * 0.05
    numbers = {
        "a|b.stiffness": stiffness,
        "a|b.backlash": backlash,
        "a|b.epsilon": 1e-3,
        "a|b.transition": 0.04,
        "drive.mean": torque,
        "brake.mean": -2 * torque,
        "drive.harmonics": [[0.4 * torque, 0.1 * torque]],
    }
    return pair.replace(numbers), torque / 0.05, abs(0.4 + 0.1j) * torque / 0.05 / 2


@pytest.mark.parametrize("load", [1e-12, 1e-7])
def test_multipliers_of_teeth_that_stay_in_the_gap_are_those_of_its_spring(pair, load):
    """Turning as one has the multiplier 1 twice; equal masses of 4 kg on the spring of
    the gap turn by w T.
    """
    train, *_ = light(pair, load)
    multipliers = jaxhb.stability(
        jaxhb.solve(train, rpm=0.05, harmonics=16)
    ).multipliers
    swing = np.exp(1j * np.sqrt(1e-3 * 1e11 / 2) * 1200)
    assert len(multipliers) == 4
    for expected in (1.0, swing, swing.conjugate()):
        assert np.abs(multipliers - expected).min() < 1e-5


@pytest.mark.slow
def test_solves_of_many_light_loads_side_by_side_have_the_forces_of_each(pair):
    train, *_ = light(pair, 1e-6)
    plan = jaxhb.plan(train, rpm=0.05, harmonics=16)
    loads = 10.0 ** np.arange(-12, -4)

    def solved(share):
        torques = {
            "drive.mean": train.value("drive.mean") * share,
            "brake.mean": train.value("brake.mean") * share,
            "drive.harmonics": train.torques.harmonics[0] * share,
        }
        response = jaxhb.solve(train.replace(torques), rpm=0.05, plan=plan)
        force = response.force("a", "b")
        return response.status, force.mean, force.max, force.min

    status, *forces = jax.jit(jax.vmap(solved))(loads / 1e-6)
    means, vibrations = np.transpose([light(pair, load)[1:] for load in loads])
    assert (np.asarray(status) == Status.CONVERGED).all()
    np.testing.assert_allclose(
        forces, [means, means + vibrations, means - vibrations], rtol=1e-4
    )


@pytest.mark.slow
@pytest.mark.parametrize("load", [1e-12, 1e-7])
def test_the_speed_of_lift_off_does_not_depend_on_the_load(pair, load):
    """Teeth in contact part where the vibration grows to the mean: ``c / (c - m w^2) =
    2 / |0.4 + 0.1 i|``.
    """
    softer = {"a|b.stiffness": 1e9, "a|b.backlash": 1.0}
    train = light(pair, load)[0].replace(softer)
    growth = 2 / abs(0.4 + 0.1j)
    rpm = np.sqrt(1e9 / 2 * (1 - 1 / growth)) * 30 / np.pi
    boundary = jaxhb.lift_off(train, rpm=[0.5 * rpm, 1.05 * rpm])
    np.testing.assert_allclose(boundary.rpm, [rpm], rtol=1e-6)


@pytest.mark.slow  # a branch has two programs of its own
@pytest.mark.parametrize("load", [1e-12, 1e-7])
def test_a_branch_over_the_stiffness_in_the_gap_keeps_the_forces_of_the_load(
    pair, load
):
    train, mean, vibration = light(pair, load)
    branch = jaxhb.follow(
        train, "a|b.epsilon", start=1e-3, to=2e-3, rpm=0.05, harmonics=8
    )
    assert branch.value[-1] == pytest.approx(2e-3, rel=1e-9)
    np.testing.assert_allclose(branch.largest_force[:, 0], mean + vibration, rtol=1e-6)
    np.testing.assert_allclose(branch.smallest_force[:, 0], mean - vibration, rtol=1e-6)


@pytest.mark.slow
def test_a_residual_that_leaves_the_mean_forces_unbalanced_is_not_called_converged(
    pair,
):
    """Newton's method ends at once with so large a residual: on the flank, where the
    teeth carry more than the load.
    """
    train = pair.replace(
        {"drive.mean": 1e-4, "brake.mean": -2e-4, "drive.harmonics": [[0.0, 0.0]]}
    )
    plan = dataclasses.replace(
        jaxhb.plan(train, rpm=60.0, harmonics=16), residual_tolerance=1e9
    )
    response = jaxhb.solve(train, rpm=60.0, plan=plan)
    mean = response.force("a", "b").mean
    assert abs(mean - 1e-4 / 0.05) > 0.1 * 1e-4 / 0.05
    assert response.status > Status.TOLERANCE_NOT_MET


@pytest.mark.slow
def test_a_steady_state_keeps_no_vibration_of_its_start_where_nothing_damps_it(pair):
    """A march from rest on the flank of a light load falls through the gap, where
    damping in contact ends, and swings there for ever.
    """
    torque = 1e-5
    train = pair.replace(
        {
            "a|b.damping": 2000.0,
            "drive.mean": torque,
            "brake.mean": -2 * torque,
            "drive.harmonics": [[0.4 * torque, 0.1 * torque]],
            # The resonance of the gap lies far above the order, as the closed form has
            # it.
            "a|b.epsilon": 1e-3,
        }
    )
    state = jaxhb.steady_state(train, rpm=20.0)
    assert state.kind == "periodic"
    assert "nothing damps" in state.notes[0]
    force = state.force("a", "b")
    amplitude = abs(0.4 + 0.1j) * torque / 0.05 / 2
    actual = [float(force.mean), float(force.max), float(force.min)]
    expected = torque / 0.05 + amplitude * np.array([0, 1, -1])
    np.testing.assert_allclose(actual, expected, rtol=1e-4)
