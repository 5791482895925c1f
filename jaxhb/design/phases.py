"""The worst phase between engines that drive one train: the largest value of a quantity
over the full circle.

The response of a linear train is linear in its excitation: turned by the angle alpha,
what one engine adds to harmonic n of the cycle is multiplied by exp(-i n alpha / turn).
One response and its derivative by the angle give the motions of all phases exactly.
Trains with backlash are solved at phases all round the circle, and near the worst.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import jax
import numpy as np

from jaxhb._jax import Array, on_host, refuse_tracers
from jaxhb._shown import brief
from jaxhb.design.quantities import (
    QUANTITIES,
    Objective,
    judged,
    label,
    objective_faults,
)
from jaxhb.elements.elements import SceneError, suggestion
from jaxhb.linear.forced import forced_response
from jaxhb.results.answers import left_out
from jaxhb.results.response import FIELDS, Response
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed

LINEAR_STEPS, STEPS = (
    40,
    8,
    # Of the golden section round the worst phase of the scan; with backlash each is a
    # solve
)
GOLDEN = (5**0.5 - 1) / 2
PHASES = 24  # of the scan of a train that is solved at each
PER_HARMONIC = (
    16  # phases of the scan of a linear train for each harmonic that the engine excites
)
# Of the scan of a linear train that are refined: the highest of it need not be that of
# the circle
PEAKS = 3


@brief
@dataclass(frozen=True)
class WorstPhase:
    """The worst phase of every quantity at every speed; made by :func:`worst_phase`.

    Parameters
    ----------
    name : str, of the phase; circle : float, deg of its rotor after which all repeats:
    whole revolutions of one engine
        cycle, however many of these the cycle of the scene holds
    of : tuple of Objective, Q quantities; labels : tuple of str, what they are called
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
    of: tuple
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
        """As ``"shaft torque of line"``."""
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
    check_speed(train, rpm, many=True)
    if name not in topology.phase_names:
        why = (
            suggestion(name, topology.phase_names)
            if topology.phase_names
            else " The scene has no [[phase]]."
        )
        raise SceneError(f"{topology.title}: there is no phase {name!r}.{why}")
    rpm = np.asarray(rpm, dtype=float)
    every = [Objective(quantity="tooth force", of=mesh) for mesh in topology.mesh_names]
    every += [
        Objective(quantity="shaft torque", of=link)
        for link in topology.shaft_and_damper_names
    ]
    chosen = tuple(of) or tuple(every)
    faults = [
        f"{topology.title}, {label(one)}: {text}"
        for one in chosen
        for text in objective_faults(train, one, 1)
    ]
    if faults:
        raise SceneError(faults)
    turn = topology.phase_turn[topology.phase_names.index(name)]
    circle = _circle(topology, name)
    linear = not (topology.has_law.any() or topology.amplitude_links)
    read: _Linear | _Solved = (
        _Linear.of(train, name, rpm, turn) if linear else _Solved(train, name, rpm)
    )
    count = phases or (
        max(PHASES, math.ceil(PER_HARMONIC * read.highest * circle / (360.0 * turn)))
        if linear
        else PHASES
    )
    angles = np.arange(count) * (circle / count)
    values = np.empty((len(rpm), len(chosen), count))
    for k, angle in enumerate(angles):
        if progress and not linear:
            progress(f"phase {angle:g} of {circle:g} deg")
        values[..., k] = read(np.full(len(rpm), angle), chosen)
    nominal = read(np.full(len(rpm), float(train.value(f"{name}.angle"))), chosen)
    known = np.isfinite(values)
    best = np.where(known, values, np.inf).argmin(-1)
    ranked = np.where(known, values, -np.inf)
    peak = (ranked >= np.roll(ranked, 1, -1)) & (ranked >= np.roll(ranked, -1, -1))
    tops = np.argsort(-np.where(peak, ranked, -np.inf), axis=-1, kind="stable")[
        ..., : PEAKS if linear else 1
    ]
    at = angles[tops[..., 0]]
    worst = values.max(-1, initial=-np.inf, where=known)
    worst[~known.any(-1)] = np.nan
    for q, one in enumerate(chosen):
        places = np.flatnonzero(np.isfinite(worst[:, q]))
        places = places if linear else places[np.argsort(-worst[places, q])][:1]
        own = read.at(places)
        for k in range(tops.shape[-1] if len(places) else 0):
            how = {"width": circle / count, "steps": LINEAR_STEPS if linear else STEPS}
            middle = angles[tops[places, q, k]]
            found, value = _golden(
                lambda a, one=one, own=own: own(a, (one,))[:, 0], middle, **how
            )
            better = value > worst[places, q]
            at[places[better], q], worst[places[better], q] = (
                found[better] % circle,
                value[better],
            )
    least = np.take_along_axis(values, best[..., None], -1)[..., 0]
    found = (nominal, at, worst, angles[best], least, angles, values)
    return WorstPhase(
        name, circle, chosen, rpm, *found, left_out=tuple(read.left_out())
    )


def _circle(topology, name):
    """Whole revolutions, in deg, of the rotor of a phase after which all that it turns
    repeats.
    """
    place = topology.phase_names.index(name)
    turn = topology.phase_turn[place]
    harmonics = [
        n for k in topology.phase_torques[place] for n in topology.torque_harmonics[k]
    ]
    for i in topology.phase_cylinders[place]:
        harmonics += topology.cylinder_harmonics[i]
        harmonics += [topology.cylinder_step[i]] * bool(topology.cylinder_gas[i])
        harmonics += [round(topology.cylinder_turn[i])] * bool(
            topology.cylinder_inertia[i]
        )
    # An angle alpha turns harmonic n of the cycle by n alpha / turn.
    common = math.gcd(*harmonics) or 1
    revolutions = Fraction(turn / common).limit_denominator(1000).numerator
    return 360.0 * min(float(revolutions), turn)


