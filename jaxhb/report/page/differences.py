"""What differs between two designs: numbers, words and tables of their elements, elements that one of them lacks."""

import dataclasses

import numpy as np

from jaxhb.excitation.gas import FAR
from jaxhb.report.text.columns import NONE, Table, plain_number
from jaxhb.train.changes import declared_field

WORDS = {
    "mesh_internal": ("kind", ("external", "internal")),
    "mesh_damping_law": ("damping_law", None),
    "torque_own": ("orders_of", ("reference", "own")),
    "cylinder_series": ("kinematics", ("exact", "mendes2008")),
    "cylinder_fires": ("fires", ("no", "yes")),
    "cylinder_source": ("gas torque from", None),
    "cylinder_gas_revolutions": ("revolutions of the gas cycle", None),
    "cylinder_inertia": ("orders of the inertia torque", None),
    "cylinder_gas": ("orders of the gas torque", None),
}
"""What the words of an element are called, and what stands for no and yes."""

TABLED = {"load_rpm": "load", "load_share": "load", "scale_rpm": "scale", "scale_factor": "scale"}
TABLED |= {"cylinder_harmonics": "gas_torque", "torque_harmonics": "harmonics", "load_harmonics": "harmonics"}
"""What the tables of an element are called in a scene."""

ABSENT = {"gas_factor": 1.0, "speed_exponent": 2.0}
"""Numbers of an element that gives none."""

IDLE = {"over_hz": (0.0, 1.0, 1.0), "over_amplitude": (0.0, 1.0, 1.0), "load_share": 1.0, "scale_factor": 1.0}
"""The one row of a table that an element has where others of its kind have rows."""

WHOLE = {"revolutions_per_cycle": "", "rated_rpm": "rpm"}
BESIDE = ("name", "scenarios", "tune")
"""What of a scene changes no motion."""


def differences(train, other):
    """A table of all that differs between two designs, in a list with what it cannot tell.

    Parameters
    ----------
    train, other : DriveTrain

    Returns
    -------
    list of Table and str
    """
    mine, its = train.topology.elements, other.topology.elements
    rows = _whole(train.topology, other.topology)
    for name in dict.fromkeys([*mine, *its]):
        own, another = mine.get(name), its.get(name)
        if own is None or another is None or own[0] != another[0]:
            cells = [NONE if one is None else one[0] for one in (own, another)]
            rows.append([f"{name}: {'another element' if own and another else 'in one design only'}", *cells, NONE])
        else:
            rows += _element(name, own[0], [facts_of(train, *own), facts_of(other, *another)])
    if rows:
        heads = ["number of the scene", "first design", "second", "unit"]
        return [Table("What differs between the designs", heads, list(zip(*rows, strict=True)), left=(3,))]
    if unlike := _unlike(train.topology, other.topology):
        return [f"Same numbers, tables and words of the elements, in another order or with other {', '.join(unlike)}."]
    return ["Nothing differs between the designs: no number, no table, no word, no element."]


def _whole(mine, its):
    """Rows on the scene as a whole."""
    rows = []
    for field, unit in WHOLE.items():
        both = [getattr(topology, field) for topology in (mine, its)]
        if both[0] != both[1]:
            rows.append([f"scene.{field}", *(NONE if value is None else f"{value:g}" for value in both), unit or NONE])
    reference = [{t.disk_names[i] for i, r in enumerate(t.rotor) if r == t.reference_rotor} for t in (mine, its)]
    # Any disk of a rotor may be its reference: rotors that share a disk are the same.
    if not reference[0] & reference[1]:
        rows.append(["scene.reference", *(", ".join(sorted(names)) for names in reference), NONE])
    return rows


def _element(name, table, both):
    """Rows on one element that both designs have."""
    rows, tables = [], {}
    for field in dict.fromkeys(key for facts in both for key in facts):
        values = [facts.get(field, ABSENT.get(field, 0.0)) for facts in both]
        called = TABLED.get(field, field.partition(".")[0] if field.startswith("traces.") else field)
        if all(isinstance(value, float) for value in values):
            if values[0] != values[1]:
                rows.append([f"{name}.{field}", *_numbers(table, field, values, both), _unit(table, field)])
        elif any(isinstance(value, str) for value in values):
            if values[0] != values[1]:
                rows.append([f"{name}.{field}", *(value if isinstance(value, str) else NONE for value in values), NONE])
        elif not _alike(field, *values):
            tables[called] = [f"{called} of {name}: another table", *_given(field, values), NONE]
    return rows + list(tables.values())


