"""The numbers of a drive train as arrays, each field one vector over its elements, made
from elements.
"""

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb.elements import derived
from jaxhb.elements.elements import Combustion, Damper, Disk, Ground, Mesh, Shaft
from jaxhb.equations.kinematics import OF_GEARS, OF_PERIOD
from jaxhb.excitation import gas
from jaxhb.excitation.gas import GAS_SAMPLES, Combustions, Traces, gas_cycle, table

Array = Any

LAW = {"epsilon": 1e-3, "transition": 0.04}
"""Stiffness in the gap over that in contact, width of the smooth zone over the
backlash, where a scene gives none.
"""

LAW_OF_FRIDMAN = {"epsilon": 0.03, "transition": 0.2}
"""The same of the law (18) of Fridman 2009, ``law = "fridman2009"``."""


ROWS = "over_hz", "over_amplitude", "stages", "stops", *OF_PERIOD, *OF_GEARS  # of links


def vectors_of(element):
    """Give a class one vector for each number of an element, and for its rows over
    frequency, amplitude or orders.

    0 stands for a number that is absent. Those that not all links have, and most rows,
    are None where none has them.
    """

    def declare(cls):
        kept = [
            f
            for f in dataclasses.fields(element)
            if f.metadata["kind"] == "number" or f.name in ROWS
        ]
        absent = (
            *derived.OPTIONAL,
            *derived.WITH,
            *(name for name in ROWS if not name.startswith("over_")),
        )
        optional = {f.name: None for f in kept if f.name in absent}
        needed = [f.name for f in kept if f.name not in optional]
        cls.__annotations__ = dict.fromkeys([*needed, *optional], Array)
        for name, absent in optional.items():
            setattr(cls, name, absent)
        return table(cls)

    return declare


