"""A periodic signal as the engineer reads it: mean, extremes, orders, samples."""

import dataclasses
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import Array, concrete, namespace, refuse_tracers, traced
from jaxhb._shown import number
from jaxhb.equations import fourier

SAME_HZ = 1e-9  # share by which frequencies of one line differ
MISSED = 0.01  # share of the peak by which samples may miss it without a warning


class Summarized:
    """Statistics that follow from the extremes and amplitudes of a signal, whether it
    repeats or was recorded.
    """

    @property
    def orders(self: Any) -> np.ndarray:
        """Orders of the amplitudes, per revolution of the reference rotor ``(K,)``."""
        return np.arange(1, self.amplitudes.shape[-1] + 1) / self.revolutions_per_cycle

    @property
    def sum_of_amplitudes(self: Any) -> Any:
        """Sum of the A_k, often shown by published torque curves of crankshafts; never
        below half peak-to-peak.
        """
        return self.amplitudes.sum(axis=-1)

    def summary(self: Any) -> dict[str, Any]:
        """Plain numbers for programs: mean, min, max, rms, half_peak_to_peak,
        sum_of_amplitudes, amplitudes.
        """
        refuse_tracers(
            "summary",
            self,
            instead="read .max, .min, .mean, .rms and .amplitudes there",
            host=True,
        )
        numbers = {
            "rms": float(self.rms),
            "sum_of_amplitudes": float(self.sum_of_amplitudes),
        }
        return self.extremes() | numbers | {"amplitudes": self.spectrum()}

    def extremes(self: Any) -> dict[str, float]:
        """Plain numbers for programs: mean, min, max and half_peak_to_peak."""
        refuse_tracers(
            "extremes", self, instead="read .max, .min and .mean there", host=True
        )
        low = float(self.min)
        high = float(self.max)
        return {
            "mean": float(self.mean),
            "min": low,
            "max": high,
            "half_peak_to_peak": (high - low) / 2,
        }


@jax.tree_util.register_dataclass
@by_value
@dataclass(frozen=True)
class Lines:
    """Parts of a signal at fixed frequencies, beside its orders.

    Parameters
    ----------
    hz : ``(..., L)`` Hz
    coefficients : complex ``(..., L)``
        Two-sided like those of orders; 0 where another line has the same frequency,
        which then has the sum.
    elastic_coefficients : complex ``(..., L)`` or None
        Elastic part of a transmitted force or torque.
    """

    hz: Array
    coefficients: Array
    elastic_coefficients: Array | None = None

    @property
    def amplitudes(self) -> Array:
        """One-sided peak amplitudes ``(..., L)``."""
        return 2 * _absolute(self.coefficients)

    @property
    def phases_deg(self) -> Array:
        """Phases of the cosines in deg ``(..., L)``, at 0 s."""
        return _phases_deg(self.coefficients)

    @property
    def listed_hz(self) -> list[float]:
        """Distinct frequencies in Hz, rising."""
        return np.unique(np.asarray(self.hz)).tolist()


