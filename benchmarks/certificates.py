"""Error bounds against true errors: random trains, under-resolved and perturbed
motions.

    python benchmarks/certificates.py [--cases 200] [--seed 20261126] [--json F]     hours; goes on where the file ends
    python benchmarks/certificates.py --only 17                                     one of them

Cases are those of ``random_trains.py`` with up to 27 disks and four meshes; every
eighth is solved with about a quarter of the harmonics, every eighth is disturbed by 0.1
% to 10 % of a backlash in all deflections. The true motion is a solve with exact
integrals and FINE harmonics, eight times those of the response where there are so many,
begun at it; its error is what another with half as many differs from it. *Unsound*: a
certificate whose bound is less than the true error of a deflection or of a tooth force
of any mesh.
"""

import collections
import dataclasses
import time

import jax
import numpy as np
from random_trains import random_case
from records import cases_line, run_cases

import jaxhb
import jaxhb.equations.backlash
from jaxhb import _program
from jaxhb.equations import fourier
from jaxhb.train.excitation import listed_harmonic
from jaxhb.train.mesh_parameters import law_of

FINE = 2048
MOST = 4096
DISKS = 27
MESHES = 4
FLOOR = 1e-8
"""Errors below this share of the largest are not judged: the equations of the reference
are solved to 1e-10.
"""
SAMPLES = 2**16


def motion(response):
    """Deflections and tooth forces ``(2, G, SAMPLES)`` of the meshes."""
    names = response.topology.mesh_names
    frequency = response.topology.cycle_frequency(float(response.rpm))
    deflection = np.asarray(response.deflections)
    value = fourier.synthesize(deflection, SAMPLES)
    rate = fourier.synthesize(fourier.derivative(deflection, frequency), SAMPLES)
    train = response.train
    law = jax.tree.map(np.asarray, law_of(train.meshes)).expand()
    gated = np.array([law == "contact" for law in train.topology.mesh_damping_law])[
        :, None
    ]
    viscous = np.asarray(train.meshes.damping)[:, None]
    force = jaxhb.equations.backlash.mesh_force(law, viscous, gated, value, rate)
    assert len(names) == len(force)
    return np.stack([value, force])


def disturbed(response, rng, size):
    """The response with deflections off by ``size`` backlashes (largest value)."""
    h = np.asarray(response.train.meshes.backlash)[:, None]
    shape = np.asarray(response.deflections).shape
    noise = rng.normal(size=shape) + 1j * rng.normal(size=shape) * (
        np.arange(shape[1]) > 0
    )
    noise = noise / (1 + np.arange(shape[1])) ** 1.5
    noise = noise / np.abs(fourier.synthesize(noise, 16 * shape[1])).max()
    return dataclasses.replace(
        response, deflections=response.deflections + size * h * noise
    )


def run_case(seed, index):
    """The record of one case."""
    draw = 0
    while True:
        train, rpm, facts = random_case(np.random.default_rng([seed, index, draw]))
        if facts["meshes"] <= MESHES and facts["disks"] <= DISKS:
            break
        draw += 1
    rng = np.random.default_rng([seed, index, 1000])
    record = {"seed": seed, "case": index} | {
        key: facts[key] for key in ("skeleton", "meshes", "zeta", "load")
    }
    begin = time.perf_counter()
    response = jaxhb.solve(train, rpm=rpm)
    record |= {
        "rpm": rpm,
        "status": response.status.item(),
        "harmonics": response.harmonics,
        "asked": "solved",
    }
    record |= {"seconds_solve": time.perf_counter() - begin}
    if not response.converged:
        return record | {"verdict": "not solved"}
    if index % 8 == 3:
        fewer = max(
            listed_harmonic(train.topology),
            1 << (response.harmonics // 3).bit_length() - 1,
        )
        fewer = jaxhb.solve(train, rpm=rpm, harmonics=fewer, start=response)
        if fewer.status <= 1:
            record["asked"], response = "under-resolved", fewer
    if index % 8 == 7:
        size = 10 ** rng.uniform(-3, -1)
        record["asked"], response = (
            f"disturbed {size:.2g}",
            disturbed(response, rng, size),
        )
    begin = time.perf_counter()
    try:
        found = jaxhb.certify(response)
    except ValueError as error:
        return record | {"verdict": "refused", "reason": str(error)}
    record |= {
        "seconds_certify": time.perf_counter() - begin,
        "Y0": found.Y0,
        "Z1": found.Z1,
        "Z2": found.Z2,
    }
    record |= {"low": found.low, "small_gain": found.small_gain}
    if not found.holds:
        return record | {"verdict": "refused", "reason": found.reason}
    gaps = np.array(train.topology.mesh_backlash, dtype=bool)
    bound = np.stack([found.deflection_bound, found.force_bound])
    fine = min(max(FINE, 8 * response.harmonics), MOST)
    if fine < 2 * response.harmonics:
        return record | {"verdict": "no reference"}
    solved = [
        jaxhb.solve(train, rpm=rpm, harmonics=n, integrals="exact", start=response)
        for n in (fine // 2, fine)
    ]
    if max(r.residual for r in solved) > 1e-9:
        return record | {"verdict": "no reference"}
    coarse, true, own = (motion(r)[:, gaps] for r in (*solved, response))
    error = np.abs(true - own).max(-1)
    doubt = np.abs(true - coarse).max(-1)
    size = np.abs(true).max(axis=(1, 2))[:, None]
    sound = error <= bound + doubt + FLOOR * size
    ratio = (bound / np.maximum(error, 1e-300)).max(1)
    record |= {
        "error": (error / size).max(1).tolist(),
        "bound": (bound / size).max(1).tolist(),
    }
    record |= {"doubt": (doubt / size).max(1).tolist(), "ratio": ratio.tolist()}
    return record | {"verdict": "sound" if sound.all() else "unsound"}


def report(records):
    """Print verdicts and how large bounds are."""
    for asked in ("solved", "under-resolved", "disturbed"):
        rows = [r for r in records if r["asked"].startswith(asked)]
        told = collections.Counter(r["verdict"] for r in rows)
        print(
            f"{asked}: {len(rows)}: "
            + ", ".join(f"{count} {verdict}" for verdict, count in told.most_common())
        )
        seen = [
            r
            for r in rows
            if "ratio" in r and min(r["error"]) > 10 * max(*r["doubt"], FLOOR)
        ]
        if seen:
            ratio, bound = (
                np.median([r[key] for r in seen], axis=0) for key in ("ratio", "bound")
            )
            print(
                f"  bound / true error, medians: deflection {ratio[0]:.3g}, tooth force"
                f" {ratio[1]:.3g}"
            )
            print(
                f"  bound / largest, medians: deflection {bound[0]:.2g}, tooth force"
                f" {bound[1]:.2g}"
            )
            cost = np.median([r["seconds_certify"] / r["seconds_solve"] for r in seen])
            print(f"  certificate / solve, seconds, median: {cost:.2g}")


def main():
    asked = cases_line(__doc__, seed=20261126).parse_args()
    jaxhb.cache_programs()
    # Most of the time goes into compiling, and each program serves a few cases.
    _program.OPTIONS["xla_backend_optimization_level"] = 0
    report(run_cases(asked, "certificates", run_case))


if __name__ == "__main__":
    main()
