"""The curve of the reduced harmonic equations F(l, p) = 0 over a number p of the train
or the speed.

Unknowns are scaled: deflections over the size of the first motion, and p as a share of
its range. Linear systems are bordered by the tangent, and so regular at a fold; Krylov
steps on the linearised map of a sweep solve them.
"""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp

from jaxhb._jax import Array
from jaxhb._program import Program
from jaxhb.balance import correction
from jaxhb.balance.newton import KRYLOV_STEPS
from jaxhb.balance.plan import Plan
from jaxhb.balance.problem import ActiveMeshes, model_of, problem_at, reduced_equation
from jaxhb.equations import fourier
from jaxhb.train.drivetrain import DriveTrain


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class HarmonicCurve:
    """What does not change along a branch: begin and span of the parameter, scale in m,
    the meshes (ActiveMeshes).
    """

    train: DriveTrain
    rpm: Array
    begin: Array
    span: Array
    scale: Array
    active_meshes: ActiveMeshes
    parameter: str = field(metadata={"static": True})
    plan: Plan = field(metadata={"static": True})

    def at(self, share):
        """Train and speed at a share of the range."""
        value = self.begin + share * self.span
        if self.parameter == "rpm":
            return self.train, value
        return self.train.replace({self.parameter: value}), self.rpm

    def value(self, y):
        """The parameter at a point, on the host."""
        return float(self.begin + y[-1] * self.span)

    def deflection(self, y):
        """Coefficients ``(G, N+1)`` m of the unknown meshes at a point."""
        return fourier.unpack(
            self.scale * y[:-1].reshape(len(self.active_meshes.mask), -1)
        )

    def equation(self, y):
        """F packed ``(n,)``, over the scale; the Problem and the CondensedEquation."""
        problem = jax.tree.map(
            jnp.asarray, problem_at(*self.at(y[-1]), self.plan.excited)
        )
        deflection = self.deflection(y)
        reduced, _ = reduced_equation(
            problem, deflection.shape[-1] - 1, self.active_meshes
        )
        value = (
            fourier.pack(reduced.residual(deflection, self.plan.samples)).reshape(-1)
            / self.scale
        )
        return value, (problem, reduced)


@Program
def linearized(curve, y, normal):
    """What ``linearize`` of :func:`jaxhb.solutions.continuation.follow_curve`
    returns.
    """
    rising = jnp.zeros_like(y).at[-1].set(1.0)
    value, column, equations = jax.jvp(curve.equation, (y,), (rising,), has_aux=True)
    at = _prepared(curve, y, *equations)
    border = (column, normal)
    # Change and tangent are two right sides of one bordered system: across the normal,
    # and one unit along it.
    right = jnp.append(-value, 0.0), rising
    change, tangent = correction.correct_bordered(*at, border, right, KRYLOV_STEPS)
    return value, change, tangent, (at[1], border)


def _prepared(curve, y, problem, reduced):
    """The equations, the linearised march and the slopes of phi at a point."""
    plan = curve.plan
    deflection = curve.deflection(y)
    train = correction.train_of(
        reduced,
        model_of(problem, curve.active_meshes, plan.time_steps),
        plan.time_steps,
    )
    slopes = correction.slopes_at(reduced, deflection, plan.samples)
    return reduced, correction.march_at(train, slopes), slopes


# Of the bordered Jacobian: each leaves of the rest of a direction what the singular
# value at a point leaves.
INVERSIONS = 3


@Program
def null_direction(curve, y, direction):
    """The direction ``(n,)``, of length 1, in which F stays zero to first order where
    its Jacobian is singular.

    By inverse iteration on the Jacobian bordered with the last direction; it keeps the
    symmetry of the one given.
    """
    value, equations = curve.equation(y)
    at = _prepared(curve, y, *equations)
    one = jnp.append(jnp.zeros_like(value), 1.0)
    for _ in range(INVERSIONS):
        direction = direction / jnp.linalg.norm(direction)
        border = direction, jnp.append(direction, 0.0)
        (found,) = correction.correct_bordered(*at, border, (one,), KRYLOV_STEPS)
        direction = found[:-1]
    return direction / jnp.linalg.norm(direction)


@Program
def simplified(curve, y, slopes):
    """What ``simplify`` of :func:`jaxhb.solutions.continuation.follow_curve` returns:
    the Jacobian of this point, the linearised march and the derivative in the parameter
    of another one.
    """
    value, (_, reduced) = curve.equation(y)
    right = (jnp.append(-value, 0.0),)
    march, border = slopes
    here = correction.slopes_at(reduced, curve.deflection(y), curve.plan.samples)
    (change,) = correction.correct_bordered(
        reduced, march, here, border, right, KRYLOV_STEPS
    )
    return value, change
