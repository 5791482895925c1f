"""Which numbers are best: objectives to be differentiated, and tuning by gradient. A train, parameters and objectives
go in; a tuned train and its history come out."""

import importlib
from typing import TYPE_CHECKING

from jaxhb._jax import load

from .quantities import Objective, Parameter, Penalty

if TYPE_CHECKING:
    from .tuning import tune

load()

__all__ = ["Objective", "Parameter", "Penalty", "tune"]


def __getattr__(name):
    if name == "tune":
        return importlib.import_module(".tuning", __name__).tune
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
