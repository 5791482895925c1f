"""The worst phase between engines that drive one train: the largest value of a quantity
over the full circle.

The response of a linear train is linear in its excitation: turned by the angle alpha,
what one engine adds to harmonic n of the cycle is multiplied by exp(-i n alpha / turn).
The responses at two angles give the motions of all phases exactly. So they do at speeds
at which the teeth of a train with backlash stay in contact all round the circle; at the
others its steady states are marched at phases all round the circle, and near the worst.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from jaxhb._jax import Array, refuse_tracers
from jaxhb._shown import brief, ranges
from jaxhb.design.quantities import (
    QUANTITIES,
    Objective,
    judged,
    label,
    objective_faults,
)
from jaxhb.elements.sentences import SceneError, suggestion
from jaxhb.equations import fourier
from jaxhb.linear.forced import forced_response
from jaxhb.results.answers import left_out
from jaxhb.results.response import FIELDS, Response
from jaxhb.results.status import Status
from jaxhb.results.steady import SteadyState
from jaxhb.solutions.planning import meshes_leaving_contact
from jaxhb.steady.steady_state import steady_state
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import refuse_lines
from jaxhb.train.speeds import check_speed
from jaxhb.train.topology import Topology
from jaxhb.train.varying import at_speed

LINEAR_STEPS = 6  # of the parabolas round the worst phase of the scan
STEPS = 4  # of those with backlash, where each is a march
CLOSEST = 1e-4  # share of a step of the scan between two angles that are tried
PHASES = 24  # of the scan of a train that is marched at each
# Phases of the scan of a linear train for each harmonic that the engine excites
PER_HARMONIC = 16
# The same of speeds at which teeth stay in contact
PER_HARMONIC_IN_CONTACT = 4
# Peaks of the scan of a linear train that are refined, the highest and those that come
# near it: the highest of the scan need not be that of the circle
PEAKS = 4
NEAR = 0.99  # share of the highest from which on another may be higher
TIME_SAMPLES = 32  # for each harmonic, of the scan of a linear train
# Motions of a linear train that are read together: their arrays stay in the cache of a
# processor
LANES = 32


@brief
@dataclass(frozen=True)
class WorstPhase:
    """The worst phase of every quantity at every speed; made by :func:`worst_phase`.

    Parameters
    ----------
    name : str, of the phase
    circle : float, deg of its rotor after which all repeats: whole revolutions of one
        engine cycle, however many of these the cycle of the scene holds
    of : tuple of Objective, Q quantities; labels : tuple of str, their names
    rpm : ``(S,)``
    nominal : ``(S, Q)``, with the phase that the train has
    angle, worst : ``(S, Q)`` deg, and the largest value, there; nan where nothing is
        known
    best_angle, best : ``(S, Q)``, the least of the phases of the scan
    angles, values : ``(P,)`` deg and ``(S, Q, P)``, the scan; of linear motions
    extremes are read from 32 time samples for each harmonic there
    left_out : tuple of str, a sentence for each reason why speeds have no answer, or
        none at some phases
    """

    name: str
    circle: float
    of: tuple[Objective, ...]
    rpm: np.ndarray
    nominal: np.ndarray
    angle: np.ndarray
    worst: np.ndarray
    best_angle: np.ndarray
    best: np.ndarray
    angles: np.ndarray
    values: np.ndarray
    left_out: tuple[str, ...] = ()

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the quantities: ``"shaft torque of line"``."""
        return tuple(map(label, self.of))


