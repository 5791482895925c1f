"""Numbers that are only known within limits: the ``[tolerance]`` table of a scene, and
the range that it spans.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import hadamard

from jaxhb._jax import Array, Number, namespace
from jaxhb.design.quantities import Objective, own_value
from jaxhb.design.task import Task
from jaxhb.elements.sentences import SceneError, shown, suggestion
from jaxhb.elements.units import Refused, si_number
from jaxhb.elements.values import number_like
from jaxhb.train.changes import in_si
from jaxhb.train.drivetrain import DriveTrain

# Standard deviations to either side that the range of a ``std`` spans: 99.7 % of all
DEVIATIONS = 3.0
EXPLORED = 4  # corners from which searches may begin, a power of 2
KEYS = "range", "share", "std", "together"
NUMBERS_ONLY = "give tolerances of numbers only."


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """The range of a number of the train about its value in the scene.

    Parameters
    ----------
    name : str
        ``"NAME.FIELD"`` as in :meth:`jaxhb.DriveTrain.replace`.
    low, high : float
        The range, in the unit of the scene format, with the train's own value in it.
    std : float, optional
        Standard deviation, where samples are normal (cut off at the range) and not
        uniform.
    together : tuple of str
        Other numbers that have the same ratio to their own values as this one has.
    """

    name: str
    low: float
    high: float
    std: float | None = None
    together: tuple = ()


def read_tolerances(train: DriveTrain) -> tuple[Tolerance, ...]:
    """Read the :class:`Tolerance` of every entry of the ``[tolerance]`` table of a
    scene.

    ``"NAME.FIELD" = { range = [low, high] }``, ``{ share = 0.15 }`` of the train's own
    value to either side, or ``{ std = ... }``, of which the range is three to either
    side; and ``together = ["NAME.FIELD", ...]``. :class:`SceneError` tells no table,
    unknown names and keys, and ranges that are empty, reversed or without the own
    value, one sentence each, all at once.
    """
    table = train.tolerance
    title = train.topology.title
    if not table:
        raise SceneError(
            f'{title}: the scene has no [tolerance] table. Write one, "NAME.FIELD" = {{'
            " share = 0.1 }."
        )
    if not isinstance(table, dict):
        raise SceneError(
            f"{title}: 'tolerance' is a list of tables, must be one. Write [tolerance]."
        )
    tolerances: list[Tolerance] = []
    faults: list[str] = []
    for name, entry in _entries(table):
        sentences: list = []
        tolerance = _tolerance(train, name, entry, sentences)
        faults += [
            f"{title}, [tolerance] {name!r}: {sentence}" for sentence in sentences
        ]
        if tolerance is not None:
            tolerances.append(tolerance)
    if faults:
        raise SceneError(faults)
    check_tolerances(train, tolerances)
    return tuple(tolerances)


def _entries(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (name, entry) of all, whether names are quoted or, as TOML has dotted keys,
    nested tables.
    """
    for key, entry in table.items():
        name = f"{before}{key}"
        nested = (
            isinstance(entry, dict)
            and entry
            and all(isinstance(inner, dict) for inner in entry.values())
        )
        yield from _entries(entry, f"{name}.") if nested else [(name, entry)]


def _tolerance(
    train: DriveTrain, name: str, entry: Any, faults: list[str]
) -> Tolerance | None:
    """Read the :class:`Tolerance` of an entry; sentences go to ``faults``, and there is
    none.
    """
    if not isinstance(entry, dict):
        faults.append(
            f"is {shown(entry)}, must be a table as {{ share = 0.1 }} or {{ range ="
            " [low, high] }."
        )
        return None
    faults += [
        f"unknown key {key!r}.{suggestion(key, KEYS)}"
        for key in entry
        if key not in KEYS
    ]
    range_keys = [key for key in KEYS[:3] if key in entry]
    if len(range_keys) != 1:
        faults.append(
            f"{' and '.join(range_keys) or 'no range'} is given, must be one of range,"
            " share and std."
        )
        return None
    (key,) = range_keys
    together = entry.get("together", [])
    if not isinstance(together, list) or not all(
        isinstance(other, str) for other in together
    ):
        faults.append(f"together is {shown(together)}, must be a list of 'NAME.FIELD'.")
        together = []
    value = entry[key]
    if key == "share":
        value = si_number(value, "")
    else:
        value = in_si(train.topology, {name: value})[name]
    for number in value if isinstance(value, list) else [value]:
        if isinstance(number, Refused):
            faults.append(f"{key} is {shown(number)}, {number.why}")
            return None
    nominal = own_value(train, name, NUMBERS_ONLY, faults)
    if key == "range":
        if not (
            isinstance(value, list) and len(value) == 2 and all(map(number_like, value))
        ):
            faults.append(f"range is {shown(value)}, must be two numbers [low, high].")
        if faults:
            return None
        return Tolerance(
            name=name, low=value[0], high=value[1], together=tuple(together)
        )
    if not (number_like(value) and value > 0):
        faults.append(f"{key} is {shown(value)}, must be a number greater than 0.")
    if faults:
        return None
    half = abs(nominal) * value if key == "share" else DEVIATIONS * value
    return Tolerance(
        name=name,
        low=nominal - half,
        high=nominal + half,
        std=float(value) if key == "std" else None,
        together=tuple(together),
    )


