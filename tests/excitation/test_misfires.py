"""Cylinders without injection, whose compression stays, and cut off, against closed
forms and direct integration.
"""

import dataclasses

import jax
import numpy as np
import pytest
from built_trains import pair
from scipy.integrate import quad
from tolerances import ALGEBRAIC, GRADIENT

from jaxhb.elements.excitations.crank_slider import Combustion, Cylinder, Trace
from jaxhb.elements.sentences import SceneError
from jaxhb.train.excitation import excitation, highest_harmonic

BORE = 0.3
STROKE = 0.4
ROD = 0.8
AREA = np.pi / 4 * 0.3**2
RATIO = 14.0
EXPONENT = 1.32
CHARGE = 2.5e5
COMBUSTION = Combustion(
    compression_ratio=RATIO,
    charge_pressure=CHARGE,
    start=-4.0,
    duration=60.0,
    imep=1.8e6,
    compression_exponent=EXPONENT,
    expansion_exponent=1.25,
)


def cylinder(name="c", **source):
    return Cylinder(
        disk="a",
        name=name,
        bore=BORE,
        stroke=STROKE,
        rod=ROD,
        ambient_pressure=1e5,
        **source,
    )


def measured(rows, **changes):
    """A cylinder with a pressure table that counts from its firing top dead centre."""
    return cylinder(pressure=rows, table_firing_tdc=0.0, **changes)


def listed(name="c"):
    """A cylinder whose gas torque is listed."""
    return cylinder(name, gas_torque_mean=20.0, gas_torque=[(0.5, 3.0, 1.0)])


def height(degrees):
    """Height of the gas above the piston, from the triangle of crank and rod."""
    a = np.deg2rad(degrees)
    pin = 0.5 * STROKE * np.cos(a) + np.sqrt(ROD**2 - (0.5 * STROKE * np.sin(a)) ** 2)
    return STROKE / (RATIO - 1) + 0.5 * STROKE + ROD - pin


def motored(degrees):
    """Compression and expansion on one polytrope, deg from top dead centre."""
    turned = (degrees + 180.0) % 360.0 - 180.0
    return CHARGE * (height(180.0) / height(turned)) ** EXPONENT


def per_degree(degrees, step=1e-4):
    return (height(degrees + step) - height(degrees - step)) / (2 * step)


def coefficient(pressure, order, turns):
    """T^n of p A dx over the cycle of ``turns`` revolutions, by adaptive quadrature of
    the work.
    """

    def part(kind):
        def work(a):
            wave = kind(np.deg2rad(order * a))
            return (pressure(a) - 1e5) * AREA * per_degree(a) * wave

        begins = np.arange(-180.0, -180.0 + 360.0 * turns, 30.0)
        pieces = [quad(work, a, a + 30.0, epsrel=1e-9)[0] for a in begins]
        return sum(pieces) / (2 * np.pi * turns)

    return part(np.cos) - 1j * part(np.sin)


def torque(train, harmonics=12, rpm=0.0):
    return np.asarray(excitation(train, rpm, harmonics)[0])[0]


def table(strokes=4, first=-180.0, step=0.5, compressed=motored, blowdown=0.0):
    """A measured cycle: the compression of :func:`motored` up to 6 deg before top dead
    centre, then combustion, and an exhaust stroke that begins with ``blowdown`` Pa
    above the pressure of its end.
    """
    angle = np.arange(first, first + 180.0 * strokes + step / 2, step)
    expansion = CHARGE * 9.0 * (height(180.0) / height(angle)) ** 1.2
    burnt = expansion / (1 + np.exp(-(angle - 4.0) / 2.0))
    pressure = np.where(
        angle < -6.0, compressed(angle), np.maximum(burnt, compressed(angle))
    )
    emptied = 1.9e5 + blowdown * np.exp(-(angle - 180.0) / 20.0)
    pressure[angle > 180.0] = np.where(angle < 360.0, emptied, CHARGE)[angle > 180.0]
    return tuple(zip(angle.tolist(), pressure.tolist(), strict=True))


@pytest.mark.parametrize("strokes", [2, 4])
def test_the_misfire_of_a_combustion_is_the_polytrope_in_every_order(strokes):
    combustion = dataclasses.replace(
        COMBUSTION, stroke_cycle=strokes, exhaust_pressure=1.9e5
    )
    train = pair(cylinder(combustion=combustion, orders=9))
    turns = strokes // 2
    idle = torque(train.misfire("c"), 9 * 2)

    def pressure(a):
        return motored(a) if a <= 180.0 else 1.9e5 if a < 360.0 else CHARGE

    for order in (1.0, 2.0, 3.0, 6.0, *[0.5, 1.5] * (turns == 2)):
        expected = coefficient(pressure, order, turns)
        np.testing.assert_allclose(
            idle[round(2 * order)], expected, rtol=0, atol=1e-5 * abs(idle).max()
        )
    if turns == 1:
        # The compressed gas gives its work back.
        assert abs(idle[0]) < 1e-9 * abs(idle).max()
    else:
        # Work of the gas exchange alone: the swept volume times the difference of its
        # pressures.
        np.testing.assert_allclose(
            idle[0].real, (CHARGE - 1.9e5) * AREA * STROKE / (4 * np.pi), rtol=1e-6
        )


