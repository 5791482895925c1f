"""The worst case within tolerances beside large samples and a dense search; what it
costs.

    python benchmarks/tolerances.py [--scenes engine_with_damper gear_train_30]
    [--samples 10000] [--seed 1] [--json F] python benchmarks/tolerances.py --robust 5

Ten numbers of each train, twelve speeds, the tooth force of the hardest mesh.
``jaxhb.tolerance`` searches without a sample. Beside it: the largest of a sample (Latin
hypercube), and, at speeds at which no tooth separates in any corner, the largest of all
1024 corners and of a search from the best eight of them. ``bound`` is the bound over
the worst case found, where there is one. ``over`` is the largest other response over
the worst case found, above 1 where it was missed. ``price`` is the processor time of
the search, without bounds and with them, over that of ``jaxhb.solve_speeds`` of the
same speeds, medians of three without compilation.
"""

import itertools
import time
from functools import partial

import numpy as np
from records import command_line, started

import jaxhb
from jaxhb.balance.plan import Request
from jaxhb.design import Objective, Parameter, Tolerance, read_tolerances
from jaxhb.design.tolerances import box_of
from jaxhb.design.worst_case import _Question, _Search

RPM = {
    "engine_with_damper": np.linspace(800.0, 2400.0, 12),
    "gear_train_30": np.linspace(700.0, 2450.0, 12),
}
MESH = {"engine_with_damper": "crank gear|idler", "gear_train_30": "crank gear|idler"}
COLUMNS = {
    "scene": "<20s",
    "rpm": "6.0f",
    "nominal": "8.0f",
    "worst": "8.0f",
    "sample": "8.0f",
    "solved": "6.2f",
}
COLUMNS |= {"corners": "8.0f", "bound": "7.4f", "over": "7.4f", "notes": "<30s"}


def box(train):
    """Ten tolerances: those of the scene, or of its dampers, gears and shafts."""
    if train.tolerance:
        return read_tolerances(train)
    names = [
        f"{name}.{field}"
        for name in ("crank damper", "cam damper A")
        for field in ("stiffness", "damping")
    ]
    meshes = [
        f"{name}.{field}"
        for name in train.topology.mesh_names[:2]
        for field in ("stiffness", "damping", "backlash")
    ]
    return tuple(
        Tolerance(name=name, low=0.85 * value, high=1.15 * value)
        for name in [*names, *meshes]
        for value in [float(train.value(name))]
    )


def dense(train, rpm, tolerances, of):
    """The largest response of all corners and of a search from the best eight, of
    speeds in contact; nan elsewhere.
    """
    request = Request.of(train, None, 0.01)
    search = _Search(_Question(train, rpm, box_of(train, tolerances, of), request))
    search.room = 8 * 64
    search.start()
    search.sampled(
        np.array(list(itertools.product((-1.0, 1.0), repeat=len(tolerances))))
    )
    found = np.full(len(rpm), np.nan)
    speeds = []
    starts = []
    for i, tried in enumerate(search.tried):
        best = sorted(tried, key=lambda u: -np.nan_to_num(tried[u][0]))[:8]
        speeds += [i] * len(best)
        starts += best
    search._ascend(np.array(speeds), np.zeros(len(speeds), dtype=int), np.array(starts))
    for i, tried in enumerate(search.tried):
        found[i] = np.nanmax(list(tried.values()))
    return found


def robust(seeds):
    """Robust against nominal dampers: worst case and largest response of a fresh
    sample, for several seeds.
    """
    train = jaxhb.load_scene("engine_with_damper")
    names = {
        "viscous damper.damping": (3.0, 300.0),
        "rubber damper.stiffness": (1e4, 3e5),
    }
    asked = {
        "parameters": [
            Parameter(name=name, low=low, high=high)
            for name, (low, high) in names.items()
        ],
        "objective": Objective(quantity="tooth force", of=MESH["engine_with_damper"]),
        "rpm": np.linspace(1000.0, 2600.0, 9),
        "steps": 12,
    }
    for seed in range(seeds):
        for kind in ("worst", "p95"):
            found = jaxhb.tune(train, **asked, robust=kind, seed=seed)
            cells = []
            for said, one in found.robust.spreads.items():
                numbers = one.nominal, one.worst, one.percentile(95), one.samples
                cells.append(
                    f"{said}: " + ", ".join(f"{np.nanmax(own):.0f}" for own in numbers)
                )
            print(
                f"seed {seed}, {kind} (N: itself, worst case, 95 %, largest):"
                f" {'; '.join(cells)}",
                flush=True,
            )


def measured(call):
    """Result of a call and its processor time, the median of three after a first that
    compiles.
    """
    taken = []
    for _ in range(4):
        begin = time.process_time()
        found = call()
        taken.append(time.process_time() - begin)
    return found, np.median(taken[1:])


def main():
    """Run what the command line asks for."""
    parser = command_line(__doc__, core=-1)
    parser.add_argument("--scenes", nargs="+", default=list(RPM))
    parser.add_argument("--samples", type=int, default=10000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--robust", type=int, metavar="SEEDS", help="compare robust dampers instead"
    )
    options = parser.parse_args()
    jaxhb.cache_programs()
    if options.robust:
        robust(options.robust)
        return
    recorder = started("tolerances", options, COLUMNS)
    for scene in options.scenes:
        train = jaxhb.load_scene(scene)
        rpm = RPM[scene]
        of = [Objective(quantity="tooth force", of=MESH[scene])]
        tolerances = box(train)
        asked = {"rpm": rpm, "of": of, "tolerances": tolerances}
        _, nominal = measured(partial(jaxhb.solve_speeds, train, rpm=rpm))
        _, alone = measured(partial(jaxhb.tolerance, train, **asked, bounds=False))
        found, bounded = measured(partial(jaxhb.tolerance, train, **asked))
        sampled = jaxhb.tolerance(
            train, **asked, samples=options.samples, seed=options.seed
        )
        contact = [
            state.kind == "contact"
            for state in jaxhb.steady_state(train, rpm=rpm).states
        ]
        at_worst = [
            jaxhb.steady_state(train.replace(found.values(i, 0)), rpm=float(r)).kind
            for i, r in enumerate(rpm)
        ]
        quiet = np.array(
            [
                one and kind == "contact"
                for one, kind in zip(contact, at_worst, strict=True)
            ]
        )
        corners = np.full(len(rpm), np.nan)
        if quiet.any():
            corners[quiet] = dense(train, rpm[quiet], tolerances, of)
        for i, speed in enumerate(rpm):
            largest = np.nanmax(sampled.samples[i, :, 0])
            over = np.nanmax([largest, corners[i]]) / found.worst[i, 0]
            row = {
                "scene": scene,
                "rpm": speed,
                "nominal": found.nominal[i, 0],
                "worst": found.worst[i, 0],
            }
            row |= {
                "sample": largest,
                "solved": sampled.solved[i],
                "corners": corners[i],
                "over": over,
            }
            row["bound"] = found.bound[i, 0] / found.worst[i, 0]
            recorder.add(**row, notes=f"{at_worst[i]} in the worst case")
        told = (
            f"price {alone / nominal:.1f} nominal sweeps, with bounds"
            f" {bounded / nominal:.1f}"
        )
        print(f"{scene}: {found.evaluations} solves, {told}", flush=True)


if __name__ == "__main__":
    main()
