"""``jaxhb scene`` and ``jaxhb report --misfire each``."""

import subprocess
import sys

import jax
import numpy as np
import pytest
from built_trains import same
from reference_data import text_of

import jaxhb

ENGINE = "\n" + text_of("traces.toml")


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "p.csv").write_text(
        "# deg, Pa\n0, 1e5\n300, 2e6\n370, 9e6\n500, 4e5\n720, 1e5\n"
    )
    path = tmp_path / "engine.toml"
    path.write_text(ENGINE)
    return path


def test_an_expanded_scene_is_printed_and_loads_to_the_same_train(scene, run):
    completed = run(f"scene {scene} --expand")
    completed.check_printed("scene_expanded")
    copy_of_scene = scene.with_name("copy.toml")
    copy_of_scene.write_text(completed.out)
    train = jaxhb.load_scene(scene)
    copy = jaxhb.load_scene(copy_of_scene)
    assert copy.topology.cylinder_names == train.topology.cylinders.names
    jax.tree.map(np.testing.assert_array_equal, copy.cylinders, train.cylinders)


def test_a_scene_is_written_with_its_tables_beside_it(scene, run, tmp_path):
    copy = tmp_path / "out" / "copy.toml"
    copy.parent.mkdir()
    run(f"scene {scene} --out {copy}").check_printed("scene_written")
    assert "[engine]" in copy.read_text()
    assert jaxhb.load_scene(copy).topology.name == "engine"


DRIVEN = """\
[scene]
name = "driven"
[[disk]]
name = "a"
inertia = 1.0
[[disk]]
name = "b"
inertia = 2.0
[[shaft]]
between = ["a", "b"]
stiffness = 1e5
[[torque]]
disk = "a"
harmonics = "../drive.csv"  # of the motor
scale = "../tables/drive.csv"
"""


@pytest.fixture
def driven(tmp_path):
    """A scene whose tables lie beside its folder, two of one name."""
    for folder in ("scenes", "tables"):
        (tmp_path / "in" / folder).mkdir(parents=True)
    (tmp_path / "in" / "drive.csv").write_text("1, 3.0, 4.0\n")
    (tmp_path / "in" / "tables" / "drive.csv").write_text("500, 1.0\n1500, 2.0\n")
    path = tmp_path / "in" / "scenes" / "driven.toml"
    path.write_text(DRIVEN)
    return path


@pytest.mark.parametrize(
    "line", ["scene {scene} --out {copy}", "new {copy} --from {scene}"]
)
def test_tables_outside_of_the_folder_of_a_scene_are_copied_into_that_of_its_copy(
    driven, run, tmp_path, line
):
    copy = tmp_path / "out" / "inner" / "copy.toml"
    copy.parent.mkdir(parents=True)
    run(line.format(scene=driven, copy=copy))
    tables = sorted(path.name for path in (tmp_path / "out").rglob("*.csv"))
    assert tables == ["drive 2.csv", "drive.csv"]
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["inner"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "out"]
    assert 'harmonics = "drive.csv"  # of the motor' in copy.read_text()
    original = jaxhb.load_scene(driven)
    (tmp_path / "in").rename(tmp_path / "elsewhere")  # the copy does not lean on it
    assert same(jaxhb.load_scene(copy), original)


def test_a_copy_from_which_the_names_lead_to_the_same_tables_keeps_them(driven, run):
    before = sorted(driven.parents[1].rglob("*.csv"))
    run(f"scene {driven} --out {driven.with_name('copy.toml')}")
    assert sorted(driven.parents[1].rglob("*.csv")) == before
    assert driven.with_name("copy.toml").read_text() == DRIVEN


def test_every_table_that_a_scene_may_name_is_copied(run, tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "charge.csv").write_text("0.0, 0.4\n1.0, 1.0\n")
    named = '[engine.combustion]\ncharge_over_load = "charge.csv"'
    scene = tmp_path / "in" / "engine.toml"
    copy = tmp_path / "copy.toml"
    scene.write_text(text_of("two_strokes.toml").replace("[engine.combustion]", named))
    run(f"scene {scene} --out {copy}")
    assert (tmp_path / "charge.csv").is_file()
    assert jaxhb.load_scene(copy).cylinders.combustion is not None


def test_a_csv_file_becomes_a_scene(tmp_path, run):
    table = tmp_path / "pair.csv"
    out = tmp_path / "pair.toml"
    table.write_text("name,inertia\na,1\nb,2\n\nfrom,to,stiffness\na,b,1e5\n")
    assert run(f"scene {table} --out {out} --quiet").out == ""
    for scene in (out, table):
        assert "61.64" in run(f"modes {scene}").out


def test_the_scene_command_needs_no_jax(scene):
    code = (
        f"import sys, jaxhb.cli.main as c; c.main(['scene', {str(scene)!r}]);"
        " print('jax' in sys.modules)"
    )
    completed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert completed.stdout.splitlines()[-1] == "False"


def test_the_worst_of_all_misfires_is_that_of_python(scene, run):
    completed = run(f"report {scene} --rpm 1200,1800 --misfire each", "json")
    misfires = jaxhb.misfire_each(jaxhb.load_scene(scene), rpm=[1200.0, 1800.0])
    expected = misfires.worst(lambda r: r.torque("one", "two").half_peak_to_peak)
    worst = completed.json["worst_misfire"]
    assert worst == worst | {
        "of": "one|two",
        "cylinder": expected.cylinder,
        "rpm": expected.rpm,
        "value": pytest.approx(expected.value, rel=1e-9),
        "firing": pytest.approx(expected.firing, rel=1e-9),
    }
    beginning = f"The worst misfire is that of {expected.cylinder}: torque of "
    assert completed.out.startswith(beginning)
    cases = completed.json["cases"]
    titles = [case["title"] for case in cases]
    assert titles == [
        "all cylinders firing",
        "cylinder 1 not firing",
        "cylinder 2 not firing",
    ]
    for title in titles:
        assert title in completed.out
    shaft = cases[2]["responses"][0]["shafts"]["one|two"]
    torque = misfires.responses["cylinder 2"][0].torque("one", "two")
    np.testing.assert_allclose(
        shaft["half_peak_to_peak"], torque.half_peak_to_peak, rtol=1e-9
    )


def test_a_speed_outside_the_traces_is_told_among_the_notes(scene, run):
    words = run(f"sweep {scene} --rpm 900,1500,2500").words
    traces = "the pressure traces of 'cylinder 1', 'cylinder 2' (1000 to 2000 rpm)"
    assert f"At 900 rpm the speed lies outside {traces}" in words
    assert "(alike at 2500 rpm)" in words
    assert "outside" not in run(f"solve {scene} --rpm 1500").out
