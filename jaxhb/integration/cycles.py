"""Marches through cycles, each reduced to a few numbers per quantity before the next
one begins.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._program import Program
from jaxhb.equations import backlash, fourier
from jaxhb.integration.batch import SAMPLES
from jaxhb.integration.step import run

CYCLES = 8  # that a program marches at a time, at most
HARMONICS = 256  # of the cycle, of which amplitudes are kept at most
# Steps between the samples of shafts and disks, which follow the teeth with fewer than
# these
STRIDE = 2


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Outputs:
    """Quantities that are linear in the motion, and gear torques.

    modal ``(Q, 2m)`` of the deviation from the linear train, which adds linear ``(Q,
    steps / stride)``: disks and shafts; mesh_modal ``(2R, 2m)`` and mesh_linear ``(2R,
    steps)``: deflections and forces of the R meshes without backlash; sums ``(P, R +
    G)``: gear torques as sums of the forces of these and of the others; beside ``(Q',
    G)``, torques of the last Q' quantities per force that acts beside a shaft, None
    without such.
    """

    modal: jax.Array
    linear: jax.Array
    mesh_modal: jax.Array
    mesh_linear: jax.Array
    sums: jax.Array
    beside: jax.Array | None = None


def cut(outputs, by_speed, shared):
    """What tells of each array of Outputs of several speeds whether it is cut
    ``by_speed``; None of None.
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


def of_speed(outputs, index):
    """The Outputs of one of several speeds; None of None."""
    return outputs and replace(
        outputs, linear=outputs.linear[index], mesh_linear=outputs.mesh_linear[index]
    )


def outputs_of(modes, system, shafts, linear_meshes, sums, linear_motion, steps):
    """The :class:`Outputs` of a train, on the host: ``shafts`` links are shafts or
    dampers, ``linear_meshes`` meshes without backlash, ``sums`` radius and sense ``(P,
    R + G)`` m with which forces act on gears, and on shafts.
    """
    speed = fourier.derivative(
        linear_motion.displacement, linear_motion.frequency[:, None, None]
    )
    motion = np.concatenate([linear_motion.displacement, speed], axis=1)
    parts = []
    for rows, samples in zip(
        _rows(system, shafts, linear_meshes), (steps // STRIDE, steps), strict=True
    ):
        modal = rows @ modes.motion
        parts += [
            np.concatenate([modal.real, -modal.imag], axis=1),
            fourier.synthesize(rows @ motion, samples),
        ]
    return Outputs(*parts, *sums)


def _rows(system, shafts, linear_meshes):
    """What quantities take of (x, x'), two arrays ``(Q, 2S)``: of angles, their rates,
    twists, their rates and torques, and of deflections and forces of meshes.
    """
    radius = np.asarray(system.radius)
    bend = system.incidence().T
    ends = radius[system.tree.end_a][:, None]
    # A loss factor turns the spring force by its angle: of the analytic signal, whose
    # real part is taken, a product with 1 + i eta.
    elastic = np.asarray(system.stiffness) * (
        1 + 1j * np.asarray(system.loss)
    )  # of what turns with positive frequency
    spring, damper = (np.asarray(a)[:, None] * bend for a in (elastic, system.viscous))
    angle = np.eye(len(radius)) / radius[:, None]
    first = slice(None, shafts)
    mesh = np.asarray(linear_meshes, int)
    none = 0 * angle
    twist = (bend / ends)[first]
    still = 0 * bend[first]
    shaft = (
        [angle, none, twist, still, (spring * ends)[first]],
        [none, angle, still, twist, (damper * ends)[first]],
    )
    teeth = [bend[mesh], spring[mesh]], [0 * bend[mesh], damper[mesh]]
    return [
        np.concatenate([np.concatenate(x), np.concatenate(v)], axis=1)
        for x, v in (shaft, teeth)
    ]


@Program
def march(stepper, state, cycles, outputs):
    """Some cycles of one speed, CYCLES at most, one program for any number of them;
    with ``outputs``, not None, each is reduced to numbers.

    Gives state ``(2m,)``; samples ``(CYCLES, SAMPLES, 2G)``, (l, l') at equidistant
    time samples of each cycle, then zeros; trace ``(steps + 1, 2G)``, (l, l') of the
    last cycle; numbers, a dict of each cycle, ``(CYCLES, quantities)`` max, min, mean,
    square (mean of squares), and ``(CYCLES, G)`` of the backlash meshes above, below
    (shares of the cycle beyond the gap on either side), impacts (entries into contact),
    hardest (approach speed of the hardest, m/s); power ``(quantities, H+1)``, sum over
    the cycles of |x^n|^2.

    The quantities are angles and rates of the disks, twists, their rates and torques of
    shafts and dampers, deflections and forces of meshes without backlash, deflections,
    elastic and transmitted forces of the others, transmitted and elastic gear torques.
    """
    stepper, outputs = jax.tree.map(jnp.asarray, (stepper, outputs))

    def keep(kept, k, *values):
        return tuple(
            lax.dynamic_update_index_in_dim(a, value, k, axis=0)
            for a, value in zip(kept, values, strict=False)
        )

    def one_cycle(state):
        widths = (stepper.linear.shape[1], *(() if outputs is None else (len(state),)))
        kept = tuple(jnp.zeros((stepper.steps + 1, width)) for width in widths)
        state, w, kept = run(stepper, state, 0, stepper.steps, keep, kept, even=True)
        kept = keep(kept, stepper.steps, w, state)
        return (
            state,
            kept[0],
            *(
                (None, None)
                if outputs is None
                else _statistics(stepper, outputs, *kept)
            ),
        )

    def another(i, carry):
        state, rows, _, power = carry
        state, trace, numbers, own = one_cycle(state)
        row = trace[: -1 : stepper.steps // SAMPLES], numbers
        rows = jax.tree.map(
            lambda a, b: lax.dynamic_update_index_in_dim(a, b, i, axis=0), rows, row
        )
        return state, rows, trace, jax.tree.map(jnp.add, power, own)

    _, trace, numbers, power = jax.eval_shape(one_cycle, state)
    row = jax.ShapeDtypeStruct((SAMPLES, *trace.shape[1:]), trace.dtype), numbers
    rows = jax.tree.map(lambda a: jnp.zeros((CYCLES, *a.shape), a.dtype), row)
    empty, none = (
        jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), tree)
        for tree in (trace, power)
    )
    state, (samples, numbers), trace, power = lax.fori_loop(
        0, cycles, another, (state, rows, empty, none)
    )
    return state, samples, trace, numbers, power


