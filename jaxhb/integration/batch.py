"""A batch of speeds of one train marched side by side, each through its own cycles, on modes that they share.

The step is that of :mod:`jaxhb.integration.step`, exponential Runge-Kutta around the linear train with the weights of
Krogstad, in the modes of :mod:`jaxhb.equations.state_space`: propagators and weights are one complex number per mode
and speed, so that steps of another length cost nothing, and only the products with ``observation`` and ``forcing``,
which all speeds share, are matrices.

Arrays have the speeds last: ``(..., L)``. Measured on ``gear_train_30`` (27 modes, four meshes) on one core: 0.27
microseconds a speed and step in 64 of them, 0.4 in 32, 0.5 in 16, 2.2 in one.
"""

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb.equations import fourier
from jaxhb.equations.backlash import Law
from jaxhb.equations.state_space import dense_linear_motion, matrices, paired, static_response
from jaxhb.excitation.torques import excitation
from jaxhb.integration.step import Stepper, force_on_flank, krogstad, stages

# Time samples of a cycle at which its motion is compared with that of other cycles; divides every number of steps.
SAMPLES = 32
UNROLLED = 16  # terms of a sum up to which it is written out, which vectorises over the speeds
# Share of the motion in contact that a start from there lacks: a motion that repels would be kept for long.
DISTURBED = 0.02


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinearMotion:
    """Several speeds: frequency ``(L,)`` rad/s; displacement ``(L, S, N+1)`` m of the linear train; flank ``(L, S)`` m,
    its shift onto the drive sides."""

    frequency: jax.Array
    displacement: jax.Array
    flank: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class BatchStepper:
    """L trains of m modes and G meshes, cut into steps.

    full, half ``(2, m, L)``: exp(rate dt) and exp(rate dt / 2), real above imaginary part; weights ``(3, 2, m, L)`` of
    the forces (first, sum of the two in the middle, last); first ``(G, 2G, L)``, second, third ``(2G, 2G, L)``, end
    ``(3G, 2G, L)``: what these forces, along the first axis, add to (l, l'); observation ``(2G, 2m)``, forcing ``(2m,
    G)``; linear ``(2 steps, 2G, L)``: (l, l') of the linear train every half step; law, viscous, contact_damping ``(G,
    1)``.
    """

    full: jax.Array
    half: jax.Array
    weights: jax.Array
    first: jax.Array
    second: jax.Array
    third: jax.Array
    end: jax.Array
    observation: jax.Array
    forcing: jax.Array
    linear: jax.Array
    law: Law
    viscous: jax.Array
    contact_damping: jax.Array

    @property
    def steps(self):
        """Steps of a cycle."""
        return self.linear.shape[0] // 2

    def nonlinear_force(self, w):
        """Force ``(G, L)`` N of the meshes less its linear part at (l, l') ``(2G, L)``: the mesh force of
        :func:`jaxhb.equations.backlash.mesh_force`, written for speed."""
        law, (deflection, rate) = self.law, jnp.split(w, 2)
        reach = jnp.abs(deflection) - law.gap
        inside = jnp.clip(reach, 0.0, law.width)
        beyond, share = jnp.maximum(reach - law.width, 0.0), inside * (1 / law.width)
        drop = law.stiffness * (1 - law.epsilon)
        elastic = drop * (jnp.sign(deflection) * (share * inside / 2 + beyond) - deflection)
        return elastic + self.viscous * rate * jnp.where(self.contact_damping, share - 1, 0.0)

    def advance(self, state, w, k):
        """State ``(2m, L)`` and w ``(2G, L)`` one step after step ``k`` of the cycle."""
        moved = _turned(self.full, state)
        following = jnp.where(k + 1 < self.steps, 2 * k + 2, 0)
        # The stages see (l, l') alone: two products for all speeds, and the state itself is touched once a step.
        ahead = self.observation @ moved + lax.dynamic_index_in_dim(self.linear, following, keepdims=False)
        middle = self.observation @ _turned(self.half, state)
        middle = middle + lax.dynamic_index_in_dim(self.linear, 2 * k + 1, keepdims=False)
        forces = stages(self.nonlinear_force, _sum, self, w, middle, ahead)
        change = (_turned(weight, self.forcing @ force) for weight, force in zip(self.weights, forces, strict=True))
        return moved + sum(change), ahead + _sum(self.end, *forces)

    def single(self):
        """``advance`` for one speed, where dense products with its own matrices are faster: that of a Stepper."""

        def dense(factor):
            real, imag = jnp.diag(factor[0, :, 0]), jnp.diag(factor[1, :, 0])
            return jnp.block([[real, -imag], [imag, real]])

        whole, half = dense(self.full), dense(self.half)
        push = jnp.concatenate([dense(weight) @ self.forcing for weight in self.weights], axis=1)
        stepper = Stepper(
            propagator=paired(whole),
            ahead=jnp.concatenate([self.observation @ whole, self.observation @ half]),
            weights=jnp.concatenate([push, self.end[..., 0].T]),
            **{name: getattr(self, name)[..., 0].T for name in ("first", "second", "third")},
            **{name: getattr(self, name)[..., 0] for name in ("linear", "viscous", "contact_damping")},
            law=jax.tree.map(lambda a: a[:, 0], self.law),
        )

        def advance(state, w, k):
            state, w = stepper.advance(state[:, 0], w[:, 0], k)
            return state[:, None], w[:, None]

        return advance


