"""Starts for Newton's method: a few cycles of time integration from the motion with all teeth in contact."""

import jax.numpy as jnp

from ..harmonic import fourier
from ..transient.integrate import settle
from ..transient.stepper import cut, flank_excess, seen
from ..transient.surrogate import resting_on_flank

INSTANTS_PER_MODE_PERIOD = 6
INSTANT_COUNTS = tuple(n * 2**k for k in range(5, 13) for n in (2, 3)) + (16384,)


def instants_for(harmonic):
    """Instants per cycle for motion up to ``harmonic`` of the cycle, one of a few numbers."""
    needed = INSTANTS_PER_MODE_PERIOD * harmonic
    return next((n for n in INSTANT_COUNTS if n >= needed), INSTANT_COUNTS[-1])


def on_flank(reduced):
    """Deflections ``(G, N+1)`` with every mesh on its drive side all cycle."""
    held = jnp.zeros_like(reduced.linear).at[:, 0].set(flank_excess(reduced.law, reduced.linear))
    return reduced.linear - reduced.respond(held)


def begin(reduced, space, instants, linear, static=None):
    """The :class:`~jaxhb.transient.stepper.Stepper` of a reduced equation, ``instants`` steps per cycle."""
    return cut(
        space,
        linear,
        reduced.frequency,
        instants,
        law=reduced.law,
        viscous=reduced.viscous,
        contact_damping=reduced.contact_damping,
        linear_state=jnp.zeros(len(space.transition)),
        flank_state=resting_on_flank(space, flank_excess(reduced.law, reduced.linear)),
        static=static,
    )


def marched(reduced, space, instants, cycles, enough=0.0):
    """Deflections over the last of ``cycles`` cycles of ``instants`` steps, begun with every mesh on its drive side.

    The march ends earlier where a cycle closes to ``enough``.

    Returns
    -------
    coefficients ``(G, N+1)``, of the motion on the flanks where the steps were too long for the train; closure of
    that cycle
    """
    linear = fourier.synthesize(seen(reduced.linear, reduced.frequency), 2 * instants).T
    stepper = begin(reduced, space, instants, linear)
    trace = settle(stepper, stepper.flank_state, tolerance=enough, max_cycles=cycles).trace
    harmonics = reduced.linear.shape[-1] - 1
    kept = fourier.analyze(trace.deflection, min(harmonics, (instants - 1) // 2))
    finite = jnp.all(jnp.isfinite(trace.deflection))
    return jnp.where(finite, fourier.resize(kept, harmonics), on_flank(reduced)), trace.closure
