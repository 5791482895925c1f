"""Error bounds against true errors: random trains, under-resolved and perturbed motions.

    python benchmarks/certificates.py [--cases 200] [--seed 20261126] [--json F]     hours; goes on where the file ends
    python benchmarks/certificates.py --only 17                                     one of them
    python benchmarks/certificates.py --scenes                                      cost on the packaged scenes
    python benchmarks/certificates.py --spurious                                    minutes: motions that do not exist

Cases are those of ``random_trains.py`` with up to 27 disks and four meshes; every eighth is solved with about a quarter
of the harmonics, every eighth is disturbed by 0.1 % to 10 % of a backlash in all deflections. The true motion is a
solve with exact integrals and FINE harmonics, eight times those of the response where there are so many, begun at it;
its error is what another with half as many differs from it. *Unsound*: a certificate whose bound is less than the true
error of a deflection or of a tooth force of any mesh.

``--spurious``: all motions that few harmonics give of the lightly loaded pair (one degree of freedom, 15 speeds) from
random starts, beside the motion to which shooting over one cycle leads from each, on its own time integration. Where
that is farther away than FAR backlashes, or where shooting leads to none, the computed motion does not exist; its
certificate has to refuse it, or to give a bound that reaches as far.
"""

import argparse
import collections
import dataclasses
import sys
import time
from pathlib import Path

import jax
import numpy as np
from random_trains import random_case
from records import add_cases, run_cases

import jaxhb
import jaxhb.equations.backlash
from jaxhb import _program
from jaxhb.equations import fourier
from jaxhb.excitation.torques import listed_harmonic

FINE, MOST = 2048, 4096
DISKS, MESHES = 27, 4
FLOOR = 1e-8
"""Errors below this share of the largest are not judged: the equations of the reference are solved to 1e-10."""
SAMPLES = 2**16
FAR, STARTS = 0.1, 4


def motion(response):
    """Deflections and tooth forces ``(2, G, SAMPLES)`` of the meshes."""
    names = response.topology.mesh_names
    frequency = response.topology.cycle_frequency(float(response.rpm))
    deflection = np.asarray(response.deflections)
    value = fourier.synthesize(deflection, SAMPLES)
    rate = fourier.synthesize(fourier.derivative(deflection, frequency), SAMPLES)
    train = response.train
    law = jax.tree.map(np.asarray, jaxhb.equations.backlash.law_of(train.meshes)).expand()
    gated = np.array([law == "contact" for law in train.topology.mesh_damping_law])[:, None]
    viscous = np.asarray(train.meshes.damping)[:, None]
    force = jaxhb.equations.backlash.mesh_force(law, viscous, gated, value, rate)
    assert len(names) == len(force)
    return np.stack([value, force])


def disturbed(response, rng, size):
    """The response with deflections off by ``size`` backlashes (largest value)."""
    h = np.asarray(response.train.meshes.backlash)[:, None]
    shape = np.asarray(response.deflections).shape
    noise = rng.normal(size=shape) + 1j * rng.normal(size=shape) * (np.arange(shape[1]) > 0)
    noise = noise / (1 + np.arange(shape[1])) ** 1.5
    noise = noise / np.abs(fourier.synthesize(noise, 16 * shape[1])).max()
    return dataclasses.replace(response, deflections=response.deflections + size * h * noise)