class Vectors:
    """Fields that :func:`vectors_of` declares."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Array: ...


@vectors_of(Disk)
class Disks(Vectors):
    """The numbers of a :class:`~jaxhb.Disk`, each [n_scene_disks]."""


@vectors_of(Shaft)
class Shafts(Vectors):
    """The numbers of a :class:`~jaxhb.Shaft`, each [n_shafts].

    ``over_hz`` and ``over_amplitude`` [n_shafts, K, 3]: Hz or rad, factor of stiffness,
    factor of damping; K is 0 where no shaft has such rows. ``stages`` and ``stops``
    [n_shafts, K, 2]: deg, N m/rad.
    """


@vectors_of(Mesh)
class Meshes(Vectors):
    """The numbers of a :class:`~jaxhb.Mesh`, each [n_mesh]; rows of orders (Re, Im)
    [n_mesh, K, 2].
    """


@vectors_of(Damper)
class Dampers(Vectors):
    """The numbers of a :class:`~jaxhb.Damper`, each [n_dampers]; rows as of
    :class:`Shafts`.
    """


@vectors_of(Ground)
class Grounds(Vectors):
    """The numbers of a :class:`~jaxhb.Ground`, each [n_grounds]."""


@table
class Loads:
    """Shares of the balancing torque, each on its own shaft, relative to each other,
    [n_loads].

    ``harmonics`` [n_loads, K, 2]: Re, Im of its pulsation over its mean; None where no
    load pulsates.
    """

    share: Array
    harmonics: Array | None = None


@table
class Phases:
    """Angles by which what each phase names comes later, deg of its rotor,
    [n_phases].
    """

    angle: Array


@table
class Torques:
    """Mean [nt] (N m), harmonics [nt, K, 2] (Re, Im of the peak amplitude, N m), scale
    over rpm [nt, L].

    ``rated_rpm`` [nt], 0 for torques without, and ``speed_exponent`` [nt]; None where
    no torque has a rated speed.
    """

    mean: Array
    harmonics: Array
    scale_rpm: Array
    scale_factor: Array
    rated_rpm: Array | None = None
    speed_exponent: Array | None = None


@table
class Cylinders:
    """Geometry (m), mass (kg), firing angle (deg), ambient pressure (Pa), each [nc];
    gas torque and scale.

    ``gas_torque_mean`` [nc] and ``gas_torque`` [nc, K, 2] (N m, for firing at 0);
    ``pressure`` [nc, M] (Pa) on the uniform grid of the gas cycle counted from firing
    top dead centre, zeros where none is given; ``scale_rpm`` and ``scale_factor`` [nc,
    L]. A rod that is not given is 1 m, a bore or stroke 0 m. None where no cylinder has
    them: ``traces``, ``combustion``, ``load_rpm`` and ``load_share`` [nc, L] of either,
    and ``gas_factor`` and ``injection`` [nc], 1 for a cylinder without.
    """

    bore: Array
    stroke: Array
    rod: Array
    reciprocating_mass: Array
    firing_angle: Array
    ambient_pressure: Array
    gas_torque_mean: Array
    gas_torque: Array
    pressure: Array
    scale_rpm: Array
    scale_factor: Array
    traces: Traces | None = None
    combustion: Combustions | None = None
    load_rpm: Array | None = None
    load_share: Array | None = None
    gas_factor: Array | None = None
    injection: Array | None = None


def column(elements, name: str, absent: float = 0.0) -> np.ndarray:
    """Collect one field over elements, ``absent`` for None."""
    values = [getattr(e, name) for e in elements]
    return np.array([absent if v is None else v for v in values], dtype=np.float64)


def _harmonics(rows) -> np.ndarray:
    """Stack the (Re, Im) of rows (order, Re, Im), padded by zeros."""
    out = np.zeros((len(rows), max((len(row or ()) for row in rows), default=0), 2))
    for i, row in enumerate(rows):
        if row:
            out[i, : len(row)] = np.asarray(row, dtype=np.float64)[:, 1:]
    return out


def _scales(elements) -> dict[str, np.ndarray]:
    """Stack the scales, padded by their last point; the factor is 1 without a scale."""
    out = _padded([e.scale for e in elements], (0.0, 1.0), 2)
    return {"scale_rpm": out[..., 0].copy(), "scale_factor": out[..., 1].copy()}


def _padded(rows, absent, least: int = 1) -> np.ndarray:
    """Stack lists of rows [n, K, columns], those without any of the row ``absent``, the
    shorter ones padded by their last row; K is ``least`` at least.
    """
    rows = [row or (absent,) for row in rows]
    longest = max([least, *map(len, rows)])
    padded = [[*row, *([row[-1]] * longest)][:longest] for row in rows]
    return np.array(padded, dtype=np.float64).reshape(len(rows), longest, len(absent))


def _collected(cls, elements, own=()):
    """A table: what is its ``own``, and fields of its elements; None for one that may
    be absent and that none has.
    """
    found = dict(own)
    for f in (f for f in dataclasses.fields(cls) if f.name not in found):
        given = [getattr(e, f.name) for e in elements]
        if f.default is None and not any(given):
            found[f.name] = None
        elif f.name in ("harmonics", "gas_torque", *OF_PERIOD, *OF_GEARS):
            found[f.name] = _harmonics(given)
        elif f.name in ("stages", "stops"):
            found[f.name] = _padded(given, (0.0, 0.0))
        elif f.name.startswith("over_"):
            rows = _padded(given, (0.0, 1.0, 1.0), 2)
            found[f.name] = rows if any(given) else rows[:, :0]
        else:
            found[f.name] = column(elements, f.name)
    return cls(**found)


def of_elements(elements: dict) -> dict:
    """The tables of a train from the sound elements of each table of a scene."""
    return {
        "disks": _collected(Disks, elements["disk"]),
        "shafts": _collected(Shafts, elements["shaft"]),
        "meshes": _collected(Meshes, [_with_law(mesh) for mesh in elements["mesh"]]),
        "dampers": _collected(Dampers, elements["damper"]),
        "grounds": _collected(Grounds, elements["ground"]),
        "loads": _collected(Loads, elements["load"]),
        "phases": _collected(Phases, elements["phase"]) if elements["phase"] else None,
        "torques": torque_table(elements["torque"]),
        "cylinders": cylinder_table(elements["cylinder"]),
    }


def _with_law(mesh):
    """A mesh with the numbers of its law."""
    law = LAW_OF_FRIDMAN if mesh.law else LAW
    return dataclasses.replace(
        mesh, **{key: value for key, value in law.items() if getattr(mesh, key) is None}
    )


def torque_table(torques) -> Torques:
    """Collect the given torques."""
    rated = any(t.rated_rpm is not None for t in torques)
    exponent = column(torques, "speed_exponent", absent=2.0) if rated else None
    return _collected(Torques, torques, _scales(torques) | {"speed_exponent": exponent})


def cylinder_table(cylinders) -> Cylinders:
    """Collect the cylinders; the pressure on its uniform grid."""
    tabled = any(c.pressure for c in cylinders)
    # Without tables no samples: every program would take them.
    pressure = np.zeros((len(cylinders), GAS_SAMPLES if tabled else 0))
    for i, c in enumerate(cylinders):
        if c.pressure:
            pressure[i] = gas_cycle(c.pressure, c.table_firing_tdc)
    own = {
        "rod": column(cylinders, "rod", absent=1.0),
        "pressure": pressure,
        "traces": _trace_table(cylinders),
        "combustion": _combustion_table(cylinders),
    }
    for name in ("gas_factor", "injection"):
        scattered = any(getattr(c, name) is not None for c in cylinders)
        own[name] = column(cylinders, name, absent=1.0) if scattered else None
    return _collected(
        Cylinders, cylinders, own | _scales(cylinders) | _shares(cylinders)
    )


def _trace_table(cylinders) -> Traces | None:
    """Collect the traces; None where no cylinder has any."""
    seats = tuple(i for i, c in enumerate(cylinders) if gas.source(c) == "traces")
    if not seats:
        return None
    own = [cylinders[i].traces for i in seats]
    speeds, loads = (
        [sorted({float(getattr(t, key)) for t in row}) for row in own]
        for key in ("rpm", "load")
    )
    rpm = gas.padded(speeds)
    load = gas.padded(loads)
    pressure = np.zeros((len(seats), rpm.shape[1], load.shape[1], GAS_SAMPLES))
    for k, row in enumerate(own):
        for trace in row:
            r = speeds[k].index(float(trace.rpm))
            s = loads[k].index(float(trace.load))
            pressure[k, r, s] = gas_cycle(trace.pressure, trace.table_firing_tdc)
    sizes = tuple((len(r), len(s)) for r, s in zip(speeds, loads, strict=True))
    return Traces(seats=seats, sizes=sizes, rpm=rpm, load=load, pressure=pressure)


def _combustion_table(cylinders) -> Combustions | None:
    """Collect the combustions; None where no cylinder has one."""
    seats = tuple(i for i, c in enumerate(cylinders) if gas.source(c) == "combustion")
    if not seats:
        return None
    own = [cylinders[i].combustion for i in seats]
    names = [
        f.name for f in dataclasses.fields(Combustion) if f.metadata["kind"] == "number"
    ]
    tables = [c.charge_over_load or c.charge_over_rpm for c in own]
    tabled = any(tables)
    return Combustions(
        seats=seats,
        revolutions=tuple(gas.gas_revolutions(cylinders[i]) for i in seats),
        by_work=tuple(c.imep is not None for c in own),
        charge_by=tuple(
            "load" if c.charge_over_load else "rpm" if c.charge_over_rpm else ""
            for c in own
        ),
        charge_at=(
            gas.padded([[at for at, _ in rows or ((0.0, 1.0),)] for rows in tables])
            if tabled
            else None
        ),
        charge_factor=_padded(tables, (0.0, 1.0))[..., 1].copy() if tabled else None,
        **{
            name: np.array([float(getattr(c, name) or 0.0) for c in own])
            for name in names
        },
    )


def _shares(cylinders) -> dict[str, np.ndarray | None]:
    """Speeds and loads of every cylinder, [nc, L]; None where no load counts."""
    if not any(gas.source(c) in ("traces", "combustion") for c in cylinders):
        return {"load_rpm": None, "load_share": None}
    rows = [c.load or ((0.0, 1.0),) for c in cylinders]
    rpm = gas.padded([[rpm for rpm, _ in row] for row in rows])
    return {"load_rpm": rpm, "load_share": _padded(rows, (0.0, 1.0))[..., 1].copy()}
