"""Accuracy of the periodic response of gear_train_30 against time integration, and what backlash does to the gears.

    python benchmarks/gear_train_accuracy.py reference     the three speeds of the reference integration
    python benchmarks/gear_train_accuracy.py speeds        ten speeds: error against shooting at rising harmonics
    python benchmarks/gear_train_accuracy.py laws          the same for other gaps, transitions and damping laws
    python benchmarks/gear_train_accuracy.py laws contact  one damping law alone
    python benchmarks/gear_train_accuracy.py times         compile time and run time at 64 and 256 harmonics

Errors are sup-norm errors of the elastic tooth forces over the cycle and all meshes, relative to the largest tooth
force; the reference integration is one cycle of time integration from the harmonic solution, closed by Newton's method.
"""

import argparse
import dataclasses
import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxhb
from jaxhb.balance.problem import problem_at
from jaxhb.balance.program import Start, solve_problem

SPEEDS = np.linspace(600.0, 2450.0, 10)
STEPS_AT_1_RPM = 40 * 4333 * 120
"""Of the reference integration: 40 steps per period of the highest mesh mode, 4333 Hz, whatever the law."""

REFERENCE = Path(__file__).parents[1] / "tests" / "data" / "gear_train_30.json"


def reference(train):
    """Elastic tooth forces and separation at the three speeds of the reference integration."""
    expected = json.loads(REFERENCE.read_text())["expected_behaviour"]
    print(
        "rpm    N    mesh                     max N (ref)         min N (ref)         rms N (ref)       apart % (ref)"
    )
    for rpm in (600, 1200, 1800):
        response = jaxhb.check(jaxhb.solve(train, rpm=float(rpm), tolerance=0.003))
        row = expected[str(rpm)]
        for i, name in enumerate(train.topology.mesh_names):
            force, contact = response.force(name).elastic, response.mesh(name)
            pairs = [
                (force.max, row["elastic_force_max_N"][i]),
                (force.min, row["elastic_force_min_N"][i]),
                (force.rms, row["elastic_force_rms_N"][i]),
                (100 * contact.separated_fraction, row["separated_percent"][i]),
            ]
            figures = "  ".join(f"{float(a):9.1f} ({b:8.1f})" for a, b in pairs)
            print(f"{rpm:5d} {response.harmonics:4d}  {name:22s} {figures}")
        moments = response.gear_torque("crank gear").peak, linear(train, rpm).gear_torque("crank gear").peak
        print(f"       crank gear peak moment {moments[0]:.1f} N m, linear {moments[1]:.1f}, reference", end=" ")
        print(row["gear_11_peak_moment_transmitted_Nm"])


def linear(train, rpm):
    """The response with all teeth in contact."""
    return jaxhb.linear_response(train, rpm=float(rpm))


def speeds(train, levels=(256, 384, 512, 768, 1024)):
    """Error against shooting at ten speeds and rising harmonics; the ratio of the crank gear's moment."""
    print("error against shooting (in brackets: status other than CONVERGED, TOLERANCE_NOT_MET)")
    head = "".join(f"  N={n:<7d}" for n in levels)
    print(f"   rpm  closure of 30 cycles {head}  max ratio  half p-p ratio  apart %")
    for rpm in SPEEDS:
        cells, last = [], None
        for harmonics in levels:
            response = jaxhb.solve(train, rpm=rpm, harmonics=harmonics)
            status = jaxhb.Status(int(response.status))
            if status > jaxhb.Status.TOLERANCE_NOT_MET:
                cells.append(f"[{status.name[:7]}]")
                continue
            cells.append(f"{jaxhb.shooting_correction(response).error:.1e}")
            last = response
        periodicity_error = jaxhb.integrate(train, rpm=rpm, cycles=30).periodicity_error
        gear, straight = last.gear_torque("crank gear"), linear(train, rpm).gear_torque("crank gear")
        apart = max(c.separated_fraction for c in last.contacts().values())
        print(
            f"{rpm:6.0f}  {periodicity_error:20.1e} " + "".join(f"  {c:9s}" for c in cells),
            f" {gear.max / straight.max:9.2f}  {gear.half_peak_to_peak / straight.half_peak_to_peak:14.2f}"
            f"  {100 * apart:7.1f}",
            flush=True,
        )


