"""Transients beside exact solutions, beside the same equations written anew, beside
compiled Runge-Kutta and beside other programs.

    python benchmarks/transients.py                        all parts, some minutes
    python benchmarks/transients.py exact linear events    some of them
    python benchmarks/transients.py --json rows.jsonl

- ``exact``: one mass through its resonance at five rates; largest error / peak.
- ``linear``, ``events``: random linear trains and events of each kind beside DOP853
  (:mod:`transient_twins`); largest error of a torque / its largest value.
- ``hammering``: 600 to 2450 rpm of ``gear_train_30`` in 10 s; ``error``: of the peaks
  of the elastic tooth forces, against Runge-Kutta with a fourth of the longest step
  that gives them to 1 %; ``ratio``: seconds over those of Runge-Kutta with that step,
  its table of the excitation counted.
- ``plant``: ``jaxhb transient`` on 60 disks of a two-stroke with its propeller, whose
  shaft line is judged and its cycles counted, 20 to 110 rpm in 60 s: the whole command,
  the first and the second process.
- ``peers``: peak torque after a step of torque, by openTorsion and ROSS.
- ``derivative``: of a smooth peak by five numbers, against differences.
- ``backward``: gradient of a peak of the run-up of ``hammering`` in a process of its
  own: seconds, and its peak memory in MiB.

One core.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from random_plants import (
    CUT_OFF,
    EVENTS,
    FUEL,
    SECONDS,
    fuel_factor,
    gas_factor,
    linear_plant,
)
from records import command_line, run_parts
from transient_twins import Ramps, accelerated_mass, difference

import jaxhb
from jaxhb import Cylinder, Damper, Disk, Event, Ground, Load, Shaft, Torque

COLUMNS = {
    "part": "<10s",
    "case": "<34s",
    "steps": "8d",
    "seconds": "9.3f",
    "ratio": "7.2f",
    "error": "9.1e",
    "memory": "7.0f",
}
RATES = 20.0, 60.0, 200.0, 600.0, 2000.0
SEEDS = range(3)
LOW = 600.0
HIGH = 2450.0
DURATION = 10.0
FIVE = (
    "flywheel.inertia",
    "hub.inertia",
    "cam damper B.damping",
    "crank gear|idler.stiffness",
    "crank gear|idler.damping",
)


def exact(recorder, options):
    """One mass on a spring: rad/s2 of its acceleration."""
    natural = 200.0
    train = jaxhb.build(
        [
            Disk(name="mass", inertia=2.0, damping=0.04 * natural * 2.0),
            Ground(disk="mass", stiffness=2.0 * natural**2),
            Torque(disk="mass", harmonics=((1.0, 100.0, 0.0),)),
        ],
        revolutions_per_cycle=1,
    )
    for alpha in RATES:
        seconds = 1.6 * natural / alpha
        rows = [(0.0, 0.0), (seconds, alpha * seconds * 30 / np.pi)]
        begin = time.perf_counter()
        found = jaxhb.transient(train, seconds=seconds, speed=rows)
        passed = time.perf_counter() - begin
        expected = accelerated_mass(
            found.time, omega=natural, ratio=0.02, alpha=alpha, amplitude=50.0
        )
        error = np.abs(found.disk("mass").values - expected).max()
        recorder.add(
            part="exact",
            case=f"{alpha:g} rad/s2",
            steps=len(found.time) - 1,
            seconds=passed,
            error=float(error / np.abs(expected).max()),
        )


def linear(recorder, options):
    """Random trains at a given and at a free speed, held and floating."""
    rows = ((0.0, 700.0), (0.2, 900.0), (0.3, 850.0), (SECONDS, 1000.0))
    for seed in SEEDS:
        for held in (True, False):
            where = "held" if held else "floating"
            parts = linear_plant(seed, held=held, law=True)
            recorder.add(
                part="linear",
                case=f"{seed}, {where}, given",
                error=difference(parts, SECONDS, Ramps(rows)),
            )
            recorder.add(
                part="linear",
                case=f"{seed}, {where}, free",
                error=difference(parts, SECONDS, None, rpm=800.0),
            )


def events(recorder, options):
    """Each kind of event at a given and at a free speed."""
    parts = linear_plant(7, law=True, meshing=False)
    given = Ramps(((0.0, 1000.0), (SECONDS, 1300.0)))
    changes = {
        "fuel": {"change": (FUEL, "fuel", fuel_factor), "corners": (0.1, 0.2, 0.25)},
        "cut off": {"change": (CUT_OFF, "gas", gas_factor), "corners": (0.15,)},
    }
    changes |= {kind.event.name: {"kind": kind} for kind in EVENTS}
    for name, change in changes.items():
        for word, speed, rpm in (("given", given, None), ("free", None, 1000.0)):
            error = difference(parts, SECONDS, speed, rpm=rpm, **change)
            recorder.add(part="events", case=f"{name}, {word}", error=error)


def peaks_of(train, motion, **options):
    """Peaks ``(M,)`` N of the elastic tooth forces of the run-up, the transient and its
    seconds.
    """
    begin = time.perf_counter()
    found = jaxhb.transient(
        train,
        seconds=DURATION,
        speed=[(0.0, LOW), (DURATION, HIGH)],
        start=motion,
        **options,
    )
    passed = time.perf_counter() - begin
    names = train.topology.disk_names
    peaks = [
        float(found.force(names[a], names[b]).elastic.peak)
        for a, b in train.topology.mesh_ends
    ]
    return np.array(peaks), found, passed


def hammering(recorder, options):
    """The run-up of gear_train_30 beside compiled Runge-Kutta."""
    from run_ups import Excited, run_up

    train = jaxhb.load_scene("gear_train_30")
    steady = jaxhb.steady_state(train, rpm=LOW)
    excited = Excited.of(train, DURATION, LOW, HIGH)
    stable = int(DURATION / excited.longest_step)
    run_up(excited, steady.motion, 5000)  # compiles

    def apart(found, expected):
        return float(np.abs(found.peaks / expected.peaks - 1).max())

    fine = run_up(excited, steady.motion, 16 * stable)
    share = 1.0
    rough = run_up(excited, steady.motion, stable)
    while not apart(rough, fine) < 0.01:
        share *= 1.1
        rough = run_up(excited, steady.motion, int(share * stable))
    steps = int(share * stable)
    quarter = run_up(excited, steady.motion, 4 * steps)
    rivals = [run_up(excited, steady.motion, steps) for _ in range(options.repeats)]
    rival = min(rivals, key=lambda run: run.table_seconds + run.step_seconds)
    rival_seconds = rival.table_seconds + rival.step_seconds
    for name, run, count in (
        ("Runge-Kutta to 1 %", rival, steps),
        ("Runge-Kutta, quarter of the step", quarter, 4 * steps),
    ):
        recorder.add(
            part="hammering",
            case=name,
            steps=count,
            seconds=run.table_seconds + run.step_seconds,
            error=apart(run, fine),
            table=run.table_seconds,
            marching=run.step_seconds,
        )
    print(f"    table {rival.table_seconds:.3f} s, steps {rival.step_seconds:.3f} s")
    peaks_of(train, steady)  # compiles
    for word, more in (
        ("jaxhb", {}),
        ("jaxhb, 2000 instants a second", {"record": 2000.0}),
    ):
        runs = [peaks_of(train, steady, **more) for _ in range(options.repeats)]
        peaks, found, seconds = min(runs, key=lambda run: run[2])
        recorder.add(
            part="hammering",
            case=word,
            steps=len(found.time) - 1,
            seconds=seconds,
            ratio=seconds / rival_seconds,
            error=float(np.abs(peaks / quarter.peaks - 1).max()),
        )
    exactly = DURATION * 500.0 / (HIGH - LOW)
    recorder.add(
        part="hammering",
        case="passage 1000 to 1500 rpm",
        error=abs(float(found.passage(1000.0, 1500.0)) / exactly - 1),
    )
    for name, seconds in march_parts(train, steady).items():
        recorder.add(part="hammering", case=f"jaxhb: {name}", seconds=seconds)


def march_parts(train, steady):
    """Seconds of the parts of a run-up by name."""
    import jax
    from jax import lax

    from jaxhb._jax import concrete
    from jaxhb.transients import march, transient
    from jaxhb.transients.course import course, occurrences
    from jaxhb.transients.equations import TransientEquations
    from jaxhb.transients.free_speed import Plan
    from jaxhb.transients.timeline import padded, speed_table

    begin = time.perf_counter()
    (values,) = concrete(train)
    table = speed_table(DURATION, [(0.0, LOW), (DURATION, HIGH)], None)
    plan = Plan(table, course(values, occurrences(values, ()), table), free=False)
    equations = TransientEquations.of(train, values, plan)
    steps = transient._grid(equations, plan, DURATION, 1, transient.StepRate())
    prepared = equations.set_up(plan, steps)
    marching = prepared.marching
    blocks = transient.blocks_of(train, plan, steps, marching)
    state = equations.begin(prepared.coordinates, steady, plan)
    seconds = {"equations, weights, panels": time.perf_counter() - begin}
    count = transient.CHUNK
    parts = [
        padded(jax.tree.map(lambda rows: rows[first : first + count], blocks), count)  # noqa: B023
        for first in range(0, len(blocks.begin), count)
    ]

    @jax.jit
    def excitation(marching, part):
        def block(carry, one):
            half_steps = march._half_steps(marching, one)
            return carry + half_steps.loads.sum(), None

        return lax.scan(block, 0.0, part)[0]

    @jax.jit
    def steps_alone(marching, state, part):
        def block(state, one):
            after, _ = march._block(marching, state, one)
            return after, None

        return lax.scan(block, state, part)[0]

    def whole(marching, state, part):
        return march.march(marching, state, part)

    def timed(run):
        run(parts[0])
        begin = time.perf_counter()
        for part in parts:
            jax.block_until_ready(run(part))
        return time.perf_counter() - begin

    marching = jax.tree.map(jax.numpy.asarray, marching)
    first = jax.tree.map(lambda rows: rows[0], blocks)
    state, _ = march.first_instant(marching, state, first)
    parts = [jax.tree.map(jax.numpy.asarray, part) for part in parts]
    seconds["table of the excitation"] = timed(lambda part: excitation(marching, part))
    seconds["table and steps, nothing kept"] = timed(
        lambda part: steps_alone(marching, state, part)
    )
    seconds["the same, all states kept"] = timed(
        lambda part: whole(marching, state, part)
    )
    return seconds


def two_stroke_pressure(bore, stroke):
    """Rows of crank angle in deg and Pa of a slow two-stroke."""
    angle = np.arange(0.0, 360.0, 2.0)
    volume = 1 / 12 + (1 - np.cos(np.deg2rad(angle))) / 2
    closed = 2.5e5 * (volume[60] / volume) ** 1.35
    is_closed = (angle < 120.0) | (angle > 240.0)
    value = np.where(is_closed, np.minimum(closed, 1.2e7), 2.5e5)
    value = value + 4e6 * np.exp(-(((angle - 12.0) / 14.0) ** 2))
    return tuple(zip(angle.tolist(), value.tolist(), strict=True))


def two_stroke_plant(disks=60, cylinders=7):
    """A two-stroke, its damper, a shaft line in pieces and a propeller."""
    line = disks - cylinders - 4
    names = ["free end", *(f"cyl{k}" for k in range(1, cylinders + 1)), "flywheel"]
    parts = [Disk(name="free end", inertia=3000.0)]
    parts += [Disk(name=name, inertia=12000.0, damping=800.0) for name in names[1:-1]]
    parts.append(Disk(name="flywheel", inertia=20000.0))
    parts += [Disk(name=f"line {k}", inertia=120.0) for k in range(line)]
    parts.append(
        Disk(
            name="propeller",
            inertia=60000.0,
            damping_over_rpm=((0.0, 0.0), (110.0, 50000.0)),
        )
    )
    names += [*(f"line {k}" for k in range(line)), "propeller"]
    for a, b in zip(names[:-1], names[1:], strict=True):
        if "line" not in b and b != "propeller":
            parts.append(Shaft(between=(a, b), stiffness=1.5e9, damping=2e4))
            continue
        parts.append(
            Shaft(
                between=(a, b),
                stiffness=1.1e8 * (line + 1),
                damping=2e4,
                diameter=0.6,
                tensile_strength=600e6,
                stress_concentration=1.0,
                sn_curve=((1e4, 200e6), (1e6, 80e6)),
                sn_source="of the benchmark, no material",
            )
        )
    parts.append(
        Damper(
            name="damper", disk="free end", inertia=9000.0, stiffness=2.5e7, damping=1e5
        )
    )
    pressure = two_stroke_pressure(0.6, 2.4)
    parts += [
        Cylinder(
            name=f"cylinder {k}",
            disk=f"cyl{k}",
            bore=0.6,
            stroke=2.4,
            rod=2.5,
            reciprocating_mass=5000.0,
            firing_angle=360.0 * (3 * k % cylinders) / cylinders,
            pressure=pressure,
        )
        for k in range(1, cylinders + 1)
    ]
    parts.append(Load(disk="propeller", harmonics=((4.0, 0.05, 0.0), (8.0, 0.01, 0.0))))
    return parts


def plant(recorder, options):
    """The whole command on a plant of 60 disks: the first and the second process."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "plant.toml")
        Path(path).write_text(plant_text())
        command = [sys.executable, "-m", "jaxhb", "transient", path]
        command += ["--seconds=60", "--speed=0:20,60:110"]
        for start in ("rest", "steady"):
            for word in ("first", "second"):
                begin = time.perf_counter()
                subprocess.run(
                    [*command, "--start", start], capture_output=True, check=True
                )
                recorder.add(
                    part="plant",
                    case=f"from {start}, {word} process",
                    seconds=time.perf_counter() - begin,
                )


