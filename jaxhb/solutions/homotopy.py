"""From a linear law with strong tooth damping to that of the train, along the curve of
periodic motions.

Where teeth hammer with little damping, sweeps may wander for ever though periodic
motions exist. With a gap as stiff as the contact the law is linear and its motion
unique. On the way to the law of the train,

    epsilon^p,     damping r + D (1 - p),     transition tau v^(1 - p),     p = 0 .. 1,

the motion stays bounded, so that the curve of motions that begins at p = 0 has nowhere
to end but at p = 1, however often it turns back (homotopies of this kind succeed for
almost all their parameters: Chow, Mallet-Paret and Yorke, Math. Comp. 32 (1978) 887).
It is followed by arclength (:mod:`jaxhb.solutions.continuation`) in the point at which
a sweep begins: law and damping are numbers that the program of a sweep is given. How
long it is nobody knows beforehand: the work is bounded.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from jaxhb.balance import sweeps
from jaxhb.balance.map_newton import DIFFERENCE, PackedPoint
from jaxhb.balance.sweeps import SweepEquation, SweepPlan, SweepPoint
from jaxhb.equations.iterations import gcr_on_host

Product: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""Product of a matrix with a vector."""


class Beginning(NamedTuple):
    """The law at p = 0: damping ratio of the fastest motion of teeth that is added;
    transition over that of the train, at most, as far as the backlash holds it; whether
    epsilon falls linearly in p instead of geometrically.
    """

    damping: float
    transition: float
    linear: bool


# Of one curve after another: nobody knows beforehand which one is short.
BEGINNINGS = (
    Beginning(0.3, 20.0, False),
    Beginning(0.1, 4.5, True),
    Beginning(0.3, 7.0, False),
)
# Below which epsilon changes linearly in p: too soft to matter, and zero has no
# logarithm
LEAST_EPSILON = 1e-4
LEAST_DAMPING = 0.01  # share of what is added from which it falls geometrically in p
# Rate of deflection m/s up to which a friction is in proportion to it: damping that the
# law of each mesh is given.
SLIP = 1e6
FORCING = 0.03
KRYLOV_STEPS = 40


