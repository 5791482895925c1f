"""The page of a report: one HTML file without a network, to be printed and signed. The
only importer of plotly.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

from jaxhb.report.figures.figure import Figure
from jaxhb.report.page.elements import over_the_speed
from jaxhb.report.page.first_page import compliance, operating_modes, result
from jaxhb.report.page.judgement import accuracy, limits, notes_of
from jaxhb.report.page.linear import campbell, forced, modes
from jaxhb.report.page.motion import (
    dampers,
    forces_over_speed,
    gears,
    motions,
    one_speed,
    second_design,
    shafts,
    transient,
)
from jaxhb.report.page.parts import Block, Heading, Report, environment
from jaxhb.report.page.train import assumptions, train_data
from jaxhb.report.page.words import Words, names_of
from jaxhb.report.table import Table

PARTS: dict[str, Callable[[Report], list[Block]]] = {
    "Result": result,
    "Statement of compliance": compliance,
    "Operating modes": operating_modes,
    "Train and data": train_data,
    "Assumptions and versions": assumptions,
    "Natural frequencies": modes,
    "Campbell diagram and critical speeds": campbell,
    "Linear forced response": forced,
    "Elements over the speed": over_the_speed,
    "Motion over the speed": motions,
    "Tooth forces": forces_over_speed,
    "Torques of gears": gears,
    "Torques of shafts and dampers": shafts,
    "Heat of dampers": dampers,
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

KEEP = '<div class="keep">'
LONG = 16  # rows of a table that may go on on the next page


@dataclass(frozen=True)
class Part:
    """A part of the page: its HTML, of which the ``first`` stays on the page of the
    title unless it is ``long``, the blocks that it is made of, and whether it could
    not be made.
    """

    title: str
    first: str
    rest: str
    blocks: list[Block]
    failed: bool
    long: bool = False

    @property
    def html(self) -> str:
        """All of it."""
        return self.first + self.rest


@dataclass(frozen=True)
class Page:
    """A page: its report, the parts that were made of it, and its ``words``."""

    report: Report
    parts: list[Part]
    words: Words

    @property
    def whole(self) -> bool:
        """Whether every part could be made."""
        return not any(part.failed for part in self.parts)

    def html(self, numbers: Mapping[str, int] = MappingProxyType({})) -> bytes:
        """Write the page as the bytes of a file, with the ``numbers`` of the pages on
        which its parts begin, where they are known; scripts, styles and numbers are
        inside, nothing is loaded when it is opened.
        """
        return self._written(numbers) if numbers else self._unnumbered

    @cached_property
    def _unnumbered(self) -> bytes:
        """The page without numbers of pages, which is written, printed and asked for
        its phrases.
        """
        return self._written({})

    def _written(self, numbers: Mapping[str, int]) -> bytes:
        """Fill the template."""
        from plotly.offline import get_plotlyjs

        return (
            environment(self.words)
            .get_template("page.html")
            .render(
                parts=self.parts,
                words=self.words,
                report=self.report,
                numbers=numbers,
                script=get_plotlyjs(),
            )
            .encode()
        )

    def phrases(self) -> bytes:
        """Write a file of all phrases of the page, to be replaced by others."""
        self.html()
        return self.words.template()


def as_page(report: Report, phrases: Mapping[str, str] = MappingProxyType({})) -> Page:
    """Make the page of a :class:`Report`, with phrases in the place of English ones."""
    facts = [text for fact, text in report.facts.items() if fact != "changes"]
    more = [report.description, report.mode, *facts]
    names = names_of(report.train.topology, more)
    words = Words(phrases, names)
    return Page(report, parts_of(report, PARTS, words), words)


def parts_of(
    report: Report,
    sources: Mapping[str, Callable[[Report], list[Block]]],
    words: Words | None = None,
) -> list[Part]:
    """Make all parts that concern the train; a failure is a sentence in the part, and
    on stderr.
    """
    parts = []
    macros: Any = environment(words).get_template("show.html").module
    show = macros.show
    for title, gather in sources.items():
        failed = False
        try:
            blocks = gather(report)
            groups = together(list(filter(None, blocks)))
            texts = [_shown(group, show) for group in groups]
        except Exception as error:  # whatever it is, the other parts are of use
            kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
            reason = f"{kind}{error}"
            print(
                f"--html: {title!r} is missing from the page: {reason}", file=sys.stderr
            )
            blocks = [f"This part could not be made: {reason}"]
            failed = True
            groups = [blocks]
            texts = [show(blocks[0])]
        if blocks:
            rest = (
                text if len(group) == 1 or is_long(group) else f"{KEEP}{text}</div>"
                for group, text in zip(groups[1:], texts[1:], strict=True)
            )
            first = Part(title, texts[0], "".join(rest), blocks, failed)
            parts.append(replace(first, long=is_long(groups[0])))
    return parts


def _shown(group: Sequence[Block], show: Callable[[Block], str]) -> str:
    """Show blocks that stay together, two narrow figures side by side."""
    narrow = [isinstance(each, Figure) and each.narrow for each in group]
    begins = narrow.index(True) if True in narrow else len(group)
    beside = "".join(map(show, group[begins:]))
    pair = f'<div class="pair">{beside}</div>' if beside else ""
    return "".join(map(show, group[:begins])) + pair


def is_long(group: Sequence[Block]) -> bool:
    """Tell whether blocks may fill a page: they end with a long table."""
    last = group[-1]
    return isinstance(last, Table) and len(last.columns[0]) >= LONG


def together(blocks: Sequence[Block]) -> list[list[Block]]:
    """Group blocks that stay on one page: headings with what they stand above, words
    with which a part begins with a figure behind them, and two narrow figures.

    >>> together([Heading("a"), "b", "c"])
    [['a', 'b'], ['c']]
    """
    groups: list[list[Block]] = []
    goes_on = False
    for place, block in enumerate(blocks):
        if goes_on:
            groups[-1].append(block)
        else:
            groups.append([block])
        behind = blocks[place + 1] if place + 1 < len(blocks) else None
        if isinstance(block, Figure) and block.narrow:
            narrow = sum(isinstance(each, Figure) for each in groups[-1])
            follows = isinstance(behind, Figure) and behind.narrow
            goes_on = follows and narrow % 2 == 1
        else:
            begins = place == 0 and type(block) is str
            goes_on = isinstance(block, Heading) or (
                begins and isinstance(behind, Figure | Heading)
            )
    return groups
