"""Events that change a train, against the changed train itself, and what is refused."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxhb
from jaxhb import Cylinder, Disk, Event, Load, Shaft, Torque

SPEED = 600.0
CYCLE = 120.0 / SPEED  # s
DISKS = ("crank", "flywheel")


def pressure():
    """A four-stroke that fires at 360 deg: compression, a burning, the valves open."""
    angle = np.arange(0.0, 721.0, 2.0)
    volume = 1.0 / 9.0 + (1 - np.cos(np.deg2rad(angle))) / 2
    closed = 1e5 * (volume.max() / volume) ** 1.33
    is_closed = (angle > 180.0) & (angle < 540.0)
    burning = 3e6 * np.exp(-(((angle - 375.0) / 20.0) ** 2))
    value = np.where(is_closed, closed, 1e5) + burning
    return tuple(zip(angle.tolist(), value.tolist(), strict=True))


def parts(*more, law=True):
    held = {"law": "propeller", "rated_torque": 150.0, "rated_rpm": 900.0}
    sizes = {
        "disk": "crank",
        "bore": 0.1,
        "stroke": 0.12,
        "rod": 0.2,
        "reciprocating_mass": 1.0,
        "pressure": pressure(),
    }
    return [
        Disk(name="crank", inertia=0.5, damping=2.0),
        Disk(name="flywheel", inertia=2.0),
        Shaft(between=DISKS, stiffness=5e4, damping=20.0),
        Cylinder(name="one", firing_angle=0.0, **sizes),
        Cylinder(name="two", firing_angle=360.0, **sizes),
        Load(disk="flywheel", **(held if law else {})),
        *more,
    ]


def built(*more, law=True):
    return jaxhb.build(
        parts(*more, law=law), reference="crank", revolutions_per_cycle=2
    )


EVENTS = (
    Event(name="misfire", misfire="one", begin=2 * CYCLE),
    Event(name="cut", cut_off="two", begin=2 * CYCLE),
    Event(name="start", firing_from=900.0),
    Event(name="less", begin=0.1, fuel=((0.0, 0.4),)),
)
TRAIN = built(*EVENTS)


def motion_at_end(found):
    """Displacements and velocities of the disks, whose radius is 1 m."""
    turning = found.rpm[-1] * np.pi / 30
    angles = [found.disk(name).values[-1] for name in DISKS]
    speeds = [found.speed(name).values[-1] - turning for name in DISKS]
    return np.array([*angles, *speeds])


def in_two_parts(before, after, seconds, speeds):
    """Torques of the shaft of a train, and of another one that goes on from there."""
    first = jaxhb.transient(before, seconds=seconds[0], speed=speeds[0], start="rest")
    second = jaxhb.transient(
        after, seconds=seconds[1], speed=speeds[1], start=motion_at_end(first)
    )
    return first.torque(*DISKS), second.torque(*DISKS)


def compare(found, first, second):
    """Where the parts have the instants of the whole."""
    torque = found.torque(*DISKS)
    size = np.abs(torque.values).max()
    count = len(first.time)
    np.testing.assert_allclose(torque.time[:count], first.time, atol=1e-12)
    # The same steps: the rounding of some thousand
    np.testing.assert_allclose(
        torque.values[:count], first.values, rtol=0, atol=1e-9 * size
    )
    np.testing.assert_allclose(
        torque.values[count:], second.values[1:], rtol=0, atol=1e-9 * size
    )


@pytest.mark.parametrize(
    "event, number", [("misfire", "one.injection"), ("cut", "two.gas_factor")]
)
def test_a_cylinder_that_fails_is_another_train_from_then_on(event, number):
    changed = TRAIN.replace({number: 0.0})
    found = jaxhb.transient(
        TRAIN, seconds=4 * CYCLE, speed=SPEED, events=[event], start="rest"
    )
    parts = in_two_parts(TRAIN, changed, (2 * CYCLE, 2 * CYCLE), (SPEED, SPEED))
    compare(found, *parts)
    sound = jaxhb.transient(TRAIN, seconds=4 * CYCLE, speed=SPEED, start="rest")
    apart = found.torque(*DISKS).values - sound.torque(*DISKS).values
    assert np.abs(apart).max() > 0.1 * np.abs(sound.torque(*DISKS).values).max()


def test_cylinders_compress_only_until_the_speed_of_a_start():
    """600 to 1200 rpm in 0.8 s: the train has turned 5 times at 900 rpm, and once more
    makes whole cycles.
    """
    # 900 rpm after t1 s, with 6 revolutions turned: t1 (600 + 900) / 2 = 360
    passed = 360.0 / 750.0
    slope = 300.0 / passed
    last = 0.3
    speed = [(0.0, 600.0), (passed + last, 900.0 + slope * last)]
    found = jaxhb.transient(
        TRAIN, seconds=passed + last, speed=speed, events=["start"], start="rest"
    )
    idle = TRAIN.replace({"one.injection": 0.0, "two.injection": 0.0})
    rows = (
        [(0.0, 600.0), (passed, 900.0)],
        [(0.0, 900.0), (last, 900.0 + slope * last)],
    )
    first, second = in_two_parts(idle, TRAIN, (passed, last), rows)
    torque = found.torque(*DISKS)
    size = np.abs(torque.values).max()
    # Other steps before and after, which err by 1e-6 each
    np.testing.assert_allclose(torque.at(first.time), first.values, atol=1e-5 * size)
    np.testing.assert_allclose(
        torque.at(passed + second.time[1:]), second.values[1:], atol=1e-4 * size
    )


def test_fuel_multiplies_gas_torques_and_torques_that_drive():
    """Gas torques of 40 % are those of cylinders with a gas factor of 0.4."""
    weak = TRAIN.replace({"one.gas_factor": 0.4, "two.gas_factor": 0.4})
    event = built(Event(name="fuel", begin=2 * CYCLE, fuel=((0.0, 0.4),)))
    found = jaxhb.transient(
        event, seconds=4 * CYCLE, speed=SPEED, events=["fuel"], start="rest"
    )
    compare(found, *in_two_parts(TRAIN, weak, (2 * CYCLE, 2 * CYCLE), (SPEED, SPEED)))


def test_sequences_begin_their_events_later():
    later = Event(name="block", disk="flywheel", begin=0.05, step=-40.0)
    train = jaxhb.build(
        parts(later),
        reference="crank",
        revolutions_per_cycle=2,
        sequences={"late": {"events": ["block"], "begin": 0.1}},
    )
    found = jaxhb.transient(
        train, seconds=0.3, speed=SPEED, events="late", start="rest"
    )
    at_once = jaxhb.transient(
        train.replace({"block.begin": 0.15}),
        seconds=0.3,
        speed=SPEED,
        events="block",
        start="rest",
    )
    # 0.05 + 0.1 s is not quite 0.15 s.
    np.testing.assert_allclose(
        found.torque(*DISKS).values, at_once.torque(*DISKS).values, atol=1e-9
    )


def test_a_free_speed_settles_where_torque_and_load_meet():
    """The mean of the cylinders is that of their excitation: T (n / N)^2 balances it."""
    found = jaxhb.transient(
        TRAIN, seconds=30.0, speed="free", rpm=600.0, start="rest", record=100.0
    )
    _, balancing, _ = jaxhb_excitation(TRAIN, float(found.rpm[-1]))
    carried = 150.0 * (float(found.rpm[-1]) / 900.0) ** 2
    assert carried == pytest.approx(-float(balancing[0]), rel=1e-4)


def jaxhb_excitation(train, rpm):
    from jaxhb.train.excitation import excitation

    return excitation(train, rpm, 1)


REFUSED = {
    "seconds is 0": ({"seconds": 0.0}, "seconds is 0, must be greater than 0 s"),
    "negative speed": (
        {"speed": [(0.0, 600.0), (1.0, -5.0)]},
        "the speed at 1 s is -5 rpm, must be from 0 to 1000000 rpm",
    ),
    "times that fall": (
        {"speed": [(0.0, 600.0), (1.0, 700.0), (0.5, 800.0)]},
        "the row of speed at 0.5 s follows that at 1 s: times must increase",
    ),
    "a row of three": ({"speed": [(0.0, 1.0, 2.0)]}, r"must be rows of \(s, rpm\)"),
    "standstill": ({"speed": 0.0}, "the speed is 0 rpm throughout: nothing turns"),
    "another word": ({"speed": "fast"}, "speed is 'fast': give a number in rpm, rows"),
    "free without a speed": (
        {"speed": "free"},
        r"begins at rpm=None: give the first speed",
    ),
    "rpm beside a speed": ({"rpm": 700.0}, 'rpm is the first speed of speed="free"'),
    "an unknown event": (
        {"events": ["misfires"]},
        "there is no event or sequence 'misfires'. Did you mean 'misfire'",
    ),
    "refine": ({"refine": 0}, "refine is 0, must be a whole number of at least 1"),
    "too long": ({"seconds": 1e7}, "steps of .* ask for a shorter time"),
    "an unknown start": ({"start": "still"}, "start is 'still': give \"steady\""),
    "a start of another size": (
        {"start": np.zeros(3)},
        r"start has the shape \(3,\), must be \(4,\)",
    ),
    "steady at standstill": (
        {"speed": [(0.0, 0.0), (1.0, 600.0)], "start": "steady"},
        'the first speed is 0 rpm: start from "rest"',
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_refused_in_a_sentence(case):
    changed, sentence = REFUSED[case]
    options = {"seconds": 0.2, "speed": SPEED, "start": "rest"} | changed
    with pytest.raises(jaxhb.SceneError, match=sentence) as raised:
        jaxhb.transient(TRAIN, **options)
    assert str(raised.value).count("\n") == 0


def test_a_load_without_a_law_has_no_free_speed():
    with pytest.raises(
        jaxhb.SceneError, match="has no law over the speed: give a load"
    ):
        jaxhb.transient(built(law=False), seconds=1.0, speed="free", rpm=600.0)


def test_a_train_that_runs_away_or_stops_is_refused():
    driven = [part for part in parts() if not isinstance(part, Cylinder)]
    away = [
        part
        if not isinstance(part, Load)
        else Load(disk="flywheel", over_rpm=((1, 1.0), (2, 1.0)))
        for part in driven
    ]
    train = jaxhb.build([*away, Torque(disk="crank", mean=500.0)], reference="crank")
    with pytest.raises(
        jaxhb.SceneError, match="the train runs away: .* rpm are passed"
    ):
        jaxhb.transient(train, seconds=100.0, speed="free", rpm=600.0)
    train = jaxhb.build([*driven, Torque(disk="crank", mean=-50.0)], reference="crank")
    with pytest.raises(jaxhb.SceneError, match="at free speed the train stops after"):
        jaxhb.transient(train, seconds=100.0, speed="free", rpm=600.0)


@pytest.mark.parametrize("rpm", [0.0, 50.0])
def test_torques_alike_at_all_speeds_accelerate_a_train_as_long_as_asked(rpm):
    """30 N m on 3 kg m2 for 5 s: 50 rad/s."""
    train = jaxhb.build(
        [
            Disk(name="motor", inertia=2.0),
            Disk(name="drum", inertia=1.0),
            Shaft(between=("motor", "drum"), stiffness=1e4, damping=5.0),
            Torque(disk="motor", mean=50.0),
            Load(disk="drum", law="constant", rated_torque=20.0),
        ],
        revolutions_per_cycle=1,
    )
    moved = jaxhb.transient(train, seconds=5.0, speed="free", rpm=rpm)
    assert float(moved.rpm[-1]) == pytest.approx(rpm + 50 * 30 / np.pi, rel=1e-9)


def test_a_speed_that_settles_faster_than_blocks_is_refused():
    """Time constant of 1 ms, blocks of 133 ms: the iterations of a block diverge."""
    law = {"law": "propeller", "rated_torque": 90.0, "rated_rpm": 900.0}
    light = [
        Disk(name="motor", inertia=0.001),
        Disk(name="fan", inertia=0.001),
        Shaft(between=("motor", "fan"), stiffness=2e4),
        Torque(disk="motor", mean=100.0, harmonics=((1.0, 60.0, 10.0),)),
        Load(disk="fan", **law),
    ]
    train = jaxhb.build(light, reference="motor", revolutions_per_cycle=1)
    options = {"seconds": 0.2, "speed": "free", "rpm": 900.0, "start": "rest"}
    with pytest.raises(jaxhb.SceneError, match="by a greater refine"):
        jaxhb.transient(train, **options)
    found = jaxhb.transient(train, **options, refine=128)
    assert found.rpm[-1] == pytest.approx(900.0 * np.sqrt(100.0 / 90.0), rel=1e-6)


def test_begins_that_do_not_settle_are_told(monkeypatch):
    from jaxhb.transients import free_speed

    def moved(values, plan, *_):
        later = dataclasses.replace(plan.course, begins=plan.course.begins + 1e-3)
        return dataclasses.replace(plan, course=later)

    monkeypatch.setattr(free_speed, "_free_again", moved)
    found = jaxhb.transient(
        TRAIN, seconds=0.2, speed="free", rpm=600.0, start="rest", events=["misfire"]
    )
    assert "the begins of 'misfire' did not settle" in " ".join(found.notes)


def test_it_says_that_jit_cannot_trace_it():
    def peak(damping):
        train = TRAIN.replace({"crank.damping": damping})
        return jaxhb.transient(train, seconds=0.1, speed=SPEED, start="rest").rpm[-1]

    with pytest.raises(
        TypeError, match="jit and vmap cannot trace it: call it outside"
    ):
        jax.jit(peak)(2.0)


def test_the_begin_of_a_jump_has_no_derivative():
    train = built(Event(name="block", disk="flywheel", begin=0.05, step=-40.0))

    def peak(begin):
        moved = train.replace({"block.begin": begin})
        found = jaxhb.transient(
            moved, seconds=0.1, speed=SPEED, events="block", start="rest"
        )
        return found.torque(*DISKS).smooth_peak()

    with pytest.raises(jaxhb.SceneError, match="only ramps, ice and fuel have"):
        jax.grad(peak)(0.05)
