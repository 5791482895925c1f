"""Contributions of each cylinder to the orders of a linear forced response."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from jaxhb._jax import Array, refuse_tracers
from jaxhb.elements.sentences import SceneError
from jaxhb.linear.forced import ForcedResponse, forced_response
from jaxhb.linear.heat import at_temperatures, heat_balance, span_of, warm_names
from jaxhb.results.signal import Signal
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.tables import with_table


@dataclass(frozen=True, eq=False)
class Contributions:
    """Complex peak amplitudes of a signal by order, and what each cylinder adds to them
    with its gas and its reciprocating mass.

    Attributes
    ----------
    cylinders : tuple of str ``(C,)``; rpm : array ``(n,)``; orders : array ``(K,)``, of
        the reference rotor
    total : complex array ``(n, K)``, amplitude exp(i phase)
    parts : complex array ``(C, n, K)``; what they leave of the total comes from torques
        and meshes
    """

    cylinders: tuple[str, ...]
    rpm: np.ndarray
    orders: np.ndarray
    total: np.ndarray
    parts: np.ndarray

    def shares(self) -> np.ndarray:
        """Parts in the direction of the total over its size ``(C, n, K)``: their sum is
        1 where nothing but cylinders excites; 0 where the total is.
        """
        squared = np.abs(self.total) ** 2
        along = (self.parts * self.total.conj()).real
        return np.divide(along, squared, out=np.zeros_like(along), where=squared > 0)


def cylinder_contributions(
    train: DriveTrain,
    read: Callable[[ForcedResponse], Signal],
    *,
    rpm: Sequence[float] | Array,
) -> Contributions:
    """Contributions of each cylinder to a signal of the linear forced response.

    A linear response is the sum of those to each excitation: a cylinder adds the
    response less that of the train without its torques, of gas and reciprocating mass.
    Loads pulsate with the mean torque that the cylinder gives. Dampers and couplings
    that grow warm have the temperatures of :func:`jaxhb.heat_balance` with all
    excitations.

    Parameters
    ----------
    read : function of a :class:`jaxhb.ForcedResponse` that reads the signal
    rpm : speeds ``(n,)`` of the reference rotor; on the host

    Raises
    ------
    SceneError : no cylinder, or links whose stiffness depends on the motion, of which
        responses do not add up

    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> added = jaxhb.cylinder_contributions(
    ...     train, lambda response: response.torque("cyl6", "flywheel"), rpm=[1500.0]
    ... )
    >>> bool(abs(added.parts.sum(axis=0) - added.total).max() < 1e-6)
    True
    """
    refuse_tracers(
        "cylinder_contributions",
        (train, rpm),
        instead="take jaxhb.forced_response of trains with gas_factor 0 of a cylinder",
    )
    topology = train.topology
    where = f"{topology.title}, cylinder_contributions"
    if not topology.cylinder_names:
        raise SceneError(f"{where}: there is no cylinder. Give one, or an engine.")
    if topology.springs or topology.amplitude_links:
        raise SceneError(
            f"{where}: the stiffness of links depends on the motion (stages, stops or"
            " over_amplitude), so that responses do not add up. Give constant links."
        )
    speeds = np.asarray(rpm, dtype=float)
    if not topology.warm_links:
        return _contributions(train, read, speeds)
    # Each speed has links at the temperatures that all cylinders together give them.
    warm = heat_balance(train, rpm=speeds).temperatures
    assert warm is not None
    by_speed = [
        _contributions(_warmed(train, temperatures), read, speeds[i : i + 1])
        for i, temperatures in enumerate(np.asarray(warm))
    ]
    return dataclasses.replace(
        by_speed[0],
        rpm=speeds,
        total=np.concatenate([added.total for added in by_speed]),
        parts=np.concatenate([added.parts for added in by_speed], axis=1),
    )


def _contributions(
    train: DriveTrain, read: Callable[[ForcedResponse], Signal], speeds: np.ndarray
) -> Contributions:
    """Contributions at speeds ``(n,)`` in a train whose links are as they are."""
    full = read(forced_response(train, rpm=speeds))
    total = _complex(full)
    cycles = total.shape[-1]
    parts = []
    for i in range(len(train.topology.cylinder_names)):
        response = forced_response(_without(train, i), rpm=speeds, harmonics=cycles)
        parts.append(total - _complex(read(response)))
    return Contributions(
        cylinders=train.topology.cylinder_names,
        rpm=speeds,
        orders=np.asarray(full.orders),
        total=total,
        parts=np.stack(parts),
    )


def _warmed(train: DriveTrain, temperatures: np.ndarray) -> DriveTrain:
    """The train with its warm links at temperatures ``(W,)`` deg C, beyond the rows of
    ``over_temperature`` those of the nearest row.
    """
    spans = np.array([span_of(train, name) for name in warm_names(train.topology)])
    return at_temperatures(train, np.clip(temperatures, spans[:, 0], spans[:, 1]))


def _without(train: DriveTrain, i: int) -> DriveTrain:
    """The train without the torques of cylinder ``i``."""
    weights = np.ones(len(train.topology.cylinder_names))
    weights[i] = 0.0
    cylinders = train.cylinders
    factor = weights if cylinders.gas_factor is None else cylinders.gas_factor * weights
    silent = dataclasses.replace(
        cylinders,
        gas_factor=factor,
        reciprocating_mass=cylinders.reciprocating_mass * weights,
    )
    return with_table(train, "cylinder", silent)


def _complex(signal: Signal) -> np.ndarray:
    """Complex peak amplitudes ``(n, K)`` of a signal."""
    phases = np.deg2rad(np.asarray(signal.phases_deg))
    return np.asarray(signal.amplitudes) * np.exp(1j * phases)
