"""Start strategies: ways to a start of Newton's method, tried one after another until
the equations are solved.

A start strategy is a function ``strategy(case)`` that yields attempts ``(plan,
initial_guess, event)``: deflections ``(G, n+1)`` from which Newton's method is to start
under a plan, None for the start that the plan has, and the event that led to them. The
next attempt is taken where Newton's method did not solve the last. The cheap strategies
come first: from teeth in contact Newton's method succeeds where no tooth separates,
from sweeps where the motion becomes periodic within a few cycles, and from the motion
that a solve by sweeps alone finds, whatever harmonics and integrals the request has.
Shooting finds more than all of them, and takes longest.
"""

import dataclasses
import math
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import cached_property

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
    solve_problem,
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


@dataclass
class Case:
    """One train at one speed and one request: the parts that its attempts share, and
    the outcome of the last attempt.
    """

    train: DriveTrain
    rpm: float
    request: Request
    plan: Plan  # from the linear motion; strategies change copies of it
    deadline: float = math.inf  # on the monotonic clock, when no further attempt begins
    # Events so far; strategies and ``refine`` add theirs
    path: list = field(default_factory=list)
    response: Response | None = None  # of the last attempt
    reached: Plan | None = None  # its plan in the end
    solved: bool = False  # or not to be solved: no further attempt is needed
    # By the last of the sweeps; inf where there was none, or it was not finite
    sweep_change: float = math.inf
    harmonics: int = 0  # the fewest that the tolerance needs, as far as attempts show

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
    def settled(self) -> bool:
        """Whether sweeps settled: Newton's method then lacks shorter steps or more
        harmonics.
        """
        return self.sweep_change <= START_SETTLED

    @property
    def status(self) -> Status:
        """The Status of the last attempt."""
        assert self.response is not None, "no attempt has been made"
        return Status(int(self.response.status))

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

    @property
    def resolving(self) -> int:
        """Time steps a cycle that resolve the mesh modes and the excitation."""
        return time_steps_for(max(self.modes[0], 2 * self.plan.excited))

    def march_plan(self) -> Plan:
        """The plan of a march: above the mesh modes, below which the harmonics often
        have no solution nearby.
        """
        latest = self.reached or self.plan
        plan = self.plan
        harmonics = plan.harmonics
        steps = max(plan.time_steps, self.resolving)
        if self.request.harmonics is None:
            level = planning.first_level(0, self.modes[0])
            harmonics = max(harmonics, min(level, MOST_HARMONICS[plan.method]))
        return dataclasses.replace(
            plan,
            active=latest.active,
            flank=latest.flank,
            harmonics=harmonics,
            start="march",
            time_steps=steps,
        )


Attempt = tuple[Plan, np.ndarray | None, Shooting | None]
Strategy = Callable[[Case], Iterator[Attempt]]


def first_solved(case: Case, strategies: Iterable[Strategy]) -> Case:
    """Make the attempts of strategies until one is solved; return the case after it,
    else after the last attempt, with all of them in its path.

    One attempt is made even after the deadline, if a strategy yields any.
    """
    for strategy in strategies:
        if case.response is not None and time.monotonic() > case.deadline:
            break
        for attempt in strategy(case):
            refine(case, *attempt)
            # Solved, or not to be solved from anywhere: a resonance without damping,
            # torques that do not balance.
            if case.solved:
                return case
            if time.monotonic() > case.deadline:
                break
    # With the events that led to no further attempt.
    if case.response is not None:
        case.response = dataclasses.replace(case.response, path=tuple(case.path))
    return case


def refine(
    case: Case,
    plan: Plan,
    initial_guess: Array | None = None,
    event: March | Shooting | None = None,
) -> None:
    """Make an attempt: Newton's method with more and more harmonics until the tolerance
    is met.

    Where a mesh leaves the flank that the plan held it on, Newton's method begins again
    with all meshes unknown. initial_guess : deflections ``(G, n+1)`` m, None for the
    start that the plan has; event : added to the path.
    """
    harmonics = 0
    if event is not None:
        case.path.append(event)
    while True:
        marches = plan.marches and initial_guess is None
        plan = case.resolved(plan)
        begin = first_start(plan, marches=marches, given=initial_guess)
        response, outcome = solve_once(case.train, case.rpm, case.problem, plan, begin)
        if marches:
            error = float(outcome.periodicity_error)
            case.sweep_change = error if math.isfinite(error) else math.inf
        case.path += response.path
        status = Status(int(response.status))
        higher = (
            case.next_level(plan.harmonics) if case.request.harmonics is None else None
        )
        if status == Status.PLAN_VIOLATED and any(plan.flank):
            initial_guess = None
            plan = planning.all_active(case.train, plan, case.request)
        elif status == Status.TOLERANCE_NOT_MET and higher:
            # The motion with too few harmonics is the start with more: the low ones
            # change little.
            initial_guess = outcome.deflection
            harmonics = higher
            plan = dataclasses.replace(plan, harmonics=higher)
        else:
            case.response = dataclasses.replace(response, path=tuple(case.path))
            case.reached = plan
            case.harmonics = harmonics
            case.solved = not status.another_start_may_help
            return


def sweep(case: Case) -> None:
    """Make the attempt by sweeps, where teeth part and they serve."""
    swept = (
        sweeping.swept_train(case.train, case.plan, case.request)
        if case.plan.marches
        else None
    )
    if swept is None:
        return
    case.response = swept.solve(float(case.rpm))
    case.path += case.response.path
    plan = dataclasses.replace(swept.plan, harmonics=case.response.harmonics)
    case.reached = case.resolved(plan)
    case.solved = not case.status.another_start_may_help


