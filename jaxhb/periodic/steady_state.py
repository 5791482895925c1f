"""What a train does after it has run long enough: contact, a period of one or several cycles, or none."""

import numpy as np

from .._arrays import staged, traced
from ..harmonic import fourier
from ..model.elements import SceneError
from ..model.speeds import check_speed
from ..response.response import Response
from ..response.status import Status
from ..response.steady import SteadyState, SteadySweep
from .marching import Batch, Equations, record_of
from .planned import solve_batches
from .planning import plan_speeds
from .request import Request
from .returns import Cycles, ended
from .settled import same_motion, shortest_period, solve_settled
from .stability import attracts

DIRECTIONS = "up", "down", "both"

AGAIN = 32
"""Cycles that a march goes on where harmonic balance did not find its motion."""

RETURNED = 5e-3
"""Return error below which a motion may have the shorter period that its solution has."""

AGREES = 0.02
"""Difference of deflections, relative to the largest and the gap, up to which a march arrives at a motion known from
another start."""

LEVEL = 0.1
"""Difference of the largest deflections of neighbouring speeds from which the one may have another motion when it
starts from the other."""


def steady_state(
    train,
    *,
    rpm,
    direction="up",
    start=None,
    harmonics=None,
    tolerance=None,
    exact=True,
    cycles=None,
    progress=None,
):
    """What a drive train does at each speed after it has run long enough.

    Teeth that stay in contact are known from the linear motion. Otherwise the train is marched through cycles of the
    excitation until its motion returns after 1 to 8 of them; harmonic balance of so many cycles, from there, gives the
    exact motion. Where it does not return, the numbers are those of a record of at least 64 cycles.

    Parameters
    ----------
    train : DriveTrain
        Loss factors become viscous damping in the march, at the main frequency of the tooth deflections; a note tells.
    rpm : float or array ``(n,)``
        Speeds of the reference rotor.
    direction : "up", "down" or "both"
        Each of several speeds is reached from its neighbour below, or above: where several motions are possible that
        decides which one the train has.
    start : SteadyState or Response, optional
        Motion from which the first speed starts; by default teeth rest on their drive sides.
    harmonics, tolerance : optional
        Of periodic motions, per cycle of the excitation, as in :func:`jaxhb.solve`.
    exact : bool
        Whether periodic and subharmonic motions are solved by harmonic balance. Without, they too are read from
        recorded cycles, good to about 1 %, in a fraction of the time.
    cycles : Cycles, optional
        How long a march is at most.
    progress : callable, optional
        Called with the number of speeds done since the last call.

    Returns
    -------
    SteadyState, or SteadySweep for an array of speeds, or for "both" a pair of them, upwards and downwards

    Raises
    ------
    SceneError
        A speed that is not positive.
    ValueError
        An unknown direction.
    TypeError
        Under ``jit``, ``vmap`` or ``grad``.

    Notes
    -----
    The march is exponential integration around the linear train, five steps per period of the highest mesh mode or
    more; kinds and records are those of its steps. Two motions with nearly the same deflections are not told apart in
    a sweep, and a transient that outlasts the march counts as irregular.

    Examples
    --------
    >>> import jaxhb
    >>> s = jaxhb.steady_state(jaxhb.load_scene("gear_train_30"), rpm=1200.0)
    >>> s.kind, s.period
    ('contact', 1)
    """
    if traced(train, rpm) or staged():
        raise TypeError(
            "steady_state decides by value and cannot be traced: call it outside, and differentiate "
            "jaxhb.solve(train, rpm=..., plan=..., start=its response)"
        )
    if direction not in DIRECTIONS:
        raise ValueError(f"direction is {direction!r}: give 'up', 'down' or 'both'")
    check_speed(train, rpm, many=True)
    speeds = np.atleast_1d(np.asarray(rpm, dtype=float))
    request = Request.of(train, harmonics, tolerance, many=len(speeds) > 1)
    search = _Search(train, speeds, request, exact, cycles or Cycles(), start, progress)
    if not np.ndim(rpm):
        return search.alone(0)
    order = np.argsort(speeds, kind="stable")
    found = {}
    for way in ("up", "down") if direction == "both" else (direction,):
        states = search.along(order if way == "up" else order[::-1])
        found[way] = SteadySweep(tuple(states[place] for place in range(len(speeds))), way)
    return (found["up"], found["down"]) if direction == "both" else found[direction]


