"""Many speeds side by side on one device: time a speed by how many share a program.

    python benchmarks/lanes.py [--scene engine_with_damper] [--rpm 600 2600] [--speeds
    1000] [--batches 1 16 256 4096]
        [--paths swept planned] [--platform cpu] [--json F]

*swept* : sweeps of the cycle under ``jax.vmap``, from the numbers of the train to the
deflections; *planned* : ``jax.vmap`` of ``jaxhb.solve`` under one plan, with its error
estimate and the motion of every disk. A batch runs until its slowest speed is done.
Times are the least of ``--repeats`` without compilation, which is told beside them.
"""

import argparse
import dataclasses
import json
import time
from pathlib import Path

import jax
import numpy as np

import jaxhb
from jaxhb.balance import program, sweeps, swept
from jaxhb.balance.plan import Request
from jaxhb.balance.problem import linear_equation
from jaxhb.solutions.planning import plan_speeds
from jaxhb.solutions.sweeping import SweptTrain


def swept_lanes(train, speeds):
    """A function of speeds ``(n,)`` that gives a program, which tells at which of them
    sweeps settle, and what it is given; and how large it is.
    """
    request = Request.of(train, None, None, "reduced", None)
    ready = SweptTrain.of(
        train, plan_speeds(train, np.array([float(speeds.max())]), request)[0], request
    )
    # Of the slowest speed, whose cycle takes the most steps: one program for all.
    plan = ready.sweep_plans(float(speeds.min()))[0]
    goal = swept.SETTLED * ready.plan.tolerance

    def one(problem, active_meshes, modes):
        equation, condensed = linear_equation(
            problem, 2 * plan.harmonics, active_meshes
        )
        equation = dataclasses.replace(equation, by_rate=plan.by_rate)
        made = swept.prepare.nested(
            equation, condensed.system, condensed.columns, modes, plan=plan
        )
        ended = sweeps.settle(made.sweeps, made.flank, plan, goal, swept.MOST_SWEEPS)
        return ended.distance <= goal, abs(ended.deflection).sum(axis=-1).max()

    axes = program.problem_axes()
    lanes = jax.jit(jax.vmap(one, in_axes=(axes, None, None)))
    given = jax.tree.map(jax.numpy.asarray, (ready.plan.active_meshes, ready.modes))

    def at(rpm):
        return lanes, (
            program.problems_at(train, jax.numpy.asarray(rpm), ready.plan.excited),
            *given,
        )

    return at, f"{plan.steps} steps a cycle"


def planned_lanes(train, speeds):
    """The same of which were solved under one plan."""
    plan = jaxhb.plan(
        train, rpm=np.linspace(speeds.min(), speeds.max(), 5), active="all"
    )

    def one(rpm):
        response = jaxhb.solve(train, rpm=rpm, plan=plan)
        return response.solved, abs(response.deflections).max()

    lanes = jax.jit(jax.vmap(one))
    return lambda rpm: (lanes, (jax.numpy.asarray(rpm),)), f"{plan.harmonics} harmonics"


PATHS = {"swept": swept_lanes, "planned": planned_lanes}


def timed(at, speeds, batch, repeats):
    """Seconds of compilation and of a speed in batches, the least of the repeats; and
    the share solved.
    """
    padded = np.resize(speeds, -(-len(speeds) // batch) * batch).reshape(-1, batch)
    begin = time.perf_counter()
    lanes, given = at(padded[0])
    compiled = lanes.lower(*given).compile()
    compiling = time.perf_counter() - begin
    seconds = np.inf
    for _ in range(repeats):
        begin = time.perf_counter()
        solved = np.concatenate(
            [np.asarray(compiled(*at(some)[1])[0]) for some in padded]
        )
        seconds = min(seconds, time.perf_counter() - begin)
    return compiling, seconds / padded.size, solved[: len(speeds)].mean()


def main():
    """Read the command line, run, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", default="engine_with_damper")
    parser.add_argument("--rpm", nargs=2, type=float, default=(600.0, 2600.0))
    parser.add_argument("--speeds", type=int, default=1000)
    parser.add_argument("--batches", nargs="+", type=int, default=(1, 16, 256, 4096))
    parser.add_argument(
        "--few",
        type=int,
        default=8,
        help="batches timed at most: of small ones not all speeds are",
    )
    parser.add_argument("--paths", nargs="+", choices=PATHS, default=tuple(PATHS))
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--platform", help="cpu, gpu or tpu; by default what jax takes")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    if asked.platform:
        jax.config.update("jax_platforms", asked.platform)
    device = jax.devices()[0]
    print(
        f"{asked.scene}, {asked.rpm[0]:g} to {asked.rpm[1]:g} rpm,"
        f" {device.device_kind}, jax {jax.__version__}"
    )
    train = jaxhb.load_scene(asked.scene)
    for path in asked.paths:
        speeds = np.linspace(*asked.rpm, asked.speeds)
        at, what = PATHS[path](train, speeds)
        for batch in asked.batches:
            # Evenly from all, as hammering ones take longer.
            some = (
                speeds
                if batch * asked.few >= len(speeds)
                else np.linspace(*asked.rpm, batch * asked.few)
            )
            if batch > len(some):
                some = np.linspace(*asked.rpm, batch)
            compiling, seconds, solved = timed(at, some, batch, asked.repeats)
            print(
                f"{path:8s} batches of {batch:5d}: {1e3 * seconds:8.3f} ms a speed,"
                f" compiled in {compiling:5.1f} s, {100 * solved:.1f} % solved, {what}",
                flush=True,
            )
            if asked.json:
                row = {
                    "benchmark": "lanes",
                    "scene": asked.scene,
                    "device": device.device_kind,
                }
                row |= {"jax": jax.__version__}
                row |= {"path": path, "batch": batch}
                row |= {
                    "milliseconds": 1e3 * seconds,
                    "compile_seconds": compiling,
                    "solved": float(solved),
                }
                with asked.json.open("a") as stream:
                    stream.write(json.dumps(row) + "\n")


if __name__ == "__main__":
    main()
