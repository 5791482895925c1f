"""The page of a report: one HTML file without a network, to be printed and signed. The only importer of plotly and
jinja2."""

import json

from jaxhb.report.page.cycle import cycle_part
from jaxhb.report.page.judgement import bounds_part, notes_part, result_part
from jaxhb.report.page.limits import limits_part
from jaxhb.report.page.linear import campbell_part, forced_part, modes_part
from jaxhb.report.page.motion import forces_part, gears_part, map_part, power_part, shafts_part
from jaxhb.report.page.parts import Heading, parts_of
from jaxhb.report.page.second import second_part
from jaxhb.report.page.train import assumptions_part, train_part

PARTS = {
    "Result": result_part,
    "Train and data": train_part,
    "Assumptions and versions": assumptions_part,
    "Natural frequencies": modes_part,
    "Campbell diagram and critical speeds": campbell_part,
    "Linear forced response": forced_part,
    "Motion over the speed": map_part,
    "Tooth forces": forces_part,
    "Torques of gears": gears_part,
    "Torques of shafts and dampers": shafts_part,
    "Heat of dampers": power_part,
    "One speed in full": cycle_part,
    "Limits": limits_part,
    "Second design": second_part,
    "Accuracy and computed bounds": bounds_part,
    "Notes": notes_part,
}
"""Functions that make the parts of the page, by their titles, in its order."""

ROWS = 150
"""Rows of a table that are shown."""


def as_page(report):
    """The page of a :class:`Report` as the bytes of a file, and whether every part of it could be made."""
    parts = parts_of(report, PARTS)
    return [page_text(report.name, parts, report).encode()], not any(part.failed for part in parts)


def page_text(name, parts, report):
    """HTML of parts.

    Parameters
    ----------
    name : str, of the scene
    parts : list of Part
    report : Report

    Returns
    -------
    str
        Scripts, styles and numbers are inside; nothing is loaded when it is opened.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from plotly.offline import get_plotlyjs

    environment = Environment(
        loader=PackageLoader(__package__, "."), autoescape=True, trim_blocks=True, undefined=StrictUndefined
    )
    environment.filters |= {"figure": _figure_json, "rows": _rows, "words": _words, "kind": _kind, "css": _css_text}
    return environment.get_template("page.html").render(
        name=name, parts=parts, report=report, script=get_plotlyjs(), most=ROWS
    )


def _kind(block):
    """Which branch of the template shows a block."""
    if isinstance(block, Heading):
        return "heading"
    kinds = {"heads": "table", "traces": "figure", "svg": "picture"}
    return next((kind for attribute, kind in kinds.items() if hasattr(block, attribute)), "words")


def _rows(table):
    """Rows of a table, as many as are shown."""
    return list(zip(*table.columns, strict=True))[:ROWS]


def _words(table):
    """Numbers of the columns that hold words, which stand at the left."""
    columns = enumerate(table.columns)
    return {0, *table.left, *(i for i, column in columns if any(cell[:1].isalpha() for cell in column))}


def _figure_json(figure):
    """A figure inside a script element: nothing in it ends the element."""
    text = json.dumps({"data": figure.traces, "layout": figure.layout}, allow_nan=False, ensure_ascii=False)
    return text.replace("<", "\\u003c")


def _css_text(text):
    """A text inside quotes in a style sheet."""
    return "".join(char if char.isalnum() or char in " .,-()" else f"\\{ord(char):x} " for char in text)
