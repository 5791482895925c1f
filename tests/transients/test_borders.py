"""What a transient hands on: stresses, S-N curves, labelled arrays, extremes in cycles,
a table for a notebook.
"""

import numpy as np
import pytest
from reference_data import text_of

import jaxhb
from jaxhb.transients.history import History

CURVE = (
    'tensile_strength = 5e8\nsn_curve = [[1e4, 6e7], [1e6, 2e7]]\nsn_source = "rods"'
)
OUTER = 0.11  # m, of the line shaft


@pytest.fixture(scope="module")
def run_up(tmp_path_factory):
    text = text_of("limited_line.toml").replace("tensile_strength = 5e8", CURVE)
    path = tmp_path_factory.mktemp("scene") / "line.toml"
    path.write_text(text)
    train = jaxhb.load_scene(path)
    return jaxhb.transient(train, seconds=1.0, speed=[(0, 380), (1, 440)])


def test_the_stress_of_a_shaft_is_its_torque_over_that_of_its_section(run_up):
    torque = run_up.torque("line shaft")
    section = np.pi * OUTER**3 / 16
    stress = run_up.stress("line shaft")
    np.testing.assert_allclose(stress.values, torque.values / section, rtol=1e-12)
    np.testing.assert_allclose(
        stress.elastic.values, torque.elastic.values / section, rtol=1e-12
    )
    reverse = run_up.stress("propeller", "wheel")
    np.testing.assert_array_equal(reverse.values, -stress.values)


def test_a_scene_keeps_the_curve_when_a_part_is_left_out(run_up):
    train = run_up.train.without("ring").without("engine:torque")
    assert train.topology.shaft_names == ("coupling", "line shaft")
    curves = [rows for rows, _ in train.topology.shaft_curves]
    assert curves == [(), ((1e4, 6e7), (1e6, 2e7))]


def test_a_shaft_without_section_or_curve_says_so(run_up):
    with pytest.raises(ValueError, match="'coupling' has no section"):
        run_up.stress("coupling")
    with pytest.raises(ValueError, match="'coupling' has none"):
        run_up.sn_curve("coupling")
    with pytest.raises(ValueError, match="'ring' has none"):
        run_up.sn_curve("ring")


def test_the_curve_of_the_scene_bears_its_cycles(run_up):
    curve = run_up.sn_curve("line shaft")
    assert curve.source == "rods"
    np.testing.assert_allclose(curve.cycles(np.array([6e7, 2e7])), [1e4, 1e6])


def test_labelled_arrays_hold_the_signals(run_up):
    data = run_up.to_xarray()
    assert dict(data.sizes) == {
        "time": len(run_up.time),
        "disk": 5,
        "shaft": 3,
        "gear": 2,
        "mesh": 1,
    }
    np.testing.assert_array_equal(data.rpm, run_up.rpm)
    for values, signal, unit in (
        (data.torque.sel(shaft="ring"), run_up.torque("ring"), "N m"),
        (data.tooth_force.sel(mesh="pinion|wheel"), run_up.force("pinion|wheel"), "N"),
        (data.speed.sel(disk="wheel"), run_up.speed("wheel"), "rad/s"),
    ):
        np.testing.assert_array_equal(values, signal.values)
        assert values.attrs["units"] == unit


def test_windows_of_a_cycle_hold_every_extreme_of_it():
    """A wave of order 4 whose amplitude grows with the angle, and a mean of 7."""
    angle = np.linspace(0.0, 41 * np.pi, 41_001)
    values = 7 + angle * np.cos(4 * angle)
    time = angle / 50
    history = History(time, values, 0 * time + 1500 / np.pi, angle)
    envelope = history.envelope_of_cycles(2)
    swing = (envelope.highest - envelope.lowest) / 2
    middles = np.interp(envelope.time, time, angle)
    # Windows of two revolutions hold angles up to one from their middle, the last one
    # all that is left; extremes lie within a quarter of a wave.
    assert len(swing) == 19
    ends = np.append(middles[:-1] + 2 * np.pi, 41 * np.pi)
    np.testing.assert_allclose(swing, ends, atol=np.pi / 4)
    assert envelope.highest.max() == pytest.approx(float(history.max))


def test_a_rotor_that_turns_less_than_a_cycle_has_one_window():
    time = np.linspace(0.0, 1.0, 11)
    envelope = History(time, time, time, time).envelope_of_cycles(2)
    assert envelope.highest.tolist() == [1.0]
    assert envelope.lowest.tolist() == [0.0]
    with pytest.raises(ValueError, match="must be greater than 0"):
        History(time, time, time, time).envelope_of_cycles(0)


def test_a_notebook_shows_a_row_for_every_link(run_up):
    html = run_up._repr_html_()
    assert [name in html for name in run_up.topology.link_names] == [True] * 4


def test_contact_tells_when_teeth_first_part_and_hit():
    train = jaxhb.load_scene("spur_pair")
    motion = jaxhb.transient(train, seconds=0.1, speed=[(0, 4600), (0.1, 4800)])
    contact = motion.mesh("gear a|gear b")
    # The force of the spring in the gap at its end
    numbers = ("stiffness", "epsilon", "backlash")
    weakest = np.prod([train.value(f"gear a|gear b.{name}") for name in numbers]) / 2
    apart = np.abs(motion.force("gear a|gear b").elastic.values) < weakest
    assert contact.first_separation == motion.time[np.argmax(apart)]
    assert contact.first_separation < contact.first_impact
    in_contact = jaxhb.transient(train, seconds=0.01, speed=2000.0).mesh(
        "gear a|gear b"
    )
    assert np.isnan(in_contact.first_separation)
    assert np.isnan(in_contact.first_impact)
