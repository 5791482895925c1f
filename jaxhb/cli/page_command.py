"""``jaxhb report``: several speeds, normal and misfiring, and what its page has beyond
the tables.
"""

import dataclasses
import hashlib
import platform
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click

from jaxhb import __version__
from jaxhb.cli import arguments as cli
from jaxhb.cli.commands import check_files, misfire_trains, status
from jaxhb.cli.operating_modes import EACH, compare
from jaxhb.cli.progress import Progress
from jaxhb.cli.resume import Unfinished
from jaxhb.design.table import read_table
from jaxhb.design.tolerances import read_tolerances
from jaxhb.design.worst_case import tolerance as search
from jaxhb.elements.declared import table_of
from jaxhb.elements.elements import TABLES
from jaxhb.report.answer import Case
from jaxhb.report.compute import Asked, certificate_of, check_spread, solve_cases
from jaxhb.report.figures.cycle import plot_cycle
from jaxhb.report.figures.speeds import tolerance_figures
from jaxhb.report.figures.transients import transient_figures
from jaxhb.report.files.browser import find_browser
from jaxhb.report.files.compared import of_answers
from jaxhb.report.files.formats import FORMATS, deliver, named
from jaxhb.report.files.numbers import answer_row, cases_record, labelled, on_scene
from jaxhb.report.files.output import (
    NOT_ANSWERED,
    OutputError,
    changed_text,
    sheet,
)
from jaxhb.report.page.parts import Report, shown_misfire
from jaxhb.report.selection import case_title, cylinder_of, idle_title
from jaxhb.report.text import cases as case_text
from jaxhb.report.text.sentences import remarks_text, warnings
from jaxhb.report.text.tolerances import tolerance_parts
from jaxhb.report.text.transients import transient_parts
from jaxhb.report.text.tuned import tuned_parts
from jaxhb.report.transients import (
    governing_link,
    steady_extremes,
    transient_report,
)
from jaxhb.results.checkpoint import place_in
from jaxhb.scene.files import (
    find_scene,
    load_scene,
    scene_description,
    scene_title_block,
)
from jaxhb.scene.input_files import read_bytes
from jaxhb.scene.title_block import logo_address
from jaxhb.scene.writer import element_files, elements_of, scene_text
from jaxhb.solutions.misfires import alike
from jaxhb.train.changes import scene_values
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.transients.transient import transient as march_transient

SECOND = "second design"
TUNED = "tuned design"
SAMPLE = 100  # trains within the tolerances


@dataclass(frozen=True)
class _Computed:
    """Everything that a report computes.

    place : number of the speed that is shown in full; seconds : cases of a second
    design; tuning, tolerances, transient : words, tables and figures on how it was
    tuned, on what the tolerances do, and on a transient
    """

    cases: list[Case]
    place: int
    seconds: list[Case]
    tuning: tuple
    tolerances: tuple
    transient: tuple


def report(train: DriveTrain, arguments: cli.ReportOptions) -> int:
    """Several speeds, normal and misfiring, with backlash and without."""
    rpm = arguments.rpm
    at = arguments.at
    check_files(train, arguments)
    if at is not None and at not in rpm:
        raise OutputError(
            f"--at: {at:g} rpm is not one of the speeds of --rpm. Add it."
        )
    phrases = _phrases(arguments)
    second = _checked_page(train, arguments)
    trains = misfire_trains(train, arguments, each=True)
    each = len(trains) > 1
    misfire = bool(arguments.misfire or arguments.cut_off)
    if misfire and not each:
        (misfiring,) = trains.values()
        cases = {case_title(train): train, idle_title(misfiring.topology): misfiring}
    else:
        cases = {case_title(case, cylinder): case for cylinder, case in trains.items()}
    # A computed bound takes half a minute: only the speed that is shown in full gets
    # one, at the end.
    question = dataclasses.replace(Asked.of(arguments), certify=False)
    designs = [*cases.values(), *([] if second is None else [second])]
    unfinished = Unfinished(designs, ("report", rpm, question))
    second_designs = 1 + misfire if second is not None or arguments.tune else 0
    runs = len(cases) + second_designs
    with Progress(runs * len(rpm), quiet=arguments.quiet) as progress:
        computed = unfinished.run(
            lambda folder: _compute(
                train, cases, second, arguments, question, progress, folder
            ),
            unfinished.left,
        )
    worst = {}
    if each:
        worst = {
            "worst_misfire": case_text.worst_misfire(computed.cases),
            "worst_misfires": case_text.worst_misfires(computed.cases),
        }
        text = case_text.misfires_text(computed.cases)
    else:
        text = case_text.cases_text(computed.cases)
    page = None
    whole = True
    if named(arguments, "page"):
        from jaxhb.report.page.page import as_page

        page = as_page(_report_of(arguments, computed), phrases)
        whole = page.whole
    _deliver(arguments, text, cases, computed, worst, page)
    unfinished.forget()
    answers = [answer for case in computed.cases for answer in case.answers]
    exit_status = status(warnings(answers))
    return exit_status if whole else NOT_ANSWERED


