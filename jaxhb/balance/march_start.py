"""Starts for Newton's method: a few cycles of time integration from the motion with all teeth in contact."""

import jax.numpy as jnp

from jaxhb.equations import fourier
from jaxhb.equations.reduced_model import resting_on_flank
from jaxhb.integration.cycles import settle
from jaxhb.integration.step import cut, force_on_flank, with_rate


def deflections_on_flank(reduced):
    """Deflections ``(G, N+1)`` with every mesh on its drive side all cycle."""
    held = jnp.zeros_like(reduced.linear).at[:, 0].set(force_on_flank(reduced.law, reduced.linear))
    return reduced.linear - reduced.respond(held)


def begin(reduced, space, time_steps, linear, residual_flexibility=None):
    """The :class:`~jaxhb.integration.step.Stepper` of a reduced equation, ``time_steps`` steps per cycle."""
    return cut(
        space,
        linear,
        reduced.frequency,
        time_steps,
        law=reduced.law,
        viscous=reduced.viscous,
        contact_damping=reduced.contact_damping,
        linear_state=jnp.zeros(len(space.transition)),
        flank_state=resting_on_flank(space, force_on_flank(reduced.law, reduced.linear)),
        residual_flexibility=residual_flexibility,
    )


def marched(reduced, space, time_steps, cycles, periodicity_tolerance=0.0):
    """Deflections over the last of ``cycles`` cycles of ``time_steps`` steps, begun with every mesh on its drive side.

    The march ends earlier where a cycle closes to ``periodicity_tolerance``.

    Returns
    -------
    coefficients ``(G, N+1)``, of the motion on the flanks where the steps were too long for the train; periodicity
    error of that cycle
    """
    linear = fourier.synthesize(with_rate(reduced.linear, reduced.frequency), 2 * time_steps).T
    stepper = begin(reduced, space, time_steps, linear)
    trace = settle(stepper, stepper.flank_state, tolerance=periodicity_tolerance, max_cycles=cycles).trace
    harmonics = reduced.linear.shape[-1] - 1
    kept = fourier.analyze(trace.deflection, min(harmonics, (time_steps - 1) // 2))
    finite = jnp.all(jnp.isfinite(trace.deflection))
    return jnp.where(finite, fourier.resize(kept, harmonics), deflections_on_flank(reduced)), trace.periodicity_error