class MapCurve:
    """Curve of the points that sweeps do not change, over p; it has taken ``marches``,
    and takes ``most`` of them at most.
    """

    def __init__(
        self,
        equation: SweepEquation,
        flank: SweepPoint,
        plan: SweepPlan,
        beginning: Beginning,
        most: float,
    ):
        self.equation = equation
        self.plan = plan
        self.beginning = beginning
        self.most = most
        self.packing = PackedPoint(equation, flank)
        # Size that makes changes of a point comparable with those of p.
        self.scale = np.linalg.norm(self.packing.pack(flank)) + 1e-300
        self.marches = 0
        law = equation.equation.law
        stiffness = np.abs(np.asarray(law.stiffness))
        self.added = (
            2
            * beginning.damping
            * stiffness
            / max(sweeps.fastest_rate(equation.modes), 1e-300)
        )
        self.least = np.maximum(
            np.asarray(equation.equation.viscous), LEAST_DAMPING * self.added
        )

    def start(self) -> np.ndarray:
        """Point y ``(m+1,)`` of the curve at p = 0: the linear motion."""
        linear = np.asarray(self.equation.equation.linear)
        modes = self.equation.modes
        law = self.equation.equation.law
        nothing = SweepPoint(
            linear, np.zeros(2 * len(modes.rates)), np.zeros(np.shape(law.stiffness))
        )
        return np.append(self.packing.pack(nothing) / self.scale, 0.0)

    def point(self, y: np.ndarray) -> SweepPoint:
        """The point at which a sweep begins, from y = (packed point, p)."""
        return self.packing.unpack(self.scale * y[:-1])

    def at(self, p: float) -> SweepEquation:
        """The equation of the sweeps with the law at p."""
        equation = self.equation.equation
        remaining = 1 - p
        law = equation.law
        epsilon = np.asarray(law.epsilon)
        transition = np.asarray(law.transition)
        least = np.maximum(epsilon, LEAST_EPSILON)
        geometric = least**p - p * (least - epsilon)
        widest = np.minimum(
            transition * self.beginning.transition, np.maximum(transition, 1.0)
        )
        added = self.least * (
            (1 + self.added / np.maximum(self.least, 1e-300)) ** remaining - 1
        )
        softened = 1 - p * (1 - epsilon) if self.beginning.linear else geometric
        # Friction that a shaft has stays.
        shaft_friction = (
            np.zeros(np.shape(epsilon))
            if law.friction is None
            else np.asarray(law.friction)
        )
        shaft_slip = 0.0 if law.slip is None else np.asarray(law.slip)
        numbers: dict[str, Any] = {
            "epsilon": softened,
            "transition": transition * (widest / transition) ** remaining,
            "friction": np.where(shaft_friction > 0, shaft_friction, SLIP * added),
            "slip": np.where(shaft_friction > 0, shaft_slip, SLIP),
        }
        changed = dataclasses.replace(law, **numbers)
        # What damping in contact lacks in the gap, as far as there is one.
        viscous = (
            np.asarray(equation.viscous)
            * (1 - softened)
            / np.maximum(1 - epsilon, 1e-300)
        )
        equation = dataclasses.replace(equation, law=changed, viscous=viscous)
        teeth = dataclasses.replace(self.equation.teeth, law=changed, viscous=viscous)
        return dataclasses.replace(self.equation, equation=equation, teeth=teeth)

    def unclosed(self, y: np.ndarray) -> np.ndarray:
        """H ``(m,)``, the change that a sweep makes, over the scale; nan where no march
        is left.
        """
        if self.marches >= self.most:
            return np.full(len(y) - 1, np.nan)
        self.marches += 1
        following, _ = sweeps.sweep_program(
            self.at(float(y[-1])), self.point(y), plan=self.plan
        )
        return y[:-1] - self.packing.pack(following) / self.scale

    def _bordered_jacobian(
        self, y: np.ndarray, value: np.ndarray, normal: np.ndarray
    ) -> Product:
        """Product with the Jacobian at y, where H is ``value``, bordered with
        ``normal``.
        """

        def apply(direction: np.ndarray) -> np.ndarray:
            size = np.maximum(np.linalg.norm(y), 1.0)
            short = DIFFERENCE * size / np.linalg.norm(direction)
            return np.append(
                (self.unclosed(y + short * direction) - value) / short,
                normal @ direction,
            )

        return apply

    def linearize(
        self, y: np.ndarray, normal: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Product]:
        """Linearize at y, as :func:`continuation.follow_curve` wants it."""
        value = self.unclosed(y)
        apply = self._bordered_jacobian(y, value, normal)
        change = _solve(apply, np.append(-value, 0.0), FORCING * np.linalg.norm(value))
        # From the tangent before, to an error in H that is a share of a step.
        tangent = normal + _solve(
            apply, np.append(0 * value, 1.0) - apply(normal), FORCING
        )
        return value, change, tangent, apply

    def simplify(self, y: np.ndarray, slopes: Product) -> tuple[np.ndarray, np.ndarray]:
        """H and a change at y, as :func:`continuation.follow_curve` wants them."""
        value = self.unclosed(y)
        return value, _solve(
            slopes, np.append(-value, 0.0), FORCING * np.linalg.norm(value)
        )


def _solve(apply: Product, right: np.ndarray, goal: Any) -> np.ndarray:
    """Solve ``apply(x) = right`` for x ``(n,)`` to a residual of norm ``left``."""
    return gcr_on_host(
        apply,
        right,
        tolerance=goal / np.maximum(np.linalg.norm(right), 1e-300),
        steps=KRYLOV_STEPS,
    )
