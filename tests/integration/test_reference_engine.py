"""The packaged V10 timing train against the independent integration of its reference file."""

import json

import numpy as np
from integrated_trains import REFERENCE

from jaxhb.integration.reference import integrate
from jaxhb.scene.files import load_scene

TABLE = json.loads((REFERENCE / "gear_train_30.json").read_text())["expected_behaviour"]


def test_tooth_forces_agree_with_the_reference_integration():
    orbit = integrate(load_scene("gear_train_30"), rpm=1800.0, steps=12000)
    assert orbit.settled
    expected = TABLE["1800"]
    largest = np.array(expected["elastic_force_max_N"])
    rms = np.sqrt((orbit.elastic**2).mean(axis=1))
    np.testing.assert_allclose(orbit.largest, largest, rtol=1e-3)
    np.testing.assert_allclose(orbit.smallest, expected["elastic_force_min_N"], atol=1e-3 * largest.max())
    np.testing.assert_allclose(rms, expected["elastic_force_rms_N"], rtol=1e-4)
    np.testing.assert_allclose(100 * orbit.separated, expected["separated_percent"], atol=0.1)
