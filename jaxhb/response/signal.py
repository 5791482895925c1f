"""A periodic signal as the engineer reads it: mean, extremes, orders, samples."""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import namespace
from ..harmonic import fourier


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Signal:
    """A periodic quantity, or a batch of them.

    The signal is ``mean + sum_k A_k cos(order_k theta + phase_k)``, theta the angle of the reference rotor, zero at
    firing top dead centre of a cylinder with firing angle 0.

    Parameters
    ----------
    coefficients : complex array ``(..., K+1)``
        Two-sided Fourier coefficients x^0 .. x^K in the unit of the quantity.
    elastic_coefficients : complex array or None
        The elastic part (stiffness only) of a transmitted force or torque.
    revolutions_per_cycle : float
        Of the reference rotor; harmonic n is order n / revolutions_per_cycle.
    resolution : int
        Time samples per cycle at which extremes are looked for.

    Examples
    --------
    >>> torque = Signal(np.array([[3.0, 5.0, 0.0]]) + 0j, None, 2.0, 64)      # 3 + 10 cos(theta / 2)
    >>> float(torque.max[0]), float(torque.half_peak_to_peak[0]), torque.orders.tolist()
    (13.0, 10.0, [0.5, 1.0])
    """

    coefficients: jax.Array
    elastic_coefficients: jax.Array | None
    revolutions_per_cycle: float = field(metadata={"static": True})
    resolution: int = field(metadata={"static": True})

    @property
    def elastic(self):
        """The elastic part alone, a :class:`Signal`."""
        if self.elastic_coefficients is None:
            raise AttributeError("this signal is not a force or torque: it has no elastic part")
        return Signal(self.elastic_coefficients, None, self.revolutions_per_cycle, self.resolution)

    @property
    def orders(self):
        """Orders of the amplitudes, per revolution of the reference rotor ``(K,)``."""
        return np.arange(1, self.coefficients.shape[-1]) / self.revolutions_per_cycle

    @property
    def amplitudes(self):
        """One-sided peak amplitudes A_k ``(..., K)``: a cosine of 10 N m reads 10."""
        return 2 * _absolute(self.coefficients[..., 1:])

    @property
    def phases_deg(self):
        """Phases of the cosines in deg ``(..., K)``."""
        xp, tail = namespace(self.coefficients), self.coefficients[..., 1:]
        return xp.angle(xp.where(tail == 0, 1.0, tail)) * (180 / np.pi)

    def order(self, order):
        """Amplitude of one order."""
        harmonic = round(order * self.revolutions_per_cycle)
        if abs(harmonic - order * self.revolutions_per_cycle) > 1e-9 or not harmonic > 0:
            raise ValueError(
                f"order {order:g} is no harmonic of a cycle of {self.revolutions_per_cycle:g} revolutions: "
                f"use a positive multiple of {1 / self.revolutions_per_cycle:g}"
            )
        if harmonic >= self.coefficients.shape[-1]:
            return namespace(self.coefficients).zeros(self.coefficients.shape[:-1])
        return self.amplitudes[..., harmonic - 1]

    def samples(self, count):
        """Values at ``count`` equidistant time samples of one cycle, from theta = 0; shape ``(..., count)``."""
        return fourier.sample(self.coefficients, count)

    def angles_deg(self, count):
        """Angles theta of :meth:`samples` in deg of the reference rotor ``(count,)``."""
        return np.arange(count) * (360.0 * self.revolutions_per_cycle / count)

    @property
    def mean(self):
        """Mean over the cycle."""
        return self.coefficients[..., 0].real

    @property
    def max(self):
        """Largest value over the cycle."""
        return self.samples(self.resolution).max(axis=-1)

    @property
    def min(self):
        """Smallest value over the cycle."""
        return self.samples(self.resolution).min(axis=-1)

    @property
    def peak(self):
        """Largest absolute value over the cycle."""
        return namespace(self.coefficients).abs(self.samples(self.resolution)).max(axis=-1)

    @property
    def half_peak_to_peak(self):
        """(max - min) / 2 of the synthesised signal."""
        values = self.samples(self.resolution)
        return (values.max(axis=-1) - values.min(axis=-1)) / 2

    @property
    def sum_of_amplitudes(self):
        """Sum of the A_k: what published torque curves of crankshafts often show; never below half peak-to-peak."""
        return self.amplitudes.sum(axis=-1)

    @property
    def rms(self):
        """Root mean square over the cycle, mean included."""
        power = self.coefficients.real**2 + self.coefficients.imag**2
        return _power(power[..., 0] + 2 * power[..., 1:].sum(axis=-1), 0.5)

    def smooth_peak(self, p=64):
        """Differentiable peak, the p-norm over the cycle: ``(mean |x|^p)^(1/p)``.

        With M time samples it lies between ``peak M^(-1/p)`` and ``peak``.
        """
        xp = namespace(self.coefficients)
        values = xp.abs(self.samples(self.resolution))
        scale = values.max(axis=-1)
        scale = jax.lax.stop_gradient(scale) if xp is jnp else scale
        scale = xp.where(scale > 0, scale, 1.0)
        return scale * _power(((values / scale[..., None]) ** p).mean(axis=-1), 1 / p)

    def summary(self):
        """Plain numbers for programs: mean, min, max, rms, half_peak_to_peak, sum_of_amplitudes, amplitudes."""
        return self.extremes() | {
            "rms": float(self.rms),
            "sum_of_amplitudes": float(self.sum_of_amplitudes),
            "amplitudes": self.spectrum(),
        }

    def extremes(self):
        """Plain numbers for programs: mean, min, max and half_peak_to_peak."""
        values = self.samples(self.resolution)
        low, high = float(values.min()), float(values.max())
        return {"mean": float(self.mean), "min": low, "max": high, "half_peak_to_peak": (high - low) / 2}

    def spectrum(self):
        """``[[order, A, phase_deg], ...]`` of one signal."""
        columns = (self.orders, np.asarray(self.amplitudes), np.asarray(self.phases_deg))
        return [[float(v) for v in row] for row in zip(*columns, strict=True)]


def _power(values, exponent):
    """A power below 1 of values >= 0, with a zero derivative at 0."""
    xp = namespace(values)
    return xp.where(values > 0, xp.where(values > 0, values, 1.0) ** exponent, 0.0)


def _absolute(values):
    """|z| with a zero derivative at 0 (half orders that nothing excites are exactly zero)."""
    return np.abs(values) if namespace(values) is np else _power(values.real**2 + values.imag**2, 0.5)
