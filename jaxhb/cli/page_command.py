"""What ``jaxhb report --html`` computes beyond its tables, and where its page comes from."""

import dataclasses
import hashlib
import importlib.util
import platform
import shlex
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from jaxhb import __version__
from jaxhb.design.table import read_table
from jaxhb.report.answer import Case
from jaxhb.report.compute import certificate_of, solve_cases
from jaxhb.report.files.output import OutputError, changed_text
from jaxhb.report.page.parts import Report
from jaxhb.report.selection import NOT_FIRING, asks_each
from jaxhb.report.text.cases import largest_of
from jaxhb.report.text.tuned import tuned_parts
from jaxhb.scene.files import _find, load_scene, scene_description
from jaxhb.scene.writer import element_files, scene_text
from jaxhb.solutions.misfires import same_factor

SECOND, TUNED = "second design", "tuned design"
NEEDED = "jinja2", "plotly", "matplotlib"


def check_page(train, arguments):
    """Refuse what no page can tell, before anything is computed; the second design where its scene is given."""
    second = arguments.tuned is not None or arguments.tune
    if second and not arguments.html:
        option = "--tune" if arguments.tune else "--tuned"
        raise OutputError(f"{option}: the second design appears on the page only. Add --html FILE.html.")
    if arguments.html and (missing := [name for name in NEEDED if importlib.util.find_spec(name) is None]):
        raise OutputError(f'--html: the page needs {", ".join(missing)}. Install it: pip install "jaxhb[report]".')
    if arguments.tune:
        read_table(train)
    return None if arguments.tuned is None else load_scene(arguments.tuned)


def second_cases(train, second, misfire, arguments, asked, folder, progress):
    """Another design at the same speeds, without a misfire and with that of the page, and words on how it was found.

    Parameters
    ----------
    train : DriveTrain
        The first design.
    second : DriveTrain or None
        From :func:`check_page`.
    misfire : Case or None
        The misfire that the page shows of the first design.
    arguments : Namespace
    asked : Asked
    folder : Path or None
        Where answers of this command are kept; those of a design that is tuned first are not.
    progress : Progress

    Returns
    -------
    cases : list of Case
        None, one or two; no misfire of a cylinder that the second design has not got.
    found : list of str and Table
    """
    title, found = f"{SECOND} ({Path(arguments.tuned or '').stem})", ()
    if arguments.tune:
        title, (second, found) = TUNED, _tuned(train, progress)
    if second is None:
        return [], ()
    trains = {title: second}
    if misfire is not None:
        normal, misfiring = _misfiring(second, misfire.title.removesuffix(NOT_FIRING), arguments)
        trains = {title: normal} | ({} if misfiring is None else {f"{title}, {misfire.title}": misfiring})
    own = None if folder is None or arguments.tune else folder / SECOND
    tell = {"say": progress.say, "advance": progress.advance}
    return solve_cases(trains, arguments.rpm, asked, folder=own, **tell), found


def _misfiring(train, cylinders, arguments):
    """The second design as it runs and with the misfire of the first, None where it has no such cylinder; programs are
    those of the first design where numbers alone differ."""
    if asks_each(train, arguments):
        trains = train.misfires()
        return train.replace(same_factor(train)) if trains else train, trains.get(cylinders)
    known = set(arguments.misfire) <= set(train.topology.cylinder_names)
    return train, train.misfire(*arguments.misfire) if known else None


def second_text(cases, seconds):
    """What a second design does to the largest tooth force (torque, angle), a line for each of its cases."""
    lines = []
    for case in seconds:
        found = largest_of(case)
        first = cases[0] if case is seconds[0] else next(one for one in cases[1:] if case.title.endswith(one.title))
        before = largest_of(first)
        if found is None or before is None:
            lines.append(f"The {case.title}: no largest value, one of the designs has no answer.")
            continue
        called, value, text = found
        _, was, said = before
        change = f" ({100 * (value / was - 1):+.1f} %)" if was > 0 and called == before[0] else ""
        lines.append(f"The {case.title}: {called} {text}; first design: {said}{change}.")
    return "\n".join(lines)


def _tuned(train, progress):
    """The train tuned as its [tune] table asks, and what is told of that."""
    from jaxhb.design.tuning import tune

    asked = read_table(train)
    progress.say("tuning, as the [tune] table asks")

    def tell(step):
        progress.say(f"tuning: step {step.number}, objective {step.objective:.4g}")

    result = tune(train, **asked, on_step=tell)
    return result.train, tuple(tuned_parts(train, asked, result))


def report_of(arguments, cases: list[Case], place, seconds, tuning):
    """The :class:`Report` of what was computed."""
    files = [("scene", arguments.scene)] + ([("second design", arguments.tuned)] if arguments.tuned else [])
    facts = {"date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")}
    facts |= {what: _file(name) for what, name in files} | {"changes": changed_text(arguments) or "none"}
    facts |= {"command": shlex.join(["jaxhb", *arguments.words]), "accuracy": _accuracy(arguments)}
    packages = ", ".join(f"{name} {version(name)}" for name in ("jax", "jaxlib", "numpy", "plotly"))
    facts["versions"] = f"jaxhb {__version__}, Python {platform.python_version()}, {packages}, {platform.platform()}"
    text, _ = scene_text(arguments.scene)
    chosen = {"place": place, "asked": arguments.at is not None, "gear": arguments.gear}
    return Report(
        cases,
        **chosen,
        second=seconds[0] if seconds else None,
        second_misfire=seconds[1] if len(seconds) > 1 else None,
        tuning=tuning,
        facts=facts,
        description=scene_description(arguments.scene),
        scene=text,
        files=element_files(arguments.scene),
    )


def _file(name):
    """A file by name and the checksum of what is in it and in the tables that it names."""
    path = _find(name)
    digest = hashlib.sha256(path.read_bytes())
    for _, beside in sorted(scene_text(name)[1].items()):
        digest.update(beside.read_bytes())
    return f"{path.name}, SHA-256 {digest.hexdigest()[:32]} (with the tables that it names)"


def _accuracy(arguments):
    """What was asked of the solutions."""
    if arguments.harmonics:
        return f"{arguments.harmonics} harmonics, as asked"
    return f"truncation error at most {100 * arguments.tolerance:g} % of the largest tooth force, or not converged"


def certified_at(cases, place, say):
    """The cases with computed bounds at one speed."""
    found = []
    for case in cases:
        answers = list(case.answers)
        answers[place] = dataclasses.replace(answers[place], certificate=certificate_of(answers[place], say))
        found.append(Case(case.title, answers))
    return found
