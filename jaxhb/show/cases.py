"""Normal running beside one cylinder misfiring, over several speeds: what ``jaxhb report`` computes and prints."""

from dataclasses import dataclass

from .answer import Answer
from .balance import balance_line
from .certified import certificate_text
from .choose import gears, shafts_of, turning_disks
from .columns import Table, alike, ratios, shares
from .compute import answer_speeds
from .record import answer_record, finite
from .strength import answers_strength, strength_record, strength_text
from .tables import hardest_text, irregularity_text, notes_text, peak_table
from .words import status_lines, verdict


@dataclass(frozen=True)
class Case:
    """A train as it runs (``title``), and its answers at every speed."""

    title: str
    answers: list[Answer]


def solve_cases(trains, speeds, asked, *, folder=None, say=lambda text: None, advance=lambda count: None):
    """Answer every train of ``{title: train}`` at every speed, upwards as a sweep does.

    ``say`` is told what comes next. Steady states are kept in a ``folder`` as they are found, and read from there.
    """
    cases = []
    for number, (title, train) in enumerate(trains.items()):
        kept = {"out": folder / str(number), "chunk": 1} if folder else None

        def tell(text, title=title):
            say(f"{text} ({title})")

        (answers,) = answer_speeds(train, speeds, asked, kept=kept, progress=advance, say=tell).values()
        cases.append(Case(title, answers))
    return cases


def cases_record(cases, *, orders=None):
    """What ``report --json`` writes: per case the objects of all speeds with and without backlash."""
    speeds = [answer.rpm for answer in cases[0].answers]
    rows = [
        {
            "title": case.title,
            "responses": [answer_record(answer, orders=orders) for answer in case.answers],
            "without_backlash": [answer_record(answer.without_backlash, orders=orders) for answer in case.answers],
        }
        | _strength_record(case)
        for case in cases
    ]
    return {"rpm": speeds, "cases": rows}


def cases_text(cases):
    """Verdicts of all cases and speeds, then per speed tooth forces and torques side by side."""
    parts = [f"With {case.title}\n" + "\n".join(f"  {verdict(answer)}" for answer in case.answers) for case in cases]
    for number in range(len(cases[0].answers)):
        parts += [_heading(cases, number), *speed_tables(cases, number)]
    parts += [certificate_text(a, a.certificate) for case in cases for a in case.answers if a.certificate is not None]
    parts += cases_strength(cases)
    parts += notes_text(*(answer for case in cases for answer in case.answers))
    return "\n\n".join(parts)


def speed_tables(cases, number):
    """Of one speed the tooth forces, torques of gears, shafts and dampers (without links: angles), irregularity."""
    topology, tables = cases[0].answers[number].topology, []
    if topology.mesh_names:
        tables += [_force_table(cases, number), *_peak_tables(cases, number), _gear_table(cases, number)]
    if shafts_of(topology) or not tables:
        tables.append(_shaft_table(cases, number))
    return [*tables, _turning_table(cases, number)]


def cases_strength(cases):
    """Stresses, tooth torques and heat of every case in a list; empty where the scene gives no limits."""
    return strength_text({f"With {case.title}": answers_strength(case.answers) for case in cases})


def _strength_record(case):
    found = finite(strength_record(answers_strength(case.answers)))
    return {"strength": found} if found else {}


def _heading(cases, number):
    lines = [f"==== {cases[0].answers[number].rpm:g} rpm ===="]
    for case in cases:
        answer = case.answers[number]
        means = balance_line(answer.balance)
        lines += [f"  {case.title}", *(f"    {line}" for line in [*status_lines(answer), *([means] if means else [])])]
    return "\n".join(lines)


def _force_table(cases, number):
    names = cases[0].answers[0].topology.mesh_names
    columns = []
    for case in cases:
        answer = case.answers[number]
        contacts = [answer.contacts[name] for name in names]
        columns += [
            *alike(*([r.force(name).peak / 1e3 for name in names] for r in (answer, answer.linear))),
            shares([contact.separated_fraction for contact in contacts]),
            shares([contact.reverse_contact_fraction for contact in contacts]),
            [hardest_text(contact) for contact in contacts],
        ]
    heads = ["mesh", *["with", "without", "apart %", "reverse %", "hit m/s"] * len(cases)]
    title = "Largest tooth force, kN, with and without backlash; share of the time apart and on the reverse flank"
    return Table(title, heads, [names, *columns], _groups(cases, number, 5))


def _peak_tables(cases, number):
    return [text for case in cases for text in peak_table(case.answers[number], f"With {case.title}: l")]


def _gear_table(cases, number):
    names = gears(cases[0].answers[0].topology)
    return _swing_table("Gear torque, half peak-to-peak, N m", "gear", names, "gear_torque", cases, number)


def _shaft_table(cases, number):
    topology = cases[0].answers[0].topology
    names = shafts_of(topology)
    if names:
        title = "Torque of shafts and dampers, half peak-to-peak, N m"
        return _swing_table(title, "shaft", names, "torque", cases, number)
    title = "Vibratory angle of disks, half peak-to-peak, mrad"
    return _swing_table(title, "disk", topology.disk_names, "disk", cases, number, 1e3)


def _turning_table(cases, number):
    """Irregularity of the disks that :func:`turning_disks` names, and heat of the dampers."""
    train, answers = cases[0].answers[0].train, [case.answers[number] for case in cases]
    disks = turning_disks(train)
    columns = [[irregularity_text(answer, disk) for disk in disks] for answer in answers]
    for column, answer in zip(columns, answers, strict=True):
        column += alike([answer.power(name) for name in train.topology.damper_names])[0]
    rows = [
        *(f"irregularity of {disk}, %" for disk in disks),
        *(f"heat of {name}, W" for name in train.topology.damper_names),
    ]
    heads = [_titled(case.title, answer) for case, answer in zip(cases, answers, strict=True)]
    return Table("Cyclic irregularity, (largest - smallest) / mean speed, and dampers", ["", *heads], [rows, *columns])


def _swing_table(title, what, names, read, cases, number, factor=1.0):
    columns = []
    for case in cases:
        both = case.answers[number], case.answers[number].linear
        pair = [[factor * getattr(r, read)(name).half_peak_to_peak for name in names] for r in both]
        columns += [*alike(*pair), ratios(*pair)]
    heads = [what, *["with", "without", "ratio"] * len(cases)]
    return Table(title, heads, [names, *columns], _groups(cases, number, 3))


def _groups(cases, number, width):
    said = [_titled(case.title, case.answers[number]) for case in cases]
    return [(title, 1 + i * width, (i + 1) * width) for i, title in enumerate(said)]


def _titled(title, answer):
    return ", ".join(filter(None, [title, answer.doubt.upper()]))
