"""A campaign: the rows of a study, part by part, by whatever executor there is.

Parts are handed out a few for each worker, and rows are written by this process as they
come: it holds nothing of those that are done, and goes on where it was stopped.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from jaxhb._executors import WorkerLost, in_parts
from jaxhb.studies.folder import CampaignFolder
from jaxhb.studies.rows import LOST, Rows, rows_of, without_answer
from jaxhb.studies.study import Piece, Study, load_study

PLACE = ("scene", "scenario", "misfire", "sample")


@dataclass(frozen=True)
class Largest:
    """The largest value of a quantity over all rows, its case and speed, and what makes
    the train: columns of its row.
    """

    value: float
    case: int
    rpm: float
    train: dict[str, Any]


@dataclass
class CampaignSummary:
    """Summary of the rows of a campaign.

    rows : the folder that holds them; cases : their number; kinds : how many there are
    of each kind of motion; problems : of each problem; largest : by the heads of the
    quantities
    """

    rows: Path
    cases: int = 0
    kinds: dict[str, int] = field(default_factory=dict)
    problems: dict[str, int] = field(default_factory=dict)
    largest: dict[str, Largest] = field(default_factory=dict)


def campaign(
    study: Study | str | Path,
    *,
    folder: str | Path,
    executor: Executor | None = None,
    progress: Callable[[int], object] | None = None,
) -> CampaignSummary:
    """Compute all cases of a study, and write them to a folder as rows.

    Rows are in ``folder/rows``, a Parquet file for each part, which
    ``pandas.read_parquet`` reads at every moment; ``docs/how_to/campaigns.md`` has the
    columns. The same call goes on where it was stopped, whatever stopped it, and loses
    no more than the parts under way. A train that is refused, a speed that fails and
    one that kills its worker are rows with a problem, and stop nothing. Needs
    ``jaxhb[cluster]``.

    Parameters
    ----------
    study : Study, or the path of its file
    folder : path
    executor : concurrent.futures.Executor, optional
        Where parts are computed: :class:`jaxhb.Workers`, :class:`jaxhb.Cluster`, or any
        other; by default in this process. Rows are the same to the last bit on the same
        kind of machine.
    progress : callable, optional
        Called with the number of cases that are there already, then with those done
        since the last call.

    Returns
    -------
    CampaignSummary

    Raises
    ------
    SceneError
        Faults of the study, one sentence each.
    CheckpointError
        The folder holds another campaign, or cannot be written.

    Examples
    --------
    >>> import jaxhb
    >>> done = jaxhb.campaign("damper.toml", folder="damper")  # doctest: +SKIP
    """
    study = study if isinstance(study, Study) else load_study(study)
    report = progress or (lambda count: None)
    rows_folder = CampaignFolder(folder, study)
    done = rows_folder.done()
    report(sum(map(study.cases_of, done)))
    missing = [number for number in range(study.parts) if number not in done]
    # The first alone compiles what all others need.
    for numbers in (missing[:1], missing[1:]):
        for number, rows in _computed(study, numbers, executor):
            rows_folder.write(number, rows)
            report(study.cases_of(number))
    return summary(rows_folder)


def _computed(
    study: Study, numbers: Sequence[int], executor: Executor | None
) -> Iterator[tuple[int, list[Rows]]]:
    """Yield the numbers of parts and the rows of their pieces, as they come."""

    def lost(place: int, failure: WorkerLost) -> list[Rows]:
        pieces = study.pieces_of(numbers[place])
        return [_one_by_one(piece, executor) for piece in pieces]

    parts = ((study.pieces_of(number),) for number in numbers)
    for place, rows in in_parts(rows_of, parts, executor, lost):
        yield numbers[place], rows


def _one_by_one(piece: Piece, executor: Executor | None) -> Rows:
    """Rows of a piece of a part that killed its workers: each speed by itself, so that
    one alone has no answer.
    """
    singles = [
        dataclasses.replace(piece, case=piece.case + place, rpm=piece.rpm[[place]])
        for place in range(len(piece.rpm))
    ]

    def lost(place: int, failure: WorkerLost) -> list[Rows]:
        return [without_answer(singles[place], LOST, str(failure))]

    parts = (([single],) for single in singles)
    by_place = dict(in_parts(rows_of, parts, executor, lost))
    together = Rows(piece.rpm, {}, np.empty((0, len(piece.keep))))
    for place in range(len(singles)):
        (rows,) = by_place[place]
        together.numbers = rows.numbers
        together.values = np.concatenate([together.values, rows.values])
        together.kind += rows.kind
        together.period += rows.period
        together.status += rows.status
        together.problem += rows.problem
    return together


def summary(rows_folder: CampaignFolder) -> CampaignSummary:
    """Summarise the rows that are there."""
    study = rows_folder.study
    of_train = [*PLACE, *study.numbers]
    columns = [*of_train, "case", "rpm", "kind", "problem", *study.columns]
    result = CampaignSummary(rows_folder.rows)
    for rows in rows_folder.columns(columns):
        result.cases += len(rows["case"])
        for name, counts in (("kind", result.kinds), ("problem", result.problems)):
            words, numbers = np.unique(rows[name].astype(str), return_counts=True)
            for word, number in zip(words, numbers, strict=True):
                counts[str(word)] = counts.get(str(word), 0) + int(number)
        for head in study.columns:
            values = np.where(np.isnan(rows[head]), -np.inf, rows[head])
            place = int(np.argmax(values))
            before = result.largest.get(head)
            if values[place] > (-np.inf if before is None else before.value):
                train = {name: rows[name][place] for name in of_train}
                result.largest[head] = Largest(
                    float(values[place]),
                    int(rows["case"][place]),
                    float(rows["rpm"][place]),
                    {
                        name: value.item() if hasattr(value, "item") else value
                        for name, value in train.items()
                    },
                )
    result.problems.pop("", None)
    return result