@Program
def march_side_by_side(stepper, state, cycles, outputs):
    """:func:`march` of several speeds, of which stepper, state and part of the outputs
    have a leading axis.
    """

    def one(stepper, state, outputs):
        return march(stepper, state, cycles, outputs)

    return jax.vmap(one, in_axes=(0, 0, cut(outputs, 0, None)))(stepper, state, outputs)


def harmonics_of(steps):
    """Harmonics whose amplitudes are kept."""
    return min(HARMONICS, steps // STRIDE // 2)


def _statistics(stepper, outputs, w, states):
    """Numbers and power of one cycle: w ``(steps + 1, 2G)``, states ``(steps + 1,
    2m)``.
    """
    # Samples are whole steps apart, and the last is the first again.
    law, viscous, contact_damping = backlash.at_samples(
        stepper, lambda rows: _closed(rows[::2].T)
    )
    deflection, rate = jnp.split(w.T, 2)
    elastic = backlash.force(law, deflection)
    total = backlash.mesh_force(law, viscous, contact_damping, deflection, rate)
    straight = outputs.mesh_modal @ states.T + _closed(outputs.mesh_linear)
    held = jnp.split(straight, 2)[1]
    gears = [
        outputs.sums @ jnp.concatenate([held, forces]) for forces in (total, elastic)
    ]
    shafts = outputs.modal @ states[::STRIDE].T + _closed(outputs.linear)
    if outputs.beside is not None:
        extra = (
            outputs.beside @ (total - law.linear_stiffness * deflection)[:, ::STRIDE]
        )
        shafts = shafts.at[-len(extra) :].add(extra)
    teeth = jnp.concatenate([straight, deflection, elastic, total, *gears])
    parts = [
        _numbers(values, harmonics_of(stepper.steps)) for values in (shafts, teeth)
    ]
    numbers, power = jax.tree.map(lambda *a: jnp.concatenate(a), *parts)
    return numbers | _contacts(law, deflection, rate), power


def _closed(values):
    """Samples ``(Q, samples + 1)`` of a cycle, the first of which comes again at its
    end.
    """
    return jnp.concatenate([values, values[:, :1]], axis=1)


def _numbers(values, harmonics):
    """Those of one cycle, from ``(Q, samples + 1)``."""
    spectrum = fourier.analyze(values[:, :-1], harmonics)
    numbers = {
        "max": _highest(values),
        "min": -_highest(-values),
        "mean": values[:, :-1].mean(axis=1),
        "square": (values[:, :-1] ** 2).mean(axis=1),
    }
    return numbers, spectrum.real**2 + spectrum.imag**2


def _highest(values):
    """Largest value of each row, on parabolas through neighbouring samples."""
    before = values[:, :-2]
    here = values[:, 1:-1]
    after = values[:, 2:]
    # Largest value between samples: the vertex of the parabola through three of them.
    bend = 2 * here - before - after
    top = here + (after - before) ** 2 / (8 * jnp.where(bend > 0, bend, 1.0))
    peak = (here >= before) & (here >= after) & (bend > 0)
    return jnp.maximum(
        jnp.where(peak, top, here).max(axis=1), jnp.maximum(values[:, 0], values[:, -1])
    )


def _contacts(law, deflection, rate):
    """Contact over one cycle, from (l, l') ``(G, steps + 1)``."""
    distance = jnp.abs(deflection) - law.gap
    entry = (distance[:, :-1] < 0) & (distance[:, 1:] >= 0)
    share = -distance[:, :-1] / jnp.where(
        entry, distance[:, 1:] - distance[:, :-1], 1.0
    )
    speed = jnp.abs((1 - share) * rate[:, :-1] + share * rate[:, 1:])
    return {
        "above": (deflection[:, :-1] >= law.gap).mean(axis=1),
        "below": (deflection[:, :-1] <= -law.gap).mean(axis=1),
        "impacts": entry.sum(axis=1),
        "hardest": jnp.where(entry, speed, 0.0).max(axis=1),
    }
