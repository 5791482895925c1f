"""How the cost of a solve grows: with harmonics, disks, meshes and speeds; compile time
with and without a cache.

    python benchmarks/scaling.py                      all parts
    python benchmarks/scaling.py harmonics disks      some of them: harmonics, disks, meshes, speeds, compile
    python benchmarks/scaling.py --json rows.jsonl --quick

Run time on one core, medians of repeats after a first call that compiles. Exponents are
slopes of log time over log size by least squares. ``peak_MiB`` is the largest resident
memory of the process while the row was measured, its compilation and the programs of
the rows before it included. ``compile`` starts fresh processes and counts programs.
"""

import json
import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from records import command_line, exponent, forget_peak, peak_memory, run_parts, timed
from refined_trains import accessory_drive, refined, with_tooth_damping

import jaxhb
from jaxhb.results.response import stack

COLUMNS = {
    "part": "<10s",
    "size": "6d",
    "setting": "<40s",
    "harmonics": "9d",
    "steps": "5d",
    "seconds": "9.4f",
    "spread": "8.4f",
    "compile_seconds": "15.2f",
    "peak_MiB": "8.0f",
    "programs": "8d",
    "status": "<20s",
}
RPM = 1833.0
DAMPING = 0.05

FRESH = """
import json, os, sys, time
begin = time.perf_counter()
sys.path.insert(0, {folder!r})
from records import peak_memory, pin
pin({core})
import jax, jaxhb
programs = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, seconds, **_: programs.append(seconds) if event.endswith("backend_compile_duration") else None
)
loaded = time.perf_counter()
response = jaxhb.solve(jaxhb.load_scene("gear_train_30"), rpm={rpm})
first = time.perf_counter()
jaxhb.solve(jaxhb.load_scene("gear_train_30"), rpm={rpm})
second = time.perf_counter()
print(json.dumps(dict(
    import_seconds=loaded - begin, first_call_seconds=first - loaded, seconds=second - first, programs=len(programs),
    compiler_seconds=sum(programs), peak_MiB=peak_memory(), status=int(response.status),
)))
"""


GOOD = (jaxhb.Status.CONVERGED, jaxhb.Status.TOLERANCE_NOT_MET)


def _row(recorder, part, size, setting, call, repeats, share=1):
    """Time a call and record it; seconds (per ``share``) if the equations were solved,
    else None.
    """
    forget_peak()
    try:
        response, first, seconds, spread = timed(call, repeats)
    except jaxhb.NotConverged as error:
        recorder.add(
            part=part,
            size=size,
            setting=setting,
            status="not planned",
            reason=str(error),
        )
        return None
    status = np.atleast_1d(response.status)
    name = jaxhb.Status(int(status.max())).name
    recorder.add(
        part=part,
        size=size,
        setting=setting,
        harmonics=response.harmonics,
        steps=int(np.max(response.steps)),
        seconds=seconds / share,
        spread=spread / share,
        compile_seconds=first - seconds,
        peak_MiB=peak_memory(),
        status=(
            name if status.size == 1 else f"{(status == 0).sum()}/{status.size} good"
        ),
        path=[str(event) for event in response.path],
    )
    return seconds / share if np.isin(status, GOOD).all() else None


def _exponent(label, sizes, seconds):
    """Print the slope over the sizes that were solved."""
    good = [(size, time) for size, time in zip(sizes, seconds, strict=True) if time]
    if len(good) > 1:
        slope = exponent(*zip(*good, strict=True))
        print(
            f"{label}: time ~ size^{slope:.2f} from {good[0][0]} to {good[-1][0]}\n",
            flush=True,
        )


def _train(disks=27):
    return with_tooth_damping(refined("gear_train_30", disks), DAMPING)


def harmonics(recorder, options):
    """Fixed harmonics, decided by the solve and under a plan, above the mesh modes:
    below them there is no solution.
    """
    cases = (
        (
            "4 accessories",
            accessory_drive(4),
            1500.0,
            (128, 256) if options.quick else (128, 256, 512, 1024),
        ),
        (
            "gear_train_30",
            _train(),
            RPM,
            (512,) if options.quick else (384, 512, 768, 1024),
        ),
    )
    for label, train, rpm, sizes in cases:
        for planned in (False, True):
            name = f"{label}, {'planned' if planned else 'cold'}"
            seconds = [
                _row(
                    recorder,
                    "harmonics",
                    size,
                    name,
                    _fixed(train, rpm, size, planned),
                    options.repeats,
                )
                for size in sizes
            ]
            _exponent(f"harmonics, {name}", sizes, seconds)


