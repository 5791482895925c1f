"""Forced response of linear trains against dense matrices, periodic solutions,
published curves and differences.
"""

import dataclasses

import dense
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiling import executables
from differences import check_derivative
from tolerances import ALGEBRAIC
from trains import branched_parts, build, chain_parts, gearbox_parts

import jaxhb
from jaxhb import Damper, Ground, Mesh, SceneError, Shaft, Status, Torque
from jaxhb.linear import forced

TRAINS = {
    "branched": (branched_parts(), "flywheel"),
    "closed loop, free": (gearbox_parts(grounded=False), "motor"),
}
SPEEDS = np.array([200.0, 900.0, 1500.0, 3333.0])
BALANCE = 1e-10
"""Power brought in less power turned into heat, over the first."""


def linear_parts(parts):
    """The same parts with meshes that never leave contact."""
    return [
        Mesh(between=part.between, stiffness=part.stiffness, damping=part.damping)
        if isinstance(part, Mesh)
        else part
        for part in parts
    ]


def exact(parts, omega, torque):
    """Angles ``(S,)`` by a dense solve; parts that no stiffness holds stay at rest."""
    Z = dense.dynamic_stiffness(parts, omega)
    return (
        np.linalg.solve(Z, torque)
        if omega
        else np.linalg.lstsq(Z, torque, rcond=1e-13)[0]
    )


@pytest.fixture(scope="module", params=TRAINS)
def case(request):
    parts, name = TRAINS[request.param]
    parts = linear_parts(parts)
    train = build(parts, reference=name, cycle=2)
    return parts, train, jaxhb.forced_response(train, rpm=SPEEDS)


def ends_of(part):
    """The disks at the ends of a link, or the disk and the name of a damper."""
    return (part.disk, part.name) if isinstance(part, Damper) else part.between


@pytest.mark.slow
def test_few_speeds_more_or_less_compile_nothing_and_change_no_bit(case):
    _, train, response = case
    before = executables(forced._respond)
    fewer = jaxhb.forced_response(train, rpm=SPEEDS[:3])
    assert executables(forced._respond) == before
    for some, every in zip(
        jax.tree.leaves(fewer), jax.tree.leaves(response), strict=True
    ):
        np.testing.assert_array_equal(some, every[:3])


@pytest.mark.slow
def test_amplitudes_are_those_of_dense_matrices(case):
    parts, train, response = case
    torques = dense.torques(parts, response.harmonics, 2)
    for row, rpm in enumerate(SPEEDS):
        omega = float(train.topology.cycle_frequency(rpm))
        orders = range(1, response.harmonics + 1)
        angles = [exact(parts, n * omega, torques[:, n]) for n in orders]
        expected = np.array(angles).T
        # The condition of the matrices counts for 30.
        rounding = 30 * ALGEBRAIC
        np.testing.assert_allclose(
            response.angles[row][:, 1:],
            expected,
            rtol=0,
            atol=rounding * np.abs(expected).max(),
        )
        links = {
            ends_of(part): (part, incidence) for part, incidence in dense.links(parts)
        }
        for (a, b), (part, incidence) in links.items():
            stiffness = np.array(
                [dense.link_stiffness(part, n * omega) for n in orders]
            )
            force = stiffness * (incidence @ expected)
            signal = (
                response.force(a, b)
                if isinstance(part, Mesh)
                else response.torque(a, b)
            )
            largest = (np.abs(incidence) @ np.abs(expected)).max()
            size = rounding * np.abs(stiffness).max() * largest
            np.testing.assert_allclose(
                signal.coefficients[row, 1:], force, rtol=0, atol=size
            )
            elastic = part.stiffness * (incidence @ expected)
            np.testing.assert_allclose(
                signal.elastic.coefficients[row, 1:], elastic, rtol=0, atol=size
            )


@pytest.mark.slow
def test_power_is_the_mean_of_torque_times_speed_and_that_of_the_torques(case):
    parts, train, response = case
    heat = response.disk_power.sum(-1) + response.link_power.sum(-1)
    np.testing.assert_allclose(heat, response.input_power, rtol=BALANCE)
    assert (response.link_power >= 0).all()
    assert (response.disk_power >= 0).all()
    frequency = np.array(train.topology.cycle_frequency(SPEEDS))
    omega = frequency[:, None] * np.arange(response.harmonics + 1)
    for part, _ in dense.links(parts):
        a, b = ends_of(part)
        if isinstance(part, Mesh):
            force = response.force(a, b)
            deflection = response.deflection(a, b)
        else:
            force = response.torque(a, b)
            deflection = response.twist(a, b)
        rate = 1j * omega * deflection.coefficients
        mean = 2 * (force.coefficients * np.conj(rate)).real[:, 1:].sum(-1)
        apparent = 2 * np.abs(force.coefficients * rate)[:, 1:].sum(-1)
        np.testing.assert_array_less(
            np.abs(response.power(a, b) - mean), 1e-8 * apparent + 1e-12
        )


