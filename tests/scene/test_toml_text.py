"""Scenes that are written back stay the user's: comments, order and digits stay, and
only changed values change.
"""

import dataclasses
import difflib
import tomllib

import pytest
from reference_data import PACKAGED, text_of

from jaxhb.cli.main import main
from jaxhb.design.tolerances import _entries
from jaxhb.elements.engine import cylinder_rows
from jaxhb.scene.files import load_scene, scene_names
from jaxhb.scene.toml_text import TomlText
from jaxhb.scene.writer import changed_scene, scene_text

MIXED = text_of("pump_drive.toml").removesuffix("\n")


@pytest.fixture
def mixed(tmp_path):
    path = tmp_path / "mixed.toml"
    path.write_text(MIXED, encoding="utf-8")
    return path


def changes(before, after):
    """Lines that went and lines that came."""
    lines = list(difflib.ndiff(before.splitlines(), after.splitlines()))
    gone = [line[2:] for line in lines if line[0] == "-"]
    new = [line[2:] for line in lines if line[0] == "+"]
    return gone, new


def test_only_the_lines_of_changed_values_change(mixed):
    values = {
        ("disk", 0, "inertia"): 0.131,
        ("disk", 1, "inertia"): 1.25,
        ("disk", 2, "inertia"): 0.05,
        ("shaft", 0, "damping"): 30.5,
        ("mesh", 0, "backlash"): 1.2345678901234567e-4,
    }
    text, _ = changed_scene(mixed, values, remark="mixed, tuned.")
    assert text == text_of("pump_drive_changed.toml").removesuffix("\n")
    read = tomllib.loads(text)
    for (table, row, field), value in values.items():
        assert read[table][row][field] == value


def test_a_scene_is_written_as_it_is_but_for_its_name(mixed):
    text, _ = scene_text(mixed)
    assert changes(MIXED, text) == ([], ['name = "mixed"'])
    renamed, _ = scene_text("spur_pair", called="my pair")
    original = (PACKAGED / "spur_pair.toml").read_text()
    assert changes(original, renamed) == (
        ['name = "spur_pair"'],
        ['name = "my pair"'],
    )


@pytest.mark.parametrize("name", scene_names())
def test_a_packaged_scene_is_written_byte_for_byte(name):
    original = (PACKAGED / f"{name}.toml").read_text(encoding="utf-8")
    assert scene_text(name)[0] == original
    assert changed_scene(name, {})[0] == original


def test_the_line_ends_of_the_user_stay(tmp_path, capsys):
    named = MIXED.replace("[scene]", '[scene]\nname = "mixed"')
    path = tmp_path / "mixed.toml"
    written = tmp_path / "out.toml"
    path.write_bytes(named.replace("\n", "\r\n").encode())
    assert main(["scene", str(path), "--out", str(written)]) == 0
    assert written.read_bytes() == path.read_bytes()
    values = {("disk", 0, "inertia"): 0.131, ("shaft", 0, "damping"): 30.5}
    changed, _ = changed_scene(path, values, remark="tuned.")
    renamed, _ = scene_text(path, expand=True, called="it")
    for output in (changed, renamed):
        assert output.count("\n") == output.count("\r\n") > 40
        assert tomllib.loads(output)
    expected = changed_scene_of(named, tmp_path, values)
    assert changed.replace("\r\n", "\n") == expected
    assert main(["scene", str(path)]) == 0
    assert "\r" not in capsys.readouterr().out


def changed_scene_of(text, folder, values):
    (folder / "lf.toml").write_bytes(text.encode())
    return changed_scene(folder / "lf.toml", values, remark="tuned.")[0]


def test_an_expanded_engine_stands_where_the_engine_was(mixed):
    text, _ = scene_text(mixed, expand=True)
    gone, new = changes(MIXED, text)
    engine = MIXED[MIXED.index("[engine]") : MIXED.index("# what may change")]
    assert [line for line in gone if line] == [
        line for line in engine.splitlines() if line not in text.splitlines()
    ]
    read = tomllib.loads(text)
    rows = cylinder_rows(tomllib.loads(MIXED)["engine"])
    assert read["cylinder"] == rows
    assert "engine" not in read
    cylinders_at = text.index("# the two cylinders\n[[cylinder]]")
    assert cylinders_at < text.index("# what may change\n[tune]")


def test_a_value_of_the_combustion_of_a_cylinder_is_found_behind_its_head(mixed):
    text, _ = changed_scene(mixed, {("cylinder", 1, "combustion.start"): -3.5})
    first, second = tomllib.loads(text)["cylinder"]
    assert first["combustion"]["start"] == -5.0
    assert second["combustion"]["start"] == -3.5
    key = "cylinder 2.combustion.start"
    train = load_scene(mixed).replace({key: -3.5})
    mixed.write_text(text, encoding="utf-8")
    assert load_scene(mixed).value(key) == train.value(key)


