"""The backlash law of a gear mesh: force, tangent stiffness and energy.

Law (18) of Fridman 2009 with its two misprinted slopes exchanged (slope ``epsilon c`` in the gap, ``c`` in contact),
for any relative width ``tau`` of the smooth transition. With ``c1 = epsilon c``, ``c2 = c``, ``D = c2 - c1``:

    u = clip(|l| - (1 - tau) h/2, 0, tau h),     v = max(|l| - (1 + tau) h/2, 0)
    f  = c1 l + sign(l) (D u^2 / (2 tau h) + D v)
    f' = c1 + D u / (tau h)
    U  = c1 l^2/2 + D u^3/(6 tau h) + D (v^2/2 + tau h v/2)

Arguments broadcast. Automatic differentiation of this form equals ``f'`` everywhere, the knots included, because
``u^2`` and ``v`` join with equal slopes.
"""

from dataclasses import dataclass

import jax
import numpy as np

from jaxhb._jax import namespace


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Law:
    """Parameters of the law, one entry per mesh: stiffness in contact N/m; epsilon, stiffness in the gap over that;
    transition, width of the smooth zone over the backlash; backlash m, total."""

    stiffness: jax.Array
    epsilon: jax.Array
    transition: jax.Array
    backlash: jax.Array

    @property
    def gap(self):
        """(1 - tau) h/2 in m: the teeth are apart below it."""
        return (1 - self.transition) * self.backlash / 2

    @property
    def width(self):
        """tau h in m, of the smooth zone between gap and knee."""
        return self.transition * self.backlash

    @property
    def knee(self):
        """(1 + tau) h/2 in m: the tooth has its full stiffness beyond it."""
        return (1 + self.transition) * self.backlash / 2

    @property
    def knee_force(self):
        """Elastic force in N at the knee."""
        return self.stiffness * (self.epsilon + self.transition) * self.backlash / 2

    @property
    def gap_spring_force(self):
        """epsilon c h/2 in N, what the spring in the gap carries at most."""
        return self.stiffness * self.epsilon * self.backlash / 2

    def expand(self):
        """The same parameters with a trailing axis, to meet samples of shape ``(meshes, samples)``."""
        return jax.tree.map(lambda a: a[..., None], self)


def law_of(meshes):
    """The :class:`Law` of the :class:`~jaxhb.train.tables.Meshes` of a train; of no meaning for linear ones."""
    return Law(meshes.stiffness, meshes.epsilon, meshes.transition, meshes.backlash)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MeshParameters:
    """Some meshes of a train: link indices, law, damping and damping law, each ``(n,)``: all in harmonics, as any may
    be active or held on a flank; in time those with backlash, the others being linear links."""

    link: jax.Array
    law: Law
    viscous: jax.Array
    contact_damping: jax.Array


def all_meshes(train):
    """Every mesh as an entry of :class:`MeshParameters`; linear ones have epsilon 1 and a gap of 1 m."""
    xp, topology, meshes = namespace(train), train.topology, train.meshes
    gap = np.array(topology.mesh_backlash, dtype=bool)
    numbers = meshes.epsilon, meshes.transition, meshes.backlash
    law = (xp.where(gap, own, linear) for own, linear in zip(numbers, (1.0, 0.5, 1.0), strict=True))
    return MeshParameters(
        link=np.arange(len(topology.link_names) - len(gap), len(topology.link_names), dtype=np.int32),
        law=Law(xp.asarray(meshes.stiffness), *law),
        viscous=xp.asarray(meshes.damping),
        contact_damping=np.array([law == "contact" for law in topology.mesh_damping_law], dtype=bool) & gap,
    )


def backlash_meshes(train):
    """The meshes that have backlash, in the order of the scene, as :class:`MeshParameters`."""
    index = train.topology.backlash_index
    return jax.tree.map(lambda a: a[index], all_meshes(train))


def separated(law, deflection):
    """Whether the teeth are apart."""
    return namespace(law, deflection).abs(deflection) < law.gap


def _pieces(law, deflection):
    """``tau h``, u and v."""
    xp = namespace(law, deflection)
    width = law.width
    reach = xp.abs(deflection) - law.gap
    inside = xp.clip(reach, 0.0, width)
    beyond = xp.maximum(reach - width, 0.0)  # begins where ``inside`` ends to the last bit: derivatives at the knot
    return width, inside, beyond


def force(law, deflection):
    """Elastic force f(l) in N.

    >>> round(float(force(Law(1.0, 0.04, 0.2, 0.5), 0.25)), 6)
    0.022
    """
    width, inside, beyond = _pieces(law, deflection)
    drop = law.stiffness * (1 - law.epsilon)
    contact = drop * (inside**2 / (2 * width) + beyond)
    return law.epsilon * law.stiffness * deflection + namespace(law, deflection).sign(deflection) * contact


def engagement(law, deflection):
    """Share of contact (f'(l) - c1) / (c2 - c1), 0 in the gap and 1 in contact."""
    width, inside, _ = _pieces(law, deflection)
    return inside / width


def slope(law, deflection):
    """Tangent stiffness f'(l) in N/m."""
    return law.stiffness * (law.epsilon + (1 - law.epsilon) * engagement(law, deflection))


def energy(law, deflection):
    """Elastic energy U(l), the integral of f from 0 to l, in J."""
    width, inside, beyond = _pieces(law, deflection)
    drop = law.stiffness * (1 - law.epsilon)
    contact = inside**3 / (6 * width) + beyond**2 / 2 + width * beyond / 2
    return law.epsilon * law.stiffness * deflection**2 / 2 + drop * contact


def mesh_force(law, viscous, contact_damping, deflection, rate):
    """Transmitted force of a mesh, elastic + damping, in N; ``viscous`` r in N s/m, which acts always or, with
    ``contact_damping``, in contact only: ``r l' (f' - c1)/(c2 - c1)``."""
    share = namespace(law, deflection).where(contact_damping, engagement(law, deflection), 1.0)
    return force(law, deflection) + viscous * rate * share


def nonlinear_force(law, viscous, contact_damping, deflection, rate):
    """:func:`mesh_force` less its linear part ``c l + r l'``, in N, without its cancellation."""
    xp = namespace(law, deflection, viscous)
    width, inside, beyond = _pieces(law, deflection)
    share = inside / width
    elastic = xp.sign(deflection) * (share * inside / 2 + beyond) - deflection
    drop = law.stiffness * (1 - law.epsilon)
    return drop * elastic + viscous * rate * xp.where(contact_damping, share - 1, 0.0)


def mesh_slopes(law, viscous, contact_damping, deflection, rate):
    """Partial derivatives of :func:`mesh_force` with respect to l (N/m) and l' (N s/m), written out by hand."""
    xp = namespace(law, deflection, viscous)
    width, inside, _ = _pieces(law, deflection)
    share = xp.where(contact_damping, inside / width, 1.0)
    # Damping that sets in with contact adds to the slope in l: r l' times the slope of the engagement.
    moving = contact_damping & (inside > 0) & (inside < width)
    extra = xp.where(moving, viscous * rate * (xp.sign(deflection) / width), 0.0)
    return slope(law, deflection) + extra, viscous * share


def at_samples(meshes):
    """Law, viscous N s/m and contact damping of meshes with a trailing axis, to meet samples ``(G, samples)``."""
    return meshes.law.expand(), meshes.viscous[:, None], meshes.contact_damping[:, None]


def offset(law):
    """Constant part of the force on the contact flank: f = c l - offset beyond the knee, in N."""
    return law.stiffness * (1 - law.epsilon) * law.backlash / 2
