"""The real engine of Mendes et al. 2008: published and recomputed torque curves."""

import numpy as np
import pytest
from reference_data import reference
from tolerances import PATHS

import jaxhb

DATA = reference("six_cylinder_diesel_2008")
CURVES = {
    "published_fig31_flywheel_cyl6_Nm": ("cyl6", "flywheel"),
    "published_fig32_pulley_geartrain_Nm": ("pulley", "gear train"),
}
HIGHEST_RPM = 2400
"""Pressure falls steeply above; the comparison of the reference stops there."""


@pytest.fixture(scope="module")
def train():
    return jaxhb.load_scene("six_cylinder_diesel")


@pytest.fixture(scope="module")
def sweep(train):
    return jaxhb.check(jaxhb.forced_response(train, rpm=np.array(DATA["rpm"], float)))


@pytest.fixture(scope="module")
def mirrored(train):
    """The same engine with the firing angles of the reference's table, which counts
    them the other way round.
    """
    angles = {
        f"{name}.firing_angle": -train.value(f"{name}.firing_angle")
        for name in train.topology.cylinder_names
    }
    return jaxhb.forced_response(
        train.replace(angles), rpm=np.array(DATA["rpm"], float)
    )


def shafts(sweep):
    """Elastic torques of the eight shafts, from pulley to flywheel."""
    return [sweep.torque(name).elastic for name in sweep.topology.shaft_names]


def deviation(sweep, curve, quantity):
    """Relative difference to a published curve at the speeds of the reference, as
    there, and that of the peaks.
    """
    rpm, published = np.array(sorted(DATA[curve])).T
    first, second = CURVES[curve]
    inside = np.array(DATA["rpm"]) <= HIGHEST_RPM
    torque = getattr(sweep.torque(first, second).elastic, quantity)[inside]
    speeds = np.array(DATA["rpm"])[inside]
    relative = torque / np.interp(speeds, rpm, published) - 1
    return relative, torque.max() / published.max() - 1


@pytest.mark.slow
@pytest.mark.parametrize("curve", CURVES)
def test_published_torque_curves_are_sums_of_harmonic_amplitudes(sweep, curve):
    relative, peak = deviation(sweep, curve, "sum_of_amplitudes")
    assert abs(peak) < 0.05
    assert np.median(np.abs(relative)) < 0.10
    recorded = DATA["comparison"][curve.split("_")[1] + "_sum_abs"]["median_le_2400"]
    assert abs(np.median(np.abs(relative)) - recorded) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("curve", CURVES)
def test_synthesised_half_peak_to_peak_lies_a_third_below_the_published_curves(
    sweep, curve
):
    relative, _ = deviation(sweep, curve, "half_peak_to_peak")
    assert -0.40 < np.median(relative) < -0.25
    assert (relative < 0).mean() > 0.95


@pytest.mark.slow
def test_recomputed_curves_of_all_shafts_to_their_digits(mirrored):
    table = DATA["computed_exact_orders"]
    for k, shaft in enumerate(shafts(mirrored)):
        np.testing.assert_allclose(
            shaft.sum_of_amplitudes, table["sum_abs_Nm_by_shaft"][k], rtol=PATHS
        )
        # The table looks for extremes on its own grid.
        half = table["half_peak_to_peak_Nm_by_shaft"][k]
        np.testing.assert_allclose(shaft.half_peak_to_peak, half, rtol=5e-3)


@pytest.mark.slow
def test_sense_of_the_firing_angles_moves_inner_shafts_only(sweep):
    table = np.array(DATA["computed_exact_orders"]["sum_abs_Nm_by_shaft"])
    sums = np.array([shaft.sum_of_amplitudes for shaft in shafts(sweep)])
    apart = np.abs(sums / table - 1).max(1)
    assert apart[[0, 1, 7]].max() < 1e-3
    # The sense is seen, but does not decide.
    assert 0.01 < apart.max() < 0.05
