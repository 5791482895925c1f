"""The derivative of a solution with respect to every number of its problem, by the
implicit function theorem.

The deflections x of the active meshes solve F(x, theta) = x - l_lin + G phi(x) = 0,
theta everything that the problem holds. Along a change d theta

    J dx = - (dF/d theta) d theta,      J = dF/dx,

one linear solve in forward mode, one with the transpose of J in reverse mode whatever
the number of parameters, both on the linearised map of a sweep
(:mod:`jaxhb.balance.correction`). Nothing of Newton's method, of its start or of its
tests is differentiated, so that memory does not grow with its steps. Displacements,
forces and torques follow from x and theta by plain functions. The law is differentiable
twice except where a time sample of the cycle lies on one of its knots, a set of measure
zero; there one of the one-sided values, or their mean, is taken. Equations and
derivatives take averages of the law between time samples
(:mod:`jaxhb.equations.cell_forces`): samples alone see few of its transitions.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxhb._jax import Array
from jaxhb.balance import correction
from jaxhb.balance.outcome import Solution
from jaxhb.balance.problem import ActiveMeshes, Problem, fields, reduced_equation
from jaxhb.equations.condensation import CondensedEquation, CondensedTrain
from jaxhb.results.response import Fields

if TYPE_CHECKING:
    from jaxhb.balance.plan import Plan, ProgramShape


def gradient_and_error(
    function: Callable[[Any, Plan], Array], x: Any, *, plan: Plan
) -> tuple[Array, Any, Any]:
    """Value and gradient of a number that a planned solve gives, and an estimate of the
    error of the gradient.

    A tolerance bounds the change of a force by truncation, not that of its slope. The
    gradient is taken with the harmonics of the plan and with twice as many; the second
    is returned, and their difference as the estimate of its error: no bound, as
    derivatives of hammering teeth have no order of convergence. Valid under ``jit`` and
    ``vmap``.

    Parameters
    ----------
    function : callable
        ``(x, plan) -> float``, reads a response of :func:`jaxhb.solve` under the plan
        that it is handed.
    x : float, array or pytree of them
        What to differentiate by.
    plan : Plan
        From :func:`jaxhb.plan`.

    Returns
    -------
    value : float, with twice the harmonics
    gradient, error : like ``x``; the error is absolute, in the unit of the gradient
        All are nan where one of the two solves fails.

    Raises
    ------
    SceneError
        If twice the harmonics are more than the method takes.

    Examples
    --------
    >>> import jaxhb
    >>> pair = jaxhb.load_scene("spur_pair")
    >>> def peak(damping, plan):
    ...     changed = pair.replace({"gear a|gear b.damping": damping})
    ...     return (
    ...         jaxhb.solve(changed, rpm=3000.0, plan=plan)
    ...         .force("gear a", "gear b")
    ...         .smooth_peak()
    ...     )
    >>> plan = jaxhb.plan(pair, rpm=3000.0)
    >>> _, slope, error = jaxhb.gradient_and_error(
    ...     peak, float(pair.value("gear a|gear b.damping")), plan=plan
    ... )
    >>> bool(error < 1e-6 * abs(slope))  # no teeth that part: nothing is truncated
    True
    """
    finer = dataclasses.replace(plan, harmonics=2 * plan.harmonics)
    coarse_value, coarse = jax.value_and_grad(function)(x, plan)
    value, fine = jax.value_and_grad(function)(x, finer)
    # nan where one of the two is not solved, whose gradient is then 0
    unknown = 0 * (coarse_value + value)
    error = jax.tree.map(lambda a, b: jnp.abs(a - b) + unknown, fine, coarse)
    return value + unknown, jax.tree.map(lambda a: a + unknown, fine), error


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def attach(
    shape: ProgramShape,
    problem: Problem,
    active_meshes: ActiveMeshes,
    solution: Solution,
) -> tuple[Fields, Array]:
    """Fields and deflections of the ``solution`` of ``problem`` with their derivatives
    with respect to ``problem``; where it is not solved ``shape`` says what these are.
    """
    return solution.outcome.fields, solution.outcome.deflection


@attach.defjvp
def _attach_jvp(
    shape: ProgramShape,
    primals: tuple[Problem, ActiveMeshes, Solution],
    tangents: tuple[Problem, ActiveMeshes, Solution],
) -> tuple[tuple[Fields, Array], tuple[Fields, Array]]:
    problem, active_meshes, solution = primals
    solved = solution.solved
    active_crossings, all_crossings = lax.stop_gradient(
        solution.crossings or (None, None)
    )
    # Second derivatives need that of the solution.
    solved_fields, deflection = attach(shape, *primals)
    change = _masked(shape.failed_gradient, solved, tangents[0])
    problem = only_if(solved, problem, shape.failed_gradient)

    def equation(problem: Problem) -> tuple[CondensedEquation, CondensedTrain]:
        reduced, condensed = reduced_equation(problem, shape.harmonics, active_meshes)
        return (
            dataclasses.replace(
                reduced, integrals=shape.force_integrals, crossings=active_crossings
            ),
            condensed,
        )

    (reduced, condensed), (reduced_dot, condensed_dot) = jax.jvp(
        equation, (problem,), (change,)
    )

    def forces_at(
        reduced: CondensedEquation, deflection: Array
    ) -> Callable[[Array], Array]:
        """The product ``delta -> change of phi``, coefficients ``(G, N+1)``, of the
        forces of the equations themselves.
        """
        if reduced.integrals == "averaged":
            return jax.linearize(
                lambda moved: reduced.nonlinear_force_coefficients(
                    moved, shape.samples
                ),
                deflection,
            )[1]
        return correction.force_change(
            reduced, correction.slopes_at(reduced, deflection, shape.samples)
        )

    # dF/dtheta dtheta at fixed deflections: through l_lin, the receptances and the law.
    # phi comes along.
    def residual(reduced: CondensedEquation) -> tuple[Array, Array]:
        force = reduced.nonlinear_force_coefficients(deflection, shape.samples)
        return reduced.left(deflection, force), force

    (_, force), (residual_dot, force_dot) = jax.jvp(
        residual, (reduced,), (reduced_dot,)
    )
    deflection_dot = -residual_dot
    if len(active_meshes.mask):
        assert solution.linear_train is not None  # there are active meshes
        frozen, frozen_deflection = lax.stop_gradient((reduced, deflection))
        slopes = correction.slopes_at(frozen, frozen_deflection, shape.samples)
        march = lax.stop_gradient(correction.march_at(solution.linear_train, slopes))
        forces = forces_at(reduced, deflection)
        product = correction.tangent(reduced, forces)
        frozen_product = correction.tangent(
            frozen, forces_at(frozen, frozen_deflection)
        )
        deflection_dot = correction.invert(
            march, product, frozen_product, -residual_dot
        )
        force_dot = force_dot + forces(deflection_dot)

    def motion(problem: Problem, condensed: CondensedTrain, force: Array) -> Fields:
        # Tooth forces over the cycle are values of the law, no integrals of its slope:
        # the samples of the solve are enough.
        displacement, link_force = condensed.combine(force)
        return fields(
            problem,
            displacement,
            link_force,
            shape.integrals,
            shape.samples,
            all_crossings,
        )

    _, fields_dot = jax.jvp(
        motion, (problem, condensed, force), (change, condensed_dot, force_dot)
    )
    return (solved_fields, deflection), _masked(
        shape.failed_gradient, solved, (fields_dot, deflection_dot)
    )


def all_finite(tree: Any) -> Array:
    """Whether every number is finite: an infinite knot of a table may give a finite
    problem, but not the intended one.
    """
    return jnp.all(
        jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(tree)])
    )


def only_if(is_good: Array, tree: Any, failed_gradient: str = "zero") -> Any:
    """The same numbers, with derivatives where they are good and "zero" or "nan"
    elsewhere.
    """
    return jax.tree.map(
        lambda value: (
            _gated(failed_gradient, is_good, value) if _is_number(value) else value
        ),
        tree,
    )


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _gated(failed_gradient: str, is_good: Array, value: Array) -> Array:
    return value


@_gated.defjvp
def _gated_jvp(
    failed_gradient: str,
    primals: tuple[Array, Array],
    tangents: tuple[Array, Array],
) -> tuple[Array, Array]:
    is_good, value = primals
    return value, _masked(failed_gradient, is_good, tangents[1])


def _masked(failed_gradient: str, is_good: Array, tangents: Any) -> Any:
    """Tangents where they are good; elsewhere zero, so that nothing else of a batch is
    nan, or nan.
    """
    if failed_gradient == "zero":
        return _where(is_good, tangents, None)
    # A product, whose transpose is nan likewise
    one_or_nan = jnp.where(is_good, 1.0, jnp.nan)
    return jax.tree.map(
        lambda tangent: one_or_nan * tangent if _is_number(tangent) else tangent,
        tangents,
    )


def only_known(solved: Array, tree: Any) -> Any:
    """The same numbers, nan where not ``solved``: derivatives through them are zero,
    and spoil none of the rest of a batch.
    """
    return _where(solved, tree, jax.tree.map(lambda _: jnp.nan, tree))


def _is_number(value: Any) -> bool:
    """Whether a value has derivatives: no integer and no truth value."""
    return jnp.issubdtype(jnp.result_type(value), jnp.inexact)


def _where(solved: Array, values: Any, replacements: Any) -> Any:
    """``values``, or ``replacements`` (None: zeros) where not solved; integers and
    their tangents unchanged.
    """

    def choose(value: Any, replacement: Any) -> Any:
        return jnp.where(solved, value, replacement) if _is_number(value) else value

    if replacements is None:
        return jax.tree.map(lambda value: choose(value, 0.0), values)
    return jax.tree.map(choose, values, replacements)
