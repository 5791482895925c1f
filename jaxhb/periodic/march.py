"""Starts for Newton's method: a few cycles of time integration from the motion with all teeth in contact."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ..harmonic import backlash, fourier
from ..harmonic.residual import Nonlinear
from ..transient.integrate import march
from ..transient.statespace import partition
from ..transient.stepper import discretize, on_flank
from .problem import offset_load

STEPS_PER_MODE_PERIOD = 12
STEP_COUNTS = tuple(n * 2**k for k in range(8, 20) for n in (2, 3))


def steps_for(harmonic):
    """Steps per cycle that resolve motion up to ``harmonic`` of the cycle, one of a few numbers."""
    needed = max(512, STEPS_PER_MODE_PERIOD * harmonic)
    return next((n for n in STEP_COUNTS if n >= needed), STEP_COUNTS[-1])


def parts_for(problem):
    """How the train is integrated (host), or None where time integration cannot serve it."""
    try:
        return partition(without_loss(problem).system, problem.meshes)
    except ValueError:
        return None


def without_loss(problem):
    """Loss factors turned into viscous damping at the highest excited harmonic: a start needs no more."""
    system = problem.system
    highest = (problem.load.shape[-1] - 1) * problem.frequency
    viscous = system.viscous + system.loss * system.stiffness / highest
    system = dataclasses.replace(system, viscous=viscous, loss=0.0 * system.loss)
    return dataclasses.replace(problem, system=system)


def march_start(problem, choice, count, *, cycles, steps, excited, parts, state=None):
    """Deflections of the active meshes over the last of ``cycles`` cycles.

    Parameters
    ----------
    problem : Problem; choice : Choice, of whose meshes the first ``count`` are real
    cycles, steps : int, cycles and steps per cycle; excited : int, highest harmonic of the excitation
    parts : Partition
    state : array ``(n,)`` or None, where to go on

    Returns
    -------
    state : array ``(n,)``; deflection : array ``(G, steps)``, zero for padding; closure : float
    """
    problem = dataclasses.replace(problem, load=fourier.resize(offset_load(problem, choice.flank), excited))
    problem = without_loss(problem)
    chosen = choice.chosen[:count]
    meshes = problem.meshes
    active = Nonlinear(
        link=jnp.asarray(meshes.link)[chosen],
        law=jax.tree.map(lambda a: jnp.asarray(a)[chosen], meshes.law),
        viscous=jnp.asarray(meshes.viscous)[chosen],
        contact_damping=jnp.asarray(meshes.contact_damping)[chosen],
    )
    stepper = discretize(problem.system, active, problem.frequency, problem.load, steps, parts=parts)
    state, trace = march(stepper, on_flank(stepper) if state is None else state, cycles)
    padding = jnp.zeros((len(choice.active) - count, steps))
    return state, jnp.concatenate([trace.deflection, padding]), trace.closure


march_program = partial(jax.jit, static_argnames=("count", "cycles", "steps", "excited", "parts"))(march_start)


def start_from(trace, harmonics):
    """Coefficients ``(G, harmonics+1)`` of sampled deflections ``(G, steps)``."""
    available = (trace.shape[-1] - 1) // 2
    return fourier.resize(fourier.analyze(trace, min(harmonics, available)), harmonics)


def contact_weight(problem, choice, deflection, harmonics):
    """How far each mesh is from contact at the ``2 N`` instants of the preconditioner, from samples; on the host."""
    meshes = jax.tree.map(lambda a: np.asarray(a)[choice.chosen][:, None], problem.meshes.law)
    share = backlash.engagement(meshes, np.asarray(deflection)) + (choice.active[:, None] == 0)
    out = np.asarray(share) < 1
    cells = 2 * harmonics
    index = (np.arange(out.shape[-1]) * cells + out.shape[-1] // 2) // out.shape[-1] % cells
    weight = np.zeros((out.shape[0], cells))
    for row, flags in zip(weight, out, strict=True):
        np.add.at(row, index, flags)
    return weight
