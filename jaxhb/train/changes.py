"""Reading and changing single numbers, laws and teeth of a train by ``"NAME.FIELD"``,
on the host or under tracing.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb._jax import Array, load, traced
from jaxhb.elements import derived
from jaxhb.elements.checks import ORDER_ROWS
from jaxhb.elements.declared import LARGEST, LINES
from jaxhb.elements.elements import OF_GEARS, OF_PERIOD, TABLES, Mesh
from jaxhb.elements.event_tables import row_of, without_effect
from jaxhb.elements.events import rows_errors
from jaxhb.elements.excitations import EXCITATIONS
from jaxhb.elements.sentences import SceneError, shown, suggestion
from jaxhb.elements.units import Refused, si_value
from jaxhb.elements.value_checks import over_rpm_errors
from jaxhb.elements.values import number_like, row_errors, value_errors
from jaxhb.train import connections
from jaxhb.train.connections import RATIO_TOLERANCE
from jaxhb.train.kinematics import rotor_ratios
from jaxhb.train.tables import LAW_OF_FRIDMAN, with_table
from jaxhb.train.varying import NEEDS

if TYPE_CHECKING:
    from jaxhb.train.tables import Train, TrainArrays
    from jaxhb.train.topology import Topology

_WORDS = {
    f.name: f.metadata["words"]
    for f in dataclasses.fields(Mesh)
    if f.metadata["kind"] == "choice"
}
_NO_BACKLASH = (
    "the mesh has no backlash, it is always in contact. Build the scene with a"
    " backlash."
)


def _choose(
    train: Train, values: Mapping[str, Any]
) -> tuple[Train, dict[str, Any], list[str]]:
    """Take laws and numbers of teeth, which are no numbers of the train, from
    ``{"NAME.FIELD": value}``.

    Returns the train with these, the other values with those that follow (``law`` sets
    ``epsilon`` and ``transition``, ``teeth`` the ``radius`` at the tooth pitch that the
    gear has), and sentences.
    """
    numbers: dict = {}
    faults = []
    topology = train.topology
    laws = list(topology.mesh_damping_law)
    teeth = list(topology.teeth)
    for key, value in values.items():
        table = None
        field = ""
        index = 0
        fault = ""
        followed: dict[str, float] = {}
        with contextlib.suppress(SceneError):  # told with the numbers
            table, field, index = locate(topology, key)
        if table == "mesh" and field in ("law", "damping_law"):
            words = [word for word in _WORDS[field] if word]
            if not topology.mesh_backlash[index]:
                fault = _NO_BACKLASH
            elif value not in words:
                fault = f"{field} is {shown(value)}.{suggestion(value, words)}"
            elif field == "law":
                followed = LAW_OF_FRIDMAN
            else:
                laws[index] = value
        elif table == "disk" and field == "teeth":
            if not topology.teeth[index]:
                fault = (
                    "the gear has no teeth in the scene, its ratio is that of the"
                    " radii. Build it with teeth."
                )
            elif not (
                isinstance(value, int | float | np.number)
                and value >= 1
                and float(value).is_integer()
            ):
                fault = (
                    f"teeth is {shown(value)}, must be a whole number of at least 1."
                )
            else:
                followed = {
                    "radius": (
                        np.asarray(train.disks.radius)[index]
                        * int(value)
                        / teeth[index]
                    )
                }
                teeth[index] = int(value)
        elif table == "disk" and field == "gd2":
            inertia_key = f"{key.removesuffix(field)}inertia"
            if inertia_key in values:
                fault = f"{inertia_key!r} is given, too. Keep one of them."
            elif isinstance(value, Refused):
                fault = f"gd2 is {shown(value)}, {value.why}"
            else:
                numbers[inertia_key] = derived.inertia_of(value)
        else:
            numbers.setdefault(key, value)
        for followed_field, number in followed.items():
            followed_key = f"{key.removesuffix(field)}{followed_field}"
            chosen_value = values.get(followed_key, number)
            numbers[followed_key] = chosen_value
            if (
                number_like(chosen_value)
                and abs(float(chosen_value) - number) > RATIO_TOLERANCE * number
            ):
                fault = (
                    f"it makes {followed_field} {number:.6g}, but {followed_key!r} is"
                    f" given as {chosen_value:.6g}. Keep one of them."
                )
        if fault:
            faults.append(f"{topology.title}, replace {shown(key)}: {fault}")
    if tuple(laws) != topology.mesh_damping_law or tuple(teeth) != topology.teeth:
        changed = dataclasses.replace(
            topology, mesh_damping_law=tuple(laws), teeth=tuple(teeth)
        )
        train = dataclasses.replace(train, topology=changed)
    return train, numbers, faults


def scene_values(
    train: TrainArrays, settings: Mapping[str, Any]
) -> dict[tuple[str, int, str], Any]:
    """Values that a scene file needs for the settings ``{"NAME.FIELD": value}`` of a
    train that they made, by table, row and field.
    """
    by_place: dict = {}
    for key, value in in_si(train.topology, settings).items():
        table, field, index = locate(train.topology, key)
        if (table, field) == ("mesh", "law"):
            by_place |= {
                (table, index, law_field): number
                for law_field, number in LAW_OF_FRIDMAN.items()
            }
            continue
        if field == "gd2":
            by_place[table, index, "inertia"] = derived.inertia_of(value)
            continue
        by_place[table, index, field] = int(value) if field == "teeth" else value
        if field == "teeth":
            by_place[table, index, "radius"] = float(
                np.asarray(train.disks.radius)[index]
            )
    return by_place


_VARYING = {key: links for links, (key, _) in NEEDS.items()}
_INNER = {
    field.name: field.metadata["of"]
    for cls in TABLES.values()
    for field in dataclasses.fields(cls)
    if "of" in field.metadata
}


def locate(topology: Topology, key: str) -> tuple[str, str, int]:
    """Find table, field and index of ``"NAME.FIELD"``; a field may be
    ``"combustion.start"``.
    """
    where = topology.title
    name, dot, field = key.rpartition(".")
    if not dot:
        raise SceneError(
            f"{where}: {shown(key)} names no field. Write 'NAME.FIELD', as"
            " 'hub.inertia'."
        )
    outer, _, inner = name.rpartition(".")
    # A name may hold dots: an element called so goes before a table inside an element.
    if name not in topology.elements and inner in _INNER and outer in topology.elements:
        name = outer
        field = f"{inner}.{field}"
    if name not in topology.elements:
        raise SceneError(
            f"{where}: there is no element {shown(name)} in"
            f" {shown(key)}.{suggestion(name, topology.elements)}"
        )
    table, index = topology.elements[name]
    return table, field, index


def in_si(topology: Topology, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by ``"NAME.FIELD"``, those with units in the units of their fields; those
    of a unit that does not fit are :class:`~jaxhb.elements.units.Refused`.
    """
    return {key: _in_si(topology, key, value) for key, value in values.items()}


