"""Holzer's table of a train without closed loops, as engineers print it, and its
residual over frequency.

From a free end with ordinate 1, the torque sum ``sum J omega^2 theta`` of the disks
passed twists the next shaft, ``theta_(i+1) = theta_i - sum / c_i``; the torque left
behind the last disk is the residual, zero at a natural frequency. Where branches meet,
each is scaled by the product of the ordinates that the others need at the common disk,
which is division-free (docs/theory C3): a branch that has a node there does no harm.
Torques cross a mesh by the radii of its gears.
"""

from dataclasses import dataclass

import numpy as np

from jaxhb._jax import Array, Number, Numbers, concrete, namespace, on_host, traced
from jaxhb._shown import brief
from jaxhb.elements.sentences import SceneError
from jaxhb.equations.system import System, Tree
from jaxhb.linear.tangent import linear_train
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain

NODE = 1e-9  # share of the largest angle below which a disk lies in a node
# Residual over the sum of all inertia forces at which a frequency is a natural one
NATURAL = 1e-6
# Disks up to which modes that the elimination loses are found with dense matrices
DENSE_DISKS = 500


@brief
@dataclass(frozen=True)
class HolzerTable:
    """One table, disks in the order of calculation; each row ends with the link to the
    disk that comes later.

    Parameters
    ----------
    hz : float, Hz
    names : tuple of str, the S disks, last the one at which the residual is read
    inertia : ``(S,)`` kg m2
    ordinate : ``(S,)`` rad; 1 at the first disk of the scene, or at the first row where
    that disk lies in a node
    torque : ``(S,)`` N m, J omega^2 theta less the torque of a ground spring
    torque_sum : ``(S,)`` N m, of the disk and all that it carries, transmitted by the
    link
    links : tuple of str; stiffness : ``(S,)`` N/m of a mesh, else N m/rad; twist :
    ``(S,)`` m of a mesh, else rad; all
        of the link to the next disk, "" and 0 in the last row
    """

    hz: Number
    names: tuple
    inertia: Array
    ordinate: Array
    torque: Array
    torque_sum: Array
    links: tuple
    stiffness: Array
    twist: Array

    @property
    def residual(self) -> Array:
        """Torque in N m that must be applied to the last disk for this motion."""
        return self.torque_sum[-1]

    @property
    def kinetic_energy(self) -> Array:
        """Kinetic energy ``(S,)`` in J of each disk, J omega^2 theta^2 / 2."""
        return self.inertia * (2 * np.pi * self.hz * self.ordinate) ** 2 / 2

    @property
    def strain_energy(self) -> Array:
        """Strain energy ``(S,)`` in J of each link to the next disk; with those of
        grounds their sum equals the kinetic one in a mode.
        """
        return self.stiffness * self.twist**2 / 2

    def __str__(self) -> str:
        width = max(len(name) for name in (*self.names, "disk"))
        lines = [f"Holzer table at {self.hz:.6g} Hz, residual {self.residual:.4e} N m"]
        lines += [
            f"{'disk':{width}} {'J':>11} {'theta':>11} {'J w^2 theta':>11} {'sum':>11}"
            f" {'c':>11} {'sum/c':>11}"
        ]
        columns = (
            self.inertia,
            self.ordinate,
            self.torque,
            self.torque_sum,
            self.stiffness,
            self.twist,
        )
        rows = zip(*columns, strict=True)
        for name, row in zip(self.names, rows, strict=True):
            cells = " ".join(f"{value:11.4e}" for value in row)
            lines.append(f"{name:{width}} {cells}")
        return "\n".join(lines)


