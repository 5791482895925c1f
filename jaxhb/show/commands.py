"""What each command of the command line does: read the scene, compute, print for people, write for programs."""

import sys

import numpy as np

from ..linear.modal import natural_frequencies
from ..model.scene import load_scene, scene_description, scene_names
from ..periodic.harmonics import without_backlash
from ..periodic.solve import linear_response, solve
from ..periodic.speeds import solve_speeds
from .cases import cases_record, cases_text, solve_cases
from .output import OutputError, check_output, check_picture, write_csv, write_figure, write_json, write_sweep_json
from .progress import Progress
from .report import contact_at, gears, hardest_impact, modes_record, response_record, status_of
from .tables import modes_text, most_apart, solve_text, sweep_text

CONVERGED, NOT_CONVERGED = 0, 1


def scenes():
    """List the packaged scenes."""
    names = scene_names()
    width = max(map(len, names))
    for name in names:
        print(f"{name.ljust(width)}  {scene_description(name)}")
    return CONVERGED


def modes(arguments):
    """Natural frequencies of a scene."""
    _check_files(arguments)
    train = _train(arguments)
    found = natural_frequencies(train)
    if arguments.json:
        write_json(arguments.json, modes_record(found))
    print(modes_text(found, train.topology.name))
    return CONVERGED


def solve_one(arguments):
    """One speed."""
    _check_files(arguments)
    train = _train(arguments)
    _check_gear(train, arguments)
    train = train.misfire(*arguments.misfire)
    with Progress() as progress:
        progress.step(f"solving at {arguments.rpm:g} rpm")
        response = solve(train, rpm=arguments.rpm, harmonics=arguments.harmonics, tolerance=arguments.tolerance)
        linear = linear_response(train, rpm=arguments.rpm)
    if arguments.json:
        write_json(arguments.json, response_record(response, orders=arguments.orders))
    if arguments.plot:
        from .plots import plot_cycle

        write_figure(arguments.plot, plot_cycle(response, linear, arguments.gear))
    print(solve_text(response, linear))
    _warn([response])
    return CONVERGED if response.converged else NOT_CONVERGED


def sweep(arguments):
    """Many speeds."""
    _check_files(arguments)
    train = _train(arguments)
    train = train.misfire(*arguments.misfire)
    rpm = np.array(arguments.rpm)
    with Progress() as progress:
        progress.step(f"solving at {len(rpm)} speeds")
        found = solve_speeds(train, rpm=rpm, harmonics=arguments.harmonics, tolerance=arguments.tolerance)
        linear = solve_speeds(without_backlash(train), rpm=rpm)
        progress.step("reading the results")
        responses = [found[i] for i in range(len(rpm))]
        if arguments.json:
            records = (response_record(response, orders=arguments.orders) for response in responses)
            write_sweep_json(arguments.json, arguments.rpm, records)
        if arguments.csv:
            before = [linear[i] for i in range(len(rpm))]
            rows = [_row(response, other) for response, other in zip(responses, before, strict=True)]
            write_csv(arguments.csv, list(rows[0]), [list(row.values()) for row in rows])
        if arguments.plot:
            from .plots import plot_sweep

            write_figure(arguments.plot, plot_sweep(found, linear))
    print(sweep_text(found, linear))
    _warn(responses)
    return CONVERGED if bool(np.all(found.converged)) else NOT_CONVERGED


