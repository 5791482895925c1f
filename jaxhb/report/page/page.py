"""The page of a report: one HTML file without a network, to be printed and signed. The
only importer of plotly.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from jaxhb.report.page.first_page import compliance, operating_modes, result
from jaxhb.report.page.judgement import accuracy, limits, notes_of
from jaxhb.report.page.linear import campbell, forced, modes
from jaxhb.report.page.motion import (
    forces_over_speed,
    motions,
    one_speed,
    second_design,
    swings,
    transient,
)
from jaxhb.report.page.parts import Block, Report, environment
from jaxhb.report.page.train import assumptions, train_data
from jaxhb.report.quantities import angles, gear_torques, heat, shaft_torques

PARTS: dict[str, Callable[[Report], list[Block]]] = {
    "Result": result,
    "Statement of compliance": compliance,
    "Operating modes": operating_modes,
    "Train and data": train_data,
    "Assumptions and versions": assumptions,
    "Natural frequencies": modes,
    "Campbell diagram and critical speeds": campbell,
    "Linear forced response": forced,
    "Motion over the speed": motions,
    "Tooth forces": forces_over_speed,
    "Torques of gears": lambda report: swings(gear_torques(report.train), report.shown),
    "Torques of shafts and dampers": lambda report: swings(
        (shaft_torques if report.train.topology.link_names else angles)(report.train),
        report.shown,
    ),
    "Heat of dampers": lambda report: swings(heat(report.train), report.shown),
    "One speed in full": one_speed,
    "Transient": transient,
    "Limits": limits,
    "Tolerances": lambda report: list(report.tolerances),
    "Second design": second_design,
    "Accuracy and computed bounds": accuracy,
    "Notes": notes_of,
}
"""The parts of the page by their titles and in its order: functions of the report to a
list of blocks (words, headings, tables, figures), an empty one where the part does not
concern the train.
"""


@dataclass(frozen=True)
class Part:
    """A part of the page: its HTML, the blocks that it is made of, and whether it could
    not be made.
    """

    title: str
    html: str
    blocks: list[Block]
    failed: bool


def as_page(report: Report) -> tuple[list[bytes], bool]:
    """Write the page of a :class:`Report` as the bytes of a file, and tell whether
    every part of it could be made; scripts, styles and numbers are inside, nothing is
    loaded when it is opened.
    """
    from plotly.offline import get_plotlyjs

    parts = parts_of(report, PARTS)
    text = (
        environment()
        .get_template("page.html")
        .render(parts=parts, report=report, script=get_plotlyjs())
    )
    return [text.encode()], not any(part.failed for part in parts)


def parts_of(
    report: Report, sources: Mapping[str, Callable[[Report], list[Block]]]
) -> list[Part]:
    """Make all parts that concern the train; a failure is a sentence in the part, and
    on stderr.
    """
    parts = []
    macros: Any = environment().get_template("show.html").module
    show = macros.show
    for title, gather in sources.items():
        failed = False
        try:
            blocks = gather(report)
            html = "".join(map(show, blocks))
        except Exception as error:  # whatever it is, the other parts are of use
            kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
            reason = f"{kind}{error}"
            print(
                f"--html: {title!r} is missing from the page: {reason}", file=sys.stderr
            )
            blocks = [f"This part could not be made: {reason}"]
            failed = True
            html = show(blocks[0])
        if blocks:
            parts.append(Part(title, html, blocks, failed))
    return parts
