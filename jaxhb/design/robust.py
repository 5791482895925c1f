"""Tuning for a train whose numbers are only known within limits: the worst case, or
what 95 of 100 trains stay below.

Trains within the tolerances are further lanes of a tuning, each at one speed. For the
worst case they are found, and added, by searches at the best design so far (cutting
planes); for 95 % they are twenty of a sample, whose largest response is on average what
95 % stay below.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb._shown import brief
from jaxhb.design.quantities import Objective
from jaxhb.design.tolerances import Box, Tolerance, box_of
from jaxhb.design.worst_case import Spread, tolerance as search
from jaxhb.elements.sentences import SceneError
from jaxhb.results.checkpoint import Cached, place_in
from jaxhb.train.drivetrain import DriveTrain

if TYPE_CHECKING:
    from jaxhb.design.tuning import Tuning

KINDS = "worst", "p95"
ROUNDS = 4  # searches for worse trains, each followed by a tuning
# Share of the worst response by which no search finds more: the design is the best
# against all trains
SLACK = 0.01
SAMPLE = 20  # trains of a sample tuned against
CHECKED = 100  # trains of the fresh sample that designs are compared on


@brief
@dataclass(frozen=True)
class Robustness:
    """Comparison of a robust tuning with others, over the tolerances.

    kind : "worst" or "p95"; nominal : Tuning of the scene's own numbers, from which the
    robust one began; spreads : ``{design: Spread}`` of the scene, the nominal and the
    robust design, with a fresh sample
    """

    kind: str
    nominal: Tuning
    spreads: dict[str, Spread]


@dataclass(frozen=True)
class Scatter:
    """Further lanes of an evaluation: the train within a
    :class:`~jaxhb.design.tolerances.Box` at the shares ``(n, P)`` of each speed
    ``(n,)``, in ratios to the values of a design.
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
    ``values``, in their ratio.
    """
    ranges = {}
    for name, entry in train.tolerance.items():
        value = float(train.value(name)) if name in values else 0.0
        if value and isinstance(entry, dict) and isinstance(entry.get("range"), list):
            ranges[name] = entry | {
                "range": [end * values[name] / value for end in entry["range"]]
            }
    return ranges


def check_robust(
    train: DriveTrain, kind: str, tolerances: Sequence[Tolerance], peaks: int
) -> None:
    """Refuse a tuning that cannot be robust, one sentence a fault."""
    title = train.topology.title
    faults = []
    if kind not in KINDS:
        faults.append(f"{title}: robust is {kind!r}, must be 'worst' or 'p95'.")
    if peaks:
        faults.append(
            f"{title}: robust tunings follow no peaks: leave out peaks, or robust."
        )
    zero = [
        name
        for tolerance in tolerances
        for name in (tolerance.name, *tolerance.together)
        if not float(train.value(name))
    ]
    faults += [
        f"{title}: the tolerance {name!r} is of a value of 0, which has no ratio: leave"
        " it out."
        for name in zero
    ]
    if faults:
        raise SceneError(faults)


def tune_robust(
    train: DriveTrain,
    rpm: np.ndarray,
    objectives: Sequence[Objective],
    tolerances: Sequence[Tolerance],
    kind: str,
    seed: int,
    tune_lanes: Callable[
        [DriveTrain, np.ndarray, Scatter | None], tuple[Tuning, np.ndarray]
    ],
    *,
    out: str | Path | Cached | None = None,
    harmonics: int | None,
    tolerance: float,
) -> Tuning:
    """Tune for the worst case or the 95th percentile. ``tune_lanes(train, speeds,
    scatter)`` makes a Tuning with lanes at indices ``speeds`` of ``rpm``, and the
    largest response to each objective ``(Q,)`` of all its lanes.
    """
    all_speeds = np.arange(len(rpm))
    box = box_of(train, tolerances, objectives)
    shares = np.repeat(box.unbounded(train)[None], len(all_speeds), axis=0)
    searches = itertools.count()

    def spread_of(design: DriveTrain, samples: int = 0) -> Spread:
        return search(
            design,
            rpm=rpm,
            of=objectives,
            tolerances=moved(tolerances, train, design),
            samples=samples,
            seed=seed + 1,
            harmonics=harmonics,
            tolerance=tolerance,
            bounds=False,
            out=place_in(out, f"search {next(searches)}"),
        )

    nominal, largest = tune_lanes(train, all_speeds, None)
    if nominal.interrupted:
        return nominal
    design = best = nominal
    if kind == "p95":
        speeds = np.concatenate([all_speeds, np.repeat(all_speeds, SAMPLE)])
        drawn = np.tile(box.sample(SAMPLE, seed), (len(all_speeds), 1))
        scatter = Scatter(box, np.concatenate([shares, drawn]))
        design, _ = tune_lanes(nominal.train, speeds, scatter)
        best = design
    else:
        speeds = all_speeds
        weights = np.array([objective.weight for objective in objectives])
        least = np.inf
        sizes = None
        for number in range(1, ROUNDS + 1):
            spread = spread_of(design.train)
            worst = np.nanmax(spread.worst, axis=0)
            # Of the nominal optimum: the sum is of shares of them.
            sizes = worst if sizes is None else sizes
            value = float((weights * worst / sizes).sum())
            if value < least:
                best = design
                least = value
            if number == ROUNDS or (
                number > 1 and (worst <= (1 + SLACK) * largest).all()
            ):
                break
            speed, objective = np.nonzero(np.isfinite(spread.worst))
            speeds = np.concatenate([speeds, speed])
            shares = np.concatenate([shares, spread.shares[speed, objective]])
            design, largest = tune_lanes(design.train, speeds, Scatter(box, shares))
            if design.interrupted:
                break
    if design.interrupted:  # who stops a tuning does not wait for more
        return dataclasses.replace(best, before=nominal.before, interrupted=True)
    designs = {
        "as it is": train,
        "nominal optimum": nominal.train,
        "robust": best.train,
    }
    spreads = {
        name: spread_of(candidate, CHECKED) for name, candidate in designs.items()
    }
    return dataclasses.replace(
        best, before=nominal.before, robust=Robustness(kind, nominal, spreads)
    )
