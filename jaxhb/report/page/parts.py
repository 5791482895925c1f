"""The answers for a page, the tables of its parts, and its templates. The only importer
of jinja2.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb.linear.critical import campbell
from jaxhb.linear.forced import ForcedResponse
from jaxhb.linear.heat import heat_balance
from jaxhb.linear.strength import Strength, strength, train_of
from jaxhb.report.answer import Case
from jaxhb.report.figures.figure import Figure
from jaxhb.report.figures.linear import counting
from jaxhb.report.figures.plotly import layout_of
from jaxhb.report.page.words import Words
from jaxhb.report.selection import cylinder_of, is_linear
from jaxhb.report.table import Column, Table
from jaxhb.report.text.cases import worst_misfire
from jaxhb.report.text.columns import NONE, plain_number
from jaxhb.report.text.strength import answers_strength
from jaxhb.results.answers import with_gaps
from jaxhb.scene.title_block import TitleBlock
from jaxhb.train.drivetrain import DriveTrain

if TYPE_CHECKING:
    from jinja2 import Environment

Block = str | Figure | None
"""A block of a part: words, a :class:`Heading`, a :class:`Sketch`, a table or a figure;
None shows nothing.
"""

FULL = 95  # letters of a line of text that goes on in the next
# Speeds of the linear forced response at least
SPEEDS = 201
CAMPBELL_SPEEDS = 33
ROWS = 150  # rows of a table that are shown
SHORT = 26  # letters of names that are not broken in a table


class Heading(str):
    """A block of a part that stands above others."""


class Sketch(str):
    """A block of a part: the sketch of the train as SVG."""


class Strip(str):
    """A block of a part: a strip of the equivalent system as SVG."""


@dataclass(frozen=True)
class Report:
    """The answers for a page, and what else it shows.

    cases : the train as it runs, then with misfires, at the same speeds; place : number
    of the speed that is shown in full, which the user may have asked for
    (``place_asked``); gear : whose torque is shown over the cycle; seconds : another
    design at the same speeds as it runs, then with the misfire that is shown, if it can
    have it; tuning : words and tables that tell how it was found; tolerances : figures,
    words and tables on the effects of the tolerances of the scene; transient : words,
    tables and figures of a transient; facts : where the
    page comes from; title, logo : title block, and its picture as an address that holds
    it; mode : operating mode of the scene; description, scene : the description in the
    scene, and its text; elements, second_elements : the elements of the scenes of both
    designs by name, see :func:`jaxhb.scene.writer.elements_of`; files : names of the
    files that torques and cylinders take their rows from, see
    :func:`jaxhb.scene.writer.element_files`
    """

    cases: list[Case]
    place: int = 0
    place_asked: bool = False
    gear: str | None = None
    seconds: list[Case] = field(default_factory=list)
    tuning: tuple = ()
    tolerances: tuple = ()
    transient: tuple = ()
    facts: dict[str, str] = field(default_factory=dict)
    title: TitleBlock = field(default_factory=TitleBlock)
    logo: str = ""
    mode: str = ""
    description: str = ""
    scene: str = ""
    elements: dict[str, Any] = field(default_factory=dict)
    second_elements: dict[str, Any] = field(default_factory=dict)
    files: dict[str, list[dict[str, str]]] = field(default_factory=dict)

    @property
    def train(self) -> DriveTrain:
        """The train as it runs."""
        return self.cases[0].answers[0].train

    @property
    def rpm(self) -> list[float]:
        """Speeds."""
        return [answer.rpm for answer in self.cases[0].answers]

    @property
    def has_backlash(self) -> bool:
        """Whether any mesh has backlash; without, the train is linear."""
        return any(self.train.topology.mesh_backlash)

    @property
    def is_linear(self) -> bool:
        """Whether the linear forced response is the whole answer."""
        return is_linear(self.train.topology)

    @cached_property
    def fine_rpm(self) -> np.ndarray:
        """Speeds of linear calculations, those of the answers among them, and the
        critical speeds that count: they cost little, and peaks are sharp.
        """
        low = min(self.rpm)
        high = max(self.rpm)
        more = np.linspace(low, high, SPEEDS)  # of one speed it is that again
        critical = []
        if high > low:
            diagram = campbell(self.train, rpm=np.linspace(low, high, CAMPBELL_SPEEDS))
            critical = [round(float(speed.rpm), 2) for speed in counting(diagram)]
        return np.unique([*self.rpm, *more, *critical])

    @cached_property
    def responses(self) -> dict[str, ForcedResponse]:
        """Linear forced response of every case by its title, at ``fine_rpm``."""
        return {
            case.title: heat_balance(case.answers[0].train, rpm=self.fine_rpm)
            for case in self.cases
        }

    @cached_property
    def strengths(self) -> dict[str, Strength]:
        """Every case beside the limits of the scene, by its title: a linear train at
        ``fine_rpm``, others at the speeds of their answers.
        """
        if not self.is_linear:
            return {case.title: answers_strength(case.answers) for case in self.cases}
        return {
            title: strength(with_gaps(response), train=train_of(response))
            for title, response in self.responses.items()
        }

    @property
    def shown(self) -> list[Case]:
        """Normal running and the worst misfire."""
        misfire = shown_misfire(self.cases)
        return self.cases[:1] if misfire is None else [self.cases[0], misfire]


def shown_misfire(cases: Sequence[Case]) -> Case | None:
    """Choose the misfire that the page shows beside normal running, the worst; None
    without one.
    """
    if len(cases) <= 2:
        return cases[1] if len(cases) == 2 else None
    worst = worst_misfire(cases)
    worst_cases = (
        case
        for case in cases[1:]
        if worst and cylinder_of(case.title) == worst["cylinder"]
    )
    return next(worst_cases, cases[1])


def table(
    title: str,
    rows: Sequence[Sequence[str | float]],
    heads: Sequence[str],
    digits: int = 6,
) -> Table | None:
    """Make a :class:`Table` of rows of words and numbers, nan where there is none; None
    without rows.
    """

    def cell(value: str | float) -> str:
        if isinstance(value, str):
            return value
        return plain_number(float(value), digits) if math.isfinite(value) else NONE

    return Table(title, [Column(head, cell) for head in heads], rows) if rows else None


def without(table: Table, heads: Collection[str] = (), rows: int = ROWS) -> Table:
    """Leave out the columns of a table with some heads and those of zeros only, and
    all rows behind the first ``rows``.
    """
    groups = {
        place: title
        for title, first, last in table.groups
        for place in range(first, last + 1)
    }
    kept = [
        place
        for place, (head, cells) in enumerate(
            zip(table.heads, table.columns, strict=True)
        )
        if head not in heads and not all(cell == "0" for cell in cells)
    ]
    columns = [
        Column(
            table.heads[place],
            group=groups.get(place, ""),
            left=place in table.left,
        )
        for place in kept
    ]
    cells = [table.columns[place][:rows] for place in kept]
    return Table(table.caption, columns, zip(*cells, strict=True), marked=table.marked)


def flowing(text: str) -> str:
    """Join lines that are full with the next: the page breaks them where it likes.

    >>> flowing(f"{'long ' * 20}\\ngoes on\\n  an item").splitlines()[1:]
    ['  an item']
    """
    return re.sub(
        rf"^(?!  )(.{{{FULL},}}?)[ ]*\n(?!  )", r"\1 ", text, flags=re.MULTILINE
    )


def environment(words: Words | None = None) -> Environment:
    """Make the environment of templates, which escape their arguments and replace
    phrases by ``words``.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    assert __package__ is not None
    templates = Environment(
        loader=PackageLoader(__package__, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    words = words or Words()
    templates.filters |= {
        "left": _words,
        "short": _short,
        "unbroken": unbroken,
        "css": _css_text,
        "layout": layout_of,
        "told": words,
        "told_figure": words.figure,
        "told_drawing": words.drawing,
    }
    kinds = {
        "table": Table,
        "drawn": Figure,
        "heading": Heading,
        "sketch": Sketch,
        "strip": Strip,
    }
    for name, kind in kinds.items():
        templates.tests[name] = lambda block, kind=kind: isinstance(block, kind)
    templates.globals |= {"most": ROWS}
    templates.policies["json.dumps_kwargs"] = {
        "allow_nan": False,
        "ensure_ascii": False,
    }
    return templates


def _words(table: Table) -> set[int]:
    """Number the columns that hold words, which stand at the left."""
    word = re.compile("[A-Za-z]{2}|^[A-Za-z]")
    return table.left | {
        place
        for place, column in enumerate(table.columns)
        if any(map(word.search, column))
    }


def _short(table: Table) -> set[int]:
    """Number the columns of words that stay on one line: other columns are narrowed
    before them.
    """
    return {
        place
        for place, column in enumerate(table.columns)
        if max(map(len, column), default=0) <= SHORT
    }


def unbroken(text: str, *, hyphens: bool = False) -> str:
    """Keep together what a line must not break: units of two words, in heads of
    columns words with ``hyphens``; elsewhere these stay as people search them.

    >>> unbroken("half p-p, kN m", hyphens=True).split(" ")
    ['half', 'p\u2011p,', 'kN\xa0m']
    """
    if hyphens:
        text = re.sub(r"(?<=\w)-(?=\w)", "\u2011", text)
    return re.sub(r"\b([kM]?N) (?=m\b)", "\\1\u00a0", text)


def _css_text(text: str) -> str:
    """Escape a text inside quotes in a style sheet."""
    return "".join(
        char if char.isalnum() or char in " .,-()" else f"\\{ord(char):x} "
        for char in text
    )
