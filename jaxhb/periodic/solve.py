"""From a drive train and a speed to its periodic response.

Without a plan, the host decides: which meshes can leave contact (from the linear motion), where Newton starts, how many
harmonics the asked tolerance needs. With a plan nothing is decided, and ``solve`` is valid under ``jit`` and ``vmap``.
"""

import dataclasses
import itertools
from functools import cache, partial

import jax.numpy as jnp
import numpy as np

from .._arrays import concrete, staged, traced
from .._program import Program
from ..harmonic import fourier
from ..linear.response import Response
from ..model.elements import SceneError
from ..model.engine import listed_harmonic
from . import derivative, homotopy, march, orbits
from . import harmonics as decide
from .harmonics import Plan
from .newton import Status
from .problem import pose
from .program import Start, solve_problem

SETTLED = 1e-5
"""Closure of a march that makes shooting useless: what Newton then lacks are shorter steps or more harmonics."""

CLOSER = 30
"""Times better than the march before it that a longer march has to close."""

FINER = 4
"""Orbits are searched with up to so many times the steps of the march, as coarse ones bend them; one that Newton's
method does not take is found again with more steps. Harmonics follow the steps."""

FEWEST = 4
"""Shots of the finest steps that orbits.WORK has to pay for: of larger trains fewer closed none."""

ORBITS = 16
"""Closed orbits that are tried: some have no harmonics near them, or lie beyond a fold that the steps displaced."""

_UNSOLVED = (Status.MAX_STEPS, Status.STALLED, Status.NONFINITE)


class NotConverged(RuntimeError):
    """A periodic solution that did not converge, or not to the asked tolerance."""


def solve(train, *, rpm, plan=None, harmonics=None, tolerance=None, method=None, integrals=None, start=None):
    """Periodic response of a drive train at one speed.

    Solves A(x) = 0 (Fridman 2009, (19)-(32)) for the harmonics of the motion over one cycle.

    Parameters
    ----------
    train : DriveTrain
    rpm : float
        Speed of the reference rotor.
    plan : Plan, optional
        From :func:`plan`: nothing is decided by value, the call is valid under ``jit``, ``vmap`` and ``grad``. What the
        plan assumed is verified; if it does not hold the status is PLAN_VIOLATED.
    harmonics : int, optional
        Harmonics of the cycle, fixed; default: as many as ``tolerance`` needs, up to 4096.
    tolerance : float, optional
        Largest truncation error of the elastic tooth force over the largest tooth force; default 1 %.
    method : str, optional
        "reduced" (default; unknowns at the meshes that can leave contact) or "chain" (all disks, block sweep; an
        oracle up to 128 harmonics, no closed loops).
    integrals : str, optional
        Of the tooth law over the cycle: "sampled" (default) at 16 instants per harmonic, or "exact" between the times
        at which teeth pass the knots of their law. Sampling leaves the solution an error of the order of 1e-6, its
        gradient 1e-4, and second derivatives more than 10 %: those need "exact", which only "reduced" has.
    start : Response, "linear" or "march", optional
        Where Newton starts: another response, on whose branch the solution then usually lies, or the motion with all
        teeth in contact ("linear"), or a few cycles of time integration from it ("march"). By default the motion in
        contact is the answer if it holds, else a march. Several periodic motions may exist at one speed.

    Returns
    -------
    Response
        ``status``, ``residual``, ``truncation_error`` and ``path`` say how it went; :func:`check` raises if it failed.

    Raises
    ------
    SceneError
        Speed not positive, harmonics that cannot work, or a plan made for another train.
    ValueError
        ``harmonics``, ``tolerance``, ``method`` or ``integrals`` beside a plan, which holds its own.

    Notes
    -----
    The response is differentiable with respect to every number of the train and to the speed, forwards and backwards,
    at the cost of about one linear solve (:mod:`jaxhb.periodic.derivative`); without a plan outside ``jit`` and
    ``vmap`` only. A response whose status is above TOLERANCE_NOT_MET has zero derivatives.

    Examples
    --------
    >>> import jaxhb
    >>> r = jaxhb.solve(jaxhb.load_scene("gear_train_30"), rpm=600.0)
    >>> r.converged.item(), round(float(r.load_kW), 1)
    (True, 48.9)
    """
    if not (start is None or isinstance(start, Response) or start in ("linear", "march")):
        raise ValueError(f"start is {start!r}: give 'linear', 'march' or a response")
    if plan is not None:
        if not (harmonics is None and tolerance is None and method is None and integrals is None):
            raise ValueError("harmonics, tolerance, method and integrals belong to the plan: give them to jaxhb.plan")
        return _solve_planned(train, rpm, plan, start)
    now = concrete(train, rpm)
    if traced(now) or staged():
        raise TypeError("solve is being traced: pass plan=jaxhb.plan(train, rpm=...), made outside")
    tolerance = 0.01 if tolerance is None else tolerance
    response, found = _solve_deciding(*now, harmonics, tolerance, method or "reduced", integrals or "sampled", start)
    if traced(train, rpm):  # by differentiation alone: solved already, the program only adds the derivative
        return dataclasses.replace(_solve_planned(train, rpm, found, response), path=response.path)
    return response