def holzer_table(train: DriveTrain, *, hz: Number) -> HolzerTable:
    """Holzer's table at one frequency ``hz``, undamped, meshes in contact.

    ``theta_(i+1) = theta_i - (sum_(j<=i) J_j omega^2 theta_j) / c_i`` (H. Holzer, Die
    Berechnung der Drehschwingungen, Springer 1921). A part behind a link without
    stiffness (the ring of a viscous damper) rests, and no table ends there; at a
    natural frequency of such a part it is the rest that rests. Every number has
    derivatives with respect to the train and the frequency, both of which may be
    traced.

    :class:`SceneError` if the train has a closed loop.

    Thomson's three disks of 5, 11, 22 kg m2 at 20 rad/s.

    >>> parts = [
    ...     jaxhb.Disk(name=n, inertia=J) for n, J in zip("abc", (5.0, 11.0, 22.0))
    ... ]
    >>> parts += [
    ...     jaxhb.Shaft(between=e, stiffness=k)
    ...     for e, k in ((("a", "b"), 1e5), (("b", "c"), 2e5))
    ... ]
    >>> table = jaxhb.holzer_table(jaxhb.build(parts), hz=20 / 6.283185307179586)
    >>> table.ordinate.round(4).tolist(), round(table.residual)
    ([1.0, 0.98, 0.9484], 14658)
    """
    tree, system, displacement, force = _motion(train, hz)
    xp = namespace(system, hz)
    radius = system.radius[tree.node]
    mass = system.mass[tree.node]
    angle = displacement / radius
    natural = _is_natural(tree, system, 2 * np.pi * hz, displacement, force)
    unit = _unit(tree, angle, xp.where(natural, NODE, 0.0))
    link = tree.link[:-1]
    near = xp.where(tree.from_a, system.arm_a[tree.link], system.arm_b[tree.link])[:-1]
    # Carried by the link, positive where it slows the disk
    link_force = force[:-1] / near / unit
    is_shaft = np.array(
        [name not in train.topology.mesh_names for name in train.topology.link_names],
        dtype=bool,
    )[link]
    # Of shafts, from displacements to angles
    square = xp.where(is_shaft, radius[:-1] ** 2, 1.0)
    stiffness = system.stiffness[link]
    twist = xp.where(
        stiffness > 0, link_force / xp.where(stiffness > 0, stiffness, 1.0), 0.0
    )
    return HolzerTable(
        hz=hz if traced(hz) else float(hz),
        names=tuple(train.topology.disk_names[disk] for disk in tree.node),
        inertia=mass * radius**2,
        ordinate=angle / unit,
        torque=((2 * np.pi * hz) ** 2 * mass - system.ground[tree.node])
        * displacement
        * radius
        / unit,
        torque_sum=force * radius / unit,
        links=(*(train.topology.link_names[name] for name in link), ""),
        stiffness=xp.append(stiffness * square, 0.0),
        twist=xp.append(twist / xp.where(is_shaft, radius[:-1], 1.0), 0.0),
    )


def holzer_residual(train: DriveTrain, *, hz: Numbers) -> Array:
    """Residual ``(n,)`` in N m of Holzer's method at ``hz`` ``(n,)``, every branch
    begun with 1 at its free end.

    It is read at the last disk of :func:`holzer_table`, with the same errors: a
    polynomial in omega^2, zero at the natural frequencies. Where branches meet each is
    scaled by the others (docs/theory C3): nothing is divided. It overflows on long
    chains far above their frequencies, where ``jaxhb.characteristic`` does not. It has
    derivatives with respect to the train and the frequencies.

    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> f = jaxhb.natural_frequencies(train).frequencies_hz[1]
    >>> below, above = jaxhb.holzer_residual(train, hz=[0.99 * f, 1.01 * f])
    >>> bool(below > 0 > above)
    True
    """
    system = _system(train)
    tree = _trees(train, system)[0]
    omega = 2 * np.pi * namespace(system, hz).asarray(hz, dtype=float)
    balance, _, _ = _eliminate(tree, system, omega)
    return -balance[-1] * system.radius[tree.node[-1]]


