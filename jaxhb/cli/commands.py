"""Commands of the motion with backlash but for sweeps and reports: compute, print for people, write for programs."""

import sys
from pathlib import Path

from jaxhb.cli.inputs import picture
from jaxhb.cli.progress import Progress
from jaxhb.report.compute import Asked, answer_one, check_designs
from jaxhb.report.files import output
from jaxhb.report.files.labelled import check_labelled, netcdf
from jaxhb.report.files.record import both_record, on_scene
from jaxhb.report.files.rows import answer_row, rows_csv, trace_csv, untraceable
from jaxhb.report.selection import gears, without_cylinders
from jaxhb.report.text.sentences import warnings
from jaxhb.report.text.tables import solve_text
from jaxhb.report.text.tuned import check_text, progress_record, start_record, tuned_parts, tuned_record
from jaxhb.scene.writer import changed_scene, copies_beside
from jaxhb.train.changes import scene_values


def solve(train, given, rpm, orders, trace, gear, plot, quiet, **_):
    """One speed."""
    check_files(train, given)
    train = without_cylinders(train, given)
    with Progress(quiet=quiet) as progress:
        answer = answer_one(train, rpm, Asked.of(given), progress.say)
    why = untraceable(answer) if trace else ""
    output.deliver(
        given,
        solve_text(answer),
        json=lambda: output.as_json(output.changes(given) | on_scene(train) | both_record(answer, orders)),
        csv=lambda: rows_csv([answer_row(answer)]),
        netcdf=lambda: netcdf({"": [answer]}, orders),
        plot=lambda: picture(plot, "cycle.plot_cycle", answer, gear),
        **({} if why else {"trace": lambda: trace_csv(answer)}),
    )
    return status([*([f"--trace: no file, {why}."] if why else []), *warnings([answer])])


def tune(train, given, plot, quiet, **options):
    """Change the numbers of a scene so that a response becomes small, as its [tune] table asks."""
    from jaxhb.design.table import read_table
    from jaxhb.design.tuning import tune as search

    names = ("rpm", "optimizer", "steps", "starts", "seed", "tolerance")
    asked = read_table(train, {name: options[name] for name in names if options[name] is not None})
    with Progress(asked.get("steps", 0), quiet=quiet) as progress:
        files = _TunedFiles(given, train, asked["rpm"], progress)
        progress.say("solving the scene as it is")
        try:
            result = search(train, **asked, on_start=files.begin, on_step=files.note)
        except KeyboardInterrupt as stop:
            stop.add_note(files.left())
            raise
    record = tuned_record(train, asked, result)
    files.write(result.after.parameters, record)
    if plot:
        output.write_files({plot: picture(plot, "cycle.plot_tuning", asked["objective"], result)})
    print("\n\n".join(tuned_parts(train, asked, result)))
    if not result.interrupted:  # who stops a tuning does not wait for more
        with Progress(quiet=quiet) as progress:
            checked = check_designs(train, asked, result, progress.say)
        files.write(result.after.parameters, record | {"steady_state": checked})
        print(f"\n{check_text(checked)}")
    print(f"\nThe tuned scene is {given.output}, all numbers are in {given.json}.")
    if result.interrupted:
        return output.INTERRUPTED
    return output.ANSWERED if result.after.solved.all() else output.NOT_ANSWERED


class _TunedFiles:
    """The files of a tuning, whole at every moment: what is best so far, and its history."""

    def __init__(self, given, train, rpm, progress):
        self.given, self.train, self.rpm, self.progress = given, train, rpm, progress
        self.history, self.start = [], None
        _, beside = changed_scene(given.scene, {})
        self.copies = copies_beside(beside, Path(given.output).parent)
        output.make_folders(self.copies)

    def left(self):
        """What a tuning that is stopped leaves, in a sentence; before its first step the scene as far as it is solved,
        in the file of numbers."""
        if self.history:
            return f"the best design so far is {self.given.output!r}"
        done = 0 if self.start is None else int(self.start.solved.sum())
        said = f"no design is there yet and no scene is written; {done} of {len(self.rpm)} speeds of the scene as it is"
        if not done:
            return f"{said} are solved"
        record = output.changes(self.given) | start_record(self.train, self.rpm, self.start)
        output.write_files({self.given.json: output.as_json(record)})
        return f"{said} are solved, and their numbers are in {self.given.json!r}"

    def begin(self, reading):
        """What is known of the scene as it is."""
        self.start = reading
        done = f"{reading.solved.sum()} of {len(self.rpm)} speeds are solved"
        self.progress.say(f"solving the scene as it is: {done}")

    def note(self, step):
        """One step more."""
        self.history.append(step)
        self.write(step.parameters, progress_record(self.train, self.rpm, self.history))
        self.progress.advance(1 if step.number else 0)
        told = f"step {step.number}: objective {step.objective:.4g}, a share of what it was at the start"
        self.progress.say(f"{told}, with a smooth maximum of {100 * step.width:g} %")

    def write(self, parameters, record):
        """The scene with these parameters, and a record."""
        given = self.given
        values = scene_values(self.train, dict(given.set) | parameters)
        text, _ = changed_scene(given.scene, values, remark=f"{given.scene}, tuned by jaxhb tune.")
        made = {given.output: [text.encode()], given.json: output.as_json(output.changes(given) | record)}
        output.write_files({path: [content] for path, content in self.copies.items()} | made)


def check_files(train, given):
    """Refuse a picture of nothing, and arrays without labels, before anything is computed."""
    if given.plot and not train.topology.link_names:
        raise output.OutputError("--plot: the train has no gears, shafts or dampers, so there is no torque to draw.")
    if getattr(given, "gear", None):
        index = train.topology.disk_index(given.gear)
        if not any(index in ends for ends in train.topology.mesh_ends):
            known = ", ".join(repr(name) for name in gears(train.topology))
            raise output.OutputError(f"--gear: {given.gear!r} carries no mesh. Gears: {known or 'none'}.")
    check_labelled(given)


def status(failures):
    """The exit status; stderr is told what has no answer, and what to try."""
    for sentence in dict.fromkeys(failures):
        print(sentence, file=sys.stderr)
    return output.NOT_ANSWERED if failures else output.ANSWERED
