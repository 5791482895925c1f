"""What marches show: harmonic balance of a motion that returns, a record of one that
does not, and what kind it is.
"""

import contextlib
import dataclasses
from functools import cached_property, partial

import jax
import numpy as np

from jaxhb._threads import side_by_side
from jaxhb.balance.swept import ARRIVED
from jaxhb.elements.elements import SceneError
from jaxhb.equations import fourier
from jaxhb.floquet.stability import NEUTRAL, attracts
from jaxhb.results.response import Response
from jaxhb.results.steady import SteadyState, kind_of_one_cycle
from jaxhb.solutions import planning, sweeping
from jaxhb.solutions.solve import solve
from jaxhb.steady.closure import DECAYS, LONGER, NEAR, RECORDED, SPREAD, ended
from jaxhb.steady.confirmation import (
    LEVELS,
    compile_ahead,
    same_motion,
    settle_marched,
    shortest_period,
    solve_marched,
)
from jaxhb.steady.marching import Batch, Equations, part_sizes, record_of
from jaxhb.train import chain

# Difference of the motions of neighbouring speeds from which the one may have another
# motion when it starts from the other; and of largest deflections up to which records
# of irregular motion are of one.
APART = 0.1
# Closure error below which a motion may have the shorter period that its solution has
RETURNED = 5e-3
# Times the steps of a march, at most, where twice as many did not confirm what it shows
FINEST = 4
# Cycles after which a march with shorter steps is recorded that begins at the motion of
# longer ones
LATER = 32
# Where a march is too long
HIGHER = ": ask for a higher speed, or for a periodic motion (--orbit, jaxhb.solve)"
# That a march with the finest steps goes on where harmonic balance did not find its
# motion
MORE_CYCLES = 32