def test_cylinders_of_an_engine_come_behind_those_of_the_scene():
    text = TomlText('[engine]\nx = 1\n# a\n[[cylinder]]\nname = "own"\n# b\n[tune]\n')
    text.append("cylinder", [{"name": "made"}])
    text.replace("engine", "cylinder", [])
    assert (
        str(text) == '# a\n[[cylinder]]\nname = "own"\n\n[[cylinder]]\nname = "made"\n#'
        " b\n[tune]\n"
    )


def test_a_scene_of_lists_above_all_heads_can_be_written_and_expanded(tmp_path):
    text = text_of("inline.toml")
    path = tmp_path / "inline.toml"
    out = tmp_path / "out.toml"
    for content in (
        text,
        text + "\n# the torque\n[[torque]]\ndisk = 'a'\n",
        text.replace("cylinder =", "#"),
    ):
        path.write_text(content)
        for expand in (False, True):
            out.write_text(scene_text(path, expand=expand)[0])
            train = load_scene(out)
            topology = dataclasses.replace(load_scene(path).topology, name="inline")
            assert train.topology == topology
            assert train.torques.mean.shape == (content.count("[[torque]]"),)
            assert out.read_text().startswith("# by hand\ndisk = [{name")
            assert expand != ("engine =" in out.read_text())
            means = [5.0] if "# [" in content else [2.0, 5.0]
            assert train.cylinders.gas_torque_mean.tolist() == means


def test_a_law_by_name_gives_way_to_its_numbers(mixed):
    text, _ = changed_scene(mixed, {("mesh", 0, "epsilon"): 0.01})
    assert changes(MIXED, text) == (
        ['law = "fridman2009"     # (18)'],
        ["epsilon = 0.01", "transition = 0.2"],
    )


def test_an_added_value_stands_below_a_comment_that_ends_the_file():
    text = TomlText("[[disk]]\nx = 1\n# the end")
    text.set("disk", 0, "y", 2)
    assert tomllib.loads(str(text)) == {"disk": [{"x": 1, "y": 2}]}
    assert "# the end\n" in str(text)


@pytest.mark.parametrize(
    "written",
    [
        '[tolerance]\n"a.b" = { std = 1.0 } # of the maker\n"c d.e" = { share = 0.1 }\n',
        '[tolerance]\na.b = { std = 1.0 }\n"c d".e = { share = 0.1 }\n',
        "[tolerance]\na.b.std = 1.0\n'c d'.e.share = 0.1\n",
        '[tolerance."a.b"]\nstd = 1.0\n# next\n[tolerance."c d.e"]\nshare = 0.1\n',
        '[tolerance.a.b]\nstd = 1.0\n[tolerance."c d".e]\nshare = 0.1\n',
        'tolerance = { "a.b" = { std = 1.0 }, "c d.e" = { share = 0.1 } }\n',
        "",
    ],
)
def test_entries_are_put_in_the_place_of_those_of_their_names(written):
    """However their names are written, beside new ones."""
    text = TomlText(f"{written}[[disk]]\nname = 'a' # a disk\n")
    entries = {"a.b": {"range": [1.0, 2.0]}, "c d.e": {"std": 3.0}}
    text.merge("tolerance", entries | {"f.g": {"share": 0.5}})
    content = tomllib.loads(str(text))
    assert content.pop("disk") == [{"name": "a"}]
    assert "name = 'a' # a disk" in str(text)
    named = list(_entries(content["tolerance"]))
    assert len(named) == 3
    assert dict(named) == entries | {"f.g": {"share": 0.5}}


def test_heads_inside_values_are_none():
    text = TomlText('a = """\n[[disk]]\n"""\nb = [\n[1],\n[2]\n]\n[[disk]]\nc = 1\n')
    text.set("disk", 0, "c", 2)
    assert str(text) == 'a = """\n[[disk]]\n"""\nb = [\n[1],\n[2]\n]\n[[disk]]\nc = 2\n'


@pytest.mark.parametrize(
    "written, value, expected",
    [("3.50", 3.5, "3.50"), ("200", 214.5, "214.5"), ("7", 8, "8")],
)
def test_a_number_stays_as_written_or_has_all_its_digits(written, value, expected):
    text = TomlText(f"[[disk]]\nx = {written} # why\n")
    text.set("disk", 0, "x", value)
    assert str(text) == f"[[disk]]\nx = {expected} # why\n"
