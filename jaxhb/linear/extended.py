"""Complex numbers of twice the precision of float64, and beyond its range.

A characteristic polynomial is a small difference of large products: double precision leaves it digits in proportion to
the distance to the nearest root. :class:`Doubled` has some 24 digits: sums keep what they round off (D. E. Knuth, The
Art of Computer Programming 2, 4.2.2), products are made of halves whose products are exact (T. J. Dekker, Numer. Math.
18 (1971) 224): a compiler that joins a product and a sum in one instruction changes nothing.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

HALF = 25
"""Stored digits of the leading half of a number, the hidden one not counted: products of halves are exact."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Doubled:
    """Complex numbers ``high + low``, high rounded from the sum; with +, -, * and indices as arrays have them."""

    high: jax.Array
    low: jax.Array

    def __add__(self, other):
        return _total(self, doubled(other))

    def __neg__(self):
        return Doubled(-self.high, -self.low)

    def __sub__(self, other):
        return self + -doubled(other)

    def __mul__(self, other):
        return _product(self, doubled(other))

    def __getitem__(self, at):
        return Doubled(self.high[at], self.low[at])

    def scaled(self, real):
        """Times a real number, rounded as float64 unless it is a power of two."""
        return Doubled(self.high * real, self.low * real)

    def put(self, at, value):
        """With ``value`` at an index."""
        value = doubled(value)
        return Doubled(self.high.at[at].set(value.high), self.low.at[at].set(value.low))


def doubled(value):
    """A real or complex array as :class:`Doubled`, or what is one already."""
    if isinstance(value, Doubled):
        return value
    high = jnp.asarray(value).astype(complex)
    return Doubled(high, jnp.zeros_like(high))


@jax.custom_jvp
def _total(a, b):
    total, lost = _sum(a.high, b.high)
    return _joined(total, lost + (a.low + b.low))


@jax.custom_jvp
def _product(a, b):
    a1, b1 = _leading(a.high), _leading(b.high)
    a2, b2 = a.high - a1, b.high - b1
    # Four exact products: a complex product would round their sums.
    total, lost = _sum(
        lax.complex(a1.real * b1.real, a1.real * b1.imag), lax.complex(-a1.imag * b1.imag, a1.imag * b1.real)
    )
    total, more = _sum(total, a1 * b2 + a2 * b1)
    return _joined(total, (lost + more) + (a2 * b2 + (a.high * b.low + a.low * b.high)))


# derivatives are as exact as float64: beside a root the value is a small difference, its derivative is none


@_total.defjvp
def _total_jvp(primals, tangents):
    return _total(*primals), doubled(tangents[0].high + tangents[1].high)


@_product.defjvp
def _product_jvp(primals, tangents):
    (a, b), (da, db) = primals, tangents
    return _product(a, b), doubled(a.high * db.high + da.high * b.high)


def _sum(a, b):
    """Rounded sum and what was rounded off."""
    total = a + b
    shown = total - a
    return total, (a - (total - shown)) + (b - shown)


def _joined(high, low):
    """The sum of a number and one much smaller."""
    total = high + low
    # Without the barrier compilers compute every number again wherever it is used, product within product.
    return Doubled(*lax.optimization_barrier((total, low - (total - high))))


def _leading(a):
    """The leading half of the digits of real and imaginary part."""
    # The 11 bits of the exponent are those of float64: only digits go.
    return lax.complex(*(lax.reduce_precision(part, 11, HALF) for part in (a.real, a.imag)))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Scaled:
    """Complex numbers ``mantissa 2^exponent`` beyond the range of float64; exponents are whole numbers as floats."""

    mantissa: jax.Array
    exponent: jax.Array

    @property
    def log_modulus(self):
        """Natural logarithm of the modulus."""
        return jnp.log(jnp.abs(self.mantissa)) + self.exponent * np.log(2.0)

    @property
    def phase(self):
        """Phase in rad, -pi to pi."""
        return jnp.angle(self.mantissa)

    def value(self):
        """The complex numbers; infinite or zero where they leave the range."""
        # In two factors: 2^exponent may overflow where the number itself does not.
        half = jnp.clip(self.exponent // 2, -1100, 1100).astype(int)
        rest = jnp.clip(self.exponent - half, -1100, 1100).astype(int)
        return self.mantissa * jnp.ldexp(1.0, half) * jnp.ldexp(1.0, rest)

    def __truediv__(self, other):
        return rescaled(self.mantissa / other.mantissa, self.exponent - other.exponent)

    def __mul__(self, factor):
        return Scaled(self.mantissa * factor, self.exponent)

    def __add__(self, other):
        exponent = jnp.maximum(self.exponent, other.exponent)
        powers = (jnp.ldexp(1.0, jnp.maximum(z.exponent - exponent, -2000).astype(int)) for z in (self, other))
        return rescaled(sum(z.mantissa * power for z, power in zip((self, other), powers, strict=True)), exponent)


def shifted(numbers):
    """Numbers with their largest modulus between 1/2 and 1, and the power of two taken out."""
    # Powers of two cancel between mantissa and exponent: they have no derivative.
    rough = [lax.stop_gradient(z.high if isinstance(z, Doubled) else z) for z in numbers]
    sizes = [jnp.maximum(jnp.abs(z.real), jnp.abs(z.imag)) for z in rough]
    shift = jnp.frexp(jnp.max(jnp.stack(sizes), axis=0))[1]
    factor = jnp.ldexp(1.0, -shift)
    return jax.tree.map(lambda z: z * factor, tuple(numbers)), shift.astype(float)


def rescaled(number, exponent):
    """``number 2^exponent`` as :class:`Scaled`."""
    (number,), shift = shifted((number,))
    return Scaled(number, exponent + shift)


def scaled_product(numbers):
    """Product of positive numbers ``(n,)`` as :class:`Scaled`, one after the other."""

    def extend(state, number):
        product, exponent = state
        (product,), shift = shifted((product * number,))
        return (product, exponent + shift), None

    (mantissa, exponent), _ = lax.scan(extend, (jnp.array(1.0), jnp.array(0.0)), numbers)
    return Scaled(mantissa, exponent)