def _numbers(table, field, values, both):
    """Two numbers in words; a dash for one that is not given."""
    declared = declared_field(table, field)
    may_lack = declared is not None and declared.default is None
    lacking = [field not in facts or (may_lack and value == 0) for facts, value in zip(both, values, strict=True)]
    return [NONE if lacks else said for lacks, said in zip(lacking, _told(values), strict=True)]


def _told(values):
    """Two numbers with as many digits as tell them apart."""
    for digits in (4, 8):
        told = [plain_number(value, digits) for value in values]
        if told[0] != told[1]:
            return told
    return [repr(value) for value in values]


def _unit(table, field):
    declared = declared_field(table, field)
    span = declared.metadata.get("range") if declared is not None else None
    return (span.unit if span is not None else "") or NONE


def _given(field, values):
    """Whether there is a table."""
    return ["given" if np.size(_neutral(field, _trimmed(value))) else NONE for value in values]


def _alike(field, one, other):
    """Whether two tables are the same but for the rows that fill them up; none is one that changes nothing."""
    one, other = _neutral(field, _trimmed(one)), _neutral(field, _trimmed(other))
    return one.shape == other.shape and bool(np.array_equal(one, other))


def _trimmed(value):
    """A table without the rows at its end that repeat the last."""
    rows = np.asarray(value, float)
    last = len(rows) if rows.ndim else 0
    while last > 1 and np.array_equal(rows[last - 1], rows[last - 2]):
        last -= 1
    return rows[:last] if rows.ndim else rows[None][:0]


def _neutral(field, rows):
    """Nothing of a table of one row that changes nothing."""
    alone = len(rows) == 1 and np.array_equal(np.ravel(rows[0]), np.ravel(IDLE.get(field, np.zeros_like(rows[0]))))
    return np.zeros(0) if alone or not np.size(rows) else rows


def facts_of(train, table, index):
    """All that a train has of an element: numbers (float), tables (array), words (str), by name."""
    numbers = getattr(train, {"mesh": "meshes"}.get(table, f"{table}s"))
    found = {}
    for declared in dataclasses.fields(numbers):
        vector = getattr(numbers, declared.name)
        if vector is None:
            continue
        if hasattr(vector, "seats"):
            found |= _inner(vector, declared.name, index)
        elif index < len(vector):
            found[declared.name] = _fact(vector[index])
    found |= _words(train.topology, table, index)
    for name in found.keys() & {"harmonics", "gas_torque"}:  # zeros fill them up
        found[name] = found[name][: len(found[f"{table}_harmonics"])]
    if "load_rpm" in found:  # speeds far away do
        found["load_rpm"] = found["load_rpm"][found["load_rpm"] < FAR]
    return found


def _fact(value):
    return float(value) if np.ndim(value) == 0 else np.asarray(value)


def _inner(numbers, outer, index):
    """What a table inside an element holds."""
    if index not in numbers.seats:
        return {}
    place, found = numbers.seats.index(index), {}
    for declared in dataclasses.fields(numbers):
        if declared.metadata.get("static"):
            continue
        found[f"{outer}.{declared.name}"] = _fact(getattr(numbers, declared.name)[place])
    if outer == "combustion":
        found[f"{outer}.by"] = "imep" if numbers.by_work[place] else "heat"
    if outer == "traces":  # rows that never count fill them up
        speeds, loads = numbers.sizes[place]
        parts = {"rpm": np.s_[:speeds], "load": np.s_[:loads], "pressure": np.s_[:speeds, :loads]}
        found = {f"{outer}.{name}": found[f"{outer}.{name}"][part].ravel() for name, part in parts.items()}
    return found


def _words(topology, table, index):
    """Words and whole numbers of an element, and the disks that it sits on."""
    found, names = {}, topology.disk_names
    if table == "disk":
        found["teeth"] = float(topology.teeth[index])
    for key in (f"{table}_disk", f"{table}_ends"):
        ends = getattr(topology, key, ())
        if index < len(ends):
            found["disk" if key.endswith("disk") else "between"] = ", ".join(names[i] for i in np.ravel(ends[index]))
    for key, (called, choices) in WORDS.items():
        if key.startswith(f"{table}_"):
            value = getattr(topology, key)[index]
            found[called] = choices[value] if choices else str(value)
    harmonics = getattr(topology, f"{table}_harmonics", ())
    if index < len(harmonics):
        found[f"{table}_harmonics"] = np.array(harmonics[index], float)
    return found


def _unlike(mine, its):
    """Fields in which two topologies differ that change a motion."""
    names = (field.name for field in dataclasses.fields(mine) if field.name not in BESIDE)
    return [name.replace("_", " ") for name in names if getattr(mine, name) != getattr(its, name)]
