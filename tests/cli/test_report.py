"""``jaxhb report``: normal running beside a misfire, with backlash and without, in text
and in files.
"""

import numpy as np
import pytest
from reference_data import text_of

import jaxhb

SMALL = text_of("small_engine.toml")
MESH = "crank|pump"


@pytest.fixture
def small(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    return tmp_path / "small.toml"


@pytest.fixture
def completed(run, small):
    """A report on a misfire."""
    line = f"report {small} --rpm 1500,3000 --at 3000 --misfire two"
    return run(line, "json", "plot", "netcdf")


def test_the_report_puts_a_misfire_beside_normal_running(completed):
    record = completed.json
    assert record["rpm"] == [1500.0, 3000.0]
    beginning = "With all cylinders firing\n  All teeth stay in contact at 1500 rpm."
    assert completed.out.startswith(beginning)
    firing, misfiring = record["cases"]
    assert firing["title"] == "all cylinders firing"
    assert misfiring["title"] == "two not firing"
    loads = [case["responses"][1]["load_kW"] for case in (firing, misfiring)]
    assert loads[1] == pytest.approx(loads[0] / 2)
    # The half orders of two cylinders cancel; of one they do not.
    cancelled, left = (
        case["responses"][0]["gears"]["crank"]["amplitudes"][0]
        for case in (firing, misfiring)
    )
    assert cancelled[0] == left[0] == 0.5
    assert cancelled[1] < 1e-9
    assert left[1] > 1.0
    without = misfiring["without_backlash"][0]["meshes"][MESH]
    largest = misfiring["responses"][0]["meshes"][MESH]["max"]
    assert without["max"] == pytest.approx(largest)


def test_cases_are_a_dimension_of_the_arrays_of_a_report(completed, small):
    data = pytest.importorskip("xarray").load_dataset(completed.path("netcdf"))
    assert data.case.values.tolist() == ["all cylinders firing", "two not firing"]
    assert data.tooth_force_max.dims == ("case", "rpm", "mesh")
    assert data.rpm.values.tolist() == [1500.0, 3000.0]
    train = jaxhb.load_scene(small).misfire("two")
    misfiring = data.sel(case="two not firing", rpm=3000.0)
    force = float(jaxhb.steady_state(train, rpm=3000.0).force(MESH).max)
    assert misfiring.tooth_force_max.item() == pytest.approx(force, rel=1e-9)
    without = float(jaxhb.linear_response(train, rpm=3000.0).force(MESH).max)
    largest = misfiring.tooth_force_max_without_backlash.item()
    assert largest == pytest.approx(without, rel=1e-9)
    assert np.isfinite(data.tooth_force_amplitude).all()


def test_a_scene_with_a_cylinder_that_does_not_fire_is_not_called_normal(run, small):
    xarray = pytest.importorskip("xarray")
    small.write_text(SMALL + "fires = false\n")
    completed = run(f"report {small} --rpm 1500", "netcdf")
    assert completed.out.startswith("With the scene as given\n")
    assert xarray.load_dataset(completed.path("netcdf")).sizes["case"] == 1


@pytest.mark.slow
def test_solve_sweep_and_report_tell_the_same_numbers_to_the_last_bit(run_once):
    alone = run_once("solve spur_pair --rpm 5000", "json").json
    swept = run_once("sweep spur_pair --rpm 2000,5000 --full", "json").json
    (case,) = run_once("report spur_pair --rpm 2000,5000", "json").json["cases"]
    without = {"without_backlash": case["without_backlash"][1]}
    for record in (swept["responses"][1], case["responses"][1] | without):
        assert record.items() <= alone.items()
