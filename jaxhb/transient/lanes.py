"""Trains of several speeds marched side by side, each through its own cycles, on modes that they share.

The step is that of :mod:`jaxhb.transient.stepper`, exponential Runge-Kutta around the linear train with the weights of
Krogstad, in the modes of :mod:`jaxhb.transient.modes`: propagators and weights are one complex number per mode and
lane, so that steps of another length cost nothing, and only the products with ``observation`` and ``forcing``, which
all lanes share, are matrices.

Arrays have the lanes last: ``(..., lanes)``. Measured on ``gear_train_30`` (27 modes, four meshes) on one core: 0.27
microseconds a lane and step in 64 lanes, 0.4 in 32, 0.5 in 16, 2.2 in one.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .._program import Program
from ..harmonic import backlash, fourier
from ..harmonic.backlash import Law
from ..harmonic.excitation import excitation
from .statespace import _static, linear_response, matrices
from .stepper import force_on_flank

INSTANTS = 32
"""Of a cycle at which its motion is compared with that of other cycles; divides every number of steps."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Posed:
    """Several speeds: frequency ``(L,)`` rad/s; displacement ``(L, S, N+1)`` m of the linear train; flank ``(L, S)`` m,
    its shift onto the drive sides; load_torque N m."""

    frequency: jax.Array
    displacement: jax.Array
    flank: jax.Array
    load_torque: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Lanes:
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

    def phi(self, w):
        """Force ``(G, L)`` N of the meshes less its linear part at (l, l') ``(2G, L)``."""
        deflection, rate = jnp.split(w, 2)
        total = backlash.mesh_force(self.law, self.viscous, self.contact_damping, deflection, rate)
        return total - self.law.stiffness * deflection - self.viscous * rate

    def advance(self, state, w, k):
        """State ``(2m, L)`` and w ``(2G, L)`` one step after step ``k`` of the cycle."""
        lanes = w.shape[1]
        moved, midway = _turned(self.full, state), _turned(self.half, state)
        seen = self.observation @ jnp.concatenate([moved, midway], axis=1)
        following = jnp.where(k + 1 < self.steps, 2 * k + 2, 0)
        ahead = seen[:, :lanes] + lax.dynamic_index_in_dim(self.linear, following, keepdims=False)
        middle = seen[:, lanes:] + lax.dynamic_index_in_dim(self.linear, 2 * k + 1, keepdims=False)
        f0 = self.phi(w)
        fa = self.phi(middle + _sum(self.first, f0))
        fb = self.phi(middle + _sum(self.second, jnp.concatenate([f0, fa])))
        fc = self.phi(ahead + _sum(self.third, jnp.concatenate([f0, fb])))
        forces = f0, fa + fb, fc
        pushed = self.forcing @ jnp.concatenate(forces, axis=1)
        parts = [pushed[:, i * lanes : (i + 1) * lanes] for i in range(3)]
        change = sum(_turned(weight, part) for weight, part in zip(self.weights, parts, strict=True))
        return moved + change, ahead + _sum(self.end, jnp.concatenate(forces))


def _turned(factor, state):
    """Complex product of ``factor`` ``(2, m, L)`` and ``state`` ``(2m, L)``."""
    real, imag = jnp.split(state, 2)
    return jnp.concatenate([factor[0] * real - factor[1] * imag, factor[1] * real + factor[0] * imag])


UNROLLED = 16


def _sum(matrix, values):
    """Sum over the first axis of ``matrix`` ``(j, i, L)`` times ``values`` ``(j, L)``; short sums are vectorised."""
    if len(values) > UNROLLED:
        return jnp.einsum("jil,jl->il", matrix, values)
    return sum(matrix[j] * values[j] for j in range(len(values)))


def _linear_motion(train, rpm, system, meshes, harmonics):
    """The :class:`Posed` of one speed."""
    torque, load_torque, _ = excitation(train, rpm, harmonics)
    frequency = train.topology.cycle_frequency(rpm)
    displacement = linear_response(system, frequency, torque / jnp.asarray(system.radius)[:, None])
    force = force_on_flank(meshes.law, system.deflections(displacement, meshes.link))
    shift = _static(matrices(system)[1], system.spread(-force, meshes.link))
    return Posed(frequency, displacement, shift, load_torque)


@Program
def _posed(train, rpm, system, meshes, blank):
    train, system, meshes = jax.tree.map(jnp.asarray, (train, system, meshes))
    return jax.vmap(lambda one: _linear_motion(train, one, system, meshes, len(blank) - 1))(rpm)


def pose(train, rpm, system, meshes, harmonics):
    """The :class:`Posed` of the speeds ``(L,)``, on the host."""
    return jax.tree.map(np.asarray, _posed(train, np.asarray(rpm, float), system, meshes, np.zeros(harmonics + 1)))


