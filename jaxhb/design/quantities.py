"""What is tuned, for what, within which limits: parameters, objectives and penalties by
name.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jaxhb.design import objectives
from jaxhb.elements.elements import SceneError, suggestion
from jaxhb.equations.kinematics import inertias
from jaxhb.linear.strength import having, stress_limits
from jaxhb.results.motion import Motion
from jaxhb.results.signal import Signal


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


@dataclass(frozen=True)
class Quantity:
    """A response quantity: its unit, and the kind of element that ``of`` names.

    read : smooth, ``(response, of, order, train) -> (n,)``; exact, sharp : what
    ``read`` smooths, at the time samples for people and between them to be
    differentiated; close : smooth, at most 0.8 % below ``exact``, for limits; None
    where that is ``read`` itself; compared : whether a tuned design is compared with
    its steady states in it
    """

    unit: str
    kind: str
    read: Callable
    exact: Callable | None = None
    sharp: Callable | None = None
    close: Callable | None = None
    ordered: bool = False
    compared: bool = False

    def exact_value(self, motion, of, order, train=None):
        """The value for people ``(n,)`` of a Response, or a SteadyState of the
        ``train`` where it is ``compared``.
        """
        return (self.exact or self.read)(motion, of, order, train)

    def differentiated(self, how):
        """What a gradient is taken of: "read", "sharp" or "close"."""
        return getattr(self, how) or self.read


@dataclass(frozen=True)
class Size:
    """Readings of one size of a Signal, as those of :class:`Quantity`."""

    read: Callable
    exact: Callable
    sharp: Callable
    close: Callable


SWING = Size(
    read=objectives.half_peak_to_peak,
    exact=lambda signal: signal.half_peak_to_peak,
    sharp=objectives.sharp_half_peak_to_peak,
    close=objectives.close_half_peak_to_peak,
)
PEAK = Size(
    read=Signal.smooth_peak,
    exact=lambda signal: signal.peak,
    sharp=lambda signal: signal.peak,
    close=lambda signal: signal.smooth_peak(p=objectives.CLOSE),
)


def _sized(unit, kind, reader, size=SWING):
    """A size of a signal ``(motion, of) -> Signal``."""

    def of_signal(measure):
        return lambda motion, of, *_: measure(reader(objectives.usable(motion), of))

    return Quantity(
        unit,
        kind,
        **{name: of_signal(measure) for name, measure in vars(size).items()},
        compared=True,
    )


def _order(unit, kind, reader):
    """The amplitude of one order of a signal."""

    def read(motion, of, order, _=None):
        return reader(objectives.usable(motion), of).order(order)

    return Quantity(unit, kind, read, ordered=True, compared=True)


def _judged(unit, kind, value, *, compared=True, **more):
    """What is judged by a swing ``(motion, of, train=..., swing=...)``."""
    swings = (
        {},
        {"swing": lambda signal: signal.half_peak_to_peak},
        {"swing": objectives.sharp_half_peak_to_peak},
    )
    all_three = (
        lambda m, of, _, train=None, how=how: value(m, of, train=train, **how, **more)
        for how in swings
    )
    return Quantity(unit, kind, *all_three, compared=compared)


QUANTITIES = {
    "tooth force": _sized("N", "mesh", Motion.force),
    "tooth force peak": _sized("N", "mesh", Motion.force, PEAK),
    "tooth force order": _order("N", "mesh", Motion.force),
    "shaft torque": _sized("N m", "shaft or damper", Motion.torque),
    "shaft torque order": _order("N m", "shaft or damper", Motion.torque),
    "gear torque": _sized("N m", "gear", Motion.gear_torque),
    "angle": _sized("rad", "disk", Motion.disk),
    "angle order": _order("rad", "disk", Motion.disk),
    "separated fraction": Quantity(
        "", "mesh with backlash", lambda r, of, *_: objectives.separated_fraction(r, of)
    ),
    "impact severity": Quantity(
        "m/s", "mesh with backlash", lambda r, of, *_: objectives.impact_severity(r, of)
    ),
    "damper power": Quantity(
        "W", "shaft or damper", lambda r, of, *_: objectives.damper_power(r, of)
    ),
    "power over limit": Quantity(
        "",
        "shaft or damper with a power_limit",
        lambda r, of, *_: objectives.power_over_limit(r, of),
    ),
    "stress": _judged("Pa", "shaft with a diameter", objectives.stress),
    "stress over continuous limit": _judged(
        "", "shaft with a tensile_strength", objectives.stress_over_limit
    ),
    "stress over transient limit": _judged(
        "",
        "shaft with a tensile_strength",
        objectives.stress_over_limit,
        transient=True,
    ),
    "tooth torque over limit": _judged(
        "", "mesh with a rated_torque", objectives.tooth_torque_over_limit
    ),
    "tooth torque over mean": _judged(
        "",
        "mesh",
        lambda r, of, train, **how: objectives.tooth_torque_over_mean(r, of, **how),
        compared=False,
    ),
}
"""Forces, torques and angles are half peak-to-peak unless called peak or order; all are
smooth, none is negative.
"""

OF_DESIGN = {
    "inertia added": "kg m2",
    "natural frequency": "Hz",
}  # quantities of the train alone, for penalties


def unit_of(quantity):
    """Unit of a named quantity."""
    return OF_DESIGN[quantity] if quantity in OF_DESIGN else QUANTITIES[quantity].unit


def label(chosen):
    """What an Objective or Penalty reads: ``"tooth force of crank gear|idler"``."""
    order = f" {chosen.order:g}" if chosen.order is not None else ""
    mode = f" {chosen.mode}" if chosen.quantity == "natural frequency" else ""
    return f"{chosen.quantity}{order}{mode}" + (f" of {chosen.of}" if chosen.of else "")


def judged(train, chosen, rpm):
    """Whether what is read has a meaning at each speed ``(n,)``: a share of a limit has
    none where the rule of the shaft has no limit.
    """
    if not chosen.quantity.startswith("stress over "):
        return np.ones(len(rpm), dtype=bool)
    return np.isfinite(np.asarray(stress_limits(train, chosen.of, np.asarray(rpm))[0]))


def inertia_added(train, start, of=None):
    """Inertia of ``train`` beyond that of ``start``, kg m2: of all disks and rings, or
    of one.
    """
    difference = inertias(train) - inertias(start)
    return difference.sum() if of is None else difference[train.topology.disk_index(of)]


def check_all(train, parameters, given, penalties, rpm):
    """Refuse what cannot be tuned, every fault of parameters, objectives and penalties
    in one sentence, all at once.
    """
    where = train.topology.title
    names = [parameter.name for parameter in parameters]
    faults = (
        []
        if parameters
        else [f"{where}: there is nothing to tune: name at least one parameter."]
    )
    faults += (
        []
        if given
        else [f"{where}: there is nothing to make small: name at least one objective."]
    )
    twice = sorted({name for name in names if names.count(name) > 1})
    faults += [
        f"{where}: parameter {name!r} is given twice: leave one out." for name in twice
    ]
    found = [
        (f"parameter {one.name!r}", parameter_faults(train, one)) for one in parameters
    ]
    found += [
        (f"objective {one.quantity!r}", objective_faults(train, one, len(rpm)))
        for one in given
    ]
    found += [
        (f"penalty {one.quantity!r}", _penalty_faults(train, one)) for one in penalties
    ]
    faults += [f"{where}, {head}: {text}" for head, texts in found for text in texts]
    if faults:
        raise SceneError(faults)


def own_value(train, name, remedy, faults):
    """The train's own number, nan where there is none, which ``faults`` are told;
    ``remedy`` : where it is a table.
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


