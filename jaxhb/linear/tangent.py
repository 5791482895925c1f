"""The train linearised at its mean load: meshes with backlash with the slope f'(l) of law (18) there.

The static equilibrium ``D^T f(D x) = q`` of the mean torques is the minimum of a convex energy, found by Newton's
method with steps halved until the energy falls, on the host. In the gap the slope is epsilon c, beyond the knee c.
Derivatives are those of two steps more from the equilibrium: the first has the first, the second also the second ones.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from jaxhb._jax import Number, concrete, namespace, on_host, traced
from jaxhb._shown import brief
from jaxhb.elements.elements import SceneError
from jaxhb.equations import backlash
from jaxhb.excitation.torques import excitation
from jaxhb.train import chain
from jaxhb.train.changes import without_backlash
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed

STEPS, HALVINGS = 200, 40
"""Of Newton's method at most, and of a step of it."""
SOLVED = 1e-10
"""Force left over the largest mean force at which the equilibrium is found."""
IDLE = 1e-9
"""Tooth force over the largest mean force below which a mesh begins in the middle of its gap."""
SINGULAR = 1e-14
"""Singular value of a tangent stiffness over the largest that is rounding of a rigid motion."""
UNBALANCED = 1e-9
"""Mean torque left over the largest from which the train does not run steadily."""


@brief
@dataclass(frozen=True)
class MeanLoad:
    """Meshes at the mean load of a speed, and the train linearised there; made by :func:`at_mean_load`.

    Parameters
    ----------
    train : DriveTrain, without backlash, its meshes with the slopes
    names : tuple of str, meshes with backlash
    force : ``(m,)`` N, mean elastic tooth force
    stiffness : ``(m,)`` N/m, slope f'(l)
    engagement : ``(m,)`` 0 in the gap, 1 in contact, between them in the transition zone
    share : ``(m,)`` slope over the stiffness in contact
    """

    train: object
    names: tuple
    force: np.ndarray
    stiffness: np.ndarray
    engagement: np.ndarray
    share: np.ndarray


def at_mean_load(train: DriveTrain, *, rpm: Number) -> MeanLoad:
    """Linearise the meshes with backlash at the mean load of one speed.

    Parameters
    ----------
    train : DriveTrain
    rpm : float
        Speed of the reference rotor, whose mean torques act.

    Returns
    -------
    MeanLoad
        Of m meshes with backlash the elastic force (N), the slope f'(l) of the law (N/m) and where on the law they are,
        each ``(m,)``; and the linear train with these slopes. All have first and second derivatives with respect to the
        train and the speed; slopes are piecewise linear in the deflection, and so are theirs.

    Raises
    ------
    SceneError
        If mean torques do not balance, no equilibrium is found, or links vary.
    ValueError
        Inside ``jit`` or ``vmap``, as the equilibrium is looked for on the host.

    Notes
    -----
    ``D^T f(D x) = q`` with the law (18) of Fridman 2009; in the gap its slope is epsilon c, beyond the knee c.

    Examples
    --------
    >>> import jaxhb
    >>> at_mean_load(jaxhb.load_scene("spur_pair"), rpm=2000.0).engagement.tolist()
    [1.0]
    """
    values, at = concrete(train, rpm)
    if traced(values, at):
        raise ValueError(
            "at_mean_load: jit or vmap traces the train or the speed, and the equilibrium is looked for on the host. "
            "Call it outside, where it has derivatives."
        )
    check_speed(values, at)
    topology = train.topology
    name, static = topology.title, _Static.of(values, at)
    if static.system.floating and abs(static.left) > UNBALANCED * np.abs(static.torque).max():
        raise SceneError(f"{name} at {at:g} rpm: mean torques do not balance, so there is no mean load. Add a load.")
    x = _equilibrium(static)
    if x is None:
        raise SceneError(f"{name} at {at:g} rpm: no equilibrium of the mean torques was found. Leave out --at.")
    if traced(train, rpm):
        import jax  # which is there, as it traces

        meshes, found = jax.jit(_refined)(train, rpm, x)
    else:
        meshes, found = static.read(x)
    bare = without_backlash(train)
    bare = dataclasses.replace(bare, meshes=dataclasses.replace(bare.meshes, stiffness=meshes))
    return MeanLoad(bare, tuple(topology.mesh_names[i] for i in topology.backlash_index), *found)


