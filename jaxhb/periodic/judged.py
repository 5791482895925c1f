"""What marches show: harmonic balance of a motion that returns, a record of one that does not, and what kind it is."""

import dataclasses
from functools import cached_property

import numpy as np

from ..response.steady import SteadyState
from .marching import Batch, Equations, record_of
from .returns import ended
from .settled import VERDICT, prepare, same_motion, shortest_period, solve_settled
from .stability import attracts


class Judge:
    """The steady states of one train, from marches of its speeds ``(n,)``, on one device or across several; ``known``
    are those at hand, by place, ``apart`` the places where the linear motion separates teeth.

    A march begins with few steps. What harmonic balance confirms is exact whatever the steps. The rest, irregular
    motion above all, is marched on with twice the steps: on ``gear_train_30`` three of sixty speeds had another kind
    of motion with the fewest steps than with any others.
    """

    def __init__(self, train, speeds, request, exact, cycles, devices=()):
        self.devices = devices
        self.train, self.speeds, self.request, self.exact, self.cycles = train, speeds, request, exact, cycles
        self.known, self.apart = {}, set()

    def settle(self, places, motions, progress=lambda count: None):
        """Steady states of some speeds by place, side by side, from motions ``{place: (x, x')}`` or from teeth in
        contact; ``progress`` is told how many more are known."""
        # Of a single speed the program depends on which meshes leave contact, which the march tells.
        known = self.request.many and self.exact and not isinstance(self.equations, str)
        separating = [self.speeds[place] for place in places if known and place in self.apart]
        programs = prepare(self.train, separating, self.request)
        try:
            return self._settled(places, motions, progress)
        finally:
            for program in programs:
                program.cancel()

    def _settled(self, places, motions, progress):
        found, spent, finer = {}, dict.fromkeys(places, 0), 1
        while places:  # with the finest steps no verdict is unsure any more
            unsure = {}
            for group in self._groups(places):
                states, further = self._march(group, motions, spent, finer)
                progress(len(states))
                found |= states
                unsure |= further
            places, motions, finer = list(unsure), unsure, 2 * finer
        return found

    @cached_property
    def equations(self):
        """The Equations of the train, or the sentence that refuses it."""
        try:
            return Equations(self.train)
        except ValueError as refusal:
            return str(refusal)

    def _groups(self, places):
        """Places of speeds that take the same steps."""
        if isinstance(self.equations, str):
            return [places]
        groups = {}
        for place in places:
            groups.setdefault(self.equations.steps(self.speeds[place]), []).append(place)
        return list(groups.values())

    def _march(self, places, motions, spent, finer):
        """Steady states of speeds that share steps, and motions of those that need shorter steps.

        ``spent``: cycles marched before, by place, to which these are added; ``finer``: times the fewest steps.
        """
        equations = self.equations
        if isinstance(equations, str):
            return {place: unknown(self.train, self.speeds[place], equations) for place in places}, {}
        steps = finer * equations.steps(self.speeds[places].min())
        batch = Batch(equations, self.speeds[places], steps, self.devices)
        for i, place in enumerate(places):
            if place in motions:
                batch.begin(i, motions[place])
        found, further, cycles = {}, {}, self._cycles(batch, min(spent[place] for place in places), finer)
        while len(found) + len(further) < len(places):
            over = ended(batch, cycles, verified=self.exact)
            if not self.exact:
                _record(batch, over)
            for march, period in over:
                place = places[march.place]
                verdict = _Verdict(self, place, batch, march, spent[place], finer)
                state = verdict.state(period)
                march.done = state is not None or verdict.unsure
                if state is not None:
                    found[place] = state
                elif verdict.unsure:
                    further[place] = batch.motion(march)
                    spent[place] += march.cycles
        return found, further

    def _cycles(self, batch, spent, finer):
        """How long marches of a batch are at most, of which ``spent`` cycles are behind."""
        before = self.cycles.before_record(batch.work)
        if not self.exact:
            return dataclasses.replace(self.cycles, transient=before)
        if finer == 1:
            return dataclasses.replace(self.cycles, transient=before, recorded=0)
        return dataclasses.replace(self.cycles, transient=max(min(before - spent, VERDICT.later), 0))


def _record(batch, over):
    """Record a period of the marches that have one, ``(march, period)``, side by side those with the same."""
    for period in {period for march, period in over if not march.recorded} - {0}:
        batch.run([march for march, own in over if own == period and not march.recorded], True, period)


