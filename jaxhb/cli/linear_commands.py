"""Commands of the linear train: compute, print for people, write for programs."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from jaxhb.cli import arguments as cli
from jaxhb.cli.commands import misfire_trains, status
from jaxhb.cli.operating_modes import compare
from jaxhb.elements.sentences import SceneError
from jaxhb.linear.critical import (
    ELASTIC,
    Campbell,
    campbell as campbell_of,
    excited_orders,
    mode_kinds,
    modes_of,
)
from jaxhb.linear.cylinders.tangential import tangential_pressure
from jaxhb.linear.cylinders.vector_sums import vector_sums
from jaxhb.linear.forced import ForcedResponse, forced_response
from jaxhb.linear.heat import heat_balance
from jaxhb.linear.holzer import HolzerTable, holzer_table
from jaxhb.linear.margins import separations
from jaxhb.linear.modal import natural_frequencies
from jaxhb.linear.strength import strength
from jaxhb.linear.tangent import at_mean_load, with_slopes
from jaxhb.report.figures.linear import plot_campbell, plot_holzer, plot_modes
from jaxhb.report.figures.phase_diagrams import plot_vector_sums
from jaxhb.report.figures.speeds import plot_forced
from jaxhb.report.files.compared import of_forced
from jaxhb.report.files.formats import deliver, named
from jaxhb.report.files.numbers import not_firing_record
from jaxhb.report.files.output import ANSWERED, OutputError, Sheet, sheet
from jaxhb.report.orders import order_names
from jaxhb.report.selection import case_title, train_name
from jaxhb.report.text import (
    forced as forced_text,
    linear as linear_text,
)
from jaxhb.report.text.scene_check import (
    ANY_SPEED,
    check_record,
    check_text,
    own_speeds,
    scene_notes,
    table_notes,
    tangential_record,
    tangential_sheet,
    tangential_text,
)
from jaxhb.report.text.sentences import firing_lines, remarks_text
from jaxhb.report.text.strength import strength_text
from jaxhb.train.chain import span
from jaxhb.train.changes import linearised
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import main_speed
from jaxhb.train.varying import at_speed, varying

MOST_OF_CHECK = 500  # disks of which a check has all modes; of more it has the lowest
LOWEST = 20  # modes of these


def check(train: DriveTrain, arguments: cli.CheckOptions) -> int:
    """Tell what a scene comes to: mean torques, tooth forces and damping, modes and
    notes.
    """
    speeds = arguments.rpm or own_speeds(train)
    response = forced_response(train, rpm=speeds or [ANY_SPEED], harmonics=1)
    responses = [
        dataclasses.replace(response[k], train=train) for k in range(len(response))
    ]
    remarks = scene_notes(responses) + table_notes(train)
    parts = check_text(train, responses, speeds, remarks)
    record = check_record(train, responses, remarks)
    at_places = _constant(train, None, arguments.links_at)
    constant, speed_remarks = _at_a_speed(at_places, float(main_speed(train)))
    parts += speed_remarks
    if varying(constant.topology):
        parts.append("Links vary: natural frequencies need --links-at, as hz=30.")
    else:
        disks = train.topology.n_disks
        modes, kinds, ratios = modes_of(
            constant, LOWEST if disks > MOST_OF_CHECK else None
        )
        teeth = linear_text.in_contact(train)
        parts.append(
            linear_text.modes_text(modes, train.topology.name, kinds, ratios, teeth)
        )
        if len(kinds) < disks and disks > MOST_OF_CHECK:
            parts.append(f"These are the {len(kinds)} lowest modes of {disks} disks.")
        record |= {"modes": linear_text.modes_record(modes, kinds, ratios)}
        parts += remarks_text(linear_text.approximations(constant), "Of the modes")
    makers: dict[str, Callable[[], Any]] = {"record": lambda: record}
    if arguments.excitation is None:
        _refuse_without(
            train,
            "--excitation",
            ["--loads"] * bool(arguments.loads)
            + [f"--{name}" for name in named(arguments, "rows")],
        )
    else:
        table = tangential_pressure(
            train,
            arguments.excitation,
            rpm=(speeds or [ANY_SPEED])[-1],
            loads=arguments.loads or None,
        )
        parts.append(tangential_text(table))
        record |= {"excitation": tangential_record(table)}
        makers["rows"] = lambda: tangential_sheet(table)
    text = "\n\n".join([*parts, *remarks_text(remarks)])
    deliver(arguments, text, makers)
    return status(forced_text.forced_failures(response))


def modes(train: DriveTrain, arguments: cli.ShapeOptions) -> int:
    """Natural frequencies of a scene."""
    at_places = _constant(train, arguments.at, arguments.links_at)
    constant, speed_remarks = _at_a_speed(at_places, _speed_of_scene(train))
    teeth = _with_teeth(arguments, None, [constant])
    (train,) = teeth.trains
    modes, kinds, ratios = modes_of(train)
    elastic = [k for k, kind in enumerate(kinds) if kind == ELASTIC]
    if not arguments.vector_sums:
        _refuse_without(
            train, "--vector-sums", [f"--{name}" for name in named(arguments, "rows")]
        )
    if "plot" in arguments.files and not (elastic or arguments.vector_sums):
        raise OutputError(
            "--plot: no mode strains a link, so there is no shape to draw."
        )
    parts: list[str] = [
        *speed_remarks,
        linear_text.modes_text(modes, train.topology.name, kinds, ratios, teeth.title),
    ]
    if len(span(train.topology).loops):
        parts += linear_text.energies_text(modes, kinds)
    margins = separations(train, modes, kinds)
    parts += linear_text.separation_tables(margins, train.topology.operating_rpm)
    record = linear_text.modes_record(modes, kinds, ratios) | teeth.record
    record["notes"] = speed_remarks + record["notes"]
    record |= linear_text.separation_record(margins)
    makers: dict[str, Callable[[], Any]] = {
        "record": lambda: record,
        "figure": lambda: plot_modes(train, modes, elastic, ratios),
    }
    if arguments.vector_sums:
        sums = vector_sums(train, modes=modes, numbers=elastic)
        parts += linear_text.vector_text(sums, modes, order_names(train))
        record |= linear_text.vector_record(sums)
        makers["rows"] = lambda: linear_text.vector_sheet(sums)
        title = f"{train.topology.title}: phase diagrams of the firing"
        makers["figure"] = lambda: plot_vector_sums(sums, title)
    parts += [*teeth.notes, *remarks_text(train.topology.notes)]
    deliver(arguments, "\n\n".join(parts), makers)
    return ANSWERED


def holzer(train: DriveTrain, arguments: cli.HolzerOptions) -> int:
    """Holzer's tables."""
    at_places = _constant(train, arguments.at, arguments.links_at)
    constant, speed_remarks = _at_a_speed(at_places, _speed_of_scene(train))
    teeth = _with_teeth(arguments, None, [constant])
    (train,) = teeth.trains
    name = train.topology.title
    modes = natural_frequencies(train)
    kinds = mode_kinds(modes, train.topology.damper_names)
    natural_hz = {k: float(hz) for k, hz in enumerate(modes.frequencies_hz)}
    tables: list[tuple[int | None, HolzerTable]] = [
        (None, holzer_table(train, hz=hz)) for hz in arguments.hz
    ]
    if not tables:
        chosen = linear_text.chosen_modes(kinds, name, arguments.mode)
        tables = [(k, holzer_table(train, hz=natural_hz[k])) for k in chosen]
    zeros = {k: hz for k, hz in natural_hz.items() if kinds[k] == ELASTIC}
    parts: list[str] = [
        *speed_remarks,
        linear_text.holzer_text(tables, name, teeth.title),
    ]
    parts += [*teeth.notes, *remarks_text(train.topology.notes)]
    makers = {
        "record": lambda: (
            linear_text.holzer_record(tables, name)
            | teeth.record
            | {"notes": speed_remarks + teeth.record["notes"]}
        ),
        "figure": lambda: plot_holzer(train, tables, zeros),
    }
    deliver(arguments, "\n\n".join(parts), makers)
    return ANSWERED


