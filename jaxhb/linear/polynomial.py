"""Characteristic polynomials by their values, at any size, without quotients
(Moliboshko).

For a complex p, ``D(p) = det(p^2 M + p B + K(p)) / prod I`` over the disks with
inertia; link stiffnesses are ``k = c + r p``. The source's R of a free train is ``D /
p^2``. Every part of the train is a pair (docs/theory C3): F, its determinant while
free, and G, while it is held where it meets the rest. A part on link k with arms a and
b multiplies the other's pair: ``W = F + a^2 k G``, then ``F' <- F' W + G' b^2 k F``,
``G' <- G' W``. Pairs are rescaled by powers of two, which is exact. A link that closes
a loop between disks x and y adds ``k (a^2 D_x + b^2 D_y - 2 a b D_way)``, determinants
without it: with x held, with y held, and with all disks of the way from x to y held,
times the k a b of its links.

Near a root large terms cancel. :func:`doubled` numbers ``(..., 2, n)``, a high part and
a low one, have some 24 digits: sums carry their rounding errors along (D. E. Knuth, The
Art of Computer Programming 2, 4.2.2), products are made of halves whose products are
exact (T. J. Dekker, Numer. Math. 18 (1971) 224). Only damping times p, and terms with
radii of gears, are rounded.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import partial, reduce
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, added, concrete, namespace, traced
from jaxhb._program import Program
from jaxhb._shown import brief
from jaxhb.elements.sentences import SceneError
from jaxhb.equations.system import System
from jaxhb.linear.tangent import linear_train
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.topology import Topology
from jaxhb.train.varying import refuse_varying

LAST = -1  # in place of a link, for the last disk of a way
# Stored bits of the leading half of a number, the hidden bit not counted: products of
# halves are exact
HALF = 25

Way: TypeAlias = dict[int, int]
"""Disks of a way between two disks, each with the link to the next; LAST of the last
disk.
"""

Ring: TypeAlias = tuple[
    Callable[[Array, Array], Array], Callable[[Array, Array], Array]
]
"""Sum and product of numbers that the recursion is made of."""


def doubled(values: Array) -> jax.Array:
    """Numbers of twice the digits ``(..., 2, n)`` from numbers ``(..., n)``."""
    high = jnp.asarray(values).astype(complex)
    return jnp.stack([high, jnp.zeros_like(high)], axis=-2)


@jax.custom_jvp
def total(a: jax.Array, b: jax.Array) -> jax.Array:
    """Sum of :func:`doubled` numbers."""
    high, lost = _sum(a[..., 0, :], b[..., 0, :])
    return _joined(high, lost + (a[..., 1, :] + b[..., 1, :]))


@jax.custom_jvp
def product(a: jax.Array, b: jax.Array) -> jax.Array:
    """Product of :func:`doubled` numbers."""
    a_high = a[..., 0, :]
    b_high = b[..., 0, :]
    a1 = _leading(a_high)
    b1 = _leading(b_high)
    a2 = a_high - a1
    b2 = b_high - b1
    # Four exact products: a complex product would round their sums.
    high, lost = _sum(
        lax.complex(a1.real * b1.real, a1.real * b1.imag),
        lax.complex(-a1.imag * b1.imag, a1.imag * b1.real),
    )
    high, more = _sum(high, a1 * b2 + a2 * b1)
    mixed = a_high * b[..., 1, :] + a[..., 1, :] * b_high
    return _joined(high, (lost + more) + (a2 * b2 + mixed))


# Derivatives are as exact as float64: near a root the value is a small difference of
# large terms, its derivative is not.


@total.defjvp
def _total_jvp(
    primals: tuple[jax.Array, jax.Array], tangents: tuple[jax.Array, jax.Array]
) -> tuple[jax.Array, jax.Array]:
    a_dot, b_dot = tangents
    return total(*primals), doubled(a_dot[..., 0, :] + b_dot[..., 0, :])


@product.defjvp
def _product_jvp(
    primals: tuple[jax.Array, jax.Array], tangents: tuple[jax.Array, jax.Array]
) -> tuple[jax.Array, jax.Array]:
    a, b = (number[..., 0, :] for number in primals)
    a_dot, b_dot = (number[..., 0, :] for number in tangents)
    return product(*primals), doubled(a * b_dot + a_dot * b)


def _sum(a: jax.Array, b: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Rounded sum and its rounding error."""
    total = a + b
    shown = total - a
    return total, (a - (total - shown)) + (b - shown)


