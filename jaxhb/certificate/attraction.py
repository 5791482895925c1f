"""Whether the true motion near a certified one attracts: no multiplier crosses the unit circle between the two.

The share of contact of the true motion differs from that of the refined motion ybar by ``s(t) Delta(t)``, s = 1,
``|Delta| <= r zone / tau``. Let s grow from 0 to 1. A multiplier ``z = exp(2 pi i theta)`` on the unit circle would be
a motion ``exp(i theta t) x periodic`` with ``y + R_z s Delta y = 0``, R_z the response of the linearised train to
impulses, in this class of motions: impossible if ``|R_z Delta| < 1`` in the largest value. With the monodromy matrix
P, the deflections ``l(t)`` of unit states and the states ``e(s)`` after impulses

    R_z(t, s) = R_1(t, s) + l(t) ((z - P)^-1 - (1 - P)^-1) e(s),

the first of which is part of the certificate, ``|R_1 Delta| <= Z2 r``, and the second is summed over the eigenvectors
of P with the largest ``|1/(z - lambda) - 1/(1 - lambda)|`` on the unit circle.
"""

import numpy as np

from jaxhb._jax import on_host
from jaxhb.equations import exact_integrals
from jaxhb.equations.residual import backlash_meshes
from jaxhb.equations.state_space import partition, state_space
from jaxhb.floquet.variational import propagation
from jaxhb.results.bounds import NORM_MARGIN
from jaxhb.train import chain

CIRCLE = 4096
"""Points of the unit circle at which multipliers are looked for."""


def decide(lin, train, found):
    """Whether the true motion attracts, None where that is not decided; ``lin`` at the refined motion, ``found`` the
    certificate that holds."""
    system, meshes = on_host((chain.assemble(train), backlash_meshes(train)))
    # Loss factors have no equation in time, and large trains take too long.
    if np.any(system.loss) or len(system.mass) > 100:
        return None
    h, law = lin.law.backlash, meshes.law
    parts = partition(system, meshes, train.topology.disk_names, train.topology.link_names)
    space = state_space(system, meshes, lin.frequency, parts)
    deflection = lin.deflection * h[:, None]
    times = np.append(exact_integrals.switching_times(law, deflection), np.arange(1, 2048) / 2048)
    onward = propagation(space, meshes, deflection, lin.frequency, np.unique(times))
    multipliers, shapes = np.linalg.eig(onward.matrix)
    # Of each eigenvector the largest deflection of each mesh, and how much of it impulses of the share of contact leave
    # at the end of the cycle, where that of the true motion may differ: in the zone, by the trapezoidal rule.
    deflected = np.abs(onward.deflection @ shapes).max(0) / h[:, None]
    duration = np.diff(onward.share) * 2 * np.pi / lin.frequency
    zone = lin.near_transition(found.radius, onward.share) / law.transition[:, None] * h[:, None]
    rate = (np.abs(np.linalg.inv(shapes) @ onward.end_state) * zone.T[:, None]).sum(-1)
    excited = ((rate[1:] + rate[:-1]) / 2 * duration[:, None]).sum(0)
    # The rotation of the train has a multiplier of 1, bends no tooth, and says nothing.
    observed = deflected.max(0) > 1e-9 * deflected.max()
    own = multipliers[observed]
    z = np.exp(2j * np.pi * (np.arange(CIRCLE) + 0.5) / CIRCLE)[:, None]
    with np.errstate(all="ignore"):
        change = np.abs((1 - z) / (z - own) / (1 - own)).max(0)  # |1/(z - lambda) - 1/(1 - lambda)|
        closed = (deflected[:, observed] * change * excited[observed]).sum(-1).max()
    if not found.radius * (found.Z2 + NORM_MARGIN * closed) < 1:
        return None
    # No multiplier crosses the circle on the way to the true motion: as many lie inside as of the refined one.
    return bool((np.abs(own) < 1).all())
