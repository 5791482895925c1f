"""Cylinders without injection, whose compression stays, and cut off, against closed
forms and direct integration.
"""

import jax
import numpy as np
import pytest
from built_trains import pair
from scipy.integrate import quad
from tolerances import ALGEBRAIC, GRADIENT

from jaxhb.elements.elements import Combustion, Cylinder, SceneError, Trace
from jaxhb.excitation.torques import excitation, highest_harmonic

BORE = 0.3
STROKE = 0.4
ROD = 0.8
AREA = np.pi / 4 * 0.3**2
RATIO = 14.0
EXPONENT = 1.32
CHARGE = 2.5e5
CRANK = {
    "disk": "a",
    "name": "c",
    "bore": BORE,
    "stroke": STROKE,
    "rod": ROD,
    "ambient_pressure": 1e5,
}
BURNING = {
    "compression_ratio": RATIO,
    "charge_pressure": CHARGE,
    "start": -4.0,
    "duration": 60.0,
}
BURNING |= {"imep": 1.8e6, "compression_exponent": EXPONENT, "expansion_exponent": 1.25}


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
            return (
                (pressure(a) - 1e5) * AREA * per_degree(a) * kind(np.deg2rad(order * a))
            )

        pieces = [
            (a, a + 30.0) for a in np.arange(-180.0, -180.0 + 360.0 * turns, 30.0)
        ]
        return sum(quad(work, *piece, epsrel=1e-9)[0] for piece in pieces) / (
            2 * np.pi * turns
        )

    return part(np.cos) - 1j * part(np.sin)


def torque(train, harmonics=12, rpm=0.0):
    return np.asarray(excitation(train, rpm, harmonics)[0])[0]


def table(strokes=4, first=-180.0, step=0.5, compressed=motored, blowdown=0.0):
    """A measured cycle: the compression of :func:`motored` up to 6 deg before top dead
    centre, then combustion, and an exhaust stroke that begins with ``blowdown`` Pa
    above the pressure of its end.
    """
    angle = np.arange(first, first + 180.0 * strokes + step / 2, step)
    burnt = (
        CHARGE
        * 9.0
        * (height(180.0) / height(angle)) ** 1.2
        / (1 + np.exp(-(angle - 4.0) / 2.0))
    )
    pressure = np.where(
        angle < -6.0, compressed(angle), np.maximum(burnt, compressed(angle))
    )
    emptied = 1.9e5 + blowdown * np.exp(-(angle - 180.0) / 20.0)
    pressure[angle > 180.0] = np.where(angle < 360.0, emptied, CHARGE)[angle > 180.0]
    return tuple(zip(angle.tolist(), pressure.tolist(), strict=True))


@pytest.mark.parametrize("strokes", [2, 4])
def test_the_misfire_of_a_combustion_is_the_polytrope_in_every_order(strokes):
    combustion = Combustion(**BURNING, stroke_cycle=strokes, exhaust_pressure=1.9e5)
    cylinder = Cylinder(**CRANK, combustion=combustion, orders=9)
    turns = strokes // 2
    found = torque(pair(cylinder).misfire("c"), 9 * 2)

    def pressure(a):
        return motored(a) if a <= 180.0 else 1.9e5 if a < 360.0 else CHARGE

    for order in (1.0, 2.0, 3.0, 6.0, *[0.5, 1.5] * (turns == 2)):
        wanted = coefficient(pressure, order, turns)
        np.testing.assert_allclose(
            found[round(2 * order)], wanted, rtol=0, atol=1e-5 * abs(found).max()
        )
    if turns == 1:  # what is compressed gives its work back
        assert abs(found[0]) < 1e-9 * abs(found).max()
    # Work of the gas exchange alone: the swept volume times the difference of its
    # pressures
    else:
        np.testing.assert_allclose(
            found[0].real, (CHARGE - 1.9e5) * AREA * STROKE / (4 * np.pi), rtol=1e-6
        )


