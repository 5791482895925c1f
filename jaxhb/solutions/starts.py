"""Start strategies: ways to a start of Newton's method, tried one after another until
the equations are solved.

A start strategy yields one :class:`Attempt` after another; the next is made where
Newton's method did not solve the last. The cheap strategies come first: from teeth in
contact Newton's method succeeds where no tooth separates, from sweeps where the motion
becomes periodic within a few cycles, and from the motion that a solve by sweeps alone
finds, whatever harmonics and integrals the request has. Shooting finds more than all of
them, and takes longest.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from jaxhb._jax import Array
from jaxhb.balance.plan import (
    MOST_HARMONICS,
    TIME_STEPS,
    Plan,
    Request,
    time_steps_for,
    time_steps_of,
)
from jaxhb.balance.problem import Problem, problem_at
from jaxhb.balance.program import (
    START_SETTLED,
    active_deflections,
    first_start,
    solve_once,
)
from jaxhb.linear.mesh_modes import mesh_mode_harmonics
from jaxhb.results.response import Response
from jaxhb.results.status import March, Shooting, Status
from jaxhb.solutions import planning, shots, sweeping
from jaxhb.train.drivetrain import DriveTrain

# Of shooting, orbits at most: some have no harmonics near them, or lie beyond a turning
# point that the steps displaced; and shots with the finest steps that the work has to
# pay for: of larger trains fewer closed none.
ORBITS = 16
FINEST_SHOTS = 4
# Work of the shots of each number of steps where one motion is asked for: some seconds.
# Of eleven random trains that shooting solved, all but one took five shots or fewer.
BRIEF = 1e7


@dataclass(frozen=True)
class SolveCase:
    """Question that attempts answer: one train at one speed, a request, the plan that
    the linear motion tells, and the time on the monotonic clock after which no further
    attempt begins.
    """

    train: DriveTrain
    rpm: float
    request: Request
    plan: Plan
    deadline: float = math.inf

    @cached_property
    def modes(self) -> np.ndarray:
        """Harmonics of the cycle at the highest mesh modes, and at those that strain
        meshes weakly.
        """
        return mesh_mode_harmonics(
            self.train, self.train.topology.cycle_frequency(float(self.rpm))
        )

    @cached_property
    def problem(self) -> Problem:
        """The equations at this speed."""
        return problem_at(self.train, self.rpm, self.plan.shape.excited)

    @property
    def resolving(self) -> int:
        """Time steps a cycle that resolve the mesh modes and the excitation."""
        return time_steps_for(max(self.modes[0], 2 * self.plan.excited))

    def next_level(self, harmonics: int) -> int | None:
        """The number of harmonics to try after ``harmonics``; None at the limit."""
        return planning.next_level(harmonics, self.plan.method, self.request.few_levels)

    def resolved(self, plan: Plan) -> Plan:
        """The plan with the time steps and the share of the tolerance that its
        harmonics need.
        """
        if not plan.active:
            return plan
        steps = max(
            time_steps_of(plan.harmonics),
            self.resolving if plan.marches else 0,
            plan.time_steps,
        )
        share = planning.tolerance_share(plan.harmonics, self.modes[1])
        return dataclasses.replace(plan, tolerance_share=share, time_steps=steps)


@dataclass(frozen=True)
class Attempt:
    """Start that Newton's method is to try: a plan; deflections ``(G, n+1)`` m, None
    for the start that the plan has; and the event that led to them.
    """

    plan: Plan
    deflection: Array | None = None
    event: March | Shooting | None = None


@dataclass(frozen=True)
class Reached:
    """State after an attempt: its plan in the end and its Response, None before the
    first; harmonics, the fewest that the tolerance needs as far as the attempt shows;
    sweep_change, by the last of the sweeps, inf where there were none or it was not
    finite.
    """

    plan: Plan
    response: Response | None = None
    harmonics: int = 0
    sweep_change: float = math.inf

    @property
    def solved(self) -> bool:
        """Whether no further attempt is needed: solved, or not to be solved from
        anywhere, as a resonance without damping, or torques that do not balance.
        """
        if self.response is None:
            return False
        return not Status(int(self.response.status)).another_start_may_help

    @property
    def settled(self) -> bool:
        """Whether sweeps settled: Newton's method then lacks shorter steps or more
        harmonics.
        """
        return self.sweep_change <= START_SETTLED


class Attempts:
    """Attempts at a case: the events so far, and what the last attempt reached."""

    def __init__(self, case: SolveCase):
        self.case = case
        self.path: list = []
        self.reached = Reached(case.plan)

    @property
    def response(self) -> Response:
        """The Response of the last attempt, with the events of all."""
        assert self.reached.response is not None, "no attempt has been made"
        return dataclasses.replace(self.reached.response, path=tuple(self.path))

    def is_late(self) -> bool:
        """Whether the deadline is over, and one attempt is made."""
        late = time.monotonic() > self.case.deadline
        return late and self.reached.response is not None

    def march_plan(self) -> Plan:
        """The plan of a march: above the mesh modes, below which the harmonics often
        have no solution nearby.
        """
        case = self.case
        plan = case.plan
        harmonics = plan.harmonics
        steps = max(plan.time_steps, case.resolving)
        if case.request.harmonics is None:
            level = planning.first_level(0, case.modes[0])
            harmonics = max(harmonics, min(level, MOST_HARMONICS[plan.method]))
        return dataclasses.replace(
            plan,
            active=self.reached.plan.active,
            flank=self.reached.plan.flank,
            harmonics=harmonics,
            start="march",
            time_steps=steps,
        )

    def make(self, strategies: Iterable[Strategy]) -> None:
        """Make the attempts of strategies until one is solved, or the deadline is over;
        the first in any case.
        """
        for strategy in strategies:
            if self.is_late():
                return
            for attempt in strategy(self):
                self.refine(attempt)
                if self.reached.solved:
                    return
                if self.is_late():
                    break

    def refine(self, attempt: Attempt) -> None:
        """Make an attempt: Newton's method with more and more harmonics until the
        tolerance is met.

        Where a mesh leaves the flank that the plan held it on, Newton's method begins
        again with all meshes unknown.
        """
        case = self.case
        plan = attempt.plan
        deflection = attempt.deflection
        sweep_change = self.reached.sweep_change
        harmonics = 0
        if attempt.event is not None:
            self.path.append(attempt.event)
        while True:
            marches = plan.marches and deflection is None
            plan = case.resolved(plan)
            start = first_start(plan, marches=marches, deflections=deflection)
            response, outcome = solve_once(
                case.train, case.rpm, case.problem, plan, start
            )
            if marches:
                error = float(outcome.periodicity_error)
                sweep_change = error if math.isfinite(error) else math.inf
            self.path += response.path
            status = Status(int(response.status))
            higher = (
                case.next_level(plan.harmonics)
                if case.request.harmonics is None
                else None
            )
            if status == Status.PLAN_VIOLATED and any(plan.flank):
                deflection = None
                plan = planning.all_active(case.train, plan, case.request)
            elif status == Status.TOLERANCE_NOT_MET and higher:
                # The motion with too few harmonics is the start with more: the low ones
                # change little.
                deflection = outcome.deflection
                harmonics = higher
                plan = dataclasses.replace(plan, harmonics=higher)
            else:
                self.reached = Reached(plan, response, harmonics, sweep_change)
                return

    def sweep(self) -> None:
        """Make the attempt by sweeps, where teeth part and they serve."""
        case = self.case
        if not case.plan.marches:
            return
        swept = sweeping.swept_train(case.train, case.plan, case.request)
        if swept is None:
            return
        response = swept.solve(float(case.rpm))
        self.path += response.path
        plan = dataclasses.replace(swept.plan, harmonics=response.harmonics)
        self.reached = Reached(case.resolved(plan), response)


Strategy = Callable[[Attempts], Iterator[Attempt]]
"""Start strategy: yields its attempts after those that were made."""


def in_contact(attempts: Attempts) -> Iterator[Attempt]:
    """Start from teeth in contact, even where the linear motion separates some."""
    yield Attempt(dataclasses.replace(attempts.case.plan, start="linear"))


def contact_unseparated(attempts: Attempts) -> Iterator[Attempt]:
    """Start from teeth in contact, where the linear motion separates none."""
    if not attempts.case.plan.marches:
        yield from in_contact(attempts)


def from_response(response: Response, attempts: Attempts) -> Iterator[Attempt]:
    """Start from a motion at hand."""
    # A mesh that the linear motion holds on a flank may separate in a motion at hand,
    # which has the deflections of all meshes.
    case = attempts.case
    plan = planning.all_active(case.train, case.plan, case.request)
    if (
        case.request.harmonics is None
        and int(response.status) == Status.TOLERANCE_NOT_MET
    ):
        above = case.next_level(response.harmonics) or MOST_HARMONICS[plan.method]
        plan = dataclasses.replace(plan, harmonics=max(plan.harmonics, above))
    yield Attempt(plan, np.asarray(active_deflections(plan, response.deflections)))


def from_sweeps(attempts: Attempts) -> Iterator[Attempt]:
    """Start from sweeps of the cycle, as time integration goes on."""
    plan = attempts.march_plan()
    harmonics = max(plan.harmonics, attempts.reached.harmonics)
    yield Attempt(dataclasses.replace(plan, harmonics=harmonics))


def from_swept_motion(attempts: Attempts) -> Iterator[Attempt]:
    """Start from the motion that a solve by sweeps finds, with as many harmonics as it
    needs and a law that is sampled.
    """
    case = attempts.case
    free = dataclasses.replace(
        case.request, harmonics=None, method="reduced", integrals="sampled"
    )
    swept = sweeping.SweptTrain.of(case.train, case.plan, free)
    if swept is not None:
        response = swept.solve(float(case.rpm))
        attempts.path += response.path
        if response.solved:
            yield from from_response(response, attempts)


def shooting(attempts: Attempts, work: float = shots.WORK) -> Iterator[Attempt]:
    """Start from closed orbits (:mod:`jaxhb.solutions.shots`), of several numbers of
    time steps by turns.
    """
    case = attempts.case
    plan = attempts.march_plan()
    searches = {
        steps: shots.shoot(
            case.train,
            case.rpm,
            dataclasses.replace(plan, time_steps=steps),
            work=work,
            deadline=case.deadline,
        )
        for steps in _steps(attempts, plan, work)
    }
    left = ORBITS
    while searches and left:
        for steps, orbits in list(searches.items())[:left]:
            orbit = next(orbits, None)
            if orbit is None:
                del searches[steps]
                continue
            left -= 1
            yield _from_orbit(attempts, plan, orbit, steps)


def _steps(attempts: Attempts, plan: Plan, work: float) -> list[int]:
    """Numbers of time steps a cycle with which orbits are searched, several as coarse
    steps bend orbits: that of the plan, not where sweeps settled, and twice and four
    times as many, as far as there is room for them and the work pays for a shot.
    """
    candidates = [factor * plan.time_steps for factor in (1, 2, 4)]
    finest = candidates[-1]
    shots_paid = {
        steps: work / shots.work_of_cycle(attempts.case.train, steps)
        for steps in candidates
    }
    affordable = [
        steps
        for steps in candidates
        if steps <= shots.CAPACITY
        and shots_paid[steps] >= (FINEST_SHOTS if steps == finest else 1)
    ]
    return [
        steps
        for steps in affordable
        if steps > plan.time_steps or not attempts.reached.settled
    ]


def _from_orbit(
    attempts: Attempts, plan: Plan, orbit: shots.FoundOrbit, steps: int
) -> Attempt:
    """The attempt from an orbit of so many time steps, with more harmonics in
    proportion where these are free: below the reach of the steps there may be no
    solution near the orbit.
    """
    harmonics = plan.harmonics
    if attempts.case.request.harmonics is None:
        harmonics = planning.level_at_least(
            min(harmonics * steps // plan.time_steps, MOST_HARMONICS[plan.method])
        )
    plan = dataclasses.replace(
        plan,
        harmonics=max(harmonics, attempts.reached.harmonics),
        time_steps=min(steps, TIME_STEPS[-1]),
    )
    event = Shooting(orbit.tries, steps, orbit.periodicity_error)
    return Attempt(plan, orbit.coefficients, event)


# Of a solve under a plan, the cheap ones first: the first attempt that is solved is the
# answer. Shooting has a share of the shots of a search for all motions.
STRATEGIES: tuple[Strategy, ...] = (
    contact_unseparated,
    from_sweeps,
    from_swept_motion,
    partial(shooting, work=BRIEF),
)


def costlier_than(strategy: Strategy) -> tuple[Strategy, ...]:
    """The strategies that are left where one has failed."""
    return STRATEGIES[STRATEGIES.index(strategy) + 1 :]