def numbers_in_si(train: TrainArrays, key: str, values: Sequence[Any]) -> list[float]:
    """Numbers of a field, those with units in its unit; :class:`SceneError` on the
    first whose unit does not fit: that of a range stands in all its numbers.
    """
    numbers = in_si(train.topology, {key: list(values)})[key]
    for number in numbers:
        if isinstance(number, str):
            fault = number.why if isinstance(number, Refused) else "is no number."
            where = f"{train.topology.title}, {shown(key)}"
            raise SceneError(f"{where}: {shown(number)} {fault}")
    return numbers


def _in_si(topology: Topology, key: str, value: Any) -> Any:
    """The value of a field in its unit."""
    if not isinstance(value, str | list | tuple):
        return value
    try:
        table, field, _ = locate(topology, key)
    except SceneError:  # told with the numbers
        return value
    outer = field.rpartition(".")[0]
    declared = declared_field(table, field)
    if declared is None:
        return value
    return si_value(_INNER.get(outer, TABLES[table]), declared, value)


def declared_field(table: str, field: str) -> dataclasses.Field | None:
    """Declared field of an element, with its unit and range, for a field of a table;
    None where there is none.
    """
    outer, _, inner = field.rpartition(".")
    cls = _INNER.get(outer, TABLES[table])
    return {declared.name: declared for declared in dataclasses.fields(cls)}.get(inner)


