"""How well do campaigns use several workers, and what happens when these die?

    python benchmarks/campaigns.py efficiency [--repeats 3]   1 and 2 workers, some minutes
    python benchmarks/campaigns.py costs                      start, bytes, overhead a case
    python benchmarks/campaigns.py deaths [--cases 100000]    a worker killed every 30 s
    python benchmarks/campaigns.py simulate                   1 to 1000 workers on paper

"efficiency", "costs" and "deaths" want idle processors. "simulate" is a discrete-event
model with what "costs" has measured: one driver that hands out and writes parts, and
workers that compute them.
"""

import argparse
import heapq
import os
import pickle
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

STUDY = """
scene = "engine_with_damper"
rpm = "600:2400:{speeds}"
keep = ["tooth force of crank gear|idler", "shaft torque of cyl6|flywheel"]
part = {part}
[[change]]
name = "viscous damper.damping"
values = "50:400:{designs}"
"""
COMMAND = [sys.executable, "-m", "jaxhb.cli.main", "campaign"]
KILLED_EVERY = 30.0  # seconds
# Of a driver, for each part: Dask's own estimate for its scheduler, and what "costs"
# measures of taking rows and writing them
SCHEDULING = 1e-3
WRITING = 5e-3
STARTING = 5.0  # seconds until a worker has its programs


def study_file(folder, speeds, designs, part=100):
    path = folder / f"study_{speeds}_{designs}.toml"
    path.write_text(STUDY.format(speeds=speeds, designs=designs, part=part))
    return path


def run(study, out, workers):
    """Seconds of a whole campaign in processes of its own."""
    shutil.rmtree(out, ignore_errors=True)
    command = [*COMMAND, str(study), "--out", str(out), "--quiet"]
    begin = time.perf_counter()
    subprocess.run([*command, "--workers", str(workers)], check=True)
    return time.perf_counter() - begin


def rows_in(out):
    import pandas

    rows = pandas.read_parquet(out / "rows")
    return rows.sort_values("case", ignore_index=True)


def efficiency(folder, repeats):
    """Print the time of 2000 speeds of 10 designs with 1 and with 2 workers."""
    study = study_file(folder, 2000, 10)
    run(study_file(folder, 200, 2), folder / "warm", 2)
    seconds = {1: [], 2: []}
    for _ in range(repeats):
        for workers, times in seconds.items():
            times.append(run(study, folder / f"out_{workers}", workers))
    ratios = [one / two for one, two in zip(*seconds.values(), strict=True)]
    for workers, times in seconds.items():
        print(f"{workers} workers: {', '.join(f'{s:.1f}' for s in times)} s")
    print(f"ratio: {statistics.median(ratios):.2f} (", end="")
    print(", ".join(f"{ratio:.2f}" for ratio in ratios), end=")\n")
    same = rows_in(folder / "out_1").equals(rows_in(folder / "out_2"))
    print(f"rows are the same bits: {same}")


def timed(function):
    """A function that adds up the seconds of its calls."""

    def call(*args, **options):
        begin = time.perf_counter()
        result = function(*args, **options)
        call.seconds += time.perf_counter() - begin
        return result

    call.seconds = 0.0
    return call


def costs(folder):
    """Print the costs of a case beyond its solve, in batches of 100, on one processor;
    and start and bytes.
    """
    import jaxhb
    from jaxhb.studies import rows as studied
    from jaxhb.studies.folder import CampaignFolder
    from jaxhb.studies.study import load_study

    jaxhb.cache_programs()
    study = load_study(study_file(folder, 2000, 10))
    numbers = range(0, study.parts, 5)
    out = CampaignFolder(folder / "costs", study)
    for number in numbers:  # compiles, and imports
        out.write(number, studied.rows_of(study.pieces_of(number)))
    studied.steady_state = timed(studied.steady_state)
    studied._read = timed(studied._read)
    parts = []
    begin = time.perf_counter()
    for number in numbers:
        pieces = pickle.loads(pickle.dumps(study.pieces_of(number)))
        begin_part = time.perf_counter()
        rows = pickle.loads(pickle.dumps(studied.rows_of(pieces)))
        parts.append(time.perf_counter() - begin_part)
        out.write(number, rows)
    total = time.perf_counter() - begin
    solving = studied.steady_state.seconds
    reading = studied._read.seconds
    cases = 100 * len(numbers)
    print(f"solve: {1e3 * solving / cases:.3f} ms a case")
    print(f"read two quantities: {reading / solving:.1%} of it")
    rest = total - solving - reading
    print(f"hand out, collect, write: {rest / solving:.1%} of it")
    print(f"parts: {min(parts):.3f} to {max(parts):.3f} s")
    sent = len(pickle.dumps(study.pieces_of(0)))
    received = len(pickle.dumps(studied.rows_of(study.pieces_of(0))))
    print(f"bytes a case: {sent / 100:.0f} sent, {received / 100:.0f} received")
    begin = time.perf_counter()
    run(study_file(folder, 50, 2), folder / "first", 1)
    print(
        f"first part of a worker, programs on disk: {time.perf_counter() - begin:.1f} s"
    )