class _Verdict:
    """What one march says that may have ended; ``unsure`` where shorter steps have to decide."""

    def __init__(self, judge, place, batch, march, spent, finer):
        self.judge, self.place, self.batch, self.march = judge, place, batch, march
        self.finer, self.spent, self.unsure = finer, spent, False
        self.notes, missing = [], batch.equations.missing
        if lossy(judge.train):
            self.notes.append("the march takes loss factors as damping of each mode at its natural frequency")
        if missing:
            share = f"{100 * missing:.2g} %"
            self.notes.append(f"the march leaves out modes that hold {share} of the compliance of a mesh")

    def state(self, period):
        """The steady state; None where the march has to go on, or is not sure."""
        judge, march = self.judge, self.march
        if not march.returns.finite:
            reason = "the march is not finite: check the scene for huge or tiny numbers"
            return unknown(judge.train, judge.speeds[self.place], reason)
        if not period:
            return self._irregular() if self.finer > 1 or not judge.exact else self._further()
        if not judge.exact:
            return self._recorded(period)
        response, period = self._solved(period)
        if response is None:
            return self._unsolved(period)
        stays, stability = self._attracts(response)
        if not stays:
            return self._passed_by()
        apart = any(contact.separated_fraction > 0 for contact in response.contacts().values())
        kind = "subharmonic" if period > 1 else "periodic" if apart else "contact"
        return self._made(kind, period, response=response, stability=stability)

    def _made(self, kind, period, **found):
        cycles, motion = self.spent + self.march.cycles, self.batch.motion(self.march)
        judge = self.judge
        rpm, known = judge.speeds[self.place], {"cycles": cycles, "notes": self.notes, "motion": motion}
        return state_of(judge.train, rpm, kind, period, **known, **found)

    def _further(self):
        self.unsure = True

    def _solved(self, period):
        """Response (None where harmonic balance did not find the motion) and period of a march that returns."""
        judge, batch, march = self.judge, self.batch, self.march
        while True:
            trace, meshes = batch.traced(march, period), batch.equations.meshes
            known = judge.known.get(self.place)
            common = known is not None and known.response is not None and known.period == period
            if common and same_motion(known.response, trace, meshes, judge.train, VERDICT.arrived):
                return known.response, period
            given = {"steps": batch.steps, "meshes": meshes}
            levels = VERDICT.levels if self.finer == VERDICT.finest else 1
            response = solve_settled(judge.train, march, trace, period, judge.request, levels=levels, **given)
            shorter = period if response is None else shortest_period(response, period)
            if shorter == period:
                return response, period
            if march.returns.errors(shorter)[0] > VERDICT.returned:
                return None, period
            period = shorter

    def _attracts(self, response):
        """What :func:`attracts` says of a response, asked once."""
        known = self.judge.known.get(self.place)
        return (True, known.stability) if known is not None and known.response is response else attracts(response)

    def _unsolved(self, period):
        """Where harmonic balance did not find the motion."""
        if self.finer < VERDICT.finest:
            return self._further()
        if self.march.recorded < self.judge.cycles.recorded:
            self.march.again = self.march.cycles + VERDICT.again
            return None
        if not self.march.returns.period(last=True):  # it was only worth the question
            return self._irregular()
        self.notes.append("harmonic balance did not find the motion marched: the numbers are those of recorded cycles")
        return self._recorded(period)

    def _passed_by(self):
        """Where a march came near a motion that repels, which with these steps may attract."""
        if self.finer < VERDICT.finest:
            return self._further()
        if self.march.recorded < self.judge.cycles.recorded or self.march.cycles < self.judge.cycles.most:
            self.march.again = self.judge.cycles.most  # it takes cycles to leave it, and solving again tells nothing
            return None
        return self._irregular()

    def _irregular(self):
        """Motion without a period, read from its record."""
        return self._made("irregular", 0, record=record_of(self.batch.equations, self.march))

    def _recorded(self, period):
        """Motion with a period, read from its record."""
        record = record_of(self.batch.equations, self.march)
        apart = any(contact.separated_fraction > 0 for contact in record.contacts)
        kind = "subharmonic" if period > 1 else "periodic" if apart else "contact"
        return self._made(kind, period, record=record)


def lossy(train):
    """Whether a train has loss factors."""
    return bool(np.any(train.shafts.loss_factor) or np.any(train.dampers.loss_factor))


def state_of(train, rpm, kind, period, *, response=None, record=None, cycles=0, notes=(), motion=None, stability=None):
    """The :class:`SteadyState` of a train at a speed."""
    known = float(rpm), kind, period, response, record, cycles, tuple(notes), motion
    return SteadyState(*known, train.topology, stability)


def unknown(train, rpm, reason):
    """The SteadyState of a motion that is not known."""
    return state_of(train, rpm, "unknown", 0, notes=(reason,))