def campbell(train: DriveTrain, arguments: cli.CampbellOptions) -> int:
    """Natural frequencies and orders over the speed."""
    rpm = arguments.rpm
    count = arguments.modes
    trains = misfire_trains(train, arguments, each=True)
    name = train_name(trains[""].topology)
    names = order_names(train)
    lines = firing_lines(*trains.values())
    teeth = _with_teeth(arguments, rpm, list(trains.values()))
    by_cylinder = dict(zip(trains, teeth.trains, strict=True))
    excited = {
        order
        for one_train in teeth.trains
        for order in excited_orders(one_train, rpm=rpm)
    }
    orders = arguments.orders or sorted(excited)
    misfires = {
        cylinder: campbell_of(
            one_train,
            rpm=rpm,
            orders=orders,
            count=count,
            links_at=dict(arguments.links_at),
        )
        for cylinder, one_train in by_cylinder.items()
    }
    diagram = misfires.pop("")
    titles = {cylinder: case_title(trains[cylinder], cylinder) for cylinder in trains}
    responses = _at_critical_speeds(diagram, by_cylinder, arguments.links_at)
    worst = None
    compared = []
    if responses:
        worst = forced_text.hardest_misfire(responses)
        compared = forced_text.critical_misfire_text(responses, worst, titles[""])
    text = linear_text.campbell_text(
        diagram, count, name, misfires, names, teeth.title, lines, compared
    )
    makers = {
        "record": lambda: (
            linear_text.campbell_record(diagram, count, name, misfires, worst)
            | not_firing_record(*trains.values())
            | teeth.record
        ),
        "rows": lambda: Sheet(*linear_text.campbell_rows(diagram, misfires, titles)),
        "figure": lambda: plot_campbell(diagram, count, name, names),
    }
    parts = [text, *teeth.notes, *remarks_text(train.topology.notes)]
    deliver(arguments, "\n\n".join(parts), makers)
    return ANSWERED