def worst_phase(
    train: DriveTrain,
    name: str,
    *,
    rpm: Sequence[float] | Array,
    of: Sequence[Objective] = (),
    phases: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> WorstPhase:
    """Search the phase at which each quantity is largest, over the full circle of the
    rotor of a ``[[phase]]``.

    Of a linear train exactly, at every speed, and so where the teeth of a train with
    backlash stay in contact at every phase. At other speeds, and where links vary with
    their amplitude, a scan of the circle by :func:`jaxhb.steady_state`, without
    ``exact``, so that numbers are good to about 1 %; round the worst phase of each
    quantity, at the speed at which it is largest, by parabolas. What is narrower than a
    step of the scan may be missed. :class:`SceneError` of unknown names.

    Parameters
    ----------
    train : DriveTrain, concrete
    name : str
        Of the ``[[phase]]``.
    rpm : sequence of float ``(S,)``
    of : sequence of :class:`jaxhb.design.Objective`, optional
        Default: tooth force of every mesh, torque of every shaft and damper.
    phases : int, optional
        How many of the circle are scanned; default 24, of linear trains 16 for each
        harmonic, and 4 where teeth stay in contact at every speed.
    progress : callable, optional
        Told what is done.

    Examples
    --------
    Two equal engines excite one disk: in phase they add.

    >>> parts = [jaxhb.Disk(name=n, inertia=1.0) for n in "ab"] + [
    ...     jaxhb.Shaft(between=("a", "b"), stiffness=1e4)
    ... ]
    >>> parts += [
    ...     jaxhb.Torque(name=n, disk="a", harmonics=[(2.0, 10.0, 0.0)])
    ...     for n in ("port", "starboard")
    ... ]
    >>> parts += [jaxhb.Phase(name="turn", of=["port"], angle=45.0)]
    >>> found = worst_phase(
    ...     jaxhb.build(parts, revolutions_per_cycle=1), "turn", rpm=[100.0]
    ... )
    >>> (
    ...     float(found.circle),
    ...     [
    ...         round(float(x), 6)
    ...         for x in (found.nominal[0, 0] / found.worst[0, 0], found.best[0, 0])
    ...     ],
    ... )
    (360.0, [0.707107, 0.0])
    """
    refuse_tracers(
        "worst_phase",
        train,
        rpm,
        instead="differentiate jaxhb.forced_response or jaxhb.solve",
    )
    topology = train.topology
    refuse_lines(topology)
    check_speed(train, rpm, many=True)
    if name not in topology.phase_names:
        remedy = (
            suggestion(name, topology.phase_names)
            if topology.phase_names
            else " The scene has no [[phase]]."
        )
        raise SceneError(f"{topology.title}: there is no phase {name!r}.{remedy}")
    rpm = np.asarray(rpm, dtype=float)
    default_quantities = [
        Objective(quantity="tooth force", of=mesh) for mesh in topology.mesh_names
    ]
    default_quantities += [
        Objective(quantity="shaft torque", of=link)
        for link in topology.shaft_and_damper_names
    ]
    quantities = tuple(of) or tuple(default_quantities)
    faults = [
        f"{topology.title}, {label(quantity)}: {sentence}"
        for quantity in quantities
        for sentence in objective_faults(train, quantity, 1)
    ]
    if faults:
        raise SceneError(faults)
    circle = _circle(topology, name)
    linear = _linear_speeds(train, name, rpm)
    places = np.flatnonzero(linear)
    marched_places = np.flatnonzero(~linear)
    parts: list[tuple[np.ndarray, _Found]] = []
    left: list[str] = []
    count = phases or PHASES
    least = np.full(len(quantities), -np.inf)
    if len(places):
        reader = _Linear.of(train, name, rpm[places])
        finest = PER_HARMONIC_IN_CONTACT if topology.has_law.any() else PER_HARMONIC
        fine = math.ceil(finest * reader.highest * circle / (360.0 * reader.turn))
        fine_count = phases or max(PHASES, fine)
        if not phases and len(marched_places):
            # Every so many of its phases are those of the speeds that are marched.
            fine_count = -(-fine_count // PHASES) * PHASES
        count = count if len(marched_places) else fine_count
        found = reader.found(quantities, circle, fine_count, every=fine_count // count)
        parts.append((places, found))
        left += reader.left_out()
        least = np.max(np.nan_to_num(found.worst, nan=-np.inf), axis=0)
    if len(marched_places):
        marched = _Marched(train, name, rpm[marched_places])
        found = marched.found(quantities, circle, count, least, progress)
        parts.append((marched_places, found))
        left += marched.left_out()
    order = np.argsort(np.concatenate([part for part, _ in parts]))

    def joined(field_name: str) -> np.ndarray:
        return np.concatenate([getattr(found, field_name) for _, found in parts])[order]

    return WorstPhase(
        name=name,
        circle=circle,
        of=quantities,
        rpm=rpm,
        nominal=joined("nominal"),
        angle=joined("angle"),
        worst=joined("worst"),
        best_angle=joined("best_angle"),
        best=joined("best"),
        angles=np.arange(count) * (circle / count),
        values=joined("values"),
        left_out=tuple(left),
    )


@dataclass(frozen=True)
class _Found:
    """Phases of some speeds: fields as of :class:`WorstPhase`."""

    nominal: np.ndarray
    angle: np.ndarray
    worst: np.ndarray
    best_angle: np.ndarray
    best: np.ndarray
    values: np.ndarray


def _linear_speeds(train: DriveTrain, name: str, rpm: np.ndarray) -> np.ndarray:
    """Whether a train has the linear motion at every phase ``(S,)``: it is linear, or
    its teeth stay in contact all round the circle.
    """
    topology = train.topology
    if topology.amplitude_links:
        return np.zeros(len(rpm), dtype=bool)
    if not topology.has_law.any():
        return np.ones(len(rpm), dtype=bool)
    if not topology.linear_in_contact:
        return np.zeros(len(rpm), dtype=bool)
    return _Linear.of(train, name, rpm).in_contact(_circle(topology, name))


def _circle(topology: Topology, name: str) -> float:
    """Whole revolutions, in deg, of the rotor of a phase after which all that it turns
    repeats.
    """
    place = topology.phase_names.index(name)
    turn = topology.phase_turn[place]
    members = zip(topology.excitations, topology.phase_members[place], strict=True)
    rows = [seats.listed()[i] for seats, turned in members for i in turned]
    harmonics = [n for row in rows for n in row]
    # An angle alpha turns harmonic n of the cycle by n alpha / turn.
    common = math.gcd(*harmonics) or 1
    revolutions = Fraction(turn / common).limit_denominator(1000).numerator
    return 360.0 * min(float(revolutions), turn)


@dataclass(frozen=True)
class _Linear:
    """Motions of a linear train, or of one in contact, at phases ``(k,)`` deg, one for
    each of the speeds at ``places`` ``(k,)``: one response and the part of it that the
    phase turns.

    start : deg of the response; turn : turns of the reference rotor in which the phase
    turns once; highest : harmonic that it turns; read_parts : parts of the motion that
    a quantity is read from, as far as they were asked for
    """

    train: DriveTrain
    response: Response
    turned: dict[str, np.ndarray]
    start: float
    turn: float
    highest: int
    read_parts: dict[Objective, tuple[str, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, train: DriveTrain, name: str, rpm: np.ndarray) -> _Linear:
        """Solve a train with its phase ``name`` as it is and at another angle."""
        topology = train.topology
        turn = topology.phase_turn[topology.phase_names.index(name)]
        key = f"{name}.angle"
        start = float(train.value(key))
        response = forced_response(train, rpm=rpm)
        harmonics = response.angles.shape[-1] - 1
        # By this angle no harmonic is turned by whole turns.
        step = 360.0 * turn / (harmonics + 1)
        other = forced_response(train.replace({key: start + step}), rpm=rpm)
        by_step = np.expm1(_by_deg(np.asarray(response.angles), turn) * step)
        by_step[0] = 1.0  # the mean is not turned
        turned = {
            part: (getattr(other, part) - getattr(response, part)) / by_step
            for part in FIELDS
        }
        solved = np.asarray(response.solved)
        torques = np.abs(turned["torques"][solved]).max((0, 1), initial=0.0)
        angles = np.abs(turned["angles"][solved]).max((0, 1), initial=0.0)
        sizes = torques + angles * (torques.max() or 1.0)
        highest = int(np.flatnonzero(sizes > 1e-9 * sizes.max()).max(initial=1))
        return cls(train, response, turned, start, turn, highest)

    def part(self, name: str, angle: np.ndarray, places: np.ndarray) -> np.ndarray:
        """A part of the motions, one of FIELDS, at phases ``(k,)`` deg and the speeds
        at ``places`` ``(k,)``.
        """
        turned = self.turned[name][places]
        by_deg = _by_deg(turned, self.turn)
        factor = np.expm1(by_deg * (angle - self.start)[:, None])[:, None]
        return getattr(self.response, name)[places] + turned * factor

    def __call__(
        self, angle: np.ndarray, quantities: Sequence[Objective], places: np.ndarray
    ) -> np.ndarray:
        parts = {name for quantity in quantities for name in self._parts_of(quantity)}
        response = self.response
        # Parts that are not read are as large, and none of their numbers is copied.
        changes: dict[str, Any] = {
            name: self.part(name, angle, places)
            if name in parts
            else np.broadcast_to(
                getattr(response, name)[0],
                (len(places), *getattr(response, name).shape[1:]),
            )
            for name in FIELDS
        }
        nothing: dict[str, Any] = dict.fromkeys(FIELDS, response.rpm)
        bare = dataclasses.replace(response, **nothing)
        motion = dataclasses.replace(bare[places], **changes)
        return _read(motion, quantities, self.train)

    def _parts_of(self, quantity: Objective) -> tuple[str, ...]:
        """The parts of a motion that a quantity is read from."""
        if quantity not in self.read_parts:
            first = self.response[:1]
            unknown = {
                name: dataclasses.replace(
                    first, **{name: np.full_like(getattr(first, name), np.nan)}
                )
                for name in FIELDS
            }
            self.read_parts[quantity] = tuple(
                name
                for name, motion in unknown.items()
                if not np.isfinite(_value(motion, quantity, self.train)).all()
            )
        return self.read_parts[quantity]

    def in_contact(self, circle: float) -> np.ndarray:
        """Whether all teeth of a train with backlash stay in contact ``(S,)``, at
        phases round the whole circle.
        """
        train = self.train
        harmonics = self.response.angles.shape[-1] - 1
        samples = fourier.SAMPLES_PER_HARMONIC * (harmonics + 1)
        count = math.ceil(PER_HARMONIC * self.highest * circle / (360.0 * self.turn))
        angles = np.arange(count) * (circle / count)
        stays = np.asarray(self.response.solved).copy()
        for i in np.flatnonzero(stays):
            rpm = float(self.response.rpm[i])
            fixed = at_speed(train, rpm) if train.topology.depends_on_speed else train
            for chunk in np.array_split(angles, -(-count // LANES)):
                elastic = self.part("elastic_forces", chunk, np.full(len(chunk), i))
                forces = fourier.synthesize(elastic, samples)
                _, leaves, _ = meshes_leaving_contact(fixed, forces)
                stays[i] &= not leaves.any()
                if not stays[i]:
                    break
        return stays

    def found(
        self,
        quantities: Sequence[Objective],
        circle: float,
        count: int,
        every: int,
    ) -> _Found:
        """The worst of ``count`` phases round the circle, and of all between them;
        ``every`` so many of them are told.
        """
        angles = np.arange(count) * (circle / count)
        speeds = np.arange(len(self.response.rpm))
        harmonics = self.response.angles.shape[-1] - 1
        coarse = dataclasses.replace(
            self,
            response=dataclasses.replace(
                self.response, resolution=TIME_SAMPLES * (harmonics + 1)
            ),
        )
        lane_angle = np.repeat(angles, len(speeds))
        lane_place = np.tile(speeds, count)
        chunks = np.array_split(
            np.arange(len(lane_angle)), -(-len(lane_angle) // LANES)
        )
        scanned = np.concatenate(
            [coarse(lane_angle[c], quantities, lane_place[c]) for c in chunks]
        )
        # (S, Q, P)
        values = np.moveaxis(scanned.reshape(count, len(speeds), -1), 0, -1)
        own_angle = np.full(len(speeds), self.start)
        nominal = self(own_angle, quantities, speeds)
        is_known = np.isfinite(values)
        ranked = np.where(is_known, values, -np.inf)
        peak = (ranked >= np.roll(ranked, 1, -1)) & (ranked >= np.roll(ranked, -1, -1))
        peak_values = np.where(peak, ranked, -np.inf)
        tops = np.argsort(-peak_values, axis=-1, kind="stable")[..., :PEAKS]
        best = np.where(is_known, values, np.inf).argmin(-1)
        worst_angle = angles[tops[..., 0]]
        worst = np.full(nominal.shape, np.nan)
        least = np.full(nominal.shape, np.nan)
        for q, quantity in enumerate(quantities):
            read = partial(self, quantities=(quantity,))
            highest = ranked[:, q].max(-1)
            known = np.isfinite(highest)
            near = np.take_along_axis(ranked[:, q], tops[:, q], -1) >= (
                NEAR * highest[:, None]
            )
            places, tried = np.nonzero(near & known[:, None])
            if not len(places):
                continue
            peak_angle, peak_value = _refined(
                partial(read, places=places),
                angles[tops[places, q, tried]],
                width=circle / count,
                steps=LINEAR_STEPS,
            )
            for place in np.flatnonzero(known):
                of_place = np.flatnonzero(places == place)
                top = of_place[np.argmax(peak_value[of_place])]
                worst[place, q] = peak_value[top]
                worst_angle[place, q] = peak_angle[top] % circle
            shown = np.flatnonzero(known)
            least[shown, q] = read(angles[best[shown, q]], places=shown)[:, 0]
        return _Found(
            nominal=nominal,
            angle=worst_angle,
            worst=worst,
            best_angle=angles[best],
            best=least,
            values=values[..., ::every],
        )

    def left_out(self) -> list[str]:
        """Sentences for each status of speeds without an answer."""
        return left_out(
            self.response.rpm, self.response.status, self.train.topology.title
        )


def _by_deg(values: np.ndarray, turn: float) -> np.ndarray:
    """Derivative by the phase in deg of the part that it turns, over the harmonics of
    ``values``, as a share of itself.
    """
    return -1j * np.deg2rad(np.arange(values.shape[-1])) / turn


def _value(motion: Response, quantity: Objective, train: DriveTrain) -> np.ndarray:
    """A quantity ``(S,)`` of motions."""
    return np.asarray(
        QUANTITIES[quantity.quantity].exact_value(
            motion, quantity.of, quantity.order, train
        )
    )


def _read(
    motion: Response, quantities: Sequence[Objective], train: DriveTrain
) -> np.ndarray:
    """Read quantities ``(S, Q)`` for people, nan where they are not converged or a rule
    has no limit.
    """
    columns = []
    for quantity in quantities:
        values = _value(motion, quantity, train)
        has_value = np.asarray(motion.converged) & judged(train, quantity, motion.rpm)
        columns.append(np.where(has_value, values, np.nan))
    return np.stack(columns, axis=-1)


@dataclass(frozen=True)
class _Marched:
    """Values ``(k, Q)`` of the steady states of a train, marched anew for every phase
    ``(k,)`` deg, at the speeds at ``places`` ``(k,)``; the phases of all are mostly
    one.

    states : by speed and phase, as searches for several quantities meet; unread :
    speeds in rpm by sentences that say why a number is missing at some phases
    """

    train: DriveTrain
    name: str
    rpm: np.ndarray
    states: dict[tuple[int, float], SteadyState] = field(default_factory=dict)
    unread: dict[str, set[float]] = field(default_factory=dict)

    def __call__(
        self, angle: np.ndarray, quantities: Sequence[Objective], places: np.ndarray
    ) -> np.ndarray:
        values = np.full((len(places), len(quantities)), np.nan)
        for phase in np.unique(angle):
            rows = np.flatnonzero(angle == phase)
            design = self.train.replace({f"{self.name}.angle": float(phase)})
            self._march(design, float(phase), places[rows])
            for row in rows:
                state = self.states[int(places[row]), float(phase)]
                values[row] = [self._value(state, q, design) for q in quantities]
        return values

    def _march(self, design: DriveTrain, phase: float, places: np.ndarray) -> None:
        """Compute the steady states of the train of a phase at the speeds at which they
        are not known yet.
        """
        fresh = [int(place) for place in places if (place, phase) not in self.states]
        if not fresh:
            return
        sweep = steady_state(design, rpm=self.rpm[fresh], exact=False)
        for place, state in zip(fresh, sweep.states, strict=True):
            self.states[place, phase] = state

    def _value(
        self, state: SteadyState, quantity: Objective, design: DriveTrain
    ) -> float:
        """A quantity of a state for people, nan where it has none."""
        if not judged(design, quantity, np.array([state.rpm])).all():
            return np.nan
        response = state.response
        if not state.known or not (response is None or response.converged):
            status = "" if response is None else Status(int(response.status)).sentence
            why = "; ".join([*state.notes, *filter(None, [status])])
            self._leave_out(f"the motion is unknown: {why}", state.rpm)
            return np.nan
        measure = QUANTITIES[quantity.quantity]
        value = measure.of_state(state, quantity.of, quantity.order, design)
        if np.isnan(value):
            why = f"recorded cycles do not tell the {quantity.quantity}"
            self._leave_out(why, state.rpm)
        return value

    def _leave_out(self, why: str, rpm: float) -> None:
        """Note why a number is missing at a speed."""
        self.unread.setdefault(why, set()).add(rpm)

    def found(
        self,
        quantities: Sequence[Objective],
        circle: float,
        count: int,
        least: np.ndarray,
        progress: Callable[[str], None] | None,
    ) -> _Found:
        """The worst of ``count`` phases round the circle and, at the speed at which a
        quantity is largest and above ``least`` ``(Q,)``, of those round it.
        """
        angles = np.arange(count) * (circle / count)
        speeds = np.arange(len(self.rpm))
        values = np.empty((len(speeds), len(quantities), count))
        for k, angle in enumerate(angles):
            if progress:
                progress(f"phase {angle:g} of {circle:g} deg")
            values[..., k] = self(np.full(len(speeds), angle), quantities, speeds)
        own_angle = float(self.train.value(f"{self.name}.angle"))
        nominal = self(np.full(len(speeds), own_angle), quantities, speeds)
        is_known = np.isfinite(values)
        best = np.where(is_known, values, np.inf).argmin(-1)
        top = np.where(is_known, values, -np.inf).argmax(-1)
        worst_angle = angles[top]
        worst = np.take_along_axis(values, top[..., None], -1)[..., 0]
        for q, quantity in enumerate(quantities):
            largest = np.nan_to_num(worst[:, q], nan=-np.inf)
            place = np.atleast_1d(largest.argmax())
            if not largest[place] > least[q]:
                continue
            peak_angle, peak_value = _refined(
                partial(self, quantities=(quantity,), places=place),
                angles[top[place, q]],
                width=circle / count,
                steps=STEPS,
            )
            if peak_value > worst[place, q]:
                worst_angle[place, q] = peak_angle % circle
                worst[place, q] = peak_value
        return _Found(
            nominal=nominal,
            angle=worst_angle,
            worst=worst,
            best_angle=angles[best],
            best=np.take_along_axis(values, best[..., None], -1)[..., 0],
            values=values,
        )

    def left_out(self) -> list[str]:
        """Sentences for the speeds at which numbers are missing at some phases."""
        title = self.train.topology.title
        return [
            f"{title}, at some phases, at {ranges(self.rpm.tolist(), sorted(rpm))} rpm:"
            f" {why}."
            for why, rpm in self.unread.items()
        ]


def _refined(
    value: Callable[..., np.ndarray],
    middle: np.ndarray,
    *,
    width: float,
    steps: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Find the largest value ``(k, 1)`` of a function of angles ``(k,)`` within
    ``width`` of each, by parabolas through the best angle and those beside it: the
    angles and the values ``(k,)``.

    Extremes over the cycle are upper envelopes of smooth functions of the phase, whose
    maxima are smooth, so that the parabolas converge.
    """

    def value_at(angle: np.ndarray) -> np.ndarray:
        return np.nan_to_num(value(angle)[:, 0], nan=-np.inf)

    angles = middle + width * np.array([[-1.0], [0.0], [1.0]])
    values = np.stack([value_at(angle) for angle in angles])
    for _ in range(steps):
        fresh = _between(angles, values, CLOSEST * width)
        angles = np.vstack([angles, fresh])
        values = np.vstack([values, value_at(fresh)])
        order = np.argsort(angles, axis=0)
        values = np.take_along_axis(values, order, 0)
        angles = np.take_along_axis(angles, order, 0)
        # The best of the four and those beside it
        kept = np.clip(values.argmax(0) - 1, 0, 1) + np.arange(3)[:, None]
        values = np.take_along_axis(values, kept, 0)
        angles = np.take_along_axis(angles, kept, 0)
    best = values.argmax(0)[None]
    largest = np.take_along_axis(values, best, 0)[0]
    return np.take_along_axis(angles, best, 0)[0], largest


def _between(angles: np.ndarray, values: np.ndarray, closest: float) -> np.ndarray:
    """The next angle ``(k,)`` to try, between three ``(3, k)`` in order: the top of the
    parabola through their ``values`` where the middle one is best, not nearer to it
    than ``closest``; else halfway from the best to the middle one.
    """
    low, middle, high = angles
    below = middle - low
    above = high - middle
    with np.errstate(invalid="ignore", divide="ignore"):
        rise = values[1] - values[0]
        fall = values[1] - values[2]
        shift = 0.5 * (above**2 * rise - below**2 * fall)
        shift = shift / (below * fall + above * rise)
    wider = np.where(above > below, 1.0, -1.0)
    small = ~(np.abs(shift) > closest)
    shift = np.where(small, wider * closest, shift)
    top = np.clip(middle + shift, low + closest, high - closest)
    best = values.argmax(0)
    halfway = (middle + np.where(best == 0, low, high)) / 2
    return np.where(best == 1, top, halfway)
