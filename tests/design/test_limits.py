"""Limits as quantities of a tuning: against the numbers they smooth, gradients against differences."""

import jax
import numpy as np
import pytest
from tolerances import GRADIENT

import jaxhb
from jaxhb import Damper, Disk, Load, Mesh, Shaft, Torque
from jaxhb.design.quantities import QUANTITIES

SPEEDS = np.array([600.0, 900.0, 1150.0])
STEEL = {"length": 0.4, "outer": 0.06, "shear_modulus": 8e10, "magnifier": 30.0, "damping_hz": 40.0}
JUDGED = {"stress_concentration": 0.6, "tensile_strength": 6e8}
PARTS = [
    Disk(name="engine", inertia=1.0, damping=0.2),
    Disk(name="pinion", inertia=0.02, radius=0.05),
    Disk(name="wheel", inertia=0.3, radius=0.15),
    Shaft(between=("engine", "pinion"), name="coupling", **STEEL, **JUDGED, power_limit=5.0),
    Mesh(between=("pinion", "wheel"), stiffness=2e8, damping=3e3, rated_torque=300.0),
    Damper(name="ring", disk="engine", inertia=0.1, stiffness=2e4, damping=10.0, power_limit=20.0),
    Torque(disk="engine", mean=150.0, harmonics=((0.5, 120.0, 30.0), (1.0, -60.0, 20.0), (2.0, 15.0, 40.0))),
    Load(disk="wheel"),
]
NUMBERS = ("coupling.outer", "coupling.stress_concentration", "ring.damping", "pinion|wheel.rated_torque")
ELEMENTS = {
    "stress": "coupling",
    "stress over continuous limit": "coupling",
    "stress over transient limit": "coupling",
    "tooth torque over limit": "pinion|wheel",
    "tooth torque over mean": "pinion|wheel",
    "power over limit": "ring",
}


def train():
    return jaxhb.build(PARTS, reference="engine", rated_rpm=1000.0, name="geared")


@pytest.mark.parametrize("quantity", ELEMENTS)
def test_what_is_told_is_what_the_limits_tell(quantity):
    r = jaxhb.forced_response(train(), rpm=SPEEDS)
    found, of = jaxhb.strength(r), ELEMENTS[quantity]
    stress, tooth, heat = found.stresses["coupling"], found.tooth_torques["pinion|wheel"], found.heat["ring"]
    wanted = {
        "stress": stress.stress,
        "stress over continuous limit": stress.stress / stress.continuous,
        "stress over transient limit": stress.stress / stress.transient,
        "tooth torque over limit": tooth.vibratory / tooth.limit,
        "tooth torque over mean": tooth.vibratory / np.abs(tooth.mean),
        "power over limit": heat.power / heat.limit,
    }[quantity]
    told = QUANTITIES[quantity].exact_value(r, of, None)
    np.testing.assert_allclose(told, wanted, rtol=1e-9)
    smooth = QUANTITIES[quantity].read(r, of, None)
    assert (smooth <= told * (1 + 1e-12)).all() and (smooth >= 0.99 * told).all()
    if quantity.startswith("stress over"):
        assert told[2] == 0  # the rule ends at 1.05 of the rated speed


def test_the_gradient_of_limits_is_that_of_differences():
    at = train()

    @jax.jit
    @jax.value_and_grad
    def total(step):
        """Of all the limits, as all numbers change by a step of their own."""
        sizes = dict(zip(NUMBERS, (1.0, -0.7, 0.4, 1.3), strict=True))
        changed = at.replace({name: at.value(name) * (1 + size * step) for name, size in sizes.items()})
        response = jaxhb.linear_response(changed, rpm=900.0)
        values = {quantity: QUANTITIES[quantity].read(response, of, None) for quantity, of in ELEMENTS.items()}
        return sum(value / 1e7 if quantity == "stress" else value for quantity, value in values.items())

    step = 1e-4
    wanted = (total(step)[0] - total(-step)[0]) / (2 * step)
    assert total(0.0)[1] == pytest.approx(float(wanted), rel=GRADIENT)
