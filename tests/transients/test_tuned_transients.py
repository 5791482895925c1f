"""Tuning by transients: what a step compiles, and that it wins."""

import jax
import pytest
from test_transient_derivatives import SPEED, built

from jaxhb.design import Parameter, TransientObjective, tune_transient

COMPILED = "/jax/core/compile/backend_compile_duration"


@pytest.mark.slow
def test_evaluations_after_the_first_compile_nothing_though_steps_are_others():
    compiled = []

    def listen(event, duration_secs, **_):
        compiled.extend([event] * (event == COMPILED))

    after_steps = []
    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        tuned = tune_transient(
            built(backlash=1e-4),
            # The mesh decides how long steps are: a tenth stiffer, and 5 % shorter.
            parameters=[
                Parameter(name="gear a|gear b.stiffness", low=9e6, high=1.1e7),
                Parameter(name="motor|gear a.stiffness", low=1e4, high=4e4),
            ],
            objectives=[
                TransientObjective(
                    name="force",
                    value=lambda run: run.force("gear a", "gear b").smooth_peak(16),
                    seconds=0.15,
                    speed=SPEED,
                    start="rest",
                )
            ],
            steps=2,
            on_step=lambda step: after_steps.append(len(compiled)),
        )
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)
    assert after_steps[0] > 0
    assert len(after_steps) == 3
    assert after_steps[1:] == after_steps[:1] * 2
    before = tuned.before.parameters["gear a|gear b.stiffness"]
    assert abs(tuned.after.parameters["gear a|gear b.stiffness"] / before - 1) > 0.01
    assert tuned.after.objective < 1.0
