"""Harmonic balance of a motion to which a march came: of one cycle, or of several as
one long cycle.
"""

import dataclasses

import numpy as np

from jaxhb.balance.plan import MOST_HARMONICS, Plan, Request
from jaxhb.balance.program import active_deflections, first_start, solve_once
from jaxhb.equations import fourier
from jaxhb.equations.backlash import MeshParameters
from jaxhb.linear.mesh_modes import mesh_mode_harmonics
from jaxhb.results.response import Response
from jaxhb.results.status import March
from jaxhb.solutions import planning, starts
from jaxhb.solutions.sweeping import SweptTrain
from jaxhb.steady.closure import LONGEST_PERIOD
from jaxhb.steady.marching import SpeedMarch
from jaxhb.train.drivetrain import DriveTrain

# Share of the backlash beyond the knee that a mesh keeps if it is taken to stay on its
# flank (verified)
MARGIN = 0.05
# Difference of deflections, relative to the largest and the gap, up to which a solution
# is the motion marched.
SAME = 0.05
# Share of the sum of all amplitudes below which those of longer periods count as zero:
# so many times the truncation error, which is of one force and not of a sum, between
# REPEATS and WEAK; and share up to which Newton's method may have left them of a start.
TRUNCATED = 10.0
REPEATS = 1e-4
WEAK = 5e-3
DOUBTED = 0.1
# Numbers of harmonics, one higher than the other, from which Newton's method is
# started: with too few there may be no solution near the motion.
LEVELS = 3
# Share of the tolerance that sweeps may leave where the rest would look like a weak
# subharmonic
NO_SUBHARMONIC = 1e-5


