"""Steady state of a train after it has run long enough: contact, a period of one or
several cycles, or none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack, overload

import numpy as np

from jaxhb._jax import Array, Numbers, refuse_tracers
from jaxhb.balance.plan import Plan, Request
from jaxhb.balance.program import solve_batches
from jaxhb.results.checkpoint import CHUNK, Cached, Checkpoint, answered_parts
from jaxhb.results.response import Response
from jaxhb.results.status import Status
from jaxhb.results.steady import SteadyState, SteadySweep, kind_of_one_cycle
from jaxhb.solutions.planning import plan_speeds
from jaxhb.steady.classification import Classifier, motion_of, state_of, unknown
from jaxhb.steady.closure import Cycles
from jaxhb.steady.neighbours import Start, settle_along
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed

DIRECTIONS = "up", "down", "both"
PART = 16  # speeds that a worker marches at a time

OnStates = Callable[[dict[int, SteadyState], str], object]
"""Callback that takes steady states by the number of their speed, and the direction of
the sweep in which they were reached.
"""


class _Options(TypedDict, total=False):
    start: SteadyState | Response | None
    harmonics: int | None
    tolerance: float | None
    exact: bool
    cycles: Cycles | None
    progress: Callable[[int], object] | None
    out: str | Path | Cached | None
    chunk: int | None
    on_states: OnStates | None
    devices: Sequence[Any]
    executor: Executor | None


@overload
def steady_state(
    train: DriveTrain,
    *,
    rpm: float,
    direction: Literal["up", "down"] = ...,
    **options: Unpack[_Options],
) -> SteadyState: ...
@overload
def steady_state(
    train: DriveTrain,
    *,
    rpm: Sequence[float] | Array,
    direction: Literal["up", "down"] = ...,
    **options: Unpack[_Options],
) -> SteadySweep: ...
@overload
def steady_state(
    train: DriveTrain,
    *,
    rpm: Sequence[float] | Array,
    direction: Literal["both"],
    **options: Unpack[_Options],
) -> tuple[SteadySweep, SteadySweep]: ...
@overload
def steady_state(
    train: DriveTrain,
    *,
    rpm: Sequence[float] | Array,
    direction: str,
    **options: Unpack[_Options],
) -> SteadySweep | tuple[SteadySweep, SteadySweep]: ...


def steady_state(
    train: DriveTrain,
    *,
    rpm: Numbers,
    direction: str = "up",
    start: SteadyState | Response | None = None,
    harmonics: int | None = None,
    tolerance: float | None = None,
    exact: bool = True,
    cycles: Cycles | None = None,
    progress: Callable[[int], object] | None = None,
    out: str | Path | Cached | None = None,
    chunk: int | None = None,
    on_states: OnStates | None = None,
    devices: Sequence[Any] = (),
    executor: Executor | None = None,
) -> SteadyState | SteadySweep | tuple[SteadySweep, SteadySweep]:
    """Steady state of a drive train at each speed: its motion after it has run long
    enough.

    Teeth that stay in contact are known from the linear motion. Where teeth part,
    sweeps that settle at a motion in which disturbances die away give the exact motion.
    Otherwise the train is marched through cycles of the excitation until its motion
    closes after 1 to 8 of them; harmonic balance of so many cycles, from there, gives
    the exact motion. Where it does not close, the numbers are those of a record of 64
    cycles, or of 256 where the extremes of parts of it vary by more than 5 %
    (:class:`jaxhb.Cycles`).

    Parameters
    ----------
    train : DriveTrain
        The march damps each mode at its own frequency for loss factors, and a note says
        so; the solution has them as they are.
    rpm : float or array ``(n,)``
        Speeds of the reference rotor.
    direction : "up", "down" or "both"
        Each of several speeds is reached from its neighbour below, or above: of several
        motions that decides which.
    start : SteadyState or Response, optional
        Motion from which the first speed starts; by default teeth rest on their drive
        sides.
    harmonics, tolerance : optional
        Of periodic motions, per cycle of the excitation, as in :func:`jaxhb.solve`.
    exact : bool
        Whether periodic and subharmonic motions are solved by harmonic balance. If not,
        they too are read from recorded cycles, good to about 1 %, in a fraction of the
        time.
    cycles : Cycles, optional
        How long a march is at most.
    progress, devices : optional
        As in :func:`jaxhb.solve_speeds`.
    out : path, optional
        A folder to which steady states of marched speeds are written as they are found:
        the same call goes on where it was stopped, with the same numbers to the last
        bit.
    chunk : int, optional
        How many speeds are marched, reported and written together; default: 64 with
        ``out``, 16 with ``executor``, else all. Fewer take longer.
    on_states : callable, optional
        Called with ``{number of the speed: SteadyState}`` of what was found since the
        last call, and "up" or "down". A speed may be reported again when it takes over
        the motion of its neighbour: the last report counts.
    executor : concurrent.futures.Executor, optional
        Where chunks of speeds are marched, as :class:`jaxhb.Workers`; the numbers are
        the same to the last bit on the same kind of machine.

    Returns
    -------
    SteadyState, or SteadySweep for an array of speeds, or for "both" a pair of them,
    upwards and downwards

    Raises
    ------
    SceneError
        A speed that is not greater than 0 or above 1e6 rpm.
    ValueError
        An unknown direction; :class:`jaxhb.CheckpointError`: ``out`` holds other
        answers, or cannot be written.
    TypeError
        Under ``jit``, ``vmap`` or ``grad``.

    Notes
    -----
    A march takes five steps per period of the highest mesh mode or more. Where harmonic
    balance does not confirm what it shows, or disturbances of the solution grow, or the
    march does not become periodic, it goes on with twice and four times as many: beside
    a bifurcation the kind of motion is that of the steps. A transient that outlasts the
    march counts as irregular; where a mode that affects the teeth had not decayed when
    the record began, a note says so. In a sweep all speeds first start from teeth on
    their drive sides, and those whose neighbour has another motion then from that one,
    too.
    Motions of neighbours that never differ by more than a tenth of the largest
    deflection count as one.

    Examples
    --------
    >>> import jaxhb
    >>> s = jaxhb.steady_state(jaxhb.load_scene("spur_pair"), rpm=2000.0)
    >>> s.kind, s.period
    ('contact', 1)
    """
    instead = "differentiate jaxhb.solve(train, rpm=..., plan=..., start=its response)"
    refuse_tracers("steady_state", train, rpm, instead=instead)
    if direction not in DIRECTIONS:
        raise ValueError(f"direction is {direction!r}: give 'up', 'down' or 'both'")
    check_speed(train, rpm, many=True)
    speeds = np.atleast_1d(np.asarray(rpm, dtype=float))
    request = Request.of(train, harmonics, tolerance, few_levels=True)
    cycles = cycles or Cycles()
    plans = plan_speeds(train, speeds, request)
    classifier = Classifier(
        train, speeds, request, exact, cycles, tuple(devices), apart=_apart(plans)
    )
    checkpoint = None
    if out is not None:
        chunk = CHUNK if chunk is None else chunk
        settings = {
            "answers": "steady states",
            **vars(request),
            "exact": exact,
            **vars(cycles),
        }
        checkpoint = Checkpoint(out, train, settings, chunk)
    if executor is not None and chunk is None:
        chunk = PART
    search = _SpeedSweep(
        classifier, plans, checkpoint, start, progress, chunk, on_states, executor
    )
    if not np.ndim(rpm):
        return search.single(0)
    order = np.argsort(speeds, kind="stable")
    sweeps = {}
    for way in ("up", "down") if direction == "both" else (direction,):
        search.way = way
        states = search.along(order if way == "up" else order[::-1])
        in_order = tuple(states[index] for index in range(len(speeds)))
        sweeps[way] = SteadySweep(in_order, way)
    if direction == "both":
        return sweeps["up"], sweeps["down"]
    return sweeps[direction]


def state_from(
    train: DriveTrain,
    rpm: float,
    start: Start,
    at_hand: SteadyState,
    *,
    harmonics: int | None = None,
    tolerance: float | None = None,
) -> SteadyState:
    """Steady state of a train at one speed from a motion of its neighbour, of another
    train perhaps; ``at_hand`` is that from teeth in contact.
    """
    request = Request.of(train, harmonics, tolerance, few_levels=True)
    speeds = np.array([rpm], dtype=float)
    apart = _apart(plan_speeds(train, speeds, request))
    classifier = Classifier(
        train, speeds, request, True, Cycles(), apart=apart, states={0: at_hand}
    )
    states = classifier.states_from([0], {0: start.motion})
    return replace(states[0], started_from=start.rpm)


def _apart(plans: Sequence[Plan]) -> set[int]:
    """Indices of speeds at which the linear motion separates teeth."""
    return {index for index, plan in enumerate(plans) if plan.active and plan.marches}


class _SpeedSweep:
    """One call of :func:`steady_state`: a train, its speeds, the states at hand, and
    where others are kept and computed.
    """

    def __init__(
        self,
        classifier: Classifier,
        plans: Sequence[Plan],
        checkpoint: Checkpoint | None,
        start: SteadyState | Response | None,
        progress: Callable[[int], object] | None,
        chunk: int | None,
        on_states: OnStates | None,
        executor: Executor | None,
    ):
        self.classifier = classifier
        self._checkpoint = checkpoint
        self._executor = executor
        self.chunk = chunk
        self.train = classifier.train
        self.speeds = classifier.speeds
        self.progress = progress or (lambda count: None)
        self._on_states = on_states or (lambda states, way: None)
        self._reported: dict[tuple[str, int], SteadyState] = {}
        self.way = "up"
        self.start = (
            None
            if start is None
            else Start(motion_of(self.train, start), float(start.rpm))
        )
        # Responses of the speeds at which the linear motion holds the teeth in contact,
        # by index
        self.contact: dict[int, Response] = {}
        for shared in {plan for plan in plans if not plan.active}:
            indices = [i for i, plan in enumerate(plans) if plan == shared]
            batches = solve_batches(
                self.train,
                self.speeds[indices],
                shared,
                devices=self.classifier.devices,
            )
            responses = (response for batch in batches for response in batch)
            for index, response in zip(indices, responses, strict=True):
                if int(response.status) != Status.PLAN_VIOLATED:
                    self.contact[index] = response

    def report(self, states: dict[int, SteadyState]) -> None:
        """Report steady states by index."""
        if states:
            self._on_states(states, self.way)
        self._reported |= {(self.way, index): state for index, state in states.items()}

    def chunk_by_chunk(
        self,
        indices: Sequence[int] | np.ndarray,
        starts: Mapping[int, Start],
        progress: Callable[[int], object],
    ) -> dict[int, SteadyState]:
        """Steady states of some speeds by index, marched in chunks, from ``starts`` by
        index or from teeth in contact.
        """
        size = self.chunk or max(len(indices), 1)
        chunks = [
            [int(index) for index in indices[first : first + size]]
            for first in range(0, len(indices), size)
        ]
        motions = [
            {index: starts[index].motion for index in chunk if index in starts}
            for chunk in chunks
        ]
        questions = [
            (
                self.speeds[chunk],
                [index in started for index in chunk],
                *started.values(),
            )
            for chunk, started in zip(chunks, motions, strict=True)
        ]
        alone = self._executor is None
        parts = [
            (self.classifier if alone else self.classifier.part(chunk), chunk, started)
            for chunk, started in zip(chunks, motions, strict=True)
        ]
        march = partial(_march, progress=progress) if alone else _march
        states: dict[int, SteadyState] = {}
        for number, marched in answered_parts(
            self._checkpoint,
            questions,
            march,
            parts,
            self._executor,
            lambda marched: progress(len(marched)),
        ):
            chunk_states = dict(zip(chunks[number], marched, strict=True))
            chunk_states |= {
                index: replace(chunk_states[index], started_from=starts[index].rpm)
                for index in motions[number]
            }
            self.report(chunk_states)
            states |= chunk_states
        return states

    def single(self, index: int) -> SteadyState:
        """The steady state of a single speed, from the start of the call or from teeth
        in contact.
        """
        # A train of constant links has one motion, wherever it starts from, and nothing
        # to march.
        if self.start is not None and self.classifier.train.topology.has_law.any():
            states = self.chunk_by_chunk([index], {index: self.start}, self.progress)
            return states[index]
        self._from_contact([index])
        return self.classifier.states[index]

    def _from_contact(self, indices: Sequence[int]) -> None:
        """Find the steady states of speeds from teeth in contact, side by side."""
        states = self.classifier.states
        marching = []
        for index in indices:
            if index in self.contact:
                states[index] = self._contact(index)
                self.progress(1)
            else:
                marching.append(index)
        self.report({index: states[index] for index in indices if index in states})
        states |= self.chunk_by_chunk(marching, {}, self.progress)

    def along(self, order: Sequence[int] | np.ndarray) -> dict[int, SteadyState]:
        """Steady states by index, each reached from the one before it in ``order``."""
        from_contact = self.classifier.states
        self._from_contact(
            [index for index in range(len(self.speeds)) if index not in from_contact]
        )
        begun = {}
        if self.start is not None:
            begun = self.chunk_by_chunk(
                order[:1], {order[0]: self.start}, lambda count: None
            )
        states = settle_along(
            order,
            from_contact,
            lambda starts: self.chunk_by_chunk(
                list(starts), starts, lambda count: None
            ),
            lambda index: f"{self.speeds[index]:g} rpm",
            begun,
        )
        # A speed marched from its neighbour was reported before it was compared with
        # the states at hand.
        changed = {
            index: state
            for index, state in states.items()
            if self._reported.get((self.way, index)) is not state
        }
        self.report(changed)
        return states

    def _contact(self, index: int) -> SteadyState:
        """The steady state of teeth in contact."""
        response = self.contact[index]
        rpm = self.speeds[index]
        if not response.solved:
            return unknown(self.train, rpm, Status(int(response.status)).sentence)
        kind = kind_of_one_cycle(self.train.topology, ())
        return state_of(
            self.train,
            rpm,
            kind,
            1,
            response=response,
            motion=motion_of(self.train, response),
        )


def _march(
    classifier: Classifier,
    indices: Sequence[int],
    motions: Mapping[int, np.ndarray],
    progress: Callable[[int], object] = lambda count: None,
) -> list[SteadyState]:
    """Steady states of a chunk of speeds, as :meth:`Classifier.states_from`."""
    states = classifier.states_from(indices, motions, progress)
    return [states[index] for index in indices]
