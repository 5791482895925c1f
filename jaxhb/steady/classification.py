"""Classification of the motions that marches show: harmonic balance of a motion that
returns, a record of a motion that does not.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from functools import partial
from typing import Any, cast

import jax
import numpy as np

from jaxhb._threads import side_by_side
from jaxhb.balance.plan import Request
from jaxhb.balance.swept import ARRIVED
from jaxhb.elements.sentences import SceneError
from jaxhb.equations import fourier
from jaxhb.floquet.stability import NEUTRAL, Stability, Tendency, tendency
from jaxhb.results.contact import Contact
from jaxhb.results.record import Record, SteadyContact
from jaxhb.results.response import Response
from jaxhb.results.steady import SteadyState, kind_of_one_cycle
from jaxhb.solutions import planning, sweeping
from jaxhb.solutions.solve import solve
from jaxhb.steady.closure import DECAYS, LONGER, NEAR, RECORDED, SPREAD, Cycles
from jaxhb.steady.confirmation import (
    LEVELS,
    same_motion,
    settle_marched,
    shortest_period,
    solve_marched,
)
from jaxhb.steady.marching import (
    Batch,
    Equations,
    SpeedMarch,
    ended,
    part_sizes,
    record_of,
)
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.kinematics import displacement_radii
from jaxhb.train.varying import at_speed

# Difference of the motions of neighbouring speeds from which one speed may have another
# motion when it starts from the other; and difference of largest deflections up to
# which records of irregular motion are of the same motion.
APART = 0.1
# Closure error below which a motion may have the shorter period that its solution has
RETURNED = 5e-3
# Times the steps of a march, at most, where twice as many did not confirm what it shows
FINEST = 4
# Cycles after which a march with shorter steps is recorded that begins at the motion of
# longer ones
LATER = 32
# Advice where a march is too long
HIGHER = ": ask for a higher speed, or for a periodic motion (--orbit, jaxhb.solve)"
# Cycles for which a march with the finest steps goes on where harmonic balance did not
# find its motion
MORE_CYCLES = 32


@dataclass(frozen=True)
class SolvedMotion:
    """Periodic solution over ``period`` cycles of the excitation as one."""

    response: Response
    period: int


@dataclass(frozen=True, eq=False)
class Classifier:
    """The steady states of one train, from marches of its speeds ``(n,)``, on one
    device or across several.

    apart : indices of speeds where the linear motion separates teeth; by the index of
    their speed, states : those at hand, and repelling : motions that marches passed by;
    swept_trains : of :meth:`swept`, by period; equations : of :meth:`equations_at`.

    Sweeps that settle are a march that did, and the motion at which they end is exact;
    the other speeds are marched. A march begins with few steps. A motion that harmonic
    balance confirms is exact whatever the steps. Any other, irregular motion above all,
    is marched on with twice the steps: on ``gear_train_30`` three of sixty speeds had
    another kind of motion with the fewest steps than with more.
    """

    train: DriveTrain
    speeds: np.ndarray
    request: Request
    exact: bool
    cycles: Cycles
    devices: Sequence[Any] = ()
    apart: Set[int] = frozenset()
    states: dict[int, SteadyState] = field(default_factory=dict)
    repelling: dict[int, list[SolvedMotion]] = field(default_factory=dict)
    swept_trains: dict[int, sweeping.SweptTrain | None] = field(default_factory=dict)
    equations: dict[float | None, Equations | str] = field(default_factory=dict)

    @property
    def recorded(self) -> int:
        """Cycles of a record."""
        return RECORDED if self.cycles.recorded is None else self.cycles.recorded

    @property
    def longest_record(self) -> int:
        """Cycles of a record whose extremes vary."""
        return LONGER if self.cycles.recorded is None else self.cycles.recorded

    def part(self, indices: Iterable[int]) -> Classifier:
        """The Classifier of some of the speeds, for another process."""
        at_hand = {
            index: self.states[index] for index in indices if index in self.states
        }
        return dataclasses.replace(
            self, states=at_hand, repelling={}, swept_trains={}, equations={}
        )

    def states_from(
        self,
        indices: Sequence[int],
        motions: Mapping[int, np.ndarray],
        progress: Callable[[int], object] = lambda count: None,
    ) -> dict[int, SteadyState]:
        """Steady states of some speeds by index, side by side, from motions ``{index:
        (x, x')}`` or from teeth in contact; ``progress`` is called with the number of
        speeds that are done.
        """
        states = {}
        for index in indices:  # counted before anything is marched
            equations = self.equations_at(index)
            if isinstance(equations, str):
                states[index] = unknown(self.train, self.speeds[index], equations)
            elif reason := equations.too_long(self.speeds[index]):
                states[index] = self._unmarched(index, reason)
        progress(len(states))
        unswept = [index for index in indices if index not in states]
        states |= self._swept(unswept, motions, progress)
        unmarched = [index for index in indices if index not in states]
        return states | self._marched(unmarched, motions, progress)

    def swept(self, period: int) -> sweeping.SweptTrain | None:
        """The SweptTrain with so many cycles as its cycle; None where sweeps do not
        serve.
        """
        if not self.exact or len(self.devices) > 1:
            return None
        if period not in self.swept_trains:
            train = self.train.repeated(period) if period > 1 else self.train
            plan = planning.contact_plan(train, self.request)
            self.swept_trains[period] = sweeping.swept_train(train, plan, self.request)
        return self.swept_trains[period]

    def _swept(
        self,
        indices: Sequence[int],
        motions: Mapping[int, np.ndarray],
        progress: Callable[[int], object],
    ) -> dict[int, SteadyState]:
        """Steady states by index of speeds at which sweeps settle at a motion that
        attracts.
        """
        if not indices or self.swept(1) is None:
            return {}
        settle = partial(self._settled, motions)
        states = {}
        with contextlib.closing(side_by_side(settle, indices, self.devices)) as settled:
            for index, state in zip(indices, settled, strict=False):
                if state is not None:
                    states[index] = state
                    progress(1)
        return states

    def _settled(
        self, motions: Mapping[int, np.ndarray], index: int
    ) -> SteadyState | None:
        """The steady state of a speed at which sweeps end at a motion that attracts,
        else None.
        """
        rpm = float(self.speeds[index])
        earlier = self.states.get(index)
        at_hand = None
        if earlier is not None and earlier.period == 1:
            at_hand = earlier.response
        swept = self.swept(1)
        assert swept is not None, "sweeps serve"
        response = swept.solve(
            rpm, motion=motions.get(index), newton=False, at_hand=at_hand
        )
        if not response.solved:
            return None
        if response is at_hand:
            return earlier
        decided = tendency(response)
        if not decided.attracts:
            return None
        kind = kind_of_one_cycle(self.train.topology, response.contacts().values())
        return state_of(
            self.train,
            rpm,
            kind,
            1,
            response=response,
            cycles=int(response.steps),
            motion=motion_of(self.train, response),
            stability=decided.stability,
        )

    def _unmarched(self, index: int, reason: str) -> SteadyState:
        """The steady state of a speed whose march is too long."""
        return self.from_contact(index, f"{reason}: the motion") or unknown(
            self.train, self.speeds[index], reason + HIGHER
        )

    def from_contact(
        self, index: int, why: str, neutral: bool = False
    ) -> SteadyState | None:
        """The steady state that Newton's method finds from teeth in contact; None
        unless the linear motion separates no teeth and disturbances of the solution do
        not grow (``neutral``: nor fall). ``why`` begins the note that says so.
        """
        if not self.exact or index in self.apart:
            return None
        rpm = self.speeds[index]
        response = solve(
            self.train,
            rpm=float(rpm),
            start="linear",
            harmonics=self.request.harmonics,
            tolerance=self.request.tolerance,
        )
        if not response.solved:
            return None
        stability = tendency(response).stability
        if stability is None or not stability.stable:
            return None
        if neutral and stability.largest < 1 - NEUTRAL:
            return None
        notes = (
            (
                f"{why} is solved from teeth in contact, and other motions were not"
                " looked for"
            ),
        )
        apart = any(
            contact.separated_fraction > 0 for contact in response.contacts().values()
        )
        kind = "periodic" if apart else "contact"
        return state_of(
            self.train,
            rpm,
            kind,
            1,
            response=response,
            stability=stability,
            notes=notes,
        )

    def _marched(
        self,
        indices: Sequence[int],
        motions: Mapping[int, np.ndarray],
        progress: Callable[[int], object],
    ) -> dict[int, SteadyState]:
        """Steady states of speeds that are marched, group by group."""
        states: dict[int, SteadyState] = {}
        march = partial(self._until_sure, motions=motions)
        with contextlib.closing(
            side_by_side(march, self._groups(indices), self.devices)
        ) as groups:
            for group_states in groups:
                progress(len(group_states))
                states |= group_states
        return {index: states[index] for index in indices}

    def _until_sure(
        self, indices: Sequence[int], motions: Mapping[int, np.ndarray]
    ) -> dict[int, SteadyState]:
        """Steady states of speeds that share steps; with the finest steps every motion
        is classified.
        """
        equations = self.equations_at(indices[0])  # of all of them
        assert isinstance(equations, Equations), "a train that can be marched"
        states: dict[int, SteadyState] = {}
        spent = dict.fromkeys(indices, 0)
        refinement = 1
        while indices:
            speeds = self.speeds[indices]
            finer = {}
            steps = refinement * equations.steps(speeds.min())
            batch = Batch(equations, speeds, steps, self.devices)
            for i, index in enumerate(indices):
                if index in motions:
                    batch.begin(i, motions[index])
            least_spent = min(spent[index] for index in indices)
            cycles = self._cycles_of(batch, least_spent, refinement)
            running = list(batch.marches)
            while running:
                over = ended(batch, running, cycles, self.exact)
                if not self.exact:
                    _record(batch, over)
                for march, period in over:
                    index = indices[march.place]
                    classification = _Classification(
                        self, index, batch, march, spent[index], refinement
                    )
                    verdict = classification.verdict(period)
                    march.not_before = verdict.not_before
                    if verdict.state is not None:
                        states[index] = verdict.state
                        running.remove(march)
                    elif verdict.is_for_shorter_steps:
                        finer[index] = batch.motion(march)
                        spent[index] += march.cycles
                        running.remove(march)
            motions = finer
            refinement = 2 * refinement
            refused = {
                index: equations.too_long(self.speeds[index], refinement)
                for index in finer
            }
            states |= {
                index: unknown(self.train, self.speeds[index], why + HIGHER)
                for index, why in refused.items()
                if why
            }
            indices = [
                index for index in indices if index in finer and not refused[index]
            ]
        return states

    def equations_at(self, index: int) -> Equations | str:
        """The Equations of the train at a speed, or the sentence that refuses it; those
        of all speeds are the same where nothing depends on them.
        """
        constant = not self.train.topology.depends_on_speed
        speed = None if constant else float(self.speeds[index])
        if speed not in self.equations:
            train = self.train if speed is None else at_speed(self.train, speed)
            try:
                self.equations[speed] = Equations(train)
            except ValueError as refusal:
                self.equations[speed] = str(refusal)
        return self.equations[speed]

    def _groups(self, indices: Sequence[int]) -> list[list[int]]:
        """Group indices of speeds that are marched in one program: on processors each
        by itself, so that its numbers are the same bits whatever speeds there are
        beside it, else those that take the same steps, of a train with the same numbers
        at all speeds.
        """
        on_processors = len(self.devices) < 2 and jax.default_backend() == "cpu"
        if on_processors or self.train.topology.depends_on_speed:
            return [[index] for index in indices]
        groups: dict[int, list[int]] = {}
        for index in indices:
            equations = self.equations_at(index)
            assert isinstance(equations, Equations), "a train that can be marched"
            groups.setdefault(equations.steps(self.speeds[index]), []).append(index)
        return list(groups.values())

    def _cycles_of(self, batch: Batch, spent: int, refinement: int) -> Cycles:
        """Largest length of the marches of a batch, of which ``spent`` cycles are
        behind.
        """
        highest_rpm = max(march.rpm for march in batch.marches)
        decay = batch.equations.decay_cycles(highest_rpm)
        before = self.cycles.before_record(batch.work, decay)
        cycles = dataclasses.replace(
            self.cycles, transient=before, recorded=self.recorded
        )
        if not self.exact:
            return cycles
        if refinement == 1:
            # Looks for a period, which harmonic balance confirms: a motion without one
            # is not believed before shorter steps show it, too, and is recorded then.
            return dataclasses.replace(cycles, recorded=0)
        # Begins at the motion of longer steps, which has only to become that of these.
        return dataclasses.replace(cycles, transient=max(min(before - spent, LATER), 0))


def _record(batch: Batch, over: Iterable[tuple[SpeedMarch, int]]) -> None:
    """Record a period of the marches ``(march, period)`` that have one, side by side
    those with the same period.
    """
    unrecorded = [(march, period) for march, period in over if not march.recorded]
    for period in {period for _, period in unrecorded} - {0}:
        marches = [
            march for march, march_period in unrecorded if march_period == period
        ]
        batch.run(marches, True, period)


@dataclass(frozen=True)
class _Verdict:
    """Verdict on a march that may have ended: its steady state, or that shorter steps
    have to decide, or else that it goes on and no period counts before ``not_before``
    of its cycles.
    """

    state: SteadyState | None = None
    is_for_shorter_steps: bool = False
    not_before: int = 0


_SHORTER_STEPS = _Verdict(is_for_shorter_steps=True)


@dataclass(frozen=True)
class _Classification:
    """Classification of the motion of one march that may have ended, after ``spent``
    cycles with longer steps.
    """

    classifier: Classifier
    index: int
    batch: Batch
    march: SpeedMarch
    spent: int
    refinement: int

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on what time integration leaves out."""
        train = self.classifier.train
        missing = self.batch.equations.modes_and_missing[1]
        notes = []
        if np.any(train.shafts.loss_factor) or np.any(train.dampers.loss_factor):
            notes.append(
                "time integration replaces loss factors by damping of each mode at its"
                " natural frequency"
            )
        if missing:
            share = f"{100 * missing:.2g} %"
            notes.append(
                f"time integration leaves out modes that hold {share} of the compliance"
                " of a mesh"
            )
        return tuple(notes)

    def verdict(self, period: int) -> _Verdict:
        """Judge a march that has a period, or 0 where it ends without."""
        classifier = self.classifier
        if not self.march.closure.finite:
            reason = (
                "time integration gives no finite motion: check the scene for huge or"
                " tiny numbers"
            )
            speed = classifier.speeds[self.index]
            return _Verdict(unknown(classifier.train, speed, reason))
        if not period:
            if self.refinement > 1 or not classifier.exact:
                return self._irregular()
            return _SHORTER_STEPS
        if not classifier.exact:
            return self._recorded(period)
        response = self._solved(period)
        if response is None:
            return self._unsolved(period)
        shorter = shortest_period(response, period)
        if shorter < period:
            returned = self.march.closure.errors(shorter)[0] <= RETURNED
            return self.verdict(shorter) if returned else self._unsolved(period)
        passed_by = classifier.repelling.setdefault(self.index, [])
        if any(motion.response is response for motion in passed_by):
            return self._passed_by()
        earlier = classifier.states.get(self.index)
        if earlier is not None and earlier.response is response:
            decided = Tendency(cast("Stability | None", earlier.stability))
        else:
            decided = tendency(response)
            if decided.attracts is False:
                passed_by.append(SolvedMotion(response, period))
                return self._passed_by()
        undecided = f"whether the motion is stable is not decided: {decided.refusal}"
        return self._periodic(
            period,
            response.contacts().values(),
            response=response,
            stability=decided.stability,
            notes=(undecided,) if decided.refusal else (),
        )

    def _steady_state(
        self,
        kind: str,
        period: int,
        *,
        response: Response | None = None,
        record: Record | None = None,
        motion: np.ndarray | None = None,
        stability: Stability | None = None,
        notes: Iterable[str] = (),
    ) -> _Verdict:
        """The verdict with the steady state of the march; ``motion`` by default that
        where it stands.
        """
        state = state_of(
            self.classifier.train,
            self.classifier.speeds[self.index],
            kind,
            period,
            response=response,
            record=record,
            cycles=self.spent + self.march.cycles,
            notes=(*self.notes, *notes),
            motion=self.batch.motion(self.march) if motion is None else motion,
            stability=stability,
        )
        return _Verdict(state)

    def _solved(self, period: int) -> Response | None:
        """The Response of a march that returns; None where harmonic balance did not
        find its motion.
        """
        classifier = self.classifier
        batch = self.batch
        march = self.march
        trace = batch.traced(march, period)
        meshes = batch.equations.meshes
        earlier = classifier.states.get(self.index)
        if (
            earlier is not None
            and earlier.response is not None
            and earlier.period == period
            and same_motion(
                earlier.response, trace, meshes, classifier.train, period, ARRIVED
            )
        ):
            return earlier.response
        passed = self._passed_again(trace, period)
        if passed is not None:
            return passed
        swept = classifier.swept(period)
        if swept is not None:
            return settle_marched(
                swept, march, trace, period, steps=batch.steps, meshes=meshes
            )
        return solve_marched(
            classifier.train,
            march,
            trace,
            period,
            classifier.request,
            steps=batch.steps,
            meshes=meshes,
            levels=LEVELS if self.refinement == FINEST else 1,
        )

    def _passed_again(self, trace: np.ndarray, period: int) -> Response | None:
        """The Response of a motion that repels and that the march passes by once more,
        None where it may be another.
        """
        classifier = self.classifier
        march = self.march
        # It may have come to a motion that attracts beside the one that repels.
        if march.closure.errors(period)[0] <= NEAR:
            return None
        meshes = self.batch.equations.meshes
        for motion in classifier.repelling.get(self.index, ()):
            if motion.period == period and same_motion(
                motion.response, trace, meshes, classifier.train, period
            ):
                return motion.response
        return None

    def _unsolved(self, period: int) -> _Verdict:
        """Judge a march whose motion harmonic balance did not find."""
        if self.refinement < FINEST:
            return _SHORTER_STEPS
        if self.march.recorded < self.classifier.recorded:
            return _Verdict(not_before=self.march.cycles + MORE_CYCLES)
        # It was only worth the question.
        if not self.march.closure.period_at_end():
            return self._irregular()
        note = (
            "harmonic balance did not find the motion that time integration shows: the"
            " numbers are those of recorded cycles (another tolerance or number of"
            " harmonics may find it)"
        )
        return self._recorded(period, notes=(note,))

    def _passed_by(self) -> _Verdict:
        """Judge a march that came near a motion that repels, which with these steps may
        attract.
        """
        if self.refinement < FINEST:
            return _SHORTER_STEPS
        if (
            self.march.recorded < self.classifier.recorded
            or self.march.cycles < self.classifier.cycles.most
        ):
            # It takes cycles to leave it, and solving again shows nothing more.
            return _Verdict(not_before=self.classifier.cycles.most)
        return self._irregular()

    def _irregular(self) -> _Verdict:
        """The verdict of motion without a period, read from its record."""
        equations = self.batch.equations
        march = self.march
        reason = (
            "nothing damps the vibration with which time integration begins: the motion"
            " without it"
        )
        undisturbed = self.classifier.from_contact(self.index, reason, neutral=True)
        if undisturbed is not None:
            return _Verdict(undisturbed)
        notes = []
        before = self.spent + march.cycles - march.recorded
        decay = equations.decay_cycles(march.rpm)
        if before < DECAYS * decay:
            # Impacts go on exciting such a mode until what they bring in is what it
            # loses.
            slow = (
                f"takes {decay:.3g} cycles to fall to a third"
                if np.isfinite(decay)
                else "does not decay"
            )
            longer = (
                f"cycles=jaxhb.Cycles(transient={max(2 * before, 1000):d}) marches"
                " longer"
            )
            notes.append(
                f"a vibration that affects the teeth {slow}, and the record began after"
                f" {before}: the loads may still change ({longer})"
            )
        motion = self.batch.motion(march)
        record = record_of(equations, march)
        more_cycles = self.classifier.longest_record - march.recorded
        if record.spread > SPREAD and more_cycles > 0:
            # The motion from which a neighbour starts stays that of the shorter record.
            for count in part_sizes(more_cycles):
                self.batch.run([march], True, count)
            record = record_of(equations, march)
        return self._steady_state(
            "irregular", 0, record=record, motion=motion, notes=notes
        )

    def _recorded(self, period: int, notes: Iterable[str] = ()) -> _Verdict:
        """The verdict of motion with a period, read from its record."""
        record = record_of(self.batch.equations, self.march)
        return self._periodic(period, record.contacts, record=record, notes=notes)

    def _periodic(
        self,
        period: int,
        contacts: Iterable[Contact | SteadyContact],
        *,
        response: Response | None = None,
        record: Record | None = None,
        stability: Stability | None = None,
        notes: Iterable[str] = (),
    ) -> _Verdict:
        """The verdict of motion with a period, of a response or a record with these
        contacts.
        """
        kind = (
            "subharmonic"
            if period > 1
            else kind_of_one_cycle(self.batch.equations.train.topology, contacts)
        )
        return self._steady_state(
            kind,
            period,
            response=response,
            record=record,
            stability=stability,
            notes=notes,
        )


def state_of(
    train: DriveTrain,
    rpm: float,
    kind: str,
    period: int,
    *,
    response: Response | None = None,
    record: Record | None = None,
    cycles: int = 0,
    notes: Iterable[str] = (),
    motion: np.ndarray | None = None,
    stability: Stability | None = None,
) -> SteadyState:
    """The :class:`SteadyState` of a train at a speed."""
    return SteadyState(
        rpm=float(rpm),
        kind=kind,
        period=period,
        response=response,
        record=record,
        cycles=cycles,
        notes=tuple(notes),
        motion=motion,
        topology=train.topology,
        stability=stability,
    )


def unknown(train: DriveTrain, rpm: float, reason: str) -> SteadyState:
    """The SteadyState of a motion that is not known."""
    return state_of(train, rpm, "unknown", 0, notes=(reason,))


def motion_of(train: DriveTrain, start: SteadyState | Response) -> np.ndarray:
    """Motion (x, x') ``(2S,)`` of the disks at the beginning of a cycle, from a
    SteadyState or Response of the train.
    """
    motion = start.motion if isinstance(start, SteadyState) else None
    if isinstance(start, Response):
        if np.ndim(start.rpm):
            raise ValueError(
                "start is a sweep: give the response at one speed, sweep[i]"
            )
        radius = np.asarray(displacement_radii(train))[:, None]
        angles = np.asarray(start.angles) * radius
        omega = start.topology.cycle_frequency(float(start.rpm))
        motion = fourier.sample(
            np.concatenate([angles, fourier.derivative(angles, omega)]), 1
        )[:, 0]
    if motion is None:
        raise SceneError(
            "start holds no motion: give a Response, or a SteadyState whose kind is"
            " known."
        )
    if len(motion) != 2 * train.topology.n_disks:
        raise SceneError(
            "start is a motion of another train: give one with the same disks."
        )
    return motion
