"""Whether a train runs in a periodic motion: what becomes of a small disturbance of it (Floquet multipliers).

Over a cycle a disturbance y of the state is multiplied by the monodromy matrix; its eigenvalues tell whether it dies
away (docs/theory A7). A motion that is unstable solves the equations and does not occur.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .._arrays import on_host
from .._program import Program
from .._shown import brief
from ..harmonic import chain, exact
from ..harmonic.excitation import listed_harmonic
from ..harmonic.residual import backlash_meshes
from ..response.response import Response
from ..response.status import NotConverged, Status
from ..transient.reduced_model import REDUCED_MODEL
from ..transient.statespace import loss_damping, partition, state_space
from ..transient.stepper import exponential
from ..transient.variational import monodromy
from . import correction
from .plan import Plan
from .planned import active_deflections
from .planning import mesh_mode_harmonics
from .problem import model_of, problem_at, reduced_equation
from .time_steps import time_steps_for


@dataclass(frozen=True)
class StabilityOptions:
    """How multipliers are computed, and what they mean.

    Parameters
    ----------
    soft : natural frequency over Omega of a rotation against grounds below which these are soft: no support, but a hold
    neutral : by how much a multiplier of a train without damping, 1 in modulus, may be off
    samples : time samples per harmonic at which slopes are taken for averages: damping in contact gives them short
        peaks
    dense_disks : disks up to which all multipliers are computed where only the largest is asked for
    estimated : largest estimate that counts as stable beyond that, and where massless disks leave no multipliers
    """

    soft: float = 0.1
    neutral: float = 1e-8
    samples: int = 64
    dense_disks: int = 100
    estimated: float = 1.1


STABILITY = StabilityOptions()


@brief
@dataclass(frozen=True)
class Stability:
    """Floquet multipliers of a periodic motion, made by :func:`stability`; ``str`` says what they mean.

    Parameters
    ----------
    multipliers : complex array ``(n,)``, the largest modulus first
        Factors by which disturbances of the state grow over one cycle of the response.
    rotation : bool array ``(n,)``
        Those of the rotation of the whole train, floating or against a soft ground (:class:`StabilityOptions`), and of
        rings without a spring: they say nothing about the teeth. A floating train without damping has two that are 1.
    liouville : float
        Determinant of the monodromy matrix over its value by Liouville's formula, less 1: what the integration leaves.
    """

    multipliers: np.ndarray
    rotation: np.ndarray
    liouville: float

    @property
    def critical(self) -> complex:
        """The multiplier of largest modulus, those of rotation left out; 0 where there is no other."""
        own = self.multipliers[~self.rotation]
        return complex(own[0]) if len(own) else 0j

    @property
    def largest(self) -> float:
        """Modulus of :attr:`critical`: from 1 on the motion is not what the train does."""
        return abs(self.critical)

    @property
    def stable(self) -> bool:
        """Whether every disturbance dies away."""
        return self.largest <= 1 + STABILITY.neutral

    @property
    def loses_by(self) -> str | None:
        """How stability is lost: None, "fold" (a multiplier beyond +1), "period doubling" (beyond -1) or
        "Neimark-Sacker" (a complex pair)."""
        if self.stable:
            return None
        if self.critical.imag:
            return "Neimark-Sacker"
        return "fold" if self.critical.real > 0 else "period doubling"

    def __str__(self):
        if self.stable:
            return f"stable: a disturbance falls to {self.largest:.2g} of its size in a cycle."
        grows = f"unstable ({self.loses_by}): a disturbance grows {self.largest:.3g} times a cycle"
        return f"{grows}{_MANNER[self.loses_by]}; the train does not run in this motion."


_MANNER = {
    "fold": "",
    "period doubling": " and changes its sign each time, so that two cycles differ",
    "Neimark-Sacker": " and turns, so that a second frequency appears",
}


def stability(response: Response) -> Stability:
    """Floquet multipliers of a periodic motion: whether the train runs in it.

    Solves the variational equation around the motion of the harmonics, not around an integration of its own, in steps
    that end where teeth pass the knots of their law (docs/theory A7; :mod:`jaxhb.transient.variational`). All states of
    the train take part; massless disks are condensed. Loss factors, which have no equation in time, damp each mode at
    its natural frequency (:func:`jaxhb.transient.statespace.loss_damping`).

    Parameters
    ----------
    response : Response
        At one speed, solved, with its train.

    Returns
    -------
    Stability

    Raises
    ------
    NotConverged
        If the response solves no equations.
    ValueError
        For the response of a sweep or of a transformation; for massless disks that leave no equation.

    Notes
    -----
    Multipliers are as good as the motion, and less: on ``gear_train_30`` a truncation error of 0.6 % makes 6 % at 2300
    rpm (a multiplier of -1.18), and one of 1 % makes 12 % at 2350 rpm (22). Small multipliers have the absolute
    accuracy of the largest.
    Work grows with the cube of the number of states and with the number of switching times: 0.08 s for the 54 states
    and 424 times of ``gear_train_30`` at 1800 rpm.

    Examples
    --------
    >>> import jaxhb
    >>> found = jaxhb.stability(jaxhb.solve(jaxhb.load_scene("gear_train_30"), rpm=1800.0))
    >>> found.stable, round(found.largest, 2), found.multipliers[found.rotation].real.round(2).tolist()
    (True, 0.15, [1.0, 0.98])
    """
    train = train_of(response)
    system, meshes, topology = chain.assemble(train), backlash_meshes(train), train.topology
    parts = partition(system, meshes, topology.disk_names, topology.link_names, lossy=True)
    frequency = topology.cycle_frequency(float(response.rpm))
    deflection = np.asarray(response.deflections)[topology.backlash_index]
    host = on_host(system)
    space = state_space(host, on_host(meshes), frequency, parts, loss_damping(host))
    found = monodromy(space, meshes, deflection, frequency, exact.switching_times(meshes.law, deflection))
    multipliers, rotation = _multipliers(found.matrix, space.coordinates, system, frequency)
    return Stability(multipliers, rotation, float(np.expm1(found.log_determinant - found.trace)))


def largest_multiplier(response: Response) -> float:
    """Modulus of the largest Floquet multiplier, rotation left out, nearly, in a quarter of the time: for sweeps.

    From the linearised periodic operator that preconditions Newton's method, with twice its time steps: forces change
    linearly in a step, and a large train has 48 modes. Disks without inertia do no harm.

    Parameters
    ----------
    response : Response
        At one speed, solved, with its train.

    Returns
    -------
    float
        On ``gear_train_30`` within 0.1 % of ``stability(response).largest`` up to 2000 rpm; above, where the teeth
        hammer hardest, up to 11 % off at the speeds tried: what is nearer to 1 is for :func:`stability` to decide.

    Raises
    ------
    NotConverged, ValueError
        As :func:`stability`, but not for massless disks; and for more than 64 disks without a mesh with backlash.

    Examples
    --------
    >>> import jaxhb
    >>> round(jaxhb.largest_multiplier(jaxhb.solve(jaxhb.load_scene("gear_train_30"), rpm=1800.0)), 2)
    0.15
    """
    train, rpm = train_of(response), float(response.rpm)
    gaps, excited = train.topology.mesh_backlash, listed_harmonic(train.topology)
    if not reducible(train.topology):
        raise ValueError(
            f"{train.topology.title}: no mesh has backlash, and the multipliers of {train.topology.n_disks} "
            "disks are those of the modes that such meshes excite. Use jaxhb.damped_modes for a linear train."
        )
    highest = max(mesh_mode_harmonics(train, train.topology.cycle_frequency(rpm))[0], 2 * excited)
    plan = Plan(
        harmonics=response.harmonics,
        active=tuple(np.flatnonzero(gaps).tolist()),
        flank=(0,) * len(gaps),
        time_steps=time_steps_for(2 * highest),
        excited=excited,
    )
    problem = problem_at(train, rpm, excited)
    sizes = replace(plan.sizes, samples=STABILITY.samples * response.harmonics)
    found = _monodromy(problem, plan.active_meshes, active_deflections(plan, response.deflections), sizes)
    matrix, coordinates = jax.tree.map(np.asarray, found)
    multipliers, rotation = _multipliers(matrix, coordinates, problem.system, problem.frequency)
    return float(np.max(np.abs(multipliers[~rotation]), initial=0.0))


def attracts(response):
    """Whether a train that is near a periodic motion runs into it, as far as multipliers can be told; and its
    :class:`Stability`, None where that is refused or takes too long."""
    if response.train.topology.n_disks <= STABILITY.dense_disks:
        with suppress(ValueError):  # a massless disk without an equation
            found = stability(response)
            return bool(found.stable), found
    return largest_multiplier(response) <= STABILITY.estimated, None


@partial(Program, static_argnames="sizes")
def _monodromy(problem, active_meshes, deflection, sizes):
    """Monodromy matrix ``(n, n)`` of the linearised periodic operator, and the coordinates of its states."""
    harmonics = deflection.shape[-1] - 1
    model = model_of(problem, active_meshes, sizes.time_steps)
    if not len(deflection):
        return exponential(2 * jnp.pi / problem.frequency * model.space.transition), model.space.coordinates
    reduced, _ = reduced_equation(problem, harmonics, active_meshes)
    propagators = correction.prepare(reduced, model, deflection, sizes.samples, sizes.time_steps).block_propagator
    matrix, _ = lax.scan(lambda matrix, block: (block @ matrix, None), jnp.eye(propagators.shape[1]), propagators)
    return matrix, model.space.coordinates


def reducible(topology):
    """Whether the largest multiplier can be found: of large trains from the modes that meshes with backlash excite."""
    return any(topology.mesh_backlash) or topology.n_disks <= REDUCED_MODEL.disks


def train_of(response):
    """The train of a response at one speed that solves its equations."""
    name = response.topology.title
    if np.ndim(response.rpm):
        raise ValueError(f"{name}: this is a sweep of {len(response)} speeds: take one response of it, sweep[i].")
    if response.train is None:
        raise ValueError(f"{name}: the response comes out of a transformation without its train: solve outside of it.")
    status = Status(int(response.status))
    if status > Status.TOLERANCE_NOT_MET:
        raise NotConverged(f"{name} at {float(response.rpm):g} rpm is no periodic motion: {status.sentence}.")
    return response.train


def _multipliers(matrix, coordinates, system, frequency):
    """Eigenvalues of a monodromy matrix ``(n, n)``, the largest first, and which are those of rotation."""
    own = np.any(coordinates != 0, axis=1)  # a reduced-order model leaves room for modes that it has not
    matrix, coordinates = matrix[np.ix_(own, own)], coordinates[own]
    multipliers, disturbance = np.linalg.eig(matrix)
    order = np.argsort(-np.abs(multipliers), kind="stable")
    # Multipliers of rotation by their eigenvectors, those nearest to the space of rotations: by their values a slow
    # decay of the teeth could not be told from them.
    basis, _ = np.linalg.qr(coordinates @ np.kron(np.eye(2), _rotations(system, frequency)))
    share = np.linalg.norm(basis.T @ disturbance[:, order], axis=0)
    return multipliers[order], np.isin(np.arange(len(order)), np.argsort(-share, kind="stable")[: basis.shape[1]])


def _rotations(system, frequency):
    """Motions ``(S, d)`` of the disks that bend no link, meshes taken in contact, held by soft grounds at most."""
    # Null space of the links that have a stiffness; of it, what only soft grounds hold.
    rows = (system.incidence() * (np.asarray(system.stiffness) > 0)).T
    _, values, right = np.linalg.svd(rows)
    free = right[np.count_nonzero(values > 1e-10 * values.max(initial=1e-300)) :].T
    inertia, held = (free.T @ (np.asarray(a)[:, None] * free) for a in (system.mass, system.ground))
    squares, shapes = np.linalg.eig(np.linalg.pinv(inertia) @ held)
    return free @ shapes.real[:, squares.real < (STABILITY.soft * frequency) ** 2]
