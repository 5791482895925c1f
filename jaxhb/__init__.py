"""Harmonic balance for the forced periodic vibration of drive trains with gear backlash, in JAX.

Names are loaded when they are first used: the command line sets what must be set before jax is imported. Importing
jaxhb switches jax to double precision, at once where jax is already there and else with the first name.
"""

import importlib
import sys

__version__ = "0.1.0"

_HOMES = {
    "_program": ("cache_programs",),
    "model.drivetrain": ("DriveTrain", "build"),
    "model.elements": (
        "Combustion",
        "Cylinder",
        "Damper",
        "Disk",
        "Ground",
        "Load",
        "Mesh",
        "SceneError",
        "Shaft",
        "Torque",
        "Trace",
    ),
    "model.derived": ("shaft_stiffness", "viscous_damping"),
    "model.engine": ("Engine",),
    "model.plausible": ("plausibility",),
    "model.ratios": ("Referred", "referred", "tooth_damping_ratios"),
    "model.scene_writer": ("elements_text", "scene_text"),
    "model.scene": ("load_scene", "scene_names"),
    "linear.critical": ("Campbell", "Critical", "campbell", "critical_speed"),
    "linear.damped": ("DampedModes", "damped_eigenvalues", "damped_modes", "damping_ratios"),
    "linear.energy": ("inertia_and_stiffness", "kinetic_energy", "strain_energy"),
    "linear.forced": ("ForcedResponse", "forced_response"),
    "linear.holzer": ("HolzerTable", "holzer_residual", "holzer_table"),
    "linear.limits": ("Strength", "strength"),
    "linear.modal": ("Modes", "all_frequencies", "natural_frequencies"),
    "linear.polynomial": ("characteristic", "damped_approximation", "frequency_response"),
    "linear.sensitivity": ("cluster_sums_hz", "clusters_of", "frequencies_hz", "mode_shares"),
    "linear.splitting": ("characteristic_coefficients",),
    "linear.strength": ("BarredRange", "barred_ranges", "permissible_stress", "torsional_stress"),
    "linear.tangent": ("MeanLoad", "at_mean_load"),
    "transient.reference": ("integrate", "shooting_correction"),
    "response.response": ("Response",),
    "response.signal": ("Signal",),
    "response.status": ("NotConverged", "Status", "check"),
    "periodic.plan": ("Plan",),
    "periodic.solve": ("linear_response", "plan", "solve"),
    "periodic.speeds": ("solve_speeds",),
    "periodic.checkpoint": ("CheckpointError",),
    "periodic.misfires": ("misfire_each",),
    "periodic.branch": ("Branch", "BranchOptions", "follow"),
    "periodic.certificate": ("Certificate", "Kantorovich", "certify"),
    "periodic.returns": ("Cycles",),
    "periodic.search": ("PeriodicMotion", "solve_all"),
    "periodic.stability": ("Stability", "largest_multiplier", "stability"),
    "periodic.steady_state": ("steady_state",),
    "response.steady": ("SteadyState", "SteadySweep"),
    "design": ("tune",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}
__all__ = sorted(_HOME)

if "jax" in sys.modules:
    from . import _x64  # noqa: F401


def __getattr__(name):
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import _x64  # noqa: F401

    found = globals()[name] = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
    return found


def __dir__():
    return sorted([*globals(), *__all__])
