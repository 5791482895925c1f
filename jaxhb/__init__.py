"""Harmonic balance for the forced periodic vibration of drive trains with gear backlash, in JAX."""

from . import _x64  # noqa: F401
from .linear.modal import natural_frequencies
from .linear.response import Response
from .linear.signal import Signal
from .model.drivetrain import DriveTrain, build
from .model.elements import Cylinder, Damper, Disk, Ground, Load, Mesh, SceneError, Shaft, Torque
from .model.scene import load_scene, scene_names
from .periodic.harmonics import Plan
from .periodic.newton import Status
from .periodic.solve import NotConverged, check, linear_response, plan, solve
from .periodic.speeds import solve_speeds
from .transient.referee import integrate, shooting_correction

__version__ = "0.1.0"
__all__ = [
    "Cylinder",
    "Damper",
    "Disk",
    "DriveTrain",
    "Ground",
    "Load",
    "Mesh",
    "NotConverged",
    "Plan",
    "Response",
    "SceneError",
    "Shaft",
    "Signal",
    "Status",
    "Torque",
    "build",
    "check",
    "integrate",
    "linear_response",
    "load_scene",
    "natural_frequencies",
    "plan",
    "scene_names",
    "shooting_correction",
    "solve",
    "solve_speeds",
    "tune",
]


def __getattr__(name):
    if name == "tune":  # loads optax, which nothing else needs
        from .design import tune

        return tune
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
