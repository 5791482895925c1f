"""Answers at one speed over many values of a number of the scene."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from jaxhb._executors import WorkerLost
from jaxhb.report.answer import Answer, SweepAxis
from jaxhb.report.compute import (
    WAYS,
    Asked,
    answer_one,
    linear_responses,
    stability_of,
)
from jaxhb.results.answers import with_gaps
from jaxhb.results.checkpoint import Cached, Checkpoint, answered_parts
from jaxhb.results.steady import SteadyState
from jaxhb.steady.classification import unknown
from jaxhb.steady.neighbours import Start, settle_along
from jaxhb.steady.steady_state import state_from
from jaxhb.train.drivetrain import DriveTrain

if TYPE_CHECKING:
    from pathlib import Path

    from jaxhb.report.compute import Answers, Direction


def answer_values(
    train: DriveTrain,
    rpm: float,
    axis: SweepAxis,
    values: Sequence[float],
    options: Asked,
    *,
    direction: Direction = "up",
    out: Path | Cached | None = None,
    progress: Callable[[int], object] = lambda count: None,
    on_answers: Callable[[Answers], object] = lambda answers: None,
    executor: Executor | None = None,
) -> Answers:
    """Compute answers at one speed for many ``values`` of a :class:`SweepAxis`: each
    from teeth in contact, then those whose neighbour has another motion from that.

    Arguments are those of :func:`jaxhb.report.compute.answer_speeds`; each value is a
    part by itself.
    """
    sweep = _ValueSweep(train, rpm, axis, values, options, out, executor)
    ways = ["orbit"] if options.orbit else WAYS.get(direction, [direction])
    answers_by_way: dict[str, dict[int, Answer]] = {}

    def note(way: str, answers: Mapping[int, Answer]) -> None:
        answers_by_way.setdefault(way, {}).update(answers)
        on_answers(in_order())

    def in_order() -> Answers:
        return {
            way: [answers[place] for place in sorted(answers)]
            for way, answers in answers_by_way.items()
        }

    for place, answer in sweep.answer_from_contact():
        note(ways[0], {place: answer})
        progress(1)
    if not options.orbit:
        order = np.argsort(values, kind="stable").tolist()
        for way in ways:
            places = order[::-1] if way == "down" else order
            note(way, sweep.along(places, partial(note, way)))
    return in_order()


class _ValueSweep:
    """One call of :func:`answer_values`: a train for each value, the answers from teeth
    in contact, and where answers are stored and computed.
    """

    def __init__(
        self,
        train: DriveTrain,
        rpm: float,
        axis: SweepAxis,
        values: Sequence[float],
        options: Asked,
        out: Path | Cached | None,
        executor: Executor | None,
    ):
        self.rpm = rpm
        self.axis = axis
        self.values = [float(value) for value in values]
        self.trains = [train.replace({axis.name: value}) for value in self.values]
        self.options = options
        self.executor = executor
        self.from_contact: dict[int, Answer] = {}
        self.lost: set[int] = set()  # places that killed their workers
        self.checkpoint = None
        if out is not None:
            settings = {"answers": f"values of {axis.name}", "rpm": float(rpm)}
            settings |= dataclasses.asdict(options)
            self.checkpoint = Checkpoint(out, train, settings, None)

    def answer_from_contact(self) -> Iterator[tuple[int, Answer]]:
        """Yield the place of each value and its answer from teeth in contact."""
        questions = [["from contact", value] for value in self.values]
        parts = [(changed, self.rpm, self.options) for changed in self.trains]
        for place, answer in answered_parts(
            self.checkpoint,
            questions,
            answer_one,
            parts,
            self.executor,
            lost=self._without_answer,
        ):
            self.from_contact[place] = dataclasses.replace(
                answer, axis=self.axis, value=self.values[place]
            )
            yield place, self.from_contact[place]

    def along(
        self,
        order: Sequence[int],
        note: Callable[[dict[int, Answer]], object],
    ) -> dict[int, Answer]:
        """Answers by place, each reached from the one before it in ``order``; ``note``
        is called with those reached from a neighbour.
        """

        def march(starts: dict[int, Start]) -> dict[int, SteadyState]:
            states = {}
            for place, state in self._reached(starts):
                states[place] = state
                note({place: self._answer(place, state)})
            return states

        states = settle_along(
            order,
            {place: answer.state for place, answer in self.from_contact.items()},
            march,
            lambda place: self.axis.said(f"{self.values[place]:g}"),
            {},
        )
        return {place: self._answer(place, state) for place, state in states.items()}

    def _reached(
        self, starts: Mapping[int, Start]
    ) -> Iterator[tuple[int, SteadyState]]:
        """Yield places and their steady states from ``starts``, as they come, but for
        values that killed their workers.
        """
        places = [place for place in starts if place not in self.lost]

        def lost(number: int, failure: WorkerLost) -> SteadyState:
            return unknown(self.trains[places[number]], self.rpm, str(failure))

        questions = [[self.values[place], starts[place].motion] for place in places]
        parts = [
            (self.from_contact[place], starts[place], self.options) for place in places
        ]
        for number, state in answered_parts(
            self.checkpoint, questions, _state_from, parts, self.executor, lost=lost
        ):
            yield places[number], state

    def _answer(self, place: int, state: SteadyState) -> Answer:
        """The answer of a value in a steady state."""
        answer = self.from_contact[place]
        if state is answer.state:
            return answer
        stability, undecided = stability_of(state)
        return dataclasses.replace(
            answer, state=state, stability=stability, undecided=undecided
        )

    def _without_answer(self, place: int, failure: WorkerLost) -> Answer:
        """The answer of a value that killed its workers: no orbit even where orbits
        are asked for, as these have a status.
        """
        self.lost.add(place)
        train = self.trains[place]
        linear = linear_responses(train, [self.rpm])[0]
        state = unknown(train, self.rpm, str(failure))
        return Answer(train, state, with_gaps(linear))


def _state_from(answer: Answer, start: Start, options: Asked) -> SteadyState:
    """The steady state of the train of an answer from another start."""
    return state_from(
        answer.train,
        answer.rpm,
        start,
        answer.state,
        harmonics=options.harmonics,
        tolerance=options.tolerance,
    )
