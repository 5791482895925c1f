"""One ``[engine]`` table for all cylinders of an engine: it makes their
``[[cylinder]]`` entries.
"""

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from jaxhb.elements.declared import choice, declared, quantity
from jaxhb.elements.excitations.crank_slider import (
    Combustion,
    CrankSlider,
    Cylinder,
)
from jaxhb.elements.sentences import shown, suggestion
from jaxhb.elements.values import field_errors, number_like, several_given


@dataclass(frozen=True, kw_only=True)
class Engine(CrankSlider):
    """``[engine]``: data that its cylinders share, where they sit and when they fire.

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
    firing_intervals: tuple | None = declared("list", None, unit="deg")


_COMMON = {
    f.name: f
    for f in dataclasses.fields(CrankSlider)
    if f.name not in ("name", "firing_angle")
}
_OF_ENGINE = (
    "cylinders",
    "disks",
    "firing_order",
    "bank_angle",
    "stroke_cycle",
    "firing",
    "firing_intervals",
)
# Tables of a cylinder whose strokes of a cycle are those of the engine
_WITH_STROKES = ("combustion", "tangential_pressure")
_DEFAULTS: dict[str, Any] = {f.name: f.default for f in dataclasses.fields(Engine)}


def cylinder_rows(engine: dict[str, Any]) -> list[dict[str, Any]]:
    """Make the rows of the ``[[cylinder]]`` entries from the keys of a sound
    ``[engine]``.
    """
    settings = _DEFAULTS | engine
    labels = _labels(settings)
    angles = firing_angles(settings)
    disks = list(settings["disks"])
    # Where disks are throws, bank B sits on those of bank A.
    disks = disks * (len(labels) // len(disks))
    offset = settings["firing_angle"]
    rows = []
    for i, label in enumerate(labels):
        row = {"name": f"{engine.get('name') or 'cylinder'} {label}", "disk": disks[i]}
        row |= {
            key: _of_cylinder(field, engine[key], i)
            for key, field in _COMMON.items()
            if key in engine
        }
        own_offset = offset[i] if isinstance(offset, tuple | list) else offset
        row["firing_angle"] = angles[label] + own_offset
        stroke_cycle = settings["stroke_cycle"]
        for name in _WITH_STROKES:
            table = row.get(name)
            if isinstance(table, dict) and table:
                row[name] = table | {"stroke_cycle": stroke_cycle}
            elif table:
                row[name] = replace(table, stroke_cycle=stroke_cycle)
        rows.append(row)
    return rows


def cylinders(engine: Engine) -> list[Cylinder]:
    """Make the cylinders of a sound engine."""
    return [Cylinder(**row) for row in cylinder_rows(vars(engine))]


def _of_cylinder(field: dataclasses.Field, value: Any, i: int) -> Any:
    """Value of cylinder ``i`` where a field has one for each, else the value of all."""
    if field.metadata["kind"] in ("number", "flag") and isinstance(value, tuple | list):
        return value[i]
    if field.metadata["kind"] == "table" and value is not None:
        inner_fields = {
            inner_field.name: inner_field
            for inner_field in dataclasses.fields(field.metadata["of"])
        }
        values = value if isinstance(value, dict) else vars(value)
        picked = {
            key: _of_cylinder(inner_fields[key], inner_value, i)
            for key, inner_value in values.items()
        }
        return picked if isinstance(value, dict) else type(value)(**picked)
    return value


def _labels(settings: Mapping[str, Any]) -> list[str]:
    """Labels of the cylinders in the order of the lists: 1, 2, ... or A1, ..., B1,
    ...
    """
    count = int(settings["cylinders"])
    if settings["bank_angle"] is None:
        return [str(k + 1) for k in range(count)]
    return [f"{bank}{k + 1}" for bank in "AB" for k in range(count // 2)]


def firing_angles(settings: Mapping[str, Any]) -> dict[str, float]:
    """Firing angle (deg) of every cylinder, counted from the first of the firing
    order.
    """
    order = [str(label) for label in settings["firing_order"]]
    cycle = 180.0 * settings["stroke_cycle"]
    if settings["firing_intervals"] is not None:
        angles_in_order = [
            math.fsum(settings["firing_intervals"][:k]) for k in range(len(order))
        ]
        return dict(zip(order, angles_in_order, strict=True))
    even_angles = {label: k * cycle / len(order) for k, label in enumerate(order)}
    if settings["bank_angle"] is None or settings["firing"] == "even":
        return even_angles
    bank_a = [label for label in order if label[0] == "A"]
    angles = {label: k * cycle / len(bank_a) for k, label in enumerate(bank_a)}
    first_angle = even_angles[bank_a[0]]
    for label in order:
        if label[0] == "B":
            dead_centre = angles["A" + label[1:]] + settings["bank_angle"]
            # A four-stroke cylinder is at top dead centre twice a cycle, and fires
            # where that is nearer to even firing.
            dead_centres = [
                dead_centre + 360.0 * turn
                for turn in range(int(settings["stroke_cycle"]) // 2)
            ]
            distances = [
                abs(
                    (angle + first_angle - even_angles[label] + cycle / 2) % cycle
                    - cycle / 2
                )
                for angle in dead_centres
            ]
            angles[label] = dead_centres[distances.index(min(distances))]
    start = angles[order[0]]
    return {label: (angles[label] - start) % cycle for label in order}


def engine_errors(engine: Engine, where: str, disk_names: Sequence[str]) -> list[str]:
    """Find everything wrong with an engine by itself; ``disk_names`` are those of the
    train.
    """
    by_field = {
        field.name: _field_errors(engine, where, field, engine)
        for field in dataclasses.fields(engine)
    }
    errors = [text for sentences in by_field.values() for text in sentences]
    faulty = any(by_field[name] for name in _OF_ENGINE)
    together = [] if faulty else _together_errors(engine, disk_names)
    return errors + [f"{where}: {text}" for text in together]


def _together_errors(engine: Engine, disk_names: Sequence[str]) -> list[str]:
    """Check the fields that make the cylinders of an engine against each other, where
    each is sound by itself.
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
    firing_errors = _order_errors([str(label) for label in engine.firing_order], labels)
    firing_errors += _interval_errors(engine, len(labels))
    # A faulty firing order has no angles.
    texts += firing_errors or _bank_errors(engine)
    for name in _WITH_STROKES:
        # An absent key reads 4 as well: only another number contradicts the engine.
        strokes = getattr(getattr(engine, name), "stroke_cycle", 4)
        if number_like(strokes) and strokes not in (4, engine.stroke_cycle):
            texts.append(
                f"{name}: stroke_cycle is {strokes:g}, that of the engine"
                f" {engine.stroke_cycle:g}. Leave it out."
            )
    return texts


