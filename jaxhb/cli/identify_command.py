"""The command of measurements: fit numbers of a scene, or find the weak cylinder."""

from collections.abc import Sequence
from pathlib import Path

from jaxhb.cli import arguments as cli
from jaxhb.cli.progress import Progress
from jaxhb.design.identification import (
    Identification,
    identify as search,
    weak_cylinder,
)
from jaxhb.design.measurements import Measured, read_measured
from jaxhb.design.quantities import Parameter
from jaxhb.design.tolerances import read_tolerances
from jaxhb.report.figures.speeds import plot_identified
from jaxhb.report.files import output
from jaxhb.report.files.formats import deliver
from jaxhb.report.orders import order_names
from jaxhb.report.text.identified import (
    identified_record,
    identified_text,
    weak_record,
    weak_text,
)
from jaxhb.scene.files import load_scene
from jaxhb.scene.writer import changed_scene, copies_beside
from jaxhb.train.changes import numbers_in_si, scene_values
from jaxhb.train.drivetrain import DriveTrain

Bounds = tuple[str, tuple[float | str, float | str]]
"""``NAME.FIELD`` and its bounds, numbers or numbers with a unit."""


def identify(train: DriveTrain, arguments: cli.IdentifyOptions) -> int:
    """Fit numbers of a scene to measured orders."""
    rows = read_measured(arguments.measured, train)
    if arguments.weak:
        return _find_weak_cylinder(train, rows, arguments)
    parameters, priors = _parameters(train, arguments.fit)
    with Progress(quiet=arguments.quiet) as progress:
        progress.say("fitting the measurements")
        fitted = search(
            train, rows, parameters=parameters, noise=arguments.noise, priors=priors
        )
    makers = {
        "record": lambda: identified_record(fitted),
        "figure": lambda: plot_identified(fitted),
    }
    deliver(arguments, identified_text(fitted), makers)
    path = arguments.files.get("output")
    if path:
        _write(arguments, path, fitted)
        if not arguments.quiet:
            print(f"\nThe scene with the fitted parameters is {path}.")
    return output.ANSWERED


def _find_weak_cylinder(
    train: DriveTrain, rows: Measured, arguments: cli.IdentifyOptions
) -> int:
    """Name the cylinder that explains measured orders."""
    if arguments.fit or {"output", "plot"} & {*arguments.files}:
        raise output.OutputError(
            "--weak-cylinder: it fits no number. Leave out --fit, --output and --plot."
        )
    weak = weak_cylinder(train, rows, noise=arguments.noise)
    scene = {"scene": train.topology.name}
    text = weak_text(weak, order_names(train))
    deliver(arguments, text, {"record": lambda: scene | weak_record(weak)})
    return output.ANSWERED if weak.explains else output.NOT_ANSWERED


def _parameters(
    train: DriveTrain, fit: Sequence[Bounds]
) -> tuple[list[Parameter], dict[str, float]]:
    """Parameters and priors: of ``--fit``, or those of the [tolerance] table, whose
    deviations are priors.
    """
    tolerances = [] if fit else read_tolerances(train)
    written = fit or [(row.name, (row.low, row.high)) for row in tolerances]
    bounds = [(name, numbers_in_si(train, name, ends)) for name, ends in written]
    parameters = [
        Parameter(name=name, low=low, high=high, scale="log" if low > 0 else "linear")
        for name, (low, high) in bounds
    ]
    return parameters, {row.name: row.std for row in tolerances if row.std}


def _write(arguments: cli.IdentifyOptions, path: str, fitted: Identification) -> None:
    """Write the scene with fitted numbers, and their deviations as its tolerances."""
    names = [parameter.name for parameter in fitted.parameters]
    values = dict(arguments.set) | dict(
        zip(names, map(float, fitted.values), strict=True)
    )
    tolerances = {
        name: {"std": float(f"{deviation:.4g}")}
        for name, deviation in zip(names, fitted.std, strict=True)
        if deviation > 0
    }
    measured = Path(arguments.measured).name
    # A scenario may leave elements out.
    whole = load_scene(arguments.scene).replace(values)
    text, tables = changed_scene(
        arguments.scene,
        scene_values(whole, values),
        tolerances=tolerances,
        remark=f"{arguments.scene}, fitted to {measured} by jaxhb identify.",
    )
    copies = copies_beside(tables, Path(path).parent)
    output.make_folders(copies.files)
    output.write_files(copies.files | {path: copies.renamed(text).encode()})