def plan(train, *, rpm, harmonics=None, tolerance=0.01, method="reduced", integrals="sampled"):
    """Decide how to solve a train at a speed: harmonics, active meshes, start; found by solving it.

    Parameters
    ----------
    train, rpm, harmonics, tolerance, method, integrals
        As in :func:`solve`.

    Returns
    -------
    Plan
        Small and hashable. Passing it to :func:`solve` solves nearby trains and speeds without decisions. It holds no
        motion: where a march does not settle and the motion was found by shooting, give that response as ``start`` too.

    Raises
    ------
    NotConverged
        If the equations could not be solved at this speed.

    Examples
    --------
    >>> import jaxhb
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> jaxhb.plan(train, rpm=1500.0).active
    ()
    """
    if traced(train, rpm) or staged():
        raise TypeError("plan decides by value and cannot be traced: call it outside and pass its result to solve")
    response, found = _solve_deciding(train, rpm, harmonics, tolerance, method, integrals, None)
    if int(response.status) > Status.PLAN_VIOLATED:
        check(response)
    return found


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
            f"{name} at {rpm:g} rpm: {Status(int(s)).name}, residual {r:.1e}, truncation error {100 * e:.3g} %: "
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
    check_speed(train, rpm)
    if harmonics is not None:
        decide.check_harmonics(train, harmonics, "reduced")
    most = harmonics or decide.excited_harmonic(train, "reduced")
    plan = Plan(harmonics=most, active=(), flank=(0,) * len(train.topology.mesh_names))
    return solve(decide.without_backlash(train), rpm=rpm, plan=plan)


def _solve_planned(train, rpm, plan, start):
    decide.check_plan(train, plan)
    if not traced(rpm):
        check_speed(train, rpm)
        rpm = np.asarray(rpm, dtype=float)
    choice, begins = plan.choice, plan.start if start is None else start
    begin = _start(plan, None, plan.cycles if isinstance(begins, str) and begins == "march" else 0)
    if isinstance(start, Response):
        given = fourier.resize(jnp.asarray(start.deflections), plan.harmonics)[choice.chosen]
        begin = Start(given * choice.active[:, None], np.array(True), np.array(0))
    if traced(train, rpm, begin) or staged():
        return _solve_traced(train, rpm, begin, plan)
    problem = pose(train, rpm, plan.sizes.excited)
    outcome = solve_problem(problem, choice, begin, plan.limit, plan.sizes)
    return _host(respond(train, rpm, problem, outcome, plan))


@partial(Program, static_argnames="plan")
def _solve_traced(train, rpm, begin, plan):
    """One program for all of it: piece by piece, differentiation outside ``jit`` compiles a hundred small ones."""
    finite = derivative.all_finite((train, rpm))
    train, rpm = derivative.only_if_finite((train, rpm))
    problem = pose(train, rpm, plan.sizes.excited)
    outcome = solve_problem(problem, plan.choice, begin, plan.limit, plan.sizes)
    outcome = dataclasses.replace(outcome, status=jnp.where(finite, outcome.status, Status.NONFINITE))
    return respond(train, rpm, problem, outcome, plan)