def _locate(train: TrainArrays, key: str) -> tuple[str, str, int]:
    """Table, field and index of ``"NAME.FIELD"`` that the train has."""
    table, field, index = locate(train.topology, key)
    numbers = train.table(table)
    inner = field
    where = f"{train.topology.title}, [[{table}]] {key[: -len(field) - 1]!r}"
    if "." in field:
        outer, _, inner = field.partition(".")
        numbers = getattr(numbers, outer, None)
        if numbers is None or index not in numbers.seats:
            raise SceneError(f"{where}: it has no {outer}. Build the scene with one.")
    fields = [
        declared.name
        for declared in dataclasses.fields(numbers)
        if declared.name not in _INNER and not declared.metadata.get("static")
    ]
    if inner not in fields:
        raise SceneError(
            f"{where}: there is no field {shown(inner)}.{suggestion(inner, fields)}"
        )
    if (table, field) == ("disk", "damping") and index in train.topology.archer_disks:
        raise SceneError(
            f"{where}: its damping depends on the speed, by archer of its load. Take"
            " that, or the train at one speed, train.with_constant_links(rpm=...)."
        )
    if _rows_over_rpm(train.topology, table, f"{field}_over_rpm", index):
        raise SceneError(
            f"{where}: its {field} depends on the speed. Take {field}_over_rpm, or the"
            " train at one speed, train.with_constant_links(rpm=...)."
        )
    if _vector(train, table, field) is None:
        raise SceneError(
            f"{where}: nothing in the scene has {inner}. Build the scene with it."
        )
    return table, field, index


_OVER_RPM = ("damping_over_rpm", "stiffness_over_rpm")


def _rows_over_rpm(topology: Topology, table: str, field: str, index: int) -> int:
    """Number of rows of a ``field`` over the speed of an element, 0 where it has
    none.
    """
    counts = {
        (kind, f"{quantity}_over_rpm", i): count
        for kind, quantity, i, count in topology.rpm_tables
    }
    return counts.get((table, field, index), 0)


def _vector(train: TrainArrays, table: str, field: str) -> Any:
    """A field of a table over its elements; numbers that are 1 where the scene does not
    give them, as gas factors, are ones.
    """
    numbers = train.table(table)
    outer, _, inner = field.rpartition(".")
    vector = getattr(getattr(numbers, outer) if outer else numbers, inner)
    absent = (
        vector is None and table in EXCITATIONS and field in EXCITATIONS[table].ones
    )
    return np.ones(len(train.topology.names_of(table))) if absent else vector


def _place(train: TrainArrays, table: str, field: str, index: int) -> int:
    """Index of an element in the vector of a field."""
    outer = field.rpartition(".")[0]
    return getattr(train.table(table), outer).seats.index(index) if outer else index


def _row(train: TrainArrays, table: str, field: str, index: int) -> Any:
    """The part of a row that the scene gave (harmonics and traces are padded)."""
    place = _place(train, table, field, index)
    row = _vector(train, table, field)[place]
    if field in _OVER_RPM:
        return row[: _rows_over_rpm(train.topology, table, field, index)]
    if field in ("stages", "stops"):
        link = derived.link_number(train.topology, table, index)
        count = sum((link, field) == spring[:2] for spring in train.topology.springs)
        return row[:count]
    if table == "mesh" and field in (*OF_PERIOD, *OF_GEARS):
        return row[: len(getattr(train.topology, f"mesh_{field}")[index])]
    if (table, field) == ("load", "harmonics"):
        return row[: len(train.topology.load_harmonics[index])]
    if (table, field) == ("load", "over_rpm"):
        return row[: train.topology.load_points[index]]
    if table == "event":
        return row_of(train.topology.events[index], field, row)
    if table not in EXCITATIONS:
        return row
    kind = EXCITATIONS[table]
    seats = train.topology.seats_of(table)
    if field == kind.order_rows:
        return row[: len(seats.harmonics[index])]
    return kind.scene_row(train.table(table), seats, field, place, row)


def read(train: TrainArrays, key: str) -> Any:
    """Read one number or array; see :meth:`DriveTrain.value`."""
    if key.endswith(".gd2"):
        return 4 * read(train, f"{key.removesuffix('gd2')}inertia")
    table, field, index = _locate(train, key)
    row = _row(train, table, field, index)
    return float(row) if isinstance(row, np.floating) else row


def replace(train: Train, values: Mapping[str, Any]) -> Train:
    """Change numbers; see :meth:`DriveTrain.replace`."""
    before = train
    train, values, errors = _choose(train, in_si(train.topology, values))
    changes: dict[tuple[str, str], dict[int, Any]] = {}
    for key, value in values.items():
        try:
            table, field, index = _locate(train, key)
        except SceneError as error:
            errors += error.sentences
            continue
        if isinstance(value, list | tuple) and traced(value):
            # Rows with traced numbers: numpy cannot join them.
            value = load().numpy.asarray(value)
        errors += _value_errors(train, key, table, field, index, value)
        changes.setdefault((table, field), {})[_place(train, table, field, index)] = (
            value
        )
    if errors:
        raise SceneError(errors)
    changed = train
    for (table, field), new_values in changes.items():
        changed = _with(changed, table, field, new_values)
    for table, field, new_values in derived.followers(train, changed, changes):
        changed = _with(changed, table, field, new_values)
    if ("disk", "radius") in changes:
        _check_ratios(before, changed)
    # Mean torques take integrals over a cycle: only where they, or what holds them, may
    # have changed.
    errors = connections.train_errors(changed) if connections.touches(changes) else []
    if errors:
        raise SceneError(errors)
    return changed


