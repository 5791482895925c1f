"""Scenes in workbooks: bit-equal return, what people write into cells, and the sheet and
cell of every fault.
"""

import io
import json
import zipfile
from datetime import datetime

import numpy as np
import openpyxl
import pytest
from built_trains import same
from click.testing import CliRunner
from reference_data import DATA

import jaxhb
from jaxhb.cli.main import main, program
from jaxhb.elements.declared import fields_of_class
from jaxhb.elements.elements import TABLES
from jaxhb.elements.engine import Engine
from jaxhb.scene.files import find_scene, load_scene, parse, scene_names
from jaxhb.scene.workbook import grid
from jaxhb.scene.workbook.reading import workbook_content
from jaxhb.scene.workbook.writing import scene_workbook, workbook_bytes

EVENTS = str(DATA / "scenes" / "events.toml")
TEXTS = (
    *("crank", "cylinder A1", "=1+1", "#1", "1", "1.0", " a ", "a; b", '"q"', "[1]"),
    *(
        "1,5",
        "350 kg",
        "µ é 漢",
        "TRUE",
        "notes",
        "a\tb",
        "a\nb",
        "-",
        "'a",
        "@x",
        "x|y",
    ),
)


def texts(draw, count):
    return [TEXTS[k] for k in draw.integers(len(TEXTS), size=count)]


def number(draw):
    """A double with all its digits, a whole number, or one with a unit."""
    way = draw.integers(4)
    if way == 0:
        return int(draw.integers(-(2**60), 2**60))
    if way == 1:
        return f"{draw.normal():.6f} kg cm2"
    return float(draw.normal() * 10.0 ** draw.integers(-60, 60))


def value(draw, cls, field):
    """A value of the kind of a field; it need not be allowed."""
    kind = field.metadata["kind"]
    if kind == "rows":
        width = len(field.metadata["columns"])
        return [[number(draw) for _ in range(width)] for _ in range(draw.integers(4))]
    if kind == "tables":
        inner = field.metadata["of"]
        return [row(draw, inner, 0.6) for _ in range(draw.integers(1, 3))]
    if kind == "table":
        return row(draw, field.metadata["of"], 0.5)
    if kind == "pair":
        return texts(draw, 2)
    if kind == "numbers":
        return [number(draw) for _ in field.metadata["columns"]]
    if kind == "list":
        of_numbers = draw.random() < 0.5
        count = draw.integers(4)
        return (
            [number(draw) for _ in range(count)] if of_numbers else texts(draw, count)
        )
    if kind == "flag":
        return bool(draw.integers(2))
    if kind in ("number", "count", "shorthand"):
        several = cls is Engine and draw.random() < 0.3
        return [number(draw) for _ in range(3)] if several else number(draw)
    return texts(draw, 1)[0]


def row(draw, cls, share):
    """A table with a share of the keys of a class, at least one."""
    fields = list(fields_of_class(cls).values())
    keys = [field for field in fields if draw.random() < share] or fields[:1]
    return {field.name: value(draw, cls, field) for field in keys}


def content(draw):
    """Random content of a scene with rows of all tables."""
    tables = {
        table: [row(draw, cls, 0.4) for _ in range(draw.integers(1, 4))]
        for table, cls in TABLES.items()
    }
    tables["engine"] = row(draw, Engine, 0.5)
    tables["tolerance"] = {
        "a.stiffness": {"range": [number(draw), 4.5], "together": texts(draw, 2)},
        "b c.damping": {"share": 0.1},
    }
    tables["sequence"] = {"both": {"events": texts(draw, 2), "begin": number(draw)}}
    tables["scenario"] = {
        "hot": {"a.stiffness": number(draw), "without": texts(draw, 2)},
        "cold": {"b.harmonics": [[1.0, number(draw), 0.0]], "c.fires": False},
        "bare": {},
    }
    tables["tune"] = {
        "rpm": "800:2400:17",
        "steps": 12,
        "widths": [0.1, 0.01],
        "parameter": [{"name": "a.damping", "low": "20 N m s/rad", "high": 600.0}],
        "objective": [{"quantity": "tooth force", "of": "1"}],
    }
    tables["report"] = {"yard": "N; W", "hull": "123", "units": {"torque": "kN m"}}
    tables["parts"] = {"files": ["makers.toml", "a b.toml"]}
    tables["scene"] = {
        "name": "plant",
        "notes": ["one; two", "three."],
        "rated_rpm": number(draw),
    }
    return tables


