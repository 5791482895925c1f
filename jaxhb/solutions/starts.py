"""Start strategies: ways to a start of Newton's method, tried one after another until the equations are solved.

A start strategy is a function ``strategy(case, last)`` that yields attempts; the next one is asked for where Newton's
method did not solve the last (``last`` is the Result of it, None at first). The cheap strategies come first: from teeth
in contact Newton's method succeeds where no tooth separates, from a short march where the motion settles within a few
cycles. Shooting and the curve from the linear law look for periodic motions that no march settles on; what they find
may be unstable. A solve takes few shots and no curve.

A :class:`Case` is a train at one speed and what its attempts share; :func:`first_solved` makes the attempts of
strategies one after another, :func:`refine` takes one of them to the tolerance.
"""

import dataclasses
import itertools
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from jaxhb.balance.plan import Plan
from jaxhb.balance.planned import active_deflections, first_start, solve_once
from jaxhb.balance.problem import problem_at
from jaxhb.balance.program import solve_problem
from jaxhb.balance.request import MOST_HARMONICS, TIME_STEPS, Request, time_steps_for, time_steps_of
from jaxhb.linear.mesh_modes import mesh_mode_harmonics
from jaxhb.results.response import Response
from jaxhb.results.status import Homotopy, March, Shooting, Status
from jaxhb.solutions import homotopy, orbits, planning
from jaxhb.solutions.homotopy import HomotopyOptions


@dataclass(frozen=True)
class Effort:
    """What the strategies above a short march may cost: by default what a solve takes unasked, about a second for 27
    disks.

    Parameters
    ----------
    settled : periodicity error of a march from which shooting with its steps is useless: what Newton's method then
        lacks are shorter steps or more harmonics
    closer : a long march is a start where its periodicity error is so many times smaller than that of the short one
    finer : times the steps of the march, at most, with which orbits are searched, as coarse steps bend them. With 1 all
        searches keep the steps of the march
    finest_shots : with the finest steps, that ``work`` has to pay for: of larger trains fewer closed none. Counts where
        ``finer`` is above 2
    work : of the shots of a search, in units of :func:`jaxhb.solutions.orbits.work_of_cycle`
    orbits : tried at most; some have no harmonics near them, or lie beyond a turning point that the steps displaced
    homotopy : options of the curve from the linear law
    """

    settled: float = 1e-5
    closer: float = 30.0
    finer: int = 1
    finest_shots: int = 4
    work: float = 5e6
    orbits: int = 2
    homotopy: HomotopyOptions = homotopy.HOMOTOPY


LONG = Effort(finer=4, work=orbits.ORBIT.work, orbits=16)
"""What the searches of :func:`jaxhb.solve_all` may cost: minutes."""


@dataclass(frozen=True)
class Attempt:
    """From where Newton's method is to start: given deflections ``(G, n+1)``, else as the plan says.

    event : how the given deflections were found.
    """

    plan: Plan
    given: np.ndarray | None = None
    event: object = None


@dataclass(frozen=True)
class Result:
    """What became of an attempt: the plan in the end, and the periodicity error of the short march, nan without one or
    where it was not finite.

    harmonics : fewest that the tolerance is known to need.
    """

    response: Response
    plan: Plan
    periodicity_error: float
    harmonics: int

    @property
    def status(self):
        """The Status."""
        return Status(int(self.response.status))


@dataclass
class Case:
    """One train at one speed, asked for once: its numbers, and what several strategies share.

    Parameters
    ----------
    train, rpm, request : what is asked
    plan : Plan, from the linear motion; strategies change copies of it
    effort : what strategies may cost
    search_with : class of the searches for orbits
    path : events so far; strategies and :func:`refine` add theirs
    solved : whether no further attempt is wanted, as the last one was solved, or none can be; set by :func:`refine` and
        read by strategies that would go on with the same orbit
    searches : for orbits, by the meshes and time steps of their plans
    deadline : on the monotonic clock, when no further attempt begins
    """

    train: object
    rpm: float
    request: Request
    plan: Plan
    effort: Effort = field(default_factory=Effort)
    search_with: type = orbits.OrbitSearch
    path: list = field(default_factory=list)
    solved: bool = False
    searches: dict = field(default_factory=dict)
    deadline: float = math.inf

    @property
    def overdue(self):
        """Whether no further attempt begins."""
        return time.monotonic() > self.deadline

    @cached_property
    def modes(self):
        """Harmonics of the cycle at the highest mesh modes, and at those that strain meshes weakly."""
        return mesh_mode_harmonics(self.train, self.train.topology.cycle_frequency(float(self.rpm)))

    @cached_property
    def problem(self):
        """The equations at this speed."""
        return problem_at(self.train, self.rpm, self.plan.sizes.excited)

    @property
    def adaptive(self):
        """Whether the number of harmonics is free."""
        return self.request.harmonics is None

    def next_level(self, harmonics):
        """The number of harmonics to try after ``harmonics``; None at the limit."""
        one, sweep = planning.PLANNING.level_ratio, planning.PLANNING.sweep_level_ratio
        return planning.next_level(harmonics, self.plan.method, sweep if self.request.few_levels else one)

    @property
    def resolving(self):
        """Time steps a cycle that resolve the mesh modes and the excitation."""
        return time_steps_for(max(self.modes[0], 2 * self.plan.excited))

    def marching(self, last):
        """The plan of a march: above the mesh modes, below which the harmonics often have no solution nearby."""
        known = self.plan if last is None else last.plan
        plan = dataclasses.replace(self.plan, active=known.active, flank=known.flank)
        harmonics = plan.harmonics
        if self.adaptive:
            harmonics = max(harmonics, min(planning.first_level(0, self.modes[0]), MOST_HARMONICS[plan.method]))
        steps = max(plan.time_steps, self.resolving)
        return dataclasses.replace(plan, harmonics=harmonics, start="march", time_steps=steps)

    def search(self, plan):
        """The search for orbits with the meshes and time steps of a plan; its march serves several strategies."""
        key = plan.active, plan.flank, plan.time_steps
        if key not in self.searches:
            self.searches[key] = self.search_with(self.train, self.rpm, plan, self.effort.work)
        return self.searches[key]


