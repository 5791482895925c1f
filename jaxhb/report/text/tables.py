"""One speed as text: its verdict, and tables of elements as specifications over the numbers of an answer."""

import textwrap

from jaxhb.report.quantities import ELEMENTS, WITHOUT, number, shown_unit, unit_of
from jaxhb.report.selection import shafts_of, train_name
from jaxhb.report.text.certified import certificate_text
from jaxhb.report.text.columns import NONE, count, from_rows, hit, irregular, percent, ratio
from jaxhb.report.text.mean_torques import balance_line, mean_angles_of
from jaxhb.report.text.sentences import notes, status_lines, verdict
from jaxhb.report.text.strength import answers_strength, strength_text
from jaxhb.results.record import PERCENT
from jaxhb.train.plausible import plausibility

RPM, _ = shown_unit("rad/s")


def against(variable):
    """Reader of a number and of the same without backlash."""
    return lambda answer, name: (number(answer, name, variable), number(answer.linear, name, variable))


def _driver(answer, name):
    topology, side = answer.topology, answer.contacts[name].drive_side
    first, second = topology.mesh_ends[topology.mesh_names.index(name)]
    return topology.disk_names[first if side > 0 else second] if side else NONE


def _swings(signal):
    """Columns of a torque with and without backlash."""
    half = f"{signal}_half_peak_to_peak"
    return (
        ("mean", f"{signal}_mean"),
        ("peak", f"{signal}_peak"),
        ("half p-p", half),
        ("peak", f"{signal}_peak{WITHOUT}"),
        ("half p-p", f"{half}{WITHOUT}"),
        ("ratio of half p-p", against(half), ratio),
    )


def _linear_swings(signal):
    return ("half peak-to-peak", f"{signal}_half_peak_to_peak"), ("sum of amplitudes", f"{signal}_sum_of_amplitudes")


FORCES = (
    ("mean", "tooth_force_mean"),
    ("max", "tooth_force_max"),
    ("min", "tooth_force_min"),
    ("max", f"tooth_force_max{WITHOUT}"),
    ("min", f"tooth_force_min{WITHOUT}"),
    ("peak ratio", against("tooth_force_peak"), ratio),
)
CONTACT = (
    ("apart %", "separated_fraction", percent),
    ("reverse %", "reverse_contact_fraction", percent),
    ("impacts", "impacts_per_cycle", count),
    ("hardest m/s", "hardest_impact", hit),
    ("driven by", _driver, str),
)
SPEEDS = (
    ("mean", lambda answer, name: RPM * number(answer, name, "speed_mean"), "{:.6g}".format),
    ("half p-p", "speed_half_peak_to_peak"),
    ("irregularity %", "irregularity", irregular),
    ("acceleration", "acceleration_half_peak_to_peak", "rad/s2"),
)
HEAT = ("heat W", "heat", "W")
"""Columns of tables: head, variable of a data set or a reader of (answer, name), and how it is written: as a rule with
the decimals of the others, in the unit for people."""


def element_table(title, element, specs, *answers, names=None, groups=()):
    """A row for every element of a kind or of those ``names``, the columns of ``specs`` for every answer."""
    heads, rows = [element], [[name] for name in names or ELEMENTS[element](answers[0].topology)]
    for place, answer in enumerate(answers):
        for head, read, *write in specs:
            way = write[0] if write else "number"
            heads.append((head, way if callable(way) else (place, way)))
            factor = 1.0 if callable(read) or callable(way) else shown_unit(unit_of(read))[0]
            for row in rows:
                row.append(read(answer, row[0]) if callable(read) else factor * number(answer, row[0], read))
    return from_rows(title, heads, rows, groups)


def solve_text(answer):
    """The :class:`Answer` at one speed: verdict, kind of motion, tooth forces, torques of gears and shafts, notes."""
    topology = answer.topology
    means = "; ".join(filter(None, [balance_line(answer.balance), f"mean angles: {mean_angles_of(topology)}"]))
    head = [verdict(answer), "", f"{train_name(topology)} at {answer.rpm:g} rpm", *status_lines(answer), means]
    doubt = f"{answer.doubt.upper()}: " if answer.doubt else ""
    parts = ["\n".join(head), *(doubt + table for table in _tables(answer))]
    parts += certificate_text(answer) + strength_text({"": answers_strength([answer])}) + notes_text(answer)
    return "\n\n".join(parts)


def _tables(answer):
    topology, pair = answer.topology, [("with backlash", 1, 3), ("without", 4, 5)]
    if topology.mesh_names:
        title = "Tooth force, kN (elastic and damping; positive: the first gear drives the second)"
        yield element_table(title, "mesh", FORCES, answer, groups=pair)
        yield from peak_table(answer)
        title = "Contact, % of the time (apart: in the gap; reverse: on the flank that does not drive), impacts a cycle"
        yield element_table(title, "mesh", CONTACT, answer)
        title = "Torque that a gear passes to its mates, N m"
        yield element_table(title, "gear", _swings("gear_torque"), answer, groups=pair)
    if shafts_of(topology):
        backlash = any(topology.mesh_backlash)
        specs = _swings("torque") if backlash else (("mean", "torque_mean"), *_linear_swings("torque"))
        title = "Torque of shafts and dampers, N m"
        yield element_table(title, "shaft", (*specs, HEAT), answer, groups=pair if backlash else ())
    if not topology.link_names:
        yield element_table("Vibratory angle of disks, deg", "disk", _linear_swings("angle"), answer)
    if answer.known and answer.response is not None:
        title = "Speed of disks, rpm; cyclic irregularity: (largest - smallest) / mean; acceleration, rad/s2, half p-p"
        yield element_table(title, "disk", SPEEDS, answer)


def peak_table(answer, begin="L"):
    """How the largest tooth forces of recorded cycles are distributed, in a list; empty without a record."""
    if not answer.known or answer.response is not None:
        return []
    specs = [
        (f"{percent} %", lambda answer, name, i=i: answer.force(name).per_cycle.max[i] / 1e3, "kN")
        for i, percent in enumerate(PERCENT)
    ]
    title = f"{begin}argest tooth force of a cycle, kN: 5, 50 and 95 % of the recorded cycles stay below"
    return [element_table(title, "mesh", specs, answer)]


def notes_text(*answers):
    """The notes on the scene and on the motions as one paragraph in a list; an empty list where there are none."""
    return remarks_text([*plausibility(answers[0].train), *notes(*answers)])


def remarks_text(remarks):
    """Sentences as one paragraph in a list; an empty list where there are none."""
    return ["\n".join(["Notes", *map(paragraph, remarks)])] if remarks else []


def paragraph(text):
    """A sentence of a list, in lines."""
    return textwrap.fill(text, 116, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)
