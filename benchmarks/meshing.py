"""Teeth whose stiffness varies and shafts with stages: random trains against
Runge-Kutta, and what they cost.

    python benchmarks/meshing.py random [--cases 100] [--seed 1] [--json F]
    python benchmarks/meshing.py cost

*random*: an engine, a clutch with two stages, three gears with two meshes and a shaft
with a stop; one structure, filled with numbers. ``jaxhb.steady_state`` is compared with
fixed-step Runge-Kutta in numba, of equations written out here. It begins with jaxhb's
solution, or where its march ended, goes through SETTLE cycles, in which a motion that
does not attract is left, and watches LAST more. *Wrong* is another period, or a largest
elastic tooth force that is off by more than 2 % (periodic), or lies more than 5 %
beyond those of all windows of as many cycles as were recorded.

*cost*: one solve of ``gear_train_30`` under a plan of 512 harmonics, with constant
teeth and with three mesh orders.
"""

import argparse
import collections
import dataclasses
import json
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numba import njit
from records import device, versions

import jaxhb
from jaxhb.equations import fourier
from jaxhb.scene.writer import elements_of

TEETH = (20, 30, 25)
RADII = (0.04, 0.06, 0.05)
STEPS, SETTLE, LAST = 5000, 256, 256  # of a cycle; cycles before those that are watched
RECORDED = 64  # cycles of a record
# Change of a deflection or twist, over the range of all, up to which a motion has
# returned
RETURNED = 2e-4
OFF = {"periodic": 0.02, "irregular": 0.05}
SMOOTH = 0.04  # half the width of a stage over its twist


def numbers(seed, index):
    """Numbers of a case."""
    rng = np.random.default_rng([seed, index])

    def between(low, high, size=None):
        return np.exp(rng.uniform(np.log(low), np.log(high), size))

    inertia = np.concatenate(
        [between(0.3, 2.0, 1), between(0.005, 0.05, 3), between(0.05, 0.5, 1)]
    )
    mass = inertia[1:4] / np.square(RADII)
    stiffness = between(1e8, 5e8, 2)
    reduced = np.array(
        [mass[k] * mass[k + 1] / (mass[k] + mass[k + 1]) for k in (0, 1)]
    )
    natural = np.sqrt(stiffness / reduced)
    spring = between(500.0, 3000.0)
    stage = np.sort(rng.uniform(1.0, 5.0, 2))
    share = (
        rng.uniform(0.05, 0.3, 2)[:, None]
        * np.array([1.0, 0.3])
        * np.exp(2j * np.pi * rng.random((2, 2)))
    )
    mean = between(10.0, 200.0)
    return {
        "rpm": rng.uniform(0.3, 2.2) * natural.min() / TEETH[0] * 30 / np.pi,
        "inertia": inertia,
        "drag": 0.02 * inertia * spring**0.5,
        "stiffness": stiffness,
        "damping": 2 * rng.uniform(0.03, 0.1, 2) * np.sqrt(stiffness * reduced),
        "backlash": between(5e-5, 3e-4, 2),
        "share": share,
        "error": rng.uniform(1e-6, 8e-6, 2) * np.exp(2j * np.pi * rng.random(2)),
        "spring": spring,
        "stages": np.stack(
            [stage, spring * np.cumprod(rng.uniform(1.5, 5.0, 2))], axis=1
        ),
        "shaft": between(2e3, 2e4),
        "stop": np.array([rng.uniform(0.3, 2.0), between(1e3, 2e4)]),
        "mean": mean,
        "order": mean * rng.uniform(0.2, 2.0) * np.exp(2j * np.pi * rng.random()),
    }


def train_of(n):
    """The case as a train."""
    names = "engine", "a", "b", "c", "wheel"
    gears = {1: 0, 2: 1, 3: 2}
    more = {i: {"radius": RADII[k], "teeth": TEETH[k]} for i, k in gears.items()}
    parts = [
        jaxhb.Disk(
            name=name, inertia=n["inertia"][i], damping=n["drag"][i], **more.get(i, {})
        )
        for i, name in enumerate(names)
    ]
    parts += [
        jaxhb.Shaft(
            between=("engine", "a"),
            stiffness=n["spring"],
            damping=0.01 * n["spring"] ** 0.5,
            stages=n["stages"].tolist(),
        ),
        jaxhb.Shaft(
            between=("c", "wheel"),
            stiffness=n["shaft"],
            damping=0.01 * n["shaft"] ** 0.5,
            stops=[n["stop"].tolist()],
        ),
    ]
    for k, pair in enumerate((("a", "b"), ("b", "c"))):
        mesh = jaxhb.Mesh(
            between=pair,
            stiffness=n["stiffness"][k],
            damping=n["damping"][k],
            backlash=n["backlash"][k],
            stiffness_orders=[
                (j + 1, s.real, s.imag) for j, s in enumerate(n["share"][k])
            ],
            transmission_error=[(1, n["error"][k].real, n["error"][k].imag)],
        )
        parts.append(mesh)
    parts.append(
        jaxhb.Torque(
            disk="engine",
            mean=n["mean"],
            harmonics=[(2.0, n["order"].real, n["order"].imag)],
        )
    )
    return jaxhb.build(
        [*parts, jaxhb.Load(disk="wheel")], reference="engine", revolutions_per_cycle=1
    )


