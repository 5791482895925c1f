"""Characteristic polynomials and frequency responses by their values, at any size,
without quotients (Moliboshko).

For a complex p, ``D(p) = det(p^2 M + p B + K(p)) / prod I`` over the disks with
inertia; link stiffnesses are ``k = c + r p``. The source's R of a free train is ``D /
p^2``. Every part of the train is a pair (docs/theory C3): F, its determinant while
free, and G, while it is held where it meets the rest. A part on link k with arms a and
b multiplies the other's pair: ``W = F + a^2 k G``, then ``F' <- F' W + G' b^2 k F``,
``G' <- G' W``. Pairs are rescaled by powers of two, which is exact. A link that closes
a loop between disks x and y adds ``k (a^2 D_x + b^2 D_y - 2 a b D_way)``, determinants
without it: with x held, with y held, and with all disks of the way from x to y held,
times the k a b of its links.

Near a root large terms cancel. :class:`Doubled` has some 24 digits: sums carry their
rounding errors along (D. E. Knuth, The Art of Computer Programming 2, 4.2.2), products
are made of halves whose products are exact (T. J. Dekker, Numer. Math. 18 (1971) 224).
Only damping times p, and terms with radii of gears, are rounded.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial, reduce
from operator import add, itemgetter
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, Number, Numbers, concrete, traced
from jaxhb._program import Program
from jaxhb._shown import brief
from jaxhb.elements.sentences import SceneError
from jaxhb.linear.tangent import linear_train
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.topology import Topology

LAST = -1  # in place of a link, for the last disk of a way
# Stored bits of the leading half of a number, the hidden bit not counted: products of
# halves are exact
HALF = 25

Way = dict[int, int]
"""Disks of a way between two disks, each with the link to the next; LAST of the last
disk.
"""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Doubled:
    """Complex numbers ``high + low``, high rounded from the sum; +, * and indices work
    as for arrays.
    """

    high: jax.Array
    low: jax.Array

    def __add__(self, other: Doubled | Array) -> Doubled:
        return _total(self, doubled(other))

    def __mul__(self, other: Doubled | Array) -> Doubled:
        return _product(self, doubled(other))

    def __getitem__(self, index: int | Array) -> Doubled:
        return Doubled(self.high[index], self.low[index])

    def scaled(self, real: Number) -> Doubled:
        """Multiply by a real number; rounded as float64 unless it is a power of two."""
        return Doubled(self.high * real, self.low * real)

    def put(self, index: int | Array, value: Doubled | Array) -> Doubled:
        """Copy with ``value`` at an index."""
        value = doubled(value)
        high = self.high.at[index].set(value.high)
        return Doubled(high, self.low.at[index].set(value.low))


def doubled(value: Doubled | Array) -> Doubled:
    """Convert a real or complex array to :class:`Doubled`."""
    if isinstance(value, Doubled):
        return value
    high = jnp.asarray(value).astype(complex)
    return Doubled(high, jnp.zeros_like(high))


@jax.custom_jvp
def _total(a: Doubled, b: Doubled) -> Doubled:
    total, lost = _sum(a.high, b.high)
    return _joined(total, lost + (a.low + b.low))


@jax.custom_jvp
def _product(a: Doubled, b: Doubled) -> Doubled:
    a1 = _leading(a.high)
    b1 = _leading(b.high)
    a2 = a.high - a1
    b2 = b.high - b1
    # Four exact products: a complex product would round their sums.
    total, lost = _sum(
        lax.complex(a1.real * b1.real, a1.real * b1.imag),
        lax.complex(-a1.imag * b1.imag, a1.imag * b1.real),
    )
    total, more = _sum(total, a1 * b2 + a2 * b1)
    return _joined(total, (lost + more) + (a2 * b2 + (a.high * b.low + a.low * b.high)))


# Derivatives are as exact as float64: near a root the value is a small difference of
# large terms, its derivative is not.


@_total.defjvp
def _total_jvp(
    primals: tuple[Doubled, Doubled], tangents: tuple[Doubled, Doubled]
) -> tuple[Doubled, Doubled]:
    a, b = primals
    da, db = tangents
    return _total(a, b), doubled(da.high + db.high)


@_product.defjvp
def _product_jvp(
    primals: tuple[Doubled, Doubled], tangents: tuple[Doubled, Doubled]
) -> tuple[Doubled, Doubled]:
    a, b = primals
    da, db = tangents
    return _product(a, b), doubled(a.high * db.high + da.high * b.high)


def _sum(a: jax.Array, b: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Rounded sum and its rounding error."""
    total = a + b
    shown = total - a
    return total, (a - (total - shown)) + (b - shown)


