"""Torques of events against closed forms, written out in NumPy by themselves."""

import jax
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

import jaxhb
from jaxhb import Cylinder, Disk, Event, Ground, Ice, Load, Mesh, Pulse, Shaft
from jaxhb.transients.events import (
    clutch_capacity,
    corners,
    event_torques,
    fuel_factor,
    torque_disks,
    torque_events,
)
from jaxhb.transients.loads import load_torques

RATIO = 0.25  # of the propeller, whose gear has four times the radius
TIMES = np.linspace(-0.5, 4.0, 1801)
SPEED = 12.0  # rad/s
PARTS = [
    Disk(name="engine", inertia=2.0, radius=0.1),
    Disk(name="propeller", inertia=5.0, radius=0.4),
    Disk(name="wheel", inertia=3.0),
    Mesh(name="gears", between=("engine", "propeller"), stiffness=1e8),
    Shaft(between=("engine", "wheel"), stiffness=1e4),
    Ground(disk="engine", stiffness=1.0),
    Cylinder(name="one", disk="wheel", gas_torque=[(1.0, 3.0, 0.0)]),
]
TERMS = [(900.0, 0.2, 5.0, 90.0), (-300.0, 0.7, 2.0, 0.0)]
ICE = Ice(torque=1000.0, blades=4, case=1, thickness=1.5)
EVENTS = [
    Event(name="step", disk="wheel", begin=0.5, step=70.0, factor=2.0),
    Event(name="decaying", disk="engine", begin=0.25, decaying=TERMS),
    Event(name="ramp", disk="engine", ramp=(-40.0, 1.5)),
    Event(name="half", disk="wheel", begin=0.9, pulse=Pulse(torque=30.0, seconds=0.8)),
    Event(name="misfire", misfire="one", begin=1.0),
    Event(
        name="trapezoid",
        disk="wheel",
        begin=1.0,
        pulse=Pulse(torque=5.0, seconds=1.0, shape="trapezoid", rise=0.25),
    ),
    Event(name="block", disk="engine", begin=0.5, end=1.25, step=7.0),
    Event(
        name="table",
        disk="wheel",
        table=[(0.0, 1.0), (0.5, -2.0), (2.0, 6.0)],
        begin=0.2,
    ),
    Event(name="short", disk="wheel", table=[(0.0, 4.0)]),
    Event(name="ice", disk="propeller", begin_deg=90.0, ice=ICE),
    Event(name="fuel", begin=1.0, fuel=[(0.0, 1.0), (0.5, 0.2)]),
    Event(
        name="clutch",
        begin=0.5,
        between=("engine", "wheel"),
        clutch=jaxhb.Clutch(capacity=[(0.0, 0.0), (1.0, 500.0)]),
    ),
    Event(name="start", firing_from=120.0),
]
TRAIN = jaxhb.build([*PARTS, *EVENTS], reference="engine")
NAMES = [event.name for event in EVENTS]
TORQUES = torque_events(TRAIN.topology, NAMES)
# 3e-15 of the largest number in the sums, 1000 N m
ROUNDING = 1e-11


def begins(train, names, speed=SPEED):
    """Times and angles at which events begin in a train of a constant speed."""
    seats = {seat.name: i for i, seat in enumerate(train.topology.events)}
    indices = [seats[name] for name in names]
    by_angle = np.array([train.topology.events[i].by_angle for i in indices])
    turned = np.deg2rad(train.events.begin_deg[indices])
    seconds = np.where(by_angle, turned / speed, train.events.begin[indices])
    return seconds, speed * seconds


def torque(name, train=TRAIN, times=TIMES, speed=SPEED):
    """Torque ``(n,)`` of one event of a train of a constant speed."""
    seconds, angles = begins(train, [name], speed)
    return event_torques(train, [name], times, speed * times, seconds, angles)[:, 0]


def decaying(t):
    """Sum of the two decaying sinusoids."""
    first = 900.0 * np.exp(-t / 0.2) * np.cos(2 * np.pi * 5.0 * t)
    second = 300.0 * np.exp(-t / 0.7) * np.sin(2 * np.pi * 2.0 * t)
    return first - second


