"""Signals over time, their cycles and their damage, by hand and by known orders."""

import numpy as np
import pytest

import jaxhb
from jaxhb import Disk, Ground, Torque
from jaxhb.transients.fatigue import SNCurve, count_cycles, damage_of
from jaxhb.transients.history import History

TIME = np.linspace(0.0, 4.0, 40_001)
OMEGA = 20.0 + 30.0 * TIME  # rad/s
ANGLE = 20.0 * TIME + 15.0 * TIME**2


def history(values, time=TIME, omega=OMEGA, angle=ANGLE):
    return History(time, values, omega * 30 / np.pi, angle)


def test_values_between_instants_lie_on_cubics():
    time = np.array([0.0, 0.1, 0.25, 0.4, 0.7, 1.0])
    signal = history(time**3 - 2 * time, time, 0 * time, time)
    between = np.array([0.0, 0.05, 0.33, 0.5, 0.99, 1.0])
    np.testing.assert_allclose(
        signal.at(between), between**3 - 2 * between, rtol=0, atol=1e-14
    )
    with pytest.raises(ValueError, match=r"from 0 to 1 s, and 1\.5 to 1\.5 s"):
        signal.at(1.5)


def test_the_peak_of_a_sampled_wave_is_that_of_its_parabola():
    signal = history(np.sin(7 * ANGLE[:3000]), TIME[:3000], OMEGA[:3000], ANGLE[:3000])
    # 200 samples and more of a period of 7 x 29 rad/s: (2 pi / 300)^4 / 128 of 1
    assert signal.max == pytest.approx(1.0, abs=1e-7)
    assert signal.min == pytest.approx(-1.0, abs=1e-7)
    assert float(np.abs(signal.values).max()) < float(signal.peak)


def test_mean_and_rms_are_those_of_trapezia():
    signal = history(np.array([0.0, 2.0, -4.0]), np.array([0.0, 1.0, 3.0]), 0.0, 0.0)
    assert signal.mean == pytest.approx((1.0 - 2.0) / 3)
    assert signal.rms == pytest.approx(np.sqrt((2.0 + 20.0) / 3))


def test_a_part_keeps_its_instants_and_its_elastic_values():
    signal = History(TIME, 0 * TIME, OMEGA, ANGLE, TIME**2)
    part = signal.between(1.0, 1.5)
    assert (part.time[0], part.time[-1]) == (1.0, 1.5)
    np.testing.assert_array_equal(part.elastic.values, part.time**2)
    with pytest.raises(
        ValueError, match="no two instants: the signal goes from 0 to 4"
    ):
        signal.between(7.0, 8.0)
    with pytest.raises(AttributeError, match="no elastic part"):
        _ = part.elastic.elastic


def test_the_envelope_holds_the_extremes_of_every_window():
    growing = history((1 + TIME) * np.sin(40 * ANGLE))
    envelope = growing.envelope(0.5)
    assert len(envelope.time) == 8
    for k in range(8):
        begin = 0.5 * k
        inside = (begin - 1e-9 < TIME) & (begin + 0.5 - 1e-9 > TIME)
        values = growing.values[inside]
        # Vertices exceed samples by (40 x 140 x 1e-4)^2 / 8 of 5 at most.
        assert envelope.highest[k] == pytest.approx(values.max(), rel=0.05)
        assert envelope.highest[k] >= values.max() - 1e-12
        assert envelope.lowest[k] <= values.min() + 1e-12
    # The amplitude grows by 1 in a second: by half a window's rise, or a wave less.
    np.testing.assert_allclose(
        envelope.highest[:8], 1.5 + 0.5 * np.arange(8), rtol=0.02
    )
    np.testing.assert_allclose(
        envelope.rpm, (20.0 + 30.0 * envelope.time) * 30 / np.pi, rtol=1e-12
    )


