"""The train linearised at its mean load: meshes with backlash, and stages, stops and
clearance of shafts and dampers, with the slope f'(l) of law (18) there. Dry friction is
left out, and mesh stiffness that varies is taken by its mean.

The equilibrium of the mean torques is the minimum of a convex energy, found by Newton's
method with steps halved until the energy falls, on the host. Derivatives are those of
two more steps: the first has the first, the second the second.
"""

import dataclasses
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from jaxhb._jax import Number, added, concrete, namespace, on_host, traced
from jaxhb._shown import brief
from jaxhb.elements.elements import SceneError
from jaxhb.equations import backlash
from jaxhb.excitation.torques import excitation
from jaxhb.train import chain, connections
from jaxhb.train.changes import in_contact, linearised
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed
from jaxhb.train.varying import without_tables

STEPS, HALVINGS = 200, 40  # of Newton's method at most, and of a step of it
SOLVED = (
    1e-10  # force left over the largest mean force at which the equilibrium is found
)
# Tooth force over the largest mean force below which a mesh begins in the middle of its
# gap
IDLE = 1e-9
# Singular value of a tangent stiffness over the largest that is rounding of a rigid
# motion
SINGULAR = 1e-14
UNBALANCED = (
    1e-9  # mean torque left over the largest from which the train does not run steadily
)
ROUNDED = 1e-14  # of the work of the loads, by which an energy may rise in rounding
DENSE_DISKS = 1000  # up to which the equilibrium is found with dense matrices
# Of the largest stiffness, by which a train of more disks is held; the next steps take
# back its force
HELD = 1e-12
ANY_SPEED = 1000.0  # rpm, where a scene names none


@brief
@dataclass(frozen=True)
class MeanLoad:
    """Links at the mean load of a speed, and the train linearised there; made by
    :func:`at_mean_load`.

    Parameters
    ----------
    train : DriveTrain, without backlash, its meshes with the slopes, its shafts and
    dampers with them in place of
        stages, stops, clearance and friction
    names : tuple of str, meshes with backlash
    force : ``(m,)`` N, mean elastic tooth force
    stiffness : ``(m,)`` N/m, slope f'(l)
    engagement : ``(m,)`` 0 in the gap, 1 in contact, between them in the transition
    zone
    share : ``(m,)`` slope over the stiffness in contact
    rpm : float, of the reference rotor
    links : tuple of str, shafts and dampers with stages, stops, clearance or friction
    torque : ``(l,)`` N m, their mean torque; twist : ``(l,)`` rad; link_stiffness :
    ``(l,)`` N m/rad, slope there
    angle : ``(S,)`` rad, mean angles of the disks, rings last
    loaded : bool, False where links are taken at rest, as nothing balances the mean
    torques
    """

    train: Any
    names: tuple
    force: np.ndarray
    stiffness: np.ndarray
    engagement: np.ndarray
    share: np.ndarray
    rpm: Number
    links: tuple
    torque: np.ndarray
    twist: np.ndarray
    link_stiffness: np.ndarray
    angle: np.ndarray
    loaded: bool = True


def at_mean_load(train: DriveTrain, *, rpm: Number) -> MeanLoad:
    """Linearise a train at the mean load of one speed: ``D^T f(D x) = q``, law (18) of
    Fridman 2009.

    Meshes with backlash, and stages, stops and clearance of shafts and dampers, get
    their slope there; dry friction is left out. At ``rpm`` of the reference rotor,
    whose mean torques act. All numbers have first and second derivatives with respect
    to the train and the speed; slopes, epsilon c in the gap and c beyond the knee, are
    piecewise linear in the deflection, and so are theirs. :class:`SceneError` if mean
    torques do not balance, no equilibrium is found, or links vary; ValueError inside
    ``jit`` or ``vmap``, as the equilibrium is looked for on the host.

    >>> at_mean_load(jaxhb.load_scene("spur_pair"), rpm=2000.0).engagement.tolist()
    [1.0]
    """
    values, at = _concrete(train, rpm)
    check_speed(values, at)
    name = train.topology.title
    equations = _equations(values, at)
    if not equations.balanced:
        raise SceneError(
            f"{name} at {at:g} rpm: mean torques do not balance, so there is no mean"
            " load. Add a load."
        )
    x = _equilibrium(equations)
    if x is None:
        raise SceneError(
            f"{name} at {at:g} rpm: no equilibrium of the mean torques was found. Leave"
            " out --at."
        )
    return _mean_load(train, rpm, equations, x, pressed=False)


