"""One cycle of the meshes by steps in the damped modes of the train, under forces that change linearly in a step.

The deviation of a train from a motion ``b(t)`` of its linear meshes is a sum of damped modes,

    z' = rates z + forcing phi,     (l, l') = (b, b') + Re(observation z),     phi = mesh force - c l - r l',

so that the train itself is integrated exactly, however long the steps are, and only phi is approximated: it changes
linearly from an instant to the next one. With ``x = rates dt`` a step is

    z <- exp(x) z + dt forcing ((w - h) phi + h phi_next),     w = (exp(x) - 1) / x,     h = (w - 1) / x.

What is carried from step to step is ``s = z - dt h forcing phi``, the state without what phi of its own instant gives:
phi then follows from an equation in the meshes alone, which one step of Newton's method solves well enough.
"""

import dataclasses
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array
from jaxhb.equations import backlash
from jaxhb.equations.state_space import LIGHT, march_modes, partition

UNSEEN = 1e-10  # share of the motion of a mesh under its force below which a mode is left out
IDLE_RATE = -1.0  # 1/s, of modes that fill an array
FEWEST_MODES = 32


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MarchModes:
    """Damped modes of a train with its meshes in contact, one of each conjugate pair.

    rates : complex ``(m,)`` 1/s; forcing : complex ``(m, G)``, what phi does to them; observation : complex ``(2G, m)``
    of (l, l'); coordinates : complex ``(m, 2S)``, z of displacements and velocities (x, x') of the disks.
    """

    rates: Array
    forcing: Array
    observation: Array
    coordinates: Array

    @property
    def deflections(self) -> Array:
        """Rows ``(G, m)`` of ``observation`` for l alone."""
        return self.observation[: self.forcing.shape[1]]


def modes_for_march(problem, active_meshes) -> MarchModes:
    """The modes that the active meshes notice, as arrays of the host; their number is padded to 32, 64, 128, ....

    ``problem`` may be at any speed: it scales the slowest modes alone.
    """
    system, meshes = problem.system, problem.meshes
    index = np.asarray(active_meshes.index)
    chosen = jax.tree.map(lambda array: np.asarray(array)[index], meshes)
    ends = np.concatenate([system.tree.end_a[chosen.link], system.tree.end_b[chosen.link]])
    mass = np.asarray(system.mass)
    # A disk without inertia beside a mesh has no equation in time: with a little inertia it has.
    bare = np.zeros(len(mass), bool)
    bare[ends] = True
    mass = np.where(bare & (mass == 0), LIGHT * np.mean(mass), mass)
    system = dataclasses.replace(system, mass=mass)
    parts = partition(system, chosen, lossy=True)
    modes = march_modes(system, chosen, float(problem.frequency), parts)
    mask = np.asarray(active_meshes.mask)
    forcing, observation = modes.forcing * mask, modes.observation * np.tile(mask, 2)[:, None]
    noticed = noticed_modes(modes.rates, forcing, observation, float(problem.frequency))
    idle = _padded_count(noticed.sum()) - noticed.sum()
    return MarchModes(
        rates=np.pad(modes.rates[noticed], (0, idle), constant_values=IDLE_RATE),
        forcing=np.pad(forcing[noticed], ((0, idle), (0, 0))),
        observation=np.pad(observation[:, noticed], ((0, 0), (0, idle))),
        coordinates=np.pad(modes.coordinates[noticed], ((0, idle), (0, 0))),
    )


def noticed_modes(rates, forcing, observation, frequency):
    """Whether a force at a mesh moves a mesh by a mode ``(m,)``: static or accelerated response."""
    count = forcing.shape[1]
    strength = np.abs(forcing).max(axis=1)
    slow = np.abs(observation[:count]).max(axis=0) * strength / np.maximum(np.abs(rates), frequency)
    fast = np.abs(observation[count:]).max(axis=0) * strength
    return (slow > UNSEEN * slow.max()) | (fast > UNSEEN * fast.max())


def _padded_count(count):
    return max(FEWEST_MODES, 1 << (int(count) - 1).bit_length())


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class StepWeights:
    """A step of ``dt`` seconds: decay ``(m,)`` of the modes, real and imaginary; push ``(G, 2m)`` of phi on the state;
    at_once ``(2G, G)``, (l, l') by phi of the same instant; late ``(2m, G)``, ``z = s + late phi``.

    States ``(2m,)`` are real parts above imaginary ones.
    """

    decay: tuple[jax.Array, jax.Array]
    push: jax.Array
    at_once: jax.Array
    late: jax.Array


