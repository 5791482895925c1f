"""The period of a marched motion, from made-up motions whose period is known."""

import numpy as np
import pytest

from jaxhb import Disk, Load, Mesh, Shaft, Torque, build, damped_modes
from jaxhb.steady import closure
from jaxhb.steady.closure import Closure, Cycles
from jaxhb.steady.marching import Equations


def closure_of(motion, cycles):
    """Closure of ``motion(c, t)``, t in cycles, over so many cycles."""
    closure = Closure(np.array([1e-3, 1e-3]))
    t = np.arange(32) / 32
    samples = [
        np.stack([motion(c, t), motion(c, t + 0.25)], axis=1) for c in range(cycles)
    ]
    closure.add(np.stack(samples))
    return closure


NOISE = np.random.default_rng(0).normal(size=200)
# Added to a cosine that repeats, by cycle c and time t: after how many cycles which
# periods may be found.
ADDED = {
    "a slow approach": (lambda c, t: 0.1 * 0.9**c, {60: {1}}),
    "an alternating approach beside a period doubling": (
        lambda c, t: 0.3 * (-0.95) ** c,
        {cycles: {0, 1} for cycles in range(8, 200, 4)} | {240: {1}},
    ),
    "a small lasting alternation": (
        lambda c, t: 1e-3 * (-1.0) ** c + 0.2 * 0.8**c,
        {96: {2}},
    ),
    "leaving a repelling motion": (
        lambda c, t: 1e-5 * (-1.3) ** c,
        {cycles: {0} for cycles in range(16, 40, 4)},
    ),
    "a quasi-periodic motion": (
        lambda c, t: 0.5 * np.cos(2 * np.pi * (c + t) / 2**0.5),
        {200: {0}},
    ),
    "an irregular motion": (
        lambda c, t: (NOISE[c] - 1) * np.cos(2 * np.pi * t),
        {128: {0}},
    ),
} | {
    f"period {k}": (lambda c, t, k=k: 0.1 * np.cos(2 * np.pi * (c + t) / k), {40: {k}})
    for k in closure.PERIODS
}


@pytest.mark.parametrize("name", ADDED)
def test_a_motion_has_the_period_that_it_repeats_or_approaches_and_no_other(name):
    added, allowed = ADDED[name]
    for cycles, periods in allowed.items():
        record = closure_of(lambda c, t: np.cos(2 * np.pi * t) + added(c, t), cycles)
        assert record.period() in periods


def test_an_irregular_motion_is_decided_to_have_no_period():
    added, _ = ADDED["an irregular motion"]
    record = closure_of(lambda c, t: np.cos(2 * np.pi * t) + added(c, t), 128)
    assert record.period() == 0
    assert not record.undecided()


def test_a_slow_mode_that_teeth_notice_is_given_time():
    """Two gears of radius 1 m; on the second a disk by a shaft, whose mode decays
    slowly, and one by a shaft so soft that the teeth do not notice it.
    """
    inertia = 1.0
    parts = [Disk(name=name, inertia=inertia, radius=1.0) for name in "ab"]
    parts += [Disk(name=name, inertia=inertia) for name in "cd"]
    parts += [
        Mesh(
            between=("a", "b"),
            stiffness=1e6,
            damping=100.0,
            backlash=1e-4,
            epsilon=0.01,
            transition=0.2,
        ),
        Shaft(between=("b", "c"), stiffness=1e4, damping=2.0),
        Shaft(between=("b", "d"), stiffness=1e-2, damping=1e-6),
        Torque(disk="a", mean=10.0, harmonics=((1.0, 5.0, 0.0),)),
        Load(disk="b"),
    ]
    train = build(parts, reference="a")
    rates = damped_modes(train).eigenvalues
    expected = -1 / rates.real[(rates.imag > 1) & (rates.imag < 500)].max()
    assert expected > 0.3
    np.testing.assert_allclose(Equations(train).decay, expected, rtol=1e-6)

    few, most = closure.TRANSIENT
    assert Cycles().before_record(1e9, 0.1) == few
    assert Cycles().before_record(1.0, 0.1) == most
    assert Cycles().before_record(1e9, 20.0) == 20 * closure.DECAYS
    fewer, more = closure.SLOWEST
    assert Cycles().before_record(1e9, np.inf) == fewer
    assert Cycles().before_record(1.0, np.inf) == more
    assert Cycles(transient=16).before_record(1e9, np.inf) == 16


def test_a_closure_holds_the_cycles_that_its_errors_read_and_no_others():
    cycles = np.random.default_rng(1).normal(size=(200, 32, 2))
    record = Closure(np.zeros(2))
    for first in range(0, 200, 8):
        record.add(cycles[first : first + 8])
    assert len(record.cycles) == 32
    scale = np.abs(cycles[-16:]).max(axis=(0, 1))
    for k in closure.PERIODS:
        change = [
            (np.abs(cycles[c] - cycles[c - k]) / scale).max() for c in range(k, 200)
        ]
        window = max(3, k)
        ends = [len(change) - i * window for i in range(3)]
        expected = [max(change[end - window : end]) for end in ends]
        assert record.errors(k) == expected
