"""The true error of a harmonic solution: what shooting over one cycle, from where it starts, changes on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jaxhb.response.response import Response

from ..harmonic import backlash
from .reference import REFERENCE, Orbit, equations_of, reference_orbit


@dataclass(frozen=True)
class Correction:
    """What one-cycle shooting changes on a harmonic solution: its true error.

    Attributes
    ----------
    error : float
        Largest difference of the elastic tooth forces over the cycle and the meshes / largest elastic tooth force.
    peak_error : float
        Largest difference of their extremes / largest elastic tooth force.
    orbit : Orbit
        The corrected motion; ``orbit.settled`` says whether shooting closed the cycle.
    """

    error: float
    peak_error: float
    orbit: Orbit


def shooting_correction(response: Response, *, steps: int | None = None, tolerance: float = 1e-09) -> Correction:
    """Start at a harmonic solution, integrate one cycle, correct by Newton: the change is the solution's true error.

    The cycle is cut into 32 segments that Newton's method joins (multiple shooting): valid on unstable motions too. The
    answer is as good as the integration: see :func:`resolving_steps`. Teeth without damping need more steps: a change
    above three times ``response.truncation_error`` is asked with 4 and 16 times as many, which overrule it if they
    close the cycle.

    Parameters
    ----------
    response : Response
        At one speed.
    steps : int, optional
        Exactly so many per cycle, rounded up to a multiple of 32; without it :func:`resolving_steps` and, where these
        contradict the estimate, more.
    tolerance : float
        Periodicity error to reach.

    Returns
    -------
    Correction
        ``orbit.deflection.shape[1]`` steps were taken.

    Raises
    ------
    ValueError
        For scenes that cannot be integrated in time, see :func:`integrate`, and where a soft ground lets the mean
        torques turn the train so far that rounding hides the backlash.

    Examples
    --------
    >>> import jaxhb
    >>> r = jaxhb.solve(jaxhb.load_scene("gear_train_30"), rpm=600.0)
    >>> jaxhb.shooting_correction(r).error < 1e-3
    True
    """
    train, rpm = response.train, float(response.rpm)
    if train is None:
        raise ValueError("the response comes out of a transformation without its train: solve outside of it")
    if not any(train.topology.mesh_backlash):
        raise ValueError(f"{train.topology.title} has no mesh with backlash: its response is exact")
    system, meshes, frequency, load = equations_of(train, rpm)
    start = np.asarray(response.angles) * np.asarray(system.radius)[:, None]
    farthest, least = np.abs(start[:, 0]).max(), np.min(meshes.law.backlash)
    if REFERENCE.rounded * farthest > least:
        raise ValueError(
            f"{train.topology.title}: the mean torques turn a gear by {farthest:.1e} m along its teeth, and "
            f"time integration keeps no digits for a backlash of {least:.1e} m: add a [[load]] or a stiffer [[ground]]."
        )

    def correction(steps):
        return _difference(
            response, meshes, reference_orbit(system, meshes, frequency, load, start, steps=steps, tolerance=tolerance)
        )

    found = correction(steps)
    believed = REFERENCE.contradicts * max(float(response.truncation_error), REFERENCE.step_error)
    for _ in range(2 if steps is None else 0):
        if not found.orbit.settled or found.error <= believed:
            break
        # A correction far above the estimate is more often an error of the steps than of the harmonics: teeth without
        # damping ring on what coarse steps make.
        finer = correction(4 * found.orbit.deflection.shape[1])
        if not finer.orbit.settled:
            break
        found = finer
    return found


def _difference(response, meshes, orbit):
    """The Correction of a response by the motion that closes beside it."""
    train = response.train
    own = train.topology.backlash_index
    deflection = response.deflection_samples(orbit.elastic.shape[1])[own]
    force = np.asarray(backlash.force(meshes.law.expand(), deflection))
    extremes = np.array([[s.min, s.max] for s in (response.force(train.topology.mesh_names[i]).elastic for i in own)])
    change = extremes - np.stack([orbit.smallest, orbit.largest], axis=1)
    largest = np.abs(orbit.elastic).max()
    return Correction(
        float(np.abs(force - orbit.elastic).max() / largest), float(np.abs(change).max() / largest), orbit
    )
