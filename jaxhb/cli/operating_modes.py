"""A command for several scenarios in one call, as the operating modes of an
installation: one after the other, their numbers in one file, and for every quantity the
mode in which it is largest.
"""

import csv
import itertools
import json
import re
import tempfile
from pathlib import Path

from jaxhb.cli import inputs
from jaxhb.report.files import output
from jaxhb.scene.csv_tables import unguarded
from jaxhb.scene.files import load_scene

EVERY = "all"
AS_WRITTEN = "as written"
EACH = "each"
OWN_FILES = (
    "plot",
    "netcdf",
    "html",
    "trace",
    "folder",
)  # options whose file each mode has for itself


def modes(given):
    """The scenarios that are asked for, None for the scene as written; and their
    titles.
    """
    asked = list(dict.fromkeys(given.get("scenario") or ()))
    if EVERY in asked:
        known = load_scene(given["scene"]).scenarios
        if EVERY not in known:
            if len(asked) > 1 or not known:
                why = (
                    "takes all there are. Leave out the other --scenario"
                    if known
                    else "the scene has no scenario"
                )
                raise output.OutputError(f"--scenario {EVERY}: {why}.")
            asked = [None, *known]
    return {name or AS_WRITTEN: name for name in asked or [None]}


def each(run, given, asked, read):
    """``run(train, given)`` of a command for every mode of :func:`modes`; its exit
    status, the highest of all.

    JSON and CSV files hold all modes, other files have the mode in their name.
    """
    if given.get("measured"):
        raise output.OutputError(
            "--scenario: a measurement was taken in one of them. Name one."
        )
    inputs._check_files(given)
    merged = [option for option in ("json", "csv") if option in given]
    streamed = output.STANDARD_OUTPUT in [
        given.get(option) for option in (*merged, "trace")
    ]
    if given.get("trace") == output.STANDARD_OUTPUT:
        raise output.OutputError(
            "--trace: each scenario has a file of its own. Give a name."
        )
    with tempfile.TemporaryDirectory() as folder:
        own = {}
        status = []
        skipped = _skipped(given, asked)
        if len(skipped) == len(asked):
            raise output.OutputError(
                "; ".join(
                    f"--scenario {title!r}: {why}" for title, why in skipped.items()
                )
            )
        for k, (title, name) in enumerate(asked.items()):
            if title in skipped:
                continue
            files = {
                option: _named(given[option], title)
                for option in OWN_FILES
                if given.get(option)
            }
            files |= {
                option: f"{folder}/{k}.{option}" for option in merged if given[option]
            }
            own[title] = (
                given
                | files
                | {
                    "scenario": name,
                    "quiet": given["quiet"] or streamed,
                    "compared": [],
                }
            )
        # What one of them refuses is refused before the first is computed.
        trains = {title: read(changed) for title, changed in own.items()}
        try:
            for title, changed in own.items():
                if not changed["quiet"]:
                    print(
                        *["\n"] * bool(status),
                        f"Mode: {title}\n\n",
                        sep="",
                        end="",
                        flush=True,
                    )
                status.append(run(trains[title], changed))
        except KeyboardInterrupt as stop:
            done = dict(itertools.islice(own.items(), len(status)))
            files = ", ".join(_write(given, done, skipped)[1]) if done else ""
            kept = f": their numbers are in {files}" if files else ""
            stop.__notes__ = [f"{len(status)} of {len(own)} modes are done{kept}"]
            raise
        worst, _ = _write(given, own, skipped)
    if not (given["quiet"] or streamed):
        parts = [f"Skipped: {title}, {why}" for title, why in skipped.items()]
        parts += [_table(worst)] if worst else []
        print("".join(f"\n{part}\n" for part in parts), end="")
    return max(status)


