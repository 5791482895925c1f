"""What random trains do in the long run: ``steady_state`` against a long classical
Runge-Kutta integration.

    python benchmarks/kinds.py [--cases 200] [--seed 20261123] [--json F]      two hours; goes on where the file ends
    python benchmarks/kinds.py --only 17                                       one of them

Cases are those of ``random_trains.py``, drawn as ``stress.py`` draws them. The
integration is independent of jaxhb's: explicit, on disks and links, in numba,
STEPS_PER_PERIOD steps per period of the fastest mode of all. It begins where the march
of ``steady_state`` ended, goes through SETTLING cycles and watches as many more, so
that a motion that does not attract is left and a transient has died. *Wrong* is another
kind or period, or a largest tooth force of any mesh that differs by more than 2 % of
the largest of all (periodic) or lies more than 5 % beyond those of all windows of as
many cycles as were recorded (irregular). Of irregular motion the largest force of so
many cycles is itself a matter of chance: ``spread`` is how far windows of one
integration differ, ``off95`` how far the force that 95 % of the cycles stay below is
off. Cases whose integration would take more than MOST_WORK link steps say nothing.
"""

import collections
import time

import numpy as np
from integrators import runge_kutta_links
from random_trains import random_case
from records import cases_line, run_cases

import jaxhb
from jaxhb.equations import fourier
from jaxhb.equations.state_space import matrices
from jaxhb.train import chain
from jaxhb.train.excitation import excitation, highest_harmonic
from jaxhb.train.mesh_parameters import all_meshes, law_of

STEPS_PER_PERIOD = 20
SETTLING = 256
WATCHED = 256
MOST_WORK = 6e8
"""Steps times links, about a minute."""
RETURNED = 2e-4
"""Largest change of a deflection, over the largest of all and the gap, that counts as a
return.
"""
PERIODS = tuple(range(1, 9))
TOLERANCE = {"periodic": 0.02, "irregular": 0.05}


class Integration:
    """A train at one speed for :func:`integrators.runge_kutta_links`."""

    def __init__(self, train, rpm):
        system = chain.assemble(train)
        law = law_of(train.meshes)
        meshes = all_meshes(train)
        count = len(system.stiffness)
        first = len(system.stiffness) - len(meshes.link)
        self.disk = np.stack(
            [system.damping, system.ground, 1 / np.asarray(system.mass)]
        )
        self.link = np.zeros((6, count))
        self.link[:2] = np.asarray(system.tree.end_a), np.asarray(system.tree.end_b)
        self.link[2:] = system.arm_a, system.arm_b, system.stiffness, system.viscous
        self.mesh = np.zeros((4, count))
        self.mesh[0] = -1.0
        gaps = np.array(train.topology.mesh_backlash, dtype=bool)
        for g in np.flatnonzero(gaps):
            numbers = (
                law.stiffness[g],
                meshes.viscous[g],
                law.backlash[g],
                law.epsilon[g],
                law.transition[g],
            )
            self.link[4:, first + g], self.mesh[:3, first + g] = (
                numbers[:2],
                numbers[2:],
            )
            self.mesh[3, first + g] = bool(meshes.contact_damping[g])
        self.first = first
        K = np.asarray(matrices(system)[1])
        root = np.sqrt(np.asarray(system.mass))
        fastest = np.sqrt(np.linalg.eigvalsh(K / root[:, None] / root).max())
        self.omega = train.topology.cycle_frequency(rpm)
        harmonics = highest_harmonic(train)
        self.steps = (
            int(
                np.ceil(
                    max(STEPS_PER_PERIOD * fastest / self.omega, 8 * harmonics, 256)
                    / 32
                )
            )
            * 32
        )
        torque = (
            np.asarray(excitation(train, rpm, harmonics)[0])
            / np.asarray(system.radius)[:, None]
        )
        self.torque = torque

    @property
    def work(self):
        """Link steps of all cycles."""
        return self.steps * self.link.shape[1] * (SETTLING + WATCHED)

    def run(self, motion):
        """(deflections at 32 instants, extremes of the forces) of the watched cycles,
        of the meshes.
        """
        x, v = (np.array(part) for part in np.split(motion, 2))
        loads = np.ascontiguousarray(fourier.synthesize(self.torque, 2 * self.steps).T)
        dt = 2 * np.pi / self.omega / self.steps
        shared = self.disk, self.link, self.mesh, 32
        runge_kutta_links(x, v, loads, dt, SETTLING, *shared)
        seen, extremes = runge_kutta_links(x, v, loads, dt, WATCHED, *shared)
        return seen[..., self.first :], extremes[..., self.first :]


