"""The event-exact oracle of a pair of gears: published motions, adaptive integration,
and its table.
"""

import math

import numpy as np
import pytest
from event_exact import advance, cycle, long_run, march, multipliers, orbit, samples
from lightly_loaded import lightly_loaded, pairs
from reference_data import reference
from scipy.integrate import solve_ivp
from trains import Pair, pair_rpm, pair_train

import jaxhb

PUBLISHED = reference("backlash_one_mass_exact")["kahraman_singh_form"]["rows"]


def published_pair(row):
    """The pair of a row: force Fa Omega^2 sin."""
    return Pair(row["Omega"], mean=0.1, alternating=-0.05j * row["Omega"] ** 2)


@pytest.mark.parametrize(
    "row", PUBLISHED, ids=lambda row: f"{row['Omega']} {row['sweep']}"
)
def test_published_motions_have_their_multipliers_extremes_and_amplitudes(row):
    pair = published_pair(row)
    (motion,) = orbit(pair, row["y0"])
    np.testing.assert_allclose(motion.state, row["y0"], atol=1e-13)
    np.testing.assert_allclose(
        np.sort(np.abs(multipliers([motion]))), np.sort(row["floquet_abs"]), atol=1e-13
    )
    # The published extremes are those of samples: up to 5e-8 inside the true ones.
    assert -1e-13 < motion.maximum - row["max"] < 5e-8
    assert -1e-13 < row["min"] - motion.minimum < 5e-8
    amplitudes = 2 * np.abs(np.fft.rfft(samples(pair, motion.state, 512)))[1:7] / 512
    # Aliases of 512 samples: a spectrum like n^-3.
    np.testing.assert_allclose(amplitudes, row["amp_h"], atol=1e-6)


def adaptive(pair, state, end):
    """State at ``end`` by an adaptive integration that stops at the knots."""

    def field(t, z, piece):
        force = (
            pair.stiffness(piece) * z[0]
            - piece * (1 - pair.epsilon)
            + 2 * pair.damping(piece) * z[1]
        )
        return [
            z[1],
            pair.mean
            + (pair.alternating * np.exp(1j * pair.frequency * t)).real
            - force,
        ]

    def knot(level, towards):
        def event(t, z, piece):
            return z[0] - level

        event.terminal = True
        event.direction = towards
        return event

    t = 0.0
    state = np.array(state, float)
    piece = int(np.sign(state[0])) if abs(state[0]) > 1 else 0
    while t < end:
        events = [knot(piece, -piece)] if piece else [knot(1, 1), knot(-1, -1)]
        run = solve_ivp(
            field,
            (t, end),
            state,
            args=(piece,),
            events=events,
            method="DOP853",
            rtol=1e-12,
            atol=1e-13,
            max_step=0.1,  # no two crossings in a step
        )
        t = run.t[-1]
        state = run.y[:, -1]
        if run.status == 1:
            piece = 0 if piece else (1 if len(run.t_events[0]) else -1)
    return state


@pytest.mark.parametrize(
    ("frequency", "damped_gap", "epsilon"), [(0.4, True, 0.0), (1.1, False, 0.3)]
)
def test_irregular_motion_follows_an_adaptive_integration(
    frequency, damped_gap, epsilon
):
    pair = Pair(frequency, epsilon=epsilon, damped_gap=damped_gap)
    state = march(pair, (0.3, -0.2), 5)[-1].state
    expected = adaptive(pair, (0.3, -0.2), 5 * pair.cycle)
    # Errors of 1e-11 a cycle grow at most tenfold a cycle.
    np.testing.assert_allclose(state, expected, atol=1e-7)


