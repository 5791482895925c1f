"""One mesh with a sharp gap against event-exact solutions (transition 1e-3, epsilon
1e-6 as packaged).
"""

import numpy as np
import pytest
from reference_data import reference

import jaxhb

ROWS = reference("backlash_one_mass_exact")["kahraman_singh_form"]["rows"]
HALF_GAP = 5e-5
RPM_PER_OMEGA = 5625.0
MESH = "gear a|gear b"


@pytest.fixture(scope="module")
def pair():
    return jaxhb.load_scene("spur_pair")


def amplitude(response):
    """Fundamental of the deflection in half gaps, the unit of the exact solutions."""
    return response.deflection(MESH).amplitudes[0] / HALF_GAP


@pytest.mark.slow
@pytest.mark.parametrize(
    "row", [r for r in ROWS if r["sweep"] == "up"], ids=lambda r: f"Omega={r['Omega']}"
)
def test_fundamental_amplitude_at_50_harmonics_is_the_exact_one(pair, row):
    """1e-4: the smooth zone of 1e-3 of the gap moves the amplitude by about 1e-5."""
    response = jaxhb.check(
        jaxhb.solve(pair, rpm=RPM_PER_OMEGA * row["Omega"], harmonics=50)
    )
    assert amplitude(response) == pytest.approx(row["amp_h"][0], rel=1e-4)
    assert response.deflection(MESH).mean / HALF_GAP == pytest.approx(
        row["mean"], rel=1e-4
    )
    separated = response.mesh(MESH).separated_fraction > 0
    assert separated == (row["regime"] != "linear (always in contact)")


@pytest.mark.slow
def test_a_solution_is_accepted_as_its_own_start(pair):
    """The two differ by what the residual may leave, 1e-10 of the backlash and the
    motion.
    """
    first = jaxhb.solve(pair, rpm=RPM_PER_OMEGA, harmonics=50)
    again = jaxhb.solve(pair, rpm=RPM_PER_OMEGA, harmonics=50, start=first)
    assert int(again.steps) == 0
    tolerance = 1e-10 * (2 * HALF_GAP + np.linalg.norm(first.deflections))
    assert np.allclose(again.deflections, first.deflections, rtol=0, atol=tolerance)


@pytest.mark.slow
def test_error_falls_with_the_fourth_power_of_the_harmonics(pair):
    """A law with Lipschitz slope, crossed at speed: sup-norm error of the motion ~ N^-4
    (docs/theory A6).
    """
    smooth = pair.replace(
        {
            f"{MESH}.transition": 0.2,
            f"{MESH}.epsilon": 0.05,
            "error a.harmonics": [[0.0, -100.0]],
            "error b.harmonics": [[0.0, 100.0]],
        }
    )

    def motion(harmonics):
        response = jaxhb.check(
            jaxhb.solve(smooth, rpm=RPM_PER_OMEGA, harmonics=harmonics, tolerance=0.1)
        )
        return response.deflection(MESH).samples(4096)

    # The program of the other tests; it shifts the exponent by 0.1.
    finest = motion(50)
    few, more = (np.abs(motion(harmonics) - finest).max() for harmonics in (8, 32))
    assert np.log(few / more) / np.log(32 / 8) == pytest.approx(4.0, abs=0.7)
