"""What is decided before a solve: one small hashable value, and what a compiled program takes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jaxhb.balance.problem import ActiveMeshes
from jaxhb.balance.program import Sizes
from jaxhb.balance.request import DEFAULT_TOLERANCE, TIME_STEPS
from jaxhb.equations.fourier import SAMPLES_PER_HARMONIC

MARCH_CYCLES = 3
"""Cycles of time integration before Newton's method, which then takes 2 to 5 steps on ``gear_train_30``."""


@dataclass(frozen=True)
class Plan:
    """All that is decided before a solve; hashable, and the same for every speed that it serves.

    Parameters
    ----------
    harmonics : int, N
    active : tuple of int, meshes whose contact is an unknown
    flank : tuple of int, +1 or -1 for a mesh taken to stay on that flank all cycle (verified), 0 otherwise
    method : "reduced" or "chain"
    start : "linear", "march", or "response": neither leads to the motion, and a solve under the plan is to be given one
    cycles : of the march
    time_steps : per cycle, of the march and of the preconditioner, a multiple of 32
    tolerance : float, on the truncation error, relative to the largest tooth force
    tolerance_share : float, share of the tolerance that an estimate may use: it sees 2 N harmonics, and mesh modes
        above them not
    excited : harmonics of the excitation that programs have room for, 0 for N
    integrals : of the tooth law over the cycle, "sampled" at 16 N times or "exact" between the switching times
    """

    harmonics: int
    active: tuple
    flank: tuple
    method: str = "reduced"
    start: str = "linear"
    cycles: int = MARCH_CYCLES
    time_steps: int = TIME_STEPS.counts[0]
    tolerance: float = DEFAULT_TOLERANCE
    tolerance_share: float = 1.0
    excited: int = 0
    integrals: str = "sampled"

    @property
    def unknowns(self) -> int:
        """Real unknowns of Newton's method; 0 where one linear solve per harmonic is all."""
        return len(self.active) * (2 * self.harmonics + 1)

    @property
    def marches(self) -> bool:
        """Whether Newton's method starts from a march."""
        return self.start == "march"

    @property
    def limit(self) -> np.ndarray:
        """Largest estimate of the truncation error that counts as converged: an array, which programs are given."""
        return np.asarray(self.tolerance_share * self.tolerance)

    @property
    def sizes(self) -> Sizes:
        """What the program is compiled for: nothing else of a plan makes another program."""
        return Sizes(
            samples=SAMPLES_PER_HARMONIC * self.harmonics,
            time_steps=self.time_steps,
            excited=self.excited or self.harmonics,
            method=self.method,
            integrals=self.integrals,
            marches=self.marches,
        )

    @property
    def active_meshes(self) -> ActiveMeshes:
        """The active meshes as arrays, padded to 1, 2, 4, 8, ... of them."""
        count = len(self.active)
        padded = 1 << (count - 1).bit_length() if count else 0
        index = np.zeros(padded, dtype=np.int32)
        index[:count] = self.active
        mask = np.zeros(padded)
        mask[:count] = 1.0
        return ActiveMeshes(mask=mask, index=index, flank=np.array(self.flank, dtype=float))

    def __str__(self):
        size = f"{self.harmonics} harmonics" + (", exact integrals" if self.integrals == "exact" else "")
        if not self.active:
            return f"linear, {size}" + (", teeth in contact" if any(self.flank) else "")
        return f"{len(self.active)} meshes with backlash, {size}, start: {self.start}"
