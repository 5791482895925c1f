"""Pictures of kinds of motion, branches and multipliers, by what their axes hold."""

from dataclasses import replace

import numpy as np
import pytest
import trains
from event_exact import Pair

import jaxhb
from jaxhb.report.figures.branch import plot_branch, plot_multipliers
from jaxhb.report.figures.motion import COLOURS, hardest_mesh, plot_cycle_peaks, plot_motions, plot_waterfall
from jaxhb.steady.steady_state import Cycles

SPEEDS = 0.6, 1.0, 1.1, 1.2
"""Of the lightly loaded pair, over its natural frequency: two cycles at 1.0, at 1.1 no period."""

GRID = trains.ONE_RADIAN_PER_SECOND * np.linspace(0.5, 1.2, 8)


@pytest.fixture(scope="module")
def sweep():
    """Every cycle the same, two cycles, irregular, and what would be drawn if nothing were known."""
    train = trains.pair_train(Pair(1.0, epsilon=1e-3), transition=1e-2)
    rpm = trains.ONE_RADIAN_PER_SECOND * np.array(SPEEDS)
    found = jaxhb.steady_state(train, rpm=rpm, cycles=Cycles(transient=64))
    nothing = replace(found[-1], kind="unknown", period=0, response=None, record=None, notes=("nothing is known",))
    found = replace(found, states=(*found.states[:-1], nothing))
    assert found.kind.tolist() == ["periodic", "subharmonic", "irregular", "unknown"]
    return found


@pytest.fixture(scope="module")
def loaded():
    """A pair with two stable motions between its folds: its branch, and the sweeps up and down."""
    train = trains.pair_train(Pair(1.0, mean=0.5, alternating=0.15, epsilon=1e-3), transition=1e-2)
    branch = jaxhb.follow(train, "rpm", start=GRID[0], to=GRID[-1])
    return branch, jaxhb.steady_state(train, rpm=GRID, direction="both")


def lines(axes, *, marker=None, colour=None, style=None):
    """Data ``(x, y)`` of the lines of an axes that have these properties."""
    wanted = {"get_marker": marker, "get_color": colour, "get_linestyle": style}
    return [
        line.get_data()
        for line in axes.get_lines()
        if all(value is None or getattr(line, name)() == value for name, value in wanted.items())
    ]


def bars(axes):
    """Vertical bars as rows x, low, high."""
    segments = [segment for collection in axes.collections for segment in collection.get_segments()]
    return np.array([(a[0], a[1], b[1]) for a, b in segments])


def test_every_kind_of_motion_has_a_marker_of_its_own_at_its_largest_force(sweep):
    (axes,) = plot_motions(sweep).axes
    for place, marker in ((0, "s"), (1, "D"), (2, "*")):
        ((x, y),) = lines(axes, marker=marker)
        assert x.tolist() == [sweep.rpm[place]]
        assert y == pytest.approx(float(sweep[place].force("a|b").peak) / 1e3, rel=1e-12)
    assert [text.get_text() for text in axes.texts] == ["2"]


def test_a_bar_covers_the_peaks_of_irregular_cycles_from_5_to_95_percent(sweep):
    (axes,) = plot_motions(sweep).axes
    signal = sweep[2].force("a|b")
    low, _, high = np.percentile(np.maximum(signal.highest, -signal.lowest), [5, 50, 95]) / 1e3
    np.testing.assert_allclose(bars(axes), [[sweep.rpm[2], low, high]])
    assert low < high < float(signal.peak) / 1e3


def test_an_unknown_motion_is_a_cross_at_the_bottom_and_no_line_leads_to_it(sweep):
    (axes,) = plot_motions(sweep).axes
    (cross,) = [line for line in axes.get_lines() if line.get_marker() == "x"]
    assert cross.get_xdata().tolist() == [sweep.rpm[3]]
    assert cross.get_transform() == axes.get_xaxis_transform() and cross.get_ydata()[0] < 0.05
    ((_, joined),) = lines(axes, style="-")
    assert np.isnan(joined).tolist() == [False, False, False, True]


def test_motions_upwards_are_filled_and_downwards_hollow_on_the_branch_that_has_both(loaded):
    branch, both = loaded
    (axes,) = plot_motions(*both, branches=[branch]).axes
    (filled, hollow) = (
        [
            x
            for line in axes.get_lines()
            if line.get_marker() == "s" and (line.get_markerfacecolor() == "none") == empty
            for x in line.get_xdata()
        ]
        for empty in (False, True)
    )
    assert filled == both[0].rpm[both[0].kind == "periodic"].tolist()
    assert hollow == both[1].rpm[both[1].kind == "periodic"].tolist()
    assert len(hollow) > len(filled) > 0


def test_periodic_solutions_are_drawn_beside_what_happens_where_they_are_solved(sweep):
    train = trains.pair_train(Pair(1.0, epsilon=1e-3), transition=1e-2)
    orbits = jaxhb.solve_speeds(train, rpm=sweep.rpm)
    (axes,) = plot_motions(sweep, orbits=orbits).axes
    ((x, y),) = lines(axes, marker="+")
    solved = np.asarray(orbits.converged)
    np.testing.assert_allclose(x, sweep.rpm[solved])
    np.testing.assert_allclose(y, np.asarray(orbits.force("a|b").peak)[solved] / 1e3)


