"""Teeth whose stiffness varies and shafts with stages: random trains against Runge-Kutta, and what they cost.

    python benchmarks/meshing.py random [--cases 100] [--seed 1] [--json F]
    python benchmarks/meshing.py cost

*random*: an engine, a clutch with two stages, three gears with two meshes and a shaft with a stop; one structure,
filled with numbers. ``jaxhb.steady_state`` is compared with fixed-step Runge-Kutta of all trains side by side in numpy,
of equations written out here. It begins where jaxhb's march ended, goes through SETTLE cycles, in which a motion that
does not attract is left and a transient dies, and watches LAST more. *Wrong* is another period, or a largest elastic
tooth force that is off by more than 2 % (periodic) or 5 % (irregular, over as many cycles as were recorded).

*cost*: one solve of ``gear_train_30`` under a plan of 512 harmonics, with constant teeth and with three mesh orders.
"""

import argparse
import collections
import dataclasses
import json
import time
from pathlib import Path

import numpy as np

import jaxhb
from jaxhb.scene.writer import elements_of

TEETH, RADII = (20, 30, 25), (0.04, 0.06, 0.05)
STEPS, SETTLE, LAST = 6000, 128, 64  # of a cycle; cycles before those that are watched
RETURNS = 1e-3  # change of a deflection or twist, over the range of all, up to which a motion has returned
OFF = {"periodic": 0.02, "irregular": 0.05}
SMOOTH = 0.04  # half the width of a stage over its twist


def numbers(seed, index):
    """Numbers of a case."""
    rng = np.random.default_rng([seed, index])

    def between(low, high, size=None):
        return np.exp(rng.uniform(np.log(low), np.log(high), size))

    inertia = np.concatenate([between(0.3, 2.0, 1), between(0.005, 0.05, 3), between(0.05, 0.5, 1)])
    mass = inertia[1:4] / np.square(RADII)
    stiffness = between(1e8, 5e8, 2)
    reduced = np.array([mass[k] * mass[k + 1] / (mass[k] + mass[k + 1]) for k in (0, 1)])
    natural = np.sqrt(stiffness / reduced)
    spring, stage = between(500.0, 3000.0), np.sort(rng.uniform(1.0, 5.0, 2))
    share = rng.uniform(0.05, 0.3, 2)[:, None] * np.array([1.0, 0.3]) * np.exp(2j * np.pi * rng.random((2, 2)))
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
        "stages": np.stack([stage, spring * np.cumprod(rng.uniform(1.5, 5.0, 2))], axis=1),
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
        jaxhb.Disk(name=name, inertia=n["inertia"][i], damping=n["drag"][i], **more.get(i, {}))
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
            between=("c", "wheel"), stiffness=n["shaft"], damping=0.01 * n["shaft"] ** 0.5, stops=[n["stop"].tolist()]
        ),
    ]
    for k, pair in enumerate((("a", "b"), ("b", "c"))):
        mesh = jaxhb.Mesh(
            between=pair,
            stiffness=n["stiffness"][k],
            damping=n["damping"][k],
            backlash=n["backlash"][k],
            stiffness_orders=[(j + 1, s.real, s.imag) for j, s in enumerate(n["share"][k])],
            transmission_error=[(1, n["error"][k].real, n["error"][k].imag)],
        )
        parts.append(mesh)
    parts.append(jaxhb.Torque(disk="engine", mean=n["mean"], harmonics=[(2.0, n["order"].real, n["order"].imag)]))
    return jaxhb.build([*parts, jaxhb.Load(disk="wheel")], reference="engine", revolutions_per_cycle=1)


