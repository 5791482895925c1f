"""What a command is given, read and checked before anything heavy is imported: the scene and the names of files."""

import shlex
from pathlib import Path

from ..model.scene import load_scene, scene_description, scene_names
from ..model.scene_writer import copies_beside, scene_text
from .output import OutputError, as_picture, check_output, check_picture, write_files
from .referred import referred_text

_FILES = ("json", "csv", "output", "plot", "html")


def scenes():
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
    for name in (arguments.file, *copies):
        print(f"{name} is written.")
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
    if arguments.plot:
        check_picture("--plot", arguments.plot)
    text, beside = scene_text(arguments.scene, expand=arguments.expand)
    files = {arguments.plot: _sketch(arguments)} if arguments.plot else {}
    if arguments.out:
        copies = copies_beside(beside, Path(arguments.out).parent, "--out")
        files |= {arguments.out: [text.encode()]} | {path: [content] for path, content in copies.items()}
    write_files(files)
    if arguments.referred:
        print(referred_text(load_scene(arguments.scene)))
        return 0
    printed = not arguments.out and (arguments.expand or not arguments.plot)
    print(text if printed else "".join(f"{name} is written.\n" for name in files), end="")
    return 0


def _sketch(arguments):
    from .sketch_plots import plot_train

    train = load_scene(arguments.scene)
    try:
        return as_picture(arguments.plot, plot_train(train))
    except ValueError as error:
        raise OutputError(f"--plot: {error}") from None


def read(arguments):
    """The train of a command, after files that cannot be written are refused; file names that have defaults are set."""
    if hasattr(arguments, "output"):
        arguments.output = arguments.output or f"{Path(arguments.scene).stem}_tuned.toml"
        arguments.json = arguments.json or str(Path(arguments.output).with_suffix(".json"))
    _check_files(vars(arguments))
    train = load_scene(arguments.scene)
    if getattr(arguments, "scenario", None) is not None:
        train = train.scenario(arguments.scenario)
    train = train.replace(dict(arguments.set)) if arguments.set else train
    at = dict(getattr(arguments, "links_at", ()))
    by_speed = getattr(arguments, "by_speed", False)  # the command takes links as they are at its own speeds
    return train.with_constant_links(**at) if at and not by_speed else train


def _check_files(given):
    files = {option: given[option] for option in _FILES if given.get(option)}
    for option, name in files.items():
        (check_picture if option == "plot" else check_output)(f"--{option}", name)
    if files.get("html") and Path(files["html"]).suffix.lower() not in (".html", ".htm"):
        raise OutputError(f"--html: {files['html']!r} is no page. Give a name that ends in .html.")
    if len({Path(name).resolve() for name in files.values()}) < len(files):
        raise OutputError(f"--{' and --'.join(files)} name the same file. Give each its own.")
