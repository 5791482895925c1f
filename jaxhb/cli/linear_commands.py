"""Commands of the linear train: compute, print for people, write for programs."""

import dataclasses

from jaxhb.cli.commands import misfire_trains, status
from jaxhb.cli.operating_modes import tell
from jaxhb.linear.critical import (
    ELASTIC,
    campbell as campbell_of,
    excited_orders,
    mode_kinds,
    modes_of,
)
from jaxhb.linear.forced import forced_response
from jaxhb.linear.holzer import holzer_table
from jaxhb.linear.modal import natural_frequencies
from jaxhb.linear.strength import strength
from jaxhb.linear.tangent import at_mean_load, with_slopes
from jaxhb.report.figures.linear import plot_campbell, plot_holzer, plot_modes
from jaxhb.report.figures.speeds import plot_forced
from jaxhb.report.files.compared import of_forced
from jaxhb.report.files.numbers import not_firing_record
from jaxhb.report.files.output import ANSWERED, OutputError, as_csv, deliver, rows_csv
from jaxhb.report.orders import order_names
from jaxhb.report.selection import case_title, train_name
from jaxhb.report.text import forced as told, linear as linear_text
from jaxhb.report.text.scene_check import (
    ANY_SPEED,
    check_record,
    check_text,
    own_speeds,
    scene_notes,
    table_notes,
)
from jaxhb.report.text.sentences import firing_lines, remarks_text
from jaxhb.report.text.strength import strength_text
from jaxhb.results.dataset import as_netcdf
from jaxhb.train.chain import span
from jaxhb.train.changes import linearised
from jaxhb.train.varying import varying

MOST_OF_CHECK = 500  # disks of which a check has all modes; of more it has the lowest
LOWEST = 20  # modes of these


def check(train, given, rpm, links_at, **_):
    """What a scene comes to: mean torques, tooth forces and damping, modes and
    notes.
    """
    speeds = rpm or own_speeds(train)
    response = forced_response(train, rpm=speeds or [ANY_SPEED], harmonics=1)
    responses = [
        dataclasses.replace(response[k], train=train) for k in range(len(response))
    ]
    remarks = scene_notes(responses) + table_notes(train)
    parts = check_text(train, responses, speeds, remarks)
    record = check_record(train, responses, remarks)
    constant = _constant(train, None, links_at)
    if varying(constant.topology):
        parts.append("Links vary: natural frequencies need --links-at, as hz=30.")
    else:
        many = train.topology.n_disks > MOST_OF_CHECK
        found, kinds, ratios = modes_of(constant, LOWEST if many else None)
        parts.append(
            linear_text.modes_text(
                found, train.topology.name, kinds, ratios, linear_text.in_contact(train)
            )
        )
        if len(kinds) < train.topology.n_disks and many:
            parts.append(
                f"These are the {len(kinds)} lowest modes of {train.topology.n_disks}"
                " disks."
            )
        record |= {"modes": linear_text.modes_record(found, kinds, ratios)}
        parts += remarks_text(linear_text.approximations(constant), "Of the modes")
    deliver(given, "\n\n".join([*parts, *remarks_text(remarks)]), json=lambda: record)
    return status(told.forced_failures(response))


def modes(train, given, at, links_at, plot, **_):
    """Natural frequencies of a scene."""
    (train,), teeth, below, more = _with_teeth(
        at, links_at, None, _constant(train, at, links_at)
    )
    found, kinds, ratios = modes_of(train)
    elastic = [k for k, kind in enumerate(kinds) if kind == ELASTIC]
    if plot and not elastic:
        raise OutputError(
            "--plot: no mode strains a link, so there is no shape to draw."
        )
    energies = (
        linear_text.energies_text(found, kinds)
        if len(span(train.topology).loops)
        else []
    )
    deliver(
        given,
        "\n\n".join(
            [
                linear_text.modes_text(
                    found, train.topology.name, kinds, ratios, teeth
                ),
                *energies,
                *below,
                *remarks_text(train.topology.notes),
            ]
        ),
        json=lambda: linear_text.modes_record(found, kinds, ratios) | more,
        plot=lambda: plot_modes(train, found, elastic, ratios),
    )
    return ANSWERED


def holzer(train, given, at, links_at, hz, mode, plot, **_):
    """Holzer's tables."""
    (train,), teeth, below, more = _with_teeth(
        at, links_at, None, _constant(train, at, links_at)
    )
    name, found = train.topology.title, natural_frequencies(train)
    kinds = mode_kinds(found, train.topology.damper_names)
    natural = {k: float(frequency) for k, frequency in enumerate(found.frequencies_hz)}
    asked = [(None, one) for one in hz] or [
        (k, natural[k]) for k in linear_text.chosen_modes(kinds, name, mode)
    ]
    tables = [(k, holzer_table(train, hz=one)) for k, one in asked]
    zeros = {k: one for k, one in natural.items() if kinds[k] == ELASTIC}
    deliver(
        given,
        "\n\n".join(
            [
                linear_text.holzer_text(tables, name, teeth),
                *below,
                *remarks_text(train.topology.notes),
            ]
        ),
        json=lambda: linear_text.holzer_record(tables, name) | more,
        plot=lambda: plot_holzer(train, tables, zeros),
    )
    return ANSWERED


