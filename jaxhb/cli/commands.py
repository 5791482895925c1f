"""Commands of the motion with backlash but for reports: compute, print for people,
write for programs.
"""

import sys
from pathlib import Path

from jaxhb.cli.operating_modes import tell
from jaxhb.cli.progress import Progress
from jaxhb.cli.resume import GOES_ON, Kept
from jaxhb.report.answer import SPEED, Axis
from jaxhb.report.compute import (
    Asked,
    answer_one,
    answer_speeds,
    answer_values,
    check_designs,
)
from jaxhb.report.figures.cycle import plot_cycle, plot_tuning
from jaxhb.report.figures.speeds import plot_sweep
from jaxhb.report.files import numbers, output
from jaxhb.report.files.compared import of_answers
from jaxhb.report.text.cases import solve_text
from jaxhb.report.text.sentences import warnings
from jaxhb.report.text.strength import answers_strength, strength_record
from jaxhb.report.text.sweep_tables import sweep_text
from jaxhb.report.text.tuned import (
    check_text,
    parameter_unit,
    progress_record,
    start_record,
    tuned_parts,
    tuned_record,
)
from jaxhb.scene.writer import changed_scene, copies_beside
from jaxhb.solutions.misfires import alike
from jaxhb.train.changes import scene_values

EACH = "each"


def solve(train, given, rpm, orders, trace, gear, plot, quiet, **_):
    """One speed."""
    check_files(train, given)
    train = misfire_trains(train, given)[""]
    with Progress(quiet=quiet) as progress:
        answer = answer_one(train, rpm, Asked.of(given), progress.say)
    why = numbers.untraceable(answer) if trace else ""
    output.deliver(
        given,
        solve_text(answer),
        json=lambda: numbers.on_scene(train) | numbers.both_record(answer, orders),
        csv=lambda: output.rows_csv([numbers.answer_row(answer)]),
        netcdf=lambda: numbers.netcdf({"": [answer]}, orders),
        plot=lambda: plot_cycle(answer, gear),
        **({} if why else {"trace": lambda: numbers.trace_csv(answer)}),
    )
    tell(given, lambda: of_answers([answer]))
    return status(
        [*([f"--trace: no file, {why}."] if why else []), *warnings([answer])]
    )


def tune(train, given, plot, quiet, **options):
    """Change the numbers of a scene so that a response becomes small, as its [tune]
    table asks.
    """
    from jaxhb.design.table import read_table
    from jaxhb.design.tuning import tune as search

    names = ("rpm", "optimizer", "robust", "steps", "starts", "seed", "tolerance")
    asked = read_table(
        train, {name: options[name] for name in names if options[name] is not None}
    )
    kept = Kept([train], ("tune", asked))
    with Progress(
        0 if "robust" in asked else asked.get("steps", 0), quiet=quiet
    ) as progress:  # steps of several
        files = _TunedFiles(given, train, asked["rpm"], progress)
        progress.say("solving the scene as it is")

        def compute(folder):
            return search(
                train, **asked, on_start=files.begin, on_step=files.note, out=folder
            )

        result = kept.run(
            compute, lambda: files.left() + (f"; {GOES_ON}" if kept.folder else "")
        )
    record = tuned_record(train, asked, result)
    files.write(result.after.parameters, record)
    if plot:
        output.write_files(
            {plot: output.as_picture(plot, plot_tuning(asked["objective"], result))}
        )
    print("\n\n".join(tuned_parts(train, asked, result)))
    if not result.interrupted:  # who stops a tuning does not wait for more
        with Progress(quiet=quiet) as progress:
            checked = check_designs(train, asked, result, progress.say)
        files.write(result.after.parameters, record | {"steady_state": checked})
        print(f"\n{check_text(checked)}")
    print(f"\nThe tuned scene is {given.output}, all numbers are in {given.json}.")
    if result.interrupted:
        if kept.folder:
            print(f"It was stopped; {GOES_ON}.")
        return output.INTERRUPTED
    kept.forget()
    return output.ANSWERED if result.after.solved.all() else output.NOT_ANSWERED


