"""Steps of one train at several speeds, in modes that the speeds share, made on the
host.

In complex modes (:mod:`jaxhb.equations.state_space`) propagators and weights are one
number per mode and speed, so that steps of another length cost nothing.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np

from jaxhb._jax import Array, Numbers
from jaxhb.equations import backlash, fourier
from jaxhb.equations.backlash import MeshParameters
from jaxhb.equations.condensation import displacements_and_bends
from jaxhb.equations.state_space import ComplexModes, matrices, static_response
from jaxhb.equations.system import System
from jaxhb.integration.step import (
    KrogstadWeights,
    Stepper,
    force_on_flank,
    krogstad,
    rows_of,
)
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import excitation
from jaxhb.train.mesh_parameters import all_meshes

# Time samples of a cycle at which its motion is compared with that of other cycles;
# divides every number of steps.
SAMPLES = 32
# Share of the motion in contact that a start from there lacks: the march would stay
# on a motion that repels for long.
DISTURBED = 0.02


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinearMotion:
    """Motion of the linear train at L speeds: frequency ``(L,)`` rad/s; displacement
    ``(L, S, N+1)`` m of the disks and deflection ``(L, M, N+1)`` m of the meshes with
    backlash; flank ``(L, S)`` m, the shift of the disks onto the drive sides.
    """

    frequency: np.ndarray
    displacement: np.ndarray
    deflection: np.ndarray
    flank: np.ndarray


def motions_in_contact(
    train: DriveTrain,
    rpm: np.ndarray,
    system: System,
    every: MeshParameters,
    harmonics: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Displacements ``(L, S, N+1)`` m under the excitation of speeds ``(L,)`` rpm, all
    meshes in contact, and deflections ``(L, links, N+1)`` m of all links, on the host;
    every : MeshParameters of all meshes.
    """
    frequency = train.topology.cycle_frequency(rpm)
    load = excitation(train, rpm, harmonics)[0] / system.radius[:, None]
    load = np.stack(
        [
            backlash.error_load(system, every, omega, speed_load)
            for omega, speed_load in zip(frequency, load, strict=True)
        ]
    )
    return displacements_and_bends(system, frequency, load)


def linear_motions(
    train: DriveTrain,
    rpm: Numbers,
    system: System,
    meshes: MeshParameters,
    harmonics: int,
) -> LinearMotion:
    """The :class:`LinearMotion` at speeds ``(L,)`` rpm, on the host."""
    rpm = np.asarray(rpm, float)
    stiffness = matrices(system)[1]
    displacement, bends = motions_in_contact(
        train, rpm, system, all_meshes(train), harmonics
    )
    frequency = train.topology.cycle_frequency(rpm)
    deflection = bends[:, meshes.link]
    forces = (
        force_on_flank(meshes.law, mesh_deflection) for mesh_deflection in deflection
    )
    shift = np.stack(
        [
            static_response(stiffness, system.spread(-force, meshes.link))
            for force in forces
        ]
    )
    return LinearMotion(frequency, displacement, deflection, shift)


def steppers(
    modes: ComplexModes,
    system: System,
    meshes: MeshParameters,
    linear_motion: LinearMotion,
    steps: int,
) -> Stepper:
    """The :class:`~jaxhb.integration.step.Stepper` of all speeds of a LinearMotion:
    numpy arrays with a leading axis ``L``.

    meshes : those of the System with backlash; steps : per cycle, a multiple of 32.
    """
    deflection = backlash.less_error(meshes, linear_motion.deflection)
    motion = np.concatenate(
        [
            deflection,
            fourier.derivative(deflection, linear_motion.frequency[:, None, None]),
        ],
        axis=1,
    )
    linear = np.ascontiguousarray(
        np.moveaxis(fourier.synthesize(motion, 2 * steps), 1, 2)
    )

    def at_every_speed(values: Array) -> np.ndarray:
        return np.broadcast_to(values, (len(linear), *np.shape(values)))

    variation = None
    if meshes.variation is not None:
        variation = at_every_speed(rows_of(meshes.variation, steps))
    return Stepper(
        weights=_weights(modes, 2 * np.pi / linear_motion.frequency[:, None] / steps),
        linear=linear,
        observation=at_every_speed(
            np.concatenate([modes.observation.real, -modes.observation.imag], axis=1)
        ),
        law=jax.tree.map(at_every_speed, meshes.law),
        viscous=at_every_speed(meshes.viscous),
        contact_damping=at_every_speed(meshes.contact_damping),
        variation=variation,
    )


