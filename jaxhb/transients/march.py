"""March of a transient through blocks of steps.

The loads of a block are made at once, by products over all its half steps: harmonics of
the turning angle times the torques of the momentary speed. What is left to the steps
one after another is the propagation of the states and the force of the teeth, by
Krogstad's scheme (:mod:`jaxhb.integration.step`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

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
# Harmonics up to which powers are made by products, a line of the program each
MOST_POWERS = 64


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
    """Steps of blocks ``(B, STEPS, ...)``, each at its end: states ``(n,)``, loads
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


@Program
def march(
    marching: Marching, begin: Instant, blocks: Blocks
) -> tuple[Instant, Marched]:
    """March from an instant through blocks: the instant at the end, and the
    :class:`Marched`.
    """
    marching, begin, blocks = jax.tree.map(jnp.asarray, (marching, begin, blocks))

    def block(instant: Instant, one_block: Blocks) -> tuple[Instant, Marched]:
        return _block(marching, instant, one_block)

    # Backwards a block is marched again, so that its steps are not kept.
    return lax.scan(jax.checkpoint(block), begin, blocks)


def _turning(angle: Array, harmonics: int) -> Array:
    """Powers 0 to N ``(n, N+1)`` of exp(i angle), angle ``(n,)`` rad."""
    if harmonics > MOST_POWERS:
        return jnp.exp(1j * angle[:, None] * np.arange(harmonics + 1))
    turn = jnp.exp(1j * angle)
    powers = [jnp.ones_like(turn), turn]
    while len(powers) <= harmonics:
        half = len(powers) // 2
        powers.append(powers[half] * powers[len(powers) - half])
    return jnp.stack(powers[: harmonics + 1], axis=1)


def _values(turning: Array, coefficients: Array) -> Array:
    """Values ``(n, D)`` of coefficients ``(D, N+1)`` at angles ``(n,)``."""
    counts = np.where(np.arange(coefficients.shape[1]) > 0, 2.0, 1.0)
    turned = counts * coefficients
    turning = turning[:, : coefficients.shape[1]]
    return turning.real @ turned.real.T - turning.imag @ turned.imag.T


def _torques(
    marching: Marching, block: Blocks, turning: Array, acceleration: Array
) -> Array:
    """Torques ``(n, D)`` N m of the excited disks at the half steps of a block."""
    table = marching.torques
    seconds = block.begin + SHARES * block.duration
    at_lines = jnp.exp(2j * jnp.pi * seconds[:, None] * table.hz)
    turning = jnp.concatenate([turning[:, : table.highest + 1], at_lines], axis=1)
    omega = block.speeds(SHARES)
    panel = panel_of(table.omega, omega[STEPS])
    powers = powers_in_panel(table.omega, panel, omega)

    def at_times(harmonics: Array) -> Array:
        # The torques of a panel are parabolas over the speed, those that balance the
        # acceleration are constant: at free speed there are none.
        constant, linear, square = parabola(*harmonics[block.mode, panel])
        constant = constant + acceleration[STEPS] * table.accelerating
        values = _values(turning, jnp.concatenate([constant, linear, square]))
        return jnp.einsum("tkd,tk->td", values.reshape(len(powers), 3, -1), powers)

    factor: Array = jnp.ones(1)
    if marching.disturbance is not None:
        factor = marching.disturbance.fuel(seconds)
    return fuelled(table, at_times, factor[:, None])


