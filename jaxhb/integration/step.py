"""Time integration of one train at one speed: exponential Runge-Kutta steps around the
linear train, and cycles.

The deviation ``z`` of the state from the periodic response of the linear train (meshes
in contact) obeys

    z' = A z + E phi(w),     w = (l, l') = w_linear(t) + L z,
    phi = mesh force - c l - r l',

so the excitation and the whole linear train are integrated exactly and only phi, which
is constant while a mesh stays on one flank, is approximated: fourth order, weights of
Krogstad (J. Comput. Phys. 203 (2005) 72). A crossing of a knot of the law, where f''
jumps, costs an error of third order in the step; of second order for damping in
contact, whose slope jumps there. The stages need w alone: the state moves once a step,
by one product with the propagator.

The phi-functions come from one exponential of the augmented matrix [[A, E, 0, 0], [0,
0, I/dt, 0], [0, 0, 0, I/dt], 0] (Van Loan), so that a singular A (free rotation, a ring
without spring) needs no care.

Measured on ``gear_train_30`` at 1800 rpm, four hammering meshes, largest error of the
elastic force over the cycle relative to its maximum: 1000 steps 6 %, 2000 1 %, 3466 (12
per period of the highest mesh mode) 0.12 %, 4096 0.2 %, 8000 0.005 %.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxhb._jax import Array, Number, namespace
from jaxhb.equations import backlash, fourier
from jaxhb.equations.backlash import Law, MeshParameters
from jaxhb.equations.condensation import CondensedEquation
from jaxhb.equations.state_space import (
    Partition,
    StateSpace,
    dense_linear_motion,
    matrices,
    paired,
    partition,
    propagated,
    state_space,
    static_response,
)
from jaxhb.equations.system import System


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class KrogstadWeights:
    """Weights of a step of Krogstad's scheme; n = size of the state, G meshes.

    propagator: exp(A dt) ``(n, n)``, of modes its blocks ``(2, 2, n/2)``; ahead ``(4G,
    n)``: L exp(A dt) above L exp(A dt/2); first, second, third : of the forces in w at
    the stages after the first, ``(2G, G)``, ``(2G, 2G)``, ``(2G, 2G)``; end ``(n + 2G,
    3G)`` of the forces (first, sum of the two in the middle, last) in state and w after
    the step.
    """

    propagator: Array
    ahead: Array
    first: Array
    second: Array
    third: Array
    end: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Stepper:
    """A train cut into ``steps`` equal steps per cycle at one speed; n = size of the
    state, G meshes.

    weights : of a step; linear ``(2 steps, 2G)``: w of the linear
    train every half step, or more rows, of which the last are not used, if ``count``
    holds the number of steps (one program for many numbers); observation ``(2G, n)``:
    from a state to its part of w; law, viscous, contact_damping : of the meshes
    ``(G,)``; variation ``(2 steps, G)``, as linear: stiffness of that instant over its
    mean, less 1; None where it is constant; linear_state ``(n,)``: of the linear train
    at t = 0; flank_state ``(n,)``: deviation for which every mesh carries its linear
    force on its drive side; space : the equations; frequency : rad/s;
    residual_flexibility ``(G, G)`` m/N : static response of the modes that are no
    states, too fast for the steps.
    """

    weights: KrogstadWeights
    linear: Array
    observation: Array
    law: Law
    viscous: Array
    contact_damping: Array
    linear_state: Array | None = None
    flank_state: Array | None = None
    space: StateSpace | None = None
    frequency: Number | None = None
    residual_flexibility: Array | None = None
    count: Array | None = None
    variation: Array | None = None

    @property
    def capacity(self) -> int:
        """Steps of a cycle that the arrays have room for."""
        return self.linear.shape[0] // 2

    @property
    def steps(self) -> int | Array:
        """Steps of a cycle; traced where there is room for more."""
        return self.capacity if self.count is None else self.count

    def variation_at(self, row: int | Array) -> Array:
        """Stiffness over its mean, less 1, ``(G,)`` at half step ``row`` of the
        cycle.
        """
        assert self.variation is not None  # only teeth that vary are asked
        return lax.dynamic_index_in_dim(self.variation, row, keepdims=False)

    def nonlinear_force(
        self, deflection: Array, rate: Array, row: int | Array
    ) -> Array:
        """Force ``(G,)`` N of the meshes at half step ``row`` of the cycle, less its
        linear part.
        """
        law = (
            self.law
            if self.variation is None
            else backlash.at_instant(self.law, self.variation_at(row))
        )
        return backlash.nonlinear_force(
            law, self.viscous, self.contact_damping, deflection, rate
        )

    def nonlinear_force_at(self, w: Array, row: int | Array) -> Array:
        """phi ``(G,)`` N at ``w`` ``(2G,)``, deflections and rates of the states at
        half step ``row`` of the cycle.
        """
        return self.nonlinear_force(
            self.with_fast_modes(w, row), jnp.split(w, 2)[1], row
        )

    def with_fast_modes(self, w: Array, row: int | Array) -> Array:
        """Deflections ``(G,)`` at w and ``row`` with the static response of the fast
        modes, R the residual flexibility: ``l + R phi(l) = l of the states``.

        Two steps of Newton's method mesh by mesh: the fast modes have a small part of
        the compliance of a mesh. Their part of the rate is left out.
        """
        state_deflection, rate = jnp.split(w, 2)
        if self.residual_flexibility is None:
            return state_deflection
        deflection = state_deflection
        flexibility = jnp.diag(self.residual_flexibility)
        for _ in range(2):
            force, slope = jax.jvp(
                lambda l: self.nonlinear_force(l, rate, row),
                (deflection,),
                (jnp.ones_like(state_deflection),),
            )
            deflection = deflection - (
                deflection + self.residual_flexibility @ force - state_deflection
            ) / (1 + flexibility * slope)
        return deflection

    def advance(self, state: Array, w: Array, k: int | Array) -> tuple[Array, Array]:
        """Deviation and w one step after step ``k`` of the cycle: Krogstad's four
        stages, at the begin, twice in the middle and at the end.
        """
        # Rows of the linear train now, half a step ahead and one step ahead
        rows = (
            2 * k,
            2 * k + 1,
            jnp.where(k + 1 < self.steps, 2 * k + 2, 0),
        )
        middle_linear, next_linear = (
            lax.dynamic_index_in_dim(self.linear, row, keepdims=False)
            for row in rows[1:]
        )
        weights = self.weights
        next_w, middle_w = jnp.split(weights.ahead @ state, 2)
        next_w = next_linear + next_w
        middle_w = middle_linear + middle_w

        def force(half_steps: int, w: Array, weights: Array, *forces: Array) -> Array:
            stage_w = w + weights @ jnp.concatenate(forces)
            return self.nonlinear_force_at(stage_w, rows[half_steps])

        begin = self.nonlinear_force_at(w, rows[0])
        middle = force(1, middle_w, weights.first, begin)
        middle_again = force(1, middle_w, weights.second, begin, middle)
        last = force(2, next_w, weights.third, begin, middle_again)
        forces = jnp.concatenate([begin, middle + middle_again, last])
        change = weights.end @ forces
        return (
            propagated(weights.propagator, state) + change[: len(state)],
            next_w + change[len(state) :],
        )


def krogstad(
    half_1: Array, half_2: Array, full_1: Array, full_2: Array, full_3: Array
) -> tuple[tuple[Array, ...], ...]:
    """Weights of the forces of each stage and of the whole step (the two in the middle
    have one weight), from the integrals of the propagator over half a step and a full
    one.
    """
    whole_step = (
        full_1 - 3 * full_2 + 4 * full_3,
        2 * full_2 - 4 * full_3,
        4 * full_3 - full_2,
    )
    return (
        (half_1,),
        (half_1 - half_2, half_2),
        (full_1 - 2 * full_2, 2 * full_2),
        whole_step,
    )


def discretize(
    system: System,
    meshes: MeshParameters,
    frequency: Number,
    load: Array,
    steps: int,
    parts: Partition | None = None,
) -> Stepper:
    """The :class:`Stepper` of equations of motion at one speed.

    system : System, meshes taken in contact; meshes : MeshParameters of those that have
    a law, others are linear links of the system; load ``(S, N+1)`` N, that of
    transmission errors included; steps : per cycle, static, more than N; parts :
    :func:`partition`, needed where the system is traced.
    """
    if steps < load.shape[-1]:
        raise ValueError(
            f"{steps} steps per cycle do not carry {load.shape[-1] - 1} harmonics of"
            " the excitation."
        )
    if parts is None:
        parts = partition(system, meshes)
    system, meshes, frequency, load = jax.tree.map(
        jnp.asarray, (system, meshes, frequency, load)
    )
    space = state_space(system, meshes, frequency, parts)
    displacement = dense_linear_motion(system, frequency, load)
    velocity = fourier.derivative(displacement, frequency)
    deflection = backlash.less_error(
        meshes, system.deflections(displacement, meshes.link)
    )
    shift = static_response(
        matrices(system)[1],
        system.spread(-force_on_flank(meshes.law, deflection), meshes.link),
    )
    linear = rows_of(with_rate(deflection, frequency), steps)
    flank_state = space.coordinates @ jnp.concatenate([shift, jnp.zeros_like(shift)])
    linear_state = (
        space.coordinates
        @ fourier.sample(jnp.concatenate([displacement, velocity]), 1)[:, 0]
    )
    variation = None
    if meshes.variation is not None:
        variation = rows_of(meshes.variation, steps)
    return stepper_of(
        space, meshes, linear, variation, frequency, steps, linear_state, flank_state
    )


def rows_of(coefficients: Array, steps: int) -> Array:
    """Values ``(2 steps, n)`` of coefficients ``(n, N+1)`` at every half step."""
    return fourier.synthesize(coefficients, 2 * steps).T


def stepper_of(
    space: StateSpace,
    meshes: MeshParameters | CondensedEquation,
    linear: Array,
    variation: Array | None,
    frequency: Number,
    steps: int,
    linear_state: Array,
    flank_state: Array,
    residual_flexibility: Array | None = None,
) -> Stepper:
    """The :class:`Stepper` of a state space; linear ``(2 steps, 2G)`` and variation
    ``(2 steps, G)`` : rows every half step of its linear response and of the stiffness
    of the meshes; meshes : with their law, viscous and contact_damping.
    """
    return Stepper(
        weights=_weights(space, 2 * jnp.pi / frequency / steps),
        linear=linear,
        observation=space.observation,
        linear_state=linear_state,
        flank_state=flank_state,
        space=space,
        law=meshes.law,
        viscous=meshes.viscous,
        contact_damping=meshes.contact_damping,
        frequency=frequency,
        residual_flexibility=residual_flexibility,
        variation=variation,
    )


def force_on_flank(law: Law, linear: Array) -> Array:
    """phi ``(G,)`` N of meshes on their drive sides, which the signs of the means of
    ``linear`` ``(G, N+1)`` m tell.
    """
    return -backlash.offset(law) * namespace(linear).where(
        linear[:, 0].real < 0, -1.0, 1.0
    )


def with_rate(deflection: Array, frequency: Number) -> Array:
    """Coefficients ``(2G, N+1)`` of w = (l, l') from those of l."""
    return namespace(deflection).concatenate(
        [deflection, fourier.derivative(deflection, frequency)]
    )


def _weights(space: StateSpace, dt: Number) -> KrogstadWeights:
    """The weights of steps of ``dt`` seconds."""
    A = space.transition
    E = space.forcing
    L = space.observation
    n, G = E.shape
    # Van Loan (IEEE Trans. Autom. Control 23 (1978) 395): the upper blocks of the
    # exponential are exp(A dt) and the integrals of it times 1, t/dt, (t/dt)^2 / 2, the
    # phi-functions.
    matrix = (
        jnp.zeros((n + 3 * G, n + 3 * G)).at[:n, :n].set(A).at[:n, n : n + G].set(E)
    )
    matrix = matrix.at[n : n + 2 * G, n + G :].set(jnp.eye(2 * G) / dt)
    half_exponential = exponential(matrix * dt / 2)
    step_exponential = half_exponential @ half_exponential
    E_half = half_exponential[:n, :n]
    half_1 = half_exponential[:n, n : n + G]
    half_2 = 4 * half_exponential[:n, n + G : n + 2 * G]
    E_full = step_exponential[:n, :n]
    full_1, full_2, full_3 = jnp.split(step_exponential[:n, n:], 3, axis=1)
    first, second, third, whole = krogstad(half_1, half_2, full_1, full_2, full_3)
    end = jnp.concatenate(whole, axis=1)
    return KrogstadWeights(
        propagator=paired(E_full) if space.in_modes else E_full,
        ahead=jnp.concatenate([L @ E_full, L @ E_half]),
        first=L @ first[0],
        second=L @ jnp.concatenate(second, axis=1),
        third=L @ jnp.concatenate(third, axis=1),
        end=jnp.concatenate([end, L @ end]),
    )


def exponential(matrix: Array) -> Array:
    """Exponential of a matrix by its Taylor series of degree 16 with squaring: an
    eighth of the time of jax.scipy in a batch, half to compile.
    """
    norm = jnp.abs(matrix).sum(axis=0).max()
    # Halved until the norm is below a half, where 16 terms leave 1e-20.
    squarings = jnp.maximum(jnp.ceil(jnp.log2(2 * norm)), 0).astype(int)
    identity = jnp.eye(matrix.shape[0])
    small = matrix * 0.5**squarings
    series = lax.fori_loop(
        0, 16, lambda k, power: identity + small @ power / (16 - k), identity
    )
    return lax.fori_loop(0, squarings, lambda _, power: power @ power, series)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CycleTrace:
    """One cycle of the meshes, sampled at ``t_j = 2 pi j / (Omega steps)``, above zeros
    where there is room for more.

    deflection ``(G, capacity)`` m; rate ``(G, capacity)`` m/s; periodicity_error :
    change of (l, l') from the beginning of that cycle to its end, the largest over the
    meshes relative to ``max|l| + g`` and ``max|l'| + Omega g``, g = (1 - epsilon) h.
    Motion that moves no mesh (rotation of a floating or softly grounded train) does not
    count.
    """

    deflection: Array
    rate: Array
    periodicity_error: Array


def run(
    stepper: Stepper,
    state: Array,
    first: int | Array,
    count: int | Array,
    keep: Callable[..., Any] = lambda seen, *_: seen,
    seen: Any = (),
    even: bool = False,
) -> tuple[Array, Array, Any]:
    """Take ``count`` steps from the deviation ``state`` ``(n,)`` at the beginning of
    step ``first``; valid under jit and vmap.

    Returns the state and w ``(2G,)``, (l, l') of the states, at the end, and what was
    seen: ``seen = keep(seen, k, w, state)`` before each step k = 0, 1, .. of them.
    ``even`` : the count is even, and two steps are taken at once.
    """

    def step(
        k: int | Array, carry: tuple[Array, Array, Any]
    ) -> tuple[Array, Array, Any]:
        state, w, seen = carry
        return *stepper.advance(state, w, first + k), keep(seen, k, w, state)

    w_begin = (
        lax.dynamic_index_in_dim(stepper.linear, 2 * first, keepdims=False)
        + stepper.observation @ state
    )
    start = (state, w_begin, seen)
    # Two steps in a loop body: where a step takes a microsecond, the loop itself is a
    # good part of it.
    if even:
        return lax.fori_loop(
            0, count // 2, lambda k, carry: step(2 * k + 1, step(2 * k, carry)), start
        )
    return lax.fori_loop(0, count, step, start)


def _whole(
    stepper: Stepper, state: Array, keep: Callable[..., Any], seen: Any
) -> tuple[Array, Array, Any]:
    """State after one cycle, the change of w ``(2G,)``, and what was seen."""
    even = stepper.count is not None or stepper.capacity % 2 == 0
    end, w, seen = run(stepper, state, 0, stepper.steps, keep, seen, even)
    return end, w - (stepper.linear[0] + stepper.observation @ state), seen


def cycle(stepper: Stepper, state: Array) -> tuple[Array, CycleTrace]:
    """State ``(n,)`` after one cycle from the deviation ``state`` at t = 0, and its
    :class:`CycleTrace`.
    """
    end, change, samples = _whole(
        stepper, state, put, no_samples(stepper, stepper.capacity)
    )
    return end, trace_of(stepper, samples, change)


def cycle_error(stepper: Stepper, state: Array) -> tuple[Array, Array]:
    """State after one cycle from ``state``, and the periodicity error of its
    :class:`CycleTrace`; no samples are kept.
    """
    end, change, largest = _whole(stepper, state, *watch(stepper))
    return end, periodicity_error(stepper, change, largest)


def put(samples: Array, k: int | Array, w: Array, _: Array) -> Array:
    """Write a row of samples ``(capacity, 2G)``, as ``keep`` of :func:`run`."""
    return lax.dynamic_update_index_in_dim(samples, w, k, axis=0)


def no_samples(stepper: Stepper, capacity: int) -> Array:
    """Zeros ``(capacity, 2G)``, into which samples are :func:`put`."""
    return jnp.zeros((capacity, stepper.linear.shape[1]))


def watch(stepper: Stepper) -> tuple[Callable[..., Array], Array]:
    """``keep`` and ``seen`` of :func:`run` for the largest deflections and rates
    ``(2G,)``.
    """

    def keep(largest: Array, k: int | Array, w: Array, _: Array) -> Array:
        motion = jnp.concatenate(
            [stepper.with_fast_modes(w, 2 * k), jnp.split(w, 2)[1]]
        )
        return jnp.maximum(largest, jnp.abs(motion))

    return keep, jnp.zeros(stepper.linear.shape[1])


def periodicity_error(stepper: Stepper, change: Array, largest: Array) -> Array:
    """Periodicity error, see :class:`CycleTrace`, of a change and the largest of
    deflections and rates, ``(2G,)`` each.
    """
    assert stepper.frequency is not None  # a stepper of one speed
    gap = (1 - stepper.law.epsilon) * stepper.law.backlash + 1e-300
    return jnp.max(
        jnp.abs(change) / (largest + jnp.concatenate([gap, stepper.frequency * gap])),
        initial=0.0,
    )


def trace_of(stepper: Stepper, samples: Array, change: Array) -> CycleTrace:
    """The CycleTrace from w ``(capacity, 2G)``, (l, l') of the states, and its change
    ``(2G,)`` over the cycle.
    """
    deflection = jax.vmap(stepper.with_fast_modes)(
        samples, 2 * jnp.arange(len(samples))
    ).T
    rate = jnp.split(samples.T, 2)[1]
    largest = jnp.abs(jnp.concatenate([deflection, rate])).max(axis=1)
    return CycleTrace(deflection, rate, periodicity_error(stepper, change, largest))


def march(
    stepper: Stepper,
    state: Array,
    *,
    tolerance: float | Array = 1e-6,
    max_cycles: int | Array = 200,
) -> tuple[Array, CycleTrace, Array]:
    """March from a deviation ``(n,)`` until a cycle closes to ``tolerance``, a
    ``trace.periodicity_error``, is not finite, or ``max_cycles`` have passed: state
    ``(n,)``, CycleTrace of the last cycle, cycles; valid under jit and vmap.

    No cycle closes where the motion is not periodic, has a longer period or decays too
    slowly. A slow drift closes every cycle to the drift of one cycle.
    """

    def unfinished(carry: tuple[Array, CycleTrace, jax.Array]) -> Array:
        _, trace, cycles = carry
        return (
            (cycles < max_cycles)
            & ~(trace.periodicity_error <= tolerance)
            & ~jnp.isnan(trace.periodicity_error)
        )

    def next_cycle(
        carry: tuple[Array, CycleTrace, jax.Array],
    ) -> tuple[Array, CycleTrace, jax.Array]:
        state, _, cycles = carry
        return *cycle(stepper, state), cycles + 1

    # With an empty CycleTrace to begin with the loop holds one copy of a cycle, and
    # compiles faster.
    empty = jnp.zeros((len(stepper.viscous), stepper.capacity))
    begin = state, CycleTrace(empty, empty, jnp.array(jnp.inf)), jnp.array(0)
    return lax.while_loop(unfinished, next_cycle, begin)
