"""A periodic signal as the engineer reads it."""

import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import ALGEBRAIC, GRADIENT

import jaxhb
from jaxhb import Signal
from jaxhb.design.objectives import half_peak_to_peak
from jaxhb.results.response import stack

HARMONICS = 9
RESOLUTION = 4096
SLOPE_WARNING = (
    "differentiated at one time sample, and where teeth hammer such a derivative may"
    " have the wrong sign"
)


@pytest.fixture(scope="module")
def signal():
    """Three random signals, two revolutions a cycle."""
    draw = np.random.default_rng(18)
    size = (3, HARMONICS + 1)
    coefficients = draw.normal(size=size) + 1j * draw.normal(size=size)
    coefficients[:, 0] = coefficients[:, 0].real
    return Signal(coefficients, None, 2.0, RESOLUTION)


def values_at(signal, theta_deg):
    """Values of mean + sum A cos(order theta + phase), the definition of a signal."""
    total = np.zeros((3, len(theta_deg))) + np.asarray(signal.mean)[:, None]
    for k, order in enumerate(signal.orders):
        phase = np.deg2rad(signal.phases_deg[:, k, None])
        total += signal.amplitudes[:, k, None] * np.cos(
            order * np.deg2rad(theta_deg) + phase
        )
    return total


@pytest.mark.filterwarnings("ignore:.* samples miss the peak")
@pytest.mark.parametrize("count", [3, 7, 19, 720])
def test_samples_are_values_of_the_signal_at_their_angles_however_few(signal, count):
    angles = signal.angles_deg(count)
    assert angles[0] == 0.0
    assert angles[-1] < 720.0
    np.testing.assert_allclose(
        signal.samples(count), values_at(signal, angles), rtol=0, atol=30 * ALGEBRAIC
    )


def test_extremes_belong_together_and_lie_within_the_sum_of_amplitudes(signal):
    assert np.all(signal.sum_of_amplitudes >= signal.half_peak_to_peak)
    in_step = Signal(np.array([0.5, 1.0, 0.25, 0.125]) + 0j, None, 1.0, RESOLUTION)
    np.testing.assert_allclose(
        in_step.max - in_step.mean, in_step.sum_of_amplitudes, rtol=ALGEBRAIC
    )
    np.testing.assert_allclose(
        signal.half_peak_to_peak, (signal.max - signal.min) / 2, rtol=ALGEBRAIC
    )
    np.testing.assert_allclose(
        signal.peak, np.maximum(signal.max, -signal.min), rtol=ALGEBRAIC
    )
    assert np.all(signal.min < signal.mean)
    assert np.all(signal.mean < signal.max)


def test_extremes_are_found_to_the_square_of_the_resolution(signal):
    fine = Signal(signal.coefficients, None, 2.0, 64 * RESOLUTION)
    largest = np.abs(fine.max - signal.max).max()
    assert largest < 0.5 * HARMONICS**2 * (np.pi / RESOLUTION) ** 2 * np.max(
        signal.sum_of_amplitudes
    )


def test_root_mean_square_is_that_of_the_samples_with_the_mean(signal):
    values = signal.samples(RESOLUTION)
    np.testing.assert_allclose(
        signal.rms, np.sqrt((values**2).mean(-1)), rtol=ALGEBRAIC
    )


@pytest.mark.parametrize("p", [8, 64, 512])
def test_smooth_peak_lies_between_its_bounds(signal, p):
    huge = Signal(1e30 * signal.coefficients, None, 2.0, RESOLUTION).smooth_peak(p)
    smooth = signal.smooth_peak(p)
    np.testing.assert_allclose(huge, 1e30 * smooth, rtol=1e-9)
    assert Signal(np.zeros(4, complex), None, 1.0, 64).smooth_peak(p) == 0.0
    assert np.all(smooth <= signal.peak * (1 + ALGEBRAIC))
    assert np.all(smooth >= signal.peak * RESOLUTION ** (-1 / p) * (1 - ALGEBRAIC))


