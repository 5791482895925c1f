"""Numbers that follow from others: stiffness of links from dimensions, damping from a
magnifier or a damping ratio, inertia of disks from their flywheel effect.

Solves read inertia, stiffness and damping alone. The numbers of links that these follow
from are stored beside them, and :meth:`DriveTrain.replace` changes both together.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from jaxhb._jax import Number
from jaxhb.elements.elements import Damper, Disk, Mesh, Shaft

LINKS = ("shaft", "damper", "mesh")  # tables of links in the order of their numbers
DIMENSIONS = ("length", "outer", "inner", "shear_modulus")
DAMPING = ("magnifier", "damping_ratio", "damping_hz")
OPTIONAL = (
    "length",
    "outer",
    "shear_modulus",
    *DAMPING,
    "diameter",
    "stress_concentration",
    "tensile_strength",
    "yield_strength",
    "power_limit",
    "rated_torque",
    "clearance",
    "friction",
    "slip_speed",
)
"""Keys that a link has or has not, so that None differs from 0; ``inner`` and ``bore``
are 0 where absent.
"""

# Keys that only have a meaning beside another one
WITH = {"inner": "outer", "bore": "diameter"}


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


def inertia_of(gd2: Number) -> Number:
    """Moment of inertia in kg m2 of a flywheel effect GD2 in kg m2, mass times the
    square of twice the radius of gyration: a quarter of it.
    """
    return gd2 / 4


def completed(link: Disk | Shaft | Damper | Mesh) -> Disk | Shaft | Damper | Mesh:
    """A sound disk or link with the inertia, the stiffness and the damping that follow
    from its other keys.
    """
    values: dict[str, Any] = {}
    if isinstance(link, Disk):
        if link.gd2 is not None:
            values["inertia"] = inertia_of(link.gd2)
        return dataclasses.replace(link, **values)
    stiffness: Number | None = link.stiffness
    if isinstance(link, Shaft) and link.outer is not None:
        # A sound shaft with an outer diameter has the other dimensions as well.
        assert link.length is not None
        assert link.shear_modulus is not None
        stiffness = shaft_stiffness(
            link.length, link.outer, link.inner, link.shear_modulus
        )
        values["stiffness"] = stiffness
    if link.damping_hz is not None:
        assert stiffness is not None  # every sound link has one by now
        values["damping"] = viscous_damping(
            stiffness,
            link.damping_hz,
            magnifier=link.magnifier,
            damping_ratio=link.damping_ratio,
        )
    return dataclasses.replace(link, **values) if values else link


def link_keys(links: Sequence[Shaft | Damper | Mesh]) -> tuple[tuple[str, ...], ...]:
    """Keys out of :data:`OPTIONAL` that each link has; empty where no link has any."""
    keys = tuple(
        tuple(key for key in OPTIONAL if getattr(link, key, None) is not None)
        for link in links
    )
    return keys if any(keys) else ()


def link_number(topology: Any, table: str, index: int) -> int:
    """Number of element ``index`` of a table among all links."""
    first = {"shaft": 0, "damper": len(topology.shaft_names)}
    return index + first.get(table, len(topology.link_names) - len(topology.mesh_names))


def followers(
    before: Any, after: Any, changes: Mapping[tuple[str, str], Mapping[int, Any]]
) -> Iterator[tuple[str, str, dict[int, Number]]]:
    """Numbers that follow from changed numbers of links: (table, "stiffness" or
    "damping", {index: value}).

    ``changes``: ``{(table, field): {index: value}}`` that lead from the train
    ``before`` to ``after``. Both scale with the numbers that they follow from, so that
    links made constant or viscous meanwhile stay so.
    """
    topology = before.topology
    for table in LINKS if topology.link_keys else ():
        attribute = "meshes" if table == "mesh" else f"{table}s"
        old_links = getattr(before, attribute)
        new_links = getattr(after, attribute)
        resized = sorted(
            {i for name in DIMENSIONS for i in changes.get((table, name), ())}
        )
        stiffness = {
            i: new_links.stiffness[i]
            * _stiffness(new_links, i)
            / _stiffness(old_links, i)
            for i in resized
        }
        if stiffness:
            yield table, "stiffness", stiffness
        changed_links = {*resized, *changes.get((table, "stiffness"), ())}
        changed_links |= {i for name in DAMPING for i in changes.get((table, name), ())}
        damped_links = sorted(
            i
            for i in changed_links
            if topology.has_key(link_number(topology, table, i), "damping_hz")
        )
        stiffness_ratio = {
            i: stiffness.get(i, new_links.stiffness[i]) / old_links.stiffness[i]
            for i in damped_links
        }
        keys = {
            i: topology.link_keys[link_number(topology, table, i)] for i in damped_links
        }
        damping = {
            i: (
                new_links.damping[i]
                * stiffness_ratio[i]
                * _share(new_links, i, keys[i])
                / _share(old_links, i, keys[i])
            )
            for i in damped_links
        }
        if damping:
            yield table, "damping", damping


def _stiffness(shafts: Any, i: int) -> Number:
    """Stiffness in N m/rad of shaft ``i`` from its dimensions."""
    inner = 0.0 if shafts.inner is None else shafts.inner[i]
    return shaft_stiffness(
        shafts.length[i], shafts.outer[i], inner, shafts.shear_modulus[i]
    )


def _share(links: Any, i: int, keys: Sequence[str]) -> Number:
    """Damping over stiffness of link ``i``, from the keys that it has."""
    hz = links.damping_hz[i]
    if "magnifier" in keys:
        return viscous_damping(1.0, hz, magnifier=links.magnifier[i])
    return viscous_damping(1.0, hz, damping_ratio=links.damping_ratio[i])
