"""Gradients for design: what they cost, against differences of a compiled integrator, and what a tuning wins.

    python benchmarks/design_gradients.py                      all figures, about 15 minutes on one core
    python benchmarks/design_gradients.py cost rivals          some of: cost, rivals, tuning
    python benchmarks/design_gradients.py --json rows.jsonl
    python benchmarks/design_gradients.py --quick              few speeds, few steps

The train is ``engine_with_damper`` with its loss factors turned into viscous damping at 217 Hz, its first crankshaft
mode: loss factors cannot be integrated in time. The quantity is the tooth force between crank gear and idler, half
peak-to-peak, its smooth maximum over the speeds. One core, run time without compilation, medians of repeats.

- ``cost``: value and gradient over value, for 1, 10 and 100 parameters; cold (from a march at every speed) and warm
  (from the solution).
- ``rivals``: the gradient over 50 speeds by central differences, two sweeps per parameter, of Runge-Kutta from the
  linear motion on the flanks until two cycles agree within 1 % (at most 100 cycles; that is enough for the force, not
  for accurate differences). One sweep is timed, and counted twice per parameter.
- ``tuning``: worst tooth force over 600 to 2600 rpm before and after, and the tuned train at five speeds that the
  tuning did not see, against Runge-Kutta until two cycles agree within 1e-4.
"""

import argparse
from functools import partial

import jax
import numpy as np
from marches import march
from records import run_parts, timed
from tasks import fastest_rate, prepare

import jaxhb
from jaxhb.design import evaluation
from jaxhb.design.quantities import Objective, Parameter, Penalty
from jaxhb.periodic import harmonics as decide
from jaxhb.periodic.program import Start

MESH = "crank gear|idler"
FORCE = Objective(quantity="tooth force", of=MESH)
STABLE = 2.7
LEAST_STEPS = 4000
UNSEEN = (1130.0, 1710.0, 2035.0, 2265.0, 2440.0)
COLUMNS = {
    "what": "<10s",
    "setting": "<44s",
    "parameters": "10d",
    "speeds": "6d",
    "seconds": "9.3f",
    "ratio": "8.2f",
    "value": "9.1f",
    "other": "9.1f",
    "notes": "<40s",
}


def viscous_engine():
    return jaxhb.load_scene("engine_with_damper").with_viscous_damping(hz=217.0)


def many_parameters(train, count):
    """``count`` numbers of the train, dampers first; those above 0 may halve and double, the others lie amid bounds."""
    topology, names = train.topology, []
    kinds = (
        ("damper", ("damping", "inertia", "stiffness")),
        ("shaft", ("stiffness", "damping")),
        ("mesh", ("stiffness", "damping", "epsilon", "transition", "backlash")),
        ("disk", ("inertia", "damping")),
        ("cylinder", ("stroke", "rod", "reciprocating_mass", "bore", "firing_angle")),
        ("torque", ("mean",)),
        ("load", ("share",)),
    )
    for kind, fields in kinds:
        of_kind = [name for name, (table, _) in topology.elements.items() if table == kind]
        names += [f"{name}.{field}" for name in of_kind for field in fields]
    absent = ("viscous damper.stiffness", "idler|cam gear.backlash")
    names = [name for name in names if name not in absent]
    return tuple(_around(name, float(train.value(name))) for name in names[:count])


def _around(name, value):
    if value > 0:
        return Parameter(name=name, low=0.5 * value, high=2 * value)
    if value < 0:
        return Parameter(name=name, low=1.5 * value, high=0.5 * value, scale="linear")
    return Parameter(name=name, low=0.0, high=1e-6, scale="linear")


class Case:
    """One train, one list of parameters, many speeds."""

    def __init__(self, train, parameters, rpm):
        heavy = tuple((np.concatenate([train.disks.inertia, train.dampers.inertia]) > 0).tolist())
        self.task = evaluation.Task(parameters, (FORCE,), (), heavy)
        self.plan = evaluation.first_plan(train, rpm, 0.01, None)
        self.train, self.rpm = train, rpm
        self.z = np.zeros((1, len(parameters)))  # the middle of the bounds: the train as it is
        shape = (1, len(rpm), len(self.plan.active), self.plan.harmonics + 1)
        on = np.ones(shape[:2], dtype=bool)
        self.cold = Start(np.zeros(shape, dtype=complex), ~on, decide.MARCH_CYCLES * on)
        self.counted, self.sizes = on, (np.array([0.02]), np.array([6000.0]))

    def gradient(self, start):
        arguments = (self.train, self.rpm, self.z, start, self.counted, *self.sizes)
        return jax.block_until_ready(evaluation.assess(*arguments, task=self.task, plan=self.plan))

    def value(self, start):
        arguments = (self.train, self.rpm, self.z[0], jax.tree.map(lambda a: a[0], start), self.counted[0], *self.sizes)
        return jax.block_until_ready(_value(*arguments, task=self.task, plan=self.plan))


@partial(jax.jit, static_argnames=("task", "plan"))
def _value(train, rpm, z, start, counted, widths, scales, *, task, plan):
    return evaluation.cost(z, train, rpm, start, counted, widths, scales, task, plan)[0]