def _system(train: DriveTrain) -> System:
    """The System of a train without closed loops; refuses others."""
    system = on_host(chain.assemble(linear_train(train)))
    if len(system.tree.loops):
        name = train.topology.link_names[system.tree.loops[0]]
        raise SceneError(
            f"{train.topology.title}: link {name!r} closes a loop, and Holzer's table"
            " is for trains without. Use jaxhb.natural_frequencies, on the command"
            " line jaxhb modes, which prints the energies, too."
        )
    return system


def _trees(train: DriveTrain, system: System) -> list[Tree]:
    """Eliminations from the free ends, one for each part that links with stiffness
    join, beginning with the part of the first disk: each ends at a ground of its part,
    or at the disk farthest from its first.
    """
    ends = train.topology.link_ends
    ground = train.topology.ground_disk
    disks = len(system.mass)
    shafts = len(train.topology.shaft_names)
    (stiffness,) = concrete(system.stiffness)
    # Under jit and vmap the numbers are traced: only dampers may have no stiffness.
    dampers = range(shafts, shafts + len(train.topology.damper_names))
    loose = dampers if traced(stiffness) else np.flatnonzero(stiffness == 0).tolist()
    near = chain.neighbours(ends, disks, without=loose)
    parts = []
    seen = set()
    for disk in range(disks):
        if disk not in seen:
            parts.append([reached for reached, *_ in chain.breadth_first(near, disk)])
            seen.update(parts[-1])
    # A disk alone moves with nothing.
    moving = [part for part in parts if len(part) > 1] or parts
    roots = [
        next((disk for disk in ground if disk in part), part[-1]) for part in moving
    ]
    return [chain.span_links(ends, disks, root) for root in roots]


def _motion(train: DriveTrain, hz: Number) -> tuple[Tree, System, Array, Array]:
    """Elimination, System, displacements ``(S,)`` m and forces ``(S,)`` N passed on to
    the next disk of the table.
    """
    system = _system(train)
    omega = 2 * np.pi * namespace(system, hz).asarray(hz, dtype=float)
    trees = _trees(train, system)
    first = trees[0]
    if traced(system, omega):
        displacement, force = _scaled(first, system, omega)
        return first, system, displacement, force
    motions = [_scaled(tree, system, omega) for tree in trees]
    for tree, (displacement, force) in zip(trees, motions, strict=True):
        if _is_mode(tree, system, displacement, force, omega):
            return tree, system, displacement, force
    if len(system.mass) <= DENSE_DISKS:
        # Several branches with a node at one joint leave the elimination nothing but
        # rounding, or another motion.
        displacement, force = _dense(first, system, omega)
        if _is_mode(first, system, displacement, force, omega):
            return first, system, displacement, force
    displacement, force = motions[0]
    return first, system, displacement, force


def _scaled(tree: Tree, system: System, omega: Array) -> tuple[Array, Array]:
    """Displacements ``(S,)`` m and forces ``(S,)`` N of the elimination, every branch
    scaled by the ordinates that the others need where they meet.
    """
    balance, ordinate, sibling_factor = _eliminate(tree, system, omega)
    xp = namespace(system, omega)
    scales = [xp.ones(())] * len(tree.node)
    for s in range(len(tree.node) - 2, -1, -1):
        # Backwards: the factor at a joint scales a branch, and all that hangs on it
        # further out.
        scales[s] = scales[tree.parent[s]] * sibling_factor[s]
    scale = xp.stack(scales)
    return scale * ordinate, -scale * balance


def _forces_left(
    tree: Tree, system: System, omega: Array, displacement: Array
) -> tuple[Array, float]:
    """Forces ``(S,)`` N left on the disks by links and inertia, in the order of the
    tree, and the largest of the forces of both.
    """
    motion = np.empty(np.shape(displacement))
    motion[tree.node] = displacement
    links = (system.stiffness * system.deflections(motion).T).T
    inertia = ((system.ground - system.mass * omega**2) * motion.T).T
    largest = max(np.abs(inertia).max(), np.abs(links).max(initial=0.0))
    return (inertia + system.spread(links))[tree.node], largest


