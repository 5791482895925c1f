"""Do two threads that solve, differentiate, batch and compile at the same time ever
wait for each other?

    python benchmarks/threads.py                 one process of two threads, on two processors
    python benchmarks/threads.py --repeats 20    so many processes, one after another, each ended after LIMIT seconds

jaxlib 0.9.1 to 0.11.0 nest LAPACK calls in the threads that run them, 0.11.1 and 0.11.2
Fourier transforms: two programs at once, or two parts of one, can hold every thread and
wait for another for ever.
"""

import argparse
import os
import subprocess
import sys
import threading
import time

LIMIT = 300
ROUNDS = 3


def work():
    """Solves, gradients, batches and programs of the user's own, in two threads, as in
    one; first each thread compiles a program that the other does not need yet.
    """
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, set(list(os.sched_getaffinity(0))[:2]))
    import jax
    import numpy as np

    import jaxhb

    train = jaxhb.load_scene("gear_train_30")
    plan = jaxhb.plan(train, rpm=1800.0, harmonics=384)

    def peak(damping, rpm):
        changed = train.replace({"crank damper.damping": damping})
        return (
            jaxhb.solve(changed, rpm=rpm, plan=plan)
            .force("crank gear", "idler")
            .smooth_peak()
        )

    batch = jax.vmap(peak, in_axes=(None, 0))
    compiled = jax.jit(jax.vmap(jax.grad(peak), in_axes=(None, 0)))
    speeds, found = np.array([1780.0, 1800.0]), [[], []]

    def round_of(found):
        found += [batch(220.0, speeds), compiled(220.0, speeds)]
        found += [jaxhb.solve(train, rpm=1800.0, plan=plan).deflections]

    def repeat(found):
        for _ in range(ROUNDS):
            round_of(found)

    together([(batch, 220.0, speeds), (compiled, 220.0, speeds)])
    alone = []
    round_of(alone)
    together([(repeat, own) for own in found])
    for own in found:
        for value, wanted in zip(own, alone * ROUNDS, strict=True):
            np.testing.assert_allclose(value, wanted, rtol=1e-9, atol=1e-15)


def together(calls):
    """Make some calls, each a function and its arguments, each in a thread."""
    threads = [threading.Thread(target=call, args=args) for call, *args in calls]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def main():
    read = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    read.add_argument("--repeats", type=int, help="processes (default: this one alone)")
    repeats = read.parse_args().repeats
    if repeats is None:
        work()
        return 0
    finished = 0
    for number in range(repeats):
        start = time.perf_counter()
        try:
            ended = subprocess.run(
                [sys.executable, __file__], timeout=LIMIT, check=False
            ).returncode
        except subprocess.TimeoutExpired:
            ended = f"still running after {LIMIT} s"
        finished += ended == 0
        print(
            f"{number + 1:3d}  {time.perf_counter() - start:6.1f} s  {ended}",
            flush=True,
        )
    print(f"{finished} of {repeats} finished")
    return finished < repeats


if __name__ == "__main__":
    sys.exit(main())
