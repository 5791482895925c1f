"""Sentences on cylinders that do not fire, and on what is computed of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jaxhb._jax import Array, traced
from jaxhb.excitation.gas import COMPUTED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxhb.train.drivetrain import DriveTrain

COMPRESSING = "no injection, compression stays"
CUT_OFF = "cut off, no gas torque at all"
NO_COMPRESSION = (
    "no gas torque at all, as compression cannot be told from a given gas_torque"
)
NOTHING = "no gas torque, the scene gives none"
"""Words for what is computed of a cylinder that does not fire."""


NAMED = 6  # cylinders in a sentence; of more the first and the last


def not_firing(*trains: DriveTrain) -> list[str]:
    """Say what is computed of cylinders without injection or gas torque, in any of some
    trains; see :meth:`DriveTrain.not_firing`.
    """
    alike: dict[str, dict[str, None]] = {}
    for train in trains:
        for number, name in enumerate(train.topology.cylinder_names):
            state = _computed(train, number)
            if state:
                alike.setdefault(state, {})[name] = None
    return [f"{_listed(list(names))}: {state}" for state, names in alike.items()]


def _listed(names: Sequence[str]) -> str:
    """Names in a sentence; of many the first and the last."""
    return (
        ", ".join(names)
        if len(names) <= NAMED
        else f"{names[0]}, … {names[-1]} ({len(names)} cylinders)"
    )


def is_cut_off(train: DriveTrain, cylinder: str) -> bool:
    """Tell whether a cylinder has no gas torque at all, whatever it is made of."""
    number = train.topology.cylinder_names.index(cylinder)
    return train.topology.cylinder_cut_off[number] or _is_zero(
        train.cylinders.gas_factor, number
    )


def _computed(train: DriveTrain, number: int) -> str:
    """Words for what is computed of one cylinder, "" of one that fires."""
    cycles = train.topology.gas_cycles
    if cycles.cut_off[number] or _is_zero(train.cylinders.gas_factor, number):
        return CUT_OFF
    if cycles.fires[number] and not _is_zero(train.cylinders.injection, number):
        return ""
    if cycles.source[number] in COMPUTED:
        return COMPRESSING
    return NO_COMPRESSION if cycles.source[number] == "harmonics" else NOTHING


def _is_zero(values: Array | None, number: int) -> bool:
    """Whether a number of an element is there, not traced, and 0."""
    return (
        values is not None
        and not traced(values)
        and float(np.asarray(values)[number]) == 0.0
    )
