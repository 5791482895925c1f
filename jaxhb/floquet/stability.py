"""Stability of a periodic motion of a train: what becomes of a small disturbance of it
(Floquet multipliers).

Over a cycle a disturbance y of the state is multiplied by the monodromy matrix; its
eigenvalues tell whether it dies away (docs/theory A7). A motion that is unstable solves
the equations and does not occur.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from jaxhb._jax import Array, on_host, refuse_tracers
from jaxhb._shown import brief
from jaxhb.balance.march import noticed_modes
from jaxhb.equations import backlash, exact_integrals, fourier
from jaxhb.equations.backlash import MeshParameters
from jaxhb.equations.state_space import (
    ComplexModes,
    StateSpace,
    loss_damping,
    partition,
    state_space,
    unheld_modes,
)
from jaxhb.equations.system import System
from jaxhb.floquet import intervals, variational
from jaxhb.floquet.slopes import Reactions, reactions_of
from jaxhb.results.answers import need_solved
from jaxhb.results.response import Response
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.mesh_parameters import law_meshes
from jaxhb.train.topology import Topology
from jaxhb.train.varying import at_speed

# Natural frequency over Omega of a rotation against grounds that are no support, but a
# hold
SOFT = 0.1
# By how much a multiplier of a train without damping, 1 in modulus, may be off
NEUTRAL = 1e-8
# Intervals of a cycle from which on it is slow: arcs are few and long then, and a dense
# equation solves them one by one, of so many disks at most.
MOST_INTERVALS = 100_000
DENSE_DISKS = 80
# Samples of a motion, before the times at which it passes knots are looked for
FIRST_LOOK = 64
DISKS = 1000  # beyond which it would take minutes


def fall_text(largest: float) -> str:
    """Words for how a disturbance falls by a multiplier below 1: to a share of its
    size, or by one near 1.
    """
    share = f"{largest:.2g}"
    if share == "1":
        return f"falls by {100 * (1 - largest):.1g} %"
    return f"falls to {share} of its size"


@brief
@dataclass(frozen=True)
class Stability:
    """Floquet multipliers of a periodic motion, made by :func:`stability`; ``str`` says
    what they mean.

    Parameters
    ----------
    multipliers : complex ``(n,)``, the largest modulus first, by which disturbances
    grow over one cycle of the response
    rotation : bool ``(n,)``
        Those of the rotation of the whole train, floating or against a ground so soft
        that it turns at less than a tenth of the cycle frequency, and of rings without
        a spring: they say nothing about the teeth. A floating train without damping has
        two that are 1.
    liouville : float
        Determinant of the monodromy matrix over its value by Liouville's formula, less
        1: what the integration leaves in the product of all multipliers. The fastest
        modes, whose multipliers may be 1e-60, weigh most in it.
    """

    multipliers: np.ndarray
    rotation: np.ndarray
    liouville: float

    @property
    def critical(self) -> complex:
        """The multiplier of largest modulus, those of rotation left out; 0 where there
        is no other.
        """
        of_teeth = self.multipliers[~self.rotation]
        return complex(of_teeth[0]) if len(of_teeth) else 0j

    @property
    def largest(self) -> float:
        """Modulus of :attr:`critical`: from 1 on the train does not run in
        this motion.
        """
        return abs(self.critical)

    @property
    def stable(self) -> bool:
        """Whether every disturbance dies away."""
        return self.largest <= 1 + NEUTRAL

    @property
    def loses_by(self) -> str | None:
        """How stability is lost: None, "fold" (a multiplier beyond +1), "period
        doubling" (beyond -1) or "Neimark-Sacker" (a complex pair).
        """
        if self.stable:
            return None
        if self.critical.imag:
            return "Neimark-Sacker"
        return "fold" if self.critical.real > 0 else "period doubling"

    def __str__(self) -> str:
        if self.stable:
            return f"stable: a disturbance {fall_text(self.largest)} in a cycle."
        loses_by = self.loses_by
        assert loses_by is not None  # it is not stable
        manner = {
            "fold": "",
            "period doubling": (
                " and changes its sign each time, so that two cycles differ"
            ),
            "Neimark-Sacker": " and turns, so that a second frequency appears",
        }[loses_by]
        grows = (
            f"unstable ({loses_by}): a disturbance grows {self.largest:.3g} times"
            f" a cycle{manner}"
        )
        return f"{grows}; the train does not run in this motion."


def stability(response: Response) -> Stability:
    """Floquet multipliers of a periodic motion: whether the train runs in it.

    Solves the variational equation around the motion of the harmonics, not around an
    integration of its own, in the damped modes of the train and in intervals that end
    where teeth pass the knots of their law (docs/theory A7;
    :mod:`jaxhb.floquet.intervals`); where teeth stay in contact, or in their gap, all
    multipliers are exponentials of eigenvalues. Massless disks are condensed. Modes
    that no mesh notices decay by themselves. Loss factors, which have no equation in
    time, damp each mode at its natural frequency
    (:func:`jaxhb.equations.state_space.loss_damping`).

    Parameters
    ----------
    response : Response, at one speed, solved, with its train

    Raises
    ------
    NotConverged
        If the response solves no equations.
    ValueError
        For the response of a sweep or of a transformation; for massless disks that
        leave no equation; for more than 1000 disks; where teeth stay in the smooth zone
        of their law for some 100,000 of their vibrations; for more than 80 disks whose
        teeth vibrate 45,000 times a cycle.

    Notes
    -----
    Multipliers are as good as the motion, and less: on ``gear_train_30`` a truncation
    error of 0.6 % makes 6 % at 2300 rpm (a multiplier of -1.18). What is integrated is
    good to 1e-4 of the largest on ``gear_train_30``, to 2e-4 where a multiplier is in
    the hundreds, and to 1e-7 where few modes take part; small multipliers have the
    absolute accuracy of the largest. Work grows with the square of the number of modes
    and with the number of switching times: 0.02 s for ``gear_train_30`` at 1800 rpm,
    0.1 s for the same train in 100 disks, 0.9 s in 300.

    Examples
    --------
    >>> import jaxhb
    >>> stability = jaxhb.stability(
    ...     jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=2000.0)
    ... )
    >>> (
    ...     stability.stable,
    ...     round(stability.largest, 2),
    ...     stability.multipliers[stability.rotation].real.round(2).tolist(),
    ... )
    (True, 0.41, [1.0, 1.0])
    """
    refuse_tracers("stability", response)
    train = at_speed(train_of(response), float(response.rpm))
    system = chain.assemble(train)
    meshes = law_meshes(train)
    topology = train.topology
    if topology.n_disks > DISKS:
        raise ValueError(
            f"{topology.title}: it has {topology.n_disks} disks, and stability is"
            f" decided for up to {DISKS}: divide shafts into fewer pieces."
        )
    parts = partition(
        system, meshes, topology.disk_names, topology.link_names, lossy=True
    )
    frequency = topology.cycle_frequency(float(response.rpm))
    host = on_host(system)
    meshes = on_host(meshes)
    period = 2 * np.pi / frequency
    space = state_space(host, meshes, frequency, parts, loss_damping(host))
    deflection = np.asarray(response.deflections)[topology.law_index]
    constant = _constant_transition(space, meshes, deflection, frequency)
    disturbance: Array
    if constant is not None:
        rates, disturbance = np.linalg.eig(constant)
        multipliers = np.exp(period * rates)
        determinant = period * (rates.sum().real - np.trace(constant))
    else:
        modes = unheld_modes(host, meshes, space, frequency, parts)
        multipliers, disturbance, determinant = _of_motion(
            modes, space, meshes, deflection, frequency, topology
        )
    rotation = _of_rotation(disturbance, space.coordinates, system, frequency)
    order = np.argsort(-np.abs(multipliers), kind="stable")
    with np.errstate(over="ignore"):  # where dry friction sticks, multipliers may be 0
        liouville = float(np.expm1(determinant))
    return Stability(multipliers[order], rotation[order], liouville)


@dataclass(frozen=True)
class Tendency:
    """Tendency of a train near a periodic motion: the :class:`Stability` of the motion,
    None where it is not decided, and the sentence that says why.
    """

    stability: Stability | None
    refusal: str = ""

    @property
    def attracts(self) -> bool | None:
        """Whether the train runs into the motion; None where that is not decided."""
        return None if self.stability is None else bool(self.stability.stable)


def tendency(response: Response) -> Tendency:
    """Decide, where that can be done, whether a train near a periodic motion runs into
    it.
    """
    try:
        return Tendency(stability(response))
    except np.linalg.LinAlgError:  # a ValueError, and no refusal
        raise
    except ValueError as refusal:
        return Tendency(None, str(refusal))


def train_of(response: Response) -> DriveTrain:
    """The train of a response at one speed that solves its equations; ValueError of
    others.
    """
    name = response.topology.title
    if np.ndim(response.rpm):
        raise ValueError(
            f"{name}: this is a sweep of {len(response)} speeds: take one response of"
            " it, sweep[i]."
        )
    if response.train is None:
        raise ValueError(
            f"{name}: the response comes out of a transformation without its train:"
            " solve outside of it."
        )
    need_solved(response)
    return response.train


def _constant_transition(
    space: StateSpace, meshes: MeshParameters, deflection: np.ndarray, frequency: float
) -> np.ndarray | None:
    """The matrix ``(n, n)`` 1/s of the variational equation where it is constant along
    the motion, as of teeth that stay in contact; else None.
    """
    values = fourier.sample(deflection, FIRST_LOOK)
    rates = fourier.sample(fourier.derivative(deflection, frequency), FIRST_LOOK)
    by_deflection, by_rate = backlash.nonlinear_slopes(
        meshes.law.expand(),
        meshes.viscous[:, None],
        meshes.contact_damping[:, None],
        values,
        rates,
    )
    slopes = np.stack([by_deflection, by_rate])
    if meshes.variation is not None or (slopes != slopes[..., :1]).any():
        return None
    if len(_switching_times(meshes, deflection, frequency)):
        return None
    on, following = np.split(space.observation, 2)
    rows = slopes[0, :, :1] * on + slopes[1, :, :1] * following
    return space.transition + space.forcing @ rows


def _switching_times(
    meshes: MeshParameters, deflection: np.ndarray, frequency: float
) -> np.ndarray:
    """Shares of the cycle at which any of the deflections passes a knot of its law."""
    times = exact_integrals.switching_times(meshes.law, deflection)
    if meshes.law.friction is None or meshes.law.slip is None:
        return times
    # Friction is whole from a rate of slip on.
    slip = dataclasses.replace(
        meshes.law, transition=0 * meshes.law.transition, backlash=2 * meshes.law.slip
    )
    rate = fourier.derivative(deflection, frequency)
    return np.concatenate([times, exact_integrals.switching_times(slip, rate)])


def _of_motion(
    modes: ComplexModes,
    space: StateSpace,
    meshes: MeshParameters,
    deflection: np.ndarray,
    frequency: float,
    topology: Topology,
) -> tuple[np.ndarray, Array, float]:
    """Multipliers ``(n,)`` of a motion of teeth that part, their disturbances ``(n,
    n)`` in columns, and the error of the logarithm of the determinant.
    """
    noticed = noticed_modes(modes.rates, modes.forcing, modes.observation, frequency)
    seen = modes.only(noticed)
    reactions = reactions_of(seen, meshes)
    count = intervals.fewest_intervals(seen, reactions, frequency)
    if count <= MOST_INTERVALS:
        multipliers, motion, determinant = _in_modes(
            modes, noticed, reactions, deflection, frequency
        )
        return multipliers, space.coordinates @ motion, determinant
    if topology.n_disks > DENSE_DISKS:
        raise ValueError(
            f"{topology.title}: stability would take {count:.3g} intervals a cycle, as"
            " teeth vibrate fast beside it: ask at a higher speed."
        )
    times = _switching_times(meshes, deflection, frequency)
    cycle = variational.monodromy(space, meshes, deflection, frequency, times)
    multipliers, disturbance = np.linalg.eig(cycle.matrix)
    return multipliers, disturbance, cycle.log_determinant - cycle.trace


def _in_modes(
    modes: ComplexModes,
    noticed: np.ndarray,
    reactions: Reactions,
    deflection: np.ndarray,
    frequency: float,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Multipliers ``(n,)``, their disturbances ``(2S, n)`` of (x, x') in columns, and
    the error of the logarithm of the determinant; reactions of the modes that meshes
    notice.
    """
    seen = modes.only(noticed)
    alone = modes.only(~noticed)
    cycle = intervals.monodromy(seen, reactions, deflection, frequency)
    multipliers, vectors = np.linalg.eig(cycle.matrix)
    disturbance = intervals.real_states(seen, seen.motion) @ vectors
    # A mode that no mesh notices decays by itself, and so does its conjugate.
    turning = alone.only(alone.rates.imag != 0)
    rates = np.concatenate([alone.rates, turning.rates.conj()])
    multipliers = np.concatenate([multipliers, np.exp(2 * np.pi / frequency * rates)])
    disturbance = np.concatenate(
        [disturbance, alone.motion, turning.motion.conj()], axis=1
    )
    return multipliers, disturbance, cycle.log_determinant - cycle.trace