def _with(train: Train, table: str, field: str, new_values: Mapping[int, Any]) -> Train:
    """The train with values ``{index: value}`` in the vector of one field."""
    outer, _, inner = field.rpartition(".")
    numbers = train.table(table)
    vector = _set(_vector(train, table, field), new_values)
    if outer:
        vector = dataclasses.replace(getattr(numbers, outer), **{inner: vector})
    changed = dataclasses.replace(numbers, **{outer or inner: vector})
    return with_table(train, table, changed)


def in_contact(train: Train) -> Train:
    """The same train with the gaps of all meshes closed and all else as it is: "without
    backlash".
    """
    topology = train.topology
    meshes: Any = train.meshes
    return dataclasses.replace(
        train,
        topology=dataclasses.replace(
            topology, mesh_backlash=(False,) * len(topology.mesh_names)
        ),
        meshes=dataclasses.replace(meshes, backlash=0.0 * meshes.backlash),
    )


def linearised(train: Train) -> Train:
    """The train in contact, with teeth of their mean stiffness and shafts and dampers
    of one stiffness: linear.
    """
    train = in_contact(train)
    constant = ((),) * len(train.topology.mesh_names)
    meshes: Any = train.meshes
    return dataclasses.replace(
        train,
        topology=dataclasses.replace(
            train.topology, mesh_stiffness_orders=constant, springs=()
        ),
        meshes=dataclasses.replace(meshes, stiffness_orders=None),
    )


def _set(vector: Array, new_values: Mapping[int, Any]) -> Array:
    """Put values at their indices: on the host by a copy, under tracing in one
    scatter.
    """
    if isinstance(vector, np.ndarray) and not traced(new_values):
        changed = vector.copy()
        for index, value in new_values.items():
            row = np.asarray(value, dtype=np.float64)
            place: tuple[Any, ...] = (index, *(slice(n) for n in row.shape))
            changed[place] = row
        return changed
    import jax.numpy as jnp

    scattered = jnp.asarray(vector)
    if scattered.ndim == 1:
        rows = [jnp.asarray(value, dtype=jnp.float64) for value in new_values.values()]
        return scattered.at[np.array(list(new_values))].set(jnp.stack(rows))
    for index, value in new_values.items():
        new_row = jnp.asarray(value, dtype=jnp.float64)
        place = (index, *(slice(n) for n in new_row.shape))
        scattered = scattered.at[place].set(new_row)
    return scattered


def within_range(train: TrainArrays) -> Array:
    """Whether every number lies in the range of its field, a bool that may be traced;
    nan does not count as outside.
    """
    import jax.numpy as jnp

    inside = [jnp.array(True)]
    tables: list[tuple[Any, Any]] = [
        (cls, train.table(table)) for table, cls in TABLES.items()
    ]
    tables += [
        (declared.metadata["of"], getattr(numbers, declared.name))
        for cls, numbers in list(tables)
        if numbers is not None
        for declared in dataclasses.fields(cls)
        if declared.metadata["kind"] == "table"
    ]
    for cls, numbers in tables:
        for declared in dataclasses.fields(cls):
            limits = declared.metadata.get("range")
            values = getattr(numbers, declared.name, None)
            if limits is None or values is None:
                continue
            # Numbers outside are counted, not those inside: nan is neither, and has its
            # own status.
            values = jnp.asarray(values)
            outside = limits.excludes(values)
            # 0 stands for a key that is absent, except for those that the reader fills
            # in.
            filled_in = ("epsilon", "transition", "stiffness")
            if declared.default is None and declared.name not in filled_in:
                outside = outside & (values != 0.0)
            inside.append(~jnp.any(outside))
    return jnp.all(jnp.stack(inside))


