"""A sweep over the range of an engine: what the train does at every speed, against Runge-Kutta until it settles.

    python benchmarks/sweep.py [--speeds 300] [--json F] [--core 0]      5 minutes

``gear_train_30`` from 600 to 2450 rpm. ``steady_state`` with numbers from recorded cycles (``exact=False``, good to
about 1 %) and with harmonic balance, each run twice: the first time compiles. Runge-Kutta takes the fewest steps that
are stable and marches from the motion with all teeth in contact until the tooth force of a cycle is that of the one
before within 1 %, or 100 cycles, the last 64 of which are then the record; only its steps count. Seconds are those of
the processor, on one core.
"""

import argparse
import time
from collections import Counter

import numpy as np
from design_gradients import settled
from records import Recorder, pin

import jaxhb

COLUMNS = {"method": "<23s", "speeds": "7d", "answers": "8d", "seconds": "9.2f", "per_speed_ms": "13.2f"}
COLUMNS |= {"notes": "<80s"}


def swept(train, rpm, exact):
    """The sweep, its seconds and those of its first run."""
    times = []
    for _ in range(2):
        begin = time.process_time()
        sweep = jaxhb.steady_state(train, rpm=rpm, exact=exact)
        times.append(time.process_time() - begin)
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
    for name, exact in (("steady_state, recorded", False), ("steady_state, exact", True)):
        sweep, seconds, first = swept(train, rpm, exact)
        kinds = Counter(str(kind) for kind in sweep.kind)
        told = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
        known = len(rpm) - kinds["unknown"]
        _row(recorder, name, rpm, known, seconds, f"first run {first:.0f} s; {told}")
    settled(train, rpm[0], 1.0)  # compiles
    marches = [settled(train, speed, 1e-2)[0] for speed in rpm]
    good = [m for m in marches if m.periodicity_error <= 1e-2]
    cycles = np.median([m.cycles for m in good])
    spent = sum(m.seconds for m in marches)
    _row(recorder, "Runge-Kutta", rpm, len(good), spent, f"{cycles:.0f} cycles (median) where it settles")
    done = sum(m.seconds for m in good)
    _row(recorder, "of it, where it settles", rpm, len(good), done, f"{1e3 * done / len(good):.2f} ms each")


def _row(recorder, method, rpm, answers, seconds, notes):
    row = {"answers": answers, "seconds": seconds, "per_speed_ms": 1e3 * seconds / len(rpm)}
    recorder.add(method=method, speeds=len(rpm), notes=notes, **row)


if __name__ == "__main__":
    main()