def settle_marched(
    swept: SweptTrain,
    march: SpeedMarch,
    trace: np.ndarray,
    period: int,
    *,
    steps: int,
    meshes: MeshParameters,
) -> Response | None:
    """The Response of a motion with a period of some cycles, by sweeps from one marched
    period; None where they lead to no motion, or to another one.

    swept : SweptTrain with that period as its cycle; other arguments as of
    :func:`solve_marched`.
    """
    deflection = np.split(trace, 2)[0]
    deflection = fourier.analyze(deflection, (deflection.shape[1] - 1) // 2)
    response = swept.solve(march.rpm, deflection=deflection)
    if response.solved and may_repeat(response, period):
        solved_deflection = response.deflections[list(swept.plan.active)]
        exact = swept.solve(
            march.rpm,
            deflection=solved_deflection,
            settled=NO_SUBHARMONIC,
            steps=response.path[-1].time_steps,
        )
        response = exact if exact.solved else response
    if not response.solved or not same_motion(
        response, trace, meshes, swept.train, period
    ):
        return None
    event = March(march.cycles, steps, max(march.closure.errors(period)[0], 1e-300))
    return dataclasses.replace(response, path=(event, *response.path))


def solve_marched(
    train: DriveTrain,
    march: SpeedMarch,
    trace: np.ndarray,
    period: int,
    request: Request,
    *,
    steps: int,
    meshes: MeshParameters,
    levels: int = LEVELS,
) -> Response | None:
    """The Response of a motion with a period of some cycles, from one marched period;
    None where no harmonics close to the motion solve the equations.

    train : of one cycle, with its loss factors; trace : ``(2G, period x steps)``, (l,
    l') of the backlash meshes in m and m/s; meshes : their MeshParameters; levels :
    numbers of harmonics that are tried at most.
    """
    if period > 1:
        train = train.repeated(period)
        request = dataclasses.replace(
            request, harmonics=request.harmonics and period * request.harmonics
        )
    # Not 0, which in an Outcome means that nothing was marched.
    event: March | None = March(
        march.cycles, steps, max(march.closure.errors(period)[0], 1e-300)
    )
    deflection = np.split(trace, 2)[0]
    plan = _plan(train, march.rpm, request, deflection, meshes, period)
    reach = (deflection.shape[1] - 1) // 2
    coefficients = np.zeros((len(train.topology.has_law), reach + 1), dtype=complex)
    coefficients[train.topology.law_index] = fourier.analyze(deflection, reach)
    initial_guess = active_deflections(plan, coefficients)
    attempts = starts.Attempts(starts.SolveCase(train, march.rpm, request, plan))
    for _ in range(levels):
        attempts.refine(starts.Attempt(plan, initial_guess, event))
        higher = attempts.case.next_level(plan.harmonics)
        response = attempts.response
        if response.solved:
            if may_repeat(response, period):
                response = _exact(attempts)
            same = same_motion(response, trace, meshes, train, period)
            return response if same else None
        if request.harmonics or not higher:
            break
        plan = dataclasses.replace(plan, harmonics=higher)
        event = None
    return None


def _exact(attempts: starts.Attempts) -> Response:
    """The response of the last attempt solved on until its residual is exact: the rest
    that the last step of Newton's method leaves looks like a weak subharmonic, which a
    march that still decays seems to have.
    """
    case = attempts.case
    solved = attempts.response
    plan = dataclasses.replace(attempts.reached.plan, step_tolerance=0.0)
    start = first_start(plan, deflections=active_deflections(plan, solved.deflections))
    response, _ = solve_once(case.train, case.rpm, case.problem, plan, start)
    if not response.solved:
        return solved
    return dataclasses.replace(response, path=solved.path)


def _plan(
    train: DriveTrain,
    rpm: float,
    request: Request,
    deflection: np.ndarray,
    meshes: MeshParameters,
    period: int,
) -> Plan:
    """The plan whose unknowns are the meshes that come near their gap, of those with
    deflections ``(G, period x steps)`` m.
    """
    law = meshes.law
    law_index = train.topology.law_index
    side = np.where(deflection.mean(axis=1) < 0, -1, 1)
    least = (side[:, None] * deflection).min(axis=1)
    held = np.append(
        ~train.topology.mesh_varies, np.zeros(len(train.topology.springs), bool)
    )
    stays = (least > law.knee + MARGIN * law.backlash) & held[law_index]
    apart = bool((np.abs(deflection) < law.gap[:, None]).any())
    side = np.where(stays, side, 0)
    if not side.all():
        side = np.zeros_like(side)  # one program whatever meshes leave contact
    flank = np.zeros(len(train.topology.has_law), dtype=int)
    flank[law_index] = side
    contact = planning.contact_plan(train, request)
    modes = mesh_mode_harmonics(train, train.topology.cycle_frequency(rpm))
    active = tuple(int(i) for i in law_index[side == 0])
    harmonics = contact.harmonics
    if active:
        level = planning.first_level(contact.excited, modes[0] if apart else 0.0)
        harmonics = planning.level_at_least(level, planning.FEW_LEVELS)
    # With fewer harmonics a cycle than one cycle has, a motion of one cycle is solved
    # as a subharmonic one.
    harmonics = max(harmonics, planning.level_at_least(period * planning.LEVELS[0]))
    return dataclasses.replace(
        contact,
        harmonics=request.harmonics or min(harmonics, MOST_HARMONICS[request.method]),
        active=active,
        flank=tuple(flank.tolist()),
        # Read only where a flank that the plan held did not hold: the initial guess is
        # no start then.
        start="march" if active and flank.any() else "linear",
        # Room for the longest period whatever the period: equal shapes, one program.
        excited=contact.excited // period * LONGEST_PERIOD,
    )


def same_motion(
    response: Response,
    trace: np.ndarray,
    meshes: MeshParameters,
    train: DriveTrain,
    period: int = 1,
    most: float = SAME,
) -> bool:
    """Whether a response is the motion of a marched period ``(2G, steps)`` of some
    cycles, from whichever of its cycles on.
    """
    deflection = np.split(trace, 2)[0]
    steps = deflection.shape[1]
    solved = response.deflection_samples(steps)[train.topology.law_index]
    gap = (1 - meshes.law.epsilon) * meshes.law.backlash
    size = most * (np.abs(deflection).max(axis=1) + gap)
    shifted = (
        np.roll(solved, cycle * (steps // period), axis=1) for cycle in range(period)
    )
    return any(
        (np.abs(moved - deflection).max(axis=1) <= size).all() for moved in shifted
    )


def shortest_period(response: Response, period: int) -> int:
    """The smallest divisor of a number of cycles after which the motion over so many
    cycles repeats, as far as its truncation error shows: whether a weaker subharmonic
    is there, the stability of the shorter motion tells.
    """
    most = np.clip(TRUNCATED * float(response.truncation_error), REPEATS, WEAK)
    return next(
        (
            divisor
            for divisor in proper_divisors(period)
            if repetition(response, period, divisor) <= most
        ),
        period,
    )


def may_repeat(response: Response, period: int) -> bool:
    """Whether a motion over ``period`` cycles may repeat after fewer, once it is solved
    to the end.
    """
    return any(
        repetition(response, period, divisor) <= DOUBTED
        for divisor in proper_divisors(period)
    )


def proper_divisors(period: int) -> list[int]:
    """Numbers of cycles, shortest first, after which a motion over ``period`` cycles
    may repeat before its end.
    """
    return [divisor for divisor in range(1, period) if period % divisor == 0]


def repetition(response: Response, period: int, divisor: int) -> float:
    """Share of the amplitudes of a motion over ``period`` cycles that do not repeat
    after ``divisor`` of them.
    """
    deflections = np.abs(np.asarray(response.deflections))
    unrepeated = np.arange(deflections.shape[-1]) % (period // divisor) != 0
    return deflections[:, unrepeated].sum() / max(deflections[:, 1:].sum(), 1e-300)