def plant_text():
    """The plant as the text of a scene."""
    lines = ["[scene]", 'name = "plant"', "revolutions_per_cycle = 1"]
    lines.append('reference = "flywheel"')
    lines.append("rated_rpm = 105")
    for part in two_stroke_plant():
        table = type(part).__name__.lower()
        lines += ["", f"[[{table}]]"]
        for key, value in vars(part).items():
            default = type(part).__dataclass_fields__[key].default
            if value is None or value == default or value == ():
                continue
            shown = json.dumps(value) if not isinstance(value, bool) else str(value)
            lines.append(f"{key} = {shown}")
    return "\n".join(lines) + "\n"


STEP = 0.05
"""Time in s of the step of torque of ``peers``, 100 N m."""
LENGTH = 1.0
SAMPLE = 1e-4


def peers(recorder, options):
    """Peak torque after a step of torque on the last disk: chains of masses."""
    chains = {
        # Five masses of openTorsion's transient example: its gear of ratio 8 is rigid,
        # so that the two gears are one disk, and what follows is divided by 64.
        "openTorsion's example": (
            [0.5, 0.1, 0.5 + 0.1 / 64, 1.0 / 64],
            [5000.0, 500.0, 1000.0 / 64],
            [10.0, 0.8, 5.0 / 64],
            [0.0, 0.0, 0.2 + 0.2 / 64, 5.0 / 64],
        ),
        "12 masses": (
            np.linspace(0.4, 2.6, 12).tolist(),
            np.linspace(4e5, 1e5, 11).tolist(),
            np.linspace(40.0, 10.0, 11).tolist(),
            [0.0] * 12,
        ),
    }
    for name, chain in chains.items():
        reference = exact_chain(*chain)
        for program, call in (
            ("jaxhb", jaxhb_chain),
            ("jaxhb, refine 16", lambda *rows: jaxhb_chain(*rows, refine=16)),
            ("openTorsion, dsim", opentorsion_chain),
            ("ROSS, lsim", ross_chain),
        ):
            if call is ross_chain and any(chain[3]):
                continue
            begin = time.perf_counter()
            try:
                peaks = call(*chain)
            except ImportError as missing:
                print(f"    {program}: {missing}")
                continue
            recorder.add(
                part="peers",
                case=f"{name}: {program}",
                seconds=time.perf_counter() - begin,
                error=float(np.abs(peaks / reference - 1).max()),
            )


