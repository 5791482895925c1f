"""Characteristic polynomials and frequency responses by their values, at any size, without quotients (Moliboshko).

For a complex p, ``D(p) = det(p^2 M + p B + K(p)) / prod I`` over the disks with inertia; link stiffnesses are
``k = c + r p``. The source's R of a free train is ``D / p^2``. Every part of the train is a pair (method.md C3): F, its
determinant while free, and G, while it is held where it meets the rest. A part on link k with arms a and b multiplies
the other's pair: ``W = F + a^2 k G``, then ``F' <- F' W + G' b^2 k F``, ``G' <- G' W``. Pairs are rescaled by powers of
two, which is exact, so that nothing overflows. In one closed loop the pairs hang on a ring, summed by continuants.
"""

import dataclasses
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..harmonic import chain
from ..harmonic.block_sweep import slots
from ..model.elements import SceneError


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Scaled:
    """Complex numbers ``mantissa 2^exponent`` beyond the range of float64.

    mantissa : complex array; exponent : float array of whole numbers, same shape
    """

    mantissa: jax.Array
    exponent: jax.Array

    @property
    def log_modulus(self):
        """Natural logarithm of the modulus."""
        return jnp.log(jnp.abs(self.mantissa)) + self.exponent * np.log(2.0)

    @property
    def phase(self):
        """Phase in rad, -pi to pi."""
        return jnp.angle(self.mantissa)

    def value(self):
        """The complex numbers; infinite or zero where they leave the range."""
        half = jnp.clip(self.exponent // 2, -1100, 1100).astype(int)
        rest = jnp.clip(self.exponent - half, -1100, 1100).astype(int)
        return self.mantissa * jnp.ldexp(1.0, half) * jnp.ldexp(1.0, rest)

    def __truediv__(self, other):
        return _rescaled((self.mantissa / other.mantissa,), self.exponent - other.exponent)


@dataclass(frozen=True)
class _Parts:
    """Parts that hang on a spine of disks, eliminated in ``order`` (host): link, place and place above of each."""

    order: np.ndarray
    link: np.ndarray
    own: np.ndarray
    above: np.ndarray
    places: int
    spine: tuple
    joints: tuple


def characteristic(train, p):
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
    return _determinant(chain.assemble(train), _spine(train), jnp.asarray(p, complex))


def frequency_response(train, disk, at, hz):
    """Receptance of a train without closed loops from polynomials of its parts.

    ``H = prod k (over the links between the two disks) . D(the rest, the disks between held) / D``.

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
        If there is no such disk, or if the train has a closed loop.

    Examples
    --------
    >>> import jaxhb, jax.numpy as jnp
    >>> train = jaxhb.build([*(jaxhb.Disk(name=n, inertia=2.0) for n in "ab"),
    ...                      jaxhb.Shaft(between=("a", "b"), stiffness=100.0)])
    >>> H = jaxhb.frequency_response(train, "a", "b", jnp.array([5.0 / (2 * jnp.pi)]))  # 100 / (p^2 (p^2 + 100) 2 2)
    >>> [round(float(value), 9) for value in H.real]
    [-0.013333333]
    """
    system, topology = chain.assemble(train), train.topology
    a, b = topology.disk_index(disk), topology.disk_index(at)
    parts = _hang(system.tree, _path(_without_loops(train), a, b))
    p = 2j * np.pi * jnp.asarray(hz, float)
    F, G, exponent, alpha, beta, k = _pairs(system, parts, p, jnp.ones(len(system.mass)))
    whole = Scaled(F[0], exponent[0])
    held, passed = G[0], Scaled(G[0], exponent[0])
    for i in range(len(parts.spine) - 1):  # parts along the way, one after the other
        W = whole.mantissa + alpha[i] ** 2 * k[i] * held
        free = F[i + 1] * W + G[i + 1] * beta[i] ** 2 * k[i] * whole.mantissa
        (free, held), shift = _shifted((free, G[i + 1] * W))
        product = alpha[i] * beta[i] * k[i] * G[i + 1] * passed.mantissa
        passed = _rescaled((product,), passed.exponent + exponent[i + 1])
        whole = Scaled(free, whole.exponent + exponent[i + 1] + shift)
    return (passed / whole).value() / (system.radius[a] * system.radius[b])


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class DampedApproximation:
    """The source's approximation of a damped characteristic polynomial beside the exact value.

    exact, approximate : Scaled ``(n,)``; relative_error : ``(n,)``, |approximate - exact| / |exact|
    """

    exact: Scaled
    approximate: Scaled
    relative_error: jax.Array


def damped_approximation(train, omega):
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
    (method.md, M5): at most 1 % for omega r/c up to 0.01 and omega much larger than 1. Prefer the exact value.

    Examples
    --------
    >>> import jaxhb, jax.numpy as jnp
    >>> train = jaxhb.build([*(jaxhb.Disk(name=n, inertia=2.0) for n in "ab"),
    ...                      jaxhb.Shaft(between=("a", "b"), stiffness=100.0, damping=1.0)])
    >>> bool(jaxhb.damped_approximation(train, jnp.array([5.0])).relative_error[0] < 1e-15)  # exact for one link
    True
    """
    system, spine = chain.assemble(train), _spine(train)
    omega = jnp.asarray(omega, float)
    none = jnp.zeros_like(jnp.asarray(system.viscous))
    viscous = dataclasses.replace(system, loss=none)
    without = dataclasses.replace(viscous, viscous=none)
    stiffer = dataclasses.replace(without, stiffness=system.stiffness + system.viscous)
    exact, low, high = (_determinant(kind, spine, 1j * omega) for kind in (viscous, without, stiffer))
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
    return _rescaled((sum(shares),), exponent)


def _shifted(numbers):
    """Numbers with their largest modulus between 1/2 and 1, and the power of two taken out."""
    sizes = [jnp.maximum(jnp.abs(z.real), jnp.abs(z.imag)) for z in map(lax.stop_gradient, numbers)]
    shift = jnp.frexp(jnp.max(jnp.stack(sizes), axis=0))[1]
    factor = jnp.ldexp(1.0, -shift)
    return tuple(z * factor for z in numbers), shift.astype(float)


def _rescaled(numbers, exponent):
    (number,), shift = _shifted(numbers)
    return Scaled(number, exponent + shift)


def _without_loops(train):
    """The elimination tree of a train without closed loops; others are refused."""
    tree = chain.span(train.topology)
    if len(tree.loops):
        where, link = train.topology.name or "scene", train.topology.link_names[tree.loops[0]]
        raise SceneError(
            f"{where}: link {link!r} closes a loop, and responses from polynomials are for trains without. "
            "Use linear_response."
        )
    return tree


def _spine(train):
    """Parts that hang on the root of a tree or on the ring of disks of the one closed loop."""
    tree = chain.span(train.topology)
    if not len(tree.loops):
        return _hang(tree, (int(tree.node[-1]),))
    if len(tree.loops) > 1:
        where = train.topology.name or "scene"
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
    """The :class:`_Parts` of a tree that hang on the disks ``spine``, joined in a row and by the link ``closing``."""
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
    return _Parts(
        order=np.array([disk for disk, *_ in hanging], dtype=np.int32),
        link=np.array([link for *_, link in hanging], dtype=np.int32),
        own=held.own[:-1],
        above=above.astype(np.int32),
        places=places + len(spine),
        spine=tuple(spine),
        joints=(*joints, *(() if closing is None else (closing,))),
    )


def _pairs(system, parts, p, weight):
    """Pairs F, G ``(m, n)`` of the disks of the spine with all that hangs on them, their exponents, and the joints.

    weight : ``(S,)`` by which the row of each disk is multiplied. Joints are arms ``(j,)`` at the disk before and at
    the one behind, and stiffnesses ``(j, n)``.
    """
    stiffness, loss, viscous = (jnp.asarray(a)[:, None] for a in (system.stiffness, system.loss, system.viscous))
    C = stiffness * (1 + 1j * loss * jnp.sign(p.imag)) + viscous * p
    mass, damping, ground = (jnp.asarray(a)[:, None] for a in (system.mass, system.damping, system.ground))
    Z = p**2 * mass + p * damping + ground

    def arms(link, disk):
        first = system.tree.end_a[link] == disk
        arm_a, arm_b = jnp.asarray(system.arm_a)[link], jnp.asarray(system.arm_b)[link]
        return jnp.where(first, arm_a, arm_b), jnp.where(first, arm_b, arm_a)

    def take(state, item):
        A, P, exponent = state
        own, above, near, far, k, z, w = item
        F, G = w * (z * P[own] + A[own]), w * P[own]
        W = F + near**2 * k * G
        moved = exponent[own]
        A, P, exponent = A.at[own].set(0.0), P.at[own].set(1.0), exponent.at[own].set(0.0)
        (a, b), shift = _shifted((A[above] * W + P[above] * far**2 * k * F, P[above] * W))
        return (A.at[above].set(a), P.at[above].set(b), exponent.at[above].add(moved + shift)), None

    shape = (parts.places, len(p))
    state = (jnp.zeros(shape, complex), jnp.ones(shape, complex), jnp.zeros(shape))
    if len(parts.order):
        items = (parts.own, parts.above, *arms(parts.link, parts.order), C[parts.link], Z[parts.order])
        state, _ = lax.scan(take, state, (*items, weight[parts.order]))
    spine, joints = np.array(parts.spine), np.array(parts.joints, dtype=int)
    A, P, exponent = (array[-len(spine) :] for array in state)
    w = weight[spine, None]
    alpha, beta = arms(joints, spine[: len(joints)])
    return w * (Z[spine] * P + A), w * P, exponent, alpha, beta, C[joints]


def _determinant(system, parts, p):
    """D(p), each row of a disk with inertia divided by it, other rows in angles."""
    mass = jnp.asarray(system.mass)
    heavy = mass > 0
    weight = jnp.where(heavy, 1 / jnp.where(heavy, mass, 1.0), system.radius**2)
    F, G, exponent, alpha, beta, k = _pairs(system, parts, p, weight)
    if not parts.joints:
        return Scaled(F[0], exponent[0])
    # det = K(1..m) - c_m^2 w_1 w_m K(2..m-1) - 2 prod c prod w with diagonals d, couplings c = a b k (method.md C3)
    along, behind = alpha[:, None] ** 2 * k, beta[:, None] ** 2 * k
    diagonal = F + G * (along + jnp.roll(behind, 1, axis=0))
    coupling = (alpha * beta)[:, None] * k
    zero, one = jnp.zeros_like(p), jnp.ones_like(p)

    def extend(state, item):
        (whole, last, inner, inner_last, ring), exponent = state
        d, w, c, w_before, more = item
        step = c**2 * w * w_before
        state = (d * whole - step * last, whole, d * inner - step * inner_last, inner, ring * c * w)
        state, shift = _shifted(state)
        return (state, exponent + shift + more), None

    (first, shift) = _shifted((diagonal[0], one, one, zero, G[0]))
    items = (diagonal[1:], G[1:], coupling[:-1], G[:-1], exponent[1:])
    (state, total), _ = lax.scan(extend, (first, exponent[0] + shift), items)
    whole, _, _, inner_last, ring = state
    closing = coupling[-1] ** 2 * G[0] * G[-1] * inner_last
    return _rescaled((whole - closing - 2 * coupling[-1] * ring,), total)
