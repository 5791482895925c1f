"""Steps of one train at several speeds, in modes that the speeds share, made on the
host.

Of complex modes (:mod:`jaxhb.equations.state_space`) propagators and weights are one
number per mode and speed, so that steps of another length cost nothing.
"""

import math
from dataclasses import dataclass

import jax
import numpy as np

from jaxhb.equations import backlash, fourier
from jaxhb.equations.backlash import all_meshes
from jaxhb.equations.condensation import displacements_and_bends
from jaxhb.equations.state_space import matrices, static_response
from jaxhb.excitation.torques import excitation
from jaxhb.integration.step import Stepper, force_on_flank, krogstad, rows_of

# Time samples of a cycle at which its motion is compared with that of other cycles;
# divides every number of steps.
SAMPLES = 32
# Share of the motion in contact that a start from there lacks: a motion that repels
# would be kept for long.
DISTURBED = 0.02


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinearMotion:
    """Several speeds: frequency ``(L,)`` rad/s; displacement ``(L, S, N+1)`` m of the
    linear train and deflection ``(L, M, N+1)`` m of the meshes with backlash; flank
    ``(L, S)`` m, its shift onto the drive sides.
    """

    frequency: jax.Array
    displacement: jax.Array
    deflection: jax.Array
    flank: jax.Array


def motions_in_contact(train, rpm, system, every, harmonics):
    """Displacements ``(L, S, N+1)`` m under the excitation of speeds ``(L,)``, all
    meshes in contact, and deflections ``(L, links, N+1)`` m of all links, on the host;
    every : MeshParameters of all meshes.
    """
    frequency = train.topology.cycle_frequency(rpm)
    load = excitation(train, rpm, harmonics)[0] / system.radius[:, None]
    load = np.stack(
        [
            backlash.error_load(system, every, *of_speed)
            for of_speed in zip(frequency, load, strict=True)
        ]
    )
    return displacements_and_bends(system, frequency, load)


def linear_motions(train, rpm, system, meshes, harmonics):
    """The :class:`LinearMotion` of speeds ``(L,)``, on the host."""
    rpm = np.asarray(rpm, float)
    stiffness = matrices(system)[1]
    displacement, bends = motions_in_contact(
        train, rpm, system, all_meshes(train), harmonics
    )
    frequency = train.topology.cycle_frequency(rpm)
    deflection = bends[:, meshes.link]
    forces = (force_on_flank(meshes.law, own) for own in deflection)
    shift = np.stack(
        [
            static_response(stiffness, system.spread(-force, meshes.link))
            for force in forces
        ]
    )
    return LinearMotion(frequency, displacement, deflection, shift)


def steppers(modes, system, meshes, linear_motion, steps):
    """The :class:`~jaxhb.integration.step.Stepper` of every speed of a LinearMotion,
    numpy arrays with a leading axis.

    modes : Modes; meshes : those with backlash of the System (MeshParameters); steps :
    per cycle, a multiple of 32.
    """
    deflection = backlash.less_error(meshes, linear_motion.deflection)
    both = np.concatenate(
        [
            deflection,
            fourier.derivative(deflection, linear_motion.frequency[:, None, None]),
        ],
        axis=1,
    )
    linear = np.ascontiguousarray(
        np.moveaxis(fourier.synthesize(both, 2 * steps), 1, 2)
    )

    def everywhere(values):
        return np.broadcast_to(values, (len(linear), *np.shape(values)))

    return Stepper(
        **_weights(modes, 2 * np.pi / linear_motion.frequency[:, None] / steps),
        linear=linear,
        observation=everywhere(
            np.concatenate([modes.observation.real, -modes.observation.imag], axis=1)
        ),
        law=jax.tree.map(everywhere, meshes.law),
        viscous=everywhere(meshes.viscous),
        contact_damping=everywhere(meshes.contact_damping),
        variation=(
            None
            if meshes.variation is None
            else everywhere(rows_of(meshes.variation, steps))
        ),
    )


