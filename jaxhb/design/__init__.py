"""Design: objectives to be differentiated, and tuning by gradient (``tune``, which loads optax when first used)."""

from .. import _x64  # noqa: F401
from .quantities import Objective, Parameter, Penalty

__all__ = ["Objective", "Parameter", "Penalty", "tune"]


def __getattr__(name):
    if name == "tune":
        from .tuning import tune

        return tune
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