def _at_critical_speeds(
    diagram: Campbell, trains: Mapping[str, DriveTrain], links_at: Sequence
) -> dict[str, ForcedResponse]:
    """Linear forced responses at the critical speeds, by the cylinder that does not
    fire; empty without such a case.
    """
    speeds = sorted({critical.rpm for critical in diagram.critical})
    if len(trains) == 1 or not speeds:
        return {}
    return {
        cylinder: heat_balance(_constant(train, None, links_at), rpm=speeds)
        for cylinder, train in trains.items()
    }


def forced(train: DriveTrain, arguments: cli.ForcedOptions) -> int:
    """Linear forced response over the speed, with --misfire each beside it that of
    every cylinder in turn.
    """
    rpm = arguments.rpm
    orders = arguments.orders
    trains = misfire_trains(train, arguments, each=True)
    one_train = [name for name in named(arguments, "dataset") if len(trains) > 1]
    if one_train:
        raise OutputError(
            f"--{one_train[0]}: it holds one train, and --misfire each takes several."
            " Leave one of them out."
        )
    cases = {
        cylinder: heat_balance(one_train, rpm=rpm)
        for cylinder, one_train in trains.items()
    }
    titles = dict.fromkeys(cases, "")
    if len(cases) > 1:
        titles = {
            cylinder: case_title(trains[cylinder], cylinder) for cylinder in cases
        }
    failures = [
        sentence
        for cylinder, response in cases.items()
        for sentence in forced_text.forced_failures(response, titles[cylinder])
    ]
    response = cases[""]
    if not any(case.converged.any() for cylinder, case in cases.items() if cylinder):
        cases = {"": response}  # no misfire has an answer to compare with
    readings = forced_text.readings(response, arguments.element)
    judged = {cylinder: strength(case) for cylinder, case in cases.items()}
    worst = None
    if len(cases) > 1:
        worst = forced_text.worst_of(cases, readings, judged)
    parts = [
        forced_text.forced_text(cases, readings, worst, each=bool(arguments.element))
    ]
    added = []
    if arguments.by_cylinder:
        _refuse_without(train, "--element", ["--by-cylinder"] * (not arguments.element))
        added = forced_text.contributions_of(trains[""], readings)
    parts += [forced_text.contributions_text(*one) for one in added]
    parts += strength_text(
        {
            f"With {titles[cylinder]}" if worst else "": case
            for cylinder, case in judged.items()
        }
    )
    notes = linear_text.approximations(train, rpm, response)
    parts += remarks_text([*train.topology.notes, *notes])
    makers = {
        "record": lambda: (
            not_firing_record(*trains.values())
            | forced_text.forced_record(cases, readings, judged, worst, orders=orders)
            | forced_text.contributions_record(added)
            | {"notes": notes}
        ),
        # An order that a response does not have has no column there: its amplitude is
        # 0.
        "rows": lambda: sheet(
            forced_text.forced_rows(cases, readings, judged), missing=0.0
        ),
        "dataset": lambda: response.to_xarray(orders=orders),
        "figure": lambda: plot_forced(cases, readings, worst),
    }
    deliver(arguments, "\n\n".join(parts), makers)
    compare(arguments, lambda: of_forced(cases, readings, judged))
    return status(failures)


