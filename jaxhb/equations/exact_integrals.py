"""Integrals of a mesh force over the cycle, exact between the switching times of the
backlash law.

The deflection ``l(t)`` of a mesh is a trigonometric polynomial, and its force is smooth
along it except where ``|l|`` passes a knot ``(1 -+ tau) h/2`` of the law: the switching
times (Fridman 2009, (38), integrated arc by arc). The cycle is divided into 8 equal
cells per harmonic. In each of them ``l`` is a polynomial of degree 7, set by its values
at the Gauss-Legendre time samples of the cell, which also integrate the products of the
law with a harmonic if the cell holds no switching time. A cell that may hold one is cut
at its switching times, and every arc has Gauss-Legendre time samples of its own; the
moments of the force with the Legendre polynomials of the cell take the place of its
values, so that all transforms between time samples and harmonics are fast ones.

Switching times carry their derivative ``dt = -dl / l'``: first and second derivatives
of the integrals with respect to ``l`` and the law are exact as well. (Those of an
elastic force do not see the switching times move, because the law has a continuous
slope; those of damping in contact do.)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from numpy.polynomial import legendre

from jaxhb._jax import Array, namespace, on_host
from jaxhb.equations import fourier
from jaxhb.equations.fourier import AnyArray

if TYPE_CHECKING:
    from jaxhb.equations.backlash import Law

CELLS = 8  # per harmonic
FEWEST_HARMONICS = 16  # for which there are cells, at least
POINTS = 8  # Gauss-Legendre time samples of a cell, and of each arc of one that is cut
FEWEST_CUT = 32  # cells per mesh that can be cut, at least; one per harmonic else
# By how much of the range of its samples in a cell a deflection may leave that range
MARGIN = 0.25
AT_REST = 1e-13  # change in half a cell over the deflection that is rounding
NEWTON_STEPS = 12  # to a switching time, bracketed: enough for the last bit

_AT, _WEIGHT = legendre.leggauss(POINTS)
_VALUES = legendre.legvander(_AT, POINTS - 1)
_MODES = (np.arange(POINTS)[:, None] + 0.5) * _VALUES.T * _WEIGHT
"""Matrix from values at the time samples of a cell to coefficients of Legendre
polynomials.
"""

_POWERS = np.array(
    [
        np.pad(legendre.leg2poly(row), (0, POINTS - 1 - k))
        for k, row in enumerate(np.eye(POINTS))
    ]
)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Quadrature:
    """Time samples at which a mesh force is to be evaluated, and the integrals over
    them; made by :func:`quadrature`.

    cell : int ``(G, K)`` of the cells that are cut, ``cells`` for room left over; at,
    weight : ``(G, n, K)`` time samples of their arcs, -1 .. 1 in the cell; cells : per
    cycle.
    """

    cell: Array
    at: Array
    weight: Array
    cells: int = field(metadata={"static": True})

    def synthesize(self, coefficients: Array) -> Array:
        """Values ``(G, time_steps)``, those of all cells and then those of the arcs,
        from coefficients ``(G, N+1)``.
        """
        smooth = _in_cells(coefficients, self.cells)
        arcs = _value(_modes(smooth, self.cell)[:, :, None], self.at)
        return jnp.concatenate(
            [smooth.reshape(len(smooth), -1), arcs.reshape(len(arcs), -1)], axis=-1
        )

    def analyze(self, values: Array, harmonics: int) -> Array:
        """Complex coefficients ``(G, harmonics+1)`` of values at the time samples, of
        at most ``cells`` harmonics.
        """
        smooth = values[:, : self.cells * POINTS].reshape(-1, POINTS, self.cells)
        arcs = self.weight * values[:, self.cells * POINTS :].reshape(self.at.shape)
        # The Gauss sum of a cell sees of its force the moments with the Legendre
        # polynomials. Where the force has a knot they come from its arcs; values at the
        # samples of the cell with the same moments then go through the same transforms.
        moments = jnp.stack(
            [
                jnp.sum(arcs * polynomial, axis=1)
                for polynomial in _polynomials(self.at)
            ],
            axis=1,
        )
        equivalent = jnp.einsum(
            "gmk,jm->gjk", moments, _VALUES * (np.arange(POINTS) + 0.5)
        )
        place = jax.vmap(
            lambda values, cell, new: values.at[:, cell].set(new, mode="drop")
        )
        samples = place(smooth, self.cell, equivalent)
        spectrum = fourier.analyze(samples, self.cells // 2)
        # Samples one a cell tell harmonics n and cells - n apart only by the place of
        # the sample, which the sum over the places below does.
        mirrored = jnp.conj(spectrum[..., -2::-1])
        spectrum = jnp.concatenate([spectrum, mirrored], axis=-1)
        spectrum = spectrum[..., : harmonics + 1]
        shift_back = _WEIGHT[:, None] / 2 * np.conj(_shift(harmonics, self.cells))
        return jnp.einsum("gjn,jn->gn", spectrum, shift_back)


def _shift(harmonics: int, cells: int) -> np.ndarray:
    """Factors ``(POINTS, N+1)`` that move a signal to each of the time samples of the
    first cell.
    """
    return np.exp(1j * np.pi / cells * (_AT[:, None] + 1) * np.arange(harmonics + 1))


def _in_cells(coefficients: Array, cells: int) -> Array:
    """Values ``(G, POINTS, cells)`` at the time samples of all cells."""
    # The j-th samples of all cells are equidistant: one transform, of the signal moved
    # by the place of the first.
    shifted = coefficients[:, None] * _shift(coefficients.shape[-1] - 1, cells)
    return fourier.synthesize(shifted, cells)


def _modes(smooth: Array, cell: Array) -> Array:
    """Coefficients ``(G, POINTS, K)`` of Legendre polynomials in the cells
    ``(G, K)``.
    """
    pick = jax.vmap(lambda samples, cell: samples.at[:, cell].get(mode="clip"))
    return jnp.einsum("mj,gjk->gmk", _MODES, pick(smooth, cell))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Crossings:
    """Times at which deflections pass the knots of their laws; made by
    :func:`find_crossings`, without derivatives.

    cell : int ``(G, K)`` of the cells that may hold a switching time, ``cells`` for
    room left over; low, high : ``(G, 1, 2, K)`` ends, -1 .. 1 in the cell, of its two
    parts, in which the deflection is monotonic; time : ``(G, 4, 2, K)`` at which it
    passes each knot, or the end before or after which it does; inverse_rate : the same
    shape, one over its rate there, 0 where it does not pass; rising : ``(G, 1, 2, K)``;
    complete : whether there was room for all.
    """

    cell: Array
    low: Array
    high: Array
    time: Array
    inverse_rate: Array
    rising: Array
    complete: Array


def find_crossings(
    law: Law, deflection: Array, capacity: int | None = None
) -> Crossings:
    """The :class:`Crossings` of deflections ``(G, N+1)`` m, with room for ``capacity``
    cells per mesh.

    A cell is parted at the extremum of ``l`` in it, if it has one, else in the middle.
    Cells without room are integrated as sampling does.
    """
    law, deflection = lax.stop_gradient((law, deflection))
    harmonics = deflection.shape[-1] - 1
    smooth = _in_cells(deflection, _cells(harmonics))
    capacity = capacity or max(harmonics, FEWEST_CUT)
    passed = _passed(smooth, _knots(law))
    cells = passed.shape[-1]
    cell = jax.vmap(
        lambda passes: jnp.nonzero(passes, size=capacity, fill_value=cells)[0]
    )(passed)
    complete = jnp.all(passed.sum(-1) <= capacity)
    low, high, time, inverse_rate, rising = _pass(
        _modes(smooth, cell), _knots(law)[..., None, None]
    )
    return Crossings(cell, low, high, time, inverse_rate, rising, complete)


def switching_times(law: Law, deflection: Array) -> np.ndarray:
    """Shares of the cycle ``(K,)``, in no order, at which any of the deflections ``(G,
    N+1)`` m passes a knot of its law; on the host.
    """
    law, deflection = on_host((law, deflection))
    cells = _cells(deflection.shape[-1] - 1)
    smooth = _in_cells(deflection, cells)
    mesh, cell = np.nonzero(_passed(smooth, _knots(law)))
    knots = _knots(law)[mesh].T[None, :, None]
    modes = np.einsum("mj,kj->mk", _MODES, smooth[mesh, :, cell])[None]
    _, _, time, inverse_rate, _ = _pass(modes, knots)
    return ((cell + (time + 1) / 2) / cells)[inverse_rate != 0]


def quadrature(
    law: Law, deflection: Array, crossings: Crossings | None = None
) -> Quadrature:
    """The :class:`Quadrature` of deflections ``(G, N+1)`` m, differentiable twice with
    respect to both arguments.

    ``crossings`` : of the same law and deflection, found here where they are None.

    >>> from jaxhb.equations import backlash
    >>> law = backlash.Law(*(np.array([value]) for value in (1.0, 0.04, 0.2, 0.5)))
    >>> def square(cosine):
    ...     rule = quadrature(law, cosine)
    ...     return rule.analyze(rule.synthesize(cosine) ** 2, 2)
    >>> jax.jit(square)(np.array([[0.0, 0.5]])).real.round(12).tolist()
    [[0.5, 0.0, 0.25]]
    """
    crossings = find_crossings(law, deflection) if crossings is None else crossings
    cells = _cells(deflection.shape[-1] - 1)
    modes = _modes(_in_cells(deflection, cells), crossings.cell)
    # One more step of Newton's method: it moves a time by no more than rounding, and
    # its derivative is that of the switching time, dt = -dl / l' (implicit function
    # theorem), for the law as for the deflection.
    miss = (
        _value(modes[:, :, None, None], crossings.time) - _knots(law)[..., None, None]
    )
    time = crossings.time - crossings.inverse_rate * miss
    # Arcs are integrated forwards: falling, a deflection passes the highest knot first.
    time = jnp.where(crossings.rising, time, time[:, ::-1])
    breaks = jnp.concatenate([crossings.low, time, crossings.high], axis=1)
    shape = (len(breaks), 1, -1, breaks.shape[-1])
    low = breaks[:, :-1].reshape(shape)
    high = breaks[:, 1:].reshape(shape)
    at = (high + low) / 2 + (high - low) / 2 * _AT[:, None, None]
    weight = (high - low) / 2 * _WEIGHT[:, None, None]
    arcs = (len(breaks), -1, breaks.shape[-1])
    return Quadrature(crossings.cell, at.reshape(arcs), weight.reshape(arcs), cells)


def _cells(harmonics: int) -> int:
    """Number of cells of a cycle."""
    return CELLS * max(harmonics, FEWEST_HARMONICS)


def _knots(law: Law) -> Array:
    """Knots ``(G, 4)`` m of the law, rising."""
    return namespace(law).stack([-law.knee, -law.gap, law.gap, law.knee], axis=-1)


def _passed(smooth: Array, knots: Array) -> Array:
    """Whether the deflection may pass a knot in a cell, ``(G, cells)``."""
    low = smooth.min(1)
    high = smooth.max(1)
    slack = MARGIN * (high - low)
    low = (low - slack)[..., None]
    high = (high + slack)[..., None]
    return ((low < knots[:, None]) & (knots[:, None] < high)).any(axis=-1)


def _pass(
    modes: AnyArray, knots: Array
) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray, AnyArray]:
    """Fields of :class:`Crossings` from ``low`` to ``rising``, from Legendre series
    ``(G, POINTS, K)`` of deflections.
    """
    xp = namespace(modes)
    powers = xp.einsum("gmk,mi->igk", modes, _POWERS)[:, :, None, None]
    rates = _derivative(powers)
    edge = xp.ones(powers.shape[1:])
    # Cells are so short that a deflection has one extremum in them at most: parted
    # there it is monotonic, and passes each knot at most once.
    turns = _horner(rates, -edge) * _horner(rates, edge) < 0
    turn = xp.where(turns, _root(rates, 0.0, -edge, edge), 0.0)
    low = xp.concatenate([-edge, turn], axis=2)
    high = xp.concatenate([turn, edge], axis=2)
    first = _horner(powers, low)
    last = _horner(powers, high)
    rising = first <= last
    sense = xp.where(rising, 1.0, -1.0)
    ahead = sense * (knots - first) > 0
    before = sense * (last - knots) > 0
    time = _root(
        powers,
        knots,
        xp.broadcast_to(low, ahead.shape),
        xp.broadcast_to(high, ahead.shape),
    )
    # The time of a graze has no derivative, and needs none: on both sides of it lies
    # the same piece of the law.
    rate = _horner(rates, time)
    # Neither does the time of a deflection that rests on a knot to rounding.
    grazing = xp.abs(rate) <= xp.maximum(
        1e-7 * xp.max(xp.abs(rates), axis=0), AT_REST * xp.abs(knots)
    )
    inverse_rate = xp.where(
        ahead & before & ~grazing, 1 / xp.where(grazing, 1.0, rate), 0.0
    )
    time = xp.where(before, time, high)
    time = xp.where(ahead, time, low)
    return low, high, time, inverse_rate, rising


def _root(
    powers: AnyArray, level: Array | float, low: AnyArray, high: AnyArray
) -> AnyArray:
    """Argument at which a polynomial, monotonic from ``low`` to ``high``, has the value
    ``level``: Newton's method, bracketed.
    """
    xp = namespace(powers)
    rates = _derivative(powers)
    sense = xp.sign(_horner(powers, high) - _horner(powers, low))

    def step(
        _: int | Array, state: tuple[AnyArray, AnyArray, AnyArray]
    ) -> tuple[AnyArray, AnyArray, AnyArray]:
        low, high, x = state
        value = _horner(powers, x) - level
        # Bracketed, as Newton's method alone leaves the cell where the deflection is
        # flat.
        low = xp.where(sense * value <= 0, x, low)
        high = xp.where(sense * value <= 0, high, x)
        rate = _horner(rates, x)
        ahead = x - value / xp.where(rate == 0, 1.0, rate)
        inside = (rate != 0) & (ahead >= low) & (ahead <= high)
        return low, high, xp.where(inside, ahead, (low + high) / 2)

    state = (low, high, (low + high) / 2)
    if xp is not np:
        return lax.fori_loop(0, NEWTON_STEPS, step, state)[2]
    for k in range(NEWTON_STEPS):
        state = step(k, state)
    return state[2]


def _derivative(powers: Array) -> Array:
    """Derivative of the polynomials whose coefficients lie along the leading axis."""
    degree = np.arange(1, len(powers)).reshape((-1,) + (1,) * (powers.ndim - 1))
    return degree * powers[1:]


def _horner(powers: AnyArray, x: AnyArray) -> AnyArray:
    """Value at x of the polynomials whose coefficients lie along the leading axis."""
    value = powers[-1]
    for coefficient in powers[-2::-1]:
        value = value * x + coefficient
    return value


def _polynomials(x: Array) -> list[Array]:
    """Legendre polynomials of degree 0 .. POINTS-1 at x."""
    polynomials = [jnp.ones_like(x), x]
    for k in range(1, POINTS - 1):
        rising = (2 * k + 1) * x * polynomials[k]
        polynomials.append((rising - k * polynomials[k - 1]) / (k + 1))
    return polynomials


def _value(modes: Array, x: Array) -> Array:
    """Value at x ``(G, ..., K)`` of the Legendre series ``(G, POINTS, ..., K)``."""
    terms = (modes[:, m] * values for m, values in enumerate(_polynomials(x)))
    return cast(Array, sum(terms))
