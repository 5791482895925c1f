"""The task of a tuning, the scales of its parameters, and readings of a design."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, namespace
from jaxhb._shown import brief
from jaxhb.design.quantities import OF_DESIGN, Criterion, Parameter, Penalty
from jaxhb.train.drivetrain import DriveTrain

# |z| of a start on a bound: a thousandth of the range inside it, where the share still
# has a slope
FARTHEST = 6.9
# Quantity, element and order of a reading, and which variant of it is differentiated
ResponseReading: TypeAlias = tuple[str, str | None, float | None, str]


def scales(
    parameters: Sequence[Parameter],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bounds ``(P,)`` of parameters, and the logarithm of their ratio, 0 on a linear
    scale.
    """
    low, high = np.array(
        [(parameter.low, parameter.high) for parameter in parameters]
    ).T
    log = np.array([parameter.scale == "log" for parameter in parameters])
    return low, high, np.log(np.where(log, high, 1.0) / np.where(log, low, 1.0))


def named_at(parameters: Sequence[Parameter], shares: Array) -> dict[str, Any]:
    """Parameters by name at ``shares`` ``(P,)`` of the way between their bounds, on
    their scales; floats on the host.
    """
    xp = namespace(shares)
    low, high, ratio = scales(parameters)
    values = xp.where(
        ratio > 0, low * xp.exp(shares * ratio), low + shares * (high - low)
    )
    return {
        parameter.name: values[i] if xp is jnp else float(values[i])
        for i, parameter in enumerate(parameters)
    }


def shares_of(train: DriveTrain, parameters: Sequence[Parameter]) -> np.ndarray:
    """Shares ``(P,)`` of the way between their bounds at which a train has parameters,
    as of :func:`named_at`.
    """
    values = [float(train.value(parameter.name)) for parameter in parameters]
    return shares_at(parameters, np.array(values))


def shares_at(parameters: Sequence[Parameter], values: np.ndarray) -> np.ndarray:
    """Shares ``(P,)`` of the way between their bounds of values ``(P,)`` of
    parameters.
    """
    low, high, ratio = scales(parameters)
    log = ratio > 0
    logarithm = np.log(np.where(log, values, 1.0) / np.where(log, low, 1.0))
    linear = (values - low) / (high - low)
    return np.where(log, logarithm / np.where(log, ratio, 1.0), linear)


def unbounded_at(shares: np.ndarray) -> np.ndarray:
    """The z ``(P,)`` of shares, of those on a bound a little inside."""
    with np.errstate(divide="ignore"):
        z = np.log(shares) - np.log1p(-shares)
    return np.clip(z, -FARTHEST, FARTHEST)


@dataclass(frozen=True)
class Task:
    """The purpose of a tuning: tuples of Parameter, Objective, Penalty."""

    parameters: tuple
    objectives: tuple
    penalties: tuple
    smooth = True
    step_tolerance = 0.0
    """Newton step after which a lane is solved; 0 for the accuracy of derivatives."""

    @property
    def of_response(self) -> tuple[Criterion, ...]:
        """The objectives, and the penalties that read a response: J of them."""
        return self.objectives + tuple(
            penalty for penalty in self.penalties if penalty.quantity not in OF_DESIGN
        )

    @property
    def of_design(self) -> tuple[Penalty, ...]:
        """The penalties that read the train alone."""
        return tuple(
            penalty for penalty in self.penalties if penalty.quantity in OF_DESIGN
        )

    @property
    def response_readings(self) -> tuple[ResponseReading, ...]:
        """Quantity, element and order of each reading of a response, and which variant
        of it is differentiated.
        """
        variants = [
            "close" if isinstance(criterion, Penalty) else "read"
            for criterion in self.of_response
        ]
        variants = variants if self.smooth else ["sharp"] * len(variants)
        return tuple(
            (criterion.quantity, criterion.of, criterion.order, variant)
            for criterion, variant in zip(self.of_response, variants, strict=True)
        )

    def named(self, z: Array) -> dict[str, Any]:
        """Parameters by name, in their own units, from z ``(P,)``; floats on
        the host.
        """
        return named_at(self.parameters, 1 / (1 + namespace(z).exp(-z)))

    def unbounded(self, train: DriveTrain) -> np.ndarray:
        """The z ``(P,)`` of a train, of values on a bound a little inside."""
        return unbounded_at(shares_of(train, self.parameters))


@brief
@dataclass(frozen=True)
class Reading:
    """The readings of a design: parameters by name, whether each speed is solved
    ``(n,)``, readings by label.

    A reading is an array ``(n,)`` in SI units, nan where the speed is not solved or a
    rule has no limit, or a float for those of the train alone; its label is ``"tooth
    force of crank gear|idler"``.
    """

    parameters: dict[str, float]
    solved: np.ndarray
    readings: dict[str, Any]

    def of_first(self, count: int) -> Reading:
        """Select the readings of the first speeds."""
        readings = {
            name: values[:count] if np.ndim(values) else values
            for name, values in self.readings.items()
        }
        return dataclasses.replace(self, solved=self.solved[:count], readings=readings)