def check_tolerances(train: DriveTrain, tolerances: Sequence[Tolerance]) -> None:
    """Refuse tolerances that no train has: one sentence for each fault, all at once."""
    title = train.topology.title
    faults = []
    names = [
        name
        for tolerance in tolerances
        for name in (tolerance.name, *tolerance.together)
    ]
    if not tolerances:
        faults.append(f"{title}: there is no tolerance: give at least one.")
    twice = sorted({name for name in names if names.count(name) > 1})
    faults += [
        f"{title}: {name!r} has two tolerances: leave one out." for name in twice
    ]
    for tolerance in tolerances:
        sentences: list[str] = []
        nominal = {
            name: own_value(train, name, NUMBERS_ONLY, sentences)
            for name in (tolerance.name, *tolerance.together)
        }
        value = nominal[tolerance.name]
        if not sentences and not (
            np.isfinite(tolerance.low)
            and np.isfinite(tolerance.high)
            and tolerance.low < tolerance.high
        ):
            sentences.append(
                f"its range is {tolerance.low:g} to {tolerance.high:g}, must be finite,"
                " low less than high."
            )
        elif not sentences and not tolerance.low <= value <= tolerance.high:
            sentences.append(
                f"its value {value:g} lies outside its range {tolerance.low:g} to"
                f" {tolerance.high:g}: widen the range."
            )
        elif not sentences and tolerance.together and not value:
            sentences.append(
                "its value is 0, which no other can have a ratio to: leave out"
                " together."
            )
        ends = () if sentences else (tolerance.low, tolerance.high)
        for end in ends:
            try:
                train.replace(
                    {tolerance.name: end}
                    | {name: nominal[name] * end / value for name in tolerance.together}
                )
            except SceneError as error:
                sentences += [
                    f"at the end {end:g} of its range: {sentence}"
                    for sentence in error.sentences
                ]
        faults += [
            f"{title}, tolerance {tolerance.name!r}: {sentence}"
            for sentence in sentences
        ]
    if faults:
        raise SceneError(faults)


