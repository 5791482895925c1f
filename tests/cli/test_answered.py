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


def with_state(answer, **changes):
    """The answer with other fields of its state."""
    return dataclasses.replace(
        answer, state=dataclasses.replace(answer.state, **changes)
    )


def record_of(completed):
    """The object of the only speed in the JSON of a command."""
    content = completed.json
    if "cases" in content:
        content = content["cases"][0]
    (record,) = content.get("responses", [content])
    return record


@pytest.mark.parametrize("command", COMMANDS)
def test_a_motion_known_from_recorded_cycles_is_an_answer(
    command, run, monkeypatch, solved
):
    monkeypatch.setattr(
        "jaxhb.report.compute.steady_state", partial(jaxhb.steady_state, exact=False)
    )
    completed = run(f"{command} spur_pair --rpm 5000", "json", "csv")
    assert completed.err == ""
    record = record_of(completed)
    (row,) = completed.rows
    assert record["motion"]["kind"] == "periodic"
    assert record == record | {"converged": None, "status": None}
    largest = float(solved.force(MESH).max)
    # A record is good for as much.
    assert record["meshes"][MESH]["max"] == pytest.approx(largest, rel=0.01)
    assert float(row[f"{MESH} max N"]) == record["meshes"][MESH]["max"]
    assert row["status"] == ""


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_harmonic_solution_beyond_its_limits_is_no_answer(command, run_once):
    line = f"{command} spur_pair --rpm 5000 --harmonics 16 --tolerance 1e-12"
    completed = run_once(line, "json", status=1)
    assert "TOLERANCE_NOT_MET" in completed.err
    record = record_of(completed)
    assert record == record | {"converged": False, "status": "TOLERANCE_NOT_MET"}


def test_only_what_is_unknown_or_beyond_its_limits_has_no_answer(solved, unsure):
    failed = dataclasses.replace(
        solved.response, status=np.int32(jaxhb.Status.TOLERANCE_NOT_MET)
    )
    beyond = with_state(solved, response=failed)
    unknown = with_state(solved, kind="unknown", response=None)
    irregular = with_state(unsure, kind="irregular", period=0)
    answers = [solved, unsure, irregular, beyond, unknown]
    share = f"{100 * irregular.state.record.spread:.2g} %"
    sentence = motion_sentences([solved, irregular])[-1]
    assert f"would differ by up to {share} (two standard deviations)" in sentence
    rows = [
        (
            answer.answered,
            answer.converged,
            answer.doubt,
            len(warnings([answer])),
            answer_row(answer)[f"{MESH} max N"] is None,
        )
        for answer in answers
    ]
    assert rows == [
        (True, True, "", 0, False),
        (True, None, "not confirmed", 0, False),
        (True, None, "", 0, False),
        (False, False, "not converged", 1, True),
        (False, False, "", 1, True),
    ]


@pytest.mark.parametrize(
    ("changes", "period", "word"),
    [
        ({}, "one cycle", "periodic"),
        ({"kind": "subharmonic", "period": 2}, "2 cycles", "period 2"),
    ],
    ids=["periodic", "subharmonic"],
)
def test_a_motion_that_harmonic_balance_did_not_confirm_is_marked_in_one_way(
    solved, unsure, changes, period, word
):
    answer = with_state(unsure, **changes)
    assert motion_sentences([solved, answer])[1:] == [
        f"The motion has a period of {period}, not confirmed by harmonic balance,"
        " at 5000 rpm."
    ]
    assert motion_word(answer) == f"{word}, not confirmed"
    confirmation = "; not confirmed by harmonic balance; numbers are the extremes over"
    assert confirmation in motion_text(answer)
    beginning = "Not confirmed by harmonic balance: the teeth hammer"
    assert verdict(answer).startswith(beginning)
    assert "not confirmed" in untraceable(answer)
    assert "not confirmed" in certificate_of(answer)


def test_a_number_that_harmonic_balance_did_not_confirm_has_a_question_mark(
    solved, unsure
):
    table = speed_table([solved, unsure])
    cells = table.columns[table.heads.index("with kN")]
    assert [cell.endswith("?") for cell in cells] == [False, True]
    assert table.caption == "?: not confirmed"


def test_notes_of_a_report_do_not_repeat_a_speed_that_two_cases_have(unsure):
    noted = with_state(unsure, notes=("the record is short",))
    sentences = [note for note in notes(noted, noted) if "record" in note]
    assert sentences == ["At 5000 rpm the record is short."]
