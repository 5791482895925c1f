"""Periodic motion by sweeps: march one cycle, correct what its steps did wrong, repeat.

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
whatever the march does wrong. The march is a nonlinear preconditioner (defect
correction); solving and settling are one thing.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, namespace
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
from jaxhb.equations import condensation, fourier
from jaxhb.equations.block_sweep import quotient
from jaxhb.integration.step import force_on_flank, with_rate

STEPS = tuple(
    2**k for k in range(9, 15)
)  # of a cycle that are offered: each is a program
STEPS_PER_PERIOD = 5.0  # of the fastest mode in which teeth move
# Share of the acceleration of a mesh under its force from which teeth move in a mode
MOVES = 0.05
NEAR_NYQUIST = 24  # harmonics next to half the steps that a march does not resolve
SAMPLES_PER_STEP = 3  # of the law in the residual
WIDE_SAMPLES_PER_STEP = 4  # and where it is taken once, to see its error
# Share of the rate of a mode by which teeth that part change it at most if they hardly
# strain it
HARDLY = 0.05
FEWEST_SWEEPS = 3
NEAR, WAITED = (
    0.01,
    4,
)  # change of the vibration from which sweeps may take so many times as long
UNSETTLED = 1e6  # times the last change that counts as no end in sight
NOTHING = 1e-8  # of what the gap carries: a vibration that is rounding


@dataclass(frozen=True)
class SweepPlan:
    """What a sweep is compiled for: steps K of a cycle, how phi of an instant is found,
    whether it depends on rates of deflection; harmonics at most, and samples of the law
    in the residual, where these are not as many as the steps resolve.
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
    def kept(self) -> int:
        """Harmonics of the motion that are kept: those above them carry little more
        than rounding of the teeth.
        """
        return self.steps // 4

    @property
    def samples(self) -> int:
        """M, at which the residual takes the law."""
        return self.law_samples or SAMPLES_PER_STEP * self.steps

    @property
    def back_a_step(self) -> np.ndarray:
        """Factors ``(N+1,)`` of the harmonics a step earlier: numbers of the host, as a
        compiler would take the exponential anew for each mode.
        """
        return np.exp(-2j * np.pi * np.arange(self.harmonics + 1) / self.steps)


def fastest_rate(modes) -> float:
    """Modulus in 1/s of the fastest rate of the modes in which teeth move."""
    meshes = modes.forcing.shape[1]
    accelerated = np.abs(modes.observation[meshes:].T * modes.forcing)
    moves = (accelerated > MOVES * accelerated.sum(axis=0)).any(axis=1)
    return float(np.abs(modes.rates[moves]).max(initial=0.0))


def steps_for(modes: MarchModes, frequency: float) -> int:
    """Steps of a cycle that resolve the modes in which teeth move, one of STEPS."""
    wanted = STEPS_PER_PERIOD * fastest_rate(modes) / frequency
    return next((steps for steps in STEPS if steps >= wanted), STEPS[-1])


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SweepEquation:
    """A train at one speed, ready for sweeps.

    equation : CondensedEquation of the active meshes with N harmonics; modes; weights
    of its steps; teeth; free : ``(2, 2m, N+1)``, real and imaginary parts of the
    harmonics of what meshes see of the modes, of real parts above those of imaginary
    ones, in a cycle that ends off by 1; closing : complex ``(m,)``, of
    :func:`closing_of`; variation : rows ``(K, G)`` of the stiffness over its mean, less
    1, None of none.
    """

    equation: condensation.CondensedEquation
    modes: MarchModes
    weights: StepWeights
    teeth: TeethLaw
    free: jax.Array
    closing: jax.Array
    variation: jax.Array | None

    def rows(self, deflection, steps):
        """(l, l') ``(steps, 2G)`` of coefficients ``(G, N+1)``."""
        return fourier.synthesize(
            with_rate(deflection, self.equation.frequency), steps
        ).T

    def pairs(self):
        """Harmonics ``(m, N+1)`` of a mode and of its conjugate in a cycle that ends
        off by 1, of the host.
        """
        real, imag = self.free
        even, odd = np.split(real + 1j * imag, 2)
        return even - 1j * odd, even + 1j * odd


def free_motion(train, jump):
    """J ``(G, N+1)`` m of a state that ends off by ``jump`` ``(2m,)``; train : anything
    with ``modes`` and ``free``.
    """
    observed = train.modes.deflections * complex_modes(jump)
    # Products of real numbers: half the work of those of a mode and its conjugate.
    parts = jnp.concatenate([observed.real, observed.imag], axis=1)
    return lax.complex(parts @ train.free[0], parts @ train.free[1])