class _TunedFiles:
    """The files of a tuning, whole at every moment: what is best so far, and its
    history.
    """

    def __init__(self, given, train, rpm, progress):
        self.given = given
        self.train = train
        self.rpm = rpm
        self.progress = progress
        self.history = []
        self.start = None
        _, beside = changed_scene(given.scene, {})
        self.copies = copies_beside(beside, Path(given.output).parent)
        output.make_folders(self.copies.files)

    def begin(self, reading):
        """What is known of the scene as it is."""
        self.start = reading
        self.progress.say(
            f"solving the scene as it is: {reading.solved.sum()} of {len(self.rpm)}"
            " speeds are solved"
        )

    def left(self):
        """What a tuning that is stopped leaves, in a sentence; before its first step
        the speeds that are solved.
        """
        if self.history:
            return f"the best design so far is {self.given.output!r}"
        done = 0 if self.start is None else int(self.start.solved.sum())
        there = ""
        if done:
            record = output.changes(self.given) | start_record(
                self.train, self.rpm, self.start
            )
            output.write_files({self.given.json: output.as_json(record)})
            there = f", and their numbers are in {self.given.json!r}"
        said = (
            f"no design is there yet and no scene is written; {done} of {len(self.rpm)}"
            " speeds of the scene as it is"
        )
        return f"{said} are solved{there}"

    def note(self, step):
        """One step more."""
        self.history.append(step)
        self.write(step.parameters, progress_record(self.train, self.rpm, self.history))
        self.progress.advance(1 if step.number else 0)
        told = (
            f"step {step.number}: objective {step.objective:.4g}, a share of what it"
            " was at the start"
        )
        self.progress.say(f"{told}, with a smooth maximum of {100 * step.width:g} %")

    def write(self, parameters, record):
        """The scene with these parameters, and a record."""
        from jaxhb.design.robust import moved_ranges  # imports scipy

        given = self.given
        values = scene_values(self.train, dict(given.set) | parameters)
        ranges = moved_ranges(self.train, parameters)
        text, _ = changed_scene(
            given.scene,
            values,
            tolerances=ranges,
            remark=f"{given.scene}, tuned by jaxhb tune.",
        )
        record = output.changes(given) | record
        scene = self.copies.renamed(text).encode()
        output.write_files(
            self.copies.files
            | {
                given.output: scene,
                given.json: output.as_json(record),
            }
        )


def check_files(train, given):
    """Refuse a picture of nothing before anything is computed."""
    if given.plot and not train.topology.link_names:
        raise output.OutputError(
            "--plot: the train has no gears, shafts or dampers, so there is no torque"
            " to draw."
        )
    if getattr(given, "gear", None):
        index = train.topology.disk_index(given.gear)
        if not any(index in ends for ends in train.topology.mesh_ends):
            known = ", ".join(repr(name) for name in train.topology.gear_names)
            raise output.OutputError(
                f"--gear: {given.gear!r} carries no mesh. Gears: {known or 'none'}."
            )


def misfire_trains(train, given, *, each=False):
    """Trains by the cylinders that do not fire: under "" that of ``--misfire`` and
    ``--cut-off``; of ``each``, which some commands take, the train as it runs, and
    every cylinder in turn; these share programs.
    """
    asked = {"--misfire": given.misfire, "--cut-off": given.cut_off}
    every = [option for option, names in asked.items() if EACH in names]
    if not every or EACH in train.topology.cylinder_names:
        return {"": train.misfire(*given.misfire).cut_off(*given.cut_off)}
    option = every[0]
    if not each:
        with_it = "report, forced and campbell take every cylinder in turn"
        raise output.OutputError(
            f"{option} {EACH}: only jaxhb {with_it}. Name one, or use one of them."
        )
    if len(given.misfire) + len(given.cut_off) > 1:
        others = (
            "Leave out the other"
            f" {' and '.join(name for name, names in asked.items() if names)}"
        )
        raise output.OutputError(
            f"{option} {EACH}: takes every cylinder in turn. {others}."
        )
    if not train.topology.firing_cylinders:
        told = "no cylinder of the train fires. Name what misfires, or leave it out"
        raise output.OutputError(f"{option} {EACH}: {told}.")
    cut_off = EACH in given.cut_off
    return {"": alike(train, cut_off=cut_off)} | (
        train.cut_offs() if cut_off else train.misfires()
    )


def status(failures):
    """The exit status; stderr is told what has no answer, and what to try."""
    for sentence in dict.fromkeys(failures):
        print(sentence, file=sys.stderr)
    return output.NOT_ANSWERED if failures else output.ANSWERED


