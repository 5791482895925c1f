"""The lightly loaded pair at 15 speeds: what it does upwards, downwards and from
anywhere, event-exact.

``python benchmarks/lightly_loaded.py`` writes ``tests/data/lightly_loaded_pair.json``;
units are those of :mod:`event_exact`, exponents and impacts are per cycle of the
excitation. For a stiffness ratio epsilon in the gap of 0 and of 1e-3 (the default of a
scene) and each speed:

    attractors : motions in the long run, those of the sweeps and those from a grid of
    25 starts (``starts`` of them
        each), with the cycles marched until the state returned within 1e-9, median and
        most: transients may be long
    orbits : the motions of one cycle that Newton's method finds from a grid of starts,
    stable or not up, down : which of them a sweep is on that begins at rest on the
    flank, goes up, and then down again

Beside an irregular motion the sweep hands on a point of it, and if several motions
exist at the next speed it is chance to which it leads: then another exact integration
may be on another of the attractors. ``largest_over`` n cycles : 5 %, 50 % and 95 % of
the largest x over n successive cycles of the record.
"""

import json
from pathlib import Path

import numpy as np
from event_exact import Pair, long_run, multipliers, orbit

SPEEDS = tuple(round(0.2 + 0.1 * j, 1) for j in range(15))
"""Over the natural frequency."""

TABLE = Path(__file__).parents[1] / "tests" / "data" / "lightly_loaded_pair.json"


def sweep(pairs, state, **lengths):
    """The motion of each pair in this order, each from where its neighbour ended."""
    motions = []
    for pair in pairs:
        motions.append(long_run(pair, state, **lengths))
        state = motions[-1].state
    return motions


def up_and_down(pairs, **lengths):
    """Motions upwards from rest on the flank, and from there downwards; both in the
    order of the pairs.
    """
    up = sweep(pairs, (1 + pairs[0].mean, 0.0), **lengths)
    return up, sweep(pairs[::-1], up[-1].state, **lengths)[::-1]


def lightly_loaded(epsilon=0.0):
    """The pair at each of the speeds."""
    return [Pair(speed, epsilon=epsilon) for speed in SPEEDS]


def from_a_grid(pair, points, **lengths):
    """The motions from ``points`` x ``points`` starts over |x| < 3, |x'| < 2."""
    grid = [
        (x, v)
        for x in np.linspace(-2.9, 3.0, points)
        for v in np.linspace(-1.9, 2.0, points)
    ]
    return [long_run(pair, start, **lengths) for start in grid]


def orbits_of_one_cycle(pair):
    """The motions of one cycle, stable or not, as numbers for the table."""
    starts = [(x, v) for x in np.linspace(-4, 4, 9) for v in np.linspace(-3, 3, 5)]
    found = [one for (one,) in filter(None, (orbit(pair, start) for start in starts))]
    different = {round(one.maximum, 6): one for one in reversed(found)}
    return [
        {
            "minimum": one.minimum,
            "maximum": one.maximum,
            "state": one.state,
            "multipliers": pairs(multipliers([one])),
        }
        for _, one in sorted(different.items())
    ]


def pairs(values):
    """Complex numbers as [real, imaginary]."""
    return [[complex(value).real, complex(value).imag] for value in values]


def label(motion):
    """Two motions are the same if this is; all that have no period count as one."""
    return motion.period and (
        motion.period,
        round(motion.maximum, 6),
        round(motion.minimum, 6),
    )


def largest_over(peaks, cycles):
    """5 %, 50 % and 95 % of the largest of ``cycles`` successive peaks."""
    whole = len(peaks) // cycles * cycles
    return np.percentile(
        np.reshape(peaks[:whole], (-1, cycles)).max(axis=1), [5, 50, 95]
    ).tolist()


def described(motion, starts, marched):
    """One attractor as numbers for the table; ``marched`` holds the cycles after which
    each march was on it.
    """
    cycles = motion.cycles
    numbers = {
        "kind": motion.kind,
        "period": motion.period,
        "minimum": motion.minimum,
        "maximum": motion.maximum,
        "state": motion.state,
        "separated": float(np.mean([one.separated for one in cycles])),
        "reverse": float(np.mean([one.reverse for one in cycles])),
        "impacts": float(np.mean([one.impacts for one in cycles])),
        "lyapunov_exponent": motion.exponent,
        "starts": starts,
        "marched": [int(np.median(marched)), max(marched)],
    }
    if motion.period:
        return numbers | {"multipliers": pairs(multipliers(cycles))}
    windows = [n for n in (1, 64, 256, 1024, 4096) if n <= len(cycles)]
    most = [one.maximum for one in cycles]
    least = [-one.minimum for one in cycles]
    return numbers | {
        "record": len(cycles),
        "largest_over": {str(n): largest_over(most, n) for n in windows},
        "smallest_over": {
            str(n): [-value for value in largest_over(least, n)] for n in windows
        },
    }


def tabulated(pairs, points=5, record=16384):
    """The rows of the table, one per speed."""
    rows = []
    for pair, up, down in zip(pairs, *up_and_down(pairs, record=record), strict=True):
        others = from_a_grid(pair, points, record=512)
        motions = [up, down, *others]
        labels = [label(motion) for motion in motions]
        order = sorted(set(labels), key=labels.index)
        attractors = []
        for key in order:
            marched = [motion.marched for motion in motions if label(motion) == key]
            attractors.append(
                described(motions[labels.index(key)], labels[2:].count(key), marched)
            )
        directions = {"up": 0, "down": order.index(labels[1])}
        orbits = orbits_of_one_cycle(pair)
        rows.append(
            {
                "speed": pair.frequency,
                "attractors": attractors,
                **directions,
                "orbits": orbits,
            }
        )
    return rows


def main():
    table = {
        "note": (
            "What a lightly loaded pair of gears does; made by"
            " benchmarks/lightly_loaded.py, which says more."
        ),
        **{
            name: getattr(Pair(1.0), name)
            for name in ("damping_ratio", "mean", "alternating")
        },
        "laws": [
            {"epsilon": epsilon, "rows": tabulated(lightly_loaded(epsilon))}
            for epsilon in (0.0, 1e-3)
        ],
    }
    TABLE.write_text(json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main()