def step_weights(modes: MarchModes, dt) -> StepWeights:
    """The weights of steps of ``dt`` seconds."""
    turned = modes.rates * dt
    decay = jnp.exp(turned)
    whole = jnp.expm1(turned) / turned
    half = (whole - 1) / turned
    late = (dt * half)[:, None] * modes.forcing
    push = decay[:, None] * late + (dt * (whole - half))[:, None] * modes.forcing
    at_once = (modes.observation @ late).real
    return StepWeights((decay.real, decay.imag), real_pairs(push).T, at_once, real_pairs(late))


def real_pairs(modal):
    """Complex ``(m, ...)`` as real ``(2m, ...)``."""
    return jnp.concatenate([modal.real, modal.imag])


def complex_modes(pairs):
    """Complex ``(m, ...)`` of :func:`real_pairs`."""
    half = len(pairs) // 2
    return pairs[:half] + 1j * pairs[half:]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TeethLaw:
    """What gives phi of the active meshes ``(G,)``: law, viscous N s/m, contact damping."""

    law: backlash.Law
    viscous: jax.Array
    contact_damping: jax.Array

    def at_instant(self, variation):
        """The same where the stiffness is 1 + ``variation`` times its mean; None where none varies."""
        if variation is None:
            return self
        return dataclasses.replace(self, law=backlash.at_instant(self.law, variation))

    def excess(self, deflection, rate):
        """phi in N, and its slopes in l (N/m) and l' (N s/m)."""
        known = self.law, self.viscous, self.contact_damping
        by_deflection, by_rate = backlash.nonlinear_slopes(*known, deflection, rate)
        return backlash.nonlinear_force(*known, deflection, rate), by_deflection, by_rate


@dataclass(frozen=True)
class InstantSolve:
    """How phi of an instant is found: Newton steps, and whether these couple the meshes.

    A mesh whose force moves another one at once (on a disk without inertia, beside another force of the same shaft)
    is coupled to it; elsewhere coupling within a step is small, and each mesh is solved for by itself.
    """

    steps: int = 1
    coupled: bool = False


def march_cycle(modes: MarchModes, weights: StepWeights, teeth: TeethLaw, state, force, motion, variation, instant):
    """One cycle from ``state`` ``(2m,)`` and phi ``force`` ``(G,)`` N at its beginning.

    motion : ``(K, 2G)``, rows of (b, b') at each of K steps; variation : ``(K, G)`` of the stiffness, or None. Gives
    deflections ``(K, G)`` m at the steps, and state and force at the end.
    """
    meshes = len(force)
    observed = jnp.concatenate([modes.observation.real, -modes.observation.imag], axis=1)
    by_deflection, by_rate = weights.at_once[:meshes], weights.at_once[meshes:]
    alone_l, alone_rate = jnp.diagonal(by_deflection), jnp.diagonal(by_rate)
    decay_real, decay_imag = weights.decay

    def with_force(free, force):
        # A written-out sum of columns is faster than a product inside a scan.
        return free + sum(weights.at_once[:, g] * force[g] for g in range(meshes))

    def improved(teeth, free, force):
        moved = with_force(free, force)
        phi, slope, rate_slope = teeth.excess(moved[:meshes], moved[meshes:])
        missed = phi - force
        if instant.coupled:
            coupling = slope[:, None] * by_deflection + rate_slope[:, None] * by_rate
            return force + jnp.linalg.solve(jnp.eye(meshes) - coupling, missed)
        return force + missed / (1 - alone_l * slope - alone_rate * rate_slope)

    def step(carry, row):
        state, force = carry
        now, varied = row
        free = now + observed @ state
        teeth_now = teeth.at_instant(varied)
        for _ in range(instant.steps):
            force = improved(teeth_now, free, force)
        deflection = with_force(free, force)[:meshes]
        real, imag = jnp.split(state, 2)
        turned = jnp.concatenate([decay_real * real - decay_imag * imag, decay_imag * real + decay_real * imag])
        pushed = turned + sum(weights.push[g] * force[g] for g in range(meshes))
        return (pushed, force), deflection

    (state, force), deflection = lax.scan(step, (state, force), (motion, variation))
    return deflection, state, force
