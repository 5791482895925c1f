"""Text for people: columns, numbers, notes, and the line that ticks."""

import dataclasses
import io
import time
from types import SimpleNamespace

import numpy as np
import pytest
from printed import HAMMERING, check_text

import jaxhb
from jaxhb._shown import ranges
from jaxhb.cli.progress import Progress
from jaxhb.report.answer import Answer
from jaxhb.report.compute import Asked, answer_one
from jaxhb.report.figures.figure import DIGITS, numbers
from jaxhb.report.figures.speeds import plot_sweep
from jaxhb.report.files.numbers import answer_record, answer_row
from jaxhb.report.files.output import as_bytes
from jaxhb.report.table import Column, Table
from jaxhb.report.text.cases import solve_text
from jaxhb.report.text.columns import (
    alike,
    fixed,
    hit,
    percent,
    plain_number,
    ratio,
)
from jaxhb.report.text.linear import modes_text
from jaxhb.report.text.sentences import notes
from jaxhb.report.text.sweep_tables import sweep_text
from jaxhb.results.status import NewtonOnSweeps
from jaxhb.results.steady import orbit_state


def test_numbers_that_are_compared_share_their_decimals():
    assert alike([24.0447, -5.644], [0.0, 3.3]) == [
        ["24.04", "-5.64"],
        ["0.00", "3.30"],
    ]
    assert alike([1187.6, -0.2]) == [["1188", "0"]]
    assert alike([float("nan"), 0.012345]) == [["-", "0.01235"]]


def test_a_short_separation_is_not_shown_as_none():
    assert list(map(percent, [0.0, 1e-4, 0.4191, None])) == ["0.0", "<0.1", "41.9", "-"]


def test_nothing_is_divided_by_zero():
    assert ratio((1.0, 0.0)) == "-"
    assert ratio((3.0, 2.0)) == "1.50"


def test_columns_line_up_under_their_groups():
    columns = ["gear", Column("with", group="both"), Column("without", group="both")]
    lines = Table("", columns, [("a", 1, 3), ("long", 2, 4)]).splitlines()
    assert lines == [
        "        ---- both ---",
        "  gear  with  without",
        "  a        1        3",
        "  long     2        4",
    ]


def test_speeds_that_follow_each_other_are_told_as_a_range():
    assert ranges([1, 2, 3, 4, 5], {2, 3, 5}) == "2-3, 5"


def test_a_soft_gap_and_a_high_knee_are_noted():
    train = jaxhb.load_scene("spur_pair")
    assert notes(answer_one(train, 2000.0, Asked())) == []
    soft = train.replace(
        {"gear a|gear b.epsilon": 0.03, "gear a|gear b.transition": 0.2}
    )
    soft_notes = notes(answer_one(soft, 2000.0, Asked()))
    assert any(
        "the spring in the gap carries up to" in note and "lower epsilon" in note
        for note in soft_notes
    )
    assert any(
        "full stiffness only above" in note and "smaller transition" in note
        for note in soft_notes
    )
    # The mean is the same at all speeds.
    slow = answer_one(soft, 1500.0, Asked())
    assert notes(slow, answer_one(soft, 2000.0, Asked())) == soft_notes


def as_orbit(response, stability=None):
    """A response as the answer of --orbit."""
    linear = jaxhb.linear_response(response.train, rpm=response.rpm)
    return Answer(
        response.train,
        orbit_state(response),
        linear,
        orbit=True,
        stability=stability,
    )


def test_an_orbit_of_newtons_method_with_unknown_stability_may_be_unstable():
    sharp = jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=2000.0)
    searched = dataclasses.replace(
        sharp, path=(NewtonOnSweeps(40, 1024, 1e-6), *sharp.path)
    )
    (note,) = notes(as_orbit(searched))
    assert "2000 rpm" in note
    assert "may be" in note
    assert "unstable" in note
    stable = SimpleNamespace(largest=0.5, stable=True, loses_by=None)
    assert notes(as_orbit(searched, stability=stable)) == []
    stalled = dataclasses.replace(searched, status=np.array(int(jaxhb.Status.STALLED)))
    assert notes(as_orbit(stalled)) == []


def test_no_unstable_motion_goes_without_the_word():
    grows = SimpleNamespace(largest=2.5, stable=False, loses_by="fold")
    orbit = as_orbit(
        jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=5000.0), stability=grows
    )
    check_text("text_of_an_unstable_motion", solve_text(orbit), HAMMERING)
    check_text("text_of_unstable_motions", sweep_text({"orbit": [orbit]}), HAMMERING)
    massless = dataclasses.replace(orbit, stability=None, undecided="a massless disk")
    sentence = "stability not decided: a massless disk"
    assert sentence in solve_text(massless).splitlines()[3]


@pytest.fixture(scope="module")
def sweep():
    """A hammering periodic solution, and the same as if its truncation error were too
    large.
    """
    hammering = jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=5000.0)
    doubtful = dataclasses.replace(hammering, rpm=np.array(5100.0), status=np.array(1))
    return [as_orbit(hammering), as_orbit(doubtful)]


def test_irregularity_is_in_per_cent_for_people_and_a_share_for_programs(sweep):
    table = next(
        part
        for part in solve_text(sweep[0]).split("\n\n")
        if part.startswith("Speed of disks")
    )
    head, *rows = (line.split() for line in table.splitlines()[1:])
    assert head[-3:] == ["irregularity", "%", "acceleration"]
    for row, disk in zip(rows, ("gear a", "gear b"), strict=True):
        share = answer_record(sweep[0])["disks"][disk]["irregularity"]
        assert share == answer_row(sweep[0])[f"{disk} irregularity"]
        assert float(row[-2]) == pytest.approx(100 * share, rel=6e-3)