class Classifier:
    """The steady states of one train, from marches of its speeds ``(n,)``, on one
    device or across several; ``known`` are those at hand, by the index of their speed,
    ``apart`` the indices of speeds where the linear motion separates teeth.

    Sweeps that settle are a march that did, and what they end at is exact; the rest is
    marched. A march begins with few steps. What harmonic balance confirms is exact
    whatever the steps. The rest, irregular motion above all, is marched on with twice
    the steps: on ``gear_train_30`` three of sixty speeds had another kind of motion
    with the fewest steps than with any others.
    """

    def __init__(self, train, speeds, request, exact, cycles, devices=()):
        self.devices = devices
        self.train = train
        self.speeds = speeds
        self.request = request
        self.exact = exact
        self.longest_record = LONGER if cycles.recorded is None else cycles.recorded
        self.cycles = dataclasses.replace(
            cycles, recorded=RECORDED if cycles.recorded is None else cycles.recorded
        )
        self.known, self.apart, self._swept_trains = {}, set(), {}
        # Lists of (Response, period) of motions that marches passed by, by index of the
        # speed
        self.repelling = {}

    def march_to_the_end(self, indices, motions, progress=lambda count: None):
        """Steady states of some speeds by index, side by side, from motions ``{index:
        (x, x')}`` or from teeth in contact; ``progress`` is called with the number of
        those that became known.
        """
        states = {}
        if isinstance(self.equations, str):
            states = {
                index: unknown(self.train, self.speeds[index], self.equations)
                for index in indices
            }
        else:  # counted before anything is marched
            too_long = {
                index: self.equations.too_long(self.speeds[index]) for index in indices
            }
            states = {
                index: self._unmarched(index, reason)
                for index, reason in too_long.items()
                if reason
            }
        progress(len(states))
        states |= self._swept(
            [i for i in indices if i not in states], motions, progress
        )
        return states | self._march_compiled(
            [index for index in indices if index not in states], motions, progress
        )

    def swept(self, period):
        """The SweptTrain with so many cycles as its cycle; None where sweeps do not
        serve.
        """
        if not self.exact or len(self.devices) > 1:
            return None
        if period not in self._swept_trains:
            train = self.train.repeated(period) if period > 1 else self.train
            plan = planning.contact_plan(train, self.request)
            self._swept_trains[period] = sweeping.swept_train(train, plan, self.request)
        return self._swept_trains[period]

    def _swept(self, indices, motions, progress):
        """Steady states by index of speeds at which sweeps settle at a motion that
        attracts.
        """
        if not indices or self.swept(1) is None:
            return {}
        settle = partial(self._settled, motions)
        states = {}
        with contextlib.closing(side_by_side(settle, indices, self.devices)) as found:
            for index, state in zip(indices, found, strict=False):
                if state is not None:
                    states[index] = state
                    progress(1)
        return states

    def _settled(self, motions, index):
        """The steady state of a speed at which sweeps end at a motion that attracts,
        else None.
        """
        rpm = float(self.speeds[index])
        known = self.known.get(index)
        at_hand = known.response if known is not None and known.period == 1 else None
        response = self.swept(1).solve(
            rpm, motion=motions.get(index), newton=False, at_hand=at_hand
        )
        if not response.solved:
            return None
        if response is at_hand:
            return known
        attracted, stability, _ = attracts(response)
        if not attracted:
            return None
        kind = kind_of_one_cycle(self.train.topology, response.contacts().values())
        found = {"motion": motion_of(self.train, response), "stability": stability}
        return state_of(
            self.train,
            rpm,
            kind,
            1,
            response=response,
            cycles=int(response.steps),
            **found,
        )

    def _unmarched(self, index, reason):
        """The steady state of a speed whose march is too long."""
        return self.from_contact(index, f"{reason}: the motion") or unknown(
            self.train, self.speeds[index], reason + HIGHER
        )

    def from_contact(self, index, why, neutral=False):
        """The steady state that Newton's method finds from teeth in contact, None
        unless the linear motion separates no teeth and disturbances of it do not grow
        (``neutral``: nor fall); ``why`` begins the note that says so.
        """
        if not self.exact or index in self.apart:
            return None
        rpm = self.speeds[index]
        given = {
            "harmonics": self.request.harmonics,
            "tolerance": self.request.tolerance,
        }
        response = solve(self.train, rpm=float(rpm), start="linear", **given)
        attracted, stability, _ = (
            attracts(response) if response.solved else (False, None, "")
        )
        if not attracted or neutral and stability.largest < 1 - NEUTRAL:
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

    def _march_compiled(self, indices, motions, progress):
        """Those of speeds that are marched, while the programs that confirm them are
        made.
        """
        programs = []
        if self.exact and indices and self.swept(1) is None:
            separates = {self.speeds[index]: index in self.apart for index in indices}
            programs = compile_ahead(self.train, separates, self.request)
        try:
            return self._marched(indices, motions, progress)
        finally:
            for program in programs:
                program.cancel()

    def _marched(self, indices, motions, progress):
        found = {}
        march = partial(self._until_sure, motions=motions)
        with contextlib.closing(
            side_by_side(march, self._groups(indices), self.devices)
        ) as groups:
            for states in groups:
                progress(len(states))
                found |= states
        return {index: found[index] for index in indices}

    def _until_sure(self, indices, motions):
        """Steady states of speeds that share steps; with the finest steps every motion
        is classified.
        """
        found = {}
        spent = dict.fromkeys(indices, 0)
        refinement = 1
        while indices:
            speeds = self.speeds[indices]
            finer = {}
            batch = Batch(
                self.equations,
                speeds,
                refinement * self.equations.steps(speeds.min()),
                self.devices,
            )
            for i, index in enumerate(indices):
                if index in motions:
                    batch.begin(i, motions[index])
            cycles = self._cycles_of(
                batch, min(spent[index] for index in indices), refinement
            )
            while marches := [march for march in batch.marches if not march.done]:
                over = ended(batch, marches, cycles, self.exact)
                if not self.exact:
                    _record(batch, over)
                for march, period in over:
                    index = indices[march.place]
                    classification = _Classification(
                        self, index, batch, march, spent[index], refinement
                    )
                    state = classification.state(period)
                    march.done = state is not None or classification.needs_refinement
                    if state is not None:
                        found[index] = state
                    elif classification.needs_refinement:
                        finer[index] = batch.motion(march)
                        spent[index] += march.cycles
            motions = finer
            refinement = 2 * refinement
            refused = {
                index: self.equations.too_long(self.speeds[index], refinement)
                for index in finer
            }
            found |= {
                i: unknown(self.train, self.speeds[i], why + HIGHER)
                for i, why in refused.items()
                if why
            }
            indices = [
                index for index in indices if index in finer and not refused[index]
            ]
        return found

    @cached_property
    def equations(self):
        """The Equations of the train, or the sentence that refuses it."""
        try:
            return Equations(self.train)
        except ValueError as refusal:
            return str(refusal)

    def _groups(self, indices):
        """Indices of speeds that are marched in one program: on processors each by
        itself, so that its numbers are the same bits whatever speeds are asked for
        beside it, else those that take the same steps.
        """
        if len(self.devices) < 2 and jax.default_backend() == "cpu":
            return [[index] for index in indices]
        groups = {}
        for index in indices:
            groups.setdefault(self.equations.steps(self.speeds[index]), []).append(
                index
            )
        return list(groups.values())

    def _cycles_of(self, batch, spent, refinement):
        """How long marches of a batch are at most, of which ``spent`` cycles are
        behind.
        """
        decay = self.equations.decay_cycles(max(march.rpm for march in batch.marches))
        before = self.cycles.before_record(batch.work, decay)
        if not self.exact:
            return dataclasses.replace(self.cycles, transient=before)
        if refinement == 1:
            # Looks for a period, which harmonic balance confirms: a motion without one
            # is not believed before shorter steps show it, too, and is recorded then.
            return dataclasses.replace(self.cycles, transient=before, recorded=0)
        # Begins at the motion of longer steps, which has only to become that of these.
        return dataclasses.replace(
            self.cycles, transient=max(min(before - spent, LATER), 0)
        )


