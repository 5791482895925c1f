"""Commands of what is not known exactly: the worst case of tolerances, and the worst
phase between two engines.
"""

import re

import numpy as np

from jaxhb.cli.commands import status
from jaxhb.cli.operating_modes import tell
from jaxhb.cli.progress import Progress
from jaxhb.cli.resume import GOES_ON, Kept
from jaxhb.design.phases import worst_phase
from jaxhb.design.quantities import QUANTITIES, Objective, unit_of
from jaxhb.design.tolerances import read_tolerances
from jaxhb.design.worst_case import tolerance as search
from jaxhb.elements.elements import SceneError, suggestion
from jaxhb.report.compute import check_spread
from jaxhb.report.figures.speeds import plot_tolerance
from jaxhb.report.files import numbers, output
from jaxhb.report.files.compared import of_worst
from jaxhb.report.quantities import shown_unit
from jaxhb.report.selection import train_name
from jaxhb.report.text.columns import from_rows, plain_number
from jaxhb.report.text.tolerances import (
    tolerance_parts,
    tolerance_record,
    tolerance_rows,
)


def tolerance(train, given, rpm, of, samples, seed, plot, quiet, **_):
    """What the tolerances of a scene do to its response."""
    tolerances = read_tolerances(train)
    asked = {
        "samples": samples or 0,
        "seed": seed or 0,
        "harmonics": given.harmonics,
        "tolerance": given.tolerance,
    }
    quantities = tuple(map(asked_quantity, of))
    kept = Kept([train], ("tolerance", rpm, quantities, tolerances, asked))
    with Progress(quiet=quiet) as progress:

        def compute(folder):
            return search(
                train,
                rpm=np.array(rpm),
                of=quantities,
                **asked,
                progress=progress.say,
                out=folder,
            )

        left = f"no file is written, but what was found is kept; {GOES_ON}"
        spread = kept.run(
            compute, lambda: left if kept.folder else "nothing more is written"
        )
        checked = check_spread(spread, progress.say)
    output.deliver(
        given,
        "\n\n".join(tolerance_parts(spread, checked)),
        json=lambda: numbers.on_scene(train) | tolerance_record(spread, checked),
        csv=lambda: output.rows_csv(list(tolerance_rows(spread, checked))),
        netcdf=lambda: [numbers.as_netcdf(spread.to_xarray())],
        plot=lambda: plot_tolerance(spread),
    )
    tell(given, lambda: of_worst(tolerance_rows(spread, checked)))
    kept.forget()
    return output.ANSWERED if spread.answered.all() else output.NOT_ANSWERED


def asked_quantity(text):
    """The Objective of ``"QUANTITY of ELEMENT"``, where a quantity may end in an
    order.
    """
    name, found, element = text.partition(" of ")
    order = re.fullmatch(r"(.*) ([\d.]+)", name)
    name, order = (order[1], float(order[2])) if order else (name, None)
    if not found or name not in QUANTITIES:
        known = 'write "QUANTITY of ELEMENT", as "tooth force of crank gear|idler"'
        raise output.OutputError(
            f"--of: {text!r}: {known}.{suggestion(name, QUANTITIES)}"
        )
    return Objective(quantity=name, of=element, order=order)


def phase(train, given, rpm, name, of, phases, quiet, **_):
    """The worst phase of an engine."""
    known = train.topology.phase_names
    if name is None and len(known) != 1:
        near = (
            suggestion("", known)
            if known
            else " The scene has no [[phase]]: docs/how_to/strength.md has one."
        )
        raise SceneError(f"{train.topology.title}: --phase: name one.{near}")
    name = name or known[0]
    quantities = tuple(map(asked_quantity, of))
    with Progress(quiet=quiet) as progress:
        found = worst_phase(
            train, name, rpm=rpm, of=quantities, phases=phases, progress=progress.say
        )
    record = {
        "phase": name,
        "circle_deg": found.circle,
        "angle_deg": train.value(f"{name}.angle"),
        "rpm": found.rpm,
    }
    rows = [
        {"rpm": speed, "quantity": label, "unit": unit_of(one.quantity)}
        | {
            key: getattr(found, key)[i, j]
            for key in ("nominal", "worst", "angle", "best", "best_angle")
        }
        for i, speed in enumerate(found.rpm)
        for j, (label, one) in enumerate(zip(found.labels, found.of, strict=True))
    ]
    output.deliver(
        given,
        _phase_text(train, found),
        json=lambda: (
            numbers.on_scene(train)
            | record
            | {
                "phases": rows,
                "left_out": found.left_out,
            }
        ),
        csv=lambda: output.rows_csv(rows),
    )
    tell(given, lambda: of_worst(rows))
    return status(list(found.left_out))


def _phase_text(train, found):
    """A row for each quantity, at the speed at which its worst phase is worst."""
    rows = []
    own = float(train.value(f"{found.name}.angle"))
    for j, one in enumerate(found.of):
        solved = np.flatnonzero(np.isfinite(found.worst[:, j]))
        factor, unit = shown_unit(unit_of(one.quantity))
        if not len(solved):
            rows.append([found.labels[j], *["-"] * 6, unit])
            continue
        i = solved[np.argmax(found.worst[solved, j])]
        cells = [
            plain_number(factor * values[i, j])
            for values in (found.nominal, found.worst, found.best)
        ]
        at = [f"{angle[i, j]:.1f}" for angle in (found.angle, found.best_angle)]
        rows.append(
            [
                found.labels[j],
                f"{found.rpm[i]:g}",
                cells[0],
                cells[1],
                at[0],
                cells[2],
                at[1],
                unit,
            ]
        )
    said = (
        f"{found.name}, turned through {found.circle:g} deg of its rotor,"
        f" {len(found.rpm)} speeds"
    )
    heads = [
        "",
        "at rpm",
        f"at {own:g} deg",
        "worst",
        "at deg",
        "best",
        "at deg",
        "unit",
    ]
    return from_rows(
        f"{train_name(train.topology)}: phase {said}", heads, rows, left=(7,)
    )
