"""Does time integration settle where no periodic motion was found?

    python benchmarks/settling.py benchmarks/results/stress.jsonl [--json F] [--core 0]
    [--disks 27]

Marches every case of ``stress.py`` that ended MAX_STEPS, STALLED or NONFINITE through
1024 cycles from the drive sides of its teeth, and looks for the number of cycles, 1 to
16, after which deflections and rates of all meshes come back. Where none does, no
stable periodic motion was reached: the teeth hammer irregularly.
"""

import argparse
import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from random_trains import random_case
from records import Recorder, pin
from stress import mode_harmonic, steps_for

import jaxhb
from jaxhb.integration.step import cycle
from jaxhb.linear.mesh_modes import STRAINED

CYCLES = 1024
WATCHED = 64
LONGEST = 16
"""Cycles after which a motion may come back."""
RETURNED = 1e-4
"""Largest change of a deflection or rate, over the largest, that counts as coming
back.
"""
STEPS_PER_PERIOD = 16
"""Of the highest mesh mode: the integration errs by about a tenth of a percent."""
MOST_WORK = 3e6
"""Steps times states of a cycle, about a third of a second."""
COLUMNS = {
    "case": "4d",
    "skeleton": "<29s",
    "zeta": "6.3f",
    "steps": "6d",
    "closure": "8.1e",
    "period": "6d",
}
COLUMNS |= {"change": "8.1e", "verdict": "<14s", "seconds": "7.1f"}


@jax.jit
def watched(stepper, state):
    """(deflections and rates ``(WATCHED, 2G)`` at the beginnings of cycles, their
    largest ``(2G,)``).
    """

    def one(state, _):
        after, trace = cycle(stepper, state)
        largest = jnp.concatenate(
            [abs(trace.deflection).max(axis=1), abs(trace.rate).max(axis=1)]
        )
        return after, (stepper.linear[0] + stepper.space.observation @ state, largest)

    seen, largest = lax.scan(one, state, None, length=WATCHED)[1]
    return seen, largest.max(axis=0)


def settling(train, rpm):
    """Steps a cycle, change after one cycle, the period that changes least, its change,
    and a verdict.
    """
    wanted = max(512, STEPS_PER_PERIOD * mode_harmonic(train, rpm, STRAINED))
    steps = steps_for(wanted)
    if steps is None or steps * 2 * train.topology.n_disks > MOST_WORK:
        return {"steps": int(wanted), "verdict": "too long"}
    orbit = jaxhb.integrate(train, rpm=rpm, cycles=CYCLES - WATCHED, steps=steps)
    seen, largest = (np.asarray(a) for a in watched(orbit.stepper, orbit.state))
    change = np.array(
        [
            np.max(np.abs(seen[-1] - seen[-1 - k]) / largest)
            for k in range(1, LONGEST + 1)
        ]
    )
    back = change <= RETURNED
    period = 1 + int(np.argmax(back) if back.any() else np.argmin(change))
    verdict = (
        "irregular" if not back.any() else "settles" if period == 1 else "longer period"
    )
    found = {
        "steps": steps,
        "closure": float(change[0]),
        "period": period,
        "change": float(change[period - 1]),
    }
    return found | {"verdict": verdict}


def main():
    """Read the command line and run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("records", help="JSON lines of stress.py")
    parser.add_argument(
        "--disks", type=int, default=60, help="cases of at most so many disks"
    )
    parser.add_argument("--json", help="write JSON lines to this file")
    parser.add_argument("--core", type=int, default=-1, help="run on this core")
    options = parser.parse_args()
    pin(options.core)
    rows = [json.loads(text) for text in Path(options.records).read_text().splitlines()]
    lost = [
        r
        for r in rows
        if r.get("status") in ("MAX_STEPS", "STALLED", "NONFINITE")
        and r["disks"] <= options.disks
    ]
    recorder = Recorder("settling", options.json, COLUMNS)
    recorder.head()
    for r in sorted(lost, key=lambda r: (r["disks"], r["meshes"], -r["zeta"])):
        train, rpm, _ = random_case(np.random.default_rng([r["seed"], r["case"]]))
        begin = time.perf_counter()
        found = settling(train, rpm)
        known = {
            key: r[key]
            for key in ("seed", "case", "skeleton", "disks", "meshes", "zeta", "rpm")
        }
        recorder.add(**known, **found, seconds=time.perf_counter() - begin)
    verdicts = [r["verdict"] for r in recorder.rows]
    print(", ".join(f"{verdicts.count(v)} {v}" for v in dict.fromkeys(verdicts)))


if __name__ == "__main__":
    main()