def respond(train, rpm, problem, outcome, plan):
    """Assemble the :class:`Response` of an outcome."""
    found = outcome.fields
    return Response(
        train=train,
        rpm=jnp.asarray(rpm, dtype=float) if traced(train, rpm) or staged() else np.asarray(rpm, dtype=float),
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


def _solve_deciding(train, rpm, harmonics, tolerance, method, integrals, start):
    """The host's decisions for one speed: (response, plan)."""
    check_speed(train, rpm)
    decide.check_method(train, method)
    decide.check_integrals(integrals, method)
    decide.check_tolerance(train, tolerance)
    if harmonics is not None:
        decide.check_harmonics(train, harmonics, method)
    excited = decide.excited_harmonic(train, method)
    contact = _solve_in_contact(train, rpm, excited)
    flank, leaves, separates = decide.contact_demand(train, contact)
    flank, active = tuple(flank.tolist()), tuple(np.flatnonzero(leaves).tolist())
    base = Plan(
        harmonics=harmonics or max(excited, decide.LEVELS[0]),
        active=active,
        flank=flank,
        method=method,
        tolerance=tolerance,
        excited=listed_harmonic(train.topology),
        integrals=integrals,
    )
    chosen = isinstance(start, Response) or start == "march"
    if chosen and any(train.topology.mesh_backlash):
        active, flank = _all_backlash(train), (0,) * len(flank)
        base = dataclasses.replace(base, active=active, flank=flank)
    if not active:
        response = _solve_planned(train, rpm, base, None)
        if int(response.status) != Status.PLAN_VIOLATED:
            return response, base
        base = dataclasses.replace(base, active=_all_backlash(train), flank=(0,) * len(flank))
    modes = decide.mesh_mode_harmonics(train, train.topology.cycle_frequency(float(rpm)))
    if harmonics is None:
        first = decide.first_level(excited, modes[0] if separates else 0.0)
        base = dataclasses.replace(base, harmonics=min(first, decide.MOST[method]))
    if start is None or start == "further":
        lower, upper = ("march", "further") if separates else ("flank", "march")
        start = upper if start else lower
    return _climb(train, rpm, base, modes, harmonics is None, start)


def solve_further(train, rpm, *, harmonics, tolerance, integrals):
    """Response where the first rung of the ladder is known to fail."""
    return _solve_deciding(train, rpm, harmonics, tolerance, "reduced", integrals, "further")[0]


def _solve_in_contact(train, rpm, excited):
    """Elastic tooth forces ``(M, samples)`` with all meshes in contact; (0, 1) without meshes."""
    if not any(train.topology.mesh_backlash):
        return np.zeros((len(train.topology.mesh_names), 1))
    response = linear_response(train, rpm=rpm, harmonics=excited)
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


def check_speed(train, rpm, *, many=False):
    """Refuse a speed that is not a positive number, and several speeds where one is wanted."""
    values, name = np.atleast_1d(np.asarray(rpm, dtype=float)), train.topology.name or "scene"
    if np.ndim(rpm) and not many:
        raise SceneError(f"{name}: {values.size} speeds were given where one is solved: use jaxhb.solve_speeds.")
    if not values.size:
        raise SceneError(f"{name}: no speed is given: name at least one, in rpm.")
    for value in values:
        if not (np.isfinite(value) and value > 0):
            raise SceneError(f"{name}: the speed is {value:g} rpm, must be greater than 0 rpm: a running engine.")


def _climb(train, rpm, plan, modes, adaptive, begins):
    """Solve with rising numbers of harmonics, from one start after another, until the status is good or none is left.

    ``begins`` : a Response, "linear", or the start of the ladder, "march" or (where no tooth separates) "flank";
    "further" for the rungs above a march of a few cycles. ``modes`` : of :func:`~.harmonics.mesh_mode_harmonics`.
    """
    resolving, given = march.instants_for(max(modes[0], 2 * plan.excited)), None
    if isinstance(begins, Response):
        given = np.asarray(begins.deflections)[plan.choice.chosen] * plan.choice.active[:, None]
        if adaptive and int(begins.status) == Status.TOLERANCE_NOT_MET:
            above = decide.next_level(begins.harmonics, plan.method) or decide.MOST[plan.method]
            plan = dataclasses.replace(plan, harmonics=max(plan.harmonics, above))
    path, starts, least = [], None, plan.harmonics
    plan = dataclasses.replace(plan, start="march" if begins in ("march", "further") else "linear")
    while True:
        marching = plan.start == "march"
        if marching and adaptive:
            level = min(decide.first_level(0, modes[0]), decide.MOST[plan.method])
            plan = dataclasses.replace(plan, harmonics=max(plan.harmonics, level))
        enough = resolving if marching else march.instants_for(2 * plan.harmonics)
        plan = dataclasses.replace(plan, instants=max(plan.instants, min(resolving, enough)))
        if begins == "further" and starts is None:
            starts = _starts(train, rpm, plan, adaptive, np.inf, path)
            given, plan = next(starts, (None, plan))
        plan = dataclasses.replace(plan, trust=decide.trust_in(plan.harmonics, modes[1]))
        response, outcome = _attempt(train, rpm, plan, given, plan.cycles if marching else 0)
        status = Status(int(response.status))
        if marching and given is None:
            closure = float(outcome.closure)
            path.append(f"march of {plan.cycles} cycles of {plan.instants} steps (closure {closure:.1e})")
            starts = starts or _starts(train, rpm, plan, adaptive, closure, path)
        path.append(f"Newton with {plan.described}: {status.name}, {int(response.steps)} steps")
        higher = decide.next_level(plan.harmonics, plan.method) if adaptive else None
        if status == Status.PLAN_VIOLATED and any(plan.flank):
            given, starts = None, None
            plan = dataclasses.replace(plan, active=_all_backlash(train), flank=(0,) * len(plan.flank))
        elif status == Status.TOLERANCE_NOT_MET and higher:
            given, least = np.asarray(outcome.deflection), higher
            plan = dataclasses.replace(plan, harmonics=higher)
        elif status in _UNSOLVED and begins == "flank" and not marching:
            given = None
            plan = dataclasses.replace(plan, start="march")
        elif status in _UNSOLVED and starts and (another := next(starts, None)) is not None:
            given, plan = another
            plan = dataclasses.replace(plan, harmonics=max(plan.harmonics, least))
        else:
            return dataclasses.replace(response, path=tuple(path)), plan


def _starts(train, rpm, plan, adaptive, closure, path):
    """Deflections from which to try again after a march of that ``closure``, each with the Plan to try them with.

    Each is found when asked for, and told in ``path``. What was found with shorter steps is solved with as many more
    harmonics, if these are free: below their reach there may be no solution near the motion.
    """
    finest, settled = max(plan.instants, min(FINER * plan.instants, orbits.ROOM)), closure <= SETTLED

    @cache
    def search(instants):
        return orbits.Search(train, rpm, dataclasses.replace(plan, instants=instants))

    def beginning(motion, instants):
        wanted = min(plan.harmonics * instants // plan.instants, decide.MOST[plan.method])
        harmonics = decide.level_at_least(wanted) if adaptive else plan.harmonics
        steps = min(instants, march.INSTANT_COUNTS[-1])
        return motion.coefficients, dataclasses.replace(plan, harmonics=harmonics, instants=steps)

    def finer(motion, instants):
        """The motion, then with ever shorter steps as long as its cycle closes; returns whether it always did."""
        while motion.coefficients is not None:
            yield beginning(motion, instants)
            coarse, instants = search(instants), 2 * instants
            if instants > finest:
                return True
            motion = search(instants).close(motion.nodes, coarse)
            path.append(f"shooting in segments, cycle of {instants} steps (closure {motion.closure:.1e})")
        return False

    twice = min(2 * plan.instants, finest)
    affordable = FEWEST * orbits.work_of_cycle(train, finest) <= orbits.WORK
    counts = dict.fromkeys((plan.instants, twice, finest if affordable else twice))
    counts, closed = [n for n in counts if n > plan.instants or not settled], False
    if counts:
        steady = search(counts[0]).march(min(orbits.STEADY, closure / CLOSER))
        path.append(f"march of {steady.tries} cycles of {counts[0]} steps (closure {steady.closure:.1e})")
        if steady.coefficients is not None:
            yield beginning(steady, counts[0])
    shots = {instants: search(instants).shoot() for instants in counts}
    for instants, orbit in itertools.islice(_in_turn(shots), ORBITS):
        path.append(f"shooting from {orbit.tries} cycles of {instants} steps (closure {orbit.closure:.1e})")
        closed |= yield from finer(orbit, instants)
    if not (settled or closed):
        arrival = homotopy.find(train, rpm, dataclasses.replace(plan, instants=twice))
        outcome = "lost" if arrival.coefficients is None else "found"
        told = f"{outcome}, curve no. {arrival.curves}, {arrival.steps} steps, {arrival.folds} folds"
        told = told if arrival.curves else "not tried, too long"
        path.append(f"homotopy from the linear law: {told}, cycle of {twice} steps")
        yield from finer(arrival, twice)


def _in_turn(iterators):
    """``(key, item)`` of ``{key: iterator}``, one item of each by turns until none has another."""
    while iterators:
        for key, iterator in list(iterators.items()):
            item = next(iterator, None)
            if item is None:
                del iterators[key]
            else:
                yield key, item


def _attempt(train, rpm, plan, given, cycles):
    """One solve from coefficients ``given`` (None: from the motion with all teeth in contact, marched on)."""
    problem = pose(train, rpm, plan.sizes.excited)
    outcome = solve_problem(problem, plan.choice, _start(plan, given, cycles), plan.limit, plan.sizes)
    return _host(respond(train, rpm, problem, outcome, plan)), outcome


def _start(plan, given, cycles):
    coefficients = np.zeros((len(plan.choice.active), plan.harmonics + 1), dtype=complex)
    if given is not None:
        kept = min(given.shape[-1], coefficients.shape[-1])
        coefficients[:, :kept] = given[:, :kept]
    marched = 0 if given is not None else cycles
    return Start(coefficients, np.array(given is not None), np.array(marched))
