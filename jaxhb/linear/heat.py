"""Dampers and couplings that grow warm: the temperature at which they give off the heat
that they make, at each speed of the linear forced response.

A link with ``surface`` A, ``heat_transfer`` h and ``ambient`` T_a has the temperature T
= T_a + P / (h A), where P is the power that it turns into heat with the stiffness and
damping that its ``over_temperature`` gives at T: a silicone oil thins as it grows warm.
"""

import dataclasses
from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, Numbers, on_host, traced
from jaxhb._program import Program
from jaxhb.elements.sentences import SceneError
from jaxhb.elements.values import joined
from jaxhb.linear.forced import ForcedResponse, forced_response
from jaxhb.results.answers import solved
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.topology import Topology

STEPS = 60
SETTLED = 1e-4  # K, by which the temperature may differ from that of its heat
SHORTEST = 0.05
LONGEST = 3.0
"""Step over the difference of temperatures, at least and at most."""


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
    # For its errors, and the train of the response.
    first = forced_response(train, rpm=rpm, harmonics=harmonics)
    speeds = np.atleast_1d(np.asarray(rpm, dtype=float))
    ambient = np.array([train.value(f"{name}.ambient") for name in names])
    conductance = np.array(
        [
            train.value(f"{name}.surface") * train.value(f"{name}.heat_transfer")
            for name in names
        ]
    )
    spans = [span_of(train, name) for name in names]
    lowest, highest = np.transpose(spans)

    def respond(temperatures: np.ndarray) -> ForcedResponse:
        """The response at all speeds with links at temperatures ``(n, W)``."""
        # Constant outside the rows, and numbers have a range.
        inside = np.clip(temperatures, lowest, highest)
        if not train.topology.springs:
            return on_host(_respond_each(train, inside, speeds, harmonics))
        # Each speed has the slopes of its own mean load.
        responses = [
            forced_response(
                at_temperatures(train, inside[i]), rpm=speeds[i], harmonics=harmonics
            )
            for i in range(len(speeds))
        ]
        return jax.tree.map(lambda *rows: np.stack(rows), *responses)

    temperatures = np.tile(ambient, (len(speeds), 1))
    before = (np.nan * temperatures, np.nan * temperatures)
    for _ in range(STEPS):
        response = respond(temperatures)
        power = np.stack([response.power(name) for name in names], axis=-1)
        excess = ambient + power / conductance - temperatures
        unsolved = ~np.asarray(solved(response.status))
        settled = unsolved | np.all(np.abs(excess) <= SETTLED, axis=-1)
        if settled.all():
            break
        steps = _steps(temperatures, excess, *before)
        before = (temperatures, excess)
        moved = temperatures + steps * excess
        temperatures = np.where(settled[:, None], temperatures, moved)
    else:
        lost = speeds[~settled]
        raise SceneError(
            f"{train.topology.title}: the temperature of {joined(map(repr, names))} is"
            f" not found at {len(lost)} speeds, the first {lost[0]:g} rpm: it still"
            f" moves by {np.max(np.abs(excess[~settled])):.3g} K after {STEPS} steps."
            " Give over_temperature more rows, or a temperature without surface."
        )
    temperatures = np.where(unsolved[:, None], ambient, temperatures)
    response = dataclasses.replace(
        response, temperatures=temperatures, train=first.train
    )
    return response if np.ndim(rpm) else response[0]


def span_of(train: DriveTrain, name: str) -> tuple[float, float]:
    """First and last temperature in deg C of the rows of a link, whose factors hold
    outside, too.
    """
    rows = np.asarray(train.value(f"{name}.over_temperature"))
    return float(rows[0, 0]), float(rows[-1, 0])


def _steps(
    temperatures: np.ndarray,
    excess: np.ndarray,
    temperatures_before: np.ndarray,
    excess_before: np.ndarray,
) -> np.ndarray:
    """Steps ``(n, W)`` over the excess of temperature: by the secant of each link,
    where the excess falls with the temperature; 1 at first.
    """
    change = temperatures - temperatures_before
    rise = excess - excess_before
    falls = np.isfinite(change) & (change * rise < 0.0)
    secant = np.where(falls, -change, 1.0) / np.where(falls, rise, 1.0)
    return np.clip(secant, SHORTEST, LONGEST)


@partial(Program, static_argnames="harmonics")
def _respond_each(
    train: DriveTrain, temperatures: Array, rpm: Array, harmonics: int | None
) -> ForcedResponse:
    """The response at speeds ``(n,)``, at each with its own temperatures ``(n, W)``."""

    def at(temperature: Array, speed: Array) -> ForcedResponse:
        warm = at_temperatures(train, list(temperature))
        return forced_response(warm, rpm=speed, harmonics=harmonics)

    return jax.vmap(at)(jnp.asarray(temperatures), jnp.asarray(rpm))
