"""Pseudo-arclength continuation: along a curve of solutions through its folds and
corners.

A curve ``H(y) = 0`` with one unknown more than equations, the last of ``y`` a parameter
p, is followed by steps along its tangent, each corrected by Newton's method in the
plane across the tangent (Keller 1977; Allgower and Georg, Introduction to Numerical
Continuation Methods, SIAM 2003, chs. 2, 6 and 10), until p leaves its range. At a fold
p turns back; at a corner, where a knot of the law is grazed, the tangent jumps.

The loop runs on the host, around compiled functions: beside a Jacobian, milliseconds,
its decisions cost nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np


@dataclass(frozen=True, kw_only=True)
class StepControl:
    """Lengths in the norm of y, errors in the norm of H."""

    first: float = 0.02  # length of the first step
    longest: float = 0.5  # length of a step at most
    # Length below which a step that fails has met a corner, and one that turns has
    # passed it
    corner: float = 1e-3
    near: float = 1e-4  # error on the way, where points need only lead on
    closed: float = 1e-9  # error at both ends of the curve, and of p there
    # Cosine of the angle by which the tangent may turn in a step: beyond it may be
    # another curve
    bent: float = 0.5
    straight: float = 0.9  # cosine of the angle up to which the next step is longer


STEP_CONTROL = StepControl()

# Length after a failure: the predicted point is six times nearer to a smooth curve
SHORTER = 0.4
# After a straight step with one Jacobian: two such steps make up for one failure
LONGER = 1.6
EASED = 0.7  # after a step with all its Jacobians: the next prediction is twice as near
LOST = 1e-8  # below which the curve is given up
# Of a step at most: where Newton's method needs more, a shorter step is cheaper
JACOBIANS = 3
END_JACOBIANS = 9  # at an end of the curve at most: the error falls to ``closed``
# Corrections at most with one Jacobian, which costs many times as much as each
SIMPLIFIED = 5
TURNS = 12  # tangents tried at a corner

Linearize = Callable[
    [np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray, Any]
]
"""Map from ``y`` and a normal, both ``(m+1,)``, to H ``(m,)``, a change and a tangent,
both ``(m+1,)``, and slopes: see :func:`follow_curve`.
"""
Simplify = Callable[[np.ndarray, Any], tuple[np.ndarray, np.ndarray]]
"""Map from ``y`` and slopes to H and a change: see :func:`follow_curve`."""


class CurveEnd(NamedTuple):
    """End of the part of a curve that was followed."""

    y: np.ndarray  # (m+1,)
    tangent: np.ndarray | None
    arrived: bool  # whether p is at an end of its range
    steps: int  # accepted
    jacobians: int  # evaluated
    folds: int  # of p, passed


class _Trial(NamedTuple):
    """A step as far as it was corrected.

    tangent : at its last Jacobian; side : tangent at its first Jacobian.
    """

    y: np.ndarray
    error: float
    tangent: np.ndarray
    side: np.ndarray
    jacobians: int


# Numbers that are not finite fail the tests of a trial.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def follow_curve(
    linearize: Linearize,
    simplify: Simplify,
    start: np.ndarray,
    *,
    most: float,
    within: tuple[float, float] = (-np.inf, 1.0),
    onward: np.ndarray | None = None,
    visit: Callable[[np.ndarray, np.ndarray], object] | None = None,
    control: StepControl = STEP_CONTROL,
) -> CurveEnd:
    """Follow the curve from ``start``, whose last entry is p, until p leaves its range;
    return the CurveEnd.

    ``linearize(y, normal)`` gives H, the change that makes it zero to first order, a
    tangent of any length, oriented by the sign of the determinant of the Jacobian with
    the tangent below it or by a positive product with ``normal``, the tangent before,
    and the slopes with which ``simplify(y, slopes)`` gives H and a change at another y.
    ``most``: Jacobians at most; ``onward``: the tangent on from a start on the curve,
    without it p rises; ``visit(y, tangent)`` is called at the start, after every step
    and at the end.
    """
    curve = _Curve(linearize, simplify, most, control)
    visit = visit or (lambda y, tangent: None)
    y = np.asarray(start)
    if onward is None:
        y, tangent = curve.reach(y, y[-1], np.inf)
        if tangent is None:
            return CurveEnd(y, None, False, 0, curve.jacobians, 0)
        # Folds and corners leave the sign of the determinant as it is, so that a
        # tangent with the orientation of the first one never leads back. The angle to
        # the tangent before would not tell: at a corner it may be more than a right
        # one.
        curve.orientation = np.sign(tangent[-1])
        tangent = curve.orientation * tangent
    else:
        tangent = onward
    visit(y, tangent)
    rise = np.sign(tangent[-1])
    length = control.first
    steps = 1
    folds = 0
    turns = 0
    while not curve.exhausted and turns <= TURNS and length >= LOST:
        trial = curve.correct(y + length * tangent, tangent, length)
        straight = trial.tangent @ tangent
        on_curve = trial.error < control.near
        short = length < control.corner
        end = within[0] if trial.y[-1] <= within[0] else within[1]
        crossing = trial.y[-1] <= within[0] or trial.y[-1] >= within[1]
        if not on_curve:
            length *= SHORTER
            if length < control.corner and np.isfinite(trial.error):
                # No shorter step helps where the curve bends back from the plane across
                # the tangent. The point fell on the far side of the knot, whose tangent
                # leads on along the curve; where knots meet, several in turn. Steps
                # stay long enough to fall on a far side at all.
                tangent = trial.side
                length = max(length, control.corner / 20)
                turns = turns + 1
        elif not (straight > control.bent or short):
            length *= SHORTER
        elif crossing:
            # The end is between both points. If the curve turned back between them, a
            # shorter step tells.
            between = y + (end - y[-1]) / (trial.y[-1] - y[-1]) * (trial.y - y)
            end_point, end_tangent = curve.reach(between, end, 4 * length)
            if end_tangent is not None:
                end_tangent = end_tangent * np.sign(end_tangent @ tangent)
                visit(end_point, end_tangent)
                return CurveEnd(
                    end_point, end_tangent, True, steps, curve.jacobians, folds
                )
            length *= SHORTER
        else:
            if trial.jacobians == JACOBIANS:
                length = EASED * length
            elif trial.jacobians == 1 and straight > control.straight:
                length = min(LONGER * length, control.longest)
            folds += int(trial.tangent[-1] * rise < 0)
            y = trial.y
            tangent = trial.tangent
            rise = np.sign(trial.tangent[-1])
            steps = steps + 1
            turns = 0
            visit(y, tangent)
    return CurveEnd(y, tangent, False, steps, curve.jacobians, folds)


def locate_zero(
    linearize: Linearize,
    simplify: Simplify,
    before: tuple[np.ndarray, np.ndarray],
    after: tuple[np.ndarray, np.ndarray],
    test: Callable[[np.ndarray, np.ndarray], float],
    *,
    closed: float = 1e-9,
    most: int = 30,
    control: StepControl = STEP_CONTROL,
) -> tuple[np.ndarray, np.ndarray]:
    """Locate the point ``(y, tangent)`` between two other points of a curve where
    ``test(y, tangent)`` changes its sign.

    By the method of false position (Illinois) in the distance along the first tangent,
    until p moves by less than ``closed``: the distance moved times the slope of p, the
    larger one at both ends, as p itself hardly moves at a fold. The test of a fold is
    that slope, the last entry of the tangent.
    """
    curve = _Curve(linearize, simplify, np.inf, control)
    y, tangent = before
    near = 0.0
    far = (after[0] - y) @ tangent
    # A step leaves the tangent of its last Jacobian, not of its end: the change of sign
    # may lie beside the two points.
    point = after[0]
    start_tangent = curve.linearize(y, tangent)[2]
    point_tangent = curve.linearize(point, tangent)[2]
    low = test(y, start_tangent)
    high = test(point, point_tangent)
    whole = abs(far)
    for _ in range(most):
        length = (near * high - far * low) / (high - low)
        last_tangent = point_tangent
        point = curve.correct(y + length * tangent, tangent, whole).y
        point_tangent = curve.linearize(point, tangent)[2]
        value = test(point, point_tangent)
        slope = max(abs(point_tangent[-1]), abs(last_tangent[-1]))
        if value == 0 or abs(length - far) * slope < closed:
            break
        near, low = (far, high) if value * high < 0 else (near, low / 2)
        far = length
        high = value
    return point, point_tangent


def _across(change: np.ndarray, tangent: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Remove from a change its part along the curve: it is then in the plane across
    ``normal``.
    """
    return change - tangent * (normal @ change) / (normal @ tangent)


