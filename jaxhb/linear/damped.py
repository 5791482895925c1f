"""Free vibration with damping: complex frequencies, damping ratios and shapes on the
host, derivatives anywhere.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from scipy.linalg import eig

from jaxhb._jax import Array, concrete, namespace, on_host, refuse_tracers, traced
from jaxhb._shown import brief
from jaxhb.equations.system import System
from jaxhb.linear.modal import Modes
from jaxhb.linear.tangent import linear_train
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain

CREEPING = 0.01
"""Im lambda / |lambda| up to which a mode counts as not oscillating (damping ratio
0.99995): a loss factor turns the eigenvalues of motions that creep back a little off
the real axis.
"""
# Least modal assurance criterion of a damped and an undamped mode that count as the
# same
ALIKE = 0.5
AT_REST = 1e-10
"""Modulus, over the largest number of the pencil, that is rounding of a motion without
force. Not over the largest eigenvalue: a disk without inertia on links with little
damping r relaxes at k/r, which belongs to no mode.
"""
DAMPED_DISKS = 300  # disks up to which damping ratios take seconds


@brief
@dataclass(frozen=True)
class DampedModes:
    """Complex modes ``e^{lambda t}`` of a damped train, meshes in contact.

    Parameters
    ----------
    names : tuple of str, the S disks
    eigenvalues : complex ``(m,)`` 1/s, lambda of the modes that oscillate, by rising
    imaginary part
    shapes : complex ``(m, S)`` angles of the disks, the largest is 1
    decay_rates : ``(n,)`` 1/s, -Re lambda of motions that creep back without
    oscillation, rising; without rest, and without
        motions some 1e12 times as fast as the train (a disk without inertia on links
        with next to no damping)
    """

    names: tuple
    eigenvalues: np.ndarray
    shapes: np.ndarray
    decay_rates: np.ndarray

    @property
    def frequencies_hz(self) -> Array:
        """``(m,)`` Hz, Im lambda / 2 pi: of the decaying oscillation."""
        return self.eigenvalues.imag / (2 * np.pi)

    @property
    def damping_ratio(self) -> Array:
        """``(m,)`` Lehr's damping ratio, ``-Re lambda / |lambda|``: 1 at critical
        damping.
        """
        return _lehr(self.eigenvalues)


def damped_modes(train: DriveTrain) -> DampedModes:
    """Modes of free vibration with all viscous damping and loss factors, meshes in
    contact; of a concrete train.

    Eigenvalues of ``(lambda^2 M + lambda B + K) v = 0`` by the QZ method (C. B. Moler,
    G. W. Stewart, SIAM J. Numer. Anal. 10 (1973) 241) from ``M v' = -(B + D^T R D) v -
    D^T C l``, ``l' = D v``, with the link deflections l as unknowns: rigid rotation is
    then a state at rest, and a free train has no double eigenvalue zero. A loss factor
    gives the link the stiffness ``k (1 + i eta)``, which holds for the modes with
    positive imaginary part, the ones returned. Disks without inertia have no eigenvalue
    of their own.

    >>> parts = [jaxhb.Disk(name=name, inertia=2.0) for name in "ab"]
    >>> parts.append(jaxhb.Shaft(between=("a", "b"), stiffness=100.0, damping=2.0))
    >>> modes = jaxhb.damped_modes(jaxhb.build(parts))
    >>> modes.eigenvalues.round(6).tolist(), modes.damping_ratio.round(6).tolist()
    ([(-1+9.949874j)], [0.1])
    """
    refuse_tracers(
        "damped_modes",
        train,
        instead="pass its modes to jaxhb.damped_eigenvalues, which traces",
        host=True,
    )
    system = on_host(chain.assemble(linear_train(train)))
    values, velocity, resolved = _eigenpairs(system)
    order = np.argsort(values.imag, kind="stable")
    order = order[np.abs(values[order]) > AT_REST * resolved]
    slant = values.imag[order] / np.abs(values[order])
    oscillating = order[slant > CREEPING]
    creeping = order[np.abs(slant) <= CREEPING]
    angles = velocity[:, oscillating] / system.radius[:, None]
    largest = np.abs(angles).argmax(0)
    shapes = (angles / angles[largest, np.arange(len(largest))]).T
    return DampedModes(
        train.topology.disk_names,
        values[oscillating],
        shapes,
        np.sort(-values.real[creeping]),
    )


def damped_eigenvalues(train: DriveTrain, modes: DampedModes) -> Array:
    """Eigenvalues of damped modes ``(m,)`` in 1/s with their first derivatives, in any
    mode of jax.

    ``lambda = lambda_0 - v^T Q(lambda_0) v / (v^T Q'(lambda_0) v)`` with ``Q = lambda^2
    M + lambda B + K``: Q is symmetric, so that v is left eigenvector too, without
    conjugation (P. Lancaster, Lambda-Matrices and Vibrating Systems, Pergamon 1966).
    Derivatives are those of simple eigenvalues; second ones are not.

    ``modes`` are those of the ``train``, which may be traced, or of one near it: the
    eigenvalues are then right to first order in the change.

    >>> import jax
    >>> parts = [jaxhb.Disk(name=name, inertia=2.0) for name in "ab"]
    >>> train = jaxhb.build(
    ...     [*parts, jaxhb.Shaft(between=("a", "b"), stiffness=100.0, damping=2.0)]
    ... )
    >>> modes = damped_modes(train)
    >>> decay = lambda r: (
    ...     -damped_eigenvalues(train.replace({"a|b.damping": r}), modes)[0].real
    ... )  # r / 2 for two disks
    >>> round(float(jax.grad(decay)(2.0)), 9)
    0.5
    """
    system = chain.assemble(linear_train(train))
    value = jnp.asarray(modes.eigenvalues)
    x = jnp.asarray(modes.shapes.T) * jnp.asarray(system.radius)[:, None]
    bent = system.deflections(x)
    # Squares, not moduli: Q is symmetric, not Hermitian.
    inertia = system.mass @ x**2
    resistance = system.damping @ x**2 + system.viscous @ bent**2
    stiffness = (
        system.ground @ x**2 + (system.stiffness * (1 + 1j * system.loss)) @ bent**2
    )
    return value - (value * (value * inertia + resistance) + stiffness) / (
        2 * value * inertia + resistance
    )


def damping_ratios(train: DriveTrain, modes: Modes) -> Array:
    """Damping ratio of each undamped mode ``(m,)``: the ratio of the damped mode with
    the most similar shape.

    Pairs have the largest sum of the modal assurance criterion ``|phi^T J psi|^2 /
    (phi^T J phi psi^* J psi)`` (R. J. Allemang, D. L. Brown, Proc. IMAC 1 (1982) 110),
    here weighted with the inertias.

    ``modes`` are those of the same train. The ratio is Lehr's ``-Re lambda /
    |lambda|``, nan for rigid modes and where heavy damping leaves no similar mode.
    First derivatives are those of :func:`damped_eigenvalues`. ValueError inside ``jit``
    or ``vmap``, as the values decide which modes are alike.

    >>> train = jaxhb.load_scene("spur_pair")
    >>> damping_ratios(train, jaxhb.natural_frequencies(train)).round(3).tolist()
    [nan, 0.05]
    """
    (values,) = concrete(train)
    if traced(values):
        raise ValueError(
            "damping_ratios: jit or vmap traces the train, and its values decide which"
            " damped mode is like which undamped one. Call it outside, where it has"
            " derivatives, or use damped_eigenvalues."
        )
    system = on_host(chain.assemble(values))
    damped = damped_modes(values)
    inertia = system.mass * system.radius**2
    # Rigid modes have exactly 0 Hz: they are counted on the graph, not computed.
    moving = np.flatnonzero(modes.frequencies_hz)
    phi = modes.shapes[moving]
    psi = damped.shapes
    size = np.outer((inertia * phi**2).sum(1), (inertia * np.abs(psi) ** 2).sum(1))
    criterion = np.abs((phi * inertia) @ psi.T) ** 2 / size
    # Takes a tenth of a second, which other commands are spared.
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(criterion, maximize=True)
    damped_mode = {
        moving[row]: column
        for row, column in zip(rows, columns, strict=True)
        if criterion[row, column] > ALIKE
    }
    eigenvalues = (
        damped_eigenvalues(train, damped) if traced(train) else damped.eigenvalues
    )
    ratio = _lehr(eigenvalues)
    xp = namespace(eigenvalues)
    return xp.stack(
        [
            ratio[damped_mode[mode]] if mode in damped_mode else np.nan
            for mode in range(len(modes.frequencies_hz))
        ]
    )


def _lehr(eigenvalues: Array) -> Array:
    """Lehr's damping ratio ``-Re lambda / |lambda|``."""
    return -eigenvalues.real / namespace(eigenvalues).abs(eigenvalues)


def _eigenpairs(system: System) -> tuple[np.ndarray, np.ndarray, float]:
    """Finite eigenvalues ``(n,)`` in 1/s, the velocities v ``(S, n)``, and the largest
    number in 1/s of the equations.
    """
    rows, stiffness = system.springs()
    incidence = rows[: len(system.loss)]
    elastic = np.flatnonzero(stiffness)
    loss = np.append(system.loss, np.zeros(len(system.ground)))[elastic]
    rows = rows[elastic]
    stiffness = stiffness[elastic]
    resistance = np.diag(system.damping) + incidence.T @ (
        system.viscous[:, None] * incidence
    )
    # Disks without inertia are scaled by what resists them; a disk that nothing resists
    # takes no part.
    weight = np.where(
        system.mass > 0,
        system.mass,
        (stiffness[:, None] * rows**2).sum(0) + np.diag(resistance),
    )
    coupled = np.flatnonzero(weight)
    scale = 1 / np.sqrt(weight[coupled])
    # QZ rounds to the largest entry: with sqrt(m) v and sqrt(k) l as unknowns all are
    # in 1/s, and none is a stiffness.
    E = np.sqrt(stiffness)[:, None] * rows[:, coupled] * scale
    disks = len(coupled)
    size = len(coupled) + len(stiffness)
    left = np.zeros((size, size), complex)
    right = np.eye(size)
    left[:disks, :disks] = (
        -scale[:, None] * resistance[np.ix_(coupled, coupled)] * scale
    )
    left[:disks, disks:] = -E.T * (1 + 1j * loss)
    left[disks:, :disks] = E
    right[:disks, :disks] = np.diag((system.mass[coupled] > 0).astype(float))
    (alpha, beta), vectors = eig(left, right, homogeneous_eigvals=True)
    largest = np.abs(left).max(initial=0.0)
    # Disks without inertia add eigenvalues at infinity, where beta is 0 but for
    # rounding.
    finite = np.abs(beta) * largest > 1e-12 * np.abs(alpha)
    velocity = np.zeros((len(system.mass), int(finite.sum())), complex)
    velocity[coupled] = scale[:, None] * vectors[:disks, finite]
    return alpha[finite] / beta[finite], velocity, largest