FORMS = {
    "step": (0.5, lambda t: 140.0 + 0.0 * t),
    "decaying": (0.25, decaying),
    "ramp": (0.0, lambda t: np.where(t < 1.5, -40.0 * t / 1.5, -40.0)),
    "half": (0.9, lambda t: np.where(t < 0.8, 30.0 * np.sin(np.pi * t / 0.8), 0.0)),
    "trapezoid": (1.0, lambda t: 5.0 * np.clip(np.minimum(4 * t, 4 - 4 * t), 0, 1)),
    "block": (0.5, lambda t: np.where(t < 0.75, 7.0, 0.0)),
    "table": (
        0.2,
        lambda t: np.where(t < 0.5, 1 - 6 * t, np.minimum(6, 16 / 3 * t - 14 / 3)),
    ),
    "short": (0.0, lambda t: 4.0 + 0.0 * t),
}


@pytest.mark.parametrize("name", FORMS)
def test_torques_over_time_follow_their_closed_form(name):
    begin, form = FORMS[name]
    since = TIMES - begin
    # A jump is where its instant rounds to: such instants are left out.
    jumps = corners(TRAIN, name).seconds
    away = np.abs(since[:, None] - jumps).min(axis=1) > 1e-9
    expected = np.where(since >= 0.0, form(since), 0.0)
    np.testing.assert_allclose(torque(name)[away], expected[away], atol=ROUNDING)


def milled(phi, blades, coefficient, alpha, length, *, blocks=1, ramp=270.0):
    """Torque of ice at angles of the propeller in deg: the sum over all passages one by
    one, as the rule has it.
    """
    total = np.zeros_like(phi)
    spacing = 360.0 / blades / blocks
    for passage in range(int(np.ceil(length / spacing))):
        x = phi - passage * spacing
        contact = (x >= 0.0) & (x < alpha)
        total += np.where(contact, np.sin(np.deg2rad(180.0 * x / alpha)), 0.0)
    rise = np.clip(np.minimum(phi, length - phi) / ramp, 0.0, 1.0)
    inside = (phi >= 0.0) & (phi <= length)
    return np.where(inside, -coefficient * 1000.0 * rise * total, 0.0)


@pytest.mark.parametrize(
    "ice, rule",
    [
        (ICE, (4, 0.75, 90.0, 1080.0)),
        (Ice(torque=1000.0, blades=5, case=2, thickness=1.0), (5, 1.0, 135.0, 720.0)),
        (Ice(torque=1000.0, blades=6, case=4, angle_deg=900.0), (6, 0.5, 30.0, 900.0)),
        (
            Ice(
                torque=1000.0,
                blades=3,
                coefficient=0.4,
                contact_deg=200.0,
                angle_deg=1000.0,
            ),
            (3, 0.4, 200.0, 1000.0),
        ),
        (
            Ice(torque=1000.0, blades=3, contact_deg=50.0, angle_deg=400.0),
            (3, 1.0, 50.0, 400.0),
        ),
    ],
)
def test_ice_is_the_sum_of_half_sines_of_the_blades_over_the_angle_of_its_propeller(
    ice, rule
):
    train = jaxhb.build(
        [*PARTS, Event(name="ice", disk="propeller", begin_deg=90.0, ice=ice)],
        reference="engine",
    )
    times = np.linspace(0.0, 9.0, 2003)
    phi = (np.rad2deg(SPEED * times) - 90.0) * RATIO
    expected = milled(phi, *rule)
    assert expected.min() < -300.0
    # Angles in deg round to 1e-13: torques to 1e-15 of 1000 N m for each, and sines.
    np.testing.assert_allclose(torque("ice", train, times), expected, atol=1e-9)


def test_two_ice_blocks_hit_twice_as_often():
    ice = Ice(torque=1000.0, blades=4, case=3, thickness=1.0, ramp_deg=360.0)
    train = jaxhb.build(
        [*PARTS, Event(name="ice", disk="propeller", ice=ice)], reference="engine"
    )
    phi = np.rad2deg(SPEED * TIMES) * RATIO
    expected = milled(phi, 4, 0.5, 45.0, 720.0, blocks=2, ramp=360.0)
    np.testing.assert_allclose(torque("ice", train), expected, atol=1e-9)


