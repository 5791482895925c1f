"""Gradients for design: what they cost, against differences of a compiled integrator,
and what a tuning wins.

    python benchmarks/design_gradients.py                      all figures, about 15 minutes on one core
    python benchmarks/design_gradients.py cost rivals          some of: cost, rivals, tuning
    python benchmarks/design_gradients.py --json rows.jsonl
    python benchmarks/design_gradients.py --quick              few speeds, few steps

The train is ``engine_with_damper`` with its loss factors turned into viscous damping at
217 Hz, its first crankshaft mode: loss factors cannot be integrated in time. The
quantity is the tooth force between crank gear and idler, half peak-to-peak, its smooth
maximum over the speeds. One core, without compilation; processor time, so that other
work on the machine counts little. What is compared is measured in turns: seconds are
medians, ratios medians of the ratios within a turn.

- ``cost``: value and gradient over value, for 1, 10 and 100 parameters; cold (nothing
  known but the plans) and warm (from the solution).
- ``rivals``: the gradient over 50 speeds by central differences, two sweeps per
  parameter, of Runge-Kutta from the linear motion on the flanks until two cycles agree
  within 1 % (at most 100 cycles), and within 1e-6, with how far the two gradients are
  apart. The ratio of times is given for both.
- ``tuning``: worst tooth force over 600 to 2600 rpm before and after, and the tuned
  train at five speeds that the tuning did not see, against Runge-Kutta until two cycles
  agree within 1e-4.
"""

import dataclasses
import time
from functools import partial

import numpy as np
from marches import march
from records import command_line, run_parts
from tasks import fastest_rate, prepare

import jaxhb
from jaxhb.balance.plan import Request
from jaxhb.design.evaluation import Aim, Evaluator
from jaxhb.design.quantities import Objective, Parameter, Penalty
from jaxhb.design.task import Task

MESH = "crank gear|idler"
FORCE = Objective(quantity="tooth force", of=MESH)
STABLE = 2.7
LEAST_STEPS = 4000
AIMS = (1e-6, 1e-2)
"""How well two cycles of Runge-Kutta agree."""
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
    """``count`` numbers of the train, dampers first; those above 0 may halve and
    double, the others lie amid bounds.
    """
    topology = train.topology
    names = []
    kinds = (
        ("damper", ("damping", "inertia", "stiffness")),
        ("shaft", ("stiffness", "damping")),
        ("mesh", ("stiffness", "damping", "epsilon", "transition", "backlash")),
        ("disk", ("inertia", "damping")),
        (
            "cylinder",
            (
                "stroke",
                "rod",
                "reciprocating_mass",
                "bore",
                "firing_angle",
                "ambient_pressure",
            ),
        ),
        ("torque", ("mean",)),
        ("load", ("share",)),
    )
    for kind, fields in kinds:
        of_kind = [
            name for name, (table, _) in topology.elements.items() if table == kind
        ]
        names += [f"{name}.{field}" for name in of_kind for field in fields]
    absent = [
        "viscous damper.stiffness",
        *(f"idler|cam gear.{field}" for field in ("epsilon", "transition", "backlash")),
    ]
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
        self.bench = Evaluator(train, rpm, Task(parameters, (FORCE,), ()), Request())
        self.z = np.zeros(
            (1, len(parameters))
        )  # the middle of the bounds: the train as it is
        counted = np.ones((1, len(rpm)), dtype=bool)
        self.aim = Aim(
            counted, scales=np.array([6000.0]), widths=np.array([0.02]), share=0.02
        )
        self.point = self.bench.at(
            self.z, self.bench.unsolved(self.z), self.aim, rescues=len(rpm)
        )
        unknown = np.full_like(self.point.status, jaxhb.Status.MAX_STEPS)
        self.cold = dataclasses.replace(self.point, status=unknown)

    def gradient(self, near, away=0.0):
        """Value and gradient from the motions of ``near``, every parameter ``away`` of
        its range from there.
        """
        return self.bench.at(self.z + 4 * away, near, self.aim)

    def value(self, near):
        """The value alone."""
        return self.bench.at(self.z, near, self.aim, most=-np.inf)


def in_turns(calls, repeats):
    """Seconds of processor time of each call ``{name: (repeats,)}``, one after the
    other in every turn.
    """
    for call in calls.values():
        call()
    seconds = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            begin = time.process_time()
            told = call()
            seconds[name].append(
                told if isinstance(told, float) else time.process_time() - begin
            )
    return {name: np.array(values) for name, values in seconds.items()}


def spread_of(seconds):
    """Median and spread of what :func:`in_turns` gives for one call."""
    return {"seconds": float(np.median(seconds)), "spread": float(np.ptp(seconds))}


def cost(recorder, options):
    """Value and gradient over value."""
    train = viscous_engine()
    rpm = np.linspace(600, 2600, 5 if options.quick else 50)
    for count in (1, 10, 100):
        case = Case(train, many_parameters(train, count), rpm)
        solved = (
            f"{int(np.sum(case.point.solved))} speeds solved;"
            f" {case.bench.described(case.point, 0)}"
        )
        for said, near in (("cold", case.cold), ("warm", case.point)):
            calls = {
                "value": partial(case.value, near),
                "both": partial(case.gradient, near),
            }
            taken = in_turns(calls, options.repeats)
            recorder.add(
                what="cost",
                setting=said,
                parameters=count,
                speeds=len(rpm),
                **spread_of(taken["both"]),
                ratio=float(np.median(taken["both"] / taken["value"])),
                value_seconds=float(np.median(taken["value"])),
                notes=solved,
            )


def settled(train, rpm, aim):
    """Runge-Kutta at one speed: the Marched, its task."""
    task = prepare(train, rpm)
    return _march(task, aim), task


