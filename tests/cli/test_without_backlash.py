""" "Without backlash": the gaps of meshes closed, all else as it is. The other way is
the same scene whose meshes have none.
"""

import numpy as np
import pytest
from reference_data import DATA
from tolerances import ALGEBRAIC, PATHS

import jaxhb
from jaxhb.report.compute import Asked, answer_one
from jaxhb.report.figures.cycle import cycle_figure

SCENE = DATA / "scenes" / "idle_rattle.toml"
RPM = 1000.0
MESH = "hub|counter gear"
CLUTCH = "clutch disc"


@pytest.fixture(scope="module")
def closed_scene(tmp_path_factory):
    """The scene of a clutch disc with stages and friction, without the line that gives
    the mesh its backlash.
    """
    path = tmp_path_factory.mktemp("scene") / "closed.toml"
    lines = SCENE.read_text().splitlines(True)
    path.write_text("".join(ln for ln in lines if not ln.startswith("backlash")))
    return path


@pytest.fixture(scope="module")
def closed(closed_scene):
    """Motion of the train without a gap."""
    return jaxhb.steady_state(jaxhb.load_scene(closed_scene), rpm=RPM)


@pytest.mark.slow
def test_what_stands_beside_a_motion_is_that_of_the_scene_whose_meshes_have_no_backlash(
    run, closed
):
    xarray = pytest.importorskip("xarray")
    line = f"sweep {SCENE} --rpm {RPM}"
    completed = run(line, "json", "csv", "netcdf", "plot")
    largest = closed.force(MESH).max
    torque = closed.torque(CLUTCH).half_peak_to_peak
    (record,) = completed.json["responses"]
    (row,) = completed.rows
    without = record["without_backlash"]
    swing = without["shafts"][CLUTCH]["half_peak_to_peak"]
    assert swing == pytest.approx(torque, rel=ALGEBRAIC)
    with xarray.open_dataset(completed.path("netcdf")) as data:
        in_data_set = data.tooth_force_max_without_backlash.item()
    for force in (
        without["meshes"][MESH]["max"],
        float(row[f"{MESH} max N without backlash"]),
        in_data_set,
    ):
        assert force == pytest.approx(largest, rel=ALGEBRAIC)
    # The teeth never part.
    assert record["meshes"][MESH]["max"] / largest == pytest.approx(1.0, abs=0.01)
    assert f"{largest / 1e3:.4g}" in completed.out


@pytest.mark.slow
def test_a_scene_without_gaps_stands_beside_itself(closed_scene):
    answer = answer_one(jaxhb.load_scene(closed_scene), RPM, Asked())
    assert answer.without_backlash is answer


def pair(backlash=None):
    """Two gears whose mesh stiffness varies by a fifth."""
    parts = [
        jaxhb.Disk(name="a", inertia=0.01, radius=0.05, teeth=20),
        jaxhb.Disk(name="b", inertia=0.01, radius=0.05, teeth=20),
        jaxhb.Torque(disk="a", mean=20.0, harmonics=[(1.0, 5.0, 0.0)]),
        jaxhb.Load(disk="b"),
        jaxhb.Mesh(
            between=("a", "b"),
            stiffness=1e6,
            damping=300.0,
            stiffness_orders=[(1, 0.2, 0.0)],
            backlash=backlash,
        ),
    ]
    return jaxhb.build(parts, reference="a")


@pytest.mark.slow
def test_a_mesh_stiffness_goes_on_varying_in_orbits_pictures_and_linear_responses():
    orbit = jaxhb.solve_speeds(pair(), rpm=[300.0])[0]
    largest = np.abs(orbit.forces).max()
    force = orbit.force("a", "b")
    assert float(force.order(20.0)) > 0.01 * float(force.mean)
    train = pair(backlash=1e-4)
    smooth = jaxhb.linear_response(train, rpm=300.0, harmonics=orbit.harmonics)
    # A sweep solves to a share of its tolerance, not to the last digit.
    np.testing.assert_allclose(
        smooth.forces, orbit.forces, rtol=0, atol=1e3 * PATHS * largest
    )
    answer = answer_one(train, 300.0, Asked(orbit=True))
    forces = answer.without_backlash.response.forces
    np.testing.assert_allclose(forces, orbit.forces, rtol=0, atol=ALGEBRAIC * largest)
    _, drawn = cycle_figure(answer, "a", (), "").traces
    assert drawn["name"] == "without backlash"
    half = float(orbit.gear_torque("a").half_peak_to_peak)
    assert np.ptp(drawn["y"]) / 2 == pytest.approx(half, rel=1e-3)
