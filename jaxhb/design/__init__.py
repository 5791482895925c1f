"""The best numbers of a train, and the effects of numbers that nobody knows exactly. A
train, parameters or tolerances, and objectives go in; a tuned train and its history, or
the worst case and its place, come out.
"""

import importlib
from typing import TYPE_CHECKING, Any

from jaxhb._jax import load

from .quantities import Objective, Parameter, Penalty

if TYPE_CHECKING:
    from .identification import identify, weak_cylinder
    from .measurements import Measured, read_measured
    from .phases import worst_phase
    from .signals.files import Recorded, read_recorded
    from .tolerances import Tolerance, read_tolerances
    from .transients.tuning import TransientObjective, tune_transient
    from .tuning import tune
    from .worst_case import tolerance

load()

LATER = {"tune": "tuning", "tolerance": "worst_case", "worst_phase": "phases"}
LATER |= dict.fromkeys(("Tolerance", "read_tolerances"), "tolerances")
LATER |= dict.fromkeys(("identify", "weak_cylinder"), "identification")
LATER |= dict.fromkeys(("TransientObjective", "tune_transient"), "transients.tuning")
LATER |= dict.fromkeys(("Measured", "read_measured"), "measurements")
LATER |= dict.fromkeys(("Recorded", "read_recorded"), "signals.files")
"""Modules of the names whose import takes optax or scipy."""

__all__ = [
    "Measured",
    "Objective",
    "Parameter",
    "Penalty",
    "Tolerance",
    "identify",
    "read_measured",
]
__all__ += ["Recorded", "read_recorded"]
__all__ += ["TransientObjective", "read_tolerances", "tolerance", "tune"]
__all__ += ["tune_transient", "weak_cylinder", "worst_phase"]


def __getattr__(name: str) -> Any:
    if name in LATER:
        return getattr(importlib.import_module(f".{LATER[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
