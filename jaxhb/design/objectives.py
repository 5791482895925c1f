"""Differentiable functions of a response by which a design is judged.

Each reads a :class:`~jaxhb.Response`, of one speed or of a batch (from ``jax.vmap``
over :func:`jaxhb.solve`), and returns one number per speed, ``(...)``; :func:`worst`
and :func:`weighted_sum` make one number of a batch. A speed that failed counts as zero
with zero derivative; the number of valid speeds is returned beside every sum, so that
no optimiser is paid for failing. ``a, b`` are the two ends of a link, or its name
alone; ``train`` is by default that of the response, which has none if it comes out of a
jax transformation.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jaxhb._jax import Array, Number
from jaxhb.elements.sentences import SceneError
from jaxhb.equations import fourier
from jaxhb.linear import strength
from jaxhb.results.answers import with_zeros
from jaxhb.results.response import Response
from jaxhb.results.signal import Signal, p_norm
from jaxhb.train.drivetrain import DriveTrain

# The half peak-to-peak of a signal, or what stands for it
Swing = Callable[[Signal], Array]
CLOSE = 1024  # p of norms that limits read
# Least number of time samples of the cycle at which contact is looked at
TIME_SAMPLES = 4096


def valid(response: Response) -> Array:
    """Whether the equations of each speed are solved ``(...)``, the truncation error
    aside.
    """
    return jnp.asarray(response.solved)


def usable(response: Any) -> Any:
    """The response with zeros at speeds that failed: masked before it is read, so that
    nan goes nowhere; anything but a Response, as a steady state whose motion is known,
    as it is.
    """
    return with_zeros(response) if isinstance(response, Response) else response


def tooth_force(
    response: Response, a: str, b: str | None = None, *, p: float = 64
) -> Array:
    """Smooth half peak-to-peak of a tooth force, N; see :func:`half_peak_to_peak`."""
    return half_peak_to_peak(usable(response).force(a, b), p=p)


def shaft_torque(
    response: Response, a: str, b: str | None = None, *, p: float = 64
) -> Array:
    """Smooth half peak-to-peak of the torque of a shaft or damper, N m; see
    :func:`half_peak_to_peak`.
    """
    return half_peak_to_peak(usable(response).torque(a, b), p=p)


def half_peak_to_peak(signal: Signal, *, p: float = 64) -> Array:
    """Smooth half peak-to-peak of a signal, from p-norms of its parts above and below
    the mean.

        (||max(s - mean, 0)||_p + ||max(mean - s, 0)||_p) / 2,
        ||v||_p = (mean over the cycle |v|^p)^(1/p)

    In the unit of the signal ``(...)``. At M = ``signal.resolution`` time samples it
    lies between M^(-1/p) times the true value and the true value (p = 64, M = 4096:
    0.88 to 1).

    >>> torque = jaxhb.Signal(
    ...     jnp.array([3.0, 5.0, 0.0]) + 0j, None, 2.0, 64
    ... )  # 3 + 10 cos(theta / 2)
    >>> round(float(half_peak_to_peak(torque, p=256)), 1)
    9.9
    """
    values = signal.samples(signal.resolution) - signal.mean[..., None]
    return (
        p_norm(jnp.maximum(values, 0.0), p) + p_norm(jnp.maximum(-values, 0.0), p)
    ) / 2


def sharp_half_peak_to_peak(signal: Signal) -> Array:
    """Half peak-to-peak between the time samples: the vertices of parabolas through the
    largest and the smallest value and their neighbours, ``(...)``; its derivative is
    that of the maximum, not of the nearest sample.
    """
    values = signal.samples(signal.resolution)
    return (_vertex(values) + _vertex(-values)) / 2


def _vertex(values: Array) -> Array:
    """The height ``(...)`` of the parabola through the largest of values over the cycle
    ``(..., M)`` and its neighbours.
    """
    place = jnp.argmax(values, axis=-1)[..., None]
    left, top, right = (
        jnp.take_along_axis(values, (place + step) % values.shape[-1], axis=-1)[..., 0]
        for step in (-1, 0, 1)
    )
    bend = left + right - 2 * top  # at most 0, and 0 of a constant alone
    return top - (right - left) ** 2 / (8 * jnp.where(bend < 0, bend, -1.0))


def damper_power(response: Response, a: str, b: str | None = None) -> Array:
    """Mean power that a damper or shaft turns into heat, W ``(...)``; see
    :meth:`jaxhb.Response.power`.
    """
    return Response.power(usable(response), a, b)


def close_half_peak_to_peak(signal: Signal) -> Array:
    """:func:`half_peak_to_peak` with p = 1024, for limits: at 4096 time samples at most
    0.8 % below the true value.
    """
    return half_peak_to_peak(signal, p=CLOSE)


def power_over_limit(
    response: Response, name: str, *, train: DriveTrain | None = None
) -> Array:
    """:func:`damper_power` of a shaft or damper over its ``power_limit``; arguments as
    of :func:`stress_over_limit`.
    """
    return damper_power(response, name) / strength.LIMITS["heat"].of(
        strength.train_of(response, train), name
    )


def stress(
    response: Response,
    name: str,
    *,
    train: DriveTrain | None = None,
    swing: Swing = close_half_peak_to_peak,
) -> Array:
    """Amplitude of the nominal torsional stress of a shaft, Pa; see
    :func:`stress_over_limit`.
    """
    return strength.stress_of(
        strength.train_of(response, train), name, swing(usable(response).torque(name))
    )


def stress_over_limit(
    response: Response,
    name: str,
    *,
    transient: bool = False,
    train: DriveTrain | None = None,
    swing: Swing = close_half_peak_to_peak,
) -> Array:
    """Stress of a shaft over its limit after IACS UR M68 at the speed of the response,
    ``T / W_p / tau``.

    See :func:`jaxhb.permissible_stress`; an aid to evaluation, no approval by a class.

    Of a shaft ``name`` with a ``tensile_strength``; ``transient``: the limit of passing
    through, instead of continuous running; ``swing``: the half peak-to-peak of a
    Signal, by default smooth and at most 0.8 % too small. ``(...)``, 0 above 1.05 of
    the rated speed, where there is no limit.

    >>> parts = [jaxhb.Disk(name=name, inertia=2.0) for name in "ab"]
    >>> parts += [jaxhb.Torque(disk="a", harmonics=[(1.0, 10.0, 0.0)])]
    >>> form = {"diameter": 0.01, "stress_concentration": 1.0, "tensile_strength": 6e8}
    >>> parts += [jaxhb.Shaft(between=("a", "b"), stiffness=100.0, **form)]
    >>> train = jaxhb.build(parts, revolutions_per_cycle=1, rated_rpm=50.0)
    >>> r = jaxhb.linear_response(train, rpm=25.0)
    >>> round(
    ...     float(
    ...         stress_over_limit(
    ...             r, "a|b", swing=lambda signal: signal.half_peak_to_peak
    ...         )
    ...     ),
    ...     4,
    ... )
    0.2765
    """
    train = strength.train_of(response, train)
    limit = strength.stress_limits(train, name, response.rpm)[int(transient)]
    return stress(response, name, train=train, swing=swing) / limit


def tooth_torque_over_limit(
    response: Response,
    name: str,
    *,
    train: DriveTrain | None = None,
    swing: Swing = close_half_peak_to_peak,
) -> Array:
    """Vibratory torque of a mesh over a third of its ``rated_torque``; arguments as of
    :func:`stress_over_limit`.
    """
    radius, limit = strength.rated_gear(strength.train_of(response, train), name)
    return radius * swing(usable(response).force(name)) / limit


def tooth_torque_over_mean(
    response: Response, name: str, *, swing: Swing = close_half_peak_to_peak
) -> Array:
    """Vibratory torque of a mesh over its mean: above about 1 it reverses; 0 where
    there is no mean torque.
    """
    force = usable(response).force(name)
    mean = jnp.abs(force.mean)
    return jnp.where(mean > 0, swing(force) / jnp.where(mean > 0, mean, 1.0), 0.0)


def separated_fraction(
    response: Response, a: str, b: str | None = None, *, smoothing: float = 0.02
) -> Array:
    """Share of the cycle in which the teeth are apart, smoothed.

    The mean over the cycle of ``1 / (1 + exp((|l| - g) / w))`` with g the gap of the
    law and w = ``smoothing`` x backlash; the share with ``|l| < g`` as w goes to zero.

    :class:`SceneError` if the mesh has no backlash.
    """
    distance, _, gap, width = _motion(response, a, b, smoothing)
    return jnp.where(
        valid(response), jax.nn.sigmoid((gap - distance) / width).mean(axis=-1), 0.0
    )


def impact_severity(
    response: Response, a: str, b: str | None = None, *, smoothing: float = 0.02
) -> Array:
    """Sum of the approach speeds of all impacts of a cycle, smoothed, m/s; errors as of
    :func:`separated_fraction`.

    With the speed ``v = d|l|/dt`` and g as in :func:`separated_fraction`, the sum over
    the time samples at which ``|l|`` rises through g is the integral over the cycle of
    ``delta(|l| - g) max(v, 0)^2 dt``; the delta function is a logistic bell of width
    ``smoothing`` x backlash, which must be passed in several of the time samples of the
    cycle.
    """
    distance, speed, gap, width = _motion(response, a, b, smoothing)
    inside = jax.nn.sigmoid((distance - gap) / width)
    bell = inside * (1 - inside) / width
    period = 2 * jnp.pi / response.topology.cycle_frequency(jnp.asarray(response.rpm))
    return jnp.where(
        valid(response),
        period * (bell * jnp.maximum(speed, 0.0) ** 2).mean(axis=-1),
        0.0,
    )


def _motion(
    response: Response, a: str, b: str | None, smoothing: float
) -> tuple[Array, Array, Array, Array]:
    """Read ``|l|`` in m and ``d|l|/dt`` in m/s ``(..., time_steps)``, the gap and the
    width of its smooth edge in m ``(..., 1)``.
    """
    topology = response.topology
    signal = usable(response).deflection(a, b)
    index = topology.link_index(a, b)[0] - response.torques.shape[-2]
    if not topology.mesh_backlash[index]:
        raise SceneError(
            f"{topology.title}: mesh {topology.mesh_names[index]!r} has no backlash,"
            " its teeth never part: give it a backlash, or take another objective."
        )
    law = jax.tree.map(
        lambda parameter: jnp.asarray(parameter)[..., index, None], response.law
    )
    frequency = topology.cycle_frequency(jnp.asarray(response.rpm))[..., None]
    moving = dataclasses.replace(
        signal, coefficients=fourier.derivative(signal.coefficients, frequency)
    )
    count = max(TIME_SAMPLES, signal.resolution)
    values = signal.samples(count)
    return (
        jnp.abs(values),
        jnp.sign(values) * moving.samples(count),
        law.gap,
        smoothing * law.backlash,
    )


def weighted_sum(
    values: Array, response: Response, *, weights: Number = 1.0
) -> tuple[Array, Array]:
    """Sum over the valid speeds of weight x value, of values and weights ``(n,)`` of
    their speeds, and their number.
    """
    mask = valid(response)
    return masked_sum(weights * jnp.where(mask, values, 0.0), mask), mask.sum()


def masked_sum(values: Array, mask: Array) -> Array:
    """Sum of the values where the ``mask`` is true, whatever the others are."""
    return jnp.sum(jnp.where(mask, values, 0.0))


def worst(values: Array, response: Response, *, width: Number) -> tuple[Array, Array]:
    """Smooth maximum over the valid speeds of their values ``(n,)``, and their number;
    0 where no speed is valid.

    ``width log(sum exp(value / width))``, between the true maximum and ``width log(n)``
    above it.
    """
    mask = valid(response)
    return smooth_maximum(values, mask, width), mask.sum()


def smooth_maximum(values: Array, mask: Array, width: Number) -> Array:
    """``width log(sum exp(value / width))`` over the values ``(n,)`` where the ``mask``
    is true; 0 of none.
    """
    some = mask.any()
    # Without a valid speed all are -inf, and their gradient nan: finite values stand in
    # for them.
    scaled = jnp.where(mask | ~some, values / width, -jnp.inf)
    scaled = jnp.where(some, scaled, 0.0)
    return jnp.where(some, width * jax.nn.logsumexp(scaled), 0.0)
