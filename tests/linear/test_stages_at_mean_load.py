"""Linear calculations of trains with stages, stops, clearance and friction: at the mean
load, against closed forms of two disks and the motion of :func:`jaxhb.solve`.
"""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import GRADIENT, PATHS

import jaxhb
from jaxhb.design import Measured, Parameter
from jaxhb.linear.tangent import at_pressed_load
from jaxhb.report.text.linear import approximations

RATTLE = Path(__file__).parents[1] / "data" / "scenes" / "idle_rattle.toml"
FIRST = 20.0  # N m/rad
SECOND = 600.0  # N m/rad
TWIST = 4.0  # deg at which the second stage begins
INERTIA = (0.15, 0.005)


def clutch(mean=30.0, harmonic=0.5, scale=None, **changes):
    """Two disks joined by a clutch disc of two stages, under a mean torque."""
    disc = jaxhb.Shaft(
        name="disc",
        between=("a", "b"),
        stiffness=FIRST,
        damping=0.05,
        stages=[(TWIST, SECOND)],
    )
    drive = jaxhb.Torque(
        name="drive", disk="a", mean=mean, harmonics=[(2.0, harmonic, 0.0)]
    )
    parts = [
        jaxhb.Disk(name="a", inertia=INERTIA[0]),
        jaxhb.Disk(name="b", inertia=INERTIA[1]),
        dataclasses.replace(disc, **changes),
        dataclasses.replace(drive, scale=scale) if scale else drive,
        jaxhb.Load(disk="b"),
    ]
    return jaxhb.build(parts, reference="a", revolutions_per_cycle=1)


def hertz(stiffness):
    """The frequency of the two disks."""
    return np.sqrt(stiffness * sum(1 / inertia for inertia in INERTIA)) / (2 * np.pi)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mean", "stiffness"), [(0.5, FIRST), (30.0, SECOND), (-30.0, SECOND), (0.0, FIRST)]
)
def test_every_linear_calculation_takes_the_stage_that_carries_the_mean(
    mean, stiffness
):
    train = clutch(mean)
    hz = hertz(stiffness)
    modes = jaxhb.natural_frequencies(train)
    assert modes.frequencies_hz[1] == pytest.approx(hz, rel=PATHS)
    assert jaxhb.all_frequencies(train)[1] == pytest.approx(hz, rel=PATHS)
    assert float(jaxhb.frequencies_hz(train)[1]) == pytest.approx(hz, rel=PATHS)
    omega = 2 * np.pi * hz
    table = jaxhb.holzer_table(train, hz=hz)
    assert table.stiffness[0] == pytest.approx(stiffness, rel=PATHS)
    assert abs(table.residual) < 1e-9 * abs(table.torque).max()
    eigenvalue = jaxhb.damped_modes(train).eigenvalues[0]
    assert np.abs(eigenvalue) == pytest.approx(omega, rel=PATHS)
    (critical,) = jaxhb.campbell(train, rpm=[50.0, 5000.0], orders=[2.0]).critical
    assert critical.rpm == pytest.approx(30 * hz, rel=PATHS)
    _, matrix = jaxhb.inertia_and_stiffness(train)
    np.testing.assert_allclose(
        matrix, stiffness * np.array([[1, -1], [-1, 1]]), rtol=PATHS
    )
    link = stiffness + 0.05j * 0.7 * omega
    Z = -((0.7 * omega) ** 2) * np.diag(INERTIA) + link * np.array([[1, -1], [-1, 1]])
    (response,) = jaxhb.frequency_response(train, "b", "a", jnp.array([0.7 * hz]))
    expected = complex(np.linalg.inv(Z)[1, 0])
    assert complex(response) == pytest.approx(expected, rel=PATHS)


@pytest.mark.slow
def test_small_vibrations_about_the_mean_are_those_of_the_motion_with_stages():
    train = clutch()
    motion = jaxhb.solve(train, rpm=900.0, harmonics=8)
    linear = jaxhb.forced_response(train, rpm=[900.0, 950.0])
    order = float(motion.torque("a", "b").order(2.0))
    orders = linear.torque("a", "b").order(2.0)
    assert float(orders[0]) == pytest.approx(order, rel=1e-6)
    twist = float(motion.twist("a", "b").mean)
    assert float(linear.twist("a", "b").mean[0]) == pytest.approx(twist, rel=1e-6)
    alone = jaxhb.forced_response(train, rpm=900.0)
    assert float(alone.torque("disc").order(2.0)) == pytest.approx(order, rel=1e-6)


def test_stops_count_on_their_side_and_clearances_as_closed():
    twisted = FIRST * np.deg2rad(5.0) + 30.0
    stopped = clutch(twisted, stages=[], stops=[(5.0, 3000.0)])
    turned_back = clutch(-twisted, stages=[], stops=[(5.0, 3000.0)])
    expected = hertz(FIRST + 3000.0)
    assert jaxhb.all_frequencies(stopped)[1] == pytest.approx(expected, rel=PATHS)
    assert jaxhb.all_frequencies(turned_back)[1] == pytest.approx(
        hertz(FIRST), rel=PATHS
    )
    idle = clutch(0.0, stages=[], clearance=2.0)
    assert jaxhb.all_frequencies(idle)[1] == pytest.approx(hertz(FIRST), rel=PATHS)
    load = jaxhb.at_mean_load(idle, rpm=900.0)
    assert load.link_stiffness == pytest.approx([1e-3 * FIRST], rel=PATHS)


