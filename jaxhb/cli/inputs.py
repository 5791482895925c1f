"""What a command is given, read and checked before anything heavy is imported: the scene and the names of files."""

import shlex
from pathlib import Path

from jaxhb.report.files.output import (
    STANDARD_OUTPUT,
    OutputError,
    as_picture,
    check_inputs,
    check_output,
    check_picture,
    write_files,
)
from jaxhb.scene.files import load_scene, scene_description, scene_names
from jaxhb.scene.writer import copies_beside, scene_files, scene_text

_FILES = ("output", "json", "csv", "netcdf", "trace", "plot", "html")


def scenes(_):
    """List the packaged scenes."""
    names = scene_names()
    width = max(map(len, names))
    for name in names:
        print(f"{name.ljust(width)}  {scene_description(name)}")
    return 0


def new(arguments):
    """Write a scene to begin with, and its tables beside it."""
    path = Path(arguments.file)
    _check_scene_name("FILE", arguments.file)
    if path.exists():
        raise OutputError(f"FILE: {arguments.file!r} is there already, and is not overwritten. Give another name.")
    text, beside = scene_text(arguments.scene, called=path.stem)
    copies = copies_beside(beside, path.parent, "FILE")
    write_files({path: [content] for path, content in copies.items()} | {arguments.file: [text.encode()]})
    if not arguments.quiet:
        print("".join(f"{name} is written.\n" for name in (arguments.file, *copies)), end="")
        print(f"Try: jaxhb check {shlex.quote(arguments.file)}")
    return 0


def _check_scene_name(option, name):
    if Path(name).suffix != ".toml":
        raise OutputError(f"{option}: {name!r} is no scene. Give a name that ends in .toml.")
    check_output(option, name)


def scene(arguments):
    """Print a scene as TOML or its referred numbers, or write it with the tables it names, or draw the train."""
    if arguments.out:
        _check_scene_name("--out", arguments.out)
        check_inputs("--out", arguments.out, scene_files(arguments.scene))
    if arguments.plot:
        check_picture("--plot", arguments.plot)
        check_inputs("--plot", arguments.plot, scene_files(arguments.scene))
    text, beside = scene_text(arguments.scene, expand=arguments.expand)
    files = {arguments.plot: _sketch(arguments)} if arguments.plot else {}
    if arguments.out:
        copies = copies_beside(beside, Path(arguments.out).parent, "--out")
        files |= {arguments.out: [text.encode()]} | {path: [content] for path, content in copies.items()}
    write_files(files)
    if arguments.quiet:
        return 0
    if arguments.referred:
        from jaxhb.report.text.scene_check import referred_tables

        print("\n\n".join(referred_tables(load_scene(arguments.scene))))
        return 0
    printed = not arguments.out and (arguments.expand or not arguments.plot)
    print(text.replace("\r\n", "\n") if printed else "".join(f"{name} is written.\n" for name in files), end="")
    return 0


def _sketch(arguments):
    from jaxhb.report.figures.sketch import plot_train

    train = load_scene(arguments.scene)
    try:
        return as_picture(arguments.plot, plot_train(train))
    except ValueError as error:
        raise OutputError(f"--plot: {error}") from None


def read(arguments, constant_links=True):
    """The train of a command, after files that cannot be written are refused; file names that have defaults are set.

    Links that vary become constant as --links-at says, unless the command sees to that at its own speeds.
    """
    _check_files(arguments)
    train = load_scene(arguments.scene)
    if getattr(arguments, "scenario", None) is not None:
        train = train.scenario(arguments.scenario)
    train = train.replace(dict(arguments.set)) if arguments.set else train
    at = dict(getattr(arguments, "links_at", ()))
    train = train.with_constant_links(**at) if at and constant_links else train
    hz = getattr(arguments, "viscous", None)
    return train if hz is None else train.with_viscous_damping(hz=hz)


def _check_files(arguments):
    """Refuse what cannot be written, by the name of the option that was given."""
    options = {option: f"--{option}" for option in _FILES}
    if hasattr(arguments, "output"):
        _tuned_names(arguments, options)
    files = {option: getattr(arguments, option) for option in _FILES if getattr(arguments, option, None)}
    scenes = [arguments.scene, getattr(arguments, "tuned", None)] if files else []
    inputs = [path for name in scenes if name is not None for path in scene_files(name)]
    for option, name in files.items():
        (check_picture if option == "plot" else check_output)(options[option], name)
        check_inputs(options[option], name, inputs)
    if files.get("html") and Path(files["html"]).suffix.lower() not in (".html", ".htm"):
        raise OutputError(f"--html: {files['html']!r} is no page. Give a name that ends in .html.")
    if len({Path(name).resolve() for name in files.values()}) < len(files):
        raise OutputError(f"--{' and --'.join(files)} name the same file. Give each its own.")


def _tuned_names(arguments, options):
    """Names of the files of a tuning that were not given; none of them may hold anything else."""
    signs = {}
    if arguments.output is None:
        arguments.output = f"{Path(arguments.scene).stem}_tuned.toml"
        signs[arguments.output] = b"tuned by jaxhb tune"
    if arguments.json is None:
        arguments.json, options["json"] = str(Path(arguments.output).with_suffix(".json")), "--output"
        signs[arguments.json] = b'"history"'
    if arguments.json == STANDARD_OUTPUT:
        raise OutputError("--json: a tuning writes it again at every step. Give the name of a file.")
    for name, sign in signs.items():
        if Path(name).is_file() and sign not in Path(name).read_bytes():
            raise OutputError(f"--output: {name!r} is there and is not from jaxhb tune. Name the tuned scene yourself.")
