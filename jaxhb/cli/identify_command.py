"""The command of measurements: fit numbers of a scene, or find the weak cylinder."""

from pathlib import Path

from jaxhb.cli.progress import Progress
from jaxhb.design.identification import identify as search, weak_cylinder
from jaxhb.design.measurements import read_measured
from jaxhb.design.quantities import Parameter
from jaxhb.design.tolerances import read_tolerances
from jaxhb.report.figures.speeds import plot_identified
from jaxhb.report.files import output
from jaxhb.report.orders import order_names
from jaxhb.report.text.identified import (
    identified_record,
    identified_text,
    weak_record,
    weak_text,
)
from jaxhb.scene.files import load_scene
from jaxhb.scene.writer import changed_scene, copies_beside
from jaxhb.train.changes import scene_values


def identify(train, given, measured, fit, noise, weak, plot, quiet, **_):
    """Fit numbers of a scene to measured orders."""
    rows = read_measured(measured, train)
    if weak:
        if fit or given.output or plot:
            raise output.OutputError(
                "--weak-cylinder: it fits no number. Leave out --fit, --output and"
                " --plot."
            )
        found = weak_cylinder(train, rows, noise=noise)
        said = weak_text(found, order_names(train))
        output.deliver(
            given,
            said,
            json=lambda: {"scene": train.topology.name} | weak_record(found),
        )
        return output.ANSWERED if found.explains else output.NOT_ANSWERED
    parameters, priors = _asked(train, fit)
    with Progress(quiet=quiet) as progress:
        progress.say("fitting the measurements")
        found = search(train, rows, parameters=parameters, noise=noise, priors=priors)
    output.deliver(
        given,
        identified_text(found),
        json=lambda: identified_record(found),
        plot=lambda: plot_identified(found),
    )
    if given.output:
        _write(given, found)
        if not quiet:
            print(f"\nThe scene with the fitted numbers is {given.output}.")
    return output.ANSWERED


def _asked(train, fit):
    """Parameters and priors: of ``--fit``, or those of the [tolerance] table, whose
    deviations are priors.
    """
    known = [] if fit else read_tolerances(train)
    bounds = fit or [(one.name, (one.low, one.high)) for one in known]
    scales = (("log" if low > 0 else "linear") for _, (low, _) in bounds)
    made = [
        Parameter(name=name, low=a, high=b, scale=s)
        for (name, (a, b)), s in zip(bounds, scales, strict=True)
    ]
    return made, {one.name: one.std for one in known if one.std}


def _write(given, found):
    """The scene with fitted numbers, and their deviations as its tolerances."""
    values = dict(given.set) | {
        p.name: float(v) for p, v in zip(found.parameters, found.values, strict=True)
    }
    known = {
        p.name: {"std": float(f"{s:.4g}")}
        for p, s in zip(found.parameters, found.std, strict=True)
        if s > 0
    }
    remark = f"{given.scene}, fitted to {Path(given.measured).name} by jaxhb identify."
    whole = load_scene(given.scene).replace(values)  # a scenario may leave elements out
    text, beside = changed_scene(
        given.scene, scene_values(whole, values), tolerances=known, remark=remark
    )
    copies = copies_beside(beside, Path(given.output).parent)
    output.make_folders(copies.files)
    output.write_files(copies.files | {given.output: copies.renamed(text).encode()})
