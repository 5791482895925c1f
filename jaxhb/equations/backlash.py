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

import dataclasses
from dataclasses import dataclass, field

import jax
import numpy as np

from jaxhb._jax import added, namespace
from jaxhb.equations import fourier
from jaxhb.equations.kinematics import OF_GEARS, OF_PERIOD, displacement_radii

SMOOTH, LEFT = (
    0.04,
    1e-3,
)  # share of a play in which stiffness sets in, and of the stiffness that is left in it
SLIP_SPEED = 0.1  # rad/s, from which dry friction is whole
# In m, gap of a mesh without backlash whose stiffness varies: its law has no kink there
NARROW = 1e-9


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Law:
    """Parameters of the law, one entry per mesh: stiffness in contact N/m; epsilon,
    stiffness in the gap over that; transition, width of the smooth zone over the
    backlash; backlash m, total.

    linear : N/m, of the linear train in its place where that is not the stiffness in
    contact: the mean of one that varies in time, 0 of what acts beside a link; side :
    0, or +1 or -1 where there is but one flank, on that side; friction N against the
    rate of deflection, in proportion to it below slip m/s. None where no mesh has any.
    """

    stiffness: jax.Array
    epsilon: jax.Array
    transition: jax.Array
    backlash: jax.Array
    linear: jax.Array | None = None
    side: jax.Array | None = None
    friction: jax.Array | None = None
    slip: jax.Array | None = None

    @property
    def linear_stiffness(self):
        """c in N/m, of the linear mesh that the train is condensed with."""
        return self.stiffness if self.linear is None else self.linear

    def only(self, active):
        """The law without forces where ``active`` ``(G,)`` is 0."""
        forces = {
            name: getattr(self, name) for name in ("stiffness", "linear", "friction")
        }
        return dataclasses.replace(
            self,
            **{n: force * active for n, force in forces.items() if force is not None},
        )

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
        """The same parameters with a trailing axis, to meet samples of shape ``(meshes,
        samples)``.
        """
        return jax.tree.map(lambda a: a[..., None], self)


def law_of(meshes):
    """The :class:`Law` of the :class:`~jaxhb.train.tables.Meshes` of a train; of no
    meaning for linear ones.
    """
    return Law(meshes.stiffness, meshes.epsilon, meshes.transition, meshes.backlash)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MeshParameters:
    """Some meshes of a train, and behind them what acts beside the stiffness of shafts
    and dampers: link indices, law, damping and damping law, each ``(n,)``: all in
    harmonics, as any may be active or held on a flank; in time those that have a law,
    the others being linear links.

    variation : complex ``(n, K+1)``, coefficients over the cycle of the stiffness over
    its mean, less 1; error : the same of the transmission error in m; None where no
    mesh has any; springs : how many of them are no meshes.
    """

    link: jax.Array
    law: Law
    viscous: jax.Array
    contact_damping: jax.Array
    variation: jax.Array | None = None
    error: jax.Array | None = None
    springs: int = field(default=0, metadata={"static": True})


def all_meshes(train):
    """Every mesh as an entry of :class:`MeshParameters`, and ``springs`` of the
    topology; meshes without backlash have epsilon 1, constant ones a gap of 1 m, others
    one that is no measure of their motion.
    """
    xp = namespace(train)
    topology = train.topology
    meshes = train.meshes
    gap = np.array(topology.mesh_backlash, dtype=bool)
    numbers = (meshes.epsilon, meshes.transition, meshes.backlash)
    wide = np.where(topology.mesh_varies, NARROW, 1.0)
    law = (
        xp.where(gap, own, linear)
        for own, linear in zip(numbers, (1.0, 0.5, wide), strict=True)
    )
    meshes = MeshParameters(
        variation=_over_cycle(train, ["stiffness_orders"]),
        error=_over_cycle(train, [OF_PERIOD[1], *OF_GEARS]),
        link=np.arange(
            len(topology.link_names) - len(gap),
            len(topology.link_names),
            dtype=np.int32,
        ),
        law=Law(xp.asarray(meshes.stiffness), *law),
        viscous=xp.asarray(meshes.damping),
        contact_damping=np.array(
            [law == "contact" for law in topology.mesh_damping_law], dtype=bool
        )
        & gap,
    )
    return _with_springs(train, meshes) if topology.springs else meshes