@dataclass(frozen=True)
class Box(Task):
    """Tolerances as the numbers of a :class:`Task`: shares u ``(P,)`` from -1 to 1.

    nominal : the value of every parameter in the train, and those of the numbers
    together with it, by name
    """

    nominal: tuple[tuple[tuple[str, float], ...], ...] = ()
    # Of one speed a maximum over the cycle has a slope nearly everywhere, and the
    # search wants its own
    smooth = False
    step_tolerance = 1e-4  # enough to know the way up

    def named(self, z: Array) -> dict[str, Any]:
        xp = namespace(z)
        numbers = {}
        for k, (tolerance, ((_, value), *companions)) in enumerate(
            zip(self.parameters, self.nominal, strict=True)
        ):
            low = tolerance.low
            high = tolerance.high
            number = (high + low) / 2 + z[k] * (high - low) / 2
            numbers[tolerance.name] = number
            numbers |= {name: nominal * number / value for name, nominal in companions}
        if xp is not np:
            return numbers
        return {name: float(number) for name, number in numbers.items()}

    def scaled(self, train: DriveTrain, z: Array) -> dict[str, Number]:
        """Scale numbers of a train in the ratio that those of shares ``(P,)`` have to
        the box's own.
        """
        numbers = self.named(z)
        nominal = dict(pair for group in self.nominal for pair in group)
        return {
            name: train.value(name) * (number / nominal[name])
            for name, number in numbers.items()
        }

    def unbounded(self, train: DriveTrain) -> np.ndarray:
        return self.shares(np.array([value for (_, value), *_ in self.nominal]))

    def shares(self, values: np.ndarray) -> np.ndarray:
        """Shares u ``(..., P)`` of numbers ``(..., P)``."""
        low, high = np.array(
            [(tolerance.low, tolerance.high) for tolerance in self.parameters]
        ).T
        return (2 * values - high - low) / (high - low)

    def corners(self, seed: int) -> np.ndarray:
        """``(EXPLORED, P)`` shares, -1 or 1: a two-level design, in which every number
        is at both ends as often and no two of the first seven vary alike.
        """
        rng = np.random.default_rng(seed)
        columns = hadamard(EXPLORED)[:, 1:]
        repeats = -(-len(self.parameters) // columns.shape[1]) - 1
        shuffled = [rng.permuted(columns, axis=0) for _ in range(repeats)]
        return np.concatenate([columns, *shuffled], axis=1)[
            :, : len(self.parameters)
        ].astype(float)

    def sample(self, count: int, seed: int) -> np.ndarray:
        """``(count, P)`` shares: a Latin hypercube of uniform and, where a standard
        deviation is given, normal ones.
        """
        # A third of a second, which commands without samples are spared.
        from scipy.stats import norm, qmc

        points = qmc.LatinHypercube(
            len(self.parameters), rng=np.random.default_rng(seed)
        ).random(count)
        for k, (tolerance, ((_, value), *_)) in enumerate(
            zip(self.parameters, self.nominal, strict=True)
        ):
            if tolerance.std:
                ends = norm.cdf(
                    (np.array([tolerance.low, tolerance.high]) - value) / tolerance.std
                )
                points[:, k] = value + tolerance.std * norm.ppf(
                    ends[0] + points[:, k] * (ends[1] - ends[0])
                )
            else:
                points[:, k] = tolerance.low + points[:, k] * (
                    tolerance.high - tolerance.low
                )
        return self.shares(points)


def box_of(
    train: DriveTrain, tolerances: Sequence[Tolerance], of: Sequence[Objective]
) -> Box:
    """Make the :class:`Box` of a train whose responses are Objectives."""
    nominal = tuple(
        tuple(
            (name, float(train.value(name)))
            for name in (tolerance.name, *tolerance.together)
        )
        for tolerance in tolerances
    )
    return Box(tuple(tolerances), tuple(of), (), nominal)


@dataclass(frozen=True)
class Scatter:
    """Further lanes of an evaluation: the train within a :class:`Box` at the shares
    ``(n, P)`` of each speed ``(n,)``, in ratios to the values of a design.
    """

    box: Box
    shares: np.ndarray


def moved(
    tolerances: Sequence[Tolerance], before: DriveTrain, after: DriveTrain
) -> tuple[Tolerance, ...]:
    """Move the ranges of tolerances in the ratio that the numbers of a design have to
    those of the train before.
    """
    ratios = (
        float(after.value(tolerance.name)) / float(before.value(tolerance.name))
        for tolerance in tolerances
    )
    return tuple(
        dataclasses.replace(
            tolerance,
            low=tolerance.low * ratio,
            high=tolerance.high * ratio,
            std=tolerance.std and tolerance.std * ratio,
        )
        for tolerance, ratio in zip(tolerances, ratios, strict=True)
    )


def moved_ranges(
    train: DriveTrain, values: Mapping[str, float]
) -> dict[str, dict[str, Any]]:
    """Entries of ``[tolerance]`` with a range of numbers that a tuning gave other
    ``values``, in their ratio and in the unit of the scene format. Ranges that are no
    numbers stay: :func:`read_tolerances` tells their faults.
    """
    ranges = {}
    for name, entry in _entries(train.tolerance):
        value = float(train.value(name)) if name in values else 0.0
        ends = entry.get("range") if isinstance(entry, dict) else None
        if not value or not isinstance(ends, list):
            continue
        ends = in_si(train.topology, {name: ends})[name]
        if all(map(number_like, ends)):
            ranges[name] = entry | {
                "range": [end * values[name] / value for end in ends]
            }
    return ranges
