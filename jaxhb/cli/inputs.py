"""Scenes as a command reads, lists and writes them, and names of files checked before
anything heavy is imported.
"""

import importlib.util
import shlex
from pathlib import Path

from jaxhb.report.files import output
from jaxhb.scene.files import load_scene, scene_description, scene_names
from jaxhb.scene.input_files import Unreadable, read_bytes
from jaxhb.scene.writer import copies_beside, scene_files, scene_text

FILES = ("FILE", "output", "out", "json", "csv", "netcdf", "trace", "plot", "html")
# What files must be, and how their names end.
ENDINGS: dict = {
    "html": ("page", ".html", ".htm"),
    "out": ("scene", ".toml"),
    "FILE": ("scene", ".toml"),
}
ENDINGS |= {"plot": ("picture", ".png", ".svg", ".pdf")}
# What files need, and the extra that brings it.
NEEDS: dict = {
    "plot": ("pictures need", "plot", "matplotlib"),
    "netcdf": ("such files need", "data", "xarray"),
}
NEEDS |= {"html": ("the page needs", "report", "jinja2", "plotly", "matplotlib")}


def scenes():
    """List the packaged scenes."""
    names = scene_names()
    for name in names:
        print(f"{name:<{max(map(len, names))}}  {scene_description(name)}")
    return 0


def new(file, scene, quiet):
    """Write a scene to begin with, and its tables beside it."""
    path = Path(file)
    _check_files({"scene": scene, "FILE": file})
    if path.exists():
        raise output.OutputError(
            f"FILE: {file!r} is there already, and is not overwritten. Give another"
            " name."
        )
    text, beside = scene_text(scene, called=path.stem)
    copies = copies_beside(beside, path.parent, "FILE")
    output.write_files(copies.files | {file: copies.renamed(text).encode()})
    if not quiet:
        print(
            "".join(f"{name} is written.\n" for name in (file, *copies.files)), end=""
        )
        print(f"Try: jaxhb check {shlex.quote(file)}")
    return 0


def scene(scene, quiet, expand, out, referred, plot):
    """Print a scene as TOML or its referred numbers, or write it with the tables it
    names, or draw the train.
    """
    _check_files({"scene": scene, "out": out, "plot": plot})
    text, beside = scene_text(scene, expand=expand)
    files = {}
    if plot:
        from jaxhb.report.figures.sketch import (
            plot_train,
        )  # loads jax, which a scene that is printed does not need

        try:
            files = {plot: output.as_picture(plot, plot_train(load_scene(scene)))}
        except ValueError as error:
            raise output.OutputError(f"--plot: {error}") from None
    if out:
        copies = copies_beside(beside, Path(out).parent, "--out")
        files |= {out: copies.renamed(text).encode()} | copies.files
    output.write_files(files)
    if referred and not quiet:
        from jaxhb.report.text.scene_check import referred_tables

        print("\n\n".join(referred_tables(load_scene(scene))))
    elif not quiet:
        printed = not out and (expand or not plot)
        print(
            (
                text.replace("\r\n", "\n")
                if printed
                else "".join(f"{name} is written.\n" for name in files)
            ),
            end="",
        )
    return 0


def read(given, constant_links):
    """The train of a command, after files that cannot be written are refused; names of
    files get their defaults.

    Links that vary become constant as --links-at says, unless the command sees to that
    at its own speeds.
    """
    _check_files(given)
    train = load_scene(given["scene"])
    if given.get("scenario") is not None:
        train = train.scenario(given["scenario"])
    train = train.replace(dict(given["set"])) if given["set"] else train
    if constant_links and given.get("links_at"):
        train = train.with_constant_links(**dict(given["links_at"]))
    return (
        train
        if given.get("viscous") is None
        else train.with_viscous_damping(hz=given["viscous"])
    )


def _check_files(given):
    """Refuse what cannot be written, by the name of the option that was given."""
    named = {option: f"--{option}" if option.islower() else option for option in FILES}
    if "optimizer" in given:  # of a tuning
        _name_tuned(given, named)
    files = {option: given[option] for option in FILES if given.get(option)}
    scenes = [given["scene"], given.get("tuned")] if files else []
    inputs = [path for name in scenes if name is not None for path in scene_files(name)]
    for option, name in files.items():
        output.check_output(named[option], name, inputs)
        kind, *endings = ENDINGS.get(option, ("file", Path(name).suffix.lower()))
        if Path(name).suffix.lower() not in endings:
            told = f"is no {kind}. Give a name that ends in {', '.join(endings)}"
            raise output.OutputError(f"{named[option]}: {name!r} {told}.")
        need, extra, *libraries = NEEDS.get(option, ("", ""))
        if missing := [
            one for one in libraries if importlib.util.find_spec(one) is None
        ]:
            told = (
                f'{need} {", ".join(missing)}. Install it: pip install "jaxhb[{extra}]"'
            )
            raise output.OutputError(f"{named[option]}: {told}.")
    if len({Path(name).resolve() for name in files.values()}) < len(files):
        raise output.OutputError(
            f"--{' and --'.join(files)} name the same file. Give each its own."
        )


def _name_tuned(given, named):
    """Name the files of a tuning that were not given; none of them may hold anything
    else.
    """
    if given["json"] == output.STANDARD_OUTPUT:
        raise output.OutputError(
            "--json: a tuning writes it again at every step. Give the name of a file."
        )
    signs = {"output": b"tuned by jaxhb tune", "json": b'"history"'}
    stem = f"{Path(given['scene']).stem}_tuned.toml"
    for option, sign in signs.items():
        if given[option] is None:
            name = (
                stem
                if option == "output"
                else str(Path(given["output"]).with_suffix(".json"))
            )
            given[option], named[option] = name, "--output"
            if Path(name).is_file() and not _holds(Path(name), sign):
                told = (
                    f"{name!r} is there and is not from jaxhb tune. Name the tuned"
                    " scene yourself."
                )
                raise output.OutputError(f"--output: {told}")


def _holds(path, sign):
    """Whether a file can be read and holds a sign of who wrote it."""
    try:
        return sign in read_bytes(path)
    except Unreadable:
        return False