def chain_matrices(inertia, stiffness, damping, ground):
    """Matrices M, B, K of a chain."""
    count = len(inertia)
    rows = np.eye(count)[:-1] - np.eye(count)[1:]
    K = rows.T @ np.diag(stiffness) @ rows
    B = rows.T @ np.diag(damping) @ rows + np.diag(ground)
    return np.diag(inertia), B, K, rows


def exact_chain(inertia, stiffness, damping, ground):
    """Largest torques ``(n - 1,)`` N m of shafts, that of their damping counted, as in
    openTorsion, by the matrix exponential.
    """
    from scipy.linalg import expm

    M, B, K, rows = chain_matrices(inertia, stiffness, damping, ground)
    n = len(inertia)
    A = np.zeros((2 * n + 1, 2 * n + 1))
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, :n] = -np.linalg.solve(M, K)
    A[n : 2 * n, n : 2 * n] = -np.linalg.solve(M, B)
    A[2 * n - 1, -1] = 100.0 / inertia[-1]
    state = np.zeros(2 * n + 1)
    state[-1] = 1.0
    # Ten times finer than the samples of the others
    step = expm(A * SAMPLE / 10)
    peaks = np.zeros(n - 1)
    for _ in range(round((LENGTH - STEP) / SAMPLE) * 10):
        state = step @ state
        torque = stiffness * (rows @ state[:n])
        torque = torque + damping * (rows @ state[n : 2 * n])
        peaks = np.maximum(peaks, np.abs(torque))
    return peaks


