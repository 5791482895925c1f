"""Tables of tangential pressure, as engine makers give them, against direct Fourier
integrals, closed forms and the pressures from which they were computed.
"""

import dataclasses

import jax
import numpy as np
import pytest
from built_trains import pair
from scipy.integrate import quad
from tolerances import ALGEBRAIC, GRADIENT

import jaxhb
from jaxhb.elements.elements import Disk, Load, Shaft
from jaxhb.elements.engine import Engine
from jaxhb.elements.excitations.crank_slider import (
    Combustion,
    Cylinder,
    TangentialPressure,
)
from jaxhb.elements.sentences import SceneError
from jaxhb.train.assembly import build
from jaxhb.train.excitation import excitation

BORE = 0.3
STROKE = 0.4
ROD = 0.8
SIZE = np.pi / 4 * BORE**2 * STROKE / 2
SWEPT = np.pi / 4 * BORE**2 * STROKE
COMBUSTION = Combustion(
    compression_ratio=14.0,
    charge_pressure=2.5e5,
    start=-4.0,
    duration=60.0,
    imep=1.8e6,
)
# order, imep, cosine, sine
ROWS = [
    (0.5, 0.0, 1e5, 2e5),
    (0.5, 1e6, 3e5, 1e5),
    (0.5, 2e6, 4e5, -1e5),
    (1.0, 0.0, 2e4, 0.0),
    (1.0, 1e6, 1e5, 5e4),
    (1.0, 2e6, 2e5, 8e4),
]


def cylinder(name="c", **source):
    return Cylinder(disk="a", name=name, bore=BORE, stroke=STROKE, **source)


def table(imep=2e6, rows=ROWS, **more):
    return TangentialPressure(imep=imep, cosine_sine=rows, **more)


def torque(train, rpm, harmonics=48):
    """Torque on disk a, complex over the harmonics of the cycle."""
    return np.asarray(excitation(train, rpm, harmonics)[0])[0]


def close(actual, expected, tolerance=ALGEBRAIC):
    scale = np.abs(expected).max()
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * scale)


def row(train, rpm):
    """Mean, order 0.5 and order 1 of a torque of the reference rotor, as T^n."""
    return torque(train, rpm, 2)


@pytest.mark.parametrize(
    ("load", "cosines", "sines"),
    [(1.0, (4e5, 2e5), (-1e5, 8e4)), (0.75, (3.5e5, 1.5e5), (0.0, 6.5e4))],
)
def test_an_order_is_its_tangential_pressure_on_the_piston_at_the_crank(
    load, cosines, sines
):
    """Linear between the rows; the mean does the work of the mean pressure in two
    revolutions.
    """
    angle = 40.0
    train = pair(
        cylinder(tangential_pressure=table(), load=[(1000.0, load)], firing_angle=angle)
    )
    orders = np.array([0.5, 1.0])
    mean = load * 2e6 * SWEPT / (4 * np.pi)
    parts = 0.5 * SIZE * (np.array(cosines) - 1j * np.array(sines))
    turned = parts * np.exp(-1j * orders * np.deg2rad(angle))
    close(row(train, 1000.0), [mean, *turned])


def test_amplitude_and_phase_are_of_the_cosine_or_of_the_sine():
    expected = row(pair(cylinder(tangential_pressure=table())), 900.0)
    for word, angle_of in (
        ("cosine", lambda c, s: np.degrees(np.arctan2(-s, c))),
        ("sine", lambda c, s: np.degrees(np.arctan2(c, s))),
    ):
        rows = [(n, p, np.hypot(c, s), angle_of(c, s)) for n, p, c, s in ROWS]
        amplitudes = TangentialPressure(imep=2e6, amplitude_phase=rows, phase_of=word)
        close(row(pair(cylinder(tangential_pressure=amplitudes)), 900.0), expected)