def report(arguments):
    """Several speeds, normal and misfiring, with backlash and without."""
    _check_files(arguments)
    train = _train(arguments)
    _check_gear(train, arguments)
    if arguments.at is not None and arguments.at not in arguments.rpm:
        raise OutputError(f"--at: {arguments.at:g} rpm is none of the speeds of --rpm. Add it there.")
    trains = {"all cylinders firing" if train.topology.cylinder_names else "the scene as given": train}
    if arguments.misfire:
        trains[f"{', '.join(arguments.misfire)} not firing"] = train.misfire(*arguments.misfire)
    accuracy = {"harmonics": arguments.harmonics, "tolerance": arguments.tolerance}
    with Progress(len(trains) * len(arguments.rpm)) as progress:
        cases = solve_cases(trains, arguments.rpm, step=progress.step, **accuracy)
    if arguments.json:
        write_json(arguments.json, cases_record(cases, orders=arguments.orders))
    if arguments.plot:
        from .plots import plot_cycle

        chosen = _picture_of(cases[0], arguments.at)
        write_figure(arguments.plot, plot_cycle(cases[0].responses[chosen], cases[0].linear[chosen], arguments.gear))
    print(cases_text(cases))
    every = [response for case in cases for response in case.responses]
    _warn(every)
    return CONVERGED if all(response.converged for response in every) else NOT_CONVERGED


def _picture_of(case, rpm):
    """Number of the speed to draw: the asked one, or that at which teeth are apart longest."""
    if rpm is not None:
        return [float(response.rpm) for response in case.responses].index(rpm)
    return max(range(len(case.responses)), key=lambda i: _longest_apart(case.responses[i]))


def _longest_apart(response):
    contacts = {name: contact_at(response, name) for name in response.topology.mesh_names}
    name = most_apart(contacts)
    return contacts[name].separated_fraction if name else 0.0


def _train(arguments):
    train = load_scene(arguments.scene)
    return train.replace(dict(arguments.set)) if arguments.set else train


def _check_files(arguments):
    """Refuse what cannot be written before anything is computed."""
    given = vars(arguments)
    files = {option: given[option] for option in ("json", "csv", "plot") if given.get(option)}
    for option, name in files.items():
        (check_picture if option == "plot" else check_output)(f"--{option}", name)
    if len(set(files.values())) < len(files):
        raise OutputError(f"--{' and --'.join(files)} name the same file. Give each its own.")


def _check_gear(train, arguments):
    if arguments.gear:
        index = train.topology.disk_index(arguments.gear)
        if not any(index in ends for ends in train.topology.mesh_ends):
            known = ", ".join(repr(name) for name in gears(train))
            raise OutputError(f"--gear: {arguments.gear!r} carries no mesh. Gears: {known or 'none'}.")


def _warn(responses):
    """Say on stderr what did not converge, and what to try."""
    for response in responses:
        if not response.converged:
            status = status_of(response)
            print(f"{float(response.rpm):g} rpm: {status.name}, {status.sentence}.", file=sys.stderr)


def _row(response, linear):
    """One speed as a row of the CSV file, by its heading."""
    row = {
        "rpm": float(response.rpm),
        "status": status_of(response).name,
        "harmonics": int(response.harmonics),
        "residual": float(response.residual),
        "truncation error": float(response.truncation_error),
        "load kW": float(response.load_kW),
    }
    for name in response.topology.mesh_names:
        force, contact = response.force(name), contact_at(response, name)
        row |= {f"{name} {what} N": float(getattr(force, what)) for what in ("mean", "max", "min")}
        row[f"{name} max N without backlash"] = float(linear.force(name).max)
        row[f"{name} separated fraction"] = None if contact is None else contact.separated_fraction
        row[f"{name} reverse fraction"] = None if contact is None else contact.reverse_contact_fraction
        row[f"{name} impacts"] = None if contact is None else len(contact.impacts)
        row[f"{name} hardest impact m/s"] = None if contact is None else hardest_impact(contact)
    for gear in gears(response):
        row[f"{gear} torque half peak-to-peak N m"] = float(response.gear_torque(gear).half_peak_to_peak)
        without = float(linear.gear_torque(gear).half_peak_to_peak)
        row[f"{gear} torque half peak-to-peak N m without backlash"] = without
    for shaft in response.topology.shaft_names + response.topology.damper_names:
        row[f"{shaft} torque half peak-to-peak N m"] = float(response.torque(shaft).half_peak_to_peak)
    return row