def jaxhb_chain(inertia, stiffness, damping, ground, refine=1):
    """The same by a transient at a constant speed."""
    count = len(inertia)
    parts = [
        Disk(name=f"m{k}", inertia=inertia[k], damping=ground[k]) for k in range(count)
    ]
    parts += [
        Shaft(
            between=(f"m{k}", f"m{k + 1}"), stiffness=stiffness[k], damping=damping[k]
        )
        for k in range(count - 1)
    ]
    parts.append(Event(name="step", disk=f"m{count - 1}", begin=STEP, step=100.0))
    train = jaxhb.build(parts, revolutions_per_cycle=1)
    found = jaxhb.transient(
        train,
        seconds=LENGTH,
        speed=600.0,
        events="step",
        start="rest",
        refine=refine,
    )
    return np.array(
        [float(found.torque(f"m{k}", f"m{k + 1}").peak) for k in range(count - 1)]
    )


def opentorsion_chain(inertia, stiffness, damping, ground):
    """The same by openTorsion's dsim."""
    import opentorsion as ot

    count = len(inertia)
    shafts = [
        ot.Shaft(k, k + 1, None, None, k=stiffness[k], c=damping[k])
        for k in range(count - 1)
    ]
    disks = [ot.Disk(k, I=inertia[k], c=ground[k]) for k in range(count)]
    assembly = ot.Assembly(shafts, disk_elements=disks)
    times = np.arange(round(LENGTH / SAMPLE) + 1) * SAMPLE
    excitation = ot.TransientExcitation(count, times)
    excitation.add_transient(count - 1, 100.0 * (times >= STEP - 1e-9))
    torques, _, _ = assembly.dsim(excitation)
    return np.abs(torques).max(axis=1)