def test_compression_alone_is_the_row_of_no_mean_pressure():
    """With part of the injection, that share of the way to it, the mean, too."""
    train = pair(cylinder(tangential_pressure=table()))
    whole = row(train, 900.0)
    idle = 0.5 * SIZE * np.array([0.0, 1e5 - 2e5j, 2e4])
    close(row(train.misfire("c"), 900.0), idle)
    close(row(train.replace({"c.injection": 0.25}), 900.0), 0.25 * whole + 0.75 * idle)
    close(row(train.cut_off("c"), 900.0), np.zeros(3) + 0j, 0.0)
    close(row(train.replace({"c.gas_factor": 0.5}), 900.0), 0.5 * whole)
    assert train.misfire("c").not_firing() == ["c: no injection, compression stays"]


def test_what_the_table_does_not_cover_is_noted():
    burning = [row for row in ROWS if row[1]]
    train = pair(
        cylinder(
            tangential_pressure=table(rows=burning),
            load=[(500.0, 0.25), (1000.0, 1.0)],
        )
    )
    assert train.outside_traces(1000.0) == []
    assert train.outside_traces(500.0) == [
        "the mean indicated pressure lies outside the tangential pressures of 'c'"
        " (1e+06 to 2e+06 Pa): the nearest is used"
    ]
    close(row(train, 500.0)[1:], 0.5 * SIZE * np.array([3e5 - 1e5j, 1e5 - 5e4j]))
    for change in (lambda: train.misfire("c"), train.misfires):
        with pytest.raises(SceneError, match="no rows at imep 0, those of compression"):
            change()


def test_an_engine_of_two_strokes_has_whole_orders():
    rows = [(1.0, 1e6, 2e5, 0.0), (2.0, 1e6, 0.0, 1e5)]
    engine = Engine(
        cylinders=1,
        disks=("a",),
        firing_order=("1",),
        stroke_cycle=2,
        bore=BORE,
        stroke=STROKE,
        tangential_pressure=table(1e6, rows),
    )
    parts = [Disk(name="a", inertia=1.0), Disk(name="b", inertia=1.0)]
    parts += [Shaft(between=("a", "b"), stiffness=1e5), engine, Load(disk="b")]
    train = build(parts, revolutions_per_cycle=1)
    expected = 0.5 * SIZE * np.array([2e5, -1e5j])
    close(torque(train, 100.0, 2), [1e6 * SWEPT / (2 * np.pi), *expected])


def smooth_pressure(degrees):
    """A smooth pressure of a four-stroke cycle from firing top dead centre, Pa."""
    half = np.deg2rad(degrees) / 2
    return 1e5 + 6e6 * np.exp(9.0 * (np.cos(half - 0.1) - 1.0))


def travel(degrees):
    """Slope of the travel of the piston by the crank angle, m, from the triangle of
    crank and rod.
    """
    a = np.deg2rad(degrees)
    r = STROKE / 2
    return r * np.sin(a) * (1 + r * np.cos(a) / np.sqrt(ROD**2 - (r * np.sin(a)) ** 2))


def test_tangential_pressures_are_the_fourier_integrals_of_the_tangential_force():
    """The force is that of gas and ambient pressure; the integrals are those of
    scipy.
    """
    degrees = np.arange(0.0, 720.0, 0.1)
    train = pair(
        cylinder(
            rod=ROD,
            pressure=list(zip(degrees, smooth_pressure(degrees), strict=True)),
            table_firing_tdc=0.0,
            ambient_pressure=1e5,
            gas_factor=1.3,
        )
    )
    result = jaxhb.tangential_pressure(train, "c", rpm=900.0)
    assert result.stroke_cycle == 4
    np.testing.assert_array_equal(result.orders, np.arange(1, 25) / 2)

    def integral(function):
        # Four parts: quad sees the narrow peak.
        ends = [0.0, 60.0, 360.0, 660.0, 720.0]
        return sum(
            quad(function, low, high, epsabs=1e-4, epsrel=1e-12, limit=400)[0]
            for low, high in zip(ends, ends[1:], strict=False)
        )

    def force(degrees):
        """Tangential force over the area of the piston."""
        return (smooth_pressure(degrees) - 1e5) * travel(degrees) / (STROKE / 2)

    work = integral(lambda a: smooth_pressure(a) * travel(a)) * np.pi / 180
    np.testing.assert_allclose(result.imep[1], work / STROKE, rtol=1e-12)
    largest = result.amplitude.max()
    for order in (0.5, 1.0, 2.5, 6.0, 12.0):
        k = int(2 * order) - 1
        cosine = integral(lambda a, n=order: force(a) * np.cos(n * np.deg2rad(a))) / 360
        sine = integral(lambda a, n=order: force(a) * np.sin(n * np.deg2rad(a))) / 360
        # The trapezoidal rule on 7200 angles has no error on a signal this smooth.
        np.testing.assert_allclose(
            [result.cosine[1, k], result.sine[1, k]],
            [cosine, sine],
            rtol=0,
            atol=1e-10 * largest,
        )
        amplitude = result.amplitude[1, k] * np.cos(np.deg2rad(result.phase_deg[1, k]))
        np.testing.assert_allclose(amplitude, cosine, rtol=0, atol=1e-10 * largest)


