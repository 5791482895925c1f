"""``jaxhb sweep``: many speeds, or many values of a number at one speed; what is found is written as it is found."""

from jaxhb.cli.commands import check_picture, status_of
from jaxhb.cli.progress import Progress
from jaxhb.cli.resume import GOES_ON, Kept
from jaxhb.report.answer import SPEED, Axis
from jaxhb.report.compute import Asked, answer_speeds, answer_values
from jaxhb.report.files.labelled import check_labelled, netcdf
from jaxhb.report.files.output import (
    STANDARD_OUTPUT,
    OutputError,
    as_bytes,
    as_picture,
    as_sweep_json,
    changes,
    deliver,
    write_files,
)
from jaxhb.report.files.record import NO_ORDERS, both_record, finite, on_scene
from jaxhb.report.files.rows import answer_row, rows_csv
from jaxhb.report.selection import without_cylinders
from jaxhb.report.text.strength import answers_strength, strength_record
from jaxhb.report.text.sweep_tables import sweep_text
from jaxhb.train.changes import declared_field, locate

CHUNK = 16
"""Speeds that are marched, kept and written together by default: a batch of marches."""


def sweep(train, arguments):
    """Many speeds, or many values of a number."""
    check_picture(train, arguments)
    check_labelled(arguments)
    _check_options(arguments)
    train, asked = without_cylinders(train, arguments), Asked.of(arguments)
    going = _Sweep(train, arguments, asked)
    with Progress(len(going.values), quiet=arguments.quiet) as progress:
        try:
            found = going.run(progress)
        except KeyboardInterrupt as stop:
            stop.add_note(going.left())
            raise
        progress.say("reading the results")
        deliver(
            arguments,
            sweep_text(found),
            json=lambda: going.json(found, complete=True),
            csv=lambda: going.csv(found),
            netcdf=lambda: going.netcdf(found),
            plot=lambda: _picture(arguments, found),
        )
    going.kept.forget()
    return status_of([answer for answers in found.values() for answer in answers])


def _check_options(arguments):
    if arguments.orbit and arguments.direction:
        raise OutputError("--direction: periodic solutions (--orbit) do not depend on it. Leave one of them out.")
    if arguments.over and len(arguments.rpm) > 1:
        raise OutputError(f"--over: it goes over one number at one speed, and --rpm names {len(arguments.rpm)}.")


class _Sweep:
    """A sweep under way: what was found, and the files that hold it."""

    def __init__(self, train, arguments, asked):
        self.train, self.arguments, self.asked = train, arguments, asked
        self.axis, self.values = _axis(train, arguments)
        self.found, self.records = {}, {}
        question = self.axis, self.values, arguments.rpm, arguments.direction, asked, arguments.chunk
        self.kept = Kept([train], question)
        if arguments.folder:
            self.kept.folder = None

    def run(self, progress):
        """Answers by direction."""
        return self.kept.run(lambda folder: self._answers(progress, self.arguments.folder or folder))

    def _answers(self, progress, folder):
        kept = {"out": folder, "chunk": self.arguments.chunk or CHUNK}
        given = {"direction": self.arguments.direction or "up", "progress": progress.advance, "told": self.note}
        if self.axis == SPEED:
            return answer_speeds(self.train, self.values, self.asked, kept=kept, say=progress.say, **given)
        progress.say(f"values of {self.axis.name}")
        return answer_values(self.train, self.arguments.rpm[0], self.axis, self.values, self.asked, kept=kept, **given)

    def note(self, found):
        """Write what is known so far; a JSON file of all orders is too large to be written again and again."""
        self.found = {way: answers for way, answers in found.items() if answers}
        if not self.found:
            return
        self._write({"csv": self.csv} if self.arguments.full else {"csv": self.csv, "json": self.json})

    def _write(self, makers):
        given = {option: getattr(self.arguments, option) for option in makers}
        files = {option: name for option, name in given.items() if name and name != STANDARD_OUTPUT}
        write_files({name: makers[option](self.found) for option, name in files.items()})
        return list(files.values())

    def left(self):
        """What a sweep that is stopped leaves, in a sentence."""
        ways = ("up", "down") if self.arguments.direction == "both" else tuple(self.found) or ("",)
        done = min(len(self.found.get(way, ())) for way in ways)
        files = self._write({"json": self.json, "csv": self.csv, "netcdf": self.netcdf}) if self.found else []
        where = f" in {' and '.join(map(repr, files))}" if files else ""
        again = f"; {GOES_ON}" if self.arguments.folder or self.kept.folder else ""
        counted = "speeds" if self.axis == SPEED else "values"
        return f"{done} of {len(self.values)} {counted} are done{where}{again}"

    def json(self, found, *, complete=False):
        """One list of answers is called responses, two by their directions."""
        arguments, first, both = self.arguments, next(iter(found.values())), self.arguments.direction == "both"
        lists = {way if both else "responses": map(self._record, own) for way, own in found.items()}
        direction = None if "orbit" in found else arguments.direction or "up"
        head = {"rpm": [answer.rpm for answer in first], "direction": direction, "complete": complete}
        head["orders"] = _orders(arguments)
        if self.axis != SPEED:
            head["over"] = {"name": self.axis.name, "unit": self.axis.unit, "values": [a.place for a in first]}
        elif complete:
            judged = {way: finite(strength_record(answers_strength(answers))) for way, answers in found.items()}
            if any(judged.values()):
                head["strength"] = judged if both else [*judged.values()][0]
        return as_sweep_json(changes(arguments) | on_scene(self.train) | head, lists)

    def _record(self, answer):
        """The record of an answer as bytes, made once but for those of all orders."""
        if self.arguments.full:
            return as_bytes(both_record(answer))
        if id(answer) not in self.records:
            self.records[id(answer)] = answer, as_bytes(both_record(answer, _orders(self.arguments)))
        return self.records[id(answer)][1]

    def csv(self, found):
        """One row per answer."""
        given = {} if self.axis == SPEED else {self.axis.label: None}
        rows = []
        for way, answers in found.items():
            for answer in answers:
                first = dict.fromkeys(given, answer.place) | {"direction": way}
                rows.append(answer_row(answer, **first))
        return rows_csv(rows)

    def netcdf(self, found):
        """Labelled arrays."""
        along = "direction" if len(found) > 1 else None
        return netcdf(found, self.arguments.orders, along=along, every=self.arguments.full)


def _orders(arguments):
    """Highest order whose amplitudes the JSON lists; None: all."""
    return None if arguments.full else arguments.orders or NO_ORDERS


def _axis(train, arguments):
    """What changes along the sweep, and its values."""
    if not arguments.over:
        return SPEED, arguments.rpm
    name, values = arguments.over
    table, field, _ = locate(train.topology, name)
    for value in values:  # what is refused is refused before anything is computed or written
        train.replace({name: value})
    return Axis(name, declared_field(table, field).metadata["range"].unit), values


def _picture(arguments, found):
    from jaxhb.report.figures.sweep import plot_sweep

    return as_picture(arguments.plot, plot_sweep(found))
