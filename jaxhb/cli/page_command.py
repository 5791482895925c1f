"""``jaxhb report``: several speeds, normal and misfiring, and what its page has beyond
the tables.
"""

import dataclasses
import hashlib
import platform
import shlex
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import click

from jaxhb import __version__
from jaxhb.cli.commands import EACH, check_files, misfire_trains, status
from jaxhb.cli.operating_modes import tell
from jaxhb.cli.progress import Progress
from jaxhb.cli.resume import GOES_ON, Kept
from jaxhb.design.table import read_table
from jaxhb.design.tolerances import read_tolerances
from jaxhb.design.worst_case import tolerance as search
from jaxhb.elements.elements import TABLES, table_of
from jaxhb.report.compute import Asked, certificate_of, check_spread, solve_cases
from jaxhb.report.figures.cycle import plot_cycle
from jaxhb.report.figures.speeds import tolerance_figures
from jaxhb.report.files.compared import of_answers
from jaxhb.report.files.numbers import answer_row, cases_record, netcdf, on_scene
from jaxhb.report.files.output import (
    NOT_ANSWERED,
    OutputError,
    changed_text,
    deliver,
    rows_csv,
)
from jaxhb.report.page.parts import Report, shown_misfire
from jaxhb.report.selection import case_title, cylinder_of, idle_title
from jaxhb.report.text import cases as told
from jaxhb.report.text.sentences import warnings
from jaxhb.report.text.tolerances import tolerance_parts
from jaxhb.report.text.tuned import tuned_parts
from jaxhb.results.checkpoint import place_in
from jaxhb.scene.files import _find, load_scene, scene_description
from jaxhb.scene.input_files import read_bytes
from jaxhb.scene.writer import element_files, elements_of, scene_text
from jaxhb.solutions.misfires import alike
from jaxhb.train.changes import scene_values

SECOND = "second design"
TUNED = "tuned design"
SAMPLE = 100  # trains within the tolerances


def report(train, given, rpm, at, orders, gear, plot, certify, tune, html, quiet, **_):
    """Several speeds, normal and misfiring, with backlash and without."""
    check_files(train, given)
    if at is not None and at not in rpm:
        raise OutputError(
            f"--at: {at:g} rpm is not one of the speeds of --rpm. Add it."
        )
    other, trains = _checked_page(train, given), misfire_trains(train, given, each=True)
    each, misfire = len(trains) > 1, given.misfire or given.cut_off
    trains = {case_title(one, cylinder): one for cylinder, one in trains.items()}
    if misfire and not each:
        limping = next(iter(trains.values()))
        trains = {case_title(train): train, idle_title(limping.topology): limping}
    # A computed bound takes half a minute: only the speed that is shown in full gets
    # one, at the end.
    asked, designs = (
        dataclasses.replace(Asked.of(given), certify=False),
        [*trains.values(), *filter(None, [other])],
    )
    kept = Kept(designs, ("report", rpm, asked))

    def compute(folder):
        tell = {"say": progress.say, "advance": progress.advance}
        cases = solve_cases(trains, rpm, asked, folder=folder, **tell)
        found = told.hardest_of(cases[:1]) if at is None else None
        place = found.place if found else rpm.index(at) if at is not None else 0
        for answers in [case.answers for case in cases] if certify else []:
            certificate = certificate_of(answers[place], progress.say)
            answers[place] = dataclasses.replace(
                answers[place], certificate=certificate
            )
        second, tuning = (
            _tuned(train, progress, place_in(folder, TUNED)) if tune else (other, ())
        )
        shown = shown_misfire(cases)
        designs = _second_designs(second, shown, given, each) if second else {}
        own = place_in(folder, "of the tuned design" if tune else SECOND)
        known = (
            _tolerances(train, rpm, given, progress.say, place_in(folder, "tolerances"))
            if given.tolerances
            else ()
        )
        return (
            cases,
            place,
            solve_cases(designs, rpm, asked, folder=own, **tell),
            tuning,
            known,
        )

    runs = len(designs) + tune + bool(misfire and (other or tune))
    with Progress(runs * len(rpm), quiet=quiet) as progress:
        left = f"no file is written, but what was found is kept; {GOES_ON}"
        cases, place, seconds, *beside = kept.run(
            compute, lambda: left if kept.folder else "nothing more is written"
        )
    worst, whole = {}, True
    if each:
        worst = {
            "worst_misfire": told.worst_misfire(cases),
            "worst_misfires": told.worst_misfires(cases),
        }
    if html:
        from jaxhb.report.page.page import as_page

        page, whole = as_page(_report_of(given, cases, place, seconds, *beside))
    deliver(
        given,
        "\n\n".join(
            filter(
                None,
                [
                    told.misfires_text(cases) if each else told.cases_text(cases),
                    second_text(cases, seconds),
                ],
            )
        ),
        json=lambda: (
            on_scene(*trains.values()) | cases_record(cases, orders=orders) | worst
        ),
        csv=lambda: rows_csv(
            [
                answer_row(answer, case=case.title)
                for case in cases
                for answer in case.answers
            ]
        ),
        netcdf=lambda: netcdf(
            {case.title: case.answers for case in cases}, orders, along="case"
        ),
        plot=lambda: plot_cycle(cases[0].answers[place], gear),
        html=lambda: page,
    )
    tell(
        given,
        lambda: [one for case in cases for one in of_answers(case.answers, case.title)],
    )
    kept.forget()
    answered = status(warnings([answer for case in cases for answer in case.answers]))
    return answered if whole else NOT_ANSWERED