@pytest.mark.parametrize("blowdown", [0.0, 6e5])
@pytest.mark.parametrize("source", ["pressure", "traces"])
def test_the_misfire_of_a_table_follows_its_polytrope_through_the_combustion(
    source, blowdown
):
    rows = table(blowdown=blowdown)
    trace = Trace(rpm=1000.0, pressure=rows, table_firing_tdc=0.0)
    train = pair(measured(rows) if source == "pressure" else cylinder(traces=[trace]))
    idle = torque(train.misfire("c"), 24)

    def pressure(a):
        return motored(a) if a <= 180.0 else 1.9e5 if a < 360.0 else CHARGE

    expected = np.array([coefficient(pressure, n / 2, 2) for n in range(7)])
    # Rows stand half a degree apart.
    np.testing.assert_allclose(idle[:7], expected, rtol=0, atol=1e-3 * abs(idle).max())
    assert abs(torque(train)[0]) > 100 * abs(expected[0])


def test_compression_and_expansion_of_a_two_stroke_table_have_no_mean_torque():
    idle = torque(pair(measured(table(2))).misfire("c"), 30)
    assert abs(idle[0]) < ALGEBRAIC * abs(idle).max()


def test_a_compression_that_is_no_polytrope_is_mirrored_as_it_is():
    def bent(angle):
        early = 20 * np.exp(-(((angle + 60.0) / 15.0) ** 2))
        late = 5 * np.exp(-((angle / 30.0) ** 2))
        return 1e5 * (1 + early + late)

    rows = table(2, compressed=bent)
    train = pair(measured(rows))
    angle, pressure = np.array(rows).T
    mirrored = pressure.copy()
    mirrored[angle > 0] = pressure[angle < 0][::-1]
    twin = pair(measured(tuple(zip(angle, mirrored, strict=True))))
    expected = torque(twin)
    np.testing.assert_allclose(
        torque(train.misfire("c")), expected, rtol=0, atol=1e-9 * abs(expected).max()
    )


def test_the_injection_leads_from_the_misfire_to_the_cycle_as_it_is():
    train = pair(cylinder(combustion=COMBUSTION))
    idle = torque(train.misfire("c"))
    fired = torque(train)
    half = torque(train.replace({"c.injection": 0.5}))
    whole = torque(train.replace({"c.injection": 1.0}))
    rounding = ALGEBRAIC * abs(fired).max()
    np.testing.assert_allclose(half, (idle + fired) / 2, rtol=0, atol=rounding)
    np.testing.assert_allclose(whole, fired, rtol=0, atol=rounding)
    written = pair(cylinder(combustion=COMBUSTION, injection=0.0))
    np.testing.assert_array_equal(torque(written), idle)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["bore", "stroke", "rod", "pressure", "combustion.compression_ratio", "injection"],
)
def test_a_misfire_is_differentiated_as_it_is_computed(name):
    train = pair(
        cylinder(combustion=COMBUSTION) if "combustion" in name else measured(table())
    )
    train = (
        train.replace({"c.injection": 0.3})
        if name == "injection"
        else train.misfire("c")
    )
    start = train.value(f"c.{name}")

    def size(share):
        changed = train.replace({f"c.{name}": start * share})
        return abs(excitation(changed, 900.0, 12)[0][0, 3]) ** 2

    slope = (size(1 + 1e-5) - size(1 - 1e-5)) / 2e-5
    derivative = jax.jit(jax.grad(size))(1.0)
    np.testing.assert_allclose(derivative, slope, rtol=30 * GRADIENT)


