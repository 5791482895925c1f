"""Tuning for a train whose numbers are only known within limits: the worst case, or
what 95 of 100 trains stay below.

Trains within the tolerances are further lanes of a tuning, each at one speed. For the
worst case they are found, and added, by searches at the best design so far (cutting
planes); for 95 % they are twenty of a sample, whose largest response is on average what
95 % stay below.
"""

import dataclasses
import itertools
from dataclasses import dataclass

import numpy as np

from jaxhb._shown import brief
from jaxhb.design.tolerances import box_of
from jaxhb.design.worst_case import tolerance as search
from jaxhb.elements.elements import SceneError
from jaxhb.results.checkpoint import place_in

KINDS = "worst", "p95"
ROUNDS = 4  # searches for worse trains, each followed by a tuning
# Share of the worst response by which no search finds more: the design is the best
# against all trains
SLACK = 0.01
SAMPLE, CHECKED = (
    20,
    100,
)  # trains of a sample tuned against, and of the fresh one that designs are compared on


@brief
@dataclass(frozen=True)
class Robustness:
    """What a robust tuning is compared with, over the tolerances.

    kind : "worst" or "p95"; nominal : Tuning of the scene's own numbers, from which the
    robust one began; spreads : ``{design: Spread}`` of the scene, the nominal and the
    robust design, with a fresh sample
    """

    kind: str
    nominal: object
    spreads: dict


@dataclass(frozen=True)
class Scatter:
    """Further lanes of an evaluation: the train within a
    :class:`~jaxhb.design.tolerances.Box` at the shares ``(n, P)`` of each speed
    ``(n,)``, in ratios to the values of a design.
    """

    box: object
    shares: np.ndarray

    def of_lanes(self, train):
        """The same for a train of which a number has another value: what changes is
        known from it.
        """
        return train.replace(
            self.box.scaled(train, np.full(len(self.box.parameters), 0.3))
        )


def moved(tolerances, before, after):
    """Tolerances of a design: ranges in the ratio that its numbers have to those of the
    train before.
    """
    ratios = (
        float(after.value(one.name)) / float(before.value(one.name))
        for one in tolerances
    )
    return tuple(
        dataclasses.replace(
            one,
            low=one.low * ratio,
            high=one.high * ratio,
            std=one.std and one.std * ratio,
        )
        for one, ratio in zip(tolerances, ratios, strict=True)
    )


def moved_ranges(train, values):
    """Entries of ``[tolerance]`` with a range of numbers that a tuning gave other
    ``values``, in their ratio.
    """
    found = {}
    for name, entry in train.tolerance.items():
        own = float(train.value(name)) if name in values else 0.0
        if own and isinstance(entry, dict) and isinstance(entry.get("range"), list):
            found[name] = entry | {
                "range": [end * values[name] / own for end in entry["range"]]
            }
    return found


def check_robust(train, kind, tolerances, peaks):
    """Refuse what cannot be robust, one sentence a fault."""
    where = train.topology.title
    faults = []
    if kind not in KINDS:
        faults.append(f"{where}: robust is {kind!r}, must be 'worst' or 'p95'.")
    if peaks:
        faults.append(
            f"{where}: robust tunings follow no peaks: leave out peaks, or robust."
        )
    zero = [
        name
        for one in tolerances
        for name in (one.name, *one.together)
        if not float(train.value(name))
    ]
    faults += [
        f"{where}: the tolerance {name!r} is of a value of 0, which has no ratio: leave"
        " it out."
        for name in zero
    ]
    if faults:
        raise SceneError(faults)


def tune_robust(
    train, rpm, given, tolerances, kind, seed, tuned, *, out=None, **accuracy
):
    """The robust Tuning. ``tuned(train, speeds, scatter)`` makes a Tuning with lanes at
    indices ``speeds`` of ``rpm``, and the largest response to each objective ``(Q,)``
    of all its lanes.
    """
    every = np.arange(len(rpm))
    box = box_of(train, tolerances, given)
    shares = np.repeat(box.unbounded(train)[None], len(every), axis=0)
    searches = itertools.count()

    def spread_of(design, samples=0):
        own = {
            "of": given,
            "tolerances": moved(tolerances, train, design),
            "samples": samples,
            "seed": seed + 1,
        }
        own["out"] = place_in(out, f"search {next(searches)}")
        return search(design, rpm=rpm, bounds=False, **own, **accuracy)

    nominal, largest = tuned(train, every, None)
    if nominal.interrupted:
        return nominal
    design = best = nominal
    if kind == "p95":
        at = np.repeat(every, SAMPLE)
        more = np.tile(box.sample(SAMPLE, seed), (len(every), 1))
        scatter = Scatter(box, np.concatenate([shares, more]))
        design = best = tuned(nominal.train, np.concatenate([every, at]), scatter)[0]
    else:
        speeds = every
        weights = np.array([one.weight for one in given])
        least = np.inf
        sizes = None
        for number in range(1, ROUNDS + 1):
            found = spread_of(design.train)
            worst = np.nanmax(found.worst, axis=0)
            sizes = (
                worst if sizes is None else sizes
            )  # of the nominal optimum: what is summed is shares of them
            value = float((weights * worst / sizes).sum())
            if value < least:
                best = design
                least = value
            if number == ROUNDS or (
                number > 1 and (worst <= (1 + SLACK) * largest).all()
            ):
                break
            at, j = np.nonzero(np.isfinite(found.worst))
            speeds = np.concatenate([speeds, at])
            shares = np.concatenate([shares, found.shares[at, j]])
            design, largest = tuned(design.train, speeds, Scatter(box, shares))
            if design.interrupted:
                break
    if design.interrupted:  # who stops a tuning does not wait for more
        return dataclasses.replace(best, before=nominal.before, interrupted=True)
    designs = {
        "as it is": train,
        "nominal optimum": nominal.train,
        "robust": best.train,
    }
    spreads = {said: spread_of(one, CHECKED) for said, one in designs.items()}
    return dataclasses.replace(
        best, before=nominal.before, robust=Robustness(kind, nominal, spreads)
    )
