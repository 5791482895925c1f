"""March of a transient through blocks of steps.

The loads of a block are made at once, by products over all its half steps: harmonics of
the turning angle times the torques of the momentary speed. What is left to the steps
one after another is the propagation of the states and the force of the teeth, by
Krogstad's scheme (:mod:`jaxhb.integration.step`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, namespace
from jaxhb._program import Program
from jaxhb.equations import backlash
from jaxhb.equations.backlash import Law
from jaxhb.equations.state_space import propagated
from jaxhb.transients.events import Disturbance
from jaxhb.transients.timeline import INSIDE, STEPS, Blocks
from jaxhb.transients.torques import (
    TorqueTable,
    fuelled,
    panel_of,
    parabola,
    powers_in_panel,
)
from jaxhb.transients.weights import StepWeights

# Half steps of a block as shares of its time
SHARES = np.clip(np.arange(2 * STEPS + 1) / (2 * STEPS), INSIDE, 1 - INSIDE)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Errors:
    """Transmission errors of R meshes: coefficients ``(R, K+1)`` m over the cycle,
    stiffness N/m and viscous N s/m ``(R,)``; places : of the meshes with a law among
    them.
    """

    coefficients: Array
    stiffness: Array
    viscous: Array
    places: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Varying:
    """Stiffness and damping of V springs over the speed, less those that the linear
    train has, in P panels with borders omega ``(P, 2)`` rad/s: stiffness N/m and
    viscous N s/m ``(P, 3, V)`` at begin, middle and end.
    """

    omega: Array
    stiffness: Array
    viscous: Array

    def at(self, omega: Array) -> tuple[Array, Array]:
        """Stiffness and viscous ``(n, V)`` at speeds ``(n,)`` rad/s."""
        xp = namespace(self, omega)
        panel = panel_of(self.omega, omega)
        powers = powers_in_panel(self.omega, panel, omega)

        def values(nodes: Array) -> Array:
            coefficients = parabola(nodes[:, 0], nodes[:, 1], nodes[:, 2])
            chosen = xp.stack(coefficients, axis=1)[panel]
            return (powers[..., None] * chosen).sum(axis=-2)

        return values(self.stiffness), values(self.viscous)

    def of(self, springs: np.ndarray) -> Varying:
        """Some of the springs, by their places."""
        return replace(
            self,
            stiffness=self.stiffness[..., springs],
            viscous=self.viscous[..., springs],
        )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Slipping:
    """C shafts with clutches, each stiffness k N/m, viscous r N s/m and radius m at its
    first end, ``(C,)``.

    A clutch carries ``k (l - s) + r l'`` as long as that is within its capacity; beyond
    it carries its capacity and slips: s follows l so that ``k (l - s)`` is that force.
    """

    stiffness: Array
    viscous: Array
    radius: Array

    def force(self, capacity: Array, slip: Array, l: Array, rate: Array) -> Array:
        """Force ``(C,)`` N that clutches carry, of a capacity ``(C,)`` N."""
        sticking = self.stiffness * (l - slip) + self.viscous * rate
        return jnp.clip(sticking, -capacity, capacity)

    def slip(self, capacity: Array, slip: Array, l: Array, rate: Array) -> Array:
        """Slip ``(C,)`` m afterwards."""
        sticking = self.stiffness * (l - slip) + self.viscous * rate
        slips = jnp.abs(sticking) > capacity
        limit = jnp.where(slips, capacity, 0.0)
        return jnp.where(slips, l - jnp.sign(sticking) * limit / self.stiffness, slip)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Marching:
    """All that the blocks of a transient share.

    weights : by the lengths of the steps, ``(K, ...)``; observation ``(2 (G + V), n)``
    of G meshes that have a law and V springs that vary with the speed; law, viscous,
    contact_damping : of the meshes; variation ``(G, H+1)``: coefficients of their
    stiffness over the cycle, over its mean, less 1, or None; errors : or None; varying
    : the springs, or None; slipping : clutches behind the springs, or None; torques :
    of the excitation; disturbance : events; revolutions : of the reference rotor in a
    cycle; keeps_loads : whether loads are part of the result, as disks follow them at
    once.
    """

    weights: StepWeights
    observation: Array
    law: Law
    viscous: Array
    contact_damping: Array
    variation: Array | None
    errors: Errors | None
    varying: Varying | None
    slipping: Slipping | None
    torques: TorqueTable
    disturbance: Disturbance | None
    revolutions: float = field(metadata={"static": True})
    keeps_loads: bool = field(metadata={"static": True})

    @property
    def springs(self) -> int:
        """Number V of springs that vary with the speed."""
        return 0 if self.varying is None else self.varying.stiffness.shape[-1]

    @property
    def clutches(self) -> int:
        """Number C of clutches."""
        return 0 if self.slipping is None else len(self.slipping.stiffness)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Marched:
    """Some steps of blocks ``(B, steps, ...)``, each at its end: states ``(n,)``, loads
    ``(C,)`` or none; teeth : deflections and rates of meshes, springs and clutches, and
    forces of clutches in N.
    """

    state: Array
    loads: Array
    teeth: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Instant:
    """State ``(n,)`` of a march, and slip ``(C,)`` m of its clutches."""

    state: Array
    slip: Array


@partial(Program, static_argnames="stride")
def march(
    marching: Marching, begin: Instant, blocks: Blocks, stride: int = 1
) -> tuple[Instant, Marched]:
    """March from an instant through blocks: the instant at the end, and the
    :class:`Marched` of every ``stride``-th step.
    """
    marching, begin, blocks = jax.tree.map(jnp.asarray, (marching, begin, blocks))

    def block(instant: Instant, one_block: Blocks) -> tuple[Instant, Marched]:
        after, marched = _block(marching, instant, one_block)
        return after, jax.tree.map(lambda rows: rows[stride - 1 :: stride], marched)

    # Backwards a block is marched again, so that its steps are not kept.
    return lax.scan(jax.checkpoint(block), begin, blocks)


def _turning(angle: Array, harmonics: int) -> Array:
    """Real and imaginary part ``(2, N+1, n)`` of the powers 0 to N of exp(i angle),
    angle ``(n,)`` rad.
    """
    turn = jnp.exp(1j * angle)
    powers = jnp.stack([jnp.ones_like(turn), turn])
    while len(powers) <= harmonics:
        # Without barriers every power is computed from the first one anew.
        powers = lax.optimization_barrier(powers)
        powers = jnp.concatenate([powers, powers * (powers[-1] * turn)])
    return lax.optimization_barrier(_parts(powers[: harmonics + 1]))


def _parts(numbers: Array) -> Array:
    """Real and imaginary part ``(2, ...)`` of complex numbers."""
    return jnp.stack([numbers.real, numbers.imag])


def _real(coefficients: Array) -> Array:
    """Weights ``(..., D, 2 (N+1))`` of the rows of :func:`_turning` in the values of
    coefficients ``(..., D, N+1)``.
    """
    counts = np.where(np.arange(coefficients.shape[-1]) > 0, 2.0, 1.0)
    turned = counts * coefficients
    return jnp.concatenate([turned.real, -turned.imag], axis=-1)


def _values(turning: Array, coefficients: Array) -> Array:
    """Values ``(D, n)`` of coefficients ``(D, N+1)`` at angles ``(n,)``, by their
    :func:`_turning`.
    """
    turning = turning[:, : coefficients.shape[1]]
    return _real(coefficients) @ turning.reshape(-1, turning.shape[2])


def _torques(
    marching: Marching, block: Blocks, turning: Array, acceleration: Array
) -> Array:
    """Torques ``(D, n)`` N m of the excited disks at the half steps of a block."""
    table = marching.torques
    seconds = block.begin + SHARES * block.duration
    turning = turning[:, : table.highest + 1]
    if len(table.hz):
        at_lines = jnp.exp(2j * jnp.pi * seconds * table.hz[:, None])
        turning = jnp.concatenate([turning, _parts(at_lines)], axis=1)
    omega = block.speeds(SHARES)
    panel = panel_of(table.omega, omega[STEPS])
    powers = powers_in_panel(table.omega, panel, omega).T

    def at_times(harmonics: Array) -> Array:
        # The torques of a panel are parabolas over the speed, those that balance the
        # acceleration are constant: at free speed there are none.
        nodes = _real(harmonics[block.mode, panel])
        constant, linear, square = parabola(nodes[0], nodes[1], nodes[2])
        constant = constant + acceleration[STEPS] * _real(table.accelerating)
        over_speed = jnp.concatenate([constant, linear, square])
        values = over_speed @ turning.reshape(-1, turning.shape[2])
        constant, linear, square = jnp.split(values, 3)
        return constant + powers[1] * linear + powers[2] * square

    factor: Array = jnp.ones(1)
    if marching.disturbance is not None:
        factor = marching.disturbance.fuel(seconds)
    return fuelled(table, at_times, factor)


def _errors(errors: Errors, turning: Array, rate: Array) -> tuple[Array, Array]:
    """Transmission errors ``(R, n)`` m and their rates ``(R, n)`` m/s, as the cycle
    turns at ``rate`` ``(n,)`` rad/s.
    """
    harmonic = np.arange(errors.coefficients.shape[1])
    error = _values(turning, errors.coefficients)
    by_angle = _values(turning, 1j * harmonic * errors.coefficients)
    return error, by_angle * rate


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Steps:
    """Numbers of the steps of a block, ``(STEPS, ...)``: what loads add to the state
    ``(n,)`` and to w ``(2 (G + V),)`` in the middle and at the end; stiffness over its
    mean, less 1, ``(3, G)`` at begin, middle and end, None where it is constant; and
    those of springs that vary with the speed ``(3, 2V)``, and the capacity of clutches
    ``(3, C)`` N.
    """

    state: Array
    middle: Array
    end: Array
    variation: Array | None
    springs: Array | None
    capacity: Array | None


def _at_steps(values: Array) -> tuple[Array, Array, Array]:
    """Values ``(..., STEPS)`` at begin, middle and end of the steps, of those at half
    steps.
    """
    return values[:, :-1:2], values[:, 1::2], values[:, 2::2]


def _of_steps(values: Array) -> Array:
    """The same ``(STEPS, 3, ...)``, steps first."""
    return jnp.stack(_at_steps(values)).transpose(2, 0, 1)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _HalfSteps:
    """Numbers at the half steps of a block, ``(..., 2 STEPS + 1)``: loads ``(C,)``,
    transmission errors and their rates ``(2 (G + V),)`` of the meshes that have a law,
    their stiffness over its mean, less 1, ``(G,)``, and stiffness and damping of the
    springs that vary with the speed ``(2V,)``; None where there are none; capacity
    ``(C,)`` N of clutches.
    """

    loads: Array
    shift: Array | None
    variation: Array | None
    springs: Array | None
    capacity: Array | None


def _half_steps(marching: Marching, block: Blocks) -> _HalfSteps:
    """The :class:`_HalfSteps` of a block."""
    angle = block.angles(SHARES) / marching.revolutions
    acceleration = block.accelerations(SHARES)
    highest = [marching.torques.highest]
    if marching.variation is not None:
        highest.append(marching.variation.shape[-1] - 1)
    if marching.errors is not None:
        highest.append(marching.errors.coefficients.shape[-1] - 1)
    turning = _turning(angle, max(highest))
    loads = [
        _torques(marching, block, turning, acceleration),
        acceleration[None],
    ]
    if marching.disturbance is not None:
        seconds = block.begin + SHARES * block.duration
        loads.append(marching.disturbance.torque(seconds, block.angles(SHARES)).T)
    shift = None
    variation = None
    if marching.errors is not None:
        errors = marching.errors
        rate = block.speeds(SHARES) / marching.revolutions
        error, error_rate = _errors(errors, turning, rate)
        stiffness = errors.stiffness[:, None]
        loads.append(error * stiffness + error_rate * errors.viscous[:, None])
        without_error = marching.springs + marching.clutches
        at_rest = jnp.zeros((without_error, len(SHARES)))
        shift = jnp.concatenate(
            [error[errors.places], at_rest, error_rate[errors.places], at_rest]
        )
    if marching.variation is not None:
        variation = _values(turning, marching.variation)
    springs = None
    if marching.varying is not None:
        over_time = marching.varying.at(block.speeds(SHARES))
        springs = jnp.concatenate(over_time, axis=1).T
    capacity = None
    if marching.slipping is not None and marching.disturbance is not None:
        seconds = block.begin + SHARES * block.duration
        torque = marching.disturbance.capacity(seconds)
        capacity = (torque / marching.slipping.radius).T
    return _HalfSteps(jnp.concatenate(loads), shift, variation, springs, capacity)


def _teeth(marching: Marching, state: Array, half_steps: _HalfSteps) -> Array:
    """Deflections and rates ``(2G,)`` of the meshes at the begin of a block."""
    teeth = marching.observation @ state
    return teeth if half_steps.shift is None else teeth - half_steps.shift[:, 0]


@Program
def first_instant(
    marching: Marching, state: Array, block: Blocks
) -> tuple[Instant, Marched]:
    """The instant of a state at the begin of a block, whose clutches have slipped where
    they do not carry it, and its :class:`Marched`.
    """
    marching, state, block = jax.tree.map(jnp.asarray, (marching, state, block))
    half_steps = _half_steps(marching, block)
    w = _teeth(marching, state, half_steps)
    slip: Array = jnp.zeros(marching.clutches)
    carried = slip
    if marching.slipping is not None and half_steps.capacity is not None:
        numbers = half_steps.capacity[:, 0], *_of_clutches(marching, w)
        slip = marching.slipping.slip(numbers[0], slip, *numbers[1:])
        carried = marching.slipping.force(numbers[0], slip, *numbers[1:])
    loads = _recorded_loads(marching, half_steps.loads[:, 0])
    teeth = jnp.concatenate([w, carried])
    marched = Marched(state[None, None], loads[None, None], teeth[None, None])
    return Instant(state, slip), marched


def _of_clutches(marching: Marching, w: Array) -> tuple[Array, Array]:
    """Deflections m and rates m/s ``(C,)`` of the clutches."""
    deflection, rate = jnp.split(w, 2)
    first = len(w) // 2 - marching.clutches
    return deflection[first:], rate[first:]


def _recorded_loads(marching: Marching, loads: Array) -> Array:
    """Loads ``(..., C)`` where they are part of the result, else ``(..., 0)``."""
    return loads if marching.keeps_loads else loads[..., :0]


def _block(
    marching: Marching, instant: Instant, block: Blocks
) -> tuple[Instant, Marched]:
    """The instant after a block and its :class:`Marched`."""
    half_steps = _half_steps(marching, block)
    of_steps = jnp.concatenate(_at_steps(half_steps.loads)).T
    weights = jax.tree.map(lambda values: values[block.kind], marching.weights)
    middle = of_steps @ weights.load_middle
    end = of_steps @ weights.load_next
    variation = None
    if half_steps.shift is not None:
        _, shift_middle, shift_end = _at_steps(half_steps.shift)
        middle = middle - shift_middle.T
        end = end - shift_end.T
    if half_steps.variation is not None:
        variation = _of_steps(half_steps.variation)
    springs = None
    if half_steps.springs is not None:
        springs = _of_steps(half_steps.springs)
    capacity = None
    if half_steps.capacity is not None:
        capacity = _of_steps(half_steps.capacity)
    steps = _Steps(
        of_steps @ weights.load_state, middle, end, variation, springs, capacity
    )

    def step(
        carry: tuple[Instant, Array], numbers: _Steps
    ) -> tuple[tuple[Instant, Array], tuple[Array, Array]]:
        instant, w = carry
        state, w = _step(marching, weights, instant, w, numbers)
        slip = instant.slip
        carried: Array = jnp.zeros(0)
        if marching.slipping is not None and numbers.capacity is not None:
            motion = _of_clutches(marching, w)
            slip = marching.slipping.slip(numbers.capacity[-1], slip, *motion)
            carried = marching.slipping.force(numbers.capacity[-1], slip, *motion)
        after = Instant(state, slip), w
        return after, (state, jnp.concatenate([w, carried]))

    begin = instant, _teeth(marching, instant.state, half_steps)
    (instant, _), (states, teeth) = lax.scan(step, begin, steps)
    loads = _recorded_loads(marching, half_steps.loads[:, 2::2].T)
    return instant, Marched(states, loads, teeth)


def _step(
    marching: Marching,
    weights: StepWeights,
    instant: Instant,
    w: Array,
    numbers: _Steps,
) -> tuple[Array, Array]:
    """State and w after a step: Krogstad's stages at its begin, twice in its middle
    and at its end.
    """
    state = instant.state
    linear_end, linear_middle = jnp.split(weights.ahead @ state, 2)
    linear_end = linear_end + numbers.end
    linear_middle = linear_middle + numbers.middle
    next_state = propagated(weights.propagator, state) + numbers.state
    if not len(w):
        return next_state, linear_end
    meshes = len(marching.viscous)

    def force(moment: int, w: Array) -> Array:
        law = marching.law
        if numbers.variation is not None:
            law = backlash.at_instant(law, numbers.variation[moment])
        deflection, rate = jnp.split(w, 2)
        of_meshes = backlash.nonlinear_force(
            law,
            marching.viscous,
            marching.contact_damping,
            deflection[:meshes],
            rate[:meshes],
        )
        forces = [of_meshes]
        if numbers.springs is not None:
            springs = slice(meshes, meshes + marching.springs)
            stiffness, viscous = jnp.split(numbers.springs[moment], 2)
            forces.append(stiffness * deflection[springs] + viscous * rate[springs])
        if marching.slipping is not None and numbers.capacity is not None:
            slipping = marching.slipping
            l, l_rate = _of_clutches(marching, w)
            carried = slipping.force(numbers.capacity[moment], instant.slip, l, l_rate)
            linear = slipping.stiffness * l + slipping.viscous * l_rate
            forces.append(carried - linear)
        return jnp.concatenate(forces)

    begin = force(0, w)
    middle = force(1, linear_middle + weights.first @ begin)
    middle_again = force(
        1, linear_middle + weights.second @ jnp.concatenate([begin, middle])
    )
    last = force(2, linear_end + weights.third @ jnp.concatenate([begin, middle_again]))
    change = weights.end @ jnp.concatenate([begin, middle + middle_again, last])
    return next_state + change[: len(state)], linear_end + change[len(state) :]
