"""Pictures, by what their axes hold."""

from types import SimpleNamespace

import numpy as np
import pytest

import jaxhb
from jaxhb.report.answer import Answer, orbit_state
from jaxhb.report.compute import Asked, answer_one, answer_speeds
from jaxhb.report.figures.cycle import in_the_gap, plot_cycle
from jaxhb.report.figures.style import new_figure
from jaxhb.report.figures.sweep import BESIDE, _draw_distributions, plot_sweep
from jaxhb.report.selection import default_gear


@pytest.fixture(scope="module")
def pair():
    """A hammering pair."""
    return answer_one(jaxhb.load_scene("spur_pair"), 5000.0, Asked())


def shaded(axes):
    """Share of the width of the axes that is shaded."""
    (area,) = axes.collections
    width = sum(np.ptp(path.vertices[:, 0]) for path in area.get_paths())
    return width / np.ptp(axes.get_xlim())


def test_gap_contact_is_shaded_for_the_share_of_the_cycle_that_the_teeth_are_apart(pair):
    figure = plot_cycle(pair)
    share = pair.response.mesh("gear a", "gear b").separated_fraction
    for axes in figure.axes:
        assert shaded(axes) == pytest.approx(share, abs=2e-3)


def test_the_curves_are_the_moment_in_newton_metres_and_the_force_in_kilonewtons(pair):
    response, linear = pair.response, pair.linear
    above, below = plot_cycle(pair, "gear b").axes
    after, before = above.get_lines()[:2]
    assert after.get_ydata().max() == pytest.approx(float(response.gear_torque("gear b").max), rel=1e-3)
    assert before.get_ydata().max() == pytest.approx(float(linear.gear_torque("gear b").max), rel=1e-3)
    assert after.get_xdata()[-1] == pytest.approx(360.0 * response.topology.revolutions_per_cycle)
    assert below.get_lines()[0].get_ydata().max() == pytest.approx(
        float(response.force("gear a", "gear b").max) / 1e3, rel=1e-3
    )
    assert {text.get_text() for text in above.get_legend().get_texts()} == {
        "with backlash",
        "without backlash",
        "teeth apart",
    }


def test_nothing_is_shaded_where_all_teeth_stay_in_contact(pair):
    linear = pair.without_backlash
    assert not plot_cycle(linear).axes[0].collections
    assert not in_the_gap(linear, "gear a|gear b", 64).any()


def test_the_picture_shows_the_gear_of_the_reference_rotor():
    train = jaxhb.load_scene("gear_train_30")
    linear = jaxhb.linear_response(train, rpm=1800.0)
    assert default_gear(Answer(train, orbit_state(linear), linear, orbit=True)) == "crank gear"


def test_a_train_without_teeth_shows_its_hardest_shaft():
    train = jaxhb.load_scene("six_cylinder_diesel")
    (axes,) = plot_cycle(answer_one(train, 1500.0, Asked())).axes
    response = jaxhb.solve(train, rpm=1500.0)
    peaks = [float(response.torque(name).max) for name in train.topology.shaft_names]
    assert axes.get_lines()[0].get_ydata().max() == pytest.approx(max(peaks), rel=1e-3)


def test_a_sweep_without_teeth_shows_both_measures_of_a_torque():
    train = jaxhb.load_scene("six_cylinder_diesel")
    (axes,) = plot_sweep(answer_speeds(train, [1000.0, 1800.0, 2600.0], Asked())).axes
    swing, total = (line.get_ydata() for line in axes.get_lines())
    assert (total > swing).all()


def test_the_bars_of_several_meshes_stand_beside_each_other():
    axes = new_figure(3.0).subplots()
    cycles = SimpleNamespace(per_cycle=SimpleNamespace(max=np.array([1e3, 2e3, 3e3])))
    irregular = {"state": SimpleNamespace(kind="irregular"), "answered": True, "force": lambda mesh: cycles}
    for beside in (0.0, BESIDE):
        _draw_distributions(axes, [SimpleNamespace(place=1800.0, **irregular)], "a|b", "red", beside)
    first, second = (line.get_transform().transform((1800.0, 1.0)) for line in axes.get_lines())
    np.testing.assert_allclose(second - first, [BESIDE / 72 * axes.figure.dpi, 0.0], atol=1e-9)
