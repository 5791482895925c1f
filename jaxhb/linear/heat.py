"""Dampers and couplings that grow warm: the temperature at which they give off the heat
that they make, at each speed of the linear forced response.

A link with ``surface`` A, ``heat_transfer`` h and ``ambient`` T_a has the temperature T
= T_a + P / (h A), where P is the power that it turns into heat with the stiffness and
damping that its ``over_temperature`` gives at T: a silicone oil thins as it grows warm.
It is where ``dT/dt = T_a + P / (h A) - T`` comes to rest from T_a, as a train that is
started cold does (:func:`jaxhb.linear.forced.at_rest`).
"""

import dataclasses
from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, Numbers, namespace, on_host, traced
from jaxhb._program import Program
from jaxhb.elements.sentences import SceneError
from jaxhb.elements.values import joined
from jaxhb.linear.forced import (
    ForcedResponse,
    at_padded_speeds,
    at_rest,
    checked_harmonics,
    forced_response,
)
from jaxhb.linear.tangent import at_pressed_load, linear_train
from jaxhb.results.answers import solved
from jaxhb.train.changes import linearised
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.topology import Topology

SETTLED = 1e-10
"""Change of temperatures at which they are at rest, over the first from the air."""
AGREES = 1e-3  # K, by which the temperature may differ from that of its heat


def at_temperatures(
    train: DriveTrain, temperatures: Sequence[Array] | np.ndarray
) -> DriveTrain:
    """The train with the links that give off their heat at temperatures ``(W,)`` deg
    C.
    """
    names = warm_names(train.topology)
    return train.replace(
        {
            f"{name}.temperature": value
            for name, value in zip(names, temperatures, strict=True)
        }
    )


def warm_names(topology: Topology) -> list[str]:
    """Names of the links whose temperature follows from their heat."""
    return [topology.link_names[i] for i in topology.warm_links]


def fixed_temperatures(train: DriveTrain) -> list[str]:
    """Notes on the links that give off their heat, for answers that take them at one
    temperature.
    """
    return [
        f"{name} stays at {float(train.value(f'{name}.temperature')):g} deg C: the"
        " linear forced response (jaxhb forced) finds the temperature at which it gives"
        " off its heat"
        for name in warm_names(train.topology)
    ]


def heat_balance(
    train: DriveTrain, *, rpm: Numbers, harmonics: int | None = None
) -> ForcedResponse:
    """Linear forced response with dampers and couplings at the temperature at which
    they give off their heat, found at every speed.

    Without a link that has ``surface``, ``heat_transfer`` and ``ambient`` it is
    :func:`jaxhb.forced_response`, of which arguments, result and errors are those here,
    too. The temperature is :meth:`ForcedResponse.temperature`; where a speed has no
    response it is that of the air. :class:`SceneError` names links whose temperature
    was not found, and tells that numbers must be concrete.

    Examples
    --------
    >>> import jaxhb
    >>> law = [(20.0, 1.0, 1.0), (80.0, 1.0, 0.4)]
    >>> parts = [
    ...     jaxhb.Disk(name="crank", inertia=2.0),
    ...     jaxhb.Damper(
    ...         name="ring",
    ...         disk="crank",
    ...         inertia=0.5,
    ...         damping=50.0,
    ...         over_temperature=law,
    ...         surface=0.2,
    ...         heat_transfer=25.0,
    ...         ambient=40.0,
    ...     ),
    ...     jaxhb.Torque(disk="crank", harmonics=[(1.0, 300.0, 0.0)]),
    ... ]
    >>> warm = heat_balance(jaxhb.build(parts, revolutions_per_cycle=1), rpm=1200.0)
    >>> round(float(warm.temperature("ring")), 2)
    43.45
    >>> round(40.0 + float(warm.power("ring")) / (25.0 * 0.2), 2)
    43.45
    """
    names = warm_names(train.topology)
    if not names:
        return forced_response(train, rpm=rpm, harmonics=harmonics)
    if traced(train, rpm):
        raise SceneError(
            f"{train.topology.title}: the temperature of {joined(map(repr, names))} is"
            " found outside jit, vmap and grad. Take jaxhb.forced_response inside, with"
            " temperature set by train.replace."
        )
    harmonics = checked_harmonics(linearised(train), rpm, harmonics)
    speeds = np.atleast_1d(np.asarray(rpm, dtype=float))
    linear = linearised(linear_train(train, rpm=speeds[0]))
    if train.topology.springs:
        # Each speed has the slopes of its own mean load.
        at_speeds = [_alone(train, speed, harmonics) for speed in speeds]
        response = jax.tree.map(lambda *rows: np.stack(rows), *at_speeds)
    else:
        response = on_host(at_padded_speeds(_balanced, linear, speeds, harmonics))
    temperatures = np.asarray(response.temperatures)
    power = np.stack([response.power(name) for name in names], axis=-1)
    ambient = np.array([train.value(f"{name}.ambient") for name in names])
    unsettled = np.asarray(solved(response.status)) & ~np.all(
        np.abs(ambient + power / _conductance(train) - temperatures) <= AGREES, axis=-1
    )
    if unsettled.any():
        raise SceneError(
            f"{train.topology.title}: the temperature of {joined(map(repr, names))} is"
            f" not found at {np.sum(unsettled)} of {len(speeds)} speeds, the first"
            f" {speeds[unsettled][0]:g} rpm. Make over_temperature smoother, or give a"
            " temperature without surface."
        )
    response = dataclasses.replace(response, train=linear)
    return response if np.ndim(rpm) else response[0]