def _value_errors(
    train: TrainArrays, key: str, table: str, field: str, index: int, value: Any
) -> list[str]:
    """Check shape and, where it is concrete, range of a new value."""
    where = f"{train.topology.title}, replace {shown(key)}"
    if isinstance(value, Refused):
        return [f"{where}: the value is {shown(value)}, {value.why}"]
    row = _row(train, table, field, index)
    shape = np.shape(row)
    new_shape = None
    with contextlib.suppress(ValueError):  # rows of different lengths have no shape
        new_shape = np.shape(value)
    if new_shape != shape:
        remedy = "Map over a batch with jax.vmap."
        by_orders = field in {*ORDER_ROWS, *OF_PERIOD, *OF_GEARS}
        if by_orders and new_shape == (*shape[:-1], 3):
            remedy = "Leave the orders out: rows are (Re, Im) of those of the scene."
        return [
            f"{where}: the value has shape {new_shape}, must have {shape}. {remedy}"
        ]
    no_effect = _has_no_effect(train, table, field, index)
    if traced(value):
        return [f"{where}: {no_effect}"] if no_effect else []
    number = np.asarray(value)
    if number.dtype.kind not in "fiu" or not np.all(np.abs(number) <= LARGEST):
        return [
            f"{where}: the value is {shown(value)}, must be finite and real, at most"
            f" {LARGEST:g} in size."
        ]
    # A value that is there already changes nothing, and is no fault.
    if no_effect and (traced(row) or not np.all(np.asarray(row) == number)):
        return [f"{where}: {no_effect}"]
    declared = declared_field(table, field)
    if table == "event" and shape and declared is not None:
        texts = rows_errors(declared.name, number.tolist())
        return [f"{where}: {text}" for text in texts]
    if declared is not None and field in _OVER_RPM:
        excluded = field == "stiffness_over_rpm" and table != "damper"
        rows = number.tolist()
        texts = row_errors(field, declared.metadata["columns"], rows)
        texts += over_rpm_errors(field, rows, least_is_excluded=excluded)
        return [f"{where}: {text}" for text in texts]
    if declared is not None and declared.metadata.get("columns") == LINES:
        texts = row_errors(field, LINES, number.tolist())
        return [f"{where}: {text}" for text in texts]
    if declared is None or shape or declared.metadata["kind"] != "number":
        return []
    if declared.default is None and number == 0.0 and not traced(row) and row == 0.0:
        return []  # the scene gave none, which stands as 0
    return [f"{where}: {text}" for text in value_errors(declared, float(number))]


def _has_no_effect(train: TrainArrays, table: str, field: str, index: int) -> str:
    """Say why a number has no effect in a train of this topology; empty where it has
    one.
    """
    topology = train.topology
    if table in EXCITATIONS:
        seats = topology.seats_of(table)
        numbers = train.table(table)
        return EXCITATIONS[table].without_effect(numbers, seats, field, index)
    if table == "event":
        return without_effect(topology.events[index], field)
    if (table, field) == ("load", "archer") and index not in topology.archer_loads:
        return _built_without(table, field)
    if table == "load" and field in ("rated_torque", "rated_rpm", "over_rpm"):
        law = topology.load_law[index]
        if law and (field == "over_rpm") == (law == "over_rpm"):
            return ""
        return f"it has no effect on this load. Build the scene with {field}."
    if field in _OVER_RPM and not _rows_over_rpm(topology, table, field, index):
        return f"the {table} was built without {field}. Build the scene with it."
    if field in derived.LIMITS_OF_DISKS:
        is_limited = topology.disk_keys and field in topology.disk_keys[index]
        return "" if is_limited else _built_without(table, field)
    if table not in derived.LINKS:
        return ""
    if (
        table == "mesh"
        and field in ("backlash", "epsilon", "transition")
        and not topology.mesh_backlash[index]
    ):
        return _NO_BACKLASH
    if table == "mesh" and field == "phase" and not topology.mesh_periods[index]:
        return (
            "it has no effect, as the mesh has neither stiffness_orders nor"
            " transmission_error."
        )
    link = derived.link_number(topology, table, index)
    key = derived.WITH.get(field, field)
    if field == "stiffness" and topology.has_key(link, "outer"):
        return (
            "the stiffness comes from length, outer, inner and shear_modulus. Change"
            " these."
        )
    share = next((key for key in derived.SHARES if topology.has_key(link, key)), "")
    if field == "damping" and topology.has_key(link, "damping_hz"):
        return f"the damping comes from {share} and damping_hz. Change these."
    if (field, share) == ("loss_factor", "relative_damping"):
        return "the loss factor comes from relative_damping. Change that."
    for over in ("over_hz", "over_torque"):
        if topology.has_key(link, f"{field}_{over}"):
            return (
                f"the {field} comes from {field}_{over}. Change the rows in the scene."
            )
    is_built_in = (
        link in getattr(topology, _VARYING[field])
        if field in _VARYING
        else topology.has_key(link, key)
    )
    if (field in _VARYING or key in derived.OPTIONAL) and not is_built_in:
        return _built_without(table, key)
    return ""


