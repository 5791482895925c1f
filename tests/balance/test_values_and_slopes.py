"""Differences of values and derivatives where teeth hammer, as the page on derivatives
tells them.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxhb

DAMPING = "viscous damper.damping"
RPM = 2300.0


@pytest.mark.slow
def test_differences_of_planned_values_tend_to_the_derivative_as_the_page_says():
    train = jaxhb.load_scene("engine_with_damper")
    damping = float(train.value(DAMPING))
    start = jaxhb.solve(train, rpm=RPM)
    plan = jaxhb.plan(train, rpm=RPM)

    def read(share):
        changed = train.replace({DAMPING: damping * share})
        force = jaxhb.solve(changed, rpm=RPM, plan=plan, start=start).force(
            "crank gear|idler"
        )
        return jnp.stack([force.smooth_peak(), force.max])

    @jax.jit
    def values_and_slopes(share):
        return jax.jvp(read, (share,), (1.0,))

    def difference(step):
        upper, lower = (values_and_slopes(1 + s)[0] for s in (step, -step))
        return (np.asarray(upper) - np.asarray(lower)) / (2 * step)

    with pytest.warns(
        UserWarning,
        match="is differentiated at one time sample, and where teeth hammer",
    ):
        _, slope = values_and_slopes(1.0)
    assert slope[0] == pytest.approx(-1779.1, abs=0.5)
    # The largest sample has this slope, too, as long as it stays the same one.
    np.testing.assert_allclose(difference(1e-5), slope, rtol=1e-4)
    assert difference(1e-3)[0] == pytest.approx(-1779.3, abs=1.0)
    assert difference(1e-2)[0] == pytest.approx(-1819, abs=5.0)


@pytest.mark.slow
def test_the_largest_sample_has_a_derivative_of_another_sign_than_the_smooth_peak():
    """Where teeth hammer."""
    train = jaxhb.load_scene("gear_train_30")
    key = "crank damper.damping"
    rpm = 1800.0
    damping = float(train.value(key))
    start = jaxhb.solve(train, rpm=rpm)
    plan = jaxhb.plan(train, rpm=rpm)

    def read(share):
        changed = train.replace({key: damping * share})
        response = jaxhb.solve(changed, rpm=rpm, plan=plan, start=start)
        force = response.force("crank gear|idler")
        return jnp.stack([force.smooth_peak(), force.max, force.half_peak_to_peak])

    with pytest.warns(
        UserWarning,
        match="is differentiated at one time sample, and where teeth hammer",
    ):
        _, slope = jax.jit(lambda share: jax.jvp(read, (share,), (1.0,)))(1.0)
    np.testing.assert_allclose(slope, [-20, 1978, 1380], atol=5.0)