@jax.tree_util.register_dataclass
@by_value
@dataclass(frozen=True)
class Signal(Summarized):
    """A periodic quantity, or a batch of them.

    The signal is ``mean + sum_k A_k cos(order_k theta + phase_k)``, theta the angle of
    the reference rotor, zero at firing top dead centre of a cylinder with firing angle
    0.

    Torques with lines at fixed frequencies add ``sum_l A_l cos(2 pi hz_l t +
    phase_l)``, and the signal then has no period. Its extremes are those of the orders
    beyond which all lines go at once: no time exceeds them, and where the frequencies
    have no common period some come as near to them as one likes. The rms takes lines
    and orders as independent.

    Parameters
    ----------
    coefficients : complex ``(..., K+1)``
        Two-sided, x^0 .. x^K, in the unit of the quantity.
    elastic_coefficients : complex ``(..., K+1)`` or None
        Elastic part (stiffness only) of a transmitted force or torque.
    revolutions_per_cycle : float
        Of the reference rotor; harmonic n is order n / revolutions_per_cycle.
    resolution : int
        Time samples per cycle at which extremes are looked for.
    sharp : bool
        Whether the contact of teeth was an unknown of the solve, as where they hammer:
        extremes may then be narrow peaks, and their derivatives, of one time sample,
        come with a warning.
    lines : Lines or None
        Parts at fixed frequencies, of a forced response alone.

    Examples
    --------
    The signal 3 + 10 cos(theta / 2):

    >>> torque = Signal(np.array([[3.0, 5.0, 0.0]]) + 0j, None, 2.0, 64)
    >>> float(torque.max[0]), float(torque.half_peak_to_peak[0]), torque.orders.tolist()
    (13.0, 10.0, [0.5, 1.0])
    """

    coefficients: Array
    elastic_coefficients: Array | None
    revolutions_per_cycle: float = field(metadata={"static": True})
    resolution: int = field(metadata={"static": True})
    sharp: bool = field(default=False, metadata={"static": True})
    lines: Lines | None = None

    def __repr__(self) -> str:
        kind = type(self).__name__
        orders = self.coefficients.shape[-1] - 1
        if traced(self):
            return f"<{kind}, traced, {orders} harmonics>"
        if np.ndim(self.coefficients) > 1:
            batch = " x ".join(map(str, self.coefficients.shape[:-1]))
            low = float(np.min(self.min))
            high = float(np.max(self.max))
            return (
                f"<{kind} of {batch} motions, {orders} harmonics: {number(low)} to"
                f" {number(high)}>"
            )
        mean, smallest, largest = (
            number(float(value)) for value in (self.mean, self.min, self.max)
        )
        return (
            f"<{kind}, {orders} harmonics: mean {mean}, min {smallest}, max {largest}>"
        )

    @property
    def elastic(self) -> Self:
        """The elastic part alone, a signal of the same kind."""
        if self.elastic_coefficients is None:
            raise AttributeError(
                "this signal is not a force or torque: it has no elastic part"
            )
        lines = self.lines
        if lines is not None and lines.elastic_coefficients is not None:
            lines = Lines(lines.hz, lines.elastic_coefficients)
        return dataclasses.replace(
            self,
            coefficients=self.elastic_coefficients,
            elastic_coefficients=None,
            lines=lines,
        )

    def reversed(self) -> Self:
        """The quantity with the other sign."""
        part = None if self.elastic_coefficients is None else -self.elastic_coefficients
        lines = self.lines
        if lines is not None:
            elastic = lines.elastic_coefficients
            elastic = None if elastic is None else -elastic
            lines = Lines(lines.hz, -lines.coefficients, elastic)
        return dataclasses.replace(
            self,
            coefficients=-self.coefficients,
            elastic_coefficients=part,
            lines=lines,
        )

    @property
    def amplitudes(self) -> Array:
        """One-sided peak amplitudes A_k ``(..., K)``: a cosine of 10 N m reads 10."""
        return 2 * _absolute(self.coefficients[..., 1:])

    @property
    def phases_deg(self) -> Array:
        """Phases of the cosines in deg ``(..., K)``."""
        return _phases_deg(self.coefficients[..., 1:])

    def order(self, order: float) -> Array:
        """Amplitude of one order."""
        harmonic = round(order * self.revolutions_per_cycle)
        if (
            abs(harmonic - order * self.revolutions_per_cycle) > 1e-9
            or not harmonic > 0
        ):
            raise ValueError(
                f"order {order:g} is no harmonic of a cycle of"
                f" {self.revolutions_per_cycle:g} revolutions: use a positive multiple"
                f" of {1 / self.revolutions_per_cycle:g}"
            )
        # A signal holds all that it has: a harmonic beyond is 0, not unknown; but nan
        # of a signal that is nan.
        if harmonic >= self.coefficients.shape[-1]:
            return 0 * self.rms
        return self.amplitudes[..., harmonic - 1]

    def line(self, hz: float) -> Array:
        """Amplitude of the line at a fixed frequency; ValueError where no torque has
        one there.
        """
        listed = []
        if self.lines is not None:
            (frequencies,) = concrete(self.lines.hz)
            refuse_tracers(
                "line", frequencies, instead="read .lines.amplitudes there", host=True
            )
            here = np.abs(np.asarray(frequencies) - hz) <= SAME_HZ * hz
            if here.any():
                return (np.where(here, 1.0, 0.0) * self.lines.amplitudes).sum(axis=-1)
            listed = np.unique(frequencies).tolist()
        frequencies_text = ", ".join(f"{each:.12g}" for each in listed) or "none"
        raise ValueError(
            f"there is no line at {hz:g} Hz; lines in Hz: {frequencies_text}"
        )

    def by_line(self) -> dict[float, Array]:
        """Amplitude ``(...)`` of every line by its frequency in Hz, rising; of numbers
        that are concrete.
        """
        if self.lines is None:
            return {}
        return {hz: self.line(hz) for hz in self.lines.listed_hz}

    def summary(self) -> dict[str, Any]:
        """Plain numbers for programs: mean, min, max, rms, half_peak_to_peak,
        sum_of_amplitudes, amplitudes, and the amplitudes of ``lines`` where there are
        any.
        """
        lines = [[hz, float(amplitude)] for hz, amplitude in self.by_line().items()]
        return super().summary() | ({"lines": lines} if lines else {})

    @property
    def sum_of_lines(self) -> Array:
        """Sum of the amplitudes of all lines at fixed frequencies, 0 without any."""
        if self.lines is None:
            return 0 * self.coefficients[..., 0].real
        return self.lines.amplitudes.sum(axis=-1)

    @property
    def sum_of_amplitudes(self) -> Array:
        """Sum of the amplitudes of all orders and lines, often shown by published
        torque curves of crankshafts; never below half peak-to-peak.
        """
        return self.amplitudes.sum(axis=-1) + self.sum_of_lines

    def samples(self, count: int) -> Array:
        """Values at ``count`` equidistant time samples of one cycle, from theta = 0;
        shape ``(..., count)``.

        Warns where the samples miss the peak by more than 1 % of it, and names a count
        that is enough. ValueError of a signal with lines at fixed frequencies.
        """
        if self.lines is not None:
            raise ValueError(
                "the signal has lines at fixed frequencies, so no cycle is like the"
                " next: read its extremes and amplitudes, or march it with"
                " jaxhb.transient"
            )
        values = self._sampled(count)
        if count >= self.resolution or traced(values):
            return values
        peak = np.asarray(self.peak)

        def missed(values: Array) -> np.floating:
            """Largest share of the peak by which samples miss it."""
            lost = peak - np.abs(np.asarray(values)).max(axis=-1)
            return np.max(
                np.where(peak > 0, lost / np.where(peak > 0, peak, 1.0), 0.0),
                initial=0.0,
            )

        if missed(values) > MISSED:
            more = (count << doublings for doublings in range(1, 32))
            enough = next(
                larger
                for larger in more
                if larger >= self.resolution or missed(self._sampled(larger)) <= MISSED
            )
            warnings.warn(
                f"{count} samples miss the peak of the signal by"
                f" {100 * missed(values):.2g} %: take {enough}, or read .max, .min and"
                " .half_peak_to_peak, which have the whole signal",
                stacklevel=2,
            )
        return values

    def _sampled(self, count: int) -> Array:
        """Values ``(..., count)`` at equidistant time samples of one cycle."""
        return fourier.sample(self.coefficients, count)

    @cached_property
    def _samples(self) -> Array:
        """Samples of a signal on the host that its extremes are read from. Others are
        not kept: a tracer would outlive its program.
        """
        return self._sampled(self.resolution)

    def angles_deg(self, count: int) -> np.ndarray:
        """Angles theta of :meth:`samples` in deg of the reference rotor
        ``(count,)``.
        """
        return np.arange(count) * (360.0 * self.revolutions_per_cycle / count)

    @property
    def mean(self) -> Array:
        """Mean over the cycle."""
        return self.coefficients[..., 0].real

    @property
    def max(self) -> Array:
        """Largest value over the cycle; its derivative is of one time sample, and warns
        where teeth may hammer.
        """
        largest = self._over("max", lambda values: values.max(axis=-1))
        return largest + self.sum_of_lines

    @property
    def min(self) -> Array:
        """Smallest value over the cycle; derivatives as of :attr:`max`."""
        smallest = self._over("min", lambda values: values.min(axis=-1))
        return smallest - self.sum_of_lines

    @property
    def peak(self) -> Array:
        """Largest absolute value over the cycle; derivatives as of :attr:`max`."""
        largest = self._over(
            "peak", lambda values: namespace(values).abs(values).max(axis=-1)
        )
        return largest + self.sum_of_lines

    @property
    def half_peak_to_peak(self) -> Array:
        """(max - min) / 2 of the synthesised signal; derivatives as of :attr:`max`."""
        of_orders = self._over(
            "half_peak_to_peak",
            lambda values: (values.max(axis=-1) - values.min(axis=-1)) / 2,
        )
        return of_orders + self.sum_of_lines

    def _over(self, name: str, function: Callable[[Array], Array]) -> Array:
        """Extreme ``name`` over the cycle: a ``function`` of the samples."""
        on_host = isinstance(self.coefficients, np.ndarray)
        values = self._samples if on_host else self._sampled(self.resolution)
        if self.sharp and traced(values):
            values = _warned_of_when_differentiated(name, values)
        # 0, or nan of a signal that is nan: jax 0.12 gives -inf on a processor for the
        # largest of many nan.
        return function(values) + 0 * values[..., 0]

    @property
    def rms(self) -> Array:
        """Root mean square over the cycle, mean included."""
        power = self.coefficients.real**2 + self.coefficients.imag**2
        # Parseval: each coefficient n > 0 stands for -n too.
        square = power[..., 0] + 2 * power[..., 1:].sum(axis=-1)
        if self.lines is not None:
            lines = self.lines.coefficients
            square = square + 2 * (lines.real**2 + lines.imag**2).sum(axis=-1)
        return _power(square, 0.5)

    def smooth_peak(self, p: float = 64) -> Array:
        """Differentiable peak, the p-norm over the cycle, ``(mean |x|^p)^(1/p)``: with
        M time samples between ``peak M^(-1/p)`` and ``peak``. Where teeth hammer
        differentiate this: :attr:`max` and the like are differentiated at one time
        sample, whose slope truncation spoils, and warn.
        """
        values = self._sampled(self.resolution)
        return p_norm(namespace(values).abs(values), p) + self.sum_of_lines

    def spectrum(self) -> list[list[float]]:
        """``[[order, A, phase_deg], ...]`` of one signal."""
        refuse_tracers(
            "spectrum",
            self,
            instead="read .orders, .amplitudes and .phases_deg there",
            host=True,
        )
        columns = (
            self.orders,
            np.asarray(self.amplitudes),
            np.asarray(self.phases_deg),
        )
        return [[float(number) for number in row] for row in zip(*columns, strict=True)]


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _warned_of_when_differentiated(name: str, values: Array) -> Array:
    """Return the samples from which the extreme ``name`` is taken: their derivative
    alone comes with a warning.
    """
    return values