def sweep(train, given, rpm, direction, over, folder, chunk, orbit, plot, quiet, **_):
    """Many speeds, or many values of a number."""
    check_files(train, given)
    if orbit and direction:
        raise output.OutputError(
            "--direction: periodic solutions (--orbit) do not depend on it. Leave one"
            " of them out."
        )
    if over and len(rpm) > 1:
        raise output.OutputError(
            f"--over: it goes over one number at one speed, and --rpm names {len(rpm)}."
        )
    train, asked = misfire_trains(train, given)[""], Asked.of(given)
    axis, values = SPEED, rpm
    if over:
        name, values = over
        axis = Axis(name, parameter_unit(train, name))
        for value in (
            values
        ):  # what is refused is refused before anything is computed or written
            train.replace({name: value})
    files = _SweepFiles(train, given, axis)
    kept = Kept(
        [train], ("sweep", axis, values, rpm, direction, asked, chunk), elsewhere=folder
    )

    def compute(place):
        how = {"direction": direction or "up", "out": place, "chunk": chunk}
        how |= {"progress": progress.advance, "on_answers": files.note}
        if axis == SPEED:
            return answer_speeds(train, values, asked, say=progress.say, **how)
        progress.say(f"values of {axis.name}")
        return answer_values(train, rpm[0], axis, values, asked, **how)

    with Progress(len(values), quiet=quiet) as progress:
        found = kept.run(
            compute,
            lambda: files.left(len(values)) + (f"; {GOES_ON}" if kept.folder else ""),
        )
        progress.say("reading the results")
        output.deliver(
            given,
            sweep_text(found),
            json=lambda: files.json(found, complete=True),
            csv=lambda: files.csv(found),
            netcdf=lambda: files.netcdf(found),
            plot=lambda: plot_sweep(found),
        )
    tell(
        given,
        lambda: [one for answers in found.values() for one in of_answers(answers)],
    )
    kept.forget()
    return status(
        warnings([answer for answers in found.values() for answer in answers])
    )


class _SweepFiles:
    """What was found so far, and the files that hold it."""

    def __init__(self, train, given, axis):
        self.train = train
        self.given = given
        self.axis = axis
        self.found = {}
        self.records = {}
        self.both = given.direction == "both"
        # The highest that JSON lists; None: all.
        self.orders = None if given.full else given.orders or numbers.NO_ORDERS

    def note(self, found):
        """Write what is known so far; a JSON file of all orders is too large to be
        written again and again.
        """
        self.found = {way: answers for way, answers in found.items() if answers}
        self._write("csv", *([] if self.given.full else ["json"]))

    def _write(self, *options):
        """Write files that were asked for, as soon as anything is known; their
        names.
        """
        names = {
            option: getattr(self.given, option) for option in options if self.found
        }
        names = {
            option: name
            for option, name in names.items()
            if name and name != output.STANDARD_OUTPUT
        }
        output.write_files(
            {name: getattr(self, option)(self.found) for option, name in names.items()}
        )
        return " and ".join(map(repr, names.values()))

    def left(self, total):
        """What a sweep that is stopped leaves, in a sentence."""
        ways = ("up", "down") if self.both else tuple(self.found) or ("",)
        done = min(len(self.found.get(way, ())) for way in ways)
        names = self._write("json", "csv", "netcdf")
        counted = "speeds" if self.axis == SPEED else "values"
        return f"{done} of {total} {counted} are done{f' in {names}' if names else ''}"

    def json(self, found, *, complete=False):
        """One list of answers is called responses, two by their directions."""
        first = next(iter(found.values()))
        lists = {
            way if self.both else "responses": map(self._record, own)
            for way, own in found.items()
        }
        direction = None if "orbit" in found else self.given.direction or "up"
        head = {
            "rpm": [answer.rpm for answer in first],
            "direction": direction,
            "complete": complete,
        }
        head["orders"] = self.orders
        if self.axis != SPEED:
            head["over"] = {
                "name": self.axis.name,
                "unit": self.axis.unit,
                "values": [a.place for a in first],
            }
        elif complete:
            judged = {
                way: strength_record(answers_strength(answers))
                for way, answers in found.items()
            }
            if all(judged.values()):  # the scene gives limits
                records = {way: one["strength"] for way, one in judged.items()}
                head["strength"] = records if self.both else [*records.values()][0]
        return output.as_json(
            output.changes(self.given) | numbers.on_scene(self.train) | head, **lists
        )

    def _record(self, answer):
        """The record of an answer as bytes, made once but for those of all orders."""
        if self.given.full:
            return output.as_bytes(numbers.both_record(answer))
        if id(answer) not in self.records:
            self.records[id(answer)] = (
                answer,
                output.as_bytes(numbers.both_record(answer, self.orders)),
            )
        return self.records[id(answer)][1]

    def csv(self, found):
        """One row per answer."""
        heads = [] if self.axis == SPEED else [self.axis.label]
        answers = [(way, answer) for way, own in found.items() for answer in own]
        rows = [
            numbers.answer_row(a, **dict.fromkeys(heads, a.place), direction=way)
            for way, a in answers
        ]
        return output.rows_csv(rows)

    def netcdf(self, found):
        """Labelled arrays."""
        along = "direction" if len(found) > 1 else None
        return numbers.netcdf(
            found, self.given.orders, along=along, every=self.given.full
        )
