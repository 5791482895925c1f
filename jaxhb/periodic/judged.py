"""What marches show: harmonic balance of a motion that returns, a record of one that does not, and what kind it is."""

import dataclasses
import os
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import contextmanager
from contextvars import copy_context
from functools import cached_property

import jax
import numpy as np

from ..response.steady import SteadyState
from .marching import BATCHES, Batch, Equations, record_of
from .returns import ended
from .settled import VERDICT, prepare, same_motion, shortest_period, solve_settled
from .stability import attracts

SIDE_BY_SIDE = BATCHES[1][1]
"""Marches from which several are one program: fewer wait for no other."""

MOST_THREADS = 8
"""In which marches and verdicts run: each holds some memory, and solves take what they need of it."""


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
        programs = []
        # Of a single speed the program depends on which meshes leave contact, which the march tells.
        if self.request.many and self.exact and not isinstance(self.equations, str):
            programs = prepare(self.train, {self.speeds[place]: place in self.apart for place in places}, self.request)
        try:
            return self._settled(places, motions, progress)
        finally:
            for program in programs:
                program.cancel()

    def _settled(self, places, motions, progress):
        if isinstance(self.equations, str):
            progress(len(places))
            return {place: unknown(self.train, self.speeds[place], self.equations) for place in places}
        with _side_by_side(self.devices) as ask:
            groups = [self._until_sure(group, motions, progress, ask) for group in self._groups(places)]
            return {place: state for found in _driven(groups) for place, state in found.items()}

    def _until_sure(self, places, motions, progress, ask):
        """Steady states of speeds that share steps, for :func:`_driven`."""
        found, spent, finer = {}, dict.fromkeys(places, 0), 1
        while places:  # with the finest steps no verdict is unsure any more
            rounds = _Rounds(self, places, motions, spent, finer, progress, ask)
            yield from rounds.of(rounds.batch.marches)
            found |= rounds.found
            motions = rounds.further
            places, finer = [place for place in places if place in motions], 2 * finer
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
        groups = {}
        for place in places:
            groups.setdefault(self.equations.steps(self.speeds[place]), []).append(place)
        return list(groups.values())

    def _cycles(self, batch, spent, finer):
        """How long marches of a batch are at most, of which ``spent`` cycles are behind."""
        before = self.cycles.before_record(batch.work)
        if not self.exact:
            return dataclasses.replace(self.cycles, transient=before)
        if finer == 1:
            return dataclasses.replace(self.cycles, transient=before, recorded=0)
        return dataclasses.replace(self.cycles, transient=max(min(before - spent, VERDICT.later), 0))


class _Rounds:
    """Marches of speeds that share steps, round by round: steady states ``found``, and motions of those that need
    ``further``, shorter steps, by place.

    ``spent``: cycles marched before, by place, to which these are added; ``finer``: times the fewest steps; ``ask``
    begins a function in another thread and gives its Future.
    """

    def __init__(self, judge, places, motions, spent, finer, progress, ask):
        self.judge, self.places, self.spent, self.finer = judge, places, spent, finer
        self.progress, self.ask, self.found, self.further = progress, ask, {}, {}
        speeds = judge.speeds[places]
        self.batch = Batch(judge.equations, speeds, finer * judge.equations.steps(speeds.min()), judge.devices)
        for i, place in enumerate(places):
            if place in motions:
                self.batch.begin(i, motions[place])
        self.cycles = judge._cycles(self.batch, min(spent[place] for place in places), finer)

    def of(self, marches, asked=()):
        """Take marches to their ends, for :func:`_driven`; ``asked``: verdicts on their way, ``(march, verdict,
        Future)``.

        A verdict takes as long as many cycles: marches wait for theirs while the others go on. Which go on side by side
        does not depend on how long a verdict takes, so that the same call gives the same bits.
        """
        while True:
            marches = [march for march in marches if not march.done]
            if 1 < len(marches) < SIDE_BY_SIDE and len(self.judge.devices) < 2:
                yield [self.of([march], [one for one in asked if one[0] is march]) for march in marches]
                return
            if not marches:
                return
            waiting = [march for march, _, _ in asked]
            going = [march for march in marches if not any(march is other for other in waiting)]
            over = self.ask(ended, self.batch, going, self.cycles, self.judge.exact) if going else None
            for march, verdict, answer in asked:
                self._settle(march, verdict, (yield answer))
            over = (yield over) if going else []
            if not self.judge.exact:
                yield self.ask(_record, self.batch, over)
            asked = [self._question(march, period) for march, period in over]

    def _question(self, march, period):
        place = self.places[march.place]
        verdict = _Verdict(self.judge, place, self.batch, march, self.spent[place], self.finer)
        return march, verdict, self.ask(verdict.state, period)

    def _settle(self, march, verdict, state):
        place = self.places[march.place]
        march.done = state is not None or verdict.unsure
        if state is not None:
            self.found[place] = state
            self.progress(1)
        elif verdict.unsure:
            self.further[place] = self.batch.motion(march)
            self.spent[place] += march.cycles


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


@contextmanager
def _side_by_side(devices):
    """What begins a function in one of some threads, and gives its Future. Across several devices one at a time."""
    # More threads than processors: some wait for programs that others make.
    threads = ThreadPoolExecutor(min(2 * (os.cpu_count() or 1), MOST_THREADS) if len(devices) < 2 else 1, "jaxhb-judge")
    device = jax.config.jax_default_device

    def run(context, function, *args):
        with jax.default_device(device):
            return context.run(function, *args)

    try:
        yield lambda function, *args: threads.submit(run, copy_context(), function, *args)
    finally:
        threads.shutdown(cancel_futures=True)


def _driven(generators):
    """What generators return, side by side: each yields a Future, and is sent its result as soon as it is there, or a
    list of generators, and goes on when these have returned."""
    returned, waiting, left = {}, {}, {}

    def go_on(generator, parent, result=None):
        try:
            wanted = generator.send(result)
        except StopIteration as end:
            returned[generator] = end.value
            if parent is not None:
                left[parent[0]] -= 1
                if not left[parent[0]]:
                    go_on(*parent)
            return
        if isinstance(wanted, list):
            left[generator] = len(wanted)
            for one in wanted:
                go_on(one, (generator, parent))
        else:
            waiting.setdefault(wanted, []).append((generator, parent))

    for generator in generators:
        go_on(generator, None)
    while waiting:
        for future in wait(waiting, return_when=FIRST_COMPLETED).done:
            for generator, parent in waiting.pop(future):
                go_on(generator, parent, future.result())
    return [returned[generator] for generator in generators]
