"""Orders of measured rotations against the orders from which pulses, angles and speeds
were made, their accuracy, noise, missing pulses, and the way to identify.
"""

import math

import numpy as np
import pytest

import jaxhb
from jaxhb.design import read_measured
from jaxhb.design.signals.files import read_recorded
from jaxhb.design.signals.orders import measured_orders

TURN = 2 * np.pi
ORDERS = {
    0.5: 0.004j,
    1.0: 0.003,
    1.5: -0.002 + 0.001j,
    3.0: 0.01 - 0.005j,
    6.0: 0.002j,
}
"""Complex amplitudes in rad by order: a swing of 0.03 rad, speeds that vary by 7 %."""
ROUNDING = 1e-11  # rad: doubles of the angle, 1e3 rad, have steps of 1e-13
TIMED = 1e-9  # s, the last digit of the times in the files of these tests


class Rotor:
    """A rotor at ``rpm`` + ``slope`` t with known orders."""

    def __init__(self, rpm, slope=0.0, orders=ORDERS):
        self.speed = TURN * rpm / 60
        self.slope = TURN * slope / 60
        self.orders = orders

    def even(self, t):
        return self.speed * t + self.slope * t * t / 2

    def angle(self, t):
        waves = (c * np.exp(1j * k * self.even(t)) for k, c in self.orders.items())
        return self.even(t) + sum(wave.real for wave in waves)

    def rate(self, t):
        speed = self.speed + self.slope * t
        waves = (
            1j * k * c * np.exp(1j * k * self.even(t)) for k, c in self.orders.items()
        )
        return speed * (1 + sum(wave.real for wave in waves))

    def time_at(self, angle):
        """Times at which the rotor passes angles, by Newton's method."""
        root = np.sqrt(self.speed**2 + 2 * self.slope * angle)
        t = 2 * angle / (self.speed + root)
        for _ in range(60):
            t = t - (self.angle(t) - angle) / self.rate(t)
        return t

    def pulses(self, revolutions, teeth):
        return self.time_at(TURN * np.arange(1, revolutions * teeth) / teeth)

    def marks(self, revolutions):
        """Times of a mark at the begin of each cycle of two revolutions."""
        return self.time_at(2 * TURN * np.arange(1, revolutions // 2))


def off(found):
    """Largest difference of the complex amplitudes from those of the rotor."""
    expected = np.array([ORDERS.get(order, 0.0) for order in found.orders])
    return np.abs(found.angle - expected).max()


@pytest.mark.parametrize("slope", [0.0, 120.0])
def test_pulses_have_the_orders_of_the_rotor_to_rounding(slope):
    """Pulses are fitted where they are: there is no error of interpolation."""
    rotor = Rotor(900.0, slope)
    found = measured_orders(rotor.pulses(90, 60), pulses=60, marks=rotor.marks(90))
    assert len(found.rpm) == (1 if slope == 0 else 4)
    assert off(found) < ROUNDING
    assert found.phased
    assert (found.noise < ROUNDING).all()


@pytest.mark.parametrize("quantity", ["angle", "speed"])
def test_samples_over_time_have_them_as_well(quantity):
    rotor = Rotor(1200.0, 40.0)
    time = np.arange(0.0, 3.0, 4e-4)
    values = {"angle": rotor.angle(time) % TURN, "speed": rotor.rate(time)}[quantity]
    found = measured_orders(time, **{quantity: values}, marks=rotor.marks(60))
    assert off(found) < ROUNDING
    reversed_sense = measured_orders(time, **{quantity: -values})
    assert "reversed" in reversed_sense.notes[0]


def test_what_is_asked_is_not_what_interpolation_at_even_angles_gives():
    """A second way: angles at even times by linear interpolation between pulses, and
    sums of cosines. Its error falls with the square of the teeth, and leads to the
    amplitudes that the fit has at once; with 60 teeth order 3 is 0.8 % off, as the
    response sinc^2(order / teeth) of straight lines says.
    """
    rotor = Rotor(900.0)
    errors = []
    for teeth in (60, 120, 240):
        time = rotor.pulses(41, teeth)
        angle = TURN * np.arange(1, len(time) + 1) / teeth
        even = np.linspace(2 * TURN, 18 * TURN, 20000, endpoint=False)
        swing = np.interp(even / rotor.speed, time, angle) - even
        c = 2 * np.mean(swing * np.exp(-3j * even))
        errors.append(abs(c - ORDERS[3.0]))
    response = 1 - np.sinc(3.0 / 60) ** 2
    assert errors[0] == pytest.approx(response * abs(ORDERS[3.0]), rel=0.01)
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(slopes, 2.0, atol=0.1)


def test_noise_scatters_amplitudes_as_is_told():
    rotor = Rotor(900.0)
    draw = np.random.default_rng(0)
    time = rotor.pulses(400, 60)
    jitter = 2e-6  # s
    noisy = time + jitter * draw.normal(size=len(time))
    found = measured_orders(noisy, pulses=60, marks=rotor.marks(400), cycles=5)
    blocks = int(found.blocks[0])
    # The angle of a pulse is off by speed x jitter, one of n samples for each order.
    expected = rotor.speed * jitter * math.sqrt(2 / (5 * 2 * 60)) / math.sqrt(blocks)
    # Speeds that vary by 7 % change the weight of the jitter alike.
    np.testing.assert_allclose(found.noise[0], expected, rtol=0.1)
    quiet = [k for k, order in enumerate(found.orders) if order not in ORDERS]
    # Real and imaginary part scatter by the noise each: mean square 2, of 19 orders.
    share = np.mean(np.abs(found.angle[0, quiet]) ** 2) / expected**2
    assert 1.0 < share < 3.5


def test_missing_and_doubled_pulses_are_told_and_mended():
    rotor = Rotor(900.0)
    time = rotor.pulses(90, 60)
    gap = np.delete(time, [1000, 2500, 2501])
    found = measured_orders(gap, pulses=60, marks=rotor.marks(90))
    (note,) = found.notes[:1]
    assert note.startswith("3 pulses are missing, the first behind ")
    assert f"{time[999]:.6g} s" in note
    assert off(found) < ROUNDING
    doubled = np.insert(time, 1001, time[1000] + 1e-5)
    found = measured_orders(doubled, pulses=60, marks=rotor.marks(90))
    assert found.notes[0].startswith("1 pulse is too many, the first at ")
    assert off(found) < ROUNDING
    # A wheel of 60 teeth less two, which tell its revolution
    wheel = time[np.arange(len(time)) % 60 < 58]
    found = measured_orders(wheel, pulses=60, marks=rotor.marks(90))
    assert off(found) < ROUNDING


def test_the_mark_says_where_the_cycle_begins():
    rotor = Rotor(900.0)
    marks = rotor.time_at(2 * TURN * np.arange(1, 40) + np.deg2rad(100.0))
    found = measured_orders(
        rotor.pulses(90, 60), pulses=60, marks=marks, mark_deg=100.0
    )
    assert off(found) < ROUNDING
    without = measured_orders(rotor.pulses(90, 60), pulses=60)
    assert not without.phased
    assert np.isnan(without.rows("crank").phase).all()
    np.testing.assert_allclose(
        np.abs(without.angle), np.abs(found.angle), atol=ROUNDING
    )


@pytest.mark.parametrize("teeth", [58, 59, 120])
def test_marks_tell_that_the_wheel_has_other_teeth(teeth):
    rotor = Rotor(1200.0)
    between = 2 * 60 / teeth
    with pytest.raises(jaxhb.SceneError, match=f"there are {between:.4g} revolutions"):
        measured_orders(rotor.pulses(90, 60), pulses=teeth, marks=rotor.marks(90))


def test_a_mark_in_every_revolution_tells_no_cycle_of_two():
    rotor = Rotor(1200.0)
    twice = rotor.time_at(TURN * np.arange(1, 90))
    with pytest.raises(jaxhb.SceneError, match="there are 1 revolutions, must be 2"):
        measured_orders(rotor.pulses(90, 60), pulses=60, marks=twice)


def test_a_speed_without_marks_has_its_amplitudes_whatever_its_scale():
    """A torsiograph that reads 0.1 % too much: its phases drift by turns in a record of
    400 revolutions, its amplitudes do not.
    """
    rotor = Rotor(1200.0)
    time = np.arange(0.0, 20.0, 1 / 5000)
    found = measured_orders(time, speed=1.001 * rotor.rate(time), highest=6.0)
    for order, amplitude in ORDERS.items():
        size = np.abs(found.angle[0, found.orders == order])[0]
        # Over the 20 revolutions of a block the phase turns by 0.12 of a turn at most,
        # and (pi 0.12)^2 / 6 of the wave is lost.
        assert size == pytest.approx(abs(amplitude), rel=0.03), order


def test_speeds_and_accelerations_are_derivatives_of_the_angle():
    rotor = Rotor(900.0)
    found = measured_orders(rotor.pulses(41, 60), pulses=60)
    k = 3.0 * rotor.speed
    place = int(np.flatnonzero(found.orders == 3.0)[0])
    size = abs(ORDERS[3.0])
    assert abs(found.values("speed")[0, place]) == pytest.approx(k * size, rel=1e-8)
    rows = found.rows("crank", "acceleration")
    assert rows.amplitude[place] == pytest.approx(k * k * size, rel=1e-8)
    with pytest.raises(jaxhb.SceneError, match="must be one of angle, speed"):
        found.values("torque")


REFUSED = {
    "two of them": ({"angle": [0.0], "pulses": 60}, "angle and pulses is given"),
    "nothing": ({}, "nothing is given beside time"),
    "order too high": ({"pulses": 12}, "order 12 is asked for"),
    "short": ({"pulses": 600}, "must have 20: a block of 10 cycles"),
    "one cycle": ({"pulses": 60, "cycles": 1}, "must be at least 2"),
    "no teeth": ({"pulses": 0}, "the teeth of the wheel"),
    "no orders": ({"pulses": 60, "highest": 0.2}, "below the lowest order"),
    "other length": ({"speed": [1.0, 2.0]}, "speed has 2 values, must have"),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_what_cannot_be_read_is_said_in_a_sentence(fault):
    arguments, sentence = REFUSED[fault]
    time = Rotor(900.0).pulses(41, 60)
    with pytest.raises(jaxhb.SceneError, match=sentence):
        measured_orders(time, **arguments)
    with pytest.raises(jaxhb.SceneError, match="must increase"):
        measured_orders(time[::-1], pulses=60)


def written(path, heads, *columns):
    lines = [heads]
    for row in zip(*columns, strict=True):
        lines.append(";".join("" if np.isnan(x) else f"{x:.9f}" for x in row))
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("heads", "scale"),
    [
        ("time;angle", 180 / np.pi),
        ("time [s];angle [rad]", 1.0),
        ("time;rpm", 60 / TURN),
    ],
)
def test_files_have_columns_with_units(tmp_path, heads, scale):
    rotor = Rotor(900.0)
    time = np.arange(0.0, 0.1, 1e-3)
    kind = "speed" if "rpm" in heads else "angle"
    values = rotor.rate(time) if kind == "speed" else rotor.angle(time)
    level = np.where(np.arange(len(time)) % 20 >= 10, 5.0, 0.1)
    path = written(tmp_path / "x.csv", f"{heads};mark", time, scale * values, level)
    recorded = read_recorded(path)
    np.testing.assert_allclose(getattr(recorded, kind), values, atol=1e-8)
    # Half way between the samples 9 and 10 of every twenty
    np.testing.assert_allclose(recorded.marks, np.arange(0.0095, 0.1, 0.02))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("time;angel\n0;1", "no column 'angel'. Did you mean 'angle'"),
        ("time\n0", "there is no column angle or speed"),
        ("0;1\n1;2", "the columns have no heads"),
        ("time;angle [bar]\n0;1", "the head is 'angle \\[bar\\]', must be in rad"),
        ("time;angle\n0;1\n1;x", "line 3: angle is 'x', must be a number"),
        ("time;angle;speed\n0;1;2", "angle and speed are both there"),
        ("time;time\n0;1", "two columns 'time'"),
        ("", "the file is empty"),
        ("time;angle;mark", "there is no time below its head"),
        ("time;angle;mark\n0;1;5\n1;2;5", "the column mark has no mark"),
        ("time;angle;mark [V]\n0;1;5", "Leave out the unit of a level"),
    ],
)
def test_files_that_are_no_records_are_refused(tmp_path, text, sentence):
    path = tmp_path / "x.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(jaxhb.SceneError, match=sentence):
        read_recorded(path)


