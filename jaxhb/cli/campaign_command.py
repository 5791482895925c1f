"""The command of campaigns: the rows of a study, and what is largest in them."""

import dataclasses
import importlib.util
import sys
from pathlib import Path
from typing import Any

from jaxhb.cli import arguments as cli
from jaxhb.cli.progress import Progress
from jaxhb.cli.resume import GOES_ON
from jaxhb.report.files import output
from jaxhb.report.files.formats import deliver
from jaxhb.report.quantities import shown_unit
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import plain_number
from jaxhb.studies.campaign import Summary, campaign as run
from jaxhb.studies.study import Study, load_study


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
        print(f"{count} cases have no answer: {problem}", file=sys.stderr)
    return output.NOT_ANSWERED if summary.problems else output.ANSWERED


def campaign_record(study: Study, summary: Summary) -> dict[str, Any]:
    """Numbers of a campaign for programs."""
    return {
        "study": study.name,
        "rows": str(summary.rows),
        "cases": summary.cases,
        "kinds": summary.kinds,
        "problems": summary.problems,
        "largest": {
            head: dataclasses.asdict(largest) | study.design_of(largest.case)
            for head, largest in summary.largest.items()
        },
    }


def campaign_text(study: Study, summary: Summary) -> str:
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
        design = study.design_of(largest.case)
        words = [f"{key} = {value}" for key, value in design.items() if value != ""]
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