class _Curve:
    """Newton's method on the equations of a curve; its Jacobians are counted."""

    def __init__(
        self,
        linearize: Linearize,
        simplify: Simplify,
        most: float,
        control: StepControl,
    ):
        self.equations = linearize
        self.simplify = simplify
        self.most = most
        self.control = control
        self.orientation = 1.0
        self.jacobians = 0

    @property
    def exhausted(self) -> bool:
        """Whether no Jacobian is left."""
        return self.jacobians >= self.most

    def linearize(
        self, y: np.ndarray, normal: np.ndarray
    ) -> tuple[Any, np.ndarray, np.ndarray, Any]:
        """Error, change ``(m+1,)``, tangent ``(m+1,)`` of length 1, and slopes."""
        self.jacobians += 1
        value, change, tangent, slopes = self.equations(y, normal)
        tangent = self.orientation * np.asarray(tangent)
        return (
            np.linalg.norm(value),
            np.asarray(change),
            tangent / np.linalg.norm(tangent),
            slopes,
        )

    def reach(
        self, y: np.ndarray, p: float, farthest: float
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """The point of the curve with that p and its tangent; None for the tangent
        where Newton's method fails, at the latest by a change as long as ``farthest``.
        """
        upwards = np.zeros_like(y)
        upwards[-1] = 1.0
        for _ in range(END_JACOBIANS):
            if self.exhausted:
                break
            error, change, tangent, _ = self.linearize(y, upwards)
            if error < self.control.closed and abs(y[-1] - p) < self.control.closed:
                return y, tangent
            change = change - tangent * (change[-1] + y[-1] - p) / tangent[-1]
            if not (np.isfinite(error) and np.linalg.norm(change) < farthest):
                break
            y = y + change
        return y, None

    def correct(self, y: np.ndarray, normal: np.ndarray, length: float) -> _Trial:
        """The :class:`_Trial` at ``y``, corrected across ``normal`` while it stays
        within two lengths of the step.
        """
        trial = None
        for jacobians in range(1, JACOBIANS + 1):
            error, change, tangent, slopes = self.linearize(y, normal)
            side = tangent if trial is None else trial.side
            change = _across(change, tangent, normal)
            if np.linalg.norm(change) < 2 * length:
                y, error, change = self.polish(
                    y, error, change, slopes, tangent, normal
                )
            trial = _Trial(y, error, tangent, side, jacobians)
            leads_away = not (
                np.isfinite(error) and np.linalg.norm(change) < 2 * length
            )
            if error < self.control.near or leads_away or self.exhausted:
                break
            y = y + change
        assert trial is not None, "a step has at least one Jacobian"
        return trial

    def polish(
        self,
        y: np.ndarray,
        error: Any,
        change: np.ndarray,
        slopes: Any,
        tangent: np.ndarray,
        normal: np.ndarray,
    ) -> tuple[np.ndarray, Any, np.ndarray]:
        """Correct with the same Jacobian as long as each change is less than half of
        the last; return y, error and the change that is left.
        """
        for _ in range(SIMPLIFIED):
            if not error > self.control.near:
                break
            value, following = self.simplify(y + change, slopes)
            following = _across(np.asarray(following), tangent, normal)
            if not np.linalg.norm(following) < 0.5 * np.linalg.norm(change):
                break
            y = y + change
            error = np.linalg.norm(value)
            change = following
        return y, error, change
