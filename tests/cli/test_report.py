"""``jaxhb report``: normal running beside a misfire, with backlash and without, in text and in files."""

import json

import numpy as np
import pytest

import jaxhb
from jaxhb.cli.main import main

SMALL = """
[scene]
name = "two cylinders"
reference = "crank"
[[disk]]
name = "crank"
inertia = 0.2
radius = 0.05
damping = 1.0
[[disk]]
name = "pump"
inertia = 0.1
radius = 0.1
damping = 1.0
[[mesh]]
between = ["crank", "pump"]
stiffness = 2e8
damping = 3000.0
backlash = 1e-4
[[ground]]
disk = "pump"
stiffness = 10.0
[[load]]
disk = "pump"
[[cylinder]]
name = "one"
disk = "crank"
gas_torque_mean = 300.0
gas_torque = [[0.5, 20.0, 10.0], [1.0, 30.0, -5.0]]
[[cylinder]]
name = "two"
disk = "crank"
firing_angle = 360.0
gas_torque_mean = 300.0
gas_torque = [[0.5, 20.0, 10.0], [1.0, 30.0, -5.0]]
"""


def test_the_report_puts_a_misfire_beside_normal_running(capsys, tmp_path):
    scene, files = tmp_path / "small.toml", (tmp_path / "r.json", tmp_path / "r.png")
    scene.write_text(SMALL)
    command = ["report", str(scene), "--rpm", "1500,3000", "--at", "3000", "--misfire", "two"]
    assert main([*command, "--json", str(files[0]), "--plot", str(files[1])]) == 0
    record = json.loads(files[0].read_text(encoding="utf-8"))
    assert record["rpm"] == [1500.0, 3000.0]
    assert [case["title"] for case in record["cases"]] == ["all cylinders firing", "two not firing"]
    powers = [case["responses"][1]["load_kW"] for case in record["cases"]]
    assert powers[1] == pytest.approx(powers[0] / 2)
    # The half orders of two cylinders cancel; of one they do not.
    half = [case["responses"][0]["gears"]["crank"]["amplitudes"][0] for case in record["cases"]]
    assert half[0][0] == half[1][0] == 0.5
    assert half[0][1] < 1e-9 < 1.0 < half[1][1]
    without = record["cases"][1]["without_backlash"][0]["meshes"]["crank|pump"]
    assert without["max"] == pytest.approx(record["cases"][1]["responses"][0]["meshes"]["crank|pump"]["max"])
    said = capsys.readouterr().out
    assert said.startswith("With all cylinders firing\n  All teeth stay in contact at 1500 rpm.")
    assert files[1].read_bytes().startswith(b"\x89PNG")


def test_a_scene_with_a_cylinder_that_does_not_fire_is_not_called_normal(capsys, tmp_path):
    scene = tmp_path / "small.toml"
    scene.write_text(SMALL + "fires = false\n")
    assert main(["report", str(scene), "--rpm", "1500"]) == 0
    assert capsys.readouterr().out.startswith("With the scene as given\n")


def test_cases_of_a_report_are_a_dimension_of_its_labelled_arrays(tmp_path):
    xarray = pytest.importorskip("xarray")
    scene, file = tmp_path / "small.toml", tmp_path / "r.nc"
    scene.write_text(SMALL)
    assert main(["report", str(scene), "--rpm", "1500,3000", "--misfire", "two", "--netcdf", str(file)]) == 0
    data = xarray.load_dataset(file)
    assert data.case.values.tolist() == ["all cylinders firing", "two not firing"]
    assert data.tooth_force_max.dims == ("case", "rpm", "mesh") and data.rpm.values.tolist() == [1500.0, 3000.0]
    misfiring = jaxhb.load_scene(scene).misfire("two")
    one = data.sel(case="two not firing", rpm=3000.0)
    found = jaxhb.steady_state(misfiring, rpm=3000.0).force("crank|pump").max
    without = jaxhb.linear_response(misfiring, rpm=3000.0).force("crank|pump").max
    assert one.tooth_force_max.item() == pytest.approx(float(found), rel=1e-9)
    assert one.tooth_force_max_without_backlash.item() == pytest.approx(float(without), rel=1e-9)
    half = data.tooth_force_amplitude.sel(order=0.5, rpm=1500.0, mesh="crank|pump").values
    assert half[0] < 1e-9 < 1.0 < half[1]
    assert np.isfinite(data.tooth_force_amplitude).all()
    assert main(["report", str(scene), "--rpm", "1500", "--netcdf", str(file)]) == 0
    assert xarray.load_dataset(file).sizes["case"] == 1


def test_solve_sweep_and_report_tell_the_same_numbers_to_the_last_bit(tmp_path):
    def told(command, rpm, *options):
        file = str(tmp_path / "r.json")
        assert main([command, "spur_pair", "--rpm", rpm, "--json", file, "--quiet", *options]) == 0
        return json.loads((tmp_path / "r.json").read_text())

    alone, sweep, report = told("solve", "5000"), told("sweep", "2000,5000", "--full"), told("report", "2000,5000")
    (case,) = report["cases"]
    for found in (sweep["responses"][1], case["responses"][1] | {"without_backlash": case["without_backlash"][1]}):
        assert found.items() <= alone.items()
