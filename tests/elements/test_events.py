"""Events of a scene: read, written, changed by name, left out."""

import jax
import numpy as np
import pytest

import jaxhb
from jaxhb import Clutch, Cylinder, Disk, Event, Ice, Load, Pulse, SceneError, Shaft
from jaxhb.elements.events import CASES
from jaxhb.scene.files import load_scene
from jaxhb.scene.writer import elements_text

PARTS = [
    *(Disk(name=name, inertia=1.0) for name in "abc"),
    Shaft(between=("a", "b"), stiffness=1e4, damping=1.0),
    Shaft(name="coupling", between=("b", "c"), stiffness=2e4, damping=1.0),
    Cylinder(name="one", disk="a", gas_torque_mean=9.0, gas_torque=[(0.5, 3.0, 1.0)]),
    Cylinder(name="two", disk="b", gas_torque_mean=9.0, gas_torque=[(0.5, 3.0, 1.0)]),
    Load(disk="c", over_rpm=[(0.0, 0.0), (900.0, 5.0)]),
    Load(name="fan", disk="b", law="propeller", rated_torque=3.0, rated_rpm=800.0),
]
EVENTS = [
    Event(name="kick", disk="a", begin=0.5, step=20.0),
    Event(name="ramp", disk="c", begin_deg=30.0, ramp=(5.0, 0.5)),
    Event(name="pulse", disk="c", pulse=Pulse(torque=5.0, seconds=0.5), end=0.3),
    Event(name="rows", disk="b", table=[(0.0, 1.0), (1.0, 2.0)], factor=-1.0),
    Event(name="longer", disk="b", table=[(0.0, 1.0), (1.0, 2.0), (3.0, 5.0)]),
    Event(name="fault", disk="c", decaying=[(9.0, 0.1, 50.0, 0.0), (5.0, 0.2, 9, 0)]),
    Event(name="ice", disk="c", ice=Ice(torque=8.0, blades=4, case=3, thickness=1.5)),
    Event(name="idle", misfire="two"),
    Event(name="none", cut_off="one", begin=2.0),
    Event(name="less", fuel=[(0.0, 1.0), (2.0, 0.0)]),
    Event(name="start", firing_from=200.0),
    Event(name="slip", between=("c", "b"), clutch=Clutch(capacity=[(0.0, 1e3)])),
]
SEQUENCES = {"all": {"events": ["kick", "idle", "slip"], "begin": 1.5}}
TRAIN = jaxhb.build([*PARTS, *EVENTS], sequences=SEQUENCES)


def test_a_scene_with_events_is_read_as_it_is_written(tmp_path):
    path = tmp_path / "scene.toml"
    text = elements_text([*PARTS, *EVENTS], reference="a", sequences=SEQUENCES)
    path.write_text(text, encoding="utf-8")
    read = load_scene(path)
    assert read.topology.events == TRAIN.topology.events
    assert read.sequences == TRAIN.sequences == SEQUENCES
    before, structure = jax.tree.flatten(TRAIN.events)
    after, same = jax.tree.flatten(read.events)
    assert structure == same
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_is_fixed_of_events_names_disks_cylinders_and_shafts():
    seats = {seat.name: seat for seat in TRAIN.topology.events}
    assert [seats[name].of for name in ("idle", "none", "slip")] == [
        *("two", "one", "coupling")
    ]
    assert TRAIN.topology.disk_names[seats["ice"].disk] == "c"
    assert seats["ice"].passages == 8  # two blocks
    assert [seat.name for seat in seats.values() if seat.by_angle] == ["ramp"]
    assert [seat.name for seat in seats.values() if seat.ends] == ["pulse"]
    assert [seat.is_torque for seat in seats.values()] == [True] * 7 + [False] * 5


@pytest.mark.parametrize(
    "case, angles",
    [
        (1, (90.0, 90.0, 72.0, 60.0)),
        (2, (135.0,) * 4),
        (3, (45.0, 45.0, 36.0, 30.0)),
        (4, (45.0, 45.0, 36.0, 30.0)),
    ],
)
def test_cases_of_ice_have_the_angles_of_the_rules_for_three_to_six_blades(
    case, angles
):
    contacts = [CASES[case].contact(blades) for blades in (3, 4, 5, 6)]
    np.testing.assert_allclose(contacts, angles, rtol=1e-15)


def test_the_case_and_the_thickness_of_ice_become_numbers():
    values = [
        TRAIN.value(f"ice.ice.{key}")
        for key in ("coefficient", "contact_deg", "angle_deg", "ramp_deg")
    ]
    assert values == [0.5, 45.0, 1080.0, 270.0]