def ross_chain(inertia, stiffness, damping, ground):
    """The same by the time response of ROSS, torsion alone; shafts of 0.1 m of a
    material without mass.
    """
    import ross
    from ross.utils import convert_6dof_to_torsional

    length = 0.1
    modulus = 8e10
    material = ross.Material(name="light", rho=1e-6, E=2.08e11, G_s=modulus)
    elements = []
    for number, torsion in enumerate(stiffness):
        diameter = (32 * torsion * length / (np.pi * modulus)) ** 0.25
        elements.append(
            ross.ShaftElement(
                L=length,
                idl=0.0,
                odl=diameter,
                material=material,
                n=number,
                beta=damping[number] / torsion,
            )
        )
    disks = [
        ross.DiskElement(n=k, m=1.0, Id=size / 2, Ip=size)
        for k, size in enumerate(inertia)
    ]
    bearings = [
        ross.BearingElement(n=k, kxx=1e8, cxx=0.0) for k in (0, len(inertia) - 1)
    ]
    rotor = ross.Rotor(elements, disks, bearings)
    torsional = convert_6dof_to_torsional(rotor)
    times = np.arange(round(LENGTH / SAMPLE) + 1) * SAMPLE
    force = np.zeros((len(times), len(inertia)))
    force[:, -1] = 100.0 * (times >= STEP - 1e-9)
    _, _, states = torsional.time_response(0.0, force, times)
    twists = states[:, :-1] - states[:, 1:]
    count = len(stiffness)
    torque = twists[:, :count] * stiffness + twists[:, count + 1 :] * damping
    return np.abs(torque).max(axis=0)