def _skipped(given, asked):
    """Modes that lack what an option names, or in which no cylinder fires though
    ``each`` asks for one, and why.
    """
    whole = load_scene(given["scene"])
    skipped = {}
    for title, name in asked.items():
        train = whole if name is None else whole.scenario(name)
        lacking = [
            (option, element)
            for option, element in _named_elements(given)
            if element in whole.topology.elements
            and element not in train.topology.elements
        ]
        if lacking:
            option, element = lacking[0]
            skipped[title] = f"which has no {element!r} that {option} names."
        elif (
            EACH in (*given.get("misfire", ()), *given.get("cut_off", ()))
            and not train.topology.firing_cylinders
        ):
            skipped[title] = "in which no cylinder fires."
    return skipped


def _named_elements(given):
    """Elements that options of a command name, (option, element)."""
    for option in ("misfire", "cut_off", "element"):
        yield from (
            (f"--{option.replace('_', '-')}", name) for name in given.get(option) or ()
        )
    yield from (
        ("--of", str(name).rpartition(" of ")[2]) for name in given.get("of") or ()
    )
    yield from (
        (f"--{option}", given[key])
        for option, key in (("gear", "gear"), ("phase", "name"))
        if given.get(key)
    )
    settings = [("--set", key) for key, _ in given.get("set") or ()]
    settings += [("--over", given["over"][0])] if given.get("over") else []
    for option, key in settings:
        name = key.rpartition(".")[0]
        yield option, name.removesuffix(".combustion").removesuffix(".traces")


def _write(given, own, skipped):
    """Write JSON and CSV of modes that are done; the largest values of all, and the
    files written.
    """
    worst = _worst({title: changed["compared"] for title, changed in own.items()})
    contents = {}
    if given.get("csv"):
        rows = {}
        for title, changed in own.items():
            with Path(changed["csv"]).open(encoding="utf-8", newline="") as text:
                heads, *lines = (
                    [unguarded(cell) for cell in cells] for cells in csv.reader(text)
                )
                rows[title] = [dict(zip(heads, cells, strict=True)) for cells in lines]
        heads = list(
            dict.fromkeys(
                head for several in rows.values() for row in several for head in row
            )
        )
        lines = [
            [title, *map(row.get, heads)]
            for title, several in rows.items()
            for row in several
        ]
        contents[given["csv"]] = output.as_csv(["scenario", *heads], lines)
    if given.get("json"):
        records = {
            title: json.loads(Path(one["json"]).read_text("utf-8"))
            for title, one in own.items()
        }
        contents[given["json"]] = output.as_json(
            {"scenarios": records, "worst": worst, "skipped": skipped}
        )
    output.write_files(contents)
    return worst, list(contents)


def _named(name, title):
    """The name of a file with that of the mode in it."""
    path = Path(name)
    own = re.sub(r"[^\w.-]+", "_", title)
    return str(path.with_name(f"{path.stem}_{own}{path.suffix}"))


def tell(given, compared):
    """Hand on what is compared over the modes, made by a function, to the table of the
    largest of all; where the command runs alone nothing is made.
    """
    if hasattr(given, "compared"):
        given.compared.extend(compared())


def _worst(compared):
    """Of every quantity of all modes its largest value, with the mode, the case and the
    place; ``compared`` are lists of :class:`jaxhb.report.files.compared.Compared` by
    mode.
    """
    largest = {}
    for title, numbers in compared.items():
        for one in numbers:
            if one.value > (largest[one.key][1].value if one.key in largest else 0.0):
                largest[one.key] = title, one
    return {
        key: {
            "value": one.value,
            "unit": one.unit,
            "scenario": title,
            "case": one.case,
            one.axis: one.place,
        }
        for key, (title, one) in largest.items()
    }


def _table(worst):
    """The same for people."""
    from jaxhb.report.quantities import shown_unit
    from jaxhb.report.text.columns import from_rows, plain_number

    lines = []
    for head, one in worst.items():
        value, si, mode, case, place = one.values()
        factor, unit = shown_unit(si)
        where = f"{mode}, {case}" if case else mode
        lines.append(
            [
                head.removesuffix(f" {si}"),
                plain_number(factor * value),
                unit,
                f"{place:g}",
                where,
            ]
        )
    at = f"at {list(worst[head])[-1]}"
    return from_rows(
        "Largest over all modes", ["", "value", "unit", at, "mode"], lines, left=(2, 4)
    )