@njit(nogil=True)
def knee(x, at, width):
    """A ramp that begins at ``at``, its slope rising over ``width``."""
    inside = min(max(x - at + width / 2, 0.0), width)
    return inside * inside / (2 * width) + max(x - at - width / 2, 0.0)


@njit(nogil=True)
def fall(
    y,
    time,
    omega,
    inertia,
    drag,
    tooth,
    share,
    error,
    links,
    stages,
    drive,
    rate,
    force,
):
    """Rates ``(10,)`` of angles and speeds of the five disks; elastic forces of the two
    meshes.

    tooth : rows of stiffness, damping, backlash; links : stiffness of clutch and shaft,
    twist and stiffness of the stop; drive : mean and order 2 of the torque.
    """
    turn = np.exp(1j * TEETH[0] * omega * time)
    torque = np.zeros(5)
    torque[0] = drive[0].real + (drive[1] * np.exp(2j * omega * time)).real
    torque[4] = -drive[0].real * TEETH[2] / TEETH[0]
    for k in range(2):
        a = RADII[k]
        b = RADII[k + 1]
        e = error[k] * turn
        l = a * y[1 + k] - b * y[2 + k] - e.real
        l_rate = a * y[6 + k] - b * y[7 + k] - (1j * TEETH[0] * omega * e).real
        half = tooth[2, k] / 2
        width = 2 * SMOOTH * half
        inside = min(max(abs(l) - (1 - SMOOTH) * half, 0.0), width)
        elastic = 1e-3 * l + 0.999 * np.sign(l) * knee(abs(l), half, width)
        force[k] = (
            (1 + (share[k, 0] * turn + share[k, 1] * turn**2).real)
            * tooth[0, k]
            * elastic
        )
        total = force[k] + tooth[1, k] * l_rate * inside / width
        torque[1 + k] -= a * total
        torque[2 + k] += b * total
    twist = y[0] - y[1]
    other = y[3] - y[4]
    clutch = links[0] * twist + 0.01 * np.sqrt(links[0]) * (y[5] - y[6])
    before = links[0]
    for k in range(2):
        clutch += (
            (stages[k, 1] - before)
            * np.sign(twist)
            * knee(abs(twist), stages[k, 0], 2 * SMOOTH * stages[k, 0])
        )
        before = stages[k, 1]
    shaft = links[1] * other + 0.01 * np.sqrt(links[1]) * (y[8] - y[9])
    shaft += links[3] * knee(other, links[2], 2 * SMOOTH * links[2])
    torque[0] -= clutch
    torque[1] += clutch
    torque[3] -= shaft
    torque[4] += shaft
    for i in range(5):
        rate[i] = y[5 + i]
        rate[5 + i] = (torque[i] - drag[i] * y[5 + i]) / inertia[i]


@njit(nogil=True)
def march(y, cycles, omega, inertia, drag, tooth, share, error, links, stages, drive):
    """Deflections of the meshes and twists of the shafts ``(cycles, 4)`` at the
    beginnings of cycles, and the largest elastic tooth force ``(cycles,)`` in each;
    ``y`` is taken along.
    """
    bends = np.zeros((cycles, 4))
    largest = np.zeros(cycles)
    force = np.zeros(2)
    dt = 2 * np.pi / omega / STEPS
    a = np.zeros(10)
    b = np.zeros(10)
    c = np.zeros(10)
    d = np.zeros(10)
    given = omega, inertia, drag, tooth, share, error, links, stages, drive
    for m in range(cycles):
        bends[m, 0], bends[m, 1] = (
            RADII[0] * y[1] - RADII[1] * y[2],
            RADII[1] * y[2] - RADII[2] * y[3],
        )
        bends[m, 2], bends[m, 3] = y[0] - y[1], y[3] - y[4]
        for k in range(STEPS):
            fall(y, k * dt, *given, a, force)
            largest[m] = max(largest[m], abs(force[0]), abs(force[1]))
            fall(y + dt / 2 * a, (k + 0.5) * dt, *given, b, force)
            fall(y + dt / 2 * b, (k + 0.5) * dt, *given, c, force)
            fall(y + dt * c, (k + 1) * dt, *given, d, force)
            y += dt / 6 * (a + 2 * b + 2 * c + d)
    return bends, largest