def swept(tasks, aim):
    """Seconds of a sweep of Runge-Kutta, its steps alone."""
    return sum(_march(task, aim).seconds for task in tasks)


def _march(task, aim):
    steps = max(
        LEAST_STEPS, int(np.ceil(task.period * fastest_rate(task) / STABLE / 100)) * 100
    )
    return march(task, "rk4", steps, aim=aim, clock=time.process_time)


def smooth_worst(marches, mesh):
    """The objective of :class:`Case` from tooth forces in time."""
    sizes = []
    for marched in marches:
        swing = marched.force[mesh] - marched.force[mesh].mean()
        parts = np.maximum(swing, 0.0), np.maximum(-swing, 0.0)
        sizes.append(
            sum(
                part.max() * np.mean((part / part.max()) ** 64) ** (1 / 64)
                for part in parts
            )
            / 2
        )
    scaled = np.array(sizes) / 6000.0 / 0.02
    return 0.02 * (scaled.max() + np.log(np.exp(scaled - scaled.max()).sum()))


def rivals(recorder, options):
    """The same gradient by differences of compiled Runge-Kutta."""
    train = viscous_engine()
    rpm = np.linspace(600, 2600, 5 if options.quick else 50)
    mesh = train.topology.mesh_names.index(MESH)
    cases = {
        count: Case(train, many_parameters(train, count), rpm) for count in (10, 100)
    }
    tasks = [settled(train, speed, 1.0)[1] for speed in rpm]
    gradients = {}
    calls = {}
    for aim in AIMS:
        found = []
        open_cycles = 0
        for k in range(options.differences):
            values = []
            for sign in (1, -1):
                z = cases[10].z[0].copy()
                z[k] = sign * 4e-3  # a thousandth of the range
                marches = [
                    settled(train.replace(cases[10].bench.task.named(z)), speed, aim)[0]
                    for speed in rpm
                ]
                values.append(smooth_worst(marches, mesh))
                open_cycles += sum(
                    marched.periodicity_error > aim for marched in marches
                )
            found.append((values[0] - values[1]) / 8e-3)
        gradients[aim] = np.array(found)
        apart = (
            np.abs(gradients[aim] - gradients[AIMS[0]]).max()
            / np.abs(gradients[AIMS[0]]).max()
        )
        notes = (
            f"gradient {apart:.0e} from the finest; {open_cycles / 2 / len(found):g}"
            " marches a sweep stay open"
        )
        calls[aim] = (
            partial(swept, tasks, aim),
            {"parameters": len(found), "apart": apart, "notes": notes},
        )
    for count, case in cases.items():
        calls |= {
            (count, "cold"): (partial(case.gradient, case.cold), {}),
            (count, "warm"): (partial(case.gradient, case.point), {}),
            (count, "from a design a hundredth of the range away"): (
                partial(case.gradient, case.point, 0.01),
                {},
            ),
        }
    taken = in_turns({name: call for name, (call, _) in calls.items()}, options.repeats)
    for name, seconds in taken.items():
        row = {"what": "rivals", "speeds": len(rpm), **spread_of(seconds)}
        if name in AIMS:
            setting = f"one sweep of Runge-Kutta, cycles agree to {name:g}"
            recorder.add(**row, **calls[name][1], setting=setting)
            continue
        count, said = name
        ratios = {
            f"{aim:g}": float(np.median(2 * count * taken[aim] / seconds))
            for aim in AIMS
        }
        words = ", ".join(f"{ratio:.3g} ({aim})" for aim, ratio in ratios.items())
        row |= {
            "parameters": count,
            "ratio": ratios["0.01"],
            "ratios": ratios,
            "notes": words,
        }
        recorder.add(**row, setting=f"gradient, {said}")


def tuning(recorder, options):
    """Before and after, and the tuned train against Runge-Kutta at speeds that were not
    tuned.
    """
    train = viscous_engine()
    rpm = np.linspace(600, 2600, 9 if options.quick else 41)
    bounds = {
        "viscous damper.damping": (3.0, 300.0),
        "rubber damper.stiffness": (1e4, 3e5),
    }
    own = train.value("rubber damper.damping")
    bounds |= {
        "rubber damper.damping": (own / 5, 5 * own),
        "rubber damper.inertia": (0.01, 0.05),
    }
    result = jaxhb.tune(
        train,
        parameters=[
            Parameter(name=name, low=low, high=high)
            for name, (low, high) in bounds.items()
        ],
        rpm=rpm,
        objective=FORCE,
        penalties=[
            Penalty(quantity="damper power", of="viscous damper", most=600.0),
            Penalty(quantity="inertia added", most=0.01),
        ],
        steps=2 if options.quick else 40,
    )
    worst = [
        np.nanmax(reading.readings[f"tooth force of {MESH}"])
        for reading in (result.before, result.after)
    ]
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
        found = float(response.force(MESH).elastic.half_peak_to_peak)
        wanted = float(np.ptp(marched.force[mesh]) / 2)
        recorder.add(
            what="recheck",
            setting=f"{speed:g} rpm, half peak-to-peak, N: harmonics, in time",
            value=found,
            other=wanted,
            ratio=found / wanted,
            speeds=1,
            rpm=speed,
            notes=f"{response.path[-1]}; closure {marched.periodicity_error:.0e}",
        )


PARTS = {"cost": cost, "rivals": rivals, "tuning": tuning}


def main():
    """Print the rows, and write them."""
    reader = command_line(__doc__, core=0, repeats=5, quick="few speeds and steps")
    reader.add_argument(
        "--differences",
        type=int,
        default=4,
        help="parameters of which Runge-Kutta is differenced",
    )
    run_parts("design_gradients", reader, PARTS, COLUMNS)


if __name__ == "__main__":
    main()
