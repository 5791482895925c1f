"""What each command of the command line does: compute, print for people, write for programs."""

import dataclasses
import sys
from functools import partial
from pathlib import Path

from jaxhb.cli.page_command import certified_at, check_page, report_of, second_cases, second_text
from jaxhb.cli.progress import Progress
from jaxhb.cli.resume import GOES_ON, Kept
from jaxhb.report.compute import Asked, answer_one, check_designs, solve_cases
from jaxhb.report.files.labelled import check_labelled, netcdf
from jaxhb.report.files.output import (
    ANSWERED,
    INTERRUPTED,
    NOT_ANSWERED,
    OutputError,
    as_json,
    as_picture,
    changes,
    deliver,
    make_folders,
    write_files,
)
from jaxhb.report.files.record import both_record, finite, on_scene
from jaxhb.report.files.rows import answer_row, rows_csv, trace_csv, untraceable
from jaxhb.report.page.parts import shown_misfire
from jaxhb.report.selection import asks_each, case_title, gears, misfire_trains, without_cylinders
from jaxhb.report.text.cases import cases_record, cases_text, hardest, misfires_text, worst_misfire
from jaxhb.report.text.sentences import warnings
from jaxhb.report.text.tables import solve_text
from jaxhb.report.text.tuned import check_text, progress_record, start_record, tuned_record, tuned_text
from jaxhb.scene.writer import changed_scene, copies_beside
from jaxhb.train.changes import locate, scene_values


def solve(train, arguments):
    """One speed."""
    check_picture(train, arguments)
    check_labelled(arguments)
    train = without_cylinders(train, arguments)
    with Progress(quiet=arguments.quiet) as progress:
        answer = answer_one(train, arguments.rpm, Asked.of(arguments), progress.say)
    why = untraceable(answer) if arguments.trace else ""
    arguments.trace = None if why else arguments.trace
    deliver(
        arguments,
        solve_text(answer),
        json=lambda: as_json(changes(arguments) | on_scene(train) | both_record(answer, arguments.orders)),
        csv=lambda: rows_csv([answer_row(answer)]),
        netcdf=lambda: netcdf({"": [answer]}, arguments.orders),
        trace=lambda: trace_csv(answer),
        plot=lambda: _cycle_picture(arguments, answer),
    )
    if why:
        print(f"--trace: no file, {why}.", file=sys.stderr)
    return max(status_of([answer]), NOT_ANSWERED if why else ANSWERED)


def report(train, arguments):
    """Several speeds, normal and misfiring, with backlash and without."""
    check_picture(train, arguments)
    check_labelled(arguments)
    if arguments.at is not None and arguments.at not in arguments.rpm:
        raise OutputError(f"--at: {arguments.at:g} rpm is not one of the speeds of --rpm. Add it.")
    other = check_page(train, arguments)
    each = asks_each(train, arguments)
    trains = misfire_trains(train) if each else {"": train}
    if arguments.misfire and not each:
        trains[", ".join(arguments.misfire)] = train.misfire(*arguments.misfire)
    trains = {case_title(train, cylinders): one for cylinders, one in trains.items()}
    # A computed bound takes half a minute: only the speed that is shown in full gets one, at the end.
    asked, designs = dataclasses.replace(Asked.of(arguments), certify=False), [*trains.values(), *filter(None, [other])]
    kept = Kept(designs, ("report", arguments.rpm, asked))
    runs = len(designs) + arguments.tune + bool(arguments.misfire and (other or arguments.tune))
    with Progress(runs * len(arguments.rpm), quiet=arguments.quiet) as progress:
        try:
            found = kept.run(lambda folder: _reported(train, trains, other, arguments, asked, folder, progress))
        except KeyboardInterrupt as stop:
            if kept.folder:
                stop.add_note(f"no file is written, but what was found is kept; {GOES_ON}")
            raise
    cases, place, seconds, tuning = found
    worst, whole = {"worst_misfire": finite(worst_misfire(cases))} if each else {}, []
    deliver(
        arguments,
        "\n\n".join(filter(None, [misfires_text(cases) if each else cases_text(cases), second_text(cases, seconds)])),
        json=lambda: as_json(
            changes(arguments) | on_scene(train) | cases_record(cases, orders=arguments.orders) | worst
        ),
        csv=lambda: rows_csv([answer_row(answer, case=case.title) for case in cases for answer in case.answers]),
        netcdf=lambda: netcdf({case.title: case.answers for case in cases}, arguments.orders, along="case"),
        plot=lambda: _cycle_picture(arguments, cases[0].answers[place]),
        html=lambda: _page(report_of(arguments, cases, place, seconds, tuning), whole),
    )
    kept.forget()
    status = status_of([answer for case in cases for answer in case.answers])
    return status if all(whole) else NOT_ANSWERED


def _reported(train, trains, other, arguments, asked, folder, progress):
    """The cases, the number of the speed to show in full, the second design and what is told of how it was found."""
    tell = {"say": progress.say, "advance": progress.advance}
    cases = solve_cases(trains, arguments.rpm, asked, folder=folder, **tell)
    place = _place_of(cases[0], arguments.at)
    cases = certified_at(cases, place, progress.say) if arguments.certify else cases
    return cases, place, *second_cases(train, other, shown_misfire(cases), arguments, asked, folder, progress)