def sweep_equation(equation, modes: MarchModes, plan: SweepPlan) -> SweepEquation:
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


def closing_of(modes: MarchModes, law, frequency):
    """How many times the jump in its cycle each mode ``(m,)`` goes on to the next
    cycle.

    Once, as the train does, or if teeth hardly strain the mode as often as closes it
    under forces that stay what they are. Where teeth decide what a mode does, that
    would lead away from the motion that the train comes to.
    """
    # First-order change of a rate by teeth that part: their force falls by stiffness
    # times deflection.
    change = (
        jnp.abs(modes.forcing.T * modes.deflections) * jnp.abs(law.stiffness)[:, None]
    )
    strained = change.sum(axis=0) > HARDLY * jnp.abs(modes.rates)
    at_once = -1 / jnp.expm1(modes.rates * 2 * jnp.pi / frequency)
    return jnp.where(strained, 1.0, at_once)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SweepPoint:
    """What a sweep begins with: b ``(G, N+1)`` m, in place of the linear motion; state
    ``(2m,)`` of the modes and force phi ``(G,)`` N at the beginning of the cycle.
    """

    linear: Array
    state: Array
    force: Array


def first_point(sweeps: SweepEquation) -> SweepPoint:
    """All teeth on their drive sides."""
    linear = sweeps.equation.linear
    modes = sweeps.modes
    force = force_on_flank(sweeps.equation.law, linear)
    at_rest = -(modes.forcing @ force) / modes.rates
    return SweepPoint(linear, real_pairs(at_rest) - sweeps.weights.late @ force, force)


def point_at(sweeps: SweepEquation, deviation) -> SweepPoint:
    """From a motion that deviates from the linear one by ``deviation`` ``(2S,)`` m, m/s
    of (x, x') at t = 0; of the host.
    """
    modes = sweeps.modes
    linear = sweeps.equation.linear
    modal = modes.coordinates @ deviation
    begin = (
        fourier.sample(with_rate(linear, sweeps.equation.frequency), 1)[:, 0]
        + (modes.observation @ modal).real
    )
    teeth = sweeps.teeth.at_instant(
        None if sweeps.variation is None else sweeps.variation[0]
    )
    force, _, _ = teeth.excess(*np.split(begin, 2))
    return SweepPoint(linear, real_pairs(modal) - sweeps.weights.late @ force, force)


