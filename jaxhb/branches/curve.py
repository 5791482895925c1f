"""The curve of the reduced harmonic equations F(l, p) = 0 over a number p of the train
or the speed.

Unknowns are scaled: deflections over the size of the first motion, and p as a share of
its range. Linear systems are bordered by the tangent, and so regular at a fold; Krylov
steps on the linearised map of a sweep solve them.
"""

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp

from jaxhb._jax import Array, Number
from jaxhb._program import Program
from jaxhb.balance import correction
from jaxhb.balance.newton import KRYLOV_STEPS
from jaxhb.balance.plan import ProgramShape
from jaxhb.balance.problem import (
    ActiveMeshes,
    Problem,
    model_of,
    problem_at,
    reduced_equation,
)
from jaxhb.equations import fourier
from jaxhb.equations.condensation import CondensedEquation
from jaxhb.train.drivetrain import DriveTrain


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class HarmonicCurve:
    """Constants of a branch: train, speed in rpm, begin and span of the parameter,
    scale of the deflections in m, active meshes, name of the parameter, shape of
    the programs.
    """

    train: DriveTrain
    rpm: Array
    begin: Array
    span: Array
    scale: Array
    active_meshes: ActiveMeshes
    parameter: str = field(metadata={"static": True})
    shape: ProgramShape = field(metadata={"static": True})

    def at(self, share: Number) -> tuple[DriveTrain, Array]:
        """Train and speed at a share of the range."""
        value = self.begin + share * self.span
        if self.parameter == "rpm":
            return self.train, value
        return self.train.replace({self.parameter: value}), self.rpm

    def value(self, y: Array) -> float:
        """The parameter at a point, on the host."""
        return float(self.begin + y[-1] * self.span)

    def deflection(self, y: Array) -> Array:
        """Coefficients ``(G, N+1)`` m of the unknown meshes at a point."""
        return fourier.unpack(
            self.scale * y[:-1].reshape(len(self.active_meshes.mask), -1)
        )

    def equation(self, y: Array) -> tuple[Array, tuple[Problem, CondensedEquation]]:
        """F packed ``(n,)``, over the scale; the Problem and the CondensedEquation."""
        train, rpm = self.at(y[-1])
        problem = jax.tree.map(jnp.asarray, problem_at(train, rpm, self.shape.excited))
        deflection = self.deflection(y)
        reduced, _ = reduced_equation(
            problem, deflection.shape[-1] - 1, self.active_meshes
        )
        residual = reduced.residual(deflection, self.shape.samples)
        value = fourier.pack(residual).reshape(-1) / self.scale
        return value, (problem, reduced)


@Program
def linearized(curve: HarmonicCurve, y: Array, normal: Array) -> tuple:
    """Linearize the curve at a point, as ``linearize`` of
    :func:`jaxhb.solutions.continuation.follow_curve`.
    """
    rising = jnp.zeros_like(y).at[-1].set(1.0)
    value, column, (problem, reduced) = jax.jvp(
        curve.equation, (y,), (rising,), has_aux=True
    )
    reduced, march, slopes = _prepared(curve, y, problem, reduced)
    border = (column, normal)
    # Change and tangent are two right sides of one bordered system: across the normal,
    # and one unit along it.
    right = jnp.append(-value, 0.0), rising
    change, tangent = correction.correct_bordered(
        reduced, march, slopes, border, right, KRYLOV_STEPS
    )
    return value, change, tangent, (march, border)


def _prepared(
    curve: HarmonicCurve, y: Array, problem: Problem, reduced: CondensedEquation
) -> tuple[CondensedEquation, correction.LinearMarch, Array]:
    """The equations, the linearised march and the slopes of phi at a point."""
    shape = curve.shape
    deflection = curve.deflection(y)
    linear_train = correction.train_of(
        reduced,
        model_of(problem, curve.active_meshes, shape.time_steps),
        shape.time_steps,
    )
    slopes = correction.slopes_at(reduced, deflection, shape.samples)
    return reduced, correction.march_at(linear_train, slopes), slopes


# Inversions of the bordered Jacobian: each reduces the rest of a direction to the share
# of the singular value at the point.
INVERSIONS = 3


@Program
def null_direction(curve: HarmonicCurve, y: Array, direction: Array) -> Any:
    """Direction ``(n,)``, of length 1, in which F stays zero to first order where its
    Jacobian is singular.

    By inverse iteration on the Jacobian bordered with the last direction; it keeps the
    symmetry of ``direction``.
    """
    value, (problem, reduced) = curve.equation(y)
    reduced, march, slopes = _prepared(curve, y, problem, reduced)
    unit = jnp.append(jnp.zeros_like(value), 1.0)
    for _ in range(INVERSIONS):
        direction = direction / jnp.linalg.norm(direction)
        border = direction, jnp.append(direction, 0.0)
        (solved,) = correction.correct_bordered(
            reduced, march, slopes, border, (unit,), KRYLOV_STEPS
        )
        direction = solved[:-1]
    return direction / jnp.linalg.norm(direction)


@Program
def simplified(curve: HarmonicCurve, y: Array, slopes: tuple) -> tuple:
    """Correct a point, as ``simplify`` of
    :func:`jaxhb.solutions.continuation.follow_curve`: with the Jacobian of this point,
    the linearised march and the derivative in the parameter of another one.
    """
    value, (_, reduced) = curve.equation(y)
    right = (jnp.append(-value, 0.0),)
    march, border = slopes
    slopes_here = correction.slopes_at(
        reduced, curve.deflection(y), curve.shape.samples
    )
    (change,) = correction.correct_bordered(
        reduced, march, slopes_here, border, right, KRYLOV_STEPS
    )
    return value, change
