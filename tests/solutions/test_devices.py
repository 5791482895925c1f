"""Sweeps across several devices, in a process that has two of them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

SHARED = """
import compiling
import jax, numpy as np
import jaxhb, trains
from jaxhb import _program

first, second = devices = jax.devices()
train = trains.pair_train(trains.Pair(1.0), transition=1e-3)
rpm = np.linspace(0.4, 1.2, 7) * trains.ONE_RADIAN_PER_SECOND

single = jaxhb.solve_speeds(train, rpm=rpm, harmonics=24)
spread = jaxhb.solve_speeds(train, rpm=rpm, harmonics=24, devices=devices)
assert (single.status == spread.status).all()
assert single.converged.all()
scale = np.abs(single.deflections).max()
assert np.abs(single.deflections - spread.deflections).max() <= 1e-10 * scale

# A march ends where its motion returns within 5e-5, and a transient that is irregular
# enlarges rounding up to there. An irregular motion, which would enlarge rounding until
# nothing is left of it, is not among these.
single = jaxhb.steady_state(train, rpm=rpm, harmonics=64, exact=False)
spread = jaxhb.steady_state(train, rpm=rpm, harmonics=64, exact=False, devices=devices)
assert (single.kind == spread.kind).all()
assert (single.period == spread.period).all()
assert set(single.kind) == {"periodic", "subharmonic"}
for a, b in zip(single, spread):
    peaks = [float(state.force("a", "b").max) for state in (a, b)]
    assert abs(peaks[0] / peaks[1] - 1) < 1e-4, (a.rpm, a.kind, peaks)

double = _program.Program(lambda x: 2.0 * x)

def place(size=3):
    return next(iter(double(np.ones(size)).devices()))

assert place() == first
with jax.default_device(second):
    assert place() == second
    assert place(4) == second
    assert double.compile_ahead(np.ones(5)) is None
assert place(4) == first
assert place() == first
jax.config.update("jax_default_device", second)
assert place() == second
for same in (first, "cpu"):
    with jax.default_device(same):
        assert place() == first
print("all hold")
"""


def test_two_devices_give_what_one_gives_and_programs_run_on_the_default_one():
    flags = os.environ.get("XLA_FLAGS", "")
    here = str(Path(__file__).parents[1])
    environment = os.environ | {
        "XLA_FLAGS": flags + " --xla_force_host_platform_device_count=2",
        "PYTHONPATH": os.pathsep.join([here, *sys.path]),
    }
    completed = subprocess.run(
        [sys.executable, "-c", SHARED], capture_output=True, text=True, env=environment
    )
    assert completed.returncode == 0, completed.stderr[-3000:]
    assert "all hold" in completed.stdout, completed.stderr[-3000:]
