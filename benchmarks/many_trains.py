"""A process that solves one train after another: does it end well, and how many memory maps does it hold?

    python benchmarks/many_trains.py [--trains 300] [--seed 0]

Every train has its own connections, so that every one compiles its own programs: two rotors of 2 to 5 disks each, one
or two meshes, at a speed where the teeth hammer. Linux gives a process 65530 memory maps by default and ends it with a
segmentation fault beyond.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import jaxhb
from jaxhb import Disk, Ground, Load, Mesh, Shaft, Torque


def small_train(number, rng):
    """Train ``number``: its own names and connections, numbers from ``rng``."""
    first, second = (int(n) for n in rng.integers(1, 5, 2))
    parts = [Disk(name=f"gear a{number}", inertia=0.01, radius=0.05), Disk(name="gear b", inertia=0.012, radius=0.06)]
    for rotor, (gear, count) in enumerate(((f"gear a{number}", first), ("gear b", second))):
        seats = [gear]
        for i in range(count):
            seats.append(f"disk {rotor}{i}")
            parts.append(Disk(name=seats[-1], inertia=float(rng.uniform(0.01, 0.2)), damping=0.2))
            at = seats[int(rng.integers(len(seats) - 1))]
            parts.append(Shaft(between=(at, seats[-1]), stiffness=float(rng.uniform(1e5, 1e6)), damping=30.0))
    teeth = {"stiffness": 2e8, "damping": 3000.0, "backlash": 1e-4, "epsilon": 0.01, "transition": 0.2}
    parts += [
        Mesh(between=(f"gear a{number}", "gear b"), **teeth),
        Torque(disk=f"gear a{number}", mean=20.0, harmonics=((1.0, 60.0, 0.0), (2.0, 150.0, 80.0))),
        Load(disk="gear b"),
        Ground(disk="gear b", stiffness=1.0),
    ]
    return jaxhb.build(parts, name=f"train {number}", reference=f"gear a{number}", revolutions_per_cycle=1)


def main():
    read = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    read.add_argument("--trains", type=int, default=300)
    read.add_argument("--seed", type=int, default=0)
    asked = read.parse_args()
    rng, most, start, solved = np.random.default_rng(asked.seed), 0, time.perf_counter(), 0
    for number in range(asked.trains):
        response = jaxhb.solve(small_train(number, rng), rpm=float(rng.uniform(1500, 4000)))
        solved += bool(response.converged)
        maps = Path("/proc/self/maps").read_bytes().count(b"\n")
        most = max(most, maps)
        if number % 10 == 9:
            seconds = time.perf_counter() - start
            print(f"{number + 1:4d} trains  {solved:4d} converged  {maps:6d} maps  {seconds:6.0f} s", flush=True)
    print(f"{asked.trains} trains, {solved} converged, at most {most} memory maps")


if __name__ == "__main__":
    main()