def period_of(seen, floor):
    """The smallest number of cycles after which the deflections ``(cycles, instants,
    M)`` return, 0 for none.
    """
    scale = np.abs(seen).max(axis=(0, 1)) + floor
    for k in PERIODS:
        if (np.abs(seen[k:] - seen[:-k])[-16:] / scale).max() <= RETURNED:
            return k
    return 0


def judge(train, state):
    """Verdict of the integration: right, wrong (with what was found), or why nothing is
    said.
    """
    integration = Integration(train, state.rpm)
    if integration.work > MOST_WORK:
        return {"verdict": "too long"}
    seen, extremes = integration.run(state.motion)
    if not np.isfinite(extremes).all():
        return {"verdict": "not finite"}
    floor = np.asarray(train.meshes.backlash)
    period = period_of(seen, floor)
    names = train.topology.mesh_names
    told = np.array(
        [[float(state.force(n).max), float(state.force(n).min)] for n in names]
    ).T
    width = state.record.cycles if state.record is not None else WATCHED
    windows = [extremes[i : i + width] for i in range(0, WATCHED - width + 1, 16)]
    high = np.array([w[:, 0].max(axis=0) for w in windows])
    low = np.array([w[:, 1].min(axis=0) for w in windows])
    size = np.abs(extremes).max()
    beyond = np.maximum(told - np.array([high.max(axis=0), low.max(axis=0)]), 0)
    beyond = np.maximum(beyond, np.array([high.min(axis=0), low.min(axis=0)]) - told)
    off = float(beyond.max() / size)
    claimed = 0 if state.kind == "irregular" else state.period
    allowed = TOLERANCE["irregular" if state.kind == "irregular" else "periodic"]
    verdict = "right" if period == claimed and off <= allowed else "wrong"
    apart = extremes[: WATCHED // width * width].reshape(-1, width, *extremes.shape[1:])
    ends = np.stack([apart[:, :, 0].max(axis=1), -apart[:, :, 1].min(axis=1)])
    told95 = np.array(
        [
            [state.force(n).per_cycle.max[2], -state.force(n).per_cycle.min[0]]
            for n in names
        ]
    ).T
    found95 = np.percentile([extremes[:, 0], -extremes[:, 1]], 95, axis=1)
    more = {
        "spread": float(np.ptp(ends, axis=1).max() / size),
        "off95": float(np.abs(told95 - found95).max() / size),
    }
    return {
        "verdict": verdict,
        "found_period": period,
        "off": off,
        "steps": integration.steps,
    } | more


def run_case(seed, index):
    """The record of one case."""
    train, rpm, facts = random_case(np.random.default_rng([seed, index]))
    begin = time.perf_counter()
    state = jaxhb.steady_state(train, rpm=rpm)
    seconds = time.perf_counter() - begin
    record = (
        {"seed": seed, "case": index}
        | facts
        | {"rpm": rpm, "kind": state.kind, "period": state.period}
    )
    record |= {
        "cycles": state.cycles,
        "solved": state.response is not None,
        "notes": list(state.notes),
    }
    record |= {"seconds_first": seconds}
    if state.known:
        record |= judge(train, state)
    return record


def report(records):
    """Print kinds and verdicts."""
    kinds = collections.Counter(r["kind"] for r in records)
    print(
        f"\n{len(records)} cases: "
        + ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    )
    for kind in kinds:
        told = collections.Counter(
            r.get("verdict", "no reason" if not r["notes"] else "a reason")
            for r in records
            if r["kind"] == kind
        )
        print(
            f"  {kind}: "
            + ", ".join(f"{count} {verdict}" for verdict, count in told.most_common())
        )


def main():
    asked = cases_line(__doc__, seed=20261123).parse_args()
    jaxhb.cache_programs()
    report(run_cases(asked, "kinds", run_case))


if __name__ == "__main__":
    main()
