"""What is only known within limits: the ``[tolerance]`` table of a scene, and the range
that it spans.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import hadamard

from jaxhb._jax import namespace
from jaxhb.design.evaluation import Task
from jaxhb.design.quantities import own_value
from jaxhb.elements.elements import SceneError, shown, suggestion
from jaxhb.elements.value_checks import number_like
from jaxhb.train.drivetrain import DriveTrain

# Standard deviations to either side that the range of a ``std`` spans: 99.7 % of all
DEVIATIONS = 3.0
EXPLORED = 4  # corners from which searches may begin, a power of 2
KEYS = "range", "share", "std", "together"
NUMBERS_ONLY = "give tolerances of numbers only."


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """How far a number of the train may be from what the scene says.

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
    """The :class:`Tolerance` of every entry of the ``[tolerance]`` table of a scene.

    ``"NAME.FIELD" = { range = [low, high] }``, ``{ share = 0.15 }`` of the train's own
    value to either side, or ``{ std = ... }``, of which the range is three to either
    side; and ``together = ["NAME.FIELD", ...]``. :class:`SceneError` tells no table,
    unknown names and keys, and ranges that are empty, reversed or without the own
    value, one sentence each, all at once.
    """
    table = train.tolerance
    where = train.topology.title
    if not table:
        raise SceneError(
            f'{where}: the scene has no [tolerance] table. Write one, "NAME.FIELD" = {{'
            " share = 0.1 }."
        )
    if not isinstance(table, dict):
        raise SceneError(
            f"{where}: 'tolerance' is a list of tables, must be one. Write [tolerance]."
        )
    found = []
    faults = []
    for name, entry in _entries(table):
        wrong = []
        one = _tolerance(train, name, entry, wrong)
        faults += [f"{where}, [tolerance] {name!r}: {text}" for text in wrong]
        found += [] if wrong else [one]
    if faults:
        raise SceneError(faults)
    check_tolerances(train, found)
    return tuple(found)


