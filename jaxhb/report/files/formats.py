"""The formats of files, one table: options, names and libraries that they need, which
answers they hold, and what writes them. A new format is an entry of :data:`FORMATS`.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from jaxhb.report.files.browser import printed
from jaxhb.report.files.output import (
    STANDARD_OUTPUT,
    as_csv,
    as_json,
    as_picture,
    changed_text,
    changes,
    merged_csv,
    merged_json,
    write_files,
)
from jaxhb.report.files.spreadsheets import as_workbook, merged_workbook


@dataclass(frozen=True, kw_only=True)
class Format:
    """A kind of file that commands write.

    name : of its option, also in Python; metavar : as help spells the file; text : for
    help; kind : for people; endings : of names, () for any; libraries : those that
    write it; need, extra : the sentence that they are missing, and what brings them;
    streamed : whether it may be standard output

    content : of which content it is one: "record" (a dict), "rows" (a Sheet), "trace"
    (a Sheet), "dataset" (of xarray), "figure" (of matplotlib), "page"; "" where the
    command writes it; write : bytes of a file of this name with this content; merge :
    bytes of one file from those of several operating modes by title, None where each
    mode has a file
    """

    name: str
    metavar: str
    text: str = ""
    kind: str = "file"
    endings: tuple[str, ...] = ()
    need: str = ""
    extra: str = ""
    libraries: tuple[str, ...] = ()
    streamed: bool = False
    content: str = ""
    write: Callable[[str, Any], Iterable[bytes]] = lambda name, content: content
    merge: Callable[[Mapping[str, str], Mapping[str, Any]], Iterable[bytes]] | None = (
        None
    )

    @property
    def option(self) -> str:
        """How people know it."""
        return "FILE" if self.name == "file" else f"--{self.name}"

    @property
    def spelled(self) -> str:
        """Its option as help spells it."""
        return f"{self.option} {self.metavar}"


def _of_page(
    *,
    name: str,
    metavar: str,
    text: str,
    kind: str,
    endings: tuple[str, ...],
    write: Callable[[str, Any], Iterable[bytes]],
) -> Format:
    """A kind of file that is made of the page."""
    return Format(
        name=name,
        metavar=metavar,
        text=text,
        kind=kind,
        endings=endings,
        need="the page needs",
        extra="report",
        libraries=("jinja2", "plotly", "matplotlib"),
        content="page",
        write=write,
    )


SCENE_ENDINGS = (".toml",)

FORMATS = {
    form.name: form
    for form in (
        Format(name="file", metavar="FILE.toml", kind="scene", endings=SCENE_ENDINGS),
        Format(name="output", metavar="FILE.toml"),
        Format(name="out", metavar="FILE.toml", kind="scene", endings=SCENE_ENDINGS),
        Format(
            name="json",
            metavar="FILE",
            text=(
                "write all results in full precision, SI units; -: to standard output"
                " instead of the tables"
            ),
            streamed=True,
            content="record",
            write=lambda name, record: as_json(record),
            merge=merged_json,
        ),
        Format(
            name="csv",
            metavar="FILE",
            text="write one row per result for spreadsheets, SI units",
            streamed=True,
            content="rows",
            write=lambda name, sheet: as_csv(sheet.heads, sheet.rows),
            merge=merged_csv,
        ),
        Format(
            name="xlsx",
            metavar="FILE.xlsx",
            text="write the same rows as a workbook (needs jaxhb[spreadsheet])",
            kind="workbook",
            endings=(".xlsx",),
            need="workbooks need",
            extra="spreadsheet",
            libraries=("openpyxl",),
            content="rows",
            write=lambda name, sheet: as_workbook({"results": sheet}),
            merge=merged_workbook,
        ),
        Format(
            name="netcdf",
            metavar="FILE.nc",
            text=(
                "write labelled arrays (xarray, ncview, MATLAB, ...; needs jaxhb[data])"
            ),
            need="such files need",
            extra="data",
            libraries=("xarray",),
            content="dataset",
            # Version 3, which everything reads
            write=lambda name, data: [
                bytes(data.to_netcdf(engine="scipy", format="NETCDF3_64BIT"))
            ],
        ),
        Format(
            name="trace",
            metavar="FILE.csv",
            text=(
                "write the motion for spreadsheets: forces, torques, angles and speeds"
                " over the crank angle"
            ),
            streamed=True,
            content="trace",
            write=lambda name, sheet: as_csv(sheet.heads, sheet.rows),
        ),
        Format(
            name="plot",
            metavar="FILE.png",
            text="draw {} (.png, .svg, .pdf; needs jaxhb[plot])",
            kind="picture",
            endings=(".png", ".svg", ".pdf"),
            need="pictures need",
            extra="plot",
            libraries=("matplotlib",),
            content="figure",
            write=as_picture,
        ),
        _of_page(
            name="html",
            metavar="FILE.html",
            text=(
                "write a page to print and sign: one file, no network (needs"
                " jaxhb[report])"
            ),
            kind="page",
            endings=(".html", ".htm"),
            write=lambda name, page: [page.html()],
        ),
        _of_page(
            name="pdf",
            metavar="FILE.pdf",
            text=(
                "print that page by the browser at hand (Chromium, Chrome, Edge, or"
                " that of JAXHB_BROWSER; needs jaxhb[report])"
            ),
            kind="PDF",
            endings=(".pdf",),
            write=lambda name, page: [printed(page.html)],
        ),
        _of_page(
            name="phrases",
            metavar="FILE.toml",
            text="write all phrases of the page, to be given in other words by --words",
            kind="list of phrases",
            endings=(".toml",),
            write=lambda name, page: [page.phrases()],
        ),
    )
}
"""All formats by the names of their options."""

OF_NUMBERS = ("record", "rows", "dataset")
"""Contents that hold the numbers of answers."""


def named(arguments: Any, *contents: str) -> dict[str, str]:
    """Files that were asked for with one of these contents, by the names of their
    formats.
    """
    return {
        name: path
        for name, path in arguments.files.items()
        if FORMATS[name].content in contents
    }


def made(
    arguments: Any, makers: Mapping[str, Callable[[], Any]]
) -> dict[str, Iterable[bytes]]:
    """Make all files that were asked for, by their paths, of the contents that
    ``makers`` make; a record gets the changes of the scene.
    """
    files = {}
    for name, path in named(arguments, *makers).items():
        content = makers[FORMATS[name].content]()
        if FORMATS[name].content == "record":
            content = changes(arguments) | content
        files[path] = FORMATS[name].write(path, content)
    return files


def deliver(arguments: Any, text: str, makers: Mapping[str, Callable[[], Any]]) -> None:
    """Make all that was asked for, then write it, then print, unless a file is standard
    output; all or nothing.
    """
    files = made(arguments, makers)
    write_files(files)
    if not (arguments.quiet or STANDARD_OUTPUT in files):
        print("\n\n".join(filter(None, [text, changed_text(arguments)])))
