"""The numbers of a drive train as arrays, each field one vector over its elements, made
from elements.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from jaxhb.elements import derived
from jaxhb.elements.columns import collected
from jaxhb.elements.elements import (
    OF_GEARS,
    OF_PERIOD,
    TABLES,
    Damper,
    Disk,
    Ground,
    Load,
    Mesh,
    Phase,
    Shaft,
)
from jaxhb.elements.event_tables import Events, numbers_of
from jaxhb.elements.excitations import EXCITATIONS, Excitation
from jaxhb.elements.excitations.torque import Torques
from jaxhb.excitation.tables import Cylinders, table
from jaxhb.train.topology import Topology

Array = Any

LAW = {"epsilon": 1e-3, "transition": 0.04}
"""Stiffness in the gap over that in contact, width of the smooth zone over the
backlash, where a scene gives none.
"""

LAW_OF_FRIDMAN = {"epsilon": 0.03, "transition": 0.2}
"""The same numbers in the law (18) of Fridman 2009, ``law = "fridman2009"``."""

# Fields of links that hold rows
ROWS = (
    "over_hz",
    "over_amplitude",
    "over_temperature",
    "damping_over_rpm",
    "stiffness_over_rpm",
    "stages",
    "stops",
    *OF_PERIOD,
    *OF_GEARS,
)


def vectors_of(element: type) -> Callable[[type], type]:
    """Give a class one vector for each number of an element, and for its rows over
    frequency, amplitude or orders.

    0 stands for a number that is absent, nan for one that rows over the speed give, as
    ``damping_over_rpm`` [n, K, 2] (rpm, value), padded by its last row. Numbers that
    not all links have, and most rows, are None where no link has them.
    """

    def declare(cls: type) -> type:
        fields = [
            field
            for field in dataclasses.fields(element)
            if field.metadata["kind"] == "number" or field.name in ROWS
        ]
        may_be_none = (
            *derived.OPTIONAL,
            *derived.LIMITS_OF_DISKS,
            *derived.WITH,
            *(name for name in ROWS if name not in ("over_hz", "over_amplitude")),
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
    factor of damping; K is 0 where no shaft has such rows. ``over_temperature``
    likewise over deg C. ``stages`` and ``stops`` [n_shafts, K, 2]: deg, N m/rad.
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
    load pulsates. ``rated_torque`` (N m) and ``rated_rpm`` [n_loads] of its law over
    the speed, 0 where absent, ``over_rpm`` [n_loads, K, 2]: rpm, N m; ``archer``
    [n_loads] of the damping of propellers, 0 where absent; None where no load has them.
    """

    share: Array
    harmonics: Array | None = None
    rated_torque: Array | None = None
    rated_rpm: Array | None = None
    over_rpm: Array | None = None
    archer: Array | None = None


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
    excitations: dict[str, Any]
    phases: Phases | None = None
    events: Events | None = None

    @property
    def torques(self) -> Torques:
        """Numbers of the torques of the scene."""
        return self.excitations["torque"]

    @property
    def cylinders(self) -> Cylinders:
        """Numbers of the cylinders."""
        return self.excitations["cylinder"]

    def table(self, name: str) -> Any:
        """Numbers of the elements of a ``[[table]]``; None of absent phases and
        events.
        """
        if name in EXCITATIONS:
            return self.excitations[name]
        return getattr(self, ATTRIBUTES[name])

    def excited(self) -> list[tuple[Excitation, Any, Any]]:
        """Kinds of excitation, each with its numbers and its seats."""
        return [
            (kind, self.excitations[table], self.topology.seats_of(table))
            for table, kind in EXCITATIONS.items()
        ]


ATTRIBUTES = {
    table: "meshes" if table == "mesh" else f"{table}s"
    for table in TABLES
    if table not in EXCITATIONS
}
"""Fields of a train that hold the numbers of a ``[[table]]``; those of excitations are
in ``excitations`` by the table.
"""

Train = TypeVar("Train", bound=TrainArrays)
"""A train of any class, where what goes in and what comes out are of one."""


def with_table(train: Train, name: str, numbers: Any) -> Train:
    """The train with other numbers of the elements of a ``[[table]]``."""
    changed: dict[str, Any] = {}
    if name in EXCITATIONS:
        changed["excitations"] = train.excitations | {name: numbers}
    else:
        changed[ATTRIBUTES[name]] = numbers
    return dataclasses.replace(train, **changed)


def of_elements(elements: Mapping[str, Sequence[Any]]) -> dict[str, Any]:
    """Tables of a train from the sound elements of each table of a scene."""
    return {
        "disks": collected(Disks, Disk, elements["disk"]),
        "shafts": collected(Shafts, Shaft, elements["shaft"]),
        "meshes": collected(
            Meshes, Mesh, [_with_law(mesh) for mesh in elements["mesh"]]
        ),
        "dampers": collected(Dampers, Damper, elements["damper"]),
        "grounds": collected(Grounds, Ground, elements["ground"]),
        "loads": collected(Loads, Load, elements["load"]),
        "phases": collected(Phases, Phase, elements["phase"])
        if elements["phase"]
        else None,
        "events": numbers_of(elements["event"]),
        "excitations": {
            table: kind.numbers(elements[table]) for table, kind in EXCITATIONS.items()
        },
    }


def _with_law(mesh: Mesh) -> Mesh:
    """A mesh with the numbers of its law where it has none."""
    law = LAW_OF_FRIDMAN if mesh.law else LAW
    return dataclasses.replace(
        mesh,
        epsilon=law["epsilon"] if mesh.epsilon is None else mesh.epsilon,
        transition=law["transition"] if mesh.transition is None else mesh.transition,
    )
