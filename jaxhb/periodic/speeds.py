"""Many speeds in one call: one plan, one compiled program, a status per speed."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ..model.engine import highest_harmonic
from . import harmonics as decide
from . import march
from .harmonics import Plan
from .problem import Problem, pose
from .program import solve_problem
from .solve import check_speed, respond

CHUNK = 8


def solve_speeds(train, *, rpm, plan=None, harmonics=None, tolerance=0.01):
    """Periodic responses at many speeds.

    All speeds share one plan and are solved by one compiled program in chunks of fixed size.

    Parameters
    ----------
    train : DriveTrain
    rpm : array ``(n,)``
        Speeds of the reference rotor.
    plan : Plan, optional
        From :func:`jaxhb.plan`; by default made for all speeds together.
    harmonics : int, optional
        Harmonics of the cycle; by default enough for the mesh modes at the lowest speed at which teeth separate.
    tolerance : float
        On the truncation error; speeds that do not reach it have status TOLERANCE_NOT_MET.

    Returns
    -------
    Response
        With a leading axis: ``sweep[17]`` is the response at speed 17, ``sweep.status`` the status of each.

    Raises
    ------
    SceneError
        A speed that is not positive, or harmonics below the excitation.

    Examples
    --------
    >>> import jaxhb, numpy
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> sweep = jaxhb.solve_speeds(train, rpm=numpy.linspace(1000, 2500, 4))
    >>> sweep.torque("cyl6", "flywheel").half_peak_to_peak.shape
    (4,)
    """
    rpm = np.atleast_1d(np.asarray(rpm, dtype=float))
    check_speed(train, rpm)
    if plan is None:
        if harmonics is not None:
            decide.check_harmonics(train, harmonics, "reduced")
        plan = plan_speeds(train, rpm, harmonics, tolerance)
    chunk = min(CHUNK, len(rpm))
    padded = np.concatenate([rpm, np.full(-len(rpm) % chunk, rpm[-1])])
    parts = [_solve_chunk(train, part, plan) for part in padded.reshape(-1, chunk)]
    whole = jax.tree.map(lambda *leaves: np.concatenate(leaves)[: len(rpm)], *parts)
    problem, outcome = whole
    return respond(train, rpm, problem, outcome, plan)


def _axes():
    """Of a batch of problems only what depends on speed has a leading axis."""
    return Problem(
        system=None,
        meshes=None,
        frequency=0,
        load=0,
        rigid=None,
        load_torque=0,
        load_power=0,
        imbalance=0,
        torque_scale=0,
    )


@partial(jax.jit, static_argnames=("harmonics", "excited"))
def _pose_all(train, rpm, harmonics, excited):
    return jax.vmap(lambda speed: pose(train, speed, harmonics, excited), out_axes=_axes())(rpm)


@partial(jax.jit, static_argnames="sizes")
def _solve_all(problem, choice, start, tolerance, sizes):
    def one(problem):
        return solve_problem(problem, choice, start, tolerance, sizes)

    return jax.vmap(one, in_axes=(_axes(),))(problem)


def _solve_chunk(train, rpm, plan):
    problem = _pose_all(train, jnp.asarray(rpm), plan.harmonics, plan.excited)
    choice = plan.choice
    start = jnp.zeros((len(choice.active), plan.harmonics + 1), dtype=complex)
    outcome = _solve_all(problem, choice, start, jnp.asarray(plan.tolerance), plan.sizes)
    batched = {name: getattr(problem, name) for name in ("load_torque", "load_power")}
    return _Loads(**batched), jax.tree.map(np.asarray, outcome)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Loads:
    """What :func:`respond` reads of a problem."""

    load_torque: jax.Array
    load_power: jax.Array


def plan_speeds(train, rpm, harmonics, tolerance):
    """One plan that serves all speeds: every mesh that leaves contact at any of them is active."""
    excited = highest_harmonic(train)
    count = len(train.topology.mesh_names)
    linear = Plan(
        harmonics=max(excited, decide.LEVELS[0]),
        active=(),
        flank=(0,) * count,
        tolerance=tolerance,
        excited=excited,
    )
    if not any(train.topology.mesh_backlash):
        return dataclasses.replace(linear, harmonics=harmonics or linear.harmonics)
    sweep = solve_speeds(decide.without_backlash(train), rpm=rpm, plan=linear)
    samples = np.fft.irfft(sweep.elastic_forces, n=16 * sweep.elastic_forces.shape[-1], norm="forward")
    demands = [decide.contact_demand(train, forces) for forces in samples]
    active = tuple(sorted({mesh for _, meshes, _ in demands for mesh in meshes}))
    flank = tuple(demands[0][0]) if not active else (0,) * count
    if not active:
        return dataclasses.replace(linear, flank=flank, harmonics=harmonics or linear.harmonics)
    slowest = min((r for r, (_, _, separates) in zip(rpm, demands, strict=True) if separates), default=None)
    modes = decide.mesh_mode_harmonic(train, decide.cycle_frequency(train, slowest or rpm.min()))
    level = harmonics or decide.first_level(excited, modes if slowest else 0.0)
    resolved = decide.resolved_for(level, modes)
    problem = pose(train, float(rpm[0]), excited)
    parts = march.parts_for(problem)
    steps = march.steps_for(decide.mesh_mode_harmonic(train, decide.cycle_frequency(train, rpm.min())))
    return dataclasses.replace(
        linear,
        harmonics=level,
        active=active,
        flank=flank,
        start="march" if parts else "linear",
        march_steps=steps,
        parts=parts,
        room=resolved * len(active),
        resolved=resolved,
    )