def with_law(train, epsilon, transition, damping_law):
    """The train with other numbers in the law of all meshes."""
    count = len(train.topology.mesh_names)
    topology = dataclasses.replace(train.topology, mesh_damping_law=(damping_law,) * count)
    meshes = dataclasses.replace(train.meshes, epsilon=np.full(count, epsilon), transition=np.full(count, transition))
    return dataclasses.replace(train, topology=topology, meshes=meshes)


def laws(train, damping_laws=("always", "contact")):
    """Ten speeds for every gap stiffness, transition and damping law at the default tolerance of 1 %."""
    print("per law: converged speeds of 10, Newton-reported and true error (worst), crank gear moment ratios (worst)")
    columns = "damping   epsilon  transition  converged  harmonics  estimate  true error"
    print(columns + "  max ratio  half p-p ratio  settled")
    for damping_law in damping_laws:
        for epsilon in (3e-2, 3e-3, 1e-3):
            for transition in (0.2, 0.04, 0.01):
                _law_row(with_law(train, epsilon, transition, damping_law), damping_law, epsilon, transition)


def _law_row(train, damping_law, epsilon, transition):
    rows, failed = [], []
    for rpm in SPEEDS:
        response = jaxhb.solve(train, rpm=rpm)
        if not response.converged:
            failed.append(f"{rpm:.0f} rpm {jaxhb.Status(int(response.status)).name}")
            continue
        gear, straight = response.gear_torque("crank gear"), linear(train, rpm).gear_torque("crank gear")
        steps = round(STEPS_AT_1_RPM / rpm)
        correction = jaxhb.shooting_correction(response, steps=steps)
        if not correction.orbit.settled:
            failed.append(
                f"{rpm:.0f} rpm: shooting leaves a closure of {correction.orbit.periodicity_error:.1e}, error not known"
            )
        rows.append(
            (
                response.harmonics,
                response.truncation_error,
                correction.error if correction.orbit.settled else np.nan,
                gear.max / straight.max,
                gear.half_peak_to_peak / straight.half_peak_to_peak,
                jaxhb.integrate(train, rpm=rpm, cycles=30, steps=steps).periodicity_error < 1e-6,
            )
        )
    columns = np.array(rows, dtype=float).T
    print(
        f"{damping_law:8s}  {epsilon:7.0e}  {transition:10.2f}  {len(rows):6d}/10  {columns[0].max():9.0f}"
        f"  {columns[1].max():8.1e}  {np.nanmax(columns[2]):10.1e}  {columns[3].max():9.2f}  {columns[4].max():14.2f}"
        f"  {columns[5].sum():4.0f}/10  {'; '.join(failed)}",
        flush=True,
    )


def times(train):
    """Compile time and run time of one planned solve, Newton from a march, at 64 and 256 harmonics."""
    print("harmonics   rpm  compile s  run s  Newton steps  status")
    for harmonics, rpm in ((64, 1200.0), (256, 2450.0)):
        plan = jaxhb.plan(train, rpm=rpm, harmonics=harmonics)
        problem = problem_at(train, rpm, plan.sizes.excited)
        nothing = jnp.zeros((len(plan.active_meshes.mask), harmonics + 1), dtype=complex)
        start = Start(nothing, np.array(False), np.array(plan.cycles))
        jax.clear_caches()
        begin = time.perf_counter()
        given = problem, plan.active_meshes, start, jnp.asarray(plan.tolerance)
        program = jax.jit(solve_problem.function, static_argnames="sizes").lower(*given, plan.sizes).compile()
        compiled = time.perf_counter() - begin
        runs = []
        for _ in range(5):
            begin = time.perf_counter()
            outcome = jax.block_until_ready(program(*given))
            runs.append(time.perf_counter() - begin)
        status = jaxhb.Status(int(outcome.status)).name
        print(
            f"{harmonics:9d}  {rpm:4.0f}  {compiled:9.2f}  {np.median(runs):5.3f}  {int(outcome.steps):12d}  {status}"
        )


PARTS = {"reference": reference, "speeds": speeds, "laws": laws, "times": times}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("damping_law", nargs="?", choices=("always", "contact"), help="for laws: this one alone")
    chosen = parser.parse_args()
    scene = jaxhb.load_scene("gear_train_30")
    if chosen.damping_law:
        laws(scene, (chosen.damping_law,))
    else:
        PARTS[chosen.part](scene)