@pytest.mark.parametrize("strokes", [4, 2])
def test_a_table_that_is_read_back_gives_the_same_torques(strokes):
    """With injection all of it, without it all but the mean, which the exchange of the
    gas has and the table at imep 0 has not.
    """
    burning = dataclasses.replace(
        COMBUSTION, stroke_cycle=strokes, exhaust_pressure=2.2e5
    )
    loads = [(300.0, 0.3), (900.0, 1.0)]
    train = pair(
        cylinder(
            rod=ROD,
            reciprocating_mass=20.0,
            combustion=burning,
            ambient_pressure=1e5,
            load=loads,
            firing_angle=30.0,
        )
    )
    result = jaxhb.tangential_pressure(train, "c", rpm=600.0)
    back = pair(
        cylinder(
            rod=ROD,
            reciprocating_mass=20.0,
            tangential_pressure=result.element(),
            firing_angle=30.0,
        )
    )
    close(torque(back, 600.0), torque(train, 600.0), 1e-10)
    without = torque(train.misfire("c"), 600.0)
    close(torque(back.misfire("c"), 600.0)[1:], without[1:], 1e-10)


def test_a_table_of_several_loads_holds_at_each_of_them():
    train = pair(cylinder(rod=ROD, combustion=COMBUSTION))
    shares = [0.25, 0.5, 1.0]
    result = jaxhb.tangential_pressure(train, "c", rpm=600.0, loads=shares)
    np.testing.assert_allclose(
        result.imep, 1.8e6 * np.array([0.0, *shares]), rtol=1e-12
    )
    load = [(100.0 * k, share) for k, share in enumerate(shares, 1)]
    back = pair(cylinder(tangential_pressure=result.element(), load=load))
    for k, share in enumerate(shares, 1):
        # At this load alone, whatever the speed
        alone = pair(cylinder(rod=ROD, combustion=COMBUSTION, load=[(600.0, share)]))
        expected = jaxhb.tangential_pressure(
            alone, "c", rpm=600.0, loads=[share]
        ).element()
        same = pair(cylinder(tangential_pressure=expected))
        close(torque(back, 100.0 * k), torque(same, 600.0), 1e-10)
    with pytest.raises(SceneError, match="must increase from above 0"):
        jaxhb.tangential_pressure(train, "c", rpm=600.0, loads=[1.0, 0.5])