def _joined(high: jax.Array, low: jax.Array) -> jax.Array:
    """Sum of a number and a much smaller one."""
    total = high + low
    # Without the barrier compilers compute every number again wherever it is used,
    # product within product.
    parts = lax.optimization_barrier((total, low - (total - high)))
    return jnp.stack(parts, axis=-2)


def _leading(a: jax.Array) -> jax.Array:
    """Leading half of the digits of real and imaginary part."""
    # The 11 bits of the exponent are those of float64: only digits are cut.
    return lax.complex(
        lax.reduce_precision(a.real, 11, HALF), lax.reduce_precision(a.imag, 11, HALF)
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Scaled:
    """Complex numbers ``mantissa 2^exponent`` beyond the range of float64; exponents
    are whole numbers as floats.
    """

    mantissa: jax.Array
    exponent: jax.Array

    @property
    def log_modulus(self) -> jax.Array:
        """Natural logarithm of the modulus."""
        return jnp.log(jnp.abs(self.mantissa)) + self.exponent * np.log(2.0)

    @property
    def phase(self) -> jax.Array:
        """Phase in rad, -pi to pi."""
        return jnp.angle(self.mantissa)

    def value(self) -> jax.Array:
        """Convert to complex numbers, infinite or zero where they leave the range of
        float64.
        """
        # In two factors: 2^exponent may overflow where the number itself does not.
        half = jnp.clip(self.exponent // 2, -1100, 1100).astype(int)
        rest = jnp.clip(self.exponent - half, -1100, 1100).astype(int)
        return self.mantissa * jnp.ldexp(1.0, half) * jnp.ldexp(1.0, rest)


def rescaled(numbers: jax.Array, exponent: jax.Array) -> Scaled:
    """``numbers 2^exponent``, ``(..., n)`` and ``(n,)``, with one exponent that brings
    their largest modulus between 1/2 and 1.
    """
    # Powers of two cancel between mantissa and exponent: they have no derivative.
    rough = lax.stop_gradient(numbers)
    size = jnp.maximum(jnp.abs(rough.real), jnp.abs(rough.imag))
    shift = jnp.frexp(size.max(axis=tuple(range(size.ndim - 1))))[1]
    return Scaled(numbers * jnp.ldexp(1.0, -shift), exponent + shift)


def _at_one_exponent(numbers: Scaled) -> Scaled:
    """Numbers ``(T, ..., n)`` with exponents ``(T, n)``, all with the largest one
    ``(n,)``.
    """
    exponent = numbers.exponent.max(axis=0)
    shift = jnp.maximum(numbers.exponent - exponent, -2000).astype(int)
    factor = jnp.ldexp(1.0, shift)
    between = range(1, numbers.mantissa.ndim - 1)
    return Scaled(numbers.mantissa * jnp.expand_dims(factor, tuple(between)), exponent)


def closing_link(topology: Topology) -> int | None:
    """Link that closes the loop of a train, None without a loop; SceneError if there
    are several.
    """
    loops = chain.span(topology).loops.tolist()
    if len(loops) > 1:
        names = ", ".join(repr(topology.link_names[link]) for link in loops)
        raise SceneError(
            f"{topology.title}: links {names} close {len(loops)} loops, and"
            " characteristic polynomials take one at most. Use natural_frequencies or"
            " linear_response."
        )
    return loops[0] if loops else None


def way_between(topology: Topology, a: int, b: int) -> Way:
    """The way from disk a to b over no closing link."""
    tree = chain.span_links(topology.link_ends, topology.n_disks, b)
    position = int(np.flatnonzero(tree.node == a)[0])
    way = {}
    while tree.parent[position] < len(tree.node):
        way[int(tree.node[position])] = int(tree.link[position])
        position = int(tree.parent[position])
    return way | {b: LAST}


def closed(
    topology: Topology, closing: int, a: Any, b: Any
) -> tuple[tuple[Any, Way], tuple[Any, Way], tuple[Any, Way]]:
    """Factors with which the stiffness of a closing link enters the determinant, each
    with the way whose disks are held there; a and b are the arms of the link, numbers
    of any kind.
    """
    x, y = topology.link_ends[closing]
    return (
        (a * a, {x: LAST}),
        (b * b, {y: LAST}),
        (-2 * a * b, way_between(topology, x, y)),
    )


def characteristic(train: DriveTrain, p: Array) -> Scaled:
    """Characteristic determinant D(p) ``(n,)`` of a train with at most one closed loop,
    meshes in contact.

    The unit is s^(-2 S) for S disks, all with inertia. The source's R of a free tree is
    D / p^2, its R^0 of a loop is D.

    At complex ``p`` ``(n,)`` in 1/s, i omega for harmonic motion; loss factors count
    with the sign of Im p. The result has ``value()``, and ``log_modulus`` and ``phase``
    where that overflows. :class:`SceneError` if there is more than one closed loop.

    >>> import jax.numpy as jnp
    >>> train = jaxhb.build(
    ...     [
    ...         *(jaxhb.Disk(name=n, inertia=2.0) for n in "ab"),
    ...         jaxhb.Shaft(between=("a", "b"), stiffness=100.0),
    ...     ]
    ... )
    >>> jaxhb.characteristic(
    ...     train, 1j * jnp.array([0.0, 5.0])
    ... ).value().real.tolist()  # p^2 (p^2 + 100)
    [0.0, -1875.0]
    """
    return _characteristic(linear_train(train), jnp.asarray(p, complex))


@Program
def _characteristic(train: DriveTrain, p: jax.Array) -> Scaled:
    return _determinant(chain.assemble(train), train.topology, p)


def _determinant(system: System, topology: Topology, p: jax.Array) -> Scaled:
    """D ``(n,)`` of a System at ``p`` ``(n,)``."""
    stiffness, loss, viscous, mass, damping, ground = (
        jnp.asarray(field)[:, None]
        for field in (
            system.stiffness,
            system.loss,
            system.viscous,
            system.mass,
            system.damping,
            system.ground,
        )
    )
    # Loss factors count with the sign of Im p.
    elastic = stiffness * (1 + 1j * loss * jnp.sign(p.imag))
    long_p = doubled(p)
    C = total(doubled(elastic), long_p * viscous[..., None])
    held_to = total(long_p * damping[..., None], doubled(ground))
    Z = total(product(product(long_p, long_p), doubled(mass)), held_to)
    ways: list[Way] = [{}]
    factors = [doubled(jnp.ones_like(p))]
    closing = closing_link(topology)
    if closing is not None:
        for factor, way in closed(
            topology, closing, system.arm_a[closing], system.arm_b[closing]
        ):
            ways.append(way)
            factors.append(C[closing] * factor)
    held = np.zeros((len(ways), topology.n_disks), bool)
    passed = np.full((len(ways), topology.n_disks), LAST)
    for row, way in enumerate(ways):
        held[row, list(way)] = True
        passed[row, list(way)] = list(way.values())
    of_way = jax.vmap(partial(_of_tree, system, C, Z))
    terms = _at_one_exponent(of_way(held, passed))
    sum_of_terms = reduce(total, map(product, terms.mantissa, factors))
    determinant = rescaled(sum_of_terms[0], terms.exponent)

    # The row of each disk with inertia is divided by it, other rows are in angles.
    heavy = mass[:, 0] > 0
    by_row = jnp.where(heavy, 1 / jnp.where(heavy, mass[:, 0], 1.0), system.radius**2)

    def multiplied(value: Scaled, factor: jax.Array) -> tuple[Scaled, None]:
        return rescaled(value.mantissa * factor, value.exponent), None

    return lax.scan(multiplied, determinant, by_row)[0]


def _of_tree(
    system: System, C: jax.Array, Z: jax.Array, held: Array, passed: Array
) -> Scaled:
    """Determinant without the closing link, a :func:`doubled` number, of links ``C``
    and disks ``Z``; ``held`` ``(S,)``: which disks are held, ``passed`` ``(S,)``: the
    links whose k a b stand in their places, LAST for 1.
    """
    tree = system.tree
    arm_a = jnp.asarray(system.arm_a)
    arm_b = jnp.asarray(system.arm_b)
    unit = doubled(jnp.ones(Z.shape[-1]))
    factors = jnp.append(C * (arm_a * arm_b)[:, None, None], unit[None], axis=0)
    Z = jnp.where(held[:, None, None], factors[passed], Z)
    order = tree.node[:-1]
    link = tree.link[:-1]
    above = tree.node[tree.parent[:-1]]
    # Without an arm at a disk that is held a link holds the other disk alone.
    near = jnp.where(
        held[order], 0.0, jnp.where(tree.from_a[:-1], arm_a[link], arm_b[link])
    )
    far = jnp.where(
        held[above], 0.0, jnp.where(tree.from_a[:-1], arm_b[link], arm_a[link])
    )

    def hang(state: Scaled, row: tuple[Any, ...]) -> tuple[Scaled, None]:
        disk, above, near, far, k, z = row
        pairs = state.mantissa
        hung = _hung((total, product), pairs[disk], pairs[above], z, k, near, far)
        pair = rescaled(jnp.stack(hung), state.exponent[disk])
        return (
            Scaled(
                pairs.at[above].set(pair.mantissa),
                state.exponent.at[above].add(pair.exponent),
            ),
            None,
        )

    free = jnp.stack([jnp.zeros_like(unit), unit])
    disks, *_, n = Z.shape
    state = Scaled(jnp.tile(free, (disks, 1, 1, 1)), jnp.zeros((disks, n)))
    if len(order):
        state, _ = lax.scan(hang, state, (order, above, near, far, C[link], Z[order]))
    root = tree.node[-1]
    A, G = state.mantissa[root]
    return Scaled(total(product(Z[root], G), A), state.exponent[root])


def _hung(
    ring: Ring,
    part: Iterable[Array],
    above: Iterable[Array],
    z: Array,
    k: Array,
    near: Any,
    far: Any,
) -> tuple[Array, Array]:
    """Pair of a disk on which a part hangs by a link k, from the pairs (sum of F, G) of
    the part and of the disk above, and the z of the part; near and far are the arms of
    the link, numbers of any kind.
    """
    add, times = ring
    A, P = part
    A_above, P_above = above
    F = add(times(z, P), A)
    W = add(F, times(P, k * (near * near)))
    return (
        add(times(A_above, W), times(P_above, times(F, k * (far * far)))),
        times(P_above, W),
    )


@jax.tree_util.register_dataclass
@brief
@dataclass(frozen=True)
class DampedApproximation:
    """Approximation of a damped polynomial by the source, the exact value, and the
    relative error, each ``(n,)``.
    """

    exact: Scaled
    approximate: Scaled
    relative_error: jax.Array


def damped_approximation(train: DriveTrain, omega: Array) -> DampedApproximation:
    """Approximate a damped polynomial as the source does, ``D(i omega) = D1 + i omega
    (D2 - D1)``: D1 without link damping, D2 with c + r as stiffness.

    It is of first order in omega r/c (docs/theory C4): at most 1 % off for omega r/c up
    to 0.01 and omega much larger than 1. Prefer the exact value, which is returned with
    it. Loss factors do not count; damping of disks enters exactly.

    At ``omega`` ``(n,)`` rad/s, of a train with at most one closed loop.

    >>> import jax.numpy as jnp
    >>> train = jaxhb.build(
    ...     [
    ...         *(jaxhb.Disk(name=n, inertia=2.0) for n in "ab"),
    ...         jaxhb.Shaft(between=("a", "b"), stiffness=100.0, damping=1.0),
    ...     ]
    ... )
    >>> bool(
    ...     jaxhb.damped_approximation(train, jnp.array([5.0])).relative_error[0]
    ...     < 1e-15
    ... )  # exact for one link
    True
    """
    return _approximation(linear_train(train), jnp.asarray(omega, float))


@Program
def _approximation(train: DriveTrain, omega: jax.Array) -> DampedApproximation:
    system = chain.assemble(train)
    zeros = jnp.zeros_like(jnp.asarray(system.viscous))

    def determinant(stiffness: Array, viscous: Array) -> Scaled:
        changed = dataclasses.replace(
            system, stiffness=stiffness, viscous=viscous, loss=zeros
        )
        return _determinant(changed, train.topology, 1j * omega)

    exact = determinant(system.stiffness, system.viscous)
    low = determinant(system.stiffness, zeros)
    high = determinant(system.stiffness + system.viscous, zeros)
    all_three = jax.tree.map(lambda *rows: jnp.stack(rows), low, high, exact)
    together = _at_one_exponent(all_three)
    at_low, at_high, at_exact = together.mantissa
    approximate = at_low * (1 - 1j * omega) + at_high * (1j * omega)
    return DampedApproximation(
        exact,
        rescaled(approximate, together.exponent),
        jnp.abs((approximate - at_exact) / at_exact),
    )


# Disks up to which coefficients in double precision have digits (docs/theory C5)
LARGEST = 12


def characteristic_coefficients(
    train: DriveTrain, *, exact: bool = False
) -> tuple[Any, ...]:
    """Coefficients of ``det(p^2 M + p B + K) / prod I``, highest power first, 2 S + 1
    of them.

    The rules are those of :func:`characteristic` in polynomials of p (docs/theory C3):
    the source's R of a free tree is this polynomial over p^2.

    They are fractions if ``exact``, for any number of disks; else floats, for at most
    12. :class:`SceneError` if there is more than one closed loop, a disk without
    inertia, or a loss factor. The train may be traced, but not for ``exact``, and loss
    factors not by ``jit`` and ``vmap`` (ValueError); traced coefficients are nan or
    infinite where an inertia is 0.

    >>> parts = [jaxhb.Disk(name="a", inertia=1.0), jaxhb.Disk(name="b", inertia=1.5)]
    >>> train = jaxhb.build(
    ...     [*parts, jaxhb.Shaft(between=("a", "b"), stiffness=3.0, damping=0.1)]
    ... )
    >>> [str(value) for value in jaxhb.characteristic_coefficients(train, exact=True)]
    ['1', '1/6', '5', '0', '0']
    """
    train = linear_train(train)
    refuse_varying(train.topology)
    _refuse_coefficients(train, exact)

    topology = train.topology
    xp = namespace(train)
    ring = (xp.polyadd, xp.convolve)

    def numbers(values: Array) -> Array:
        if exact:
            return np.array([Fraction(repr(float(value))) for value in values])
        return xp.asarray(values, dtype=float)

    tree = chain.span(topology)
    ground = added(
        numbers(np.zeros(topology.n_disks)),
        np.array(topology.ground_disk, dtype=int),
        numbers(train.grounds.stiffness),
    )
    no_damping = np.zeros(len(topology.damper_names))
    inertia = xp.concatenate([train.disks.inertia, train.dampers.inertia])
    damping = xp.concatenate([train.disks.damping, no_damping])
    Z = xp.stack([numbers(inertia), numbers(damping), ground], axis=1)
    tables = (train.shafts, train.dampers, train.meshes)
    C = xp.stack(
        [
            numbers(xp.concatenate([table.damping for table in tables])),
            numbers(xp.concatenate([table.stiffness for table in tables])),
        ],
        axis=1,
    )
    radius = numbers(train.disks.radius)
    first_mesh = len(topology.link_names) - len(topology.mesh_names)

    def arms(link: int, disk: int) -> tuple[Any, Any]:
        """Arms of a link at a disk and at its other end, 1 for angles and the radii of
        gears.
        """
        a, b = topology.link_ends[link]
        near, far = (a, b) if a == disk else (b, a)
        return (1, 1) if link < first_mesh else (radius[near], radius[far])

    zero = numbers(np.zeros(1))
    unit = numbers(np.ones(1))

    def determinant(way: Mapping[int, int]) -> Array:
        """Determinant of the tree with the disks of a way held, times the k a b of its
        links.
        """
        z = list(Z)
        for disk, link in way.items():
            z[disk] = unit if link == LAST else C[link] * math.prod(arms(link, disk))
        pairs = [(zero, unit)] * topology.n_disks
        for disk, link, above in zip(
            tree.node[:-1], tree.link[:-1], tree.node[tree.parent[:-1]], strict=True
        ):
            near, far = (
                (end not in way) * arm
                for end, arm in zip((disk, above), arms(link, disk), strict=True)
            )
            pairs[above] = _hung(
                ring, pairs[disk], pairs[above], z[disk], C[link], near, far
            )
        A, G = pairs[tree.node[-1]]
        return xp.polyadd(xp.convolve(z[tree.node[-1]], G), A)

    polynomial = determinant({})
    closing = closing_link(topology)
    if closing is not None:
        arm_a, arm_b = arms(closing, topology.link_ends[closing][0])
        for factor, way in closed(topology, closing, arm_a, arm_b):
            term = xp.convolve(C[closing] * factor, determinant(way))
            polynomial = xp.polyadd(polynomial, term)
    values = polynomial / polynomial[0]
    return tuple(values.tolist() if xp is np else values)


def _refuse_coefficients(train: DriveTrain, exact: bool) -> None:
    """Refuse trains whose determinant is no polynomial, or has coefficients without
    correct digits in double precision.
    """
    topology = train.topology
    title = topology.title
    loss = concrete(train.shafts.loss_factor, train.dampers.loss_factor)
    if traced(loss):
        raise ValueError(
            "characteristic_coefficients: jit or vmap traces the loss factors, and with"
            " one there is no polynomial. Close over the train and trace only what"
            " changes."
        )
    if exact and traced(train):
        raise ValueError(
            "characteristic_coefficients: fractions cannot be traced. Leave out exact."
        )
    # Meshes, the last links, have no loss factor.
    lossy = [
        name
        for name, eta in zip(topology.link_names, np.concatenate(loss), strict=False)
        if eta
    ]
    if lossy:
        raise SceneError(
            f"{title}: link {lossy[0]!r} has a loss factor, which is no polynomial in"
            " p. Use with_viscous_damping."
        )
    inertias = [
        J
        for table in concrete(train.disks.inertia, train.dampers.inertia)
        for J in table
    ]
    light = [
        name
        for name, J in zip(topology.disk_names, inertias, strict=True)
        if not traced(J) and not J
    ]
    faults = [
        f"{title}: disk {name!r} has no inertia: give it some, or use"
        " jaxhb.characteristic."
        for name in light
    ]
    if topology.n_disks > LARGEST and not exact:
        faults.append(
            f"{title}: coefficients of {topology.n_disks} disks in double precision"
            f" have no digits beyond {LARGEST}. Ask for exact ones, or for values by"
            " jaxhb.characteristic."
        )
    if faults:
        raise SceneError(faults)
