"""Axes of the pictures of a cycle and of several speeds."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import jaxhb
from jaxhb.report.answer import SPEED, Answer, Case
from jaxhb.report.compute import Asked, answer_one, answer_speeds
from jaxhb.report.figures.cycle import cycle_figure, in_the_gap, plot_cycle
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import (
    DIGITS,
    MOTIONS,
    Axis,
    above,
    bands,
    figure,
    line,
    marks,
)
from jaxhb.report.figures.plotly import layout_of
from jaxhb.report.figures.speeds import (
    BESIDE,
    over_speed,
    plot_sweep,
    tolerance_figures,
)
from jaxhb.report.quantities import Quantity
from jaxhb.report.selection import subject_of
from jaxhb.results.steady import orbit_state


@pytest.fixture(scope="module")
def pair():
    """A hammering pair."""
    return answer_one(jaxhb.load_scene("spur_pair"), 5000.0, Asked())


def test_torque_and_force_are_drawn_with_gap_contact_shaded_for_its_share_of_the_cycle(
    pair,
):
    response = pair.response
    linear = pair.linear
    top, below = plot_cycle(pair, "gear b").axes
    after, before = top.get_lines()[:2]
    assert after.get_ydata().max() == pytest.approx(
        float(response.gear_torque("gear b").max), rel=1e-3
    )
    assert before.get_ydata().max() == pytest.approx(
        float(linear.gear_torque("gear b").max), rel=1e-3
    )
    assert after.get_xdata()[-1] == pytest.approx(
        360.0 * response.topology.revolutions_per_cycle
    )
    force = float(response.force("gear a", "gear b").max) / 1e3
    assert below.get_lines()[0].get_ydata().max() == pytest.approx(force, rel=1e-3)
    share = response.mesh("gear a", "gear b").separated_fraction
    for axes in (top, below):
        widths = [band.get_width() for band in axes.patches]
        assert sum(widths) / np.ptp(axes.get_xlim()) == pytest.approx(share, abs=2e-3)
    legend = top.get_legend()
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == ["with backlash", "without backlash"]
    title = legend.get_title().get_text().replace("\n", " ")
    assert title.endswith("grey: its teeth are separated")


def test_nothing_is_shaded_where_all_teeth_stay_in_contact(pair):
    linear = pair.without_backlash
    assert not plot_cycle(linear).axes[0].patches
    assert not in_the_gap(linear, "gear a|gear b", 64).any()


def test_the_picture_of_an_unknown_motion_has_its_reason_and_the_linear_motion(pair):
    state = dataclasses.replace(
        pair.state, kind="unknown", period=0, response=None, notes=("it gains speed",)
    )
    figure = plot_cycle(Answer(pair.train, state, pair.linear))
    assert figure.get_suptitle() == "spur_pair, 5000 rpm: unknown: it gains speed"
    for axes in figure.axes:
        curves = [curve for curve in axes.get_lines() if len(curve.get_xdata()) > 2]
        assert [curve.get_linestyle() for curve in curves] == ["--"]
        assert not axes.patches


def test_the_picture_shows_the_gear_of_the_reference_rotor():
    train = jaxhb.load_scene("gear_train_30")
    linear = jaxhb.linear_response(train, rpm=1800.0)
    answer = Answer(train, orbit_state(linear), linear, orbit=True)
    assert subject_of(answer)[0] == "crank gear"


def test_a_train_without_teeth_shows_its_hardest_shaft_and_two_measures_of_torque():
    answers = answer_speeds(
        jaxhb.load_scene("six_cylinder_diesel"), [1000.0, 1500.0], Asked()
    )
    response = answers["up"][1].response
    peaks = [float(response.torque(name).max) for name in response.topology.shaft_names]
    (axes,) = plot_cycle(answers["up"][1]).axes
    assert axes.get_lines()[0].get_ydata().max() == pytest.approx(
        1e-3 * max(peaks), rel=1e-3
    )
    assert axes.get_ylabel() == "torque, kN m"
    swing, total, _ = plot_sweep(answers).axes[0].get_lines()
    assert (total.get_ydata() > swing.get_ydata()).all()


def test_the_bars_of_several_meshes_stand_beside_each_other():
    spread = SimpleNamespace(peak=0.0)
    cycles = SimpleNamespace(
        per_cycle=SimpleNamespace(peak=np.array([1e3, 2e3, 3e3])),
        peak=3e3,
        spread=spread,
    )
    topology = SimpleNamespace(mesh_names=("a|b", "b|c"), mesh_backlash=(0.0, 0.0))

    def irregular(rpm):
        return SimpleNamespace(
            place=rpm,
            rpm=rpm,
            axis=SPEED,
            train=SimpleNamespace(topology=topology),
            topology=topology,
            state=SimpleNamespace(kind="irregular"),
            force=lambda mesh: cycles,
            linear=None,
            answered=True,
            unstable=False,
            unconfirmed=False,
        )

    answers = [irregular(1800.0), irregular(2000.0)]
    quantity = Quantity("tooth_force_peak", topology.mesh_names, "mesh")
    figure = over_speed(quantity, topology.mesh_names, [Case("", answers)])
    (bars,) = [
        trace for trace in figure.traces if trace["name"] == "5 to 95 % of the cycles"
    ]
    beside = 1800.0 + BESIDE * np.ptp(figure.x.limits)
    expected = [1800, 1800, None, 2000, 2000, None]
    expected += [beside, beside, None, beside + 200, beside + 200, None]
    np.testing.assert_allclose(
        np.array(bars["x"], float),
        np.array(expected, float),
        rtol=0.5 * 10 ** (1 - DIGITS),
    )
    assert bars["y"] == [1.0, 3.0, None] * 4


@pytest.fixture(scope="module")
def specification():
    """Two panels: a dashed line with a gap and several marks in the first, a stepped
    line, a cross, bands and a text in the second.
    """
    dashed = line(
        [0.0, 1.0, 2.0, 3.0],
        [1.0, np.nan, 3.0, -2.0],
        "dashed",
        1,
        mode="lines+markers",
    )
    dashed["marker"] = {
        "symbol": ["circle", "circle", "square-open", "star"],
        "size": 10,
    }
    stepped = line(
        [],
        [2.0, 4.0, 6.0],
        "stepped",
        panel=1,
        look={"shape": "hv", "dash": "dot"},
        x0=0.0,
        dx=1.5,
    )
    del stepped["x"]
    traces = [
        dashed,
        stepped,
        marks([2.0], [3.0], "cross", "x-thin-open", panel=1, showlegend=False),
    ]
    return figure(
        "What is drawn",
        Axis("angle", (0.0, 3.0), step=1.5),
        [
            Axis("first", (-4.0, 4.0), ticks={-4: "low", 4: "very<br>high"}),
            Axis("second"),
        ],
        traces,
        bands=[*bands([(0.5, 1.0)]), *bands([(2.0, 2.5)], 1)],
        notes=[above("name", 1)],
    )


def test_a_specification_is_drawn_with_its_lines_gaps_marks_bands_ticks_and_texts(
    specification,
):
    top, below = drawn(specification, title="scene").axes
    dashed, round_, square, star = top.get_lines()[:4]
    assert dashed.get_linestyle() == "--"
    assert dashed.get_marker() == "None"
    np.testing.assert_array_equal(dashed.get_ydata(), [1.0, np.nan, 3.0, -2.0])
    assert [curve.get_marker() for curve in (round_, square, star)] == ["o", "s", "*"]
    assert square.get_xydata().tolist() == [[2.0, 3.0]]
    assert square.get_markerfacecolor() == "none"
    stepped, cross = below.get_lines()[:2]
    assert stepped.get_drawstyle() == "steps-post"
    assert stepped.get_xdata().tolist() == [0.0, 1.5, 3.0]
    assert cross.get_marker() == "x"
    assert cross.get_linestyle() == "None"
    for axes, expected in ((top, [(0.5, 1.0)]), (below, [(0.5, 1.0), (2.0, 2.5)])):
        shaded = [
            (band.get_x(), band.get_x() + band.get_width()) for band in axes.patches
        ]
        assert shaded == expected
        assert axes.get_xlim() == (0.0, 3.0)
        assert axes.get_xticks().tolist() == [0.0, 1.5, 3.0]
    assert top.get_ylim() == (-4, 4)
    assert top.get_ylabel() == "first"
    assert below.get_xlabel() == "angle"
    assert top.get_xlabel() == ""
    assert [label.get_text() for label in top.get_yticklabels()] == [
        "low",
        "very\nhigh",
    ]
    assert [text.get_text() for text in below.texts] == ["name"]
    legend = top.get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["dashed", "stepped"]
    assert legend.get_title().get_text() == "What is drawn"


def test_figures_stand_one_below_the_other_each_with_its_axis_and_legend(specification):
    axis = dataclasses.replace(specification.x, title="force", limits=(0.0, 9.0))
    second = dataclasses.replace(specification, caption="Other", x=axis)
    axes = drawn(specification, second).axes
    assert [(panel.get_xlabel(), panel.get_xlim()[1]) for panel in axes] == [
        ("", 3),
        ("angle", 3),
        ("", 9),
        ("force", 9),
    ]
    assert [panel.get_legend().get_title().get_text() for panel in axes[::2]] == [
        "What is drawn",
        "Other",
    ]


def test_thousands_are_shown_in_the_next_larger_unit_panel_by_panel():
    traces = [
        line([0.0, 1.0], [12000.0, -3.0], "torque"),
        line([0.0, 1.0], [900.0, np.nan], "heat", panel=1),
    ]
    rescaled = figure(
        "two panels, N m",
        Axis("rpm"),
        [Axis("torque, N m", (0.0, 13000.0)), Axis("heat, W")],
        traces,
    )
    titles = [axis.title for axis in rescaled.panels]
    assert titles == ["torque, kN m", "heat, W"]
    assert rescaled.panels[0].limits == (0.0, 13.0)
    assert [trace["y"] for trace in rescaled.traces] == [[12.0, -0.003], [900.0, None]]
    single = figure(
        "the panel, N m; grey: barred", Axis("rpm"), "torque, N m", traces[:1]
    )
    assert single.caption == "the panel, kN m; grey: barred"
    # The traces themselves stay as they are.
    assert traces[0]["y"] == [12000.0, -3.0]


def test_tiny_numbers_have_a_smaller_unit_so_that_an_axis_shows_more_than_zeros():
    tiny = (
        line([0.0, 1.0], [8.7e-9, 3e-9], "force"),
        line([0.0, 1.0], [2e-8, 0.0], "angle", panel=1),
    )
    rescaled = figure(
        "two panels",
        Axis("rpm"),
        [Axis("force, kN", (0.0, 1e-8)), Axis("angle, deg")],
        tiny,
    )
    titles = [axis.title for axis in rescaled.panels]
    assert titles == ["force, 1e-6 N", "angle, 1e-9 deg"]
    assert [trace["y"] for trace in rescaled.traces] == [[8.7, 3.0], [20.0, 0.0]]
    assert rescaled.panels[0].limits == pytest.approx([0.0, 10.0])
    assert (
        figure("a - b, kN", Axis("rpm"), "force, kN", tiny[:1]).caption
        == "a - b, 1e-6 N"
    )
    picture = drawn(rescaled)
    picture.canvas.draw()
    for axes in picture.axes:
        labels = [label.get_text() for label in axes.get_yticklabels()]
        assert len(set(labels)) == len(labels)


def test_numbers_of_one_speed_are_marked_and_differ_without_colour():
    names = ("half peak-to-peak", "limit", "sum of amplitudes")
    single = figure(
        "",
        Axis("rpm"),
        "torque, N m",
        [line([500.0], [1.0 + k], name, k) for k, name in enumerate(names)],
    )
    symbols = {trace["marker"]["symbol"] for trace in single.traces}
    assert len(symbols) == len(names)
    assert not symbols & {symbol for symbol, _ in MOTIONS.values()}
    markers = {curve.get_marker() for curve in drawn(single).axes[0].get_lines()}
    assert len(markers) == len(names)
    assert "None" not in markers
    # No line reaches a point between gaps either; where every point has another beside
    # it there are no marks.
    assert line([1.0, 2.0, 3.0], [1.0, np.nan, 2.0], "gap")["mode"] == "lines+markers"
    assert line([1.0, 2.0, 3.0], [1.0, 2.0, np.nan], "line")["mode"] == "lines"


def test_a_title_longer_than_its_panel_is_high_stands_in_rows_beside_the_numbers():
    titled = figure(
        "", Axis("rpm"), "stress over continuous limit", [line([0.0], [1.0], "a")]
    )
    plainer = figure("", Axis("rpm"), "stress, MPa", [line([0.0], [1.0], "a")])
    layouts = [layout_of(each) for each in (titled, plainer)]
    title = layouts[0]["yaxis"]["title"]
    assert title["text"] == "stress over continuous<br>limit"
    assert title["standoff"] > 0
    assert layouts[0]["margin"]["l"] > layouts[1]["margin"]["l"]
    assert drawn(titled).axes[0].get_ylabel() == "stress over continuous\nlimit"


@pytest.mark.parametrize(("revolutions", "step"), [(2, 90), (5, 180), (10, 360)])
def test_the_angles_of_a_long_cycle_have_few_ticks_at_quarters_or_whole_revolutions(
    revolutions, step
):
    parts = [
        jaxhb.Disk(name="a", inertia=1.0),
        jaxhb.Disk(name="b", inertia=1.0),
        jaxhb.Shaft(between=("a", "b"), stiffness=1e3, damping=1.0),
        jaxhb.Torque(disk="a", harmonics=[(1.0, 5.0, 0.0)]),
    ]
    train = jaxhb.build(parts, revolutions_per_cycle=revolutions)
    linear = jaxhb.linear_response(train, rpm=100.0)
    answer = Answer(train, orbit_state(linear), linear, orbit=True)
    assert cycle_figure(answer, "a|b", (), "").x.step == step


def test_the_middle_of_the_sample_is_called_its_median():
    ones = np.ones((2, 1))
    spread = SimpleNamespace(
        rpm=np.array([100.0, 200.0]),
        labels=["shaft torque of a|b"],
        drawn=[1.0],
        of=[SimpleNamespace(quantity="shaft torque")],
        percentile=lambda percent: percent * ones,
        nominal=ones,
        worst=2 * ones,
        bound=np.nan * ones,
    )
    (picture,) = tolerance_figures(spread)
    (median,) = [
        trace for trace in picture.traces if trace["name"] == "median of the sample"
    ]
    assert median["y"] == [50.0, 50.0]
    assert picture.panels[0].title == "shaft torque, N m"