def _compute(
    train: DriveTrain,
    trains: dict[str, DriveTrain],
    second: DriveTrain | None,
    arguments: cli.ReportOptions,
    question: Asked,
    progress: Progress,
    folder: Any,
) -> _Computed:
    """Answer all cases of both designs, those of the ``train`` in ``trains`` by their
    titles; answers are kept in the ``folder``.
    """
    rpm = arguments.rpm
    transient: tuple = ()
    if arguments.transient:
        # First: of all that is computed it alone may be refused.
        transient = _transient(train, arguments, progress.say)
    cases = solve_cases(
        trains,
        rpm,
        question,
        folder=folder,
        executor=arguments.executor,
        say=progress.say,
        advance=progress.advance,
    )
    hardest = case_text.hardest_of(cases[:1])
    if arguments.at is not None:
        place = rpm.index(arguments.at)
    else:
        place = hardest.place if hardest else 0
    if arguments.certify:
        for case in cases:
            certificate = certificate_of(case.answers[place], progress.say)
            case.answers[place] = dataclasses.replace(
                case.answers[place], certificate=certificate
            )
    tuning: tuple = ()
    if arguments.tune:
        second, tuning = _tuned(train, progress, place_in(folder, TUNED))
    designs = {}
    if second is not None:
        designs = _second_designs(second, shown_misfire(cases), arguments)
    tolerances: tuple = ()
    if arguments.tolerances:
        tolerances = _tolerances(
            train, arguments, progress.say, place_in(folder, "tolerances")
        )
    second_folder = "of the tuned design" if arguments.tune else SECOND
    seconds = solve_cases(
        designs,
        rpm,
        question,
        folder=place_in(folder, second_folder),
        executor=arguments.executor,
        say=progress.say,
        advance=progress.advance,
    )
    return _Computed(cases, place, seconds, tuning, tolerances, transient)


def _deliver(
    arguments: cli.ReportOptions,
    text: str,
    trains: dict[str, DriveTrain],
    computed: _Computed,
    worst: dict,
    page: Any,
) -> None:
    """Write and print what was computed."""
    cases = computed.cases
    orders = arguments.orders
    answers = {case.title: case.answers for case in cases}
    makers = {
        "record": lambda: (
            on_scene(*trains.values()) | cases_record(cases, orders=orders) | worst
        ),
        "rows": lambda: sheet(
            [
                answer_row(answer, case=case.title)
                for case in cases
                for answer in case.answers
            ]
        ),
        "dataset": lambda: labelled(answers, orders, along="case"),
        "figure": lambda: plot_cycle(cases[0].answers[computed.place], arguments.gear),
        "page": lambda: page,
    }
    parts = [text, second_text(cases, computed.seconds)]
    deliver(arguments, "\n\n".join(filter(None, parts)), makers)
    compare(
        arguments,
        lambda: [
            number for case in cases for number in of_answers(case.answers, case.title)
        ],
    )


