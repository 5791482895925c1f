"""Request for a solve, the plan decided before it, and its two parts for programs: the
shape that one is compiled for, and the goals that it is given.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast

import jax
import numpy as np

from jaxhb._jax import Array, traced
from jaxhb.balance.problem import ActiveMeshes
from jaxhb.elements.sentences import SceneError
from jaxhb.equations.fourier import SAMPLES_PER_HARMONIC
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import highest_harmonic

Method = Literal["reduced", "chain"]
Integrals = Literal["sampled", "exact"]
PlannedStart = Literal["linear", "march", "response"]
FailedGradient = Literal["zero", "nan"]

# Limit on the harmonics of the cycle, by method: work and memory grow with N, for the
# chain with N^3 and N^2.
MOST_HARMONICS: dict[str, int] = {"reduced": 4096, "chain": 128}
# Truncation error of the elastic tooth force, as a share of the largest tooth force
DEFAULT_TOLERANCE = 0.01
# Residual of equations that count as solved exactly, as derivatives need them
# (:class:`Plan`)
RESIDUAL = 1e-10
# Size of a whole step of Newton's method after which values are good enough, as a share
# of the tolerance: it leaves a tenth of itself at most (``newton.LEAVES``). A residual
# would not do: near resonances 3e-8 of it hides 3 % of the force.
STEP_SHARE = 1e-2
MARCH_CYCLES = 12  # sweeps before Newton's method, at most
# Numbers of time steps per cycle that are offered, multiples of 32, which segments of a
# cycle divide.
TIME_STEPS = (*(n * 2**k for k in range(5, 13) for n in (2, 3)), 16384)
# Time steps per period of the highest mode: with so many, forces that change linearly
# within a step suffice.
STEPS_PER_MODE_PERIOD = 6


def time_steps_for(harmonic: int) -> int:
    """Time steps per cycle for motion up to ``harmonic`` of the cycle."""
    return next(
        (steps for steps in TIME_STEPS if steps >= STEPS_PER_MODE_PERIOD * harmonic),
        TIME_STEPS[-1],
    )


def time_steps_of(harmonics: int) -> int:
    """Time steps per cycle of sweeps that solve for so many harmonics: four for each
    of them.
    """
    return min(-(-4 * harmonics // 32) * 32, TIME_STEPS[-1])


@dataclass(frozen=True)
class Request:
    """Request for a solve: ``harmonics`` None for as many as ``tolerance`` needs; see
    :func:`jaxhb.solve`.

    few_levels : whether numbers of harmonics lie far apart, so that the speeds of a
    sweep share few programs; averaged : that of the :class:`Plan`, True where
    derivatives follow.
    """

    harmonics: int | None = None
    tolerance: float = DEFAULT_TOLERANCE
    method: Method = "reduced"
    integrals: Integrals = "sampled"
    few_levels: bool = False
    averaged: bool = False

    @property
    def step_tolerance(self) -> float:
        """Step tolerance of the :class:`Plan`: exact where harmonics are prescribed."""
        return 0.0 if self.harmonics else STEP_SHARE * self.tolerance

    @classmethod
    def of(
        cls,
        train: DriveTrain,
        harmonics: int | None = None,
        tolerance: float | None = None,
        method: str | None = None,
        integrals: str | None = None,
        few_levels: bool = False,
    ) -> Request:
        """Make a request, with defaults for None; refuse with a sentence what cannot
        work.
        """
        tolerance = DEFAULT_TOLERANCE if tolerance is None else tolerance
        method = method or "reduced"
        integrals = integrals or "sampled"
        name = train.topology.title
        if method not in MOST_HARMONICS:
            raise ValueError(f"method is {method!r}: give 'reduced' or 'chain'")
        loops = chain.span(train.topology).loops
        if method == "chain" and train.topology.springs:
            raise SceneError(
                f"{name}: method 'chain' takes no play, stages, stops or friction: use"
                " 'reduced'."
            )
        if method == "chain" and len(loops):
            names = ", ".join(repr(train.topology.link_names[i]) for i in loops)
            raise SceneError(
                f"{name}: {names} closes a loop, and method 'chain' needs a tree: use"
                " 'reduced'."
            )
        if integrals not in ("sampled", "exact"):
            raise ValueError(f"integrals is {integrals!r}: give 'sampled' or 'exact'")
        if integrals == "exact" and any(
            kind == "friction" for _, kind, _ in train.topology.springs
        ):
            raise SceneError(
                f"{name}: exact integrals take no friction of shafts: use integrals"
                " 'sampled'."
            )
        if integrals == "exact" and method != "reduced":
            raise ValueError(
                f"exact integrals need method 'reduced', and method is {method!r}:"
                " change one of them"
            )
        if not 0 < tolerance < 1:
            raise SceneError(
                f"{name}: tolerance is {tolerance:g}, must be greater than 0 and less"
                " than 1: the share of the largest tooth force that the harmonics left"
                " out may make, 0.01 by default."
            )
        if harmonics is not None:
            check_harmonics(train, harmonics, method)
        return cls(
            harmonics,
            tolerance,
            cast(Method, method),
            cast(Integrals, integrals),
            few_levels,
        )


@dataclass(frozen=True)
class ProgramShape:
    """Decisions of a :class:`Plan` that a program is compiled for, by their names
    there; all others reach it in arrays.

    marches : whether it has sweeps before Newton's method; excited : harmonics of the
    excitation that it has room for; averaged : False without active meshes, too;
    compare_starts : whether a given start is compared with a marched one.
    """

    harmonics: int
    excited: int
    method: Method
    integrals: Integrals
    marches: bool
    time_steps: int
    max_steps: int
    estimated: bool
    averaged: bool
    failed_gradient: FailedGradient
    compare_starts: bool = False

    @property
    def samples(self) -> int:
        """Time samples of the law per cycle."""
        return SAMPLES_PER_HARMONIC * self.harmonics

    @property
    def force_integrals(self) -> str:
        """Integrals of the law over the cycle in the equations: "sampled", "averaged"
        between the samples, or "exact".
        """
        return (
            "averaged"
            if self.integrals == "sampled" and self.averaged
            else self.integrals
        )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Goals:
    """Largest estimate of the truncation error, residual and Newton step that count as
    converged, numbers or ``(n,)`` of n solves: arguments of programs.
    """

    truncation: Array
    residual: Array
    step: Array


@dataclass(frozen=True)
class Plan:
    """Decisions made before a solve; hashable, and the same for every speed that the
    plan serves.

    Parameters
    ----------
    harmonics : int, N
    active : tuple of int, meshes whose contact is an unknown
    flank : tuple of int, +1 or -1 for a mesh taken to stay on that flank all cycle
    (verified), 0 otherwise
    method : "reduced" or "chain"
    start : "linear", "march", or "response": neither of those leads to the motion, and
    a solve under the plan needs a response to start from
    cycles : int, of the march, at most: sweeps (:mod:`jaxhb.balance.sweeps`)
    time_steps : int, per cycle, of sweeps and of the march in linear solves, a multiple
    of 32
    tolerance : float, on the truncation error, a share of the largest tooth force
    tolerance_share : float, share of the tolerance that an estimate may use: it sees 2
    N harmonics, and mesh modes
        above them not
    excited : int, harmonics of the excitation that programs have room for; 0 means N
    integrals : of the tooth law over the cycle, "sampled" at 16 N times or "exact"
    between the switching times
    residual_tolerance : float, dimensionless, at which Newton's method ends: root mean
    square of what the equation of a
        mesh leaves, over that of its linear deflection and its backlash, or less where
        loads are light (``sizes.deflection_scale``)
    step_tolerance : float, size of a whole step at which it ends, too, measured
    likewise; 0 for derivatives
    max_steps : int, linear solves of Newton's method at most
    estimated : bool, whether the truncation error is; without, it counts as 0
    averaged : bool, whether the equations take a sampled law as averages between its
    samples, so that derivatives are
        those of values; without, at the samples themselves, as A(x) does. Its slope has
        kinks: where teeth hammer few samples of a solve lie in its transition zones,
        and derivatives from them alone are off by 8 % and more
    failed_gradient : "zero" or "nan", derivative of a response that is not solved
    """

    harmonics: int
    active: tuple[int, ...]
    flank: tuple[int, ...]
    method: Method = "reduced"
    start: PlannedStart = "linear"
    cycles: int = MARCH_CYCLES
    time_steps: int = TIME_STEPS[0]
    tolerance: float = DEFAULT_TOLERANCE
    tolerance_share: float = 1.0
    excited: int = 0
    integrals: Integrals = "sampled"
    residual_tolerance: float = RESIDUAL
    step_tolerance: float = 0.0
    max_steps: int = 24
    estimated: bool = True
    averaged: bool = True
    failed_gradient: FailedGradient = "zero"

    @property
    def marches(self) -> bool:
        """Whether Newton's method starts from a march."""
        return self.start == "march"

    @property
    def goals(self) -> Goals:
        """The :class:`Goals` of a solve."""
        return Goals(
            truncation=np.array(self.tolerance_share * self.tolerance),
            residual=np.array(self.residual_tolerance),
            step=np.array(self.step_tolerance),
        )

    @property
    def shape(self) -> ProgramShape:
        """The :class:`ProgramShape` of a solve."""
        return ProgramShape(
            harmonics=self.harmonics,
            excited=self.excited or self.harmonics,
            method=self.method,
            integrals=self.integrals,
            marches=self.marches,
            time_steps=self.time_steps,
            max_steps=self.max_steps,
            estimated=self.estimated,
            averaged=self.averaged and bool(self.active),
            failed_gradient=self.failed_gradient,
        )

    @property
    def active_meshes(self) -> ActiveMeshes:
        """The active meshes as arrays, padded to 1, 2, 4, 8, ... of them."""
        count = len(self.active)
        capacity = 1 << (count - 1).bit_length() if count else 0
        index = np.zeros(capacity, dtype=np.int32)
        index[:count] = self.active
        mask = np.zeros(capacity)
        mask[:count] = 1.0
        return ActiveMeshes(
            mask=mask, index=index, flank=np.array(self.flank, dtype=float)
        )

    def __str__(self) -> str:
        size = f"{self.harmonics} harmonics" + (
            ", exact integrals" if self.integrals == "exact" else ""
        )
        if not self.active:
            return f"linear, {size}" + (", teeth in contact" if any(self.flank) else "")
        return f"{len(self.active)} meshes with backlash, {size}, start: {self.start}"


