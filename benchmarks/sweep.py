"""A sweep over the range of an engine: ``solve_speeds`` against Runge-Kutta at every speed until it settles.

    python benchmarks/sweep.py [--speeds 300] [--json F] [--core 0]      7 minutes

``gear_train_30`` from 600 to 2450 rpm. ``solve_speeds`` runs twice: the first time compiles. Runge-Kutta takes the
fewest steps that are stable and marches from the motion with all teeth in contact until the tooth force of a cycle is
that of the one before within 1 %, or 100 cycles; only its steps count. A speed that does not settle has no answer.
"""

import argparse
import time
from collections import Counter

import numpy as np
from design_gradients import settled
from records import Recorder, pin

import jaxhb
from jaxhb.response.events import Shooting

COLUMNS = {"method": "<22s", "speeds": "7d", "answers": "8d", "apart": "6d", "seconds": "9.2f", "per_speed_ms": "13.2f"}
COLUMNS |= {"notes": "<40s"}


def swept(train, rpm):
    """The sweep, its seconds and those of its first run."""
    times = []
    for _ in range(2):
        begin = time.perf_counter()
        sweep = jaxhb.solve_speeds(train, rpm=rpm)
        times.append(time.perf_counter() - begin)
    return sweep, times[1], times[0]


def main(argv=None):
    """Read the command line and run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--speeds", type=int, default=300)
    parser.add_argument("--low", type=float, default=600.0, help="rpm")
    parser.add_argument("--high", type=float, default=2450.0, help="rpm")
    parser.add_argument("--core", type=int, default=0, help="the core to stay on; -1: any")
    parser.add_argument("--json", help="file for JSON lines")
    options = parser.parse_args(argv)
    pin(options.core)
    train, rpm = jaxhb.load_scene("gear_train_30"), np.linspace(options.low, options.high, options.speeds)
    recorder = Recorder("sweep", options.json, COLUMNS)
    recorder.head()
    sweep, seconds, first = swept(train, rpm)
    apart = sum(
        any(sweep[i].mesh(name).separated_fraction > 0 for name in train.topology.mesh_names) for i in range(len(rpm))
    )
    status = Counter(jaxhb.Status(int(s)).name for s in sweep.status)
    shot = sum(any(isinstance(event, Shooting) for event in path) for path in sweep.path)
    _row(recorder, "jaxhb", rpm, status["CONVERGED"], apart, seconds, f"first run {first:.0f} s, {shot} by shooting")
    settled(train, rpm[0], 1.0)  # compiles
    marches = [settled(train, speed, 1e-2)[0] for speed in rpm]
    good = [m for m in marches if m.periodicity_error <= 1e-2]
    cycles = np.median([m.cycles for m in good])
    _row(
        recorder, "Runge-Kutta", rpm, len(good), None, sum(m.seconds for m in marches), f"{cycles:.0f} cycles (median)"
    )
    done = sum(m.seconds for m in good)
    _row(recorder, "of it, where it settles", rpm, len(good), None, done, f"{1e3 * done / len(good):.2f} ms each")


def _row(recorder, method, rpm, answers, apart, seconds, notes):
    row = {"answers": answers, "apart": apart, "seconds": seconds, "per_speed_ms": 1e3 * seconds / len(rpm)}
    recorder.add(method=method, speeds=len(rpm), notes=notes, **row)


if __name__ == "__main__":
    main()