def at_pressed_load(train: DriveTrain, *, rpm: Number | None = None) -> MeanLoad:
    """The same with all gaps closed, those of clearances too: stages and stops at the
    mean load of a speed, by default :func:`own_speed`.

    ``train`` of it has meshes and links that vary as they were. At rest where nothing
    balances the mean torques.
    """
    values, at = _concrete(train, own_speed(train) if rpm is None else rpm)
    equations = _equations(in_contact(without_tables(values)), at)
    x = _equilibrium(equations) if equations.balanced else None
    statics = in_contact(without_tables(train))
    load = _mean_load(statics, at if rpm is None else rpm, equations, x, pressed=True)
    return dataclasses.replace(
        load, train=with_slopes(train, load), loaded=x is not None
    )


def linear_train(train: DriveTrain, *, rpm: Number | None = None) -> DriveTrain:
    """The train that linear calculations take: that of :func:`at_pressed_load`; itself
    if no shaft or damper has stages, stops, clearance or friction.
    """
    return at_pressed_load(train, rpm=rpm).train if train.topology.springs else train


def own_speed(train: DriveTrain) -> float:
    """The speed in rpm whose mean load counts where none is asked for: the rated one,
    else the highest at which the scene gives a torque.
    """
    (values,) = _concrete(train)
    return float(
        train.topology.rated_rpm or max(connections.speeds(values)) or ANY_SPEED
    )


def _concrete(*trees):
    values = concrete(*trees)
    if traced(values):
        raise ValueError(
            "at_mean_load: jit or vmap traces the train or the speed, and the"
            " equilibrium is looked for on the host. Call it outside, where it has"
            " derivatives. Linear calculations need it of trains whose shafts have"
            " stages, stops, clearance or friction."
        )
    return values


def _mean_load(train, rpm, equations, x, pressed):
    """The :class:`MeanLoad` at the equilibrium ``x``; None: at rest."""
    topology = train.topology
    system = equations.system
    if x is None:
        found = _read(equations, np.zeros(len(system.mass)), pressed)
    elif traced(train, rpm):
        import jax  # which is there, as it traces

        found = jax.jit(partial(_refined, pressed=pressed))(train, rpm, x)
    else:
        found = _read(equations, x, pressed)
    gaps = np.flatnonzero(topology.mesh_backlash)
    first = len(topology.link_names) - len(topology.mesh_names)
    links = np.array(
        list(dict.fromkeys(link for link, *_ in topology.springs)), dtype=int
    )
    arm = system.radius[system.tree.end_a[links]]
    rigid = (
        np.asarray(chain.rigid_shape(train, system.radius))
        if not traced(train)
        else None
    )
    still = (
        found.displacement
        if rigid is None
        else found.displacement - chain.drift(system, rigid, found.displacement)
    )
    load = MeanLoad(
        None,
        tuple(topology.mesh_names[i] for i in gaps),
        *(
            values[gaps]
            for values in (found.force, found.slope, found.engagement, found.share)
        ),
        rpm=rpm,
        links=tuple(topology.link_names[link] for link in links),
        torque=found.link_force[links] * arm,
        twist=found.deflection[links] / arm,
        link_stiffness=found.link_slope[links] * arm**2,
        angle=chain.to_angles(system, still),
    )
    bare = linearised(with_slopes(train, load))
    meshes = dataclasses.replace(bare.meshes, stiffness=found.link_slope[first:])
    return dataclasses.replace(load, train=dataclasses.replace(bare, meshes=meshes))


