"""Marches through cycles, each reduced to a few numbers per quantity before the next
one begins.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array
from jaxhb._program import Program
from jaxhb.equations import backlash, fourier
from jaxhb.equations.backlash import Law
from jaxhb.equations.state_space import ComplexModes
from jaxhb.equations.system import System
from jaxhb.integration.batch import SAMPLES, LinearMotion
from jaxhb.integration.step import Stepper, run

CYCLES = 8  # cycles that a program marches at a time, at most
HARMONICS = 256  # harmonics of the cycle whose amplitudes are kept, at most
# Steps between the samples of shafts and disks, which need fewer than the teeth
STRIDE = 2


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Outputs:
    """Matrices that give the quantities linear in the motion, and gear torques.

    Those of disks and shafts: modal ``(Q, 2m)`` times the deviation from the linear
    train, plus linear ``(Q, steps / stride)``; deflections and forces of the R meshes
    without backlash: mesh_modal ``(2R, 2m)`` and mesh_linear ``(2R, steps)`` likewise;
    sums ``(P, R + G)``: gear torques as sums of the forces of these and of the other
    meshes; beside ``(Q', G)``: torques of the last Q' quantities per force that acts
    beside a shaft, None where none does.
    """

    modal: Array
    linear: Array
    mesh_modal: Array
    mesh_linear: Array
    sums: Array
    beside: Array | None = None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class QuantityNumbers:
    """Numbers of Q quantities over each of some cycles, ``(cycles, Q)``; square : mean
    of squares.
    """

    highest: Array
    lowest: Array
    mean: Array
    square: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ContactNumbers:
    """Contact of G backlash meshes over each of some cycles, ``(cycles, G)``: shares of
    the cycle beyond the gap on either side, entries into contact, and approach speed of
    the hardest of them in m/s.
    """

    above: Array
    below: Array
    impacts: Array
    hardest: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CycleNumbers:
    """Numbers to which recorded cycles are reduced."""

    quantities: QuantityNumbers
    contacts: ContactNumbers


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Marched:
    """Some cycles that were marched.

    state ``(2m,)`` at their end; samples ``(CYCLES, SAMPLES, 2G)``, (l, l') at
    equidistant time samples of each cycle, then zeros; trace ``(steps + 1, 2G)``,
    (l, l') of the last cycle; of recorded cycles, else None: numbers of CYCLES, then
    zeros, and power ``(Q, H+1)``, the sum of |x^n|^2 over the cycles.
    """

    state: Array
    samples: Array
    trace: Array
    numbers: CycleNumbers | None
    power: Array | None


# State, samples and numbers of the cycles so far, trace of the last, summed power
MarchCarry = tuple[Array, tuple[Array, CycleNumbers | None], Array, Array | None]


def cut(outputs: Outputs | None, by_speed: Any, shared: Any) -> Outputs | None:
    """Tree of the axes of Outputs of several speeds: ``by_speed`` for arrays that each
    speed has its own row of, ``shared`` for the others; None for None.
    """
    if outputs is None:
        return None
    beside = None if outputs.beside is None else shared
    return Outputs(
        modal=shared,
        linear=by_speed,
        mesh_modal=shared,
        mesh_linear=by_speed,
        sums=shared,
        beside=beside,
    )


def of_speed(outputs: Outputs | None, index: int) -> Outputs | None:
    """The Outputs of one of several speeds; None for None."""
    return outputs and replace(
        outputs, linear=outputs.linear[index], mesh_linear=outputs.mesh_linear[index]
    )


def outputs_of(
    modes: ComplexModes,
    system: System,
    shafts: int,
    linear_meshes: Sequence[int] | np.ndarray,
    sums: tuple[np.ndarray, np.ndarray | None],
    linear_motion: LinearMotion,
    steps: int,
) -> Outputs:
    """The :class:`Outputs` of a train, on the host: ``shafts`` links are shafts or
    dampers, ``linear_meshes`` meshes without backlash, ``sums`` radius and sense ``(P,
    R + G)`` m with which forces act on gears, and ``(Q', G)`` on shafts, or None.
    """
    speed = fourier.derivative(
        linear_motion.displacement, linear_motion.frequency[:, None, None]
    )
    motion = np.concatenate([linear_motion.displacement, speed], axis=1)
    shaft_rows, mesh_rows = _rows(system, shafts, linear_meshes)
    shaft_modes = shaft_rows @ modes.motion
    mesh_modes = mesh_rows @ modes.motion
    gear_sums, beside = sums
    return Outputs(
        modal=np.concatenate([shaft_modes.real, -shaft_modes.imag], axis=1),
        linear=fourier.synthesize(shaft_rows @ motion, steps // STRIDE),
        mesh_modal=np.concatenate([mesh_modes.real, -mesh_modes.imag], axis=1),
        mesh_linear=fourier.synthesize(mesh_rows @ motion, steps),
        sums=gear_sums,
        beside=beside,
    )


def _rows(
    system: System, shafts: int, linear_meshes: Sequence[int] | np.ndarray
) -> list[np.ndarray]:
    """Quantities by (x, x'), two arrays ``(Q, 2S)``: angles, their rates, twists, their
    rates and torques; and deflections and forces of meshes.
    """
    radius = np.asarray(system.radius)
    bend = system.incidence().T
    ends = radius[system.tree.end_a][:, None]
    # A loss factor turns the spring force by its angle: for the analytic signal, which
    # has positive frequencies alone and whose real part is taken, a product with
    # 1 + i eta.
    elastic = np.asarray(system.stiffness) * (1 + 1j * np.asarray(system.loss))
    spring = elastic[:, None] * bend
    damper = np.asarray(system.viscous)[:, None] * bend
    angle = np.eye(len(radius)) / radius[:, None]
    shaft_links = slice(None, shafts)
    mesh_links = np.asarray(linear_meshes, int)
    nothing = 0 * angle
    twist = (bend / ends)[shaft_links]
    no_bend = 0 * bend[shaft_links]
    shaft = (
        [angle, nothing, twist, no_bend, (spring * ends)[shaft_links]],
        [nothing, angle, no_bend, twist, (damper * ends)[shaft_links]],
    )
    teeth = (
        [bend[mesh_links], spring[mesh_links]],
        [0 * bend[mesh_links], damper[mesh_links]],
    )
    return [
        np.concatenate(
            [np.concatenate(by_displacement), np.concatenate(by_velocity)], axis=1
        )
        for by_displacement, by_velocity in (shaft, teeth)
    ]


@Program
def march(
    stepper: Stepper, state: Array, cycles: int | Array, outputs: Outputs | None
) -> Marched:
    """March some cycles at one speed, CYCLES at most, one program for any number of
    them, each reduced to numbers with ``outputs`` (not None): the :class:`Marched`.

    The quantities are angles and rates of the disks, twists, their rates and torques of
    shafts and dampers, deflections and forces of meshes without backlash, deflections,
    elastic and transmitted forces of the others, transmitted and elastic gear torques.
    """
    stepper, outputs = jax.tree.map(jnp.asarray, (stepper, outputs))

    def keep(
        rows: tuple[Array, ...], k: int | Array, *step_values: Array
    ) -> tuple[Array, ...]:
        return tuple(
            lax.dynamic_update_index_in_dim(array, value, k, axis=0)
            for array, value in zip(rows, step_values, strict=False)
        )

    def one_cycle(
        state: Array,
    ) -> tuple[Array, Array, CycleNumbers | None, Array | None]:
        widths = [stepper.linear.shape[1]]
        if outputs is not None:
            widths.append(len(state))
        step_rows: tuple[Array, ...] = tuple(
            jnp.zeros((stepper.steps + 1, width)) for width in widths
        )
        state, w, step_rows = run(
            stepper, state, 0, stepper.steps, keep, step_rows, even=True
        )
        step_rows = keep(step_rows, stepper.steps, w, state)
        if outputs is None:
            return state, step_rows[0], None, None
        numbers, power = _statistics(stepper, outputs, *step_rows)
        return state, step_rows[0], numbers, power

    def next_cycle(index: Array, carry: MarchCarry) -> MarchCarry:
        state, rows, _, power = carry
        state, trace, numbers, cycle_power = one_cycle(state)
        row = trace[: -1 : stepper.steps // SAMPLES], numbers
        rows = jax.tree.map(
            lambda array, new_row: lax.dynamic_update_index_in_dim(
                array, new_row, index, axis=0
            ),
            rows,
            row,
        )
        return state, rows, trace, jax.tree.map(jnp.add, power, cycle_power)

    _, trace, numbers, power = jax.eval_shape(one_cycle, state)
    row = jax.ShapeDtypeStruct((SAMPLES, *trace.shape[1:]), trace.dtype), numbers
    rows = jax.tree.map(lambda leaf: jnp.zeros((CYCLES, *leaf.shape), leaf.dtype), row)
    no_trace, no_power = (
        jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), tree)
        for tree in (trace, power)
    )
    state, (samples, numbers), trace, power = lax.fori_loop(
        0, cycles, next_cycle, (state, rows, no_trace, no_power)
    )
    return Marched(
        state=state, samples=samples, trace=trace, numbers=numbers, power=power
    )


@Program
def march_side_by_side(
    stepper: Stepper, state: Array, cycles: int | Array, outputs: Outputs | None
) -> Marched:
    """:func:`march` at several speeds; stepper, state and part of the outputs have a
    leading axis for them.
    """

    def march_one_speed(
        stepper: Stepper, state: Array, outputs: Outputs | None
    ) -> Marched:
        return march(stepper, state, cycles, outputs)

    return jax.vmap(march_one_speed, in_axes=(0, 0, cut(outputs, 0, None)))(
        stepper, state, outputs
    )


def harmonics_of(steps: int) -> int:
    """Number of harmonics whose amplitudes are kept."""
    return min(HARMONICS, steps // STRIDE // 2)


def _statistics(
    stepper: Stepper, outputs: Outputs, w: Array, states: Array
) -> tuple[CycleNumbers, Array]:
    """Numbers and power of one cycle: w ``(steps + 1, 2G)``, states ``(steps + 1,
    2m)``.
    """
    # Samples are whole steps apart, and the last is the first again.
    law, viscous, contact_damping = backlash.at_samples(
        stepper, lambda rows: _closed(rows[::2].T)
    )
    deflection, rate = jnp.split(w.T, 2)
    elastic = backlash.force(law, deflection)
    transmitted = backlash.mesh_force(law, viscous, contact_damping, deflection, rate)
    linear_meshes = outputs.mesh_modal @ states.T + _closed(outputs.mesh_linear)
    linear_forces = jnp.split(linear_meshes, 2)[1]
    gear_torques = [
        outputs.sums @ jnp.concatenate([linear_forces, forces])
        for forces in (transmitted, elastic)
    ]
    shafts = outputs.modal @ states[::STRIDE].T + _closed(outputs.linear)
    if outputs.beside is not None:
        spring_torques = (
            outputs.beside
            @ (transmitted - law.linear_stiffness * deflection)[:, ::STRIDE]
        )
        shafts = cast(jax.Array, shafts).at[-len(spring_torques) :].add(spring_torques)
    teeth = jnp.concatenate(
        [linear_meshes, deflection, elastic, transmitted, *gear_torques]
    )
    by_samples = [
        _numbers(values, harmonics_of(stepper.capacity)) for values in (shafts, teeth)
    ]
    quantities, power = jax.tree.map(
        lambda *part_leaves: jnp.concatenate(part_leaves), *by_samples
    )
    return CycleNumbers(quantities, _contacts(law, deflection, rate)), power


def _closed(values: Array) -> Array:
    """Samples ``(Q, samples + 1)`` of a cycle, the first one repeated at its end."""
    return jnp.concatenate([values, values[:, :1]], axis=1)


def _numbers(values: Array, harmonics: int) -> tuple[QuantityNumbers, Array]:
    """Numbers ``(Q,)`` and power ``(Q, H+1)`` of samples ``(Q, samples + 1)``."""
    spectrum = fourier.analyze(values[:, :-1], harmonics)
    numbers = QuantityNumbers(
        highest=_highest(values),
        lowest=-_highest(-values),
        mean=values[:, :-1].mean(axis=1),
        square=(values[:, :-1] ** 2).mean(axis=1),
    )
    return numbers, spectrum.real**2 + spectrum.imag**2


def _highest(values: Array) -> Array:
    """Largest value of each row, on parabolas through neighbouring samples."""
    before = values[:, :-2]
    here = values[:, 1:-1]
    after = values[:, 2:]
    # Largest value between samples: the vertex of the parabola through three of them.
    bend = 2 * here - before - after
    vertex = here + (after - before) ** 2 / (8 * jnp.where(bend > 0, bend, 1.0))
    is_peak = (here >= before) & (here >= after) & (bend > 0)
    return jnp.maximum(
        jnp.where(is_peak, vertex, here).max(axis=1),
        jnp.maximum(values[:, 0], values[:, -1]),
    )


def _contacts(law: Law, deflection: Array, rate: Array) -> ContactNumbers:
    """Contact over one cycle, from (l, l') ``(G, steps + 1)``."""
    distance = jnp.abs(deflection) - law.gap
    entry = (distance[:, :-1] < 0) & (distance[:, 1:] >= 0)
    share = -distance[:, :-1] / jnp.where(
        entry, distance[:, 1:] - distance[:, :-1], 1.0
    )
    speed = jnp.abs((1 - share) * rate[:, :-1] + share * rate[:, 1:])
    return ContactNumbers(
        above=(deflection[:, :-1] >= law.gap).mean(axis=1),
        below=(deflection[:, :-1] <= -law.gap).mean(axis=1),
        impacts=entry.sum(axis=1),
        hardest=jnp.where(entry, speed, 0.0).max(axis=1),
    )
