"""Commands of many trains: the worst case of tolerances, the worst phase between two
engines, and campaigns.
"""

import dataclasses
import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxhb.cli import arguments as cli
from jaxhb.cli.commands import status
from jaxhb.cli.operating_modes import compare
from jaxhb.cli.progress import Progress
from jaxhb.cli.resume import GOES_ON, Unfinished
from jaxhb.design.phases import WorstPhase, worst_phase
from jaxhb.design.quantities import Objective, read_quantity, unit_of
from jaxhb.design.tolerances import read_tolerances
from jaxhb.design.worst_case import Spread, tolerance as search
from jaxhb.elements.sentences import SceneError, suggestion
from jaxhb.report.compute import check_spread
from jaxhb.report.figures.speeds import plot_tolerance
from jaxhb.report.files import numbers, output
from jaxhb.report.files.compared import of_worst
from jaxhb.report.files.formats import deliver
from jaxhb.report.selection import train_name
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import plain_number
from jaxhb.report.text.tolerances import (
    tolerance_parts,
    tolerance_record,
    tolerance_rows,
)
from jaxhb.report.units import shown_unit
from jaxhb.studies.campaign import PLACE, CampaignSummary, campaign as run
from jaxhb.studies.study import Study, load_study
from jaxhb.train.drivetrain import DriveTrain


def tolerance(train: DriveTrain, arguments: cli.ToleranceOptions) -> int:
    """Find what the tolerances of a scene do to its response."""
    tolerances = read_tolerances(train)
    quantities = _quantities(arguments.of)
    samples = arguments.samples or 0
    seed = arguments.seed or 0
    accuracy = (arguments.harmonics, arguments.tolerance)
    unfinished = Unfinished(
        [train],
        ("tolerance", arguments.rpm, quantities, tolerances, samples, seed, accuracy),
    )
    with Progress(quiet=arguments.quiet) as progress:

        def compute(folder: Any) -> Spread:
            return search(
                train,
                rpm=np.array(arguments.rpm),
                of=quantities,
                samples=samples,
                seed=seed,
                harmonics=arguments.harmonics,
                tolerance=arguments.tolerance,
                progress=progress.say,
                out=folder,
                executor=arguments.executor,
            )

        spread = unfinished.run(compute, unfinished.left)
        checked = check_spread(spread, progress.say)
    rows = list(tolerance_rows(spread, checked))
    makers = {
        "record": lambda: numbers.on_scene(train) | tolerance_record(spread, checked),
        "rows": lambda: output.sheet(rows),
        "dataset": spread.to_xarray,
        "figure": lambda: plot_tolerance(spread),
    }
    deliver(arguments, "\n\n".join(tolerance_parts(spread, checked)), makers)
    compare(arguments, lambda: of_worst(rows))
    unfinished.forget()
    return output.ANSWERED if spread.answered.all() else output.NOT_ANSWERED


def _quantities(texts: Sequence[str]) -> tuple[Objective, ...]:
    """The quantities of ``--of``."""
    try:
        return tuple(map(read_quantity, texts))
    except ValueError as fault:
        raise output.OutputError(f"--of: {fault}") from None


def phase(train: DriveTrain, arguments: cli.PhaseOptions) -> int:
    """Find the worst phase of an engine."""
    names = train.topology.phase_names
    if arguments.name is None and len(names) != 1:
        advice = " The scene has no [[phase]]: docs/how_to/strength.md has one."
        if names:
            advice = suggestion("", names)
        raise SceneError(f"{train.topology.title}: --phase: name one.{advice}")
    name = arguments.name or names[0]
    quantities = _quantities(arguments.of)
    with Progress(quiet=arguments.quiet) as progress:
        worst = worst_phase(
            train,
            name,
            rpm=arguments.rpm,
            of=quantities,
            phases=arguments.phases,
            progress=progress.say,
        )
    rows = _phase_rows(worst)
    record = {
        "phase": name,
        "circle_deg": worst.circle,
        "angle_deg": train.value(f"{name}.angle"),
        "rpm": worst.rpm,
        "phases": rows,
        "left_out": worst.left_out,
    }
    makers = {
        "record": lambda: numbers.on_scene(train) | record,
        "rows": lambda: output.sheet(rows),
    }
    deliver(arguments, _phase_text(train, worst), makers)
    compare(arguments, lambda: of_worst(rows))
    return status(worst.left_out)