def _built_without(table: str, key: str) -> str:
    """Say that a key changes nothing, as an element was built without it."""
    return (
        f"it has no effect, as the {table} was built without {key}. Build the scene"
        " with it."
    )


def _periods(topology: Topology, ratios: Array, index: int) -> float:
    """Mesh periods of a mesh in a revolution of the reference rotor; 1 where no gear
    has teeth.
    """
    gears = [
        disk
        for disk in topology.mesh_ends[index]
        if disk < len(topology.teeth) and topology.teeth[disk]
    ]
    periods = (topology.teeth[disk] * ratios[topology.rotor[disk]] for disk in gears)
    return float(next(periods, 1.0))


def _check_ratios(before: TrainArrays, after: TrainArrays) -> None:
    """Refuse concrete radii that lock a loop or change the speed of a rotor with orders
    of its own.
    """
    topology = after.topology
    radius = after.disks.radius
    if traced(radius):
        return
    radius = np.asarray(radius)
    old = rotor_ratios(topology, np.asarray(before.disks.radius))
    new = rotor_ratios(topology, radius)
    errors = []
    where = topology.title
    counted: list[tuple[str, int]] = []
    for k, seats in reversed([*enumerate(topology.excitations)]):
        # A phase counts on the rotor, whatever the orders of a torque count on.
        turned = {i for members in topology.phase_members for i in members[k]}
        counted += [
            (name, disk)
            for i, (name, disk, of_own_rotor) in enumerate(
                zip(seats.names, seats.disk, seats.of_own_rotor, strict=True)
            )
            if of_own_rotor or i in turned
        ]
    pulsating = zip(
        topology.load_names, topology.load_disk, topology.load_harmonics, strict=True
    )
    counted += [(name, disk) for name, disk, orders in pulsating if orders]
    for end, field in enumerate(OF_GEARS):
        gear_orders = zip(
            topology.mesh_names,
            topology.mesh_ends,
            getattr(topology, f"mesh_{field}"),
            strict=True,
        )
        counted += [(name, ends[end]) for name, ends, orders in gear_orders if orders]
    for name, disk in counted:
        rotor = topology.rotor[disk]
        if abs(new[rotor] / old[rotor] - 1.0) > RATIO_TOLERANCE:
            errors.append(
                f"{where}: the new radii change the speed of {name!r} from"
                f" {old[rotor]:.6g} to {new[rotor]:.6g} times the reference, so that"
                " its orders fit the cycle no more. Build the scene anew with these"
                " radii."
            )
    for index, name in enumerate(topology.mesh_names):
        old_periods = _periods(before.topology, old, index)
        new_periods = _periods(topology, new, index)
        if (
            topology.mesh_periods[index]
            and abs(new_periods / old_periods - 1.0) > RATIO_TOLERANCE
        ):
            errors.append(
                f"{where}: the new gears of mesh {name!r} have {new_periods:.6g} mesh"
                f" periods in a revolution of the reference, not {old_periods:.6g}, so"
                " that its orders fit no more. Build the scene anew with them."
            )
    for name, (a, b) in zip(topology.mesh_names, topology.mesh_ends, strict=True):
        mismatch = (
            new[topology.rotor[a]] * radius[a] / (new[topology.rotor[b]] * radius[b])
        )
        if abs(mismatch - 1.0) > RATIO_TOLERANCE:
            errors.append(
                f"{where}: the new radii lock the closed loop through mesh {name!r}:"
                f" its ratios multiply to {mismatch:.6g}, must be 1. Change all radii"
                " of the loop together."
            )
        teeth = [topology.teeth[disk] for disk in (a, b)]
        if (
            all(teeth)
            and abs(teeth[0] / teeth[1] * radius[b] / radius[a] - 1.0) > RATIO_TOLERANCE
        ):
            errors.append(
                f"{where}: the new radii of mesh {name!r} are"
                f" {radius[a]:g}:{radius[b]:g} m, but its teeth {teeth[0]}:{teeth[1]}."
                " Change both radii alike, or build the scene with other teeth."
            )
    if errors:
        raise SceneError(errors)
