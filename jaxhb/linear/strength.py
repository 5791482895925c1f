"""Torsional stresses of shafts, tooth torques, heat, and torques, speeds and vibrations
of couplings and disks compared with their limits: an aid to evaluation, no approval by
a class.

The rules with their sources are in :mod:`jaxhb.elements.rules`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import ModuleType
from typing import Any, NamedTuple, cast

import numpy as np

from jaxhb._jax import Array, Number, concrete, namespace, traced
from jaxhb._shown import brief
from jaxhb.elements.derived import link_number
from jaxhb.elements.rules import RULES, Rule, Section
from jaxhb.elements.rules.chosen import GEARS
from jaxhb.elements.sentences import suggestion
from jaxhb.results.answers import with_gaps
from jaxhb.train.checks.limits import section_of
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.kinematics import speed_ratios
from jaxhb.train.omission import silent_cylinders
from jaxhb.train.topology import Topology

NEAR = 0.01  # share of the highest speed of a rule that may be missing
# Vibratory torque that a mesh may pass on, over its rated torque
SHARE_OF_RATED = 1.0 / 3.0


def torsional_stress(torque: Number, *, diameter: Number, bore: Number = 0.0) -> Number:
    """Nominal torsional stress in Pa of a round section, ``tau = T / W_p`` with ``W_p =
    pi (d^4 - b^4) / (16 d)``.

    Saint-Venant's theory, without stress concentration. ``torque`` is in N m, half of
    the peak-to-peak for an amplitude; ``diameter`` and ``bore`` in m; numbers or arrays
    ``(...)``. Differentiable; numpy on the host.

    >>> round(float(torsional_stress(1000.0, diameter=0.1, bore=0.05)))
    5432489
    """
    return 16.0 * torque * diameter / (math.pi * (diameter**4 - bore**4))


def permissible_stress(
    *,
    tensile_strength: Number,
    speed_ratio: Number,
    diameter: Number = math.nan,
    stress_concentration: Number = math.nan,
    yield_strength: Number = 0.0,
    bore: Number = 0.0,
    nominal_torque: Number = math.nan,
    rated_rpm: Number = math.nan,
    rule: str | Rule = "M68",
) -> tuple[Array, Array]:
    """Permissible amplitudes of the torsional vibration stress after a rule, continuous
    and transient.

    IACS UR M68 is for intermediate, thrust and propeller shafts (M68.5), not for
    crankshafts (UR M53). In MPa and mm::

        tau_C = (sigma_B + 160) / 18 C_K C_D (3 - 2 lambda^2)     lambda < 0.9
        tau_C = (sigma_B + 160) / 18 C_K C_D 1.38                 0.9 <= lambda <= 1.05
        C_D   = 0.35 + 0.93 d^-0.2
        tau_T = 1.7 tau_C / sqrt(C_K)

    with the outer ``diameter`` d in m; the ``stress_concentration`` C_K, the factor of
    the rule for the form: 1 for an integral flange, 0.6 for a keyway on a taper, 1.45 /
    scf for a notch with stress concentration factor scf; the specified minimum
    ``tensile_strength`` sigma_B in Pa, counted up to 800 MPa, of which the rule counts
    600 MPa at the most for carbon and carbon-manganese steels and for propeller shafts;
    and the ``speed_ratio`` lambda = n / n0, n0 the rated speed. Numbers or arrays
    ``(...)``, the limits in Pa: infinite where lambda is above 1.05, for which the rule
    says nothing. Differentiable; numpy on the host.

    The other rules are those of the Korean Register, Rules for the Classification of
    Steel Ships 2025 (RA-05-E), Part 5, Chapter 4, to be checked against the current
    text. Kind A is a four-stroke in line, or in vee with firing intervals of 45 or 60
    deg; B is a two-stroke, or a four-stroke in another vee. In MPa, ``tau_T`` up to the
    stated lambda, above it ``tau_C``, as no passing is accepted there::

        201, crankshafts, c = 24 (A) or 29 (B):
            tau_C = f (45 - c lambda^2)                                 lambda <= 1
            tau_C = f (45 - c + 237 (lambda - 0.8) sqrt(lambda - 1))    up to 1.15
            tau_T = 2 g (45 - c lambda^2)                               lambda <= 0.8
        203.1, crankshafts of generators:
            tau_C = 21 f (A), 16 f (B)                                  lambda <= 1.1
            tau_T = 90 g                                                lambda <= 0.9
        203.2, generator shafts:
            tau_C = 31 f                                                lambda <= 1.1
            tau_T = 118 g                                               lambda <= 0.9
        201.4, 203.3, both at least 1:
            f = 1 + 2/3 (sigma_B / 440 - 1), g = Y / 225

    with the ``yield_strength`` Y in Pa, and sigma_B, counted up to 835 MPa, of which
    the rule counts 590 MPa at the most for carbon steels. They do not depend on the
    diameter. ``rule`` may be a rule of a file (``jaxhb.elements.rules.written``), which
    may also read the ``bore`` in m, the ``nominal_torque`` in N m and ``rated_rpm``.
    ValueError if there is no such rule.

    Examples
    --------
    >>> form = {"diameter": 0.4, "stress_concentration": 1.0, "tensile_strength": 6e8}
    >>> limits = permissible_stress(**form, speed_ratio=np.array([0.5, 0.9, 1.0]))
    >>> [(limit / 1e6).round(2).tolist() for limit in limits]
    [[66.56, 36.74, 36.74], [113.16, 62.46, 62.46]]
    """
    if not isinstance(rule, Rule):
        if rule not in RULES:
            raise ValueError(f"there is no rule {rule!r}.{suggestion(rule, RULES)}")
        rule = RULES[rule]
    section = Section(
        diameter=diameter,
        tensile_strength=tensile_strength,
        stress_concentration=stress_concentration,
        yield_strength=yield_strength,
        bore=bore,
        nominal_torque=nominal_torque,
        rated_rpm=rated_rpm,
    )
    return _limits(rule, section, speed_ratio)


@dataclass(frozen=True)
class BarredRange:
    """Speeds at which a stress is above its continuous limit; made by
    :func:`barred_ranges`.

    Parameters
    ----------
    low, high : float, rpm; all numbers are arrays where they are differentiated
    at : float, rpm, of the computed speed with the largest share of the limit
    share, transient_share : float, stress over the continuous limit there, and the
    largest over the transient limit
    open_below, open_above : bool, whether the stress is above its limit at the first or
    last computed speed
    rule_low, rule_high : float or None, rpm, of the range that the rule bars around the
    critical speed ``at``, None of a rule without; tolerance : float, rpm, of the
    tachometer, by which that rule widens the range above the limit
    """

    low: float
    high: float
    at: float
    share: float
    transient_share: float
    open_below: bool = False
    open_above: bool = False
    rule_low: float | None = None
    rule_high: float | None = None
    tolerance: float = 0.0

    @property
    def bar_low(self) -> float:
        """Lowest speed in rpm that is to be barred: of the range above the limit with
        the tolerance, and of that of the rule.
        """
        low = self.low - self.tolerance
        if self.rule_low is None:
            return low
        return _end(namespace(low, self.rule_low).minimum(low, self.rule_low))

    @property
    def bar_high(self) -> float:
        """Highest speed in rpm that is to be barred."""
        high = self.high + self.tolerance
        if self.rule_high is None:
            return high
        return _end(namespace(high, self.rule_high).maximum(high, self.rule_high))

    def accepted_by(self, rule: Rule, rated_rpm: float) -> bool:
        """Whether a rule accepts a barred range up to these speeds: it ends below the
        highest one, often 0.8 of the rated speed.
        """
        return bool(self.bar_high <= rule.passed * rated_rpm)

    def widened(
        self, rule: Rule, rated_rpm: float, tachometer_tolerance: float
    ) -> BarredRange:
        """The range with that of a rule around its critical speed, and with the
        tolerance as a share of the rated speed; itself of a rule without such a range.
        """
        if rule.barred is None:
            return self
        low, high = rule.barred(self.at, rated_rpm)
        return replace(
            self,
            rule_low=_end(low),
            rule_high=_end(high),
            tolerance=tachometer_tolerance * rated_rpm,
        )

    @property
    def passable(self) -> bool:
        """Whether the stress stays within the transient limit, so that the range may be
        passed through rapidly.
        """
        return self.transient_share <= 1.0


def _end(speed: Any) -> Any:
    """An end of a range: a float unless it is differentiated."""
    return speed if traced(speed) else float(speed)


def barred_ranges(
    rpm: Array, stress: Array, continuous: Array, transient: Array
) -> tuple[BarredRange, ...]:
    """Speed ranges in which a stress is above its continuous limit, by rising speed; on
    the host.

    Bounds lie where stress less limit, linear between computed speeds, is zero: ranges
    narrower than the step of the speeds may be missed. The numbers have derivatives,
    the bounds those of that zero.

    ``rpm`` ``(n,)``, the stress and its limits ``(n,)`` Pa, see
    :func:`permissible_stress`; speeds without a number or without a limit are left out.
    ValueError inside ``jit`` or ``vmap``, as the values decide how many ranges there
    are.

    >>> limit = np.full(4, 30e6)
    >>> ranges = barred_ranges(
    ...     [100.0, 200.0, 300.0, 400.0],
    ...     np.array([10e6, 40e6, 60e6, 20e6]),
    ...     limit,
    ...     1.7 * limit,
    ... )
    >>> [(round(r.low, 3), round(r.high, 3), r.share, r.passable) for r in ranges]
    [(166.667, 375.0, 2.0, False)]
    """
    columns = (rpm, stress, continuous, transient)
    values = concrete(rpm, stress, continuous, transient)
    if traced(values):
        raise ValueError(
            "barred_ranges: jit or vmap traces the stresses, and these decide how many"
            " ranges there are. Call it outside, where it has derivatives."
        )
    number = namespace(columns).asarray if traced(columns) else float
    # Values decide which ranges there are; derivatives go through the arguments.
    values = _rows(np, values)
    rows = _rows(namespace(columns), columns)
    counted = np.flatnonzero(np.isfinite(values).all(axis=0))
    counted = counted[np.argsort(values[0, counted], kind="stable")]
    values = values[:, counted]
    speed, stress, continuous, transient = rows[:, counted]
    excess = stress - continuous
    share = share_of_limit(stress, continuous)
    transient_share = share_of_limit(stress, transient)
    sizes = share_of_limit(values[1], values[2])
    last = len(counted) - 1

    def bound(inside: int, outside: int) -> Array:
        """Speed at which the excess, linear between a speed within the range and one
        beyond, is zero; the speed within at an end.
        """
        if not 0 <= outside <= last:
            return speed[inside]
        i, j = sorted((inside, outside))
        return speed[i] + (speed[j] - speed[i]) * excess[i] / (excess[i] - excess[j])

    def barred(first: int, end: int) -> BarredRange:
        worst = first + int(np.argmax(sizes[first:end]))
        return BarredRange(
            low=number(bound(first, first - 1)),
            high=number(bound(end - 1, end)),
            at=number(speed[worst]),
            share=number(share[worst]),
            transient_share=number(transient_share[first:end].max()),
            open_below=first == 0,
            open_above=end == last + 1,
        )

    # A zero at either end closes ranges that go on beyond the computed speeds.
    above = (values[1] > values[2]).astype(int)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], above, [0]]))).tolist()
    return tuple(
        barred(first, end) for first, end in zip(edges[::2], edges[1::2], strict=True)
    )


def share_of_limit(stress: Array, limit: Array) -> Array:
    """Stress over its limit ``(...)``, infinite where no stress is permitted."""
    xp = namespace(stress, limit)
    permitted = limit > 0.0
    return xp.where(permitted, stress / xp.where(permitted, limit, 1.0), math.inf)


def _rows(xp: ModuleType, columns: tuple[Array, ...]) -> Array:
    """Stack columns over the speeds as the rows of one array ``(4, n)``."""
    return xp.stack(
        [
            xp.broadcast_to(xp.asarray(column, dtype=float), np.shape(columns[0]))
            for column in columns
        ]
    )


class Stress(NamedTuple):
    """Amplitude of the nominal torsional stress of a shaft and its limits, ``(...)``
    Pa; limits None without.
    """

    stress: Array
    continuous: Array | None
    transient: Array | None


class ToothTorque(NamedTuple):
    """Torque of a mesh on its first gear, ``(...)`` N m: amplitude, limit, mean; and
    whether it changes its sign.
    """

    vibratory: Array
    limit: Number
    mean: Array
    reverses: Array


class Heat(NamedTuple):
    """Power that a shaft or damper turns into heat and its limit, ``(...)`` W."""

    power: Array
    limit: Number


class Bounded(NamedTuple):
    """A number of an element and its limit, ``(...)`` in their SI unit."""

    value: Array
    limit: Number


class Running(NamedTuple):
    """A ``motion`` of a train at speeds ``(...)`` of the reference rotor in rpm."""

    train: DriveTrain
    rpm: Array
    motion: Any


@dataclass(frozen=True)
class Limit:
    """A limit that elements of some ``tables`` give in the unit of a scene by a
    ``key``; what :func:`judged` compares with it, ``read(running, name)``; and the
    factor to the SI unit.
    """

    key: str
    tables: tuple[str, ...]
    read: Callable[[Running, str], Array]
    factor: float = 1.0

    def of(self, train: DriveTrain, name: str) -> Number:
        """Limit of an element in its SI unit."""
        topology = train.topology
        table = next(table for table in self.tables if name in topology.names_of(table))
        index = topology.names_of(table).index(name)
        return self.factor * getattr(train.table(table), self.key)[index]


def largest_torque(running: Running, name: str) -> Array:
    """Largest size ``(...)`` N m of the torque of a shaft or damper."""
    torque = running.motion.torque(name)
    return namespace(torque.max).maximum(torque.max, -torque.min)


def speed_of(running: Running, name: str) -> Array:
    """Speed ``(...)`` rpm of the rotor of a shaft or damper."""
    topology = running.train.topology
    link, _ = topology.link_index(name)
    disk, _ = topology.link_ends[link]
    ratio = speed_ratios(running.train)[topology.rotor[disk]]
    return abs(ratio) * namespace(running.rpm, ratio).asarray(running.rpm)


def acceleration_of(running: Running, name: str) -> Array:
    """Half of the peak-to-peak acceleration ``(...)`` rad/s2 of a disk; nan of a motion
    that never repeats, whose record has none.
    """
    motion = running.motion
    if getattr(motion, "solution", motion) is None:
        return np.full(np.shape(running.rpm), np.nan)
    return motion.acceleration(name).half_peak_to_peak


def concentrated_stress(running: Running, name: str) -> Array:
    """Additional alternating torsional stress ``(...)`` Pa of a crankshaft, ``tau_N``
    times the larger of its factors: IACS UR M53, torsion alone.
    """
    train = running.train
    topology = train.topology
    link, _ = topology.link_index(name)
    factors = [
        getattr(train.shafts, key)[link]
        for key in ("fillet_factor", "oil_bore_factor")
        if topology.has_key(link, key)
    ]
    nominal = stress_of(train, name, running.motion.torque(name).half_peak_to_peak)
    return nominal * namespace(factors).max(namespace(factors).asarray(factors))


LINKED = ("shaft", "damper")
LIMITS = {
    "heat": Limit(
        "power_limit", LINKED, lambda running, name: running.motion.power(name)
    ),
    "mean_torques": Limit(
        "nominal_torque",
        LINKED,
        lambda running, name: abs(running.motion.torque(name).mean),
    ),
    "vibratory_torques": Limit(
        "vibratory_torque",
        LINKED,
        lambda running, name: running.motion.torque(name).half_peak_to_peak,
    ),
    "largest_torques": Limit("maximum_torque", LINKED, largest_torque),
    "speeds": Limit("speed_limit", LINKED, speed_of),
    "crank_stresses": Limit("alternating_limit", ("shaft",), concentrated_stress),
    "angles": Limit(
        "angle_limit",
        ("disk",),
        lambda running, name: running.motion.disk(name).half_peak_to_peak,
        math.pi / 180.0,
    ),
    "irregularities": Limit(
        "speed_irregularity_limit",
        ("disk",),
        lambda running, name: abs(running.motion.irregularity(name)),
    ),
    "accelerations": Limit(
        "acceleration_limit",
        ("disk",),
        acceleration_of,
    ),
}
"""Limits of one number each, by the fields of a :class:`Strength`."""


class Judged(NamedTuple):
    """Source of a rule; rpm up to which it has limits, up to which it requires
    stresses, and up to which these are computed; and whether they are all it requires,
    but for 1 %.
    """

    source: str
    limits_to_rpm: float
    asked_to_rpm: float
    known_to_rpm: float
    complete: bool


@brief
@dataclass(frozen=True)
class Strength:
    """Stresses, tooth torques and heat with their limits; made by :func:`strength`.

    Parameters
    ----------
    rpm : ``()`` or ``(n,)``, of the reference rotor; rated_rpm : float or None
    stresses : dict, :class:`Stress` of every shaft with a ``diameter`` or ``outer``
    tooth_torques : dict, :class:`ToothTorque` of every mesh with a ``rated_torque``
    heat : dict, :class:`Heat` of every shaft and damper with a ``power_limit``
    mean_torques, vibratory_torques, largest_torques, speeds : dict, :class:`Bounded` of
        every shaft and damper with a ``nominal_torque``, ``vibratory_torque``,
        ``maximum_torque`` (N m) or ``speed_limit`` (rpm)
    crank_stresses : dict, :class:`Bounded` of every shaft with an
        ``alternating_limit``, Pa
    angles, irregularities, accelerations : dict, :class:`Bounded` of every disk with an
        ``angle_limit`` (rad), ``speed_irregularity_limit`` or ``acceleration_limit``
        (rad/s2)
    rules : dict, name of the rule of every shaft with limits; known : dict, the rules
        by name
    tachometer_tolerance : share of the rated speed by which barred ranges are widened
    not_firing : names of the cylinders without injection or gas torque
    unconfirmed : ``(n,)`` bool or None, speeds whose numbers are those of recorded
        cycles, as no harmonic solution repeats the motion
    """

    rpm: Array
    rated_rpm: float | None
    stresses: dict
    tooth_torques: dict
    heat: dict
    mean_torques: dict = field(default_factory=dict)
    vibratory_torques: dict = field(default_factory=dict)
    largest_torques: dict = field(default_factory=dict)
    speeds: dict = field(default_factory=dict)
    crank_stresses: dict = field(default_factory=dict)
    angles: dict = field(default_factory=dict)
    irregularities: dict = field(default_factory=dict)
    accelerations: dict = field(default_factory=dict)
    rules: dict = field(default_factory=dict)
    known: dict = field(default_factory=lambda: RULES, repr=False)
    tachometer_tolerance: float = 0.0
    not_firing: tuple[str, ...] = ()
    unconfirmed: np.ndarray | None = None

    def __bool__(self) -> bool:
        """Whether the scene has anything to judge by limits."""
        kinds = ("stresses", "tooth_torques", *LIMITS)
        return any(getattr(self, kind) for kind in kinds)

    @cached_property
    def barred(self) -> dict[str, tuple[BarredRange, ...]]:
        """Barred speed ranges of every shaft with limits, see
        :func:`jaxhb.barred_ranges`; of several speeds.
        """
        barred = {}
        for name, row in self.stresses.items():
            if row.continuous is None:
                continue
            rule = self.known[self.rules[name]]
            ranges = barred_ranges(self.rpm, row.stress, row.continuous, row.transient)
            assert self.rated_rpm is not None  # limits are those of a rated speed
            barred[name] = tuple(
                each.widened(rule, self.rated_rpm, self.tachometer_tolerance)
                for each in ranges
            )
        return barred

    @property
    def judged(self) -> dict[str, Judged]:
        """Speeds of every rule, for which it has limits and requires stresses, and up
        to which the stresses reach.
        """
        by_rule: dict = {}
        for name, rule in self.rules.items():
            known = self.known[rule]
            stress = np.broadcast_to(self.stresses[name].stress, np.shape(self.rpm))
            reached = float(np.max(np.where(np.isfinite(stress), self.rpm, 0.0)))
            rated = self.rated_rpm or 0.0
            required = known.required * rated
            judgement = Judged(
                source=known.source,
                limits_to_rpm=known.highest * rated,
                asked_to_rpm=required,
                known_to_rpm=reached,
                complete=reached >= (1 - NEAR) * required,
            )
            by_rule.setdefault(rule, judgement)
        return by_rule


def strength(response: Any, *, train: DriveTrain | None = None) -> Strength:
    """Compare stresses, tooth torques and heat of a motion with the limits of the
    scene.

    ``response`` is a Response or ForcedResponse of one speed or of several, nan where
    its equations are not solved, or a SteadyState. ``train`` is the train to be judged,
    by default that of the response: a response that comes out of a jax transformation
    has none, nor has a motion that never repeats, and ValueError asks for it.
    Differentiable.

    Every shaft with a ``diameter`` (or ``outer``) has as stress half of the
    peak-to-peak torque over W_p, and with a ``tensile_strength`` its limits at this
    speed over ``rated_rpm`` after its ``rule``, see :func:`jaxhb.permissible_stress`
    (IACS UR M68: not for crankshafts). Every mesh with a ``rated_torque`` has half of
    the peak-to-peak torque on its first gear, which must not exceed a third of the
    rated torque, nor may the torque reverse. Every shaft, damper and disk with a limit
    of :data:`LIMITS` has the number that it bounds. An aid to evaluation, no class
    approval.

    >>> import math
    >>> parts = [jaxhb.Disk(name=name, inertia=2.0) for name in "ab"]
    >>> parts += [jaxhb.Torque(disk="a", harmonics=[(1.0, 10.0, 0.0)])]
    >>> parts += [
    ...     jaxhb.Shaft(between=("a", "b"), stiffness=100.0, diameter=0.01, bore=0.0)
    ... ]
    >>> train = jaxhb.build(parts, revolutions_per_cycle=1)
    >>> result = strength(jaxhb.forced_response(train, rpm=2.5 * 30 / math.pi))
    >>> (
    ...     round(float(result.stresses["a|b"].stress) / 1e6, 4),
    ...     result.stresses["a|b"].continuous,
    ... )
    (27.1624, None)
    """
    motion = (
        with_gaps(response, doubtful=True)
        if response.solution is response
        else response
    )
    return judged(train_of(response, train), response.rpm, motion)


def train_of(response: Any, train: DriveTrain | None = None) -> DriveTrain:
    """The ``train``, by default that of the response; ValueError if there is none."""
    solution = response.solution
    train = solution.train if train is None and solution is not None else train
    if train is None:
        raise ValueError(
            "this response comes out of a jax transformation or of a record and has no"
            " train: give train="
        )
    return train


def judged(train: DriveTrain, rpm: Array, motion: Any) -> Strength:
    """The :class:`Strength` of a train whose ``motion`` has ``power(name)``, and
    ``mean``, ``min``, ``max`` and ``half_peak_to_peak`` of ``torque(name)`` and
    ``force(name)``.
    """
    topology = train.topology
    stresses = {}
    rules = {}
    for name in having(topology, "shaft", "outer", "diameter"):
        stress = stress_of(train, name, motion.torque(name).half_peak_to_peak)
        continuous = transient = None
        link, _ = topology.link_index(name)
        if topology.has_key(link, "tensile_strength"):
            continuous, transient = stress_limits(train, name, rpm)
            rules[name] = topology.rule_of(link).name
        stresses[name] = Stress(stress, continuous, transient)

    def tooth_torque(name: str) -> ToothTorque:
        force = motion.force(name)
        radius, limit = rated_gear(train, name)
        reverses = (force.min < 0) & (force.max > 0)
        return ToothTorque(
            radius * force.half_peak_to_peak, limit, radius * force.mean, reverses
        )

    def bounded(kind: str) -> dict[str, Bounded]:
        limit = LIMITS[kind]
        running = Running(train, rpm, motion)
        return {
            name: Bounded(limit.read(running, name), limit.of(train, name))
            for table in limit.tables
            for name in having(topology, table, limit.key)
        }

    return Strength(
        rpm=rpm,
        rated_rpm=topology.rated_rpm,
        stresses=stresses,
        tooth_torques={
            name: tooth_torque(name)
            for name in having(topology, "mesh", "rated_torque")
            if GEARS in topology.rules.names
        },
        heat={name: Heat(*row) for name, row in bounded("heat").items()},
        mean_torques=bounded("mean_torques"),
        vibratory_torques=bounded("vibratory_torques"),
        largest_torques=bounded("largest_torques"),
        speeds=bounded("speeds"),
        crank_stresses=bounded("crank_stresses"),
        angles=bounded("angles"),
        irregularities=bounded("irregularities"),
        accelerations=bounded("accelerations"),
        rules=rules,
        known=topology.rules.rules,
        tachometer_tolerance=topology.tachometer_tolerance,
        not_firing=silent_cylinders(train),
    )


def having(topology: Topology, table: str, *keys: str) -> list[str]:
    """Names of the links, or disks, of a table that have one of the keys in the
    scene.
    """
    if table == "disk":
        disks = zip(topology.names_of(table), topology.disk_keys, strict=False)
        return [name for name, present in disks if set(keys) & set(present)]
    names = topology.names_of(table) if topology.link_keys else ()
    links = [link_number(topology, table, i) for i in range(len(names))]
    return [
        name
        for name, link in zip(names, links, strict=True)
        if any(topology.has_key(link, key) for key in keys)
    ]


def stress_of(train: DriveTrain, name: str, torque: Number) -> Array:
    """Nominal stress in Pa of a shaft under a torque in N m."""
    shaft, _ = train.topology.link_index(name)
    section = section_of(train, shaft)
    # An array, as the diameter is one.
    return cast(
        "Array",
        torsional_stress(torque, diameter=section.diameter, bore=section.bore),
    )


def stress_limits(train: DriveTrain, name: str, rpm: Number) -> tuple[Array, Array]:
    """Continuous and transient limit in Pa of a shaft at speeds of the reference
    rotor.
    """
    shaft, _ = train.topology.link_index(name)
    rated = train.topology.rated_rpm
    assert rated is not None  # a shaft with limits has one
    ratio = namespace(rpm).asarray(rpm) / rated
    return _limits(train.topology.rule_of(shaft), section_of(train, shaft), ratio)


def _limits(rule: Rule, section: Section, speed_ratio: Number) -> tuple[Array, Array]:
    """Limits in Pa of a section, infinite above the highest speed of a rule."""
    xp = namespace(*vars(section).values(), speed_ratio)
    ratio = xp.asarray(speed_ratio, dtype=float)
    # Both are masked, not one computed from the other: the derivative of an infinite
    # limit would be nan.
    continuous, transient = rule.limits(section, ratio)
    beyond = ratio > rule.highest
    return (
        xp.where(beyond, math.inf, continuous),
        xp.where(beyond, math.inf, transient),
    )


def rated_gear(train: DriveTrain, name: str) -> tuple[Number, Number]:
    """Pitch radius in m of the first gear of a mesh, and the vibratory torque in N m
    that it may pass on.
    """
    mesh = train.topology.mesh_names.index(name)
    first, _ = train.topology.mesh_ends[mesh]
    return train.disks.radius[first], SHARE_OF_RATED * train.meshes.rated_torque[mesh]
