"""The folder of a campaign: a Parquet file for each part, readable at every moment.

``pandas.read_parquet("FOLDER/rows")`` reads all rows so far. A file appears whole or
not at all, so that what is there is done, whatever ended the run.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb._files import clear_parts, write_whole
from jaxhb.results.checkpoint import CheckpointError, changes, versions
from jaxhb.studies.rows import Rows
from jaxhb.studies.study import Piece, Study

if TYPE_CHECKING:
    import pyarrow

MANIFEST = "campaign.json"
ROWS = "rows"
HASHED = ("trains", "changes", "speeds", "sources of jaxhb")


class CampaignFolder:
    """The folder of the rows of a study; a CheckpointError for one that holds those of
    another, or cannot be written.
    """

    def __init__(self, folder: str | Path, study: Study):
        self.folder = Path(folder)
        self.rows = self.folder / ROWS
        self.study = study
        manifest = {"numbers": study.manifest, "versions": versions()}
        try:
            self.rows.mkdir(parents=True, exist_ok=True)
            clear_parts(self.rows)
            if (self.folder / MANIFEST).exists():
                self._compare(manifest)
            elif self.done():
                raise CheckpointError(
                    f"{str(folder)!r} has rows but no {MANIFEST}. Give another folder."
                )
            else:
                text = json.dumps(manifest, indent=1, ensure_ascii=False)
                write_whole({self.folder / MANIFEST: [text.encode()]})
        except OSError as error:
            raise self._unwritten(error) from None

    def _compare(self, manifest: dict[str, Any]) -> None:
        """Refuse the rows of another study, or of other sources or versions."""
        place = repr(str(self.folder))
        try:
            stored = json.loads((self.folder / MANIFEST).read_text(encoding="utf-8"))
            differing = {
                kind: list(changes(stored[kind], values))
                for kind, values in manifest.items()
            }
        except (ValueError, KeyError, TypeError, AttributeError):
            raise CheckpointError(
                f"{place} has no readable {MANIFEST}. Give another folder."
            ) from None
        for kind, sentences in differing.items():
            for change in sentences:
                # Hashes say nothing to people.
                hashed = [name for name in HASHED if change.startswith(f"{name} ")]
                raise CheckpointError(
                    f"{place} holds a campaign with other {kind}:"
                    f" {hashed[0] if hashed else change}. Give another folder, or"
                    " remove this one."
                )

    def done(self) -> set[int]:
        """Numbers of the parts that are there."""
        return {int(path.stem) for path in self.rows.glob("[0-9]*.parquet")}

    def write(self, number: int, rows: Sequence[Rows]) -> None:
        """Write the rows of the pieces of a part."""
        import pyarrow.parquet

        pieces = zip(self.study.pieces_of(number), rows, strict=True)
        tables = [self._table(piece, of_piece) for piece, of_piece in pieces]
        content = io.BytesIO()
        pyarrow.parquet.write_table(pyarrow.concat_tables(tables), content)
        path = self.rows / f"{number:08d}.parquet"
        try:
            write_whole({path: [content.getvalue()]})
        except OSError as error:
            raise self._unwritten(error) from None

    def _table(self, piece: Piece, rows: Rows) -> pyarrow.Table:
        """The rows as a table."""
        import pyarrow

        count = len(rows.rpm)
        variant = piece.variant
        same: dict[str, Any] = {
            "scene": variant.scene,
            "scenario": variant.scenario,
            "misfire": variant.misfire,
            "sample": piece.sample,
        }
        # Every file has the columns of all scenes.
        same |= {name: rows.numbers.get(name, np.nan) for name in self.study.numbers}
        columns: dict[str, Any] = {"case": piece.case + np.arange(count)}
        columns |= {name: np.repeat(value, count) for name, value in same.items()}
        columns |= {
            "rpm": rows.rpm,
            "kind": rows.kind,
            "period": rows.period,
            "status": rows.status,
            "problem": rows.problem,
        }
        columns |= dict(zip(self.study.columns, rows.values.T, strict=True))
        return pyarrow.table(columns)

    def columns(self, names: list[str]) -> Iterator[dict[str, np.ndarray]]:
        """Yield columns of all rows, some rows at a time."""
        import pyarrow.dataset

        batches = pyarrow.dataset.dataset(self.rows, format="parquet").to_batches(
            columns=names
        )
        for batch in batches:
            yield {
                name: batch.column(name).to_numpy(zero_copy_only=False)
                for name in names
            }

    def _unwritten(self, error: OSError) -> CheckpointError:
        return CheckpointError(
            f"{str(self.folder)!r} cannot be written: {error.strerror}. What is in it"
            " stays: mend that, and the same campaign goes on."
        )
