"""The command of tolerances: the worst case at many speeds, a few at a time, kept until all are done."""

import re

import numpy as np

from jaxhb.cli.progress import Progress
from jaxhb.cli.resume import GOES_ON, Kept
from jaxhb.design.quantities import QUANTITIES, Objective
from jaxhb.design.tolerances import read_tolerances
from jaxhb.design.worst_case import ARRAYS, Spread, default_quantities, joined, tolerance as search
from jaxhb.elements.elements import suggestion
from jaxhb.report.compute import check_spread
from jaxhb.report.figures.speeds import plot_tolerance
from jaxhb.report.files import numbers, output
from jaxhb.report.text.tolerances import tolerance_parts, tolerance_record, tolerance_rows

TOGETHER = 8  # speeds that are searched and kept together


def tolerance(train, given, rpm, of, samples, seed, plot, quiet, **_):
    """What the tolerances of a scene do to its response."""
    tolerances = read_tolerances(train)
    asked = {"samples": samples or 0, "seed": seed or 0, "harmonics": given.harmonics, "tolerance": given.tolerance}
    quantities = tuple(map(asked_quantity, of))
    kept = Kept([train], ("tolerance", rpm, quantities, tolerances, asked))
    with Progress(len(rpm), quiet=quiet) as progress:
        progress.say("solving the scene as it is")
        quantities = quantities or default_quantities(train, np.array(rpm), tolerances)
        asked |= {"of": quantities, "tolerances": tolerances, "progress": progress.say}
        parts = []

        def compute(folder):
            parts.clear()
            for first in range(0, len(rpm), TOGETHER):
                parts.append(_part(train, rpm[first : first + TOGETHER], asked, folder))
                progress.advance(len(parts[-1].rpm))
            return joined(parts)

        def left():
            done = sum(len(part.rpm) for part in parts)
            return f"{done} of {len(rpm)} speeds are done" + (f"; {GOES_ON}" if kept.folder else "")

        spread = kept.run(compute, left)
        checked = check_spread(spread, progress.say)
    output.deliver(
        given,
        "\n\n".join(tolerance_parts(spread, checked)),
        json=lambda: output.as_json(numbers.on_scene(given, train) | tolerance_record(spread, checked)),
        csv=lambda: numbers.rows_csv(list(tolerance_rows(spread, checked))),
        netcdf=lambda: [numbers.as_netcdf(spread.to_xarray())],
        plot=lambda: output.as_picture(plot, plot_tolerance(spread)),
    )
    kept.forget()
    return output.ANSWERED if np.isfinite(spread.nominal).all() else output.NOT_ANSWERED


def asked_quantity(text):
    """The Objective of ``"QUANTITY of ELEMENT"``, where a quantity may end in an order."""
    name, found, element = text.partition(" of ")
    order = re.fullmatch(r"(.*) ([\d.]+)", name)
    name, order = (order[1], float(order[2])) if order else (name, None)
    if not found or name not in QUANTITIES:
        known = 'write "QUANTITY of ELEMENT", as "tooth force of crank gear|idler"'
        raise output.OutputError(f"--of: {text!r}: {known}.{suggestion(name, QUANTITIES)}")
    return Objective(quantity=name, of=element, order=order)


def _part(train, rpm, asked, folder):
    """The Spread of a few speeds, as it was kept or computed and kept now."""
    path = folder / f"{rpm[0]:.6g}.npz" if folder else None
    if path and path.is_file():
        with np.load(path) as kept:
            arrays = {name: kept[name] for name in (*ARRAYS, "drawn")}
            solves = int(kept["evaluations"])
        return Spread(train, asked["of"], asked["tolerances"], **arrays, evaluations=solves)
    spread = search(train, rpm=np.array(rpm), **asked)
    if path:
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(path, **{name: getattr(spread, name) for name in (*ARRAYS, "drawn", "evaluations")})
    return spread
