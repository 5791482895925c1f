"""A fast subset for every supported Python: import, command line, solve, gradient,
vmapped planned solve.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import jax
import numpy as np

import jaxhb

print(
    f"Python {sys.version.split()[0]}, jax {jax.__version__}, jaxlib"
    f" {jax.lib.__version__}, numpy {np.__version__}"
)
response = jaxhb.check(jaxhb.solve(jaxhb.load_scene("gear_train_30"), rpm=1800.0))
largest = response.force("crank gear", "idler").max
assert abs(largest / 24.02e3 - 1) < 2e-3, largest

pair, mesh, rpm = jaxhb.load_scene("spur_pair"), ("gear a", "gear b"), 5000.0
exact = jaxhb.plan(pair, rpm=rpm, harmonics=64, integrals="exact")


def peak(damping, rpm):
    changed = pair.replace({"gear a|gear b.damping": damping})
    return jaxhb.solve(changed, rpm=rpm, plan=exact).force(*mesh).smooth_peak()


damping = float(pair.value("gear a|gear b.damping"))
slope, step = jax.grad(peak)(damping, rpm), 1e-3 * damping
difference = (peak(damping + step, rpm) - peak(damping - step, rpm)) / (2 * step)
assert abs(slope / difference - 1) < 1e-5, (
    slope,
    difference,
)  # of differences, second order in the step

speeds = np.array([4990.0, rpm, 5010.0])
batch = jax.vmap(peak, in_axes=(None, 0))(damping, speeds)
np.testing.assert_allclose(batch, [peak(damping, speed) for speed in speeds], rtol=1e-8)

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "result.json"
    command = [
        Path(sys.executable).parent / "jaxhb",
        "solve",
        "spur_pair",
        "--rpm",
        f"{rpm:g}",
        "--json",
        file,
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("The teeth hammer at 5000 rpm"), done.stdout
    assert not done.stderr, done.stderr
    told = json.loads(file.read_text())["meshes"]["|".join(mesh)]["max"]
    steady = float(jaxhb.steady_state(pair, rpm=rpm).force(*mesh).max)
    assert told == steady, (told, steady)
print("subset passed: import, solve, gradient, vmapped planned solve, command line")
