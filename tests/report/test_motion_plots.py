"""Axes of the pictures of kinds of motion, branches and multipliers."""

from dataclasses import replace
from types import SimpleNamespace

import motion_pictures as pictures
import numpy as np
import pytest
import trains

import jaxhb
from jaxhb.report.figures.figure import DIGITS
from jaxhb.steady.steady_state import Cycles

SPEEDS = 0.6, 1.0, 1.1, 1.2
"""Speeds of the lightly loaded pair over its natural frequency, with a period of two
cycles at 1.0, and no period at 1.1.
"""

GRID = trains.ONE_RADIAN_PER_SECOND * np.linspace(0.5, 1.2, 8)
ROUNDING = 10.0 ** (1 - DIGITS)
"""Relative error of the digits that a figure has."""


@pytest.fixture(scope="module")
def sweep():
    """A periodic motion, one of two cycles, an irregular and an unknown one."""
    train = trains.pair_train(trains.Pair(1.0, epsilon=1e-3), transition=1e-2)
    rpm = trains.ONE_RADIAN_PER_SECOND * np.array(SPEEDS)
    motions = jaxhb.steady_state(train, rpm=rpm, cycles=Cycles(transient=64))
    unknown = replace(
        motions[-1],
        kind="unknown",
        period=0,
        response=None,
        record=None,
        notes=("nothing is known",),
    )
    motions = replace(motions, states=(*motions.states[:-1], unknown))
    assert motions.kind.tolist() == ["periodic", "subharmonic", "irregular", "unknown"]
    return motions


@pytest.fixture(scope="module")
def loaded():
    """The branch, and the sweeps up and down, of a pair with two stable motions between
    its folds.
    """
    train = trains.pair_train(
        trains.Pair(1.0, mean=0.5, alternating=0.15, epsilon=1e-3), transition=1e-2
    )
    branch = jaxhb.follow(train, "rpm", start=GRID[0], to=GRID[-1])
    return branch, jaxhb.steady_state(train, rpm=GRID, direction="both")


def lines(axes, *, marker=None, style=None):
    """Data ``(x, y)`` of the lines of an axes with a marker or style, without keys of
    the legend.
    """
    return [
        line.get_data()
        for line in axes.get_lines()
        if marker in (None, line.get_marker())
        and style in (None, line.get_linestyle())
        and np.isfinite(line.get_xdata()).any()
    ]


def peaks(state):
    """Largest force of every cycle, kN."""
    signal = state.force("a|b")
    return np.maximum(signal.highest, -signal.lowest) / 1e3


@pytest.mark.slow
def test_every_motion_is_marked_by_its_kind_its_period_and_the_range_of_its_cycles(
    sweep,
):
    orbits = SimpleNamespace(
        rpm=sweep.rpm,
        converged=[True, False, True, True],
        force=lambda mesh: SimpleNamespace(peak=np.array([1e3, 2e3, 3e3, 4e3])),
    )
    (axes,) = pictures.plot_motions(sweep, orbits=orbits).axes
    for place, marker in ((0, "s"), (1, "D"), (2, "*")):
        ((x, y),) = lines(axes, marker=marker)
        np.testing.assert_allclose(
            [x[0], y[0]], [sweep.rpm[place], peaks(sweep[place]).max()], rtol=ROUNDING
        )
    assert [text.get_text() for text in axes.texts] == ["2"]
    ((x, y),) = lines(axes, marker="x")
    np.testing.assert_allclose([x[0], y[0]], [sweep.rpm[3], 0.0], rtol=ROUNDING)
    joined, bar, *_ = lines(axes, style="-")
    assert np.isnan(joined[1]).tolist() == [False, False, False, True]
    np.testing.assert_allclose(
        bar[1][:2], sweep[2].force("a|b").per_cycle.max[[0, 2]] / 1e3, rtol=ROUNDING
    )
    ((x, y),) = lines(axes, marker="+")
    np.testing.assert_allclose(
        [x, y], [sweep.rpm[[0, 2, 3]], [1.0, 3.0, 4.0]], rtol=ROUNDING
    )


@pytest.mark.slow
def test_motions_upwards_are_filled_and_downwards_hollow_on_the_branch_that_has_both(
    loaded,
):
    branch, (upwards, downwards) = loaded
    (axes,) = pictures.plot_motions(upwards, downwards, branches=[branch]).axes
    squares = [
        line
        for line in axes.get_lines()
        if line.get_marker() == "s" and np.isfinite(line.get_xdata()).all()
    ]
    faces = [line.get_markerfacecolor() == "none" for line in squares]
    assert faces == [False, True]
    for line, sweep in zip(squares, (upwards, downwards), strict=True):
        np.testing.assert_allclose(
            line.get_xdata(), sweep.rpm[sweep.kind == "periodic"], rtol=ROUNDING
        )
    assert len(squares[1].get_xdata()) > len(squares[0].get_xdata()) > 0
    assert len(lines(axes, marker="D")[0][0]) == len(branch.folds) == 2


