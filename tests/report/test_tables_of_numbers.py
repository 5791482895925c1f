"""One entry makes a number appear in all outputs, and a format in all commands."""

from operator import attrgetter
from types import SimpleNamespace

import click
import pytest

import jaxhb
from jaxhb.cli import options
from jaxhb.report.compute import Asked, answer_one
from jaxhb.report.files.formats import FORMATS, Format, made
from jaxhb.report.files.numbers import answer_record, answer_row, labelled
from jaxhb.report.files.output import sheet
from jaxhb.report.text.cases import solve_text
from jaxhb.results.quantities import VARIABLES, Variable

MESH = "gear a|gear b"
ENTRY = Variable(
    name="tooth_force_root",
    element="mesh",
    unit="N",
    meaning="root mean square of the tooth force",
    reader="force",
    part=attrgetter("rms"),
    json="root",
    csv="root mean square",
    column="root kN",
)


def test_a_number_of_one_entry_stands_in_text_csv_json_and_netcdf(monkeypatch):
    pytest.importorskip("xarray")
    answer = answer_one(jaxhb.load_scene("spur_pair"), 2000.0, Asked())
    without = solve_text(answer)
    monkeypatch.setitem(VARIABLES, ENTRY.name, ENTRY)
    expected = float(answer.force(MESH).rms)
    (contact,) = (
        part for part in solve_text(answer).split("\n\n") if part.startswith("Contact")
    )
    _, heads, cells = contact.splitlines()
    assert "root kN" not in without
    assert "root kN" in heads
    assert f"{expected / 1e3:.3g}"[:4] in cells
    assert answer_row(answer)[f"{MESH} root mean square N"] == expected
    assert answer_record(answer)["meshes"][MESH]["root"] == expected
    data = labelled({"": [answer]}, None)
    assert data[ENTRY.name].sel(mesh=MESH).item() == expected
    assert data[ENTRY.name].attrs == {"long_name": ENTRY.meaning, "units": "N"}


def test_a_format_of_one_entry_is_an_option_and_is_written(monkeypatch):
    toy = Format(
        name="toy",
        metavar="FILE.toy",
        text="write toys",
        content="rows",
        write=lambda name, table: [f"{name}: {list(table.heads)}".encode()],
    )
    monkeypatch.setitem(FORMATS, toy.name, toy)
    command = click.command()(options.files("a picture")(lambda: None))
    assert ["--toy"] in [parameter.opts for parameter in command.params]
    arguments = SimpleNamespace(files={"toy": "a.toy"})
    assert made(arguments, {"rows": lambda: sheet([{"rpm": 1.0}])}) == {
        "a.toy": [b"a.toy: ['rpm']"]
    }
    assert made(arguments, {"record": dict}) == {}
