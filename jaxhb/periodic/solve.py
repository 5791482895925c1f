"""From a drive train and a speed to its periodic response.

Without a plan, the host decides: which meshes can leave contact (from the linear motion), where Newton starts, how many
harmonics the asked tolerance needs. With a plan nothing is decided, and ``solve`` is valid under ``jit`` and ``vmap``.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from ..harmonic import fourier
from ..linear.response import Response
from ..model.elements import SceneError
from ..model.engine import highest_harmonic
from . import harmonics as decide
from . import march
from .harmonics import Plan
from .newton import Status
from .problem import pose
from .program import solve_problem


class NotConverged(RuntimeError):
    """A periodic solution that did not converge, or not to the asked tolerance."""


def solve(train, *, rpm, plan=None, harmonics=None, tolerance=0.01, method="reduced", start=None):
    """Periodic response of a drive train at one speed.

    Solves A(x) = 0 (Fridman 2009, (19)-(32)) for the harmonics of the motion over one cycle.

    Parameters
    ----------
    train : DriveTrain
    rpm : float
        Speed of the reference rotor.
    plan : Plan, optional
        From :func:`plan`: nothing is decided by value, the call is valid under ``jit`` and ``vmap``. What the plan
        assumed is verified; if it does not hold the status is PLAN_VIOLATED.
    harmonics : int, optional
        Harmonics of the cycle, fixed; default: as many as ``tolerance`` needs, up to 1024.
    tolerance : float
        Largest truncation error of the elastic tooth force over the largest tooth force.
    method : str
        "reduced" (unknowns at the meshes that can leave contact) or "chain" (all disks, block sweep; an oracle up to
        128 harmonics, no closed loops).
    start : Response or "linear", optional
        Where Newton starts: another response, on whose branch the solution then usually lies, or the motion with all
        teeth in contact. By default that motion if it holds, else a few cycles of time integration from it. Several
        periodic motions may exist at one speed.

    Returns
    -------
    Response
        ``status``, ``residual``, ``truncation_error`` and ``path`` say how it went; :func:`check` raises if it failed.

    Raises
    ------
    SceneError
        Speed not positive, or harmonics that cannot work.

    Examples
    --------
    >>> import jaxhb
    >>> r = jaxhb.solve(jaxhb.load_scene("gear_train_30"), rpm=600.0)
    >>> r.converged.item(), round(float(r.load_kW), 1)
    (True, 48.9)
    """
    if plan is not None:
        return _solve_planned(train, rpm, plan, start)
    if _traced(train, rpm):
        raise TypeError("solve is being traced: pass plan=jaxhb.plan(train, rpm=...), made outside")
    return _solve_deciding(train, rpm, harmonics, tolerance, method, start)[0]


def plan(train, *, rpm, harmonics=None, tolerance=0.01, method="reduced"):
    """Decide how to solve a train at a speed: harmonics, active meshes, start; verified by solving once.

    Parameters
    ----------
    train, rpm, harmonics, tolerance, method
        As in :func:`solve`.

    Returns
    -------
    Plan
        Small and hashable. Passing it to :func:`solve` solves nearby trains and speeds without decisions.

    Examples
    --------
    >>> import jaxhb
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> jaxhb.plan(train, rpm=1500.0).active
    ()
    """
    if _traced(train, rpm):
        raise TypeError("plan decides by value and cannot be traced: call it outside and pass its result to solve")
    return _solve_deciding(train, rpm, harmonics, tolerance, method, None)[1]


def check(response):
    """Raise :class:`NotConverged` with a sentence per speed that did not converge; return the response otherwise."""
    status = np.atleast_1d(np.asarray(response.status))
    if not status.any():
        return response
    rows = zip(
        np.atleast_1d(response.rpm),
        status,
        np.atleast_1d(response.residual),
        np.atleast_1d(response.truncation_error),
        strict=True,
    )
    name = response.topology.name or "scene"
    raise NotConverged(
        "\n".join(
            f"{name} at {rpm:g} rpm: {Status(int(s)).name}, residual {r:.1e}, truncation error {100 * e:.2g} %: "
            f"{Status(int(s)).sentence}."
            for rpm, s, r, e in rows
            if s
        )
    )


def linear_response(train, *, rpm, harmonics=None):
    """Response with every mesh in contact all cycle, as if there were no backlash.

    Parameters
    ----------
    train : DriveTrain
    rpm : float
    harmonics : int, optional
        Default: those of the excitation.

    Returns
    -------
    Response
        Tooth forces are linear and may pull.
    """
    most = harmonics or highest_harmonic(train)
    plan = Plan(harmonics=most, active=(), flank=(0,) * len(train.topology.mesh_names))
    return solve(decide.without_backlash(train), rpm=rpm, plan=plan)


def _traced(train, rpm):
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves((train, rpm)))


def _solve_planned(train, rpm, plan, start):
    problem = pose(train, rpm, plan.harmonics, plan.excited)
    choice = plan.choice
    sizes = plan.sizes
    given = jnp.zeros((len(choice.active), plan.harmonics + 1), dtype=complex)
    if start is not None and len(choice.active):
        given, sizes = _given(start, choice, plan.harmonics, sizes)
    outcome = solve_problem(problem, choice, given, jnp.asarray(plan.tolerance), sizes)
    return respond(train, rpm, problem, outcome, plan)


def _given(start, choice, harmonics, sizes):
    if isinstance(start, str):
        if start not in ("linear", "march"):
            raise ValueError(f"start is {start!r}: give 'linear', 'march' or a response")
        return jnp.zeros((len(choice.active), harmonics + 1), dtype=complex), dataclasses.replace(sizes, origin=start)
    deflection = fourier.resize(jnp.asarray(start.deflections), harmonics)[choice.chosen]
    return deflection * choice.active[:, None], dataclasses.replace(sizes, origin="given")


def respond(train, rpm, problem, outcome, plan):
    """Assemble the :class:`Response` of an outcome."""
    found = outcome.fields
    return Response(
        train=train,
        rpm=jnp.asarray(rpm, dtype=float) if _traced(train, rpm) else np.asarray(rpm, dtype=float),
        angles=found.angles,
        torques=found.torques,
        elastic_torques=found.elastic_torques,
        deflections=found.deflections,
        forces=found.forces,
        elastic_forces=found.elastic_forces,
        load_torque=problem.load_torque,
        load_power=problem.load_power,
        status=outcome.status,
        residual=outcome.residual,
        truncation_error=outcome.truncation_error,
        steps=outcome.steps,
        path=(str(plan),),
        resolution=plan.sizes.samples * max(1, -(-4096 // plan.sizes.samples)),
    )


def _solve_deciding(train, rpm, harmonics, tolerance, method, start):
    """The host's decisions for one speed: (response, plan)."""
    check_speed(train, rpm)
    decide.check_method(train, method)
    if harmonics is not None:
        decide.check_harmonics(train, harmonics, method)
    excited = highest_harmonic(train)
    contact = _solve_in_contact(train, rpm, excited)
    flank, active, separates = decide.contact_demand(train, contact)
    base = Plan(
        harmonics=harmonics or max(excited, decide.LEVELS[0]),
        active=active,
        flank=flank,
        method=method,
        tolerance=tolerance,
        excited=excited,
    )
    if isinstance(start, Response) and any(train.topology.mesh_backlash):
        active, flank = _all_backlash(train), (0,) * len(flank)
        base = dataclasses.replace(base, active=active, flank=flank)
    if not active:
        response = _host(_solve_planned(train, rpm, base, None))
        if int(response.status) != Status.PLAN_VIOLATED:
            return response, base
        base = dataclasses.replace(base, active=_all_backlash(train), flank=(0,) * len(flank))
    modes = decide.mesh_mode_harmonic(train, decide.cycle_frequency(train, rpm))
    if harmonics is None:
        first = decide.first_level(excited, modes if separates else 0.0)
        base = dataclasses.replace(base, harmonics=min(first, decide.MOST[method]))
    return _climb(train, rpm, base, modes, harmonics is None, start)


