"""Limits in pictures: panels of stresses, tooth torques and heat, with barred ranges shaded."""

from types import SimpleNamespace

import numpy as np
import pytest
from limited_line import SCENE, strength_of, written

import jaxhb
from jaxhb.report.compute import Asked, answer_speeds
from jaxhb.report.figures.forced import plot_forced
from jaxhb.report.figures.limits import judged_elements
from jaxhb.report.figures.sweep import plot_sweep
from jaxhb.report.text.forced import readings, worst_of

ENGINE = """
[engine]
cylinders = 2
disks = ["engine", "engine"]
firing_order = [1, 2]
bore = 0.1
stroke = 0.1
rod = 0.2
reciprocating_mass = 1.0
gas_torque_mean = 100.0
gas_torque = [[0.5, 90.0, 20.0], [1.0, 150.0, 30.0], [1.5, 80.0, 10.0]]
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return written(tmp_path_factory.mktemp("line"))


@pytest.fixture(scope="module")
def wanted(scene):
    return strength_of(scene)


def labelled(axes, label):
    (line,) = [line for line in axes.get_lines() if line.get_label() == label]
    return line.get_xdata(), line.get_ydata()


def test_a_misfire_stands_beside_normal_running_in_the_panels_of_limits(tmp_path):
    (tmp_path / "e.toml").write_text(SCENE + ENGINE)
    rpm = np.linspace(300.0, 900.0, 7)
    misfires = jaxhb.misfire_each(jaxhb.load_scene(tmp_path / "e.toml"), rpm=rpm, solve=jaxhb.forced_response)
    found = readings(misfires.firing)
    worst = worst_of(misfires, found)
    stress = plot_forced(misfires.firing, found, misfires, worst).axes[2]
    cylinder = worst["line shaft"].cylinder
    wanted = jaxhb.strength(misfires.responses[cylinder]).stresses["line shaft"].stress
    np.testing.assert_allclose(labelled(stress, f"stress, {cylinder} not firing")[1], 1e-6 * wanted)


def test_the_picture_has_stresses_torques_and_heat_beside_their_limits_and_shades_barred_ranges(scene, wanted):
    response = jaxhb.forced_response(jaxhb.load_scene(scene), rpm=wanted.rpm)
    stress, tooth, heat = plot_forced(response, readings(response)).axes[-3:]
    row, rated = wanted.stresses["line shaft"], wanted.tooth_torques["pinion|wheel"]
    for label, values in (
        ("stress", row.stress),
        ("continuous limit", row.continuous),
        ("transient limit", row.transient),
    ):
        np.testing.assert_allclose(labelled(stress, label)[1], 1e-6 * values)
    (shaded,), (one,) = stress.patches, wanted.barred["line shaft"]
    assert (shaded.get_x(), shaded.get_x() + shaded.get_width()) == pytest.approx((one.low, one.high))
    np.testing.assert_allclose(labelled(tooth, "vibratory torque")[1], rated.vibratory)
    np.testing.assert_allclose(labelled(tooth, "a third of the rated torque")[1], 500.0)
    assert heat.get_ylabel() == "heat, W\nring"  # nearer to its limit than the coupling
    np.testing.assert_allclose(labelled(heat, "heat")[1], wanted.heat["ring"].power)
    drawn = plot_forced(response, readings(response, ["coupling"])).axes
    assert [axes.get_ylabel() for axes in drawn] == ["coupling, N m", "heat, W\ncoupling"]
    five = readings(response, ["coupling", "engine", "pinion", "wheel", "propeller"])
    assert [axes.get_ylabel() for axes in plot_forced(response, five).axes] == ["coupling, N m", "heat, W\ncoupling"]


def test_the_picture_of_a_sweep_has_the_limits_of_the_motion(scene):
    train, rpm = jaxhb.load_scene(scene), [360.0, 420.0, 480.0]
    axes = plot_sweep(answer_speeds(train, rpm, Asked())).axes
    found = jaxhb.strength(jaxhb.solve_speeds(train, rpm=rpm)).stresses["line shaft"].stress
    np.testing.assert_allclose(labelled(axes[2], "stress")[1], 1e-6 * np.asarray(found), rtol=1e-6)
    assert len(axes) == 5 and axes[2].patches


def test_the_shaft_with_the_largest_stress_has_the_panel_where_no_shaft_has_a_limit():
    rows = {name: SimpleNamespace(stress=[1e6, top], continuous=None) for name, top in {"a": 3e6, "b": 9e6}.items()}
    found = SimpleNamespace(stresses=rows, tooth_torques={}, heat={})
    assert judged_elements(found) == [("stresses", "b")]
    rows["a"].continuous = [4e7, 4e7]
    assert judged_elements(found) == [("stresses", "a")]