def test_the_command_writes_what_identify_reads(tmp_path, run):
    rotor = Rotor(600.0, 60.0)
    marks = rotor.marks(200)
    time = np.delete(rotor.pulses(200, 60), 3000)
    told = np.full(len(time), np.nan)
    told[: len(marks)] = marks
    path = written(tmp_path / "run_up.csv", "time [s];mark [s]", time, told)
    line = f"orders {path} --pulses 60 --element flywheel --quantity speed --step 100"
    completed = run(line, "csv", "json", "plot", "xlsx")
    assert "1 pulse is missing, behind" in completed.out
    train = jaxhb.load_scene("six_cylinder_diesel")
    rows = read_measured(tmp_path / "csv.csv", train)
    assert {*rows.quantity} == {"speed"}
    expected = {k: abs(1j * k * c) for k, c in ORDERS.items()}
    for rpm, order, amplitude in zip(rows.rpm, rows.order, rows.amplitude, strict=True):
        speed = TURN * rpm / 60
        # An angle is off by the speed times the last digit of a time.
        assert amplitude / speed == pytest.approx(
            expected.get(order, 0.0), abs=12 * speed * TIMED
        )
    windows = completed.json["windows"]
    assert [window["rpm"] for window in windows] == sorted({*rows.rpm})
    refused = run(f"orders {path} --pulses 60 --csv {tmp_path / 'x.csv'}", status=2)
    assert "Give it by --element" in refused.err
    lost = run(f"orders {path} --pulses 60 --csv {path} --element flywheel", status=2)
    assert "would be lost" in lost.err


