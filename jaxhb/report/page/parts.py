"""What was computed for a page, how tables of its parts are made, and its templates.
The only importer of jinja2.
"""

import math
import re
from dataclasses import dataclass, field

from jaxhb.report.answer import Case
from jaxhb.report.figures.figure import Figure
from jaxhb.report.selection import cylinder_of
from jaxhb.report.text.cases import worst_misfire
from jaxhb.report.text.columns import NONE, Table, from_rows, plain_number

FULL = 95  # letters of a line of text that goes on in the next
ROWS = 150  # rows of a table that are shown


class Heading(str):
    """A block of a part that stands above others."""


class Sketch(str):
    """A block of a part: the sketch of the train as SVG."""


@dataclass(frozen=True)
class Report:
    """What was computed for a page.

    cases : the train as it runs, then with misfires, at the same speeds place : number
    of the speed that is shown in full, which the user may have ``asked`` for gear :
    whose torque is shown over the cycle seconds : another design at the same speeds as
    it runs, then with the misfire that is shown, if it can have it tuning : words and
    tables that tell how it was found tolerances : figures, words and tables on what the
    tolerances of the scene do facts : where the page comes from; description, scene :
    what the scene says that it is, and its text elements, second_elements : what the
    scenes say of both designs, see :func:`elements_of` files : names of the files that
    torques and cylinders take their rows from, see :func:`element_files`
    """

    cases: list[Case]
    place: int = 0
    asked: bool = False
    gear: str | None = None
    seconds: list[Case] = field(default_factory=list)
    tuning: tuple = ()
    tolerances: tuple = ()
    facts: dict = field(default_factory=dict)
    description: str = ""
    scene: str = ""
    elements: dict = field(default_factory=dict)
    second_elements: dict = field(default_factory=dict)
    files: dict = field(default_factory=dict)

    train = property(
        lambda self: self.cases[0].answers[0].train, doc="The train as it runs."
    )
    rpm = property(
        lambda self: [answer.rpm for answer in self.cases[0].answers], doc="Speeds."
    )

    @property
    def shown(self):
        """Normal running and one misfire, that which is worst."""
        misfire = shown_misfire(self.cases)
        return self.cases[:1] if misfire is None else [self.cases[0], misfire]


def shown_misfire(cases):
    """The misfire that the page shows beside normal running, the worst; None without
    one.
    """
    if len(cases) <= 2:
        return cases[1] if len(cases) == 2 else None
    worst = worst_misfire(cases)
    known = (
        case
        for case in cases[1:]
        if worst and cylinder_of(case.title) == worst["cylinder"]
    )
    return next(known, cases[1])


def table(title, rows, heads, digits=6):
    """A :class:`Table` of rows of words and numbers, nan where there is none; None
    without rows.
    """

    def cell(value):
        if isinstance(value, str):
            return value
        return plain_number(float(value), digits) if math.isfinite(value) else NONE

    return from_rows(title, [(head, cell) for head in heads], rows) if rows else None


def flowing(text):
    """A text in which lines that are full are no lines of their own: the page breaks
    them where it likes.

    >>> flowing(f"{'long ' * 20}\\ngoes on\\n  an item").splitlines()[1:]
    ['  an item']
    """
    return re.sub(
        rf"^(?!  )(.{{{FULL},}}?)[ ]*\n(?!  )", r"\1 ", text, flags=re.MULTILINE
    )


def environment():
    """Templates, which escape what they are given."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    blocks = {"trim_blocks": True, "lstrip_blocks": True}
    made = Environment(
        loader=PackageLoader(__package__, "."),
        autoescape=True,
        undefined=StrictUndefined,
        **blocks,
    )
    made.filters |= {"words": _words, "css": _css_text}
    for name, kind in {
        "table": Table,
        "drawn": Figure,
        "heading": Heading,
        "sketch": Sketch,
    }.items():
        made.tests[name] = lambda block, kind=kind: isinstance(block, kind)
    made.globals |= {"most": ROWS}
    made.policies["json.dumps_kwargs"] = {"allow_nan": False, "ensure_ascii": False}
    return made


def _words(table):
    """Numbers of the columns that hold words, which stand at the left."""
    columns = enumerate(table.columns)
    word = re.compile("[A-Za-z]{2}|^[A-Za-z]")
    return {
        0,
        *table.left,
        *(i for i, column in columns if any(map(word.search, column))),
    }


def _css_text(text):
    """A text inside quotes in a style sheet."""
    return "".join(
        char if char.isalnum() or char in " .,-()" else f"\\{ord(char):x} "
        for char in text
    )
