"""``jaxhb scene`` and ``jaxhb report --misfire each``."""

import json
import subprocess
import sys

import numpy as np
import pytest

import jaxhb
from jaxhb.cli.main import main

ENGINE = """
[[disk]]
name = "one"
inertia = 0.2
damping = 1.0
[[disk]]
name = "two"
inertia = 0.3
damping = 1.0
[[shaft]]
between = ["one", "two"]
stiffness = 1e5
damping = 5.0
[[load]]
disk = "two"
[engine]
cylinders = 2
disks = ["one", "two"]
firing_order = [1, 2]
gas_factor = [1.0, 0.8]
bore = 0.1
stroke = 0.12
rod = 0.2
[[engine.traces]]
rpm = 1000
pressure = "p.csv"
[[engine.traces]]
rpm = 2000
pressure = "p.csv"
"""


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "p.csv").write_text("# deg, Pa\n0, 1e5\n300, 2e6\n370, 9e6\n500, 4e5\n720, 1e5\n")
    path = tmp_path / "engine.toml"
    path.write_text(ENGINE)
    return path


def test_an_expanded_scene_is_printed_and_loads_to_the_same_train(scene, capsys):
    assert main(["scene", str(scene), "--expand"]) == 0
    text = capsys.readouterr().out
    assert "[engine]" not in text and text.count("[[cylinder.traces]]") == 4
    copy = scene.with_name("copy.toml")
    copy.write_text(text)
    both = (jaxhb.linear_response(jaxhb.load_scene(path), rpm=1500.0).angles for path in (scene, copy))
    np.testing.assert_array_equal(*both)


def test_a_scene_is_written_with_its_tables_beside_it(scene, capsys, tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    out = folder / "copy.toml"
    assert main(["scene", str(scene), "--out", str(out)]) == 0
    assert capsys.readouterr().out.splitlines() == [f"{out} is written.", f"{folder / 'p.csv'} is written."]
    assert "[engine]" in out.read_text() and jaxhb.load_scene(out).topology.name == "engine"


def test_a_csv_file_becomes_a_scene(tmp_path, capsys):
    table, out = tmp_path / "pair.csv", tmp_path / "pair.toml"
    table.write_text("name,inertia\na,1\nb,2\n\nfrom,to,stiffness\na,b,1e5\n")
    assert main(["scene", str(table), "--out", str(out)]) == 0
    assert main(["modes", str(out)]) == main(["modes", str(table)]) == 0
    assert "61.64" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        (["--out", "x.json"], "--out: 'x.json' is no scene. Give a name that ends in .toml."),
        (["--out", "nowhere/x.toml"], "--out: there is no folder"),
    ],
)
def test_a_scene_that_cannot_be_written_is_refused(scene, arguments, sentence, capsys, monkeypatch):
    monkeypatch.chdir(scene.parent)
    assert main(["scene", scene.name, *arguments]) == 2
    assert sentence in capsys.readouterr().err


def test_the_scene_command_needs_no_jax(scene):
    code = (
        f"import sys, jaxhb.cli.main as c; c.main(['scene', {str(scene)!r}, '--expand']); print('jax' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found.splitlines()[-1] == "False"


def test_the_worst_of_all_misfires_is_that_of_python(scene, capsys, tmp_path):
    file = tmp_path / "r.json"
    assert main(["report", str(scene), "--rpm", "1200,1800", "--misfire", "each", "--json", str(file)]) == 0
    said, record = capsys.readouterr().out, json.loads(file.read_text())
    worst = jaxhb.misfire_each(jaxhb.load_scene(scene), rpm=[1200.0, 1800.0]).worst(
        lambda r: r.torque("one", "two").half_peak_to_peak
    )
    found = record["worst_misfire"]
    assert (found["cylinder"], found["rpm"], found["of"], found["unit"]) == (
        worst.cylinder,
        worst.rpm,
        "one|two",
        "N m",
    )
    np.testing.assert_allclose([found["value"], found["firing"]], [worst.value, worst.firing], rtol=1e-9)
    assert said.startswith(f"The worst misfire is that of {worst.cylinder}: torque of ")
    titles = ["all cylinders firing", "cylinder 1 not firing", "cylinder 2 not firing"]
    assert [case["title"] for case in record["cases"]] == titles and all(title in said for title in titles)
    each = jaxhb.load_scene(scene).misfire("cylinder 2")
    torque = record["cases"][2]["responses"][0]["shafts"]["one|two"]["half_peak_to_peak"]
    wanted = jaxhb.linear_response(each, rpm=1200.0).torque("one", "two").half_peak_to_peak
    np.testing.assert_allclose(torque, wanted, rtol=1e-9)


def test_each_stands_alone_and_needs_a_cylinder(scene, capsys):
    assert main(["report", str(scene), "--rpm", "900", "--misfire", "each", "--misfire", "cylinder 1"]) == 2
    assert "--misfire each: takes every cylinder in turn. Leave out the other --misfire." in capsys.readouterr().err
    assert main(["report", "spur_pair", "--rpm", "900", "--misfire", "each"]) == 2
    assert "--misfire each: no cylinder of the train fires." in capsys.readouterr().err


def test_a_speed_outside_the_traces_is_told_among_the_notes(scene, capsys):
    assert main(["sweep", str(scene), "--rpm", "900,1500,2500"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert (
        "At 900 rpm the speed lies outside the pressure traces of 'cylinder 1', 'cylinder 2' (1000 to 2000 rpm)" in said
    )
    assert "(alike at 2500 rpm)" in said
    assert main(["solve", str(scene), "--rpm", "1500"]) == 0
    assert "outside" not in capsys.readouterr().out