def _joined(high: jax.Array, low: jax.Array) -> Doubled:
    """Sum of a number and a much smaller one."""
    total = high + low
    # Without the barrier compilers compute every number again wherever it is used,
    # product within product.
    total, error = lax.optimization_barrier((total, low - (total - high)))
    return Doubled(total, error)


def _leading(a: jax.Array) -> jax.Array:
    """Leading half of the digits of real and imaginary part."""
    # The 11 bits of the exponent are those of float64: only digits are cut.
    return lax.complex(
        lax.reduce_precision(a.real, 11, HALF), lax.reduce_precision(a.imag, 11, HALF)
    )


DoubledOrArray = TypeVar("DoubledOrArray", Doubled, jax.Array)


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

    def __truediv__(self, other: Scaled) -> Scaled:
        return rescaled(self.mantissa / other.mantissa, self.exponent - other.exponent)

    def __mul__(self, factor: Number) -> Scaled:
        return Scaled(self.mantissa * factor, self.exponent)

    def __add__(self, other: Scaled) -> Scaled:
        exponent = jnp.maximum(self.exponent, other.exponent)
        a, b = (
            z * jnp.ldexp(1.0, jnp.maximum(z.exponent - exponent, -2000).astype(int))
            for z in (self, other)
        )
        return rescaled(a.mantissa + b.mantissa, exponent)


def shifted(
    numbers: Sequence[DoubledOrArray],
) -> tuple[tuple[DoubledOrArray, ...], jax.Array]:
    """Divide numbers by the power of two that brings their largest modulus between 1/2
    and 1, and return its exponent with them.
    """
    # Powers of two cancel between mantissa and exponent: they have no derivative.
    rough = [
        lax.stop_gradient(z.high if isinstance(z, Doubled) else z) for z in numbers
    ]
    sizes = [jnp.maximum(jnp.abs(z.real), jnp.abs(z.imag)) for z in rough]
    shift = jnp.frexp(jnp.max(jnp.stack(sizes), axis=0))[1]
    factor = jnp.ldexp(1.0, -shift)
    return jax.tree.map(lambda z: z * factor, tuple(numbers)), shift.astype(float)


def rescaled(number: jax.Array, exponent: jax.Array) -> Scaled:
    """``number 2^exponent`` as :class:`Scaled`."""
    (number,), shift = shifted((number,))
    return Scaled(number, exponent + shift)


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


def ways_between(topology: Topology, a: int, b: int) -> list[Way]:
    """All ways from disk a to b: one, or both ways round the loop where it lies between
    them.
    """
    ways = [way_between(topology, a, b)]
    closing = closing_link(topology)
    if closing is None:
        return ways
    for x, y in itertools.permutations(topology.link_ends[closing]):
        before = way_between(topology, a, x)
        behind = way_between(topology, y, b)
        if not before.keys() & behind.keys():
            ways.append(before | {x: closing} | behind)
    return ways


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
    system = chain.assemble(train)
    (determinant,) = _determinants(system, train.topology, p, [{}])
    return _over_inertias(system, determinant)


def frequency_response(train: DriveTrain, disk: str, at: str, hz: Numbers) -> Array:
    """Receptance ``(n,)`` in rad/(N m) of a train with at most one closed loop, from
    polynomials of its parts.

    ``H = sum (over the ways between the two disks) of prod k (over its links) . D(the
    rest, its disks held) / D``: one way, or the two round the loop.

    It is the angle of ``disk`` over a torque on the disk ``at``, at positive ``hz``
    ``(n,)``. :class:`SceneError` if there is no such disk, or more than one closed
    loop.

    >>> import jax.numpy as jnp
    >>> train = jaxhb.build(
    ...     [
    ...         *(jaxhb.Disk(name=n, inertia=2.0) for n in "ab"),
    ...         jaxhb.Shaft(between=("a", "b"), stiffness=100.0),
    ...     ]
    ... )
    >>> H = jaxhb.frequency_response(
    ...     train, "a", "b", jnp.array([5.0 / (2 * jnp.pi)])
    ... )  # 100 / (p^2 (p^2 + 100) 2 2)
    >>> [round(float(value), 9) for value in H.real]
    [-0.013333333]
    """
    ends = train.topology.disk_index(disk), train.topology.disk_index(at)
    return _receptance(linear_train(train), 2j * np.pi * jnp.asarray(hz, float), ends)


@partial(Program, static_argnames="ends")
def _receptance(train: DriveTrain, p: jax.Array, ends: tuple[int, int]) -> jax.Array:
    """Receptance ``(n,)`` in rad/(N m) between two disks."""
    system = chain.assemble(train)
    a, b = ends
    ways = ways_between(train.topology, a, b)
    whole, *parts = _determinants(system, train.topology, p, [{}, *ways])
    response = reduce(add, parts) / whole
    return response.value() / (system.radius[a] * system.radius[b])