def parameter_faults(train, parameter):
    faults = []
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


def objective_faults(train, objective, speeds):
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


def _penalty_faults(train, penalty):
    known = [*QUANTITIES, *OF_DESIGN]
    if penalty.quantity not in known:
        return [f"there is no such quantity.{suggestion(penalty.quantity, known)}"]
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


def _element_faults(train, chosen):
    """Faults of ``of`` and ``order`` of an objective or penalty."""
    quantity = QUANTITIES[chosen.quantity]
    topology = train.topology
    kind = quantity.kind.removesuffix(" with backlash")
    elements, _, key = kind.partition(" with a ")
    names = {
        "mesh": topology.mesh_names,
        "shaft": topology.shaft_names,
        "shaft or damper": topology.shaft_and_damper_names,
        "gear": topology.gear_names,
        "disk": topology.disk_names,
    }[elements]
    keys = (key, "outer") if key == "diameter" else (key,)
    judged = (
        [
            name
            for table in elements.split(" or ")
            for name in having(topology, table, *keys)
        ]
        if key
        else names
    )
    if chosen.of in names and chosen.of not in judged:
        faults = [f"{chosen.of!r} has no {key}: give it one in the scene."]
    else:
        faults = _unknown(chosen.of, judged, kind)
    gaps = dict(zip(topology.mesh_names, topology.mesh_backlash, strict=True))
    if kind != quantity.kind and not gaps.get(chosen.of, True):
        faults.append(
            f"mesh {chosen.of!r} has no backlash, its teeth never part: give it one, or"
            " take another."
        )
    if quantity.ordered != (chosen.order is not None):
        faults.append(
            "it needs an order." if quantity.ordered else "it takes no order."
        )
    elif quantity.ordered:
        harmonic = chosen.order * topology.revolutions_per_cycle
        if not harmonic > 0 or abs(harmonic - round(harmonic)) > 1e-9:
            least = 1 / topology.revolutions_per_cycle
            faults.append(
                f"order {chosen.order:g} is no harmonic of the cycle: use a positive"
                f" multiple of {least:g}."
            )
    return faults


def _unknown(name, names, kind):
    if name in names:
        return []
    if name is None:
        return [f"of is missing: name a {kind}."]
    return [f"there is no {kind} {name!r}.{suggestion(name, names)}"]
