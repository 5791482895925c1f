"""Decisions taken on the host: which meshes are unknowns, where to start, how many harmonics."""

import dataclasses
from dataclasses import dataclass

import jax
import numpy as np

from .._arrays import traced
from ..harmonic import backlash, chain
from ..linear.modal import natural_frequencies
from ..model.elements import SceneError
from ..model.engine import highest_harmonic
from . import march
from .program import Choice, Sizes

LEVELS = (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, 1536, 2048, 3072, 4096)
MOST = {"reduced": 4096, "chain": 128}
DENSE_MODES, GEARS_ALONE = 400, 1.1
"""Disks up to which all modes are computed; what the shafts add to the frequencies of the gears alone."""

STRAINED = 0.05, 0.01
"""Share of the strain energy of a mode that tooth meshes hold noticeably, and faintly."""

MARCH_CYCLES = 3

HAMMERED = 2.0
"""Linear half swings of the hardest mesh that separates, by which another must stay loaded to be no unknown."""


@dataclass(frozen=True)
class Plan:
    """All that is decided before a solve; hashable, and the same for every speed that it serves.

    Parameters
    ----------
    harmonics : int, N
    active : tuple of int, meshes whose contact is an unknown
    flank : tuple of int, +1 or -1 for a mesh taken to stay on that flank all cycle (verified), 0 otherwise
    method : "reduced" or "chain"
    start : "linear" or "march"
    cycles : of the march; instants : per cycle, of the march and of the preconditioner, a multiple of 32
    tolerance : float, on the truncation error, relative to the largest tooth force
    trust : float, share of the tolerance that an estimate may use: it sees 2 N harmonics, and mesh modes above them not
    excited : highest harmonic of the excitation, 0 for N
    integrals : of the tooth law over the cycle, "sampled" at 16 N instants or "exact" between the switching times
    """

    harmonics: int
    active: tuple
    flank: tuple
    method: str = "reduced"
    start: str = "linear"
    cycles: int = MARCH_CYCLES
    instants: int = march.INSTANT_COUNTS[0]
    tolerance: float = 0.01
    trust: float = 1.0
    excited: int = 0
    integrals: str = "sampled"

    @property
    def unknowns(self):
        """Real unknowns of Newton's method; 0 where one linear solve per harmonic is all."""
        return len(self.active) * (2 * self.harmonics + 1)

    @property
    def limit(self):
        """Largest estimate of the truncation error that counts as converged."""
        return np.asarray(self.trust * self.tolerance)

    @property
    def sizes(self):
        """What the program is compiled for."""
        return Sizes(
            samples=16 * self.harmonics,
            instants=self.instants,
            excited=self.excited or self.harmonics,
            method=self.method,
            integrals=self.integrals,
        )

    @property
    def choice(self):
        """The meshes as arrays, padded to 1, 2, 4, 8, ... unknowns."""
        count = len(self.active)
        padded = 1 << (count - 1).bit_length() if count else 0
        chosen = np.zeros(padded, dtype=np.int32)
        chosen[:count] = self.active
        active = np.zeros(padded)
        active[:count] = 1.0
        return Choice(active=active, chosen=chosen, flank=np.array(self.flank, dtype=float))

    def __str__(self):
        if not self.active:
            return f"linear, {self.harmonics} harmonics" + (", teeth in contact" if any(self.flank) else "")
        return f"{len(self.active)} meshes with backlash, {self.described}, start: {self.start}"

    @property
    def described(self):
        """Size and accuracy of its equations, for people."""
        return f"{self.harmonics} harmonics" + (", exact integrals" if self.integrals == "exact" else "")


