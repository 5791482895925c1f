"""Units in files: engines, CSV files, copies of scenes, tunings and studies."""

import numpy as np
import pytest

import jaxhb
from jaxhb.design.table import read_table
from jaxhb.elements.sentences import SceneError
from jaxhb.scene.writer import changed_scene, elements_of, scene_text
from jaxhb.studies.study import load_study

ENGINE = """
[scene]
revolutions_per_cycle = 2
rated_rpm = 1500
reference = "flywheel"

[[disk]]
name = "crank"
inertia = {inertia}     # of all webs

[[disk]]
name = "flywheel"
inertia = 30.0

[[shaft]]
between = ["crank", "flywheel"]
stiffness = {stiffness}
damping = 10.0

[[engine]]
name = "engine"
cylinders = 2
disks = ["crank", "crank"]
firing_order = [1, 2]
firing_intervals = {intervals}
firing_angle = {angle}
bore = {bore}
stroke = 0.15
rod = 0.27
reciprocating_mass = {masses}
ambient_pressure = {ambient}

[engine.combustion]
compression_ratio = 15
charge_pressure = {charge}
start = -8.0
duration = 60.0
imep = {imep}

[[load]]
disk = "flywheel"

[tune]
rpm = {speeds}
tolerance = {tolerance}

[[tune.parameter]]
name = "crank|flywheel.stiffness"
low = {low}
high = 9e6

[[tune.objective]]
quantity = "shaft torque"
of = "crank|flywheel"

[[tune.penalty]]
quantity = "inertia added"
most = {most}
"""
PLAIN = {
    "inertia": "0.5",
    "stiffness": "4e6",
    "intervals": "[340.0, 380.0]",
    "angle": "30.0",
    "bore": "0.135",
    "masses": "[4.3, 4.4]",
    "ambient": "1e5",
    "charge": "2.2e5",
    "imep": "18e5",
    "speeds": "[600.0, 1200.0]",
    "tolerance": "0.01",
    "low": "1e6",
    "most": "0.2",
}
WRITTEN = {
    "inertia": '"5000 kg cm2"',
    "stiffness": '"4 MN m/rad"',
    "intervals": '["340 deg", 380.0]',
    "angle": f'"{np.deg2rad(30.0)!r} rad"'.replace("np.float64(", "").replace(")", ""),
    "bore": '"135 mm"',
    "masses": '["4300 g", "4.4 kg"]',
    "ambient": '"1 bar"',
    "charge": '"2200 mbar"',
    "imep": '"1.8 N/mm2"',
    "speeds": '["10 Hz", 1200]',
    "tolerance": '"1 %"',
    "low": '"1000 kN m/rad"',
    "most": '"2000 kg cm2"',
}


def written(tmp_path, name, numbers):
    path = tmp_path / f"{name}.toml"
    path.write_text(ENGINE.format(**numbers))
    return path


def test_an_engine_in_other_units_is_the_same_engine_expanded_or_not(tmp_path):
    plain = jaxhb.load_scene(written(tmp_path, "plain", PLAIN))
    path = written(tmp_path, "written", WRITTEN)
    text, _ = scene_text(path, expand=True)
    expanded = tmp_path / "expanded.toml"
    expanded.write_text(text)
    for train in (jaxhb.load_scene(path), jaxhb.load_scene(expanded)):
        for name in ("bore", "reciprocating_mass", "firing_angle", "ambient_pressure"):
            expected = getattr(plain.cylinders, name)
            numbers = getattr(train.cylinders, name)
            np.testing.assert_allclose(numbers, expected, rtol=1e-12)
        for name in ("charge_pressure", "imep"):
            expected = getattr(plain.cylinders.combustion, name)
            numbers = getattr(train.cylinders.combustion, name)
            np.testing.assert_allclose(numbers, expected, rtol=1e-12)


