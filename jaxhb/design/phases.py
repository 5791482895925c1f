"""The worst phase between engines that drive one train: the largest value of a quantity
over the full circle.

The response of a linear train is linear in its excitation: turned by the angle alpha,
what one engine adds to harmonic n of the cycle is multiplied by exp(-i n alpha / turn).
One response and its derivative by the angle give the motions of all phases exactly.
Trains with backlash are solved at phases all round the circle, and near the worst.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial

import jax
import numpy as np

from jaxhb._jax import Array, Number, on_host, refuse_tracers
from jaxhb._shown import brief
from jaxhb.design.quantities import (
    QUANTITIES,
    Objective,
    judged,
    label,
    objective_faults,
)
from jaxhb.elements.sentences import SceneError, suggestion
from jaxhb.linear.forced import forced_response
from jaxhb.results.answers import left_out
from jaxhb.results.response import FIELDS, Response
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import refuse_lines
from jaxhb.train.speeds import check_speed
from jaxhb.train.topology import Topology

LINEAR_STEPS = 40  # of the golden section round the worst phase of the scan
STEPS = 8  # of that with backlash, where each is a solve
GOLDEN = (5**0.5 - 1) / 2
PHASES = 24  # of the scan of a train that is solved at each
# Phases of the scan of a linear train for each harmonic that the engine excites
PER_HARMONIC = 16
# Peaks of the scan of a linear train that are refined: the highest of it need not be
# that of the circle
PEAKS = 3


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
        solved
    best_angle, best : ``(S, Q)``, the least of the phases of the scan
    angles, values : ``(P,)`` deg and ``(S, Q, P)``, the scan
    left_out : tuple of str, a sentence for each status of speeds that have no answer,
        or none at some phases
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

    Of a linear train exactly, at every speed. With backlash, or links that vary with
    their amplitude, a scan of the circle by :func:`jaxhb.solve_speeds`, and round the
    worst phase of each quantity, at the speed at which it is largest, a golden section:
    what is narrower than a step of the scan may be missed. :class:`SceneError` of
    unknown names.

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
        harmonic.
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
    turn = topology.phase_turn[topology.phase_names.index(name)]
    circle = _circle(topology, name)
    linear = not (topology.has_law.any() or topology.amplitude_links)
    reader: _Linear | _Solved = (
        _Linear.of(train, name, rpm, turn) if linear else _Solved(train, name, rpm)
    )
    count = PHASES
    if linear:
        fine = math.ceil(PER_HARMONIC * reader.highest * circle / (360.0 * turn))
        count = max(PHASES, fine)
    count = phases or count
    angles = np.arange(count) * (circle / count)
    every_speed = np.arange(len(rpm))
    values = np.empty((len(rpm), len(quantities), count))
    for k, angle in enumerate(angles):
        if progress and not linear:
            progress(f"phase {angle:g} of {circle:g} deg")
        values[..., k] = reader(np.full(len(rpm), angle), quantities, every_speed)
    own_angle = np.full(len(rpm), float(train.value(f"{name}.angle")))
    nominal = reader(own_angle, quantities, every_speed)
    is_known = np.isfinite(values)
    best = np.where(is_known, values, np.inf).argmin(-1)
    ranked = np.where(is_known, values, -np.inf)
    peak = (ranked >= np.roll(ranked, 1, -1)) & (ranked >= np.roll(ranked, -1, -1))
    tops = np.argsort(-np.where(peak, ranked, -np.inf), axis=-1, kind="stable")[
        ..., : PEAKS if linear else 1
    ]
    worst_angle = angles[tops[..., 0]]
    worst = values.max(-1, initial=-np.inf, where=is_known)
    worst[~is_known.any(-1)] = np.nan
    for q, quantity in enumerate(quantities):
        places = np.flatnonzero(np.isfinite(worst[:, q]))
        places = places if linear else places[np.argsort(-worst[places, q])][:1]
        for k in range(tops.shape[-1] if len(places) else 0):
            peak_angle, peak_value = _golden(
                partial(reader, quantities=(quantity,), places=places),
                angles[tops[places, q, k]],
                width=circle / count,
                steps=LINEAR_STEPS if linear else STEPS,
            )
            better = peak_value > worst[places, q]
            worst_angle[places[better], q] = peak_angle[better] % circle
            worst[places[better], q] = peak_value[better]
    least = np.take_along_axis(values, best[..., None], -1)[..., 0]
    return WorstPhase(
        name=name,
        circle=circle,
        of=quantities,
        rpm=rpm,
        nominal=nominal,
        angle=worst_angle,
        worst=worst,
        best_angle=angles[best],
        best=least,
        angles=angles,
        values=values,
        left_out=tuple(reader.left_out()),
    )


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
    """Values ``(k, Q)`` of a linear train at phases ``(k,)`` deg, one for each of the
    speeds at ``places`` ``(k,)``, from one response and the part of it that the phase
    turns; ``highest`` : harmonic that it turns.
    """

    train: DriveTrain
    response: Response
    turned: dict[str, np.ndarray]
    start: float
    turn: float
    highest: int

    @classmethod
    def of(cls, train: DriveTrain, name: str, rpm: np.ndarray, turn: float) -> _Linear:
        """Solve a train whose phase ``name`` turns once in ``turn`` turns of the
        reference rotor.
        """
        key = f"{name}.angle"
        start = float(train.value(key))

        def fields(angle: Number) -> dict[str, Array]:
            response = forced_response(train.replace({key: angle}), rpm=rpm)
            return {part: getattr(response, part) for part in FIELDS}

        response = forced_response(train, rpm=rpm)
        slope = on_host(jax.jvp(fields, (start,), (1.0,))[1])
        # The derivative of the part that the phase turns is a multiple of that part.
        turned = {}
        for part in FIELDS:
            by_deg = _by_deg(slope[part], turn)
            turned[part] = slope[part] / np.where(by_deg == 0, 1.0, by_deg)
        solved = np.asarray(response.solved)
        torques = np.abs(turned["torques"][solved]).max((0, 1), initial=0.0)
        angles = np.abs(turned["angles"][solved]).max((0, 1), initial=0.0)
        sizes = torques + angles * (torques.max() or 1.0)
        highest = int(np.flatnonzero(sizes > 1e-9 * sizes.max()).max(initial=1))
        return cls(train, response, turned, start, turn, highest)

    def __call__(
        self, angle: np.ndarray, quantities: Sequence[Objective], places: np.ndarray
    ) -> np.ndarray:
        response = self.response[places]
        changes = {}
        for part, values in self.turned.items():
            factor = np.expm1(
                _by_deg(values, self.turn) * (angle - self.start)[:, None, None]
            )
            changes[part] = getattr(response, part) + values[places] * factor
        motion = dataclasses.replace(response, **changes)
        return _read(motion, quantities, self.train)

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


def _read(
    motion: Response, quantities: Sequence[Objective], train: DriveTrain
) -> np.ndarray:
    """Read quantities ``(S, Q)`` for people, nan where they are not converged or a rule
    has no limit.
    """
    columns = []
    for quantity in quantities:
        values = QUANTITIES[quantity.quantity].exact_value(
            motion, quantity.of, quantity.order, train
        )
        has_value = np.asarray(motion.converged) & judged(train, quantity, motion.rpm)
        columns.append(np.where(has_value, values, np.nan))
    return np.stack(columns, axis=-1)


@dataclass(frozen=True)
class _Solved:
    """Values ``(k, Q)`` of a train that is solved anew for every phase ``(k,)`` deg, at
    the speeds at ``places`` ``(k,)``; the phases of all are mostly one.

    ``worst_status`` : of the phases read, by the speeds that did not converge at all of
    them
    """

    train: DriveTrain
    name: str
    rpm: np.ndarray
    worst_status: dict[float, int] = field(default_factory=dict)
    highest = 0  # harmonic that the phase turns: not known before solves

    def __call__(
        self, angle: np.ndarray, quantities: Sequence[Objective], places: np.ndarray
    ) -> np.ndarray:
        values = np.full((len(places), len(quantities)), np.nan)
        for phase in np.unique(angle):
            rows = np.flatnonzero(angle == phase)
            design = self.train.replace({f"{self.name}.angle": float(phase)})
            motion = solve_speeds(design, rpm=self.rpm[places[rows]])
            values[rows] = _read(motion, quantities, design)
            for lost in np.flatnonzero(~np.asarray(motion.converged)):
                rpm = float(motion.rpm[lost])
                status = int(motion.status[lost])
                self.worst_status[rpm] = max(status, self.worst_status.get(rpm, 0))
        return values

    def left_out(self) -> list[str]:
        """Sentences for each status of speeds without an answer at some phases."""
        rpm = np.array(list(self.worst_status))
        status = np.array(list(self.worst_status.values()))
        title = f"{self.train.topology.title}, at some phases,"
        return left_out(rpm, status, title, answered=np.zeros(len(rpm), dtype=bool))


def _golden(
    value: Callable[..., np.ndarray],
    middle: np.ndarray,
    *,
    width: float,
    steps: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Find the largest value ``(S, 1)`` of a function of angles ``(S,)`` within
    ``width`` of each, by golden sections: the angles and the values ``(S,)``.
    """

    def point(angle: np.ndarray) -> np.ndarray:
        return np.stack([angle, np.nan_to_num(value(angle)[:, 0], nan=-np.inf)])

    low = middle - width
    high = middle + width
    # Rows of angles and values.
    first = point(high - GOLDEN * (high - low))
    second = point(low + GOLDEN * (high - low))
    for _ in range(steps):
        left = first[1] > second[1]
        low = np.where(left, low, first[0])
        high = np.where(left, second[0], high)
        better = np.where(left, first, second)
        reach = GOLDEN * (high - low)
        fresh = point(np.where(left, high - reach, low + reach))
        first = np.where(left, fresh, better)
        second = np.where(left, better, fresh)
    angle, largest = np.where(first[1] > second[1], first, second)
    return angle, largest
