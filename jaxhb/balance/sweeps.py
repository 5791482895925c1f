"""Periodic motion by sweeps: march one cycle, correct the errors of its steps, repeat.

Harmonic balance asks for ``F(l) = l - l_lin + G phi(l) = 0``
(:mod:`jaxhb.equations.condensation`). A sweep marches one cycle under a corrected
linear motion b in place of l_lin, from the state s at hand:

    l = P(b, s),     b <- b - (F(l) - J(s_end - s)),     s <- s + closing (s_end - s).

``J(s_end - s)`` is the free motion in a cycle that does not close, known mode by mode:
without it F(l) would be transient as well as error of the steps, and sweeps would run
away where a mode lives for many cycles. ``closing`` is 1, so that sweeps settle as the
train does, except for modes that teeth hardly strain: these close at once, by ``1 / (1
- exp(rate T))``, and a train on a soft ground takes a few sweeps in place of hundreds
of cycles. At a fixed point ``s_end = s``, hence ``F(l) = 0``: harmonic balance holds,
whatever the errors of the march. The march is a nonlinear preconditioner (defect
correction); solving and settling are one thing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, Number, namespace
from jaxhb._program import Program
from jaxhb.balance.march import (
    InstantSolve,
    MarchModes,
    StepWeights,
    TeethLaw,
    complex_modes,
    march_cycle,
    real_pairs,
    step_weights,
)
from jaxhb.balance.sizes import relative_residual
from jaxhb.equations import fourier
from jaxhb.equations.backlash import Law
from jaxhb.equations.block_sweep import quotient
from jaxhb.equations.condensation import CondensedEquation
from jaxhb.equations.state_space import ComplexModes
from jaxhb.integration.step import force_on_flank, with_rate

# Steps of a cycle that are offered: each number is a program.
STEPS = tuple(2**k for k in range(9, 15))
STEPS_PER_PERIOD = 5.0  # of the fastest mode in which teeth move
# Share of the acceleration of a mesh under its force from which teeth move in a mode
MOVES = 0.05
NEAR_NYQUIST = 24  # harmonics next to half the steps that a march does not resolve
SAMPLES_PER_STEP = 3  # of the law in the residual
WIDE_SAMPLES_PER_STEP = 4  # and where the residual is taken once, to see its error
# Share of the rate of a mode by which teeth that part change it at most if they hardly
# strain it
HARDLY = 0.05
FEWEST_SWEEPS = 3
# Change of the vibration below which sweeps may take WAITED times as many
NEAR = 0.01
WAITED = 4
UNSETTLED = 1e6  # multiple of the last change that stands for no end in sight
NOTHING = 1e-8  # share of the force of the gap: a vibration that is rounding


@dataclass(frozen=True)
class SweepPlan:
    """Sizes and options that a sweep is compiled for: steps K of a cycle, the solve for
    phi of an instant, whether phi depends on rates of deflection; harmonics at most,
    and samples of the law in the residual, where these are not as many as the steps
    resolve.
    """

    steps: int
    instant: InstantSolve = InstantSolve()
    by_rate: bool = True
    most_harmonics: int | None = None
    law_samples: int | None = None

    @property
    def harmonics(self) -> int:
        """N of the deflections."""
        resolved = self.steps // 2 - min(NEAR_NYQUIST, self.steps // 8)
        return min(resolved, self.most_harmonics or resolved)

    @property
    def motion_harmonics(self) -> int:
        """Harmonics of the motion that an outcome has: those above them carry little
        more than rounding of the teeth.
        """
        return self.steps // 4

    @property
    def samples(self) -> int:
        """Time samples of a cycle at which the residual takes the law."""
        return self.law_samples or SAMPLES_PER_STEP * self.steps

    @property
    def back_a_step(self) -> np.ndarray:
        """Factors ``(N+1,)`` of the harmonics a step earlier: on the host, as a
        compiler would take the exponential anew for each mode.
        """
        return np.exp(-2j * np.pi * np.arange(self.harmonics + 1) / self.steps)


def fastest_rate(modes: MarchModes | ComplexModes) -> float:
    """Modulus in 1/s of the fastest rate of the modes in which teeth move."""
    meshes = modes.forcing.shape[1]
    accelerated = np.abs(modes.observation[meshes:].T * modes.forcing)
    moves = (accelerated > MOVES * accelerated.sum(axis=0)).any(axis=1)
    return float(np.abs(modes.rates[moves]).max(initial=0.0))


def steps_for(modes: MarchModes, frequency: float) -> int:
    """Steps of a cycle that resolve the modes in which teeth move, one of STEPS."""
    least = STEPS_PER_PERIOD * fastest_rate(modes) / frequency
    return next((steps for steps in STEPS if steps >= least), STEPS[-1])


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SweepEquation:
    """A train at one speed, ready for sweeps.

    equation : CondensedEquation of the active meshes with N harmonics; modes; weights
    of its steps; teeth; free : ``(2, 2m, N+1)``, real and imaginary parts of the
    harmonics of the deflections by the modes, of their real parts above those of their
    imaginary ones, in a cycle that ends off by 1; closing : complex ``(m,)``, of
    :func:`closing_of`; variation : rows ``(K, G)`` of the stiffness over its mean, less
    1, None where it is constant.
    """

    equation: CondensedEquation
    modes: MarchModes
    weights: StepWeights
    teeth: TeethLaw
    free: Array
    closing: Array
    variation: Array | None

    def rows(self, deflection: Array, steps: int) -> Array:
        """(l, l') ``(steps, 2G)`` of coefficients ``(G, N+1)``."""
        return fourier.synthesize(
            with_rate(deflection, self.equation.frequency), steps
        ).T

    def pairs(self) -> tuple[Array, Array]:
        """Harmonics ``(m, N+1)`` of a mode and of its conjugate in a cycle that ends
        off by 1, of the host.
        """
        real, imag = self.free
        even, odd = np.split(real + 1j * imag, 2)
        return even - 1j * odd, even + 1j * odd


class FreeTrain(Protocol):
    """A SweepEquation or a LinearTrain, as free motion needs it."""

    @property
    def modes(self) -> MarchModes: ...
    @property
    def free(self) -> Array: ...


def free_motion(train: FreeTrain, jump: Array) -> Array:
    """Free motion ``J jump`` ``(G, N+1)`` m of a cycle whose state ends off by ``jump``
    ``(2m,)``.
    """
    observed = train.modes.deflections * complex_modes(jump)
    # Products of real numbers: half the work of those of a mode and its conjugate.
    parts = jnp.concatenate([observed.real, observed.imag], axis=1)
    return lax.complex(parts @ train.free[0], parts @ train.free[1])


def sweep_equation(
    equation: CondensedEquation, modes: MarchModes, plan: SweepPlan
) -> SweepEquation:
    """The :class:`SweepEquation` of a CondensedEquation with ``plan.harmonics``."""
    dt = 2 * jnp.pi / equation.frequency / plan.steps
    decay = jnp.exp(modes.rates * dt)
    mode, conjugate = quotient(
        1 / plan.steps,
        jnp.stack([decay, decay.conj()])[:, :, None] * plan.back_a_step - 1,
    )
    parts = jnp.concatenate([mode + conjugate, 1j * (mode - conjugate)]) / 2
    return SweepEquation(
        equation=equation,
        modes=modes,
        weights=step_weights(modes, dt),
        teeth=TeethLaw(equation.law, equation.viscous, equation.contact_damping),
        free=jnp.stack([parts.real, parts.imag]),
        closing=closing_of(modes, equation.law, equation.frequency),
        variation=(
            None
            if equation.variation is None
            else fourier.sample(equation.variation, plan.steps).T
        ),
    )


def closing_of(modes: MarchModes, law: Law, frequency: Number) -> Array:
    """Multiples, complex ``(m,)``, of the jump in its cycle by which each mode goes on
    to the next cycle.

    1, as the train does; or if teeth hardly strain the mode the number that closes it
    under unchanged forces. Where teeth decide the motion of a mode, that would lead
    away from the motion that the train comes to.
    """
    # First-order change of a rate by teeth that part: their force falls by stiffness
    # times deflection.
    change = (
        jnp.abs(modes.forcing.T * modes.deflections) * jnp.abs(law.stiffness)[:, None]
    )
    is_strained = change.sum(axis=0) > HARDLY * jnp.abs(modes.rates)
    at_once = -1 / jnp.expm1(modes.rates * 2 * jnp.pi / frequency)
    return jnp.where(is_strained, 1.0, at_once)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SweepPoint:
    """Point that a sweep begins with: linear b ``(G, N+1)`` m, in place of the linear
    motion; state ``(2m,)`` of the modes and force phi ``(G,)`` N at the beginning of
    the cycle.
    """

    linear: Array
    state: Array
    force: Array


def first_point(sweeps: SweepEquation) -> SweepPoint:
    """The point with all teeth on their drive sides."""
    linear = sweeps.equation.linear
    modes = sweeps.modes
    force = force_on_flank(sweeps.equation.law, linear)
    at_rest = -(modes.forcing @ force) / modes.rates
    return SweepPoint(linear, real_pairs(at_rest) - sweeps.weights.late @ force, force)


def point_at(sweeps: SweepEquation, deviation: np.ndarray) -> SweepPoint:
    """The point of a motion that deviates from the linear one by ``deviation``
    ``(2S,)`` m, m/s of (x, x') at t = 0; on the host.
    """
    modes = sweeps.modes
    linear = sweeps.equation.linear
    modal = modes.coordinates @ deviation
    begin = (
        fourier.sample(with_rate(linear, sweeps.equation.frequency), 1)[:, 0]
        + (modes.observation @ modal).real
    )
    variation = None if sweeps.variation is None else sweeps.variation[0]
    deflection, rate = np.split(begin, 2)
    force, _, _ = sweeps.teeth.at_instant(variation).excess(deflection, rate)
    return SweepPoint(linear, real_pairs(modal) - sweeps.weights.late @ force, force)


def point_of(sweeps: SweepEquation, deflection: Array, plan: SweepPlan) -> SweepPoint:
    """The point from which a sweep marches the deflections ``(G, n+1)`` m, as far as
    its steps tell them apart; on the host.
    """
    equation = sweeps.equation
    modes = sweeps.modes
    deflection = fourier.resize(deflection, plan.harmonics)
    rule = fourier.Equidistant(plan.steps)
    values, rates = equation.sampled(deflection, plan.steps)
    force = equation.nonlinear_force(values, rates, rule)
    # States under these forces, periodic: s' = decay s + push phi, by harmonics of a
    # mode and of its conjugate.
    harmonics = fourier.analyze(force, plan.harmonics)
    end_forces = -plan.steps * plan.back_a_step * harmonics
    push = complex_modes(sweeps.weights.push.T)
    mode, conjugate = sweeps.pairs()
    mode_states = mode * (push @ end_forces)
    conjugate_states = conjugate * (push.conj() @ end_forces)
    immediate = sweeps.weights.at_once[: len(force)] @ harmonics
    marched_part = (
        modes.deflections @ mode_states + modes.deflections.conj() @ conjugate_states
    ) / 2 + immediate
    state = mode_states.sum(axis=1) + conjugate_states[:, 1:].conj().sum(axis=1)
    return SweepPoint(deflection - marched_part, real_pairs(state), force[:, 0])


def marched(
    sweeps: SweepEquation, point: SweepPoint, plan: SweepPlan
) -> tuple[SweepPoint, Array]:
    """The :class:`SweepPoint` at the end of the cycle marched from a point, and its
    deflections ``(G, N+1)`` m.
    """
    linear = point.linear
    rows = (
        sweeps.rows(linear, plan.steps)
        if plan.by_rate
        else fourier.synthesize(linear, plan.steps).T
    )
    cycle, state, force = march_cycle(
        sweeps.modes,
        sweeps.weights,
        sweeps.teeth,
        point.state,
        point.force,
        rows,
        sweeps.variation,
        plan.instant,
    )
    deflection = fourier.analyze(cycle.T, plan.harmonics)
    return SweepPoint(point.linear, state, force), deflection


def sweep(
    sweeps: SweepEquation, point: SweepPoint, plan: SweepPlan
) -> tuple[SweepPoint, Array]:
    """The next :class:`SweepPoint`, and the deflections ``(G, N+1)`` m of the cycle
    marched.
    """
    following, deflection, _ = _sweep(sweeps, point, plan)
    return following, deflection


def _sweep(
    sweeps: SweepEquation, point: SweepPoint, plan: SweepPlan
) -> tuple[SweepPoint, Array, Array]:
    """The results of :func:`sweep`, and F ``(G, N+1)`` m of the deflections."""
    end, deflection = marched(sweeps, point, plan)
    residual = sweeps.equation.residual(deflection, plan.samples)
    jump = end.state - point.state
    transient = free_motion(sweeps, jump)
    next_state = point.state + real_pairs(sweeps.closing * complex_modes(jump))
    return (
        SweepPoint(point.linear - (residual - transient), next_state, end.force),
        deflection,
        residual,
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Settled:
    """End of an iteration: point; deflection ``(G, N+1)`` m; marches, how many were
    taken; change of the deflection in the last of them over its
    :func:`vibration_size`; left ``(G, N+1)`` m, the estimated change of the deflection
    still to come on the way to the fixed point; distance, the size of that likewise.
    """

    point: SweepPoint
    deflection: Array
    marches: Array
    change: Array
    left: Array
    distance: Array


def force_size(equation: CondensedEquation, deflection: Array) -> Array:
    """Root mean square of deflections ``(G, N+1)`` times the stiffness of their meshes,
    N, the largest.
    """
    xp = namespace(equation, deflection)
    size = xp.linalg.norm(fourier.pack(deflection), axis=-1)
    return xp.max(size * xp.abs(equation.law.stiffness), initial=0.0)


def vibration_size(equation: CondensedEquation, deflection: Array) -> Array:
    """:func:`force_size` without the means; a rounding of the force of the gap where
    nothing vibrates.
    """
    xp = namespace(equation, deflection)
    rounding = NOTHING * xp.max(
        equation.law.stiffness * equation.law.backlash, initial=0.0
    )
    vibration = xp.where(np.arange(deflection.shape[-1]) == 0, 0.0, deflection)
    return force_size(equation, vibration) + rounding


def changes_to_come(change: Array, before_last: Array) -> Array:
    """Multiple of its last change by which a sequence may still change, from the size
    of that change and of the one two before: a geometric series, at least 1; inf where
    changes do not shrink.
    """
    ratio = jnp.sqrt(change / before_last)
    return jnp.where(ratio < 1, jnp.maximum(1.0, ratio / (1 - ratio)), jnp.inf)


class _Sweeping(NamedTuple):
    """Sweeps so far and their point; deflections ``(G, N+1)`` m before the last of them
    and after it; the last three changes of the vibration; and what the last leaves of
    the equations.
    """

    marches: Array
    point: SweepPoint
    before: Array
    deflection: Array
    changes: tuple[Array, Array, Array]
    error: Array


def settle(
    sweeps: SweepEquation,
    point: SweepPoint,
    plan: SweepPlan,
    goal: Number,
    most: int | Array,
    solved: Number = 0.0,
) -> Settled:
    """Sweep until the deflections may still change by ``goal`` or less, at most
    ``most`` times, near the end WAITED times as often; and on until they leave
    ``solved`` of the equations (:func:`~jaxhb.balance.sizes.relative_residual`), if
    ``most`` more sweeps lead there.

    The first sweep corrects and closes nothing: it forgets the part of the start that
    no motion of the train has.
    """
    equation = sweeps.equation

    def sweep_once(carry: _Sweeping) -> _Sweeping:
        following, deflection, residual = _sweep(sweeps, carry.point, plan)
        linear = jnp.where(carry.marches == 0, carry.point.linear, following.linear)
        change = force_size(equation, deflection - carry.deflection) / vibration_size(
            equation, carry.deflection
        )
        _, last_but_one, last = carry.changes
        return _Sweeping(
            marches=carry.marches + 1,
            point=SweepPoint(linear, following.state, following.force),
            before=carry.deflection,
            deflection=deflection,
            changes=(last_but_one, last, change),
            error=relative_residual(equation, residual),
        )

    def unsettled(carry: _Sweeping) -> Array:
        before_last, _, change = carry.changes
        away = change * changes_to_come(change, before_last) > goal
        promising = carry.error * (change / before_last) ** (most / 2) <= solved
        go_on = (carry.error > solved) & (away | promising)
        allowed = jnp.where(change < NEAR, WAITED * most, most)
        return (carry.marches < FEWEST_SWEEPS) | (
            (carry.marches < allowed) & go_on & jnp.isfinite(change)
        )

    infinite = jnp.array(jnp.inf)
    start = _Sweeping(
        marches=jnp.array(0),
        point=point,
        before=equation.linear,
        deflection=equation.linear,
        changes=(infinite, infinite, infinite),
        error=infinite,
    )
    ended = lax.while_loop(unsettled, sweep_once, start)
    before_last, _, change = ended.changes
    remaining = jnp.minimum(changes_to_come(change, before_last), UNSETTLED)
    return Settled(
        point=ended.point,
        deflection=ended.deflection,
        marches=ended.marches,
        change=change,
        left=remaining * (ended.deflection - ended.before),
        distance=remaining * change,
    )


def visited(
    sweeps: SweepEquation, point: SweepPoint, plan: SweepPlan, cycles: int
) -> tuple[Array, Array, Array]:
    """The points at which so many cycles begin that are marched from a point one after
    another, uncorrected: states ``(cycles, 2m)`` and forces ``(cycles, G)``, and how
    far each cycle misses its beginning, as meshes see it, m.
    """

    def march(
        point: SweepPoint, _: None
    ) -> tuple[SweepPoint, tuple[Array, Array, Array]]:
        end = marched(sweeps, point, plan)[0]
        missed = sweeps.modes.deflections * complex_modes(end.state - point.state)
        return end, (point.state, point.force, jnp.linalg.norm(missed))

    _, visits = lax.scan(march, point, None, length=cycles)
    return visits


settle_program = Program(settle, static_argnames="plan")
equation_program = Program(sweep_equation, static_argnames="plan")
sweep_program = Program(sweep, static_argnames="plan")
marched_program = Program(marched, static_argnames="plan")
visited_program = Program(visited, static_argnames=("plan", "cycles"))
