"""Which speeds have an answer: one rule for the exit status of ``solve``, ``sweep`` and
``report``, and their files.
"""

import dataclasses
from functools import partial

import numpy as np
import pytest

import jaxhb
from jaxhb.report.answer import Answer
from jaxhb.report.compute import Asked, answer_one, certificate_of
from jaxhb.report.files.numbers import answer_row, untraceable
from jaxhb.report.text.sentences import (
    motion_text,
    motion_word,
    notes,
    verdict,
    warnings,
)
from jaxhb.report.text.sweep_tables import motion_sentences, speed_table
from jaxhb.solutions.solve import linear_response

MESH = "gear a|gear b"
COMMANDS = "solve", "sweep", "report"


@pytest.fixture(scope="module")
def solved():
    """A hammering speed as harmonic balance has it."""
    return answer_one(jaxhb.load_scene("spur_pair"), 5000.0, Asked())


@pytest.fixture(scope="module")
def unsure(solved):
    """The same speed, which harmonic balance did not confirm."""
    state = jaxhb.steady_state(solved.train, rpm=5000.0, exact=False)
    return Answer(solved.train, state, linear_response(solved.train, rpm=5000.0))


def records_of(called):
    """The objects of all speeds in the JSON of a command."""
    found = called.json
    return (
        found["cases"][0]["responses"]
        if "cases" in found
        else found.get("responses", [found])
    )


@pytest.mark.parametrize("command", COMMANDS)
def test_a_motion_known_from_recorded_cycles_is_an_answer(
    command, run, monkeypatch, solved
):
    monkeypatch.setattr(
        "jaxhb.report.compute.steady_state", partial(jaxhb.steady_state, exact=False)
    )
    called = run(f"{command} spur_pair --rpm 5000", "json", "csv")
    assert (called.status, called.err) == (0, "")
    (record,) = records_of(called)
    (row,) = called.rows
    assert (record["motion"]["kind"], record["converged"], record["status"]) == (
        "periodic",
        None,
        None,
    )
    largest = float(solved.force(MESH).max)
    assert record["meshes"][MESH]["max"] == pytest.approx(
        largest, rel=0.01
    )  # what a record is good for
    assert (
        float(row[f"{MESH} max N"]) == record["meshes"][MESH]["max"]
        and row["status"] == ""
    )


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_harmonic_solution_beyond_its_limits_is_no_answer(command, told):
    called = told(
        f"{command} spur_pair --rpm 5000 --harmonics 16 --tolerance 1e-12", "json"
    )
    assert called.status == 1 and "TOLERANCE_NOT_MET" in called.err
    assert [
        (record["converged"], record["status"]) for record in records_of(called)
    ] == [(False, "TOLERANCE_NOT_MET")]


def test_only_what_is_unknown_or_beyond_its_limits_has_no_answer(solved, unsure):
    failed = dataclasses.replace(
        solved.response, status=np.int32(jaxhb.Status.TOLERANCE_NOT_MET)
    )
    beyond = dataclasses.replace(
        solved, state=dataclasses.replace(solved.state, response=failed)
    )
    unknown = dataclasses.replace(
        solved, state=dataclasses.replace(solved.state, kind="unknown", response=None)
    )
    irregular = dataclasses.replace(
        unsure, state=dataclasses.replace(unsure.state, kind="irregular", period=0)
    )
    every = [solved, unsure, irregular, beyond, unknown]
    share = f"{100 * irregular.state.record.spread:.2g} %"
    assert (
        f"would differ by up to {share} (two standard deviations)"
        in motion_sentences([solved, irregular])[-1]
    )
    assert [answer.answered for answer in every] == [True, True, True, False, False]
    assert [answer.converged for answer in every] == [True, None, None, False, False]
    assert [answer.doubt for answer in every] == [
        "",
        "not confirmed",
        "",
        "not converged",
        "",
    ]
    assert [len(warnings([answer])) for answer in every] == [0, 0, 0, 1, 1]
    assert [answer_row(answer)[f"{MESH} max N"] is None for answer in every] == [
        False
    ] * 3 + [True] * 2


def test_a_motion_that_harmonic_balance_did_not_confirm_is_marked_in_one_way(
    solved, unsure
):
    twice = dataclasses.replace(
        unsure, state=dataclasses.replace(unsure.state, kind="subharmonic", period=2)
    )
    for answer, period, word in (
        (unsure, "one cycle", "periodic"),
        (twice, "2 cycles", "period 2"),
    ):
        told = motion_sentences([solved, answer])[1:]
        assert told == [
            f"The motion has a period of {period}, not confirmed by harmonic balance,"
            " at 5000 rpm."
        ]
        assert motion_word(answer) == f"{word}, not confirmed"
        assert (
            "; not confirmed by harmonic balance; numbers are the extremes over"
            in motion_text(answer)
        )
        assert verdict(answer).startswith(
            "Not confirmed by harmonic balance: the teeth hammer"
        )
        assert "not confirmed" in untraceable(
            answer
        ) and "not confirmed" in certificate_of(answer)
    table = speed_table([solved, unsure])
    assert [
        cell.endswith("?") for cell in table.columns[table.heads.index("with kN")]
    ] == [False, True]
    assert table.caption == "?: not confirmed"


def test_notes_of_a_report_do_not_repeat_a_speed_that_two_cases_have(unsure):
    noted = dataclasses.replace(
        unsure, state=dataclasses.replace(unsure.state, notes=("the record is short",))
    )
    assert [note for note in notes(noted, noted) if "record" in note] == [
        "At 5000 rpm the record is short."
    ]