@pytest.mark.parametrize("blowdown", [0.0, 6e5])
@pytest.mark.parametrize("source", ["pressure", "traces"])
def test_the_misfire_of_a_table_follows_its_polytrope_through_the_combustion(
    source, blowdown
):
    rows = table(blowdown=blowdown)
    given = {"pressure": rows, "table_firing_tdc": 0.0} if source == "pressure" else {}
    if source == "traces":
        given = {"traces": [Trace(rpm=1000.0, pressure=rows, table_firing_tdc=0.0)]}
    train = pair(Cylinder(**CRANK, **given))
    found = torque(train.misfire("c"), 24)

    def pressure(a):
        return motored(a) if a <= 180.0 else 1.9e5 if a < 360.0 else CHARGE

    wanted = np.array([coefficient(pressure, n / 2, 2) for n in range(7)])
    # Rows stand half a degree apart.
    np.testing.assert_allclose(found[:7], wanted, rtol=0, atol=1e-3 * abs(found).max())
    assert abs(torque(train)[0]) > 100 * abs(wanted[0])


def test_compression_and_expansion_of_a_two_stroke_table_have_no_mean_torque():
    found = torque(
        pair(Cylinder(**CRANK, pressure=table(2), table_firing_tdc=0.0)).misfire("c"),
        30,
    )
    assert abs(found[0]) < ALGEBRAIC * abs(found).max()


def test_a_compression_that_is_no_polytrope_is_mirrored_as_it_is():
    def bent(angle):
        return 1e5 * (
            1
            + 20 * np.exp(-(((angle + 60.0) / 15.0) ** 2))
            + 5 * np.exp(-((angle / 30.0) ** 2))
        )

    rows = table(2, compressed=bent)
    train = pair(Cylinder(**CRANK, pressure=rows, table_firing_tdc=0.0))
    angle, pressure = np.array(rows).T
    mirrored = pressure.copy()
    mirrored[angle > 0] = pressure[angle < 0][::-1]
    twin = pair(
        Cylinder(
            **CRANK,
            pressure=tuple(zip(angle, mirrored, strict=True)),
            table_firing_tdc=0.0,
        )
    )
    np.testing.assert_allclose(
        torque(train.misfire("c")),
        torque(twin),
        rtol=0,
        atol=1e-9 * abs(torque(twin)).max(),
    )


def test_the_injection_leads_from_the_misfire_to_the_cycle_as_it_is():
    train = pair(Cylinder(**CRANK, combustion=Combustion(**BURNING)))
    idle = torque(train.misfire("c"))
    fired = torque(train)
    half = torque(train.replace({"c.injection": 0.5}))
    np.testing.assert_allclose(
        half, (idle + fired) / 2, rtol=0, atol=ALGEBRAIC * abs(fired).max()
    )
    np.testing.assert_allclose(
        torque(train.replace({"c.injection": 1.0})),
        fired,
        rtol=0,
        atol=ALGEBRAIC * abs(fired).max(),
    )
    written = pair(Cylinder(**CRANK, combustion=Combustion(**BURNING), injection=0.0))
    np.testing.assert_array_equal(torque(written), idle)


@pytest.mark.parametrize(
    "name",
    ["bore", "stroke", "rod", "pressure", "combustion.compression_ratio", "injection"],
)
def test_a_misfire_is_differentiated_as_it_is_computed(name):
    source = (
        {"combustion": Combustion(**BURNING)}
        if "combustion" in name
        else {"pressure": table(), "table_firing_tdc": 0.0}
    )
    train = pair(Cylinder(**CRANK, **source))
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
    np.testing.assert_allclose(jax.grad(size)(1.0), slope, rtol=30 * GRADIENT)


def test_what_is_computed_without_firing_is_said():
    given = {"gas_torque_mean": 20.0, "gas_torque": [(0.5, 3.0, 1.0)]}
    names = (
        {"name": "table", "pressure": table(), "table_firing_tdc": 0.0},
        {"name": "model", "combustion": Combustion(**BURNING)},
    )
    parts = [
        Cylinder(**(CRANK | more))
        for more in (
            *names,
            {"name": "given", **given},
            {"name": "none", "fires": False},
        )
    ]
    train = pair(*parts)
    assert train.not_firing() == ["none: no gas torque, the scene gives none"]
    assert train.misfire("table", "model", "given").not_firing() == [
        "table, model: no injection, compression stays",
        (
            "given: no gas torque at all, as compression cannot be told from a given"
            " gas_torque"
        ),
        "none: no gas torque, the scene gives none",
    ]
    assert (
        train.cut_off("model").not_firing()[0] == "model: cut off, no gas torque at all"
    )
    for one in (train.misfires()["model"], train.misfire("model")):
        assert one.not_firing()[0] == "model: no injection, compression stays"
    assert (
        train.cut_offs()["table"].not_firing()[0]
        == "table: cut off, no gas torque at all"
    )
    with pytest.raises(
        SceneError, match="there is no cylinder 'tabel'. Did you mean 'table'"
    ):
        train.cut_off("tabel")