def test_it_is_the_periodic_response_of_the_same_train():
    train = build(
        linear_parts(gearbox_parts(grounded=False)), reference="motor", cycle=2
    )
    response = jaxhb.forced_response(train, rpm=SPEEDS)
    periodic = jaxhb.linear_response(train, rpm=SPEEDS[2])
    for name in (
        "angles",
        "torques",
        "elastic_torques",
        "deflections",
        "forces",
        "load_power",
    ):
        values = np.asarray(getattr(response[2], name))
        expected = np.asarray(getattr(periodic, name))
        if expected.ndim:
            expected = expected[..., : response.harmonics + 1]
        size = np.abs(expected).max(initial=0.0)
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-11 * size)
    assert response.converged.all()
    assert response.residual.max() < 1e-11


@pytest.mark.slow
def test_speeds_beyond_a_group_are_those_of_one_by_one():
    train = jaxhb.load_scene("six_cylinder_diesel")
    # 24 half orders: groups of 19, the last one padded.
    rpm = np.linspace(600.0, 2600.0, 47)
    sweep = jaxhb.forced_response(train, rpm=rpm)
    for row in (18, 19, 46):
        alone = jaxhb.forced_response(train, rpm=rpm[row])
        np.testing.assert_allclose(
            sweep.angles[row],
            alone.angles,
            rtol=0,
            atol=ALGEBRAIC * np.abs(alone.angles).max(),
        )


def test_an_undamped_resonance_is_told_and_its_neighbours_are_not_spoilt():
    train = build(
        [
            *chain_parts([2.0, 2.0], [100.0]),
            Torque(disk="1", harmonics=((1.0, 1.0, 0.0),)),
        ]
    )
    rpm = np.array([5.0, 10.0, 20.0]) * 60 / (2 * np.pi)
    response = jaxhb.forced_response(train, rpm=rpm)
    assert response.status.tolist() == [
        Status.CONVERGED,
        Status.NEAR_SINGULAR,
        Status.CONVERGED,
    ]
    with pytest.raises(jaxhb.NotConverged, match="undamped resonance"):
        jaxhb.check(response)


def loaded(parts, at="1"):
    return build([*parts, Torque(disk=at, harmonics=((1.0, 1.0, 0.0),))])


TEN = 10 * 30 / np.pi
"""rpm of 10 rad/s, at which every train below is excited."""
SINGULAR = {
    "all disks move as one and no link is strained": loaded(
        [
            *chain_parts([1.0, 1.0], [50.0]),
            Ground(disk="1", stiffness=100.0),
            Ground(disk="2", stiffness=100.0),
        ]
    ),
    "closed loop": loaded(
        [
            *chain_parts([1.0, 1.0, 1.0], [100 / 3] * 2),
            Shaft(between=("3", "1"), stiffness=100 / 3),
        ]
    ),
    "loop whose last pivot is exactly zero": loaded(
        [
            *chain_parts([3.0, 3.0, 2.0, 3.0], [200.0, 100.0, 100.0]),
            Shaft(between=("4", "1"), stiffness=200.0),
        ],
        at="2",
    ),
    # Regular, but the tree under disk 3 is at resonance where disk 2 rests: elimination
    # leaves no digit of disk 3.
    "no digit left": loaded(chain_parts([2.0, 3.0, 1.0], [70.0, 100.0]), at="3"),
    "torques that cancel": loaded(
        [
            *chain_parts([2.0, 2.0], [100.0]),
            Torque(disk="2", harmonics=((1.0, 1.0, 0.0),)),
        ]
    ),
    "torque where the mode rests": loaded(
        chain_parts([1.0, 2.0, 1.0], [100.0, 100.0]), at="2"
    ),
}


@pytest.mark.parametrize("name", SINGULAR)
def test_equations_without_an_answer_are_singular_whatever_the_rounding(name):
    rpm = np.array([TEN, np.nextafter(TEN, 0), np.nextafter(TEN, 100)])
    response = jaxhb.forced_response(SINGULAR[name], rpm=rpm)
    assert response.status.tolist() == [Status.NEAR_SINGULAR] * 3