def written(scene):
    """Content of a scene with keys in order, numbers in all digits and with types."""
    return json.dumps(scene, sort_keys=True)


@pytest.mark.parametrize("seed", range(6))
def test_random_content_returns_from_a_workbook_to_the_last_bit(seed, tmp_path):
    scene = content(np.random.default_rng(seed))
    errors = []
    back = workbook_content(workbook_bytes(scene, tmp_path), "plant.xlsx", errors)
    assert errors == []
    assert {*back} == {*scene}
    for table in scene:
        assert written(back[table]) == written(scene[table]), table


@pytest.mark.parametrize("name", [*scene_names(), EVENTS])
def test_a_scene_returns_from_a_workbook_as_the_same_train(name, tmp_path):
    path = tmp_path / "plant.xlsx"
    path.write_bytes(scene_workbook(name, called="plant"))
    assert same(load_scene(name), load_scene(path))
    assert load_scene(path).topology.name == "plant"
    # and from there as TOML, by the writer of files of other programs
    toml = tmp_path / "plant.toml"
    CliRunner().invoke(program, ["scene", str(path), "--out", str(toml)])
    assert same(load_scene(name), load_scene(toml))


def test_new_writes_a_sheet_for_every_kind_of_element_with_lists_and_examples(
    tmp_path, capsys
):
    path = tmp_path / "plant.xlsx"
    result = CliRunner().invoke(program, ["new", "--xlsx", str(path)])
    assert result.exit_code == 0
    book = openpyxl.load_workbook(path)
    tables = {"scene", *TABLES, "engine", "report", "parts"}
    assert {"notes", *tables} <= {*book.sheetnames}
    assert [cell.value for cell in book["parts"]["A"]] == ["key", "files", "# files"]
    shaft = book["shaft"]
    heads = [cell.value for cell in shaft[1]]
    assert heads[:3] == ["name", "from", "to"]
    assert "stiffness [N m/rad]" in heads
    assert "damping_over_rpm" in heads
    lists = {
        str(offered.sqref): offered.formula1
        for offered in shaft.data_validations.dataValidation
        if offered.type == "list"
    }
    assert lists["B2:B1000"] == "=disk!$A$2:$A$1000"
    offered = book["mesh"].data_validations.dataValidation
    assert '"external,internal"' in {each.formula1 for each in offered}
    # A kind that the scene does not have shows a row as a remark.
    assert book["ground"]["A2"].value.startswith("#")
    assert shaft.freeze_panes == "B2"
    assert main(["new", "--xlsx", str(path)]) == 2
    assert "is there already" in capsys.readouterr().err
    both = ["new", str(tmp_path / "a.toml"), "--xlsx", str(tmp_path / "a.xlsx")]
    assert main(both) == 2
    assert "give one of them" in capsys.readouterr().err


def test_files_of_parts_stay_beside_the_workbook(tmp_path, capsys):
    plant = tmp_path / "plant"
    plant.mkdir()
    (tmp_path / "makers.toml").write_text(
        '[coupling."X 3100"]\nstiffness = 2.1e4\ndamping = 20.0\n'
    )
    scene = plant / "plant.toml"
    scene.write_text(
        '[parts]\nfiles = ["../makers.toml"]\n'
        '[[disk]]\nname = "a"\ninertia = 1.0\n[[disk]]\nname = "b"\ninertia = 2.0\n'
        '[[shaft]]\nbetween = ["a", "b"]\npart = "X 3100"\n[[load]]\ndisk = "b"\n'
    )
    elsewhere = tmp_path / "x" / "y"
    elsewhere.mkdir(parents=True)
    path = elsewhere / "plant.xlsx"
    assert main(["new", "--xlsx", str(path), "--from", str(scene)]) == 0
    assert "makers.toml is written" in capsys.readouterr().out
    assert same(load_scene(path), load_scene(scene))


