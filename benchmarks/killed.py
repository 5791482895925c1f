"""Is anything lost, or different, when a sweep is killed again and again?

    python benchmarks/killed.py [--kills 20] [--seed 0] [--scene gear_train_30] [--rpm 700:2450:120] [--chunk 8]

Runs the sweep of the command line once without interruption, then with ``kill -9`` at random moments until it has been
killed so often, and lets it end. Both have to give the same file of numbers, to the last bit, and no steady state that
was kept may be computed again.
"""

import argparse
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def command(asked, folder):
    """The sweep as it is typed."""
    given = [asked.scene, "--rpm", asked.rpm, "--out", folder / "kept", "--chunk", asked.chunk, "--orders", 1]
    given += ["--direction", "both", "--json", folder / "numbers.json"]
    return [sys.executable, "-m", "jaxhb.cli.main", "sweep", *map(str, given)]


def kept(folder):
    """Files of a folder that are whole, with the time at which they were written."""
    return {path.name: path.stat().st_mtime_ns for path in (folder / "kept").glob("*.npz")}


def run(asked, folder, limit=None):
    """Whether the sweep ended by itself, killed after ``limit`` seconds; the files kept before have to stay."""
    before, begin = kept(folder), time.perf_counter()
    process = subprocess.Popen(command(asked, folder), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    try:
        _, errors = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
        _, errors = process.communicate()
    after, seconds = kept(folder), time.perf_counter() - begin
    assert before.items() <= after.items(), "a file that was kept is lost or was written again"
    ended = process.returncode == 0
    assert ended or process.returncode == -signal.SIGKILL, errors.decode()
    print(f"{'ended' if ended else 'killed'} after {seconds:6.1f} s, {len(after):3d} files kept", flush=True)
    return ended, seconds


def main():
    read = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    read.add_argument("--kills", type=int, default=20)
    read.add_argument("--seed", type=int, default=0)
    read.add_argument("--scene", default="gear_train_30")
    read.add_argument("--rpm", default="700:2450:120")
    read.add_argument("--chunk", type=int, default=8)
    asked = read.parse_args()
    rng = random.Random(asked.seed)
    with tempfile.TemporaryDirectory() as folder:
        whole, often = Path(folder) / "whole", Path(folder) / "often"
        whole.mkdir(), often.mkdir()
        run(asked, whole)
        _, length = run(asked, Path(folder) / "whole")  # what a sweep takes that only reads
        total = sum(1 for _ in kept(whole))
        kills = 0
        while kills < asked.kills:
            ended, _ = run(asked, often, length * rng.uniform(0.2, 1.6))
            kills += not ended
            if ended and kills < asked.kills:
                for path in rng.sample(sorted((often / "kept").glob("*.npz")), max(total // 2, 1)):
                    path.unlink()  # so that there is something left to be killed at
        assert run(asked, often)[0]
        names = "numbers.json", "kept/sweep.json", *(f"kept/{name}" for name in kept(whole))
        assert kept(often).keys() == kept(whole).keys()
        different = [name for name in names if (whole / name).read_bytes() != (often / name).read_bytes()]
        assert not different, f"different: {different}"
    print(f"killed {kills} times: {len(names)} files equal to the last bit")


if __name__ == "__main__":
    main()