def _phase_rows(worst: WorstPhase) -> list[dict]:
    """A row by heads for each speed and quantity."""
    rows = []
    for i, speed in enumerate(worst.rpm):
        for j, objective in enumerate(worst.of):
            rows.append(
                {
                    "rpm": speed,
                    "quantity": worst.labels[j],
                    "unit": unit_of(objective.quantity),
                    "nominal": worst.nominal[i, j],
                    "worst": worst.worst[i, j],
                    "angle": worst.angle[i, j],
                    "best": worst.best[i, j],
                    "best_angle": worst.best_angle[i, j],
                }
            )
    return rows


def _phase_text(train: DriveTrain, worst: WorstPhase) -> str:
    """A row for each quantity, at the speed at which its worst phase is worst."""
    rows = []
    for j, objective in enumerate(worst.of):
        solved = np.flatnonzero(np.isfinite(worst.worst[:, j]))
        factor, unit = shown_unit(unit_of(objective.quantity))
        if not len(solved):
            rows.append([worst.labels[j], *["-"] * 6, unit])
            continue
        i = solved[np.argmax(worst.worst[solved, j])]
        rows.append(
            [
                worst.labels[j],
                f"{worst.rpm[i]:g}",
                plain_number(factor * worst.nominal[i, j]),
                plain_number(factor * worst.worst[i, j]),
                f"{worst.angle[i, j]:.1f}",
                plain_number(factor * worst.best[i, j]),
                f"{worst.best_angle[i, j]:.1f}",
                unit,
            ]
        )
    angle = float(train.value(f"{worst.name}.angle"))
    return Table(
        f"{train_name(train.topology)}: phase {worst.name}, turned through"
        f" {worst.circle:g} deg of its rotor, {len(worst.rpm)} speeds",
        [
            "",
            "at rpm",
            f"at {angle:g} deg",
            "worst",
            "at deg",
            "best",
            "at deg",
            Column("unit", left=True),
        ],
        rows,
    )


def campaign(arguments: cli.CampaignOptions) -> int:
    """Compute the cases of a study."""
    if importlib.util.find_spec("pyarrow") is None:
        raise output.OutputError(
            'campaign: it needs pyarrow. Install it: pip install "jaxhb[cluster]".'
        )
    study = load_study(arguments.study)
    folder = Path(arguments.folder or study.name)
    with Progress(study.cases, quiet=arguments.quiet) as progress:
        progress.say("cases")
        try:
            counts = iter([progress.resume])
            summary = run(
                study,
                folder=folder,
                executor=arguments.executor,
                progress=lambda count: next(counts, progress.advance)(count),
            )
        except KeyboardInterrupt as stop:
            stop.add_note(
                f"{progress.done} of {study.cases} cases are done in {str(folder)!r};"
                f" {GOES_ON}"
            )
            raise
    deliver(
        arguments,
        campaign_text(study, summary),
        {"record": lambda: campaign_record(study, summary)},
    )
    for problem, count in summary.problems.items():
        cases = "1 case has" if count == 1 else f"{count} cases have"
        print(f"{cases} no answer: {problem}", file=sys.stderr)
    return output.NOT_ANSWERED if summary.problems else output.ANSWERED


def campaign_record(study: Study, summary: CampaignSummary) -> dict[str, Any]:
    """Numbers of a campaign for programs."""
    return {
        "study": study.name,
        "rows": str(summary.rows),
        "cases": summary.cases,
        "kinds": summary.kinds,
        "problems": summary.problems,
        "largest": {
            head: dataclasses.asdict(largest)
            for head, largest in summary.largest.items()
        },
    }


def campaign_text(study: Study, summary: CampaignSummary) -> str:
    """The summary of a campaign for people."""
    kinds = ", ".join(f"{count} {kind}" for kind, count in summary.kinds.items())
    head = (
        f"{summary.cases} cases ({study.designs} trains, {len(study.rpm)} speeds) are"
        f" in {str(summary.rows)!r}: {kinds}."
    )
    rows = []
    for name, largest in summary.largest.items():
        quantity, _, unit = name.rstrip("]").partition(" [")
        factor, people_unit = shown_unit(unit)
        # Text that is empty, and sample -1, stand for none.
        words = [
            f"{key} = {value:.6g}" if isinstance(value, float) else f"{key} = {value}"
            for key, value in largest.train.items()
            if not (key in PLACE and value in ("", -1))
        ]
        rows.append(
            [
                quantity,
                plain_number(factor * largest.value),
                people_unit,
                f"{largest.rpm:.6g}",
                str(largest.case),
                ", ".join(words),
            ]
        )
    table = Table(
        "Largest values",
        [
            "",
            "value",
            Column("unit", left=True),
            "at rpm",
            "case",
            Column("train", left=True),
        ],
        rows,
    )
    return f"{head}\n\n{table}" if rows else head