def test_a_bifurcation_diagram_has_as_many_points_a_speed_as_the_motion_has_cycles(sweep):
    (axes,) = plot_cycle_peaks(sweep).axes
    drawn = {kind: lines(axes, colour=COLOURS[kind]) for kind in COLOURS}
    counts = {kind: len(data[0][0]) for kind, data in drawn.items() if data}
    assert counts == {"periodic": 1, "subharmonic": 2, "irregular": sweep[2].record.cycles, "unknown": 1}
    ((x, y),) = drawn["subharmonic"]
    assert set(x) == {sweep.rpm[1]}
    assert y.max() == pytest.approx(float(sweep[1].force("a|b").peak) / 1e3, rel=1e-12)
    assert np.ptp(y) > 0.1 * y.max()


def test_a_waterfall_has_a_stem_for_each_order_of_each_speed_in_one_scale(sweep):
    (axes,) = plot_waterfall(sweep, highest=3.0).axes
    *stems, scale = bars(axes)
    stems = np.array(stems)
    for place, step in ((0, 1.0), (1, 0.5), (2, 1.0)):
        own = stems[stems[:, 1] == sweep.rpm[place]]
        np.testing.assert_allclose(own[:, 0], np.arange(step, 3.01, step))
        amplitudes = np.asarray(sweep[place].force("a|b").amplitudes)[: len(own)]
        largest = max(float(np.max(state.force("a|b").amplitudes)) for state in sweep if state.known)
        np.testing.assert_allclose((own[:, 2] - own[:, 1]) / (scale[2] - scale[1]), amplitudes / largest)
    assert not (stems[:, 1] == sweep.rpm[3]).any()


def test_a_branch_is_solid_where_stable_and_dashed_between_its_folds(loaded):
    branch, _ = loaded
    above, below = plot_branch(branch).axes
    solid, dashed = lines(above, style="-"), lines(above, style="--")
    assert (len(solid), len(dashed)) == (2, 1)
    ((x, y),) = dashed
    np.testing.assert_allclose([x[0], x[-1]], branch.folds)
    np.testing.assert_allclose([solid[0][0][-1], solid[1][0][0]], branch.folds)
    at = [data for line in above.get_lines() if line.get_marker() == "D" for data in np.transpose(line.get_data())]
    np.testing.assert_allclose(at, [(x[0], y[0]), (x[-1], y[-1])])
    drawn = np.concatenate([forces for _, forces in solid + dashed])
    assert np.isin(branch.largest_force[:, 0] / 1e3, drawn).all()
    stable, unstable = lines(below, marker="o")
    assert (len(stable[0]), len(unstable[0])) == (branch.stable.sum(), (~branch.stable).sum())
    assert stable[1].max() < 1 < unstable[1].min()


def test_moduli_of_multipliers_have_the_limit_marked_and_how_stability_is_lost(sweep):
    train = trains.pair_train(Pair(1.0, epsilon=1e-3), transition=1e-2)
    asked = [jaxhb.stability(jaxhb.solve(train, rpm=rpm)) for rpm in sweep.rpm[:3]]
    (axes,) = plot_multipliers(sweep.rpm, [*asked, None]).axes
    ((x, y),) = lines(axes, marker="^")
    assert x.tolist() == sweep.rpm[1:3].tolist()
    assert y.tolist() == [found.largest for found in asked[1:]]
    stable, unstable = lines(axes, marker="o")
    assert stable[0].tolist() == [sweep.rpm[0]] and unstable[0].tolist() == sweep.rpm[1:3].tolist()
    assert any((np.asarray(y) == 1).all() for _, y in lines(axes, style="-"))
    assert lines(axes, marker="x")[0][0].tolist() == [sweep.rpm[3]]


def test_the_mesh_shown_is_the_hardest_and_a_train_without_one_is_refused():
    """Of all speeds: the first and the last alone would say the pump gear's, the one between says the cam gear's."""
    train = trains.build(trains.pinions_parts(50.0), reference="flywheel")
    sweep = jaxhb.steady_state(train, rpm=[1000.0, 2000.0, 1000.0])
    cam, pump = np.transpose([[float(state.force(mesh).peak) for mesh in train.topology.mesh_names] for state in sweep])
    assert (pump > cam).tolist() == [True, False, True] and cam.max() > pump.max()
    assert hardest_mesh(sweep) == "crank gear|cam gear"
    disks = [*trains.chain_parts([1.0, 1.0], [50.0]), jaxhb.Torque(disk="1", harmonics=((1.0, 10.0, 0.0),))]
    bare = jaxhb.steady_state(trains.build(disks), rpm=[1500.0])
    with pytest.raises(ValueError, match="has no mesh"):
        plot_motions(bare)
