"""Normal running beside one cylinder misfiring, or each in turn, over several speeds: what ``jaxhb report`` tells."""

from jaxhb.report.quantities import (
    WITHOUT,
    angles,
    forces,
    gear_torques,
    heat,
    irregularity,
    main_quantity,
    shaft_torques,
)
from jaxhb.report.selection import NOT_FIRING, shafts_of
from jaxhb.report.text.certified import certificate_text
from jaxhb.report.text.columns import NONE, from_rows, hit, irregular, percent, ratio
from jaxhb.report.text.mean_torques import balance_line
from jaxhb.report.text.sentences import misfire_text, motion_word, status_lines, verdict
from jaxhb.report.text.strength import answers_strength, strength_text
from jaxhb.report.text.tables import against, element_table, notes_text, peak_table

FORCES = (
    ("with", "tooth_force_peak"),
    ("without", f"tooth_force_peak{WITHOUT}"),
    ("apart %", "separated_fraction", percent),
    ("reverse %", "reverse_contact_fraction", percent),
    ("hit m/s", "hardest_impact", hit),
)
"""Columns of every case, as of :func:`jaxhb.report.text.tables.element_table`."""


def cases_text(cases):
    """Verdicts of all cases and speeds, then per speed tooth forces and torques side by side."""
    parts = [f"With {case.title}\n" + "\n".join(f"  {verdict(answer)}" for answer in case.answers) for case in cases]
    for number, first in enumerate(cases[0].answers):
        lines = [f"==== {first.rpm:g} rpm ===="]
        for case in cases:
            answer = case.answers[number]
            said = filter(None, [*status_lines(answer), balance_line(answer.balance)])
            lines += [f"  {case.title}", *(f"    {line}" for line in said)]
        parts += ["\n".join(lines), *speed_tables(cases, number)]
    parts += [text for case in cases for answer in case.answers for text in certificate_text(answer)]
    return "\n\n".join([*parts, *_below(cases)])


def _below(cases):
    """Stresses, tooth torques and heat of every case beside their limits, and notes."""
    limits = strength_text({f"With {case.title}": answers_strength(case.answers) for case in cases})
    return limits + notes_text(*(answer for case in cases for answer in case.answers))


def speed_tables(cases, number):
    """Of one speed the tooth forces, torques of gears and links (without links: angles), irregularity, heat."""
    answers = [case.answers[number] for case in cases]
    train, doubts = answers[0].train, [f", {one.doubt.upper()}".removesuffix(", ") for one in answers]
    titles = [f"{case.title}{doubt}" for case, doubt in zip(cases, doubts, strict=True)]

    def table(title, quantity, specs):
        width = len(specs)
        groups = [(said, 1 + i * width, (i + 1) * width) for i, said in enumerate(titles)]
        return element_table(title, quantity.element, specs, *answers, names=quantity.names, groups=groups)

    def swings(quantity):
        variable = quantity.variable
        specs = ("with", variable), ("without", f"{variable}{WITHOUT}"), ("ratio", against(variable), ratio)
        return table(f"{quantity.title}, {quantity.unit}", quantity, specs)

    tables, links = [], shafts_of(train.topology)
    if train.topology.mesh_names:
        title = "Largest tooth force, kN, with and without backlash; share of the time apart and on the reverse flank"
        tables.append(table(title, forces(train), FORCES))
        tables += [text for case in cases for text in peak_table(case.answers[number], f"With {case.title}: l")]
        tables.append(swings(gear_torques(train)))
    if links or not tables:
        tables.append(swings((shaft_torques if links else angles)(train)))
    turning, heats = irregularity(train), heat(train)
    tables.append(table(turning.title, turning, [("%", turning.variable, irregular)]))
    return [*tables, *[table(heats.title, heats, [("W", heats.variable)]) for _ in heats.names[:1]]]


def hardest(answer):
    """What is hit hardest at one speed: the quantity, its element, its value in SI units (nan: no answer)."""
    quantity = main_quantity(answer.train)
    name = quantity.largest(answer) if answer.answered else None
    return quantity, name, quantity.read(answer, name) if name else float("nan")


def _hardest_of(cases):
    """The largest of :func:`hardest` over cases and speeds, its case and the place of its speed; None: no answer."""
    found = [(*hardest(answer), case, place) for case in cases for place, answer in enumerate(case.answers)]
    return max((row for row in found if row[1]), key=lambda row: row[2], default=None)


def largest_of(case):
    """What is hit hardest over the speeds of a case: what it is called, its value, and all in words; None without."""
    found = _hardest_of([case])
    if found is None:
        return None
    quantity, name, value, _, place = found
    return quantity.small_title, value, f"{quantity.said(value)} in {name} at {case.answers[place].rpm:g} rpm"


def worst_misfire(cases):
    """The misfire and the speed with the largest value, as it is written; None where no motion is known."""
    found = _hardest_of(cases[1:])
    if found is None:
        return None
    quantity, name, value, case, place = found
    return {
        "cylinder": case.title.removesuffix(NOT_FIRING),
        "rpm": case.answers[place].rpm,
        "quantity": quantity.called,
        "of": name,
        "unit": quantity.si_unit,
        "value": value,
        "firing": quantity.read(cases[0].answers[place], name),
    }


def misfires_text(cases):
    """The worst misfire, then per speed what each misfire hits hardest, against normal running."""
    worst = worst_misfire(cases)
    parts = [misfire_text(worst, cases[0].title) if worst else "No motion with a misfire is known."]
    parts += [_speed_table(cases, number) for number in range(len(cases[0].answers))]
    return "\n\n".join([*parts, *_below(cases)])


def _speed_table(cases, number):
    answers, rows = [case.answers[number] for case in cases], []
    quantity = main_quantity(answers[0].train)
    for case, answer in zip(cases, answers, strict=True):
        _, name, value = hardest(answer)
        value *= quantity.factor
        firing = rows[0][1] if rows else value
        rows.append([case.title, value, (value, firing), name or NONE, motion_word(answer)])
    heads = ["", (quantity.unit, "number"), ("ratio", ratio), "in", *["motion"] * (quantity.element == "mesh")]
    title = f"{quantity.title} at {answers[0].rpm:g} rpm, {quantity.unit}"
    return from_rows(title, heads, rows, left=(3, 4))