class _Search:
    """One call: a train, its speeds, and what is known of them."""

    def __init__(self, train, speeds, request, exact, cycles, start, progress):
        self.train, self.speeds, self.request, self.exact, self.cycles = train, speeds, request, exact, cycles
        self.progress = progress or (lambda count: None)
        self.lossy = bool(np.any(train.shafts.loss_factor) or np.any(train.dampers.loss_factor))
        self.start = None if start is None else _motion_of(train, start)
        self.contact = self._in_contact()
        self.equations = {}
        self.known = {}

    def _in_contact(self):
        """Responses of the speeds at which the linear motion holds the teeth in contact, by place."""
        plans, found = plan_speeds(self.train, self.speeds, self.request), {}
        for shared in {plan for plan in plans if not plan.active}:
            places = [i for i, plan in enumerate(plans) if plan == shared]
            batches = solve_batches(self.train, self.speeds[places], shared, shared.sizes.max_steps)
            responses = (response for batch in batches for response in batch)
            for place, response in zip(places, responses, strict=True):
                if int(response.status) != Status.PLAN_VIOLATED:
                    found[place] = response
        return found

    def alone(self, place):
        """The steady state of one speed, from the start that was given or from teeth in contact."""
        if place not in self.known:
            self.many([place])
        return self.known[place]

    def many(self, places):
        """Find steady states of some speeds side by side."""
        marching = []
        for place in places:
            if place in self.contact and self.start is None:
                self.known[place] = self._contact(place)
                self.progress(1)
            else:
                marching.append(place)
        for group in self._groups(marching):
            self.known |= self._march(group, {place: self.start for place in group if self.start is not None})
            self.progress(len(group))

    def along(self, order):
        """Steady states by place, each reached from the one before it in ``order``."""
        if self.start is not None:
            self.known[order[0]] = self._from(order[0], self.start)
        first, self.start = self.start, None
        self.many([place for place in range(len(self.speeds)) if place not in self.known])
        self.start = first
        found, before = {}, None
        for place in order:
            state = self.known[place]
            if before is not None and before.motion is not None and self._differs(before, state):
                state = self._from(place, before.motion)
            found[place] = before = state
        return found

    def _differs(self, before, state):
        """Whether a speed may have another motion when it starts from the one before."""
        if before.kind != state.kind or before.period != state.period:
            return True
        if state.kind == "contact":
            return False
        one, other = (_largest_deflections(s) for s in (before, state))
        return bool(np.any(np.abs(one - other) > LEVEL * np.maximum(one, other)))

    def _from(self, place, motion):
        return self._march([place], {place: motion})[place]

    def _groups(self, places):
        """Places of speeds that take the same steps of the same equations."""
        if self.lossy:
            return [[place] for place in places]
        if not places:
            return []
        equations = self._equations(None)
        if isinstance(equations, str):
            return [places]
        groups = {}
        for place in places:
            groups.setdefault(equations.steps(self.speeds[place]), []).append(place)
        return list(groups.values())

    def _equations(self, hz):
        """The Equations with loss factors as damping at ``hz``, or the sentence that refuses them."""
        if hz not in self.equations:
            train = self.train if hz is None else self.train.with_viscous_damping(hz=hz)
            try:
                self.equations[hz] = Equations(train)
            except ValueError as refusal:
                self.equations[hz] = str(refusal)
        return self.equations[hz]

    def _contact(self, place):
        """The steady state of teeth in contact."""
        response = self.contact[place]
        if int(response.status) > Status.TOLERANCE_NOT_MET:
            return self._unknown(place, Status(int(response.status)).sentence)
        return self._state(place, "contact", 1, response=response, motion=_motion_of(self.train, response))

    def _unknown(self, place, reason):
        return self._state(place, "unknown", 0, notes=(reason,))

    def _state(self, place, kind, period, *, response=None, record=None, cycles=0, notes=(), motion=None):
        rpm, topology = float(self.speeds[place]), self.train.topology
        return SteadyState(rpm, kind, period, response, record, cycles, tuple(notes), motion, topology)

    def _march(self, places, motions):
        """Steady states of speeds that share steps and equations, from motions or from teeth in contact."""
        hz = self._main_hz(places[0]) if self.lossy else None
        equations = self._equations(hz)
        if isinstance(equations, str):
            return {place: self._unknown(place, equations) for place in places}
        batch = Batch(equations, self.speeds[places], equations.steps(self.speeds[places].min()))
        for i, place in enumerate(places):
            if place in motions:
                batch.begin(i, motions[place])
        found = {}
        while len(found) < len(places):
            for march, period in ended(batch, self.cycles):
                place = places[march.place]
                state = self._state_of(place, batch, march, period, hz)
                if state is None:
                    march.again = max(march.again, march.cycles + AGAIN)
                else:
                    found[place] = state
                    march.done = True
        return found

    def _main_hz(self, place):
        """Frequency at which viscous damping takes as much from the tooth deflections as loss factors do."""
        rpm = self.speeds[place]
        cycle_hz = self.train.topology.cycle_frequency(rpm) / (2 * np.pi)
        equations = self._equations(float(cycle_hz * 8))
        if isinstance(equations, str):
            return float(cycle_hz * 8)
        batch = Batch(equations, np.array([rpm]), equations.steps(rpm))
        batch.run(batch.marches)
        deflection = np.split(batch.traced(batch.marches[0], 1), 2)[0]
        power = np.abs(fourier.analyze(deflection, deflection.shape[1] // 2 - 1)[:, 1:]) ** 2
        n = np.arange(1, power.shape[1] + 1)
        return float(cycle_hz * (n**2 * power).sum() / (n * power).sum())

    def _state_of(self, place, batch, march, period, hz):
        """The steady state of a march that may have ended; None where it has to go on."""
        notes, missing = [], batch.equations.missing
        if hz is not None:
            notes.append(f"the march takes loss factors as viscous damping at {hz:.4g} Hz")
        if missing:
            notes.append(f"the march leaves out modes that hold {100 * missing:.2g} % of the compliance of a mesh")
        if not march.returns.finite:
            return self._unknown(place, "the march is not finite: check the scene for huge or tiny numbers")
        if not period:
            return self._irregular(place, batch, march, notes)
        if not self.exact:
            return self._recorded(place, batch, march, period, notes)
        response, note, period = self._solved(place, batch, march, period, hz)
        if response is not None and not attracts(response):
            return self._passed_by(place, batch, march, notes)
        kind, notes = "periodic" if period == 1 else "subharmonic", notes + [note] * bool(note)
        common = {"cycles": march.cycles, "motion": batch.motion(march)}
        if response is not None:
            apart = any(contact.separated_fraction > 0 for contact in response.contacts().values())
            kind = kind if apart or period > 1 else "contact"
            return self._state(place, kind, period, response=response, notes=notes, **common)
        if march.recorded < self.cycles.recorded:
            return None
        notes.append("harmonic balance did not find the motion marched: the numbers are those of recorded cycles")
        return self._recorded(place, batch, march, period, notes)

    def _passed_by(self, place, batch, march, notes):
        """The steady state of a march that came near a motion that repels; None where it may still leave it."""
        if march.recorded < self.cycles.recorded or march.cycles < self.cycles.most:
            march.again = self.cycles.most  # it takes cycles to leave it, and solving it again tells nothing
            return None
        return self._irregular(place, batch, march, notes)

    def _irregular(self, place, batch, march, notes):
        """The steady state of a motion without a period, read from its record."""
        record, motion = record_of(batch.equations, march), batch.motion(march)
        return self._state(place, "irregular", 0, record=record, cycles=march.cycles, notes=notes, motion=motion)

    def _recorded(self, place, batch, march, period, notes):
        """The steady state of a motion with a period, read from its record."""
        if not march.recorded:
            batch.record(march, period)
        record = record_of(batch.equations, march)
        apart = any(contact.separated_fraction > 0 for contact in record.contacts)
        kind = "subharmonic" if period > 1 else "periodic" if apart else "contact"
        common = {"cycles": march.cycles, "notes": notes, "motion": batch.motion(march)}
        return self._state(place, kind, period, record=record, **common)

    def _solved(self, place, batch, march, period, hz):
        """Response (None where harmonic balance did not find the motion), note and period of a march that returns."""
        while True:
            trace = batch.traced(march, period)
            known = self.known.get(place)
            common = known is not None and known.response is not None and known.period == period
            if common and same_motion(known.response, trace, batch.equations.meshes, self.train, AGREES):
                return known.response, "", period
            given = {"steps": batch.steps, "meshes": batch.equations.meshes, "hz": hz}
            response, note = solve_settled(self.train, march, trace, period, self.request, **given)
            shorter = period if response is None else shortest_period(response, period)
            if shorter == period:
                return response, note, period
            if march.returns.errors(shorter)[0] > RETURNED:
                return None, "", period
            period = shorter


def _motion_of(train, start):
    """(x, x') ``(2S,)`` at the beginning of a cycle of a SteadyState or Response of the train."""
    motion = start.motion if isinstance(start, SteadyState) else None
    if isinstance(start, Response):
        if np.ndim(start.rpm):
            raise ValueError("start is a sweep: give the response at one speed, sweep[i]")
        from ..harmonic import chain

        radius = np.asarray(chain.assemble(train).radius)[:, None]
        angles = np.asarray(start.angles) * radius
        omega = start.topology.cycle_frequency(float(start.rpm))
        motion = fourier.sample(np.concatenate([angles, fourier.derivative(angles, omega)]), 1)[:, 0]
    if motion is None:
        raise SceneError("start holds no motion: give a Response, or a SteadyState whose kind is known.")
    if len(motion) != 2 * train.topology.n_disks:
        raise SceneError("start is a motion of another train: give one with the same disks.")
    return motion


def _largest_deflections(state):
    """Largest absolute deflection ``(M,)`` of every mesh."""
    return np.array([float(state.deflection(name).peak) for name in state.topology.mesh_names])
