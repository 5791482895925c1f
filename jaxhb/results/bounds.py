"""Computed bounds: how near to a computed motion one of the train lies, and the numbers
that show it.
"""

from dataclasses import dataclass

import numpy as np

from jaxhb._equal import by_value
from jaxhb._shown import brief

NORM_MARGIN = 1.1
ROW_SUM_MARGIN = 1.5
"""Factors on norms, whose iterations come from below, and on largest row sums: their
estimate is seldom off and never known to be right.
"""

MARGINS = (
    f"in double precision; margins on iterated norms x{NORM_MARGIN:g}, on estimated row"
    f" sums x{ROW_SUM_MARGIN:g}"
)
"""Reservations that stand beside the numbers of a bound."""


@by_value
@dataclass(frozen=True)
class Kantorovich:
    """The theorem of Newton and Kantorovich (Kantorovich & Akilov, XVIII.1; theory
    A4.3): norm ``H0`` of the inverse derivative, ``delta0`` of the first correction,
    Lipschitz constant ``K`` of the derivative.

    >>> case = Kantorovich(H0=2.0, delta0=0.7, K=1 / 14)
    >>> round(case.h0, 12), round(float(case.radius), 6), round(float(case.bound(2)), 8)
    (0.1, 0.73901, 0.00012077)
    """

    H0: float
    delta0: float
    K: float

    @property
    def h0(self) -> float:
        """``H0 K delta0``, at most 1/2 where the theorem holds."""
        return self.H0 * self.K * self.delta0

    @property
    def holds(self) -> bool:
        """Whether a solution exists within :attr:`radius`."""
        return self.h0 <= 0.5

    @property
    def radius(self) -> float:
        """Distance within which a solution exists, (36): ``(1 - sqrt(1 - 2 h0)) / h0
        delta0``; nan where the theorem fails.
        """
        # Written without a difference of nearly equal numbers where h0 is small.
        return 2 * self.delta0 / (1 + self._root)

    @property
    def uniqueness(self) -> float:
        """Distance within which it is the only one; inf where the derivative does not
        change.
        """
        slope = self.H0 * self.K
        return (1 + self._root) / slope if slope else np.inf

    @property
    def _root(self) -> float:
        return np.sqrt(1 - 2 * self.h0) if self.holds else np.nan

    def bound(self, steps: int) -> float:
        """Largest distance from the solution after so many exact Newton steps: (37)
        corrected, and sharp (Gragg & Tapia, SIAM J. Numer. Anal. 11 (1974) 10).
        """
        # The derivative does not change, or nothing is left: the first step is exact.
        if not self.h0:
            return 0.0 if steps else self.delta0
        ratio = self.radius / self.uniqueness
        # h0 = 1/2: both radii are equal, and the bound only halves with each step.
        if ratio == 1:
            return self.radius / 2.0**steps
        power = ratio ** (2.0**steps)
        return (self.uniqueness - self.radius) * power / (1 - power)


@brief
@dataclass(frozen=True)
class Certificate:
    """Bound on the distance of a periodic motion of the train from a computed one, made
    by :func:`jaxhb.certify`; ``str`` says it.

    A computed bound and no proof: all of it is in double precision without outward
    rounding, see :func:`jaxhb.certify`.

    Parameters
    ----------
    reason : what failed and what to do, empty where a bound holds
    meshes : names of those with backlash
    deflection_bound, elastic_bound, force_bound : ``(G,)`` m, N, N
        Of each mesh the largest difference over the cycle between the computed motion
        and that of the train: of the deflection, of the elastic tooth force and of the
        tooth force with its damping, whether samples are read or ``max``, ``min``,
        ``peak``, ``half_peak_to_peak``, ``mean`` and ``rms``; inf where no bound holds.
    Y0, Z1, Z2 : of the theorem, lengths in backlashes, at the motion that Newton's
    method finds on ``low`` harmonics
    small_gain : below 1 there is one motion of one cycle whatever the load (docs/theory
    A4.2)
    harmonic_balance : Kantorovich, of the truncated equations with exact integrals,
    weighted norm, backlashes
    stable : whether the motion of the train attracts; None where the bound does not
    decide it
    harmonics, low, high : of the response, of the inverse, of the equation
    """

    reason: str
    meshes: tuple[str, ...]
    deflection_bound: np.ndarray
    elastic_bound: np.ndarray
    force_bound: np.ndarray
    Y0: float
    Z1: float
    Z2: float
    small_gain: float
    low: int
    high: int
    harmonics: int = 0
    stable: bool | None = None
    harmonic_balance: Kantorovich | None = None

    @property
    def holds(self) -> bool:
        """Whether the computed numbers meet the condition of the theorem, so that there
        is a bound.
        """
        return not self.reason

    @property
    def h0(self) -> float:
        """``Y0 Z2``, at most 1/2 where a bound holds."""
        return self.Y0 * self.Z2

    @property
    def radius(self) -> float:
        """Distance of the motion of the train from the refined one, in backlashes, all
        the time and at every mesh.
        """
        return Kantorovich(self.Z2, self.Y0, 1.0).radius if self.holds else np.inf

    @property
    def unique_within(self) -> float:
        """Distance from the refined motion within which there is no other of one cycle,
        in backlashes.
        """
        return 2 * self.Y0 if self.holds else 0.0

    def __str__(self) -> str:
        if not self.holds:
            return f"no computed bound: {self.reason}"
        if not len(self.meshes):
            return "no mesh has backlash: the equations are linear and solved exactly"
        pairs = zip(self.meshes, self.force_bound, strict=True)
        forces = ", ".join(f"{bound:.2g} N ({name})" for name, bound in pairs)
        return (
            "computed bound: a periodic motion of the train with tooth forces within"
            f" {forces} ({MARGINS})"
        )


_NONE = np.zeros(0)
LINEAR = Certificate(
    "", (), _NONE, _NONE, _NONE, Y0=0.0, Z1=0.0, Z2=0.0, small_gain=0.0, low=0, high=0
)
"""Certificate of equations that are linear and solved exactly."""