def test_the_order_map_finds_the_amplitudes_of_known_orders():
    """Order 2 has 3 N m at all speeds, order 5.5 grows with the speed, the mean is 7."""
    growth = OMEGA / 100.0
    values = 7.0 + 3.0 * np.sin(2 * ANGLE + 0.4) + growth * np.cos(5.5 * ANGLE)
    found = history(values).order_map(highest=8.0, revolutions=8.0)
    place = {order: k for k, order in enumerate(found.orders)}
    assert found.orders[-1] == 8.0
    # Linear between samples: (5.5 x 140 rad/s x 1e-4 s)^2 / 8 of an amplitude
    np.testing.assert_allclose(found.amplitudes[:, place[0.0]], 7.0, rtol=1e-3)
    np.testing.assert_allclose(found.amplitudes[:, place[2.0]], 3.0, rtol=1e-3)
    expected = found.rpm * np.pi / 30 / 100.0
    # An amplitude that bends over the 8 revolutions of a window is that in its middle
    # but for 1 %.
    np.testing.assert_allclose(found.amplitudes[:, place[5.5]], expected, rtol=0.02)
    for empty in (1.0, 3.5, 7.0):
        assert found.amplitudes[:, place[empty]].max() < 0.01
    # A peak spreads over its neighbours, half of it each.
    np.testing.assert_allclose(found.amplitudes[:, place[2.125]], 1.5, rtol=0.01)
    turned = found.time * 20.0 + 15.0 * found.time**2
    steps = np.diff(turned) / (2 * np.pi)
    np.testing.assert_allclose(steps, 2.0, rtol=1e-6)


def test_orders_beyond_those_of_a_map_do_not_appear_in_it():
    """Teeth mesh 40 times a revolution; of 48 samples order 40 would be order 8."""
    found = history(np.sin(40 * ANGLE)).order_map(highest=12.0)
    # A wave of 16 samples or more, linear between them, leaves (2 pi / 16)^2 / 12
    assert found.amplitudes.max() < 0.02
    np.testing.assert_array_equal(found.orders, np.arange(97) / 8)


def test_an_order_map_of_too_few_revolutions_is_refused():
    short = history(0 * TIME[:100], TIME[:100], OMEGA[:100], ANGLE[:100])
    with pytest.raises(ValueError, match="turns 0.03175 times, and a window has 8"):
        short.order_map()
    with pytest.raises(ValueError, match="overlap is 1, must be from 0 to below 1"):
        history(TIME).order_map(overlap=1.0)
    with pytest.raises(ValueError, match="revolutions are 0 and highest is 12, must"):
        history(TIME).order_map(revolutions=0.0)


def turning(speed, seconds):
    train = jaxhb.build(
        [
            Disk(name="mass", inertia=1.0, damping=5.0),
            Ground(disk="mass", stiffness=4e4),
            Torque(disk="mass", harmonics=((1.0, 1.0, 0.0),)),
        ],
        revolutions_per_cycle=1,
    )
    return jaxhb.transient(train, seconds=seconds, speed=speed, start="rest")


def test_the_passage_of_a_range_takes_what_the_rows_of_the_speed_say():
    """Up with 1000 rpm/s, at 1000 rpm for 0.2 s, down with 2000 rpm/s."""
    found = turning([(0.0, 600.0), (0.4, 1000.0), (0.6, 1000.0), (0.8, 600.0)], 0.8)
    assert found.passage(700.0, 900.0) == pytest.approx(0.2 + 0.1, rel=1e-12)
    assert found.passage(950.0, 1000.0) == pytest.approx(0.05 + 0.2 + 0.025, rel=1e-12)
    assert found.passage(1100.0, 1200.0) == 0.0
    assert found.passage(500.0, 1200.0) == pytest.approx(0.8, rel=1e-12)
    with pytest.raises(ValueError, match="the first speed must be the lower one"):
        found.passage(900.0, 700.0)


ASTM = np.array([-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0])
"""Peaks and valleys of figure 6 of ASTM E1049-85."""


def test_rainflow_counts_the_example_of_the_standard():
    cycles = count_cycles(history(ASTM, np.arange(9.0), 0.0, np.arange(9.0)))
    counted = {}
    for size, count in zip(cycles.ranges.tolist(), cycles.counts.tolist(), strict=True):
        counted[size] = counted.get(size, 0.0) + count
    assert counted == {9.0: 0.5, 8.0: 1.0, 6.0: 0.5, 4.0: 1.5, 3.0: 0.5}
    assert cycles.total == 4.0
    middle = (ASTM[cycles.begin] + ASTM[cycles.end]) / 2
    np.testing.assert_array_equal(cycles.means, middle)


