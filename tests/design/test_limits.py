"""Limits as quantities of a tuning: against the numbers they smooth, gradients against
differences.
"""

import jax
import numpy as np
import pytest
from reference_data import DATA
from tolerances import GRADIENT

import jaxhb
from jaxhb.design import Objective, Parameter
from jaxhb.design.quantities import QUANTITIES

SPEEDS = np.array([420.0, 600.0, 1000.0])
SHAFT = "line shaft"
TRAIN = jaxhb.load_scene(DATA / "scenes/limited_line.toml")
NUMBERS = (
    "line shaft.outer",
    "line shaft.stress_concentration",
    "ring.damping",
    "pinion|wheel.rated_torque",
)
STRESSES = "stress", "stress over continuous limit", "stress over transient limit"
ELEMENTS = dict.fromkeys(STRESSES, SHAFT) | {"power over limit": "ring"}
ELEMENTS |= dict.fromkeys(
    ("tooth torque over limit", "tooth torque over mean"), "pinion|wheel"
)


@pytest.mark.slow
def test_exact_values_are_those_of_the_limits():
    response = jaxhb.forced_response(TRAIN, rpm=SPEEDS)
    limits = jaxhb.strength(response)
    stress = limits.stresses[SHAFT]
    tooth = limits.tooth_torques["pinion|wheel"]
    heat = limits.heat["ring"]
    expected = {
        "stress": stress.stress,
        "stress over continuous limit": stress.stress / stress.continuous,
        "stress over transient limit": stress.stress / stress.transient,
        "tooth torque over limit": tooth.vibratory / tooth.limit,
        "tooth torque over mean": tooth.vibratory / np.abs(tooth.mean),
        "power over limit": heat.power / heat.limit,
    }
    for quantity, of in ELEMENTS.items():
        exact = QUANTITIES[quantity].exact_value(response, of, None)
        np.testing.assert_allclose(exact, expected[quantity], rtol=1e-9)
        smooth = QUANTITIES[quantity].differentiated("read")(response, of, None, None)
        assert (smooth <= exact * (1 + 1e-12)).all()
        assert (smooth >= 0.99 * exact).all()
        if quantity.startswith("stress over"):
            assert exact[2] == 0  # the rule ends at 1.05 of the rated speed


@pytest.mark.slow
def test_the_gradient_of_limits_is_that_of_differences():
    @jax.jit
    @jax.value_and_grad
    def total(step):
        """Sum of all limits, as each number changes by a step of its own."""
        sizes = dict(zip(NUMBERS, (1.0, -0.7, 0.4, 1.3), strict=True))
        values = {
            name: TRAIN.value(name) * (1 + size * step) for name, size in sizes.items()
        }
        changed = TRAIN.replace(values)
        response = jaxhb.linear_response(changed, rpm=600.0)
        values = {
            quantity: QUANTITIES[quantity].differentiated("read")(
                response, of, None, None
            )
            for quantity, of in ELEMENTS.items()
        }
        return sum(
            value / 1e7 if quantity == "stress" else value
            for quantity, value in values.items()
        )

    step = 1e-4
    expected = (total(step)[0] - total(-step)[0]) / (2 * step)
    assert total(0.0)[1] == pytest.approx(float(expected), rel=GRADIENT)


@pytest.mark.slow
def test_no_share_of_a_limit_is_told_where_the_rule_has_none():
    """A tuned design at and between its speeds: 1000 rpm lies above 1.05 of the rated
    speed.
    """
    share = Objective(quantity="stress over continuous limit", of=SHAFT)
    thicker = Parameter(name="line shaft.outer", low=0.1, high=0.12)
    rpm = [600.0, 800.0, 1000.0]
    tuned = jaxhb.tune(TRAIN, parameters=[thicker], rpm=rpm, objective=share, steps=1)
    label = f"{share.quantity} of {SHAFT}"
    readings = tuned.after.readings[label]
    assert tuned.after.solved.all()
    assert (readings[:2] > 0).all()
    assert np.isnan(readings[2])
    checked = tuned.checked["after"]
    np.testing.assert_array_equal(
        np.isnan(checked.readings[label]), checked.rpm > 945.0
    )