def test_what_is_computed_without_firing_is_said():
    train = pair(
        measured(table(), name="table"),
        cylinder("model", combustion=COMBUSTION),
        listed("given"),
        cylinder("none", fires=False),
    )
    assert train.not_firing() == ["none: no gas torque, the scene gives none"]
    assert train.misfire("table", "model", "given").not_firing() == [
        "table, model: no injection, compression stays",
        (
            "given: no gas torque at all, as compression is unknown for a given"
            " gas_torque"
        ),
        "none: no gas torque, the scene gives none",
    ]
    note, *_ = train.cut_off("model").not_firing()
    assert note == "model: cut off, no gas torque at all"
    for idle in (train.misfires()["model"], train.misfire("model")):
        assert idle.not_firing()[0] == "model: no injection, compression stays"
    note, *_ = train.cut_offs()["table"].not_firing()
    assert note == "table: cut off, no gas torque at all"
    with pytest.raises(
        SceneError, match="there is no cylinder 'tabel'. Did you mean 'table'"
    ):
        train.cut_off("tabel")


def test_a_misfire_of_a_given_gas_torque_and_a_cut_off_have_none_at_all():
    train = pair(listed())
    assert not torque(train.misfire("c")).any()
    assert not torque(train.misfires()["c"]).any()
    burning = pair(cylinder(combustion=COMBUSTION))
    assert not torque(burning.cut_off("c")).any()
    assert not torque(burning.cut_offs()["c"]).any()
    assert highest_harmonic(burning.cut_off("c")) == 1


def test_a_scenario_may_misfire_by_a_flag_by_its_injection_and_by_its_imep():
    scenarios = {
        "flag": {"c.fires": False},
        "number": {"c.injection": 0.0},
        "work": {"c": {"combustion": {"imep": 0.0}}},
        "cut": {"c.gas_factor": 0.0},
    }
    train = pair(cylinder(combustion=COMBUSTION), scenarios=scenarios)
    idle = torque(train.misfire("c"))
    for name in ("flag", "number"):
        np.testing.assert_allclose(
            torque(train.scenario(name)), idle, rtol=0, atol=ALGEBRAIC * abs(idle).max()
        )
    expected = torque(train.replace({"c.combustion.imep": 0.0}))
    np.testing.assert_array_equal(torque(train.scenario("work")), expected)
    assert not torque(train.scenario("cut")).any()


def over_cycles(fired, idle, every):
    """Harmonics of several engine cycles in time: samples of the one with injection,
    round its top dead centre, and of those without, from harmonics of one cycle each,
    [N].
    """
    size = 4096

    def samples(harmonics):
        return np.fft.irfft(np.r_[harmonics[0].real, harmonics[1:]] * size, size)

    begin, end = np.split(samples(fired), 2)
    between = np.tile(np.roll(samples(idle), -size // 2), every - 1)
    cycle = np.concatenate([begin, between, end])
    return np.fft.rfft(cycle) / cycle.size


@pytest.mark.parametrize("source", ["combustion", "table"])
def test_a_cylinder_that_fires_every_second_cycle_compresses_alone_in_the_other(source):
    every_cycle = (
        cylinder(combustion=COMBUSTION, orders=300, reciprocating_mass=0.0)
        if source == "combustion"
        else measured(table(), orders=300)
    )
    steady = pair(every_cycle)
    skipping = pair(
        dataclasses.replace(every_cycle, fires_every=2), revolutions_per_cycle=4
    )
    fired = torque(steady, 600)
    idle = torque(steady.misfire("c"), 600)
    expected = over_cycles(fired, idle, 2)[:60]
    # 600 harmonics of one cycle leave steps of the samples.
    actual = torque(skipping, 59)
    np.testing.assert_allclose(
        actual, expected, rtol=0, atol=3e-4 * abs(expected).max()
    )
    mean = (fired[0] + idle[0]) / 2
    np.testing.assert_allclose(actual[0], mean, rtol=0, atol=1e-9 * abs(fired[0]))
    never = torque(skipping.misfire("c"), 60)
    np.testing.assert_allclose(
        never[::2], idle[:31], rtol=0, atol=ALGEBRAIC * abs(idle).max()
    )
    assert abs(never[1::2]).max() < 1e-9 * abs(idle).max()


def test_in_a_cycle_of_several_engine_cycles_a_cylinder_fires_in_each():
    """A cylinder that does not may say so only where the cycle has room for it."""
    every_cycle = cylinder(combustion=COMBUSTION)
    short, long = (pair(every_cycle, revolutions_per_cycle=r) for r in (2, 4))
    torques = torque(long, 24)
    np.testing.assert_allclose(
        torques[::2], torque(short, 12), rtol=0, atol=ALGEBRAIC * abs(torques).max()
    )
    assert not torques[1::2].any()
    with pytest.raises(
        SceneError, match="one gas cycle of 4 revolutions is harmonic 0.5 .* = 4"
    ):
        pair(dataclasses.replace(every_cycle, fires_every=2))
    with pytest.raises(
        SceneError,
        match="fires_every is 2, but only pressure, traces and combustion tell",
    ):
        pair(cylinder(gas_torque_mean=10.0, fires_every=2))