@_warned_of_when_differentiated.defjvp
def _with_warning(
    name: str, primals: tuple[Array], tangents: tuple[Array]
) -> tuple[Array, Array]:
    (values,) = primals
    (changes,) = tangents
    warnings.warn(
        f".{name} is differentiated at one time sample, and where teeth hammer such a"
        " derivative may have the wrong sign: differentiate .smooth_peak() or"
        " jaxhb.design.objectives.half_peak_to_peak(signal)",
        stacklevel=2,
    )
    return values, changes


def p_norm(values: Array, p: float) -> Array:
    """``(mean |v|^p)^(1/p)`` over the last axis of values >= 0."""
    xp = namespace(values)
    scale = values.max(axis=-1)
    # The scale keeps powers in range and cancels: it needs no derivative.
    scale = jax.lax.stop_gradient(scale) if xp is jnp else scale
    scale = xp.where(scale > 0, scale, 1.0)
    return scale * _power(((values / scale[..., None]) ** p).mean(axis=-1), 1 / p)


def _power(values: Array, exponent: float) -> Array:
    """Power below 1 of values >= 0, with a zero derivative at 0; nan of nan."""
    xp = namespace(values)
    return xp.where(values == 0, 0.0, xp.where(values == 0, 1.0, values) ** exponent)


def _phases_deg(values: Array) -> Array:
    """Phases in deg; the angle of 0, which has no derivative, is 0."""
    xp = namespace(values)
    return xp.angle(xp.where(values == 0, 1.0, values)) * (180 / np.pi)


def _absolute(values: Array) -> Array:
    """|z| with a zero derivative at 0 (half orders that nothing excites are exactly
    zero).
    """
    return (
        np.abs(values)
        if namespace(values) is np
        else _power(values.real**2 + values.imag**2, 0.5)
    )
