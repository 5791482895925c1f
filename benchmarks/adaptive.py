"""Integrators from libraries: diffrax, scipy, and the exponential integrator of the
package over a batch of speeds.
"""

import time
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from integrators import accelerate
from records import timed
from scipy.integrate import solve_ivp
from tasks import links

from jaxhb.balance.problem import problem_at
from jaxhb.equations import backlash
from jaxhb.equations.state_space import partition
from jaxhb.integration.step import discretize, march
from jaxhb.train.excitation import highest_harmonic
from jaxhb.train.mesh_parameters import law_meshes


def scipy_march(task, method, rtol, cycles, samples):
    """Deflections ``(M, samples)`` m of the last cycle and seconds; the right-hand side
    is compiled.

    The excitation is the Fourier sum at the time asked for.
    """
    size, m = task.model.mass.size, task.model
    orders = np.arange(task.load.shape[1]) * task.frequency
    cosine, sine = 2 * task.load.real, -2 * task.load.imag
    cosine[:, 0] /= 2

    def slope(t, state):
        push = cosine @ np.cos(orders * t) + sine @ np.sin(orders * t)
        out = np.empty(2 * size)
        out[:size] = state[size:]
        accelerate(m, state[:size], state[size:], push[None, :], out[size:])
        return out

    begin = time.perf_counter()
    end = cycles * task.period
    at = end - task.period + np.arange(samples) * task.period / samples
    start = np.concatenate([task.displacement, task.velocity])
    found = solve_ivp(
        slope,
        (0.0, end),
        start,
        method=method,
        rtol=rtol,
        atol=_absolute(task, rtol),
        t_eval=at,
    )
    seconds = time.perf_counter() - begin
    return (
        _seen(m, found.y[:size])
        if found.success
        else np.full((m.mesh_k.size, samples), np.nan)
    ), seconds


def _absolute(task, rtol):
    """Absolute tolerances: of displacements against the gap, of velocities against gap
    x 1000 Hz.
    """
    gap = task.model.low.max()
    return rtol * np.repeat([gap, gap * 2 * np.pi * 1000], task.model.mass.size)


def _seen(m, x):
    return m.arm_a[:, None] * x[m.mesh_a] - m.arm_b[:, None] * x[m.mesh_b]


def march_speeds(train, rpm, steps, cycles, repeats):
    """Exponential integration of all speeds in one program, every mesh with backlash.

    Deflection ``(speeds, M, steps)`` m, periodicity error ``(speeds,)``, seconds of the
    first run, median of others.
    """
    meshes, excited = law_meshes(train), highest_harmonic(train)
    parts = partition(problem_at(train, rpm[0], excited).system, meshes)

    @jax.jit
    @jax.vmap
    def run(speed):
        problem = problem_at(train, speed, excited)
        stepper = discretize(
            problem.system, meshes, problem.frequency, problem.load, steps, parts=parts
        )
        _, trace, _ = march(
            stepper, stepper.flank_state, tolerance=-1.0, max_cycles=cycles
        )
        return trace.deflection, trace.periodicity_error

    (deflection, periodicity_error), first, seconds, _ = timed(
        lambda: jax.block_until_ready(run(jnp.asarray(rpm))), repeats
    )
    return np.asarray(deflection), np.asarray(periodicity_error), first, seconds


def diffrax_march(task, solver, rtol, cycles, samples, repeats):
    """Deflections of the last cycle, seconds to compile and run first, seconds of later
    runs; dense matrices.
    """
    import diffrax

    equations = _dense(task)
    kinds = {
        "Tsit5": diffrax.Tsit5,
        "Dopri8": diffrax.Dopri8,
        "Kvaerno5": diffrax.Kvaerno5,
    }
    end = cycles * task.period
    at = jnp.asarray(end - task.period + np.arange(samples) * task.period / samples)
    start = jnp.concatenate(
        [jnp.asarray(task.displacement), jnp.asarray(task.velocity)]
    )
    absolute = jnp.asarray(_absolute(task, rtol))

    @jax.jit
    def run(start):
        return diffrax.diffeqsolve(
            diffrax.ODETerm(partial(_slope, equations, task.law)),
            kinds[solver](),
            0.0,
            end,
            task.period / 4000,
            start,
            saveat=diffrax.SaveAt(ts=at),
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=absolute),
            max_steps=10_000_000,
            adjoint=diffrax.ForwardMode(),
            throw=False,
        ).ys

    states, first, seconds, _ = timed(
        lambda: jax.block_until_ready(run(start)), repeats
    )
    return (
        _seen(task.model, np.asarray(states).T[: task.model.mass.size]),
        first,
        seconds,
    )


def _dense(task):
    """Dense equations: M^-1 B and M^-1 K without the meshes, mesh rows, their damping,
    the excitation.
    """
    m = task.model
    size = task.model.mass.size
    a, b, arm_a, arm_b, k, r = links(m)
    rows = np.zeros((a.size, size))
    at = np.arange(a.size)
    rows[at, a] += arm_a
    rows[at, b] -= arm_b
    meshes = rows[-m.mesh_k.size :]
    linear = rows[: -m.mesh_k.size]
    k = k[: -m.mesh_k.size]
    r = r[: -m.mesh_k.size]
    load = np.zeros((size, task.load.shape[1]), dtype=complex)
    load[m.pushed] = task.load * np.where(np.arange(task.load.shape[1]), 2, 1)
    matrix = np.concatenate(
        [
            np.diag(m.ground) + linear.T @ (k[:, None] * linear),
            np.diag(m.damping) + linear.T @ (r[:, None] * linear),
        ],
        1,
    )
    weights = np.concatenate([load.real, -load.imag], axis=1)
    arrays = (matrix, meshes, weights, 1 / m.mass, m.mesh_r, m.gated, task.frequency)
    return jax.tree.map(jnp.asarray, arrays)


def _slope(equations, law, t, state, args):
    matrix, meshes, weights, inverse, viscous, gated, frequency = equations
    phase = frequency * t * jnp.arange(weights.shape[1] // 2)
    x, v = jnp.split(state, 2)
    tooth = backlash.mesh_force(
        jax.tree.map(jnp.asarray, law), viscous, gated, meshes @ x, meshes @ v
    )
    push = (
        weights @ jnp.concatenate([jnp.cos(phase), jnp.sin(phase)])
        - matrix @ state
        - meshes.T @ tooth
    )
    return jnp.concatenate([v, inverse * push])