def test_rainflow_counts_what_lies_between_turning_points_alone():
    fine = np.interp(np.linspace(0, 8, 801), np.arange(9.0), ASTM)
    time = np.linspace(0, 8, 801)
    cycles = count_cycles(history(fine, time, 0.0, time))
    few = count_cycles(history(ASTM, np.arange(9.0), 0.0, np.arange(9.0)))
    np.testing.assert_allclose(cycles.ranges, few.ranges, rtol=1e-12)
    np.testing.assert_array_equal(cycles.counts, few.counts)


def test_damage_is_the_sum_of_palmgren_and_miner():
    """N = 1e6 (2 / S)^3 by hand: cycles of the example, with half of their ranges."""
    curve = SNCurve(points=((1e6, 2.0), (8e6, 1.0)), source="by hand")
    cycles = count_cycles(history(ASTM, np.arange(9.0), 0.0, np.arange(9.0)))
    amplitudes = np.array([4.5, 4.0, 3.0, 2.0, 1.5])
    counts = np.array([0.5, 1.0, 0.5, 1.5, 0.5])
    expected = (counts * (amplitudes / 2.0) ** 3 / 1e6).sum()
    assert damage_of(cycles, curve) == pytest.approx(expected, rel=1e-12)


def test_the_curve_has_a_knee_and_a_limit():
    points = ((1e4, 300.0), (1e6, 100.0))
    slope = np.log(100.0) / np.log(3.0)
    curve = SNCurve(
        points=points, source="by hand", limit=20.0, knee_exponent=2 * slope - 1
    )
    amplitudes = np.array([600.0, 300.0, 100.0, 50.0, 20.0, 0.0])
    expected = [
        1e4 * 0.5**slope,
        1e4,
        1e6,
        1e6 * 2.0 ** (2 * slope - 1),
        np.inf,
        np.inf,
    ]
    np.testing.assert_allclose(curve.cycles(amplitudes), expected, rtol=1e-12)
    # A number that is none does not pass for a cycle without damage.
    assert np.isnan(curve.cycles(np.array([np.nan, 50.0]))).tolist() == [True, False]
    straight = SNCurve(points=points, source="by hand")
    assert straight.cycles(np.array(50.0)) == pytest.approx(1e6 * 2.0**slope)


def test_a_curve_to_an_amplitude_of_one_bears_no_load_for_ever():
    curve = SNCurve(points=((1e4, 2.0), (1e6, 1.0)), source="by hand")
    assert curve.cycles(np.array([0.0, 1.0])).tolist() == [np.inf, pytest.approx(1e6)]


def test_a_signal_that_is_no_number_has_no_cycles():
    values = np.where(np.arange(9) == 5, np.nan, ASTM)
    with pytest.raises(jaxhb.SceneError, match="the signal is nan at 5 s"):
        count_cycles(history(values, np.arange(9.0), 0.0, np.arange(9.0)))


@pytest.mark.parametrize(
    "points, sentence",
    [
        ((1e4, 300.0), r"points must be rows of \(cycles, amplitude\)"),
        (((1e4, 300.0), (1e3, 100.0)), "cycles must increase and amplitudes fall"),
        (((1e4, 300.0), (1e6, 300.0)), "cycles must increase and amplitudes fall"),
        (((1e4, 300.0), (1e6, 0.0)), "all greater than 0"),
    ],
)
def test_a_curve_that_is_none_is_refused(points, sentence):
    with pytest.raises(jaxhb.SceneError, match=sentence):
        SNCurve(points=points, source="by hand").cycles(np.array(1.0))


def test_half_a_cycle_of_a_slow_swing_does_most_damage():
    """Damage of a transient is that of its cycles."""
    found = turning([(0.0, 600.0), (0.4, 2400.0)], 0.4)
    signal = found.disk("mass")
    curve = SNCurve(points=((1e3, 1e-3), (1e6, 1e-4)), source="by hand")
    cycles = found.cycles(signal)
    by_hand = (cycles.counts * (cycles.ranges / 2 / 1e-3) ** 3 / 1e3).sum()
    assert found.damage(signal, curve) == pytest.approx(by_hand, rel=1e-12)
    assert cycles.ranges[0] == pytest.approx(
        float(np.max(signal.values) - np.min(signal.values)), rel=1e-12
    )
