"""Text for people: columns, numbers, notes, and the line that ticks."""

import dataclasses
import io

import numpy as np
import pytest

import jaxhb
from jaxhb.response.events import Shooting
from jaxhb.response.response import stack
from jaxhb.show.plots import plot_sweep
from jaxhb.show.progress import Progress
from jaxhb.show.report import notes
from jaxhb.show.tables import _ranges, aligned, alike, ratios, shares, sweep_text


def test_numbers_that_are_compared_share_their_decimals():
    assert alike([24.0447, -5.644], [0.0, 3.3]) == [["24.04", "-5.64"], ["0.00", "3.30"]]
    assert alike([1187.6, -0.2]) == [["1188", "0"]]
    assert alike([float("nan"), 0.012345]) == [["-", "0.01235"]]


def test_a_short_separation_is_not_shown_as_none():
    assert shares([0.0, 1e-4, 0.4191, None]) == ["0.0", "<0.1", "41.9", "-"]


def test_nothing_is_divided_by_zero():
    assert ratios([1.0, 3.0], [0.0, 2.0]) == ["-", "1.50"]


def test_columns_line_up_under_their_groups():
    lines = aligned(["gear", "with", "without"], [["a", "long"], ["1", "2"], ["3", "4"]], [("both", 1, 2)]).splitlines()
    assert lines == ["        ---- both ---", "  gear  with  without", "  a        1        3", "  long     2        4"]


def test_speeds_that_follow_each_other_are_told_as_a_range():
    assert _ranges([1, 2, 3, 4, 5], {2, 3, 5}) == "2-3, 5"


def test_a_soft_gap_and_a_high_knee_are_noted():
    train = jaxhb.load_scene("spur_pair")
    sharp = jaxhb.solve(train, rpm=2000.0)
    assert notes(sharp) == []
    soft = dataclasses.replace(sharp.law, epsilon=np.array([0.03]), transition=np.array([0.2]))
    found = notes(dataclasses.replace(sharp, law=soft))
    assert any("the spring in the gap carries up to" in note and "lower epsilon" in note for note in found)
    assert any("stiff only above" in note and "smaller transition" in note for note in found)


def test_a_motion_found_by_shooting_is_said_to_be_perhaps_unstable():
    sharp = jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=2000.0)
    shot = dataclasses.replace(sharp, path=(Shooting(1, 1024, 1e-9, closed=True), *sharp.path))
    (note,) = notes(shot)
    assert "found at 2000 rpm" in note and "may be unstable" in note
    assert notes(dataclasses.replace(shot, status=np.array(int(jaxhb.Status.STALLED)))) == []


@pytest.fixture(scope="module")
def sweep():
    """Two speeds: a hammering solution, and the same as if it had not converged."""
    one = jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=5000.0)
    return stack([one, dataclasses.replace(one, rpm=np.array(5100.0), status=np.array(1))])


def test_a_sweep_tells_where_teeth_separate_and_what_did_not_converge(sweep):
    lines = sweep_text(sweep, sweep).splitlines()
    assert lines[0] == (
        "Teeth separate at 2 of 2 speeds between 5000 and 5100 rpm: 5000-5100 rpm; "
        "1 did not converge, do not rely on those."
    )
    assert [line.split()[-1] for line in lines[3:5]] == ["converged", "met"]
    assert any(line.startswith("TOLERANCE_NOT_MET at 5100 rpm: ") for line in lines)


def test_a_picture_of_a_sweep_marks_what_did_not_converge(sweep):
    above, below = plot_sweep(sweep, sweep).axes
    crosses = next(line for line in above.get_lines() if line.get_marker() == "x")
    assert crosses.get_xdata().tolist() == [5100.0]
    share = 100 * sweep[0].mesh("gear a", "gear b").separated_fraction
    assert below.get_lines()[0].get_ydata() == pytest.approx([share, share])


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


@pytest.mark.parametrize(("stream", "expected"), [(io.StringIO(), False), (Terminal(), True)])
def test_progress_is_told_on_a_terminal_only(stream, expected, monkeypatch):
    monkeypatch.setattr("jaxhb.show.progress.INTERVAL", 0.01)
    with Progress(2, stream) as progress:
        progress.step("600 rpm")
        progress.ended.wait(0.1)
    assert ("1 of 2: 600 rpm" in stream.getvalue()) is expected
    assert not expected or stream.getvalue().endswith("\r")
