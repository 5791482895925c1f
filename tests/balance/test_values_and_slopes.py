"""What values and derivatives differ by where teeth hammer, as the page on derivatives says."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxhb

DAMPING, RPM = "viscous damper.damping", 2300.0


@pytest.mark.oracle
def test_differences_of_values_miss_the_derivative_by_what_the_page_says():
    # Values sample the law at 16 points a harmonic, derivatives at 256. A quintic through values over 3 % gives -1806
    # for the smooth peak.
    train = jaxhb.load_scene("engine_with_damper")
    own, start, plan = float(train.value(DAMPING)), jaxhb.solve(train, rpm=RPM), jaxhb.plan(train, rpm=RPM)

    @jax.jit
    def read(share):
        changed = train.replace({DAMPING: own * share})
        force = jaxhb.solve(changed, rpm=RPM, plan=plan, start=start).force("crank gear|idler")
        return jnp.stack([force.smooth_peak(), force.max])

    def difference(step):
        return (np.asarray(read(1 + step)) - np.asarray(read(1 - step))) / (2 * step)

    with pytest.warns(UserWarning, match="is differentiated at one time sample, and where teeth hammer"):
        _, slope = jax.jit(lambda share: jax.jvp(read, (share,), (1.0,)))(1.0)
    np.testing.assert_allclose(slope, [-1780, -2349], rtol=0.005)
    np.testing.assert_allclose(difference(0.001), [-2006, -2618], rtol=0.02)
    np.testing.assert_allclose(difference(0.01), [-1840, -2148], rtol=0.02)
    assert slope[0] == pytest.approx(-1806, rel=0.02)


@pytest.mark.oracle
def test_the_derivative_of_the_largest_sample_has_another_sign_than_that_of_the_smooth_peak_where_teeth_hammer():
    train, key, rpm = jaxhb.load_scene("gear_train_30"), "crank damper.damping", 1800.0
    own, start, plan = float(train.value(key)), jaxhb.solve(train, rpm=rpm), jaxhb.plan(train, rpm=rpm)

    def read(share):
        force = jaxhb.solve(train.replace({key: own * share}), rpm=rpm, plan=plan, start=start).force(
            "crank gear|idler"
        )
        return jnp.stack([force.smooth_peak(), force.max, force.half_peak_to_peak])

    with pytest.warns(UserWarning, match="is differentiated at one time sample, and where teeth hammer"):
        _, slope = jax.jit(lambda share: jax.jvp(read, (share,), (1.0,)))(1.0)
    np.testing.assert_allclose(slope, [-20, 1978, 1380], atol=5.0)
