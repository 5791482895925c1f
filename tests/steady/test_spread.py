"""How far the extremes of another record of an irregular motion may lie."""

import numpy as np
import pytest
from reference_data import reference
from trains import Pair, pair_rpm, pair_train

import jaxhb
from jaxhb.results.record import RecordedSignal
from jaxhb.steady.closure import LONGER, RECORDED, SPREAD, Cycles

EPSILON = 1e-3
SPEED = 1.1
EXACT = next(
    row
    for row in reference("lightly_loaded_pair")["laws"][1]["rows"]
    if row["speed"] == SPEED
)["attractors"][0]


def recorded(highest):
    """A signal with these largest values of its cycles, and smallest ones of the other
    sign.
    """
    return RecordedSignal(highest, -highest, 0.0, 1.0, np.zeros(1), 2.0)


def test_the_spread_is_that_of_the_extremes_of_many_records():
    """Largest values that fall off exponentially: those of records of any length
    scatter alike, by pi / sqrt(6).
    """
    records = np.random.default_rng(1).exponential(size=(400, 64))
    spreads = np.array([recorded(record).spread.max for record in records])
    true = 2 * records.max(axis=1).std()
    assert true == pytest.approx(2 * np.pi / np.sqrt(6), rel=0.1)
    assert np.sqrt((spreads**2).mean()) == pytest.approx(true, rel=0.1)
    covered = np.abs(records.max(axis=1) - np.log(64) - np.euler_gamma) < spreads
    assert covered.mean() > 0.85


def test_a_motion_that_repeats_has_no_spread():
    assert recorded(np.tile([1.0, 2.0, 1.5, 1.0], 16)).spread == (0.0, 0.0, 0.0)
    assert recorded(np.array([1.0, 2.0])).spread == (0.0, 0.0, 0.0)
    state = jaxhb.steady_state(jaxhb.load_scene("spur_pair"), rpm=6000.0)
    assert state.force("gear a", "gear b").spread == (0.0, 0.0, 0.0)


def test_records_grow_where_their_extremes_vary_and_tell_how_far_others_lie():
    """The exact motion gives what 5 and 95 % of records of so many cycles reach: apart
    by 3.3 standard deviations.
    """
    train = pair_train(Pair(1.0, epsilon=EPSILON), transition=0.01)
    rpm = pair_rpm(Pair(SPEED, epsilon=EPSILON))
    short = jaxhb.steady_state(train, rpm=rpm, cycles=Cycles(recorded=RECORDED))
    state = jaxhb.steady_state(train, rpm=rpm, cycles=None)
    assert short.kind == state.kind == "irregular"
    assert short.record.cycles == RECORDED
    assert state.record.cycles == (LONGER if short.record.spread > SPREAD else RECORDED)
    # A neighbour starts from this motion.
    np.testing.assert_array_equal(short.motion, state.motion)
    for record in (short.record, state.record):
        low, _, high = EXACT["largest_over"][str(record.cycles)]
        signal = record.deflection("a", "b")
        assert 0.99 * low < signal.max < 1.01 * high
        assert signal.spread.max > 2 * (high - low) / 3.3 / 2
        assert signal.spread.max < 0.5 * signal.max
