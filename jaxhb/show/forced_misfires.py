"""Every cylinder in turn not firing in the linear forced response: what ``jaxhb forced --misfire each`` tells."""

import numpy as np

from .choose import case_title
from .columns import NONE, aligned, alike, ratios
from .forced import KINDS, forced_record, forced_rows, readings, signal_of

_CALLED = {"disks": "angle", "shafts": "torque", "meshes": "tooth force"}


def worst_of(misfires, found):
    """The misfire and the speed at which each element swings most.

    Parameters
    ----------
    misfires : Misfires, of forced responses
    found : list of Reading, of the response with all cylinders firing

    Returns
    -------
    dict
        :class:`jaxhb.periodic.misfires.Worst` by name, of the half peak-to-peak in SI units.

    Raises
    ------
    ValueError
        If no speed has an answer.
    """
    return {
        one.name: misfires.worst(lambda r, one=one: signal_of(r, one.name, one.kind).half_peak_to_peak) for one in found
    }


def hardest_of(found, worst):
    """The element that swings most under a misfire: of the meshes, without any of the shafts, else of the disks."""
    kinds = [one.kind for one in found]
    kind = next(kind for kind in ("meshes", "shafts", "disks") if kind in kinds)
    return max((one for one in found if one.kind == kind), key=lambda one: worst[one.name].value)


def misfires_text(misfires, found, worst, *, each):
    """The worst misfire, the largest swing of an element with every misfire, and the worst misfire of every element.

    Parameters
    ----------
    misfires : Misfires
    found : list of Reading, with all cylinders firing
    worst : dict, from :func:`worst_of`
    each : bool
        Whether the elements of ``found`` were asked for by name: then every misfire is listed for each of them.

    Returns
    -------
    str
    """
    chosen, title = found if each else [hardest_of(found, worst)], case_title(misfires.firing.train)
    parts = ["\n".join(_sentence(one, worst[one.name], title) for one in chosen)]
    parts += [_cylinder_table(misfires, one) for one in chosen]
    if not each:
        kinds = {kind: [one for one in found if one.kind == kind] for kind in KINDS}
        parts += [_element_table(misfires, kind, own, worst) for kind, own in kinds.items() if own]
    return "\n\n".join(parts)


def _sentence(element, worst, title):
    _, _, _, unit, factor = KINDS[element.kind]
    value, firing = (f"{factor * number:.4g} {unit}" for number in (worst.value, worst.firing))
    return (
        f"The worst misfire is that of {worst.cylinder}: {_CALLED[element.kind]} of {value} half peak-to-peak in"
        f" {element.name} at {worst.rpm:g} rpm, {firing} with {title}."
    )


def _cylinder_table(misfires, element):
    _, _, _, unit, factor = KINDS[element.kind]
    train, responses = misfires.firing.train, {"": misfires.firing} | misfires.responses
    values, speeds = zip(*(_largest(response, element) for response in responses.values()), strict=True)
    values = [factor * value for value in values]
    speeds = [f"{rpm:g}" if value > 0 else NONE for value, rpm in zip(values, speeds, strict=True)]
    titles, ratio = [case_title(train, name) for name in responses], ratios(values, values[:1] * len(values))
    title = f"{element.name}, {unit}: largest half peak-to-peak over the speeds"
    return title + "\n" + aligned(["", "half p-p", "at rpm", "ratio"], [titles, *alike(values), speeds, ratio])


def _largest(response, element):
    """The largest half peak-to-peak of an element over the speeds that have an answer, and its speed; nan without."""
    swing = signal_of(response, element.name, element.kind).half_peak_to_peak
    answered = np.flatnonzero(response.converged)
    if not len(answered):
        return np.nan, np.nan
    place = answered[np.argmax(swing[answered])]
    return swing[place], response.rpm[place]


def _element_table(misfires, kind, found, worst):
    head, title, _, _, factor = KINDS[kind]
    own = [worst[one.name] for one in found]
    largest = [factor * _largest(misfires.firing, one)[0] for one in found]
    values = [factor * one.value for one in own]
    columns = [
        [one.name for one in found],
        *alike(largest, values),
        ratios(values, largest),
        [f"{one.rpm:g}" if one.value else NONE for one in own],
        [one.cylinder if one.value else NONE for one in own],
    ]
    heads = [head, case_title(misfires.firing.train), "worst misfire", "ratio", "at rpm", "that of"]
    return f"{title}: largest half peak-to-peak over the speeds\n" + aligned(heads, columns, left=(5,))


def misfires_record(misfires, found, worst, *, orders=None):
    """What ``forced --misfire each --json`` writes beside normal running.

    Parameters
    ----------
    misfires : Misfires
    found : list of Reading, with all cylinders firing
    worst : dict, from :func:`worst_of`
    orders : float, optional
        Highest order that is listed.

    Returns
    -------
    dict
        ``misfires``: by the cylinder that does not fire what :func:`jaxhb.show.forced.forced_record` gives;
        ``worst_misfires`` by element ``cylinder``, ``rpm``, ``quantity``, ``unit``, ``value`` (half peak-to-peak) and
        ``firing``, the value at this speed with all cylinders firing; ``worst_misfire``, that of the element that
        swings most, with its name as ``of``.
    """
    rows = {
        one.name: {
            "cylinder": worst[one.name].cylinder,
            "rpm": worst[one.name].rpm,
            "quantity": _CALLED[one.kind],
            "unit": one.unit,
            "value": worst[one.name].value,
            "firing": worst[one.name].firing,
        }
        for one in found
    }
    hardest, names = hardest_of(found, worst).name, [one.name for one in found]
    records = {
        cylinder: forced_record(response, readings(response, names), orders=orders)
        for cylinder, response in misfires.responses.items()
    }
    return {"misfires": records, "worst_misfires": rows, "worst_misfire": rows[hardest] | {"of": hardest}}


def misfires_rows(misfires, found, more):
    """Heads and rows of the CSV file: those of normal running, then those of every misfire, named in the first column.

    ``more`` holds further columns of every response, by the cylinder that does not fire, "" for none.
    """
    responses = {"": misfires.firing} | misfires.responses
    names, heads, rows = [one.name for one in found], {}, []
    for cylinder, response in responses.items():
        own, cells = forced_rows(response, readings(response, names), more[cylinder])
        rows += [{"misfire": cylinder} | dict(zip(own, row, strict=True)) for row in cells]
        heads |= dict.fromkeys(["misfire", *own])
    # An order that a response does not have has no column there: its amplitude is 0.
    return list(heads), [[row.get(head, 0.0) for head in heads] for row in rows]