def _alone(train: DriveTrain, speed: float, harmonics: int) -> ForcedResponse:
    """The response at one speed of a train with stages, stops, clearance or friction,
    which other links have than those that grow warm.
    """
    loaded = linearised(at_pressed_load(train, rpm=speed).train)
    temperatures = _balanced(loaded, np.array([speed]), harmonics).temperatures
    assert temperatures is not None
    inside = _inside(train, temperatures[0])
    warm = at_temperatures(train, list(inside))
    response = forced_response(warm, rpm=speed, harmonics=harmonics)
    return dataclasses.replace(response, temperatures=temperatures[0])


def _conductance(train: DriveTrain) -> Array:
    """Heat ``(W,)`` in W/K that links give off."""
    xp = namespace(train)
    return xp.stack(
        [
            xp.asarray(
                train.value(f"{name}.surface") * train.value(f"{name}.heat_transfer")
            )
            for name in warm_names(train.topology)
        ]
    )


def _inside(train: DriveTrain, temperatures: Array) -> Array:
    """Temperatures ``(W,)`` within the rows of each link: outside the factors are
    constant, and numbers have a range.
    """
    rows = [
        train.value(f"{name}.over_temperature") for name in warm_names(train.topology)
    ]
    lowest = jnp.stack([jnp.asarray(row)[0, 0] for row in rows])
    highest = jnp.stack([jnp.asarray(row)[-1, 0] for row in rows])
    return jnp.clip(jnp.asarray(temperatures), lowest, highest)


@partial(Program, static_argnames="harmonics")
def _balanced(train: DriveTrain, rpm: Array, harmonics: int) -> ForcedResponse:
    """The response at speeds ``(n,)`` with its temperatures ``(n, W)``."""
    names = warm_names(train.topology)
    ambient = jnp.stack([jnp.asarray(train.value(f"{name}.ambient")) for name in names])
    conductance = _conductance(train)

    def respond(temperatures: Array, speed: Array) -> ForcedResponse:
        """The response at a speed with links at temperatures ``(W,)``."""
        warm = at_temperatures(train, list(_inside(train, temperatures)))
        return forced_response(warm, rpm=speed, harmonics=harmonics)

    def at(speed: Array) -> ForcedResponse:
        """The response at a speed with its temperatures."""

        def resulting(temperatures: Array) -> Array:
            response = respond(temperatures, speed)
            power = jnp.stack([response.power(name) for name in names])
            return ambient + power / conductance

        temperatures = at_rest(resulting, ambient, SETTLED)
        response = respond(temperatures, speed)
        return dataclasses.replace(response, temperatures=temperatures)

    return jax.vmap(at)(jnp.asarray(rpm))


def span_of(train: DriveTrain, name: str) -> tuple[float, float]:
    """First and last temperature in deg C of the rows of a link, whose factors hold
    outside, too.
    """
    rows = np.asarray(train.value(f"{name}.over_temperature"))
    return float(rows[0, 0]), float(rows[-1, 0])