@pytest.mark.parametrize("array", [np.asarray, jnp.asarray])
def test_nothing_is_read_of_a_signal_that_is_nan(array):
    """Many samples: in jax 0.12 the largest of a few nan is nan, and of many -inf."""
    unknown = Signal(array(np.full(HARMONICS + 1, np.nan + 0j)), None, 2.0, RESOLUTION)
    names = (
        "max",
        "min",
        "peak",
        "half_peak_to_peak",
        "mean",
        "rms",
        "sum_of_amplitudes",
    )
    readings = [getattr(unknown, name) for name in names] + [
        unknown.smooth_peak(),
        unknown.order(1.0),
        unknown.order(99.0),
    ]
    assert np.isnan(readings).all()
    assert np.isnan(list(unknown.extremes().values())).all()


def test_derivatives_are_those_of_differences_and_zero_for_absent_orders():
    start = jnp.array([0.3, 1.0, 0.0, -0.4])
    turn = jnp.array([1.0, 0.6 + 0.8j, 1.0, 1j])

    def of_sizes(function):
        return lambda sizes: function(Signal(turn * sizes, None, 1.0, 64))

    for function in (
        lambda s: s.sum_of_amplitudes,
        lambda s: s.smooth_peak(16),
        lambda s: s.rms,
    ):
        slope = jax.jit(jax.grad(of_sizes(function)))(start)
        assert np.isfinite(slope).all()
        direction = np.array([0.3, -0.8, 0.0, 0.5])
        ahead = of_sizes(function)(np.asarray(start) + 1e-6 * direction)
        behind = of_sizes(function)(np.asarray(start) - 1e-6 * direction)
        np.testing.assert_allclose(
            slope @ direction, (ahead - behind) / 2e-6, rtol=0, atol=GRADIENT
        )


@pytest.mark.parametrize("order", [0.3, 0.0, -1.0])
def test_an_order_is_read_and_one_that_is_no_harmonic_of_the_cycle_is_refused(
    signal, order
):
    np.testing.assert_array_equal(signal.order(4.5), signal.amplitudes[:, 8])
    np.testing.assert_array_equal(signal.order(60.0), 0.0)
    with pytest.raises(
        ValueError, match=rf"order {order:g} .*2 revolutions.*multiple of 0.5"
    ):
        signal.order(order)


def test_summary_is_plain_numbers_and_the_spectrum_gives_the_signal_back():
    signal = Signal(np.array([1.0, 2.0 - 1.0j, 0.0, 0.25j]), None, 2.0, RESOLUTION)
    with pytest.raises(AttributeError, match="not a force or torque"):
        _ = signal.elastic
    summary = signal.summary()
    assert set(summary) == {
        "mean",
        "min",
        "max",
        "rms",
        "half_peak_to_peak",
        "sum_of_amplitudes",
        "amplitudes",
    }
    values = [value for key, value in summary.items() if key != "amplitudes"]
    assert all(isinstance(value, float) for value in values)
    assert [row[0] for row in summary["amplitudes"]] == [0.5, 1.0, 1.5]
    theta = np.deg2rad(signal.angles_deg(50))
    rebuilt = 1.0 + sum(
        amplitude * np.cos(order * theta + np.deg2rad(phase))
        for order, amplitude, phase in summary["amplitudes"]
    )
    np.testing.assert_allclose(signal.samples(50), rebuilt, rtol=0, atol=30 * ALGEBRAIC)


EXTREMES = ("max", "min", "peak", "half_peak_to_peak")


def extreme_of(name, sharp):
    """An extreme of a signal as a function of its size, read through ``reversed`` and
    ``elastic``, which are to hand the flag on.
    """
    coefficients = jnp.array([1.0, 2.0 - 1.0j, 0.0, 0.25j])

    def extreme(size):
        signal = Signal(size * coefficients, size * coefficients, 2.0, 64, sharp)
        return getattr(signal.reversed().elastic, name)

    return extreme