def point_of(sweeps: SweepEquation, deflection, plan: SweepPlan) -> SweepPoint:
    """The point at which a sweep marches the deflections ``(G, n+1)`` m, as far as its
    steps tell them apart; of the host.
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
    turned = -plan.steps * plan.back_a_step * harmonics
    push = complex_modes(sweeps.weights.push.T)
    mode, conjugate = sweeps.pairs()
    own = mode * (push @ turned)
    other = conjugate * (push.conj() @ turned)
    late = sweeps.weights.at_once[: len(force)] @ harmonics
    moved = (modes.deflections @ own + modes.deflections.conj() @ other) / 2 + late
    state = own.sum(axis=1) + other[:, 1:].conj().sum(axis=1)
    return SweepPoint(deflection - moved, real_pairs(state), force[:, 0])


def marched(sweeps: SweepEquation, point: SweepPoint, plan: SweepPlan):
    """The :class:`SweepPoint` at the end of the cycle marched from a point, and its
    deflections ``(G, N+1)`` m.
    """
    linear = point.linear
    rows = (
        sweeps.rows(linear, plan.steps)
        if plan.by_rate
        else fourier.synthesize(linear, plan.steps).T
    )
    given = sweeps.modes, sweeps.weights, sweeps.teeth
    start = point.state, point.force
    cycle, state, force = march_cycle(
        *given, *start, rows, sweeps.variation, plan.instant
    )
    return SweepPoint(point.linear, state, force), fourier.analyze(
        cycle.T, plan.harmonics
    )


def sweep(sweeps: SweepEquation, point: SweepPoint, plan: SweepPlan):
    """The next :class:`SweepPoint`, and the deflections ``(G, N+1)`` m of the cycle
    marched.
    """
    following, deflection, _ = _sweep(sweeps, point, plan)
    return following, deflection


def _sweep(sweeps, point, plan):
    """What :func:`sweep` gives, and F of the deflections."""
    end, deflection = marched(sweeps, point, plan)
    missed = sweeps.equation.residual(deflection, plan.samples)
    jump = end.state - point.state
    transient = free_motion(sweeps, jump)
    onward = point.state + real_pairs(sweeps.closing * complex_modes(jump))
    return (
        SweepPoint(point.linear - (missed - transient), onward, end.force),
        deflection,
        missed,
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Settled:
    """Where an iteration ended: point; deflection ``(G, N+1)`` m; marches, how many
    were taken; change of the deflection in the last of them over its
    :func:`vibration_size`; left ``(G, N+1)`` m, what the deflection may still change on
    the way to the fixed point, estimated; distance, the size of that likewise.
    """

    point: SweepPoint
    deflection: Array
    marches: Array
    change: Array
    left: Array
    distance: Array


def force_size(equation, deflection):
    """Root mean square of deflections ``(G, N+1)`` times the stiffness of their meshes,
    N, the largest.
    """
    xp = namespace(equation, deflection)
    size = xp.linalg.norm(fourier.pack(deflection), axis=-1)
    return xp.max(size * xp.abs(equation.law.stiffness), initial=0.0)


def vibration_size(equation, deflection):
    """:func:`force_size` without the means; a rounding of what the gap carries where
    nothing vibrates.
    """
    xp = namespace(equation, deflection)
    rounding = NOTHING * xp.max(
        equation.law.stiffness * equation.law.backlash, initial=0.0
    )
    vibration = xp.where(np.arange(deflection.shape[-1]) == 0, 0.0, deflection)
    return force_size(equation, vibration) + rounding


def changes_to_come(change, before_last):
    """How many times its last change a sequence may still change, from the size of that
    and of the one two before: a geometric series, at least 1; inf where changes do not
    shrink.
    """
    ratio = jnp.sqrt(change / before_last)
    return jnp.where(ratio < 1, jnp.maximum(1.0, ratio / (1 - ratio)), jnp.inf)


def settle(
    sweeps: SweepEquation, point: SweepPoint, plan: SweepPlan, goal, most, solved=0.0
) -> Settled:
    """Sweeps until the deflections may still change by ``goal`` or less, at most
    ``most``, near the end WAITED times as many; and on until they leave ``solved`` of
    the equations (:func:`~jaxhb.balance.sizes.relative_residual`), if ``most`` more of
    them lead there.

    The first sweep corrects and closes nothing: it forgets what the start has of no
    motion of the train.
    """
    equation = sweeps.equation

    def one(carry):
        count, point, _, before, (_, last_but_one, last), _ = carry
        following, deflection, missed = _sweep(sweeps, point, plan)
        linear = jnp.where(count == 0, point.linear, following.linear)
        change = force_size(equation, deflection - before) / vibration_size(
            equation, before
        )
        point = SweepPoint(linear, following.state, following.force)
        changes = last_but_one, last, change
        return (
            count + 1,
            point,
            before,
            deflection,
            changes,
            relative_residual(equation, missed),
        )

    def unsettled(carry):
        count, _, _, _, (before_last, _, change), error = carry
        away = change * changes_to_come(change, before_last) > goal
        promising = error * (change / before_last) ** (most / 2) <= solved
        wanted = (error > solved) & (away | promising)
        allowed = jnp.where(change < NEAR, WAITED * most, most)
        return (count < FEWEST_SWEEPS) | (
            (count < allowed) & wanted & jnp.isfinite(change)
        )

    none_yet = (jnp.array(jnp.inf),) * 3
    begin = (
        jnp.array(0),
        point,
        equation.linear,
        equation.linear,
        none_yet,
        jnp.array(jnp.inf),
    )
    count, point, before, deflection, changes, _ = lax.while_loop(unsettled, one, begin)
    before_last, _, change = changes
    to_come = jnp.minimum(changes_to_come(change, before_last), UNSETTLED)
    return Settled(
        point,
        deflection,
        count,
        change,
        to_come * (deflection - before),
        to_come * change,
    )


def visited(sweeps: SweepEquation, point: SweepPoint, plan: SweepPlan, cycles: int):
    """The points at which so many cycles begin that are marched from a point one after
    another, uncorrected: states ``(cycles, 2m)`` and forces ``(cycles, G)``, and how
    far each cycle misses its beginning, as meshes see it, m.
    """

    def march(point, _):
        end, _ = marched(sweeps, point, plan)
        missed = sweeps.modes.deflections * complex_modes(end.state - point.state)
        return end, (point.state, point.force, jnp.linalg.norm(missed))

    return lax.scan(march, point, None, length=cycles)[1]


settle_program = Program(settle, static_argnames="plan")
equation_program = Program(sweep_equation, static_argnames="plan")
sweep_program = Program(sweep, static_argnames="plan")
marched_program = Program(marched, static_argnames="plan")
visited_program = Program(visited, static_argnames=("plan", "cycles"))
