"""The answers of the command line: at one speed, at many, with misfires, of tuned
designs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from jaxhb.certificate.certificate import certify
from jaxhb.design.quantities import QUANTITIES, label
from jaxhb.floquet.stability import Stability, tendency
from jaxhb.report.answer import UNCONFIRMED, Answer, Case
from jaxhb.report.text.tuned import difference
from jaxhb.results.answers import with_gaps
from jaxhb.results.checkpoint import Cached
from jaxhb.results.response import Response
from jaxhb.results.status import NotConverged, Status
from jaxhb.results.steady import SteadyState, orbit_state
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.steady.orbits import orbit_states
from jaxhb.steady.steady_state import steady_state
from jaxhb.train.changes import in_contact, linearised
from jaxhb.train.drivetrain import DriveTrain

if TYPE_CHECKING:
    from pathlib import Path

    from jaxhb.design.tuning import Tuning
    from jaxhb.design.worst_case import Spread
    from jaxhb.results.bounds import Certificate

    Direction = Literal["up", "down", "both"]
    Answers = dict[str, list[Answer]]

# Ways through the speeds, of a direction that stands for several
WAYS = {"both": ["up", "down"]}


@dataclass(frozen=True)
class Asked:
    """Options of every speed: a steady state or a periodic solution, how exactly, and
    whether with a bound.
    """

    orbit: bool = False
    harmonics: int | None = None
    tolerance: float | None = None
    certify: bool = False

    @classmethod
    def of(cls, arguments: Any) -> Asked:
        """Read the options of the command line."""
        certified = getattr(arguments, "certify", False)
        return cls(arguments.orbit, arguments.harmonics, arguments.tolerance, certified)


def answer_one(
    train: DriveTrain,
    rpm: float,
    options: Asked,
    say: Callable[[str], None] = lambda text: None,
) -> Answer:
    """Compute the :class:`Answer` at one speed from teeth in contact, with a bound if
    asked for; arguments are those of :func:`answer_speeds`.
    """
    ((answer,),) = answer_speeds(train, [rpm], options, say=say).values()
    return (
        dataclasses.replace(answer, certificate=certificate_of(answer, say))
        if options.certify
        else answer
    )


def answer_speeds(
    train: DriveTrain,
    rpm: Sequence[float],
    options: Asked,
    *,
    direction: Direction = "up",
    out: Path | Cached | None = None,
    chunk: int | None = None,
    progress: Callable[[int], object] | None = None,
    say: Callable[[str], None] = lambda text: None,
    on_answers: Callable[[Answers], object] | None = None,
    executor: Executor | None = None,
) -> Answers:
    """Compute answers in the order of ``rpm`` by the direction of the sweep, ``{"up":
    [Answer, ...]}``, ``"down"`` or both, ``"orbit"`` for orbits.

    out, chunk, executor : as of :func:`jaxhb.steady_state`; progress : called with the
    number of speeds done since the last call; say : called with a sentence at every
    stage; on_answers : called now and then with the answers so far
    """
    speeds = np.array(rpm, dtype=float)
    about = "the speeds" if len(rpm) > 1 else f"{rpm[0]:g} rpm"
    linear = linear_responses(train, speeds)
    closed: list[SteadyState | None] = [None] * len(speeds)
    if linear[0].status != Status.UNBALANCED:
        closed = _closed_states(
            train,
            speeds,
            options,
            "down" if direction == "down" else "up",
            say,
            executor,
        )
    states_so_far: dict[str, dict[int, SteadyState]] = {}
    answer_of_state: dict[int, Answer] = {}

    def answer(place: int, state: SteadyState) -> Answer:
        # A speed that does the same upwards and downwards has one state and one answer.
        if id(state) not in answer_of_state:
            stability, undecided = stability_of(state)
            answer_of_state[id(state)] = Answer(
                train,
                state,
                with_gaps(linear[place]),
                options.orbit,
                closed[place],
                stability,
                undecided,
            )
        return answer_of_state[id(state)]

    def note(states: dict[int, SteadyState], way: str) -> None:
        states_so_far.setdefault(way, {}).update(states)
        if on_answers:
            on_answers(
                {
                    way: [answer(place, states[place]) for place in sorted(states)]
                    for way, states in states_so_far.items()
                }
            )

    states_by_way: Mapping[str, Sequence[SteadyState]]
    if options.orbit:
        say(f"solving for periodic motions at {about}")
        orbits = orbit_states(
            train,
            speeds,
            harmonics=options.harmonics,
            tolerance=options.tolerance,
            out=out,
            chunk=chunk,
            progress=progress,
            on_states=lambda states: note(states, "orbit"),
            executor=executor,
        )
        states_by_way = {"orbit": orbits}
    elif linear[0].status == Status.UNBALANCED:
        # The train gains speed, whatever its vibration: its linear motion tells that
        # there is no steady one, and wherever it starts, as its topology has no law.
        unbalanced = [
            dataclasses.replace(orbit_state(linear[place]), response=None)
            for place in range(len(speeds))
        ]
        states_by_way = dict.fromkeys(WAYS.get(direction, [direction]), unbalanced)
    else:
        say(f"marching until the motion settles at {about}")
        sweeps = steady_state(
            train,
            rpm=speeds,
            direction=direction,
            harmonics=options.harmonics,
            tolerance=options.tolerance,
            out=out,
            chunk=chunk,
            progress=progress,
            on_states=note,
            executor=executor,
        )
        states_by_way = {
            sweep.direction: sweep.states
            for sweep in (sweeps if isinstance(sweeps, tuple) else (sweeps,))
        }
    say(f"is the motion stable at {about}?")
    return {
        way: [answer(place, state) for place, state in enumerate(states)]
        for way, states in states_by_way.items()
    }


def linear_responses(train: DriveTrain, rpm: Sequence[float] | np.ndarray) -> Response:
    """Compute the response of the linear train with all teeth in contact at speeds."""
    # A train of constant links is its own linear train, whose programs are at hand.
    linear_train = linearised(train) if train.topology.has_law.any() else train
    return solve_speeds(linear_train, rpm=rpm)


def _closed_states(
    train: DriveTrain,
    rpm: np.ndarray,
    options: Asked,
    direction: Literal["up", "down"],
    say: Callable[[str], None],
    executor: Executor | None,
) -> list[SteadyState | None]:
    """Compute a SteadyState for every speed with the gaps of meshes closed; None for
    all where that is the linear motion, or where there is no gap.
    """
    if train.topology.linear_in_contact or not any(train.topology.mesh_backlash):
        return [None] * len(rpm)
    say("the same with the gaps of meshes closed")
    closed = in_contact(train)
    if options.orbit:
        states = orbit_states(
            closed,
            rpm,
            harmonics=options.harmonics,
            tolerance=options.tolerance,
            executor=executor,
        )
        return list(states)
    sweep = steady_state(
        closed,
        rpm=rpm,
        direction=direction,
        harmonics=options.harmonics,
        tolerance=options.tolerance,
        executor=executor,
    )
    return list(sweep.states)


def stability_of(state: SteadyState) -> tuple[Stability | None, str]:
    """The Stability of a steady state or orbit, None where it is not decided; and the
    sentence that says why.
    """
    if state.response is None or not state.known:
        return None, ""
    if state.stability is not None:
        return cast(Stability, state.stability), ""
    decided = tendency(state.response)
    return decided.stability, "" if state.linear else decided.refusal


def solve_cases(
    trains: Mapping[str, DriveTrain],
    speeds: Sequence[float],
    options: Asked,
    *,
    folder: Path | Cached | None = None,
    say: Callable[[str], None] = lambda text: None,
    advance: Callable[[int], object] = lambda count: None,
    executor: Executor | None = None,
) -> list[Case]:
    """Compute a :class:`Case` of every train of ``{title: train}`` at every speed
    upwards; states are stored in a ``folder``.
    """
    cases = []
    for place, (title, train) in enumerate(trains.items()):

        def say_with_title(text: str, title: str = title) -> None:
            say(f"{text} ({title})")

        (answers,) = answer_speeds(
            train,
            speeds,
            options,
            out=folder / str(place) if folder else None,
            chunk=1 if folder else None,
            progress=advance,
            say=say_with_title,
            executor=executor,
        ).values()
        cases.append(Case(title, answers))
    return cases


def certificate_of(
    answer: Answer, say: Callable[[str], None] = lambda text: None
) -> Certificate | str:
    """Compute the :class:`jaxhb.Certificate` of an answer's harmonic solution; a
    sentence where there can be none.
    """
    if not answer.known:
        return "There is no solution."
    if answer.response is None:
        why = (
            f"The motion is {UNCONFIRMED}"
            if answer.unconfirmed
            else "The motion does not repeat itself"
        )
        return (
            f"{why}: a computed bound needs a harmonic solution (--orbit asks for one)."
        )
    say(f"{answer.rpm:g} rpm: how far off can it be?")
    try:
        return certify(answer.response)
    except (ValueError, NotConverged) as refusal:
        return str(refusal)


def check_spread(
    spread: Spread, say: Callable[[str], None] = lambda text: None
) -> dict[str, list]:
    """Compute the steady states of trains where a Spread found its worst cases.

    Returns kinds of motion of the train as it is, ``nominal``, and in the ``worst``
    case of each speed and quantity, "" where there is none; ``differences``, a sentence
    for each that is neither in contact nor periodic, or more than 2 % from the response
    of the Spread.
    """
    train = spread.train
    solved = np.isfinite(spread.nominal)
    say("what does the nominal train do?")
    kinds = [state.kind for state in steady_state(train, rpm=spread.rpm).states]
    linear = not train.topology.has_law.any()
    worst: list = []
    differences = []
    for i, rpm in enumerate(spread.rpm):
        worst.append([])
        for j, objective in enumerate(spread.of):
            if not solved[i, j]:
                worst[-1].append("")
                continue
            if linear:  # its only motion is the one that was searched
                worst[-1].append(kinds[i])
                continue
            say(f"{rpm:g} rpm: what does the train do in its worst cases?")
            design = train.replace(spread.values(i, j))
            quantity = QUANTITIES[objective.quantity]
            state = steady_state(design, rpm=float(rpm))
            worst[-1].append(state.kind)
            value = (
                float(
                    quantity.exact_value(state, objective.of, objective.order, design)
                )
                if state.known and quantity.compared
                else np.nan
            )
            sentence = difference(
                state, {objective: (value, float(spread.worst[i, j]))}
            )
            if sentence:
                differences.append(
                    f"In the worst case of {label(objective)} the train {sentence}"
                )
    return {"nominal": kinds, "worst": worst, "differences": differences}


def check_designs(
    train: DriveTrain,
    table: Mapping[str, Any],
    result: Tuning,
    say: Callable[[str], None] = lambda text: None,
) -> dict[str, dict[str, Any]]:
    """Compute the steady states of the first and the last design of a Tuning at its
    speeds.

    Returns by "before" and "after" motions, ``readings`` that can be compared, and
    ``differences``, a sentence for each speed at which the motion is neither in contact
    nor periodic, or a quantity is more than 2 % from that of the orbit tuned. ``train``
    is the first design, ``table`` as of :func:`jaxhb.design.table.read_table`.
    """
    checked = {}
    chosen = [*table["objective"], *table["penalties"]]
    quantities = {c: QUANTITIES[c.quantity] for c in chosen if c.quantity in QUANTITIES}
    designs = {
        "before": ("first", train, result.before),
        "after": ("last", result.train, result.after),
    }
    for when, (which, design, tuned) in designs.items():
        say(f"what does the {which} design do?")
        states = steady_state(
            design, rpm=np.asarray(table["rpm"]), tolerance=table.get("tolerance")
        ).states
        readings = {
            c: [
                (
                    float(quantity.exact_value(state, c.of, c.order, design))
                    if state.known
                    else np.nan
                )
                for state in states
            ]
            for c, quantity in quantities.items()
            if quantity.compared
        }
        differences = (
            difference(
                state,
                {
                    c: (values[i], float(tuned.readings[label(c)][i]))
                    for c, values in readings.items()
                },
            )
            for i, state in enumerate(states)
        )
        checked[when] = {
            "kind": [state.kind for state in states],
            "period": [state.period for state in states],
            "readings": {label(c): values for c, values in readings.items()},
            "differences": [
                f"The {which} design {sentence}" for sentence in differences if sentence
            ],
        }
    return checked
