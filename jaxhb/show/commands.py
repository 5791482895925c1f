"""What each command of the command line does: compute, print for people, write for programs."""

import dataclasses
import sys
from pathlib import Path

from ..model.change import locate
from ..model.scene_writer import changed_scene, copies_beside
from ..periodic.checkpoint import CHUNK
from ..response.steady import PERCENT
from .balance import ground_reactions, load_torques
from .cases import cases_record, cases_text, solve_cases
from .choose import asks_each, case_title, gears, shafts_of, without_cylinders
from .compute import Asked, answer_one, answer_speeds
from .misfire_cases import hardest, misfire_trains, misfires_text, worst_misfire
from .output import (
    ANSWERED,
    NOT_ANSWERED,
    OutputError,
    as_csv,
    as_json,
    as_picture,
    as_sweep_json,
    changes,
    deliver,
    make_folders,
    write_files,
)
from .page_command import certified_at, check_page, report_of, second_case
from .progress import Progress
from .record import answer_record, finite
from .strength import answers_strength, strength_columns, strength_record
from .sweep_tables import sweep_text
from .tables import solve_text
from .tuned import progress_record, tuned_record, tuned_text
from .tuned_check import check_designs, check_text
from .words import warnings

INTERRUPTED = 130


def solve_one(train, arguments):
    """One speed."""
    _check_picture(train, arguments)
    train = without_cylinders(train, arguments)
    with Progress() as progress:
        answer = answer_one(train, arguments.rpm, Asked.of(arguments), progress.say)
    deliver(
        arguments,
        solve_text(answer),
        json=lambda: as_json(changes(arguments) | _record(arguments, answer)),
        plot=lambda: _cycle_picture(arguments, answer),
    )
    return _status([answer])


def sweep(train, arguments):
    """Many speeds."""
    _check_picture(train, arguments)
    train, asked = without_cylinders(train, arguments), Asked.of(arguments)
    direction = arguments.direction or "up"
    if asked.orbit and arguments.direction:
        raise OutputError("--direction: periodic solutions (--orbit) do not depend on it. Leave one of them out.")
    if asked.orbit and arguments.folder:
        raise OutputError("--out: a folder keeps steady states, and --orbit asks for none. Leave one of them out.")
    if arguments.chunk and not arguments.folder:
        raise OutputError("--chunk: it says how many speeds are kept together. Add --out DIR, or leave it out.")
    kept = {"out": arguments.folder, "chunk": arguments.chunk or CHUNK}
    with Progress(len(arguments.rpm)) as progress:
        tell = {"progress": progress.advance, "say": progress.say}
        found = answer_speeds(train, arguments.rpm, asked, direction=direction, kept=kept, **tell)
        progress.say("reading the results")
        deliver(
            arguments,
            sweep_text(found),
            json=lambda: _sweep_json(arguments, found),
            csv=lambda: _sweep_table(found),
            plot=lambda: _sweep_picture(arguments, found),
        )
    return _status([answer for answers in found.values() for answer in answers])


def report(train, arguments):
    """Several speeds, normal and misfiring, with backlash and without."""
    _check_picture(train, arguments)
    if arguments.at is not None and arguments.at not in arguments.rpm:
        raise OutputError(f"--at: {arguments.at:g} rpm is not one of the speeds of --rpm. Add it.")
    other = check_page(train, arguments)
    each = asks_each(train, arguments)
    trains = misfire_trains(train) if each else {"": train}
    if arguments.misfire and not each:
        trains[", ".join(arguments.misfire)] = train.misfire(*arguments.misfire)
    trains = {case_title(train, cylinders): one for cylinders, one in trains.items()}
    asked = dataclasses.replace(Asked.of(arguments), certify=False)
    with Progress((len(trains) + bool(other or arguments.tune)) * len(arguments.rpm)) as progress:
        cases = solve_cases(trains, arguments.rpm, asked, say=progress.say, advance=progress.advance)
        place = _place_of(cases[0], arguments.at)
        cases = certified_at(cases, place, progress.say) if arguments.certify else cases
        second, tuning = second_case(train, other, arguments, asked, progress)
    worst, whole = {"worst_misfire": finite(worst_misfire(cases))} if each else {}, []
    deliver(
        arguments,
        misfires_text(cases) if each else cases_text(cases),
        json=lambda: as_json(changes(arguments) | cases_record(cases, orders=arguments.orders) | worst),
        plot=lambda: _cycle_picture(arguments, cases[0].answers[place]),
        html=lambda: _page(report_of(arguments, cases, place, second, tuning), whole),
    )
    status = _status([answer for case in cases for answer in case.answers])
    return status if all(whole) else NOT_ANSWERED


def _page(report, whole):
    """The bytes of the page; whether it is whole goes to the list."""
    from .page import as_page

    content, complete = as_page(report)
    whole.append(complete)
    return content


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
    record = tuned_record(train, asked, result)
    files.write(result.after.parameters, record)
    if arguments.plot:
        from .plots import plot_tuning

        write_files({arguments.plot: as_picture(arguments.plot, plot_tuning(asked["objective"], result))})
    print(tuned_text(train, asked, result))
    if not result.interrupted:  # who stops a tuning does not wait for more
        with Progress() as progress:
            checked = check_designs(train, asked, result, progress.say)
        files.write(result.after.parameters, record | {"steady_state": finite(checked)})
        print(f"\n{check_text(checked)}")
    print(f"\nThe tuned scene is {arguments.output}, all numbers are in {arguments.json}.")
    if result.interrupted:
        return INTERRUPTED
    return ANSWERED if result.after.solved.all() else NOT_ANSWERED


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
        values = {}
        for key, value in {**dict(self.arguments.set), **parameters}.items():
            table, field, row = locate(self.train.topology, key)
            values[table, row, field] = value
        text, _ = changed_scene(self.arguments.scene, values, remark=f"{self.arguments.scene}, tuned by jaxhb tune.")
        made = {self.arguments.output: [text.encode()], self.arguments.json: as_json(changes(self.arguments) | record)}
        write_files({path: [content] for path, content in self.copies.items()} | made)


