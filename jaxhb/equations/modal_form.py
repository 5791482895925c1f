"""The equations of a march in modal form: every mode by itself, so that lanes of other speeds share all but rates.

The state space of :mod:`jaxhb.equations.state_space`, ``y' = A y + E phi``, in its damped modes ``A V = V
diag(rates)``:

    z' = rates z + forcing phi,     (l, l') = Re(observation z),     (x, x') = Re(motion z).

One mode of each conjugate pair is kept and counted twice. Free rotation and rings without spring have a Jordan block,
which no eigenvectors span: a spring far below the cycle frequency parts it, which no mesh notices. Rates at
which eigenvectors coincide are parted by a little more damping.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from jaxhb._jax import on_host
from jaxhb.equations.state_space import MODAL, loss_damping, matrices, state_space


@dataclass(frozen=True)
class Modes:
    """Host arrays of m modes, G meshes, S disks; complex.

    rates ``(m,)`` 1/s; forcing ``(m, G)``; observation ``(2G, m)``; motion ``(2S, m)``; coordinates ``(m, 2S)``: z of
    (x, x').
    """

    rates: np.ndarray
    forcing: np.ndarray
    observation: np.ndarray
    motion: np.ndarray
    coordinates: np.ndarray


def march_modes(system, meshes, frequency, parts):
    """The :class:`Modes` of a train.

    Parameters
    ----------
    system : System
    meshes : MeshParameters, the backlash meshes
    frequency : float, Omega in rad/s, scales the slow modes
    parts : Partition

    Returns
    -------
    Modes
    """
    inertial = np.array(parts.inertial, int)
    highest = np.max(np.asarray(system.held_stiffness())[inertial] / system.mass[inertial])
    # Springs in proportion to the inertias leave the undamped shapes as they are: they part the Jordan block of free
    # rotation, and raise the other frequencies by less than rounding shows.
    soft = max((MODAL.held * frequency) ** 2, MODAL.held_rounded * highest)
    held = dataclasses.replace(system, ground=system.ground + soft * system.mass)
    space = state_space(*on_host((held, meshes)), frequency, parts, loss_damping(held))
    A, T = np.asarray(space.transition), np.asarray(space.coordinates)
    return modes_of(space, _motion(system, A, T, parts))


def modes_of(space, motion):
    """The :class:`Modes` of a StateSpace; ``motion`` ``(2S, n)``: (x, x') of its states."""
    A, E, L, T = (np.asarray(a) for a in (space.transition, space.forcing, space.observation, space.coordinates))
    rates, vectors = _eigen(A)
    # Of a conjugate pair one mode, counted twice below: Re(v z) of both is twice that of one.
    one = rates.imag >= 0
    inverse = np.linalg.inv(vectors)[one]
    rates, vectors = rates[one], np.where(rates[one].imag > 0, 2.0, 1.0) * vectors[:, one]
    return Modes(rates, inverse @ E, L @ vectors, motion @ vectors, inverse @ T)


def _eigen(A):
    """Eigenvalues and well-conditioned eigenvectors of a matrix."""
    rates, vectors = np.linalg.eig(A)
    if np.linalg.cond(vectors) > MODAL.condition:
        shares = (1 + np.arange(len(A))) / len(A)
        # Different shares for every state: equal ones would move all eigenvalues alike and part none.
        rates, vectors = np.linalg.eig(A - np.diag(MODAL.parting * np.abs(np.diag(A)).max() * shares))
    return rates, vectors


def _motion(system, A, T, parts):
    """(x, x') ``(2S, n)`` of all disks from the state."""
    inertial, kept = np.array(parts.inertial, int), np.array(parts.inertial + parts.damped, int)
    static, disks = np.array(parts.static, int), len(system.mass)
    inverse = np.linalg.inv(T[:, np.concatenate([kept, disks + inertial])])
    x = np.zeros((disks, len(A)))
    x[kept] = inverse[: len(kept)]
    if static.size:
        K = np.asarray(matrices(system)[1])
        x[static] = -np.linalg.solve(K[np.ix_(static, static)], K[np.ix_(static, kept)] @ x[kept])
    return np.concatenate([x, x @ A])