@pytest.mark.slow
def test_a_mean_torque_that_grows_with_the_speed_changes_the_stage_over_it():
    train = clutch(scale=[(500.0, 0.01), (3000.0, 1.0)])
    diagram = jaxhb.campbell(train, rpm=[500.0, 3000.0], orders=[2.0])
    np.testing.assert_allclose(
        diagram.frequencies_hz[:, 1], [hertz(FIRST), hertz(SECOND)], rtol=PATHS
    )
    both = jaxhb.forced_response(train, rpm=[500.0, 3000.0])
    alone = [
        jaxhb.forced_response(train, rpm=rpm).torque("disc").order(2.0)
        for rpm in (500.0, 3000.0)
    ]
    np.testing.assert_allclose(both.torque("disc").order(2.0), alone, rtol=PATHS)
    # Without a speed the highest counts, or the rated one.
    assert jaxhb.all_frequencies(train)[1] == pytest.approx(hertz(SECOND), rel=PATHS)


@pytest.mark.slow
def test_the_stiffness_at_the_mean_load_has_derivatives():
    train = clutch()

    def frequency(stiffness):
        changed = train.replace({"disc.stages": jnp.array([[TWIST, stiffness]])})
        return jaxhb.frequencies_hz(changed)[1]

    slope = jax.grad(frequency)(SECOND)
    assert float(slope) == pytest.approx(hertz(SECOND) / (2 * SECOND), rel=GRADIENT)
    with pytest.raises(ValueError, match="Call it outside, where it has derivatives"):
        jax.jit(frequency)(SECOND)


def test_approximations_are_told_with_their_elements():
    train = clutch(friction=0.6, clearance=0.5)
    report = "\n".join(approximations(train))
    for words in (
        "disc: linear with 600 N m/rad",
        "mean torque of 30 N m",
        "clearance is taken",
        "friction of 0.6 N m",
    ):
        assert words in report
    shaken = clutch(harmonic=40.0)
    response = jaxhb.forced_response(shaken, rpm=[1000.0, 1660.0])
    (crossing,) = [
        text
        for text in approximations(shaken, response.rpm, response)
        if "leaves this stage" in text
    ]
    assert crossing.startswith("disc: ")
    assert "at 1660 rpm" in crossing
    unloaded = jaxhb.load_scene(RATTLE).without("flywheel:load")
    assert "no load balances" in " ".join(approximations(unloaded))


@pytest.mark.slow
def test_the_stiffness_of_a_staged_link_is_not_fitted():
    train = clutch()
    rpm = np.array([600.0, 900.0])
    rows = Measured(
        rpm=rpm,
        order=np.full(2, 2.0),
        element=("disc",) * 2,
        quantity=("torque",) * 2,
        amplitude=jaxhb.forced_response(train, rpm=rpm).torque("disc").order(2.0),
        phase=np.full(2, np.nan),
    )
    stiffness = Parameter(name="disc.stiffness", low=10.0, high=40.0)
    with pytest.raises(jaxhb.SceneError, match="its link is linear here"):
        jaxhb.identify(train, rows, parameters=[stiffness])
    inertia = Parameter(name="b.inertia", low=0.003, high=0.008)
    fit = jaxhb.identify(train, rows, parameters=[inertia])
    assert fit.train.value("b.inertia") == pytest.approx(INERTIA[1], rel=1e-4)
    assert fit.train.topology.springs


@pytest.mark.parametrize("loop", [False, True])
def test_links_of_more_than_1000_disks_are_taken_at_their_mean_load(loop):
    """A branched train: its links in equilibrium, and its angles those of a dense solve
    with the first disk held.
    """
    disks = 1100
    drive = np.array([1200.0, -700.0])
    knee = 0.003
    second = 5e5
    pairs = [(k - 1 if k % 5 else max(0, k - 6), k) for k in range(1, disks)]
    if loop:
        pairs.append((2, 550))
    stiffness = 1e5 * (1 + 0.1 * (np.arange(len(pairs)) % 7))
    staged = np.arange(len(pairs)) % 4 == 0
    parts = [jaxhb.Disk(name=f"d{k}", inertia=1.0) for k in range(disks)]
    for number, (a, b) in enumerate(pairs):
        shaft = jaxhb.Shaft(
            name=f"s{number}",
            between=(f"d{a}", f"d{b}"),
            stiffness=stiffness[number],
            stages=[(np.degrees(knee), second)] if staged[number] else (),
        )
        parts.append(shaft)
    parts += [
        jaxhb.Torque(disk=f"d{k}", mean=mean)
        for k, mean in zip((0, 7), drive, strict=True)
    ]
    parts.append(jaxhb.Load(disk=f"d{disks - 1}"))
    load = at_pressed_load(jaxhb.build(parts, reference="d0"))
    assert load.loaded

    first, last = np.array(pairs).T
    rows = np.zeros((len(pairs), disks))
    rows[np.arange(len(pairs)), first] = 1.0
    rows[np.arange(len(pairs)), last] = -1.0
    twist = rows @ load.angle
    beyond = staged & (np.abs(twist) > knee)
    assert 10 < beyond.sum() < staged.sum()
    sharp = np.where(beyond, (stiffness - second) * knee * np.sign(twist), 0.0)
    sharp += np.where(beyond, second, stiffness) * twist
    # The knees of the law are rounded.
    np.testing.assert_allclose(load.torque, sharp[staged], rtol=0.02, atol=0.1)
    slope = stiffness.copy()
    offset = np.zeros(len(pairs))
    slope[staged] = load.link_stiffness
    offset[staged] = load.torque - load.link_stiffness * twist[staged]
    applied = np.zeros(disks)
    applied[[0, 7, disks - 1]] = [*drive, -drive.sum()]
    matrix = (rows.T * slope) @ rows
    torque = applied - rows.T @ offset
    angles = np.linalg.solve(matrix[1:, 1:], torque[1:])
    np.testing.assert_allclose(
        load.angle[1:] - load.angle[0], angles, atol=1e-9 * np.abs(angles).max()
    )