def cost(recorder, options):
    """Value and gradient over value."""
    train, rpm = viscous_engine(), np.linspace(600, 2600, 5 if options.quick else 20)
    for count in (1, 10, 100):
        case = Case(train, many_parameters(train, count), rpm)
        point = case.gradient(case.cold)
        warm = Start(np.asarray(point.motion), np.asarray(point.solved), 0 * case.cold.cycles)
        solved = f"{int(np.sum(point.solved))} speeds solved"
        for said, start in (("cold", case.cold), ("warm", warm)):
            _, _, alone, _ = timed(partial(case.value, start), options.repeats)
            _, _, both, spread = timed(partial(case.gradient, start), options.repeats)
            row = {"parameters": len(case.task.parameters), "speeds": len(rpm), "seconds": both, "spread": spread}
            recorder.add(what="cost", setting=said, ratio=both / alone, value_seconds=alone, notes=solved, **row)


def settled(train, rpm, aim):
    """Runge-Kutta at one speed: the Marched, its task."""
    task = prepare(train, rpm)
    steps = max(LEAST_STEPS, int(np.ceil(task.period * fastest_rate(task) / STABLE / 100)) * 100)
    return march(task, "rk4", steps, aim=aim), task


def rivals(recorder, options):
    """The same gradient by differences of compiled Runge-Kutta."""
    train, rpm = viscous_engine(), np.linspace(600, 2600, 5 if options.quick else 50)
    settled(train, rpm[0], 1.0)  # compiles
    marches = [settled(train, speed, 1e-2)[0] for speed in rpm]
    sweep, open_cycles = sum(m.seconds for m in marches), sum(m.closure > 1e-2 for m in marches)
    for count in (10, 100):
        case = Case(train, many_parameters(train, count), rpm)
        point = case.gradient(case.cold)
        _, _, cold, _ = timed(partial(case.gradient, case.cold), options.repeats)
        warm = Start(np.asarray(point.motion), np.asarray(point.solved), 0 * case.cold.cycles)
        _, _, again, _ = timed(partial(case.gradient, warm), options.repeats)
        notes = f"{int(np.sum(point.solved))} solved; {open_cycles} of the marches did not settle"
        row = {"parameters": len(case.task.parameters), "speeds": len(rpm), "notes": notes, "sweep_seconds": sweep}
        recorder.add(what="rivals", setting="differences of Runge-Kutta", seconds=2 * count * sweep, **row)
        for said, seconds in (("gradient, cold", cold), ("gradient, warm", again)):
            recorder.add(what="rivals", setting=said, seconds=seconds, ratio=2 * count * sweep / seconds, **row)


def tuning(recorder, options):
    """Before and after, and the tuned train against Runge-Kutta at speeds that were not tuned."""
    train, rpm = viscous_engine(), np.linspace(600, 2600, 9 if options.quick else 41)
    bounds = {"viscous damper.damping": (3.0, 300.0), "rubber damper.stiffness": (1e4, 3e5)}
    own = train.value("rubber damper.damping")
    bounds |= {"rubber damper.damping": (own / 5, 5 * own), "rubber damper.inertia": (0.01, 0.05)}
    result = jaxhb.tune(
        train,
        parameters=[Parameter(name=name, low=low, high=high) for name, (low, high) in bounds.items()],
        rpm=rpm,
        objective=FORCE,
        penalties=[
            Penalty(quantity="damper power", of="viscous damper", most=600.0),
            Penalty(quantity="inertia added", most=0.01),
        ],
        steps=2 if options.quick else 40,
    )
    worst = [np.nanmax(reading.readings[f"tooth force of {MESH}"]) for reading in (result.before, result.after)]
    last = result.history[-1]
    recorder.add(
        what="tuning",
        setting="worst half peak-to-peak, N: before, after",
        parameters=len(bounds),
        speeds=len(rpm),
        seconds=last.seconds,
        value=worst[0],
        other=worst[1],
        ratio=worst[0] / worst[1],
        notes=f"{last.number} steps, {last.evaluations} evaluations",
        tuned=result.after.parameters,
        evaluations=last.evaluations,
        steps=last.number,
        solved=[int(result.before.solved.sum()), int(result.after.solved.sum())],
    )
    mesh = train.topology.mesh_names.index(MESH)
    for speed in UNSEEN[:1] if options.quick else UNSEEN:
        response = jaxhb.solve(result.train, rpm=speed)
        marched, _ = settled(result.train, speed, 1e-4)
        found, wanted = float(response.force(MESH).elastic.half_peak_to_peak), float(np.ptp(marched.force[mesh]) / 2)
        recorder.add(
            what="recheck",
            setting=f"{speed:g} rpm, half peak-to-peak, N: harmonics, in time",
            value=found,
            other=wanted,
            ratio=found / wanted,
            speeds=1,
            rpm=speed,
            notes=f"{response.path[-1].partition(': ')[2]}; closure {marched.closure:.0e}",
        )


PARTS = {"cost": cost, "rivals": rivals, "tuning": tuning}


def main(argv=None):
    """Print the rows, and write them."""
    reader = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    reader.add_argument("parts", nargs="*", metavar="PART", help="cost, rivals, tuning; default: all")
    reader.add_argument("--repeats", type=int, default=5)
    reader.add_argument("--quick", action="store_true")
    reader.add_argument("--core", type=int, default=0, help="-1: wherever the system puts it")
    reader.add_argument("--json", metavar="FILE")
    options = reader.parse_args(argv)
    run_parts("design_gradients", reader, PARTS, COLUMNS, options)


if __name__ == "__main__":
    main()