def _field_errors(
    engine: Engine, where: str, field: dataclasses.Field, holder: Engine | Combustion
) -> list[str]:
    """Sentences on a field of an engine, of its combustion on each field; lists hold
    one value for each cylinder.
    """
    value = getattr(holder, field.name)
    if field.metadata["kind"] == "table" and isinstance(value, field.metadata["of"]):
        fields = dataclasses.fields(value)
        return [
            text
            for inner_field in fields
            for text in _field_errors(
                engine, f"{where}, {field.name}", inner_field, value
            )
        ]
    per_cylinder = (
        field.name in _COMMON or field.name == "firing_angle" or holder is not engine
    )
    if not (
        per_cylinder
        and field.metadata["kind"] in ("number", "flag")
        and isinstance(value, tuple | list)
    ):
        return field_errors(where, field, value) or []
    if not number_like(engine.cylinders):
        return []
    if len(value) != engine.cylinders:
        return [
            f"{where}: {field.name} has {len(value)} values, must have one, or"
            f" {engine.cylinders}: one for each cylinder."
        ]
    return [
        text
        for k, own_value in enumerate(value)
        for text in field_errors(f"{where}, value {k + 1}", field, own_value) or []
    ]


def _disk_errors(engine: Engine, count: int, disk_names: Sequence[str]) -> list[str]:
    """Check that an engine names disks of the train, one for each cylinder or throw."""
    vee = engine.bank_angle is not None
    allowed = (count // 2, count) if vee else (count,)
    if len(engine.disks) not in allowed:
        expected = (
            f"{count // 2} (one for each throw) or {count} (one for each cylinder)"
            if vee
            else f"{count}"
        )
        return [f"disks has {len(engine.disks)} names, must have {expected}."]
    unknown = [name for name in engine.disks if name not in disk_names]
    return [
        *dict.fromkeys(
            f"disks: there is no disk {shown(name)}.{suggestion(name, disk_names)}"
            for name in unknown
        )
    ]


def _order_errors(order: Sequence[str], labels: Sequence[str]) -> list[str]:
    """Check that a firing order names every cylinder once."""
    last_of_a = labels[len(labels) // 2 - 1]
    all_labels = (
        f"1 to {labels[-1]}"
        if labels[0] == "1"
        else f"A1 to {last_of_a} and B1 to B{last_of_a[1:]}"
    )
    errors = [
        f"firing_order names {name!r}, which is no cylinder: they are {all_labels}."
        " Correct it."
        for name in dict.fromkeys(order)
        if name not in labels
    ]
    errors += [
        f"firing_order names {name!r} {times} times, must name it once."
        for name, times in Counter(order).items()
        if times > 1
    ]
    lacking = [name for name in labels if name not in order]
    if lacking:
        errors.append(
            f"firing_order leaves out {', '.join(map(repr, lacking))}. Name every"
            " cylinder once."
        )
    return errors


def _interval_errors(engine: Engine, count: int) -> list[str]:
    """Check that firing intervals are one for each cylinder and add up to a cycle."""
    intervals = engine.firing_intervals
    cycle = 180.0 * engine.stroke_cycle
    if intervals is None:
        return []
    if engine.firing == "even":
        return several_given(["firing_intervals", "firing = 'even'"])
    if (
        not all(
            number_like(interval) and math.isfinite(interval) and interval >= 0
            for interval in intervals
        )
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


def _bank_errors(engine: Engine) -> list[str]:
    """Check that the cylinders fire in their order at the angles that the crank and the
    bank angle give.
    """
    angles = firing_angles(vars(engine))
    firing_order = [str(label) for label in engine.firing_order]
    by_angle = sorted(firing_order, key=lambda label: round(angles[label], 6))
    if by_angle == firing_order:
        return []
    order = ", ".join(by_angle)
    return [
        f"with the bank angle of {engine.bank_angle:g} deg the cylinders fire in the"
        f" order {order}, not in that of firing_order. Correct one of them,"
        " or give firing = 'even' or firing_intervals."
    ]
