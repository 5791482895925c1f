"""The answers of the command line: at one speed, at many, over values of a number, with
misfires, of tuned designs.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from jaxhb.certificate.certificate import certify
from jaxhb.design.quantities import QUANTITIES, label
from jaxhb.floquet.stability import attracts
from jaxhb.report.answer import UNCONFIRMED, Answer, Case
from jaxhb.report.text.tuned import difference
from jaxhb.results.answers import with_gaps
from jaxhb.results.status import NotConverged, Status
from jaxhb.results.steady import orbit_state
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.steady.orbits import orbit_states
from jaxhb.steady.steady_state import steady_state
from jaxhb.train.changes import in_contact, linearised

WAYS = {
    "both": ["up", "down"]
}  # ways through the speeds, of a direction that is not one itself


@dataclass(frozen=True)
class Asked:
    """What was asked of every speed: a steady state or a periodic solution, how
    exactly, and whether with a bound.
    """

    orbit: bool = False
    harmonics: int | None = None
    tolerance: float | None = None
    certify: bool = False

    @classmethod
    def of(cls, arguments):
        """As the command line says."""
        certified = getattr(arguments, "certify", False)
        return cls(arguments.orbit, arguments.harmonics, arguments.tolerance, certified)

    @property
    def accuracy(self):
        """Of :func:`jaxhb.solve` and :func:`jaxhb.steady_state`."""
        return {"harmonics": self.harmonics, "tolerance": self.tolerance}


def answer_one(train, rpm, asked, say=lambda text: None, *, start=None, kept=None):
    """The :class:`Answer` at one speed, with a computed bound if asked for; ``start``
    is the SteadyState of a neighbour from which the motion starts, the others are as of
    :func:`answer_speeds`.
    """
    ((answer,),) = answer_speeds(
        train, [rpm], asked, start=start, kept=kept, say=say
    ).values()
    return (
        dataclasses.replace(answer, certificate=certificate_of(answer, say))
        if asked.certify
        else answer
    )


def answer_speeds(
    train,
    rpm,
    asked,
    *,
    direction="up",
    start=None,
    kept=None,
    progress=None,
    say=lambda text: None,
    told=None,
):
    """Answers in the order of ``rpm`` by the direction in which the sweep went,
    ``{"up": [Answer, ...]}``, ``"down"`` or both, ``"orbit"`` for orbits.

    kept : a dictionary with ``out`` and ``chunk`` of :func:`jaxhb.steady_state`;
    progress : called with the number of speeds done since the last call; say : told
    what is done; told : now and then what is returned in the end, as far as it is known
    """
    rpm, about = (
        np.array(rpm, dtype=float),
        "the speeds" if len(rpm) > 1 else f"{rpm[0]:g} rpm",
    )
    # A train of constant links is its own linear train, whose programs are at hand.
    linear = solve_speeds(
        linearised(train) if train.topology.has_law.any() else train, rpm=rpm
    )
    closed = [None] * len(rpm)
    if linear[0].status != Status.UNBALANCED:
        closed = _closed_states(
            train, rpm, asked, "down" if direction == "down" else "up", say
        )
    known, made = {}, {}

    def answer(place, state):
        # A speed that does the same upwards and downwards has one state and one answer.
        if id(state) not in made:
            both = with_gaps(linear[place]), asked.orbit, closed[place]
            made[id(state)] = Answer(train, state, *both, *_stability_of(state))
        return made[id(state)]

    def tell(states, way):
        known.setdefault(way, {}).update(states)
        if told:
            told(
                {
                    one: [answer(place, own[place]) for place in sorted(own)]
                    for one, own in known.items()
                }
            )

    if asked.orbit:
        say(f"solving for periodic motions at {about}")
        given = {**asked.accuracy, **(kept or {}), "progress": progress}
        found = {
            "orbit": orbit_states(
                train, rpm, **given, on_states=lambda states: tell(states, "orbit")
            )
        }
    elif linear[0].status == Status.UNBALANCED:
        # The train gains speed, whatever its vibration: its linear motion tells that
        # there is no steady one.
        states = [
            dataclasses.replace(orbit_state(linear[place]), response=None)
            for place in range(len(rpm))
        ]
        found = dict.fromkeys(WAYS.get(direction, [direction]), states)
    else:
        say(f"marching until the motion settles at {about}")
        given = {
            **asked.accuracy,
            **(kept or {}),
            "progress": progress,
            "on_states": tell,
        }
        if start is not None:
            found = {direction: [steady_state(train, rpm=rpm[0], start=start, **given)]}
        else:
            sweeps = steady_state(train, rpm=rpm, direction=direction, **given)
            found = {
                one.direction: one.states
                for one in (sweeps if direction == "both" else [sweeps])
            }
    say(f"is the motion stable at {about}?")
    return {
        way: [answer(place, state) for place, state in enumerate(states)]
        for way, states in found.items()
    }


def _closed_states(train, rpm, asked, direction, say):
    """What the train does with the gaps of its meshes closed, a SteadyState for every
    speed; None for all where that is the linear motion, or where there is no gap.
    """
    if train.topology.linear_in_contact or not any(train.topology.mesh_backlash):
        return [None] * len(rpm)
    say("the same with the gaps of meshes closed")
    closed = in_contact(train)
    if asked.orbit:
        return orbit_states(closed, rpm, **asked.accuracy)
    return list(
        steady_state(closed, rpm=rpm, direction=direction, **asked.accuracy).states
    )


def _stability_of(state):
    """The Stability of a steady state or orbit; None where it is not decided, and the
    sentence that says why.
    """
    if state.response is None or not state.known:
        return None, ""
    _, found, refused = (
        (True, state.stability, "")
        if state.stability is not None
        else attracts(state.response)
    )
    return found, "" if state.linear else refused


def answer_values(
    train,
    rpm,
    axis,
    values,
    asked,
    *,
    direction="up",
    kept=None,
    progress=None,
    told=None,
):
    """Answers at one speed for many ``values`` of an :class:`Axis`, each from the
    motion of its neighbour.
    """
    order = np.argsort(values, kind="stable")
    found = {}

    def in_order():
        return {
            way: [own[place] for place in sorted(own)] for way, own in found.items()
        }

    for way in ["orbit"] if asked.orbit else WAYS.get(direction, [direction]):
        own, start = found.setdefault(way, {}), None
        for place in order[::-1] if way == "down" else order:
            changed = train.replace({axis.name: values[place]})
            value = float(values[place])
            folder = (
                {"out": kept["out"] / f"{way} {place}"} if kept and kept["out"] else {}
            )
            answer = answer_one(changed, rpm, asked, start=start, kept=folder)
            own[int(place)] = dataclasses.replace(answer, axis=axis, value=value)
            # A motion that is not known is nothing to start from.
            start = answer.state if answer.state.motion is not None else None
            progress and progress(1)
            if told:
                told(in_order())
    return in_order()


def solve_cases(
    trains,
    speeds,
    asked,
    *,
    folder=None,
    say=lambda text: None,
    advance=lambda count: None,
):
    """A :class:`Case` of every train of ``{title: train}`` at every speed upwards;
    states are kept in a ``folder``.
    """
    cases = []
    for place, (title, train) in enumerate(trains.items()):
        how = {"kept": {"out": folder / str(place), "chunk": 1}} if folder else {}
        how |= {
            "progress": advance,
            "say": lambda text, title=title: say(f"{text} ({title})"),
        }
        (answers,) = answer_speeds(train, speeds, asked, **how).values()
        cases.append(Case(title, answers))
    return cases


def certificate_of(answer, say=lambda text: None):
    """The :class:`jaxhb.Certificate` of an answer's harmonic solution; a sentence where
    there can be none.
    """
    if answer.response is None and answer.known:
        why = (
            f"The motion is {UNCONFIRMED}"
            if answer.unconfirmed
            else "The motion does not repeat itself"
        )
        return (
            f"{why}: a computed bound needs a harmonic solution (--orbit asks for one)."
        )
    if not answer.known:
        return "There is no solution."
    say(f"{answer.rpm:g} rpm: how far off can it be?")
    try:
        return certify(answer.response)
    except (ValueError, NotConverged) as refusal:
        return str(refusal)


def check_spread(spread, say=lambda text: None):
    """What trains do where a Spread found its worst cases: kinds of motion of the train
    as it is, ``nominal``, and in the ``worst`` case of each speed and quantity, ""
    where there is none; ``differences``, a sentence for each that is neither in contact
    nor periodic, or more than 2 % from what was found.
    """
    train = spread.train
    solved = np.isfinite(spread.nominal)
    say("what does the train do as it is?")
    kinds = [state.kind for state in steady_state(train, rpm=spread.rpm).states]
    worst = []
    told = []
    for i, rpm in enumerate(spread.rpm):
        worst.append([])
        for j, one in enumerate(spread.of):
            if not solved[i, j]:
                worst[-1].append("")
                continue
            say(f"{rpm:g} rpm: what does the train do in its worst cases?")
            design = train.replace(spread.values(i, j))
            own = QUANTITIES[one.quantity]
            state = steady_state(design, rpm=float(rpm))
            worst[-1].append(state.kind)
            value = (
                float(own.exact_value(state, one.of, one.order, design))
                if state.known and own.compared
                else np.nan
            )
            said = difference(state, {one: (value, float(spread.worst[i, j]))})
            told += (
                [f"In the worst case of {label(one)} the train {said}"] if said else []
            )
    return {"nominal": kinds, "worst": worst, "differences": told}


def check_designs(train, asked, result, say=lambda text: None):
    """What the first and the last design of a Tuning do at its speeds: motions,
    ``readings`` that can be compared, and ``differences``, a sentence for each speed at
    which the motion is neither in contact nor periodic, or a quantity is more than 2 %
    from that of the orbit tuned. ``train`` is as it was, ``asked`` as of
    :func:`jaxhb.design.table.read_table`.
    """
    found = {}
    chosen = [*asked["objective"], *asked["penalties"]]
    compared = {c: QUANTITIES[c.quantity] for c in chosen if c.quantity in QUANTITIES}
    designs = {
        "before": ("first", train, result.before),
        "after": ("last", result.train, result.after),
    }
    for when, (which, design, tuned) in designs.items():
        say(f"what does the {which} design do?")
        states = steady_state(
            design, rpm=np.asarray(asked["rpm"]), tolerance=asked.get("tolerance")
        ).states
        told = {
            c: [
                (
                    float(own.exact_value(state, c.of, c.order, design))
                    if state.known
                    else np.nan
                )
                for state in states
            ]
            for c, own in compared.items()
            if own.compared
        }
        differences = (
            difference(
                state,
                {
                    c: (own[i], float(tuned.readings[label(c)][i]))
                    for c, own in told.items()
                },
            )
            for i, state in enumerate(states)
        )
        found[when] = {
            "kind": [state.kind for state in states],
            "period": [state.period for state in states],
            "readings": {label(chosen): values for chosen, values in told.items()},
            "differences": [
                f"The {which} design {one}" for one in filter(None, differences)
            ],
        }
    return found
