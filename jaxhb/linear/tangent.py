"""The train linearised at its mean load: meshes with backlash with the slope f'(l) of law (18) there.

The equilibrium of the mean torques is the minimum of a convex energy, found by Newton's method with steps halved until
the energy falls, on the host. Derivatives are those of two more steps: the first has the first, the second the second.
"""

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jaxhb._jax import Number, concrete, namespace, on_host, traced
from jaxhb._shown import brief
from jaxhb.elements.elements import SceneError
from jaxhb.equations import backlash
from jaxhb.excitation.torques import excitation
from jaxhb.train import chain
from jaxhb.train.changes import linearised
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed

STEPS, HALVINGS = 200, 40  # of Newton's method at most, and of a step of it
SOLVED = 1e-10  # force left over the largest mean force at which the equilibrium is found
IDLE = 1e-9  # tooth force over the largest mean force below which a mesh begins in the middle of its gap
SINGULAR = 1e-14  # singular value of a tangent stiffness over the largest that is rounding of a rigid motion
UNBALANCED = 1e-9  # mean torque left over the largest from which the train does not run steadily


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
    """Linearise meshes with backlash at the mean load of one speed: ``D^T f(D x) = q``, law (18) of Fridman 2009.

    At ``rpm`` of the reference rotor, whose mean torques act. All numbers have first and second derivatives with
    respect to the train and the speed; slopes, epsilon c in the gap and c beyond the knee, are piecewise linear in the
    deflection, and so are theirs. :class:`SceneError` if mean torques do not balance, no equilibrium is found, or links
    vary; ValueError inside ``jit`` or ``vmap``, as the equilibrium is looked for on the host.

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
    name, (equations, torque, left) = train.topology.title, _equations(values, at)
    if equations.system.floating and abs(left) > UNBALANCED * np.abs(torque).max():
        raise SceneError(f"{name} at {at:g} rpm: mean torques do not balance, so there is no mean load. Add a load.")
    x = _equilibrium(equations)
    if x is None:
        raise SceneError(f"{name} at {at:g} rpm: no equilibrium of the mean torques was found. Leave out --at.")
    if traced(train, rpm):
        import jax  # which is there, as it traces

        found = jax.jit(_refined)(train, rpm, x)
    else:
        found = _read(equations, x)
    topology = train.topology
    own, first = np.flatnonzero(topology.mesh_backlash), len(topology.link_names) - len(topology.mesh_names)
    bare = linearised(train)
    bare = dataclasses.replace(bare, meshes=dataclasses.replace(bare.meshes, stiffness=found[1][first:]))
    names = tuple(train.topology.mesh_names[i] for i in own)
    return MeanLoad(bare, names, *(values[first + own] for values in found))


class _Equations(NamedTuple):
    """Static equations of the train under the mean torques ``load`` ``(S,)`` N, with the ``law`` of every link."""

    system: chain.System
    law: backlash.Law
    load: np.ndarray

    def unbalanced(self, x):
        """Force ``(S,)`` in N that the links and grounds leave of the load at displacements ``(S,)``."""
        force = backlash.force(self.law, self.system.deflections(x))
        return self.load - self.system.spread(force) - self.system.ground * x

    def tangent(self, slope):
        """Stiffness ``(S, S)`` in N/m of links with these slopes and grounds."""
        incidence = self.system.incidence()
        return (incidence * slope) @ incidence.T + namespace(self.system.ground).diag(self.system.ground)


def _equations(train, rpm):
    """The :class:`_Equations` at a speed; mean torques ``(S,)`` N m and what is left of their sum."""
    torque, _, left = excitation(train, rpm, 0)
    system, torque, left, train = on_host((chain.assemble(train), torque[:, 0].real, left, train))
    # A link without backlash has the law of one slope, epsilon 1.
    loose = np.array(train.topology.mesh_backlash, bool)
    shafts = np.ones(len(system.loss) - len(loose))
    xp, meshes = namespace(train), backlash.law_of(train.meshes)
    rest = (xp.append(shafts, xp.where(loose, a, 1.0)) for a in (meshes.epsilon, meshes.transition, meshes.backlash))
    law = backlash.Law(system.stiffness, *rest)
    return _Equations(system, law, torque / system.radius), torque, left


def _read(equations, x):
    """Of every link elastic force, slope, engagement and slope over the stiffness in contact."""
    law, deflection = equations.law, equations.system.deflections(x)
    engagement = backlash.engagement(law, deflection)
    share = law.epsilon + (1 - law.epsilon) * engagement
    return backlash.force(law, deflection), backlash.slope(law, deflection), engagement, share


def _refined(train, rpm, x):
    """What is read two steps of Newton's method from the equilibrium, as one program."""
    equations, *_ = _equations(train, rpm)
    for _ in range(2):
        tangent = equations.tangent(backlash.slope(equations.law, equations.system.deflections(x)))
        x = x + namespace(tangent).linalg.pinv(tangent, rtol=SINGULAR) @ equations.unbalanced(x)
    return _read(equations, x)


def _equilibrium(equations):
    """Displacements ``(S,)`` in m at which the mean torques are in equilibrium, or None where none was found; host."""
    system, law, load = equations

    def solved(slope, force):
        # Least squares: the tangent of a floating train is singular.
        return np.linalg.lstsq(equations.tangent(slope), force, rcond=SINGULAR)[0]

    def energy(x):
        return backlash.energy(law, system.deflections(x)).sum() + (system.ground * x**2).sum() / 2 - load @ x

    # begin on the flanks that all teeth in contact would press: in a gap without stiffness nothing pulls back to them
    size = np.abs(load).max(initial=0.0)
    x = solved(system.stiffness, load)
    pressed = system.stiffness * system.deflections(x)
    flank = np.where(np.abs(pressed) > IDLE * size, np.sign(pressed), 0.0) * backlash.offset(law)
    # On a flank f = c l - offset: the offset goes to the side of the load.
    x = solved(system.stiffness, load + system.spread(flank))
    least = energy(x)
    for _ in range(STEPS):
        deflection, left = system.deflections(x), equations.unbalanced(x)
        largest = np.abs(backlash.force(law, deflection)).max(initial=0.0)
        if np.abs(left).max(initial=0.0) <= SOLVED * max(size, largest):
            return x
        step, share = solved(backlash.slope(law, deflection), left), 1.0
        for _ in range(HALVINGS):
            reached = energy(x + share * step)
            if reached <= least:
                break
            share /= 2
        x, least = x + share * step, reached
    return None