def lanes_of(modes, system, meshes, posed, steps):
    """The :class:`Lanes` of some speeds.

    Parameters
    ----------
    modes : Modes
    system : System
    meshes : Nonlinear, the backlash meshes
    posed : Posed
    steps : int, per cycle, a multiple of 32

    Returns
    -------
    Lanes
        Of numpy arrays.
    """
    deflection = np.moveaxis(system.deflections(np.moveaxis(posed.displacement, 0, 1), meshes.link), 1, 0)
    both = np.concatenate([deflection, fourier.derivative(deflection, posed.frequency[:, None, None])], axis=1)
    linear = np.ascontiguousarray(np.moveaxis(fourier.synthesize(both, 2 * steps), (0, 1, 2), (2, 1, 0)))
    observation, forcing = modes.observation, modes.forcing
    return Lanes(
        **_weights(modes, 2 * np.pi / posed.frequency / steps),
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
    half_1 = half_1 / 2
    last = one - 3 * two + 4 * three, 2 * two - 4 * three, 4 * three - two

    def seen(*weights):
        parts = [np.einsum("im,ml,mj->jil", modes.observation, w, modes.forcing, optimize=True).real for w in weights]
        return np.ascontiguousarray(np.concatenate(parts))

    return {
        "full": _parts(np.exp(whole)),
        "half": _parts(np.exp(whole / 2)),
        "weights": np.stack([_parts(w) for w in last]),
        "first": seen(half_1),
        "second": seen(half_1 - half_2, half_2),
        "third": seen(one - 2 * two, 2 * two),
        "end": seen(*last),
    }


def _parts(values):
    return np.stack([values.real, values.imag])


def _phi_functions(z):
    """phi_1, phi_2, phi_3: (e^z - 1) / z, (phi_1 - 1) / z, (phi_2 - 1/2) / z; series where z is small."""
    small = np.abs(z) < 1.0
    safe, near = np.where(small, 1.0, z), np.where(small, z, 0.0)
    series = [sum(near**j / float(_factorial(j + k)) for j in range(20)) for k in (1, 2, 3)]
    one = (np.exp(safe) - 1) / safe
    two = (one - 1) / safe
    three = (two - 0.5) / safe
    return tuple(np.where(small, s, f) for s, f in zip(series, (one, two, three), strict=True))


def _factorial(n):
    return float(np.prod(np.arange(1, n + 1, dtype=float)))


def state_of(modes, motion, posed):
    """States ``(2m, L)`` of motions (x, x') ``(L, 2S)`` at t = 0: their deviation from the linear train."""
    z = modes.coordinates @ (motion - linear_start(posed)).T
    return np.concatenate([z.real, z.imag])


def motion_of(modes, state, posed):
    """Motions (x, x') ``(L, 2S)`` at t = 0 of states ``(2m, L)``."""
    real, imag = np.split(np.asarray(state), 2)
    return (modes.motion.real @ real - modes.motion.imag @ imag).T + linear_start(posed)


def linear_start(posed):
    """(x, x') ``(L, 2S)`` of the linear train at t = 0."""
    speed = fourier.derivative(posed.displacement, posed.frequency[:, None, None])
    return fourier.sample(np.concatenate([posed.displacement, speed], axis=1), 1)[..., 0]


DISTURBED = 0.02
"""Share of the motion in contact that a start from there lacks: a motion that repels would be kept for long."""


def on_flank(posed):
    """Motions (x, x') ``(L, 2S)`` at t = 0 with every mesh on its drive side, carrying nearly its linear force."""
    rest = np.concatenate([posed.displacement[..., 0].real + posed.flank, 0 * posed.flank], axis=1)
    moving = linear_start(posed) + np.concatenate([posed.flank, 0 * posed.flank], axis=1)
    return moving + DISTURBED * (rest - moving)


def cycle(lanes, state, states=False):
    """One cycle on from ``state`` ``(2m, L)``: the state after it, (l, l') ``(steps + 1, 2G, L)`` of its steps, and
    if ``states`` their states ``(steps + 1, 2m, L)``."""
    w = lanes.linear[0] + lanes.observation @ state
    kept = tuple(jnp.zeros((lanes.steps + 1, *a.shape)) for a in ((w, state) if states else (w,)))

    def keep(kept, k, *values):
        return tuple(
            lax.dynamic_update_index_in_dim(a, value, k, axis=0) for a, value in zip(kept, values, strict=False)
        )

    def step(k, carry):
        state, w, kept = carry
        return *lanes.advance(state, w, k), keep(kept, k, w, state)

    state, w, kept = lax.fori_loop(0, lanes.steps, step, (state, w, kept))
    return state, *keep(kept, lanes.steps, w, state)


@Program
def march(lanes, state, blank):
    """As many cycles as ``blank`` ``(cycles,)`` is long.

    Returns
    -------
    state ``(2m, L)``
    seen ``(cycles, INSTANTS, 2G, L)`` : (l, l') at equidistant instants of each cycle
    trace ``(steps + 1, 2G, L)`` : (l, l') of the last cycle
    """
    lanes = jax.tree.map(jnp.asarray, lanes)
    stride = lanes.steps // INSTANTS
    empty = jnp.zeros((lanes.steps + 1, lanes.linear.shape[1], state.shape[1]))

    def another(carry, _):
        state, trace = cycle(lanes, carry[0])
        return (state, trace), trace[:-1:stride]

    (state, trace), seen = lax.scan(another, (state, empty), blank)
    return state, seen, trace
