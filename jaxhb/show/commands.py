"""What each command of the command line does: compute, print for people, write for programs."""

import sys
from pathlib import Path

import numpy as np

from ..linear.modal import natural_frequencies
from ..model.scene_writer import changed_scene, copies_beside
from ..periodic.planning import without_backlash
from ..periodic.solve import linear_response, solve
from ..periodic.speeds import solve_speeds
from .balance import ground_reactions, load_torques
from .cases import cases_record, cases_text, solve_cases
from .output import (
    OutputError,
    as_csv,
    as_json,
    as_picture,
    as_sweep_json,
    make_folders,
    write_files,
)
from .progress import Progress
from .report import contact_at, gears, hardest_impact, modes_record, response_record, shafts_of, status_of
from .tables import modes_text, most_apart, solve_text, sweep_text
from .tuned import progress_record, tuned_record, tuned_text

CONVERGED, NOT_CONVERGED, INTERRUPTED = 0, 1, 130
_CHANGES = {"set": dict, "misfire": list}


def modes(train, arguments):
    """Natural frequencies of a scene."""
    found = natural_frequencies(train)
    _answer(
        arguments,
        modes_text(found, train.topology.name),
        json=lambda: as_json(_changes(arguments) | modes_record(found)),
    )
    return CONVERGED


def solve_one(train, arguments):
    """One speed."""
    _check_picture(train, arguments)
    train = train.misfire(*arguments.misfire)
    with Progress() as progress:
        progress.step(f"solving at {arguments.rpm:g} rpm")
        response = solve(train, rpm=arguments.rpm, harmonics=arguments.harmonics, tolerance=arguments.tolerance)
        linear = linear_response(train, rpm=arguments.rpm) if any(train.topology.mesh_backlash) else response
    _answer(
        arguments,
        solve_text(response, linear),
        json=lambda: as_json(_changes(arguments) | _record(arguments, response, linear)),
        plot=lambda: _cycle_picture(arguments, response, linear),
    )
    _warn([response])
    return CONVERGED if response.converged else NOT_CONVERGED


def sweep(train, arguments):
    """Many speeds."""
    _check_picture(train, arguments)
    train = train.misfire(*arguments.misfire)
    with Progress(len(arguments.rpm)) as progress:
        found, linear = _sweep_both(train, arguments, progress)
        progress.say("reading the results")
        responses = [found[i] for i in range(len(found))]
        _answer(
            arguments,
            sweep_text(found, linear),
            json=lambda: _sweep_json(arguments, responses, linear),
            csv=lambda: _sweep_table(responses, linear),
            plot=lambda: _sweep_picture(arguments, found, linear),
        )
    _warn(responses)
    return CONVERGED if bool(np.all(found.converged)) else NOT_CONVERGED


def _sweep_both(train, arguments, progress):
    """The sweep, and the same with all teeth in contact; one and the same where no mesh has backlash."""
    rpm, accuracy = np.array(arguments.rpm), {"harmonics": arguments.harmonics, "tolerance": arguments.tolerance}
    progress.say("speeds solved")
    found = solve_speeds(train, rpm=rpm, **accuracy, progress=progress.advance)
    if not any(train.topology.mesh_backlash):
        return found, found
    # The program is the one that planned the sweep: nothing is compiled anew.
    return found, solve_speeds(without_backlash(train), rpm=rpm)


def report(train, arguments):
    """Several speeds, normal and misfiring, with backlash and without."""
    _check_picture(train, arguments)
    if arguments.at is not None and arguments.at not in arguments.rpm:
        raise OutputError(f"--at: {arguments.at:g} rpm is not one of the speeds of --rpm. Add it.")
    fires = train.topology.cylinder_fires
    trains = {"all cylinders firing" if fires and all(fires) else "the scene as given": train}
    if arguments.misfire:
        trains[f"{', '.join(arguments.misfire)} not firing"] = train.misfire(*arguments.misfire)
    accuracy = {"harmonics": arguments.harmonics, "tolerance": arguments.tolerance}
    with Progress(len(trains) * len(arguments.rpm)) as progress:
        cases = solve_cases(trains, arguments.rpm, step=progress.step, **accuracy)
    chosen = _picture_of(cases[0], arguments.at)
    _answer(
        arguments,
        cases_text(cases),
        json=lambda: as_json(_changes(arguments) | cases_record(cases, orders=arguments.orders)),
        plot=lambda: _cycle_picture(arguments, cases[0].responses[chosen], cases[0].linear[chosen]),
    )
    every = [response for case in cases for response in case.responses]
    _warn(every)
    return CONVERGED if all(response.converged for response in every) else NOT_CONVERGED


def tune(train, arguments):
    """Change the numbers of a scene so that a response becomes small, as its [tune] table asks."""
    from ..design.table import read_table
    from ..design.tuning import tune as search

    given = _given(arguments, ("rpm", "optimizer", "steps", "starts", "seed", "tolerance"))
    asked = read_table(train, given)
    files = _TunedFiles(arguments, train, asked["rpm"])
    with Progress(asked.get("steps", 0)) as progress:
        progress.say("solving the scene as it is")
        result = search(train, **asked, on_step=lambda step: _tell(files, progress, step))
    files.write(result.after.parameters, tuned_record(train, asked, result))
    if arguments.plot:
        from .plots import plot_tuning

        write_files({arguments.plot: as_picture(arguments.plot, plot_tuning(asked["objective"], result))})
    print(tuned_text(train, asked, result))
    print(f"\nThe tuned scene is {arguments.output}, all numbers are in {arguments.json}.")
    if result.interrupted:
        return INTERRUPTED
    return CONVERGED if result.after.solved.all() else NOT_CONVERGED


