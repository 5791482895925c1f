"""What the commands of the linear train do: compute, print for people, write for programs."""

import dataclasses
import sys

import numpy as np

from jaxhb.linear.critical import ELASTIC, campbell as campbell_of, excited_orders, mode_kinds
from jaxhb.linear.damped import DAMPED_DISKS, damping_ratios
from jaxhb.linear.forced import forced_response
from jaxhb.linear.holzer import holzer_residual, holzer_table
from jaxhb.linear.modal import natural_frequencies
from jaxhb.linear.strength import strength
from jaxhb.linear.tangent import at_mean_load
from jaxhb.report.answer import shown
from jaxhb.report.files.labelled import check_labelled, forced_netcdf
from jaxhb.report.files.output import ANSWERED, NOT_ANSWERED, OutputError, as_csv, as_json, as_picture, changes, deliver
from jaxhb.report.files.record import finite
from jaxhb.report.selection import asks_each, case_title, misfire_trains, without_cylinders
from jaxhb.report.text.forced import (
    forced_failures,
    forced_head,
    forced_record,
    forced_rows,
    forced_text,
    misfires_record,
    misfires_rows,
    misfires_text,
    readings,
    worst_of,
)
from jaxhb.report.text.linear import (
    campbell_record,
    campbell_rows,
    campbell_text,
    chosen_modes,
    energies_text,
    holzer_record,
    holzer_text,
    mean_load_record,
    mean_load_text,
    modes_record,
    modes_text,
)
from jaxhb.report.text.scene_check import ANY_SPEED, check_record, check_text, own_speeds, scene_notes, tune_notes
from jaxhb.report.text.strength import strength_columns, strength_record, strength_text
from jaxhb.report.text.tables import remarks_text
from jaxhb.solutions.misfires import misfire_each
from jaxhb.train.chain import span
from jaxhb.train.changes import without_backlash
from jaxhb.train.varying import varying


def modes(train, arguments):
    """Natural frequencies of a scene."""
    name = train.topology.name
    train, teeth, below, more = _with_teeth(_constant(train, arguments), arguments)
    found, kinds, ratios = _modes_of(train)
    energies = energies_text(found, kinds) if len(span(train.topology).loops) else []
    deliver(
        arguments,
        "\n\n".join([modes_text(found, name, kinds, ratios, teeth), *energies, *below]),
        json=lambda: as_json(finite(changes(arguments) | modes_record(found, kinds, ratios) | more)),
        plot=lambda: as_picture(arguments.plot, _modes_picture(train, found, kinds, ratios)),
    )
    return ANSWERED


def _constant(train, arguments):
    """The train with links as they are at ``--links-at``, and at the speed of ``--at``."""
    at = getattr(arguments, "at", None)
    given = ({} if at is None else {"rpm": at}) | dict(arguments.links_at)
    return train.with_constant_links(**given) if given else train


def _with_teeth(train, arguments):
    """The train with teeth as ``--at`` asks, how stiff they are, a sentence on them in a list, and a record."""
    rpm = arguments.at
    if rpm is None:
        return train, _in_contact(train), [], {}
    load = at_mean_load(_constant(train, arguments), rpm=rpm)
    # Links that vary go on doing so: only the equilibrium needed them constant.
    train = dataclasses.replace(without_backlash(train), meshes=load.train.meshes)
    return train, f"teeth at the mean load of {rpm:g} rpm", [mean_load_text(load, rpm)], mean_load_record(load, rpm)


def _modes_picture(train, found, kinds, ratios):
    from jaxhb.report.figures.modes import plot_modes

    elastic = [k for k, kind in enumerate(kinds) if kind == ELASTIC]
    if not elastic:
        raise OutputError("--plot: no mode strains a link, so there is no shape to draw.")
    return plot_modes(train, found, elastic, ratios)


def check(train, arguments):
    """What a scene comes to: mean torques, tooth forces and damping, modes and notes."""
    speeds = arguments.rpm or own_speeds(train)
    response = forced_response(train, rpm=speeds or [ANY_SPEED], harmonics=1)
    responses = [dataclasses.replace(response[k], train=train) for k in range(len(response))]
    remarks = scene_notes(responses) + tune_notes(train)
    parts, record = check_text(train, responses, speeds, remarks), check_record(train, responses, remarks)
    constant = _constant(train, arguments)
    if varying(constant.topology):
        parts.append("Links vary: natural frequencies need --links-at, as hz=30.")
    else:
        found, kinds, ratios = _modes_of(constant)
        parts.append(modes_text(found, train.topology.name, kinds, ratios, _in_contact(train)))
        record |= {"modes": modes_record(found, kinds, ratios)}
    deliver(
        arguments,
        "\n\n".join([*parts, *remarks_text(remarks)]),
        json=lambda: as_json(finite(changes(arguments) | record)),
    )
    return _forced_status(forced_failures(response))


def _modes_of(train):
    """Natural frequencies, the kind of every mode and its damping ratio."""
    found = natural_frequencies(train)
    kinds = mode_kinds(found, train.topology.damper_names)
    few = train.topology.n_disks <= DAMPED_DISKS
    return found, kinds, damping_ratios(train, found) if few else np.full(len(kinds), np.nan)


def _in_contact(train):
    return "teeth in contact" if train.topology.mesh_names else ""