def _fixed(train, rpm, size, planned):
    """A solve with ``size`` harmonics; the plan is made in the first call."""
    made = []

    def call():
        if not planned:
            return jaxhb.solve(train, rpm=rpm, harmonics=size)
        if not made:
            made.append(jaxhb.plan(train, rpm=rpm, harmonics=size))
        return jaxhb.solve(train, rpm=rpm, plan=made[0])

    return call


def disks(recorder, options):
    """Shafts cut into pieces: at fixed harmonics, and to the default tolerance."""
    sizes = (27, 300) if options.quick else (27, 100, 300, 1000, 3000)
    for setting, wanted in (
        ("512 harmonics", {"harmonics": 512}),
        ("tolerance 1 %", {}),
    ):
        seconds = []
        for size in sizes:
            train = _train(size)
            seconds.append(
                _row(
                    recorder,
                    "disks",
                    size,
                    setting,
                    lambda t=train, w=wanted: jaxhb.solve(t, rpm=RPM, **w),
                    options.repeats,
                )
            )
        _exponent(f"disks, {setting}", sizes, seconds)


def meshes(recorder, options):
    """A shaft that drives accessories through one mesh each, all with backlash."""
    sizes = (1, 2) if options.quick else (1, 2, 4, 8, 16)
    seconds = []
    for size in sizes:
        train = accessory_drive(size)
        seconds.append(
            _row(
                recorder,
                "meshes",
                size,
                "256 harmonics",
                lambda t=train: jaxhb.solve(t, rpm=1500.0, harmonics=256),
                options.repeats,
            )
        )
    _exponent("meshes", sizes, seconds)


def speeds(recorder, options):
    """Seconds per speed of ``solve_speeds`` over the range of the engine, and of a loop
    over its speeds.
    """
    train = _train()
    sizes = (4,) if options.quick else (1, 8, 64)
    repeats = max(1, options.repeats // 2)
    for size in sizes:
        rpm = np.linspace(600.0, 2450.0, size) if size > 1 else np.array([RPM])
        sweep = partial(jaxhb.solve_speeds, train, rpm=rpm)
        _row(
            recorder,
            "speeds",
            size,
            "per speed, solve_speeds",
            sweep,
            repeats,
            share=size,
        )
        if size in (4, 8):
            _row(
                recorder,
                "speeds",
                size,
                "per speed, loop of solve",
                partial(_loop, train, rpm),
                repeats,
                share=size,
            )


def _loop(train, rpm):
    """The responses one after the other, as one with a leading axis."""
    return stack([jaxhb.solve(train, rpm=float(speed)) for speed in rpm])


def compile_times(recorder, options):
    """Fresh processes: no cache, an empty one, a filled one."""
    code = FRESH.format(rpm=RPM, core=options.core, folder=str(Path(__file__).parent))
    with tempfile.TemporaryDirectory() as folder:
        cache = {
            "JAX_COMPILATION_CACHE_DIR": folder,
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        }
        for name, extra in (
            ("no cache", {}),
            ("cache, empty", cache),
            ("cache, filled", cache),
        ):
            environment = {
                k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"
            } | extra
            done = subprocess.run(
                [sys.executable, "-c", code],
                capture_output=True,
                text=True,
                check=True,
                env=environment,
            )
            seen = json.loads(done.stdout.strip().splitlines()[-1])
            seen |= {
                "status": jaxhb.Status(seen["status"]).name,
                "compile_seconds": seen["first_call_seconds"] - seen["seconds"],
            }
            setting = f"{name}; import takes {seen['import_seconds']:.1f} s"
            recorder.add(part="compile", size=27, setting=setting, cache=name, **seen)


PARTS = {
    "harmonics": harmonics,
    "disks": disks,
    "meshes": meshes,
    "speeds": speeds,
    "compile": compile_times,
}


def main():
    """Run what the command line asks for."""
    parser = command_line(__doc__, core=0, repeats=5, quick="few and small sizes")
    run_parts("scaling", parser, PARTS, COLUMNS)


if __name__ == "__main__":
    main()
