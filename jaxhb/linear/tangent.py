"""The train linearised at its mean load: meshes with backlash, and stages, stops and
clearance of shafts and dampers, with the slope f'(l) of law (18) there. Dry friction is
left out, and mesh stiffness that varies is taken by its mean.

The equilibrium of the mean torques is the minimum of a convex energy, found by Newton's
method with steps halved until the energy falls, on the host. Derivatives are those of
two more steps: the first has the first, the second the second.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from jaxhb._jax import Array, Number, added, concrete, namespace, on_host, traced
from jaxhb._shown import brief
from jaxhb.elements.sentences import SceneError
from jaxhb.equations import backlash
from jaxhb.equations.system import System
from jaxhb.train import chain
from jaxhb.train.changes import in_contact, linearised
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import excitation, main_speed
from jaxhb.train.mesh_parameters import all_meshes
from jaxhb.train.speeds import check_speed
from jaxhb.train.varying import at_speed, without_tables

STEPS = 200  # of Newton's method, at most
HALVINGS = 40  # of one step, at most
# Force left, over the largest mean force, at which the equilibrium is found
SOLVED = 1e-10
# Tooth force over the largest mean force below which a mesh begins in the middle of its
# gap
IDLE = 1e-9
# Singular value of a tangent stiffness over the largest that is rounding of a rigid
# motion
SINGULAR = 1e-14
# Mean torque left, over the largest, from which the train does not run steadily
UNBALANCED = 1e-9
# Share of the work of the loads by which an energy may rise in rounding
ROUNDED = 1e-14
DENSE_DISKS = 1000  # up to which the equilibrium is found with dense matrices
# Share of the largest stiffness with which a train of more disks is held; the next
# steps take back its force
HELD = 1e-12


@brief
@dataclass(frozen=True)
class MeanLoad:
    """Links at the mean load of a speed, and the train linearised there; made by
    :func:`at_mean_load`.

    Parameters
    ----------
    train : DriveTrain, without backlash; its meshes, shafts and dampers have the slopes
        in place of backlash, stages, stops, clearance and friction
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
    force: Array
    stiffness: Array
    engagement: Array
    share: Array
    rpm: Number
    links: tuple
    torque: Array
    twist: Array
    link_stiffness: Array
    angle: Array
    loaded: bool = True


def at_mean_load(train: DriveTrain, *, rpm: Number) -> MeanLoad:
    """Linearise a train at the mean load of one speed: ``D^T f(D x) = q``, law (18) of
    Fridman 2009.

    Meshes with backlash, and stages, stops and clearance of shafts and dampers, get
    their slope there; dry friction is left out. At ``rpm`` of the reference rotor,
    whose mean torques act. All numbers have first and second derivatives with respect
    to the train and the speed; slopes, epsilon c in the gap and c beyond the knee, are
    piecewise linear in the deflection. :class:`SceneError` if mean torques do not
    balance, no equilibrium is found, or links vary; ValueError inside ``jit`` or
    ``vmap``, as the equilibrium is found on the host.

    >>> at_mean_load(jaxhb.load_scene("spur_pair"), rpm=2000.0).engagement.tolist()
    [1.0]
    """
    values, speed = _concrete(train, rpm)
    check_speed(values, speed)
    values = at_speed(values, speed)
    title = train.topology.title
    equations = _equations(values, speed)
    if not equations.balanced:
        raise SceneError(
            f"{title} at {speed:g} rpm: mean torques do not balance, so there is no"
            " mean load. Add a load."
        )
    x = _equilibrium(equations)
    if x is None:
        raise SceneError(
            f"{title} at {speed:g} rpm: no equilibrium of the mean torques was found."
            " Leave out --at."
        )
    return _mean_load(at_speed(train, rpm), rpm, equations, x, pressed=False)