def _entries(table, before=""):
    """(name, entry) of all, whether names are quoted or, as TOML has dotted keys,
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


def _tolerance(train, name, entry, faults):
    """The :class:`Tolerance` of an entry; what is wrong with it goes to ``faults``."""
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
    given = [key for key in KEYS[:3] if key in entry]
    if len(given) != 1:
        faults.append(
            f"{' and '.join(given) or 'no range'} is given, must be one of range, share"
            " and std."
        )
        return None
    (key,) = given
    together = entry.get("together", [])
    if not isinstance(together, list) or not all(
        isinstance(other, str) for other in together
    ):
        faults.append(f"together is {shown(together)}, must be a list of 'NAME.FIELD'.")
        together = []
    value = entry[key]
    own = own_value(train, name, NUMBERS_ONLY, faults)
    if key == "range":
        if not (
            isinstance(value, list) and len(value) == 2 and all(map(number_like, value))
        ):
            faults.append(f"range is {shown(value)}, must be two numbers [low, high].")
        return (
            None
            if faults
            else Tolerance(
                name=name, low=value[0], high=value[1], together=tuple(together)
            )
        )
    if not (number_like(value) and value > 0):
        faults.append(f"{key} is {shown(value)}, must be a number greater than 0.")
    if faults:
        return None
    half = abs(own) * value if key == "share" else DEVIATIONS * value
    std = {"std": float(value)} if key == "std" else {}
    return Tolerance(
        name=name, low=own - half, high=own + half, together=tuple(together), **std
    )


def check_tolerances(train, tolerances):
    """Refuse tolerances that no train has: one sentence for each fault, all at once."""
    where = train.topology.title
    faults = []
    names = [name for one in tolerances for name in (one.name, *one.together)]
    if not tolerances:
        faults.append(f"{where}: there is no tolerance: give at least one.")
    twice = sorted({name for name in names if names.count(name) > 1})
    faults += [
        f"{where}: {name!r} has two tolerances: leave one out." for name in twice
    ]
    for one in tolerances:
        texts = []
        own = {
            name: own_value(train, name, NUMBERS_ONLY, texts)
            for name in (one.name, *one.together)
        }
        value = own[one.name]
        if not texts and not (
            np.isfinite(one.low) and np.isfinite(one.high) and one.low < one.high
        ):
            texts.append(
                f"its range is {one.low:g} to {one.high:g}, must be finite, low less"
                " than high."
            )
        elif not texts and not one.low <= value <= one.high:
            texts.append(
                f"its value {value:g} lies outside its range {one.low:g} to"
                f" {one.high:g}: widen the range."
            )
        elif not texts and one.together and not value:
            texts.append(
                "its value is 0, which no other can have a ratio to: leave out"
                " together."
            )
        for end in (one.low, one.high) if not texts else ():
            try:
                train.replace(
                    {one.name: end}
                    | {name: own[name] * end / value for name in one.together}
                )
            except SceneError as error:
                texts += [
                    f"at the end {end:g} of its range: {sentence}"
                    for sentence in error.sentences
                ]
        faults += [f"{where}, tolerance {one.name!r}: {text}" for text in texts]
    if faults:
        raise SceneError(faults)


@dataclass(frozen=True)
class Box(Task):
    """Tolerances as the numbers of a :class:`Task`: shares u ``(P,)`` from -1 to 1.

    own : of every parameter its value and those of the numbers together with it, by
    name
    """

    own: tuple = ()
    # Of one speed a maximum over the cycle has a slope nearly everywhere, and the
    # search wants its own
    smooth = False
    step_tolerance = 1e-4  # enough to know the way up

    def named(self, z):
        xp = namespace(z)
        found = {}
        for k, (one, ((_, value), *others)) in enumerate(
            zip(self.parameters, self.own, strict=True)
        ):
            found[one.name] = number = (one.high + one.low) / 2 + z[k] * (
                one.high - one.low
            ) / 2
            found |= {name: own * number / value for name, own in others}
        return (
            found
            if xp is not np
            else {name: float(number) for name, number in found.items()}
        )

    def scaled(self, train, z):
        """Numbers of a train in the ratio that those of shares ``(P,)`` have to the
        box's own.
        """
        numbers = self.named(z)
        own = dict(pair for several in self.own for pair in several)
        return {
            name: train.value(name) * (number / own[name])
            for name, number in numbers.items()
        }

    def unbounded(self, train):
        return self.shares(np.array([value for (_, value), *_ in self.own]))

    def shares(self, values):
        """Shares u of numbers ``(..., P)``."""
        low, high = np.array([(one.low, one.high) for one in self.parameters]).T
        return (2 * values - high - low) / (high - low)

    def corners(self, seed):
        """``(EXPLORED, P)`` shares, -1 or 1: a two-level design, in which every number
        is at both ends as often and no two of the first seven vary alike.
        """
        rng = np.random.default_rng(seed)
        columns = hadamard(EXPLORED)[:, 1:]
        more = -(-len(self.parameters) // columns.shape[1]) - 1
        shuffled = [rng.permuted(columns, axis=0) for _ in range(more)]
        return np.concatenate([columns, *shuffled], axis=1)[
            :, : len(self.parameters)
        ].astype(float)

    def sample(self, count, seed):
        """``(count, P)`` shares: a Latin hypercube of uniform and, where a standard
        deviation is given, normal ones.
        """
        from scipy.stats import (
            norm,
            qmc,
        )  # a third of a second, which commands without samples are spared

        points = qmc.LatinHypercube(
            len(self.parameters), rng=np.random.default_rng(seed)
        ).random(count)
        for k, (one, ((_, value), *_)) in enumerate(
            zip(self.parameters, self.own, strict=True)
        ):
            if one.std:
                ends = norm.cdf((np.array([one.low, one.high]) - value) / one.std)
                points[:, k] = value + one.std * norm.ppf(
                    ends[0] + points[:, k] * (ends[1] - ends[0])
                )
            else:
                points[:, k] = one.low + points[:, k] * (one.high - one.low)
        return self.shares(points)


def box_of(train, tolerances, of):
    """The :class:`Box` of a train whose responses are Objectives."""
    own = tuple(
        tuple((n, float(train.value(n))) for n in (one.name, *one.together))
        for one in tolerances
    )
    return Box(tuple(tolerances), tuple(of), (), own)
