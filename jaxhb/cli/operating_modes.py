"""A command for several scenarios in one call, as the operating modes of an
installation: one after the other, their numbers in one file, and for every quantity the
mode in which it is largest.
"""

from __future__ import annotations

import dataclasses
import itertools
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxhb.cli import arguments as cli
from jaxhb.cli.inputs import check_files
from jaxhb.report.files import output
from jaxhb.report.files.formats import FORMATS
from jaxhb.scene.files import load_scene
from jaxhb.train.drivetrain import DriveTrain

if TYPE_CHECKING:
    from jaxhb.report.files.compared import Compared

EVERY = "all"
AS_WRITTEN = "as written"
EACH = "each"


def modes(arguments: cli.ChangedOptions) -> dict[str, str | None]:
    """The scenarios that are asked for by their titles, None for the scene as
    written.
    """
    if not isinstance(arguments, cli.ComputedOptions):
        return {AS_WRITTEN: None}
    chosen: list[str | None] = list(dict.fromkeys(arguments.scenarios))
    if EVERY in chosen:
        scenarios = load_scene(arguments.scene).scenarios
        if EVERY not in scenarios:
            if not scenarios:
                raise output.OutputError(
                    f"--scenario {EVERY}: the scene has no scenario."
                )
            if len(chosen) > 1:
                raise output.OutputError(
                    f"--scenario {EVERY}: takes all there are. Leave out the other"
                    " --scenario."
                )
            chosen = [None, *scenarios]
    return {name or AS_WRITTEN: name for name in chosen or [None]}


def each(
    run: Callable[[DriveTrain, Any], int],
    arguments: Any,
    scenarios: Mapping[str, str | None],
    read: Callable[[Any], DriveTrain],
) -> int:
    """``run(train, arguments)`` of a command for every mode of :func:`modes`; its exit
    status, the highest of all.

    Some files hold all modes (``merge`` of a Format), others have the mode in their
    name.
    """
    if isinstance(arguments, cli.IdentifyOptions):
        raise output.OutputError(
            "--scenario: a measurement was taken in one of them. Name one."
        )
    check_files(arguments)
    apart = {
        name: path for name, path in arguments.files.items() if not FORMATS[name].merge
    }
    for name, path in apart.items():
        if path == output.STANDARD_OUTPUT:
            raise output.OutputError(
                f"--{name}: each scenario has a file of its own. Give a name."
            )
    skipped = _skipped(arguments, scenarios)
    if len(skipped) == len(scenarios):
        reasons = [f"--scenario {title!r}: {why}" for title, why in skipped.items()]
        raise output.OutputError("; ".join(reasons))
    merged = {name: path for name, path in arguments.files.items() if name not in apart}
    quiet = arguments.quiet or output.STANDARD_OUTPUT in merged.values()
    with tempfile.TemporaryDirectory() as folder:
        by_title = {}
        for number, (title, name) in enumerate(scenarios.items()):
            if title in skipped:
                continue
            one_mode = dataclasses.replace(
                arguments,
                files={form: _with_title(path, title) for form, path in apart.items()}
                | {form: f"{folder}/{number}.{form}" for form in merged},
                scenario=name,
                quiet=quiet,
                compared=[],
            )
            if isinstance(arguments, cli.SweepOptions) and arguments.folder:
                one_mode = dataclasses.replace(
                    one_mode, folder=_with_title(arguments.folder, title)
                )
            by_title[title] = one_mode
        # What one of them refuses is refused before the first is computed.
        trains = {}
        for title, one_mode in by_title.items():
            check_files(one_mode)
            trains[title] = read(one_mode)
        statuses: list[int] = []
        try:
            for title, one_mode in by_title.items():
                if not quiet:
                    gap = "\n\n" if statuses else ""
                    print(f"{gap}Mode: {title}\n\n", end="", flush=True)
                statuses.append(run(trains[title], one_mode))
        except KeyboardInterrupt as stop:
            done = dict(itertools.islice(by_title.items(), len(statuses)))
            numbers = ""
            if done:
                written = _write(arguments, done, skipped, _worst(done))
                numbers = f": their numbers are in {', '.join(written)}" * bool(written)
            stop.__notes__ = [
                f"{len(statuses)} of {len(by_title)} modes are done{numbers}"
            ]
            raise
        worst = _worst(by_title)
        _write(arguments, by_title, skipped, worst)
    if not quiet:
        parts = [f"Skipped: {title}, {why}" for title, why in skipped.items()]
        if worst:
            parts.append(_table(worst))
        print("".join(f"\n{part}\n" for part in parts), end="")
    return max(statuses)