def run_case(seed, index):
    """The record of one case."""
    draw = 0
    while True:
        train, rpm, facts = random_case(np.random.default_rng([seed, index, draw]))
        if facts["meshes"] <= MESHES and facts["disks"] <= DISKS:
            break
        draw += 1
    rng = np.random.default_rng([seed, index, 1000])
    record = {"seed": seed, "case": index} | {key: facts[key] for key in ("skeleton", "meshes", "zeta", "load")}
    begin = time.perf_counter()
    response = jaxhb.solve(train, rpm=rpm)
    record |= {"rpm": rpm, "status": response.status.item(), "harmonics": response.harmonics, "asked": "solved"}
    record |= {"seconds_solve": time.perf_counter() - begin}
    if not response.converged:
        return record | {"verdict": "not solved"}
    if index % 8 == 3:
        fewer = max(listed_harmonic(train.topology), 1 << (response.harmonics // 3).bit_length() - 1)
        fewer = jaxhb.solve(train, rpm=rpm, harmonics=fewer, start=response)
        if fewer.status <= 1:
            record["asked"], response = "under-resolved", fewer
    if index % 8 == 7:
        size = 10 ** rng.uniform(-3, -1)
        record["asked"], response = f"disturbed {size:.2g}", disturbed(response, rng, size)
    begin = time.perf_counter()
    try:
        found = jaxhb.certify(response)
    except ValueError as error:
        return record | {"verdict": "refused", "reason": str(error)}
    record |= {"seconds_certify": time.perf_counter() - begin, "Y0": found.Y0, "Z1": found.Z1, "Z2": found.Z2}
    record |= {"low": found.low, "small_gain": found.small_gain}
    if not found.holds:
        return record | {"verdict": "refused", "reason": found.reason}
    gaps = np.array(train.topology.mesh_backlash, dtype=bool)
    bound = np.stack([found.deflection_bound, found.force_bound])
    fine = min(max(FINE, 8 * response.harmonics), MOST)
    if fine < 2 * response.harmonics:
        return record | {"verdict": "no reference"}
    solved = [jaxhb.solve(train, rpm=rpm, harmonics=n, integrals="exact", start=response) for n in (fine // 2, fine)]
    if max(r.residual for r in solved) > 1e-9:
        return record | {"verdict": "no reference"}
    coarse, true, own = (motion(r)[:, gaps] for r in (*solved, response))
    error, doubt = np.abs(true - own).max(-1), np.abs(true - coarse).max(-1)
    size = np.abs(true).max(axis=(1, 2))[:, None]
    sound = error <= bound + doubt + FLOOR * size
    ratio = (bound / np.maximum(error, 1e-300)).max(1)
    record |= {"error": (error / size).max(1).tolist(), "bound": (bound / size).max(1).tolist()}
    record |= {"doubt": (doubt / size).max(1).tolist(), "ratio": ratio.tolist()}
    return record | {"verdict": "sound" if sound.all() else "unsound"}


def report(records):
    """Print verdicts and how large bounds are."""
    for asked in ("solved", "under-resolved", "disturbed"):
        rows = [r for r in records if r["asked"].startswith(asked)]
        told = collections.Counter(r["verdict"] for r in rows)
        print(f"{asked}: {len(rows)}: " + ", ".join(f"{count} {verdict}" for verdict, count in told.most_common()))
        seen = [r for r in rows if "ratio" in r and min(r["error"]) > 10 * max(*r["doubt"], FLOOR)]
        if seen:
            ratio, bound = (np.median([r[key] for r in seen], axis=0) for key in ("ratio", "bound"))
            print(f"  bound / true error, medians: deflection {ratio[0]:.3g}, tooth force {ratio[1]:.3g}")
            print(f"  bound / largest, medians: deflection {bound[0]:.2g}, tooth force {bound[1]:.2g}")
            cost = np.median([r["seconds_certify"] / r["seconds_solve"] for r in seen])
            print(f"  certificate / solve, seconds, median: {cost:.2g}")


SCENES = ("spur_pair", 5000.0), ("engine_with_damper", 1800.0), *(("gear_train_30", r) for r in (600.0, 1200.0, 1800.0))


def scenes():
    """Seconds of a solve and of its certificate, with programs to be compiled or from the store and again; harmonics of
    the solve, and those in which the certificate inverts and evaluates its equation; the same of fewer harmonics."""
    heads = f"{'harmonics':>11}{'low':>6}{'high':>7}{'force kN':>10}{'within kN':>11}"
    print(f"{'scene':20}{'rpm':>6}{'solve s':>18}{'certificate s':>18}{heads}")
    for name, rpm in SCENES:
        train, seconds = jaxhb.load_scene(name), []
        for _ in range(2):
            begin = time.perf_counter()
            response = jaxhb.solve(train, rpm=rpm)
            middle = time.perf_counter()
            found = jaxhb.certify(response)
            seconds.append((middle - begin, time.perf_counter() - middle))
        (first_solve, first), (solve, again) = seconds
        times = f"{first_solve:9.2f}{solve:9.2f}{first:9.2f}{again:9.2f}"
        print(f"{name:20}{rpm:6.0f}{times}{_within(response, found)}", flush=True)
        for share in (2, 4, 8):
            count = max(listed_harmonic(train.topology), response.harmonics // share)
            fewer = jaxhb.solve(train, rpm=rpm, harmonics=count, start=response)
            told = _within(fewer, jaxhb.certify(fewer)) if fewer.residual < 1e-9 else f"{count:11} not solved"
            print(" " * 62 + told, flush=True)


def _within(response, found):
    """Columns of a certificate."""
    force = max(response.force(mesh).peak for mesh in found.meshes) / 1e3
    counts = f"{response.harmonics:11}{found.low:6}{found.high:7}"
    return f"{counts}{force:10.2f}{np.max(found.force_bound) / 1e3:11.2g}"


def starts(train, rpm, harmonics, rng):
    """Responses of ``harmonics`` harmonics that solve the truncated equations, from random starts, no two alike."""
    found = []
    base = jaxhb.solve(train, rpm=rpm, harmonics=harmonics, method="reduced", start="linear")
    h = float(train.meshes.backlash[0])
    for _ in range(STARTS):
        shape = (rng.normal(size=harmonics + 1) + 1j * rng.normal(size=harmonics + 1)) * h
        shape[0] = shape[0].real
        begin = dataclasses.replace(base, deflections=shape[None] / np.arange(1, harmonics + 2) ** 1.5)
        response = jaxhb.solve(train, rpm=rpm, harmonics=harmonics, integrals="exact", start=begin, tolerance=0.99)
        values = response.deflection_samples(256)
        if response.residual < 1e-9 and all(np.abs(values - other).max() > 1e-6 * h for _, other in found):
            found.append((response, values))
    return [response for response, _ in found]


def spurious():
    """Whether motions that do not exist are certified."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    from event_exact import Pair
    from trains import pair_rpm, pair_train

    rng, counts = np.random.default_rng(20261127), collections.Counter()
    for harmonics in (1, 2, 3, 4, 6, 8):
        for speed in np.arange(2, 17) / 10:
            pair = Pair(float(speed), epsilon=1e-3)
            train, rpm = pair_train(pair, transition=0.04), pair_rpm(pair)
            h = float(train.meshes.backlash[0])
            for response in starts(train, rpm, harmonics, rng):
                found, steps = jaxhb.certify(response), None
                bound = found.deflection_bound[0] / h
                for _ in range(2):  # again with four times the steps, where the first were too coarse to judge
                    orbit = jaxhb.shooting_correction(response, steps=steps).orbit
                    steps = 4 * orbit.deflection.shape[1]
                    own = response.deflection_samples(orbit.deflection.shape[1])
                    away = np.abs(own - orbit.deflection).max() / h if orbit.settled else np.inf
                    if bound >= away * (1 - 1e-3):
                        break
                exists = "exists" if away < FAR else "does not"
                verdict = "refused" if not found.holds else "bound reaches" if bound >= away * (1 - 1e-3) else "CHECK"
                counts[harmonics, exists, verdict] += 1
                if exists == "does not" and found.holds or verdict == "CHECK":
                    print(
                        f"{harmonics} harmonics, {speed:.1f}: shooting {away:.3g}, bound {bound:.3g} h: {verdict}",
                        flush=True,
                    )
    print(f"{'harmonics':>9}  {'motion':9}{'refused':>9}{'bound reaches':>15}{'CHECK':>7}")
    for harmonics, exists in sorted({key[:2] for key in counts}):
        row = [counts[harmonics, exists, verdict] for verdict in ("refused", "bound reaches", "CHECK")]
        print(f"{harmonics:9}  {exists:9}{row[0]:9}{row[1]:15}{row[2]:7}")


def main():
    read = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_cases(read, seed=20261126)
    read.add_argument("--scenes", action="store_true")
    read.add_argument("--spurious", action="store_true")
    asked = read.parse_args()
    jaxhb.cache_programs()
    if asked.scenes:
        scenes()
    elif asked.spurious:
        spurious()
    else:
        # Most of the time goes into compiling, and each program serves a few cases.
        _program.OPTIONS["xla_backend_optimization_level"] = 0
        report(run_cases(asked, "certificates", run_case))


if __name__ == "__main__":
    main()