def _turned(factor, state):
    """Complex product of ``factor`` ``(2, m, L)`` and ``state`` ``(2m, L)``."""
    real, imag = jnp.split(state, 2)
    return jnp.concatenate([factor[0] * real - factor[1] * imag, factor[1] * real + factor[0] * imag])


def _sum(matrix, *values):
    """Sum over the first axis of ``matrix`` ``(j, i, L)`` times the rows ``(j, L)`` of all values; short sums are
    vectorised."""
    if len(matrix) > UNROLLED:
        return jnp.einsum("jil,jl->il", matrix, jnp.concatenate(values))
    rows = (row for block in values for row in block)
    return sum(part * row for part, row in zip(matrix, rows, strict=True))


def linear_motions(train, rpm, system, meshes, harmonics):
    """The :class:`LinearMotion` of speeds ``(L,)``, on the host."""

    def one(rpm):
        torque, _, _ = excitation(train, rpm, harmonics)
        frequency = train.topology.cycle_frequency(rpm)
        displacement = dense_linear_motion(system, frequency, torque / system.radius[:, None])
        force = force_on_flank(meshes.law, system.deflections(displacement, meshes.link))
        shift = static_response(matrices(system)[1], system.spread(-force, meshes.link))
        return LinearMotion(frequency, displacement, shift)

    return jax.tree.map(lambda *values: np.stack(values), *map(one, np.asarray(rpm, float)))


def batch_stepper(modes, system, meshes, linear_motion, steps):
    """The :class:`BatchStepper` of Modes, a System, its backlash meshes (MeshParameters) and a LinearMotion, in numpy
    arrays; ``steps`` per cycle are a multiple of 32."""
    deflection = np.moveaxis(system.deflections(np.moveaxis(linear_motion.displacement, 0, 1), meshes.link), 1, 0)
    both = np.concatenate([deflection, fourier.derivative(deflection, linear_motion.frequency[:, None, None])], axis=1)
    linear = np.ascontiguousarray(np.moveaxis(fourier.synthesize(both, 2 * steps), (0, 1, 2), (2, 1, 0)))
    observation, forcing = modes.observation, modes.forcing
    return BatchStepper(
        **_weights(modes, 2 * np.pi / linear_motion.frequency / steps),
        observation=np.concatenate([observation.real, -observation.imag], axis=1),
        forcing=np.concatenate([forcing.real, forcing.imag]),
        linear=linear,
        law=jax.tree.map(lambda a: np.asarray(a)[:, None], meshes.law),
        viscous=np.asarray(meshes.viscous)[:, None],
        contact_damping=np.asarray(meshes.contact_damping)[:, None],
    )