def campbell(train, given, rpm, at, links_at, orders, modes, plot, **_):
    """Natural frequencies and orders over the speed."""
    trains = misfire_trains(train, given, each=True)
    name, lines = train_name(trains[""].topology), firing_lines(*trains.values())
    every, teeth, below, more = _with_teeth(at, links_at, rpm, *trains.values())
    orders = orders or {
        order for one in every for order in excited_orders(one, rpm=rpm)
    }
    asked = {"rpm": rpm, "orders": orders, "count": modes, "links_at": dict(links_at)}
    misfires = {
        cylinder: campbell_of(one, **asked)
        for cylinder, one in zip(trains, every, strict=True)
    }
    found, names = misfires.pop(""), order_names(train)
    titles = {cylinder: case_title(trains[cylinder], cylinder) for cylinder in trains}
    responses = _at_critical_speeds(
        found, dict(zip(trains, every, strict=True)), links_at
    )
    worst = told.hardest_misfire(responses) if responses else None
    compared = (
        told.critical_misfire_text(responses, worst, titles[""]) if responses else []
    )
    deliver(
        given,
        "\n\n".join(
            [
                linear_text.campbell_text(
                    found, modes, name, misfires, names, teeth, lines, compared
                ),
                *below,
                *remarks_text(train.topology.notes),
            ]
        ),
        json=lambda: (
            linear_text.campbell_record(found, modes, name, misfires, worst)
            | not_firing_record(*trains.values())
            | more
        ),
        csv=lambda: as_csv(*linear_text.campbell_rows(found, misfires, titles)),
        plot=lambda: plot_campbell(found, modes, name, names),
    )
    return ANSWERED


def _at_critical_speeds(found, trains, links_at):
    """Linear forced responses at the critical speeds, by the cylinder that does not
    fire; empty without such a case.
    """
    speeds = sorted({c.rpm for c in found.critical})
    if len(trains) == 1 or not speeds:
        return {}
    constant = {
        cylinder: _constant(train, None, links_at) for cylinder, train in trains.items()
    }
    return {
        cylinder: forced_response(train, rpm=speeds)
        for cylinder, train in constant.items()
    }


def forced(train, given, rpm, element, orders, netcdf, plot, **_):
    """Linear forced response over the speed, with --misfire each beside it that of
    every cylinder in turn.
    """
    trains = misfire_trains(train, given, each=True)
    if len(trains) > 1 and netcdf:
        raise OutputError(
            "--netcdf: it holds one train, and --misfire each takes several. Leave one"
            " of them out."
        )
    cases = {name: forced_response(one, rpm=rpm) for name, one in trains.items()}
    titles = {
        name: case_title(trains[name], name) if len(cases) > 1 else "" for name in cases
    }
    failures = [
        sentence
        for name, one in cases.items()
        for sentence in told.forced_failures(one, titles[name])
    ]
    response = cases[""]
    if not any(one.converged.any() for name, one in cases.items() if name):
        cases = {"": response}  # no misfire has an answer to compare with
    found, judged = (
        told.readings(response, element),
        {name: strength(one) for name, one in cases.items()},
    )
    worst = told.worst_of(cases, found, judged) if len(cases) > 1 else None
    parts = [told.forced_text(cases, found, worst, each=bool(element))]
    parts += strength_text(
        {f"With {titles[name]}" if worst else "": one for name, one in judged.items()}
    )
    notes = linear_text.approximations(train, rpm, response)
    parts += remarks_text([*train.topology.notes, *notes])
    deliver(
        given,
        "\n\n".join(parts),
        json=lambda: (
            not_firing_record(*trains.values())
            | told.forced_record(cases, found, judged, worst, orders=orders)
            | {"notes": notes}
        ),
        # An order that a response does not have has no column there: its amplitude is
        # 0.
        csv=lambda: rows_csv(told.forced_rows(cases, found, judged), missing=0.0),
        netcdf=lambda: [as_netcdf(response.to_xarray(orders=orders))],
        plot=lambda: plot_forced(cases, found, worst),
    )
    tell(given, lambda: of_forced(cases, found, judged))
    return status(failures)


def _constant(train, at, links_at):
    """The train with links as they are at ``--links-at``, and at the speed of
    ``--at``.
    """
    given = ({} if at is None else {"rpm": at}) | dict(links_at)
    return train.with_constant_links(**given) if given else train


def _with_teeth(at, links_at, rpm, *trains):
    """Trains with teeth as ``--at`` asks, those of the first: how stiff they are, lines
    and notes to print below, a record; ``rpm`` are the speeds asked for, None without
    any.
    """
    first = trains[0]
    notes = linear_text.approximations(
        first, rpm if at is None else [at], closed=at is None
    )
    record = {"notes": notes}
    if at is None:
        return trains, linear_text.in_contact(first), remarks_text(notes), record
    load = at_mean_load(_constant(first, at, links_at), rpm=at)
    # Links that vary go on doing so: only the equilibrium needed them constant.
    made = [
        dataclasses.replace(
            linearised(with_slopes(one, load)), meshes=load.train.meshes
        )
        for one in trains
    ]
    told = [linear_text.mean_load_text(load, at), *remarks_text(notes)]
    return (
        made,
        f"teeth at the mean load of {at:g} rpm",
        told,
        linear_text.mean_load_record(load, at) | record,
    )
