"""What many cycles of a march amount to: each is reduced to a few numbers per quantity before the next one begins."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .._program import Program
from ..harmonic import backlash, fourier
from .lanes import INSTANTS, cycle

HARMONICS = 256
"""Of the cycle, of which amplitudes are kept at most."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Outputs:
    """Quantities that are linear in the motion, and gear torques.

    modal ``(Q, 2m)`` of the deviation from the linear train, which adds linear ``(L, Q, steps)``; sums ``(P, R)``: gear
    torques as sums of the R forces, those of linear meshes (the last of the Q) and then those of the others.
    """

    modal: jax.Array
    linear: jax.Array
    sums: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Reduced:
    """Cycles of quantities: max, min, mean, square (mean of squares) ``(cycles, L, quantities)``, power ``(L,
    quantities, H+1)``: sum over the cycles of |x^n|^2.

    The quantities are those of Outputs, deflections, elastic and transmitted forces of the backlash meshes,
    transmitted and elastic gear torques.
    """

    max: jax.Array
    min: jax.Array
    mean: jax.Array
    square: jax.Array
    power: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Teeth:
    """Contact of the backlash meshes, per cycle ``(cycles, L, G)``: shares of the cycle beyond the gap on either side;
    entries into contact and the approach speed of the hardest in m/s."""

    above: jax.Array
    below: jax.Array
    impacts: jax.Array
    hardest: jax.Array


def outputs_of(modes, system, shafts, linear_meshes, gears, posed, steps):
    """The :class:`Outputs` of a train, on the host.

    Parameters
    ----------
    modes : Modes
    system : System
    shafts : int, number of links that are shafts or dampers
    linear_meshes : int array, links that are meshes without backlash
    gears : array ``(P, R)`` m, radius and sense with which forces act on gears
    posed : Posed
    steps : int, per cycle
    """
    rows = _rows(system, shafts, linear_meshes)
    modal = rows @ modes.motion
    speed = fourier.derivative(posed.displacement, posed.frequency[:, None, None])
    linear = rows @ np.concatenate([posed.displacement, speed], axis=1)
    return Outputs(np.concatenate([modal.real, -modal.imag], axis=1), fourier.synthesize(linear, steps), gears)


def _rows(system, shafts, linear_meshes):
    """What the quantities take of (x, x'), ``(Q, 2S)``: angles, twists, torques, deflections and forces of meshes."""
    disks, radius = len(system.mass), np.asarray(system.radius)
    bend, nothing = system.incidence().T, np.zeros((0, len(system.mass)))
    ends = radius[system.tree.end_a][:, None]
    spring, damper = (np.asarray(a)[:, None] * bend for a in (system.stiffness, system.viscous))
    first, mesh = slice(None, shafts), np.asarray(linear_meshes, int)
    position = [np.eye(disks) / radius[:, None], (bend / ends)[first], (spring * ends)[first], bend[mesh], spring[mesh]]
    speed = [0 * position[0], 0 * position[1], (damper * ends)[first], 0 * bend[mesh], damper[mesh]]
    return np.concatenate([np.concatenate([*position, nothing]), np.concatenate([*speed, nothing])], axis=1)


@Program
def record(lanes, outputs, state, blank):
    """As many cycles as ``blank`` ``(cycles,)`` is long, each reduced to a few numbers.

    Returns
    -------
    state ``(2m, L)``
    seen ``(cycles, INSTANTS, 2G, L)``, trace ``(steps + 1, 2G, L)`` : as :func:`jaxhb.transient.lanes.march`
    reduced : Reduced
    teeth : Teeth
    """
    lanes, outputs = jax.tree.map(jnp.asarray, (lanes, outputs))
    stride = lanes.steps // INSTANTS
    empty = jnp.zeros((lanes.steps + 1, lanes.linear.shape[1], state.shape[1]))

    def another(carry, _):
        state, trace, states = cycle(lanes, carry[0], states=True)
        reduced, teeth = lax.map(
            lambda one: _reduce(lanes, outputs, *one),
            (jnp.moveaxis(trace, 2, 0), jnp.moveaxis(states, 2, 0), outputs.linear),
        )
        power = carry[2] + reduced.pop("power")
        return (state, trace, power), (trace[:-1:stride], reduced, teeth)

    quantities = len(outputs.modal) + 3 * len(lanes.viscous) + 2 * len(outputs.sums)
    power = jnp.zeros((state.shape[1], quantities, harmonics_of(lanes.steps) + 1))
    (state, trace, power), (seen, reduced, teeth) = lax.scan(another, (state, empty, power), blank)
    return state, seen, trace, Reduced(power=power, **reduced), teeth


def harmonics_of(steps):
    """Harmonics whose amplitudes are kept."""
    return min(HARMONICS, steps // 4)


def _reduce(lanes, outputs, w, states, linear):
    """One cycle of one lane: w ``(steps + 1, 2G)``, states ``(steps + 1, 2m)``, linear ``(Q, steps)``."""
    law = jax.tree.map(lambda a: a, lanes.law)
    deflection, rate = jnp.split(w.T, 2)
    elastic = backlash.force(law, deflection)
    total = backlash.mesh_force(law, lanes.viscous, lanes.contact_damping, deflection, rate)
    values = outputs.modal @ states.T + jnp.concatenate([linear, linear[:, :1]], axis=1)
    straight = values[len(values) - (outputs.sums.shape[1] - len(total)) :]
    gears = [outputs.sums @ jnp.concatenate([straight, forces]) for forces in (total, elastic)]
    values = jnp.concatenate([values, deflection, elastic, total, *gears])
    spectrum = fourier.analyze(values[:, :-1], harmonics_of(lanes.steps))
    numbers = {
        "max": _highest(values),
        "min": -_highest(-values),
        "mean": values[:, :-1].mean(axis=1),
        "square": (values[:, :-1] ** 2).mean(axis=1),
        "power": spectrum.real**2 + spectrum.imag**2,
    }
    return numbers, _teeth(law, deflection, rate)


def _highest(values):
    """Largest value of each row, on parabolas through neighbouring samples."""
    before, here, after = values[:, :-2], values[:, 1:-1], values[:, 2:]
    bend = 2 * here - before - after
    top = here + (after - before) ** 2 / (8 * jnp.where(bend > 0, bend, 1.0))
    peak = (here >= before) & (here >= after) & (bend > 0)
    return jnp.maximum(jnp.where(peak, top, here).max(axis=1), jnp.maximum(values[:, 0], values[:, -1]))


def _teeth(law, deflection, rate):
    """The :class:`Teeth` of one cycle, from (l, l') ``(G, steps + 1)``."""
    distance = jnp.abs(deflection) - law.gap
    entry = (distance[:, :-1] < 0) & (distance[:, 1:] >= 0)
    share = -distance[:, :-1] / jnp.where(entry, distance[:, 1:] - distance[:, :-1], 1.0)
    speed = jnp.abs((1 - share) * rate[:, :-1] + share * rate[:, 1:])
    return Teeth(
        above=(deflection[:, :-1] >= law.gap).mean(axis=1),
        below=(deflection[:, :-1] <= -law.gap).mean(axis=1),
        impacts=entry.sum(axis=1),
        hardest=jnp.where(entry, speed, 0.0).max(axis=1),
    )
