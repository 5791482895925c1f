"""The true, untruncated equation of the tooth deflections around a motion, and its
norms in a certificate.

In units of the backlash, ``y = l / h``, with ``E(y)`` the integral of (engagement - 1)
from 0 to y, the force of a mesh beside its linear part is ``(1 - epsilon) c h E(y)``,
and of damping in contact ``r h d/dt E(y)``, as the engagement times ``l'`` is the
derivative of its integral. Both damping laws therefore lead to one equation with one
nonlinear function of the deflections alone (docs/theory A4.4 has it without damping in
contact), in harmonics

    F(y) = y - y_lin + H psi(y) = 0,     H(n) = (1 + H_c m)^{-1} H_c,
    H_c(n) = h^{-1} G(n) ((1-eps) c + i n Omega r) h,

``G`` the receptances of the train in contact, m the middle of the range of (engagement
- 1) over the motion and ``psi(y) = E(y) - m y``. Loss factors are part of G. ``H(n)``
falls as n^-2, with damping in contact as n^-1.

Operators here act on coefficients ``(G, n+1)``; norms are of real motions (root mean
square, or weighted).
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.linalg import eigvalsh

from jaxhb._jax import Array, Number, on_host
from jaxhb._program import Program
from jaxhb.balance import correction
from jaxhb.balance.problem import ActiveMeshes, Problem, model_of, reduced_equation
from jaxhb.equations import backlash, exact_integrals, fourier
from jaxhb.equations.condensation import CondensedEquation, truncate
from jaxhb.equations.system import System
from jaxhb.floquet.variational import motion
from jaxhb.results.bounds import NORM_MARGIN
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.mesh_parameters import law_meshes

SAMPLES = 16  # per harmonic, at which largest values are read

Map = Callable[[np.ndarray], np.ndarray]


def one_norm(
    product: Map, transposed: Map, size: int, columns: int, steps: int = 5
) -> float:
    """Lower bound of the largest absolute column sum of a square map, seldom far below
    it; inf where it is not finite.

    Algorithm 2.4 of Higham & Tisseur, SIAM J. Matrix Anal. Appl. 21 (2000) 1185, with a
    private generator of random signs: scipy draws from the generator of the whole
    process. ``columns`` vectors are multiplied at a time.
    """

    def map_rows(function: Map, vectors: np.ndarray) -> np.ndarray:
        return np.stack([function(vector) for vector in vectors])

    if size <= 2 * columns:
        return float(np.abs(map_rows(product, np.eye(size))).sum(1).max())
    generator = np.random.default_rng(0)
    random_signs = generator.choice([-1.0, 1.0], (columns - 1, size))
    vectors = np.concatenate([np.ones((1, size)), random_signs]) / size
    largest = 0.0
    signs = np.empty((0, size))
    visited = np.empty(0, int)
    for _ in range(steps):
        images = map_rows(product, vectors)
        reached = np.abs(images).sum(1).max()
        if not np.isfinite(reached):
            return np.inf
        if reached <= largest:
            break
        largest = reached
        before = signs
        signs = np.where(images >= 0, 1.0, -1.0)
        if len(before) and (np.abs(signs @ before.T) == size).any(1).all():
            break  # all the same as in the last step
        for i in range(len(signs)):
            while (
                np.abs(np.concatenate([signs[:i], before]) @ signs[i]) == size
            ).any():
                signs[i] = generator.choice([-1.0, 1.0], size)
        promising = np.argsort(-np.abs(map_rows(transposed, signs)).max(0))
        if np.isin(promising[:columns], visited).all():
            break
        chosen = promising[~np.isin(promising, visited)][:columns]
        visited = np.concatenate([visited, chosen])
        vectors = np.zeros((len(chosen), size))
        vectors[np.arange(len(chosen)), chosen] = 1.0
    return float(largest)


@dataclass(frozen=True)
class CertificateSizes:
    """Sizes for which programs are compiled: ``low`` harmonics in which the linearised
    equation is solved, ``high`` to which it is evaluated, ``reach`` of the receptances,
    and time steps of the march in linear solves.
    """

    low: int
    high: int
    reach: int
    time_steps: int


def highest_frequency(system: System) -> float:
    """Bound in rad/s of all natural frequencies, meshes in contact and damping left
    out; inf where a disk has no inertia.
    """
    mass = np.asarray(system.mass)
    if not (mass > 0).all():
        return np.inf
    # Bounded without a dense matrix: the matrix of the stiffnesses is at most twice its
    # diagonal.
    if len(mass) > 2000:
        return float(np.sqrt(2 * (np.asarray(system.held_stiffness()) / mass).max()))
    rows = system.incidence().T / np.sqrt(mass)
    grounds = np.diag(np.asarray(system.ground) / mass)
    stiffness = rows.T @ (np.asarray(system.stiffness)[:, None] * rows) + grounds
    last = len(mass) - 1
    square = eigvalsh(stiffness, subset_by_index=[last, last])[0]
    return float(np.sqrt(max(square, 0.0)))


@partial(Program, static_argnames="sizes")
def _linear_response(
    problem: Problem, chosen: np.ndarray, sizes: CertificateSizes
) -> tuple[Array, Array, CondensedEquation, correction.LinearTrain]:
    """Receptances and linear deflections up to ``reach``, the equation of the low
    harmonics, and the linear train that marches in linear solves: all that does not
    depend on the motion.
    """
    active = ActiveMeshes(
        jnp.ones(len(chosen)), chosen, jnp.zeros(len(problem.meshes.link))
    )
    reduced, _ = reduced_equation(problem, sizes.reach, active)
    low = truncate(reduced, sizes.low)
    model = model_of(problem, active, sizes.time_steps)
    linear_train = correction.train_of(low, model, sizes.time_steps)
    return reduced.receptance, reduced.linear, low, linear_train


@partial(Program, static_argnames="sizes")
def _expand(
    reduced: CondensedEquation,
    linear_train: correction.LinearTrain,
    deflection: Array,
    sizes: CertificateSizes,
) -> tuple[correction.LinearMarch, Array, Array, Array]:
    """March of linear solves around a motion ``(G, low+1)`` m; harmonics ``(G, 2
    high+1)`` of the integral of (engagement - 1), and of (engagement - 1); and whether
    all crossings of the law are found.
    """
    law = reduced.law
    meshes = len(deflection)
    samples = 4 * max(sizes.time_steps, sizes.low)
    slopes = correction.slopes_at(reduced, deflection, samples)
    march = correction.march_at(linear_train, slopes)
    # In backlashes, with a gap without stiffness: the force of this law is the integral
    # of the engagement.
    unit = replace(
        law,
        stiffness=jnp.ones(meshes),
        epsilon=jnp.zeros(meshes),
        backlash=jnp.ones(meshes),
    )
    wide = fourier.resize(deflection / law.backlash[:, None], sizes.high // 2)
    crossings = exact_integrals.find_crossings(unit, wide, 4 * sizes.low)
    rule = exact_integrals.quadrature(unit, wide, crossings)
    values = rule.synthesize(wide)
    unit = unit.expand()
    integral = rule.analyze(backlash.force(unit, values) - values, 2 * sizes.high)
    share = rule.analyze(backlash.engagement(unit, values) - 1, 2 * sizes.high)
    return march, integral, share, crossings.complete


@partial(Program, static_argnames="transposed")
def _solve(
    gain: Array,
    share: Array,
    march: correction.LinearMarch,
    right: Array,
    transposed: bool,
) -> tuple[Array, Number]:
    """Solve ``x + gain (share x) = right``, coefficients ``(G, n+1)`` m, or with the
    transpose, and return x with its relative residual.
    """

    def product(x: Array) -> Array:
        pushed = fourier.analyze(
            share * fourier.synthesize(x, share.shape[-1]), x.shape[-1] - 1
        )
        return x + jnp.einsum("ngh,hn->gn", gain, pushed)

    return correction.correct_product(
        march, product, right, transposed=transposed, tolerance=1e-9, steps=60
    )


class NotInverted(ArithmeticError):
    """The linearised equation was not solved well enough to show anything."""


class Linearization:
    """The equation of the deflections ``(G, N+1)`` m of the meshes with backlash at a
    motion, its derivative solved in ``low`` harmonics: the approximate inverse A of
    ``F'`` is the inverse in these, and 1 beyond.

    ``scale`` : harmonic at which the weights ``w_n = sqrt(1 + (n/scale)^2)`` begin to
    rise; higher where damping in contact is so strong that ``w_n |H(n)|`` would not
    fall below 1.
    """

    def __init__(
        self,
        problem: Problem,
        train: DriveTrain,
        deflection: Array,
        sizes: CertificateSizes,
        scale: float,
    ) -> None:
        self.meshes = on_host(law_meshes(train))
        self.law = self.meshes.law
        viscous = np.where(self.meshes.contact_damping, self.meshes.viscous, 0.0)
        self.frequency = float(problem.frequency)
        self.sizes = sizes
        chosen = train.topology.law_index.astype(np.int32)
        receptance, linear, self._reduced, self._linear_train = _linear_response(
            problem, chosen, sizes
        )
        n = np.arange(sizes.reach + 1)
        h = self.law.backlash
        receptance = np.asarray(receptance)
        self.slopes = (1 - self.law.epsilon) * self.law.stiffness, viscous
        change = self.slopes[0] + 1j * n[:, None] * self.frequency * self.slopes[1]
        self.held = receptance / h[:, None] * (change * h)[:, None, :]
        self._linear = np.asarray(linear)[:, : sizes.high + 1] / h[:, None]
        self._gain = (receptance * change[:, None, :])[: sizes.low + 1]
        columns = problem.system.incidence(self.meshes.link)
        self._decay = self._decay_bound(problem.system, columns)
        self.scale = max(scale, 3 * self._decay[1])
        self._linearise(fourier.resize(np.asarray(deflection), sizes.low))

    def _linearise(self, deflection: np.ndarray) -> None:
        """Linearise the equation around the motion ``(G, low+1)`` m."""
        sizes = self.sizes
        high = self.sizes.high
        self._march, *harmonics, complete = _expand(
            self._reduced, self._linear_train, deflection, sizes
        )
        integral, share = map(np.asarray, harmonics)
        self.complete = bool(complete)
        self.deflection = deflection / self.law.backlash[:, None]
        self._samples = fourier.synthesize(share, fourier.samples_for(2 * high))
        # The middle of the range leaves the smallest share s = engagement - 1 - m, in
        # the largest value half the range.
        low = self._samples.min(1)
        top = self._samples.max(1)
        between = 0.01 * (top - low)  # margin for values that samples may miss
        low = np.maximum(low - between, -1.0)
        top = np.minimum(top + between, 0.0)
        self.middle = (low + top) / 2
        self.half_range = float((top - low).max() / 2)
        self._samples = self._samples - self.middle[:, None]
        # psi = E - m y: the part linear in y is in H.
        self.integral = integral - self.middle[:, None] * fourier.resize(
            self.deflection, 2 * high
        )
        self.share = share - self.middle[:, None] * (np.arange(share.shape[1]) == 0)
        self._share = fourier.synthesize(
            fourier.resize(share, 2 * sizes.low), fourier.samples_for(2 * sizes.low)
        )
        self._shift = np.eye(len(self.middle)) + self.held * self.middle
        self.gain = np.linalg.solve(self._shift, self.held)
        self.linear = np.linalg.solve(
            self._shift[: high + 1], self._linear.T[:, :, None]
        )[..., 0].T

    def moved(self, change: np.ndarray) -> Linearization:
        """Linearise at a motion changed by ``(G, low+1)`` backlashes."""
        moved = copy(self)
        # The cached property of this motion, where it has been read
        vars(moved).pop("gain_sizes", None)
        moved._linearise((self.deflection + change) * self.law.backlash[:, None])
        return moved

    @staticmethod
    def largest(x: np.ndarray) -> np.ndarray:
        """Bound ``(G,)`` of the largest values over the cycle of motions ``(G, n+1)``:
        those at M samples, times the factor 1/cos(pi n/M) by which a trigonometric
        polynomial exceeds them at most (Ehlich & Zeller, Math. Z. 86 (1964) 41).
        """
        values = fourier.synthesize(x, SAMPLES * max(x.shape[1] - 1, 1))
        return np.abs(values).max(-1) / np.cos(np.pi / SAMPLES)

    @cached_property
    def weight(self) -> np.ndarray:
        """Weights ``(reach+1,)``: w_n."""
        return np.sqrt(1 + (np.arange(self.sizes.reach + 1) / self.scale) ** 2)

    @property
    def embedding(self) -> float:
        """Largest value of a motion over its weighted norm, ``sqrt(sum over n of
        w_n^-2)``.
        """
        return float(np.sqrt(np.pi * self.scale / np.tanh(np.pi * self.scale)))

    def near_transition(
        self, distance: float | np.ndarray, share: np.ndarray
    ) -> np.ndarray:
        """Whether ``(G, K)`` a mesh is within ``distance``, backlashes, of the
        transition of its law, at shares of the cycle ``(K,)``.
        """
        value = np.abs(motion(self.deflection, 1.0, share)[0])
        half = self.law.transition[:, None] / 2
        return (value > 0.5 - half - distance) & (value < 0.5 + half + distance)

    def residual(self) -> np.ndarray:
        """F(y) ``(G, high+1)`` of the motion, with exact integrals."""
        high = self.sizes.high
        pushed = self.apply_gain(fourier.resize(self.integral, high))
        return fourier.resize(self.deflection, high) - self.linear + pushed

    def apply_gain(self, x: np.ndarray) -> np.ndarray:
        """H x."""
        return np.einsum("ngh,hn->gn", self.gain[: x.shape[1]], x)

    def apply_gain_transposed(self, x: np.ndarray) -> np.ndarray:
        """The adjoint of :meth:`apply_gain`."""
        return np.einsum("ngh,gn->hn", self.gain[: x.shape[1]].conj(), x)

    def times_share(self, x: np.ndarray) -> np.ndarray:
        """Product with the derivative of psi along the motion, coefficients ``(G,
        high+1)`` of ``(G, n+1)``.
        """
        samples = self._samples
        return fourier.analyze(
            samples * fourier.synthesize(x, samples.shape[-1]), self.sizes.high
        )

    def inverse(self, x: np.ndarray) -> np.ndarray:
        """A x; raises NotInverted."""
        low = self.sizes.low + 1
        shifted = np.einsum("ngh,hn->gn", self._shift[:low], x[:, :low])
        return np.concatenate([self._solve(shifted, False), x[:, low:]], axis=1)

    def inverse_transposed(self, x: np.ndarray) -> np.ndarray:
        """The adjoint of :meth:`inverse`."""
        low = self.sizes.low + 1
        solved = np.einsum(
            "ngh,gn->hn", self._shift[:low].conj(), self._solve(x[:, :low], True)
        )
        return np.concatenate([solved, x[:, low:]], axis=1)

    def _solve(self, x: np.ndarray, transposed: bool) -> np.ndarray:
        """Apply the inverse on the low harmonics ``(G, low+1)``, or its transpose."""
        h = self.law.backlash[:, None]
        right = x / h if transposed else x * h
        solution, left = _solve(self._gain, self._share, self._march, right, transposed)
        if not left <= 1e-6:
            # At once: iterations for norms would not end with a map that changes from
            # call to call
            raise NotInverted
        solution = np.asarray(solution)
        return solution * h if transposed else solution / h

    def _decay_bound(self, system: System, columns: Array) -> tuple[Any, Any, float]:
        """k, d, w with ``|H_c(n)| <= (k + n d) / (n^2 - w^2)``, whatever the damping
        (docs/theory A4.5).
        """
        root = columns.T / np.sqrt(np.asarray(system.mass))
        h = self.law.backlash
        left = np.linalg.norm(root / h[:, None], 2)
        k, d = (
            left * np.linalg.norm(root * (h * change)[:, None], 2)
            for change in self.slopes
        )
        return (
            k / self.frequency**2,
            d / self.frequency,
            highest_frequency(system) / self.frequency,
        )

    def _decay_beyond(self) -> tuple[float, float, float]:
        """:meth:`_decay_bound` for H, at harmonics above those of ``gain``."""
        k, d, highest = self._decay
        n = self.sizes.reach + 1
        # H = (1 + H_c m)^-1 H_c: |H| <= |H_c| / (1 - |H_c| |m|), by the Neumann series
        # where that is less than one.
        less = 1 - (k + n * d) / (n**2 - highest**2) * np.abs(self.middle).max()
        return (k / less, d / less, highest) if less > 0 else (np.inf, np.inf, highest)

    @cached_property
    def gain_sizes(self) -> np.ndarray:
        """Largest singular value of H(n), ``(reach+1,)``."""
        return np.linalg.norm(self.gain, 2, axis=(1, 2))

    def largest_gain(self, first: int) -> float:
        """sup of ``w_n |H(n)|`` over n >= ``first``."""
        k, d, highest = self._decay_beyond()
        n = self.sizes.reach + 1
        # Falls with n
        beyond = np.sqrt(1 + (n / self.scale) ** 2) * (k + n * d) / (n**2 - highest**2)
        largest = (self.weight * self.gain_sizes)[first:].max(initial=0.0)
        return float(max(largest, beyond))

    def gain_between(self, first: int) -> float:
        """``sqrt(sum of |H(n)|^2 over |n| >= first)``: largest value of H x over the
        root mean square of x, whose harmonics begin with ``first``.
        """
        k, d, highest = self._decay_beyond()
        n = self.sizes.reach
        factor = 1 / (1 - (highest / (n + 1)) ** 2)
        # (k + n d)^2 <= 2 (k^2 + n^2 d^2), and sums over n of n^-4 and n^-2 below their
        # integrals.
        beyond = factor**2 * 2 * (k**2 / (3 * n**3) + d**2 / n)
        return float(np.sqrt(2 * (self.gain_sizes[first:] ** 2).sum() + 2 * beyond))

    def rate_of_gain(self, first: int, last: int) -> float:
        """Largest absolute row sum of the kernel of ``d/dt H``, t over the cycle of 2
        pi, harmonics ``first`` to ``last``.
        """
        n = np.arange(last + 1)
        rates = 1j * n * np.moveaxis(self.gain[: last + 1], 0, -1) * (n >= first)
        kernel = fourier.synthesize(rates, fourier.samples_for(4 * last))
        return float(np.abs(kernel).mean(-1).sum(1).max())

    def galerkin(self, harmonics: int) -> Linearization:
        """Truncate the equation to so many harmonics, as harmonic balance solves it."""
        truncated = copy(self)
        keep = (np.arange(self.sizes.reach + 1) <= harmonics)[:, None, None]
        truncated.gain = self.gain * keep
        truncated._shift = np.where(keep, self._shift, np.eye(len(self.middle)))
        truncated._gain = self._gain * keep[: self.sizes.low + 1]
        linear_train = self._march.linear_train
        marched = replace(linear_train, free=linear_train.free[..., : harmonics + 1])
        truncated._march = replace(self._march, linear_train=marched)
        return truncated

    def norm(
        self, apply: Map, apply_transposed: Map, harmonics: int, enough: float = np.inf
    ) -> float:
        """Largest singular value of a map between coefficients ``(G, harmonics+1)``,
        with its margin; a lower bound of it once that reaches ``enough``, inf where the
        iteration does not end.
        """
        # Imported here, as other commands do not need it.
        from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

        shape = len(self.middle), 2 * harmonics + 1

        def square(v: np.ndarray) -> np.ndarray:
            image = apply(fourier.unpack(v.reshape(shape)))
            stretch = np.linalg.norm(fourier.pack(image)) / np.linalg.norm(v)
            if stretch >= enough:
                raise StopIteration(float(stretch))
            return fourier.pack(apply_transposed(image)).reshape(-1)

        size = shape[0] * shape[1]
        operator = LinearOperator((size, size), matvec=square, dtype=float)
        start = np.random.default_rng(0).normal(size=size)
        try:
            # To one percent, which the margin covers
            largest = eigsh(
                operator,
                1,
                which="LA",
                v0=start,
                return_eigenvectors=False,
                tol=1e-2,
                maxiter=100,
                ncv=6,
            )
        except StopIteration as stop:
            return stop.value
        except ArpackNoConvergence:
            return np.inf
        return NORM_MARGIN * float(np.sqrt(max(largest[0], 0.0)))

    def respond(self, x: np.ndarray) -> np.ndarray:
        """A H x."""
        return self.inverse(self.apply_gain(x))

    def respond_transposed(self, x: np.ndarray) -> np.ndarray:
        """The adjoint of :meth:`respond`."""
        return self.apply_gain_transposed(self.inverse_transposed(x))