CHANGES = {
    "kick.step": 7.0,
    "kick.begin": 0.25,
    "ramp.begin_deg": 60.0,
    "ramp.ramp": [6.0, 0.25],
    "pulse.pulse.seconds": 0.75,
    "pulse.end": 0.5,
    "rows.factor": 2.0,
    "rows.table": [[0.0, 3.0], [0.5, 4.0]],
    "fault.decaying": [[8.0, 0.2, 25.0, 45.0], [1.0, 0.1, 5.0, 0.0]],
    "ice.ice.contact_deg": 30.0,
    "less.fuel": [[0.0, 1.0], [1.0, 0.5]],
    "start.firing_from": 150.0,
    "slip.clutch.capacity": [[0.0, 500.0]],
    "fan.rated_torque": 4.0,
    "c:load.over_rpm": [[0.0, 1.0], [900.0, 7.0]],
}


def test_every_number_of_an_event_is_changed_by_its_name():
    changed = TRAIN.replace(CHANGES)
    assert changed.topology == TRAIN.topology
    for key, value in CHANGES.items():
        np.testing.assert_array_equal(changed.value(key), value)
        back = TRAIN.replace({key: value})
        leaves = zip(jax.tree.leaves(TRAIN), jax.tree.leaves(back), strict=True)
        assert sum(not np.array_equal(*pair) for pair in leaves) == 1


@pytest.mark.parametrize(
    "key, value, words",
    [
        ("kick.begin_deg", 5.0, "begins by begin"),
        ("kick.ramp", (1.0, 2.0), "the event has a step"),
        ("kick.end", 5.0, "has no end"),
        ("idle.factor", 5.0, "a misfire, no torque"),
        ("kick.pulse.torque", 5.0, "it has no pulse"),
        ("kick.misfire", "one", "there is no field 'misfire'"),
        ("kick.begin", -1.0, "must be at least 0 s"),
        ("ramp.ramp", (1.0, -2.0), "must be greater than 0 s"),
        ("rows.table", [(0.0, 1.0), (-1.0, 1.0)], "must increase"),
        ("rows.table", [(0.0, 1.0)], "has shape"),
        ("less.fuel", [(0.0, 1.0), (1.0, -1.0)], "must be at least 0"),
        ("fault.decaying", [(8.0, 0.0, 25.0, 0.0)] * 2, "must be greater than 0 s"),
        ("fan.over_rpm", [(0.0, 1.0)], "has shape"),
    ],
)
def test_changes_of_events_that_say_nothing_or_are_wrong_are_refused(key, value, words):
    with pytest.raises(SceneError, match=words):
        TRAIN.replace({key: value})


def test_scenarios_change_numbers_of_events():
    scenarios = {"strong": {"kick.step": 90.0, "pulse.pulse.torque": 70.0}}
    train = jaxhb.build([*PARTS, *EVENTS], scenarios=scenarios).scenario("strong")
    assert train.value("kick.step") == 90.0
    assert train.value("pulse.pulse.torque") == 70.0
    with pytest.raises(SceneError, match="'kick' has no pulse"):
        jaxhb.build([*PARTS, *EVENTS], scenarios={"x": {"kick.pulse.torque": 70.0}})


def test_events_go_with_what_they_act_on():
    left = TRAIN.without("coupling")
    names = [seat.name for seat in left.topology.events]
    assert names == ["kick", "rows", "longer", "idle", "none", "less", "start"]
    assert left.value("longer.table")[2].tolist() == [3.0, 5.0]
    assert left.sequences == {"all": {"events": ["kick", "idle"], "begin": 1.5}}
    assert left.events.ice is None
    assert TRAIN.without("one").topology.events[-4].name == "idle"
    assert "kick" not in TRAIN.without("kick").topology.elements
    none = TRAIN.without(*(event.name for event in EVENTS))
    assert none.events is None
    assert none.sequences == {}


def test_a_train_without_events_has_no_arrays_of_them_and_solves_take_none():
    plain = jaxhb.build(PARTS)
    assert plain.events is None
    assert plain.topology.events == ()
    rows = len(jax.tree.leaves(TRAIN)) - len(jax.tree.leaves(TRAIN.events))
    assert len(jax.tree.leaves(plain)) == rows
    first = jaxhb.solve(plain, rpm=900.0).torque("a", "b").max
    assert jaxhb.solve(TRAIN, rpm=900.0).torque("a", "b").max == first


def test_a_load_without_a_law_has_no_arrays_of_laws():
    loads = jaxhb.build([*PARTS[:5], Load(disk="c")]).loads
    assert (loads.rated_torque, loads.rated_rpm, loads.over_rpm) == (None,) * 3