@pytest.mark.slow
def test_a_bifurcation_diagram_has_as_many_points_a_speed_as_the_motion_has_cycles(
    sweep,
):
    (axes,) = pictures.plot_cycle_peaks(sweep).axes
    for place, marker, count in (
        (0, "s", 1),
        (1, "D", 2),
        (2, "*", sweep[2].record.cycles),
        (3, "x", 1),
    ):
        ((x, y),) = lines(axes, marker=marker)
        np.testing.assert_allclose(x, [sweep.rpm[place]] * count, rtol=ROUNDING)
        np.testing.assert_allclose(
            y, peaks(sweep[place]) if place < 3 else 0.0, rtol=ROUNDING
        )


@pytest.mark.slow
def test_a_waterfall_has_a_stem_for_each_order_of_each_speed_in_one_scale(sweep):
    (axes,) = pictures.plot_waterfall(sweep, highest=3.0).axes
    _, stems, (_, scale) = lines(axes, style="-")
    x = stems[0][::3]
    low = stems[1][::3]
    high = stems[1][1::3]
    largest = max(
        float(np.max(state.force("a|b").amplitudes)) for state in sweep if state.known
    )
    for place, step in ((0, 1.0), (1, 0.5), (2, 1.0)):
        at_speed = np.isclose(low, sweep.rpm[place], rtol=ROUNDING)
        np.testing.assert_allclose(x[at_speed], np.arange(step, 3.01, step))
        amplitudes = np.asarray(sweep[place].force("a|b").amplitudes)[: at_speed.sum()]
        heights = (high - low)[at_speed] / (scale[1] - scale[0])
        # The speeds are rounded too.
        np.testing.assert_allclose(heights, amplitudes / largest, atol=2e-4)
    assert len(x) == 3 + 6 + 3
    assert [len(lines(axes, marker=marker)) for marker in "sD*x"] == [1, 1, 1, 1]


@pytest.mark.slow
def test_a_branch_is_solid_where_stable_and_dashed_between_its_folds(loaded):
    branch, _ = loaded
    above, below = pictures.plot_branch(branch).axes
    solid = lines(above, style="-")
    dashed = lines(above, style="--")
    assert len(solid) == 2
    assert len(dashed) == 1
    ((x, y),) = dashed
    np.testing.assert_allclose([x[0], x[-1]], branch.folds, rtol=ROUNDING)
    np.testing.assert_allclose(
        [solid[0][0][-1], solid[1][0][0]], branch.folds, rtol=ROUNDING
    )
    ((fold_rpm, fold_forces),) = lines(above, marker="D")
    np.testing.assert_allclose([fold_rpm, fold_forces], [(x[0], x[-1]), (y[0], y[-1])])
    drawn = np.concatenate([values for _, values in solid + dashed])
    forces = branch.largest_force[:, :1] / 1e3
    assert np.isclose(forces, drawn, rtol=ROUNDING).any(axis=1).all()
    stable, unstable = lines(below, marker="o")
    assert len(stable[0]) == branch.stable.sum()
    assert len(unstable[0]) == (~branch.stable).sum()
    assert stable[1].max() < 1 < unstable[1].min()


def stability_of(*, largest, stable, loses_by):
    """A stability with the multipliers 0.5j and, of the rotation, 1."""
    return SimpleNamespace(
        multipliers=np.array([0.5j, 1.0]),
        rotation=np.array([False, True]),
        largest=largest,
        stable=stable,
        loses_by=loses_by,
    )


def test_multipliers_beyond_1_are_marked_with_how_stability_is_lost():
    stable = stability_of(largest=0.5, stable=True, loses_by=None)
    lost = stability_of(largest=1.2, stable=False, loses_by="period doubling")
    (axes,) = pictures.plot_multipliers(
        [1000.0, 2000.0, 3000.0], [stable, lost, None]
    ).axes
    places = {
        marker: [np.ravel(data).tolist() for data in lines(axes, marker=marker)]
        for marker in "o^x"
    }
    assert places == {
        "o": [[1e3, 2e3, 0.5, 0.5], [1e3, 0.5], [2e3, 1.2]],
        "^": [[2e3, 1.2]],
        "x": [[3e3, 0.05]],
    }
    assert any((np.asarray(y) == 1).all() for _, y in lines(axes, style="-"))


def test_the_mesh_shown_is_the_hardest_of_all_and_a_train_without_one_is_refused():
    def state(**peaks):
        forces = {
            mesh: SimpleNamespace(highest=np.array([peak]), lowest=-0.5)
            for mesh, peak in peaks.items()
        }
        topology = SimpleNamespace(mesh_names=tuple(peaks), name="t")
        return SimpleNamespace(topology=topology, known=True, force=forces.get)

    states = [
        state(cam=1.0, pump=2.0),
        state(cam=4.0, pump=3.0),
        state(cam=1.0, pump=2.0),
    ]
    assert pictures.hardest_mesh(states) == "cam"
    with pytest.raises(ValueError, match="t has no mesh"):
        pictures.plot_motions([state()])
