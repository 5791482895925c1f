"""From a drive train and a speed to its periodic response.

Without a plan, the host decides: which meshes can leave contact (from the linear
motion), where Newton starts, how many harmonics the tolerance needs. With a plan
nothing is decided, and ``solve`` is valid under ``jit`` and ``vmap``.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from functools import partial
from typing import Any, cast

import numpy as np

from jaxhb._jax import Number, concrete, refuse_tracers, staged, traced
from jaxhb.balance.plan import (
    MOST_HARMONICS,
    FailedGradient,
    Plan,
    Request,
    check_harmonics,
    excited_harmonic,
    time_steps_of,
)
from jaxhb.balance.program import solve_batches, solve_planned
from jaxhb.certificate import certificate
from jaxhb.results.response import Response
from jaxhb.results.status import Status, check
from jaxhb.solutions import planning, starts
from jaxhb.train.changes import in_contact
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import listed_harmonic
from jaxhb.train.speeds import check_speed


def solve(
    train: DriveTrain,
    *,
    rpm: Number,
    plan: Plan | None = None,
    harmonics: int | None = None,
    tolerance: float | None = None,
    method: str | None = None,
    integrals: str | None = None,
    start: Response | str | None = None,
    certify: bool = False,
    seconds: float | None = None,
) -> Response:
    """Periodic response of a drive train at one speed.

    Solves A(x) = 0 (Fridman 2009, (19)-(32)) for the harmonics of the motion over one
    cycle.

    Parameters
    ----------
    train : DriveTrain
    rpm : float
        Speed of the reference rotor.
    plan : Plan, optional
        From :func:`plan`: nothing is decided by value, the call is valid under ``jit``,
        ``vmap`` and ``grad``. What the plan assumed is verified; if it does not hold
        the status is PLAN_VIOLATED.
    harmonics : int, optional
        Harmonics of the cycle, fixed; default: as many as ``tolerance`` needs, up to
        4096.
    tolerance : float, optional
        Largest truncation error of the elastic tooth force over the largest tooth
        force; default 1 %.
    method : str, optional
        "reduced" (default; unknowns at the meshes that can leave contact) or "chain"
        (all disks; a check up to 128 harmonics, no closed loops).
    integrals : str, optional
        Of the tooth law over the cycle: "sampled" (default) at 16 time samples per
        harmonic, or "exact" between the times at which teeth pass the knots of their
        law, which only "reduced" has. Sampling leaves the solution an error of the
        order of 1e-6; under a plan and where it is differentiated the law is averaged
        between the samples, which leaves a gradient an error of 1e-5 to 1e-4, and
        second derivatives some percent: those need "exact".
    start : Response, "linear" or "march", optional
        Where Newton starts: another response, on whose branch the solution then usually
        lies, the motion with all teeth in contact ("linear"), or what sweeps of the
        cycle lead to from there ("march"). By default teeth that part are solved by
        sweeps (docs/theory/harmonic_balance.md), where these lead nowhere by Newton's
        method on them, and at last by shooting. Several motions may exist at one speed:
        :func:`jaxhb.solve_all` searches for them.
    certify : bool, optional
        Add a computed bound, ``response.certificate`` (:func:`jaxhb.certify`);
        harmonics that are not fixed are raised until it holds, as far as they go. Not
        beside a plan.
    seconds : float, optional
        After which no further attempt begins; one is made in any case. Not beside a
        plan.

    Returns
    -------
    Response
        ``status``, ``residual``, ``truncation_error`` and ``path`` say how it went;
        :func:`check` raises if it failed.

    Raises
    ------
    SceneError
        Speed not greater than 0 or above 1e6 rpm, harmonics that cannot work, or a plan
        made for another train.
    ValueError
        An argument beside a plan that belongs to the plan; no ``start`` beside a plan
        whose ``start`` is "response".

    Notes
    -----
    The response is differentiable with respect to every number of the train and to the
    speed, forwards and backwards, at the cost of about one linear solve
    (:mod:`jaxhb.balance.derivative`); without a plan outside ``jit`` and ``vmap`` only.
    Under a transformation a response whose status is above TOLERANCE_NOT_MET is nan in
    every number but its inputs, and has zero derivatives backwards, so that the other
    responses of a batch keep theirs, or nan if the plan says so.

    Examples
    --------
    >>> import jaxhb
    >>> r = jaxhb.solve(jaxhb.load_scene("gear_train_30"), rpm=600.0)
    >>> r.converged.item(), round(float(r.load_kW), 1)
    (True, 48.9)
    """
    if not (
        start is None or isinstance(start, Response) or start in ("linear", "march")
    ):
        raise ValueError(f"start is {start!r}: give 'linear', 'march' or a response")
    if plan is not None:
        if not (
            harmonics is None
            and tolerance is None
            and method is None
            and integrals is None
        ):
            raise ValueError(
                "harmonics, tolerance, method and integrals belong to the plan: give"
                " them to jaxhb.plan"
            )
        if seconds is not None:
            raise ValueError("a plan makes one attempt: leave out seconds")
        if certify:
            raise ValueError(
                "certify depends on values, which a plan rules out: pass the response"
                " to jaxhb.certify"
            )
        return solve_planned(train, rpm, plan, start)
    if certify and traced(train, rpm):
        raise ValueError(
            "a computed bound has no derivative: leave out certify where you"
            " differentiate solve"
        )
    concrete_train, concrete_rpm = concrete(train, rpm)
    if traced(concrete_train, concrete_rpm) or staged():
        raise TypeError(
            "jit or vmap traces solve: pass plan=jaxhb.plan(train, rpm=...), made"
            " outside"
        )
    request = Request.of(train, harmonics, tolerance, method, integrals)
    attempts = _decide(concrete_train, concrete_rpm, request, start, seconds)
    response = attempts.response
    # Traced by differentiation alone: solved already, the program only adds the
    # derivative.
    if traced(train, rpm):
        plan = _exact(attempts.reached.plan)
        differentiable = solve_planned(train, rpm, plan, response)
        return dataclasses.replace(differentiable, path=response.path)
    if certify:
        return _certified(response, harmonics, method, integrals)
    return response


def _certified(
    response: Response, fixed: int | None, method: str | None, integrals: str | None
) -> Response:
    """The response with its certificate; with more harmonics where the bound needs them
    and they are not ``fixed``.
    """
    while response.solved:
        bound = certificate.certify(response)
        response = dataclasses.replace(response, certificate=bound)
        more = (
            None
            if fixed
            else planning.next_level(response.harmonics, method or "reduced")
        )
        if bound.holds or not more:
            break
        assert response.train is not None, "solve gives its train"
        finer = solve(
            response.train,
            rpm=float(response.rpm),
            harmonics=more,
            method=method,
            integrals=integrals,
            start=response,
        )
        if not finer.solved:
            break
        response = finer
    return response


def plan(
    train: DriveTrain,
    *,
    rpm: float | Sequence[float] | np.ndarray,
    harmonics: int | None = None,
    tolerance: float = 0.01,
    method: str = "reduced",
    integrals: str = "sampled",
    active: str | None = None,
    failed_gradient: str = "zero",
) -> Plan:
    """Decide how to solve a train at a speed or over a range, by solving it: harmonics,
    active meshes, start.

    Parameters
    ----------
    train, harmonics, tolerance, method, integrals
        As in :func:`solve`.
    rpm : float or sequence of float
        A speed, or several: one plan then serves them all, and those between.
    active : "all", optional
        Makes the motion at every mesh with backlash an unknown, also where it stays
        loaded at these speeds: designs and speeds at which it parts are then served,
        too. By default such a mesh is held on its flank, which is cheaper, and a solve
        in which it parts has status PLAN_VIOLATED.
    failed_gradient : "zero" (default) or "nan"
        Derivative, under a transformation, of a response whose status is above
        TOLERANCE_NOT_MET. With zero the other responses of a batch keep theirs; nan
        cannot be taken for a derivative.

    Returns
    -------
    Plan
        Small and hashable: :func:`solve` under it solves nearby trains and speeds
        without decisions. It holds no motion: where none of its starts leads there, its
        ``start`` is "response", and :func:`solve` asks for ``start=jaxhb.solve(train,
        rpm=rpm)`` beside it.

    Raises
    ------
    NotConverged
        If the equations could not be solved at this speed, or at none of several.
    SceneError
        For what is no speed, and as of :func:`solve`.

    Notes
    -----
    A plan of several speeds has the harmonics that the most demanding of them needs. At
    some of them no motion of one cycle may be found (:func:`jaxhb.steady_state` tells
    what the train does there): every solve says so by its status.

    Examples
    --------
    >>> import jaxhb
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> jaxhb.plan(train, rpm=1500.0).active
    ()
    """
    refuse_tracers("plan", train, rpm, instead="give jaxhb.solve its result")
    if active not in (None, "all"):
        raise ValueError(f"active is {active!r}: give 'all', or leave it out")
    if failed_gradient not in ("zero", "nan"):
        raise ValueError(
            f"failed_gradient is {failed_gradient!r}: give 'zero' or 'nan'"
        )
    check_speed(train, rpm, many=True)
    request = dataclasses.replace(
        Request.of(train, harmonics, tolerance, method, integrals), averaged=True
    )
    speeds = np.atleast_1d(np.asarray(rpm, dtype=float))
    if np.ndim(rpm) or active == "all" and train.topology.has_law.any():
        decided = _plan_of_several(train, speeds, request, active)
    else:
        decided = _plan_of_one(train, rpm, request)
    return dataclasses.replace(
        decided, failed_gradient=cast(FailedGradient, failed_gradient)
    )


def _plan_of_one(train: DriveTrain, rpm: Any, request: Request) -> Plan:
    """The plan of one speed, from whatever start led to its motion."""
    attempts = _decide(train, rpm, request, None, by_sweeps=False)
    response = attempts.response
    # Where a mesh left its flank, refine has planned again. What can still be violated
    # is the number of crossings that exact integrals have room for, at this speed:
    # every solve under the plan verifies it and says so by its status.
    if response.status > Status.PLAN_VIOLATED:
        check(response)
    plan = _exact(attempts.reached.plan)
    if plan.active and solve_planned(train, rpm, plan).status > response.status:
        return dataclasses.replace(plan, start="response")
    return plan


def _plan_of_several(
    train: DriveTrain, speeds: np.ndarray, request: Request, active: str | None
) -> Plan:
    """The plan that serves several speeds, with the harmonics that the most demanding
    of them needs.
    """
    plan = _exact(
        planning.plan_range(train, speeds, request, every_mesh=active == "all")
    )
    unsolved_speeds = speeds
    solved = False
    while True:
        responses = [
            response
            for batch in solve_batches(train, unsolved_speeds, plan)
            for response in batch
        ]
        solved = solved or any(response.solved for response in responses)
        needs_more = [
            bool(response.solved and not response.converged) for response in responses
        ]
        higher = (
            None
            if request.harmonics
            else planning.next_level(plan.harmonics, plan.method)
        )
        if not any(needs_more) or not higher:
            break
        unsolved_speeds = unsolved_speeds[needs_more]
        plan = dataclasses.replace(
            plan,
            harmonics=higher,
            time_steps=max(plan.time_steps, time_steps_of(higher)),
        )
    if not solved:
        check(responses[0])
    return plan


def _exact(plan: Plan) -> Plan:
    """The plan whose solutions have derivatives."""
    return dataclasses.replace(plan, step_tolerance=0.0, averaged=True)


def linear_response(
    train: DriveTrain, *, rpm: Number, harmonics: int | None = None
) -> Response:
    """Response with every mesh in contact all cycle, as if there were no backlash:
    tooth forces may pull.

    The gaps of meshes are closed and all else stays as it is. Where that is not linear
    (a mesh stiffness that varies, stages, stops, clearance or friction of a shaft) it
    is solved as by :func:`solve`, else in one linear solve.

    ``harmonics`` : default those of the excitation; arguments and errors otherwise as
    of :func:`solve`. Valid under ``jit``, ``vmap`` and ``grad`` where it is linear.
    """
    train = in_contact(train)
    if not train.topology.linear_in_contact:
        return solve(train, rpm=rpm, harmonics=harmonics)
    check_speed(train, rpm)
    if harmonics is not None and not traced(train):
        check_harmonics(train, harmonics, "reduced")
    # Only values tell which of the listed harmonics are excited.
    listed = min(listed_harmonic(train.topology), MOST_HARMONICS["reduced"])
    most = harmonics or (
        listed if traced(train) else excited_harmonic(train, "reduced")
    )
    plan = Plan(harmonics=most, active=(), flank=(0,) * len(train.topology.mesh_names))
    return solve_planned(train, rpm, plan)


def solve_again(
    train: DriveTrain,
    rpm: float,
    request: Request,
    plan: Plan,
    start: Response | None = None,
    *,
    marched: bool = True,
    swept: bool = False,
) -> Response | None:
    """Solve again where the first attempt under a plan has failed: from another motion,
    then by the other start strategies.

    marched : whether that attempt began with a march, where the plan has one; swept :
    whether it was a solve by sweeps.
    """
    failed: starts.Strategy = starts.contact_unseparated
    if swept:
        failed = starts.from_swept_motion
    elif plan.marches and marched:
        failed = starts.from_sweeps
    strategies = starts.costlier_than(failed)
    if start is not None:
        strategies = (partial(starts.from_response, start), *strategies)
    attempts = starts.Attempts(starts.SolveCase(train, rpm, request, plan))
    attempts.make(strategies)
    return None if attempts.reached.response is None else attempts.response


def _decide(
    train: DriveTrain,
    rpm: float,
    request: Request,
    start: Response | str | None,
    seconds: float | None = None,
    by_sweeps: bool = True,
) -> starts.Attempts:
    """The Attempts at one speed after all start strategies, or after those that
    ``start`` leaves.

    by_sweeps : whether sweeps come first, where they serve; a plan needs a start of
    Newton's method instead.
    """
    check_speed(train, rpm)
    (plan,) = planning.plan_speeds(train, np.array([float(rpm)]), request)
    strategies = starts.STRATEGIES
    if start == "linear" or start is not None and not train.topology.has_law.any():
        strategies = (starts.in_contact,)
    elif isinstance(start, Response):
        strategies = (partial(starts.from_response, start),)
    elif start == "march":
        plan = planning.all_active(train, plan, request)
        strategies = (starts.from_sweeps, *starts.costlier_than(starts.from_sweeps))
    deadline = math.inf if seconds is None else time.monotonic() + seconds
    attempts = starts.Attempts(starts.SolveCase(train, rpm, request, plan, deadline))
    if by_sweeps and start is None:
        attempts.sweep()
        if attempts.reached.response is not None:
            strategies = starts.costlier_than(starts.from_swept_motion)
    if not attempts.reached.solved:
        attempts.make(strategies)
    return attempts
