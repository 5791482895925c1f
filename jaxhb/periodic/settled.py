"""Harmonic balance of a motion on which a march settled: of one cycle, or of several as one long cycle."""

import dataclasses

import numpy as np

from ..harmonic import fourier
from ..response.events import March
from ..response.status import Status
from . import ladder, planning
from .planned import of_unknown_meshes
from .request import MOST
from .returns import PERIODS

MARGIN = 0.05
"""Share of the backlash beyond the knee that a mesh keeps which is taken to stay on its flank (verified)."""

SAME = 0.05
"""Difference of deflections, relative to the largest and the gap, up to which a solution is the motion marched."""

LEVELS_TRIED = 3
"""Numbers of harmonics, one higher than the other, from which Newton's method is started: with too few there may
be no solution near the motion."""

REPEATS = 1e-4
"""Share of the sum of all amplitudes below which those of longer periods are none."""

LOSS_SHARES = (1.0,), (0.5, 1.0), (0.25, 0.5, 0.75, 1.0)
"""Shares of the loss factors stepped through, from a solution with viscous damping, until all steps succeed."""


def solve_settled(train, march, trace, period, request, *, steps, meshes, hz=None, levels=LEVELS_TRIED):
    """The Response of a motion with a period of some cycles, from one marched period.

    Parameters
    ----------
    train : DriveTrain, of one cycle, with its loss factors
    march : March
    trace : array ``(2G, period x steps)``, (l, l') of the backlash meshes
    period : int, cycles
    request : Request
    steps : int, per cycle
    meshes : Nonlinear, the backlash meshes
    hz : float or None, where loss factors were turned into viscous damping
    levels : int, numbers of harmonics that are tried at most

    Returns
    -------
    Response or None
        None where no harmonics close to the motion solve the equations.
    note : str, what is to be known about it; "" for nothing
    """
    if period > 1:
        train = train.repeated(period)
        request = dataclasses.replace(request, harmonics=request.harmonics and period * request.harmonics)
    viscous = train if hz is None else train.with_viscous_damping(hz=hz)
    event = March(march.cycles, steps, max(march.returns.errors(period)[0], 1e-300))
    found, plan = _solve(viscous, march.rpm, request, trace, meshes, event, period, levels)
    if found is None or not same_motion(found, trace, meshes, viscous):
        return None, ""
    if hz is None:
        return found, ""
    lossy = _step_up(train, found, plan, request, hz)
    if lossy is None:
        return found, f"loss factors are viscous damping at {hz:.4g} Hz: the equations with them were not solved"
    return lossy, ""


def _solve(train, rpm, request, trace, meshes, event, period, levels):
    """Response and plan from the deflections of a period, or None and None."""
    deflection = np.split(trace, 2)[0]
    plan = _plan(train, rpm, request, deflection, meshes, period)
    own = np.flatnonzero(np.array(train.topology.mesh_backlash, dtype=bool))
    reach = (deflection.shape[1] - 1) // 2
    given = np.zeros((len(train.topology.mesh_names), reach + 1), dtype=complex)
    given[own] = fourier.analyze(deflection, reach)
    given = given[plan.choice.chosen] * plan.choice.active[:, None]
    case = ladder.Case(train, rpm, request, plan)
    for _ in range(levels):
        result = ladder.refine(case, ladder.Attempt(plan, given, event))
        higher = case.next_level(plan.harmonics)
        if result.status <= Status.TOLERANCE_NOT_MET:
            return result.response, result.plan
        if request.harmonics or not higher:
            break
        plan, event = dataclasses.replace(plan, harmonics=higher), None
    return None, None


def _plan(train, rpm, request, deflection, meshes, period):
    """The plan whose unknowns are the meshes that come near their gap."""
    law = meshes.law
    side = np.where(deflection.mean(axis=1) < 0, -1, 1)
    least = (side[:, None] * deflection).min(axis=1)
    stays = least > law.knee + MARGIN * law.backlash
    flank = np.zeros(len(train.topology.mesh_names), dtype=int)
    own = np.flatnonzero(np.array(train.topology.mesh_backlash, dtype=bool))
    flank[own] = np.where(stays, side, 0)
    contact = planning.contact_plan(train, request)
    modes = planning.mesh_mode_harmonics(train, train.topology.cycle_frequency(rpm))
    if request.many and not stays.all():
        stays[:] = flank[:] = 0  # one program whatever meshes leave contact
    active = tuple(int(i) for i in own[~stays])
    apart = (np.abs(deflection) < law.gap[:, None]).any()
    wanted = planning.first_level(contact.excited, modes[0] if apart else 0.0) if active else contact.harmonics
    wanted = planning.shared_level(wanted) if request.many and active else wanted
    # With fewer harmonics a cycle than one cycle has, a motion of one cycle is solved as a subharmonic one.
    wanted = max(wanted, planning.level_at_least(period * planning.LEVELS[0]))
    return dataclasses.replace(
        contact,
        harmonics=request.harmonics or min(wanted, MOST[request.method]),
        active=active,
        flank=tuple(flank.tolist()),
        start="march" if active and flank.any() else "linear",  # beside a flank that does not hold there is no start
        excited=contact.excited // period * PERIODS[-1] if request.many else contact.excited,
    )


def same_motion(response, trace, meshes, train, most=SAME):
    """Whether a response is the motion of a marched period ``(2G, steps)``."""
    own = np.flatnonzero(np.array(train.topology.mesh_backlash, dtype=bool))
    deflection = np.split(trace, 2)[0]
    found = response.deflection_samples(deflection.shape[1])[own]
    gap = (1 - meshes.law.epsilon) * meshes.law.backlash
    size = np.abs(deflection).max(axis=1) + gap
    return bool((np.abs(found - deflection).max(axis=1) <= most * size).all())


def _step_up(train, response, plan, request, hz):
    """The Response with all loss factors from one with viscous damping, or None."""
    for shares in LOSS_SHARES:
        found = response
        for share in shares:
            partly = partly_lossy(train, hz, share)
            given = np.asarray(of_unknown_meshes(plan, found))
            result = ladder.refine(ladder.Case(partly, float(response.rpm), request, plan), ladder.Attempt(plan, given))
            if result.status > Status.TOLERANCE_NOT_MET:
                break
            found, plan = result.response, result.plan
        else:
            return dataclasses.replace(found, path=response.path + found.path)
    return None


def partly_lossy(train, hz, share):
    """The train with a share of its loss factors, and the rest as viscous damping at ``hz``."""

    def shared(table, viscous):
        damping = share * table.damping + (1 - share) * viscous.damping
        return dataclasses.replace(table, damping=damping, loss_factor=share * table.loss_factor)

    viscous = train.with_viscous_damping(hz=hz)
    return dataclasses.replace(
        train, shafts=shared(train.shafts, viscous.shafts), dampers=shared(train.dampers, viscous.dampers)
    )


def shortest_period(response, period):
    """The smallest divisor of a number of cycles after which the motion over so many cycles repeats."""
    deflections = np.abs(np.asarray(response.deflections))
    for divisor in range(1, period):
        if period % divisor == 0:
            others = np.arange(deflections.shape[-1]) % (period // divisor) != 0
            if deflections[:, others].sum() <= REPEATS * deflections[:, 1:].sum():
                return divisor
    return period