def test_a_sweep_tells_where_teeth_separate_and_what_did_not_converge(sweep):
    text = sweep_text({"orbit": sweep})
    check_text("text_of_doubtful_motions", text, HAMMERING)
    certain, doubted = (line.split() for line in text.splitlines()[5:7])
    assert doubted[4] == f"{certain[4]}?"


def test_an_unknown_motion_is_dashes_in_a_table_and_a_gap_with_a_cross_in_a_picture(
    sweep,
):
    stalled = dataclasses.replace(
        sweep[0].response,
        rpm=np.array(5200.0),
        status=np.array(int(jaxhb.Status.STALLED)),
    )
    answers = [*sweep, as_orbit(stalled)]
    row = sweep_text({"orbit": answers}).splitlines()[8].split()
    assert row == ["5200", "-", "-", "-", "-", "-", "-", "128", "stalled"]
    above, below = plot_sweep({"orbit": answers}).axes
    (cross,) = [
        line
        for line in above.get_lines()
        if line.get_marker() == "x" and len(line.get_xdata())
    ]
    assert cross.get_xdata().tolist() == [5100.0, 5200.0]
    share = 100 * sweep[0].contacts["gear a|gear b"].separated_fraction
    np.testing.assert_allclose(
        below.get_lines()[0].get_ydata(),
        [share, np.nan, np.nan],
        rtol=0.5 * 10 ** (1 - DIGITS),
    )
    assert np.isnan(above.get_lines()[0].get_ydata()).tolist() == [False, True, True]


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


@pytest.mark.parametrize("stream", [io.StringIO(), Terminal()], ids=["log", "terminal"])
def test_progress_is_one_line_on_a_terminal_and_a_line_now_and_then_in_a_log(
    stream, monkeypatch
):
    monkeypatch.setattr("jaxhb.cli.progress.INTERVAL", 0.01)
    monkeypatch.setattr("jaxhb.cli.progress.LOGGED", 0.01)
    with Progress(2, stream) as progress:
        progress.say("600 rpm")
        progress.advance(1)
        progress.ended.wait(0.1)
    log = stream.getvalue()
    assert "1 of 2: 600 rpm" in log
    assert log.endswith("\r") == stream.isatty()
    assert ("\n" in log) != stream.isatty()


@pytest.mark.parametrize(
    "failure", [OSError(28, "no space"), ValueError("closed file")]
)
def test_progress_that_cannot_be_written_ends_no_computation(failure, monkeypatch):
    monkeypatch.setattr("jaxhb.cli.progress.INTERVAL", 0.01)
    tried = []

    def write(_, text):
        tried.append(text)
        raise failure

    monkeypatch.setattr(Terminal, "write", write)
    with Progress(2, Terminal()) as progress:
        progress.ended.wait(0.05)
        lines = len(tried)
    # Progress was written while it went on, and at its end.
    assert lines
    assert len(tried) > lines


def test_a_quick_command_leaves_a_log_clean_and_a_quiet_one_a_terminal(monkeypatch):
    log = io.StringIO()
    terminal = Terminal()
    with Progress(2, log) as progress:
        progress.ended.wait(0.05)
    monkeypatch.setattr("jaxhb.cli.progress.INTERVAL", 0.01)
    with Progress(2, terminal, quiet=True) as progress:
        progress.ended.wait(0.05)
    assert log.getvalue() == ""
    assert terminal.getvalue() == ""


@pytest.mark.parametrize(
    ("value", "places", "expected"),
    [
        (-3e-18, 4, "0.0000"),
        (-0.0, 2, "0.00"),
        (0.0512, 4, "0.0512"),
        (0.0012, 2, "0.0012"),
        (np.nan, 2, "-"),
    ],
)
def test_no_number_is_minus_zero_and_no_small_number_reads_as_zero(
    value, places, expected
):
    assert fixed(value, places) == expected


def test_minus_zero_is_in_no_file_and_in_no_other_words():
    assert plain_number(-0.0) == "0"
    assert hit(0.0031) == "0.0031"
    assert as_bytes({"a": -0.0, "b": [-0.0, 1.5]}) == b'{"a": 0.0, "b": [0.0, 1.5]}'
    assert numbers([-0.0, -2.0]) == [0.0, -2.0]
    assert str(numbers([-0.0])[0]) == "0.0"
    angles = {"a": 1.0, "b": -0.0}
    modes = SimpleNamespace(
        frequencies_hz=[3.0],
        shape=lambda k: angles,
        node_count=[0],
        mesh_energy_share=[0.0],
    )
    table = modes_text(modes, "pair", ["elastic"], [-1e-17])
    assert "-0.0" not in table
    assert "0.0000" in table
    assert "b" not in table.columns[-1][0]


def test_progress_without_words_yet_says_that_it_computes(monkeypatch):
    monkeypatch.setattr("jaxhb.cli.progress.LOGGED", 0.01)
    log = io.StringIO()
    with Progress(2, log):
        time.sleep(0.1)
    assert log.getvalue().startswith("0 of 2 (0 s)\n")
    log = io.StringIO()
    with Progress(1, log):
        time.sleep(0.1)
    assert log.getvalue().startswith("computing (0 s)\n")
