"""One cycle of the meshes by steps in the damped modes of the train, under forces that
change linearly in a step.

The deviation of a train from a motion ``b(t)`` of its linear meshes is a sum of damped
modes,

    z' = rates z + forcing phi,     (l, l') = (b, b') + Re(observation z),
    phi = mesh force - c l - r l',

so that the train itself is integrated exactly, however long the steps are, and only phi
is approximated: it changes linearly from an instant to the next one. With ``x = rates
dt`` a step is

    z <- exp(x) z + dt forcing ((w - h) phi + h phi_next),
    w = (exp(x) - 1) / x,     h = (w - 1) / x.

Carried from step to step is ``s = z - dt h forcing phi``, the state without the part
that phi of its own instant gives: phi then follows from an equation in the meshes
alone, which one step of Newton's method solves well enough.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, namespace, on_host
from jaxhb.balance.problem import ActiveMeshes, Problem
from jaxhb.equations import backlash
from jaxhb.equations.backlash import MeshParameters
from jaxhb.equations.projected_modes import projected_modes
from jaxhb.equations.reduced_model import ReducedOrderModel
from jaxhb.equations.state_space import (
    LIGHT,
    ComplexModes,
    march_modes,
    paired,
    partition,
)
from jaxhb.equations.system import System

# Number of disks up to which all modes are computed; those of a projection for larger
# trains
DENSE_DISKS = 100
# Share of the motion of a mesh under its force below which a mode is left out; in a
# larger train it responds at once: twice the modes would not save a sweep.
UNSEEN = 1e-10
FAINT = 1e-4
# Share of the fastest rate below which a mode of a reduced-order model does not move by
# itself
STILL = 1e-12
IDLE_RATE = -1.0  # 1/s, of modes that fill an array
FEWEST_MODES = 32  # modes in an array, at least


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MarchModes:
    """Damped modes of a train with its meshes in contact, one of each conjugate pair.

    rates : complex ``(m,)`` 1/s; forcing : complex ``(m, G)``, their rate of change
    under phi; observation : complex ``(2G, m)``, from them to (l, l'); coordinates :
    complex ``(m, 2S)``, to them from displacements and velocities (x, x') of the disks;
    flexibility : ``(G, G)`` m/N, by which l falls at once under phi, of modes that are
    too fast for the steps.
    """

    rates: Array
    forcing: Array
    observation: Array
    coordinates: Array
    flexibility: Array

    @property
    def deflections(self) -> Array:
        """Rows ``(G, m)`` of ``observation`` for l alone."""
        return self.observation[: self.forcing.shape[1]]

    @property
    def observed(self) -> Array:
        """Rows ``(2G, 2m)`` of (l, l') for states that are real parts above imaginary
        ones.
        """
        return jnp.concatenate([self.observation.real, -self.observation.imag], axis=1)


def modes_for_march(problem: Problem, active_meshes: ActiveMeshes) -> MarchModes:
    """The modes that move the active meshes noticeably, as arrays of the host; their
    number is padded to 32, 64, 128, ....

    ``problem`` may be at any speed: it scales the slowest modes alone.
    """
    system = problem.system
    frequency = float(problem.frequency)
    active_parameters = jax.tree.map(
        lambda leaf: np.asarray(leaf)[np.asarray(active_meshes.index)], problem.meshes
    )
    is_dense = len(system.mass) <= DENSE_DISKS
    if is_dense:
        modes = _dense_modes(system, active_parameters, frequency)
    else:
        modes = projected_modes(on_host(system), active_parameters, frequency)
    mask = np.asarray(active_meshes.mask)
    forcing = modes.forcing * mask
    observation = modes.observation * np.tile(mask, 2)[:, None]
    noticed = noticed_modes(
        modes.rates, forcing, observation, frequency, UNSEEN if is_dense else FAINT
    )
    # Fast modes among the others respond at once.
    is_immediate = ~noticed & (np.abs(modes.rates) > frequency)
    at_once = observation[: len(mask), is_immediate] @ (
        forcing[is_immediate] / modes.rates[is_immediate, None]
    )
    idle_count = _padded_count(noticed.sum()) - noticed.sum()
    return MarchModes(
        rates=np.pad(modes.rates[noticed], (0, idle_count), constant_values=IDLE_RATE),
        forcing=np.pad(forcing[noticed], ((0, idle_count), (0, 0))),
        observation=np.pad(observation[:, noticed], ((0, 0), (0, idle_count))),
        coordinates=np.pad(modes.coordinates[noticed], ((0, idle_count), (0, 0))),
        flexibility=at_once.real,
    )


def _dense_modes(
    system: System, meshes: MeshParameters, frequency: float
) -> ComplexModes:
    """All modes of a train."""
    ends = np.concatenate(
        [system.tree.end_a[meshes.link], system.tree.end_b[meshes.link]]
    )
    mass = np.asarray(system.mass)
    # A disk without inertia beside a mesh has no equation in time: with a little
    # inertia it has.
    bare = np.zeros(len(mass), bool)
    bare[ends] = True
    mass = np.where(bare & (mass == 0), LIGHT * np.mean(mass), mass)
    system = dataclasses.replace(system, mass=mass)
    parts = partition(system, meshes, lossy=True)
    return march_modes(system, meshes, frequency, parts)


def modes_of_model(model: ReducedOrderModel) -> MarchModes:
    """The modes of a reduced-order model, which exists inside programs, too; of a pair
    of states that turns the second one is idle.
    """
    space = model.space
    (first_rate, upper), (lower, second_rate) = paired(space.transition)
    # A pair of states is a mode that turns, as its real and imaginary part, or two that
    # do not.
    is_turning = ((first_rate - second_rate) / 2) ** 2 + upper * lower < 0
    rates = jnp.concatenate(
        [
            jnp.where(is_turning, first_rate + 1j * upper, first_rate),
            jnp.where(is_turning, IDLE_RATE, second_rate),
        ]
    )
    # Free rotation, which no mesh sees, and modes that respond at once, which the
    # residual flexibility has.
    is_still = jnp.abs(rates) <= STILL * jnp.max(jnp.abs(rates))
    half = len(first_rate)

    def as_modes(first: Array, second: Array) -> Array:
        return jnp.concatenate(
            [
                jnp.where(is_turning, first + 1j * second, first),
                jnp.where(is_turning, 0.0, second),
            ],
            axis=-1,
        )

    forcing, coordinates = (
        as_modes(state_rows[:half].T, -state_rows[half:].T).T
        for state_rows in (space.forcing, space.coordinates)
    )
    return MarchModes(
        rates=jnp.where(is_still, IDLE_RATE, rates),
        forcing=jnp.where(is_still[:, None], 0.0, forcing),
        observation=jnp.where(
            is_still,
            0.0,
            as_modes(space.observation[:, :half], space.observation[:, half:]),
        ),
        coordinates=coordinates,
        flexibility=model.residual_flexibility,
    )


def noticed_modes(
    rates: np.ndarray,
    forcing: np.ndarray,
    observation: np.ndarray,
    frequency: float,
    least: float = UNSEEN,
) -> np.ndarray:
    """Whether a force at a mesh moves a mesh by a mode, bool ``(m,)``: its static or
    accelerated response is more than the share ``least`` of the largest of any mode.
    """
    meshes = forcing.shape[1]
    strength = np.abs(forcing).max(axis=1)
    slow = (
        np.abs(observation[:meshes]).max(axis=0)
        * strength
        / np.maximum(np.abs(rates), frequency)
    )
    fast = np.abs(observation[meshes:]).max(axis=0) * strength
    return (slow > least * slow.max()) | (fast > least * fast.max())


def _padded_count(count: int) -> int:
    return max(FEWEST_MODES, 1 << (int(count) - 1).bit_length())


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class StepWeights:
    """A step of ``dt`` seconds: decay ``(m,)`` of the modes, real and imaginary; push
    ``(G, 2m)`` of phi on the state; at_once ``(2G, G)``, (l, l') by phi of the same
    instant; late ``(2m, G)``, ``z = s + late phi``.

    States ``(2m,)`` are real parts above imaginary ones.
    """

    decay: tuple[Array, Array]
    push: Array
    at_once: Array
    late: Array

    def onward(self, state: Array, force: Array) -> Array:
        """States ``(2m,)`` a step later, under phi ``(G,)`` N."""
        decay_real, decay_imag = self.decay
        real, imag = jnp.split(state, 2)
        turned = jnp.concatenate(
            [
                decay_real * real - decay_imag * imag,
                decay_imag * real + decay_real * imag,
            ]
        )
        # A written-out sum of columns is faster than a product inside a scan.
        return turned + sum(self.push[g] * force[g] for g in range(len(force)))


def step_weights(modes: MarchModes, dt: Array) -> StepWeights:
    """The weights of steps of ``dt`` seconds."""
    turned = modes.rates * dt
    decay = jnp.exp(turned)
    whole = jnp.expm1(turned) / turned
    half = (whole - 1) / turned
    late = (dt * half)[:, None] * modes.forcing
    push = decay[:, None] * late + (dt * (whole - half))[:, None] * modes.forcing
    at_once = jnp.real(modes.observation @ late)
    at_once = at_once.at[: modes.forcing.shape[1]].add(-modes.flexibility)
    return StepWeights(
        (decay.real, decay.imag), real_pairs(push).T, at_once, real_pairs(late)
    )


def real_pairs(modal: Array) -> Array:
    """Complex ``(m, ...)`` as real ``(2m, ...)``."""
    return namespace(modal).concatenate([modal.real, modal.imag])


def complex_modes(pairs: Array) -> Array:
    """Complex ``(m, ...)`` of :func:`real_pairs`."""
    half = len(pairs) // 2
    return pairs[:half] + 1j * pairs[half:]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TeethLaw:
    """Parameters of phi of the active meshes, ``(G,)`` each: law, viscous N s/m,
    contact damping.
    """

    law: backlash.Law
    viscous: Array
    contact_damping: Array

    def at_instant(self, variation: Array | None) -> TeethLaw:
        """The law at an instant where the stiffness is 1 + ``variation`` ``(G,)`` times
        its mean; None where none varies.
        """
        if variation is None:
            return self
        return dataclasses.replace(self, law=backlash.at_instant(self.law, variation))

    def excess(self, deflection: Array, rate: Array) -> tuple[Array, Array, Array]:
        """phi ``(G,)`` in N, and its slopes in l (N/m) and l' (N s/m)."""
        by_deflection, by_rate = backlash.nonlinear_slopes(
            self.law, self.viscous, self.contact_damping, deflection, rate
        )
        force = backlash.nonlinear_force(
            self.law, self.viscous, self.contact_damping, deflection, rate
        )
        return force, by_deflection, by_rate


@dataclass(frozen=True)
class InstantSolve:
    """Options of the equation for phi of an instant: Newton steps, and whether these
    couple the meshes.

    A mesh whose force moves another one at once (on a disk without inertia, beside
    another force of the same shaft) is coupled to it; elsewhere coupling within a step
    is small, and each mesh is solved for by itself.
    """

    steps: int = 1
    coupled: bool = False

    @classmethod
    def of(cls, springs: int) -> InstantSolve:
        """Choose for meshes and so many springs: friction and stops of a shaft act at
        once on the gear at its end.
        """
        return cls(steps=2, coupled=True) if springs else cls()


def march_cycle(
    modes: MarchModes,
    weights: StepWeights,
    teeth: TeethLaw,
    state: Array,
    force: Array,
    motion: Array,
    variation: Array | None,
    instant: InstantSolve,
) -> tuple[Array, Array, Array]:
    """March one cycle from ``state`` ``(2m,)`` and phi ``force`` ``(G,)`` N at its
    beginning.

    motion : ``(K, 2G)``, rows of (b, b') at each of K steps, or of b alone where phi
    does not depend on rates; variation : ``(K, G)`` of the stiffness, or None. Returns
    deflections ``(K, G)`` m at the steps, and state and force at the end.
    """
    meshes = len(force)
    columns = slice(motion.shape[1])
    observed = modes.observed[columns]
    at_once = weights.at_once[columns]
    by_deflection = weights.at_once[:meshes]
    by_rate = weights.at_once[meshes:]
    diagonal_l = jnp.diagonal(by_deflection)
    diagonal_rate = jnp.diagonal(by_rate)

    def with_force(free: Array, force: Array) -> Array:
        # A written-out sum of columns is faster than a product inside a scan.
        return free + sum(at_once[:, g] * force[g] for g in range(meshes))

    def improved(teeth: TeethLaw, free: Array, force: Array) -> Array:
        moved = with_force(free, force)
        deflection = moved[:meshes]
        rate = moved[meshes:] if len(moved) > meshes else jnp.zeros_like(deflection)
        phi, slope, rate_slope = teeth.excess(deflection, rate)
        mismatch = phi - force
        if instant.coupled:
            coupling = slope[:, None] * by_deflection + rate_slope[:, None] * by_rate
            return force + jnp.linalg.solve(jnp.eye(meshes) - coupling, mismatch)
        return force + mismatch / (1 - diagonal_l * slope - diagonal_rate * rate_slope)

    def step(
        carry: tuple[Array, Array], row: tuple[Array, Array | None]
    ) -> tuple[tuple[Array, Array], Array]:
        state, force = carry
        motion_row, variation_row = row
        free = motion_row + observed @ state
        teeth_now = teeth.at_instant(variation_row)
        for _ in range(instant.steps):
            force = improved(teeth_now, free, force)
        deflection = with_force(free, force)[:meshes]
        return (weights.onward(state, force), force), deflection

    (state, force), deflection = lax.scan(step, (state, force), (motion, variation))
    return deflection, state, force
