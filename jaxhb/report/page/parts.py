"""What the page tells, in plain Python: numbered parts of words, tables and figures; a part that fails says so."""

import sys
from dataclasses import dataclass

from jaxhb.report.answer import Case
from jaxhb.report.selection import NOT_FIRING
from jaxhb.report.text.cases import worst_misfire

FULL = 95
"""Letters of a line of text that goes on in the next."""


@dataclass(frozen=True)
class Part:
    """A part of the page: words (str), tables (:class:`Table`), figures and pictures, in the order of the page."""

    title: str
    blocks: list
    failed: bool = False


class Heading(str):
    """A heading inside a part."""


@dataclass(frozen=True)
class Picture:
    """A drawing that does not change: a caption and its text as SVG."""

    caption: str
    svg: str


@dataclass(frozen=True)
class Report:
    """What was computed for a page.

    Parameters
    ----------
    cases : list of Case
        The train as it runs, then with misfires; the same speeds.
    place : int
        Number of the speed at which the cycle is shown and computed bounds are asked for.
    asked : bool
        Whether the user chose that speed.
    gear : str, optional
        Gear whose torque is shown over the cycle.
    second : Case, optional
        Another design at the same speeds, as it runs.
    second_misfire : Case, optional
        The same with the misfire that is shown.
    tuning : list, optional
        Words and tables that tell how the second design was found.
    facts : dict
        Where the page comes from, by what it is: the scene, its changes, the command, versions.
    description, scene : str
        What the scene says that it is, and its text as it was read.
    files : dict
        Names of the files that torques and cylinders take their rows from, see :func:`element_files`.
    """

    cases: list[Case]
    place: int = 0
    asked: bool = False
    gear: str | None = None
    second: Case | None = None
    second_misfire: Case | None = None
    tuning: tuple = ()
    facts: dict | None = None
    description: str = ""
    scene: str = ""
    files: dict | None = None

    @property
    def train(self):
        """The train as it runs."""
        return self.cases[0].answers[0].train

    @property
    def name(self):
        """Name of the scene."""
        return self.train.topology.name or "scene"

    @property
    def rpm(self):
        """Speeds."""
        return [answer.rpm for answer in self.cases[0].answers]

    @property
    def seconds(self):
        """All cases of the second design."""
        return [case for case in (self.second, self.second_misfire) if case is not None]

    @property
    def shown(self):
        """Normal running and one misfire, that which is worst."""
        misfire = shown_misfire(self.cases)
        return self.cases[:1] if misfire is None else [self.cases[0], misfire]


def shown_misfire(cases):
    """The misfire that the page shows beside normal running, the worst; None without one."""
    if len(cases) <= 2:
        return cases[1] if len(cases) == 2 else None
    worst = worst_misfire(cases)
    title = worst["cylinder"] + NOT_FIRING if worst else cases[1].title
    return next(case for case in cases if case.title == title)


def flowing(text):
    """A text in which lines that are full are no lines of their own: the page breaks them where it likes.

    Examples
    --------
    >>> flowing(f"{'long ' * 20}\\ngoes on\\n  an item").splitlines()[1:]
    ['  an item']
    """
    first, *lines = text.split("\n")
    found, before = first.rstrip(), first
    for one in lines:
        on = len(before) >= FULL and not before.startswith("  ") and not one.startswith("  ")
        found += (" " if on else "\n") + one.rstrip()
        before = one
    return found


def parts_of(report, builders):
    """Build all parts, ``{title: function of the report}``; what fails is a sentence in the part, and on stderr.

    Parameters
    ----------
    report : Report
    builders : dict
        A function returns the blocks of its part, none where the part does not concern the train.

    Returns
    -------
    list of Part

    Examples
    --------
    >>> [part.title for part in parts_of(None, {"Words": lambda report: ["said"], "Nothing": lambda report: []})]
    ['Words']
    """
    found = []
    for title, build in builders.items():
        try:
            part = Part(title, build(report))
        except Exception as error:  # whatever it is, the other parts are of use
            kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
            said = f"{kind}{error or 'no reason given'}"
            print(f"--html: {title!r} is missing from the page: {said}", file=sys.stderr)
            part = Part(title, [f"This part could not be made: {said}"], failed=True)
        found += [part] if part.blocks else []
    return found