def test_torques_stand_side_by_side_on_their_disks_whatever_their_kinds_are():
    # Those without a torque are left out, and the order is that which is asked for.
    chosen = list(reversed(NAMES))
    names = torque_events(TRAIN.topology, chosen)
    assert names == tuple(reversed(TORQUES))
    disks = [TRAIN.topology.disk_names[i] for i in torque_disks(TRAIN.topology, chosen)]
    by_name = {event.name: event.disk for event in EVENTS}
    assert disks == [by_name[name] for name in names]
    seconds, angles = begins(TRAIN, names)
    together = event_torques(TRAIN, chosen, TIMES, SPEED * TIMES, seconds, angles)
    alone = np.stack([torque(name) for name in names], axis=1)
    np.testing.assert_array_equal(together, alone)


def test_compiled_torques_are_those_of_numpy_to_rounding():
    seconds, angles = begins(TRAIN, TORQUES)
    question = TIMES, SPEED * TIMES, seconds, angles
    expected = event_torques(TRAIN, TORQUES, *question)
    compiled = jax.jit(event_torques, static_argnums=1)(TRAIN, TORQUES, *question)
    np.testing.assert_allclose(compiled, expected, atol=1e-9)


def test_events_that_do_not_begin_have_no_torque_and_no_derivative():
    never = np.full(len(TORQUES), np.inf)

    def total(train):
        return event_torques(train, NAMES, TIMES, SPEED * TIMES, never, never).sum()

    derivative = jax.jit(jax.grad(total))(TRAIN)
    assert total(TRAIN) == 0.0
    assert all((leaf == 0.0).all() for leaf in jax.tree.leaves(derivative))


KEYS = {
    "step": ("step.step", "step.factor"),
    "decaying": ("decaying.decaying",),
    "ramp": ("ramp.ramp",),
    "half": ("half.pulse.torque", "half.pulse.seconds"),
    "trapezoid": (
        "trapezoid.pulse.torque",
        "trapezoid.pulse.seconds",
        "trapezoid.pulse.rise",
    ),
    "table": ("table.table",),
    "ice": (
        "ice.ice.torque",
        "ice.ice.coefficient",
        "ice.ice.contact_deg",
        "ice.ice.angle_deg",
        "ice.ice.ramp_deg",
    ),
    "block": ("block.step",),
}


@pytest.mark.parametrize("name", KEYS)
def test_torques_have_the_derivative_of_differences_by_each_of_their_numbers(name):
    # Instants at no corner, about which differences would not be derivatives
    times = np.array([1.0437, 1.1283, 1.3379, 1.8371, 2.2437])
    seconds, angles = begins(TRAIN, [name])
    weights = np.arange(1.0, 6.0)

    def total(values, begin):
        train = TRAIN.replace(dict(zip(KEYS[name], values, strict=True)))
        torques = event_torques(
            train, [name], times, 4 * SPEED * times, begin[0], begin[1]
        )
        return weights @ torques[:, 0]

    values = [np.asarray(TRAIN.value(key), dtype=float) for key in KEYS[name]]
    # Host arrays are read-only; a step of 1e-6 has an error of 1e-10 of the curvature,
    # and of 1e-10 of the torque from rounding.
    begin = (seconds, 4 * angles)
    derivative = jax.jit(jax.grad(total, argnums=(0, 1)))(values, begin)
    points, rebuild = ravel_pytree((values, begin))
    points = np.asarray(points)
    slopes, _ = ravel_pytree(derivative)
    step = 1e-6
    # The first time of a table is 0 s always.
    for i in range(name == "table", len(points)):
        shift = np.zeros(len(points))
        shift[i] = step * max(1.0, abs(points[i]))
        # In NumPy, which has no part in the derivative
        above = total(*jax.tree.map(np.asarray, rebuild(points + shift)))
        below = total(*jax.tree.map(np.asarray, rebuild(points - shift)))
        size = np.abs(slopes).max()
        difference = (above - below) / (2 * shift[i])
        np.testing.assert_allclose(slopes[i], difference, rtol=1e-5, atol=1e-6 * size)
    assert np.abs(slopes).max() > 0.0


def test_fuel_and_clutches_follow_their_tables_from_their_begin_on():
    factor = fuel_factor(TRAIN, NAMES, TIMES, np.array([1.0]))
    expected = np.interp(TIMES, [1.0, 1.5], [1.0, 0.2])
    np.testing.assert_allclose(factor, expected, atol=1e-15)
    capacity = clutch_capacity(TRAIN, ["clutch"], TIMES, np.array([0.5]))[:, 0]
    slips = TIMES >= 0.5
    expected = np.interp(TIMES, [0.5, 1.5], [0.0, 500.0])
    np.testing.assert_allclose(capacity[slips], expected[slips], atol=1e-12)
    assert np.isinf(capacity[~slips]).all()
    assert (fuel_factor(TRAIN, ["step"], TIMES, np.zeros(0)) == 1.0).all()


