"""The ladder: attempts at one case, rung after rung, until the equations are solved.

A :class:`Case` is a train at one speed and what its attempts share; :func:`climb` makes the attempts of rungs
(:mod:`jaxhb.periodic.rungs`) one after another, :func:`refine` takes one of them to the tolerance.
"""

import dataclasses
import math
import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..linear.mesh_modes import mesh_mode_harmonics
from ..response.response import Response
from ..response.status import Status
from . import homotopy, orbits, planning
from .homotopy import HomotopyOptions
from .plan import Plan
from .planned import first_start, solve_once
from .problem import problem_at
from .program import solve_problem
from .request import MOST_HARMONICS, Request
from .time_steps import time_steps_for, time_steps_of


@dataclass(frozen=True)
class Effort:
    """What the rungs above a short march may cost: by default what a solve takes unasked, about a second for 27 disks.

    Parameters
    ----------
    settled : periodicity error of a march from which shooting with its steps is useless: what Newton's method then
        lacks are shorter steps or more harmonics
    closer : a long march is a start where its periodicity error is so many times smaller than that of the short one
    finer : times the steps of the march, at most, with which orbits are searched, as coarse steps bend them. With 1 all
        searches keep the steps of the march
    finest_shots : with the finest steps, that ``work`` has to pay for: of larger trains fewer closed none. Counts where
        ``finer`` is above 2
    work : of the shots of a search, in units of :func:`jaxhb.periodic.orbits.work_of_cycle`
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
    """One train at one speed, asked for once: its numbers, and what several rungs share.

    Parameters
    ----------
    train, rpm, request : what is asked
    plan : Plan, from the linear motion; rungs change copies of it
    effort : what rungs may cost
    search_with : class of the searches for orbits
    path : events so far; rungs and :func:`refine` add theirs
    solved : whether no further attempt is wanted, as the last one was solved, or none can be; set by :func:`refine` and
        read by rungs that would go on with the same orbit
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
        """The search for orbits with the meshes and time steps of a plan; its march serves several rungs."""
        key = plan.active, plan.flank, plan.time_steps
        if key not in self.searches:
            self.searches[key] = self.search_with(self.train, self.rpm, plan, self.effort.work)
        return self.searches[key]


def climb(case, rungs):
    """The Result of the first attempt that is solved, else of the last one, whose path has them all; None if no rung
    yields an attempt.

    However overdue, one attempt is made.
    """
    last = None
    for rung in rungs:
        if last is not None and case.overdue:
            break
        for attempt in rung(case, last):
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
