"""``jaxhb sweep``: many speeds, or many values of a number at one speed; what is found is written as it is found."""

from jaxhb.cli.commands import check_files, status
from jaxhb.cli.inputs import picture
from jaxhb.cli.progress import Progress
from jaxhb.cli.resume import GOES_ON, Kept
from jaxhb.report.answer import SPEED, Axis
from jaxhb.report.compute import Asked, answer_speeds, answer_values
from jaxhb.report.files import output
from jaxhb.report.files.labelled import netcdf
from jaxhb.report.files.record import NO_ORDERS, both_record, on_scene
from jaxhb.report.files.rows import answer_row, rows_csv
from jaxhb.report.selection import without_cylinders
from jaxhb.report.text.sentences import warnings
from jaxhb.report.text.strength import answers_strength, strength_record
from jaxhb.report.text.sweep_tables import sweep_text
from jaxhb.train.changes import declared_field, locate


def sweep(train, given, rpm, direction, over, folder, chunk, orbit, plot, quiet, **_):
    """Many speeds, or many values of a number."""
    check_files(train, given)
    if orbit and direction:
        raise output.OutputError(
            "--direction: periodic solutions (--orbit) do not depend on it. Leave one of them out."
        )
    if over and len(rpm) > 1:
        raise output.OutputError(f"--over: it goes over one number at one speed, and --rpm names {len(rpm)}.")
    train, asked = without_cylinders(train, given), Asked.of(given)
    axis, values = _axis(train, over) if over else (SPEED, rpm)
    files = _SweepFiles(train, given, axis)
    kept = Kept([train], (axis, values, rpm, direction, asked, chunk))
    kept.folder = None if folder else kept.folder

    def compute(own):
        how = {"direction": direction or "up", "kept": {"out": folder or own, "chunk": chunk}}
        how |= {"progress": progress.advance, "told": files.note}
        if axis == SPEED:
            return answer_speeds(train, values, asked, say=progress.say, **how)
        progress.say(f"values of {axis.name}")
        return answer_values(train, rpm[0], axis, values, asked, **how)

    with Progress(len(values), quiet=quiet) as progress:
        found = kept.run(compute, lambda: files.left(len(values)) + (f"; {GOES_ON}" if folder or kept.folder else ""))
        progress.say("reading the results")
        output.deliver(
            given,
            sweep_text(found),
            json=lambda: files.json(found, complete=True),
            csv=lambda: files.csv(found),
            netcdf=lambda: files.netcdf(found),
            plot=lambda: picture(plot, "sweep.plot_sweep", found),
        )
    kept.forget()
    return status(warnings([answer for answers in found.values() for answer in answers]))


def _axis(train, over):
    """What output.changes along the sweep, and its values."""
    name, values = over
    table, field, _ = locate(train.topology, name)
    for value in values:  # what is refused is refused before anything is computed or written
        train.replace({name: value})
    return Axis(name, declared_field(table, field).metadata["range"].unit), values


class _SweepFiles:
    """What was found so far, and the files that hold it."""

    def __init__(self, train, given, axis):
        self.train, self.given, self.axis, self.found, self.records = train, given, axis, {}, {}
        self.both = given.direction == "both"
        self.orders = None if given.full else given.orders or NO_ORDERS  # the highest that JSON lists; None: all

    def note(self, found):
        """Write what is known so far; a JSON file of all orders is too large to be written again and again."""
        self.found = {way: answers for way, answers in found.items() if answers}
        if self.found:
            self._write("csv", *([] if self.given.full else ["json"]))

    def _write(self, *options):
        names = {option: getattr(self.given, option) for option in options}
        names = {option: name for option, name in names.items() if name and name != output.STANDARD_OUTPUT}
        output.write_files({name: getattr(self, option)(self.found) for option, name in names.items()})
        return " and ".join(map(repr, names.values()))

    def left(self, total):
        """What a sweep that is stopped leaves, in a sentence."""
        ways = ("up", "down") if self.both else tuple(self.found) or ("",)
        done = min(len(self.found.get(way, ())) for way in ways)
        names = self._write("json", "csv", "netcdf") if self.found else ""
        counted = "speeds" if self.axis == SPEED else "values"
        return f"{done} of {total} {counted} are done{f' in {names}' if names else ''}"

    def json(self, found, *, complete=False):
        """One list of answers is called responses, two by their directions."""
        first = next(iter(found.values()))
        lists = {way if self.both else "responses": map(self._record, own) for way, own in found.items()}
        direction = None if "orbit" in found else self.given.direction or "up"
        head = {"rpm": [answer.rpm for answer in first], "direction": direction, "complete": complete}
        head["orders"] = self.orders
        if self.axis != SPEED:
            head["over"] = {"name": self.axis.name, "unit": self.axis.unit, "values": [a.place for a in first]}
        elif complete:
            judged = {way: strength_record(answers_strength(answers)) for way, answers in found.items()}
            if any(judged.values()):
                head["strength"] = judged if self.both else [*judged.values()][0]
        return output.as_sweep_json(output.changes(self.given) | on_scene(self.train) | head, lists)

    def _record(self, answer):
        """The record of an answer as bytes, made once but for those of all orders."""
        if self.given.full:
            return output.as_bytes(both_record(answer))
        if id(answer) not in self.records:
            self.records[id(answer)] = answer, output.as_bytes(both_record(answer, self.orders))
        return self.records[id(answer)][1]

    def csv(self, found):
        """One row per answer."""
        heads = [] if self.axis == SPEED else [self.axis.label]
        answers = [(way, answer) for way, own in found.items() for answer in own]
        return rows_csv([answer_row(a, **dict.fromkeys(heads, a.place), direction=way) for way, a in answers])

    def netcdf(self, found):
        """Labelled arrays."""
        along = "direction" if len(found) > 1 else None
        return netcdf(found, self.given.orders, along=along, every=self.given.full)
