"""Studies: the file that says which trains, speeds and numbers a campaign computes.

A study is the product of its scenes, scenarios, misfires, changes and samples: its
designs, each at all speeds. Designs and the parts in which they are computed are known
by their numbers alone, so that nothing of a million of them is held.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from jaxhb.design.quantities import (
    Objective,
    label,
    objective_faults,
    read_quantity,
    unit_of,
)
from jaxhb.design.tolerances import box_of, read_tolerances
from jaxhb.elements.sentences import SceneError, shown, suggestion
from jaxhb.elements.units import has_unit
from jaxhb.elements.values import number_like
from jaxhb.results.checkpoint import digest, hash_of
from jaxhb.scene.csv_tables import number_rows
from jaxhb.scene.files import load_scene, parse
from jaxhb.scene.input_files import Unreadable, read_text
from jaxhb.train.changes import numbers_in_si
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import read_range, read_speeds

ANSWERS = ("steady", "orbit", "forced")
PART = 100  # cases of a part by default
MOST_CASES = 100_000_000


@dataclass(frozen=True)
class Change:
    """Numbers that change together: ``names`` ``(P,)`` as ``"NAME.FIELD"``, ``rows`` of
    their values ``(R, P)``, SI units.
    """

    names: tuple[str, ...]
    rows: np.ndarray


@dataclass(frozen=True)
class Variant:
    """A train of a study before its changes: the scene, the scenario and the cylinder
    that does not fire, "" for none.
    """

    scene: str
    scenario: str
    misfire: str
    train: DriveTrain


@dataclass(frozen=True)
class Accuracy:
    """Question that is put to each train: what to compute (of :data:`ANSWERS`), with
    how many harmonics, or which truncation error.
    """

    answers: str = "steady"
    harmonics: int | None = None
    tolerance: float | None = None


@dataclass(frozen=True)
class Piece:
    """Speeds of one design that are computed together, as small plain data.

    case : number of the first; variant : of the train; values : numbers that change, by
    name; ratios : numbers within their tolerances over their own values; sample :
    number of the draw, -1 for none; rpm : ``(n,)``
    """

    case: int
    variant: Variant
    values: dict[str, float]
    ratios: dict[str, float]
    sample: int
    rpm: np.ndarray
    accuracy: Accuracy
    keep: tuple[Objective, ...]


@dataclass(frozen=True)
class Study:
    """All that a campaign computes.

    name : of its file; variants : trains before their changes; changes : each with all
    others; rpm : ``(n,)``; keep : quantities of the rows; samples, seed : draws within
    the ``[tolerance]`` table of each scene, 0 for none; part : cases computed together
    """

    name: str
    variants: tuple[Variant, ...]
    changes: tuple[Change, ...]
    rpm: np.ndarray
    keep: tuple[Objective, ...]
    accuracy: Accuracy = Accuracy()
    samples: int = 0
    seed: int = 0
    part: int = PART

    @cached_property
    def _counts(self) -> tuple[int, ...]:
        """How many there are of what designs combine: variants, rows of each change,
        samples.
        """
        rows = (len(change.rows) for change in self.changes)
        return (len(self.variants), *rows, max(self.samples, 1))

    @property
    def designs(self) -> int:
        """Number of trains."""
        return math.prod(self._counts)

    @property
    def cases(self) -> int:
        """Number of trains times speeds."""
        return self.designs * len(self.rpm)

    @property
    def designs_of_part(self) -> int:
        """Number of designs of a part, several where they have few speeds."""
        return max(self.part // len(self.rpm), 1)

    @property
    def parts_of_design(self) -> int:
        """Number of parts of a design, several where it has many speeds."""
        return -(-len(self.rpm) // self.part)

    @property
    def parts(self) -> int:
        """Number of parts of all designs."""
        return -(-self.designs // self.designs_of_part) * self.parts_of_design

    def pieces_of(self, part: int) -> list[Piece]:
        """The pieces of the part of a number: one for each of its designs."""
        group, place = divmod(part, self.parts_of_design)
        first = group * self.designs_of_part
        designs = range(first, min(first + self.designs_of_part, self.designs))
        return [self._piece(design, place * self.part) for design in designs]

    def cases_of(self, part: int) -> int:
        """Number of cases of the part of a number."""
        group, place = divmod(part, self.parts_of_design)
        designs = min(self.designs_of_part, self.designs - group * self.designs_of_part)
        return designs * min(self.part, len(self.rpm) - place * self.part)

    def _piece(self, design: int, first: int) -> Piece:
        """The piece of a design that begins with its speed of number ``first``."""
        variant, *rows, sample = map(int, np.unravel_index(design, self._counts))
        values: dict[str, float] = {}
        for change, row in zip(self.changes, rows, strict=True):
            values |= zip(change.names, change.rows[row].tolist(), strict=True)
        return Piece(
            case=design * len(self.rpm) + first,
            variant=self.variants[variant],
            values=values,
            ratios=self._ratios[variant][sample] if self.samples else {},
            sample=sample if self.samples else -1,
            rpm=self.rpm[first : first + self.part],
            accuracy=self.accuracy,
            keep=self.keep,
        )

    @cached_property
    def numbers(self) -> list[str]:
        """Names of all numbers that change or have a tolerance."""
        changed = [name for change in self.changes for name in change.names]
        drawn = [name for draws in self._ratios for name in draws[0]]
        return list(dict.fromkeys([*changed, *drawn]))

    @cached_property
    def _ratios(self) -> list[list[dict[str, float]]]:
        """Ratios of the numbers of each sample to their own values, by variant."""
        if not self.samples:
            return []
        ratios = []
        for variant in self.variants:
            train = variant.train
            box = box_of(train, read_tolerances(train), ())
            numbers = map(box.named, box.sample(self.samples, self.seed))
            ratios.append(
                [
                    {name: v / float(train.value(name)) for name, v in drawn.items()}
                    for drawn in numbers
                ]
            )
        return ratios

    @property
    def manifest(self) -> dict[str, Any]:
        """All that rows depend on, as plain values by the names of sentences."""
        numbers = [hash_of(variant.train) for variant in self.variants]
        changes = [(change.names, change.rows) for change in self.changes]
        return {
            "trains": digest(numbers),
            "variants": [
                f"{variant.scene}, {variant.scenario}, {variant.misfire or 'firing'}"
                for variant in self.variants
            ],
            "changes": digest(changes),
            "speeds": digest(self.rpm),
            "quantities": self.columns,
            "answers": self.accuracy.answers,
            "harmonics": self.accuracy.harmonics,
            "tolerance": self.accuracy.tolerance,
            "samples": self.samples,
            "seed": self.seed,
            "part": self.part,
            "cases": self.cases,
        }

    @property
    def columns(self) -> list[str]:
        """Heads of the quantities kept: ``"shaft torque of a|b [N m]"``."""
        return [
            f"{label(quantity)} [{unit_of(quantity.quantity)}]".replace(" []", "")
            for quantity in self.keep
        ]


def load_study(path: str | Path) -> Study:
    """Read a study, a TOML file that ``docs/how_to/campaigns.md`` describes.

    Scenes are packaged ones, or files; paths of scenes and tables begin at the folder
    of the study. :class:`SceneError` names all faults, one sentence a line.
    """
    file = Path(path)
    faults: list[str] = []
    return _Reader(file, parse(file, faults), faults).study()


class _Reader:
    """The content of a study, and the faults found in it."""

    KEYS: Mapping[str, str] = {
        "scene": "the name of a scene, or a list of names",
        "rpm": 'speeds, as "600:2400:181" or a list of numbers',
        "keep": 'a list of quantities, as "shaft torque of cyl6|flywheel"',
        "answers": "'steady', 'orbit' or 'forced'",
        "scenarios": 'a list of names, or "all"',
        "misfires": 'a list of cylinders ("" for none), or "each"',
        "samples": "a whole number of at least 0",
        "seed": "a whole number of at least 0",
        "part": "a whole number of at least 1",
        "harmonics": "a whole number of at least 1",
        "tolerance": "a number greater than 0 and at most 1",
        "change": "a list of tables: write [[change]]",
    }
    CHANGE_KEYS = ("name", "values", "names", "rows")

    def __init__(self, file: Path, content: dict[str, Any], faults: list[str]):
        self.file = file
        self.content = content
        self.faults = faults
        for key in content:
            if key not in self.KEYS:
                self._fault(f"unknown key {shown(key)}.{suggestion(key, self.KEYS)}")

    def study(self) -> Study:
        """Build the Study; a SceneError with all faults."""
        variants = tuple(self._variants())
        train = variants[0].train if variants else None
        study = Study(
            name=self.file.stem,
            variants=variants,
            changes=tuple(self._changes(train)),
            rpm=self._speeds(),
            keep=tuple(self._quantities()),
            accuracy=Accuracy(
                self._value("answers", "steady", ANSWERS.__contains__),
                self._whole("harmonics", None, 1),
                self._value("tolerance", None, lambda v: number_like(v) and 0 < v <= 1),
            ),
            samples=self._whole("samples", 0, 0),
            seed=self._whole("seed", 0, 0),
            part=self._whole("part", PART, 1),
        )
        if study.cases > MOST_CASES:
            self._fault(
                f"it asks for {study.cases} cases: ask for {MOST_CASES} at most."
            )
        else:
            for variant in study.variants:
                self._check(variant, study)
        if self.faults:
            raise SceneError(dict.fromkeys(self.faults))
        return study

    def _fault(self, sentence: str) -> None:
        self.faults.append(f"{self.file.name}: {sentence}")

    def _value(self, key: str, default: Any, allowed: Callable[[Any], bool]) -> Any:
        """The value of a key where it is allowed, else its default and a fault."""
        if key not in self.content:
            return default
        value = self.content[key]
        if isinstance(value, dict) or not allowed(value):
            self._fault(f"{key} is {shown(value)}, must be {self.KEYS[key]}.")
            return default
        return value

    def _required(self, key: str, allowed: Callable[[Any], bool]) -> Any:
        """The value of a key that a study has to have, None where it lacks it."""
        if key not in self.content:
            self._fault(f"the key {key!r} is missing: give {self.KEYS[key]}.")
        return self._value(key, None, allowed)

    def _whole(self, key: str, default: Any, least: int) -> Any:
        return self._value(
            key, default, lambda value: type(value) is int and value >= least
        )

    def _variants(self) -> Iterator[Variant]:
        """The trains of all scenes, scenarios and misfires."""
        scenes = self._required("scene", lambda v: isinstance(v, str) or _texts(v))
        chosen = self._value("scenarios", [""], lambda v: v == "all" or _texts(v))
        misfires = self._value("misfires", [""], lambda v: v == "each" or _texts(v))
        for scene in [scenes] if isinstance(scenes, str) else scenes or []:
            try:
                whole = load_scene(self._beside(scene))
                every = ["", *whole.scenarios]
                for scenario in every if chosen == "all" else chosen:
                    train = whole.scenario(scenario) if scenario else whole
                    firing = train.topology.firing_cylinders
                    for cylinder in ["", *firing] if misfires == "each" else misfires:
                        changed = train.misfire(cylinder) if cylinder else train
                        yield Variant(scene, scenario, cylinder, changed)
            except SceneError as error:
                self.faults += error.sentences

    def _beside(self, name: str) -> str | Path:
        """The path of a file beside the study, or the name of a packaged scene."""
        path = self.file.parent / name
        return path if path.suffix or path.exists() else name

    def _speeds(self) -> np.ndarray:
        """Speeds in rpm ``(n,)``."""
        value = self._required("rpm", lambda v: isinstance(v, str) or _numbers(v))
        text = ",".join(map(str, value)) if isinstance(value, list) else value
        try:
            return np.array(read_speeds(text or "1"))
        except ValueError as error:
            self._fault(f"rpm: {error}.")
            return np.ones(1)

    def _quantities(self) -> Iterator[Objective]:
        """The quantities to keep."""
        for text in self._required("keep", _texts) or []:
            try:
                yield read_quantity(text)
            except ValueError as error:
                self._fault(f"keep: {error}")

    def _changes(self, train: DriveTrain | None) -> Iterator[Change]:
        """The [[change]] tables, each of one number or of several together, in the
        units of the fields of a train.
        """
        tables = self._value("change", [], lambda v: isinstance(v, list))
        for number, table in enumerate(tables, 1):
            where = f"[[change]] no. {number}"
            if not isinstance(table, dict):
                self._fault(f"{where} is {shown(table)}, must be a table.")
                continue
            for key in table:
                if key not in self.CHANGE_KEYS:
                    meant = suggestion(key, self.CHANGE_KEYS)
                    self._fault(f"{where}: unknown key {shown(key)}.{meant}")
            try:
                yield self._change(table, train)
            except ValueError as error:
                self._fault(f"{where}: {error}")

    def _change(self, table: Mapping[str, Any], train: DriveTrain | None) -> Change:
        """The Change of a table; a ValueError with a sentence where it is none."""
        names: Any = [table["name"]] if "name" in table else table.get("names")
        if not _texts(names):
            raise ValueError(
                'give name = "NAME.FIELD" with values, or names with rows.'
            )
        rows: Any = table.get("values" if "name" in table else "rows")
        if isinstance(rows, str) and "name" in table:
            _, rows = read_range(f"{names[0]}={rows}")
        elif isinstance(rows, str):
            table_file = rows
            try:
                text = read_text(self.file.parent / table_file)
            except Unreadable as error:
                raise ValueError(f"{table_file}: {error}") from None
            rows = [list(row) for row in number_rows(text, names, table_file)]
        if train is not None and isinstance(rows, list):
            rows = _in_si(train, names, rows)
        if "name" in table and _numbers(rows):
            rows = [[value] for value in rows]
        is_table = isinstance(rows, list) and all(map(_numbers, rows))
        if not (rows and is_table and all(len(row) == len(names) for row in rows)):
            raise ValueError(
                "give values, a list of numbers or A:B:COUNT, of one name, or rows of"
                " as many numbers as there are names, or the CSV file that has them."
            )
        return Change(tuple(names), np.array(rows, dtype=float))

    def _check(self, variant: Variant, study: Study) -> None:
        """Find what cannot be computed of a variant."""
        train = variant.train
        title = train.topology.title
        for quantity in study.keep:
            for sentence in objective_faults(train, quantity, len(study.rpm)):
                self.faults.append(f"{title}, {label(quantity)!r}: {sentence}")
        for change in study.changes:
            for row in change.rows:
                try:
                    train.replace(dict(zip(change.names, row.tolist(), strict=True)))
                except SceneError as error:
                    self.faults += error.sentences
        if study.samples:
            try:
                tolerances = read_tolerances(train)
            except SceneError as error:
                self.faults += error.sentences
                return
            for tolerance in tolerances:
                if not float(train.value(tolerance.name)):
                    self.faults.append(
                        f"{title}: the tolerance {tolerance.name!r} is of a value of 0,"
                        " which has no ratio: leave it out."
                    )


def _in_si(train: DriveTrain, names: list[str], rows: list[Any]) -> list[Any]:
    """Values of one name, or rows of values of several, those with units in the units
    of the fields; :class:`SceneError` where a unit does not fit.
    """
    if any(map(has_unit, rows)):
        return numbers_in_si(train, names[0], rows)
    return [
        [
            numbers_in_si(train, name, [value])[0] if has_unit(value) else value
            for name, value in zip(names, row, strict=True)
        ]
        if isinstance(row, list) and len(row) == len(names)
        else row
        for row in rows
    ]


def _texts(value: Any) -> bool:
    """Whether a value is a list of texts, at least one."""
    is_list = isinstance(value, list) and bool(value)
    return is_list and all(isinstance(entry, str) for entry in value)


def _numbers(value: Any) -> bool:
    """Whether a value is a list of numbers, at least one."""
    return isinstance(value, list) and bool(value) and all(map(number_like, value))