def _checked_page(train, given):
    """The second design where its scene is given; refuses what no page can tell, before
    anything is computed.
    """
    if (given.tuned or given.tune) and not given.html:
        told_of = (
            f"--{'tune' if given.tune else 'tuned'}: the second design appears on the"
            " page only"
        )
        raise OutputError(f"{told_of}. Add --html FILE.html.")
    if given.tolerances and not given.html:
        raise OutputError(
            "--tolerances: they appear on the page only. Add --html FILE.html."
        )
    if given.tune:
        read_table(train)
    if given.tolerances:
        read_tolerances(train)
    return load_scene(given.tuned) if given.tuned else None


def _tuned(train, progress, folder):
    """The train tuned as its [tune] table asks, and words and tables on that."""
    from jaxhb.design.tuning import tune

    asked = read_table(train)
    progress.say("tuning, as the [tune] table asks")
    line = "tuning: step {0.number}, objective {0.objective:.4g}"
    result = tune(
        train, **asked, on_step=lambda step: progress.say(line.format(step)), out=folder
    )
    return result.train, tuple(tuned_parts(train, asked, result))


def _tolerances(train, rpm, given, say, folder):
    """Figures, words and tables on what the tolerances of the scene do."""
    asked = {
        "harmonics": given.harmonics,
        "tolerance": given.tolerance,
        "samples": SAMPLE,
        "progress": say,
    }
    spread = search(train, rpm=rpm, **asked, out=folder)
    return *tolerance_figures(spread), *tolerance_parts(
        spread, check_spread(spread, say)
    )


def _second_designs(second, misfire, given, each):
    """The second design by title, as it runs and with the misfire that the page shows
    of the first, if it has that cylinder; of every misfire in turn, programs are those
    of the first design where numbers alone differ.
    """
    title = TUNED if given.tune else f"{SECOND} ({Path(given.tuned).stem})"
    if misfire is None:
        return {title: second}
    if each:
        cut_off = EACH in given.cut_off
        trains = second.cut_offs() if cut_off else second.misfires()
        misfiring = trains.get(cylinder_of(misfire.title))
        second = alike(second, cut_off=cut_off) if trains else second
    else:
        known = {*given.misfire, *given.cut_off} <= set(second.topology.cylinder_names)
        misfiring = (
            second.misfire(*given.misfire).cut_off(*given.cut_off) if known else None
        )
    return {title: second} | (
        {} if misfiring is None else {f"{title}, {misfire.title}": misfiring}
    )


def second_text(cases, seconds):
    """What a second design does to the largest tooth force (torque, angle), a line for
    each of its cases.
    """
    lines = []
    for case, first in zip(seconds, [cases[0], shown_misfire(cases)], strict=False):
        found = told.hardest_of([case])
        before = told.hardest_of([first])
        if found is None or before is None:
            lines.append(
                f"The {case.title}: no largest value, one of the designs has no answer."
            )
            continue
        alike = found.quantity.title == before.quantity.title and before.value > 0
        change = f" ({100 * (found.value / before.value - 1):+.1f} %)" if alike else ""
        lines.append(
            f"The {case.title}: {found.quantity.small_title} {found.said}; first"
            f" design: {before.said}{change}."
        )
    return "\n".join(lines)


def _report_of(given, cases, place, seconds, tuning, tolerances):
    """The :class:`Report` of what was computed."""
    accuracy = f"{given.harmonics} harmonics, as asked"
    if not given.harmonics:
        most = f"at most {100 * given.tolerance:g} %"
        accuracy = (
            f"truncation error {most} of the largest tooth force, or not converged"
        )
    packages = ", ".join(
        f"{name} {version(name)}" for name in ("jax", "jaxlib", "numpy", "plotly")
    )
    facts = {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "scene": _file(given.scene),
    }
    facts |= {"second design": _file(given.tuned)} if given.tuned else {}
    facts |= {
        "changes": changed_text(given) or "none",
        "command": shlex.join(["jaxhb", *click.get_current_context().obj]),
        "accuracy": accuracy,
        "versions": (
            f"jaxhb {__version__}, Python {platform.python_version()}, {packages},"
            f" {platform.platform()}"
        ),
    }
    train = cases[0].answers[0].train
    changed = train.scenarios.get(given.scenario, {}) | dict(given.set)
    settings = {
        key: value
        for key, value in changed.items()
        if not isinstance(value, bool | list)
    }
    # Rows of the file are those of the whole train, of which a scenario may leave some
    # out.
    written = elements_of(
        given.scene, scene_values(load_scene(given.scene).replace(settings), settings)
    )
    for key in (
        changed.keys() - settings.keys() - {"without"}
    ):  # cylinders that fire, and rows
        name, _, field = key.rpartition(".")
        written[name] = dataclasses.replace(written[name], **{field: changed[key]})
    names = {
        kind: [n for n, e in written.items() if table_of(e) == kind] for kind in TABLES
    }
    there = train.topology
    files = {
        kind: [
            own
            for name, own in zip(names[kind], rows, strict=True)
            if name in there.elements
        ]
        for kind, rows in element_files(given.scene).items()
    }
    return Report(
        cases,
        place=place,
        asked=given.at is not None,
        gear=given.gear,
        seconds=seconds,
        tuning=tuning,
        tolerances=tolerances,
        facts=facts,
        description=scene_description(given.scene),
        scene=scene_text(given.scene)[0],
        elements={
            name: element for name, element in written.items() if name in there.elements
        },
        second_elements=elements_of(given.tuned) if given.tuned else {},
        files=files,
    )


def _file(name):
    """A file by name and the checksum of what is in it and in the tables that it
    names.
    """
    path = _find(name)
    beside = sorted(scene_text(name)[1].items())
    digest = hashlib.sha256(
        b"".join(map(read_bytes, [path, *(table for _, table in beside)]))
    )
    return (
        f"{path.name}, SHA-256 {digest.hexdigest()[:32]} (with the tables that it"
        " names)"
    )