def check_harmonics(train: DriveTrain, harmonics: int, method: str) -> None:
    """Refuse a fixed number of harmonics that cannot work, with a sentence."""
    name = train.topology.title
    least = highest_harmonic(train)
    limit = MOST_HARMONICS[method]
    if not (isinstance(harmonics, int | np.integer) and harmonics >= 1):
        raise SceneError(
            f"{name}: harmonics is {harmonics}, must be a whole number of at least 1."
        )
    if harmonics < least:
        raise SceneError(
            f"{name}: {harmonics} harmonics of the cycle are below the excitation,"
            f" which reaches harmonic {least} (order"
            f" {least / train.topology.revolutions_per_cycle:g}): ask for at least"
            f" {least} harmonics."
        )
    if harmonics > limit and method == "chain":
        need = 6 * train.topology.n_disks * (2 * harmonics + 1) ** 2 * 8 / 2**30
        raise SceneError(
            f"{name}: method 'chain' holds dense blocks for all"
            f" {train.topology.n_disks} disks, about {need:.1f} GiB at {harmonics}"
            f" harmonics, and serves as a check up to {limit} harmonics: use method"
            " 'reduced'."
        )
    if harmonics > limit:
        raise SceneError(
            f"{name}: {harmonics} harmonics are more than the limit of {limit}: use"
            " fewer."
        )


def excited_harmonic(train: DriveTrain, method: str) -> int:
    """Highest harmonic of the excitation that counts; SceneError where ``method``
    cannot reach it.
    """
    highest = highest_harmonic(train)
    if highest > MOST_HARMONICS[method]:
        raise SceneError(
            f"{train.topology.title}: the excitation reaches harmonic {highest} of the"
            f" cycle, more than the {MOST_HARMONICS[method]} that method '{method}'"
            " offers: drop its highest orders or shorten the cycle."
        )
    return highest


def check_plan(train: DriveTrain, plan: Plan) -> None:
    """Refuse a plan made for another train: backlash that it leaves out, or more
    excitation than it holds.
    """
    name = train.topology.title
    has_law = train.topology.has_law
    same_meshes = len(plan.flank) == len(has_law)
    if not same_meshes or any(
        i not in plan.active and not plan.flank[i] for i in np.flatnonzero(has_law)
    ):
        raise SceneError(
            f"{name}: the plan was made for a train without this backlash or other"
            " meshes: plan again."
        )
    if not traced(train):
        with jax.ensure_compile_time_eval():  # under jit, too
            check_harmonics(train, plan.harmonics, plan.method)
