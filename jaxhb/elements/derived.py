"""Numbers of links that follow from others: stiffness from dimensions, damping from a
magnifier or a damping ratio.

Solves read stiffness and damping alone. What they follow from is kept beside them, and
:meth:`DriveTrain.replace` changes both together.
"""

import dataclasses
import math

from jaxhb._jax import Number

LINKS = ("shaft", "damper", "mesh")  # tables of links in the order of their numbers
DIMENSIONS = ("length", "outer", "inner", "shear_modulus")
DAMPING = ("magnifier", "damping_ratio", "damping_hz")
OPTIONAL = (
    *(
        "length",
        "outer",
        "shear_modulus",
        *DAMPING,
        "diameter",
        "stress_concentration",
        "tensile_strength",
    ),
    "yield_strength",
    *("power_limit", "rated_torque", "clearance", "friction", "slip_speed"),
)
"""Keys that a link has or has not, so that None differs from 0; ``inner`` and ``bore``
are 0 where not given.
"""

WITH = {
    "inner": "outer",
    "bore": "diameter",
}  # keys that only have a meaning beside another one


def shaft_stiffness(
    length: Number, outer: Number, inner: Number = 0.0, shear_modulus: Number = 8e10
) -> Number:
    """Torsional stiffness of a round shaft in N m/rad, ``k = G pi (d_o^4 - d_i^4) / (32
    l)`` (Saint-Venant).

    Length l, outer and inner diameter d_o and d_i in m and shear modulus G in Pa
    broadcast. Differentiable; numpy on the host.

    >>> round(float(shaft_stiffness(0.5, 0.1, 0.05, 8e10)))
    1472622
    """
    return shear_modulus * math.pi * (outer**4 - inner**4) / (32.0 * length)


def viscous_damping(
    stiffness: Number,
    hz: Number,
    *,
    magnifier: Number | None = None,
    damping_ratio: Number | None = None,
) -> Number:
    """Viscous damping of a link from its dynamic magnifier or damping ratio at one
    frequency, ``r = k / (M omega)``.

    In N m s/rad of a stiffness in N m/rad, in N s/m of one in N/m; ``omega = 2 pi hz``.
    The ``magnifier`` M is the amplification at the resonance of one mass on the link;
    Lehr's ``damping_ratio`` is ``D = 1 / (2 M)``: :class:`ValueError` if not exactly
    one of them is given. Arguments broadcast. Differentiable; numpy on the host.

    >>> (
    ...     round(viscous_damping(1e6, 50.0, magnifier=25.0), 3),
    ...     round(viscous_damping(1e6, 50.0, damping_ratio=0.02), 3),
    ... )
    (127.324, 127.324)
    """
    if damping_ratio is not None and magnifier is None:
        share = 2.0 * damping_ratio
    elif magnifier is not None and damping_ratio is None:
        share = 1.0 / magnifier
    else:
        raise ValueError("give either magnifier or damping_ratio")
    return stiffness * share / (2.0 * math.pi * hz)


def completed(link):
    """A sound link with the stiffness and the damping that follow from its other
    keys.
    """
    values = {}
    if getattr(link, "outer", None) is not None:
        values["stiffness"] = shaft_stiffness(
            *(getattr(link, name) for name in DIMENSIONS)
        )
    if link.damping_hz is not None:
        given = {"magnifier": link.magnifier, "damping_ratio": link.damping_ratio}
        values["damping"] = viscous_damping(
            values.get("stiffness", link.stiffness), link.damping_hz, **given
        )
    return dataclasses.replace(link, **values) if values else link


def link_keys(links) -> tuple[tuple[str, ...], ...]:
    """Which of :data:`OPTIONAL` each link has; empty where none has any."""
    found = tuple(
        tuple(key for key in OPTIONAL if getattr(link, key, None) is not None)
        for link in links
    )
    return found if any(found) else ()


def link_number(topology, table: str, index: int) -> int:
    """Number among the links of element ``index`` of a table."""
    before = {"shaft": 0, "damper": len(topology.shaft_names)}
    return index + before.get(
        table, len(topology.link_names) - len(topology.mesh_names)
    )


def followers(before, after, changes):
    """What follows from changed numbers of links: (table, "stiffness" or "damping",
    {index: value}).

    ``changes``: ``{(table, field): {index: value}}`` that lead from the train
    ``before`` to ``after``. Both scale with what they follow from, so that links made
    constant or viscous meanwhile stay so.
    """
    topology = before.topology
    for table in LINKS if topology.link_keys else ():
        old, new = (
            getattr(train, "meshes" if table == "mesh" else f"{table}s")
            for train in (before, after)
        )
        sized = sorted(
            {i for name in DIMENSIONS for i in changes.get((table, name), ())}
        )
        stiffness = {
            i: new.stiffness[i] * _stiffness(new, i) / _stiffness(old, i) for i in sized
        }
        if stiffness:
            yield table, "stiffness", stiffness
        moved = {*sized, *changes.get((table, "stiffness"), ())}
        moved |= {i for name in DAMPING for i in changes.get((table, name), ())}
        damped = sorted(
            i
            for i in moved
            if topology.has_key(link_number(topology, table, i), "damping_hz")
        )
        ratio = {
            i: stiffness.get(i, new.stiffness[i]) / old.stiffness[i] for i in damped
        }
        keys = {i: topology.link_keys[link_number(topology, table, i)] for i in damped}
        damping = {
            i: (
                new.damping[i]
                * ratio[i]
                * _share(new, i, keys[i])
                / _share(old, i, keys[i])
            )
            for i in damped
        }
        if damping:
            yield table, "damping", damping


def _stiffness(shafts, i):
    inner = 0.0 if shafts.inner is None else shafts.inner[i]
    return shaft_stiffness(
        shafts.length[i], shafts.outer[i], inner, shafts.shear_modulus[i]
    )


def _share(links, i, keys):
    """Damping over stiffness."""
    way = "magnifier" if "magnifier" in keys else "damping_ratio"
    return viscous_damping(1.0, links.damping_hz[i], **{way: getattr(links, way)[i]})
