"""Charge pressures over load and speed, against cylinders that have the pressure of one load as their own."""

import numpy as np
import pytest
from built_trains import pair
from tolerances import ALGEBRAIC

from jaxhb.elements.elements import Combustion, Cylinder, SceneError
from jaxhb.excitation.gas import charge_pressures
from jaxhb.excitation.mean_torques import gas_pressures
from jaxhb.excitation.torques import excitation
from jaxhb.report.text.scene_check import charges_of
from jaxhb.train.plausible import plausibility

CRANK = {"disk": "a", "name": "c", "bore": 0.5, "stroke": 2.0, "rod": 2.2, "ambient_pressure": 1e5}
CRANK |= {"reciprocating_mass": 2000.0}
BURNING = {"compression_ratio": 16.0, "start": -1.0, "duration": 50.0, "stroke_cycle": 2}
FULL, IMEP, ATMOSPHERE = 3.6e5, 1.8e6, 101325.0
PROPELLER = tuple((rpm, (rpm / 100.0) ** 2) for rpm in (10.0, 20.0, 40.0, 60.0, 80.0, 100.0))


def train(charge=FULL, imep=IMEP, load=PROPELLER, **more):
    burning = Combustion(**BURNING, charge_pressure=charge, imep=imep, **more)
    return pair(Cylinder(**CRANK, combustion=burning, load=load))


def torque(one, rpm):
    return np.asarray(excitation(one, rpm, 30)[0])[0]


@pytest.mark.parametrize("rpm", [20.0, 60.0, 100.0])
@pytest.mark.parametrize("exhaust", [None, 3.3e5])
def test_without_a_table_what_lies_above_the_atmosphere_follows_the_load(rpm, exhaust):
    load = (rpm / 100.0) ** 2
    pressures = [ATMOSPHERE + load * (full - ATMOSPHERE) for full in (FULL, exhaust or FULL)]
    own = train(pressures[0], load * IMEP, load=(), exhaust_pressure=pressures[1])
    found, wanted = torque(train(exhaust_pressure=exhaust), rpm), torque(own, rpm)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=ALGEBRAIC * abs(wanted).max())


def test_at_low_load_the_largest_pressure_is_that_of_the_low_charge():
    """At 20 rpm 1.1 bar are compressed, not 3.6: the pressure is less than half."""
    at_full_charge = train(charge_over_load=((1.0, 1.0),))
    peaks = [
        float(gas_pressures(one.cylinders, one.topology.gas_cycles, 20.0).max()) for one in (train(), at_full_charge)
    ]
    charge = ATMOSPHERE + 0.04 * (FULL - ATMOSPHERE)
    # Without a notable heat it is the compression.
    assert charge * 16.0**1.35 < peaks[0] < 1.15 * charge * 16.0**1.35
    assert peaks[1] > 0.98 * FULL * 16.0**1.35 and peaks[0] < 0.4 * peaks[1]


@pytest.mark.parametrize("charge", [1.0e5, 0.6e5])
def test_an_engine_that_is_not_charged_keeps_its_pressure(charge):
    found = charge_pressures(train(charge).cylinders, np.array([10.0, 60.0]))
    np.testing.assert_array_equal(found, np.full((2, 2, 1), charge))


def test_tables_over_load_and_over_speed_multiply_the_pressures_of_full_load():
    over_load = train(charge_over_load=((0.1, 0.4), (0.5, 0.8), (1.0, 1.0)), exhaust_pressure=3e5)
    over_rpm = train(charge_over_rpm=((20.0, 0.4), (60.0, 0.6), (100.0, 1.0)))
    both = pair(
        Cylinder(
            **(CRANK | {"name": "x"}), combustion=Combustion(**BURNING, charge_pressure=2e5, imep=IMEP), load=PROPELLER
        ),
        Cylinder(
            **CRANK, combustion=Combustion(**BURNING, charge_pressure=FULL, imep=IMEP, charge_over_rpm=((20.0, 0.4),))
        ),
    )
    charge, exhaust = charge_pressures(over_load.cylinders, np.array([10.0, 55.0, 100.0]))
    loads = np.interp([10.0, 55.0, 100.0], *np.transpose(PROPELLER))
    factors = np.interp(loads, [0.1, 0.5, 1.0], [0.4, 0.8, 1.0])
    np.testing.assert_allclose(charge[:, 0], FULL * factors, rtol=ALGEBRAIC)
    np.testing.assert_allclose(exhaust[:, 0], 3e5 * factors, rtol=ALGEBRAIC)
    charge, _ = charge_pressures(over_rpm.cylinders, np.array([5.0, 40.0, 120.0]))
    np.testing.assert_allclose(charge[:, 0], FULL * np.array([0.4, 0.5, 1.0]), rtol=ALGEBRAIC)
    charge, _ = charge_pressures(both.cylinders, 20.0)
    np.testing.assert_allclose(charge, [ATMOSPHERE + 0.04 * (2e5 - ATMOSPHERE), 0.4 * FULL], rtol=ALGEBRAIC)
    assert both.without("x").cylinders.combustion.charge_by == ("rpm",)


def test_a_charge_that_follows_the_load_is_noted_and_told_over_the_speeds():
    (note,) = [note for note in plausibility(train()) if "charge pressure" in note]
    assert "follows the load: 1.039e5 Pa at 10 rpm (load 0.01), 3.6e5 Pa at full load: give charge_over_load" in note
    for silent in (train(load=()), train(1e5), train(charge_over_load=((0.0, 0.4), (1.0, 1.0)))):
        assert not [note for note in plausibility(silent) if "charge pressure" in note]
    load, charge = charges_of(train(), [20.0, 100.0])["c"]
    np.testing.assert_allclose([load, charge], [[0.04, 1.0], [1.116720, 3.6]], rtol=1e-6)


@pytest.mark.parametrize(
    ("tables", "sentence"),
    [
        ({"charge_over_load": ((0.0, 0.5),), "charge_over_rpm": ((0.0, 0.5),)}, "are both given. Keep one of them."),
        ({"charge_over_rpm": ((10.0, 0.5), (5.0, 0.6))}, "charge_over_rpm, row 2: rpm 5 after 10; must increase."),
        ({"charge_over_load": ((0.0, 0.0),)}, "the least factor of charge_over_load is 0, must be greater than 0."),
    ],
)
def test_faulty_tables_are_told(tables, sentence):
    with pytest.raises(SceneError, match=sentence):
        train(**tables)