def _skipped(
    arguments: cli.ComputedOptions, scenarios: Mapping[str, str | None]
) -> dict[str, str]:
    """Modes that lack what an option names, or in which no cylinder fires though
    ``each`` asks for one, and why.
    """
    whole = load_scene(arguments.scene)
    in_turn = isinstance(arguments, cli.FiringOptions) and EACH in (
        *arguments.misfire,
        *arguments.cut_off,
    )
    skipped = {}
    for title, name in scenarios.items():
        train = whole if name is None else whole.scenario(name)
        lacking = [
            (option, element)
            for option, element in _named_elements(arguments)
            if element in whole.topology.elements
            and element not in train.topology.elements
        ]
        if lacking:
            option, element = lacking[0]
            skipped[title] = f"which has no {element!r} that {option} names."
        elif in_turn and not train.topology.firing_cylinders:
            skipped[title] = "in which no cylinder fires."
    return skipped


def _named_elements(arguments: cli.ComputedOptions) -> Iterator[tuple[str, str]]:
    """Elements that options of a command name, (option, element)."""
    for name in ("misfire", "cut_off", "element", "event"):
        for element in getattr(arguments, name, ()):
            yield f"--{name.replace('_', '-')}", element
    for quantity in getattr(arguments, "of", ()):
        yield "--of", str(quantity).rpartition(" of ")[2]
    for option, name in (("--gear", "gear"), ("--phase", "name"), ("--link", "link")):
        element = getattr(arguments, name, None)
        if element:
            yield option, element
    settings = [("--set", key) for key, _ in arguments.set]
    if isinstance(arguments, cli.SweepOptions) and arguments.over:
        settings.append(("--over", arguments.over[0]))
    for option, key in settings:
        element = key.rpartition(".")[0]
        yield option, element.removesuffix(".combustion").removesuffix(".traces")


def _write(
    arguments: Any,
    by_title: Mapping[str, Any],
    skipped: Mapping[str, str],
    worst: Mapping[str, Mapping],
) -> list[str]:
    """Write files that hold all modes that are done, and the largest values of all; the
    names of the files.
    """
    contents: dict[str, Iterable[bytes]] = {}
    together = {"worst": worst, "skipped": skipped}
    for name in sorted(arguments.files):
        merge = FORMATS[name].merge
        if merge is not None:
            files = {title: mode.files[name] for title, mode in by_title.items()}
            contents[arguments.files[name]] = merge(files, together)
    output.write_files(contents)
    return list(contents)


def _with_title(name: str, title: str) -> str:
    """The name of a file with that of the mode in it."""
    path = Path(name)
    word = re.sub(r"[^\w.-]+", "_", title)
    return str(path.with_name(f"{path.stem}_{word}{path.suffix}"))


def compare(
    arguments: cli.ComputedOptions, numbers: Callable[[], Iterable[Compared]]
) -> None:
    """Hand on the numbers that are compared over the modes, made by a function; where
    the command runs alone nothing is made.
    """
    if arguments.compared is not None:
        arguments.compared.extend(numbers())


def _worst(by_title: Mapping[str, cli.ComputedOptions]) -> dict[str, dict]:
    """The largest value of every quantity of all modes, with the mode, the case and the
    place.
    """
    largest: dict[str, tuple[str, Compared]] = {}
    for title, one_mode in by_title.items():
        for number in one_mode.compared or ():
            before = largest[number.key][1].value if number.key in largest else 0.0
            if number.value > before:
                largest[number.key] = (title, number)
    return {
        key: {
            "value": number.value,
            "unit": number.unit,
            "scenario": title,
            "case": number.case,
            number.axis: number.place,
        }
        for key, (title, number) in largest.items()
    }


def _table(worst: Mapping[str, Mapping]) -> str:
    """The largest values of all modes, for people."""
    from jaxhb.report.table import Column, Table
    from jaxhb.report.text.columns import plain_number
    from jaxhb.report.units import shown_unit

    lines = []
    for key, row in worst.items():
        value, si_unit, mode, case, place = row.values()
        factor, unit = shown_unit(si_unit)
        lines.append(
            [
                key.removesuffix(f" {si_unit}"),
                plain_number(factor * value),
                unit,
                f"{place:g}",
                f"{mode}, {case}" if case else mode,
            ]
        )
    axis = list(row)[-1]
    return Table(
        "Largest over all modes",
        [
            "",
            "value",
            Column("unit", left=True),
            f"at {axis}",
            Column("mode", left=True),
        ],
        lines,
    )