def _with_springs(train, meshes):
    """The MeshParameters with what acts beside the stiffness of shafts and dampers
    behind the meshes.
    """
    xp, topology, rows = namespace(train), train.topology, []
    radius = displacement_radii(train)
    shafts = len(topology.shaft_names)
    for link, kind, row in topology.springs:
        table, index = (
            (train.shafts, link) if link < shafts else (train.dampers, link - shafts)
        )
        arm = radius[topology.link_ends[link][0]]
        stiffness = table.stiffness[index]
        law = {
            "stiffness": 0.0,
            "epsilon": 0.0,
            "transition": SMOOTH,
            "linear": 0.0,
            "side": 0.0,
            "friction": 0.0,
        }
        if kind == "friction":
            slip = 0.0 if table.slip_speed is None else table.slip_speed[index]
            law |= {
                "epsilon": 1.0,
                "backlash": NARROW,
                "friction": table.friction[index] / arm,
            }
            law |= {"slip": xp.where(slip > 0, slip, SLIP_SPEED) * arm}
        elif kind == "clearance":
            law |= {
                "epsilon": LEFT,
                "backlash": xp.deg2rad(table.clearance[index]) * arm,
            }
            law |= dict.fromkeys(("stiffness", "linear"), stiffness / arm**2)
        else:
            twist, beyond = getattr(table, kind)[index, row]
            before = 0.0
            if kind == "stages":
                before = table.stages[index, row - 1, 1] if row else stiffness
            law |= {
                "stiffness": (beyond - before) / arm**2,
                "backlash": 2 * xp.deg2rad(xp.abs(twist)) * arm,
            }
            law |= {"side": xp.sign(twist)} if kind == "stops" else {}
        rows.append({"slip": arm} | law)
    kinds = {kind for _, kind, _ in topology.springs}
    count = len(meshes.link)
    own = meshes.law
    none = xp.zeros(count)
    given = {
        "linear": own.stiffness,
        "side": none,
        "friction": none,
        "slip": none + 1.0,
    }
    given |= {
        name: getattr(own, name)
        for name in ("stiffness", "epsilon", "transition", "backlash")
    }
    needed = {"side": "stops", "friction": "friction", "slip": "friction"}
    names = [name for name in given if needed.get(name, "") in (*kinds, "")]
    law = {
        n: xp.concatenate(
            [given[n], xp.stack([xp.asarray(row[n], float) for row in rows])]
        )
        for n in names
    }

    def wider(values):
        more = np.zeros((len(rows), *values.shape[1:]), values.dtype)
        return xp.concatenate([values, more])

    links = np.array([link for link, *_ in topology.springs], dtype=np.int32)
    return MeshParameters(
        np.concatenate([meshes.link, links]),
        Law(**law),
        *(
            jax.tree.map(wider, a)
            for a in (
                meshes.viscous,
                meshes.contact_damping,
                meshes.variation,
                meshes.error,
            )
        ),
        springs=len(rows),
    )


def _over_cycle(train, names):
    """Complex coefficients ``(M, K+1)`` over the cycle of the sum of some rows of the
    meshes, None without rows.
    """
    topology = train.topology
    meshes = train.meshes
    listed = {name: getattr(topology, f"mesh_{name}") for name in names}
    rows = [
        (name, i, k, n)
        for name in names
        for i, row in enumerate(listed[name])
        for k, n in enumerate(row)
    ]
    if not rows:
        return None
    xp = namespace(train)
    coefficients = xp.zeros(
        (len(topology.mesh_names), 1 + max(n for *_, n in rows)), dtype=complex
    )
    for name in names:
        own = [row[1:] for row in rows if row[0] == name]
        if not own:
            continue
        i, k, n = np.array(own).T
        value = xp.asarray(getattr(meshes, name))[i, k]
        value = 0.5 * (value[:, 0] + 1j * value[:, 1])
        if name in OF_PERIOD:
            value = value * xp.exp(
                1j
                * n
                / np.array(topology.mesh_periods)[i]
                * xp.deg2rad(meshes.phase)[i]
            )
        coefficients = added(coefficients, (i, n), value)
    return coefficients


def law_meshes(train):
    """The meshes that are no constant springs, in the order of the scene, as
    :class:`MeshParameters`.
    """
    index = train.topology.law_index
    return jax.tree.map(lambda a: a[index], all_meshes(train))


def separated(law, deflection):
    """Whether the teeth are apart."""
    return namespace(law, deflection).abs(deflection) < law.gap


def pieces(law, deflection):
    """``tau h``, u and v."""
    xp = namespace(law, deflection)
    width = law.width
    size = xp.abs(deflection)
    if law.side is not None:
        size = xp.where(law.side == 0, size, law.side * deflection)
    reach = size - law.gap
    inside = xp.clip(reach, 0.0, width)
    beyond = xp.maximum(
        reach - width, 0.0
    )  # begins where ``inside`` ends to the last bit: derivatives at the knot
    return width, inside, beyond


def force(law, deflection):
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


def engagement(law, deflection):
    """Share of contact (f'(l) - c1) / (c2 - c1), 0 in the gap and 1 in contact."""
    width, inside, _ = pieces(law, deflection)
    return inside / width


def slope(law, deflection):
    """Tangent stiffness f'(l) in N/m."""
    return law.stiffness * (
        law.epsilon + (1 - law.epsilon) * engagement(law, deflection)
    )