class _TunedFiles:
    """The files of a tuning, whole at every moment: what is best so far, and its history."""

    def __init__(self, arguments, train, rpm):
        self.arguments, self.train, self.rpm, self.history = arguments, train, rpm, []
        _, beside = changed_scene(arguments.scene, {})
        self.copies = copies_beside(beside, Path(arguments.output).parent)
        make_folders(self.copies)

    def note(self, step):
        """One step more."""
        self.history.append(step)
        self.write(step.parameters, progress_record(self.train, self.rpm, self.history))

    def write(self, parameters, record):
        """The scene with these parameters, and a record."""
        values, elements = {}, self.train.topology.elements
        for key, value in {**dict(self.arguments.set), **parameters}.items():
            name, _, field = key.rpartition(".")
            values[*elements[name], field] = value
        text, _ = changed_scene(self.arguments.scene, values, remark=f"{self.arguments.scene}, tuned by jaxhb tune.")
        made = {self.arguments.output: [text.encode()], self.arguments.json: as_json(_changes(self.arguments) | record)}
        write_files({path: [content] for path, content in self.copies.items()} | made)


def _tell(files, progress, step):
    files.note(step)
    progress.advance(1 if step.number else 0)
    progress.say(f"objective {step.objective:.4g} with a smooth maximum of {100 * step.width:g} %")


def _changes(arguments):
    """What was changed in the scene, for the files."""
    return {option: made(getattr(arguments, option)) for option, made in _CHANGES.items() if hasattr(arguments, option)}


def _given(arguments, names):
    """Options that were given, by name."""
    return {name: getattr(arguments, name) for name in names if getattr(arguments, name) is not None}


def _answer(arguments, text, **makers):
    """Make all that was asked for, then write it, then print: what fails on the way leaves no file."""
    given = vars(arguments)
    write_files({given[option]: make() for option, make in makers.items() if given.get(option)})
    print(text)


def _cycle_picture(arguments, response, linear):
    from .plots import plot_cycle

    return as_picture(arguments.plot, plot_cycle(response, linear, arguments.gear))


def _sweep_picture(arguments, found, linear):
    from .plots import plot_sweep

    return as_picture(arguments.plot, plot_sweep(found, linear))


def _record(arguments, response, linear):
    """What is written of one speed, under ``without_backlash`` the same with all teeth in contact."""
    record = response_record(response, orders=arguments.orders)
    if any(response.topology.mesh_backlash):
        record["without_backlash"] = response_record(linear, orders=arguments.orders)
    return record


def _sweep_json(arguments, responses, linear):
    records = (
        _record(arguments, response, linear[i]) | {"harmonics": int(response.highest_harmonic)}
        for i, response in enumerate(responses)
    )
    return as_sweep_json(_changes(arguments) | {"rpm": arguments.rpm}, records)


def _sweep_table(responses, linear):
    rows = [_row(response, linear[i]) for i, response in enumerate(responses)]
    return as_csv(list(rows[0]), [list(row.values()) for row in rows])


def _picture_of(case, rpm):
    """Number of the speed to draw: the asked one, or that at which teeth are apart longest."""
    if rpm is not None:
        return [float(response.rpm) for response in case.responses].index(rpm)
    return max(range(len(case.responses)), key=lambda i: _longest_apart(case.responses[i]))


def _longest_apart(response):
    contacts = {name: contact_at(response, name) for name in response.topology.mesh_names}
    name = most_apart(contacts)
    return contacts[name].separated_fraction if name else 0.0


def _check_picture(train, arguments):
    """Refuse a picture of nothing before anything is computed."""
    if arguments.plot and not train.topology.link_names:
        raise OutputError("--plot: the train has no gears, shafts or dampers, so there is no torque to draw.")
    if getattr(arguments, "gear", None):
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
        "harmonics": int(response.highest_harmonic),
        "residual": float(response.residual),
        "truncation error": float(response.truncation_error),
        "load kW": float(response.load_kW),
    }
    row |= {f"{name} load torque N m": torque for name, torque in load_torques(response).items()}
    row |= {f"{name} ground reaction N m": torque for name, torque in ground_reactions(response).items()}
    for name in response.topology.mesh_names:
        force, contact = response.force(name), contact_at(response, name)
        row |= {f"{name} {what} N": float(getattr(force, what)) for what in ("mean", "max", "min")}
        row |= {
            f"{name} {what} N without backlash": float(getattr(linear.force(name), what)) for what in ("max", "min")
        }
        row[f"{name} separated fraction"] = None if contact is None else contact.separated_fraction
        row[f"{name} reverse fraction"] = None if contact is None else contact.reverse_contact_fraction
        row[f"{name} impacts"] = None if contact is None else len(contact.impacts)
        row[f"{name} hardest impact m/s"] = None if contact is None else hardest_impact(contact)
    for gear in gears(response):
        row[f"{gear} torque half peak-to-peak N m"] = float(response.gear_torque(gear).half_peak_to_peak)
        without = float(linear.gear_torque(gear).half_peak_to_peak)
        row[f"{gear} torque half peak-to-peak N m without backlash"] = without
    for shaft in shafts_of(response.topology):
        row[f"{shaft} torque half peak-to-peak N m"] = float(response.torque(shaft).half_peak_to_peak)
    return row