@pytest.mark.parametrize(
    "name",
    [
        "no digit left",
        "loop whose last pivot is exactly zero",
        "torques that cancel",
        "torque where the mode rests",
    ],
)
def test_a_solve_judges_as_the_forced_response_does(name):
    assert jaxhb.solve(SINGULAR[name], rpm=TEN).status == Status.NEAR_SINGULAR


def test_numbers_that_overflow_are_no_resonance():
    train = loaded(chain_parts([2.0, 2.0], [100.0], damping=1.0))
    name = f"{train.topology.shaft_names[0]}.stiffness"

    def status(stiffness):
        return jaxhb.forced_response(train.replace({name: stiffness}), rpm=TEN).status

    # Outside of transformations such a stiffness is refused.
    assert jax.jit(status)(1e200) == Status.NONFINITE


def test_a_resonance_that_no_torque_excites_changes_nothing():
    # Order 2 at 5 rad/s is exactly the natural frequency, 10 rad/s.
    train = loaded(chain_parts([2.0, 2.0], [100.0]))
    expected = jaxhb.solve(train, rpm=TEN / 2, harmonics=1)
    response = jaxhb.solve(train, rpm=TEN / 2, harmonics=2)
    assert response.status == Status.CONVERGED
    np.testing.assert_allclose(
        response.angles[:, 1], expected.angles[:, 1], rtol=ALGEBRAIC
    )
    assert not response.angles[:, 2].any()


@pytest.mark.slow
def test_mean_torques_that_nothing_takes_are_unbalanced():
    train = build(
        [
            *chain_parts([2.0, 2.0], [100.0], damping=1.0),
            Torque(disk="1"),
            Torque(disk="2"),
        ]
    )
    means = {"1:torque.mean": 4.0, "2:torque.mean": -4.0}
    assert (
        jaxhb.forced_response(train.replace(means), rpm=90.0).status == Status.CONVERGED
    )

    def status(mean):
        return jaxhb.forced_response(
            train.replace({"1:torque.mean": mean}), rpm=90.0
        ).status

    assert jax.jit(status)(4.0) == Status.UNBALANCED


@pytest.mark.slow
def test_teeth_with_backlash_count_as_in_contact():
    parts = gearbox_parts()
    loose_parts = [
        dataclasses.replace(part, backlash=1e-4) if isinstance(part, Mesh) else part
        for part in parts
    ]
    response = jaxhb.forced_response(build(loose_parts, reference="motor"), rpm=900.0)
    expected = jaxhb.forced_response(build(parts, reference="motor"), rpm=900.0)
    np.testing.assert_array_equal(response.forces, expected.forces)
    assert response.mesh("lay 3", "output").separated_fraction == 0.0


def test_a_traced_speed_that_is_none_is_invalid():
    train = jaxhb.load_scene("six_cylinder_diesel")
    status = jax.jit(lambda rpm: jaxhb.forced_response(train, rpm=rpm).status)
    assert [int(status(rpm)) for rpm in (-100.0, 1.1e6, 900.0)] == [
        Status.INVALID_INPUT
    ] * 2 + [Status.CONVERGED]


@pytest.mark.parametrize(
    ("rpm", "harmonics"), [(0.0, None), ([900.0, 2e6], None), ([], None), (900.0, 0)]
)
def test_bad_requests_are_refused(rpm, harmonics):
    train = jaxhb.load_scene("six_cylinder_diesel")
    with pytest.raises(SceneError, match="speed is|harmonics is 0|rpm"):
        jaxhb.forced_response(train, rpm=rpm, harmonics=harmonics)


KEYS = [
    "lay 1.inertia",
    "input 1|input 2.stiffness",
    "output|mill.loss_factor",
    "viscous ring.damping",
    "input 1|lay 1.stiffness",
    "mill.damping",
    "lay 2:ground.stiffness",
]


@pytest.mark.slow
def test_derivatives_of_amplitudes_and_powers_are_those_of_differences():
    train = build(linear_parts(gearbox_parts()), reference="motor", cycle=2)

    def numbers(values):
        changed = train.replace(dict(zip(KEYS, values[:-1], strict=True)))
        rpm = values[-1] * jnp.array([1.0, 1.3])
        response = jaxhb.forced_response(changed, rpm=rpm)
        outputs = [
            response.torque("coupling", "motor").order(1.0),
            response.force("lay 3", "output").sum_of_amplitudes,
            response.torque("coupling", "motor").half_peak_to_peak,
            response.disk("mill").smooth_peak(),
            response.power("rubber ring"),
            response.power("output", "mill"),
            response.input_power,
        ]
        return jnp.concatenate(outputs)

    check_derivative(numbers, [*(train.value(key) for key in KEYS), 900.0])
