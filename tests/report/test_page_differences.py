"""What the page says of two designs that differ."""

import pytest
from page_cases import SCENE

import jaxhb
from jaxhb.report.page.differences import differences
from jaxhb.scene.writer import elements_of

BURNING = """
[[cylinder]]
name = "three"
disk = "Kurbel"
bore = 0.1
stroke = 0.1
rod = 0.2
load = [[1000.0, 0.5], [3000.0, 1.0]]
combustion = { compression_ratio = 16.0, charge_pressure = 2e5, start = -5.0, duration = 60.0, imep = 1e6 }
"""
TWO = SCENE + BURNING
SOFT = ["soft: in one design only", "-", "ground", "-"]
TABLE = ["given", "given", "-"]
CHANGES = [
    ("stiffness = 2e4", "stiffness = 2.5e4", ["Welle.stiffness", "20000", "25000", "N m/rad"]),
    ("stiffness = 2e4", "stiffness = 20000.001", ["Welle.stiffness", "20000", "20000.001", "N m/rad"]),
    ("imep = 1e6", "imep = 0.0", ["three.combustion.imep", "1000000", "0", "Pa"]),
    ("rated_torque = 900.0", "", ["Kurbel|Räder.rated_torque", "900", "-", "N m"]),
    ("0.5], [3000.0", "0.6], [3000.0", ["load of three: another table", *TABLE]),
    ("load = [[1000.0, 0.5], [3000.0, 1.0]]", "", ["load of three: another table", "given", "-", "-"]),
    ('"two"', '"two"\nscale = [[500.0, 0.5], [1500.0, 1.0]]', ["scale of two: another table", "-", "given", "-"]),
    ("[1.0, 90.0, -5.0]", "[1.0, 91.0, -5.0]", ["gas_torque of one: another table", *TABLE]),
    ("[1.0, 90.0, -5.0]", "[1.5, 90.0, -5.0]", ["gas_torque of one: another table", *TABLE]),
    (", [1.0, 90.0, -5.0]", "", ["gas_torque of one: another table", *TABLE]),
    ("= 1e-4", '= 1e-4\ndamping_law = "always"', ["Kurbel|Räder.damping_law", "contact", "always", "-"]),
    ("load = [{", 'ground = [{ name = "soft", disk = "Bremse", stiffness = 10.0 }]\nload = [{', SOFT),
    ('disk = "Kurbel", inertia', 'disk = "Bremse", inertia', ["Dämpfer.disk", "Kurbel", "Bremse", "-"]),
    ("rated_rpm = 3000", "rated_rpm = 2000", ["scene.rated_rpm", "3000", "2000", "rpm"]),
]


def told(tmp_path, *texts):
    """What the page tells of two designs."""
    designs = []
    for text in texts:
        (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
        designs.append((jaxhb.load_scene(tmp_path / "scene.toml"), elements_of(tmp_path / "scene.toml")))
    return differences(*zip(*designs, strict=True))


@pytest.mark.parametrize(("before", "after", "row"), CHANGES, ids=[row[0] for *_, row in CHANGES])
def test_whatever_differs_between_two_designs_is_told(tmp_path, before, after, row):
    assert before in TWO
    (table,) = told(tmp_path, TWO, TWO.replace(before, after, 1))
    assert [list(cells) for cells in zip(*table.columns, strict=True)] == [row]


def test_nothing_differs_only_where_everything_is_equal(tmp_path):
    assert told(tmp_path, TWO, TWO.replace("Prüfstand", "Anlage"))[0].startswith("Nothing differs")
    one, two = BURNING.replace("three", "four"), BURNING
    (said,) = told(tmp_path, SCENE + one + two, SCENE + two + one)
    assert said.startswith(
        "Same numbers, tables and words of the elements, in another order or with other cylinder names"
    )
