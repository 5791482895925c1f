"""Averages of mesh forces and of their slopes between neighbouring time samples.

Slopes of the backlash law have kinks, and where teeth hammer few time samples of a
cycle lie in its transition zones: from samples alone a derivative needs hundreds of
them a harmonic. Between two samples the deflection is nearly linear in time, and
averages over the law along a straight line are divided differences of integrals of the
law, exact whatever kinks lie between: with K the integral of a law k in l,

    average of k from l_1 to l_2  =  (K(l_2) - K(l_1)) / (l_2 - l_1).
"""

from __future__ import annotations

import dataclasses
from typing import Protocol

import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array
from jaxhb.equations import backlash, fourier

# Share of a transition zone below which the ends of a cell tell its average
SHORT = 1e-3


class Sampled(backlash.Teeth, Protocol):
    """The part of a CondensedEquation that averages need: its teeth, the frequency in
    rad/s, and l and l' at samples.
    """

    @property
    def frequency(self) -> Array: ...

    def sampled(self, deflection: Array, samples: int) -> tuple[Array, Array]: ...


def force_coefficients(equation: Sampled, deflection: Array, samples: int) -> Array:
    """Coefficients ``(G, N+1)`` of phi of an equation at those of l, from
    averages over ``samples`` cells.
    """
    force, _ = _averages(equation, deflection, samples)
    return _centred(force, deflection.shape[-1] - 1)


def slope_coefficients(
    equation: Sampled, deflection: Array, samples: int, harmonics: int
) -> Array:
    """Coefficients ``(2, G, harmonics+1)`` of the slopes of phi in l and l', in the
    same way.
    """
    _, slopes = _averages(equation, deflection, samples)
    return _centred(slopes, harmonics)


def _centred(averages: Array, harmonics: int) -> Array:
    """Coefficients of a function with these averages ``(..., M)`` over cells that begin
    at the time samples.
    """
    half = _half_angles(harmonics, averages.shape[-1])
    return fourier.analyze(averages, harmonics) * (
        np.exp(-1j * half) / np.sinc(half / np.pi)
    )


def _half_angles(harmonics: int, samples: int) -> np.ndarray:
    """Angles ``(harmonics+1,)`` rad by which each harmonic turns in half a cell."""
    return np.pi * np.arange(harmonics + 1) / samples


def _averages(
    equation: Sampled, deflection: Array, samples: int
) -> tuple[Array, Array]:
    """phi ``(G, M)`` and its slopes ``(2, G, M)`` in l and l', averages over M
    cells.
    """
    half = _half_angles(deflection.shape[-1] - 1, samples)
    # Ends of lines that have the same averages over the cells as the motion: chords
    # would lie on its inner side.
    ends = deflection * (np.sinc(half / np.pi) / np.cos(half))
    values, rates = equation.sampled(ends, samples)
    law, viscous, contact_damping = backlash.at_samples(
        equation, fourier.Equidistant(samples).synthesize
    )
    if equation.variation is not None:
        law = dataclasses.replace(law, stiffness=_mean(law.stiffness))
    width, inside, beyond = backlash.pieces(law, values)
    short = SHORT * law.width
    contact = _contact(values, width, inside, beyond)
    contact_integral = backlash.contact_integral(width, inside, beyond)
    energy = _divided(values, contact_integral, contact, short)
    engaged = inside / law.width
    share = _divided(values, contact, engaged, short) - 1
    in_contact = jnp.where(contact_damping, viscous, 0.0)
    drop = law.stiffness * (1 - law.epsilon)
    cell = 2 * jnp.pi / equation.frequency / samples
    # Damping that sets in with contact: r l' times the slope of the engagement is r
    # times its rate.
    setting_in = in_contact * (jnp.roll(engaged, -1, axis=-1) - engaged) / cell
    force = drop * (energy - _mean(values)) + in_contact * _mean(rates) * share
    by_deflection = drop * share + setting_in
    by_rate = in_contact * share
    if law.linear is not None:
        beside = law.stiffness - law.linear
        force = force + beside * _mean(values)
        by_deflection = by_deflection + beside
    if law.friction is not None:
        dry, dry_slope = _dry_friction(law, rates)
        force = force + dry
        by_rate = by_rate + dry_slope
    return force, jnp.stack([by_deflection, by_rate])


def _contact(deflection: Array, width: Array, inside: Array, beyond: Array) -> Array:
    """Elastic force in contact over the stiffness: the integral of the engagement, in
    m.
    """
    return jnp.sign(deflection) * (inside**2 / (2 * width) + beyond)


def _dry_friction(law: backlash.Law, rates: Array) -> tuple[Array, Array]:
    """Averages ``(G, M)`` of dry friction in N, and of its slope in l' in N s/m."""
    assert law.friction is not None and law.slip is not None
    relative = rates / law.slip
    size = jnp.abs(relative)
    held = jnp.clip(relative, -1.0, 1.0)
    work = law.slip * jnp.where(size < 1, size**2 / 2, size - 0.5)
    sticking = jnp.where(size < 1, 1 / law.slip, 0.0)
    short = SHORT * law.slip
    force = law.friction * _divided(rates, work, held, short)
    slope = law.friction * _divided(rates, held, sticking, short)
    return force, slope


def _divided(values: Array, integral: Array, law: Array, short: Array) -> Array:
    """Averages over cells of a law along straight lines between ``values`` ``(G, M)``,
    from the law and its integral at these: divided differences, means of both ends
    where they are no farther apart than ``short``.
    """
    difference = jnp.roll(values, -1, axis=-1) - values
    near = jnp.abs(difference) <= short
    quotient = (jnp.roll(integral, -1, axis=-1) - integral) / jnp.where(
        near, 1.0, difference
    )
    return jnp.where(near, _mean(law), quotient)


def _mean(values: Array) -> Array:
    """Means of the values at both ends of a cell."""
    return (values + jnp.roll(values, -1, axis=-1)) / 2
