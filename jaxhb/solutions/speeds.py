"""Many speeds in one call: planned on the host, solved in compiled batches; the few
that fail are solved again from other starts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxhb._jax import Numbers, refuse_tracers
from jaxhb._threads import side_by_side
from jaxhb.balance.plan import Plan, Request, check_plan
from jaxhb.balance.program import solve_batches
from jaxhb.results.response import Response, stack
from jaxhb.results.status import Newton, Status, Sweeps
from jaxhb.solutions import sweeping
from jaxhb.solutions.planning import plan_speeds
from jaxhb.solutions.solve import solve_again
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed


def solve_speeds(
    train: DriveTrain,
    *,
    rpm: Numbers,
    plan: Plan | None = None,
    harmonics: int | None = None,
    tolerance: float | None = None,
    integrals: str | None = None,
    progress: Callable[[int], object] | None = None,
    devices: Sequence[Any] = (),
) -> Response:
    """Periodic responses at many speeds.

    The linear motion shows at which speeds teeth leave contact or separate; speeds with
    the same needs share a plan and compiled programs, side by side in threads, or in
    batches where that is faster: many speeds with teeth in contact, all speeds on
    accelerators. A speed that fails is solved again by itself, from the nearest speed
    that converged, with more harmonics or by shooting.

    Parameters
    ----------
    train : DriveTrain
    rpm : array ``(n,)``
        Speeds of the reference rotor.
    plan : Plan, optional
        From :func:`jaxhb.plan`: all speeds are solved under it, and nothing is solved
        twice.
    harmonics, tolerance, integrals : optional
        As in :func:`jaxhb.solve`; speeds that do not reach the tolerance have status
        TOLERANCE_NOT_MET.
    progress : callable, optional
        Called with the number of speeds done since the last call.
    devices : sequence of jax devices
        Across which batches are shared, as ``jax.devices()``; by default one does it
        all.

    Returns
    -------
    Response
        With a leading axis: ``sweep[17]`` is the response at speed 17, ``sweep.status``
        the status of each. Responses with fewer harmonics than others are padded with
        zeros.

    Raises
    ------
    SceneError
        A speed that is not greater than 0 or above 1e6 rpm, or harmonics below the
        excitation.

    Examples
    --------
    >>> import jaxhb, numpy
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> sweep = jaxhb.solve_speeds(train, rpm=numpy.linspace(1000, 2500, 4))
    >>> sweep.torque("cyl6", "flywheel").half_peak_to_peak.shape
    (4,)
    """
    refuse_tracers(
        "solve_speeds",
        train,
        rpm,
        instead="jax.vmap over jaxhb.solve(train, rpm=..., plan=...) instead",
    )
    check_speed(train, rpm, many=True)
    rpm = np.atleast_1d(np.asarray(rpm, dtype=float))
    if plan and not (harmonics is None and tolerance is None and integrals is None):
        raise ValueError(
            "harmonics, tolerance and integrals belong to the plan: give them to"
            " jaxhb.plan"
        )
    request = Request.of(
        train, harmonics, tolerance, "reduced", integrals, few_levels=True
    )
    if plan:
        check_plan(train, plan)
    plans = [plan] * len(rpm) if plan else plan_speeds(train, rpm, request)
    responses: list = [None] * len(rpm)
    for shared in dict.fromkeys(plans):
        indices = [i for i, speed_plan in enumerate(plans) if speed_plan == shared]
        places = iter(indices)
        alone = plan is None and shared.marches and len(devices) < 2
        swept = sweeping.swept_train(train, shared, request) if alone else None
        if swept is None:
            batches = solve_batches(train, rpm[indices], shared, tuple(devices))
        else:
            batches = (
                [response]
                for response in side_by_side(swept.solve, rpm[indices].tolist())
            )
        for batch in batches:
            for response in batch:
                responses[next(places)] = response
            if progress:
                progress(len(batch))
    if plan is None:
        for index in range(len(rpm)):
            if worth_another_try(responses[index], request):
                responses[index] = try_again(
                    train, index, responses, request, plans[index]
                )
    return stack(responses)


def worth_another_try(response: Response, request: Request) -> bool:
    """Whether more steps, more harmonics or another start may help."""
    status = Status(int(response.status))
    if status == Status.TOLERANCE_NOT_MET:
        return not request.harmonics
    # Speeds share plans, which hold meshes on a flank: each may need its own plan.
    return status == Status.PLAN_VIOLATED or status.another_start_may_help


def try_again(
    train: DriveTrain,
    index: int,
    responses: Sequence[Response],
    request: Request,
    plan: Plan,
) -> Response:
    """The best response at one of the speeds of ``responses``: from its own motion or
    the nearest that converged, then by the other start strategies.
    """
    response = responses[index]
    start: Response | None = response
    if int(response.status) != Status.TOLERANCE_NOT_MET:
        near = [other for other in responses if other.converged]
        start = min(
            near, key=lambda other: np.abs(other.rpm - response.rpm), default=None
        )
    marched = not isinstance(response.path[0], Sweeps)
    swept = not any(isinstance(event, Newton) for event in response.path)
    again = solve_again(
        train, float(response.rpm), request, plan, start, marched=marched, swept=swept
    )
    return response if again is None or again.status > response.status else again
