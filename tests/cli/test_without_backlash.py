""" "Without backlash": the gaps of meshes closed, all else as it is. The other way is
the same scene whose meshes have none.
"""

from pathlib import Path

import numpy as np
import pytest
from tolerances import ALGEBRAIC, PATHS

import jaxhb
from jaxhb.report.compute import Asked, answer_one
from jaxhb.report.figures.cycle import cycle_figure

SCENE = Path(__file__).parents[1] / "data" / "scenes" / "idle_rattle.toml"
RPM = 1000.0
MESH = "hub|counter gear"
CLUTCH = "clutch disc"


@pytest.fixture(scope="module")
def closed_scene(tmp_path_factory):
    """The scene of a clutch disc with stages and friction, without the line that gives
    the mesh its backlash.
    """
    path = tmp_path_factory.mktemp("scene") / "closed.toml"
    path.write_text(
        "".join(
            line
            for line in SCENE.read_text().splitlines(True)
            if not line.startswith("backlash")
        )
    )
    return path


@pytest.fixture(scope="module")
def closed(closed_scene):
    """What the train without a gap does."""
    return jaxhb.steady_state(jaxhb.load_scene(closed_scene), rpm=RPM)


@pytest.mark.slow
def test_what_stands_beside_a_motion_is_that_of_the_scene_whose_meshes_have_no_backlash(
    run, closed
):
    called = run(f"sweep {SCENE} --rpm {RPM}", "json", "csv", "netcdf", "plot")
    assert called.status == 0
    largest = closed.force(MESH).max
    torque = closed.torque(CLUTCH).half_peak_to_peak
    (record,) = called.json["responses"]
    (row,) = called.rows
    without = record["without_backlash"]
    assert without["meshes"][MESH]["max"] == pytest.approx(largest, rel=ALGEBRAIC)
    assert without["shafts"][CLUTCH]["half_peak_to_peak"] == pytest.approx(
        torque, rel=ALGEBRAIC
    )
    assert float(row[f"{MESH} max N without backlash"]) == pytest.approx(
        largest, rel=ALGEBRAIC
    )
    assert record["meshes"][MESH]["max"] / largest == pytest.approx(
        1.0, abs=0.01
    )  # the teeth never part
    assert f"{largest / 1e3:.4g}" in called.out

    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(called.path("netcdf")) as data:
        assert data.tooth_force_max_without_backlash.item() == pytest.approx(
            largest, rel=ALGEBRAIC
        )


@pytest.mark.slow
def test_a_scene_without_gaps_stands_beside_itself(closed_scene):
    answer = answer_one(jaxhb.load_scene(closed_scene), RPM, Asked())
    assert answer.without_backlash is answer


def pair(**gap):
    """Two gears whose mesh stiffness varies by a fifth."""
    parts = [
        jaxhb.Disk(name=name, inertia=0.01, radius=0.05, teeth=20) for name in "ab"
    ]
    parts += [
        jaxhb.Torque(disk="a", mean=20.0, harmonics=[(1.0, 5.0, 0.0)]),
        jaxhb.Load(disk="b"),
    ]
    varying = {"stiffness": 1e6, "damping": 300.0, "stiffness_orders": [(1, 0.2, 0.0)]}
    return jaxhb.build(
        [*parts, jaxhb.Mesh(between=("a", "b"), **varying, **gap)], reference="a"
    )


@pytest.mark.slow
def test_a_mesh_stiffness_that_varies_goes_on_doing_so_in_orbits_pictures_and_linear_responses():
    orbit = jaxhb.solve_speeds(pair(), rpm=[300.0])[0]
    most = np.abs(orbit.forces).max()
    assert float(orbit.force("a", "b").order(20.0)) > 0.01 * float(
        orbit.force("a", "b").mean
    )
    smooth = jaxhb.linear_response(
        pair(backlash=1e-4), rpm=300.0, harmonics=orbit.harmonics
    )
    # A sweep solves to a share of its tolerance, not to the last digit.
    np.testing.assert_allclose(
        smooth.forces, orbit.forces, rtol=0, atol=1e3 * PATHS * most
    )

    answer = answer_one(pair(backlash=1e-4), 300.0, Asked(orbit=True))
    np.testing.assert_allclose(
        answer.without_backlash.response.forces,
        orbit.forces,
        rtol=0,
        atol=ALGEBRAIC * most,
    )
    _, drawn = cycle_figure(answer, "a", (), "").traces
    assert drawn["name"] == "without backlash"
    half = float(orbit.gear_torque("a").half_peak_to_peak)
    assert np.ptp(drawn["y"]) / 2 == pytest.approx(half, rel=1e-3)