def compile_ahead(case: Case) -> Future | None:
    """Begin to make the program that :func:`refine` runs first from deflections; return
    the Future, None where the program is there.
    """
    plan = case.resolved(case.plan)
    nothing = np.zeros((len(plan.active_meshes.mask), 1), dtype=complex)
    begin = first_start(plan, given=nothing)
    return solve_problem.compile_ahead(
        case.problem, plan.active_meshes, begin, plan.goals, plan.shape
    )


def contact(case: Case) -> Iterator[Attempt]:
    """Start from teeth in contact, where the linear motion separates none."""
    if not case.plan.marches:
        yield from from_contact(case)


def from_contact(case: Case) -> Iterator[Attempt]:
    """Start from teeth in contact, even where the linear motion separates some."""
    yield dataclasses.replace(case.plan, start="linear"), None, None


def from_response(response: Response) -> Strategy:
    """The strategy that starts from a motion at hand."""

    def strategy(case: Case) -> Iterator[Attempt]:
        # A mesh that the linear motion holds on a flank may separate in a motion at
        # hand, which has the deflections of all meshes.
        plan = planning.all_active(case.train, case.plan, case.request)
        if (
            case.request.harmonics is None
            and int(response.status) == Status.TOLERANCE_NOT_MET
        ):
            above = case.next_level(response.harmonics) or MOST_HARMONICS[plan.method]
            plan = dataclasses.replace(plan, harmonics=max(plan.harmonics, above))
        initial_guess = np.asarray(active_deflections(plan, response.deflections))
        yield plan, initial_guess, None

    return strategy


def from_sweeps(case: Case) -> Iterator[Attempt]:
    """Start from sweeps of the cycle, as time integration goes on."""
    plan = case.march_plan()
    yield (
        dataclasses.replace(plan, harmonics=max(plan.harmonics, case.harmonics)),
        None,
        None,
    )


def from_swept_motion(case: Case) -> Iterator[Attempt]:
    """Start from the motion that a solve by sweeps finds, with as many harmonics as it
    needs and a law that is sampled.
    """
    free = dataclasses.replace(
        case.request, harmonics=None, method="reduced", integrals="sampled"
    )
    swept = sweeping.SweptTrain.of(case.train, case.plan, free)
    if swept is not None:
        response = swept.solve(float(case.rpm))
        case.path += response.path
        if response.solved:
            yield from from_response(response)(case)


def shooting(case: Case, work: float = shots.WORK) -> Iterator[Attempt]:
    """Start from closed orbits (:mod:`jaxhb.solutions.shots`), of several numbers of
    time steps by turns.
    """
    plan = case.march_plan()
    plans = {
        steps: dataclasses.replace(plan, time_steps=steps)
        for steps in _steps(case, plan, work)
    }
    searches = {
        steps: shots.shoot(
            case.train, case.rpm, step_plan, work=work, deadline=case.deadline
        )
        for steps, step_plan in plans.items()
    }
    left = ORBITS
    while searches and left:
        for steps, orbits in list(searches.items())[:left]:
            orbit = next(orbits, None)
            if orbit is None:
                del searches[steps]
                continue
            left -= 1
            yield _from_orbit(case, plan, orbit, steps)


def brief_shooting(case: Case) -> Iterator[Attempt]:
    """Start from closed orbits, with a share of the shots of :func:`shooting`."""
    yield from shooting(case, BRIEF)


def _steps(case: Case, plan: Plan, work: float) -> list[int]:
    """Numbers of time steps a cycle with which orbits are searched, several as coarse
    steps bend orbits: that of the plan, not where sweeps settled, and twice and four
    times as many, as far as there is room for them and the work pays for a shot.
    """
    candidates = [factor * plan.time_steps for factor in (1, 2, 4)]
    finest = candidates[-1]
    shots_paid = {
        steps: work / shots.work_of_cycle(case.train, steps) for steps in candidates
    }
    affordable = [
        steps
        for steps in candidates
        if steps <= shots.CAPACITY
        and shots_paid[steps] >= (FINEST_SHOTS if steps == finest else 1)
    ]
    return [
        steps for steps in affordable if steps > plan.time_steps or not case.settled
    ]


def _from_orbit(case: Case, plan: Plan, orbit: shots.FoundOrbit, steps: int) -> Attempt:
    """The attempt from an orbit of so many time steps, with more harmonics in
    proportion where these are free: below the reach of the steps there may be no
    solution near the orbit.
    """
    harmonics = plan.harmonics
    if case.request.harmonics is None:
        harmonics = planning.level_at_least(
            min(harmonics * steps // plan.time_steps, MOST_HARMONICS[plan.method])
        )
    plan = dataclasses.replace(
        plan,
        harmonics=max(harmonics, case.harmonics),
        time_steps=min(steps, TIME_STEPS[-1]),
    )
    return (
        plan,
        orbit.coefficients,
        Shooting(orbit.tries, steps, orbit.periodicity_error),
    )


# Of a solve under a plan, the cheap ones first: the first attempt that is solved is the
# answer. Where the start of one of them has failed already, or is left out, those after
# it are tried: the order counts.
STRATEGIES = (contact, from_sweeps, from_swept_motion, brief_shooting)
BESIDE_SWEEPS = STRATEGIES[-1:]  # where a solve by sweeps found nothing
