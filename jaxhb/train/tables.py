"""The numbers of a drive train as arrays, each field one vector over its elements, made
from elements.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from jaxhb.elements import derived
from jaxhb.elements.elements import (
    OF_GEARS,
    OF_PERIOD,
    Combustion,
    Cylinder,
    Damper,
    Disk,
    Ground,
    Mesh,
    Shaft,
    Torque,
)
from jaxhb.excitation import gas
from jaxhb.excitation.gas import GAS_SAMPLES, gas_cycle
from jaxhb.excitation.tables import Combustions, Cylinders, Torques, Traces, table
from jaxhb.train.topology import Topology

Array = Any

LAW = {"epsilon": 1e-3, "transition": 0.04}
"""Stiffness in the gap over that in contact, width of the smooth zone over the
backlash, where a scene gives none.
"""

LAW_OF_FRIDMAN = {"epsilon": 0.03, "transition": 0.2}
"""The same numbers in the law (18) of Fridman 2009, ``law = "fridman2009"``."""

# Fields of links that hold rows
ROWS = ("over_hz", "over_amplitude", "stages", "stops", *OF_PERIOD, *OF_GEARS)


def vectors_of(element: type) -> Callable[[type], type]:
    """Give a class one vector for each number of an element, and for its rows over
    frequency, amplitude or orders.

    0 stands for a number that is absent. Numbers that not all links have, and most
    rows, are None where no link has them.
    """

    def declare(cls: type) -> type:
        fields = [
            field
            for field in dataclasses.fields(element)
            if field.metadata["kind"] == "number" or field.name in ROWS
        ]
        may_be_none = (
            *derived.OPTIONAL,
            *derived.WITH,
            *(name for name in ROWS if not name.startswith("over_")),
        )
        optional = [field.name for field in fields if field.name in may_be_none]
        required = [field.name for field in fields if field.name not in optional]
        cls.__annotations__ = dict.fromkeys([*required, *optional], Array)
        for name in optional:
            setattr(cls, name, None)
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
    """Angle in deg of its rotor by which each phase delays its cylinders and torques,
    [n_phases].
    """

    angle: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainArrays:
    """The fields of a :class:`~jaxhb.train.drivetrain.DriveTrain`: all that computes
    with a train works on these.
    """

    topology: Topology = dataclasses.field(metadata={"static": True})
    disks: Disks
    shafts: Shafts
    meshes: Meshes
    dampers: Dampers
    grounds: Grounds
    loads: Loads
    torques: Torques
    cylinders: Cylinders
    phases: Phases | None = None


Train = TypeVar("Train", bound=TrainArrays)
"""A train of any class, where what goes in and what comes out are of one."""


def column(elements: Sequence[Any], name: str, absent: float = 0.0) -> np.ndarray:
    """Collect one field over elements, ``absent`` for None."""
    values = [getattr(element, name) for element in elements]
    return np.array(
        [absent if value is None else value for value in values], dtype=np.float64
    )


def _harmonics(rows: Sequence[Any]) -> np.ndarray:
    """Stack the (Re, Im) of rows (order, Re, Im), padded by zeros."""
    stacked = np.zeros((len(rows), max((len(row or ()) for row in rows), default=0), 2))
    for i, row in enumerate(rows):
        if row:
            stacked[i, : len(row)] = np.asarray(row, dtype=np.float64)[:, 1:]
    return stacked


def _scales(elements: Sequence[Any]) -> dict[str, np.ndarray]:
    """Stack the scales, padded by their last point; the factor is 1 without a scale."""
    points = _padded([element.scale for element in elements], (0.0, 1.0), 2)
    return {"scale_rpm": points[..., 0].copy(), "scale_factor": points[..., 1].copy()}


def _padded(
    rows: Sequence[Any], absent: tuple[float, ...], least: int = 1
) -> np.ndarray:
    """Stack lists of rows [n, K, columns]; lists without any hold the row ``absent``,
    shorter ones repeat their last row; K is at least ``least``.
    """
    rows = [row or (absent,) for row in rows]
    longest = max([least, *map(len, rows)])
    padded = [[*row, *([row[-1]] * longest)][:longest] for row in rows]
    return np.array(padded, dtype=np.float64).reshape(len(rows), longest, len(absent))


def _collected(
    cls: type[Any], elements: Sequence[Any], special: Mapping[str, Any] | None = None
) -> Any:
    """Collect a table: its ``special`` fields, and the others from its elements; None
    for a field that may be absent and that no element has.
    """
    columns = dict(special or {})
    for field in dataclasses.fields(cls):
        if field.name in columns:
            continue
        values = [getattr(element, field.name) for element in elements]
        if field.default is None and not any(values):
            columns[field.name] = None
        elif field.name in ("harmonics", "gas_torque", *OF_PERIOD, *OF_GEARS):
            columns[field.name] = _harmonics(values)
        elif field.name in ("stages", "stops"):
            columns[field.name] = _padded(values, (0.0, 0.0))
        elif field.name.startswith("over_"):
            rows = _padded(values, (0.0, 1.0, 1.0), 2)
            columns[field.name] = rows if any(values) else rows[:, :0]
        else:
            columns[field.name] = column(elements, field.name)
    return cls(**columns)


def of_elements(elements: Mapping[str, Sequence[Any]]) -> dict[str, Any]:
    """Tables of a train from the sound elements of each table of a scene."""
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


def _with_law(mesh: Mesh) -> Mesh:
    """A mesh with the numbers of its law where it has none."""
    law = LAW_OF_FRIDMAN if mesh.law else LAW
    return dataclasses.replace(
        mesh,
        epsilon=law["epsilon"] if mesh.epsilon is None else mesh.epsilon,
        transition=law["transition"] if mesh.transition is None else mesh.transition,
    )


def torque_table(torques: Sequence[Torque]) -> Torques:
    """Collect the torques that a scene gives."""
    rated = any(torque.rated_rpm is not None for torque in torques)
    exponent = column(torques, "speed_exponent", absent=2.0) if rated else None
    return _collected(Torques, torques, _scales(torques) | {"speed_exponent": exponent})


def cylinder_table(cylinders: Sequence[Cylinder]) -> Cylinders:
    """Collect the cylinders; the pressure on its uniform grid."""
    has_tables = any(cylinder.pressure for cylinder in cylinders)
    # Without tables no samples: every program would take them.
    pressure = np.zeros((len(cylinders), GAS_SAMPLES if has_tables else 0))
    for i, cylinder in enumerate(cylinders):
        if cylinder.pressure:
            pressure[i] = gas_cycle(cylinder.pressure, cylinder.table_firing_tdc)
    special: dict[str, Any] = {
        "rod": column(cylinders, "rod", absent=1.0),
        "pressure": pressure,
        "traces": _trace_table(cylinders),
        "combustion": _combustion_table(cylinders),
    }
    for name in ("gas_factor", "injection"):
        scattered = any(getattr(cylinder, name) is not None for cylinder in cylinders)
        special[name] = column(cylinders, name, absent=1.0) if scattered else None
    return _collected(
        Cylinders, cylinders, special | _scales(cylinders) | _shares(cylinders)
    )


def _trace_table(cylinders: Sequence[Any]) -> Traces | None:
    """Collect the traces; None where no cylinder has any."""
    seats = tuple(
        i for i, cylinder in enumerate(cylinders) if gas.source(cylinder) == "traces"
    )
    if not seats:
        return None
    traces = [cylinders[i].traces for i in seats]
    speeds = [sorted({float(trace.rpm) for trace in row}) for row in traces]
    loads = [sorted({float(trace.load) for trace in row}) for row in traces]
    rpm = gas.padded(speeds)
    load = gas.padded(loads)
    pressure = np.zeros((len(seats), rpm.shape[1], load.shape[1], GAS_SAMPLES))
    for k, row in enumerate(traces):
        for trace in row:
            r = speeds[k].index(float(trace.rpm))
            s = loads[k].index(float(trace.load))
            pressure[k, r, s] = gas_cycle(trace.pressure, trace.table_firing_tdc)
    sizes = tuple(
        (len(own_speeds), len(own_loads))
        for own_speeds, own_loads in zip(speeds, loads, strict=True)
    )
    return Traces(seats=seats, sizes=sizes, rpm=rpm, load=load, pressure=pressure)


def _combustion_table(cylinders: Sequence[Any]) -> Combustions | None:
    """Collect the combustions; None where no cylinder has one."""
    seats = tuple(
        i
        for i, cylinder in enumerate(cylinders)
        if gas.source(cylinder) == "combustion"
    )
    if not seats:
        return None
    combustions = [cylinders[i].combustion for i in seats]
    names = [
        field.name
        for field in dataclasses.fields(Combustion)
        if field.metadata["kind"] == "number"
    ]
    tables = [
        combustion.charge_over_load or combustion.charge_over_rpm
        for combustion in combustions
    ]
    has_factors = any(tables)
    numbers = {
        name: np.array(
            [float(getattr(combustion, name) or 0.0) for combustion in combustions]
        )
        for name in names
    }
    charge_by = []
    for combustion in combustions:
        if combustion.charge_over_load:
            charge_by.append("load")
        else:
            charge_by.append("rpm" if combustion.charge_over_rpm else "")
    charge_at = None
    charge_factor = None
    if has_factors:
        charge_at = gas.padded(
            [[position for position, _ in rows or ((0.0, 1.0),)] for rows in tables]
        )
        charge_factor = _padded(tables, (0.0, 1.0))[..., 1].copy()
    return Combustions(
        seats=seats,
        revolutions=tuple(gas.gas_revolutions(cylinders[i]) for i in seats),
        by_work=tuple(combustion.imep is not None for combustion in combustions),
        charge_by=tuple(charge_by),
        charge_at=charge_at,
        charge_factor=charge_factor,
        **numbers,
    )


def _shares(cylinders: Sequence[Any]) -> dict[str, np.ndarray | None]:
    """Speeds and loads of every cylinder, [nc, L]; None where no load counts."""
    if not any(
        gas.source(cylinder) in ("traces", "combustion") for cylinder in cylinders
    ):
        return {"load_rpm": None, "load_share": None}
    rows = [cylinder.load or ((0.0, 1.0),) for cylinder in cylinders]
    rpm = gas.padded([[speed for speed, _ in row] for row in rows])
    return {"load_rpm": rpm, "load_share": _padded(rows, (0.0, 1.0))[..., 1].copy()}
