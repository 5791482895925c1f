"""Many speeds in one call: planned on the host, solved in compiled batches; the few
that fail are solved again from other starts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from itertools import islice
from typing import Any

import numpy as np

from jaxhb._executors import in_parts
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

PART = 16  # speeds that a worker solves at a time


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
    executor: Executor | None = None,
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
    executor : concurrent.futures.Executor, optional
        Where speeds at which teeth may leave contact are solved, some at a time, as
        :class:`jaxhb.Workers`; the numbers are the same to the last bit on the same
        kind of machine.

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
        alone = plan is None and shared.marches and len(devices) < 2
        swept_request = request if alone else None
        batches: Iterator[tuple[list[int], list[Response]]]
        # Batches of speeds in contact are programs for so many, and as fast.
        if executor is not None and shared.active:
            parts = [indices[i : i + PART] for i in range(0, len(indices), PART)]
            solved_parts = in_parts(
                _solve_part,
                ((train, rpm[part], shared, swept_request) for part in parts),
                executor,
            )
            batches = ((parts[number], batch) for number, batch in solved_parts)
        else:
            batches = _in_order(
                indices,
                _batches(train, rpm[indices], shared, swept_request, tuple(devices)),
            )
        for places, batch in batches:
            for place, response in zip(places, batch, strict=True):
                responses[place] = response
            if progress:
                progress(len(batch))
    if plan is None:
        for index in range(len(rpm)):
            if worth_another_try(responses[index], request):
                responses[index] = try_again(
                    train, index, responses, request, plans[index]
                )
    return stack(responses)


def _batches(
    train: DriveTrain,
    rpm: np.ndarray,
    plan: Plan,
    request: Request | None,
    devices: tuple = (),
) -> Iterator[list[Response]]:
    """Yield Responses at the speeds ``(n,)`` under one plan, some at a time in order;
    by sweeps where these serve and a ``request`` is given, to which they answer.
    """
    swept = None if request is None else sweeping.swept_train(train, plan, request)
    if swept is None:
        yield from solve_batches(train, rpm, plan, devices)
        return
    for response in side_by_side(swept.solve, rpm.tolist()):
        yield [response]


def _solve_part(
    train: DriveTrain, rpm: np.ndarray, plan: Plan, request: Request | None
) -> list[Response]:
    """Responses at the speeds ``(n,)`` of a part, as :func:`_batches`."""
    return [
        response for batch in _batches(train, rpm, plan, request) for response in batch
    ]


def _in_order(
    indices: Sequence[int], batches: Iterable[list[Response]]
) -> Iterator[tuple[list[int], list[Response]]]:
    """Yield each of the batches with its indices."""
    rest = iter(indices)
    for batch in batches:
        yield list(islice(rest, len(batch))), batch


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
