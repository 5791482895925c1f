"""Scenes as a command reads, lists and writes them, and names of files checked before
anything heavy is imported.
"""

import dataclasses
import importlib.util
import shlex
from collections.abc import Iterable
from pathlib import Path

from jaxhb.cli import arguments as cli
from jaxhb.elements.units import Shown, chosen_units
from jaxhb.report.files import output
from jaxhb.report.files.formats import FORMATS
from jaxhb.scene.files import (
    load_scene,
    read_rules,
    scene_description,
    scene_names,
)
from jaxhb.scene.input_files import Unreadable, read_bytes
from jaxhb.scene.writer import copies_beside, scene_files, scene_text
from jaxhb.train.drivetrain import DriveTrain

TUNED_BY = {"output": b"tuned by jaxhb tune", "json": b'"history"'}
"""Bytes by which the files of a tuning are known."""


def scenes() -> int:
    """List the packaged scenes."""
    names = scene_names()
    width = max(map(len, names))
    for name in names:
        print(f"{name:<{width}}  {scene_description(name)}")
    return 0


def new(arguments: cli.CommonOptions) -> int:
    """Write a scene to begin with: TOML and its tables beside it, or a workbook."""
    if len(arguments.files) != 1:
        raise output.OutputError("FILE and --xlsx: give one of them.")
    ((form, file),) = arguments.files.items()
    path = Path(file)
    check_files(arguments)
    if path.exists():
        raise output.OutputError(
            f"{FORMATS[form].option}: {file!r} is there already, and is not"
            " overwritten. Give another name."
        )
    text, tables = scene_text(arguments.scene, called=path.stem)
    if form == "xlsx":
        from jaxhb.scene.workbook.writing import scene_workbook

        # Rows come on sheets; parts and rules stay files.
        beside = {name: table for name, table in tables.items() if ".toml" in name}
        copies = copies_beside(beside, path.parent, "--xlsx")
        content = scene_workbook(
            arguments.scene, called=path.stem, renamed=copies.names
        )
    else:
        copies = copies_beside(tables, path.parent, "FILE")
        content = copies.renamed(text).encode()
    files = {file: content} | copies.files
    output.write_files(files)
    if not arguments.quiet:
        for name in files:
            print(f"{name} is written.")
        print(f"Try: jaxhb check {shlex.quote(file)}")
    return 0


def scene(arguments: cli.SceneOptions) -> int:
    """Print a scene as TOML or its referred numbers, or write it with the tables it
    names, or draw the train.
    """
    check_files(arguments)
    plot = arguments.files.get("plot")
    out = arguments.files.get("out")
    text, tables = scene_text(arguments.scene, expand=arguments.expand)
    files: dict[str, Iterable[bytes] | bytes] = {}
    if plot:
        # Loads jax, which a scene that is printed does not need.
        from jaxhb.report.figures.sketch import plot_train

        try:
            figure = plot_train(load_scene(arguments.scene))
        except ValueError as error:
            raise output.OutputError(f"--plot: {error}") from None
        files[plot] = output.as_picture(plot, figure)
    if out:
        copies = copies_beside(tables, Path(out).parent, "--out")
        files |= {out: copies.renamed(text).encode()} | copies.files
    output.write_files(files)
    if arguments.quiet:
        return 0
    if arguments.referred:
        from jaxhb.report.text.scene_check import referred_tables

        print("\n\n".join(referred_tables(load_scene(arguments.scene))))
    elif not out and (arguments.expand or not plot):
        print(text.replace("\r\n", "\n"), end="")
    else:
        for name in files:
            print(f"{name} is written.")
    return 0


def read(arguments: cli.ChangedOptions, constant_links: bool) -> DriveTrain:
    """The train of a command: the scene with what is changed in it.

    Links that vary become constant as --links-at says, unless the command sees to that
    at its own speeds.
    """
    train = load_scene(arguments.scene)
    computed = arguments if isinstance(arguments, cli.ComputedOptions) else None
    if computed and computed.scenario is not None:
        train = train.scenario(computed.scenario)
    if arguments.set:
        train = train.replace(dict(arguments.set))
    if arguments.rules:
        train = train.with_rules(*read_rules(arguments.rules, Path()))
    if computed and constant_links and computed.links_at:
        train = train.with_constant_links(**dict(computed.links_at))
    if computed and computed.viscous is not None:
        train = train.with_viscous_damping(hz=computed.viscous)
    return train


def shown_units(
    arguments: cli.ChangedOptions, train: DriveTrain | None
) -> dict[str, Shown]:
    """Units in which a command shows quantities: of the scene, and of ``--units``
    before those; ``train`` is one of the scene, if there is one already.
    """
    train = load_scene(arguments.scene) if train is None else train
    return chosen_units(train.report_units | dict(arguments.units or {}))


def check_files(
    arguments: cli.CommonOptions | cli.CampaignOptions | cli.OrdersOptions,
    options: dict[str, str] | None = None,
) -> None:
    """Refuse what cannot be written, by the name of the option that was given;
    ``options`` are those under which files stand that the user did not name.
    """
    files = arguments.files
    scenes = [getattr(arguments, name, None) for name in ("scene", "tuned") if files]
    inputs = [path for name in scenes if name is not None for path in scene_files(name)]
    if isinstance(arguments, cli.CampaignOptions):
        inputs += filter(Path.is_file, [Path(arguments.study)])
    if isinstance(arguments, cli.OrdersOptions):
        inputs += filter(Path.is_file, [Path(arguments.recorded)])
    for name, path in files.items():
        form = FORMATS[name]
        option = (options or {}).get(name) or form.option
        output.check_output(option, path, inputs, streamed=form.streamed)
        if form.endings and Path(path).suffix.lower() not in form.endings:
            raise output.OutputError(
                f"{option}: {path!r} is no {form.kind}. Give a name that ends in"
                f" {', '.join(form.endings)}."
            )
        missing = [
            library
            for library in form.libraries
            if importlib.util.find_spec(library) is None
        ]
        if missing:
            raise output.OutputError(
                f"{option}: {form.need} {', '.join(missing)}. Install it: pip install"
                f' "jaxhb[{form.extra}]".'
            )
    if len({Path(path).resolve() for path in files.values()}) < len(files):
        options_of_files = " and ".join(FORMATS[name].option for name in files)
        raise output.OutputError(
            f"{options_of_files} name the same file. Give each its own."
        )


def checked_tuning(arguments: cli.TuneOptions) -> cli.TuneOptions:
    """The arguments of a tuning with names for the files that were not named; none of
    those may hold anything else, and all can be written.
    """
    files = arguments.files
    if files.get("json") == output.STANDARD_OUTPUT:
        raise output.OutputError(
            "--json: a tuning writes it again at every step. Give the name of a file."
        )
    tuned = files.get("output", f"{Path(arguments.scene).stem}_tuned.toml")
    every = {"output": tuned, "json": str(Path(tuned).with_suffix(".json"))}
    every |= files
    defaults = [name for name in TUNED_BY if name not in files]
    for name in defaults:
        path = Path(every[name])
        if path.is_file() and not _holds(path, TUNED_BY[name]):
            raise output.OutputError(
                f"--output: {str(path)!r} is there and is not from jaxhb tune. Name the"
                " tuned scene yourself."
            )
    named = dataclasses.replace(arguments, files=every)
    check_files(named, dict.fromkeys(defaults, "--output"))
    return named


def _holds(path: Path, sign: bytes) -> bool:
    """Whether a file can be read and holds a sign of who wrote it."""
    try:
        return sign in read_bytes(path)
    except Unreadable:
        return False
