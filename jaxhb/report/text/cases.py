"""Normal running beside one cylinder misfiring, or each in turn, over several speeds: what ``jaxhb report`` tells."""

from dataclasses import dataclass

from jaxhb.report.answer import Answer
from jaxhb.report.compute import answer_speeds
from jaxhb.report.files.output import OutputError
from jaxhb.report.files.record import answer_record, finite
from jaxhb.report.quantities import angles, forces, gear_torques, main_quantity, shaft_torques, shown_unit
from jaxhb.report.selection import NOT_FIRING, shafts_of, turning_disks
from jaxhb.report.text.certified import certificate_text
from jaxhb.report.text.columns import NONE, Table, aligned, alike, ratios, shares
from jaxhb.report.text.mean_torques import balance_line
from jaxhb.report.text.sentences import motion_word, status_lines, verdict
from jaxhb.report.text.strength import answers_strength, strength_record, strength_text
from jaxhb.report.text.tables import hardest_text, irregularity_text, notes_text, peak_table
from jaxhb.solutions.misfires import same_factor


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
    train, tables, told = cases[0].answers[number].train, [], []
    if train.topology.mesh_names:
        tables += [_force_table(cases, number), *_peak_tables(cases, number)]
        told.append(gear_torques(train))
    if shafts_of(train.topology) or not tables:
        told.append((shaft_torques if shafts_of(train.topology) else angles)(train))
    return [*tables, *(_swing_table(quantity, cases, number) for quantity in told), _turning_table(cases, number)]


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
    quantity, columns = forces(cases[0].answers[0].train), []
    names, factor = quantity.names, quantity.factor
    for case in cases:
        answer = case.answers[number]
        contacts = [answer.contacts[name] for name in names]
        columns += [
            *alike(*([factor * quantity.read(r, name) for name in names] for r in (answer, answer.linear))),
            shares([contact.separated_fraction for contact in contacts]),
            shares([contact.reverse_contact_fraction for contact in contacts]),
            [hardest_text(contact) for contact in contacts],
        ]
    heads = ["mesh", *["with", "without", "apart %", "reverse %", "hit m/s"] * len(cases)]
    title = "Largest tooth force, kN, with and without backlash; share of the time apart and on the reverse flank"
    return Table(title, heads, [names, *columns], _groups(cases, number, 5))


def _peak_tables(cases, number):
    return [text for case in cases for text in peak_table(case.answers[number], f"With {case.title}: l")]


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


def _swing_table(quantity, cases, number):
    columns = []
    for case in cases:
        both = case.answers[number], case.answers[number].linear
        pair = [[quantity.factor * quantity.read(r, name) for name in quantity.names] for r in both]
        columns += [*alike(*pair), ratios(*pair)]
    heads = [quantity.element, *["with", "without", "ratio"] * len(cases)]
    return Table(f"{quantity.title}, {quantity.unit}", heads, [quantity.names, *columns], _groups(cases, number, 3))


def _groups(cases, number, width):
    said = [_titled(case.title, case.answers[number]) for case in cases]
    return [(title, 1 + i * width, (i + 1) * width) for i, title in enumerate(said)]


def _titled(title, answer):
    return ", ".join(filter(None, [title, answer.doubt.upper()]))


def misfire_trains(train):
    """The train as it runs under "", and under each cylinder that in which it does not fire; they share programs."""
    trains = train.misfires()
    if not trains:
        raise OutputError("--misfire each: no cylinder of the train fires. Name what misfires, or leave it out.")
    return {"": train.replace(same_factor(train))} | trains


def hardest(answer):
    """What is hit hardest at one speed: the quantity, its element, its value in SI units (nan: no answer)."""
    quantity = main_quantity(answer.train)
    name = quantity.largest(answer) if answer.answered else None
    return quantity, name, float(quantity.read(answer, name)) if name else float("nan")


def largest_of(case):
    """What is hit hardest over the speeds of a case: what it is called, its value, and value, element and speed in
    words; None without an answer."""
    found = [(*hardest(answer), answer.rpm) for answer in case.answers if answer.answered]
    found = [row for row in found if row[2] == row[2]]
    if not found:
        return None
    quantity, name, value, rpm = max(found, key=lambda row: row[2])
    return quantity.small_title, value, f"{quantity.factor * value:.4g} {quantity.unit} in {name} at {rpm:g} rpm"


def worst_misfire(cases):
    """The misfire and the speed with the largest value, as it is written; None where no motion is known."""
    found = [(*hardest(answer), case, k) for case in cases[1:] for k, answer in enumerate(case.answers)]
    found = [row for row in found if row[2] == row[2]]
    if not found:
        return None
    quantity, name, value, case, speed = max(found, key=lambda row: row[2])
    return {
        "cylinder": case.title.removesuffix(NOT_FIRING),
        "rpm": case.answers[speed].rpm,
        "quantity": quantity.called,
        "of": name,
        "unit": quantity.si_unit,
        "value": value,
        "firing": float(quantity.read(cases[0].answers[speed], name)),
    }


def misfires_text(cases):
    """The worst misfire, then per speed what each misfire hits hardest, against normal running."""
    parts, worst = ["No motion with a misfire is known."], worst_misfire(cases)
    if worst is not None:
        factor, unit = shown_unit(worst["unit"])
        value, firing = (f"{factor * worst[key]:.4g} {unit}" for key in ("value", "firing"))
        parts = [
            f"The worst misfire is that of {worst['cylinder']}: {worst['quantity']} of {value} in {worst['of']} at"
            f" {worst['rpm']:g} rpm, {firing} with {cases[0].title}."
        ]
    parts += [_speed_table(cases, number) for number in range(len(cases[0].answers))]
    parts += cases_strength(cases)
    return "\n\n".join([*parts, *notes_text(*(answer for case in cases for answer in case.answers))])


def _speed_table(cases, number):
    rows = [hardest(case.answers[number]) for case in cases]
    quantity = rows[0][0]
    values = [quantity.factor * value for *_, value in rows]
    columns = [
        [case.title for case in cases],
        *alike(values),
        ratios(values, [values[0]] * len(values)),
        [name or NONE for _, name, _ in rows],
    ]
    heads = ["", quantity.unit, "ratio", "in"]
    if quantity.element == "mesh":
        columns.append([motion_word(case.answers[number]) for case in cases])
        heads.append("motion")
    title = f"{quantity.title} at {cases[0].answers[number].rpm:g} rpm, {quantity.unit}"
    return title + "\n" + aligned(heads, columns, left=(3, 4))