def check_harmonics(train, harmonics, method):
    """Refuse a fixed number of harmonics that cannot work, with a sentence."""
    name = train.topology.name or "scene"
    if not (isinstance(harmonics, int | np.integer) and harmonics >= 1):
        raise SceneError(f"{name}: harmonics is {harmonics}, must be a whole number of at least 1.")
    least = highest_harmonic(train)
    if harmonics < least:
        raise SceneError(
            f"{name}: {harmonics} harmonics of the cycle are below the excitation, which reaches harmonic {least} "
            f"(order {least / train.topology.revolutions_per_cycle:g}): ask for at least {least} harmonics."
        )
    if harmonics > MOST[method]:
        raise SceneError(_too_many(train, harmonics, method, name))


def check_tolerance(train, tolerance):
    """Refuse a tolerance that is not a share of the largest tooth force."""
    if not 0 < tolerance < 1:
        name = train.topology.name or "scene"
        raise SceneError(
            f"{name}: tolerance is {tolerance:g}, must be greater than 0 and less than 1: the share of the largest "
            "tooth force that the harmonics left out may make, 0.01 by default."
        )


def excited_harmonic(train, method):
    """Highest harmonic of the excitation that counts; a sentence where ``method`` cannot reach it."""
    highest = highest_harmonic(train)
    if highest > MOST[method]:
        raise SceneError(
            f"{train.topology.name or 'scene'}: the excitation reaches harmonic {highest} of the cycle, more than the "
            f"{MOST[method]} that method '{method}' offers: drop its highest orders or shorten the cycle."
        )
    return highest


def check_plan(train, plan):
    """Refuse a plan made for another train: backlash it does not know, or more excitation than it holds."""
    name, gaps = train.topology.name or "scene", train.topology.mesh_backlash
    known = len(plan.flank) == len(gaps)
    if not known or any(gap and i not in plan.active and not plan.flank[i] for i, gap in enumerate(gaps)):
        raise SceneError(f"{name}: the plan was made for a train without this backlash or other meshes: plan again.")
    if not traced(train):
        with jax.ensure_compile_time_eval():  # under jit, too
            check_harmonics(train, plan.harmonics, plan.method)


def check_method(train, method):
    """Refuse an unknown method, and the chain sweep on a closed loop."""
    if method not in MOST:
        raise ValueError(f"method is {method!r}: give 'reduced' or 'chain'")
    loops = chain.span(train.topology).loops
    if method == "chain" and len(loops):
        names = ", ".join(repr(train.topology.link_names[i]) for i in loops)
        raise SceneError(
            f"{train.topology.name or 'scene'}: {names} closes a loop, and method 'chain' needs a tree: use 'reduced'."
        )


def check_integrals(integrals, method):
    """Refuse unknown integrals, and exact ones where the method has none."""
    if integrals not in ("sampled", "exact"):
        raise ValueError(f"integrals is {integrals!r}: give 'sampled' or 'exact'")
    if integrals == "exact" and method != "reduced":
        raise ValueError(f"method is {method!r}, and exact integrals go with 'reduced' only: use it, or sample")


def _too_many(train, harmonics, method, name):
    if method == "chain":
        disks, width = train.topology.n_disks, 2 * harmonics + 1
        need = 6 * disks * width**2 * 8 / 2**30
        return (
            f"{name}: method 'chain' holds dense blocks for all {disks} disks, about {need:.1f} GiB at {harmonics} "
            f"harmonics, and is an oracle up to {MOST['chain']}: use method 'reduced'."
        )
    return f"{name}: {harmonics} harmonics are more than the limit of {MOST['reduced']}: use fewer."


def level_at_least(harmonics):
    """Smallest of the offered numbers of harmonics that is not below ``harmonics``."""
    return next((n for n in LEVELS if n >= harmonics), LEVELS[-1])


def next_level(harmonics, method):
    """The number of harmonics to try after ``harmonics``, about twice as many; None at the limit."""
    higher = [n for n in LEVELS if n >= 1.9 * harmonics and n <= MOST[method]]
    if higher:
        return higher[0]
    return MOST[method] if harmonics < MOST[method] else None


