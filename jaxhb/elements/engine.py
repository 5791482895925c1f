"""One ``[engine]`` table for all cylinders of an engine: it makes their
``[[cylinder]]`` entries.
"""

import dataclasses
import math
from collections import Counter
from dataclasses import dataclass, replace

from jaxhb.elements.elements import (
    CrankSlider,
    Cylinder,
    choice,
    declared,
    quantity,
    shown,
    suggestion,
)
from jaxhb.elements.value_checks import field_errors, number_like


@dataclass(frozen=True, kw_only=True)
class Engine(CrankSlider):
    """``[engine]``: what its cylinders have in common, where they sit and when they
    fire.

    Cylinders in line are called 1, 2, ...; of a vee engine, which has a ``bank_angle``,
    A1, A2, ..., B1, B2, ... ``disks`` names the disk of every cylinder in this order,
    in a vee engine with common crank pins that of every throw. ``firing_order`` names
    the cylinders as they fire. They fire at equal intervals; in a vee engine those of
    bank A do, and each cylinder of bank B comes to top dead centre ``bank_angle`` after
    that of bank A on its throw (negative: before). ``firing = "even"`` (split crank
    pins) or ``firing_intervals``, from each firing to the next in deg, say otherwise.
    The first cylinder of the firing order fires at ``firing_angle``.

    A field of a cylinder that is a number, or true or false, may be a list with one
    value for each cylinder; those of ``firing_angle`` are added to the angles of the
    firing order.
    """

    cylinders: int = quantity("", kind="count", least=1.0, most=1000.0)
    disks: tuple = declared("list")
    firing_order: tuple = declared("list")
    bank_angle: float | None = quantity("deg", None, least=-180.0, most=180.0)
    stroke_cycle: int = quantity("", 4, kind="count", least=1.0)
    firing: str = choice("crank", "even")
    firing_intervals: tuple | None = declared("list", None)


_COMMON = {
    f.name: f
    for f in dataclasses.fields(CrankSlider)
    if f.name not in ("name", "firing_angle")
}
_OWN = (
    "cylinders",
    "disks",
    "firing_order",
    "bank_angle",
    "stroke_cycle",
    "firing",
    "firing_intervals",
)
_DEFAULTS = {f.name: f.default for f in dataclasses.fields(Engine)}


