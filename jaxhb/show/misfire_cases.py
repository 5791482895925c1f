"""Every cylinder in turn not firing, beside normal running: what ``jaxhb report --misfire each`` prints and writes."""

from ..periodic.misfires import same_factor
from .cases import cases_strength
from .choose import NOT_FIRING, largest, shafts_of
from .columns import NONE, aligned, alike, ratios
from .output import OutputError
from .tables import notes_text
from .words import motion_word

_KINDS = {"tooth force": ("N", "kN", 1e-3), "torque": ("N m", "N m", 1.0), "angle": ("rad", "mrad", 1e3)}
_CALLED = {"tooth force": "Largest tooth force", "torque": "Torque, half peak-to-peak", "angle": "Angle"}


def misfire_trains(train):
    """The train as it runs under "", and under each cylinder that in which it does not fire; they share programs."""
    trains = train.misfires()
    if not trains:
        raise OutputError("--misfire each: no cylinder of the train fires. Name what misfires, or leave it out.")
    return {"": train.replace(same_factor(train))} | trains


_READ = {
    "tooth force": lambda answer, name: answer.force(name).peak,
    "torque": lambda answer, name: answer.torque(name).half_peak_to_peak,
    "angle": lambda answer, name: answer.disk(name).half_peak_to_peak,
}


def hardest(answer):
    """What is hit hardest at one speed: kind of quantity, its element, its value in SI units (nan: no answer)."""
    topology = answer.topology
    quantity = "tooth force" if topology.mesh_names else "torque" if topology.link_names else "angle"
    names = {"tooth force": topology.mesh_names, "torque": shafts_of(topology), "angle": topology.disk_names}[quantity]
    name = largest(names, lambda name: _READ[quantity](answer, name)) if answer.answered else None
    return quantity, name, float(_READ[quantity](answer, name)) if name else float("nan")


def largest_of(case):
    """What is hit hardest over the speeds of a case: what it is called, its value, and value, element and speed in
    words; None without an answer."""
    found = [(*hardest(answer), answer.rpm) for answer in case.answers if answer.answered]
    found = [row for row in found if row[2] == row[2]]
    if not found:
        return None
    quantity, name, value, rpm = max(found, key=lambda row: row[2])
    _, unit, factor = _KINDS[quantity]
    called = _CALLED[quantity][0].lower() + _CALLED[quantity][1:]
    return called, value, f"{factor * value:.4g} {unit} in {name} at {rpm:g} rpm"


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
        "quantity": quantity,
        "of": name,
        "unit": _KINDS[quantity][0],
        "value": value,
        "firing": float(_READ[quantity](cases[0].answers[speed], name)),
    }


def misfires_text(cases):
    """The worst misfire, then per speed what each misfire hits hardest, against normal running."""
    parts, worst = ["No motion with a misfire is known."], worst_misfire(cases)
    if worst is not None:
        _, unit, factor = _KINDS[worst["quantity"]]
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
    _, unit, factor = _KINDS[quantity]
    values = [factor * value for *_, value in rows]
    columns = [
        [case.title for case in cases],
        *alike(values),
        ratios(values, [values[0]] * len(values)),
        [name or NONE for _, name, _ in rows],
    ]
    heads = ["", unit, "ratio", "in"]
    if quantity == "tooth force":
        columns.append([motion_word(case.answers[number]) for case in cases])
        heads.append("motion")
    title = f"{_CALLED[quantity]} at {cases[0].answers[number].rpm:g} rpm, {unit}"
    return title + "\n" + aligned(heads, columns, left=(3, 4))