def holzer(train, arguments):
    """Holzer's tables."""
    name = train.topology.name or "scene"
    train, teeth, below, more = _with_teeth(_constant(train, arguments), arguments)
    found = natural_frequencies(train)
    kinds = mode_kinds(found, train.topology.damper_names)
    at = [(None, hz) for hz in arguments.hz or ()]
    at = at or [(k, float(found.frequencies_hz[k])) for k in chosen_modes(kinds, name, arguments.mode)]
    tables = [(mode, holzer_table(train, hz=hz)) for mode, hz in at]
    natural = {k: hz for k, hz in enumerate(found.frequencies_hz) if kinds[k] == ELASTIC}

    def picture():
        from jaxhb.report.figures.linear import plot_holzer

        return plot_holzer(lambda hz: holzer_residual(train, hz=hz), tables, natural, name)

    deliver(
        arguments,
        "\n\n".join([holzer_text(tables, name, teeth), *below]),
        json=lambda: as_json(finite(changes(arguments) | holzer_record(tables, name) | more)),
        plot=lambda: as_picture(arguments.plot, picture()),
    )
    return ANSWERED


def campbell(train, arguments):
    """Natural frequencies over the speed, orders and critical speeds."""
    name, count = train.topology.name or "scene", arguments.modes
    each = asks_each(train, arguments)
    train, teeth, below, more = _with_teeth(train if each else without_cylinders(train, arguments), arguments)
    trains = misfire_trains(train) if each else {"": train}
    orders = arguments.orders or {order for one in trains.values() for order in excited_orders(one, rpm=arguments.rpm)}
    asked = {"rpm": arguments.rpm, "orders": orders, "count": count, "links_at": dict(arguments.links_at)}
    diagrams = {cylinder: campbell_of(one, **asked) for cylinder, one in trains.items()}
    found, misfires = diagrams.pop(""), diagrams

    def picture():
        from jaxhb.report.figures.linear import plot_campbell

        return plot_campbell(found, count, name)

    deliver(
        arguments,
        "\n\n".join([campbell_text(found, count, name, misfires, teeth=teeth), *below]),
        json=lambda: as_json(finite(changes(arguments) | campbell_record(found, count, name, misfires) | more)),
        csv=lambda: as_csv(*campbell_rows(found, misfires)),
        plot=lambda: as_picture(arguments.plot, picture()),
    )
    return ANSWERED


def forced(train, arguments):
    """Linear forced response over the speed."""
    check_labelled(arguments)
    if asks_each(train, arguments):
        if arguments.netcdf:
            raise OutputError("--netcdf: it holds one train, and --misfire each takes several. Leave one of them out.")
        return _forced_misfires(train, arguments)
    return _forced_alone(forced_response(without_cylinders(train, arguments), rpm=arguments.rpm), arguments)


def _forced_alone(response, arguments):
    """One train."""
    found, judged = readings(response, arguments.element), strength(shown(response))
    more = {"strength": strength_record(judged)} if judged else {}
    deliver(
        arguments,
        "\n\n".join([forced_text(response, found, each=bool(arguments.element)), *strength_text({"": judged})]),
        json=lambda: as_json(
            finite(changes(arguments) | forced_record(response, found, orders=arguments.orders) | more)
        ),
        csv=lambda: as_csv(*map(finite, forced_rows(response, found, strength_columns(judged)))),
        netcdf=lambda: forced_netcdf(response, arguments.orders),
        plot=lambda: _forced_picture(arguments, response, found),
    )
    return _forced_status(forced_failures(response))


def _forced_misfires(train, arguments):
    """The same with every cylinder in turn not firing beside normal running."""
    misfires = misfire_each(train, rpm=arguments.rpm, solve=forced_response)
    response, found = misfires.firing, readings(misfires.firing, arguments.element)
    responses = {"": response} | misfires.responses
    failures = [s for name, one in responses.items() for s in forced_failures(one, case_title(train, name))]
    if not any(one.converged.any() for one in misfires.responses.values()):
        _forced_alone(response, arguments)
        return _forced_status([s for s in failures if s not in forced_failures(response, case_title(train))])
    worst = worst_of(misfires, found)
    judged = {cylinder: strength(shown(one)) for cylinder, one in responses.items()}
    titled = {f"With {case_title(train, cylinder)}": one for cylinder, one in judged.items()}
    orders = arguments.orders

    def record():
        own = {"strength": strength_record(judged[""])} if judged[""] else {}
        more = misfires_record(misfires, found, worst, orders=orders)
        for cylinder, one in more["misfires"].items():
            one |= {"strength": strength_record(judged[cylinder])} if judged[cylinder] else {}
        return finite(changes(arguments) | forced_record(response, found, orders=orders) | own | more)

    columns = {cylinder: strength_columns(one) for cylinder, one in judged.items()}
    text = misfires_text(misfires, found, worst, each=bool(arguments.element))
    deliver(
        arguments,
        "\n\n".join([forced_head(response), text, *strength_text(titled)]),
        json=lambda: as_json(record()),
        csv=lambda: as_csv(*map(finite, misfires_rows(misfires, found, columns))),
        plot=lambda: _forced_picture(arguments, response, found, misfires, worst),
    )
    return _forced_status(failures)


def _forced_status(failures):
    """The exit status; stderr is told what has no answer."""
    for sentence in failures:
        print(sentence, file=sys.stderr)
    return NOT_ANSWERED if failures else ANSWERED


def _forced_picture(arguments, response, found, misfires=None, worst=None):
    from jaxhb.report.figures.forced import plot_forced

    return as_picture(arguments.plot, plot_forced(response, found, misfires, worst))