def _checked_page(train: DriveTrain, arguments: cli.ReportOptions) -> DriveTrain | None:
    """The second design where its scene is given; refuses what no page can tell, before
    anything is computed.
    """
    without_page = f"on the page only. Add {FORMATS['html'].spelled}."
    shown = named(arguments, "page")
    if "pdf" in shown:
        find_browser()
    if (arguments.tuned or arguments.tune) and not shown:
        option = "tune" if arguments.tune else "tuned"
        raise OutputError(f"--{option}: the second design appears {without_page}")
    if arguments.tolerances and not shown:
        raise OutputError(f"--tolerances: they appear {without_page}")
    if arguments.event and not arguments.transient:
        raise OutputError(
            "--event: it is one of a transient. Add --transient S:RPM,..."
        )
    if arguments.transient and not shown:
        raise OutputError(f"--transient: it appears {without_page}")
    if arguments.tune:
        read_table(train)
    if arguments.tolerances:
        read_tolerances(train)
    return load_scene(arguments.tuned) if arguments.tuned else None


def _phrases(arguments: cli.ReportOptions) -> dict[str, str]:
    """The phrases that ``--words`` gives."""
    if arguments.words is None:
        return {}
    if not named(arguments, "page"):
        raise OutputError(
            f"--words: they stand on the page only. Add {FORMATS['html'].spelled}."
        )
    from jaxhb.report.page.words import read_words

    return read_words(arguments.words)


def _tuned(
    train: DriveTrain, progress: Progress, folder: Any
) -> tuple[DriveTrain, tuple]:
    """The train tuned as its [tune] table asks, and words and tables on that."""
    from jaxhb.design.tuning import tune

    table = read_table(train)
    progress.say("tuning, as the [tune] table asks")

    def note(step: Any) -> None:
        progress.say(f"tuning: step {step.number}, objective {step.objective:.4g}")

    result = tune(train, **table, on_step=note, out=folder)
    return result.train, tuple(tuned_parts(train, table, result))


def _tolerances(
    train: DriveTrain,
    arguments: cli.ReportOptions,
    say: Callable[[str], None],
    folder: Any,
) -> tuple:
    """Figures, words and tables on what the tolerances of the scene do."""
    spread = search(
        train,
        rpm=arguments.rpm,
        harmonics=arguments.harmonics,
        tolerance=arguments.tolerance,
        samples=SAMPLE,
        progress=say,
        out=folder,
    )
    parts = tolerance_parts(spread, check_spread(spread, say))
    return (*tolerance_figures(spread), *parts)


def _transient(
    train: DriveTrain, arguments: cli.ReportOptions, say: Callable[[str], None]
) -> tuple:
    """Words, tables and figures of a transient of the train."""
    rows = arguments.transient
    assert rows  # else none was asked for
    say("marching the transient")
    run = march_transient(
        train, seconds=rows[-1][0], speed=rows, events=arguments.event
    )
    report = transient_report(
        run,
        start="steady" if rows[0][1] > 0 else "rest",
        events=arguments.event,
        passages=(),
    )
    parts = (*transient_parts(report), *remarks_text(run.notes))
    if not train.topology.link_names:
        return parts
    link = governing_link(report)
    steady = steady_extremes(run, link)
    return (*parts, *transient_figures(report, link, steady))


def _second_designs(
    second: DriveTrain, misfire: Case | None, arguments: cli.ReportOptions
) -> dict[str, DriveTrain]:
    """The second design by title, as it runs and with the misfire that the page shows
    of the first, if it has that cylinder; of every misfire in turn, programs are those
    of the first design where numbers alone differ.
    """
    title = TUNED
    if not arguments.tune:
        assert arguments.tuned is not None  # a second design is tuned or given
        title = f"{SECOND} ({Path(arguments.tuned).stem})"
    if misfire is None:
        return {title: second}
    misfiring = None
    if EACH in (*arguments.misfire, *arguments.cut_off):
        cut_off = EACH in arguments.cut_off
        cases = second.cut_offs() if cut_off else second.misfires()
        misfiring = cases.get(cylinder_of(misfire.title))
        if cases:
            second = alike(second, cut_off=cut_off)
    elif {*arguments.misfire, *arguments.cut_off} <= {*second.topology.cylinder_names}:
        misfiring = second.misfire(*arguments.misfire).cut_off(*arguments.cut_off)
    if misfiring is None:
        return {title: second}
    return {title: second, f"{title}, {misfire.title}": misfiring}