# At 2.5e-3 damping in the gap is critical.
@pytest.mark.parametrize("epsilon", [0.0, 1e-3, 2.5e-3, 0.3])
@pytest.mark.parametrize("damped_gap", [True, False])
def test_the_tangent_map_is_the_derivative_of_the_motion(epsilon, damped_gap):
    pair = Pair(0.7, epsilon=epsilon, damped_gap=damped_gap)
    state = np.array([0.3, -0.2])
    step = 1e-6
    changes = [
        np.subtract(cycle(pair, state + shift).state, cycle(pair, state - shift).state)
        for shift in step * np.eye(2)
    ]
    motion = cycle(pair, state)
    np.testing.assert_allclose(
        motion.tangent, np.transpose(changes) / (2 * step), atol=1e-6
    )
    damped = 1.0 if damped_gap else 1 - motion.separated
    expected = math.exp(-2 * pair.damping_ratio * damped * pair.cycle)  # Liouville
    assert np.linalg.det(motion.tangent) == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("beyond", [1e-3, 1e-6, 1e-10, 1e-13, -1e-13, -1e-10])
def test_a_knot_that_is_barely_passed_is_crossed_twice(beyond):
    """A throw in the gap from x = 0 whose top is just beyond the knot, or just below
    it.
    """
    pair = Pair(2.0, damping_ratio=0.0, mean=-0.1, alternating=0.0)
    speed = math.sqrt(0.2 * (1 + beyond))
    throw = advance(pair, (0.0, speed), 0.0, 8.0)
    assert throw.impacts == (beyond > 0)
    error = abs(beyond) + 1e-14  # the contact takes less than this from the throw
    assert throw.maximum == pytest.approx(1 + beyond, abs=error)
    assert throw.state[0] == pytest.approx(speed * 8 - 0.05 * 64, abs=error)


def table():
    return {
        law["epsilon"]: law["rows"] for law in reference("lightly_loaded_pair")["laws"]
    }


def attractors(epsilon):
    """(pair, attractor) of all rows of a law."""
    rows = zip(lightly_loaded(epsilon), table()[epsilon], strict=True)
    return [(pair, motion) for pair, row in rows for motion in row["attractors"]]


@pytest.mark.parametrize("epsilon", [0.0, 1e-3])
def test_periodic_rows_of_the_table_close_and_attract(epsilon):
    rows = [(pair, motion) for pair, motion in attractors(epsilon) if motion["period"]]
    assert len(rows) > 15
    for pair, motion in rows:
        cycles = march(pair, motion["state"], motion["period"])
        gaps = [
            np.abs(np.subtract(revolution.state, motion["state"])).max()
            for revolution in cycles
        ]
        assert gaps[-1] < 1e-11
        assert min([*gaps[:-1], 1.0]) > 1e-3  # no shorter period
        np.testing.assert_allclose(
            pairs(multipliers(cycles)), motion["multipliers"], atol=1e-9
        )
        real, imaginary = motion["multipliers"][0]
        assert abs(complex(real, imaginary)) < 1
        maximum = max(revolution.maximum for revolution in cycles)
        minimum = min(revolution.minimum for revolution in cycles)
        assert maximum == pytest.approx(motion["maximum"], abs=1e-10)
        assert minimum == pytest.approx(motion["minimum"], abs=1e-10)


@pytest.mark.parametrize(
    ("units", "damped_gap"),
    [
        ({}, False),
        ({"stiffness": 2e8, "backlash": 1.2e-4, "natural_frequency": 900.0}, True),
    ],
)
def test_the_pair_as_a_train_moves_alike_whatever_its_units(units, damped_gap):
    pair = Pair(0.6, epsilon=1e-3, damped_gap=damped_gap)
    motion = long_run(pair, (1.25, 0.0))
    assert motion.period == 1
    train = pair_train(pair, transition=0.01, **units)
    rpm = pair_rpm(pair, units.get("natural_frequency", 1.0))
    response = jaxhb.solve(train, rpm=rpm, tolerance=1e-3)
    jaxhb.check(response)
    half_backlash = units.get("backlash", 2.0) / 2
    x = np.asarray(response.twist("a", "b").samples(4096)) / half_backlash
    np.testing.assert_allclose(
        [x.min(), x.max(), x[0]],
        [motion.minimum, motion.maximum, motion.state[0]],
        rtol=1e-3,
    )
