"""Sweeps across several devices, in a process that has eight of them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.oracle

AGREE = """
import compiling
import jax, numpy as np
import jaxhb, trains
from event_exact import Pair

devices = jax.devices()
assert len(devices) == 8
train = trains.pair_train(Pair(1.0), transition=1e-3)
rpm = np.linspace(0.4, 1.2, 24) * trains.ONE_RADIAN_PER_SECOND

one = jaxhb.solve_speeds(train, rpm=rpm, harmonics=24)
eight = jaxhb.solve_speeds(train, rpm=rpm, harmonics=24, devices=devices)
assert (one.status == eight.status).all() and one.converged.any()
good = one.converged
scale = np.abs(one.deflections[good]).max()
assert np.abs(one.deflections - eight.deflections)[good].max() <= 1e-10 * scale

# A march ends where its motion returns within 5e-5, and a transient that is irregular enlarges rounding up to there.
# Newton's method ends at a residual of 1e-10. An irregular motion enlarges rounding until nothing is left of it.
for exact, agrees in (False, 1e-4), (True, 1e-9):
    given = {"rpm": rpm, "harmonics": 64, "exact": exact}
    one, eight = jaxhb.steady_state(train, **given), jaxhb.steady_state(train, **given, devices=devices)
    assert (one.kind == eight.kind).all() and (one.period == eight.period).all()
    for a, b in zip(one, eight):
        if a.kind != "irregular":
            peaks = [float(s.force("a", "b").max) for s in (a, b)]
            assert abs(peaks[0] / peaks[1] - 1) < agrees, (exact, a.rpm, a.kind, peaks)
    assert {"periodic", "subharmonic", "irregular"} & set(one.kind)
print("agree", sorted(set(one.kind)))
"""


DEFAULTS = """
import jax, numpy as np
from jaxhb import _program

first, second = jax.devices()
double = _program.Program(lambda x: 2.0 * x)

def place(size=3):
    return next(iter(double(np.ones(size)).devices()))

assert place() == first
with jax.default_device(second):
    assert place() == second and place(4) == second
    assert double.compile_ahead(np.ones(5)) is None
assert place(4) == first and place() == first
jax.config.update("jax_default_device", second)
assert place() == second
for same in (first, "cpu"):
    with jax.default_device(same):
        assert place() == first
print("placed")
"""


@pytest.mark.parametrize(("code", "devices", "told"), [(DEFAULTS, 2, "placed"), (AGREE, 8, "agree")])
def test_programs_run_on_the_default_device_and_eight_give_what_one_gives(code, devices, told):
    flags = os.environ.get("XLA_FLAGS", "") + f" --xla_force_host_platform_device_count={devices}"
    here = str(Path(__file__).parents[1])
    environment = os.environ | {"XLA_FLAGS": flags, "PYTHONPATH": os.pathsep.join([here, *sys.path])}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert done.returncode == 0 and told in done.stdout, done.stderr[-3000:]
