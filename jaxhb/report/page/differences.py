"""What differs between two designs: numbers, words and tables of their elements, elements that one of them lacks."""

import dataclasses

import numpy as np

from jaxhb.excitation.gas import FAR
from jaxhb.report.page.parts import table
from jaxhb.report.text.columns import NONE, plain_number
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
    """A table of all that differs between two designs, or a sentence where nothing does, in a list."""
    both = train.topology, other.topology
    rows = _whole(*both)
    for name in dict.fromkeys([*both[0].elements, *both[1].elements]):
        own, another = (topology.elements.get(name) for topology in both)
        if own is None or another is None or own[0] != another[0]:
            cells = [NONE if one is None else one[0] for one in (own, another)]
            rows.append((f"{name}: {'another element' if own and another else 'in one design only'}", *cells, NONE))
            continue
        facts = facts_of(train, *own), facts_of(other, *another)
        found = [_row(name, own[0], field, *facts) for field in dict.fromkeys([*facts[0], *facts[1]])]
        rows += dict.fromkeys(row for row in found if row)  # a table of several columns is told once
    if rows:
        heads = ["number of the scene", "first design", "second", "unit"]
        return [table("What differs between the designs", rows, heads)]
    names = [field.name for field in dataclasses.fields(both[0]) if field.name not in BESIDE]
    if unlike := [name.replace("_", " ") for name in names if getattr(both[0], name) != getattr(both[1], name)]:
        return [f"Same numbers, tables and words of the elements, in another order or with other {', '.join(unlike)}."]
    return ["Nothing differs between the designs: no number, no table, no word, no element."]


def _whole(*both):
    """Rows on the scene as a whole."""
    rows = []
    for field, unit in WHOLE.items():
        values = [getattr(topology, field) for topology in both]
        if values[0] != values[1]:
            rows.append(
                (f"scene.{field}", *(NONE if value is None else f"{value:g}" for value in values), unit or NONE)
            )
    reference = [{t.disk_names[i] for i, r in enumerate(t.rotor) if r == t.reference_rotor} for t in both]
    # Any disk of a rotor may be its reference: rotors that share a disk are the same.
    if not reference[0] & reference[1]:
        rows.append(("scene.reference", *(", ".join(sorted(names)) for names in reference), NONE))
    return rows


def _row(name, kind, field, *facts):
    """What a table tells of a field of an element; None where both designs have the same."""
    given = [one.get(field) for one in facts]
    if any(isinstance(value, np.ndarray) for value in given):
        values = [np.zeros(0) if value is None else value for value in given]
        called = TABLED.get(field, field.partition(".")[0] if field.startswith("traces.") else field)
        cells = ["given" if value.size else NONE for value in values]
        return None if np.array_equal(*values) else (f"{called} of {name}: another table", *cells, NONE)
    if any(isinstance(value, str) for value in given):
        return None if given[0] == given[1] else (f"{name}.{field}", *(value or NONE for value in given), NONE)
    values = [ABSENT.get(field, 0.0) if value is None else value for value in given]
    if values[0] == values[1]:
        return None
    declared = declared_field(kind, field)
    optional = declared is not None and declared.default is None
    lacks = [value is None or (optional and value == 0) for value in given]
    cells = [NONE if lacking else said for lacking, said in zip(lacks, _told(values), strict=True)]
    span = declared.metadata.get("range") if declared is not None else None
    return (f"{name}.{field}", *cells, (span and span.unit) or NONE)


def _told(values):
    """Two numbers with as many digits as tell them apart."""
    for digits in (4, 8):
        told = [plain_number(value, digits) for value in values]
        if told[0] != told[1]:
            return told
    return [repr(value) for value in values]


def facts_of(train, kind, index):
    """All that a train has of an element: numbers (float), tables (array), words (str), by name."""
    numbers, found = getattr(train, {"mesh": "meshes"}.get(kind, f"{kind}s")), {}
    for declared in dataclasses.fields(numbers):
        vector = getattr(numbers, declared.name)
        if hasattr(vector, "seats"):
            found |= _inner(vector, declared.name, index)
        elif vector is not None and index < len(vector):
            found[declared.name] = vector[index]
    found |= _words(train.topology, kind, index)
    for name in found.keys() & {"harmonics", "gas_torque"}:  # zeros fill them up
        found[name] = found[name][: len(found[f"{kind}_harmonics"])]
    if "load_rpm" in found:  # speeds far away do
        found["load_rpm"] = found["load_rpm"][found["load_rpm"] < FAR]
    return {name: value if isinstance(value, str) else _plain(name, np.asarray(value)) for name, value in found.items()}


def _plain(field, value):
    """A number; or a table without the rows at its end that repeat the last, none that changes nothing."""
    if value.ndim == 0:
        return float(value)
    while len(value) > 1 and np.array_equal(value[-1], value[-2]):
        value = value[:-1]
    idle = len(value) <= 1 and np.all(value == np.asarray(IDLE.get(field, 0.0)))
    return value[:0].ravel() if idle else value


def _inner(numbers, outer, index):
    """What a table inside an element holds."""
    if index not in numbers.seats:
        return {}
    place = numbers.seats.index(index)
    fields = [declared.name for declared in dataclasses.fields(numbers) if not declared.metadata.get("static")]
    found = {f"{outer}.{name}": getattr(numbers, name)[place] for name in fields}
    if outer == "combustion":
        found[f"{outer}.by"] = "imep" if numbers.by_work[place] else "heat"
    if outer == "traces":  # rows that never count fill them up
        speeds, loads = numbers.sizes[place]
        parts = {"rpm": np.s_[:speeds], "load": np.s_[:loads], "pressure": np.s_[:speeds, :loads]}
        found = {f"{outer}.{name}": found[f"{outer}.{name}"][part].ravel() for name, part in parts.items()}
    return found


def _words(topology, kind, index):
    """Words and whole numbers of an element, and the disks that it sits on."""
    found = {"teeth": topology.teeth[index]} if kind == "disk" else {}
    for key, called in ((f"{kind}_disk", "disk"), (f"{kind}_ends", "between")):
        ends = getattr(topology, key, ())
        if index < len(ends):
            found[called] = ", ".join(topology.disk_names[i] for i in np.ravel(ends[index]))
    for key, (called, choices) in WORDS.items():
        if key.startswith(f"{kind}_"):
            value = getattr(topology, key)[index]
            found[called] = choices[value] if choices else str(value)
    harmonics = getattr(topology, f"{kind}_harmonics", ())
    return found | ({f"{kind}_harmonics": harmonics[index]} if index < len(harmonics) else {})