def _tell(files, progress, step):
    files.note(step)
    progress.advance(1 if step.number else 0)
    progress.say(f"objective {step.objective:.4g} with a smooth maximum of {100 * step.width:g} %")


def _given(arguments, names):
    """Options that were given, by name."""
    return {name: getattr(arguments, name) for name in names if getattr(arguments, name) is not None}


def _cycle_picture(arguments, answer):
    from .plots import plot_cycle

    return as_picture(arguments.plot, plot_cycle(answer, arguments.gear))


def _sweep_picture(arguments, found):
    from .sweep_plots import plot_sweep

    return as_picture(arguments.plot, plot_sweep(found))


def _record(arguments, answer):
    """What is written of one speed, under ``without_backlash`` the same with all teeth in contact."""
    record = answer_record(answer, orders=arguments.orders)
    if any(answer.topology.mesh_backlash):
        record["without_backlash"] = answer_record(answer.without_backlash, orders=arguments.orders)
    return record


def _sweep_json(arguments, found):
    """One list of answers is called responses, two by their directions."""
    lists = {
        way if len(found) > 1 else "responses": (_record(arguments, answer) for answer in answers)
        for way, answers in found.items()
    }
    head = {"rpm": arguments.rpm, "direction": None if "orbit" in found else "both" if len(found) > 1 else [*found][0]}
    judged = {way: finite(strength_record(answers_strength(answers))) for way, answers in found.items()}
    if any(judged.values()):
        head["strength"] = judged if len(found) > 1 else [*judged.values()][0]
    return as_sweep_json(changes(arguments) | head, lists)


def _sweep_table(found):
    rows = [finite(_row(answer, way)) for way, answers in found.items() for answer in answers]
    return as_csv(list(rows[0]), [list(row.values()) for row in rows])


def _place_of(case, rpm):
    """Number of the asked speed, or of that with the largest tooth force, without teeth the largest torque."""
    if rpm is not None:
        return next(i for i, answer in enumerate(case.answers) if answer.rpm == rpm)
    values = [hardest(answer)[2] if answer.answered else -1.0 for answer in case.answers]
    return values.index(max(values))


def _check_picture(train, arguments):
    """Refuse a picture of nothing before anything is computed."""
    if arguments.plot and not train.topology.link_names:
        raise OutputError("--plot: the train has no gears, shafts or dampers, so there is no torque to draw.")
    if getattr(arguments, "gear", None):
        index = train.topology.disk_index(arguments.gear)
        if not any(index in ends for ends in train.topology.mesh_ends):
            known = ", ".join(repr(name) for name in gears(train.topology))
            raise OutputError(f"--gear: {arguments.gear!r} carries no mesh. Gears: {known or 'none'}.")


def _status(answers):
    """The exit status; stderr is told what has no answer, and what to try."""
    for warning in dict.fromkeys(warnings(answers)):
        print(warning, file=sys.stderr)
    return ANSWERED if all(answer.answered for answer in answers) else NOT_ANSWERED


def _row(answer, way):
    """One speed as a row of the CSV file, by its heading."""
    solved, linear = answer.response, answer.linear
    row = {
        "rpm": answer.rpm,
        "direction": way,
        "motion": answer.state.kind,
        "period cycles": answer.state.period,
        "stable": answer.growth.stable,
        "largest multiplier": answer.growth.multiplier,
        "status": None if solved is None else answer.status.name,
        "harmonics": answer.harmonics,
        "residual": None if solved is None else float(solved.residual),
        "truncation error": None if solved is None else float(solved.truncation_error),
        "load kW": float(answer.balance.load_kW),
    }
    row |= {f"{name} load torque N m": torque for name, torque in load_torques(answer.balance).items()}
    row |= {f"{name} ground reaction N m": torque for name, torque in ground_reactions(answer.balance).items()}
    for name in answer.topology.mesh_names:
        row |= _mesh_cells(name, answer.force(name), linear.force(name), answer.contacts[name])
    for gear in gears(answer.topology):
        row[f"{gear} torque half peak-to-peak N m"] = float(answer.gear_torque(gear).half_peak_to_peak)
        without = float(linear.gear_torque(gear).half_peak_to_peak)
        row[f"{gear} torque half peak-to-peak N m without backlash"] = without
    for shaft in shafts_of(answer.topology):
        row[f"{shaft} torque half peak-to-peak N m"] = float(answer.torque(shaft).half_peak_to_peak)
    return row | {head: values[0] for head, values in strength_columns(answers_strength([answer])).items()}


def _mesh_cells(name, force, linear, contact):
    cells = {f"{name} {what} N": float(getattr(force, what)) for what in ("mean", "max", "min")}
    peaks = zip(PERCENT, force.per_cycle.max.tolist(), strict=True)
    cells |= {f"{name} max of a cycle {percent} % N": peak for percent, peak in peaks}
    cells |= {f"{name} {what} N without backlash": float(getattr(linear, what)) for what in ("max", "min")}
    return cells | {
        f"{name} separated fraction": contact.separated_fraction,
        f"{name} reverse fraction": contact.reverse_contact_fraction,
        f"{name} impacts per cycle": contact.impacts_per_cycle,
        f"{name} hardest impact m/s": contact.hardest_impact,
    }