def _of_rotation(
    disturbance: Array, coordinates: Array, system: System, frequency: float
) -> np.ndarray:
    """Mask of the eigenvectors of a monodromy matrix, its columns, that are those of
    rotation.
    """
    # Those nearest to the space of rotations: by their values a slow decay of the teeth
    # could not be told from them. Rotations are motions (S, d) of the disks that bend
    # no link, meshes in contact, held by soft grounds at most. Null space of the links
    # that have a stiffness; of it, what only soft grounds hold.
    rows = (system.incidence() * (np.asarray(system.stiffness) > 0)).T
    _, values, right = np.linalg.svd(rows)
    free = right[np.count_nonzero(values > 1e-10 * values.max(initial=1e-300)) :].T
    inertia, held = (
        free.T @ (np.asarray(field)[:, None] * free)
        for field in (system.mass, system.ground)
    )
    squares, shapes = np.linalg.eig(np.linalg.pinv(inertia) @ held)
    rotations = free @ shapes.real[:, squares.real < (SOFT * frequency) ** 2]
    basis, _ = np.linalg.qr(coordinates @ np.kron(np.eye(2), rotations))
    size = np.linalg.norm(disturbance, axis=0)
    share = np.linalg.norm(basis.T @ disturbance, axis=0) / size
    nearest = np.argsort(-share, kind="stable")[: basis.shape[1]]
    return np.isin(np.arange(len(share)), nearest)