def cylinder_rows(engine: dict) -> list[dict]:
    """Make the rows of the ``[[cylinder]]`` entries from the keys of a sound
    ``[engine]``.
    """
    given = _DEFAULTS | engine
    labels = _labels(given)
    angles = firing_angles(given)
    disks = list(given["disks"])
    # Where disks are throws, bank B sits on those of bank A.
    disks = disks * (len(labels) // len(disks))
    later = given["firing_angle"]
    rows = []
    for i, label in enumerate(labels):
        row = {"name": f"{engine.get('name') or 'cylinder'} {label}", "disk": disks[i]}
        row |= {
            key: _of_cylinder(f, engine[key], i)
            for key, f in _COMMON.items()
            if key in engine
        }
        row["firing_angle"] = angles[label] + (
            later[i] if isinstance(later, tuple | list) else later
        )
        burning = row.get("combustion")
        strokes = {"stroke_cycle": given["stroke_cycle"]}
        if burning:
            row["combustion"] = (
                burning | strokes
                if isinstance(burning, dict)
                else replace(burning, **strokes)
            )
        rows.append(row)
    return rows


def cylinders(engine: Engine) -> list[Cylinder]:
    """Make the cylinders of a sound engine."""
    return [Cylinder(**row) for row in cylinder_rows(vars(engine))]


def _of_cylinder(f, value, i):
    """The value of cylinder i where there is one for each."""
    if f.metadata["kind"] in ("number", "flag") and isinstance(value, tuple | list):
        return value[i]
    if f.metadata["kind"] == "table" and value is not None:
        inner = {g.name: g for g in dataclasses.fields(f.metadata["of"])}
        values = value if isinstance(value, dict) else vars(value)
        picked = {key: _of_cylinder(inner[key], v, i) for key, v in values.items()}
        return picked if isinstance(value, dict) else type(value)(**picked)
    return value


def _labels(given) -> list[str]:
    """Cylinders in the order of the lists: 1, 2, ... or A1, ..., B1, ..."""
    count = int(given["cylinders"])
    if given["bank_angle"] is None:
        return [str(k + 1) for k in range(count)]
    return [f"{bank}{k + 1}" for bank in "AB" for k in range(count // 2)]


def firing_angles(given: dict) -> dict[str, float]:
    """Firing angle (deg) of every cylinder, counted from the first of the firing
    order.
    """
    order = [str(label) for label in given["firing_order"]]
    cycle = 180.0 * given["stroke_cycle"]
    if given["firing_intervals"] is not None:
        passed = [math.fsum(given["firing_intervals"][:k]) for k in range(len(order))]
        return dict(zip(order, passed, strict=True))
    even = {label: k * cycle / len(order) for k, label in enumerate(order)}
    if given["bank_angle"] is None or given["firing"] == "even":
        return even
    first = [label for label in order if label[0] == "A"]
    angles = {label: k * cycle / len(first) for k, label in enumerate(first)}
    begin = even[first[0]]
    for label in order:
        if label[0] == "B":
            passing = angles["A" + label[1:]] + given["bank_angle"]
            # A four-stroke cylinder is at top dead centre twice a cycle, and fires
            # where that is nearer to even firing.
            turns = [
                passing + 360.0 * turn
                for turn in range(int(given["stroke_cycle"]) // 2)
            ]
            apart = [
                abs((turn + begin - even[label] + cycle / 2) % cycle - cycle / 2)
                for turn in turns
            ]
            angles[label] = turns[apart.index(min(apart))]
    start = angles[order[0]]
    return {label: (angles[label] - start) % cycle for label in order}


def engine_errors(engine: Engine, where: str, disk_names) -> list[str]:
    """Find what is wrong with an engine by itself; ``disk_names`` are the disks there
    are.
    """
    found = {
        f.name: _field_errors(engine, where, f, engine)
        for f in dataclasses.fields(engine)
    }
    errors = [text for sentences in found.values() for text in sentences]
    own = [] if any(found[name] for name in _OWN) else _own_errors(engine, disk_names)
    return errors + [f"{where}: {text}" for text in own]


def _own_errors(engine, disk_names) -> list[str]:
    """Check what makes the cylinders of an engine whose own fields are sound by
    themselves.
    """
    texts = []
    if engine.stroke_cycle not in (2, 4):
        texts.append(
            f"stroke_cycle is {engine.stroke_cycle:g}, must be 2 or 4. Correct it."
        )
    if engine.bank_angle is not None and engine.cylinders % 2:
        texts.append(
            f"bank_angle is given for {engine.cylinders:g} cylinders, must be for an"
            " even number of them."
        )
    if texts:
        return texts
    labels = _labels(vars(engine))
    texts += _disk_errors(engine, len(labels), disk_names)
    found = _order_errors([str(label) for label in engine.firing_order], labels)
    found += _interval_errors(engine, len(labels))
    # Of a faulty firing order there are no angles.
    texts += found or _bank_errors(engine)
    # 4 is also what an absent key reads: only another number contradicts the engine.
    strokes = getattr(engine.combustion, "stroke_cycle", 4)
    if number_like(strokes) and strokes not in (4, engine.stroke_cycle):
        texts.append(
            f"combustion: stroke_cycle is {strokes:g}, that of the engine"
            f" {engine.stroke_cycle:g}. Leave it out."
        )
    return texts


def _field_errors(engine, where, f, holder) -> list[str]:
    """Sentences on a field of an engine, of its combustion on each field; lists hold
    one value for each cylinder.
    """
    value = getattr(holder, f.name)
    if f.metadata["kind"] == "table" and isinstance(value, f.metadata["of"]):
        fields = dataclasses.fields(value)
        return [
            text
            for g in fields
            for text in _field_errors(engine, f"{where}, {f.name}", g, value)
        ]
    per_cylinder = f.name in _COMMON or f.name == "firing_angle" or holder is not engine
    if not (
        per_cylinder
        and f.metadata["kind"] in ("number", "flag")
        and isinstance(value, tuple | list)
    ):
        return field_errors(where, f, value) or []
    if not number_like(engine.cylinders):
        return []
    if len(value) != engine.cylinders:
        return [
            f"{where}: {f.name} has {len(value)} values, must have one, or"
            f" {engine.cylinders}: one for each cylinder."
        ]
    return [
        text
        for k, v in enumerate(value)
        for text in field_errors(f"{where}, value {k + 1}", f, v) or []
    ]


def _disk_errors(engine, count, disk_names) -> list[str]:
    vee = engine.bank_angle is not None
    allowed = (count // 2, count) if vee else (count,)
    if len(engine.disks) not in allowed:
        one = (
            f"{count // 2} (one for each throw) or {count} (one for each cylinder)"
            if vee
            else f"{count}"
        )
        return [f"disks has {len(engine.disks)} names, must have {one}."]
    unknown = [name for name in engine.disks if name not in disk_names]
    return [
        *dict.fromkeys(
            f"disks: there is no disk {shown(n)}.{suggestion(n, disk_names)}"
            for n in unknown
        )
    ]


def _order_errors(order, labels) -> list[str]:
    """Check that a firing order names every cylinder once."""
    half = labels[len(labels) // 2 - 1]
    range_of = (
        f"1 to {labels[-1]}"
        if labels[0] == "1"
        else f"A1 to {half} and B1 to B{half[1:]}"
    )
    errors = [
        f"firing_order names {name!r}, which is no cylinder: they are {range_of}."
        " Correct it."
        for name in dict.fromkeys(order)
        if name not in labels
    ]
    errors += [
        f"firing_order names {name!r} {n} times, must name it once."
        for name, n in Counter(order).items()
        if n > 1
    ]
    lacking = [name for name in labels if name not in order]
    if lacking:
        errors.append(
            f"firing_order leaves out {', '.join(map(repr, lacking))}. Name every"
            " cylinder once."
        )
    return errors


def _interval_errors(engine, count) -> list[str]:
    intervals = engine.firing_intervals
    cycle = 180.0 * engine.stroke_cycle
    if intervals is None:
        return []
    if engine.firing == "even":
        return [
            "firing_intervals and firing = 'even' are both given. Keep one of them."
        ]
    if (
        not all(number_like(v) and math.isfinite(v) and v >= 0 for v in intervals)
        or len(intervals) != count
    ):
        return [
            f"firing_intervals is {shown(list(intervals))}, must be {count} angles of"
            " at least 0 deg."
        ]
    total = math.fsum(intervals)
    if abs(total - cycle) > 1e-6:
        return [
            f"firing_intervals add up to {total:g} deg, must be {cycle:g} deg, one"
            " cycle. Correct them."
        ]
    return []


def _bank_errors(engine) -> list[str]:
    """Check that the cylinders fire in their order where the crank and the bank angle
    say when.
    """
    angles = firing_angles(vars(engine))
    wanted = [str(label) for label in engine.firing_order]
    found = sorted(wanted, key=lambda label: round(angles[label], 6))
    if found == wanted:
        return []
    return [
        f"with the bank angle of {engine.bank_angle:g} deg the cylinders fire in the"
        f" order {', '.join(found)}, not in that of firing_order. Correct one of them,"
        " or give firing = 'even' or firing_intervals."
    ]
