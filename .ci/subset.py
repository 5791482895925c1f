"""A fast subset for every supported Python: import, command line, solve, gradient, vmapped planned solve."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import jax
import numpy as np

import jaxhb

print(f"Python {sys.version.split()[0]}, jax {jax.__version__}, jaxlib {jax.lib.__version__}, numpy {np.__version__}")
train, mesh = jaxhb.load_scene("gear_train_30"), ("crank gear", "idler")
plan = jaxhb.plan(train, rpm=1800.0, harmonics=384)


def peak(damping, rpm):
    changed = train.replace({"crank damper.damping": damping})
    return jaxhb.solve(changed, rpm=rpm, plan=plan).force(*mesh).smooth_peak()


response = jaxhb.check(jaxhb.solve(train, rpm=1800.0))
largest = response.force(*mesh).max
assert abs(largest / 24.02e3 - 1) < 2e-3, largest

pair = jaxhb.load_scene("spur_pair")
exact = jaxhb.plan(pair, rpm=5000.0, harmonics=64, integrals="exact")


def pair_peak(damping):
    changed = pair.replace({"gear a|gear b.damping": damping})
    return jaxhb.solve(changed, rpm=5000.0, plan=exact).force("gear a", "gear b").smooth_peak()


damping = float(pair.value("gear a|gear b.damping"))
slope, step = jax.grad(pair_peak)(damping), 1e-3 * damping
difference = (pair_peak(damping + step) - pair_peak(damping - step)) / (2 * step)
assert abs(slope / difference - 1) < 1e-5, (slope, difference)  # of differences, second order in the step

speeds = np.array([1790.0, 1800.0, 1810.0])
batch = jax.vmap(peak, in_axes=(None, 0))(220.0, speeds)
np.testing.assert_allclose(batch, [peak(220.0, rpm) for rpm in speeds], rtol=1e-8)

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "result.json"
    command = [Path(sys.executable).parent / "jaxhb", "solve", "gear_train_30", "--rpm", "1800", "--json", file]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("The teeth hammer at 1800 rpm"), done.stdout
    assert not done.stderr, done.stderr
    told = json.loads(file.read_text())["meshes"]["|".join(mesh)]["max"]
    steady = float(jaxhb.steady_state(train, rpm=1800.0).force(*mesh).max)
    assert told == steady and abs(told / largest - 1) < 2e-3, (told, steady, largest)
print("subset passed: import, solve, gradient, vmapped planned solve, command line")
