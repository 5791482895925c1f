"""Linear forced response: 1000 speeds x 24 orders of a branched train of 30 disks beside batched numpy; long chains.

    taskset -c 0 python benchmarks/linear_speed.py [--repeats 9] [--json F]      a minute

Seconds are medians over the repeats, without compilation, on the cores that the process may use. "apart" is the largest
difference of an angle over the largest angle; the dense solution is refined in extended precision to tell which of the
two is nearer. The chain is free at both ends, 64 harmonics at one speed; its build and first call are timed as well.
"""

import argparse
import json
import os
import statistics
import time
from pathlib import Path

import numpy as np
from branched_thirty import branched_thirty, numpy_angles

import jaxhb

DATA = Path(__file__).parents[1] / "tests" / "data" / "branched_30_disk_linear.json"
SIZES = 5000, 10_000, 20_000, 40_000


def seconds(call, repeats):
    """What a call returns, seconds of the first one, median and spread of the others."""
    times = []
    for _ in range(repeats + 1):
        begin = time.perf_counter()
        found = call()
        times.append(time.perf_counter() - begin)
    return found, times[0], statistics.median(times[1:]), (min(times[1:]), max(times[1:]))


def balance(response):
    """Largest share of the power brought in that the elements do not turn into heat."""
    heat = response.disk_power.sum(-1) + response.link_power.sum(-1)
    return float(np.max(np.abs(heat / response.input_power - 1)))


def sweep(repeats):
    """The row of the sweep."""
    data = json.loads(DATA.read_text())
    train, rpm = branched_thirty(data), np.linspace(*data["speeds"])
    found, first, median, spread = seconds(lambda: jaxhb.forced_response(train, rpm=rpm), repeats)
    dense, _, numpy_median, numpy_spread = seconds(lambda: numpy_angles(train, rpm), 3)
    refined = numpy_angles(train, rpm, refinements=3)
    largest = np.abs(refined).max()
    return {
        "task": "1000 speeds x 24 orders, 30 disks",
        "first_s": first,
        "seconds": median,
        "spread_s": spread,
        "numpy_s": numpy_median,
        "numpy_spread_s": numpy_spread,
        "apart": float(np.abs(found.angles[..., 1:] - dense).max() / largest),
        "error": float(np.abs(found.angles[..., 1:] - refined).max() / largest),
        "numpy_error": float(np.abs(dense - refined).max() / largest),
        "energy_balance": balance(found),
    }


def chain(disks, repeats):
    """The row of a free chain."""
    parts = [jaxhb.Disk(name=str(i), inertia=1.0, damping=0.01) for i in range(disks)]
    parts += [jaxhb.Shaft(between=(str(i), str(i + 1)), stiffness=1e6, damping=2.0) for i in range(disks - 1)]
    parts.append(jaxhb.Torque(disk="0", harmonics=[(float(n), 1.0 / n, 0.3) for n in range(1, 65)]))
    begin = time.perf_counter()
    train = jaxhb.build(parts, revolutions_per_cycle=1)
    built = time.perf_counter() - begin
    found, first, median, spread = seconds(lambda: jaxhb.forced_response(train, rpm=60.0), repeats)
    return {
        "task": f"free chain of {disks} disks, 64 harmonics",
        "build_s": built,
        "first_s": first,
        "seconds": median,
        "spread_s": spread,
        "residual": float(found.residual),
        "energy_balance": balance(found),
    }


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--repeats", type=int, default=9)
    arguments.add_argument("--json", metavar="F")
    asked = arguments.parse_args()
    rows = [sweep(asked.repeats), *(chain(disks, asked.repeats) for disks in SIZES)]
    for row in rows:
        numbers = (f"{key} {value:.3g}" for key, value in row.items() if isinstance(value, float))
        print(row["task"] + ": " + ", ".join(numbers))
    slope = np.polyfit(np.log(SIZES), np.log([row["seconds"] for row in rows[1:]]), 1)[0]
    print(f"seconds of the chain grow with its disks to the power {slope:.2f}")
    if asked.json:
        cores = len(os.sched_getaffinity(0))
        Path(asked.json).write_text(json.dumps({"cores": cores, "rows": rows, "power": slope}, indent=1) + "\n")


if __name__ == "__main__":
    main()
