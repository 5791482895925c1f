"""A rule by which the torsional stresses of a shaft are judged.

Scenes and the help of commands read the names of rules: nothing here imports numpy
before a limit is computed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jaxhb._jax import Array, Number


@dataclass(frozen=True)
class Section:
    """A shaft as rules see it: diameter and bore in m, strengths in Pa, nominal torque
    in N m and rated speed in rpm, numbers or arrays; nan where it has no such number, a
    ``yield_strength`` of 0 where it is not known.
    """

    diameter: Number
    tensile_strength: Number
    stress_concentration: Number
    yield_strength: Number
    bore: Number = 0.0
    nominal_torque: Number = math.nan
    rated_rpm: Number = math.nan


@dataclass(frozen=True)
class Rule:
    """A set of limits of torsional vibration stresses.

    Parameters
    ----------
    name : str, as a scene gives it; source : str, the publication
    limits : function of a :class:`Section` and the speeds ``(...)`` over the rated
        speed: continuous and transient limits ``(...)`` Pa, whatever ``highest`` is
    highest : float, share of the rated speed up to which it has limits
    required : float, share of the rated speed up to which it requires stresses
    passed : float, share of the rated speed above which it accepts no barred range
    corners : tuple of float, shares at which a limit has a step or a corner
    note : str, what readers of a table are told of it; ``{source}``, ``{rated}`` rpm
    needs : tuple of str, keys of a shaft that its limits are computed from
    unread : tuple of str, keys of a shaft that have no part in its limits
    title : str, how sentences name it; its name by default
    crankshafts : bool, whether it holds for crankshafts
    default : bool, whether it judges shafts that name none
    barred : function of a critical speed and the rated speed in rpm: the lowest and the
        highest speed that the rule bars around it; None of a rule without
    range_source : str, where the rule says so
    year : int or None, of the publication
    """

    name: str
    source: str
    limits: Callable[[Section, Array], tuple[Array, Array]]
    highest: float
    required: float
    passed: float
    corners: tuple[float, ...]
    note: str
    needs: tuple[str, ...]
    unread: tuple[str, ...]
    title: str = ""
    crankshafts: bool = True
    default: bool = False
    barred: Callable[[Number, Number], tuple[Number, Number]] | None = None
    range_source: str = ""
    year: int | None = None
