"""Answers as workbooks: the rows of the CSV file, with all digits, formats and heads."""

import csv
import io

import numpy as np
import openpyxl
import pytest

from jaxhb.report.files.output import Sheet
from jaxhb.report.files.spreadsheets import as_workbook, number_format


def book_of(content):
    return openpyxl.load_workbook(io.BytesIO(b"".join(content)))


def test_a_table_is_a_sheet_with_all_digits_and_heads_that_stay_in_sight():
    numbers = np.random.default_rng(0).normal(size=(50, 2)) * [1e3, 1e-7]
    rows = [
        [*map(float, row), "contact", np.nan, True, k] for k, row in enumerate(numbers)
    ]
    heads = ["rpm", "torque N m", "motion", "stable", "known", "period"]
    sheet = book_of(as_workbook({"results": Sheet(heads, rows)}))["results"]
    read = list(sheet.iter_rows(values_only=True))
    assert list(read[0]) == heads
    assert [row[:2] for row in read[1:]] == [tuple(row) for row in numbers.tolist()]
    assert read[1][2:] == ("contact", None, True, 0)
    assert sheet.freeze_panes == "B2"
    assert sheet["A2"].number_format == "0.0"
    assert sheet["B2"].number_format == "0.0000E+00"


def test_texts_are_no_formulas():
    sheet = book_of(as_workbook({"a/b": Sheet(["=x"], [["=1+1"]])}))["a_b"]
    assert sheet["A1"].data_type == "s"
    assert sheet["A2"].value == "=1+1"


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([0.0], "0.0000"),
        ([99999.0, 0.1], "0"),
        ([100000.0], "0"),
        ([0.0012], "0.0000000"),
        ([2.0e9], "0.0000E+00"),
        (["contact", None], "0.0000"),
    ],
)
def test_the_largest_number_of_a_column_shows_five_digits(values, expected):
    assert number_format(values) == expected


def test_a_command_writes_the_rows_of_its_csv_file(run, tmp_path):
    run("campbell six_cylinder_diesel --rpm 600:2600", "csv", "xlsx")
    written = tmp_path / "xlsx.xlsx"
    heads, *rows = openpyxl.load_workbook(written)["results"].values
    with (tmp_path / "csv.csv").open() as file:
        csv_heads, *csv_rows = csv.reader(file)
    assert list(heads) == csv_heads
    cells = [["" if cell is None else cell for cell in row] for row in rows]
    texts = [
        [repr(cell) if isinstance(cell, float) else str(cell) for cell in row]
        for row in cells
    ]
    assert texts == csv_rows
    refused = run("forced spur_pair --rpm 900:1000:2 --xlsx rows.csv", status=2)
    assert "no workbook" in refused.err


def test_scenarios_are_sheets_of_one_workbook(run, tmp_path):
    scene = tmp_path / "plant.toml"
    run(f"new {scene}")
    text = scene.read_text()
    scene.write_text(
        f'{text}\n[scenario.cold]\n"coupling.stiffness" = 6e3\n'
        '[scenario.hot]\n"coupling.stiffness" = 4e3\n'
    )
    run(f"forced {scene} --rpm 900:1000:2 --scenario all", "xlsx")
    book = openpyxl.load_workbook(tmp_path / "xlsx.xlsx")
    assert {"cold", "hot"} <= {*book.sheetnames}
    first_rows = {name: list(book[name].values)[1] for name in ("cold", "hot")}
    assert first_rows["cold"] != first_rows["hot"]


def test_sheets_of_long_names_with_one_begin_are_told_apart():
    """Spreadsheet programs take 31 letters, and no capitals to tell names apart."""
    modes = (
        "a long name of a plant, misfire of 1",
        "a long name of a plant, misfire of 2",
    )
    table = Sheet(["x"], [(1.0,)])
    (content,) = as_workbook(dict.fromkeys((*modes, "Warm", "warm", ""), table))
    names = openpyxl.load_workbook(io.BytesIO(content)).sheetnames
    assert names == [
        "a long name of a plant, misfire",
        "a long name of a plant, mis 2",
        "Warm",
        "warm 2",
        "rows",
    ]