def test_a_tuning_in_other_units_is_the_same_tuning(tmp_path):
    plain = read_table(jaxhb.load_scene(written(tmp_path, "plain", PLAIN)))
    other = read_table(jaxhb.load_scene(written(tmp_path, "written", WRITTEN)))
    np.testing.assert_allclose(other.pop("rpm"), plain.pop("rpm"), rtol=1e-12)
    assert other == plain
    faulty = written(tmp_path, "faulty", WRITTEN | {"low": '"1 kN"', "most": '"1 m"'})
    with pytest.raises(SceneError) as caught:
        read_table(jaxhb.load_scene(faulty))
    first, second = caught.value.sentences
    assert "[[tune.parameter]] no. 1: low is '1 kN', must be in N m/rad or" in first
    assert "[[tune.penalty]] no. 1: most is '1 m', must be in kg m2 or" in second


def test_a_copy_keeps_texts_and_comments_except_where_a_number_changes(tmp_path):
    path = written(tmp_path, "written", WRITTEN)
    text, _ = changed_scene(path, {("shaft", 0, "stiffness"): 5e6})
    before = path.read_text().splitlines()
    after = text.splitlines()
    changed = [pair for pair in zip(before, after, strict=True) if pair[0] != pair[1]]
    assert changed == [('stiffness = "4 MN m/rad"', "stiffness = 5000000.0")]
    assert elements_of(path)["crank|flywheel"].stiffness == 4e6


def test_the_flywheel_effect_goes_where_the_inertia_is_written(tmp_path):
    path = tmp_path / "disk.toml"
    path.write_text('[[disk]]\nname = "a"\ngd2 = "12 kgf m2"   # of the sheet\n')
    assert jaxhb.load_scene(path).value("a.inertia") == 3.0
    text, _ = changed_scene(path, {("disk", 0, "inertia"): 4.0})
    assert "gd2" not in text
    path.write_text(text)
    assert jaxhb.load_scene(path).value("a.gd2") == 16.0
    path.write_text('[[disk]]\nname = "a"\ngd2 = 12.0\ninertia = 3.0\n')
    with pytest.raises(SceneError, match="inertia and gd2 are both given. Keep one"):
        jaxhb.load_scene(path)
    path.write_text('[[disk]]\nname = "a"\n')
    with pytest.raises(SceneError, match="'inertia' is missing. Give at least 0 kg m2"):
        jaxhb.load_scene(path)


def test_heads_and_cells_of_a_csv_scene_have_units(tmp_path):
    path = tmp_path / "train.csv"
    path.write_text(
        "name;inertia [kg cm2]\na;5000\nb;20000\n"
        "from;to;stiffness in kN m/rad;damping\na;b;40;20 N m s/deg\n"
    )
    train = jaxhb.load_scene(path)
    assert train.value("a.inertia") == pytest.approx(0.5, rel=1e-15)
    assert train.value("a|b.stiffness") == pytest.approx(4e4, rel=1e-15)
    assert train.value("a|b.damping") == pytest.approx(20 * 180 / np.pi, rel=1e-15)


def test_changes_of_a_study_have_units(tmp_path):
    written(tmp_path, "plain", PLAIN)
    path = tmp_path / "study.toml"
    path.write_text(
        'scene = "plain.toml"\nrpm = "10 Hz"\nkeep = ["shaft torque of crank|flywheel"]\n'
        '[[change]]\nname = "crank|flywheel.stiffness"\nvalues = "2:4 MN m/rad:3"\n'
        '[[change]]\nname = "crank.inertia"\nvalues = ["5000 kg cm2", 0.6]\n'
    )
    first, second = load_study(path).changes
    assert first.rows.ravel().tolist() == [2e6, 3e6, 4e6]
    assert second.rows.ravel() == pytest.approx([0.5, 0.6], rel=1e-15)
    path.write_text(path.read_text().replace("MN m/rad", "MN"))
    with pytest.raises(SceneError, match="'2.0 MN' must be in N m/rad or a unit like"):
        load_study(path)


def test_operating_speeds_have_units(tmp_path):
    path = tmp_path / "scene.toml"
    text = (
        '[scene]\nrules = ["API"]\noperating_rpm = ["10 Hz", "780 1/min"]\n'
        '[[disk]]\nname = "a"\ninertia = 1.0\n'
    )
    path.write_text(text)
    assert jaxhb.load_scene(path).topology.operating_rpm == (600.0, 780.0)
    path.write_text(text.replace("10 Hz", "10 m"))
    with pytest.raises(SceneError, match=r"operating_rpm is \['10 m', 780.0\], must"):
        jaxhb.load_scene(path)
