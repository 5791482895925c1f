"""The eight folds of the chain of :mod:`chain_task`, followed from w = 1.30 to 0.70 at three limits of the steps.

    python benchmarks/folds.py --json benchmarks/results/folds.jsonl     one minute

15 harmonics, 240 samples of the law, one core. ``curve`` are the seconds of the branch alone, ``seconds`` those with
the stability and the loads of every point and with special points located, both with programs compiled. ``moved`` is
the largest relative change of a fold against the smallest limit, ``published`` the largest difference to the extremes
of sampled curves that other codes found.
"""

import argparse
import time

import numpy as np
from chain_task import published
from peers import chain_train, rpm_of
from records import Recorder, pin

import jaxhb
from jaxhb.solutions import continuation

LONGEST = (0.1, 0.05, 0.025)
COLUMNS = {
    "longest": "8.3f",
    "points": "7d",
    "jacobians": "10d",
    "curve": "8.2f",
    "seconds": "8.2f",
    "folds": "6d",
    "moved": "9.1e",
    "published": "10.1e",
}


def branch(longest):
    """The Branch, with steps of at most ``longest``."""
    options = jaxhb.BranchOptions(longest=longest)
    ends = {"start": float(rpm_of(1.30)), "to": float(rpm_of(0.70))}
    return jaxhb.follow(chain_train(3), "rpm", **ends, harmonics=15, tolerance=0.5, options=options)


def measured(longest):
    """Branch, seconds, seconds of the curve alone and its Jacobians."""
    found, follow = [], continuation.follow_curve

    def timed(*args, **options):
        begin = time.perf_counter()
        end = follow(*args, **options)
        found.append((time.perf_counter() - begin, end.jacobians))
        return end

    continuation.follow_curve = timed
    try:
        begin = time.perf_counter()
        result = branch(longest)
        return result, time.perf_counter() - begin, *found[0]
    finally:
        continuation.follow_curve = follow


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--core", type=int, default=0, help="the core to stay on; -1: any")
    parser.add_argument("--json", help="file for JSON lines")
    options = parser.parse_args()
    pin(options.core)
    recorder = Recorder("folds", options.json, COLUMNS)
    recorder.head()
    branch(LONGEST[0])
    rows = [(longest, *measured(longest)) for longest in LONGEST]
    finest, told = rows[-1][1].folds, published()["main_folds_w_S3"]
    for longest, result, seconds, curve, jacobians in rows:
        folds = result.folds
        recorder.add(
            longest=longest,
            points=len(result),
            jacobians=jacobians,
            curve=curve,
            seconds=seconds,
            folds=len(folds),
            moved=float(np.max(np.abs(folds / finest - 1))),
            published=float(np.max(np.abs(folds * 2 * np.pi / 60 - told))),
        )


if __name__ == "__main__":
    main()
