"""Harmonic balance for the forced periodic vibration of drive trains with gear
backlash, in JAX.

A map of the package; ``help(jaxhb.solve)`` and the like have units, shapes, errors and
an example.

=====================  =================================================================
a train                load_scene, scene_names, build from Disk, Shaft, Mesh, Damper,
                       Engine, ...; DriveTrain.replace
one speed              solve (a Response), check, linear_response, forced_response,
                       plan, gradient_and_error
the equations          harmonic_residual (A(x) and its Jacobian), block_sweep (a Newton
                       step)
many speeds            solve_speeds, misfire_each, cut_off_each, follow (a branch
                       through its folds)
many trains            campaign (a study, as rows of a folder), load_study
other processes        Workers, Cluster: executors of many speeds and trains
what the train does    steady_state; stability, solve_all, lift_off
linear                 natural_frequencies, damped_modes, campbell, holzer_table,
                       at_mean_load, frequency_response
judge                  strength, certify (a computed bound), shooting_correction (a
                       check by time integration)
tune                   tune; Objective, Parameter, Penalty and smooth objectives in
                       jaxhb.design
not known exactly      tolerance (the worst case); identify (numbers from measurements),
                       measured_orders (of pulses, angles or speeds over time)
read                   Response.force, .torque, .gear_torque, .twist, .disk: a Signal;
                       Response.mesh: contact
start at once          cache_programs
=====================  =================================================================

Numbers are in SI units, speeds in rpm of the reference rotor. Names are loaded when
they are first used: the command line sets what must be set before jax is imported.
jaxhb computes in double precision: its import switches jax to that for the whole
process (``jax_enable_x64``), whether jax is there already or comes later.
"""

import ast
import importlib
import os
import sys
from pathlib import Path

__version__ = "0.1.0"


def _homes() -> dict[str, str | None]:
    """The module of every public name, as the stub for type checkers has it."""
    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    return {
        alias.name: node.module
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


_HOME = _homes()
__all__ = sorted(_HOME)

_environment_before = {
    name: os.environ[name] for name in ("JAX_ENABLE_X64",) if name in os.environ
}
if "jax" in sys.modules:
    from jaxhb._jax import load

    load()
else:
    os.environ["JAX_ENABLE_X64"] = "1"  # jax reads it at its import, whoever imports it


def __getattr__(name: str):
    if name == "design":
        return importlib.import_module(".design", __name__)
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from jaxhb._jax import load

    load()
    module = importlib.import_module(f".{_HOME[name]}", __name__)
    globals()[name] = getattr(module, name)
    return globals()[name]


def __dir__() -> list[str]:
    return sorted(["__doc__", "__version__", "design", *__all__])