def test_a_misfire_of_a_given_gas_torque_and_a_cut_off_have_none_at_all():
    given = {"gas_torque_mean": 20.0, "gas_torque": [(0.5, 3.0, 1.0)]}
    train = pair(Cylinder(**CRANK, **given))
    assert not torque(train.misfire("c")).any()
    assert not torque(train.misfires()["c"]).any()
    burning = pair(Cylinder(**CRANK, combustion=Combustion(**BURNING)))
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
    train = pair(
        Cylinder(**CRANK, combustion=Combustion(**BURNING)), scenarios=scenarios
    )
    idle = torque(train.misfire("c"))
    for name in ("flag", "number"):
        np.testing.assert_allclose(
            torque(train.scenario(name)), idle, rtol=0, atol=ALGEBRAIC * abs(idle).max()
        )
    wanted = torque(train.replace({"c.combustion.imep": 0.0}))
    np.testing.assert_array_equal(torque(train.scenario("work")), wanted)
    assert not torque(train.scenario("cut")).any()


def over_cycles(fired, idle, every, firing=0.0):
    """Harmonics of several engine cycles in time: samples of the one with injection,
    round its top dead centre, and of those without, from harmonics of one cycle each,
    [N].
    """
    size = 4096
    long = [
        np.fft.irfft(np.r_[own[0].real, own[1:]] * size, size) for own in (fired, idle)
    ]
    cycle = np.concatenate(
        [
            long[0][: size // 2],
            *[np.roll(long[1], -size // 2)] * (every - 1),
            long[0][size // 2 :],
        ]
    )
    return np.fft.rfft(cycle) / cycle.size


@pytest.mark.parametrize("source", ["combustion", "table"])
def test_a_cylinder_that_fires_every_second_cycle_compresses_alone_in_the_other(source):
    model = {
        "combustion": Combustion(**BURNING),
        "orders": 300,
        "reciprocating_mass": 0.0,
    }
    given = (
        model
        if source == "combustion"
        else {"pressure": table(), "table_firing_tdc": 0.0, "orders": 300}
    )
    one = pair(Cylinder(**CRANK, **given))
    skipping = pair(Cylinder(**CRANK, **given, fires_every=2), revolutions_per_cycle=4)
    fired = torque(one, 600)
    idle = torque(one.misfire("c"), 600)
    wanted = over_cycles(fired, idle, 2)[:60]
    # 600 harmonics of one cycle leave steps of the samples.
    np.testing.assert_allclose(
        torque(skipping, 59), wanted, rtol=0, atol=3e-4 * abs(wanted).max()
    )
    np.testing.assert_allclose(
        torque(skipping, 59)[0],
        (fired[0] + idle[0]) / 2,
        rtol=0,
        atol=1e-9 * abs(fired[0]),
    )
    never = torque(skipping.misfire("c"), 60)
    np.testing.assert_allclose(
        never[::2], idle[:31], rtol=0, atol=ALGEBRAIC * abs(idle).max()
    )
    assert abs(never[1::2]).max() < 1e-9 * abs(idle).max()


def test_in_a_cycle_of_several_engine_cycles_a_cylinder_fires_in_each_unless_it_says_otherwise():
    model = {"combustion": Combustion(**BURNING)}
    short, long = (
        pair(Cylinder(**CRANK, **model), revolutions_per_cycle=r) for r in (2, 4)
    )
    found = torque(long, 24)
    np.testing.assert_allclose(
        found[::2], torque(short, 12), rtol=0, atol=ALGEBRAIC * abs(found).max()
    )
    assert not found[1::2].any()
    with pytest.raises(
        SceneError, match="one gas cycle of 4 revolutions is harmonic 0.5 .* = 4"
    ):
        pair(Cylinder(**CRANK, **model, fires_every=2))
    with pytest.raises(
        SceneError,
        match="fires_every is 2, but only pressure, traces and combustion tell",
    ):
        pair(Cylinder(**CRANK, gas_torque_mean=10.0, fires_every=2))
