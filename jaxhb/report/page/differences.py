"""Differences between two designs, as their scenes have them: numbers, words, tables,
elements.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from jaxhb.elements.declared import facts_of, table_of, unit_of
from jaxhb.elements.excitations import EXCITATIONS
from jaxhb.report.page.parts import Block, table
from jaxhb.report.text.columns import NONE, plain_number
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.topology import Topology

# Numbers of a scene as a whole, with their units
WHOLE = {"revolutions_per_cycle": "", "rated_rpm": "rpm"}
# Fields of a scene that change no motion
BESIDE = ("name", "scenarios", "tune", "tolerance")

Row = tuple[str, str, str, str]
"""Parameter of the scene, its value in both designs, and its unit."""


def value_text(value: float | bool | str | None, digits: int) -> str:
    """Write a number or word of a scene in words."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str | None):
        return value or NONE
    return plain_number(float(value), digits)


def differences(
    trains: Sequence[DriveTrain], designs: Sequence[Mapping[str, Any]]
) -> list[Block]:
    """Make a table of all that differs between two trains and their elements, as of
    :func:`jaxhb.scene.writer.elements_of`, or a sentence where nothing does, in a list.
    """
    first = trains[0].topology
    second = trains[1].topology
    rows = _whole(first, second)
    for name in dict.fromkeys([*designs[0], *designs[1]]):
        pair = [design.get(name) for design in designs]
        if type(pair[0]) is not type(pair[1]):
            change = "another element" if all(pair) else "in one design only"
            tables = [
                NONE if element is None else table_of(element) for element in pair
            ]
            rows.append((f"{name}: {change}", tables[0], tables[1], NONE))
            continue
        facts = [facts_of(element) for element in pair]
        for key in dict.fromkeys([*facts[0], *facts[1]]):
            values = [by_key.get(key, (None,))[0] for by_key in facts]
            field = (facts[0] | facts[1])[key][1]
            if values[0] != values[1]:
                rows.append(_row(name, key, field, values))
    if rows:
        heads = ["parameter of the scene", "first design", "second", "unit"]
        return [table("What differs between the designs", rows, heads)]
    second_fixed = _fixed(second)
    unlike = [
        name for name, value in _fixed(first).items() if value != second_fixed[name]
    ]
    if unlike:
        return [
            "Same parameters, tables and words of the elements, in another order or"
            f" with other {', '.join(unlike)}."
        ]
    return [
        "Nothing differs between the designs: no parameter, no table, no word, no"
        " element."
    ]


def _fixed(topology: Topology) -> dict[str, Any]:
    """Everything of a train that is no number, by its name in words."""
    values = {
        field.name.replace("_", " "): getattr(topology, field.name)
        for field in dataclasses.fields(topology)
        if field.name not in (*BESIDE, "excitations")
    }
    for table_name, seats in zip(EXCITATIONS, topology.excitations, strict=True):
        for field in dataclasses.fields(seats):
            words = f"{table_name} {field.name.replace('_', ' ')}"
            values[words] = getattr(seats, field.name)
    return values


def _row(name: str, key: str, field: dataclasses.Field, values: Sequence[Any]) -> Row:
    """Write the difference in a field, numbers with as many digits as tell them
    apart.
    """
    if field.metadata["kind"] in ("rows", "numbers"):
        presence = ["given" if value else NONE for value in values]
        return (f"{key} of {name}: another table", presence[0], presence[1], NONE)
    pairs = (
        (value_text(values[0], digits), value_text(values[1], digits))
        for digits in (4, 8, 17)
    )
    first, second = next(pair for pair in pairs if pair[0] != pair[1])
    return (f"{name}.{key}", first, second, unit_of(field) or NONE)


def _whole(first: Topology, second: Topology) -> list[Row]:
    """Make rows on the scene as a whole."""
    rows = []
    for name, unit in WHOLE.items():
        values = [getattr(topology, name) for topology in (first, second)]
        if values[0] != values[1]:
            rows.append(
                (
                    f"scene.{name}",
                    value_text(values[0], 6),
                    value_text(values[1], 6),
                    unit or NONE,
                )
            )
    reference = [
        {
            topology.disk_names[i]
            for i, rotor in enumerate(topology.rotor)
            if rotor == topology.reference_rotor
        }
        for topology in (first, second)
    ]
    # Any disk of a rotor may be its reference: rotors that share a disk are the same.
    if not reference[0] & reference[1]:
        names = [", ".join(sorted(disks)) for disks in reference]
        rows.append(("scene.reference", names[0], names[1], NONE))
    return rows
