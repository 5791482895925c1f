"""The points of a branch: their rows of its table, and the special ones between them."""

from dataclasses import dataclass, field

import numpy as np

from ..model.speeds import check_speed
from .planned import first_start, solve_once
from .problem import problem_at
from .stability import stability


@dataclass(frozen=True)
class SpecialPoint:
    """Where a branch turns back or changes its stability.

    kind : "fold", "branch point", "period doubling" or "Neimark-Sacker"; value : of the parameter; after : number of
    the point of the branch before it; y : the point itself, as the curve has it.
    """

    kind: str
    value: float
    after: int
    y: np.ndarray = field(repr=False, compare=False)

    def __str__(self):
        return f"{self.kind} at {self.value:.8g}"


def train_at(train, rpm, parameter, value):
    """Train and speed with a value of the parameter, checked."""
    speed = value if parameter == "rpm" else rpm
    check_speed(train, speed)
    return train if parameter == "rpm" else train.replace({parameter: value}), speed


def response_at(curve, plan, y):
    """The Response at a point of the curve, which solves it already."""
    train, rpm = train_at(curve.train, float(curve.rpm), curve.parameter, float(curve.begin + y[-1] * curve.span))
    given = first_start(plan, given=np.asarray(curve.deflection(y)))
    return solve_once(train, rpm, problem_at(train, rpm, curve.sizes.excited), plan, given)[0]


@dataclass(frozen=True)
class Point:
    """A point of a branch: y and tangent of its curve, its row of the table, the multipliers of its teeth."""

    y: np.ndarray
    tangent: np.ndarray
    value: float
    largest_deflection: np.ndarray
    smallest_deflection: np.ndarray
    largest_force: np.ndarray
    smallest_force: np.ndarray
    multiplier: complex
    stable: bool
    truncation_error: float
    multipliers: np.ndarray

    @classmethod
    def at(cls, curve, plan, y, tangent):
        """The point with its row."""
        response = response_at(curve, plan, y)
        found, names = stability(response), response.topology.mesh_names
        deflections, forces = ([read(name) for name in names] for read in (response.deflection, response.force))
        return cls(
            y,
            tangent,
            value=float(curve.begin + y[-1] * curve.span),
            largest_deflection=[signal.max for signal in deflections],
            smallest_deflection=[signal.min for signal in deflections],
            largest_force=[signal.max for signal in forces],
            smallest_force=[signal.min for signal in forces],
            multiplier=found.critical,
            stable=found.stable,
            truncation_error=float(response.truncation_error),
            multipliers=found.multipliers[~found.rotation],
        )

    def beyond(self, place):
        """Product of ``1 - place x multiplier``: its sign changes where a real one passes ``place``, +1 or -1."""
        return float(np.prod(1 - place * self.multipliers).real)

    @property
    def pairs(self):
        """Products of two multipliers, less 1, and whether those are complex: zero for a pair of modulus 1."""
        first, second = np.triu_indices(len(self.multipliers), 1)
        products = self.multipliers[first] * self.multipliers[second] - 1
        return products, self.multipliers[first].imag != 0


TESTS = {
    "branch point": lambda point: point.beyond(1),
    "period doubling": lambda point: point.beyond(-1),
    "Neimark-Sacker": lambda point: float(np.prod(point.pairs[0]).real),
}
"""Functions of a point whose sign changes (Kuznetsov, Elements of Applied Bifurcation Theory, 2004, ch. 10)."""


def _rise(y, tangent):
    """Zero at a fold."""
    return tangent[-1]


def special_points(curve, plan, points, locate, options):
    """The SpecialPoints of a branch, in its order."""

    def on_point(test):
        return lambda y, tangent: test(Point.at(curve, plan, y, tangent))

    found = {kind: [test(point) for point in points] for kind, test in TESTS.items()}
    found = {"fold": [point.tangent[-1] for point in points]} | found
    changes = {kind: np.sign(values[:-1]) * np.sign(values[1:]) < 0 for kind, values in found.items()}
    passed = changes["branch point"]
    for number in np.flatnonzero(changes["fold"]):
        # At a fold a multiplier passes +1, but not where that of the harmonics lies: the truncation error is between.
        beside = [k for k in (number, number - 1, number + 1) if 0 <= k < len(passed) and passed[k]]
        passed[beside[:1]] = False
    special = []
    for kind, where in changes.items():
        for number in np.flatnonzero(where):
            ends = [(point.y, point.tangent) for point in points[number : number + 2]]
            test, closed = (_rise, options.fold) if kind == "fold" else (on_point(TESTS[kind]), options.stability)
            at = Point.at(curve, plan, *locate(*ends, test, closed=closed))
            # The product of two real multipliers passes 1 as well, where nothing happens: a pair must be complex.
            products, turning = at.pairs
            if kind != "Neimark-Sacker" or turning[np.argmin(np.abs(products))]:
                length = (at.y - ends[0][0]) @ ends[0][1]
                special.append((number, length, SpecialPoint(kind, at.value, int(number), at.y)))
    return tuple(point for *_, point in sorted(special, key=lambda entry: entry[:2]))