def _record(batch, over):
    """Record a period of the marches that have one, ``(march, period)``, side by side
    those with the same.
    """
    for period in {period for march, period in over if not march.recorded} - {0}:
        batch.run(
            [march for march, own in over if own == period and not march.recorded],
            True,
            period,
        )


class _Classification:
    """What the motion of one march is that may have ended; ``needs_refinement`` where
    shorter steps have to decide.
    """

    def __init__(self, classifier, index, batch, march, spent, refinement):
        self.classifier = classifier
        self.index = index
        self.batch = batch
        self.march = march
        self.refinement = refinement
        self.spent = spent
        self.needs_refinement = False
        self.notes = []
        missing = batch.equations.modes_and_missing[1]
        if np.any(classifier.train.shafts.loss_factor) or np.any(
            classifier.train.dampers.loss_factor
        ):
            self.notes.append(
                "time integration replaces loss factors by damping of each mode at its"
                " natural frequency"
            )
        if missing:
            share = f"{100 * missing:.2g} %"
            self.notes.append(
                f"time integration leaves out modes that hold {share} of the compliance"
                " of a mesh"
            )

    def state(self, period):
        """The steady state; None where the march has to go on, or needs refinement."""
        classifier = self.classifier
        march = self.march
        if not march.closure.finite:
            reason = (
                "time integration gives no finite motion: check the scene for huge or"
                " tiny numbers"
            )
            return unknown(classifier.train, classifier.speeds[self.index], reason)
        if not period:
            return (
                self._irregular()
                if self.refinement > 1 or not classifier.exact
                else self._finer()
            )
        if not classifier.exact:
            return self._recorded(period)
        response, period = self._solved(period)
        if response is None:
            return self._unsolved(period)
        passed_by = classifier.repelling.setdefault(self.index, [])
        if any(motion is response for motion, _ in passed_by):
            return self._passed_by()
        known = classifier.known.get(self.index)
        asked = known is not None and known.response is response
        stays, stability, undecided = (
            (True, known.stability, "") if asked else attracts(response)
        )
        if stays is False:
            passed_by.append((response, period))
            return self._passed_by()
        if undecided:
            self.notes.append(
                f"whether the motion is stable is not decided: {undecided}"
            )
        return self._periodic(
            period, response.contacts().values(), response=response, stability=stability
        )

    def _made(self, kind, period, **found):
        cycles = self.spent + self.march.cycles
        classifier = self.classifier
        motion = found.pop("motion", None)
        motion = self.batch.motion(self.march) if motion is None else motion
        rpm = classifier.speeds[self.index]
        known = {"cycles": cycles, "notes": self.notes, "motion": motion}
        return state_of(classifier.train, rpm, kind, period, **known, **found)

    def _finer(self):
        self.needs_refinement = True

    def _solved(self, period):
        """Response (None where harmonic balance did not find the motion) and period of
        a march that returns.
        """
        classifier = self.classifier
        batch = self.batch
        march = self.march
        while True:
            trace = batch.traced(march, period)
            meshes = batch.equations.meshes
            known = classifier.known.get(self.index)
            common = (
                known is not None
                and known.response is not None
                and known.period == period
            )
            if common and same_motion(
                known.response, trace, meshes, classifier.train, period, ARRIVED
            ):
                return known.response, period
            passed = self._passed_again(trace, period)
            if passed is not None:
                return passed, period
            given = {"steps": batch.steps, "meshes": meshes}
            swept = classifier.swept(period)
            if swept is not None:
                response = settle_marched(swept, march, trace, period, **given)
            else:
                given["levels"] = LEVELS if self.refinement == FINEST else 1
                response = solve_marched(
                    classifier.train, march, trace, period, classifier.request, **given
                )
            shorter = period if response is None else shortest_period(response, period)
            if shorter == period:
                return response, period
            if march.closure.errors(shorter)[0] > RETURNED:
                return None, period
            period = shorter

    def _passed_again(self, trace, period):
        """The Response of a motion that repels and that the march passes by once more,
        None where it may be another.
        """
        classifier = self.classifier
        march = self.march
        if (
            march.closure.errors(period)[0] <= NEAR
        ):  # it may have come to one that attracts beside that
            return None
        given = trace, self.batch.equations.meshes, classifier.train, period
        known = classifier.repelling.get(self.index, ())
        return next(
            (
                other
                for other, its in known
                if its == period and same_motion(other, *given)
            ),
            None,
        )

    def _unsolved(self, period):
        """Where harmonic balance did not find the motion."""
        if self.refinement < FINEST:
            return self._finer()
        if self.march.recorded < self.classifier.cycles.recorded:
            self.march.not_before = self.march.cycles + MORE_CYCLES
            return None
        if not self.march.closure.period_at_end():  # it was only worth the question
            return self._irregular()
        self.notes.append(
            "harmonic balance did not find the motion that time integration shows: the"
            " numbers are those of recorded cycles (another tolerance or number of"
            " harmonics may find it)"
        )
        return self._recorded(period)

    def _passed_by(self):
        """Where a march came near a motion that repels, which with these steps may
        attract.
        """
        if self.refinement < FINEST:
            return self._finer()
        if (
            self.march.recorded < self.classifier.cycles.recorded
            or self.march.cycles < self.classifier.cycles.most
        ):
            # It takes cycles to leave it, and solving again shows nothing more.
            self.march.not_before = self.classifier.cycles.most
            return None
        return self._irregular()

    def _irregular(self):
        """Motion without a period, read from its record."""
        equations = self.batch.equations
        march = self.march
        kept = (
            "nothing damps the vibration with which time integration begins: the motion"
            " without it"
        )
        undisturbed = self.classifier.from_contact(self.index, kept, neutral=True)
        if undisturbed is not None:
            return undisturbed
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
            self.notes.append(
                f"a vibration that teeth notice {slow}, and the record began after"
                f" {before}: the loads may still change ({longer})"
            )
        motion = self.batch.motion(march)
        record = record_of(equations, march)
        longer = self.classifier.longest_record - march.recorded
        if record.spread > SPREAD and longer > 0:
            # The motion from which a neighbour starts stays that of the shorter record.
            for count in part_sizes(longer):
                self.batch.run([march], True, count)
            record = record_of(equations, march)
        return self._made("irregular", 0, record=record, motion=motion)

    def _recorded(self, period):
        """Motion with a period, read from its record."""
        record = record_of(self.batch.equations, self.march)
        return self._periodic(period, record.contacts, record=record)

    def _periodic(self, period, contacts, **found):
        kind = (
            "subharmonic"
            if period > 1
            else kind_of_one_cycle(self.batch.equations.train.topology, contacts)
        )
        return self._made(kind, period, **found)


def state_of(
    train,
    rpm,
    kind,
    period,
    *,
    response=None,
    record=None,
    cycles=0,
    notes=(),
    motion=None,
    stability=None,
):
    """The :class:`SteadyState` of a train at a speed."""
    known = float(rpm), kind, period, response, record, cycles, tuple(notes), motion
    return SteadyState(*known, train.topology, stability)


def unknown(train, rpm, reason):
    """The SteadyState of a motion that is not known."""
    return state_of(train, rpm, "unknown", 0, notes=(reason,))


def motion_of(train, start):
    """(x, x') ``(2S,)`` at the beginning of a cycle of a SteadyState or Response of the
    train.
    """
    motion = start.motion if isinstance(start, SteadyState) else None
    if isinstance(start, Response):
        if np.ndim(start.rpm):
            raise ValueError(
                "start is a sweep: give the response at one speed, sweep[i]"
            )
        radius = np.asarray(chain.assemble(train).radius)[:, None]
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