def _dense(tree: Tree, system: System, omega: Array) -> tuple[np.ndarray, Array]:
    """Displacements ``(S,)`` m that leave the least forces in the dense equations, and
    the forces ``(S,)`` N passed on.
    """
    equations, _ = _forces_left(tree, system, omega, np.eye(len(tree.node)))
    displacement = np.linalg.svd(equations)[2][-1]
    return displacement, _passed_on(tree, system, omega, displacement)


def _passed_on(
    tree: Tree, system: System, omega: Array, displacement: np.ndarray
) -> Array:
    """Force ``(S,)`` N on the next disk of every disk and all that it carries: inertia
    forces less those of grounds.
    """
    force = (
        system.mass[tree.node] * omega**2 - system.ground[tree.node]
    ) * displacement
    for s, up in enumerate(tree.parent[:-1].tolist()):
        near = system.arm_a[tree.link[s]]
        far = system.arm_b[tree.link[s]]
        force[up] += force[s] * (far / near if tree.from_a[s] else near / far)
    return force


def _is_natural(
    tree: Tree,
    system: System,
    omega: Number,
    displacement: Array,
    force: Array,
) -> Array:
    """Whether the residual is rounding, compared with the inertia forces."""
    xp = namespace(system, displacement)
    driven = omega**2 * system.mass[tree.node] * displacement
    return xp.abs(force[-1]) <= NATURAL * xp.abs(driven).sum()


def _is_mode(
    tree: Tree,
    system: System,
    displacement: Array,
    force: Array,
    omega: Array,
) -> bool:
    """Whether no force is left on any disk; on the host."""
    left, largest = _forces_left(tree, system, omega, displacement)
    balanced = np.abs(left).max() <= NATURAL * largest
    return bool(balanced and _is_natural(tree, system, omega, displacement, force))


def _unit(tree: Tree, angle: Array, node: Number) -> Array:
    """Angle of the first disk of the scene, or in the first row that moves where that
    disk lies in a node: at most the share ``node`` of the largest angle.
    """
    xp = namespace(angle)
    first = int(np.flatnonzero(tree.node == 0)[0])
    rows = xp.concatenate([angle[first : first + 1], angle])
    moving = xp.abs(rows) > node * xp.abs(angle).max()
    unit = rows[xp.argmax(moving)]
    return xp.where(unit != 0, unit, 1.0)


def _eliminate(
    tree: Tree, system: System, omega: Array
) -> tuple[Array, Array, list[Array]]:
    """Balance sum Z x ``(S, ...)`` and ordinate ``(S, ...)`` of each subtree, free ends
    at 1, and the factor by which branches beside it scale it.
    """
    xp = namespace(system, omega)
    node = tree.node
    balance = [
        ground - mass * omega**2
        for ground, mass in zip(system.ground[node], system.mass[node], strict=True)
    ]
    ordinate = [xp.ones_like(omega)] * len(node)
    sibling_factor = [xp.ones_like(omega)] * len(node)
    hung: dict = {}
    for s, up in enumerate(tree.parent[:-1].tolist()):
        alpha = system.arm_a[tree.link[s]]
        beta = system.arm_b[tree.link[s]]
        if not tree.from_a[s]:
            alpha, beta = beta, alpha
        stiffness = system.stiffness[tree.link[s]]
        loose = stiffness == 0  # the branch rests and leaves the joint free
        bent = balance[s] / (alpha * xp.where(loose, 1.0, stiffness))
        needed = xp.where(loose, 1.0, (alpha * ordinate[s] + bent) / beta)
        sibling_factor[s] = xp.where(loose, 0.0, ordinate[up])
        for earlier in hung.setdefault(up, []):
            sibling_factor[earlier] = sibling_factor[earlier] * needed
        hung[up].append(s)
        balance[up] = balance[up] * needed + xp.where(
            loose, 0.0, ordinate[up] * beta / alpha * balance[s]
        )
        ordinate[up] = ordinate[up] * needed
    return xp.stack(balance), xp.stack(ordinate), sibling_factor
