"""How long a command takes from the shell: whole processes, first with no program on
disk, then with all of them.

    python benchmarks/startup.py [--repeats 3] [--json F]      5 minutes

"run" is what the sweep itself takes once everything is compiled, in one process; what
is left of the second run of the sweep is the cost of starting.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

COMMAND = [sys.executable, "-m", "jaxhb.cli.main"]
SOLVE = ["solve", "gear_train_30", "--rpm", "1800"]
SWEEP = ["sweep", "gear_train_30", "--rpm", "700:2450:60"]
FAULTY = "[scene]\nname = 'x'\n[[disk]]\nname = 'a'\ninertai = 1.0\n"
RUN = """
import os, time
os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the command line has it
import numpy, jaxhb
train, rpm = jaxhb.load_scene("gear_train_30"), numpy.linspace(700.0, 2450.0, 60)
for _ in range(2):
    begin = time.perf_counter()
    jaxhb.steady_state(train, rpm=rpm)
    seconds = time.perf_counter() - begin
print(seconds)
"""


def seconds(command, folder, status=0):
    """Seconds that a process takes, its programs kept in ``folder``."""
    begin = time.perf_counter()
    done = subprocess.run(
        command,
        env=os.environ | {"JAXHB_CACHE": str(folder)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == status, done.stderr
    return time.perf_counter() - begin, done.stdout


def rows(repeats, scratch):
    """Yield (what, list of seconds)."""
    faulty = scratch / "faulty.toml"
    faulty.write_text(FAULTY)
    for name, arguments, status in (
        ("--help", ["--help"], 0),
        ("--version", ["--version"], 0),
        ("scenes", ["scenes"], 0),
        ("solve, a scene with a fault", ["solve", str(faulty), "--rpm", "1800"], 2),
    ):
        yield (
            name,
            [
                seconds(COMMAND + arguments, "off", status)[0]
                for _ in range(repeats + 1)
            ][1:],
        )
    for name, arguments in (("solve", SOLVE), ("sweep", SWEEP)):
        first = []
        second = []
        for i in range(repeats):
            folder = scratch / f"{name} {i}"
            first.append(seconds(COMMAND + arguments, folder)[0])
            second.append(seconds(COMMAND + arguments, folder)[0])
        yield f"{name}, first run", first
        yield f"{name}, second run", second
    run = [
        float(seconds([sys.executable, "-c", RUN], "off")[1]) for _ in range(repeats)
    ]
    yield "sweep, run", run
    yield (
        "sweep, second run less run",
        [a - b for a, b in zip(second, run, strict=True)],
    )


def main():
    read = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    read.add_argument("--repeats", type=int, default=3)
    read.add_argument("--json", metavar="F")
    arguments = read.parse_args()
    found = []
    with tempfile.TemporaryDirectory() as scratch:
        print(f"{'':30s}  median s  least s")
        for name, times in rows(arguments.repeats, Path(scratch)):
            print(
                f"{name:30s}  {statistics.median(times):8.2f}  {min(times):7.2f}",
                flush=True,
            )
            found.append({"command": name, "seconds": times})
    if arguments.json:
        Path(arguments.json).write_text(
            "".join(json.dumps(row) + "\n" for row in found)
        )


if __name__ == "__main__":
    main()
