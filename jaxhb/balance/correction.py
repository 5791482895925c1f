"""One linear solve with the Jacobian of the condensed equation, ``J = I + G (w + s
d/dt)``, by the map of a sweep.

Linearised at a motion, with slopes w and s of the nonlinear force phi in l and l', a
cycle that begins at a change of state ds and is marched under a change db of the linear
motion has the deflections and the end

    dl = C (db, ds),     ds_end.

``J dl = r`` with a cycle that closes, ``ds_end = ds``, is what a sweep
(:mod:`jaxhb.balance.sweeps`) leaves unchanged:

    J dl - J_free (ds_end - ds) = r,     - closing (ds_end - ds) = 0.

The left sides are the identity as far as the march agrees with harmonic balance, and as
cycles forget where they began: Krylov steps without a preconditioner solve them, and
their transpose, in some ten marches whatever the number of harmonics. The march is only
a way to the solution: whatever the errors of its steps, dl solves ``J dl = r``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, Number
from jaxhb.balance.march import (
    MarchModes,
    StepWeights,
    complex_modes,
    modes_of_model,
    real_pairs,
)
from jaxhb.balance.sweeps import SweepEquation, SweepPlan, free_motion, sweep_equation
from jaxhb.equations import fourier
from jaxhb.equations.condensation import CondensedEquation
from jaxhb.equations.iterations import gcr
from jaxhb.equations.reduced_model import ReducedOrderModel
from jaxhb.integration.step import with_rate

# Share of the right side that a derivative may leave, and its Krylov steps at most
DERIVATIVE = (1e-12, 60)
# Share of the right side beyond which there is no derivative but nan: where the
# Jacobian is nearly singular, as at a fold
NO_DERIVATIVE = 1e-8
# Share that a bordered solve may leave: of tangents, and of Newton's method, which
# gains digits
BORDERED = 1e-9
FAINT = 1e-9  # share of the largest visibility that a state has at least


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinearTrain:
    """A train at one speed as the march needs it, whatever the motion: modes, weights
    of the steps, free, closing (:class:`~jaxhb.balance.sweeps.SweepEquation`),
    frequency in rad/s; and visibility ``(2m,)``, the size in m of the free motion that
    a sweep takes a change of each state for.
    """

    modes: MarchModes
    weights: StepWeights
    free: Array
    closing: Array
    frequency: Array
    visibility: Array
    steps: int = field(metadata={"static": True})

    @property
    def harmonics(self) -> int:
        """N of the deflections that are marched."""
        return self.free.shape[-1] - 1


def linear_train(sweeps: SweepEquation, steps: int) -> LinearTrain:
    """The :class:`LinearTrain` of a :class:`~jaxhb.balance.sweeps.SweepEquation` with
    so many steps.
    """
    even, odd = jnp.split(jnp.sum(sweeps.free**2, axis=(0, 2)), 2)
    observed = jnp.linalg.norm(sweeps.modes.deflections, axis=0) * jnp.sqrt(even + odd)
    visibility = (observed + FAINT * jnp.max(observed, initial=0.0)) / jnp.maximum(
        jnp.abs(sweeps.closing), FAINT
    )
    # A train that is very stiff over its cycle has no mode left.
    visibility = jnp.where(visibility > 0, visibility, 1.0)
    return LinearTrain(
        modes=sweeps.modes,
        weights=sweeps.weights,
        free=sweeps.free,
        closing=sweeps.closing,
        frequency=sweeps.equation.frequency,
        visibility=jnp.tile(visibility, 2),
        steps=steps,
    )


def train_of(
    reduced: CondensedEquation, model: ReducedOrderModel, time_steps: int
) -> LinearTrain:
    """The :class:`LinearTrain` of a condensed equation and its ReducedOrderModel."""
    plan = SweepPlan(time_steps, most_harmonics=reduced.linear.shape[-1] - 1)
    return linear_train(
        sweep_equation(reduced, modes_of_model(model), plan), time_steps
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinearMarch:
    """A linear train and, at a motion, gain ``(K, G, 2G)``: change of phi at each step
    per change of (l, l') without it.
    """

    linear_train: LinearTrain
    gain: Array

    def cycle(self, linear: Array, state: Array) -> tuple[Array, Array]:
        """Deflections ``(G, N+1)`` m and jump ``(2m,)`` of the cycle from ``state``
        under ``linear`` ``(G, N+1)``, whose harmonics above the marched ones pass
        unchanged.
        """
        linear_train = self.linear_train
        harmonics = min(linear.shape[-1] - 1, linear_train.harmonics)
        motion = with_rate(fourier.resize(linear, harmonics), linear_train.frequency)
        motion_rows = fourier.synthesize(motion, linear_train.steps).T
        end, deflection = self._march(state, motion_rows)
        coefficients = fourier.analyze(deflection.T, harmonics)
        corrected = jnp.asarray(linear).at[:, : harmonics + 1].set(coefficients)
        return corrected, end - state

    def _march(self, state: Array, rows: Array) -> tuple[Array, Array]:
        modes = self.linear_train.modes
        weights = self.linear_train.weights
        meshes = modes.forcing.shape[1]
        observed = modes.observed

        def step(state: Array, step_inputs: tuple[Array, Array]) -> tuple[Array, Array]:
            gain, row = step_inputs
            free = row + observed @ state
            # Written-out sums of columns are faster than products inside a scan.
            columns = (gain[:, j] * free[j] for j in range(2 * meshes))
            force = cast(Array, sum(columns))
            deflection = free[:meshes] + sum(
                weights.at_once[:meshes, g] * force[g] for g in range(meshes)
            )
            return weights.onward(state, force), deflection

        return lax.scan(step, state, (self.gain, rows))


def march_at(linear_train: LinearTrain, slopes: Array) -> LinearMarch:
    """The :class:`LinearMarch` at a motion with coefficients ``(2, G, n+1)`` of the
    slopes of phi in l and l'.
    """
    # Averages over the steps: what lies between two of them counts, too.
    averaged = jnp.sinc(np.arange(slopes.shape[-1]) / linear_train.steps) * slopes
    by_deflection, by_rate = fourier.sample(averaged, linear_train.steps)
    gain = _gain(by_deflection, by_rate, linear_train.weights.at_once)
    return LinearMarch(linear_train, gain)


def _gain(slope: Array, rate_slope: Array, at_once: Array) -> Array:
    """Forces u = S (w + at_once u) of the meshes per w, ``(K, G, 2G)``, with S of the
    slopes ``(G, K)``.
    """
    identity = jnp.eye(len(slope))[:, :, None]
    slopes = jnp.concatenate([identity * slope, identity * rate_slope], axis=1)
    rows = jnp.concatenate(
        [identity - jnp.einsum("ghk,hf->gfk", slopes, at_once), slopes], axis=1
    )
    # Elimination of all time steps side by side takes an eighth of the time of a
    # library routine that takes one after another. Without pivots: where its slope is
    # lost, a mesh has more compliance, never less than none.
    for i in range(len(slope)):
        pivot_row = rows[i] / rows[i, i]
        rows = (rows - rows[:, i, None] * pivot_row).at[i].set(pivot_row)
    return rows[:, len(slope) :].transpose(2, 0, 1)


def slopes_at(reduced: CondensedEquation, deflection: Array, samples: int) -> Array:
    """Coefficients ``(2, G, 2N+1)`` of the slopes of phi in l and l' at ``deflection``
    ``(G, N+1)``: as many as enter a Galerkin product; law sampled at ``samples`` time
    samples or integrated exactly.
    """
    return reduced.nonlinear_slopes(deflection, samples, 2 * (deflection.shape[-1] - 1))


def force_change(reduced: CondensedEquation, slopes: Array) -> Callable[[Array], Array]:
    """The change of phi by one of the deflections: the product ``delta -> w delta + s
    delta'``, coefficients ``(G, N+1)``, with :func:`slopes_at`.

    The slopes enter with at most 2 N harmonics. With a change of N the product has 3 N,
    none of which is seen at those up to N from 4 N + 1 time samples on: 4.5 N give it
    exactly.
    """
    harmonics = (slopes.shape[-1] - 1) // 2
    time_samples = (9 * harmonics + 1) // 2
    slope, rate_slope = fourier.synthesize(slopes, time_samples)

    def product(delta: Array) -> Array:
        change, rate = reduced.sampled(delta, time_samples)
        return fourier.analyze(slope * change + rate_slope * rate, harmonics)

    return product


def tangent(
    reduced: CondensedEquation, forces: Callable[[Array], Array]
) -> Callable[[Array], Array]:
    """The product ``delta -> J delta``; forces : the product with the slopes of phi
    (:func:`force_change`).
    """
    return lambda delta: delta + reduced.respond(forces(delta))


def correct(
    reduced: CondensedEquation,
    march: LinearMarch,
    slopes: Array,
    value: Array,
    forcing: Number,
    steps: int,
) -> tuple[Array, Number, Number]:
    """Solve ``J change = value`` at a motion with :func:`slopes_at`: the change, share
    of the residual that is left, Krylov steps.

    march : at this motion or a near one; value ``(G, N+1)``; forcing : largest share
    that may be left; steps : largest number of Krylov steps (static).
    """
    product = tangent(reduced, force_change(reduced, slopes))
    mapped = _Mapped(march, product, value.shape)
    change, left, used = mapped.solve(pack(value), forcing, steps)
    return unpack(change, value.shape), left, used


def correct_product(
    march: LinearMarch,
    product: Callable[[Array], Array],
    value: Array,
    *,
    transposed: bool,
    tolerance: float,
    steps: int,
) -> tuple[Array, Number]:
    """Solve like :func:`correct` with any ``product`` ``(G, n+1) -> (G, n+1)`` with J,
    or with its transpose in packed coordinates: change and share of the residual that
    is left.
    """
    mapped = _Mapped(march, product, value.shape)
    solve = mapped.solve_transposed if transposed else mapped.solve
    change, left, _ = solve(pack(value), tolerance, steps)
    return unpack(change, value.shape), left


def invert(
    march: LinearMarch,
    product: Callable[[Array], Array],
    frozen_product: Callable[[Array], Array],
    value: Array,
) -> Array:
    """Solve ``J change = value`` for the change; differentiable, its transpose solves
    with the transpose of J.

    product : ``delta -> J delta``; frozen_product : the same, of numbers that are not
    differentiated. nan where the Krylov steps leave too much.
    """
    shape = value.shape
    mapped = _Mapped(march, frozen_product, shape)

    def if_solved(solved: tuple[Array, Number, Number]) -> Array:
        change, left, _ = solved
        return jnp.where(left <= NO_DERIVATIVE, change, jnp.nan)

    tolerance, steps = DERIVATIVE
    packed_change = lax.custom_linear_solve(
        lambda packed: pack(product(unpack(packed, shape))),
        pack(value),
        lambda _, b: if_solved(mapped.solve(b, tolerance, steps)),
        lambda _, b: if_solved(mapped.solve_transposed(b, tolerance, steps)),
    )
    return unpack(packed_change, shape)


def correct_bordered(
    reduced: CondensedEquation,
    march: LinearMarch,
    slopes: Array,
    border: tuple[Array, Array],
    right: Sequence[Array],
    steps: int,
) -> list[Array]:
    """Solve ``J x + column p = f,  row . (x, p) = g`` for each array of ``right``.

    Regular at a fold, too. right : arrays ``(n+1,)`` of (f, g); border : column
    ``(n,)`` packed, row ``(n+1,)``; other arguments as in :func:`correct`.
    """
    column, row = border
    shape = len(reduced.linear), reduced.linear.shape[-1]
    mapped = _Mapped(march, tangent(reduced, force_change(reduced, slopes)), shape)
    count = len(column)

    def bordered(z: Array) -> Array:
        left, deflection = mapped.apply(z[:-1])
        left = cast(jax.Array, left).at[:count].add(column * z[-1])
        return jnp.append(left, row[:-1] @ deflection + row[-1] * z[-1])

    pivot = row[:-1] @ column - row[-1]

    def unbordered(v: Array) -> Array:
        """The solution where J is 1. Without it a right side with nothing but g leads
        nowhere, as its image has no g.
        """
        p = (row[:-1] @ v[:count] - v[-1]) / jnp.where(pivot == 0, 1.0, pivot)
        return jnp.append(cast(jax.Array, v[:-1]).at[:count].add(-column * p), p)

    def solve(b: Array) -> Array:
        begin = jnp.concatenate([b[:-1], jnp.zeros(mapped.states), b[-1:]])
        z, *_ = gcr(bordered, unbordered, begin, tolerance=BORDERED, steps=steps)
        return jnp.append(mapped.apply(z[:-1])[1], z[-1])

    return [solve(b) for b in right]


class _Mapped:
    """Equations of a correction in real vectors ``(n + 2m,)``: packed db above states
    times their visibility.
    """

    def __init__(
        self,
        march: LinearMarch,
        product: Callable[[Array], Array],
        shape: tuple[int, ...],
    ):
        self.march = march
        self.product = product
        self.shape = shape
        self.count = shape[0] * (2 * shape[1] - 1)
        self.states = len(march.linear_train.visibility)

    def cycle(self, vector: Array) -> tuple[Array, Array]:
        """Deflections ``(G, n+1)`` and jump of the states."""
        linear_train = self.march.linear_train
        linear = unpack(vector[: self.count], self.shape)
        return self.march.cycle(linear, vector[self.count :] / linear_train.visibility)

    def deflection(self, vector: Array) -> Array:
        """Packed deflections ``(n,)``."""
        return pack(self.cycle(vector)[0])

    def apply(self, vector: Array) -> tuple[Array, Array]:
        """The left sides, and the packed deflections."""
        linear_train = self.march.linear_train
        deflection, jump = self.cycle(vector)
        marched = min(self.shape[1] - 1, linear_train.harmonics) + 1
        left = (
            jnp.asarray(self.product(deflection))
            .at[:, :marched]
            .add(-free_motion(linear_train, jump)[:, :marched])
        )
        unclosed = -real_pairs(linear_train.closing * complex_modes(jump))
        rows = jnp.concatenate([pack(left), linear_train.visibility * unclosed])
        return rows, pack(deflection)

    def solve(
        self, b: Array, tolerance: Number, steps: int
    ) -> tuple[Array, Number, Number]:
        """Solve for the packed dl of a packed right side: dl, the share of the right
        side that is left, and Krylov steps.
        """
        right = jnp.concatenate([b, jnp.zeros(self.states)])
        vector, left, used = gcr(
            lambda v: self.apply(v)[0],
            lambda v: v,
            right,
            tolerance=tolerance,
            steps=steps,
        )
        return self.deflection(vector), left, used

    def solve_transposed(
        self, b: Array, tolerance: Number, steps: int
    ) -> tuple[Array, Number, Number]:
        """Solve like :meth:`solve` with the transpose of J."""
        zeros = jnp.zeros(self.count + self.states)
        _, pull_back = jax.vjp(lambda v: self.apply(v)[0], zeros)
        _, pull_back_deflection = jax.vjp(self.deflection, zeros)
        (right,) = pull_back_deflection(b)
        vector, left, used = gcr(
            lambda v: pull_back(v)[0],
            lambda v: v,
            right,
            tolerance=tolerance,
            steps=steps,
        )
        return vector[: self.count], left, used


def pack(coefficients: Array) -> Array:
    """Coefficients ``(G, N+1)`` as a real vector ``(n,)``, orthonormal."""
    return fourier.pack(coefficients).reshape(-1)


def unpack(packed: Array, shape: tuple[int, ...]) -> Array:
    """Coefficients ``(G, N+1)`` of a real vector."""
    return fourier.unpack(packed.reshape(shape[0], -1))