@pytest.mark.slow
@pytest.mark.parametrize("name", EXTREMES)
def test_the_derivative_of_an_extreme_warns_where_contact_was_an_unknown(name):
    sharp = extreme_of(name, True)
    calm = extreme_of(name, False)
    transforms = {
        "reverse": jax.grad,
        "forward": jax.jacfwd,
        "staged": lambda f: jax.jit(jax.grad(f)),
        "inside": lambda f: jax.grad(jax.jit(f)),
        "in a batch": lambda f: jax.vmap(jax.grad(f)),
    }
    for transform, differentiated in transforms.items():
        at = jnp.array([1.5]) if transform == "in a batch" else 1.5
        with pytest.warns(
            UserWarning,
            match=rf"^\.{name} is {SLOPE_WARNING}: differentiate .smooth_peak\(\)",
        ):
            slope = differentiated(sharp)(at)
        # The calm signal gives no warning, which would be an error.
        assert slope == differentiated(calm)(at), transform


@pytest.mark.parametrize("name", EXTREMES)
def test_an_extreme_that_is_not_differentiated_is_read_without_a_warning(name):
    sharp = extreme_of(name, True)
    calm = extreme_of(name, False)
    assert sharp(1.5) == calm(1.5)
    assert jax.jit(sharp)(1.5) == jax.jit(calm)(1.5)
    assert jax.vmap(sharp)(jnp.array([1.5])) == jax.vmap(calm)(jnp.array([1.5]))
    weighted = jax.value_and_grad(
        lambda size: size * sharp(jax.lax.stop_gradient(size))
    )
    assert weighted(1.5) == (1.5 * sharp(1.5), sharp(1.5))


@pytest.mark.parametrize("smooth", [Signal.smooth_peak, half_peak_to_peak])
def test_smooth_measures_are_differentiated_without_a_warning(smooth):
    def measure(size):
        return smooth(Signal(size * jnp.array([1.0, 2.0 - 1.0j]), None, 2.0, 64, True))

    # The measure is proportional to the size.
    assert jax.grad(measure)(1.5) == pytest.approx(float(measure(1.0)))


@pytest.mark.slow
def test_signals_of_hammering_teeth_warn_and_those_of_teeth_in_contact_do_not():
    pair = jaxhb.load_scene("spur_pair")
    key = "gear a|gear b.damping"
    damping = float(pair.value(key))
    plans = {rpm: jaxhb.plan(pair, rpm=rpm, harmonics=50) for rpm in (3000.0, 5625.0)}

    def largest(share, rpm):
        damped = pair.replace({key: damping * share})
        response = jaxhb.solve(damped, rpm=rpm, plan=plans[rpm])
        return response.force("gear a", "gear b").max

    assert plans[3000.0].active == ()
    assert plans[5625.0].active == (0,)

    def differentiate(rpm):
        """Only traced: that is when it warns."""
        jax.eval_shape(jax.grad(lambda share: largest(share, rpm)), 1.0)

    differentiate(3000.0)
    with pytest.warns(UserWarning, match=SLOPE_WARNING):
        differentiate(5625.0)
    calm = jaxhb.solve(pair, rpm=3000.0, plan=plans[3000.0])
    hammering = jaxhb.solve(pair, rpm=5625.0, plan=plans[5625.0])
    assert not calm.sharp
    assert hammering.sharp
    assert pickle.loads(pickle.dumps(hammering)) == hammering
    assert stack([calm, hammering]).sharp
    assert not stack([calm, calm]).sharp
    state = jaxhb.SteadyState(
        3000.0, "periodic", 1, hammering, None, 0, (), None, pair.topology
    )
    assert state.force("gear a", "gear b").sharp
    assert not jaxhb.linear_response(pair, rpm=5625.0).sharp