def _weights(modes, dt):
    """Propagators and stage weights of Krogstad's scheme for steps of ``dt`` ``(L, 1)``
    seconds.
    """
    whole = modes.rates * dt
    half_1, half_2 = (dt * phi for phi in _phi_functions(whole / 2)[:2])
    one, two, three = (dt * phi for phi in _phi_functions(whole))
    first, second, third, end = krogstad(half_1 / 2, half_2, one, two, three)

    def pushed(weights):
        """States ``(L, m, j G)`` of complex modes that the forces of j stages leave."""
        return np.concatenate(
            [weight[:, :, None] * modes.forcing for weight in weights], axis=2
        )

    def observed(states):
        return (modes.observation @ states).real

    turn = np.exp(whole)
    ahead = np.concatenate(
        [modes.observation * np.exp(part)[:, None] for part in (whole, whole / 2)],
        axis=1,
    )
    left = pushed(end)
    return {
        "propagator": np.stack(
            [np.stack([turn.real, -turn.imag], 1), np.stack([turn.imag, turn.real], 1)],
            1,
        ),
        "ahead": np.concatenate([ahead.real, -ahead.imag], axis=2),
        "weights": np.concatenate([left.real, left.imag, observed(left)], axis=1),
        "first": observed(pushed(first)),
        "second": observed(pushed(second)),
        "third": observed(pushed(third)),
    }


def _phi_functions(z):
    """phi_1, phi_2, phi_3: (e^z - 1) / z, (phi_1 - 1) / z, (phi_2 - 1/2) / z; series
    where z is small.
    """
    # The closed forms cancel where z is small, (e^z - 1) / z to all digits at z =
    # 1e-16: there 20 terms of the series.
    small = np.abs(z) < 1.0
    safe = np.where(small, 1.0, z)
    near = np.where(small, z, 0.0)
    series = [
        sum(near**j / math.factorial(j + k) for j in range(20)) for k in (1, 2, 3)
    ]
    one = (np.exp(safe) - 1) / safe
    two = (one - 1) / safe
    three = (two - 0.5) / safe
    return tuple(
        np.where(small, s, f) for s, f in zip(series, (one, two, three), strict=True)
    )


def state_of(modes, motion, linear_motion):
    """States ``(L, 2m)`` of motions (x, x') ``(L, 2S)`` at t = 0: their deviation from
    the linear train.
    """
    z = (motion - linear_start(linear_motion)) @ modes.coordinates.T
    return np.concatenate([z.real, z.imag], axis=1)


def motion_of(modes, state, linear_motion):
    """Motions (x, x') ``(L, 2S)`` at t = 0 of states ``(L, 2m)``."""
    real, imag = np.split(np.asarray(state), 2, axis=1)
    return (
        real @ modes.motion.real.T
        - imag @ modes.motion.imag.T
        + linear_start(linear_motion)
    )


def linear_start(linear_motion):
    """(x, x') ``(L, 2S)`` of the linear train at t = 0."""
    speed = fourier.derivative(
        linear_motion.displacement, linear_motion.frequency[:, None, None]
    )
    return fourier.sample(
        np.concatenate([linear_motion.displacement, speed], axis=1), 1
    )[..., 0]


def motions_on_flank(linear_motion):
    """Motions (x, x') ``(L, 2S)`` at t = 0 with every mesh on its drive side, carrying
    nearly its linear force.
    """
    shift = linear_motion.flank
    mean = linear_motion.displacement[..., 0].real
    # A little on the way from the motion in contact to rest at its mean: near that
    # motion, and not on it.
    rest = np.concatenate([mean + shift, 0 * shift], axis=1)
    moving = linear_start(linear_motion) + np.concatenate([shift, 0 * shift], axis=1)
    return moving + DISTURBED * (rest - moving)
