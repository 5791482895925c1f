"""Which rules a scene chooses: names of rules that jaxhb has, and files of users."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from jaxhb.elements.rules import RULES
from jaxhb.elements.rules.margins import MARGINS
from jaxhb.elements.rules.rule import Rule
from jaxhb.elements.rules.written import rule_of
from jaxhb.elements.sentences import SceneError, shown, suggestion

GEARS = "gears"
"""Vibratory torque of meshes within a third of the rated torque, and no reversal: usual
in rules of classes, to be checked against their current texts.
"""

DEFAULT = ("M68", GEARS)
"""Rules of a scene that chooses none."""


@dataclass(frozen=True)
class File:
    """A file with a rule: its name and its text."""

    name: str
    text: str


@dataclass(frozen=True)
class Chosen:
    """Names of chosen rules in their order, and the files among them."""

    names: tuple[str, ...] = DEFAULT
    files: tuple[File, ...] = ()

    @property
    def rules(self) -> dict[str, Rule]:
        """Rules of shafts by name, those of jaxhb and of the files."""
        return _rules_with(self.files)

    @property
    def default(self) -> str:
        """Name of the rule of shafts that name none: the first one for shafts."""
        return next((name for name in self.names if name in self.rules), DEFAULT[0])

    def with_first(self, others: Chosen) -> Chosen:
        """Put others before these."""
        names = dict.fromkeys([*others.names, *self.names])
        files = {file.name: file for file in (*self.files, *others.files)}
        return Chosen(tuple(names), tuple(files.values()))


@cache
def _rules_with(files: tuple[File, ...]) -> dict[str, Rule]:
    """The rules of jaxhb and those of files, by name."""
    written = [rule_of(file.text, file.name) for file in files]
    return RULES | {rule.name: rule for rule in written}


def choose(entries: Sequence[str | File]) -> Chosen:
    """Choose rules by their names and :class:`File` objects; :class:`SceneError` with a
    sentence for each fault.

    >>> choose(["KR generator shaft", "gears"]).default
    'KR generator shaft'
    """
    errors: list[str] = []
    names: list[str] = []
    files: list[File] = []
    known = [*RULES, GEARS, *MARGINS]
    for entry in entries:
        if isinstance(entry, File):
            try:
                name = rule_of(entry.text, entry.name).name
            except SceneError as error:
                errors += error.sentences
                continue
            if name in (*known, *names):
                errors.append(
                    f"{entry.name}: the name {shown(name)} is that of another rule."
                    " Rename it."
                )
            names.append(name)
            files.append(entry)
        elif entry in known:
            names.append(entry)
        else:
            errors.append(f"there is no rule {shown(entry)}.{suggestion(entry, known)}")
    if errors:
        raise SceneError(errors)
    return Chosen(tuple(dict.fromkeys(names)), tuple(files))


STRENGTH_KEYS = {
    "diameter": "diameter (or outer) in m",
    "stress_concentration": (
        "stress_concentration (C_K of the form, 1 for an integral flange, less"
        " otherwise)"
    ),
    "tensile_strength": "tensile_strength in Pa",
    "yield_strength": "yield_strength in Pa",
    "nominal_torque": "nominal_torque in N m",
}
"""Keys of a shaft that rules need, in words."""


def lacking(rule: Rule, present: Collection[str]) -> list[str]:
    """Keys that a rule needs and that a shaft with keys ``present`` lacks."""
    keys: list[Any] = [key for key in rule.needs if key not in present]
    return [key for key in keys if key != "diameter" or "outer" not in present]
