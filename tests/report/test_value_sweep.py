"""Sweeps over the values of a number at one speed."""

from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial

import pytest

import jaxhb
from jaxhb.report import value_sweep
from jaxhb.report.answer import SweepAxis
from jaxhb.report.compute import Asked
from jaxhb.report.text.sentences import warnings
from jaxhb.report.text.sweep_tables import sweep_text
from jaxhb.report.value_sweep import answer_values
from jaxhb.results.checkpoint import CheckpointError, digest

RPM = 4600.0
MESH = "gear a|gear b"
STIFFNESS = SweepAxis(f"{MESH}.stiffness", "N/m")
# Soft teeth hammer, stiff ones stay in contact from rest; places and order differ.
VALUES = [2.4e8, 1.6e8, 1.8e8, 2.0e8]
ORBITS = Asked(orbit=True)
# Largest forces of one motion solved from two starts: sweeps leave 3 % of the default
# tolerance of 1e-2 of the vibration, and somewhat more of its peaks
SOLVED_TWICE = 1e-3


@pytest.fixture(scope="module")
def pair():
    return jaxhb.load_scene("spur_pair")


@pytest.fixture(scope="module")
def alone(pair):
    return answer_values(pair, RPM, STIFFNESS, VALUES, Asked(), direction="both")


def test_each_value_has_the_motion_that_comes_from_its_neighbour(pair, alone):
    """As where every value is marched from its neighbour, one after another."""
    kinds = {}
    for way, places in (("up", [1, 2, 3, 0]), ("down", [0, 3, 2, 1])):
        start = None
        for place in places:
            train = pair.replace({STIFFNESS.name: VALUES[place]})
            start = jaxhb.steady_state(train, rpm=RPM, start=start)
            answer = alone[way][place]
            kinds[way, place] = start.kind
            assert (answer.state.kind, answer.state.period) == (
                start.kind,
                start.period,
            )
            assert float(answer.force(MESH).peak) == pytest.approx(
                float(start.force(MESH).peak), rel=SOLVED_TWICE
            )
            assert answer.place == VALUES[place]
    hysteresis = [
        place for place in range(4) if kinds["up", place] != kinds["down", place]
    ]
    assert hysteresis == [0, 3]


def test_a_note_names_the_value_from_which_a_motion_was_reached(alone):
    by_place = [answer.state.notes for answer in alone["up"]]
    assert by_place[1] == by_place[2] == ()
    assert (
        "was reached from that at gear a|gear b.stiffness = 2e+08 N/m" in by_place[0][0]
    )
    assert (
        "was reached from that at gear a|gear b.stiffness = 1.8e+08 N/m"
        in by_place[3][0]
    )
    assert {answer.state.notes for answer in alone["down"]} == {()}


def test_an_executor_gives_the_same_bits_and_a_stopped_sweep_goes_on(
    pair, alone, tmp_path, monkeypatch
):
    sweep = partial(
        answer_values,
        pair,
        RPM,
        STIFFNESS,
        VALUES,
        Asked(),
        direction="both",
        out=tmp_path / "kept",
    )

    def stop(count):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(progress=stop)
    assert len(list((tmp_path / "kept").glob("*.npz"))) == 1
    counts = []
    with ThreadPoolExecutor(3) as threads:
        answers = sweep(executor=threads, progress=counts.append)
    assert digest(answers) == digest(alone)
    assert counts == [1] * len(VALUES)
    # All is stored now, motions from neighbours too.
    monkeypatch.setattr(value_sweep, "answer_one", None)
    monkeypatch.setattr(value_sweep, "_state_from", None)
    assert digest(sweep()) == digest(alone)
    with pytest.raises(CheckpointError, match=r"rpm 4600.0 there, 4700.0 now"):
        answer_values(pair, 4700.0, STIFFNESS, VALUES, Asked(), out=tmp_path / "kept")


def test_orbits_of_values_are_independent(pair):
    sweep = partial(answer_values, pair, RPM, STIFFNESS, options=ORBITS)
    with ThreadPoolExecutor(3) as threads:
        answers = sweep(values=VALUES, executor=threads)
    assert list(answers) == ["orbit"]
    turned = sweep(values=VALUES[::-1])
    assert digest(answers["orbit"]) == digest(turned["orbit"][::-1])


class LosingExecutor(Executor):
    """Runs parts at once, and loses one, the second by default."""

    def __init__(self, lost=2):
        self.lost = lost
        self.parts = 0

    def submit(self, function, /, *args):
        future = Future()
        self.parts += 1
        if self.parts == self.lost:
            future.set_exception(jaxhb.WorkerLost("the worker process ended"))
        else:
            future.set_result(function(*args))
        return future


@pytest.mark.parametrize("options", [Asked(), ORBITS])
def test_a_value_that_kills_its_workers_is_one_without_an_answer(
    pair, options, tmp_path
):
    values = [3.2e8, 3.6e8, 4e8]
    sweep = partial(
        answer_values, pair, 2000.0, STIFFNESS, values, options, out=tmp_path / "kept"
    )
    ((way, answers),) = sweep(executor=LosingExecutor()).items()
    assert [answer.known for answer in answers] == [True, False, True]
    assert answers[1].state.notes == ("the worker process ended",)
    assert "unknown" in sweep_text({way: answers})
    assert "3.6e+08 N/m: the kind of motion is unknown" in warnings(answers)[0]
    whole = sweep()[way]
    assert all(answer.known for answer in whole)
    assert digest(whole[::2]) == digest(answers[::2])


def test_a_value_that_is_lost_on_the_way_from_its_neighbour_is_unknown(pair):
    """The third part: the second value from the motion of the first."""
    sweep = partial(
        answer_values, pair, RPM, STIFFNESS, [1.8e8, 2e8], Asked(), direction="both"
    )
    answers = sweep(executor=LosingExecutor(3))
    kinds = {
        way: [answer.state.kind for answer in several]
        for way, several in answers.items()
    }
    assert kinds == {"up": ["periodic", "unknown"], "down": ["periodic", "contact"]}
    assert answers["up"][1].state.notes == ("the worker process ended",)


@pytest.mark.parametrize("direction", ["up", "down"])
def test_a_value_that_unbalances_the_train_has_no_motion_to_reach(pair, direction):
    axis = SweepAxis("brake.mean", "N m")
    values = [-60.0, -50.0, -40.0]
    answers = answer_values(pair, 5000.0, axis, values, Asked(), direction=direction)
    kinds = [answer.state.kind for answer in answers[direction]]
    assert kinds == ["unknown", "periodic", "unknown"]
