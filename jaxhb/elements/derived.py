"""Numbers that follow from others: stiffness of links from dimensions, damping from a
magnifier or a damping ratio, inertia of disks from their flywheel effect.

Solves read inertia, stiffness and damping alone. The numbers of links that these follow
from are stored beside them, and :meth:`DriveTrain.replace` changes both together.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from jaxhb._jax import Number, namespace
from jaxhb.elements.elements import Damper, Disk, Mesh, Shaft
from jaxhb.elements.values import is_present

LINKS = ("shaft", "damper", "mesh")  # tables of links in the order of their numbers
DIMENSIONS = ("length", "outer", "inner", "shear_modulus")
SHARES = ("magnifier", "damping_ratio", "relative_damping")
DAMPING = (*SHARES, "damping_hz")
HEAT = ("temperature", "over_temperature")
COOLING = ("surface", "heat_transfer", "ambient")
OVER_HZ = ("stiffness_over_hz", "damping_over_hz")
OPTIONAL = (
    "length",
    "outer",
    "shear_modulus",
    *DAMPING,
    *HEAT,
    *COOLING,
    *OVER_HZ,
    "stiffness_over_torque",
    "diameter",
    "stress_concentration",
    "tensile_strength",
    "yield_strength",
    "power_limit",
    "nominal_torque",
    "vibratory_torque",
    "maximum_torque",
    "speed_limit",
    "fillet_factor",
    "oil_bore_factor",
    "alternating_limit",
    "rated_torque",
    "clearance",
    "friction",
    "slip_speed",
)
"""Keys that a link has or has not, so that None differs from 0; ``inner`` and ``bore``
are 0 where absent.
"""

LIMITS_OF_DISKS = ("angle_limit", "speed_irregularity_limit", "acceleration_limit")
"""Keys that a disk has or has not, likewise."""

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
    relative_damping: Number | None = None,
) -> Number:
    """Viscous damping of a link from its dynamic magnifier, damping ratio or relative
    damping at one frequency, ``r = k / (M omega)``.

    In N m s/rad of a stiffness in N m/rad, in N s/m of one in N/m; ``omega = 2 pi hz``.
    The ``magnifier`` M is the amplification at the resonance of one mass on the link;
    Lehr's ``damping_ratio`` is ``D = 1 / (2 M)``, and the ``relative_damping``, the
    work lost in a cycle over the elastic energy at its amplitude, ``psi = 2 pi / M``:
    :class:`ValueError` if not exactly one of them is given. Arguments broadcast.
    Differentiable; numpy on the host.

    >>> (
    ...     round(viscous_damping(1e6, 50.0, magnifier=25.0), 3),
    ...     round(viscous_damping(1e6, 50.0, damping_ratio=0.02), 3),
    ... )
    (127.324, 127.324)
    """
    shares = []
    if magnifier is not None:
        shares.append(1.0 / magnifier)
    if damping_ratio is not None:
        shares.append(2.0 * damping_ratio)
    if relative_damping is not None:
        shares.append(relative_damping / (2.0 * math.pi))
    if len(shares) != 1:
        raise ValueError("give one of magnifier, damping_ratio and relative_damping")
    return stiffness * shares[0] / (2.0 * math.pi * hz)


def temperature_factors(rows: Any, temperature: Number) -> tuple[Number, Number]:
    """Factors of stiffness and of damping of a link at a ``temperature`` in deg C, from
    its ``over_temperature`` [K, 3]: linear between the rows, constant outside.

    >>> temperature_factors(np.array([(20.0, 1.0, 1.0), (60.0, 0.5, 0.9)]), 40.0)
    (0.75, 0.95)
    """
    xp = namespace(rows, temperature)
    table = xp.asarray(rows)
    stiffer, damped = (xp.interp(temperature, table[:, 0], table[:, k]) for k in (1, 2))
    return (float(stiffer), float(damped)) if xp is np else (stiffer, damped)


def inertia_of(gd2: Number) -> Number:
    """Moment of inertia in kg m2 of a flywheel effect GD2 in kg m2, mass times the
    square of twice the radius of gyration: a quarter of it.
    """
    return gd2 / 4


def completed(link: Disk | Shaft | Damper | Mesh) -> Disk | Shaft | Damper | Mesh:
    """A sound disk or link with the inertia, the stiffness, the damping and the loss
    factor that follow from its other keys, at its temperature.
    """
    values: dict[str, Any] = {}
    if isinstance(link, Disk):
        if link.gd2 is not None:
            values["inertia"] = inertia_of(link.gd2)
        return dataclasses.replace(link, **values)
    if not isinstance(link, Mesh):
        link = _with_stages(_with_factors_over_hz(link))
    stiffness: Number | None = link.stiffness
    stiffer: Number = 1.0
    damped: Number = 1.0
    if isinstance(link, Shaft) and link.outer is not None:
        # A sound shaft with an outer diameter has the other dimensions as well.
        assert link.length is not None
        assert link.shear_modulus is not None
        stiffness = shaft_stiffness(
            link.length, link.outer, link.inner, link.shear_modulus
        )
        values["stiffness"] = stiffness
    if not isinstance(link, Mesh) and link.over_temperature:
        assert link.temperature is not None
        assert stiffness is not None
        rows = np.array(link.over_temperature, dtype=np.float64)
        stiffer, damped = temperature_factors(rows, link.temperature)
        stiffness = stiffness * stiffer
        values["stiffness"] = stiffness
        values["stages"] = tuple((twist, k * stiffer) for twist, k in link.stages)
        values["damping"] = link.damping * damped
        values["loss_factor"] = link.loss_factor * damped
    if link.damping_hz is not None:
        assert stiffness is not None  # every sound link has one by now
        shares = {key: getattr(link, key, None) for key in SHARES}
        values["damping"] = damped * viscous_damping(
            stiffness,
            link.damping_hz,
            magnifier=shares["magnifier"],
            damping_ratio=shares["damping_ratio"],
            relative_damping=shares["relative_damping"],
        )
    elif not isinstance(link, Mesh) and link.relative_damping is not None:
        values["loss_factor"] = damped * link.relative_damping / (2.0 * math.pi)
    return dataclasses.replace(link, **values) if values else link


def _with_factors_over_hz(link: Shaft | Damper) -> Shaft | Damper:
    """A sound link with ``over_hz`` in the place of its stiffness and damping over the
    frequency; the numbers are the largest of these.
    """
    tables = {
        name.removesuffix("_over_hz"): np.array(getattr(link, name), dtype=np.float64)
        for name in OVER_HZ
        if getattr(link, name)
    }
    if not tables:
        return link
    # All are linear between the frequencies of both.
    hz = np.unique(np.concatenate([rows[:, 0] for rows in tables.values()]))
    largest = {name: float(np.max(rows[:, 1])) for name, rows in tables.items()}
    factors = {
        name: np.interp(hz, rows[:, 0], rows[:, 1] / largest[name])
        for name, rows in tables.items()
    }
    constant = np.ones(len(hz))
    columns = [hz, *(factors.get(name, constant) for name in ("stiffness", "damping"))]
    values: dict[str, Any] = dict(largest)
    values["over_hz"] = tuple(map(tuple, np.stack(columns, axis=1).tolist()))
    return dataclasses.replace(link, **values)


def _with_stages(link: Shaft | Damper) -> Shaft | Damper:
    """A sound link with stages in the place of its stiffness over the mean torque: the
    torque at which one ends lies half way between two rows.
    """
    if not link.stiffness_over_torque:
        return link
    rows = np.array(link.stiffness_over_torque, dtype=np.float64)
    (torques, stiffnesses) = rows.T
    ends = (torques[1:] + torques[:-1]) / 2.0
    twists = np.cumsum(np.diff(ends, prepend=0.0) / stiffnesses[:-1])
    stages = np.stack([np.degrees(twists), stiffnesses[1:]], axis=1)
    return dataclasses.replace(
        link,
        stiffness=float(stiffnesses[0]),
        stages=tuple(map(tuple, stages.tolist())),
    )


def present_keys(
    elements: Sequence[Any], optional: Sequence[str] = OPTIONAL
) -> tuple[tuple[str, ...], ...]:
    """Keys out of ``optional`` that each link, or each disk, has; empty where none has
    any.
    """
    keys = tuple(
        tuple(key for key in optional if is_present(getattr(element, key, None)))
        for element in elements
    )
    return keys if any(keys) else ()


def link_number(topology: Any, table: str, index: int) -> int:
    """Number of element ``index`` of a table among all links."""
    first = {"shaft": 0, "damper": len(topology.shaft_names)}
    return index + first.get(table, len(topology.link_names) - len(topology.mesh_names))


def followers(
    before: Any, after: Any, changes: Mapping[tuple[str, str], Mapping[int, Any]]
) -> Iterator[tuple[str, str, dict[int, Any]]]:
    """Numbers that follow from changed numbers of links: (table, field, {index:
    value}).

    ``changes``: ``{(table, field): {index: value}}`` that lead from the train
    ``before`` to ``after``. All scale with the numbers that they follow from, so that
    links made constant or viscous meanwhile stay so; a stiffness or damping that is
    changed as well is that at the temperature which then holds.
    """
    topology = before.topology
    for table in LINKS if topology.link_keys else ():
        attribute = "meshes" if table == "mesh" else f"{table}s"
        old_links = getattr(before, attribute)
        new_links = getattr(after, attribute)
        touched = {
            group: {i for field in fields for i in changes.get((table, field), ())}
            for group, fields in _GROUPS.items()
        }
        heat = {i: _heat_ratios(old_links, new_links, i) for i in touched["heat"]}
        stiffness = {}
        for i in sorted(touched["size"] | (touched["heat"] - touched["stiffness"])):
            stiffness[i] = new_links.stiffness[i] * heat.get(i, UNCHANGED)[0]
            if i in touched["size"]:
                shape_ratio = _stiffness(new_links, i) / _stiffness(old_links, i)
                stiffness[i] = stiffness[i] * shape_ratio
        damping = {}
        loss_factor = {}
        for i in sorted(set().union(*touched.values())):
            keys = topology.link_keys[link_number(topology, table, i)]
            damped = heat.get(i, UNCHANGED)[1]
            share: Number = 1.0
            if any(key in keys for key in SHARES):
                share = _share(new_links, i, keys) / _share(old_links, i, keys)
            if "damping_hz" in keys:
                stiffness_ratio = (
                    stiffness.get(i, new_links.stiffness[i]) / old_links.stiffness[i]
                )
                damping[i] = new_links.damping[i] * stiffness_ratio * damped * share
            elif i in heat and i not in touched["damping"]:
                damping[i] = new_links.damping[i] * damped
            by_share = "relative_damping" in keys and "damping_hz" not in keys
            if by_share or i in touched["heat"] - touched["loss factor"]:
                loss_factor[i] = new_links.loss_factor[i] * damped * share
        stages = {
            i: new_links.stages[i] * namespace(ratios[0]).asarray([1.0, ratios[0]])
            for i, ratios in heat.items()
            if new_links.stages is not None
        }
        found = {
            "stiffness": stiffness,
            "damping": damping,
            "loss_factor": loss_factor,
            "stages": stages,
        }
        yield from ((table, field, values) for field, values in found.items() if values)


UNCHANGED = (1.0, 1.0)
_GROUPS = {
    "size": DIMENSIONS,
    "heat": HEAT,
    "share": DAMPING,
    "stiffness": ("stiffness",),
    "damping": ("damping",),
    "loss factor": ("loss_factor",),
}
"""Numbers from which others follow, or which are given in their place."""


def _heat_ratios(old: Any, new: Any, i: int) -> tuple[Number, Number]:
    """Ratios of stiffness and of damping of link ``i`` after and before a change of its
    temperature or of its rows.
    """
    before = temperature_factors(old.over_temperature[i], old.temperature[i])
    after = temperature_factors(new.over_temperature[i], new.temperature[i])
    return after[0] / before[0], after[1] / before[1]


def _stiffness(shafts: Any, i: int) -> Number:
    """Stiffness in N m/rad of shaft ``i`` from its dimensions."""
    inner = 0.0 if shafts.inner is None else shafts.inner[i]
    return shaft_stiffness(
        shafts.length[i], shafts.outer[i], inner, shafts.shear_modulus[i]
    )


def _share(links: Any, i: int, keys: Sequence[str]) -> Number:
    """Damping over stiffness of link ``i``, at 1 Hz where it is a loss factor, from the
    keys that it has.
    """
    hz = links.damping_hz[i] if "damping_hz" in keys else 1.0
    if "magnifier" in keys:
        return viscous_damping(1.0, hz, magnifier=links.magnifier[i])
    if "damping_ratio" in keys:
        return viscous_damping(1.0, hz, damping_ratio=links.damping_ratio[i])
    return viscous_damping(1.0, hz, relative_damping=links.relative_damping[i])
