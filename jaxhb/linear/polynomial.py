"""Characteristic polynomials and frequency responses by their values, at any size, without quotients (Moliboshko).

For a complex p, ``D(p) = det(p^2 M + p B + K(p)) / prod I`` over the disks with inertia; link stiffnesses are
``k = c + r p``. The source's R of a free train is ``D / p^2``. Every part of the train is a pair (docs/theory C3): F,
its determinant while free, and G, while it is held where it meets the rest. A part on link k with arms a and b
multiplies the other's pair: ``W = F + a^2 k G``, then ``F' <- F' W + G' b^2 k F``, ``G' <- G' W``. Pairs are rescaled
by powers of two, which is exact, so that nothing overflows. In one closed loop the pairs hang on a ring, summed by
continuants. All of it has twice the precision (:mod:`~jaxhb.linear.extended`), as little is left of large terms beside
a root. Only damping times p, and what radii of gears enter, is rounded: as if these numbers of the train had another
last digit.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import Array, Numbers
from jaxhb._program import Program
from jaxhb._shown import brief
from jaxhb.elements.elements import SceneError
from jaxhb.equations.block_sweep import slots
from jaxhb.linear.extended import Scaled, doubled, rescaled, scaled_product, shifted
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain


@dataclass(frozen=True)
class Parts:
    """Parts that hang on a spine of disks, eliminated in ``order`` (host): link, place and place above of each."""

    order: np.ndarray
    link: np.ndarray
    own: np.ndarray
    above: np.ndarray
    places: int
    spine: tuple
    joints: tuple


def spine_of(train):
    """The :class:`Parts` that hang on the root of a tree or on the ring of disks of the one closed loop."""
    tree = chain.span(train.topology)
    if not len(tree.loops):
        return _hang(tree, (int(tree.node[-1]),))
    if len(tree.loops) > 1:
        where = train.topology.title
        names = ", ".join(repr(train.topology.link_names[link]) for link in tree.loops)
        raise SceneError(
            f"{where}: links {names} close {len(tree.loops)} loops, and characteristic polynomials take one at most. "
            "Use natural_frequencies or linear_response."
        )
    loop = int(tree.loops[0])
    return _hang(tree, _path(tree, int(tree.end_a[loop]), int(tree.end_b[loop])), closing=loop)


def _path(tree, a, b):
    """Disks of the tree from a to b."""
    above = {int(tree.node[s]): int(tree.node[up]) for s, up in enumerate(tree.parent[:-1].tolist())}

    def climb(disk):
        way = [disk]
        while way[-1] in above:
            way.append(above[way[-1]])
        return way

    up, down = climb(a), climb(b)
    met = next(disk for disk in up if disk in set(down))
    return (*up[: up.index(met) + 1], *reversed(down[: down.index(met)]))


def _hang(tree, spine, closing=None):
    """The :class:`Parts` of a tree that hang on the disks ``spine``, joined in a row and by the link ``closing``."""
    at = [[] for _ in tree.node]
    for s, up in enumerate(tree.parent[:-1].tolist()):
        disk, other, link = int(tree.node[s]), int(tree.node[up]), int(tree.link[s])
        at[disk].append((other, link))
        at[other].append((disk, link))
    seen, outward = set(spine), [(disk, -1, -1) for disk in spine]
    for disk, _, _ in outward:
        for other, link in at[disk]:
            if other not in seen:
                seen.add(other)
                outward.append((other, disk, link))
    hanging = outward[: len(spine) - 1 : -1]
    position = {disk: s for s, (disk, *_) in enumerate([*hanging, *((disk,) for disk in spine)])}
    parent = np.array([position[up] for _, up, _ in hanging], dtype=np.int32)
    held = slots([*np.where(parent < len(hanging), parent, len(hanging)), len(hanging)])
    places = len(held.every)
    onto = [up >= len(hanging) for up in parent]
    above = np.where(onto, places + parent - len(hanging), held.above[:-1])
    links = {frozenset((a, b)): link for a, pairs in enumerate(at) for b, link in pairs}
    joints = [links[frozenset(pair)] for pair in zip(spine, spine[1:], strict=False)]
    return Parts(
        order=np.array([disk for disk, *_ in hanging], dtype=np.int32),
        link=np.array([link for *_, link in hanging], dtype=np.int32),
        own=held.own[:-1],
        above=above.astype(np.int32),
        places=places + len(spine),
        spine=tuple(spine),
        joints=(*joints, *(() if closing is None else (closing,))),
    )


def ways_between(tree, a, b):
    """Ways from disk a to b as (disks, links): one, and where the closed loop allows it the other way round it."""
    at = {
        frozenset((int(tree.node[s]), int(tree.node[up]))): int(tree.link[s]) for s, up in enumerate(tree.parent[:-1])
    }

    def way(*disks):
        return disks, [at[frozenset(pair)] for pair in zip(disks, disks[1:], strict=False)]

    ways = [way(*_path(tree, a, b))]
    for loop in tree.loops.tolist():
        x, y = int(tree.end_a[loop]), int(tree.end_b[loop])
        for near, far in ((x, y), (y, x)):
            (there, before), (back, behind) = way(*_path(tree, a, near)), way(*_path(tree, far, b))
            if not set(there) & set(back):
                ways.append(((*there, *back), [*before, loop, *behind]))
    return ways


def characteristic(train: DriveTrain, p: Array) -> Scaled:
    """Characteristic determinant D(p) of a train with at most one closed loop, meshes in contact.

    Parameters
    ----------
    train : DriveTrain, may be traced
    p : complex array ``(n,)`` 1/s; i omega for harmonic motion. Loss factors count with the sign of Im p.

    Returns
    -------
    Scaled ``(n,)``
        In s^(-2 S) for S disks, all with inertia. The source's R of a free tree is D / p^2, its R^0 of a loop is D.

    Raises
    ------
    SceneError
        If there is more than one closed loop.

    Examples
    --------
    >>> import jaxhb, jax.numpy as jnp
    >>> train = jaxhb.build([*(jaxhb.Disk(name=n, inertia=2.0) for n in "ab"),
    ...                      jaxhb.Shaft(between=("a", "b"), stiffness=100.0)])
    >>> jaxhb.characteristic(train, 1j * jnp.array([0.0, 5.0])).value().real.tolist()  # p^2 (p^2 + 100)
    [0.0, -1875.0]
    """
    return _characteristic(train, jnp.asarray(p, complex))


@Program
def _characteristic(train, p):
    system = chain.assemble(train)
    return _over_inertias(system, _determinant(system, spine_of(train), p))


def frequency_response(train: DriveTrain, disk: str, at: str, hz: Numbers) -> Array:
    """Receptance of a train with at most one closed loop from polynomials of its parts.

    ``H = sum (over the ways between the two disks) of prod k (over its links) . D(the rest, its disks held) / D``: one
    way, or the two round the loop.

    Parameters
    ----------
    train : DriveTrain, may be traced
    disk, at : str
        Disk whose angle is wanted and disk at which the torque acts.
    hz : array ``(n,)`` Hz, positive

    Returns
    -------
    complex array ``(n,)``, rad/(N m)

    Raises
    ------
    SceneError
        If there is no such disk, or if there is more than one closed loop.

    Examples
    --------
    >>> import jaxhb, jax.numpy as jnp
    >>> train = jaxhb.build([*(jaxhb.Disk(name=n, inertia=2.0) for n in "ab"),
    ...                      jaxhb.Shaft(between=("a", "b"), stiffness=100.0)])
    >>> H = jaxhb.frequency_response(train, "a", "b", jnp.array([5.0 / (2 * jnp.pi)]))  # 100 / (p^2 (p^2 + 100) 2 2)
    >>> [round(float(value), 9) for value in H.real]
    [-0.013333333]
    """
    ends = train.topology.disk_index(disk), train.topology.disk_index(at)
    return _receptance(train, 2j * np.pi * jnp.asarray(hz, float), ends)


@partial(Program, static_argnames="ends")
def _receptance(train, p, ends):
    """Receptance ``(n,)`` between two disks."""
    system, spine = chain.assemble(train), spine_of(train)
    names = "mass", "damping", "ground", "arm_a", "arm_b"
    own = {name: jnp.asarray(getattr(system, name)) for name in names}
    cases = [own, *(_passed(system, *way) for way in ways_between(system.tree, *ends))]
    together = jax.tree.map(lambda *a: jnp.stack(a), *cases)
    found = jax.vmap(lambda case: _determinant(dataclasses.replace(system, **case), spine, p))(together)
    whole, *ways = (Scaled(*pair) for pair in zip(found.mantissa, found.exponent, strict=True))
    response = _combined(*((1.0, way) for way in ways)) / whole
    return response.value() / (system.radius[ends[0]] * system.radius[ends[1]])


def _passed(system, disks, links):
    """Numbers that make the determinant that of the other disks, these held, times ``k a b`` of the links passed."""
    disks, links = np.array(disks), np.array(links, dtype=int)
    stiffness, loss, viscous = (jnp.asarray(a)[links] for a in (system.stiffness, system.loss, system.viscous))
    arm_a, arm_b = jnp.asarray(system.arm_a), jnp.asarray(system.arm_b)
    both = arm_a[links] * arm_b[links]
    # Without arms at its ends a link holds the other disk alone; the factors stand where the disks passed were.
    return {
        "mass": jnp.asarray(system.mass).at[disks].set(0.0),
        "damping": jnp.asarray(system.damping).at[disks].set(jnp.append(viscous * both, 0.0)),
        "ground": jnp.asarray(system.ground, complex)
        .at[disks]
        .set(jnp.append(stiffness * (1 + 1j * loss) * both, 1.0)),
        "arm_a": jnp.where(np.isin(system.tree.end_a, disks), 0.0, arm_a),
        "arm_b": jnp.where(np.isin(system.tree.end_b, disks), 0.0, arm_b),
    }


@jax.tree_util.register_dataclass
@brief
@dataclass(frozen=True)
class DampedApproximation:
    """The source's approximation of a damped characteristic polynomial beside the exact value.

    exact, approximate : Scaled ``(n,)``; relative_error : ``(n,)``, |approximate - exact| / |exact|
    """

    exact: Scaled
    approximate: Scaled
    relative_error: jax.Array


def damped_approximation(train: DriveTrain, omega: Array) -> DampedApproximation:
    """The source's ``D(i omega) = D1 + i omega (D2 - D1)``: D1 without link damping, D2 with c + r as stiffness.

    Parameters
    ----------
    train : DriveTrain, may be traced
        At most one closed loop; loss factors do not count; damping of disks enters all three exactly.
    omega : array ``(n,)`` rad/s

    Returns
    -------
    DampedApproximation

    Notes
    -----
    First order in omega r/c, with a second-order error that depends on the unit of time, as c + r adds N m and N m s
    (docs/theory C4): at most 1 % for omega r/c up to 0.01 and omega much larger than 1. Prefer the exact value.

    Examples
    --------
    >>> import jaxhb, jax.numpy as jnp
    >>> train = jaxhb.build([*(jaxhb.Disk(name=n, inertia=2.0) for n in "ab"),
    ...                      jaxhb.Shaft(between=("a", "b"), stiffness=100.0, damping=1.0)])
    >>> bool(jaxhb.damped_approximation(train, jnp.array([5.0])).relative_error[0] < 1e-15)  # exact for one link
    True
    """
    return _approximation(train, jnp.asarray(omega, float))


@Program
def _approximation(train, omega):
    system, spine = chain.assemble(train), spine_of(train)
    none = jnp.zeros_like(jnp.asarray(system.viscous))

    def value(stiffness, viscous):
        changed = dataclasses.replace(system, stiffness=stiffness, viscous=viscous, loss=none)
        return _over_inertias(system, _determinant(changed, spine, 1j * omega))

    stiffness = jnp.stack([system.stiffness, system.stiffness, system.stiffness + system.viscous])
    found = jax.vmap(value)(stiffness, jnp.stack([system.viscous, none, none]))
    exact, low, high = (Scaled(*pair) for pair in zip(found.mantissa, found.exponent, strict=True))
    approximate = _combined((1 - 1j * omega, low), (1j * omega, high))
    difference = _combined((1.0, approximate), (-1.0, exact)) / exact
    return DampedApproximation(exact, approximate, jnp.abs(difference.value()))


def _combined(*terms):
    """Sum of factors times scaled numbers."""
    exponent = jnp.max(jnp.stack([number.exponent for _, number in terms]), axis=0)
    shares = [
        factor * number.mantissa * jnp.ldexp(1.0, jnp.maximum(number.exponent - exponent, -2000).astype(int))
        for factor, number in terms
    ]
    return rescaled(sum(shares), exponent)


def _pairs(system, parts, p):
    """Pairs F, G ``(m, n)`` of the disks of the spine with all that hangs on them, their exponents, and the joints.

    Joints are arms ``(j,)`` at the disk before and at the one behind, and stiffnesses ``(j, n)``.
    """
    stiffness, loss, viscous = (jnp.asarray(a)[:, None] for a in (system.stiffness, system.loss, system.viscous))
    mass, damping, ground = (jnp.asarray(a)[:, None] for a in (system.mass, system.damping, system.ground))
    p, turned = doubled(p), jnp.sign(p.imag)
    C = doubled(stiffness * (1 + 1j * loss * turned)) + p.scaled(viscous)
    Z = p * p * mass + (p.scaled(damping) + ground)

    def arms(link, disk):
        first = system.tree.end_a[link] == disk
        arm_a, arm_b = jnp.asarray(system.arm_a)[link], jnp.asarray(system.arm_b)[link]
        return jnp.where(first, arm_a, arm_b), jnp.where(first, arm_b, arm_a)

    def take(state, item):
        A, P, exponent = state
        own, above, near, far, k, z = item
        F, G = z * P[own] + A[own], P[own]
        W = F + G * k.scaled(near * near)
        moved = exponent[own]
        A, P, exponent = A.put(own, 0.0), P.put(own, 1.0), exponent.at[own].set(0.0)
        (a, b), shift = shifted((A[above] * W + P[above] * (F * k.scaled(far * far)), P[above] * W))
        return (A.put(above, a), P.put(above, b), exponent.at[above].add(moved + shift)), None

    shape = (parts.places, *p.high.shape)
    state = (doubled(jnp.zeros(shape)), doubled(jnp.ones(shape)), jnp.zeros(shape))
    if len(parts.order):
        items = (parts.own, parts.above, *arms(parts.link, parts.order), C[parts.link], Z[parts.order])
        state, _ = lax.scan(take, state, items)
    spine, joints = np.array(parts.spine), np.array(parts.joints, dtype=int)
    A, P, exponent = (array[-len(spine) :] for array in state)
    alpha, beta = arms(joints, spine[: len(joints)])
    return Z[spine] * P + A, P, exponent, alpha, beta, C[joints]


def _determinant(system, parts, p):
    """``det(p^2 M + p B + K)`` in displacements."""
    F, G, exponent, alpha, beta, k = _pairs(system, parts, p)
    if not parts.joints:
        return rescaled(F[0].high, exponent[0])
    # det = K(1..m) - c_m^2 w_1 w_m K(2..m-1) - 2 prod c prod w with diagonals d, couplings c = a b k (docs/theory C3)
    alpha, beta = alpha[:, None], beta[:, None]
    behind = k * beta * beta
    diagonal = F + G * (k * alpha * alpha + jax.tree.map(lambda a: jnp.roll(a, 1, axis=0), behind))
    coupling = k * alpha * beta
    zero, one = (doubled(jnp.full(p.shape, value)) for value in (0.0, 1.0))

    def extend(state, item):
        (whole, last, inner, inner_last, ring), exponent = state
        d, w, c, w_before, more = item
        step = c * c * w * w_before
        state = (d * whole - step * last, whole, d * inner - step * inner_last, inner, ring * c * w)
        state, shift = shifted(state)
        return (state, exponent + shift + more), None

    first, shift = shifted((diagonal[0], one, one, zero, G[0]))
    items = (diagonal[1:], G[1:], coupling[:-1], G[:-1], exponent[1:])
    (state, total), _ = lax.scan(extend, (first, exponent[0] + shift), items)
    whole, _, _, inner_last, ring = state
    last = coupling[-1]
    closed = whole - last * last * G[0] * G[-1] * inner_last - last * ring * 2.0
    return rescaled(closed.high, total)


def _over_inertias(system, determinant):
    """D: each row of a disk with inertia divided by it, other rows in angles."""
    mass = jnp.asarray(system.mass)
    heavy = mass > 0
    weight = scaled_product(jnp.where(heavy, 1 / jnp.where(heavy, mass, 1.0), system.radius**2))
    return rescaled(determinant.mantissa * weight.mantissa, determinant.exponent + weight.exponent)