def _solve_in_contact(train, rpm, excited):
    """Elastic tooth forces ``(M, samples)`` with all meshes in contact; (0, 1) without meshes."""
    if not any(train.topology.mesh_backlash):
        return np.zeros((len(train.topology.mesh_names), 1))
    response = _host(linear_response(train, rpm=rpm, harmonics=excited))
    return np.fft.irfft(response.elastic_forces, n=16 * response.elastic_forces.shape[-1], norm="forward")


def _all_backlash(train):
    return tuple(i for i, gap in enumerate(train.topology.mesh_backlash) if gap)


def _host(response):
    """The response with numpy arrays."""
    arrays = {
        f.name: np.asarray(getattr(response, f.name))
        for f in dataclasses.fields(response)
        if f.name not in ("train", "path", "resolution")
    }
    return dataclasses.replace(response, **arrays)


def check_speed(train, rpm):
    """Refuse a speed that is not a positive number."""
    values = np.atleast_1d(np.asarray(rpm, dtype=float))
    for value in values:
        if not (np.isfinite(value) and value > 0):
            name = train.topology.name or "scene"
            raise SceneError(f"{name}: the speed is {value:g} rpm, must be greater than 0 rpm: a running engine.")


def _climb(train, rpm, base, modes, adaptive, start):
    """Solve with rising numbers of harmonics, and longer marches, until the status is good or the ladder ends."""
    problem = pose(train, rpm, base.harmonics, base.excited)
    choice = base.choice
    path, state = [], None
    base = dataclasses.replace(base, parts=march.parts_for(problem))
    if start is None and base.parts is None:
        start = "linear"
    if start is None:
        base = dataclasses.replace(base, march_steps=march.steps_for(modes))
        state, trace, closure = _march(problem, choice, base, None)
        path.append(f"march of {base.cycles} cycles (closure {float(closure):.1e})")
    longer = 4 * base.cycles
    while True:
        if start is None:
            samples = np.asarray(trace)
            given = march.start_from(jnp.asarray(samples), base.harmonics)
        else:
            given, sizes = _given(start, choice, base.harmonics, base.sizes)
            samples = None if sizes.origin == "linear" else np.asarray(fourier.synthesize(given, base.sizes.samples))
        resolved = decide.resolved_for(base.harmonics, modes)
        room = decide.room_for(samples, problem, choice, resolved)
        base = dataclasses.replace(base, room=room, resolved=resolved, start="march" if start is None else base.start)
        sizes = dataclasses.replace(base.sizes, origin="given" if samples is not None else "linear")
        problem = pose(train, rpm, base.harmonics, base.excited)
        outcome = solve_problem(problem, choice, given, jnp.asarray(base.tolerance), sizes)
        response = _host(respond(train, rpm, problem, outcome, base))
        status = Status(int(response.status))
        path.append(f"Newton with {base.harmonics} harmonics: {status.name}, {int(response.steps)} steps")
        if status == Status.TOLERANCE_NOT_MET and adaptive:
            higher = decide.next_level(base.harmonics, base.method)
            if higher is None:
                break
            base = dataclasses.replace(base, harmonics=higher)
            start = response
        elif status in (Status.MAX_STEPS, Status.STALLED, Status.NONFINITE) and state is not None and longer:
            base = dataclasses.replace(base, cycles=longer)
            state, trace, closure = _march(problem, choice, base, state)
            path.append(f"march of {longer} more cycles (closure {float(closure):.1e})")
            start, longer = None, 0
        elif status in (Status.MAX_STEPS, Status.STALLED) and adaptive and base.harmonics < decide.MOST[base.method]:
            base = dataclasses.replace(base, harmonics=decide.next_level(base.harmonics, base.method))
            start = None if state is not None else start
        else:
            break
    return dataclasses.replace(response, path=tuple(path)), base


def _march(problem, choice, base, state):
    return march.march_program(
        problem,
        choice,
        len(base.active),
        cycles=base.cycles,
        steps=base.march_steps,
        excited=base.excited,
        parts=base.parts,
        state=state,
    )
