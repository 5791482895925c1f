"""Static half of a drive train, fixed when a program is compiled: names, connections,
rotors, orders.

Everything here is text, integers, floats and tuples of them, so that a
:class:`Topology` can be hashed and compared.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from jaxhb._jax import Number
from jaxhb.elements.elements import OF_GEARS, OF_PERIOD, TABLES, TACHOMETER
from jaxhb.elements.event_tables import EventSeat
from jaxhb.elements.excitations import EXCITATIONS, Seats
from jaxhb.elements.excitations.cylinder import CylinderSeats
from jaxhb.elements.rules import Rule
from jaxhb.elements.rules.chosen import Chosen
from jaxhb.elements.sentences import SceneError, shown, suggestion


@dataclass(frozen=True, kw_only=True)
class Topology:
    """The static half of a :class:`~jaxhb.train.drivetrain.DriveTrain`.

    Disk indices run over the disks of the scene and then over the rings of the dampers.
    Links are the shafts, then the dampers (from the disk they sit on to the ring), then
    the meshes. ``load_harmonics`` hold the harmonics n of the cycle of each given
    order, as do ``mesh_stiffness_orders``, .. ``mesh_second_gear_error``;
    ``mesh_periods`` of each cycle, 0 where none are needed. ``excitations`` are the
    :class:`Seats` of each kind of excitation. ``rotor_path`` holds for each rotor the
    pairs (driving disk, driven disk) that lead to it from the reference rotor.
    ``hz_links``, ``amplitude_links`` and ``order_links`` are the links that vary over
    the frequency, over their amplitude and with the speed; ``rpm_tables`` the numbers
    that rows over the speed give: (table, field, index, number of rows). ``springs``
    are what acts beside the stiffness of shafts and dampers: (link, "clearance",
    "stages", "stops" or "friction", row). ``load_law`` names the law of each load over
    the speed, "over_rpm" with ``load_points`` rows, "" without one; ``archer_loads``
    are those whose disks have the damping of propellers. ``events`` are
    those of transients. ``rules`` are those that the scene chooses, ``shaft_rules``
    name the limits of each shaft, "" of one that names none, ``shaft_curves``
    are the rows of its S-N curve and their source. ``phase_members`` are the elements
    of each kind of excitation that each phase turns, ``phase_turn`` the harmonics of
    the cycle per order of their rotor. ``link_keys`` names for each link which of the
    keys that may be absent it has, ``disk_keys`` for each disk of the scene which
    limits; empty where none has any.
    ``rated_rpm`` is the rated speed of the reference rotor, with ``reference_disk``,
    ``tachometer_tolerance`` a share of it, ``operating_rpm`` the lowest and the highest
    operating speed;
    ``notes`` are those of the scene.

    Its ``repr`` is whole: it makes keys of compiled programs and of stored sweeps.
    """

    name: str
    revolutions_per_cycle: float
    disk_names: tuple[str, ...]
    n_scene_disks: int
    teeth: tuple[int, ...]
    rotor: tuple[int, ...]
    n_rotors: int
    reference_rotor: int
    rotor_path: tuple[tuple[tuple[int, int], ...], ...]
    shaft_names: tuple[str, ...]
    shaft_ends: tuple[tuple[int, int], ...]
    mesh_names: tuple[str, ...]
    mesh_ends: tuple[tuple[int, int], ...]
    mesh_internal: tuple[bool, ...]
    mesh_backlash: tuple[bool, ...]
    mesh_damping_law: tuple[str, ...]
    mesh_periods: tuple[int, ...]
    mesh_stiffness_orders: tuple[tuple[int, ...], ...]
    mesh_transmission_error: tuple[tuple[int, ...], ...]
    mesh_first_gear_error: tuple[tuple[int, ...], ...]
    mesh_second_gear_error: tuple[tuple[int, ...], ...]
    damper_names: tuple[str, ...]
    damper_disk: tuple[int, ...]
    ground_names: tuple[str, ...]
    ground_disk: tuple[int, ...]
    load_names: tuple[str, ...]
    load_disk: tuple[int, ...]
    excitations: tuple[Seats, ...]
    load_harmonics: tuple[tuple[int, ...], ...] = ()
    load_law: tuple[str, ...] = ()
    load_points: tuple[int, ...] = ()
    archer_loads: tuple[int, ...] = ()
    shaft_rules: tuple[str, ...] = ()
    shaft_curves: tuple[tuple[tuple[tuple[float, float], ...], str], ...] = ()
    phase_names: tuple[str, ...] = ()
    phase_members: tuple[tuple[tuple[int, ...], ...], ...] = ()
    phase_turn: tuple[float, ...] = ()
    hz_links: tuple[int, ...] = ()
    amplitude_links: tuple[int, ...] = ()
    order_links: tuple[int, ...] = ()
    rpm_tables: tuple[tuple[str, str, int, int], ...] = ()
    springs: tuple[tuple[int, str, int], ...] = ()
    link_keys: tuple[tuple[str, ...], ...] = ()
    disk_keys: tuple[tuple[str, ...], ...] = ()
    rated_rpm: float | None = None
    rules: Chosen = Chosen()
    tachometer_tolerance: float = TACHOMETER
    operating_rpm: tuple[float, ...] = ()
    reference_disk: int = 0
    events: tuple[EventSeat, ...] = ()
    scenarios: str = "{}"
    sequences: str = "{}"
    tune: str = "{}"
    tolerance: str = "{}"
    report: str = "{}"
    notes: tuple[str, ...] = ()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Topology):
            return NotImplemented
        # Compared at every call of a program: the stored hash tells most apart at once.
        return hash(self) == hash(other) and self._key == other._key

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _key(self) -> tuple[Any, ...]:
        return tuple(getattr(self, field.name) for field in dataclasses.fields(self))

    @cached_property
    def _hash(self) -> int:
        return hash(self._key)

    @cached_property
    def _names(self) -> dict[str, tuple[str, ...]]:
        """Names of the elements by table."""
        return {table: self.names_of(table) for table in TABLES}

    def names_of(self, table: str) -> tuple[str, ...]:
        """Names of the elements of a table."""
        if table == "disk":
            return self.disk_names[: self.n_scene_disks]
        if table == "event":
            return tuple(event.name for event in self.events)
        names: tuple[str, ...] = (
            self.seats_of(table).names
            if table in EXCITATIONS
            else getattr(self, f"{table}_names")
        )
        return names

    def seats_of(self, table: str) -> Seats:
        """Elements of a kind of excitation, as far as they are fixed."""
        return self._seats[table]

    @cached_property
    def _seats(self) -> dict[str, Seats]:
        return dict(zip(EXCITATIONS, self.excitations, strict=True))

    @property
    def depends_on_speed(self) -> bool:
        """Whether any stiffness or damping does."""
        return bool(self.rpm_tables or self.order_links or self.archer_loads)

    @property
    def archer_disks(self) -> tuple[int, ...]:
        """Disk of each load that has the damping of propellers."""
        return tuple(self.load_disk[load] for load in self.archer_loads)

    @property
    def torque_names(self) -> tuple[str, ...]:
        """Names of the torques."""
        return self.torques.names

    @property
    def cylinder_names(self) -> tuple[str, ...]:
        """Names of the cylinders."""
        return self.cylinders.names

    @property
    def torques(self) -> Seats:
        """The torques of the scene, as far as they are fixed."""
        return self.seats_of("torque")

    @property
    def cylinders(self) -> CylinderSeats:
        """The cylinders, as far as they are fixed."""
        return cast(CylinderSeats, self.seats_of("cylinder"))

    def with_cylinders(self, **changes: tuple[bool, ...]) -> Topology:
        """The same topology with some fields of its cylinders changed."""
        cylinders = dataclasses.replace(self.cylinders, **changes)  # type: ignore[arg-type]
        return dataclasses.replace(
            self,
            excitations=tuple(
                cylinders if seats is self.cylinders else seats
                for seats in self.excitations
            ),
        )

    @cached_property
    def firing_cylinders(self) -> tuple[str, ...]:
        """Names of the cylinders that are injected and not cut off."""
        seats = self.cylinders
        cylinders = zip(seats.names, seats.fires, seats.cut_off, strict=True)
        return tuple(name for name, fires, cut in cylinders if fires and not cut)

    @property
    def parts_text(self) -> str:
        """Number of elements of each kind: ``26 disks, 4 meshes``."""
        plurals = {"mesh": "meshes"}
        return ", ".join(
            f"1 {kind}" if count == 1 else f"{count} {plurals.get(kind, f'{kind}s')}"
            for kind, count, _ in self.parts_rows
        )

    @property
    def parts_rows(self) -> list[list[Any]]:
        """Kind, number and first names of the elements, a row for each kind in the
        train.
        """
        return [
            [kind, len(names), ", ".join(names[:12]) + ", …" * (len(names) > 12)]
            for kind, names in self._names.items()
            if names
        ]

    def cycle_frequency(self, rpm: Number) -> Any:
        """Omega = 2 pi rpm / (60 revolutions_per_cycle) in rad/s, of the cycle at
        ``rpm`` of the reference rotor.
        """
        return 2 * math.pi * rpm / 60 / self.revolutions_per_cycle

    def repeated(self, cycles: int) -> Topology:
        """The same topology with a cycle ``cycles`` times as long; harmonic n of the
        cycle becomes harmonic ``cycles n``.
        """
        numbers: dict[str, Any] = {
            "revolutions_per_cycle": cycles * self.revolutions_per_cycle
        }
        for name in ("mesh_periods", "phase_turn"):
            numbers[name] = tuple(cycles * number for number in getattr(self, name))
        of_meshes = (f"mesh_{name}" for name in (*OF_PERIOD, *OF_GEARS))
        for name in ("load_harmonics", *of_meshes):
            numbers[name] = tuple(
                tuple(cycles * harmonic for harmonic in row)
                for row in getattr(self, name)
            )
        numbers["excitations"] = tuple(
            seats.repeated(cycles) for seats in self.excitations
        )
        return dataclasses.replace(self, **numbers)

    @property
    def title(self) -> str:
        """Name of the scene in sentences."""
        return self.name or "scene"

    @property
    def mesh_varies(self) -> np.ndarray:
        """Whether the stiffness of a mesh varies over the mesh period ``(M,)``."""
        return np.array([bool(row) for row in self.mesh_stiffness_orders], dtype=bool)

    @property
    def meshing(self) -> list[str]:
        """Names of the meshes whose stiffness varies or that have transmission
        errors.
        """
        rows = [getattr(self, f"mesh_{name}") for name in (*OF_PERIOD, *OF_GEARS)]
        return [
            name
            for name, *orders in zip(self.mesh_names, *rows, strict=True)
            if any(orders)
        ]

    @property
    def has_law(self) -> np.ndarray:
        """Whether a mesh is no constant spring, as it has backlash or its stiffness
        varies; then the same of the ``springs``, which are none either: bool ``(E,)``.
        """
        meshes = np.array(self.mesh_backlash, dtype=bool) | self.mesh_varies
        return np.concatenate([meshes, np.ones(len(self.springs), dtype=bool)])

    @property
    def linear_in_contact(self) -> bool:
        """Whether the train is linear and constant as long as all teeth are in
        contact.
        """
        return not (self.springs or self.mesh_varies.any())

    @property
    def law_index(self) -> np.ndarray:
        """Meshes and ``springs`` ``(G,)`` that are no constant springs, in the order of
        :attr:`has_law`.
        """
        return np.flatnonzero(self.has_law)

    @property
    def n_disks(self) -> int:
        """Number of disks, rings of dampers included."""
        return len(self.disk_names)

    @property
    def ring_disks(self) -> tuple[int, ...]:
        """Disk index of each damper's ring."""
        return tuple(range(self.n_scene_disks, self.n_disks))

    @cached_property
    def gear_names(self) -> tuple[str, ...]:
        """Names of the disks that carry a mesh, in the order of the meshes, the two of
        a mesh in that of the disks.
        """
        return tuple(
            dict.fromkeys(
                self.disk_names[disk]
                for ends in self.mesh_ends
                for disk in sorted(ends)
            )
        )

    @property
    def shaft_and_damper_names(self) -> tuple[str, ...]:
        """Names of the links that transmit a torque: shafts, then dampers."""
        return self.shaft_names + self.damper_names

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """Names of the links: shafts, dampers, meshes."""
        return self.shaft_and_damper_names + self.mesh_names

    @cached_property
    def link_ends(self) -> tuple[tuple[int, int], ...]:
        """Pairs of disk indices of the links: shafts, dampers (disk, ring), meshes."""
        dampers = tuple(zip(self.damper_disk, self.ring_disks, strict=True))
        return self.shaft_ends + dampers + self.mesh_ends

    def rule_of(self, shaft: int) -> Rule:
        """Rule that judges a shaft."""
        return self.rules.rules[self.shaft_rules[shaft] or self.rules.default]

    @property
    def warm_links(self) -> tuple[int, ...]:
        """Shafts and dampers whose temperature follows from the heat that they give
        off.
        """
        return tuple(
            link for link, keys in enumerate(self.link_keys) if "surface" in keys
        )

    def has_key(self, link: int, key: str) -> bool:
        """Tell whether a link was built with a key that no solve reads."""
        return bool(self.link_keys) and key in self.link_keys[link]

    @cached_property
    def _disk_of(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.disk_names)}

    @cached_property
    def _link_of(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.link_names)}

    @cached_property
    def elements(self) -> dict[str, tuple[str, int]]:
        """Table and index of every element by its name; a ring stands under
        ``damper``.
        """
        order = (
            *(table for table in self._names if table not in ("damper", "disk")),
            "damper",
            "disk",
        )
        return {
            name: (table, i)
            for table in order
            for i, name in enumerate(self._names[table])
        }

    def disk_index(self, name: str) -> int:
        """Index of a disk or a damper's ring among the disks, rings last; else
        :class:`SceneError` with the nearest.
        """
        if name not in self._disk_of:
            raise SceneError(
                f"{self.title}: there is no disk"
                f" {shown(name)}.{suggestion(name, self.disk_names)}"
            )
        return self._disk_of[name]

    def link_index(self, name: str, other: str | None = None) -> tuple[int, int]:
        """Index and sense of a link given by its name, or by the two disks it joins;
        else :class:`SceneError`.

        The sense is -1 where the disks are given against the order of ``between``.
        Of several links that join them a name picks one.
        """
        where = self.title
        if other is None:
            if name not in self._link_of:
                raise SceneError(
                    f"{where}: there is no link"
                    f" {shown(name)}.{suggestion(name, self.link_names)}"
                )
            return self._link_of[name], 1
        a = self.disk_index(name)
        b = self.disk_index(other)
        hits = [
            (link, 1 if ends == (a, b) else -1)
            for link, ends in enumerate(self.link_ends)
            if set(ends) == {a, b}
        ]
        if not hits:
            near = [
                link_name
                for link_name, ends in zip(self.link_names, self.link_ends, strict=True)
                if a in ends or b in ends
            ]
            raise SceneError(
                f"{where}: no link joins {name!r} and {other!r}. Links there:"
                f" {', '.join(near)}."
            )
        if len(hits) > 1:
            names = ", ".join(repr(self.link_names[link]) for link, _ in hits)
            raise SceneError(
                f"{where}: several links join {name!r} and {other!r}: {names}. Ask for"
                " one by its name."
            )
        return hits[0]