def test_emptied_sheets_make_no_table(tmp_path):
    emptied = {
        "tune": [["key", "value"], ["rpm"]],
        "tune.parameter": [["name", "low", "high"]],
        "tune.objective": [["quantity", "of"]],
        "report": [["key", "value"], ["yard"], ["# yard", "Nordwerft"]],
        "parts": [["key", "value"], ["files"]],
    }
    path = tmp_path / "plant.xlsx"
    book_of(plant(**emptied)).save(path)
    content = workbook_content(path.read_bytes(), path.name, [])
    assert not {"tune", "report", "parts"} & {*content}


def book_of(sheets):
    """A workbook of rows by sheets."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for cells in rows:
            sheet.append(cells)
    return book


def plant(**changes):
    """Sheets of a small train."""
    return {
        "scene": [["key", "value"], ["reference", "a"], ["rated_rpm [rpm]", 1500]],
        "disk": [["name", "inertia [kg m2]", "damping"], ["a", 1.5], ["b", 2.5, 0.5]],
        "shaft": [["from", "to", "stiffness [N m/rad]"], ["a", "b", 1e5]],
        "torque": [["disk", "mean [N m]", "harmonics"], ["a", 10, "pulses"]],
        "load": [["disk"], ["b"]],
        "pulses": [["order", "Re [N m]", "Im [N m]"], [0.5, 3, 0], [1, 2, 1]],
    } | changes


def loaded(tmp_path, book):
    path = tmp_path / "plant.xlsx"
    if isinstance(book, dict):
        book = book_of(book)
    book.save(path)
    return load_scene(path)


def refused(tmp_path, book):
    with pytest.raises(jaxhb.SceneError) as refusal:
        loaded(tmp_path, book)
    return str(refusal.value).splitlines()


def test_cells_as_people_write_them_mean_the_same(tmp_path):
    expected = loaded(tmp_path, plant())
    disks = [
        ["Name", "inertia [kg cm2]", None, "# from the drawing", "damping"],
        ["a", 15000, None, "sheet 3"],
        [],
        ["# not built", 1e9],
        ["b ", "2,5 kg m2", None, 7, "0.5"],
    ]
    shaft = [["to", "from", "stiffness [kN m/rad]"], ["b", "a", 100]]
    torque = [["disk", "mean", "harmonics"], ["a", "10", "[[0.5, 3, 0], [1, 2, 1]]"]]
    for sheets in (
        {"disk": disks},
        {"shaft": shaft},
        {"torque": torque, "pulses": []},
        {"#old": [["x"]], "empty": [], "notes": [["of the plant"]]},
        {"torque": [["disk", "mean", "harmonics"], ["a", 10, "Pulses"]]},
        {"pulses": [["Im", "Re [kN m]", "order"], [0, 0.003, "0,5"], [1, 0.002, 1]]},
        {"pulses": [[0.5, "3 N m", 0], ["1", 2, 1]]},
    ):
        assert same(loaded(tmp_path, plant(**sheets)), expected), sheets


def test_a_head_gives_its_unit_to_all_numbers_below_it(tmp_path):
    """In lists in the notation of JSON, and in tables whose keys are not declared."""
    pistons = ["disks", "cylinders", "firing_order", "reciprocating_mass [g]"]
    engine = {"bore": 0.1, "stroke": 0.1, "rod": 0.2, "gas_torque_mean": 1.0}
    for masses in ("[2000, 3000]", "2000; 3000"):
        rows = [[*pistons, *engine], ["a; b", 2, "1; 2", masses, *engine.values()]]
        train = loaded(tmp_path, plant(engine=rows))
        assert train.cylinders.reciprocating_mass.tolist() == [2.0, 3.0], masses
    low = {
        "tune": [["key", "value"], ["rpm", "800:2200:15"]],
        "tune.parameter": [["name", "low [kN m/rad]", "high"], ["a|b.stiffness", 1, 4]],
        "tune.objective": [["quantity", "of"], ["torque", "a|b"]],
    }
    (parameter,) = loaded(tmp_path, plant(**low)).tune["parameter"]
    assert (parameter["low"], parameter["high"]) == ("1 kN m/rad", 4)


def test_merged_cells_of_a_column_hold_for_all_their_rows(tmp_path):
    book = book_of(plant(disk=[["name", "inertia"], ["a", 2.5], ["b"]]))
    book["disk"].merge_cells("B2:B3")
    train = loaded(tmp_path, book)
    assert train.value("b.inertia") == 2.5
    book["disk"].unmerge_cells("B2:B3")
    book["disk"].merge_cells("A2:B2")
    (line, *_) = refused(tmp_path, book)
    assert "sheet disk, cell A2: cells A2:B2 with 'a' are merged over several" in line


def with_cached_formulas(book, values):
    """Bytes of a workbook whose formulas have values, as spreadsheet programs save
    them.
    """
    stream = io.BytesIO()
    book.save(stream)
    out = io.BytesIO()
    with zipfile.ZipFile(stream) as parts, zipfile.ZipFile(out, "w") as written_parts:
        for part in parts.namelist():
            text = parts.read(part)
            for formula, number in values.items():
                text = text.replace(
                    f"<f>{formula}</f><v />".encode(),
                    f"<f>{formula}</f><v>{number}</v>".encode(),
                ).replace(
                    f"<f>{formula}</f><v/>".encode(),
                    f"<f>{formula}</f><v>{number}</v>".encode(),
                )
            written_parts.writestr(part, text)
    return out.getvalue()


def test_formulas_have_the_values_that_are_saved_with_them(tmp_path):
    book = book_of(plant(disk=[["name", "inertia"], ["a", "=1+0.5"], ["b", 2.5]]))
    path = tmp_path / "plant.xlsx"
    path.write_bytes(with_cached_formulas(book, {"1+0.5": 1.5}))
    assert load_scene(path).value("a.inertia") == 1.5
    (line,) = refused(tmp_path, book)
    assert line.startswith("plant.xlsx, sheet disk, cell B2: its formula has no value")


FAULTS = {
    "stiffness below 0": (
        {"shaft": [["from", "to", "stiffness"], ["a", "b", -5]]},
        "plant.xlsx, sheet shaft, cell C2: stiffness is -5 N m/rad, must be greater"
        " than 0 N m/rad.",
    ),
    "unit that does not fit": (
        {"shaft": [["from", "to", "stiffness"], ["a", "b", "5 kN m s"]]},
        "sheet shaft, cell C2: stiffness is '5 kN m s', must be in N m/rad",
    ),
    "unit of a head that does not fit": (
        {"shaft": [["from", "to", "stiffness [bar]"], ["a", "b", 5]]},
        "sheet shaft, cell C2: stiffness is '5 bar', must be in N m/rad",
    ),
    "unknown disk": (
        {"shaft": [["from", "to", "stiffness"], ["a", "c", 1e5]]},
        "sheet shaft, cell B2: there is no disk 'c'.",
    ),
    "unknown key": (
        {"shaft": [["from", "to", "stifness"], ["a", "b", 1e5]]},
        "sheet shaft, cell C1: unknown key 'stifness'. Did you mean 'stiffness'?",
    ),
    "missing value": (
        {"disk": [["name", "inertia"], ["a", 1.5], [None, 2.5]]},
        "sheet disk, cell A3: the key 'name' is missing.",
    ),
    "several marks": (
        {"disk": [["name", "inertia"], ["a", "1.200,5"], ["b", 2.5]]},
        "sheet disk, cell B2: '1.200,5' has several marks.",
    ),
    "doubtful comma": (
        {"disk": [["name", "inertia"], ["a", "1,200"], ["b", 2.5]]},
        "sheet disk, cell B2: '1,200' may have decimals or thousands",
    ),
    "no number": (
        {"disk": [["name", "inertia"], ["a", "heavy"], ["b", 2.5]]},
        "sheet disk, cell B2 'a': inertia is 'heavy', must be a number in kg m2.",
    ),
    "head twice": (
        {"disk": [["name", "inertia", "inertia"], ["a", 1.5, 1], ["b", 2.5, 1]]},
        "sheet disk, cell C1: the head 'inertia' is there twice.",
    ),
    "no head": (
        {"disk": [["name", "inertia"], ["a", 1.5], ["b", 2.5, 7.0]]},
        "sheet disk, cell C3: its column has no head.",
    ),
    "unknown sheet of rows": (
        {"torque": [["disk", "mean", "harmonics"], ["a", 10, "pulse"]]},
        "sheet torque, cell C2: there is no sheet 'pulse'. Did you mean 'pulses'?",
    ),
    "sheet that nothing names": (
        {"torque": [["disk", "mean"], ["a", 10]]},
        "plant.xlsx, sheet pulses: it is no table, and no cell names it.",
    ),
    "unknown table": ({"damper s": [["name"], ["x"]]}, "unknown table 'damper s'"),
    "row of rows": (
        {"pulses": [["order", "Re", "Im"], [0.5, 3, 0], [-1, 2, 1]]},
        "sheet pulses, row 3: harmonics, row 2: order is -1, must be greater than 0.",
    ),
    "empty cell of rows": (
        {"pulses": [["order", "Re", "Im"], [0.5, 3, 0], [1, None, 1]]},
        "sheet pulses, cell B3: the Re of the row is missing.",
    ),
    "column of rows": (
        {"pulses": [["order", "Re"], [0.5, 3]]},
        "sheet pulses: the column 'Im' is missing.",
    ),
    "setting": (
        {"scene": [["key", "value"], ["reference", "c"]]},
        "sheet scene, cell B2: ",
    ),
    "scenario": (
        {"scenario": [["key", "hot"], ["x.stiffness", 5]]},
        "sheet scenario, cell B2: there is no element 'x'",
    ),
    "key of a scenario twice": (
        {"scenario": [["key", "hot"], ["a|b.stiffness", 5], ["a|b.stiffness", 6]]},
        "sheet scenario, cell A3: 'a|b.stiffness' is there twice. Keep one.",
    ),
    "scenario twice": (
        {"scenario": [["key", "hot", "hot"], ["a|b.stiffness", 5, 6]]},
        "sheet scenario, cell C1: 'hot' is there twice. Keep one.",
    ),
    "scenario without key": (
        {"scenario": [["key", "hot"], ["a|b.stiffness", 5], [None, 6]]},
        "sheet scenario, cell A3: the key of the row is missing.",
    ),
    "number of a scenario": (
        {"scenario": [["key", "hot"], ["a|b.stiffness", "soft"]]},
        "sheet scenario, cell B2: 'a|b': stiffness is 'soft'",
    ),
    "setting twice": (
        {"scene": [["key", "value"], ["rated_rpm", 1500], ["rated_rpm [Hz]", 20]]},
        "sheet scene, cell A3: 'rated_rpm' is there twice. Keep one.",
    ),
    "unknown key of parts": (
        {"parts": [["key", "value"], ["file", "makers.toml"]]},
        "sheet parts, cell B2: unknown key 'file'. Did you mean 'files'?",
    ),
    "no picture": (
        {"report": [["key", "value"], ["yard", "N"], ["logo", "a.txt"]]},
        "sheet report, cell B3: logo 'a.txt' is no picture.",
    ),
    "unit of rows": (
        {"torque": [["disk", "harmonics [kN m]"], ["a", "[[0.5, 3, 0]]"]]},
        "sheet torque, cell B1: the head names the unit 'kN m', and harmonics has",
    ),
    "more columns of rows": (
        {"pulses": [[1, 0.5, 3, 0], [2, 1, 2, 1]]},
        "sheet pulses, cell D1: rows have the columns order, Re, Im, and there are",
    ),
    "date": (
        {
            "disk": [
                ["name", "inertia"],
                ["a", datetime(2026, 5, 1)],
                ["b", 2.5],
            ]
        },
        "sheet disk, cell B2: it holds a date or a time.",
    ),
    "error": (
        {"disk": [["name", "inertia"], ["a", "#REF!"], ["b", 2.5]]},
        "sheet disk, cell B2: it holds the error #REF!.",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_names_its_sheet_and_cell(fault, tmp_path):
    sheets, sentence = FAULTS[fault]
    lines = refused(tmp_path, plant(**sheets))
    assert any(sentence in line for line in lines), lines
    assert len(lines) <= 3, lines


def test_what_is_no_workbook_is_refused_in_a_sentence(tmp_path, monkeypatch):
    path = tmp_path / "plant.xlsx"
    path.write_bytes(b"PK no workbook")
    with pytest.raises(jaxhb.SceneError, match="no workbook that can be read"):
        load_scene(path)
    whole = scene_workbook("spur_pair")
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(jaxhb.SceneError, match="no workbook that can be read"):
        load_scene(path)
    path.write_bytes(whole)
    monkeypatch.setattr(grid, "MOST_UNPACKED", 1000)
    with pytest.raises(jaxhb.SceneError, match="unpacks to"):
        load_scene(path)
    monkeypatch.setattr(grid, "MOST_CELLS", 10)
    monkeypatch.setattr(grid, "MOST_UNPACKED", 10**9)
    with pytest.raises(jaxhb.SceneError, match="must have at most 10"):
        load_scene(path)
    monkeypatch.setattr(grid, "has_library", lambda: False)
    with pytest.raises(jaxhb.SceneError, match=r"pip install \"jaxhb\[spreadsheet\]\""):
        load_scene(path)


def test_csv_rows_of_a_scene_come_on_sheets_that_elements_share(tmp_path):
    book = openpyxl.load_workbook(io.BytesIO(scene_workbook("six_cylinder_diesel")))
    cells = {row[0].value for row in book["cylinder"].iter_rows(min_row=2)}
    assert len(cells) == 6
    assert "six_cylinder_diesel_pressure" in book.sheetnames
    named = parse(find_scene("six_cylinder_diesel"), [])["cylinder"][0]["pressure"]
    assert named == "six_cylinder_diesel_pressure.csv"


CELLS = (
    *(0, -1, 1e300, 1e-300, 1.5, "x", "crank", "=1+1", "a" * 3000, True, None, "é"),
    *("[]", "[[]]", '[[1, 2], ["a", 3]]', '{"a": 1}', "1,5", "1.2,3", "5 bar", "#x"),
)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["first_scene", "inline_four_timing_drive", EVENTS])
def test_a_mutated_workbook_is_read_or_refused_in_a_few_short_sentences(name, tmp_path):
    whole = scene_workbook(name)
    path = tmp_path / "changed.xlsx"
    refusals = 0
    for seed in range(12):
        draw = np.random.default_rng(seed)
        book = openpyxl.load_workbook(io.BytesIO(whole))
        sheet = book.worksheets[draw.integers(1, len(book.worksheets))]
        filled = [c for row in sheet.iter_rows() for c in row if c.value is not None]
        cell = filled[draw.integers(len(filled))]
        cell.hyperlink = None
        cell.value = CELLS[draw.integers(len(CELLS))]
        book.save(path)
        try:
            jaxhb.plausibility(load_scene(path))
        except jaxhb.SceneError as error:
            refusals += 1
            lines = str(error).splitlines()
            assert len(lines) <= 13, seed
            assert all(len(line) <= 1000 for line in lines), seed
            assert "sheet" in lines[0] or "sequence" in lines[0], lines
    assert refusals >= 4
