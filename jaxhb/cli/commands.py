"""Commands of the motion with backlash but for reports: compute, print for people,
write for programs.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxhb.cli import arguments as cli
from jaxhb.cli.operating_modes import EACH, compare
from jaxhb.cli.progress import Progress
from jaxhb.cli.resume import GOES_ON, Unfinished
from jaxhb.report.answer import SPEED, Answer, SweepAxis
from jaxhb.report.compute import (
    Asked,
    answer_one,
    answer_speeds,
    check_designs,
)
from jaxhb.report.figures.cycle import plot_cycle, plot_tuning
from jaxhb.report.figures.speeds import plot_sweep
from jaxhb.report.figures.transients import plot_transient
from jaxhb.report.files import numbers, output
from jaxhb.report.files.compared import of_answers, of_transient
from jaxhb.report.files.formats import OF_NUMBERS, deliver, made, named
from jaxhb.report.files.transients import transient_record, transient_sheet
from jaxhb.report.text.cases import solve_text
from jaxhb.report.text.sentences import warnings
from jaxhb.report.text.strength import answers_strength, strength_record
from jaxhb.report.text.sweep_tables import sweep_text
from jaxhb.report.text.transients import transient_text
from jaxhb.report.text.tuned import (
    check_text,
    parameter_unit,
    progress_record,
    start_record,
    tuned_parts,
    tuned_record,
)
from jaxhb.report.transients import (
    governing_link,
    has_curve,
    steady_extremes,
    transient_report,
)
from jaxhb.report.value_sweep import answer_values
from jaxhb.scene.writer import changed_scene, copies_beside
from jaxhb.solutions.misfires import alike
from jaxhb.train.changes import numbers_in_si, scene_values
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.transients.transient import Speed, transient as march_transient

if TYPE_CHECKING:
    from jaxhb.design.descent import Step
    from jaxhb.design.task import Reading
    from jaxhb.design.tuning import Tuning
    from jaxhb.results.dataset import Dataset


def solve(train: DriveTrain, arguments: cli.SolveOptions) -> int:
    """Answer one speed."""
    check_files(train, arguments)
    train = misfire_trains(train, arguments)[""]
    with Progress(quiet=arguments.quiet) as progress:
        question = Asked.of(arguments)
        answer = answer_one(train, arguments.rpm, question, progress.say)
    no_trace = numbers.untraceable(answer) if named(arguments, "trace") else ""
    makers = {
        "record": lambda: (
            numbers.on_scene(train) | numbers.both_record(answer, arguments.orders)
        ),
        "rows": lambda: output.sheet([numbers.answer_row(answer)]),
        "dataset": lambda: numbers.labelled({"": [answer]}, arguments.orders),
        "figure": lambda: plot_cycle(answer, arguments.gear),
    }
    if not no_trace:
        makers["trace"] = lambda: numbers.trace(answer)
    deliver(arguments, solve_text(answer), makers)
    compare(arguments, lambda: of_answers([answer]))
    failures = warnings([answer])
    if no_trace:
        failures = [f"--trace: no file, {no_trace}.", *failures]
    return status(failures)


def transient(train: DriveTrain, arguments: cli.TransientOptions) -> int:
    """March a transient."""
    check_files(train, arguments)
    if arguments.link is not None:
        train.topology.link_index(arguments.link)
    if has_curve(train.topology) and importlib.util.find_spec("rainflow") is None:
        raise output.OutputError(
            "sn_curve: counting cycles needs rainflow. Install it: pip install"
            ' "jaxhb[transients]".'
        )
    speed = _speed_of(arguments)
    train = misfire_trains(train, arguments)[""]
    with Progress(quiet=arguments.quiet) as progress:
        progress.say("preparing the march")
        run = march_transient(
            train,
            seconds=arguments.seconds,
            speed=speed,
            rpm=arguments.rpm if arguments.free else None,
            events=arguments.event,
            start=arguments.start,
            record=arguments.record,
            refine=arguments.refine,
            progress=lambda done: progress.say(
                f"marching, {100 * done:.0f} % are done"
            ),
        )
        progress.say("reading the results")
        at_rest = arguments.start == "rest" or not float(run.rpm[0]) > 0
        report = transient_report(
            run,
            start="rest" if at_rest else "steady",
            events=arguments.event,
            passages=arguments.passage,
        )
        link = ""
        steady = None
        if "plot" in arguments.files and not run.interrupted:
            link = arguments.link or governing_link(report)
            progress.say("solving for the steady motion at the same speeds")
            steady = steady_extremes(run, link)
    makers = {
        "record": lambda: transient_record(report),
        "rows": lambda: transient_sheet(run),
        "dataset": run.to_xarray,
    }
    if not run.interrupted:  # who stops a march does not wait for its steady motions
        makers["figure"] = lambda: plot_transient(report, link, steady)
    deliver(arguments, transient_text(report), makers)
    if run.interrupted:
        done = float(run.time[-1])
        print(f"\nIt was stopped: {done:.4g} of {arguments.seconds:g} s are marched.")
        return output.INTERRUPTED
    compare(arguments, lambda: of_transient(report))
    return output.ANSWERED


def _speed_of(arguments: cli.TransientOptions) -> Speed:
    """The speed of a transient as the library takes it."""
    if arguments.rpm is None and arguments.speed is None:
        instead = "--rpm R, its first speed" if arguments.free else "--speed or --rpm"
        raise output.OutputError(f"transient: no speed is given. Give {instead}.")
    if arguments.free:
        return "free"
    rows = arguments.speed
    if rows is not None:
        return rows
    assert arguments.rpm is not None  # else it was refused
    return arguments.rpm


def tune(train: DriveTrain, arguments: cli.TuneOptions) -> int:
    """Change the numbers of a scene so that a response becomes small, as its [tune]
    table asks.
    """
    from jaxhb.design.table import read_table
    from jaxhb.design.tuning import tune as search

    names = ("rpm", "optimizer", "robust", "steps", "starts", "seed", "tolerance")
    chosen = {name: getattr(arguments, name) for name in names}
    table = read_table(
        train, {name: value for name, value in chosen.items() if value is not None}
    )
    unfinished = Unfinished([train], ("tune", table))
    # Several designs of a robust tuning go on at once: their steps are not counted.
    steps = 0 if "robust" in table else table.get("steps", 0)
    with Progress(steps, quiet=arguments.quiet) as progress:
        files = _TunedFiles(arguments, train, table["rpm"], progress)
        progress.say("solving the nominal scene")

        def compute(folder: Any) -> Tuning:
            return search(
                train,
                **table,
                on_start=files.begin,
                on_step=files.note,
                out=folder,
                executor=arguments.executor,
            )

        def left() -> str:
            return files.left() + (f"; {GOES_ON}" if unfinished.folder else "")

        result = unfinished.run(compute, left)
    record = tuned_record(train, table, result)
    files.write(result.after.parameters, record)
    picture = {"figure": lambda: plot_tuning(table["objective"], result)}
    output.write_files(made(arguments, picture))
    print("\n\n".join(tuned_parts(train, table, result)))
    if not result.interrupted:  # who stops a tuning does not wait for more
        with Progress(quiet=arguments.quiet) as progress:
            checked = check_designs(train, table, result, progress.say)
        files.write(result.after.parameters, record | {"steady_state": checked})
        print(f"\n{check_text(checked)}")
    print(f"\nThe tuned scene is {files.output}, all numbers are in {files.json}.")
    if result.interrupted:
        if unfinished.folder:
            print(f"It was stopped; {GOES_ON}.")
        return output.INTERRUPTED
    unfinished.forget()
    return output.ANSWERED if result.after.solved.all() else output.NOT_ANSWERED


class _TunedFiles:
    """The files of a tuning, whole at every moment: the best design so far, and its
    history.
    """

    def __init__(
        self,
        arguments: cli.TuneOptions,
        train: DriveTrain,
        rpm: Iterable[float],
        progress: Progress,
    ):
        self.arguments = arguments
        self.train = train
        self.rpm = list(rpm)
        self.progress = progress
        self.history: list[Step] = []
        self.start: Reading | None = None
        _, tables = changed_scene(arguments.scene, {})
        self.output = arguments.files["output"]
        self.json = arguments.files["json"]
        self.copies = copies_beside(tables, Path(self.output).parent)
        output.make_folders(self.copies.files)

    def begin(self, reading: Reading) -> None:
        """Note the readings of the nominal scene."""
        self.start = reading
        self.progress.say(
            f"solving the nominal scene: {reading.solved.sum()} of {len(self.rpm)}"
            " speeds are solved"
        )

    def left(self) -> str:
        """A sentence on what a tuning that is stopped leaves; before its first step
        the speeds that are solved.
        """
        if self.history:
            return f"the best design so far is {self.output!r}"
        solved = 0
        place = ""
        if self.start is not None and self.start.solved.any():
            solved = int(self.start.solved.sum())
            record = output.changes(self.arguments) | start_record(
                self.train, self.rpm, self.start
            )
            output.write_files({self.json: output.as_json(record)})
            place = f", and their numbers are in {self.json!r}"
        return (
            f"no design is there yet and no scene is written; {solved} of"
            f" {len(self.rpm)} speeds of the nominal scene are solved{place}"
        )

    def note(self, step: Step) -> None:
        """Write the design and the history after one more step."""
        self.history.append(step)
        self.write(step.parameters, progress_record(self.train, self.rpm, self.history))
        self.progress.advance(1 if step.number else 0)
        self.progress.say(
            f"step {step.number}: objective {step.objective:.4g}, a share of what it"
            f" was at the start, with a smooth maximum of {100 * step.width:g} %"
        )

    def write(self, parameters: Mapping[str, float], record: dict) -> None:
        """Write the scene with these parameters, and a record."""
        from jaxhb.design.tolerances import moved_ranges  # imports scipy

        arguments = self.arguments
        values = scene_values(self.train, dict(arguments.set) | dict(parameters))
        text, _ = changed_scene(
            arguments.scene,
            values,
            tolerances=moved_ranges(self.train, parameters),
            remark=f"{arguments.scene}, tuned by jaxhb tune.",
        )
        scene = self.copies.renamed(text).encode()
        json = output.as_json(output.changes(arguments) | record)
        output.write_files(self.copies.files | {self.output: scene, self.json: json})


def check_files(
    train: DriveTrain,
    arguments: cli.SolveOptions
    | cli.SweepOptions
    | cli.ReportOptions
    | cli.TransientOptions,
) -> None:
    """Refuse a picture of nothing before anything is computed."""
    topology = train.topology
    if "plot" in arguments.files and not topology.link_names:
        raise output.OutputError(
            "--plot: the train has no gears, shafts or dampers, so there is no torque"
            " to draw."
        )
    gear = getattr(arguments, "gear", None)
    if gear:
        index = topology.disk_index(gear)
        if not any(index in ends for ends in topology.mesh_ends):
            gears = ", ".join(map(repr, topology.gear_names)) or "none"
            raise output.OutputError(
                f"--gear: {gear!r} carries no mesh. Gears: {gears}."
            )


def misfire_trains(
    train: DriveTrain, arguments: cli.FiringOptions, *, each: bool = False
) -> dict[str, DriveTrain]:
    """Trains by the cylinders that do not fire: under "" that of ``--misfire`` and
    ``--cut-off``; of ``each``, which some commands take, the train as it runs, and
    every cylinder in turn; these share programs.
    """
    misfire = arguments.misfire
    cut_off = arguments.cut_off
    options = {"--misfire": misfire, "--cut-off": cut_off}
    in_turn = [option for option, names in options.items() if EACH in names]
    if not in_turn or EACH in train.topology.cylinder_names:
        return {"": train.misfire(*misfire).cut_off(*cut_off)}
    option = in_turn[0]
    if not each:
        raise output.OutputError(
            f"{option} {EACH}: only jaxhb report, forced and campbell take every"
            " cylinder in turn. Name one, or use one of them."
        )
    if len(misfire) + len(cut_off) > 1:
        used = " and ".join(name for name, names in options.items() if names)
        raise output.OutputError(
            f"{option} {EACH}: takes every cylinder in turn. Leave out the other"
            f" {used}."
        )
    if not train.topology.firing_cylinders:
        raise output.OutputError(
            f"{option} {EACH}: no cylinder of the train fires. Name what misfires, or"
            " leave it out."
        )
    without_gas = EACH in cut_off
    cases = train.cut_offs() if without_gas else train.misfires()
    return {"": alike(train, cut_off=without_gas)} | cases


def status(failures: Iterable[str]) -> int:
    """The exit status; stderr is told what has no answer, and what to try."""
    sentences = list(dict.fromkeys(failures))
    for sentence in sentences:
        print(sentence, file=sys.stderr)
    return output.NOT_ANSWERED if sentences else output.ANSWERED


def sweep(train: DriveTrain, arguments: cli.SweepOptions) -> int:
    """Answer many speeds, or many values of a number."""
    check_files(train, arguments)
    rpm = arguments.rpm
    if arguments.orbit and arguments.direction:
        raise output.OutputError(
            "--direction: periodic solutions (--orbit) do not depend on it. Leave one"
            " of them out."
        )
    if arguments.over and len(rpm) > 1:
        raise output.OutputError(
            f"--over: it sweeps one parameter at one speed, and --rpm names {len(rpm)}."
        )
    train = misfire_trains(train, arguments)[""]
    question = Asked.of(arguments)
    axis = SPEED
    values = rpm
    if arguments.over:
        name, written = arguments.over
        values = numbers_in_si(train, name, written)
        axis = SweepAxis(name, parameter_unit(train, name))
        # What is refused is refused before anything is computed or written.
        for value in values:
            train.replace({name: value})
    files = _SweepFiles(train, arguments, axis)
    direction = arguments.direction
    unfinished = Unfinished(
        [train],
        ("sweep", axis, values, rpm, direction, question, arguments.chunk),
        elsewhere=arguments.folder,
    )

    def compute(folder: Any) -> dict[str, list[Answer]]:
        if axis == SPEED:
            return answer_speeds(
                train,
                values,
                question,
                direction=direction or "up",
                out=folder,
                chunk=arguments.chunk,
                progress=progress.advance,
                say=progress.say,
                on_answers=files.note,
                executor=arguments.executor,
            )
        progress.say(f"values of {axis.name}")
        return answer_values(
            train,
            rpm[0],
            axis,
            values,
            question,
            direction=direction or "up",
            out=folder,
            progress=progress.advance,
            on_answers=files.note,
            executor=arguments.executor,
        )

    def left() -> str:
        goes_on = f"; {GOES_ON}" if unfinished.folder else ""
        return files.left(len(values)) + goes_on

    with Progress(len(values), quiet=arguments.quiet) as progress:
        answers = unfinished.run(compute, left)
        progress.say("reading the results")
        makers = files.makers(answers, complete=True)
        makers["figure"] = lambda: plot_sweep(answers)
        deliver(arguments, sweep_text(answers), makers)
    every_answer = [answer for several in answers.values() for answer in several]
    compare(arguments, lambda: of_answers(every_answer))
    unfinished.forget()
    return status(warnings(every_answer))


class _SweepFiles:
    """The answers so far by direction, and the files that hold them."""

    def __init__(self, train: DriveTrain, arguments: cli.SweepOptions, axis: SweepAxis):
        self.train = train
        self.arguments = arguments
        self.axis = axis
        self.answers: dict[str, list[Answer]] = {}
        self.records: dict[int, tuple[Answer, bytes]] = {}
        self.rows: dict[int, tuple[Answer, dict[str, Any]]] = {}
        self.both = arguments.direction == "both"
        # The highest that JSON lists; None: all.
        self.orders: float | None = arguments.orders or numbers.NO_ORDERS
        if arguments.full:
            self.orders = None

    def note(self, answers: Mapping[str, list[Answer]]) -> None:
        """Write the answers so far; a record of all orders is too large to be written
        again and again, as are data sets.
        """
        self.answers = {way: several for way, several in answers.items() if several}
        self._write(["rows"] if self.arguments.full else ["rows", "record"])

    def _write(self, contents: Iterable[str]) -> str:
        """Write files with these contents that were asked for, as soon as there is an
        answer; their names.
        """
        if not self.answers:
            return ""
        makers = self.makers(self.answers)
        files = made(self.arguments, {content: makers[content] for content in contents})
        files.pop(output.STANDARD_OUTPUT, None)
        output.write_files(files)
        return " and ".join(map(repr, files))

    def left(self, total: int) -> str:
        """A sentence on what a sweep that is stopped leaves."""
        ways = ("up", "down") if self.both else tuple(self.answers) or ("",)
        done = min(len(self.answers.get(way, ())) for way in ways)
        names = self._write(OF_NUMBERS)
        counted = "speeds" if self.axis == SPEED else "values"
        return f"{done} of {total} {counted} are done{f' in {names}' if names else ''}"

    def makers(
        self, answers: Mapping[str, list[Answer]], *, complete: bool = False
    ) -> dict[str, Callable[[], Any]]:
        """Functions that make the contents of files of these answers."""
        return {
            "record": partial(self._record_of_all, answers, complete),
            "rows": partial(self._rows, answers),
            "dataset": partial(self._dataset, answers),
        }

    def _record_of_all(
        self, answers: Mapping[str, list[Answer]], complete: bool
    ) -> dict[str, Any]:
        """The record: one list of answers is called responses, two by their
        directions.
        """
        first = next(iter(answers.values()))
        lists = {
            way if self.both else "responses": map(self._record, several)
            for way, several in answers.items()
        }
        head: dict[str, Any] = {
            "rpm": [answer.rpm for answer in first],
            "direction": (
                None if "orbit" in answers else self.arguments.direction or "up"
            ),
            "complete": complete,
            "orders": self.orders,
        }
        if self.axis != SPEED:
            head["over"] = {
                "name": self.axis.name,
                "unit": self.axis.unit,
                "values": [answer.place for answer in first],
            }
        elif complete:
            judged = {
                way: strength_record(answers_strength(several))
                for way, several in answers.items()
            }
            if all(judged.values()):  # the scene gives limits
                records = {way: record["strength"] for way, record in judged.items()}
                head["strength"] = records if self.both else [*records.values()][0]
        return numbers.on_scene(self.train) | head | lists

    def _record(self, answer: Answer) -> bytes:
        """The record of an answer, made once but for those of all orders."""
        if self.arguments.full:
            return output.as_bytes(numbers.both_record(answer))
        if id(answer) not in self.records:
            record = output.as_bytes(numbers.both_record(answer, self.orders))
            self.records[id(answer)] = (answer, record)
        return self.records[id(answer)][1]

    def _rows(self, answers: Mapping[str, list[Answer]]) -> output.Sheet:
        """One row per answer."""
        rows = [
            self._row(answer) | {"direction": way}
            for way, several in answers.items()
            for answer in several
        ]
        return output.sheet(rows)

    def _row(self, answer: Answer) -> dict[str, Any]:
        """The row of an answer without its direction, made once."""
        if id(answer) not in self.rows:
            first = {} if self.axis == SPEED else {self.axis.label: answer.place}
            row = numbers.answer_row(answer, **first, direction=None)
            self.rows[id(answer)] = (answer, row)
        return self.rows[id(answer)][1]

    def _dataset(self, answers: Mapping[str, list[Answer]]) -> Dataset:
        """The labelled arrays."""
        return numbers.labelled(
            answers,
            self.arguments.orders,
            along="direction" if len(answers) > 1 else None,
            every=self.arguments.full,
        )