def at_pressed_load(train: DriveTrain, *, rpm: Number | None = None) -> MeanLoad:
    """Linearise as :func:`at_mean_load` with all gaps closed, those of clearances too:
    stages and stops at the mean load of a speed, by default :func:`own_speed`.

    The ``train`` of the result is that at ``rpm``, where one is given, and keeps its
    meshes, and its links that vary. It is at rest where nothing balances the mean
    torques.
    """
    if rpm is not None:
        train = at_speed(train, rpm)
    values, speed = _concrete(train, own_speed(train) if rpm is None else rpm)
    equations = _equations(in_contact(without_tables(values)), speed)
    x = _equilibrium(equations) if equations.balanced else None
    statics = in_contact(without_tables(train))
    load_speed = speed if rpm is None else rpm
    load = _mean_load(statics, load_speed, equations, x, pressed=True)
    return dataclasses.replace(
        load, train=with_slopes(train, load), loaded=x is not None
    )


def linear_train(train: DriveTrain, *, rpm: Number | None = None) -> DriveTrain:
    """The train of linear calculations: that of :func:`at_pressed_load`, or the train
    itself if no shaft or damper has stages, stops, clearance or friction.
    """
    return at_pressed_load(train, rpm=rpm).train if train.topology.springs else train


def own_speed(train: DriveTrain) -> float:
    """Default speed in rpm of the mean load: the rated speed, else the highest at which
    the scene gives a torque.
    """
    (values,) = _concrete(train)
    return main_speed(values)


def _concrete(*trees: Any) -> Any:
    """Values of trees; refuses trees traced by ``jit`` or ``vmap``."""
    values = concrete(*trees)
    if traced(values):
        raise ValueError(
            "at_mean_load: jit or vmap traces the train or the speed, and the"
            " equilibrium is looked for on the host. Call it outside, where it has"
            " derivatives. Linear calculations need it of trains whose shafts have"
            " stages, stops, clearance or friction."
        )
    return values


def _mean_load(
    train: DriveTrain,
    rpm: Number,
    equations: _Equations,
    x: np.ndarray | None,
    pressed: bool,
) -> MeanLoad:
    """The :class:`MeanLoad` at the equilibrium ``x`` ``(S,)`` in m; at rest if it is
    None.
    """
    topology = train.topology
    system = equations.system
    if x is None:
        state = _state_at(equations, np.zeros(len(system.mass)), pressed)
    elif traced(train, rpm):
        import jax  # which is loaded already, as it traces

        state = jax.jit(partial(_refined, pressed=pressed))(train, rpm, x)
    else:
        state = _state_at(equations, x, pressed)
    gaps = np.flatnonzero(topology.mesh_backlash)
    first = len(topology.link_names) - len(topology.mesh_names)
    links = np.array(
        list(dict.fromkeys(link for link, *_ in topology.springs)), dtype=int
    )
    arm = system.radius[system.tree.end_a[links]]
    displacement = state.displacement
    if not traced(train):
        rigid = np.asarray(chain.rigid_shape(train, system.radius))
        displacement = displacement - chain.drift(system, rigid, displacement)
    load = MeanLoad(
        train=None,
        names=tuple(topology.mesh_names[i] for i in gaps),
        force=state.force[gaps],
        stiffness=state.slope[gaps],
        engagement=state.engagement[gaps],
        share=state.share[gaps],
        rpm=rpm,
        links=tuple(topology.link_names[link] for link in links),
        torque=state.link_force[links] * arm,
        twist=state.deflection[links] / arm,
        link_stiffness=state.link_slope[links] * arm**2,
        angle=chain.to_angles(system, displacement),
    )
    linear = linearised(with_slopes(train, load))
    meshes: Any = linear.meshes  # a dataclass made of the fields of the elements
    meshes = dataclasses.replace(meshes, stiffness=state.link_slope[first:])
    return dataclasses.replace(load, train=dataclasses.replace(linear, meshes=meshes))