def integrated(n, state):
    """Bends and largest forces of the cycles that are watched, from a steady state of
    the case.
    """
    omega = n["rpm"] * np.pi / 30
    y = np.asarray(state.motion).reshape(2, 5) / [
        RADII[0],
        *RADII,
        RADII[2],
    ]  # an arm is that of the rotor's first gear
    if state.response is not None:
        angles = np.asarray(state.response.angles)
        y = np.stack(
            [
                fourier.sample(a, 1)[:, 0]
                for a in (
                    angles,
                    fourier.derivative(angles, omega / max(state.period, 1)),
                )
            ]
        )
    stages = np.stack([np.deg2rad(n["stages"][:, 0]), n["stages"][:, 1]], axis=1)
    links = np.array([n["spring"], n["shaft"], np.deg2rad(n["stop"][0]), n["stop"][1]])
    tooth = np.stack([n["stiffness"], n["damping"], n["backlash"]])
    given = omega, n["inertia"], n["drag"], tooth, n["share"], n["error"], links, stages
    y = np.ascontiguousarray(y.ravel())
    drive = np.array([n["mean"], n["order"]], complex)
    march(y, SETTLE, *given, drive)
    return march(y, LAST, *given, drive)


def period_of(bends):
    """Cycles after which bends ``(cycles, 4)`` return, 0 where they do not within 8."""
    size = np.abs(bends).max(axis=0)
    off = [(np.abs(bends[p:] - bends[:-p]) / size).max() for p in range(1, 9)]
    return next((p for p, one in enumerate(off, 1) if one < RETURNED), 0)


def judged(index, state, bends, largest):
    """The row of a case."""
    period = period_of(bends)
    ours = max(float(state.force(name).elastic.peak) for name in ("a|b", "b|c"))
    windows = largest.reshape(-1, RECORDED).max(axis=1)
    off = max(ours / windows.max() - 1, 1 - ours / windows.min(), 0.0)
    wrong = (
        period != state.period or off > OFF["periodic" if state.period else "irregular"]
    )
    row = {
        "case": index,
        "rpm": state.rpm,
        "kind": state.kind,
        "period": state.period,
        "integrated": period,
    }
    return row | {
        "off": off,
        "spread": windows.max() / windows.min() - 1,
        "wrong": bool(wrong),
    }


def random(cases, seed, out):
    """Compare; prints what is wrong and how often."""
    given = [numbers(seed, i) for i in range(cases)]
    begin = time.perf_counter()
    states = [jaxhb.steady_state(train_of(n), rpm=n["rpm"]) for n in given]
    taken = time.perf_counter() - begin
    known = [i for i, state in enumerate(states) if state.known]
    with ThreadPoolExecutor() as pool:
        found = list(pool.map(lambda i: integrated(given[i], states[i]), known))
    rows = [judged(i, states[i], *one) for i, one in zip(known, found, strict=True)]
    for row in rows:
        if row["wrong"]:
            told = (
                f"{row['kind']} {row['period']}, integrated {row['integrated']}, force"
                f" {row['off']:.2%} off"
            )
            print(
                f"case {row['case']} at {row['rpm']:.0f} rpm: {told}, windows differ by"
                f" {row['spread']:.0%}"
            )
    kinds = collections.Counter(row["kind"] for row in rows)
    wrong = sum(row["wrong"] for row in rows)
    worst = max(
        (row["off"] for row in rows if row["period"] and not row["wrong"]), default=0.0
    )
    print(
        f"seed {seed}: {wrong} of {cases} wrong, {cases - len(known)} unknown;"
        f" {dict(kinds)}"
    )
    print(f"{taken:.0f} s for all steady states, compiling included")
    print(
        f"largest difference of a tooth force of the others with a period: {worst:.2%}"
    )
    if out:
        common = {
            "benchmark": "meshing",
            "device": device(),
            "versions": versions(),
            "seed": seed,
        }
        out.write_text("".join(json.dumps(common | row) + "\n" for row in rows))


def cost():
    """Times of one solve under a plan, interleaved."""
    made = elements_of("gear_train_30")
    times = {}
    before = jaxhb.load_scene("gear_train_30").topology
    reference = before.disk_names[before.rotor.index(before.reference_rotor)]
    for name, orders in (
        ("constant", ()),
        ("three orders", tuple((k, 0.15 / k, 0.05 / k) for k in (1, 2, 3))),
    ):
        parts = []
        for part in made.values():
            if isinstance(part, jaxhb.Disk) and part.radius:
                part = dataclasses.replace(part, teeth=round(part.radius / 0.0025))
            parts.append(
                dataclasses.replace(part, stiffness_orders=orders)
                if isinstance(part, jaxhb.Mesh)
                else part
            )
        train = jaxhb.build(parts, reference=reference, revolutions_per_cycle=2)
        for rpm in (1422.0, 1800.0):
            times[name, rpm] = (
                train,
                rpm,
                jaxhb.plan(train, rpm=rpm, harmonics=512),
                [],
            )
    for _ in range(12):
        for train, rpm, plan, own in times.values():
            begin = time.perf_counter()
            found = jaxhb.solve(train, rpm=rpm, plan=plan, start="march")
            own.append((time.perf_counter() - begin, int(found.steps)))
    for (name, rpm), (*_, own) in times.items():
        print(
            f"{name:12s} {rpm:6.0f} rpm: {1e3 * min(one for one, _ in own[2:]):6.1f}"
            f" ms, {own[0][1]} Newton steps"
        )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("random", "cost"))
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    if asked.what == "cost":
        cost()
    else:
        random(asked.cases, asked.seed, asked.json)


if __name__ == "__main__":
    main()