def test_a_table_of_the_maker_is_that_of_its_load_at_a_speed():
    """Half way between the rows at 1 and 2 MPa; the train of that table has its
    torques.
    """
    load = [(300.0, 0.3), (900.0, 0.9)]
    train = pair(
        cylinder(
            tangential_pressure=table(), load=load, scale=[(750.0, 2.0)], orders=1.0
        )
    )
    result = jaxhb.tangential_pressure(train, "c", rpm=750.0)
    np.testing.assert_allclose(result.orders, [0.5, 1.0])
    np.testing.assert_allclose(result.imep, [0.0, 2 * 1.5e6], rtol=ALGEBRAIC)
    cosine = [[1e5, 2e4], [3.5e5, 1.5e5]]
    sine = [[2e5, 0.0], [0.0, 6.5e4]]
    close(result.cosine, 2 * np.array(cosine), ALGEBRAIC)
    close(result.sine, 2 * np.array(sine), ALGEBRAIC)
    back = pair(cylinder(tangential_pressure=result.element()))
    close(torque(back, 750.0), torque(train, 750.0), ALGEBRAIC)
    at_loads = jaxhb.tangential_pressure(train, "c", rpm=300.0, loads=[0.5, 1.0])
    np.testing.assert_allclose(at_loads.imep, [0.0, 2e6, 4e6], rtol=ALGEBRAIC)
    with pytest.raises(SceneError, match="2e.06, 1e.06 Pa, must increase from above 0"):
        jaxhb.tangential_pressure(train, "c", rpm=300.0, loads=[0.5, 0.25])
    # Without rows at 0 compression is not known.
    burning = pair(cylinder(tangential_pressure=table(rows=[*ROWS[1:3], *ROWS[4:]])))
    result = jaxhb.tangential_pressure(burning, "c", rpm=750.0)
    np.testing.assert_allclose(result.imep, [2e6], rtol=ALGEBRAIC)


def test_tangential_pressures_have_derivatives():
    train = pair(cylinder(rod=ROD, combustion=COMBUSTION))

    def amplitude(imep):
        changed = train.replace({"c.combustion.imep": imep})
        return jaxhb.tangential_pressure(changed, "c", rpm=600.0).amplitude[1, 4]

    slope = jax.grad(amplitude)(1.8e6)
    step = 1e3
    # The amplitude is nearly linear in the imep: differences have no error that counts.
    difference = (amplitude(1.8e6 + step) - amplitude(1.8e6 - step)) / (2 * step)
    np.testing.assert_allclose(slope, difference, rtol=GRADIENT)
    back = pair(cylinder(tangential_pressure=table(imep=1.5e6)))

    def mean(imep):
        changed = back.replace({"c.tangential_pressure.imep": imep})
        return excitation(changed, 600.0, 2)[0][0].real.sum()

    # Between the rows at 1e6 and 2e6: mean, and half the slopes of the cosines
    expected = SWEPT / (4 * np.pi) + 0.5 * SIZE * (0.1 + 0.1)
    np.testing.assert_allclose(jax.grad(mean)(1.5e6), expected, rtol=GRADIENT)


def test_a_csv_file_holds_the_rows_in_any_order_of_its_columns(tmp_path):
    """Heads name the columns and their units."""
    lines = ["imep bar,order,sine bar,cosine bar"]
    lines += [f"{1e-5 * p!r},{n},{1e-5 * s!r},{1e-5 * c!r}" for n, p, c, s in ROWS]
    (tmp_path / "t.csv").write_text("\n".join(lines))
    (tmp_path / "scene.toml").write_text(
        f"""
        [[disk]]
        name = "a"
        inertia = 1.0
        [[disk]]
        name = "b"
        inertia = 1.0
        [[shaft]]
        between = ["a", "b"]
        stiffness = 1e5
        [[load]]
        disk = "b"
        [[cylinder]]
        name = "c"
        disk = "a"
        bore = {BORE}
        stroke = {STROKE}
        [cylinder.tangential_pressure]
        imep = 2e6
        cosine_sine = "t.csv"
        """
    )
    train = jaxhb.load_scene(tmp_path / "scene.toml")
    close(row(train, 900.0), row(pair(cylinder(tangential_pressure=table())), 900.0))


def test_what_has_no_pressure_has_no_tangential_pressures():
    train = pair(cylinder(gas_torque_mean=20.0, gas_torque=[(0.5, 3.0, 1.0)]))
    with pytest.raises(SceneError, match="comes from no pressure table"):
        jaxhb.tangential_pressure(train, "c", rpm=600.0)
    with pytest.raises(SceneError, match="there is no cylinder 'd'"):
        jaxhb.tangential_pressure(train, "d", rpm=600.0)
