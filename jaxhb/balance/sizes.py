"""Sizes that residuals and steps of the condensed equation are measured against."""

from jaxhb._jax import Array, namespace
from jaxhb.equations import fourier
from jaxhb.equations.condensation import CondensedEquation

# Backlash counts as a size of deflections up to this multiple of that under the largest
# linear force: a whole step that is 1e-4 of it, and leaves a tenth of itself, then
# leaves 1e-3 of the force.
LIGHT = 100.0


def relative_residual(reduced: CondensedEquation, value: Array) -> Array:
    """Maximum over the meshes of ||F|| / :func:`deflection_scale`, root mean square
    over the cycle, dimensionless; value : coefficients ``(G, N+1)`` m of F.
    """
    xp = namespace(reduced, value)
    size = xp.linalg.norm(fourier.pack(value), axis=-1)
    return xp.max(size / deflection_scale(reduced))


def deflection_scale(reduced: CondensedEquation) -> Array:
    """Deflections ``(G,)`` m that residuals and steps are measured against: ||l_lin|| +
    h, or less under light loads.

    F times the stiffness c is what a residual leaves of the balance of forces. Where
    all linear forces are small beside c h, teeth would be balanced to a share of c h
    and not of what they carry: there LIGHT times the largest ||c l_lin|| / c of all
    meshes stands in place of h.
    """
    xp = namespace(reduced)
    linear = xp.linalg.norm(fourier.pack(reduced.linear), axis=-1)
    stiffness = xp.abs(reduced.law.stiffness)
    gap = reduced.law.backlash
    carried = LIGHT * xp.max(stiffness * linear, initial=0.0)
    # Without a load there is no force to be measured against.
    light = (carried > 0) & (carried < stiffness * gap)
    return linear + xp.where(light, carried / xp.where(light, stiffness, 1.0), gap)
