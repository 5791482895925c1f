"""The combustion model against closed forms and an integration of its equation in small
steps.
"""

import numpy as np
from scipy.integrate import solve_ivp
from tolerances import ALGEBRAIC

from jaxhb.excitation import gas
from jaxhb.excitation.combustion import burnt_share, pressures
from jaxhb.excitation.crank import slider_crank

BORE = 0.1
STROKE = 0.12
ROD = 0.2
SWEPT = np.pi / 4 * BORE**2 * STROKE
NUMBERS = {
    "compression_ratio": 16.0,
    "charge_pressure": 1.8e5,
    "exhaust_pressure": 1.4e5,
    "start": -7.3,
    "duration": 55.0,
    "shape": 1.1,
    "compression_exponent": 1.36,
    "expansion_exponent": 1.27,
}


def cycle(samples=7200, revolutions=2, expansion_exponent=1.27):
    """Pressures of one cylinder without heat and per joule, [samples] each."""
    numbers = NUMBERS | {"expansion_exponent": expansion_exponent}
    by_charge, by_exhaust, by_heat = pressures(
        np.array([BORE]),
        np.array([STROKE]),
        np.array([ROD]),
        {key: np.array([value]) for key, value in numbers.items()},
        revolutions=revolutions,
        samples=samples,
    )
    charge = NUMBERS["charge_pressure"] * by_charge[0]
    exhaust = NUMBERS["exhaust_pressure"] * by_exhaust[0]
    return charge + exhaust, by_heat[0]


def volume(degrees):
    travel = slider_crank(np.deg2rad(degrees), STROKE, ROD)[0]
    return np.pi / 4 * BORE**2 * (STROKE / 15.0 + travel)


def test_without_heat_compression_and_expansion_are_one_polytrope():
    motored, _ = cycle(expansion_exponent=1.36)
    angle = np.arange(7200) * 0.1
    closed = (angle < 180) | (angle >= 540)
    work = (motored * volume(angle) ** 1.36)[closed]
    np.testing.assert_allclose(work, 1.8e5 * volume(180.0) ** 1.36, rtol=ALGEBRAIC)
    assert set(motored[1800:3600]) == {1.4e5}
    assert set(motored[3600:5400]) == {1.8e5}


def test_the_burnt_share_is_0_before_the_start_and_999_per_mille_after_the_duration():
    angle = np.array([-50.0, -7.3, 47.7, 180.0])
    share = burnt_share(angle, -7.3, 55.0, 1.1)
    np.testing.assert_allclose(share, [0.0, 0.0, 0.999, 1.0], atol=1e-9)


def integrated(heat):
    """The pressure at -180, -179, ..., 180 deg by the equation of the docstring."""
    n = NUMBERS
    area = np.pi / 4 * BORE**2

    def slope(a, p):
        passed = max(a - n["start"], 0.0) / n["duration"]
        share = 1 - np.exp(np.log(0.001) * passed ** (n["shape"] + 1))
        burning = (
            -np.log(0.001)
            * (n["shape"] + 1)
            * passed ** n["shape"]
            / n["duration"]
            * (1 - share)
        )
        exponent = (
            n["compression_exponent"]
            + (n["expansion_exponent"] - n["compression_exponent"]) * share
        )
        grown = area * slider_crank(np.deg2rad(a), STROKE, ROD)[1] * np.pi / 180
        return (-exponent * p * grown + (exponent - 1) * heat * burning) / volume(a)

    solution = solve_ivp(
        slope,
        (-180, 180),
        [n["charge_pressure"]],
        t_eval=np.arange(-180, 181),
        rtol=1e-10,
        atol=1e-3,
        max_step=1.0,
    )
    return solution.y[0]


def test_the_pressure_solves_its_equation_and_converges_with_the_square_of_the_step():
    expected = integrated(2500.0)
    errors = []
    for samples in (1440, 2880, 5760):
        motored, per_joule = cycle(samples)
        pressure = motored + 2500.0 * per_joule
        degree = samples // 720
        actual = np.concatenate(
            [pressure[540 * degree :: degree], pressure[: 180 * degree : degree]]
        )
        errors.append(np.max(np.abs(actual - expected[:-1])) / expected.max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 1e-5
    np.testing.assert_allclose(orders, 2.0, atol=0.2)


def test_a_two_stroke_cycle_has_no_gas_exchange_strokes():
    two, _ = cycle(revolutions=1, samples=7200)
    four, _ = cycle(revolutions=2, samples=14400)
    np.testing.assert_allclose(two[:3600], four[:3600], rtol=ALGEBRAIC)
    np.testing.assert_allclose(two[3600:], four[10800:], rtol=ALGEBRAIC)


def test_hats_are_linear_interpolation_with_the_nearest_value_outside():
    grid = gas.padded([[1.0, 2.0, 4.0], [3.0]])
    x = np.array([[0.0, 0.0], [1.25, 3.0], [4.0, 5.0], [9.0, 9.0]])
    values = np.array([[10.0, 20.0, 60.0], [5.0, 0.0, 0.0]])
    interpolated = (gas.hats(x, grid) * values).sum(axis=-1)
    np.testing.assert_allclose(
        interpolated[:, 0],
        np.interp(x[:, 0], [1.0, 2.0, 4.0], values[0]),
        rtol=ALGEBRAIC,
    )
    np.testing.assert_allclose(interpolated[:, 1], 5.0, rtol=ALGEBRAIC)
