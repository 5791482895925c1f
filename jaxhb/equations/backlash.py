"""The backlash law of a gear mesh: force, tangent stiffness and energy.

Law (18) of Fridman 2009 with its two misprinted slopes exchanged (slope ``epsilon c``
in the gap, ``c`` in contact), for any relative width ``tau`` of the smooth transition.
With ``c1 = epsilon c``, ``c2 = c``, ``D = c2 - c1``:

    u = clip(|l| - (1 - tau) h/2, 0, tau h),     v = max(|l| - (1 + tau) h/2, 0)
    f  = c1 l + sign(l) (D u^2 / (2 tau h) + D v)
    f' = c1 + D u / (tau h)
    U  = c1 l^2/2 + D u^3/(6 tau h) + D (v^2/2 + tau h v/2)

Arguments broadcast. Automatic differentiation of this form equals ``f'`` everywhere,
the knots included, because ``u^2`` and ``v`` join with equal slopes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import jax

from jaxhb._jax import Array, Number, namespace
from jaxhb.equations import fourier
from jaxhb.equations.system import System


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Law:
    """Parameters of the law, one entry per mesh: stiffness in contact N/m; epsilon,
    stiffness in the gap over that; transition, width of the smooth zone over the
    backlash; backlash m, total.

    linear : N/m, of the linear train in its place where that is not the stiffness in
    contact: the mean of a stiffness that varies in time, 0 of springs that act beside a
    link; side : 0, or +1 or -1 where there is but one flank, on that side; friction N
    against the rate of deflection, in proportion to it below slip m/s. None where no
    mesh has any.
    """

    stiffness: Array
    epsilon: Array
    transition: Array
    backlash: Array
    linear: Array | None = None
    side: Array | None = None
    friction: Array | None = None
    slip: Array | None = None

    @property
    def linear_stiffness(self) -> Array:
        """c in N/m, of the linear mesh that the train is condensed with."""
        return self.stiffness if self.linear is None else self.linear

    def only(self, active: Array) -> Law:
        """The law without forces where ``active`` ``(G,)`` is 0."""
        return dataclasses.replace(
            self,
            stiffness=self.stiffness * active,
            linear=None if self.linear is None else self.linear * active,
            friction=None if self.friction is None else self.friction * active,
        )

    @property
    def gap(self) -> Array:
        """(1 - tau) h/2 in m: the teeth are apart below it."""
        return (1 - self.transition) * self.backlash / 2

    @property
    def width(self) -> Array:
        """tau h in m, of the smooth zone between gap and knee."""
        return self.transition * self.backlash

    @property
    def knee(self) -> Array:
        """(1 + tau) h/2 in m: the tooth has its full stiffness beyond it."""
        return (1 + self.transition) * self.backlash / 2

    @property
    def knee_force(self) -> Array:
        """Elastic force in N at the knee."""
        return self.stiffness * (self.epsilon + self.transition) * self.backlash / 2

    @property
    def gap_spring_force(self) -> Array:
        """Force epsilon c h/2 in N that the spring in the gap carries at most."""
        return self.stiffness * self.epsilon * self.backlash / 2

    def expand(self) -> Law:
        """The same parameters with a trailing axis, to meet samples of shape ``(meshes,
        samples)``.
        """
        return jax.tree.map(lambda parameter: parameter[..., None], self)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MeshParameters:
    """Some meshes of a train, and behind them the springs that act beside the stiffness
    of shafts and dampers: link indices, law, damping N s/m and damping law, each
    ``(n,)``. In harmonics these are all meshes, as any may be active or held on a
    flank; in time those that have a law, the others being linear links.

    variation : complex ``(n, K+1)``, coefficients over the cycle of the stiffness over
    its mean, less 1; error : the same of the transmission error in m; None where no
    mesh has any; springs : how many of the n entries are no meshes.
    """

    link: Array
    law: Law
    viscous: Array
    contact_damping: Array
    variation: Array | None = None
    error: Array | None = None
    springs: int = field(default=0, metadata={"static": True})


class Teeth(Protocol):
    """Law and damping of G meshes, and the variation of their stiffness: the part of
    MeshParameters, a CondensedEquation or a Stepper that forces at an instant need.
    """

    @property
    def law(self) -> Law: ...
    @property
    def viscous(self) -> Array: ...
    @property
    def contact_damping(self) -> Array: ...
    @property
    def variation(self) -> Array | None: ...


def separated(law: Law, deflection: Array) -> Array:
    """Whether the teeth are apart."""
    return namespace(law, deflection).abs(deflection) < law.gap


def pieces(law: Law, deflection: Array) -> tuple[Array, Array, Array]:
    """The widths ``tau h``, u and v of the law at a deflection, in m."""
    xp = namespace(law, deflection)
    width = law.width
    size = xp.abs(deflection)
    if law.side is not None:
        size = xp.where(law.side == 0, size, law.side * deflection)
    reach = size - law.gap
    inside = xp.clip(reach, 0.0, width)
    # Begins where ``inside`` ends to the last bit: derivatives at the knot
    beyond = xp.maximum(reach - width, 0.0)
    return width, inside, beyond


def force(law: Law, deflection: Array) -> Array:
    """Elastic force f(l) in N.

    >>> round(float(force(Law(1.0, 0.04, 0.2, 0.5), 0.25)), 6)
    0.022
    """
    width, inside, beyond = pieces(law, deflection)
    drop = law.stiffness * (1 - law.epsilon)
    contact = drop * (inside**2 / (2 * width) + beyond)
    return (
        law.epsilon * law.stiffness * deflection
        + namespace(law, deflection).sign(deflection) * contact
    )


def engagement(law: Law, deflection: Array) -> Array:
    """Share of contact (f'(l) - c1) / (c2 - c1), 0 in the gap and 1 in contact."""
    width, inside, _ = pieces(law, deflection)
    return inside / width


def slope(law: Law, deflection: Array) -> Array:
    """Tangent stiffness f'(l) in N/m."""
    return law.stiffness * (
        law.epsilon + (1 - law.epsilon) * engagement(law, deflection)
    )


def energy(law: Law, deflection: Array) -> Array:
    """Elastic energy U(l), the integral of f from 0 to l, in J."""
    width, inside, beyond = pieces(law, deflection)
    drop = law.stiffness * (1 - law.epsilon)
    contact = contact_integral(width, inside, beyond)
    return law.epsilon * law.stiffness * deflection**2 / 2 + drop * contact


def contact_integral(width: Array, inside: Array, beyond: Array) -> Array:
    """Integral over the modulus of l of ``u^2 / (2 tau h) + v``, from
    :func:`pieces`.
    """
    return inside**3 / (6 * width) + beyond**2 / 2 + width * beyond / 2


def mesh_force(
    law: Law, viscous: Array, contact_damping: Array, deflection: Array, rate: Array
) -> Array:
    """Force in N that a mesh transmits, elastic + damping. The damping ``viscous`` r in
    N s/m acts always or, with ``contact_damping``, in contact only: ``r l' (f' -
    c1)/(c2 - c1)``.
    """
    share = namespace(law, deflection).where(
        contact_damping, engagement(law, deflection), 1.0
    )
    return force(law, deflection) + viscous * rate * share + dry_friction(law, rate)


def dry_friction(law: Law, rate: Array) -> Number:
    """Force in N against a rate of deflection."""
    if law.friction is None or law.slip is None:
        return 0.0
    return law.friction * namespace(law, rate).clip(rate / law.slip, -1.0, 1.0)


def nonlinear_force(
    law: Law, viscous: Array, contact_damping: Array, deflection: Array, rate: Array
) -> Array:
    """:func:`mesh_force` less its linear part ``c l + r l'``, in N, without its
    cancellation.
    """
    xp = namespace(law, deflection, viscous)
    width, inside, beyond = pieces(law, deflection)
    share = inside / width
    elastic = xp.sign(deflection) * (share * inside / 2 + beyond) - deflection
    drop = law.stiffness * (1 - law.epsilon)
    phi = drop * elastic + viscous * rate * xp.where(contact_damping, share - 1, 0.0)
    if law.linear is not None:
        phi = phi + (law.stiffness - law.linear) * deflection
    return phi + dry_friction(law, rate)


def mesh_slopes(
    law: Law, viscous: Array, contact_damping: Array, deflection: Array, rate: Array
) -> tuple[Array, Array]:
    """Partial derivatives of :func:`mesh_force` with respect to l (N/m) and l' (N s/m),
    written out by hand.
    """
    xp = namespace(law, deflection, viscous)
    width, inside, _ = pieces(law, deflection)
    share = xp.where(contact_damping, inside / width, 1.0)
    # Damping that sets in with contact adds to the slope in l: r l' times the slope of
    # the engagement.
    moving = contact_damping & (inside > 0) & (inside < width)
    extra = xp.where(moving, viscous * rate * (xp.sign(deflection) / width), 0.0)
    dry = 0.0
    if law.friction is not None and law.slip is not None:
        dry = xp.where(xp.abs(rate) < law.slip, law.friction / law.slip, 0.0)
    return slope(law, deflection) + extra, viscous * share + dry


def nonlinear_slopes(
    law: Law, viscous: Array, contact_damping: Array, deflection: Array, rate: Array
) -> tuple[Array, Array]:
    """Partial derivatives of :func:`nonlinear_force` with respect to l (N/m) and l' (N
    s/m).
    """
    by_deflection, by_rate = mesh_slopes(
        law, viscous, contact_damping, deflection, rate
    )
    return by_deflection - law.linear_stiffness, by_rate - viscous


def at_samples(
    meshes: Teeth, synthesize: Callable[[Array], Array]
) -> tuple[Law, Array, Array]:
    """Law, viscous N s/m and contact damping of meshes with a trailing axis, to meet
    samples ``(G, samples)``.

    synthesize : gives values at these samples from coefficients ``(G, K+1)``, called
    only where a stiffness varies.
    """
    law = meshes.law.expand()
    if meshes.variation is not None:
        law = at_instant(law, synthesize(meshes.variation))
    return law, meshes.viscous[:, None], meshes.contact_damping[:, None]


def at_instant(law: Law, variation: Array) -> Law:
    """The law of meshes at an instant at which their stiffness is 1 + ``variation``
    times its mean.
    """
    return dataclasses.replace(
        law, stiffness=law.stiffness * (1 + variation), linear=law.linear_stiffness
    )


def error_load(
    system: System, meshes: MeshParameters, frequency: Number, load: Array
) -> Array:
    """Add to the ``load`` ``(S, N+1)`` N the effect of transmission errors e on the
    train with all meshes in contact, ``D^T (c e + r e')``: its motion is then that
    under errors, and the deflections of meshes are ``D x - e``.
    """
    if meshes.error is None:
        return load
    xp = namespace(system, meshes, frequency, load)
    harmonics = max(load.shape[-1], meshes.error.shape[-1]) - 1
    load = fourier.resize(xp.asarray(load), harmonics)
    error = fourier.resize(xp.asarray(meshes.error), harmonics)
    stiffness = xp.asarray(meshes.law.stiffness)[:, None]
    viscous = xp.asarray(meshes.viscous)[:, None]
    force = stiffness * error + viscous * fourier.derivative(error, frequency)
    return load + system.spread(force, meshes.link)


def less_error(meshes: MeshParameters, deflection: Array) -> Array:
    """Deflections ``(n, N+1)`` m of the teeth, from the approach D x of their gears."""
    if meshes.error is None:
        return deflection
    return deflection - fourier.resize(meshes.error, deflection.shape[-1] - 1)


def offset(law: Law) -> Array:
    """Constant part in N of the force on the contact flank, f = c l - offset beyond the
    knee; 0 of springs beside a link, which begin without a force.
    """
    constant = law.stiffness * (1 - law.epsilon) * law.backlash / 2
    if law.linear is None:
        return constant
    return namespace(law).where(law.linear == 0, 0.0, constant)
