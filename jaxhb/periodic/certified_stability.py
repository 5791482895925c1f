"""Whether the true motion near a certified one attracts: no multiplier crosses the unit circle between the two.

The share of contact of the true motion differs from that of the refined motion ybar by ``s(t) Delta(t)``, s = 1,
``|Delta| <= r zone / tau``. Let s grow from 0 to 1. A multiplier ``z = exp(2 pi i theta)`` on the unit circle would be
a motion ``exp(i theta t) x periodic`` with ``y + R_z s Delta y = 0``, R_z the answer of the linearised train to
impulses, in this class of motions: impossible if ``|R_z Delta| < 1`` in the largest value. With the monodromy matrix
P, the deflections ``seen(t)`` of unit states and the states ``left(s)`` after impulses

    R_z(t, s) = R_1(t, s) + seen(t) ((z - P)^-1 - (1 - P)^-1) left(s),

the first of which is part of the certificate, ``|R_1 Delta| <= Z2 r``, and the second is summed over the eigenvectors
of P with the largest ``|1/(z - lambda) - 1/(1 - lambda)|`` on the unit circle.
"""

import numpy as np

from .._arrays import on_host
from ..harmonic import chain, exact
from ..harmonic.residual import backlash_meshes
from ..transient.statespace import partition, state_space
from ..transient.variational import passage
from .linearisation import MARGIN

UNSEEN = 1e-9
"""Deflections per unit state, over the largest, of a motion that bends no tooth: the rotation of a train."""

GRID, CIRCLE = 2048, 4096
"""Times of the cycle besides those at which teeth pass knots; points of the unit circle."""

LARGEST = 200
"""States of a train beyond which stability is not decided."""


def decide(lin, train, found):
    """Whether the true motion attracts: True, False, or None where that is not decided.

    Parameters
    ----------
    lin : Linearisation, at the refined motion
    train : DriveTrain
    found : Certificate, that holds
    """
    system, meshes = on_host((chain.assemble(train), backlash_meshes(train)))
    if np.any(system.loss) or 2 * len(system.mass) > LARGEST:
        return None  # loss factors have no equation in time
    h, law = lin.law.backlash, meshes.law
    parts = partition(system, meshes, train.topology.disk_names, train.topology.link_names)
    space = state_space(system, meshes, lin.frequency, parts)
    deflection = lin.deflection * h[:, None]
    times = np.concatenate([exact.switching_times(law, deflection), np.arange(1, GRID) / GRID])
    way = passage(space, meshes, deflection, lin.frequency, np.unique(times))
    multipliers, shapes = np.linalg.eig(way.matrix)
    seen = np.abs(way.seen @ shapes).max(0) / h[:, None]  # of each mesh, per unit state
    duration = np.diff(way.share) * 2 * np.pi / lin.frequency
    left = np.abs(np.linalg.inv(shapes) @ way.left)
    zone = lin.near_transition(found.radius, way.share) / law.transition[:, None] * h[:, None]
    each = (left * zone.T[:, None]).sum(-1)
    left = ((each[1:] + each[:-1]) / 2 * duration[:, None]).sum(0)
    observed = seen.max(0) > UNSEEN * seen.max()
    own = multipliers[observed]
    z = np.exp(2j * np.pi * (np.arange(CIRCLE) + 0.5) / CIRCLE)[:, None]
    with np.errstate(all="ignore"):
        change = np.abs((1 - z) / (z - own) / (1 - own)).max(0)
        closed = (seen[:, observed] * change * left[observed]).sum(-1).max()
    if not found.radius * (found.Z2 + MARGIN * closed) < 1:
        return None
    return bool((np.abs(own) < 1).all())