def shafts(**section):
    return jaxhb.build(
        [
            *(jaxhb.Disk(name=name, inertia=1.0) for name in "ab"),
            jaxhb.Shaft(name="line", between=("a", "b"), stiffness=1e5, **section),
            jaxhb.Load(disk="b"),
        ]
    )


HEADS = "rpm,order,element,quantity,amplitude"


def test_the_stress_of_a_strain_gauge_is_a_torque_on_the_section(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text(
        f"{HEADS}\n900,1,line,stress,2e7\n900,1.5,line,stress,20 MPa\n"
        "900,1,line,torque,2 kN m\n900,1,a,angle,0.1 deg\n"
    )
    rows = read_measured(path, shafts(diameter=0.1, bore=0.05))
    assert rows.quantity == ("torque", "torque", "torque", "angle")
    modulus = np.pi * (0.1**4 - 0.05**4) / (16 * 0.1)
    expected = [2e7 * modulus, 2e7 * modulus, 2000.0, np.deg2rad(0.1)]
    np.testing.assert_allclose(rows.amplitude, expected, rtol=1e-14)
    with pytest.raises(jaxhb.SceneError, match="needs the section of the shaft"):
        read_measured(path, shafts())
    path.write_text(f"{HEADS}\n900,1,a,stress,2e7\n")
    with pytest.raises(jaxhb.SceneError, match="there is no shaft 'a' for its stress"):
        read_measured(path, shafts(diameter=0.1))
    path.write_text(f"{HEADS}\n900,1,line,stress,20 N m\n")
    with pytest.raises(jaxhb.SceneError, match="amplitude is '20 N m', must be in Pa"):
        read_measured(path, shafts(diameter=0.1))