def deaths(folder, cases):
    """Print whether the rows of a campaign whose workers are killed are those of one
    that nothing disturbs, and the memory of the driver.
    """
    study = study_file(folder, 2000, -(-cases // 2000))
    undisturbed = run(study, folder / "undisturbed", 2)
    out = folder / "killed"
    command = [*COMMAND, str(study), "--out", str(out), "--quiet", "--workers", "2"]
    begin = time.perf_counter()
    driver = subprocess.Popen(command)
    killed = []
    threading.Thread(target=kill, args=(driver, killed), daemon=True).start()
    memory = []
    while driver.poll() is None:
        memory.append(resident(driver.pid))
        time.sleep(1.0)
    seconds = time.perf_counter() - begin
    rows = rows_in(out)
    print(
        f"undisturbed {undisturbed:.0f} s, killed {seconds:.0f} s, {len(killed)} kills"
    )
    same = rows.equals(rows_in(folder / "undisturbed"))
    print(f"{len(rows)} rows, each once: {rows['case'].is_unique}, same bits: {same}")
    quarter = len(memory) // 4
    early = statistics.median(memory[quarter : 2 * quarter])
    late = statistics.median(memory[-quarter:])
    print(f"driver: {early:.0f} MB in the second quarter, {late:.0f} MB in the last")


def resident(process):
    """Resident memory of a process in MB, 0 of none."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def kill(driver, killed):
    """Kill one of the workers again and again."""
    choose = random.Random(0)
    while driver.poll() is None:
        time.sleep(KILLED_EVERY)
        listed = subprocess.run(
            ["ps", "--ppid", str(driver.pid), "-o", "pid=,args="],
            capture_output=True,
            text=True,
        )
        lines = listed.stdout.splitlines()
        workers = [int(line.split()[0]) for line in lines if "spawn_main" in line]
        if workers:
            killed.append(choose.choice(workers))
            os.kill(killed[-1], signal.SIGKILL)


def simulated(workers, part, cases, seconds_of_case, start, per_part):
    """Efficiency of a campaign: work over workers times time.

    seconds_of_case : of each case, in the order of the speeds of a design; per_part :
    of the driver
    """
    work = seconds_of_case[: len(seconds_of_case) // part * part]
    parts = work.reshape(-1, part).sum(axis=1)
    count = cases // part
    driver = 0.0
    free = [start] * workers
    heapq.heapify(free)
    for number in range(count):
        driver += per_part
        begin = max(heapq.heappop(free), driver)
        heapq.heappush(free, begin + parts[number % len(parts)])
    return count * parts.mean() / (workers * max(free))


def simulate():
    """Print the efficiency over the number of workers and the size of parts, of trains
    that are mostly in contact, one speed in twenty of which hammers, and of trains that
    hammer at all speeds.
    """
    hammering = np.arange(2000) >= 1900  # they lie side by side
    kinds = {
        "10 million cases, mostly in contact": (10**7, np.where(hammering, 0.03, 7e-4)),
        "1 million cases that hammer": (10**6, np.full(2000, 0.15)),
    }
    workers = (2, 10, 100, 300, 1000)
    for name, (cases, seconds) in kinds.items():
        print(f"{name}, {cases * seconds.mean() / 3600:.1f} hours of one processor")
        print("part   " + "".join(f"{count:>8}" for count in workers))
        for part in (10, 50, 100, 500, 1000, 2000):
            shares = [
                simulated(count, part, cases, seconds, STARTING, SCHEDULING + WRITING)
                for count in workers
            ]
            print(f"{part:<7}" + "".join(f"{share:>8.0%}" for share in shares))


def main():
    read = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    read.add_argument("what", choices=["efficiency", "costs", "deaths", "simulate"])
    read.add_argument("--repeats", type=int, default=3)
    read.add_argument("--cases", type=int, default=100_000)
    arguments = read.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if arguments.what == "efficiency":
            efficiency(folder, arguments.repeats)
        elif arguments.what == "costs":
            costs(folder)
        elif arguments.what == "deaths":
            deaths(folder, arguments.cases)
        else:
            simulate()


if __name__ == "__main__":
    main()
