"""What a train does at 300 speeds: ``steady_state`` beside a compiled Runge-Kutta
integration, in one process.

    python benchmarks/many_speeds.py [--speeds 300] [--json F]

``gear_train_30`` with 6 % tooth damping from 700 to 2450 rpm, on one core. Runge-Kutta
(numba, its steps alone counted) takes STEPS steps a cycle, with which its forces are
within 1 % where the motion settles (``work_precision.py``), from the linear motion on
the flanks until two cycles agree within 1 %, at most 100 cycles: it does not say what
the motion is. ``records`` is ``steady_state(..., exact=False)``; ``exact`` with
harmonic balance and stability where there is a period. Seconds of two rounds in turn,
without compilation.
"""

import time

import numpy as np
from marches import march
from records import command_line, started
from refined_trains import refined, with_tooth_damping
from tasks import prepare

import jaxhb

STEPS = 3000
COLUMNS = {
    "what": "<10s",
    "speeds": "6d",
    "seconds": "8.2f",
    "over_rk4": "8.2f",
    "notes": "<40s",
}


def main():
    """Run what the command line asks for."""
    parser = command_line(__doc__, core=0)
    parser.add_argument("--speeds", type=int, default=300)
    options = parser.parse_args()
    recorder = started("many-speeds", options, COLUMNS)
    train = with_tooth_damping(refined("gear_train_30", 27), 0.06)
    rpm = np.linspace(700.0, 2450.0, options.speeds)
    tasks = [prepare(train, speed) for speed in rpm]
    march(tasks[0], "rk4", STEPS, cycles=1)

    def integrated():
        found = [
            march(task, "rk4", STEPS, aim=0.01, clock=time.process_time)
            for task in tasks
        ]
        return (
            sum(one.seconds for one in found),
            f"{sum(one.cycles < 100 for one in found)} settle",
        )

    def steady(exact):
        begin = time.process_time()
        states = jaxhb.steady_state(train, rpm=rpm, exact=exact).states
        kinds = [state.kind for state in states]
        told = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
        return time.process_time() - begin, told

    calls = {
        "rk4": integrated,
        "records": lambda: steady(False),
        "exact": lambda: steady(True),
    }
    rounds = [{name: call() for name, call in calls.items()} for _ in range(3)][1:]
    for name in calls:
        seconds = np.array([one[name][0] for one in rounds])
        over = float(np.median(seconds / [one["rk4"][0] for one in rounds]))
        notes = rounds[0][name][1]
        recorder.add(
            what=name,
            speeds=len(rpm),
            seconds=float(np.median(seconds)),
            over_rk4=over,
            notes=notes,
        )


if __name__ == "__main__":
    main()