def energy(law, deflection):
    """Elastic energy U(l), the integral of f from 0 to l, in J."""
    width, inside, beyond = pieces(law, deflection)
    drop = law.stiffness * (1 - law.epsilon)
    contact = contact_integral(width, inside, beyond)
    return law.epsilon * law.stiffness * deflection**2 / 2 + drop * contact


def contact_integral(width, inside, beyond):
    """Integral over the modulus of l of ``u^2 / (2 tau h) + v``, from
    :func:`pieces`.
    """
    return inside**3 / (6 * width) + beyond**2 / 2 + width * beyond / 2


def mesh_force(law, viscous, contact_damping, deflection, rate):
    """Transmitted force of a mesh, elastic + damping, in N; ``viscous`` r in N s/m,
    which acts always or, with ``contact_damping``, in contact only: ``r l' (f' -
    c1)/(c2 - c1)``.
    """
    share = namespace(law, deflection).where(
        contact_damping, engagement(law, deflection), 1.0
    )
    return force(law, deflection) + viscous * rate * share + dry_friction(law, rate)


def dry_friction(law, rate):
    """Force in N against a rate of deflection."""
    if law.friction is None:
        return 0.0
    return law.friction * namespace(law, rate).clip(rate / law.slip, -1.0, 1.0)


def nonlinear_force(law, viscous, contact_damping, deflection, rate):
    """:func:`mesh_force` less its linear part ``c l + r l'``, in N, without its
    cancellation.
    """
    xp = namespace(law, deflection, viscous)
    width, inside, beyond = pieces(law, deflection)
    share = inside / width
    elastic = xp.sign(deflection) * (share * inside / 2 + beyond) - deflection
    drop = law.stiffness * (1 - law.epsilon)
    found = drop * elastic + viscous * rate * xp.where(contact_damping, share - 1, 0.0)
    if law.linear is not None:
        found = found + (law.stiffness - law.linear) * deflection
    return found + dry_friction(law, rate)


def mesh_slopes(law, viscous, contact_damping, deflection, rate):
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
    dry = (
        0.0
        if law.friction is None
        else xp.where(xp.abs(rate) < law.slip, law.friction / law.slip, 0.0)
    )
    return slope(law, deflection) + extra, viscous * share + dry


def nonlinear_slopes(law, viscous, contact_damping, deflection, rate):
    """Partial derivatives of :func:`nonlinear_force` with respect to l (N/m) and l' (N
    s/m).
    """
    by_deflection, by_rate = mesh_slopes(
        law, viscous, contact_damping, deflection, rate
    )
    return by_deflection - law.linear_stiffness, by_rate - viscous


def at_samples(meshes, synthesize):
    """Law, viscous N s/m and contact damping of meshes with a trailing axis, to meet
    samples ``(G, samples)``.

    ``synthesize`` : values at these samples from coefficients ``(G, K+1)``, asked where
    a stiffness varies.
    """
    law = meshes.law.expand()
    if meshes.variation is not None:
        law = at_instant(law, synthesize(meshes.variation))
    return law, meshes.viscous[:, None], meshes.contact_damping[:, None]


def at_instant(law, variation):
    """The law of meshes whose stiffness is 1 + ``variation`` times its mean at
    present.
    """
    return dataclasses.replace(
        law, stiffness=law.stiffness * (1 + variation), linear=law.linear_stiffness
    )


def error_load(system, meshes, frequency, load):
    """The ``load`` ``(S, N+1)`` N with what transmission errors e do to the train with
    all meshes in contact besides, ``D^T (c e + r e')``: its motion is then that under
    errors, and the deflections of meshes are ``D x - e``.
    """
    if meshes.error is None:
        return load
    xp = namespace(system, meshes, frequency, load)
    harmonics = max(load.shape[-1], meshes.error.shape[-1]) - 1
    load, error = (
        fourier.resize(xp.asarray(a), harmonics) for a in (load, meshes.error)
    )
    stiffness, viscous = (
        xp.asarray(a)[:, None] for a in (meshes.law.stiffness, meshes.viscous)
    )
    return load + system.spread(
        stiffness * error + viscous * fourier.derivative(error, frequency), meshes.link
    )


def less_error(meshes, deflection):
    """Deflections ``(n, N+1)`` of the teeth, from how far their gears approach each
    other, D x.
    """
    if meshes.error is None:
        return deflection
    return deflection - fourier.resize(meshes.error, deflection.shape[-1] - 1)


def offset(law):
    """Constant part of the force on the contact flank: f = c l - offset beyond the
    knee, in N; 0 of what acts beside a link, which begins without a force.
    """
    constant = law.stiffness * (1 - law.epsilon) * law.backlash / 2
    return (
        constant
        if law.linear is None
        else namespace(law).where(law.linear == 0, 0.0, constant)
    )