def test_corners_are_where_the_slope_of_a_torque_jumps():
    # Second differences of a grid are of the size of the step but about a corner.
    for name in TORQUES:
        if name == "ice":
            continue
        begin, _ = FORMS[name]
        since = np.linspace(-0.1, 3.0, 31001)
        values = torque(name, times=since + begin)
        bend = np.abs(np.diff(values, 2))
        # Smooth parts have at most T (2 pi f)^2 h^2 = 900 x 1000 x 1e-8; corners more
        # than 3e-3, the least change of slope, 16 / 3 - (-6) and so on, times h.
        kinks = since[1:-1][bend > 5e-4 if name != "decaying" else bend > 1.0]
        expected = corners(TRAIN, name).seconds
        distance = np.abs(kinks[:, None] - expected)
        assert (distance.min(axis=1) < 2e-4).all(), name
        seen = distance.min(axis=0) < 2e-4
        # A row of a table behind which nothing changes
        assert seen.all(), (name, expected, kinks)


def test_corners_of_ice_are_angles_of_the_reference_rotor():
    angles = corners(TRAIN, "ice").angles
    turns = np.rad2deg(angles) * RATIO
    # Contacts of 90 deg of four blades follow each other; rise and fall of 270 deg.
    expected = np.unique([*np.arange(0.0, 1081.0, 90.0), 270.0, 810.0])
    np.testing.assert_allclose(turns, expected, atol=1e-9)
    assert not corners(TRAIN, "ice").seconds.size
    assert corners(TRAIN, "misfire").seconds.tolist() == [0.0]


def test_an_unknown_event_is_refused_with_the_nearest():
    with pytest.raises(jaxhb.SceneError, match="no event 'stepp'. Did you mean 'step'"):
        torque_events(TRAIN.topology, ["stepp"])


def test_loads_take_the_torque_of_their_law_over_the_speed():
    rows = [(0.0, 0.0), (600.0, 30.0), (1200.0, 90.0)]
    rated = {"rated_torque": 80.0, "rated_rpm": 1000.0}
    loads = [
        Load(name="hoist", disk="wheel", law="constant", rated_torque=80.0),
        Load(name="screw", disk="propeller", law="propeller", **rated),
        Load(name="generator", disk="wheel", law="generator", **rated),
        Load(name="table", disk="wheel", over_rpm=rows),
        Load(name="rest", disk="wheel"),
    ]
    train = jaxhb.build([*PARTS, *loads], reference="engine")
    assert train.topology.load_law == (
        *("constant", "propeller", "generator", "over_rpm"),
        "",
    )
    rpm = np.array([-500.0, 0.0, 300.0, 1000.0, 1500.0])
    n = rpm / 1000.0
    table = [0.0, 0.0, 15.0, 70.0, 90.0]
    expected = [80.0 + 0 * n, 80.0 * n * abs(n), 80.0 * n, table, 0 * n]
    torques = load_torques(train, rpm)
    np.testing.assert_allclose(torques, -np.transpose(expected), atol=1e-12)
    changed = train.replace({"screw.rated_rpm": 500.0, "table.over_rpm": rows})
    assert load_torques(changed, 500.0)[1] == pytest.approx(-80.0, rel=1e-15)
    slope = jax.jit(jax.grad(lambda t, n: load_torques(t, n).sum(), argnums=(0, 1)))
    by_train, by_rpm = slope(train, 900.0)
    assert by_rpm == pytest.approx(
        -(2 * 80 * 0.9 / 1e3 + 80 / 1e3 + 60 / 600), rel=1e-12
    )
    np.testing.assert_allclose(
        by_train.loads.rated_torque, [-1.0, -0.81, -0.9, 0.0, 0.0], rtol=1e-12
    )
    np.testing.assert_allclose(by_train.loads.over_rpm[3, :, 1], [0, -0.5, -0.5])
    with pytest.raises(jaxhb.SceneError, match="has no effect on this load"):
        train.replace({"rest.rated_torque": 5.0})