def _weights(modes, dt):
    """Propagators and stage weights of Krogstad's scheme for steps of ``dt`` ``(L,)`` seconds."""
    whole = modes.rates[:, None] * dt
    half_1, half_2 = (dt * phi for phi in _phi_functions(whole / 2)[:2])
    one, two, three = (dt * phi for phi in _phi_functions(whole))
    first, second, third, end = krogstad(half_1 / 2, half_2, one, two, three)

    def observed(*weights):
        parts = [np.einsum("im,ml,mj->jil", modes.observation, w, modes.forcing, optimize=True).real for w in weights]
        return np.ascontiguousarray(np.concatenate(parts))

    return {
        "full": _parts(np.exp(whole)),
        "half": _parts(np.exp(whole / 2)),
        "weights": np.stack([_parts(w) for w in end]),
        "first": observed(*first),
        "second": observed(*second),
        "third": observed(*third),
        "end": observed(*end),
    }


def _parts(values):
    return np.stack([values.real, values.imag])


def _phi_functions(z):
    """phi_1, phi_2, phi_3: (e^z - 1) / z, (phi_1 - 1) / z, (phi_2 - 1/2) / z; series where z is small."""
    # The closed forms cancel where z is small, (e^z - 1) / z to all digits at z = 1e-16: there 20 terms of the series.
    small = np.abs(z) < 1.0
    safe, near = np.where(small, 1.0, z), np.where(small, z, 0.0)
    series = [sum(near**j / math.factorial(j + k) for j in range(20)) for k in (1, 2, 3)]
    one = (np.exp(safe) - 1) / safe
    two = (one - 1) / safe
    three = (two - 0.5) / safe
    return tuple(np.where(small, s, f) for s, f in zip(series, (one, two, three), strict=True))


def state_of(modes, motion, linear_motion):
    """States ``(2m, L)`` of motions (x, x') ``(L, 2S)`` at t = 0: their deviation from the linear train."""
    z = modes.coordinates @ (motion - linear_start(linear_motion)).T
    return np.concatenate([z.real, z.imag])


def motion_of(modes, state, linear_motion):
    """Motions (x, x') ``(L, 2S)`` at t = 0 of states ``(2m, L)``."""
    real, imag = np.split(np.asarray(state), 2)
    return (modes.motion.real @ real - modes.motion.imag @ imag).T + linear_start(linear_motion)


def linear_start(linear_motion):
    """(x, x') ``(L, 2S)`` of the linear train at t = 0."""
    speed = fourier.derivative(linear_motion.displacement, linear_motion.frequency[:, None, None])
    return fourier.sample(np.concatenate([linear_motion.displacement, speed], axis=1), 1)[..., 0]


def motions_on_flank(linear_motion):
    """Motions (x, x') ``(L, 2S)`` at t = 0 with every mesh on its drive side, carrying nearly its linear force."""
    shift, mean = linear_motion.flank, linear_motion.displacement[..., 0].real
    # A little on the way from the motion in contact to rest at its mean: near that motion, and not on it.
    rest = np.concatenate([mean + shift, 0 * shift], axis=1)
    moving = linear_start(linear_motion) + np.concatenate([shift, 0 * shift], axis=1)
    return moving + DISTURBED * (rest - moving)


def cycle(stepper, state, states=False):
    """One cycle on from ``state`` ``(2m, L)``: the state after it, (l, l') ``(steps + 1, 2G, L)`` of its steps, and
    if ``states`` their states ``(steps + 1, 2m, L)``."""
    w = stepper.linear[0] + stepper.observation @ state
    kept = tuple(jnp.zeros((stepper.steps + 1, *a.shape)) for a in ((w, state) if states else (w,)))

    def keep(kept, k, *values):
        return tuple(
            lax.dynamic_update_index_in_dim(a, value, k, axis=0) for a, value in zip(kept, values, strict=False)
        )

    def step(k, carry):
        state, w, kept = carry
        return *advance(state, w, k), keep(kept, k, w, state)

    advance = stepper.single() if w.shape[1] == 1 else stepper.advance
    state, w, kept = lax.fori_loop(0, stepper.steps, step, (state, w, kept))
    return state, *keep(kept, stepper.steps, w, state)