def with_slopes(train, load):
    """The train whose shafts and dampers have the stiffness of a mean load in place of
    what acts beside it.
    """
    topology = train.topology
    slopes = dict(zip(load.links, load.link_stiffness, strict=True))

    def table(numbers, names):
        if not slopes.keys() & set(names):
            return numbers
        xp = namespace(numbers, load.link_stiffness)
        rows = [
            slopes.get(name, given)
            for name, given in zip(names, numbers.stiffness, strict=True)
        ]
        return dataclasses.replace(
            numbers, stiffness=xp.stack([xp.asarray(row, dtype=float) for row in rows])
        )

    return dataclasses.replace(
        train,
        topology=dataclasses.replace(topology, springs=()),
        shafts=table(train.shafts, topology.shaft_names),
        dampers=table(train.dampers, topology.damper_names),
    )


class _Equations(NamedTuple):
    """Static equations of the train under the mean torques ``load`` ``(S,)`` N: links
    of ``constant`` stiffness ``(L,)`` N/m, and beside them laws ``(E,)`` of all meshes
    and of what acts beside shafts, at ``link`` ``(E,)``; ``clearance`` ``(E,)``:
    whether it is the play of a shaft.
    """

    system: chain.System
    constant: np.ndarray
    law: backlash.Law
    link: np.ndarray
    clearance: np.ndarray
    load: np.ndarray
    balanced: bool

    def on_links(self, values):
        """Sums ``(L,)`` of the values ``(E,)`` of laws."""
        return added(namespace(values).zeros(len(self.constant)), self.link, values)

    def links(self, deflection):
        """Force ``(L,)`` N and slope ``(L,)`` N/m of the links."""
        at = deflection[self.link]
        force = backlash.force(self.law, at)
        slope = backlash.slope(self.law, at)
        return self.constant * deflection + self.on_links(
            force
        ), self.constant + self.on_links(slope)

    def unbalanced(self, x):
        """Force ``(S,)`` in N that the links and grounds leave of the load at
        displacements ``(S,)``.
        """
        force, _ = self.links(self.system.deflections(x))
        return self.load - self.system.spread(force) - self.system.ground * x

    def solved(self, slope: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Displacements ``(S,)`` in m under forces ``(S,)`` in N of links with these
        slopes and grounds; host.
        """
        if len(force) <= DENSE_DISKS:
            # Least squares: the tangent of a floating train is singular.
            return np.linalg.lstsq(self.tangent(slope), force, rcond=SINGULAR)[0]
        from scipy import sparse
        from scipy.sparse.linalg import splu

        tree = self.system.tree
        system = self.system
        links = np.arange(len(slope))
        disks = np.concatenate([tree.end_a, tree.end_b])
        arms = np.concatenate([system.arm_a, -system.arm_b])
        incidence = sparse.csr_array(
            (arms, (disks, np.tile(links, 2))), shape=(len(force), len(slope))
        )
        held = system.ground + HELD * np.abs(slope).max(initial=0.0)
        tangent = incidence @ sparse.diags_array(
            slope
        ) @ incidence.T + sparse.diags_array(held)
        return splu(tangent.tocsc()).solve(force)

    def tangent(self, slope):
        """Stiffness ``(S, S)`` in N/m of links with these slopes and grounds."""
        incidence = self.system.incidence()
        return (incidence * slope) @ incidence.T + namespace(self.system.ground).diag(
            self.system.ground
        )


def _equations(train, rpm):
    """The :class:`_Equations` at a speed."""
    torque, _, left = excitation(train, rpm, 0)
    system, torque, left, train = on_host(
        (chain.assemble(train), torque[:, 0].real, left, train)
    )
    meshes = backlash.all_meshes(train)
    topology = train.topology
    plays = [kind == "clearance" for _, kind, _ in topology.springs]
    clearance = np.array([*[False] * len(topology.mesh_names), *plays], dtype=bool)
    # Meshes and plays stand in the place of the stiffness of their links, stages and
    # stops beside it.
    instead = np.append(meshes.link[: len(topology.mesh_names)], meshes.link[clearance])
    constant = namespace(system).where(
        np.isin(np.arange(len(topology.link_names)), instead), 0.0, system.stiffness
    )
    # Friction stands still.
    law = dataclasses.replace(meshes.law, friction=None, slip=None)
    floats = bool(system.floating)
    balanced = (
        not floats
        or traced(left)
        or abs(left) <= UNBALANCED * np.abs(torque).max(initial=0.0)
    )
    return _Equations(
        system, constant, law, meshes.link, clearance, torque / system.radius, balanced
    )


class _Found(NamedTuple):
    """At an equilibrium: displacement ``(S,)`` m, deflection ``(L,)`` m, force N and
    slope N/m of links, and force, slope, engagement and slope over the stiffness in
    contact of meshes and what acts beside shafts ``(E,)``.
    """

    displacement: np.ndarray
    deflection: np.ndarray
    link_force: np.ndarray
    link_slope: np.ndarray
    force: np.ndarray
    slope: np.ndarray
    engagement: np.ndarray
    share: np.ndarray


def _read(equations, x, pressed):
    """What is known at displacements; ``pressed``: plays of shafts have their full
    stiffness.
    """
    law = equations.law
    deflection = equations.system.deflections(x)
    at = deflection[equations.link]
    engagement = backlash.engagement(law, at)
    share = law.epsilon + (1 - law.epsilon) * engagement
    force = backlash.force(law, at)
    slope = backlash.slope(law, at)
    link_force, _ = equations.links(deflection)
    if pressed:
        slope = namespace(slope).where(equations.clearance, law.stiffness, slope)
    link_slope = equations.constant + equations.on_links(slope)
    return _Found(
        x, deflection, link_force, link_slope, force, slope, engagement, share
    )


def _refined(train, rpm, x, pressed):
    """What is read two steps of Newton's method from the equilibrium, as one
    program.
    """
    equations = _equations(train, rpm)
    for _ in range(2):
        _, slope = equations.links(equations.system.deflections(x))
        tangent = equations.tangent(slope)
        x = x + namespace(tangent).linalg.pinv(
            tangent, rtol=SINGULAR
        ) @ equations.unbalanced(x)
    return _read(equations, x, pressed)


def _equilibrium(equations):
    """Displacements ``(S,)`` in m at which the mean torques are in equilibrium, or None
    where none was found; host.
    """
    system, law, load = equations.system, equations.law, equations.load

    def energy(x):
        deflection = system.deflections(x)
        links = (equations.constant * deflection**2).sum() / 2 + backlash.energy(
            law, deflection[equations.link]
        ).sum()
        return links + (system.ground * x**2).sum() / 2 - load @ x

    # begin on the flanks that all teeth in contact would press: in a gap without
    # stiffness nothing pulls back to them
    size = np.abs(load).max(initial=0.0)
    x = equations.solved(system.stiffness, load)
    pressed = (system.stiffness * system.deflections(x))[equations.link]
    flank = np.where(
        np.abs(pressed) > IDLE * size, np.sign(pressed), 0.0
    ) * backlash.offset(law)
    # On a flank f = c l - offset: the offset goes to the side of the load.
    x = equations.solved(
        system.stiffness, load + system.spread(equations.on_links(flank))
    )
    least = energy(x)
    for _ in range(STEPS):
        deflection, left = system.deflections(x), equations.unbalanced(x)
        force, slope = equations.links(deflection)
        if np.abs(left).max(initial=0.0) <= SOLVED * max(
            size, np.abs(force).max(initial=0.0)
        ):
            return x
        step = equations.solved(slope, left)
        share = 1.0
        for _ in range(HALVINGS):
            reached = energy(x + share * step)
            if reached <= least + ROUNDED * (np.abs(load) @ np.abs(x)):
                break
            share /= 2
        x, least = x + share * step, reached
    return None
