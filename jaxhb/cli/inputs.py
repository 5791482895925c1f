"""Scenes as a command reads, lists and writes them, and names of files checked before
anything heavy is imported.
"""

import dataclasses
import importlib.util
import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from jaxhb.cli import arguments as cli
from jaxhb.report.files import output
from jaxhb.scene.files import load_scene, scene_description, scene_names
from jaxhb.scene.input_files import Unreadable, read_bytes
from jaxhb.scene.writer import copies_beside, scene_files, scene_text
from jaxhb.train.drivetrain import DriveTrain

WRITTEN = (
    "file",
    "output",
    "out",
    "json",
    "csv",
    "netcdf",
    "trace",
    "plot",
    "html",
)
"""Names of the arguments that are files to write."""

SCENE_ENDINGS = (".toml",)
TUNED_BY = {"output": b"tuned by jaxhb tune", "json": b'"history"'}
"""Bytes by which the files of a tuning are known."""


@dataclass(frozen=True)
class FileKind:
    """A kind of file: its name for people, how its names end (by default as they are
    given), the libraries that write it and the extra that brings them.
    """

    name: str = "file"
    endings: tuple[str, ...] = ()
    need: str = ""
    extra: str = ""
    libraries: tuple[str, ...] = ()


KINDS = {
    "file": FileKind("scene", SCENE_ENDINGS),
    "out": FileKind("scene", SCENE_ENDINGS),
    "plot": FileKind(
        "picture", (".png", ".svg", ".pdf"), "pictures need", "plot", ("matplotlib",)
    ),
    "netcdf": FileKind(need="such files need", extra="data", libraries=("xarray",)),
    "html": FileKind(
        "page",
        (".html", ".htm"),
        "the page needs",
        "report",
        ("jinja2", "plotly", "matplotlib"),
    ),
}


def scenes() -> int:
    """List the packaged scenes."""
    names = scene_names()
    width = max(map(len, names))
    for name in names:
        print(f"{name:<{width}}  {scene_description(name)}")
    return 0


def new(arguments: cli.New) -> int:
    """Write a scene to begin with, and its tables beside it."""
    file = arguments.file
    path = Path(file)
    check_files(arguments)
    if path.exists():
        raise output.OutputError(
            f"FILE: {file!r} is there already, and is not overwritten. Give another"
            " name."
        )
    text, tables = scene_text(arguments.scene, called=path.stem)
    copies = copies_beside(tables, path.parent, "FILE")
    output.write_files(copies.files | {file: copies.renamed(text).encode()})
    if not arguments.quiet:
        for name in (file, *copies.files):
            print(f"{name} is written.")
        print(f"Try: jaxhb check {shlex.quote(file)}")
    return 0


def scene(arguments: cli.Scene) -> int:
    """Print a scene as TOML or its referred numbers, or write it with the tables it
    names, or draw the train.
    """
    check_files(arguments)
    plot = arguments.plot
    out = arguments.out
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


def read(arguments: cli.Changed, constant_links: bool) -> DriveTrain:
    """The train of a command: the scene with what is changed in it.

    Links that vary become constant as --links-at says, unless the command sees to that
    at its own speeds.
    """
    train = load_scene(arguments.scene)
    computed = arguments if isinstance(arguments, cli.Computed) else None
    if computed and computed.scenario is not None:
        train = train.scenario(computed.scenario)
    if arguments.set:
        train = train.replace(dict(arguments.set))
    if computed and constant_links and computed.links_at:
        train = train.with_constant_links(**dict(computed.links_at))
    if computed and computed.viscous is not None:
        train = train.with_viscous_damping(hz=computed.viscous)
    return train


def check_files(
    arguments: cli.Arguments, options: dict[str, str] | None = None
) -> None:
    """Refuse what cannot be written, by the name of the option that was given;
    ``options`` are those under which files stand that the user did not name.
    """
    named: dict[str, str | None] = {
        name: getattr(arguments, name, None) for name in WRITTEN
    }
    files = {name: path for name, path in named.items() if path}
    scenes = [arguments.scene, getattr(arguments, "tuned", None)] if files else []
    inputs = [path for name in scenes if name is not None for path in scene_files(name)]
    for name, path in files.items():
        option = (options or {}).get(name) or _option(name)
        output.check_output(option, path, inputs)
        kind = KINDS.get(name, FileKind())
        ending = Path(path).suffix.lower()
        if ending not in (kind.endings or [ending]):
            raise output.OutputError(
                f"{option}: {path!r} is no {kind.name}. Give a name that ends in"
                f" {', '.join(kind.endings)}."
            )
        missing = [
            library
            for library in kind.libraries
            if importlib.util.find_spec(library) is None
        ]
        if missing:
            raise output.OutputError(
                f"{option}: {kind.need} {', '.join(missing)}. Install it: pip install"
                f' "jaxhb[{kind.extra}]".'
            )
    if len({Path(path).resolve() for path in files.values()}) < len(files):
        raise output.OutputError(
            f"{' and '.join(map(_option, files))} name the same file. Give each its"
            " own."
        )


def _option(name: str) -> str:
    """How people know the argument of a file."""
    return "FILE" if name == "file" else f"--{name}"


def checked_tuning(arguments: cli.Tune) -> cli.Tune:
    """The arguments of a tuning with names for the files that were not named; none of
    those may hold anything else, and all can be written.
    """
    if arguments.json == output.STANDARD_OUTPUT:
        raise output.OutputError(
            "--json: a tuning writes it again at every step. Give the name of a file."
        )
    tuned = arguments.output or f"{Path(arguments.scene).stem}_tuned.toml"
    json = arguments.json or str(Path(tuned).with_suffix(".json"))
    named = dataclasses.replace(arguments, output=tuned, json=json)
    defaults = [name for name in TUNED_BY if getattr(arguments, name) is None]
    for name in defaults:
        path = Path(getattr(named, name))
        if path.is_file() and not _holds(path, TUNED_BY[name]):
            raise output.OutputError(
                f"--output: {str(path)!r} is there and is not from jaxhb tune. Name the"
                " tuned scene yourself."
            )
    check_files(named, dict.fromkeys(defaults, "--output"))
    return named


def _holds(path: Path, sign: bytes) -> bool:
    """Whether a file can be read and holds a sign of who wrote it."""
    try:
        return sign in read_bytes(path)
    except Unreadable:
        return False
