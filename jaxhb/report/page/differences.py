"""What scenes say of their elements, and what differs between two designs: numbers,
words, tables, elements.
"""

import dataclasses

from jaxhb.elements.elements import facts_of, table_of, unit_of
from jaxhb.report.page.parts import table
from jaxhb.report.text.columns import NONE, plain_number

WHOLE = {
    "revolutions_per_cycle": "",
    "rated_rpm": "rpm",
}  # numbers of a scene as a whole, with their units
BESIDE = ("name", "scenarios", "tune", "tolerance")  # what of a scene changes no motion


def said(value, digits):
    """A number or word of a scene in words."""
    if isinstance(value, str | bool | None):
        return {True: "yes", False: "no", None: NONE, "": NONE}.get(value, value)
    return plain_number(float(value), digits)


def differences(trains, designs):
    """A table of all that differs between two trains and their :func:`elements_of`, or
    a sentence where nothing does, in a list.
    """
    both = [train.topology for train in trains]
    rows = _whole(*both)
    for name in dict.fromkeys([*designs[0], *designs[1]]):
        pair = [design.get(name) for design in designs]
        if type(pair[0]) is not type(pair[1]):
            cells = [NONE if one is None else table_of(one) for one in pair]
            rows.append(
                (
                    (
                        f"{name}:"
                        f" {'another element' if all(pair) else 'in one design only'}"
                    ),
                    *cells,
                    NONE,
                )
            )
            continue
        facts = [facts_of(one) for one in pair]
        for key in dict.fromkeys([*facts[0], *facts[1]]):
            values = [one.get(key, (None,))[0] for one in facts]
            field = (facts[0] | facts[1])[key][1]
            if values[0] != values[1]:
                rows.append(_row(name, key, field, values))
    if rows:
        heads = ["number of the scene", "first design", "second", "unit"]
        return [table("What differs between the designs", rows, heads)]
    names = [
        field.name for field in dataclasses.fields(both[0]) if field.name not in BESIDE
    ]
    if unlike := [
        name.replace("_", " ")
        for name in names
        if getattr(both[0], name) != getattr(both[1], name)
    ]:
        return [
            "Same numbers, tables and words of the elements, in another order or with"
            f" other {', '.join(unlike)}."
        ]
    return [
        "Nothing differs between the designs: no number, no table, no word, no element."
    ]


def _row(name, key, field, values):
    """What differs in a field, numbers with as many digits as tell them apart."""
    if field.metadata["kind"] == "rows":
        return (
            f"{key} of {name}: another table",
            *("given" if value else NONE for value in values),
            NONE,
        )
    told = ([said(value, digits) for value in values] for digits in (4, 8, 17))
    return (
        f"{name}.{key}",
        *next(pair for pair in told if pair[0] != pair[1]),
        unit_of(field) or NONE,
    )


def _whole(*both):
    """Rows on the scene as a whole."""
    rows = []
    for name, unit in WHOLE.items():
        values = [getattr(topology, name) for topology in both]
        if values[0] != values[1]:
            rows.append(
                (f"scene.{name}", *(said(value, 6) for value in values), unit or NONE)
            )
    reference = [
        {t.disk_names[i] for i, r in enumerate(t.rotor) if r == t.reference_rotor}
        for t in both
    ]
    # Any disk of a rotor may be its reference: rotors that share a disk are the same.
    if not reference[0] & reference[1]:
        rows.append(
            (
                "scene.reference",
                *(", ".join(sorted(names)) for names in reference),
                NONE,
            )
        )
    return rows