def derivative(recorder, options):
    """Derivatives of the smooth peak of the first tooth force by five numbers."""
    import jax
    import jax.numpy as jnp

    from jaxhb.train.changes import linearised

    gears = jaxhb.load_scene("gear_train_30")
    cases = (
        ("teeth in contact", linearised(gears), [(0.0, 600.0), (0.3, 900.0)], 1e-4),
        ("teeth that hammer", gears, [(0.0, 1750.0), (0.3, 1850.0)], 1e-7),
    )
    for name, train, speed, share in cases:
        at = np.array([float(train.value(number)) for number in FIVE])

        def peak(numbers, train=train, speed=speed):
            changed = train.replace(dict(zip(FIVE, numbers, strict=True)))
            found = jaxhb.transient(changed, seconds=0.3, speed=speed, start="rest")
            return found.force("crank gear", "idler").elastic.smooth_peak(16)

        begin = time.perf_counter()
        gradient = np.asarray(jax.grad(peak)(jnp.array(at)))
        seconds = time.perf_counter() - begin
        _, slope = jax.jvp(peak, (jnp.array(at),), (jnp.array(at),))
        expected = []
        for k in range(len(at)):
            step = np.zeros(len(at))
            step[k] = share * at[k]
            change = float(peak(at + step)) - float(peak(at - step))
            expected.append(change / (2 * step[k]))
        expected = np.array(expected)
        size = np.maximum(np.abs(expected * at), 1e-3 * np.abs(expected * at).max())
        recorder.add(
            part="derivative",
            case=f"{name}, backwards",
            seconds=seconds,
            error=float((np.abs(gradient - expected) * np.abs(at) / size).max()),
        )
        terms = gradient * at
        recorder.add(
            part="derivative",
            case=f"{name}, forwards",
            error=float(abs(float(slope) - terms.sum()) / np.abs(terms).sum()),
        )


BACKWARD = """
import resource, time
import jax
import jaxhb

train = jaxhb.load_scene("gear_train_30")
steady = jaxhb.steady_state(train, rpm={low})

def peak(damping):
    changed = train.replace({{"cam damper B.damping": damping}})
    found = jaxhb.transient(
        changed,
        seconds={seconds},
        speed=[(0.0, {low}), ({seconds}, {high})],
        start=steady,
        record={record},
    )
    return found.force("crank gear", "idler").smooth_peak(16)

at = float(train.value("cam damper B.damping"))
times = []
for _ in range(2):
    begin = time.perf_counter()
    slope = float(jax.grad(peak)(at))
    times.append(time.perf_counter() - begin)
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(*times, memory, slope)
"""


def backward(recorder, options):
    """Gradient of a run-up of 10 s."""
    for name, record in (("all instants", None), ("2000 instants a second", 2000.0)):
        program = BACKWARD.format(low=LOW, high=HIGH, seconds=DURATION, record=record)
        ended = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, check=True
        )
        first, seconds, memory, _ = (float(word) for word in ended.stdout.split())
        recorder.add(
            part="backward", case=f"{name}, first", seconds=first, memory=memory
        )
        recorder.add(
            part="backward", case=f"{name}, second", seconds=seconds, memory=memory
        )


PARTS = {
    "exact": exact,
    "linear": linear,
    "events": events,
    "hammering": hammering,
    "plant": plant,
    "peers": peers,
    "derivative": derivative,
    "backward": backward,
}


def main():
    """Run what the command line asks for."""
    run_parts("transients", command_line(__doc__, core=0, repeats=5), PARTS, COLUMNS)


if __name__ == "__main__":
    main()