class Equations:
    """Equations of C trains side by side, angles of five disks ``(C, 5)``."""

    def __init__(self, cases):
        self.n = {key: np.array([case[key] for case in cases]) for key in cases[0]}
        self.omega = self.n["rpm"] * np.pi / 30
        self.load = -self.n["mean"] * TEETH[2] / TEETH[0]  # damping of disks takes nothing of the mean

    def knee(self, twist, at):
        width = 2 * SMOOTH * at
        inside = np.clip(twist - (1 - SMOOTH) * at, 0, width)
        return inside**2 / (2 * width) + np.maximum(twist - (1 + SMOOTH) * at, 0)

    def teeth(self, angle, rate, time):
        """Elastic and damping force of the meshes ``(C, 2)``."""
        n = self.n
        turn = np.exp(1j * TEETH[0] * self.omega * time)[:, None]
        share = 1 + (n["share"][:, :, 0] * turn + n["share"][:, :, 1] * turn**2).real
        e = n["error"] * turn
        x, v = angle[:, 1:4] * RADII, rate[:, 1:4] * RADII
        l = x[:, :-1] - x[:, 1:] - e.real
        l_rate = v[:, :-1] - v[:, 1:] - (1j * TEETH[0] * self.omega[:, None] * e).real
        half = n["backlash"] / 2
        width = 2 * SMOOTH * half
        inside = np.clip(np.abs(l) - (1 - SMOOTH) * half, 0, width)
        beyond = np.maximum(np.abs(l) - (1 + SMOOTH) * half, 0)
        elastic = 1e-3 * l + 0.999 * np.sign(l) * (inside**2 / (2 * width) + beyond)
        return share * n["stiffness"] * elastic, n["damping"] * l_rate * inside / width

    def fall(self, state, time):
        n = self.n
        angle, rate = state[:, :5], state[:, 5:]
        force = sum(self.teeth(angle, rate, time))
        twist, other = angle[:, 0] - angle[:, 1], angle[:, 3] - angle[:, 4]
        first = n["spring"] * twist + 0.01 * n["spring"] ** 0.5 * (rate[:, 0] - rate[:, 1])
        before = n["spring"]
        for k in (0, 1):
            at, stiffness = np.deg2rad(n["stages"][:, k, 0]), n["stages"][:, k, 1]
            first = first + (stiffness - before) * np.sign(twist) * self.knee(np.abs(twist), at)
            before = stiffness
        last = n["shaft"] * other + 0.01 * n["shaft"] ** 0.5 * (rate[:, 3] - rate[:, 4])
        last = last + n["stop"][:, 1] * self.knee(other, np.deg2rad(n["stop"][:, 0]))
        driven = n["mean"] + (n["order"] * np.exp(2j * self.omega * time)).real
        r = RADII
        torque = np.stack(
            [
                driven - first,
                first - r[0] * force[:, 0],
                r[1] * (force[:, 0] - force[:, 1]),
                r[2] * force[:, 1] - last,
                last + self.load,
            ],
            axis=1,
        )
        return np.concatenate([rate, (torque - n["drag"] * rate) / n["inertia"]], axis=1)

    def bends(self, state, time):
        """Deflections of meshes, m, and twists of shafts, rad, ``(C, 4)``."""
        x = state[:, 1:4] * RADII
        return np.stack([x[:, 0] - x[:, 1], x[:, 1] - x[:, 2], *(state[:, [0, 3]] - state[:, [1, 4]]).T], axis=1)

    def march(self, state, cycles):
        """The state after some cycles, bends ``(cycles, C, 4)`` at their beginnings and the largest elastic tooth force
        ``(cycles, C)`` in each."""
        dt = (2 * np.pi / self.omega / STEPS)[:, None]
        begins, largest = [], []
        for _ in range(cycles):
            begins.append(self.bends(state, 0.0))
            high = 0.0
            for k in range(STEPS):
                time = k * dt[:, 0]
                a = self.fall(state, time)
                b = self.fall(state + dt / 2 * a, time + dt[:, 0] / 2)
                c = self.fall(state + dt / 2 * b, time + dt[:, 0] / 2)
                d = self.fall(state + dt * c, time + dt[:, 0])
                state = state + dt / 6 * (a + 2 * b + 2 * c + d)
                high = np.maximum(high, np.abs(self.teeth(state[:, :5], state[:, 5:], time + dt[:, 0])[0]).max(axis=1))
            largest.append(high)
        return state, np.array(begins), np.array(largest)