def first_solved(case, strategies):
    """The Result of the first attempt that is solved, else of the last one, whose path has them all; None if no
    strategy yields an attempt.

    However overdue, one attempt is made.
    """
    last = None
    for strategy in strategies:
        if last is not None and case.overdue:
            break
        for attempt in strategy(case, last):
            last = refine(case, attempt, last)
            # Solved, or not to be solved from anywhere: a resonance without damping, torques that do not balance.
            if not last.status.another_start_may_help:
                return last
            if case.overdue:
                break
    if last is None:
        return None
    response = dataclasses.replace(last.response, path=tuple(case.path))  # with what led to no further attempt
    return dataclasses.replace(last, response=response)


def refine(case, attempt, last=None):
    """Newton's method with more and more harmonics until the tolerance is met.

    Where a mesh leaves the flank that the plan held it on, the attempt begins again with all meshes unknown.
    """
    plan, given, harmonics = attempt.plan, attempt.given, 0
    error = np.nan if last is None else last.periodicity_error
    if attempt.event is not None:
        case.path.append(attempt.event)
    while True:
        plan, marches = _resolved(case, plan), plan.marches and given is None
        begin = first_start(plan, marches=marches, given=given)
        response, outcome = solve_once(case.train, case.rpm, case.problem, plan, begin)
        error = float(outcome.periodicity_error) if marches else error
        case.path += response.path
        status = Status(int(response.status))
        higher = case.next_level(plan.harmonics) if case.adaptive else None
        if status == Status.PLAN_VIOLATED and any(plan.flank):
            given, plan = None, planning.all_active(case.train, plan, case.request)
        elif status == Status.TOLERANCE_NOT_MET and higher:
            # The motion with too few harmonics is the start with more: the low ones change little.
            given, harmonics, plan = outcome.deflection, higher, dataclasses.replace(plan, harmonics=higher)
        else:
            response = dataclasses.replace(response, path=tuple(case.path))
            case.solved = not status.another_start_may_help
            return Result(response, plan, error, harmonics)


def compile_ahead(case):
    """Begin to make the program that :func:`refine` runs first from deflections: the Future, None where it is there."""
    plan = _resolved(case, case.plan)
    begin = first_start(plan, given=np.zeros((len(plan.active_meshes.mask), 1), dtype=complex))
    return solve_problem.compile_ahead(case.problem, plan.active_meshes, begin, plan.limit, plan.sizes)


def _resolved(case, plan):
    """The plan with the time steps and the share of the tolerance that its harmonics want."""
    if not plan.active:
        return plan
    steps = max(time_steps_of(plan.harmonics), case.resolving if plan.marches else 0, plan.time_steps)
    share = planning.tolerance_share(plan.harmonics, case.modes[1])
    return dataclasses.replace(plan, tolerance_share=share, time_steps=steps)


def contact(case, last) -> Iterator[Attempt]:
    """From teeth in contact, where the linear motion separates none."""
    if not case.plan.marches:
        yield from from_contact(case, last)


def from_contact(case, last) -> Iterator[Attempt]:
    """From teeth in contact, even where the linear motion separates some."""
    yield Attempt(dataclasses.replace(case.plan, start="linear"))


def from_response(response):
    """The strategy that starts from a motion at hand."""

    def strategy(case, last):
        # What the linear motion holds on a flank, a motion at hand may separate: it is known at all meshes.
        plan = planning.all_active(case.train, case.plan, case.request)
        if case.adaptive and int(response.status) == Status.TOLERANCE_NOT_MET:
            above = case.next_level(response.harmonics) or MOST_HARMONICS[plan.method]
            plan = dataclasses.replace(plan, harmonics=max(plan.harmonics, above))
        yield Attempt(plan, np.asarray(active_deflections(plan, response.deflections)))

    return strategy


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


STRATEGIES = (contact, short_march, long_march, shooting)
"""Of a solve, the cheap ones first: the first attempt that is solved is the answer. Where the start of one of them has
failed already, or is not wanted, those after it are tried: the order counts."""

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
