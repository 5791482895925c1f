"""The lightly loaded pair at 15 speeds, up and down: ``steady_state`` and ``stability`` against event-exact motions.

    python benchmarks/pair_motions.py [--epsilon 0.001]      2 minutes

The exact motions are those of ``tests/data/lightly_loaded_pair.json`` (``tests/lightly_loaded.py`` says how they were
found), for a sharp dead zone; the train has a transition zone of 1 % of the backlash, 0.1 % where epsilon is 0. A speed
is right if its kind and period, and for periodic motion its extremes within 0.5 %, are those of a motion that the pair
has there in the long run; irregular motion has to reach 95 to 105 % of what the exact one reaches in as many cycles.
An orbit of ``solve`` is right if it is as stable as the nearest exact orbit of one cycle.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

import jaxhb

TESTS = Path(__file__).parents[1] / "tests"
sys.path.insert(0, str(TESTS))

from event_exact import Pair  # noqa: E402
from trains import pair_rpm, pair_train  # noqa: E402

EXTREMES, LARGEST = 0.005, 0.05


def table(epsilon):
    """Rows of the exact table, the train, and its speeds in rpm."""
    laws = json.loads((TESTS / "data" / "lightly_loaded_pair.json").read_text())["laws"]
    rows = next(law["rows"] for law in laws if law["epsilon"] == epsilon)
    pairs = [Pair(row["speed"], epsilon=epsilon) for row in rows]
    train = pair_train(pairs[0], transition=0.01 if epsilon else 0.001)
    return rows, train, np.array([pair_rpm(pair) for pair in pairs])


def is_motion(state, exact):
    """Whether a steady state is this exact motion."""
    deflection = state.deflection("a", "b")
    if "irregular" in (state.kind, exact["kind"]):
        if state.kind != exact["kind"]:
            return False
        low, _, high = exact["largest_over"]["64"] if "largest_over" in exact else [exact["maximum"]] * 3
        return (1 - LARGEST) * low <= deflection.max <= (1 + LARGEST) * high
    found, wanted = (
        np.array(pair) for pair in ((deflection.max, deflection.min), (exact["maximum"], exact["minimum"]))
    )
    size = np.abs(wanted).max()
    return state.period == exact["period"] and bool(np.all(np.abs(found - wanted) <= EXTREMES * size))


def main():
    read = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    read.add_argument("--epsilon", type=float, default=1e-3, choices=(0.0, 1e-3))
    rows, train, rpm = table(read.parse_args().epsilon)
    begin = time.perf_counter()
    sweeps = jaxhb.steady_state(train, rpm=rpm, direction="both", tolerance=1e-3)
    seconds, right = time.perf_counter() - begin, 0
    for i, row in enumerate(rows):
        for sweep in sweeps:
            state = sweep[i]
            good = any(is_motion(state, exact) for exact in row["attractors"])
            right += good
            deflection = state.deflection("a", "b")
            said = f"{state.kind:11s} {state.period} {float(deflection.max):8.4f} {float(deflection.min):8.4f}"
            known = (f"{a['kind']} {a['period']} {a['maximum']:.4f} {a['minimum']:.4f}" for a in row["attractors"])
            verdict = "right" if good else "WRONG"
            print(f"{row['speed']:.1f} {sweep.direction:4s} {said}  {verdict}  exact: {'; '.join(known)}")
    print(f"{right} of {2 * len(rows)} right, {seconds:.0f} s with compilation")
    unstable = agree = 0
    for row, speed in zip(rows, rpm, strict=True):
        orbit = jaxhb.solve(train, rpm=speed, tolerance=1e-3)
        top = float(orbit.deflection("a", "b").max)
        exact = min(row["orbits"], key=lambda o, top=top: abs(o["maximum"] - top))
        multiplier = max((complex(*m) for m in exact["multipliers"]), key=abs)
        told = jaxhb.stability(orbit)
        unstable += not told.stable
        agree += told.stable == (abs(multiplier) <= 1)
        print(f"{row['speed']:.1f} orbit: {told.critical:.4f}, exact {multiplier:.4f}, {told.loses_by or 'stable'}")
    print(f"{unstable} orbits of solve are unstable, {agree} of {len(rows)} told right")


if __name__ == "__main__":
    main()
