"""The rungs of the ladder: ways to a start of Newton's method.

A rung is a function ``rung(case, last)`` that yields attempts; the next one is asked for where Newton's method did not
solve the last (``last`` is the Result of it, None at first). The cheap rungs come first: from teeth in contact Newton's
method succeeds where no tooth separates, from a short march where the motion settles within a few cycles. Shooting and
the curve from the linear law look for periodic motions that no march settles on; what they find may be unstable. A
solve takes few shots and no curve.
"""

import dataclasses
import itertools
from collections.abc import Iterator

import numpy as np

from ..response.events import Homotopy, March, Shooting
from ..response.status import Status
from . import homotopy, orbits, planning
from .ladder import Attempt
from .planned import active_deflections
from .request import MOST_HARMONICS
from .time_steps import TIME_STEPS


def contact(case, last) -> Iterator[Attempt]:
    """From teeth in contact, where the linear motion separates none."""
    if not case.plan.marches:
        yield from from_contact(case, last)


def from_contact(case, last) -> Iterator[Attempt]:
    """From teeth in contact, even where the linear motion separates some."""
    yield Attempt(dataclasses.replace(case.plan, start="linear"))


def from_response(response):
    """The rung that starts from a motion at hand."""

    def rung(case, last):
        # What the linear motion holds on a flank, a motion at hand may separate: it is known at all meshes.
        plan = planning.all_active(case.train, case.plan, case.request)
        if case.adaptive and int(response.status) == Status.TOLERANCE_NOT_MET:
            above = case.next_level(response.harmonics) or MOST_HARMONICS[plan.method]
            plan = dataclasses.replace(plan, harmonics=max(plan.harmonics, above))
        yield Attempt(plan, np.asarray(active_deflections(plan, response.deflections)))

    return rung


def short_march(case, last) -> Iterator[Attempt]:
    """From a few cycles of time integration."""
    yield Attempt(_at_least(case.marching(last), last))


def long_march(case, last) -> Iterator[Attempt]:
    """From up to 64 cycles, where one of them closes much better than the short march did."""
    plan, error = case.marching(last), march_error(last)
    counts = search_steps(case, plan, last)
    if not counts:
        return
    finer = dataclasses.replace(plan, time_steps=counts[0])
    found = case.search(finer).march(min(orbits.ORBIT.steady, error / case.effort.closer))
    event = March(found.tries, counts[0], found.periodicity_error)
    if found.coefficients is None:
        case.path.append(event)
    else:
        yield _from_orbit(case, last, plan, found, counts[0], event)


def shooting(case, last) -> Iterator[Attempt]:
    """From closed orbits, found by Newton's method on the state at the beginning of a cycle."""
    plan = case.marching(last)
    searches = {n: case.search(dataclasses.replace(plan, time_steps=n)) for n in search_steps(case, plan, last)}
    shots = _in_turn({steps: search.shoot() for steps, search in searches.items()})
    for steps, orbit in itertools.islice(shots, case.effort.orbits):
        event = Shooting(orbit.tries, steps, orbit.periodicity_error, orbit.coefficients is not None)
        yield from _with_finer_steps(case, last, plan, orbit, steps, event)


def from_linear_law(case, last) -> Iterator[Attempt]:
    """From the motion of a linear law with strong tooth damping, followed to the wanted train.

    Not where a march settled: the curve would most likely end at its motion.
    """
    if march_error(last) <= case.effort.settled:
        return
    plan = case.marching(last)
    steps = min(2 * plan.time_steps, _finest(case, plan))
    stepped = dataclasses.replace(plan, time_steps=steps)
    found = homotopy.find(case.train, case.rpm, stepped, options=case.effort.homotopy)
    event = Homotopy(found.coefficients is not None, found.curves, found.steps, found.folds, steps)
    yield from _with_finer_steps(case, last, plan, found, steps, event)


RUNGS = (contact, short_march, long_march, shooting)
"""Of a solve, the cheap ones first: the first attempt that is solved is the answer. Where the start of one of them has
failed already, or is not wanted, those after it are climbed: the order counts."""

SEARCHES = (from_contact, short_march, long_march, shooting, from_linear_law)
"""Of :func:`jaxhb.solve_all`, which makes all their attempts."""


def march_error(last):
    """Periodicity error of the short march; infinite where there was none or it was not finite."""
    return np.nan_to_num(last.periodicity_error, nan=np.inf) if last else np.inf


def _finest(case, plan):
    return max(plan.time_steps, min(case.effort.finer * plan.time_steps, orbits.ORBIT.capacity))


def search_steps(case, plan, last):
    """Time steps a cycle with which orbits are searched; those of the march itself not where it settled."""
    finest, settled = _finest(case, plan), march_error(last) <= case.effort.settled
    twice = min(2 * plan.time_steps, finest)
    affordable = case.effort.finest_shots * orbits.work_of_cycle(case.train, finest) <= case.effort.work
    counts = dict.fromkeys((plan.time_steps, twice, finest if affordable else twice))
    return [n for n in counts if n > plan.time_steps or not settled]


def _at_least(plan, last):
    """The plan with no fewer harmonics than the tolerance is known to need."""
    return dataclasses.replace(plan, harmonics=max(plan.harmonics, last.harmonics if last else 0))


def _from_orbit(case, last, plan, orbit, steps, event):
    """Newton's method from an orbit of so many time steps, with as many more harmonics where these are free.

    Below the reach of the steps there may be no solution near the orbit.
    """
    wanted = min(plan.harmonics * steps // plan.time_steps, MOST_HARMONICS[plan.method])
    harmonics = planning.level_at_least(wanted) if case.adaptive else plan.harmonics
    plan = dataclasses.replace(plan, harmonics=harmonics, time_steps=min(steps, TIME_STEPS.counts[-1]))
    return Attempt(_at_least(plan, last), orbit.coefficients, event)


def _with_finer_steps(case, last, plan, orbit, steps, event):
    """The orbit, then the one that twice the steps find from it, as long as it closes and they are not too many."""
    finest = _finest(case, plan)
    while orbit.coefficients is not None:
        yield _from_orbit(case, last, plan, orbit, steps, event)
        if case.solved:
            return
        coarse, steps = case.search(dataclasses.replace(plan, time_steps=steps)), 2 * steps
        if steps > finest:
            return
        orbit = case.search(dataclasses.replace(plan, time_steps=steps)).close(orbit.nodes, coarse)
        event = Shooting(1, steps, orbit.periodicity_error, orbit.coefficients is not None, refined=True)
    case.path.append(event)


def _in_turn(iterators):
    """``(key, item)`` of ``{key: iterator}``, one item of each by turns until none has another."""
    while iterators:
        for key, iterator in list(iterators.items()):
            item = next(iterator, None)
            if item is None:
                del iterators[key]
            else:
                yield key, item