@dataclass(frozen=True)
class _Static:
    """The equations of the mean: links, mean torques, and the law of the meshes with backlash, may be traced.

    ``links`` are the numbers of those meshes among all links, ``first`` that of the first mesh.
    """

    system: chain.System
    torque: np.ndarray
    left: np.ndarray
    law: backlash.Law
    links: np.ndarray
    first: int

    @classmethod
    def of(cls, train, rpm):
        """Those of a train at a speed."""
        own, topology = train.topology.backlash_index, train.topology
        first = len(topology.link_names) - len(topology.mesh_names)
        torque, _, left = excitation(train, rpm, 0)
        law = backlash.Law(*(a[own] for a in dataclasses.astuple(backlash.law_of(train.meshes))))
        return cls(*on_host((chain.assemble(train), torque[:, 0].real, left, law)), first + own, first)

    @property
    def load(self):
        """Forces ``(S,)`` in N of the mean torques."""
        return self.torque / self.system.radius

    def put(self, values, own):
        """``values`` of all links with those of the law at their places."""
        # A product with 0 and 1 puts numbers at their places for numpy and for jax alike.
        chosen = np.eye(len(values))[:, self.links]
        return namespace(values, own).where(chosen.any(1), chosen @ own, values)

    def held(self, x):
        """Force of every link and its slope."""
        l, stiffness = self.system.deflections(x), self.system.stiffness
        force, slope = (law(self.law, l[self.links]) for law in (backlash.force, backlash.slope))
        return self.put(stiffness * l, force), self.put(stiffness, slope)

    def energy(self, x):
        """Energy in J that is least at the equilibrium."""
        l = self.system.deflections(x)
        links = self.put(self.system.stiffness * l**2 / 2, backlash.energy(self.law, l[self.links]))
        return links.sum() + (self.system.ground * x**2).sum() / 2 - self.load @ x

    def unbalanced(self, x):
        """Force ``(S,)`` in N that the links and grounds leave of the load."""
        return self.load - self.system.incidence() @ self.held(x)[0] - self.system.ground * x

    def tangent(self, slope):
        """Stiffness ``(S, S)`` in N/m of links with these slopes and grounds."""
        incidence = self.system.incidence()
        return (incidence * slope) @ incidence.T + namespace(self.system.ground).diag(self.system.ground)

    def read(self, x):
        """Stiffness of all meshes; and of those with backlash force, slope, engagement and share of the stiffness."""
        law, deflection = self.law, self.system.deflections(x)[self.links]
        slope, force = backlash.slope(law, deflection), backlash.force(law, deflection)
        meshes = self.put(self.system.stiffness, slope)[self.first :]
        return meshes, (force, slope, backlash.engagement(law, deflection), slope / law.stiffness)


def _refined(train, rpm, x):
    """What is read two steps of Newton's method from the equilibrium, as one program."""
    static = _Static.of(train, rpm)
    for _ in range(2):
        tangent = static.tangent(static.held(x)[1])
        x = x + namespace(tangent).linalg.pinv(tangent, rtol=SINGULAR) @ static.unbalanced(x)
    return static.read(x)


def _equilibrium(static):
    """Displacements ``(S,)`` in m at which the mean torques are in equilibrium, or None where none was found; host."""
    system, load, links = static.system, static.load, static.links

    def solved(slope, force):
        # Least squares: the tangent of a floating train is singular.
        return np.linalg.lstsq(static.tangent(slope), force, rcond=SINGULAR)[0]

    # begin on the flanks that all teeth in contact would press: in a gap without stiffness nothing pulls back to them
    size = np.abs(load).max(initial=0.0)
    x = solved(system.stiffness, load)
    pressed = (system.stiffness * system.deflections(x))[links]
    flank = np.where(np.abs(pressed) > IDLE * size, np.sign(pressed), 0.0) * backlash.offset(static.law)
    # On a flank f = c l - offset: the offset goes to the side of the load.
    x = solved(system.stiffness, load + system.incidence()[:, links] @ flank)
    energy = static.energy(x)
    for _ in range(STEPS):
        (force, slope), left = static.held(x), static.unbalanced(x)
        if np.abs(left).max(initial=0.0) <= SOLVED * max(size, np.abs(force).max(initial=0.0)):
            return x
        step = solved(slope, left)
        share = 1.0
        for _ in range(HALVINGS):
            new = static.energy(x + share * step)
            if new <= energy:
                break
            share /= 2
        x, energy = x + share * step, new
    return None
