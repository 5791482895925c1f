"""Panels of stresses, tooth torques and heat beside their limits, with barred ranges
shaded.
"""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from limited_line import SCENE, strength_of, write_scene
from reference_data import text_of

import jaxhb
from jaxhb.linear.strength import Strength
from jaxhb.report.compute import Asked, answer_speeds
from jaxhb.report.figures import speeds
from jaxhb.report.figures.figure import DIGITS
from jaxhb.report.figures.speeds import (
    judged_elements,
    limit_figure,
    plot_forced,
    plot_sweep,
)
from jaxhb.report.text.forced import readings, worst_of
from jaxhb.report.text.strength import strength_text

ENGINE = "\n" + text_of("line_engine.toml")


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_scene(tmp_path_factory.mktemp("line"))


@pytest.fixture(scope="module")
def strength(scene):
    return strength_of(scene)


def figures_of(plot, *arguments):
    """Specifications of the figures that a function of pictures draws."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(speeds, "drawn", lambda *figures, title: figures)
        return plot(*arguments)


def assert_line(figure, name, expected):
    """A line of a figure has the values, to the digits of its numbers."""
    (values,) = [trace["y"] for trace in figure.traces if trace["name"] == name]
    # No limit is a gap.
    expected = np.where(np.isfinite(expected), expected, np.nan)
    values = np.array(values, float)
    np.testing.assert_allclose(
        values, np.broadcast_to(expected, len(values)), rtol=0.5 * 10 ** (1 - DIGITS)
    )


@pytest.mark.slow
def test_a_misfire_stands_beside_normal_running_in_the_panels_of_limits(tmp_path):
    (tmp_path / "e.toml").write_text(SCENE + ENGINE)
    rpm = np.linspace(300.0, 900.0, 7)
    misfires = jaxhb.misfire_each(
        jaxhb.load_scene(tmp_path / "e.toml"), rpm=rpm, solve=jaxhb.forced_response
    )
    shown = readings(misfires.firing)
    cases = {"": misfires.firing} | misfires.responses
    strengths = {name: jaxhb.strength(response) for name, response in cases.items()}
    worst = worst_of(cases, shown, strengths)
    stress = figures_of(plot_forced, cases, shown, worst)[2]
    cylinder = worst["shafts", "line shaft"].cylinder
    expected = (
        jaxhb.strength(misfires.responses[cylinder]).stresses["line shaft"].stress
    )
    assert_line(stress, f"stress, {cylinder} not firing", 1e-6 * expected)


def test_the_picture_has_loads_beside_their_limits_and_shades_barred_ranges(
    scene, strength
):
    response = jaxhb.forced_response(jaxhb.load_scene(scene), rpm=strength.rpm)
    panels = figures_of(plot_forced, {"": response}, readings(response))
    stress, tooth, heat = panels[-3:]
    stresses = strength.stresses["line shaft"]
    torques = strength.tooth_torques["pinion|wheel"]
    assert_line(stress, "stress", 1e-6 * stresses.stress)
    # Above 810 rpm the limits are constant, above 945 rpm there is none.
    steps = [810.0, 810.0, 945.0, 945.1]
    limits = jaxhb.permissible_stress(
        diameter=0.11,
        stress_concentration=0.45,
        tensile_strength=5e8,
        speed_ratio=np.sort([*strength.rpm, *steps]) / 900.0,
    )
    assert_line(stress, "continuous limit", 1e-6 * limits[0])
    assert_line(stress, "transient limit", 1e-6 * limits[1])
    (shaded,) = stress.bands
    (barred,) = strength.barred["line shaft"]
    assert (shaded.low, shaded.high) == (barred.bar_low, barred.bar_high)
    # Thousands of N m are given in kN m, in the caption and in the title of the axis
    # too.
    assert_line(tooth, "vibratory torque", 1e-3 * torques.vibratory)
    assert_line(tooth, "a third of the rated torque", 0.5)
    assert tooth.caption == "pinion - wheel: vibratory torque against its limit, kN m"
    # The ring is nearer to its limit than the coupling.
    assert heat.caption == "ring: heat against its limit, W"
    assert_line(heat, "heat", strength.heat["ring"].power)
    # Elements with limits are shown where more are named than have room.
    for names in (["coupling"], ["coupling", "engine", "pinion", "wheel", "propeller"]):
        torque, limit = figures_of(
            plot_forced, {"": response}, readings(response, names)
        )
        assert torque.caption.startswith("coupling: linear")
        assert limit.caption.startswith("coupling: heat")
    axes = plot_forced({"": response}, readings(response)).axes
    assert [panel.get_ylabel() for panel in axes[-3:]] == [
        "stress, MPa",
        "vibratory torque, kN m",
        "heat, W",
    ]
    # Speeds stand below one another in all panels.
    assert len({panel.get_xlim() for panel in axes}) == 1
    assert len(axes) == len(panels)
    assert axes[-3].patches


def test_the_picture_of_a_sweep_has_the_limits_of_the_motion(scene):
    train = jaxhb.load_scene(scene)
    rpm = [360.0, 420.0, 480.0]
    figures = figures_of(plot_sweep, answer_speeds(train, rpm, Asked()))
    strength = jaxhb.strength(jaxhb.solve_speeds(train, rpm=rpm))
    expected = np.asarray(strength.stresses["line shaft"].stress)
    assert_line(figures[2], "stress", 1e-6 * expected)
    assert len(figures) == 5
    assert figures[2].bands


@pytest.mark.slow
def test_a_limit_that_steps_between_two_speeds_is_drawn_upright(tmp_path):
    (tmp_path / "line.toml").write_text(
        SCENE.replace("stress_concentration = 0.45", 'rule = "KR generator shaft"')
    )
    train = jaxhb.load_scene(tmp_path / "line.toml")
    response = jaxhb.forced_response(train, rpm=[600.0, 960.0])
    stress = figures_of(plot_forced, {"": response}, readings(response))[2]
    (limit,) = [trace for trace in stress.traces if trace["name"] == "transient limit"]
    # 118 MPa up to 0.9 of 900 rpm, then 31 MPa f with f = 1 + 2/3 (500/440 - 1).
    assert limit["x"] == [600.0, 810.0, 810.0, 900.0, 900.0, 960.0]
    above = 31.0 * (1 + 2 / 3 * (500 / 440 - 1))
    assert limit["y"] == pytest.approx([118.0, 118.0, *[above] * 4], rel=1e-4)


def test_numbers_that_harmonic_balance_did_not_confirm_are_ringed_and_marked(scene):
    train = jaxhb.load_scene(scene)
    response = jaxhb.forced_response(train, rpm=[360.0, 420.0])
    strength = dataclasses.replace(
        jaxhb.strength(response), unconfirmed=np.array([False, True])
    )
    figure = limit_figure({"": strength}, "tooth_torques", "pinion|wheel", train)
    (ring,) = [
        trace
        for trace in figure.traces
        if trace["name"].startswith("ringed: not confirmed")
    ]
    assert ring["x"] == [420.0]
    assert ring["y"] == pytest.approx(
        [1e-3 * strength.tooth_torques["pinion|wheel"].vibratory[1]], rel=1e-4
    )
    table = next(
        part
        for part in strength_text({"": strength})
        if part.startswith("Torque of meshes")
    )
    assert "?: not confirmed by harmonic balance" in table.splitlines()[0]
    assert table.splitlines()[2].split()[1].endswith("?")
    assert "?" not in "".join(strength_text({"": jaxhb.strength(response)}))


def test_the_shaft_with_the_largest_stress_has_the_panel_where_no_shaft_has_a_limit():
    rows = {
        name: SimpleNamespace(stress=[1e6, top], continuous=None)
        for name, top in {"a": 3e6, "b": 9e6}.items()
    }
    strength = Strength(
        rpm=[1.0, 2.0], rated_rpm=None, stresses=rows, tooth_torques={}, heat={}
    )
    assert judged_elements(strength) == [("stresses", "b")]
    rows["a"].continuous = [4e7, 4e7]
    assert judged_elements(strength) == [("stresses", "a")]