def mesh_mode_harmonics(train, frequency):
    """Harmonics of the cycle at the highest natural frequencies that strain tooth meshes noticeably and faintly.

    Noticeably: a motion is resolved from there on. Faintly: little damping makes such a mode loud, and an estimate of
    the truncation error that does not reach it misses that. Of a finely divided train, whose modes would take longer
    than its solve, that of the gears and meshes alone.

    Returns
    -------
    array ``(2,)``
    """
    cycle_hz = frequency / (2 * np.pi)
    if train.topology.n_disks > DENSE_MODES:
        return np.full(2, GEARS_ALONE * _gear_mode_hz(train) / cycle_hz)
    modes = natural_frequencies(train)
    share = modes.mesh_energy_share
    return np.array([np.max(modes.frequencies_hz[share > least], initial=0.0) for least in STRAINED]) / cycle_hz


def _gear_mode_hz(train):
    """Highest natural frequency in Hz of the gears on their meshes, all shafts taken away."""
    system = chain.assemble(train)
    links = np.arange(len(system.stiffness) - len(train.topology.mesh_names), len(system.stiffness))
    rows = np.zeros((len(links), len(system.mass)))
    at = np.arange(len(links))
    rows[at, system.tree.end_a[links]] += system.arm_a[links]
    rows[at, system.tree.end_b[links]] -= system.arm_b[links]
    mass = np.maximum(system.mass, 1e-6 * np.mean(system.mass))
    root = np.sqrt(system.stiffness[links])
    squares = np.linalg.eigvalsh(root[:, None] * (rows / mass) @ rows.T * root)
    return np.sqrt(max(squares.max(initial=0.0), 0.0)) / (2 * np.pi)


def contact_demand(train, forces):
    """Meshes that the linear motion takes off their flank, or nearly so where others separate and hammer.

    Parameters
    ----------
    train : DriveTrain
    forces : array ``(..., M, samples)`` N, elastic forces of the meshes with all in contact

    Returns
    -------
    flank : int array ``(..., M)``
        Side of each backlash mesh taken to stay beyond its transition zone (to be verified); 0 for the others and for
        linear meshes.
    leaves : bool array ``(..., M)``
        Backlash meshes whose contact is an unknown.
    separates : bool array ``(...)``
        Whether any linear force passes through zero.
    """
    gap = np.array(train.topology.mesh_backlash, dtype=bool)
    meshes = train.meshes
    law = backlash.Law(meshes.stiffness, meshes.epsilon, meshes.transition, meshes.backlash)
    side = np.where(forces.mean(-1) < 0, -1, 1)
    lowest, highest = forces.min(-1, initial=np.inf), forces.max(-1, initial=-np.inf)
    least = np.where(side < 0, -highest, lowest)
    knee = (1 + law.transition) * law.backlash / 2
    knee_force = law.stiffness * knee - np.asarray(backlash.offset(law))
    apart = gap & (least <= 0)
    swing = np.where(apart, (highest - lowest) / 2, 0.0)
    spare = HAMMERED * np.max(swing, axis=-1, initial=0.0, keepdims=True)
    leaves = gap & ~(least > knee_force + spare)
    return np.where(gap & ~leaves, side, 0), leaves, apart.any(axis=-1)


def without_backlash(train):
    """The same train with every mesh in contact all cycle."""
    topology, meshes = train.topology, train.meshes
    linear = (False,) * len(topology.mesh_names)
    return dataclasses.replace(
        train,
        topology=dataclasses.replace(topology, mesh_backlash=linear),
        meshes=dataclasses.replace(meshes, backlash=0.0 * meshes.backlash),
    )


def first_level(excited, mesh_modes):
    """Where to begin: above the excitation, and above the mesh modes where teeth separate."""
    return level_at_least(max(2 * excited, 1.5 * mesh_modes))


def trust_in(harmonics, faint):
    """How much of the tolerance an estimate may use: a tenth while modes of meshes lie above the 2 N that it sees."""
    return 1.0 if 2 * harmonics >= 1.2 * faint else 0.1