def _determinants(
    system: chain.System, topology: Topology, p: jax.Array, ways: Sequence[Way]
) -> Iterator[Scaled]:
    """``det(p^2 M + p B + K)`` ``(n,)`` in displacements for each way: with its disks
    held, times k a b of its links.
    """
    # Loss factors count with the sign of Im p.
    stiffness, loss, viscous = (
        jnp.asarray(a)[:, None] for a in (system.stiffness, system.loss, system.viscous)
    )
    C = doubled(stiffness * (1 + 1j * loss * jnp.sign(p.imag))) + doubled(p).scaled(
        viscous
    )
    closing = closing_link(topology)
    terms = [[(doubled(jnp.ones_like(p)), way)] for way in ways]
    if closing is not None:
        added = closed(topology, closing, system.arm_a[closing], system.arm_b[closing])
        for way, terms_of_way in zip(ways, terms, strict=True):
            # Where an end of the link is held already, or the way is cut, there is
            # nothing to add.
            terms_of_way += [
                (C[closing] * factor, way | more)
                for factor, more in added
                if not way.keys() & more.keys()
            ]
    held_ways = [way for terms_of_way in terms for _, way in terms_of_way]
    held = np.zeros((len(held_ways), topology.n_disks), bool)
    passed = np.full((len(held_ways), topology.n_disks), LAST)
    for row, way in enumerate(held_ways):
        held[row, list(way)] = True
        passed[row, list(way)] = list(way.values())
    determinant = jax.vmap(
        lambda held, passed: _determinant(system, C, p, held, passed)
    )
    determinants = determinant(held, passed)
    rows = iter(range(len(held_ways)))
    for terms_of_way in terms:
        products = [
            jax.tree.map(itemgetter(next(rows)), determinants) * factor
            for factor, _ in terms_of_way
        ]
        total = reduce(add, products)
        yield rescaled(total.mantissa.high, total.exponent)


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
        (value,) = _determinants(changed, train.topology, 1j * omega, [{}])
        return _over_inertias(changed, value)

    exact = determinant(system.stiffness, system.viscous)
    low = determinant(system.stiffness, zeros)
    high = determinant(system.stiffness + system.viscous, zeros)
    approximate = low * (1 - 1j * omega) + high * (1j * omega)
    return DampedApproximation(
        exact, approximate, jnp.abs(((approximate + exact * -1.0) / exact).value())
    )


def _hung(
    part: tuple[Ring, Ring],
    above: tuple[Ring, Ring],
    z: Ring,
    k: Ring,
    near: Any,
    far: Any,
) -> tuple[Ring, Ring]:
    """Pair of a disk on which a part hangs by a link k, from the pairs (sum of F, G) of
    the part and of the disk above, and the z of the part; near and far are the arms of
    the link, numbers of any kind.
    """
    A, P = part
    A_above, P_above = above
    F = z * P + A
    W = F + P * k.scaled(near * near)
    return A_above * W + P_above * (F * k.scaled(far * far)), P_above * W


def _determinant(
    system: chain.System, C: Doubled, p: Doubled | Array, held: Array, passed: Array
) -> Scaled:
    """Determinant ``(n,)`` without the closing link, as Scaled of Doubled; ``held``
    ``(S,)``: which disks are held, ``passed`` ``(S,)``: the links whose k a b stand in
    their places, LAST for 1.
    """
    tree = system.tree
    p = doubled(p)
    mass, damping, ground = (
        jnp.asarray(a)[:, None] for a in (system.mass, system.damping, system.ground)
    )
    arm_a = jnp.asarray(system.arm_a)
    arm_b = jnp.asarray(system.arm_b)
    Z = p * p * mass + (p.scaled(damping) + ground)
    unit = doubled(jnp.ones_like(p.high))
    factors = jax.tree.map(
        lambda a, b: jnp.append(a, b[None], axis=0), C * (arm_a * arm_b)[:, None], unit
    )[passed]
    Z = jax.tree.map(lambda a, b: jnp.where(held[:, None], a, b), factors, Z)
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

    State = tuple[Doubled, Doubled, jax.Array]

    def hang(state: State, link: tuple[Any, ...]) -> tuple[State, None]:
        A, G, exponent = state
        disk, above, near, far, k, z = link
        (a, g), shift = shifted(
            _hung((A[disk], G[disk]), (A[above], G[above]), z, k, near, far)
        )
        exponent = exponent.at[above].add(exponent[disk] + shift)
        return (A.put(above, a), G.put(above, g), exponent), None

    shape = Z.high.shape
    state = (doubled(jnp.zeros(shape)), doubled(jnp.ones(shape)), jnp.zeros(shape))
    if len(order):
        state, _ = lax.scan(hang, state, (order, above, near, far, C[link], Z[order]))
    A, G, exponent = state
    root = tree.node[-1]
    return Scaled(Z[root] * G[root] + A[root], exponent[root])