@dataclass(frozen=True)
class _Linear:
    """Values ``(S, Q)`` of a linear train at phases ``(S,)`` deg, one for each speed,
    from one response and what of it the phase turns; ``highest`` : harmonic that it
    turns.
    """

    train: DriveTrain
    response: Response
    turned: dict
    start: float
    turn: float
    highest: int

    @classmethod
    def of(cls, train, name, rpm, turn):
        """Of a train whose phase ``name`` turns once in ``turn`` turns of the reference
        rotor.
        """
        start = float(train.value(f"{name}.angle"))
        key = f"{name}.angle"

        def fields(angle):
            response = forced_response(train.replace({key: angle}), rpm=rpm)
            return {part: getattr(response, part) for part in FIELDS}

        response = forced_response(train, rpm=rpm)
        slope = on_host(jax.jvp(fields, (start,), (1.0,))[1])
        # What the phase turns: its derivative is its own multiple.
        turned = {
            part: slope[part] / np.where(by == 0, 1.0, by)
            for part in FIELDS
            for by in [_by_deg(slope[part], turn)]
        }
        solved = np.asarray(response.solved)
        size = np.abs(turned["torques"][solved]).max((0, 1), initial=0.0)
        size = size + np.abs(turned["angles"][solved]).max((0, 1), initial=0.0) * (
            size.max() or 1.0
        )
        highest = int(np.flatnonzero(size > 1e-9 * size.max()).max(initial=1))
        return cls(train, response, turned, start, turn, highest)

    def __call__(self, angle, chosen):
        changes = {}
        for part, own in self.turned.items():
            more = np.expm1(
                _by_deg(own, self.turn) * (angle - self.start)[:, None, None]
            )
            changes[part] = getattr(self.response, part) + own * more
        motion = dataclasses.replace(self.response, **changes)
        return _read(motion, chosen, self.train)

    def at(self, places):
        """The same at some of the speeds."""
        turned = {part: own[places] for part, own in self.turned.items()}
        return dataclasses.replace(self, response=self.response[places], turned=turned)

    def left_out(self):
        """A sentence for each status of speeds without an answer."""
        return left_out(
            self.response.rpm, self.response.status, self.train.topology.title
        )


def _by_deg(values, turn):
    """Derivative by the phase in deg of what it turns, over the harmonics of
    ``values``, as a share of itself.
    """
    return -1j * np.deg2rad(np.arange(values.shape[-1])) / turn


def _read(motion, chosen, train):
    """Quantities ``(S, Q)`` for people, nan where they are not converged or a rule has
    no limit.
    """
    columns = []
    for quantity in chosen:
        values = QUANTITIES[quantity.quantity].exact_value(
            motion, quantity.of, quantity.order, train
        )
        told = np.asarray(motion.converged) & judged(train, quantity, motion.rpm)
        columns.append(np.where(told, values, np.nan))
    return np.stack(columns, axis=-1)


@dataclass(frozen=True)
class _Solved:
    """The same of a train that is solved anew for every phase; the phases of all speeds
    are mostly one.

    ``worst_status`` : of the phases read, by the speeds that did not converge at all of
    them
    """

    train: DriveTrain
    name: str
    rpm: np.ndarray
    worst_status: dict = field(default_factory=dict)
    highest = 0  # harmonic that the phase turns: not known before solves

    def __call__(self, angle, chosen):
        values = np.full((len(self.rpm), len(chosen)), np.nan)
        for one in np.unique(angle):
            own = np.flatnonzero(angle == one)
            design = self.train.replace({f"{self.name}.angle": float(one)})
            motion = solve_speeds(design, rpm=self.rpm[own])
            values[own] = _read(motion, chosen, design)
            for lost in np.flatnonzero(~np.asarray(motion.converged)):
                rpm = float(motion.rpm[lost])
                status = int(motion.status[lost])
                self.worst_status[rpm] = max(status, self.worst_status.get(rpm, 0))
        return values

    def at(self, places):
        """The same at some of the speeds."""
        return dataclasses.replace(self, rpm=self.rpm[places])

    def left_out(self):
        """A sentence for each status of speeds without an answer at some phases."""
        rpm, status = map(
            np.array, (list(self.worst_status), list(self.worst_status.values()))
        )
        title = f"{self.train.topology.title}, at some phases,"
        return left_out(rpm, status, title, kept=np.zeros(len(rpm), dtype=bool))


def _golden(value, middle, *, width, steps):
    """The largest of a function of angles ``(S,)`` within ``width`` of each, by golden
    sections.
    """
    low = middle - width
    high = middle + width
    inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)]
    values = [np.nan_to_num(value(x), nan=-np.inf) for x in inner]
    for _ in range(steps):
        left = values[0] > values[1]
        low = np.where(left, low, inner[0])
        high = np.where(left, inner[1], high)
        kept = np.where(left, inner[0], inner[1]), np.where(left, values[0], values[1])
        fresh = np.where(
            left, high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        )
        told = np.nan_to_num(value(fresh), nan=-np.inf)
        inner = [np.where(left, fresh, kept[0]), np.where(left, kept[0], fresh)]
        values = [np.where(left, told, kept[1]), np.where(left, kept[1], told)]
    first = values[0] > values[1]
    return np.where(first, inner[0], inner[1]), np.where(first, values[0], values[1])
