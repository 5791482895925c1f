"""Reading and changing single numbers of a train by ``"NAME.FIELD"``, on the host or under tracing."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxhb._arrays import traced
from jaxhb.model import checks, hold
from jaxhb.model.elements import TABLES, SceneError
from jaxhb.model.graph import RATIO_TOLERANCE
from jaxhb.model.topology import suggestion
from jaxhb.model.varying import NEEDS

_TABLE_OF = {table: f"{table}s" for table in TABLES} | {"mesh": "meshes"}
_VARYING = {key: links for links, (key, _) in NEEDS.items()}
_LISTS = {("torque", "harmonics"): "torque_harmonics", ("cylinder", "gas_torque"): "cylinder_harmonics"}


def _locate(train, key: str):
    """Find table, field and index of ``"NAME.FIELD"``."""
    topology = train.topology
    where = topology.name or "scene"
    name, dot, field = key.rpartition(".")
    if not dot:
        raise SceneError(f"{where}: {key!r} names no field. Write 'NAME.FIELD', as 'hub.inertia'.")
    if name not in topology.elements:
        raise SceneError(f"{where}: there is no element {name!r} in {key!r}.{suggestion(name, topology.elements)}")
    table, index = topology.elements[name]
    fields = [f.name for f in dataclasses.fields(getattr(train, _TABLE_OF[table]))]
    if field not in fields:
        raise SceneError(f"{where}, [[{table}]] {name!r}: there is no field {field!r}.{suggestion(field, fields)}")
    return table, field, index


def _row(train, table, field, index):
    """The part of a row that the scene gave (harmonics are padded by zeros)."""
    row = getattr(getattr(train, _TABLE_OF[table]), field)[index]
    if (table, field) in _LISTS:
        return row[: len(getattr(train.topology, _LISTS[table, field])[index])]
    return row


def read(train, key: str):
    """Read one number; see :meth:`DriveTrain.value`."""
    row = _row(train, *_locate(train, key))
    return float(row) if isinstance(row, np.floating) else row


def replace(train, values):
    """Change numbers; see :meth:`DriveTrain.replace`."""
    errors, changes = [], {}
    for key, value in values.items():
        try:
            table, field, index = _locate(train, key)
        except SceneError as error:
            errors += error.sentences
            continue
        errors += _value_errors(train, key, table, field, index, value)
        changes.setdefault((table, field), {})[index] = value
    if errors:
        raise SceneError(errors)
    tables = {}
    for (table, field), new in changes.items():
        attribute = _TABLE_OF[table]
        old = tables.get(attribute, getattr(train, attribute))
        vector = _set(getattr(old, field), new)
        tables[attribute] = dataclasses.replace(old, **{field: vector})
    changed = dataclasses.replace(train, **tables)
    if ("disk", "radius") in changes:
        _check_ratios(train, changed)
    errors = hold.train_errors(changed) if hold.touches(changes) else []
    if errors:
        raise SceneError(errors)
    return changed


def without_backlash(train):
    """The same train with every mesh in contact all cycle."""
    topology, meshes = train.topology, train.meshes
    linear = (False,) * len(topology.mesh_names)
    return dataclasses.replace(
        train,
        topology=dataclasses.replace(topology, mesh_backlash=linear),
        meshes=dataclasses.replace(meshes, backlash=0.0 * meshes.backlash),
    )


def _set(vector, new):
    """Put values at their indices: on the host by a copy, under tracing in one scatter."""
    indices = np.array(list(new))
    plain = isinstance(vector, np.ndarray) and not traced(new)
    if plain:
        vector = vector.copy()
        for index, value in new.items():
            value = np.asarray(value, dtype=np.float64)
            vector[(index, *(slice(n) for n in value.shape))] = value
        return vector
    import jax.numpy as jnp

    vector = jnp.asarray(vector)
    if vector.ndim == 1:
        return vector.at[indices].set(jnp.stack([jnp.asarray(v, dtype=jnp.float64) for v in new.values()]))
    for index, value in new.items():
        value = jnp.asarray(value, dtype=jnp.float64)
        vector = vector.at[(index, *(slice(n) for n in value.shape))].set(value)
    return vector


def within_range(train):
    """Whether every number lies in the range of its field, a bool that may be traced; nan does not count as outside."""
    import jax.numpy as jnp

    inside = [jnp.array(True)]
    for table, attribute in _TABLE_OF.items():
        for declared in dataclasses.fields(TABLES[table]):
            limits, values = declared.metadata.get("range"), getattr(getattr(train, attribute), declared.name, None)
            if limits is None or values is None:
                continue
            values = jnp.asarray(values)
            outside = jnp.zeros(values.shape, dtype=bool)
            for wrong, limit in ((jnp.less_equal, limits.above), (jnp.less, limits.least)):
                outside |= False if limit is None else wrong(values, limit)
            for wrong, limit in ((jnp.greater_equal, limits.below), (jnp.greater, limits.most)):
                outside |= False if limit is None else wrong(values, limit)
            zero_if_absent = declared.default is None and declared.name not in ("epsilon", "transition")
            inside.append(~jnp.any(outside & (values != 0.0) if zero_if_absent else outside))
    return jnp.all(jnp.stack(inside))


def _value_errors(train, key, table, field, index, value) -> list[str]:
    """Check shape and, where it is concrete, range of a new value."""
    where = f"{train.topology.name or 'scene'}, replace {key!r}"
    wanted = np.shape(_row(train, table, field, index))
    try:
        found = np.shape(value)
    except ValueError:
        found = None
    if found != wanted:
        return [f"{where}: the value has shape {found}, must have {wanted}. Map over a batch with jax.vmap."]
    missing = _has_no_effect(train.topology, table, field, index)
    if traced(value):
        return [f"{where}: {missing}"] if missing else []
    number = np.asarray(value)
    if number.dtype.kind not in "fiu" or not np.all(np.isfinite(number)):
        return [f"{where}: the value is {value!r}, must be finite and real."]
    if missing and not _is_same(train, table, field, index, number):
        return [f"{where}: {missing}"]
    declared = {f.name: f for f in dataclasses.fields(TABLES[table])}.get(field)
    if declared is None or wanted or declared.metadata["kind"] != "number":
        return []
    if declared.default is None and number == 0.0 and _is_absent(train, table, field, index):
        return []
    return [f"{where}: {text}" for text in checks.value_errors(declared, float(number))]


def _has_no_effect(topology, table, field, index) -> str:
    """Say why a number has no effect in a train of this topology; empty where it has one."""
    if table == "mesh" and field in ("backlash", "epsilon", "transition") and not topology.mesh_backlash[index]:
        return "the mesh has no backlash, it is always in contact. Build the scene with a backlash."
    if field in _VARYING:
        links = _VARYING[field]
        if index + (len(topology.shaft_names) if table == "damper" else 0) not in getattr(topology, links):
            return f"it has no effect, as the {table} was built without {field}. Build the scene with it."
    if table != "cylinder":
        return ""
    traced, moves = topology.cylinder_source[index] == "pressure", topology.cylinder_inertia[index] > 0
    if field in ("bore", "ambient_pressure", "pressure") and not traced:
        return "it has no effect, as the cylinder has no pressure table. Build the scene with a pressure."
    if field in ("gas_torque_mean", "gas_torque") and traced:
        return "the gas torque comes from the pressure table. Change pressure, or build the scene without it."
    if (field == "reciprocating_mass" and not moves) or (field in ("stroke", "rod") and not (moves or traced)):
        return (
            "it has no effect, as the cylinder was built without inertia torque. Build the scene with stroke, rod"
            " and reciprocating_mass (orders at least 1, whole harmonics of the cycle)."
        )
    return ""


def _is_same(train, table, field, index, number) -> bool:
    """Tell whether a concrete value is the present one."""
    row = _row(train, table, field, index)
    return not traced(row) and bool(np.all(np.asarray(row) == number))


def _is_absent(train, table, field, index) -> bool:
    """Tell whether the scene gave no such number (it stands as 0)."""
    row = _row(train, table, field, index)
    return not traced(row) and bool(row == 0.0)


def _check_ratios(before, after):
    """Refuse concrete radii that lock a loop or change the speed of a rotor with orders of its own."""
    topology, radius = after.topology, after.disks.radius
    if traced(radius):
        return
    old, new = (_host_ratios(topology, np.asarray(train.disks.radius)) for train in (before, after))
    errors, where = [], topology.name or "scene"
    own = list(zip(topology.cylinder_names, topology.cylinder_disk, strict=True))
    given = zip(topology.torque_names, topology.torque_disk, topology.torque_own, strict=True)
    for name, disk in own + [(name, disk) for name, disk, is_own in given if is_own]:
        rotor = topology.rotor[disk]
        if abs(new[rotor] / old[rotor] - 1.0) > RATIO_TOLERANCE:
            errors.append(
                f"{where}: the new radii change the speed of {name!r} from {old[rotor]:.6g} to {new[rotor]:.6g} times"
                " the reference, so that its orders fit the cycle no more. Build the scene anew with these radii."
            )
    radius = np.asarray(radius)
    for name, (a, b) in zip(topology.mesh_names, topology.mesh_ends, strict=True):
        slip = new[topology.rotor[a]] * radius[a] / (new[topology.rotor[b]] * radius[b])
        if abs(slip - 1.0) > RATIO_TOLERANCE:
            errors.append(
                f"{where}: the new radii lock the closed loop through mesh {name!r}: its ratios multiply to"
                f" {slip:.6g}, must be 1. Change all radii of the loop together."
            )
        teeth = [topology.teeth[disk] for disk in (a, b)]
        if all(teeth) and abs(teeth[0] / teeth[1] * radius[b] / radius[a] - 1.0) > RATIO_TOLERANCE:
            errors.append(
                f"{where}: the new radii of mesh {name!r} are {radius[a]:g}:{radius[b]:g} m, but its teeth"
                f" {teeth[0]}:{teeth[1]}. Change both radii alike, or build the scene with other teeth."
            )
    if errors:
        raise SceneError(errors)


def _host_ratios(topology, radius):
    """Speed ratios on the host."""
    return np.array([np.prod([radius[a] / radius[b] for a, b in path]) for path in topology.rotor_path])