def _errors(errors: Errors, turning: Array, rate: Array) -> tuple[Array, Array]:
    """Transmission errors ``(n, R)`` m and their rates ``(n, R)`` m/s, as the cycle
    turns at ``rate`` ``(n,)`` rad/s.
    """
    harmonic = np.arange(errors.coefficients.shape[1])
    error = _values(turning, errors.coefficients)
    by_angle = _values(turning, 1j * harmonic * errors.coefficients)
    return error, by_angle * rate[:, None]


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
    """Values ``(STEPS, ...)`` at begin, middle and end of the steps, of those at half
    steps.
    """
    return values[:-1:2], values[1::2], values[2::2]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _HalfSteps:
    """Numbers at the half steps of a block, ``(2 STEPS + 1, ...)``: loads ``(C,)``,
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
        acceleration[:, None],
    ]
    if marching.disturbance is not None:
        seconds = block.begin + SHARES * block.duration
        loads.append(marching.disturbance.torque(seconds, block.angles(SHARES)))
    shift = None
    variation = None
    if marching.errors is not None:
        errors = marching.errors
        rate = block.speeds(SHARES) / marching.revolutions
        error, error_rate = _errors(errors, turning, rate)
        loads.append(error * errors.stiffness + error_rate * errors.viscous)
        others = marching.springs + marching.clutches
        springs_at_rest = jnp.zeros((len(SHARES), others))
        shift = jnp.concatenate(
            [
                error[:, errors.places],
                springs_at_rest,
                error_rate[:, errors.places],
                springs_at_rest,
            ],
            axis=1,
        )
    if marching.variation is not None:
        variation = _values(turning, marching.variation)
    springs = None
    if marching.varying is not None:
        springs = jnp.concatenate(marching.varying.at(block.speeds(SHARES)), axis=1)
    capacity = None
    if marching.slipping is not None and marching.disturbance is not None:
        seconds = block.begin + SHARES * block.duration
        torque = marching.disturbance.capacity(seconds)
        capacity = torque / marching.slipping.radius
    every_load = jnp.concatenate(loads, axis=1)
    return _HalfSteps(every_load, shift, variation, springs, capacity)


def _teeth(marching: Marching, state: Array, half_steps: _HalfSteps) -> Array:
    """Deflections and rates ``(2G,)`` of the meshes at the begin of a block."""
    teeth = marching.observation @ state
    return teeth if half_steps.shift is None else teeth - half_steps.shift[0]


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
        numbers = half_steps.capacity[0], *_of_clutches(marching, w)
        slip = marching.slipping.slip(numbers[0], slip, *numbers[1:])
        carried = marching.slipping.force(numbers[0], slip, *numbers[1:])
    loads = _kept_loads(marching, half_steps.loads[0])
    teeth = jnp.concatenate([w, carried])
    marched = Marched(state[None, None], loads[None, None], teeth[None, None])
    return Instant(state, slip), marched


def _of_clutches(marching: Marching, w: Array) -> tuple[Array, Array]:
    """Deflections m and rates m/s ``(C,)`` of the clutches."""
    deflection, rate = jnp.split(w, 2)
    first = len(w) // 2 - marching.clutches
    return deflection[first:], rate[first:]


def _kept_loads(marching: Marching, loads: Array) -> Array:
    """Loads ``(..., C)`` where they are part of the result, else ``(..., 0)``."""
    return loads if marching.keeps_loads else loads[..., :0]


def _block(
    marching: Marching, instant: Instant, block: Blocks
) -> tuple[Instant, Marched]:
    """The instant after a block and its :class:`Marched`."""
    half_steps = _half_steps(marching, block)
    of_steps = jnp.concatenate(_at_steps(half_steps.loads), axis=1)
    weights = jax.tree.map(lambda values: values[block.kind], marching.weights)
    middle = of_steps @ weights.load_middle
    end = of_steps @ weights.load_next
    variation = None
    if half_steps.shift is not None:
        _, shift_middle, shift_end = _at_steps(half_steps.shift)
        middle = middle - shift_middle
        end = end - shift_end
    if half_steps.variation is not None:
        variation = jnp.stack(_at_steps(half_steps.variation), axis=1)
    springs = None
    if half_steps.springs is not None:
        springs = jnp.stack(_at_steps(half_steps.springs), axis=1)
    capacity = None
    if half_steps.capacity is not None:
        capacity = jnp.stack(_at_steps(half_steps.capacity), axis=1)
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
    loads = _kept_loads(marching, half_steps.loads[2::2])
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
