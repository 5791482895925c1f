"""The misfire told from a pressure table, against simulations of the same engine with
and without injection.

The simulation with injection is the table; that without is what the misfire ought to
be. What a table cannot tell is how much denser a charge is that did not burn, and so
how much more it takes to push it out: some tenths of a percent.
"""

import numpy as np
import pytest
from built_trains import pair
from simulated_cycles import Engine, Opening, cycle, torque_harmonics

from jaxhb.elements.excitations.crank_slider import Cylinder
from jaxhb.train.excitation import excitation

ENGINES = {
    "medium speed, turbocharged": Engine(
        bore=0.32, stroke=0.42, rod=0.88, ratio=15.0, rpm=600.0, heat=1.05e5,
        exhaust=Opening(125.0, 395.0, 0.012, 2.6e5, 800.0),
        inlet=Opening(315.0, 575.0, 0.012, 3.4e5, 320.0),
    ),
    "exhaust opens late": Engine(
        bore=0.3, stroke=0.4, rod=0.8, ratio=14.0, rpm=900.0, heat=7e4,
        exhaust=Opening(155.0, 375.0, 0.008, 1.9e5, 800.0),
        inlet=Opening(350.0, 565.0, 0.009, 2.5e5, 330.0),
    ),
    "high speed, not charged": Engine(
        bore=0.1, stroke=0.12, rod=0.2, ratio=17.0, rpm=2400.0, heat=1500.0,
        exhaust=Opening(130.0, 380.0, 0.0008, 1.08e5, 800.0),
        inlet=Opening(345.0, 580.0, 0.001, 0.98e5, 310.0),
    ),
    "throttled": Engine(
        bore=0.086, stroke=0.086, rod=0.14, ratio=10.0, rpm=2000.0, heat=350.0,
        compression_exponent=1.3, start=-15.0,
        exhaust=Opening(130.0, 375.0, 0.0005, 1.05e5, 800.0),
        inlet=Opening(350.0, 590.0, 0.0006, 0.45e5, 310.0),
    ),
    "two-stroke with exhaust valve": Engine(
        bore=0.6, stroke=2.4, rod=2.9, ratio=17.0, rpm=105.0, heat=4.5e6 / 2,
        strokes=2,
        exhaust=Opening(112.0, 252.0, 0.1, 3.2e5, 650.0),
        inlet=Opening(141.0, 219.0, 0.12, 3.5e5, 310.0),
    ),
    "two-stroke with ports": Engine(
        bore=0.08, stroke=0.075, rod=0.15, ratio=9.0, rpm=3000.0, heat=400.0, strokes=2,
        exhaust=Opening(105.0, 255.0, 0.001, 1.05e5, 700.0),
        inlet=Opening(125.0, 235.0, 0.0008, 1.1e5, 310.0),
    ),
}  # fmt: skip
# Its exhaust opens and closes 20 deg before and after the other ports.
WITHIN = {"two-stroke with ports": 1.5e-2}
EVERY = 9e-3


def misfire(engine, angles, pressure, count):
    """Harmonics of the cylinder that misfires, from a table with injection."""
    cylinder = Cylinder(
        disk="a",
        name="c",
        pressure=tuple(zip(angles.tolist(), pressure.tolist(), strict=True)),
        table_firing_tdc=0.0,
        bore=engine.bore,
        stroke=engine.stroke,
        rod=engine.rod,
        ambient_pressure=0.0,
    )
    train = pair(cylinder).misfire("c")
    return np.asarray(excitation(train, 0.0, count)[0])[0]


@pytest.mark.parametrize("name", ENGINES)
def test_the_misfire_of_a_table_is_the_engine_turned_without_injection(name):
    engine = ENGINES[name]
    orders = np.arange(1 - (engine.strokes == 4) * 0.5, 6.5, 2.0 / engine.strokes)
    angles, burning = cycle(engine, fires=True)
    _, idle = cycle(engine, fires=False)
    expected = torque_harmonics(engine, angles, idle, orders)
    fired = torque_harmonics(engine, angles, burning, orders)
    actual = misfire(engine, angles, burning, 12)[np.round(2 * orders).astype(int)]
    largest = abs(expected).max()
    assert abs(actual - expected).max() < WITHIN.get(name, EVERY) * largest
    assert abs(fired - expected).max() > 0.15 * largest