def _weights(modes: ComplexModes, dt: np.ndarray) -> KrogstadWeights:
    """The weights of steps of ``dt`` ``(L, 1)`` seconds."""
    exponent = modes.rates * dt
    half_1, half_2 = (dt * phi for phi in _phi_functions(exponent / 2)[:2])
    full_1, full_2, full_3 = (dt * phi for phi in _phi_functions(exponent))
    first, second, third, end = krogstad(half_1 / 2, half_2, full_1, full_2, full_3)

    def forced_states(weights: Sequence[Array]) -> np.ndarray:
        """States ``(L, m, j G)`` of complex modes under the forces of j stages."""
        return np.concatenate(
            [weight[:, :, None] * modes.forcing for weight in weights], axis=2
        )

    def observed(states: np.ndarray) -> np.ndarray:
        return (modes.observation @ states).real

    propagator = np.exp(exponent)
    ahead = np.concatenate(
        [
            modes.observation * np.exp(power)[:, None]
            for power in (exponent, exponent / 2)
        ],
        axis=1,
    )
    end_states = forced_states(end)
    return KrogstadWeights(
        propagator=np.stack(
            [
                np.stack([propagator.real, -propagator.imag], 1),
                np.stack([propagator.imag, propagator.real], 1),
            ],
            1,
        ),
        ahead=np.concatenate([ahead.real, -ahead.imag], axis=2),
        first=observed(forced_states(first)),
        second=observed(forced_states(second)),
        third=observed(forced_states(third)),
        end=np.concatenate(
            [end_states.real, end_states.imag, observed(end_states)], axis=1
        ),
    )


def _phi_functions(z: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return phi_1, phi_2, phi_3 of z: (e^z - 1) / z, (phi_1 - 1) / z and
    (phi_2 - 1/2) / z; by their series where z is small.
    """
    # The closed forms cancel where z is small, (e^z - 1) / z to all digits at z =
    # 1e-16: there 20 terms of the series.
    small = np.abs(z) < 1.0
    safe = np.where(small, 1.0, z)
    near = np.where(small, z, 0.0)
    series = [
        sum(near**j / math.factorial(j + k) for j in range(20)) for k in (1, 2, 3)
    ]
    phi_1 = (np.exp(safe) - 1) / safe
    phi_2 = (phi_1 - 1) / safe
    phi_3 = (phi_2 - 0.5) / safe
    return tuple(
        np.where(small, near_zero, closed_form)
        for near_zero, closed_form in zip(series, (phi_1, phi_2, phi_3), strict=True)
    )


def state_of(
    modes: ComplexModes, motion: np.ndarray, linear_motion: LinearMotion
) -> np.ndarray:
    """States ``(L, 2m)`` of motions (x, x') ``(L, 2S)`` at t = 0: their deviations from
    the linear train.
    """
    z = (motion - linear_start(linear_motion)) @ modes.coordinates.T
    return np.concatenate([z.real, z.imag], axis=1)


def motion_of(
    modes: ComplexModes, state: Array, linear_motion: LinearMotion
) -> np.ndarray:
    """Motions (x, x') ``(L, 2S)`` at t = 0 of states ``(L, 2m)``."""
    real, imag = np.split(np.asarray(state), 2, axis=1)
    return (
        real @ modes.motion.real.T
        - imag @ modes.motion.imag.T
        + linear_start(linear_motion)
    )


def linear_start(linear_motion: LinearMotion) -> np.ndarray:
    """(x, x') ``(L, 2S)`` of the linear train at t = 0."""
    speed = fourier.derivative(
        linear_motion.displacement, linear_motion.frequency[:, None, None]
    )
    return fourier.sample(
        np.concatenate([linear_motion.displacement, speed], axis=1), 1
    )[..., 0]


def motions_on_flank(linear_motion: LinearMotion) -> np.ndarray:
    """Motions (x, x') ``(L, 2S)`` at t = 0 with every mesh on its drive side, carrying
    nearly its linear force.
    """
    shift = linear_motion.flank
    mean = linear_motion.displacement[..., 0].real
    # A little of the way from the motion in contact to rest at its mean: near that
    # motion, and not on it.
    rest = np.concatenate([mean + shift, 0 * shift], axis=1)
    moving = linear_start(linear_motion) + np.concatenate([shift, 0 * shift], axis=1)
    return moving + DISTURBED * (rest - moving)