def second_text(cases: list[Case], seconds: list[Case]) -> str:
    """A line for each case of a second design on what it does to the largest tooth
    force (torque, angle).
    """
    lines = []
    firsts = [cases[0], *filter(None, [shown_misfire(cases)])]
    for case, first in zip(seconds, firsts, strict=False):
        after = case_text.hardest_of([case])
        before = case_text.hardest_of([first])
        if after is None or before is None:
            lines.append(
                f"The {case.title}: no largest value, one of the designs has no answer."
            )
            continue
        change = ""
        if after.quantity.title == before.quantity.title and before.value > 0:
            change = f" ({100 * (after.value / before.value - 1):+.1f} %)"
        lines.append(
            f"The {case.title}: {after.quantity.small_title} {after.said}; first"
            f" design: {before.said}{change}."
        )
    return "\n".join(lines)


def _report_of(arguments: cli.ReportOptions, computed: _Computed) -> Report:
    """The :class:`Report` of what was computed."""
    train = computed.cases[0].answers[0].train
    elements = _written_elements(train, arguments)
    present = train.topology.elements
    names = {
        kind: [name for name, element in elements.items() if table_of(element) == kind]
        for kind in TABLES
    }
    files = {
        kind: [
            file
            for name, file in zip(names[kind], rows, strict=True)
            if name in present
        ]
        for kind, rows in element_files(arguments.scene).items()
    }
    block, folder = scene_title_block(arguments.scene)
    return Report(
        computed.cases,
        place=computed.place,
        place_asked=arguments.at is not None,
        gear=arguments.gear,
        seconds=computed.seconds,
        tuning=computed.tuning,
        tolerances=computed.tolerances,
        transient=computed.transient,
        facts=_facts(arguments),
        title=block,
        logo=logo_address(block, folder),
        mode=arguments.scenario or "",
        description=scene_description(arguments.scene),
        scene=scene_text(arguments.scene)[0],
        elements={name: row for name, row in elements.items() if name in present},
        second_elements=elements_of(arguments.tuned) if arguments.tuned else {},
        files=files,
    )


def _facts(arguments: cli.ReportOptions) -> dict[str, str]:
    """The origin of a page."""
    accuracy = f"{arguments.harmonics} harmonics, as asked"
    if not arguments.harmonics:
        accuracy = (
            f"truncation error at most {100 * arguments.tolerance:g} % of the largest"
            " tooth force, or not converged"
        )
    packages = ", ".join(
        f"{name} {version(name)}" for name in ("jax", "jaxlib", "numpy", "plotly")
    )
    facts = {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "scene": _file(arguments.scene),
    }
    if arguments.tuned:
        facts["second design"] = _file(arguments.tuned)
    return facts | {
        "changes": changed_text(arguments) or "none",
        "command": shlex.join(["jaxhb", *click.get_current_context().obj]),
        "accuracy": accuracy,
        "versions": (
            f"jaxhb {__version__}, Python {platform.python_version()}, {packages},"
            f" {platform.platform()}"
        ),
    }


def _written_elements(
    train: DriveTrain, arguments: cli.ReportOptions
) -> dict[str, Any]:
    """Elements as the scene says them, with what a scenario and --set change."""
    changed = train.scenarios.get(arguments.scenario or "", {}) | dict(arguments.set)
    settings = {
        key: value
        for key, value in changed.items()
        if not isinstance(value, bool | list)
    }
    # Rows of the file are those of the whole train, of which a scenario may leave some
    # out.
    whole = load_scene(arguments.scene).replace(settings)
    elements = elements_of(arguments.scene, scene_values(whole, settings))
    # Cylinders that fire, and rows.
    for key in changed.keys() - settings.keys() - {"without"}:
        name, _, field = key.rpartition(".")
        elements[name] = dataclasses.replace(elements[name], **{field: changed[key]})
    return elements


def _file(name: str) -> str:
    """The name of a scene, and the checksum of its file and the tables that it
    names.
    """
    path = find_scene(name)
    tables = [table for _, table in sorted(scene_text(name)[1].items())]
    digest = hashlib.sha256(b"".join(map(read_bytes, [path, *tables])))
    return (
        f"{path.name}, SHA-256 {digest.hexdigest()[:32]} (with the tables that it"
        " names)"
    )
