"""Parameters, objectives and penalties of a tuning, and the quantities that they
name.
"""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter
from typing import Any, TypeAlias

import numpy as np

from jaxhb._jax import Array
from jaxhb.design import objectives
from jaxhb.elements.sentences import SceneError, suggestion
from jaxhb.linear.strength import having, stress_limits
from jaxhb.results.motion import Motion
from jaxhb.results.quantities import CALLED, VIBRATIONS, names_of
from jaxhb.results.response import Response
from jaxhb.results.signal import Signal
from jaxhb.results.steady import SteadyState
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.kinematics import inertias


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A number of the train that may change.

    Parameters
    ----------
    name : str
        ``"NAME.FIELD"`` as in :meth:`jaxhb.DriveTrain.replace`.
    low, high : float
        Bounds, in the unit of the scene format; the train's own value must lie between
        them.
    scale : "log" or "linear"
        What equal steps of the optimiser are: equal ratios (default; bounds greater
        than 0) or equal differences.
    """

    name: str
    low: float
    high: float
    scale: str = "log"


@dataclass(frozen=True, kw_only=True)
class Objective:
    """A response quantity to be made small, over all speeds.

    Parameters
    ----------
    quantity, of : str
        A name of :data:`QUANTITIES`; the mesh, shaft, damper, gear or disk.
    order : float, optional
        Of the quantities that are the amplitude of one order.
    over : "worst" or "mean"
        The smooth maximum over the speeds (default), or their mean.
    weights : tuple of float, optional
        A factor for each speed; default 1.
    weight : float
        Of this objective among others: each is divided by its value at the start.
    """

    quantity: str
    of: str
    order: float | None = None
    over: str = "worst"
    weights: tuple = ()
    weight: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Penalty:
    """A limit: adds ``weight x (excess / |limit|)^2`` to the objective, at every speed
    at which it is passed.

    Parameters
    ----------
    quantity : str
        A name of :data:`QUANTITIES`; or ``"inertia added"`` (kg m2, of all disks and
        rings, or of the one named by ``of``), or ``"natural frequency"`` (Hz, teeth in
        contact) of mode number ``mode`` as ``jaxhb modes`` counts.
    most, least : float, optional
        The limits, in the unit of the quantity; at least one of them.
    of, order : as in :class:`Objective`
    mode : int, optional
    weight : float
        With 1000 a limit is passed by about 0.1 % where it holds back an objective of
        1.
    """

    quantity: str
    most: float | None = None
    least: float | None = None
    of: str | None = None
    order: float | None = None
    mode: int | None = None
    weight: float = 1000.0


Criterion: TypeAlias = Objective | Penalty
"""A quantity that a tuning reads, to be made small or to be kept within limits."""


SWING: dict[str, objectives.Swing] = {
    "read": objectives.half_peak_to_peak,
    "exact": attrgetter("half_peak_to_peak"),
    "sharp": objectives.sharp_half_peak_to_peak,
    "close": objectives.close_half_peak_to_peak,
}
PEAK: dict[str, objectives.Swing] = {
    "read": Signal.smooth_peak,
    "exact": attrgetter("peak"),
    "sharp": attrgetter("peak"),
    "close": lambda signal: signal.smooth_peak(p=objectives.CLOSE),
}
"""Variants of a size. read : smooth; exact, sharp : what ``read`` smooths, at the time
samples for people, between them to be differentiated; close : smooth, at most 0.8 %
below ``exact``, for limits.
"""
# A share of a limit is not to be missed.
JUDGED = SWING | {"read": SWING["close"]}


@dataclass(frozen=True)
class Measure:
    """A response quantity: its unit, and the kind of element that ``of`` names.

    value : ``(response, of, order, train, size) -> (n,)``, by a size of signals in one
    of the variants ``sizes``; ordered : whether it is of one order; compared : whether
    a tuned design is compared with its steady states in it
    """

    unit: str
    kind: str
    value: Callable[[Any, Any, Any, DriveTrain | None, objectives.Swing], Array]
    sizes: Mapping[str, objectives.Swing] = field(default_factory=lambda: SWING)
    ordered: bool = False
    compared: bool = False

    def exact_value(
        self,
        motion: Motion,
        of: str | None,
        order: float | None,
        train: DriveTrain | None = None,
    ) -> Array:
        """The value for people ``(n,)`` of a Response, or a SteadyState of the
        ``train`` where it is ``compared``.
        """
        return self.value(motion, of, order, train, self.sizes["exact"])

    def of_state(
        self, state: SteadyState, of: str | None, order: float | None, train: DriveTrain
    ) -> float:
        """The value for people of a SteadyState of the ``train`` whose motion is known;
        nan where recorded cycles do not tell it.
        """
        motion = state if self.compared else state.response
        if motion is None:
            return np.nan
        return float(self.exact_value(motion, of, order, train))

    def differentiated(self, variant: str) -> Callable[..., Array]:
        """The function that a gradient is taken of: "read", "sharp" or "close"."""
        size = self.sizes[variant]
        return lambda motion, of, order, train: self.value(
            motion, of, order, train, size
        )


def _sized(name: str, sizes: Mapping[str, objectives.Swing] = SWING) -> Measure:
    """Make the Measure of a size of a vibrating quantity."""
    vibration = VIBRATIONS[name]
    return Measure(
        vibration.unit,
        CALLED[vibration.element],
        lambda motion, of, order, train, size: size(
            vibration.read(objectives.usable(motion), of)
        ),
        sizes,
        compared=True,
    )


def _order(name: str) -> Measure:
    """Make the Measure of the amplitude of one order of a vibrating quantity."""
    vibration = VIBRATIONS[name]
    return Measure(
        vibration.unit,
        CALLED[vibration.element],
        lambda motion, of, order, train, size: vibration.read(
            objectives.usable(motion), of
        ).order(order),
        ordered=True,
        compared=True,
    )


def _alone(unit: str, kind: str, value: Callable[[Response, str], Array]) -> Measure:
    """Make the Measure of a number that is smooth by itself."""
    return Measure(unit, kind, lambda motion, of, order, train, size: value(motion, of))


def _judged(unit: str, kind: str, value: Callable[..., Array]) -> Measure:
    """Make the Measure of ``value(motion, of, train=..., swing=...)``, of limits."""
    return Measure(
        unit,
        kind,
        lambda motion, of, order, train, size: value(
            motion, of, train=train, swing=size
        ),
        JUDGED,
        compared=True,
    )


BETWEEN_TEETH = "mesh with backlash"
LIMITED = "shaft with a tensile_strength"

QUANTITIES = {
    "tooth force": _sized("tooth_force"),
    "tooth force peak": _sized("tooth_force", PEAK),
    "tooth force order": _order("tooth_force"),
    "shaft torque": _sized("torque"),
    "shaft torque order": _order("torque"),
    "gear torque": _sized("gear_torque"),
    "angle": _sized("angle"),
    "angle order": _order("angle"),
    "separated fraction": _alone("", BETWEEN_TEETH, objectives.separated_fraction),
    "impact severity": _alone("m/s", BETWEEN_TEETH, objectives.impact_severity),
    "damper power": _alone("W", CALLED["shaft"], objectives.damper_power),
    "power over limit": _alone(
        "", f"{CALLED['shaft']} with a power_limit", objectives.power_over_limit
    ),
    "stress": _judged("Pa", "shaft with a diameter", objectives.stress),
    "stress over continuous limit": _judged("", LIMITED, objectives.stress_over_limit),
    "stress over transient limit": _judged(
        "", LIMITED, partial(objectives.stress_over_limit, transient=True)
    ),
    "tooth torque over limit": _judged(
        "", "mesh with a rated_torque", objectives.tooth_torque_over_limit
    ),
    "tooth torque over mean": Measure(
        "",
        "mesh",
        lambda motion, of, order, train, size: objectives.tooth_torque_over_mean(
            motion, of, swing=size
        ),
        JUDGED,
    ),
}
"""Forces, torques and angles are half peak-to-peak unless called peak or order; all are
smooth, none is negative.
"""

# Quantities of the train alone, for penalties, and their units
OF_DESIGN = {"inertia added": "kg m2", "natural frequency": "Hz"}


def read_quantity(text: str) -> Objective:
    """The Objective of ``"QUANTITY of ELEMENT"``, where a quantity may end in an order;
    :class:`ValueError` with a sentence if it is none.
    """
    name, separator, element = text.partition(" of ")
    order = None
    ordered = re.fullmatch(r"(.*) ([\d.]+)", name)
    if ordered:
        name = ordered[1]
        order = float(ordered[2])
    if not separator or name not in QUANTITIES:
        raise ValueError(
            f'{text!r}: write "QUANTITY of ELEMENT", as "tooth force of crank'
            f' gear|idler".{suggestion(name, QUANTITIES)}'
        )
    return Objective(quantity=name, of=element, order=order)


def unit_of(quantity: str) -> str:
    """Unit of a named quantity."""
    return OF_DESIGN[quantity] if quantity in OF_DESIGN else QUANTITIES[quantity].unit


def label(criterion: Criterion) -> str:
    """Name a criterion by its reading: ``"tooth force of crank gear|idler"``."""
    order = f" {criterion.order:g}" if criterion.order is not None else ""
    mode = ""
    if isinstance(criterion, Penalty) and criterion.quantity == "natural frequency":
        mode = f" {criterion.mode}"
    element = f" of {criterion.of}" if criterion.of else ""
    return f"{criterion.quantity}{order}{mode}{element}"


def judged(train: DriveTrain, criterion: Criterion, rpm: Array) -> np.ndarray:
    """Whether a reading has a meaning at each speed ``(n,)``: a share of a limit has
    none where the rule of the shaft has no limit.
    """
    if not criterion.quantity.startswith("stress over "):
        return np.ones(len(rpm), dtype=bool)
    assert criterion.of is not None  # a share of a limit is that of a shaft
    return np.isfinite(
        np.asarray(stress_limits(train, criterion.of, np.asarray(rpm))[0])
    )


def inertia_added(train: DriveTrain, start: DriveTrain, of: str | None = None) -> Array:
    """Inertia of ``train`` beyond that of ``start``, kg m2: of all disks and rings, or
    of one.
    """
    difference = inertias(train) - inertias(start)
    return difference.sum() if of is None else difference[train.topology.disk_index(of)]


def check_all(
    train: DriveTrain,
    parameters: Sequence[Parameter],
    objectives: Sequence[Objective],
    penalties: Sequence[Penalty],
    rpm: np.ndarray,
) -> None:
    """Refuse what cannot be tuned: every fault of parameters, objectives and penalties
    in one sentence, all at once.
    """
    title = train.topology.title
    names = [parameter.name for parameter in parameters]
    faults = (
        []
        if parameters
        else [f"{title}: there is nothing to tune: name at least one parameter."]
    )
    faults += (
        []
        if objectives
        else [f"{title}: there is nothing to make small: name at least one objective."]
    )
    twice = sorted({name for name in names if names.count(name) > 1})
    faults += [
        f"{title}: parameter {name!r} is given twice: leave one out." for name in twice
    ]
    texts_of = [
        (f"parameter {parameter.name!r}", parameter_faults(train, parameter))
        for parameter in parameters
    ]
    texts_of += [
        (
            f"objective {objective.quantity!r}",
            objective_faults(train, objective, len(rpm)),
        )
        for objective in objectives
    ]
    texts_of += [
        (f"penalty {penalty.quantity!r}", _penalty_faults(train, penalty))
        for penalty in penalties
    ]
    faults += [
        f"{title}, {head}: {sentence}"
        for head, sentences in texts_of
        for sentence in sentences
    ]
    if faults:
        raise SceneError(faults)


def own_value(train: DriveTrain, name: str, remedy: str, faults: list[str]) -> float:
    """The train's own number, nan where there is none: then the reason is appended to
    ``faults``; ``remedy`` : where it is a table.
    """
    try:
        value = train.value(name)
    except SceneError as error:
        faults += [
            sentence.partition(": ")[2] or sentence for sentence in error.sentences
        ]
        return np.nan
    if np.ndim(value):
        faults.append(f"it is a table, not a number: {remedy}")
        return np.nan
    return float(value)


def parameter_faults(train: DriveTrain, parameter: Parameter) -> list[str]:
    """Sentences on a parameter that cannot be tuned."""
    faults: list = []
    value = own_value(train, parameter.name, "tune numbers only.", faults)
    if faults:
        return faults
    if parameter.scale not in ("log", "linear"):
        return [f"scale is {parameter.scale!r}, must be 'log' or 'linear'."]
    low = parameter.low
    high = parameter.high
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        return [
            f"its bounds are {low:g} and {high:g}, must be finite, low less than high."
        ]
    if parameter.scale == "log" and not (low > 0 and value > 0):
        wrong = f"its value is {value:g}" if low > 0 else f"low is {low:g}"
        return [
            f"{wrong}, must be greater than 0 on a log scale: give a larger one, or"
            " scale = 'linear'."
        ]
    if not low <= value <= high:
        return [
            f"its value {value:g} lies outside its bounds {low:g} to {high:g}: widen"
            " them, or change the start."
        ]
    for bound in (low, high):
        try:
            train.replace({parameter.name: bound})
        except SceneError as error:
            faults += [
                f"at the bound {bound:g}: {sentence}" for sentence in error.sentences
            ]
    return faults


def objective_faults(train: DriveTrain, objective: Objective, speeds: int) -> list[str]:
    """Sentences on an objective that cannot be read at so many speeds."""
    if objective.quantity not in QUANTITIES:
        return [
            f"there is no such quantity.{suggestion(objective.quantity, QUANTITIES)}"
        ]
    faults = _element_faults(train, objective)
    if objective.over not in ("worst", "mean"):
        faults.append(f"over is {objective.over!r}, must be 'worst' or 'mean'.")
    if objective.weights and len(objective.weights) != speeds:
        faults.append(
            f"{len(objective.weights)} weights are given for {speeds} speeds: give one"
            " for each."
        )
    if any(
        not (np.isfinite(w) and w >= 0) for w in (*objective.weights, objective.weight)
    ):
        faults.append("a weight is negative or not finite: weights must be at least 0.")
    return faults


def _penalty_faults(train: DriveTrain, penalty: Penalty) -> list[str]:
    """Sentences on a penalty that cannot be read."""
    quantities = [*QUANTITIES, *OF_DESIGN]
    if penalty.quantity not in quantities:
        return [f"there is no such quantity.{suggestion(penalty.quantity, quantities)}"]
    faults = _element_faults(train, penalty) if penalty.quantity in QUANTITIES else []
    if penalty.quantity == "inertia added" and penalty.of is not None:
        faults += _unknown(penalty.of, train.topology.disk_names, "disk or damper")
    modes = int(
        np.count_nonzero(train.disks.inertia) + np.count_nonzero(train.dampers.inertia)
    )
    if penalty.quantity == "natural frequency" and not (
        penalty.mode and 0 < penalty.mode < modes
    ):
        faults.append(
            f"mode is {penalty.mode}, must be a mode number of jaxhb modes, 1 to"
            f" {modes - 1}."
        )
    limits = [limit for limit in (penalty.most, penalty.least) if limit is not None]
    if not limits:
        faults.append("it has no limit: give most or least.")
    if any(not np.isfinite(limit) or limit == 0 for limit in limits):
        faults.append(
            f"a limit is {limits}, must be finite and not 0: excesses are counted in"
            " shares of it."
        )
    if not penalty.weight > 0:
        faults.append(f"weight is {penalty.weight:g}, must be greater than 0.")
    return faults


def _element_faults(train: DriveTrain, criterion: Criterion) -> list[str]:
    """Sentences on ``of`` and ``order`` of an objective or penalty."""
    quantity = QUANTITIES[criterion.quantity]
    topology = train.topology
    kind = quantity.kind.removesuffix(" with backlash")
    elements, _, key = kind.partition(" with a ")
    names = (
        names_of(topology)
        | {"shaft": topology.shaft_names, CALLED["shaft"]: names_of(topology)["shaft"]}
    )[elements]
    keys = (key, "outer") if key == "diameter" else (key,)
    candidates = (
        [
            name
            for table in elements.split(" or ")
            for name in having(topology, table, *keys)
        ]
        if key
        else names
    )
    if criterion.of in names and criterion.of not in candidates:
        faults = [f"{criterion.of!r} has no {key}: give it one in the scene."]
    else:
        faults = _unknown(criterion.of, candidates, kind)
    gaps: dict[str | None, bool] = dict(
        zip(topology.mesh_names, topology.mesh_backlash, strict=True)
    )
    if kind != quantity.kind and not gaps.get(criterion.of, True):
        faults.append(
            f"mesh {criterion.of!r} has no backlash, its teeth never part: give it one,"
            " or take another."
        )
    if quantity.ordered != (criterion.order is not None):
        faults.append(
            "it needs an order." if quantity.ordered else "it takes no order."
        )
    elif criterion.order is not None:
        harmonic = criterion.order * topology.revolutions_per_cycle
        if not harmonic > 0 or abs(harmonic - round(harmonic)) > 1e-9:
            least = 1 / topology.revolutions_per_cycle
            faults.append(
                f"order {criterion.order:g} is no harmonic of the cycle: use a positive"
                f" multiple of {least:g}."
            )
    return faults


def _unknown(name: str | None, names: Collection[str], kind: str) -> list[str]:
    """The sentence on a name that no element of a kind has."""
    if name in names:
        return []
    if name is None:
        return [f"of is missing: name a {kind}."]
    return [f"there is no {kind} {name!r}.{suggestion(name, names)}"]