def _over_inertias(system: chain.System, determinant: Scaled) -> Scaled:
    """D: the row of each disk with inertia divided by it, other rows in angles."""
    mass = jnp.asarray(system.mass)
    heavy = mass > 0
    factors = jnp.where(heavy, 1 / jnp.where(heavy, mass, 1.0), system.radius**2)

    def multiplied(value: Scaled, factor: jax.Array) -> tuple[Scaled, None]:
        return rescaled(value.mantissa * factor, value.exponent), None

    product, _ = lax.scan(multiplied, determinant, factors)
    return product


@dataclass(frozen=True)
class Polynomial:
    """Polynomial with coefficients of any kind of number, highest power first, none for
    zero; it has the operations of Doubled.
    """

    coefficients: tuple

    def __add__(self, other: Polynomial) -> Polynomial:
        size = max(len(self.coefficients), len(other.coefficients))
        a, b = (
            (0,) * (size - len(polynomial.coefficients)) + polynomial.coefficients
            for polynomial in (self, other)
        )
        return Polynomial(tuple(x + y for x, y in zip(a, b, strict=True)))

    def __mul__(self, other: Polynomial) -> Polynomial:
        a = self.coefficients
        b = other.coefficients
        product = [0] * (len(a) + len(b) - 1 if a and b else 0)
        for i, x in enumerate(a):
            for j, y in enumerate(b):
                product[i + j] += x * y
        return Polynomial(tuple(product))

    def scaled(self, factor: Any) -> Polynomial:
        """Multiply by a number."""
        return Polynomial(tuple(factor * value for value in self.coefficients))


Ring = TypeVar("Ring", Doubled, Polynomial)

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
    _refuse_coefficients(train, exact)

    def number(value: Any) -> Any:
        if exact:
            return Fraction(repr(float(value)))
        return value if traced(value) else float(value)

    topology = train.topology
    tree = chain.span(topology)
    closing = closing_link(topology)
    ground = [number(0.0)] * topology.n_disks
    for disk, stiffness in zip(
        topology.ground_disk, train.grounds.stiffness, strict=True
    ):
        ground[disk] += number(stiffness)
    inertia = map(number, (*train.disks.inertia, *train.dampers.inertia))
    damping = map(number, (*train.disks.damping, *np.zeros(len(topology.damper_names))))
    Z = [Polynomial(row) for row in zip(inertia, damping, ground, strict=True)]
    tables = (train.shafts, train.dampers, train.meshes)
    C = [
        Polynomial((number(r), number(c)))
        for table in tables
        for r, c in zip(table.damping, table.stiffness, strict=True)
    ]
    first_mesh = len(topology.link_names) - len(topology.mesh_names)

    def arms(link: int, disk: int) -> tuple[Any, Any]:
        """Arms of a link at a disk and at its other end, 1 for angles and the radii of
        gears.
        """
        a, b = topology.link_ends[link]
        near, far = (a, b) if a == disk else (b, a)
        if link < first_mesh:
            return 1, 1
        return number(train.disks.radius[near]), number(train.disks.radius[far])

    zero = Polynomial(())
    unit = Polynomial((number(1.0),))

    def determinant(way: Mapping[int, int]) -> Polynomial:
        """Determinant of the tree with the disks of a way held, times the k a b of its
        links.
        """
        passed = {
            disk: unit if link == LAST else C[link].scaled(math.prod(arms(link, disk)))
            for disk, link in way.items()
        }
        z = [passed.get(disk, free) for disk, free in enumerate(Z)]
        pairs = [(zero, unit)] * topology.n_disks
        for disk, link, above in zip(
            tree.node[:-1], tree.link[:-1], tree.node[tree.parent[:-1]], strict=True
        ):
            near, far = (
                (end not in way) * arm
                for end, arm in zip((disk, above), arms(link, disk), strict=True)
            )
            pairs[above] = _hung(pairs[disk], pairs[above], z[disk], C[link], near, far)
        A, G = pairs[tree.node[-1]]
        return z[tree.node[-1]] * G + A

    polynomial = determinant({})
    if closing is not None:
        arm_a, arm_b = arms(closing, topology.link_ends[closing][0])
        for factor, way in closed(topology, closing, arm_a, arm_b):
            polynomial += C[closing].scaled(factor) * determinant(way)
    leading = polynomial.coefficients[0]
    return tuple(value / leading for value in polynomial.coefficients)


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
