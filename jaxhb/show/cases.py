"""Normal running beside one cylinder misfiring, over several speeds: what ``jaxhb report`` computes and prints."""

from dataclasses import dataclass

from ..periodic.solve import linear_response, solve
from ..response.response import Response
from .balance import balance_line
from .report import contacts_of, gears, hardest_impact, response_record, shafts_of, status_line, verdict
from .tables import NONE, aligned, alike, notes_text, ratios, shares


@dataclass(frozen=True)
class Case:
    """A train as it runs (``title``), solved at every speed with backlash and without."""

    title: str
    responses: list[Response]
    linear: list[Response]


def solve_cases(trains, speeds, *, harmonics=None, tolerance=0.01, step=lambda text: None):
    """Solve every train of ``{title: train}`` at every speed; ``step`` is told what comes next."""
    cases = []
    for title, train in trains.items():
        responses, linear = [], []
        for rpm in speeds:
            step(f"{rpm:g} rpm, {title}")
            responses.append(solve(train, rpm=rpm, harmonics=harmonics, tolerance=tolerance))
            toothed = any(train.topology.mesh_backlash)
            linear.append(linear_response(train, rpm=rpm) if toothed else responses[-1])
        cases.append(Case(title, responses, linear))
    return cases


def cases_record(cases, *, orders=None):
    """What ``report --json`` writes: per case the response objects with and without backlash."""
    speeds = [float(response.rpm) for response in cases[0].responses]
    rows = [
        {
            "title": case.title,
            "responses": [response_record(response, orders=orders) for response in case.responses],
            "without_backlash": [response_record(response, orders=orders) for response in case.linear],
        }
        for case in cases
    ]
    return {"rpm": speeds, "cases": rows}


def cases_text(cases):
    """Verdicts of all cases and speeds, then per speed the tooth forces and gear torques side by side."""
    first = cases[0].responses
    parts = [
        f"With {case.title}\n" + "\n".join(f"  {verdict(response)}" for response in case.responses) for case in cases
    ]
    for number, response in enumerate(first):
        parts.append(_heading(cases, number))
        if response.topology.mesh_names:
            parts += [_force_table(cases, number), _gear_table(cases, number)]
        else:
            parts.append(_shaft_table(cases, number))
    parts += notes_text(*(response for case in cases for response in case.responses))
    return "\n\n".join(parts)


def _heading(cases, number):
    lines = [f"==== {float(cases[0].responses[number].rpm):g} rpm ===="]
    for case in cases:
        response = case.responses[number]
        means = balance_line(response)
        lines += [f"  {case.title}", f"    {status_line(response)}", *([f"    {means}"] if means else [])]
    return "\n".join(lines)


def _force_table(cases, number):
    names = cases[0].responses[0].topology.mesh_names
    columns = []
    for case in cases:
        contacts = contacts_of(case.responses[number]).values()
        columns += [
            *alike(*([r[number].force(name).peak / 1e3 for name in names] for r in (case.responses, case.linear))),
            shares([contact and contact.separated_fraction for contact in contacts]),
            shares([contact and contact.reverse_contact_fraction for contact in contacts]),
            [NONE if not contact or not contact.impacts else f"{hardest_impact(contact):.2f}" for contact in contacts],
        ]
    heads = ["mesh", *["with", "without", "apart %", "reverse %", "hit m/s"] * len(cases)]
    title = "Largest tooth force, kN, with and without backlash; share of the cycle apart and on the reverse flank"
    return title + "\n" + aligned(heads, [names, *columns], _groups(cases, 5))


def _gear_table(cases, number):
    names = gears(cases[0].responses[0])
    swings = [
        [[response.gear_torque(name).half_peak_to_peak for name in names] for response in pair]
        for pair in _pairs(cases, number)
    ]
    return "Gear torque, half peak-to-peak, N m\n" + _swing_table("gear", names, swings, cases)


def _shaft_table(cases, number):
    topology = cases[0].responses[0].topology
    names = shafts_of(topology)
    if not names:
        return _disk_table(cases, number)
    swings = [
        [[response.torque(name).half_peak_to_peak for name in names] for response in pair]
        for pair in _pairs(cases, number)
    ]
    return "Torque of shafts and dampers, half peak-to-peak, N m\n" + _swing_table("shaft", names, swings, cases)


def _disk_table(cases, number):
    names = cases[0].responses[0].topology.disk_names
    swings = [
        [[1e3 * response.disk(name).half_peak_to_peak for name in names] for response in pair]
        for pair in _pairs(cases, number)
    ]
    return "Vibratory angle of disks, half peak-to-peak, mrad\n" + _swing_table("disk", names, swings, cases)


def _pairs(cases, number):
    return [(case.responses[number], case.linear[number]) for case in cases]


def _swing_table(what, names, swings, cases):
    columns = [c for pair in swings for c in (*alike(*pair), ratios(*pair))]
    heads = [what, *["with", "without", "ratio"] * len(cases)]
    return aligned(heads, [names, *columns], _groups(cases, 3))


def _groups(cases, width):
    return [(case.title, 1 + i * width, (i + 1) * width) for i, case in enumerate(cases)]
