"""The train linearised at its mean load: meshes with backlash with the slope f'(l) of law (18) there; host.

The static equilibrium ``D^T f(D x) = q`` of the mean torques is the minimum of a convex energy, found by Newton's
method with steps halved until the energy falls. In the gap the slope is epsilon c, beyond the knee c.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from .._arrays import on_host
from ..harmonic import backlash, chain
from ..harmonic.excitation import excitation
from ..model.change import without_backlash
from ..model.elements import SceneError
from ..model.speeds import check_speed

STEPS, HALVINGS = 200, 40
LEFT = 1e-10
"""Force left over the largest mean force at which the equilibrium is found."""
IDLE = 1e-9
"""Tooth force over the largest mean force below which a mesh begins in the middle of its gap."""
UNBALANCED = 1e-9
"""Mean torque left over the largest from which the train does not run steadily."""


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


def at_mean_load(train, *, rpm):
    """Linearise the meshes with backlash at the mean load of one speed.

    Parameters
    ----------
    train : DriveTrain, concrete
    rpm : float
        Speed of the reference rotor, whose mean torques act.

    Returns
    -------
    MeanLoad
        Of m meshes with backlash the elastic force (N), the slope f'(l) of the law (N/m) and where on the law they are,
        each ``(m,)``; and the linear train with these slopes.

    Raises
    ------
    SceneError
        If mean torques do not balance, no equilibrium is found, or links vary.

    Notes
    -----
    ``D^T f(D x) = q`` with the law (18) of Fridman 2009; in the gap its slope is epsilon c, beyond the knee c.

    Examples
    --------
    >>> import jaxhb
    >>> at_mean_load(jaxhb.load_scene("spur_pair"), rpm=2000.0).engagement.tolist()
    [1.0]
    """
    check_speed(train, rpm)
    system, topology = on_host(chain.assemble(train)), train.topology
    name = topology.name or "scene"
    torque, _, left = (np.asarray(a) for a in excitation(train, rpm, 0))
    if system.floating and abs(left) > UNBALANCED * np.abs(torque).max():
        raise SceneError(f"{name} at {rpm:g} rpm: mean torques do not balance, so there is no mean load. Add a load.")
    law = backlash.Law(*(np.asarray(a) for a in dataclasses.astuple(backlash.law_of(train.meshes))))
    own = np.flatnonzero(topology.mesh_backlash)
    law = backlash.Law(*(a[own] for a in dataclasses.astuple(law)))
    links = len(topology.link_names) - len(topology.mesh_names) + own
    deflection = _equilibrium(system, torque[:, 0].real / system.radius, law, links)
    if deflection is None:
        raise SceneError(f"{name} at {rpm:g} rpm: no equilibrium of the mean torques was found. Leave out --at.")
    slope = backlash.slope(law, deflection)
    stiffness = np.array(train.meshes.stiffness, float)
    stiffness[own] = slope
    bare = without_backlash(train)
    bare = dataclasses.replace(bare, meshes=dataclasses.replace(bare.meshes, stiffness=stiffness))
    names = tuple(topology.mesh_names[i] for i in own)
    force, engaged = backlash.force(law, deflection), backlash.engagement(law, deflection)
    return MeanLoad(bare, names, force, slope, engaged, slope / law.stiffness)


def _equilibrium(system, load, law, links):
    """Deflections ``(m,)`` in m of the ``links`` of ``law`` under forces ``(S,)``, or None where none was found."""
    incidence = system.incidence()

    def held(x):
        """Force of every link, its slope, and the energy of all."""
        l = system.deflections(x)
        force, slope = system.stiffness * l, system.stiffness.copy()
        energy = force * l / 2
        force[links], slope[links] = backlash.force(law, l[links]), backlash.slope(law, l[links])
        energy[links] = backlash.energy(law, l[links])
        return force, slope, energy.sum() + (system.ground * x**2).sum() / 2 - load @ x

    def solved(slope, force):
        return np.linalg.lstsq((incidence * slope) @ incidence.T + np.diag(system.ground), force, rcond=1e-14)[0]

    # begin on the flanks that all teeth in contact would press: in a gap without stiffness nothing pulls back to them
    size = np.abs(load).max(initial=0.0)
    x = solved(system.stiffness, load)
    pressed = (system.stiffness * system.deflections(x))[links]
    flank = np.where(np.abs(pressed) > IDLE * size, np.sign(pressed), 0.0) * backlash.offset(law)
    x = solved(system.stiffness, load + incidence[:, links] @ flank)
    force, slope, energy = held(x)
    for _ in range(STEPS):
        left = load - incidence @ force - system.ground * x
        if np.abs(left).max(initial=0.0) <= LEFT * max(size, np.abs(force).max(initial=0.0)):
            return system.deflections(x)[links]
        step = solved(slope, left)
        share = 1.0
        for _ in range(HALVINGS):
            force, slope, new = held(x + share * step)
            if new <= energy:
                break
            share /= 2
        x, energy = x + share * step, new
    return None