def with_slopes(train: DriveTrain, load: MeanLoad) -> DriveTrain:
    """The train whose shafts and dampers have the stiffness of a mean load in place of
    their stages, stops, clearance and friction, and of a stiffness over the speed.
    """
    topology = train.topology
    slopes = dict(zip(load.links, load.link_stiffness, strict=True))

    def sloped(table: Any, names: Sequence[str]) -> Any:
        if not slopes.keys() & set(names):
            return table
        xp = namespace(table, load.link_stiffness)
        rows = [
            slopes.get(name, stiffness)
            for name, stiffness in zip(names, table.stiffness, strict=True)
        ]
        return dataclasses.replace(
            table, stiffness=xp.stack([xp.asarray(row, dtype=float) for row in rows])
        )

    rpm_tables = tuple(
        (table, field, i, count)
        for table, field, i, count in topology.rpm_tables
        if field != "stiffness" or topology.names_of(table)[i] not in slopes
    )
    return dataclasses.replace(
        train,
        topology=dataclasses.replace(topology, springs=(), rpm_tables=rpm_tables),
        shafts=sloped(train.shafts, topology.shaft_names),
        dampers=sloped(train.dampers, topology.damper_names),
    )


class _Equations(NamedTuple):
    """Static equations of the train under the mean torques ``load`` ``(S,)`` N: links
    of ``constant`` stiffness ``(L,)`` N/m, and parallel to them laws ``(E,)`` of all
    meshes and of stages, stops and clearance of shafts, at ``link`` ``(E,)``;
    ``clearance`` ``(E,)``: whether a law is the play of a shaft.
    """

    system: System
    constant: Array
    law: backlash.Law
    link: Array
    clearance: np.ndarray
    load: Array
    balanced: bool

    def on_links(self, values: Array) -> Array:
        """Sums ``(L,)`` over each link of the values ``(E,)`` of laws."""
        return added(namespace(values).zeros(len(self.constant)), self.link, values)

    def links(self, deflection: Array) -> tuple[Array, Array]:
        """Force ``(L,)`` N and slope ``(L,)`` N/m of the links at ``deflection``
        ``(L,)`` m.
        """
        law_deflection = deflection[self.link]
        force = backlash.force(self.law, law_deflection)
        slope = backlash.slope(self.law, law_deflection)
        link_force = self.constant * deflection + self.on_links(force)
        return link_force, self.constant + self.on_links(slope)

    def unbalanced(self, x: Array) -> Array:
        """Force ``(S,)`` in N that the links and grounds leave of the load at
        displacements ``(S,)`` m.
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

    def tangent(self, slope: Array) -> Array:
        """Stiffness ``(S, S)`` in N/m of links with these slopes and grounds."""
        incidence = self.system.incidence()
        return (incidence * slope) @ incidence.T + namespace(self.system.ground).diag(
            self.system.ground
        )


def _equations(train: DriveTrain, rpm: Number) -> _Equations:
    """The :class:`_Equations` at a speed."""
    torque, _, left = excitation(train, rpm, 0)
    system, torque, left, train = on_host(
        (chain.assemble(train), torque[:, 0].real, left, train)
    )
    meshes = all_meshes(train)
    topology = train.topology
    plays = [kind == "clearance" for _, kind, _ in topology.springs]
    clearance = np.array([*[False] * len(topology.mesh_names), *plays], dtype=bool)
    # Meshes and plays replace the stiffness of their links, stages and stops add to it.
    replacing = np.append(
        meshes.link[: len(topology.mesh_names)], meshes.link[clearance]
    )
    replaced = np.isin(np.arange(len(topology.link_names)), replacing)
    constant = namespace(system).where(replaced, 0.0, system.stiffness)
    # Friction does not act at rest.
    law = dataclasses.replace(meshes.law, friction=None, slip=None)
    balanced = (
        not system.floating
        or traced(left)
        or abs(left) <= UNBALANCED * np.abs(torque).max(initial=0.0)
    )
    return _Equations(
        system=system,
        constant=constant,
        law=law,
        link=meshes.link,
        clearance=clearance,
        load=torque / system.radius,
        balanced=balanced,
    )


class _Equilibrium(NamedTuple):
    """State of an equilibrium: displacement ``(S,)`` m of disks; deflection m, force N
    and slope N/m ``(L,)`` of links; and force, slope, engagement and slope over the
    stiffness in contact ``(E,)`` of the laws of meshes and shafts.
    """

    displacement: Array
    deflection: Array
    link_force: Array
    link_slope: Array
    force: Array
    slope: Array
    engagement: Array
    share: Array


def _state_at(equations: _Equations, x: Array, pressed: bool) -> _Equilibrium:
    """The :class:`_Equilibrium` at displacements ``(S,)`` m; ``pressed``: plays of
    shafts have their full stiffness.
    """
    law = equations.law
    deflection = equations.system.deflections(x)
    law_deflection = deflection[equations.link]
    engagement = backlash.engagement(law, law_deflection)
    share = law.epsilon + (1 - law.epsilon) * engagement
    force = backlash.force(law, law_deflection)
    slope = backlash.slope(law, law_deflection)
    link_force, _ = equations.links(deflection)
    if pressed:
        slope = namespace(slope).where(equations.clearance, law.stiffness, slope)
    link_slope = equations.constant + equations.on_links(slope)
    return _Equilibrium(
        displacement=x,
        deflection=deflection,
        link_force=link_force,
        link_slope=link_slope,
        force=force,
        slope=slope,
        engagement=engagement,
        share=share,
    )


def _refined(train: DriveTrain, rpm: Number, x: Array, pressed: bool) -> _Equilibrium:
    """The :class:`_Equilibrium` after two steps of Newton's method from the
    equilibrium, as one program.
    """
    equations = _equations(train, rpm)
    for _ in range(2):
        _, slope = equations.links(equations.system.deflections(x))
        tangent = equations.tangent(slope)
        inverse = namespace(tangent).linalg.pinv(tangent, rtol=SINGULAR)
        x = x + inverse @ equations.unbalanced(x)
    return _state_at(equations, x, pressed)


def _equilibrium(equations: _Equations) -> np.ndarray | None:
    """Displacements ``(S,)`` in m at which the mean torques are in equilibrium, or None
    where no equilibrium is found; on the host.
    """
    system = equations.system
    law = equations.law
    load = np.asarray(equations.load)
    stiffness = np.asarray(system.stiffness)

    def energy(x: np.ndarray) -> float:
        deflection = system.deflections(x)
        linear = (equations.constant * deflection**2).sum() / 2
        laws = backlash.energy(law, deflection[equations.link]).sum()
        return linear + laws + (system.ground * x**2).sum() / 2 - load @ x

    # Begin on the flanks that all teeth in contact would press: in a gap without
    # stiffness nothing pulls back to them.
    size = np.abs(load).max(initial=0.0)
    x = equations.solved(stiffness, load)
    pressed = (stiffness * system.deflections(x))[equations.link]
    side = np.where(np.abs(pressed) > IDLE * size, np.sign(pressed), 0.0)
    flank = side * backlash.offset(law)
    # On a flank f = c l - offset: the offset goes to the side of the load.
    x = equations.solved(stiffness, load + system.spread(equations.on_links(flank)))
    least = energy(x)
    for _ in range(STEPS):
        left = np.asarray(equations.unbalanced(x))
        force, slope = equations.links(system.deflections(x))
        largest = max(size, np.abs(force).max(initial=0.0))
        if np.abs(left).max(initial=0.0) <= SOLVED * largest:
            return x
        step = equations.solved(np.asarray(slope), left)
        share = 1.0
        for _ in range(HALVINGS):
            reached = energy(x + share * step)
            if reached <= least + ROUNDED * (np.abs(load) @ np.abs(x)):
                break
            share /= 2
        x = x + share * step
        least = reached
    return None
