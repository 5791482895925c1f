"""The command of phases: which angle between two engines is the worst, and which the best."""

import numpy as np

from jaxhb.cli.progress import Progress
from jaxhb.cli.tolerance_command import asked_quantity
from jaxhb.design.phases import worst_phase
from jaxhb.design.quantities import unit_of
from jaxhb.elements.elements import SceneError, suggestion
from jaxhb.report.files import numbers, output
from jaxhb.report.quantities import shown_unit
from jaxhb.report.selection import train_name
from jaxhb.report.text.columns import from_rows, plain_number


def phase(train, given, rpm, name, of, phases, quiet, **_):
    """The worst phase of an engine."""
    known = train.topology.phase_names
    if name is None and len(known) != 1:
        near = suggestion("", known) if known else " The scene has no [[phase]]: docs/how_to/strength.md has one."
        raise SceneError(f"{train.topology.title}: --phase: name one.{near}")
    name, quantities = name or known[0], tuple(map(asked_quantity, of))
    with Progress(quiet=quiet) as progress:
        found = worst_phase(train, name, rpm=rpm, of=quantities, phases=phases, progress=progress.say)
    record = {"phase": name, "circle_deg": found.circle, "angle_deg": train.value(f"{name}.angle"), "rpm": found.rpm}
    rows = [
        {"rpm": speed, "quantity": label, "unit": unit_of(one.quantity)}
        | {key: getattr(found, key)[i, j] for key in ("nominal", "worst", "angle", "best", "best_angle")}
        for i, speed in enumerate(found.rpm)
        for j, (label, one) in enumerate(zip(found.labels, found.of, strict=True))
    ]
    output.deliver(
        given,
        _text(train, found),
        json=lambda: output.as_json(numbers.on_scene(given, train) | record | {"phases": rows}),
        csv=lambda: numbers.rows_csv(rows),
    )
    return output.ANSWERED if np.isfinite(found.nominal).all() else output.NOT_ANSWERED


def _text(train, found):
    """A row for each quantity, at the speed at which its worst phase is worst."""
    rows, own = [], float(train.value(f"{found.name}.angle"))
    for j, one in enumerate(found.of):
        solved = np.flatnonzero(np.isfinite(found.worst[:, j]))
        factor, unit = shown_unit(unit_of(one.quantity))
        if not len(solved):
            rows.append([found.labels[j], *["-"] * 6, unit])
            continue
        i = solved[np.argmax(found.worst[solved, j])]
        cells = [plain_number(factor * values[i, j]) for values in (found.nominal, found.worst, found.best)]
        at = [f"{angle[i, j]:.1f}" for angle in (found.angle, found.best_angle)]
        rows.append([found.labels[j], f"{found.rpm[i]:g}", cells[0], cells[1], at[0], cells[2], at[1], unit])
    said = f"{found.name}, turned through {found.circle:g} deg of its rotor, {len(found.rpm)} speeds"
    heads = ["", "at rpm", f"at {own:g} deg", "worst", "at deg", "best", "at deg", "unit"]
    return from_rows(f"{train_name(train.topology)}: phase {said}", heads, rows, left=(7,))
