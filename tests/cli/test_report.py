"""``jaxhb report``: normal running beside a misfire, with backlash and without, in text
and in files.
"""

import numpy as np
import pytest
from reference_data import text_of

import jaxhb

SMALL = text_of("small_engine.toml")


@pytest.fixture
def small(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    return tmp_path / "small.toml"


def test_the_report_puts_a_misfire_beside_normal_running(run, small):
    xarray = pytest.importorskip("xarray")
    called = run(
        f"report {small} --rpm 1500,3000 --at 3000 --misfire two",
        "json",
        "plot",
        "netcdf",
    )
    record = called.json
    assert called.status == 0 and called.is_drawn and record["rpm"] == [1500.0, 3000.0]
    assert called.out.startswith(
        "With all cylinders firing\n  All teeth stay in contact at 1500 rpm."
    )
    firing, misfiring = record["cases"]
    assert (firing["title"], misfiring["title"]) == (
        "all cylinders firing",
        "two not firing",
    )
    assert misfiring["responses"][1]["load_kW"] == pytest.approx(
        firing["responses"][1]["load_kW"] / 2
    )
    # The half orders of two cylinders cancel; of one they do not.
    half = [
        case["responses"][0]["gears"]["crank"]["amplitudes"][0]
        for case in record["cases"]
    ]
    assert half[0][0] == half[1][0] == 0.5
    assert half[0][1] < 1e-9 < 1.0 < half[1][1]
    without = misfiring["without_backlash"][0]["meshes"]["crank|pump"]
    assert without["max"] == pytest.approx(
        misfiring["responses"][0]["meshes"]["crank|pump"]["max"]
    )
    data = xarray.load_dataset(
        called.path("netcdf")
    )  # cases are a dimension of its arrays
    assert data.case.values.tolist() == ["all cylinders firing", "two not firing"]
    assert data.tooth_force_max.dims == (
        "case",
        "rpm",
        "mesh",
    ) and data.rpm.values.tolist() == [1500.0, 3000.0]
    train = jaxhb.load_scene(small).misfire("two")
    one = data.sel(case="two not firing", rpm=3000.0)
    found = jaxhb.steady_state(train, rpm=3000.0).force("crank|pump").max
    without = jaxhb.linear_response(train, rpm=3000.0).force("crank|pump").max
    assert one.tooth_force_max.item() == pytest.approx(float(found), rel=1e-9)
    assert one.tooth_force_max_without_backlash.item() == pytest.approx(
        float(without), rel=1e-9
    )
    assert np.isfinite(data.tooth_force_amplitude).all()


def test_a_scene_with_a_cylinder_that_does_not_fire_is_not_called_normal(run, small):
    small.write_text(SMALL + "fires = false\n")
    called = run(f"report {small} --rpm 1500", "netcdf")
    assert called.status == 0 and called.out.startswith("With the scene as given\n")
    assert (
        pytest.importorskip("xarray").load_dataset(called.path("netcdf")).sizes["case"]
        == 1
    )


@pytest.mark.slow
def test_solve_sweep_and_report_tell_the_same_numbers_to_the_last_bit(told):
    alone = told("solve spur_pair --rpm 5000", "json").json
    swept = told("sweep spur_pair --rpm 2000,5000 --full", "json").json["responses"][1]
    (case,) = told("report spur_pair --rpm 2000,5000", "json").json["cases"]
    for found in (
        swept,
        case["responses"][1] | {"without_backlash": case["without_backlash"][1]},
    ):
        assert found.items() <= alone.items()