def period_of(begins):
    """Cycles after which bends ``(cycles, 4)`` return, 0 where they do not within 8."""
    size = np.abs(begins).max(axis=0)
    off = [(np.abs(begins[p:] - begins[:-p]) / size).max() for p in range(1, 9)]
    return next((p for p, one in enumerate(off, 1) if one < RETURNS), 0)


def random(cases, seed, out):
    """Compare; prints what is wrong and how often."""
    given = [numbers(seed, i) for i in range(cases)]
    states, begin = [], time.perf_counter()
    for n in given:
        states.append(jaxhb.steady_state(train_of(n), rpm=n["rpm"]))
    taken = time.perf_counter() - begin
    known = [i for i, state in enumerate(states) if state.known]
    equations = Equations([given[i] for i in known])
    radius = np.array([RADII[0], *RADII, RADII[2]])  # an arm of a rotor is that of its first gear
    motion = np.array([np.asarray(states[i].motion) for i in known]).reshape(len(known), 2, 5) / radius
    state, _, _ = equations.march(motion.reshape(len(known), 10), SETTLE)
    _, begins, largest = equations.march(state, LAST)
    rows = []
    for k, i in enumerate(known):
        found, period = states[i], period_of(begins[:, k])
        ours = max(float(found.force(name).elastic.peak) for name in ("a|b", "b|c"))
        off = abs(ours / largest[:, k].max() - 1)
        kind = "periodic" if found.period else "irregular"
        row = {"case": i, "kind": found.kind, "period": found.period, "integrated": period, "off": off}
        rows.append(row | {"wrong": bool(period != found.period or off > OFF[kind])})
        if rows[-1]["wrong"]:
            told = f"{found.kind} {found.period}, integrated {period}, force {off:.2%} off"
            print(f"case {i} at {found.rpm:.0f} rpm: {told}")
    kinds = collections.Counter(row["kind"] for row in rows)
    wrong = sum(row["wrong"] for row in rows)
    worst = max((row["off"] for row in rows if row["period"] and not row["wrong"]), default=0.0)
    print(f"seed {seed}: {wrong} of {cases} wrong, {cases - len(known)} unknown; {dict(kinds)}")
    print(f"{taken:.0f} s for all steady states, compiling included")
    print(f"largest difference of a tooth force of the others with a period: {worst:.2%}")
    if out:
        out.write_text("".join(json.dumps(row) + "\n" for row in rows))


def cost():
    """Times of one solve under a plan, interleaved."""
    made, times = elements_of("gear_train_30"), {}
    before = jaxhb.load_scene("gear_train_30").topology
    reference = before.disk_names[before.rotor.index(before.reference_rotor)]
    for name, orders in (("constant", ()), ("three orders", tuple((k, 0.15 / k, 0.05 / k) for k in (1, 2, 3)))):
        parts = []
        for part in made.values():
            if isinstance(part, jaxhb.Disk) and part.radius:
                part = dataclasses.replace(part, teeth=round(part.radius / 0.0025))
            parts.append(dataclasses.replace(part, stiffness_orders=orders) if isinstance(part, jaxhb.Mesh) else part)
        train = jaxhb.build(parts, reference=reference, revolutions_per_cycle=2)
        for rpm in (1422.0, 1800.0):
            times[name, rpm] = (train, rpm, jaxhb.plan(train, rpm=rpm, harmonics=512), [])
    for _ in range(12):
        for train, rpm, plan, own in times.values():
            begin = time.perf_counter()
            found = jaxhb.solve(train, rpm=rpm, plan=plan, start="march")
            own.append((time.perf_counter() - begin, int(found.steps)))
    for (name, rpm), (*_, own) in times.items():
        print(f"{name:12s} {rpm:6.0f} rpm: {1e3 * min(one for one, _ in own[2:]):6.1f} ms, {own[0][1]} Newton steps")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
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