def _refuse_without(train: DriveTrain, option: str, needed: Sequence[str]) -> None:
    """Refuse options that mean nothing without another one."""
    if needed:
        raise SceneError(
            f"{train.topology.title}: {', '.join(needed)} needs {option}. Give it, or"
            f" leave {', '.join(needed)} out."
        )


def _constant(
    train: DriveTrain, at: float | None, links_at: Sequence[tuple[str, float]]
) -> DriveTrain:
    """The train with links as they are at ``--links-at``, and at the speed of
    ``--at``.
    """
    places = ({} if at is None else {"rpm": at}) | dict(links_at)
    return train.with_constant_links(**places) if places else train


def _speed_of_scene(train: DriveTrain) -> float | None:
    """The rated speed in rpm, or else the highest at which the scene gives a torque;
    None of a scene without any.
    """
    return train.topology.rated_rpm or max(own_speeds(train) or [], default=None)


def _at_a_speed(train: DriveTrain, rpm: float | None) -> tuple[DriveTrain, list[str]]:
    """The train with links as they are at a speed, and a sentence on it; as it is, and
    no sentence, if nothing depends on the speed, or there is none.
    """
    if rpm is None or not train.topology.depends_on_speed:
        return train, []
    remark = f"Modes are those at {rpm:g} rpm; --links-at takes another speed."
    return train.with_constant_links(rpm=rpm), [remark]


@dataclass(frozen=True)
class _Teeth:
    """Trains with teeth as ``--at`` says: ``title``, how stiff they are; ``notes`` to
    print below, and their ``record``.
    """

    trains: list[DriveTrain]
    title: str
    notes: list[str]
    record: dict


def _with_teeth(
    arguments: cli.ModesOptions, rpm: Sequence[float] | None, trains: list[DriveTrain]
) -> _Teeth:
    """Trains with teeth in contact, or with the slopes at the mean load of ``--at``;
    ``rpm`` are the speeds of the command, None without any.
    """
    at = arguments.at
    first = trains[0]
    remarks = linear_text.approximations(
        first, rpm if at is None else [at], closed=at is None
    )
    record = {"notes": remarks}
    if at is None:
        title = linear_text.in_contact(first)
        return _Teeth(trains, title, remarks_text(remarks), record)
    held = dict(arguments.links_at).get("rpm")
    if held is not None:
        trains = [at_speed(train, held) for train in trains]
    over_speed = [
        first.topology.mesh_names[i]
        for table, _, i, _ in trains[0].topology.rpm_tables
        if table == "mesh"
    ]
    if over_speed:
        raise SceneError(
            f"{first.topology.title}: mesh {over_speed[0]!r} depends on the speed, and"
            " --at takes the teeth at one mean load. Leave out --at, or give"
            f" --links-at rpm={at:g}."
        )
    load = at_mean_load(_constant(first, at, arguments.links_at), rpm=at)
    # Links that vary go on doing so: only the equilibrium needed them constant.
    linear = [
        dataclasses.replace(
            linearised(with_slopes(train, load)), meshes=load.train.meshes
        )
        for train in trains
    ]
    return _Teeth(
        linear,
        linear_text.in_contact(first) and f"teeth at the mean load of {at:g} rpm",
        [linear_text.mean_load_text(load, at), *remarks_text(remarks)],
        linear_text.mean_load_record(load, at) | record,
    )
