"""Closed orbits found by shooting, where a march of a few cycles does not settle."""

import numpy as np

import jaxhb
from jaxhb.periodic import orbits
from jaxhb.periodic.harmonics import Plan

RPM = 2320.0
PLAN = Plan(harmonics=384, active=(0, 1, 2, 3), flank=(0,) * 4, start="march", instants=1536, excited=24)


def test_shooting_closes_an_orbit_that_a_march_leaves_open_for_ever():
    train = jaxhb.load_scene("gear_train_30")
    orbit = orbits.Search(train, RPM, PLAN).shoot()
    assert orbit.closure <= orbits.SETTLED and orbit.tries >= 1
    response = jaxhb.solve(train, rpm=RPM)
    assert response.converged and any(entry.startswith("shooting") for entry in response.path)
    open_for_ever = jaxhb.integrate(train, rpm=RPM, cycles=30)
    assert open_for_ever.closure > 100 * orbits.SETTLED
    harmonic = np.fft.irfft(np.asarray(response.deflections), n=1536, norm="forward")
    shot = np.fft.irfft(orbit.coefficients, n=1536, norm="forward")
    assert np.abs(harmonic - shot).max() < 0.1 * np.abs(harmonic).max()  # 1536 steps leave some percent


def test_a_march_that_is_not_finite_gives_no_orbit():
    orbit = orbits.Search(jaxhb.load_scene("gear_train_30"), float("nan"), PLAN).shoot()
    assert orbit.coefficients is None and orbit.tries == 0