def _page(report, whole):
    """The bytes of the page; whether it is whole goes to the list."""
    from jaxhb.report.page.page import as_page

    content, complete = as_page(report)
    whole.append(complete)
    return content


def tune(train, arguments):
    """Change the numbers of a scene so that a response becomes small, as its [tune] table asks."""
    from jaxhb.design.table import read_table
    from jaxhb.design.tuning import tune as search

    options = {name: getattr(arguments, name) for name in ("rpm", "optimizer", "steps", "starts", "seed", "tolerance")}
    asked = read_table(train, {name: value for name, value in options.items() if value is not None})
    files = _TunedFiles(arguments, train, asked["rpm"])
    with Progress(asked.get("steps", 0), quiet=arguments.quiet) as progress:
        progress.say("solving the scene as it is")
        try:
            result = search(
                train, **asked, on_start=partial(files.begin, progress), on_step=partial(files.note, progress)
            )
        except KeyboardInterrupt as stop:
            stop.add_note(files.left())
            raise
    record = tuned_record(train, asked, result)
    files.write(result.after.parameters, record)
    if arguments.plot:
        from jaxhb.report.figures.cycle import plot_tuning

        write_files({arguments.plot: as_picture(arguments.plot, plot_tuning(asked["objective"], result))})
    print(tuned_text(train, asked, result))
    if not result.interrupted:  # who stops a tuning does not wait for more
        with Progress(quiet=arguments.quiet) as progress:
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
        self.arguments, self.train, self.rpm, self.history, self.start = arguments, train, rpm, [], None
        _, beside = changed_scene(arguments.scene, {})
        self.copies = copies_beside(beside, Path(arguments.output).parent)
        make_folders(self.copies)

    def left(self):
        """What a tuning that is stopped before its first step leaves, in a sentence: the scene as it is, as far as it
        is solved, in the file of numbers."""
        if self.history:
            return f"the best design so far is {self.arguments.output!r}"
        done = 0 if self.start is None else int(self.start.solved.sum())
        said = f"no design is there yet and no scene is written; {done} of {len(self.rpm)} speeds of the scene as it is"
        if not done:
            return f"{said} are solved"
        record = changes(self.arguments) | start_record(self.train, self.rpm, self.start)
        write_files({self.arguments.json: as_json(record)})
        return f"{said} are solved, and their numbers are in {self.arguments.json!r}"

    def begin(self, progress, reading):
        """What is known of the scene as it is."""
        self.start = reading
        progress.say(f"solving the scene as it is: {reading.solved.sum()} of {len(self.rpm)} speeds are solved")

    def note(self, progress, step):
        """One step more."""
        self.history.append(step)
        self.write(step.parameters, progress_record(self.train, self.rpm, self.history))
        progress.advance(1 if step.number else 0)
        told = f"step {step.number}: objective {step.objective:.4g}, a share of what it was at the start"
        progress.say(f"{told}, with a smooth maximum of {100 * step.width:g} %")

    def write(self, parameters, record):
        """The scene with these parameters, and a record."""
        values = scene_values(self.train, dict(self.arguments.set) | parameters, locate)
        text, _ = changed_scene(self.arguments.scene, values, remark=f"{self.arguments.scene}, tuned by jaxhb tune.")
        made = {self.arguments.output: [text.encode()], self.arguments.json: as_json(changes(self.arguments) | record)}
        write_files({path: [content] for path, content in self.copies.items()} | made)


def _cycle_picture(arguments, answer):
    from jaxhb.report.figures.cycle import plot_cycle

    return as_picture(arguments.plot, plot_cycle(answer, arguments.gear))


def _place_of(case, rpm):
    """Number of the asked speed, or of that with the largest tooth force, without teeth the largest torque."""
    if rpm is not None:
        return next(i for i, answer in enumerate(case.answers) if answer.rpm == rpm)
    values = [hardest(answer)[2] if answer.answered else -1.0 for answer in case.answers]
    return values.index(max(values))


def check_picture(train, arguments):
    """Refuse a picture of nothing before anything is computed."""
    if arguments.plot and not train.topology.link_names:
        raise OutputError("--plot: the train has no gears, shafts or dampers, so there is no torque to draw.")
    if getattr(arguments, "gear", None):
        index = train.topology.disk_index(arguments.gear)
        if not any(index in ends for ends in train.topology.mesh_ends):
            known = ", ".join(repr(name) for name in gears(train.topology))
            raise OutputError(f"--gear: {arguments.gear!r} carries no mesh. Gears: {known or 'none'}.")


def status_of(answers):
    """The exit status; stderr is told what has no answer, and what to try."""
    for warning in dict.fromkeys(warnings(answers)):
        print(warning, file=sys.stderr)
    return ANSWERED if all(answer.answered for answer in answers) else NOT_ANSWERED
