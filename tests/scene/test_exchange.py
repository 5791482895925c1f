"""Trains from TORS and CSV files, and scenes written as TOML: reading, return and
refusal.
"""

import json

import numpy as np
import pytest
from built_trains import same
from reference_data import DATA, reference, text_of
from scipy.linalg import eigh

from jaxhb import (
    Combustion,
    Cylinder,
    Damper,
    Disk,
    Engine,
    Ground,
    Load,
    Mesh,
    SceneError,
    Shaft,
    Torque,
    Trace,
)
from jaxhb.linear.forced import forced_response
from jaxhb.linear.modal import natural_frequencies
from jaxhb.scene.files import load_scene, scene_names
from jaxhb.scene.writer import elements_text, scene_text
from jaxhb.train.assembly import build
from jaxhb.train.checks.plausible import plausibility


def disk(name, inertia, damping=0.0):
    return {"type": "Disk", "name": name, "inertia": inertia, "damping": damping}


def shaft(name, stiffness):
    return {
        "type": "ShaftDiscrete",
        "name": name,
        "stiffness": stiffness,
        "damping": 0.1,
    }


def gear(name, teeth, parent=None):
    element = {"type": "GearElement", "name": name, "inertia": 25e-6, "teeth": teeth}
    return element | ({"parent": parent} if parent else {})


def gearbox(**changes):
    """A motor that drives two shafts by gears."""
    parts = json.loads(text_of("gearbox.json")) | changes
    components = [
        {"name": name, "elements": elements} for name, elements in parts.items()
    ]
    joints = [["motor.s", "box.g1"], ["box.g2", "left.a"], ["box.g3", "right.a"]]
    return {"structure": joints, "components": components}


def write(tmp_path, name, content):
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_a_tors_file_has_the_frequencies_that_opentorsion_finds(tmp_path):
    """Frequencies in Hz, from openTorsion 0.3.2 for the same file."""
    train = load_scene(write(tmp_path, "box.json", gearbox()))
    frequencies = natural_frequencies(train).frequencies_hz
    expected = [337.22723011, 529.06874559, 2100.4776236, 2955.8700736]
    np.testing.assert_allclose(frequencies[1:5], expected, rtol=1e-6)
    assert frequencies[5] > 1e6  # the stiff meshes


def test_a_tors_file_has_its_disks_gears_and_shafts(tmp_path):
    train = load_scene(write(tmp_path, "box.json", gearbox()))
    topology = train.topology
    names = (
        "motor.rotor",
        "box.g1",
        "box.g2",
        "left.wheel",
        "box.g3",
        "right.hub",
        "right.fan",
    )
    assert topology.name == "box"
    assert topology.disk_names == names
    assert topology.mesh_names == ("box.g1|box.g2", "box.g1|box.g3")
    gears = ("box.g1", "box.g2", "box.g3")
    assert [train.value(f"{name}.radius") for name in gears] == [0.05, 0.075, 0.1]
    assert train.value("right.long.stiffness") == 7e4
    assert train.value("left.a.damping") == 0.1


def test_what_is_not_read_of_a_tors_file_is_told_and_stays_told_in_its_toml(tmp_path):
    rotor = disk("rotor", 4e-4) | {
        "excitation": {"values": [1.0]},
        "mass": 3.0,
        "angle": 0.0,
        "colour": "",
    }
    motor = [rotor, shaft("s", 1e4) | {"inertia": 2.0}]
    path = write(tmp_path, "box.json", gearbox(motor=motor) | {"format": "TORS"})
    expected = [
        "box.json: 'format' of the file is not read.",
        "box.json: 'mass' of 'motor.rotor' is not read.",
        (
            "box.json: the excitation of 'motor.rotor' is not read: it has no 'values'"
            " that are rows of order and amplitude. Give it as [[torque]]."
        ),
        "box.json: 'inertia' of 'motor.s' is not read.",
    ]
    assert plausibility(load_scene(path))[:4] == expected
    back = load_scene(write(tmp_path, "back.toml", scene_text(path)[0]))
    assert plausibility(back)[:4] == expected
    assert not load_scene(write(tmp_path, "box.json", gearbox())).topology.notes


def test_gears_with_radii_that_structure_joins_turn_at_the_ratio_of_their_radii():
    """Closed form of three coordinates, the pinion turning with three times the wheel's
    angle.
    """
    train = load_scene(DATA / "scenes" / "gear_radius_tors.json")
    inertia = np.diag([40.0, 3.0 + 9 * 0.2, 1.5])
    stiffness = np.array(
        [[2e6, -2e6, 0.0], [-2e6, 2e6 + 9 * 5e5, -3 * 5e5], [0.0, -3 * 5e5, 5e5]]
    )
    squares = eigh(stiffness, inertia, eigvals_only=True)
    frequencies = natural_frequencies(train).frequencies_hz[1:3]
    np.testing.assert_allclose(
        frequencies, np.sqrt(squares[1:]) / (2 * np.pi), rtol=1e-5
    )
    np.testing.assert_allclose(frequencies, [56.4010, 202.065], rtol=1e-5)
    assert train.topology.name == "pair"
    assert train.value("G.G.radius") == 0.3
    notes = " ".join(train.topology.notes)
    assert "'P.P' and 'G.G'" in notes
    assert "excitation of 'B.B': rows are taken" in notes
    assert "to be in m." in notes


def test_excitations_of_a_tors_file_drive_the_train_as_in_its_scene_and_in_closed_form(
    tmp_path,
):
    """Closed form of three coordinates, the pinion turning with three times the wheel's
    angle and against it, undamped.
    """
    path = DATA / "scenes" / "gear_radius_tors.json"
    rpm = 700.0
    inertia = np.diag([40.0, 3.0 + 9 * 0.2, 1.5])
    stiffness = np.array(
        [[2e6, -2e6, 0.0], [-2e6, 2e6 + 9 * 5e5, -3 * 5e5], [0.0, -3 * 5e5, 5e5]]
    )
    again = load_scene(write(tmp_path, "pair.toml", scene_text(path)[0]))
    for train in (load_scene(path), again):
        response = forced_response(train, rpm=[rpm])
        for order, amplitude in ((2, 30.0), (4, 12.0)):
            omega = order * 2 * np.pi * rpm / 60
            angles = np.linalg.solve(
                stiffness - omega**2 * inertia, [0.0, 0.0, amplitude]
            )
            # The stiff mesh in the place of rigid teeth changes 1e-5 of natural
            # frequencies.
            torque = 2e6 * abs(angles[0] - angles[1])
            np.testing.assert_allclose(
                response.torque("A.A", "G.G").order(order), [torque], rtol=1e-3
            )


@pytest.mark.parametrize(
    ("excitation", "why"),
    [
        (
            {"type": "excitationValuesRpmPercentage", "values": [[4, 2.0]]},
            "shares of a torque, which the file",
        ),
        ({"type": "steps", "values": [[4, 2.0]]}, "its type 'steps' is unknown"),
        ([[4, 0.0015], [6, 0.02]], "below 1, and may be N m or shares"),
        ([[4, "much"]], "no 'values' that are rows"),
        ({"values": {"4": 2.0}}, "no 'values' that are rows"),
    ],
)
def test_an_excitation_whose_torque_a_tors_file_does_not_tell_is_not_read_and_told(
    tmp_path, excitation, why
):
    motor = [disk("rotor", 4e-4) | {"excitation": excitation}, shaft("s", 1e4)]
    topology = load_scene(write(tmp_path, "box.json", gearbox(motor=motor))).topology
    assert not topology.torque_names
    (note,) = topology.notes
    assert "'motor.rotor' is not read" in note
    assert why in note


def test_excitations_of_shafts_and_gears_act_where_opentorsion_puts_them(tmp_path):
    """Excitations act at the node where a shaft begins and at the node of a gear; the
    cycle holds all orders, of which 0 has no load.
    """
    values = {"values": [[0, 5.0], [1 / 3, 2.0], [1 / 3, 1.0]]}
    motor = [disk("rotor", 4e-4), shaft("s", 1e4) | {"excitation": values}]
    parts = gearbox(motor=motor)
    parts["components"][1]["elements"][1]["excitation"] = [[1, -4.0]]
    train = load_scene(write(tmp_path, "box.json", parts))
    topology = train.topology
    name = parts["components"][1]["elements"][1]["name"]
    assert [topology.disk_names[disk] for disk in topology.torques.disk] == [
        "motor.rotor",
        f"box.{name}",
    ]
    assert topology.revolutions_per_cycle == 6
    unread = "order 0 of the excitation of 'motor.s' is not read"
    assert any(unread in note for note in topology.notes)
    back = scene_text(tmp_path / "box.json")[0]
    assert "harmonics = [[0.3333333333333333, 3.0, 0.0]]" in back
    assert "harmonics = [[1.0, -4.0, 0.0]]" in back


@pytest.mark.parametrize(
    ("size", "radius"),
    [({"radius": 60.0}, 0.06), ({"diameter": 120.0}, 0.06), ({}, 0.05)],
)
def test_a_gear_has_its_radius_in_the_unit_that_gears_have(tmp_path, size, radius):
    box = [
        gear("g1", 20) | size,
        gear("g2", 30, "g1") | {key: 1.5 * number for key, number in size.items()},
    ]
    content = {
        "structure": [["motor.s", "box.g1"]],
        "components": gearbox(box=box)["components"][:2],
    }
    train = load_scene(write(tmp_path, "box.json", content))
    np.testing.assert_allclose(
        [train.value(f"box.{name}.radius") for name in ("g1", "g2")],
        [radius, 1.5 * radius],
    )


def test_disks_of_one_node_are_added_and_gears_of_one_node_joined(tmp_path):
    box = [
        gear("g1", 20),
        gear("g2", 30, "g1"),
        disk("clutch", 1e-4, 0.5),
        gear("g3", 15),
        gear("g4", 45, "g3"),
    ]
    content = {
        "structure": [["motor.s", "box.g1"]],
        "components": gearbox(box=box)["components"][:2],
    }
    train = load_scene(write(tmp_path, "box.json", content))
    assert train.value("box.g2.inertia") == 25e-6 + 1e-4 + 25e-6
    assert train.value("box.g2.damping") == 0.5
    assert train.topology.mesh_names == ("box.g1|box.g2", "box.g3|box.g4")
    assert train.value("box.g2|box.g3.stiffness") == 1e9


def test_a_round_shaft_has_the_stiffness_and_inertia_of_its_sizes(tmp_path):
    round_shaft = {
        "type": "ShaftContinuous",
        "name": "r",
        "length": 500.0,
        "outerDiameter": 40.0,
        "innerDiameter": 20.0,
    }
    parts = {"name": "c", "elements": [disk("a", 1.0), round_shaft, disk("b", 1.0)]}
    train = load_scene(
        write(tmp_path, "round.json", {"structure": [], "components": [parts]})
    )
    polar = np.pi / 32 * (0.04**4 - 0.02**4)
    np.testing.assert_allclose(train.value("c.r.stiffness"), 80e9 * polar / 0.5)
    np.testing.assert_allclose(train.value("c.a.inertia"), 1.0 + 8000 * polar * 0.5 / 2)


CSV = text_of("pump.csv")
IN_GERMAN = CSV.replace(",", ";").replace(".", ",")


@pytest.mark.parametrize(
    "text",
    [CSV, CSV.replace(",", ";"), CSV.replace(",", "\t"), IN_GERMAN],
    ids=["commas", "semicolons", "tabs", "decimal commas"],
)
def test_two_tables_of_a_csv_file_are_a_train(tmp_path, text):
    assert same(
        load_scene(write(tmp_path, "pump.csv", text)),
        load_scene(DATA / "scenes" / "pump.toml"),
    )


RADII = text_of("gear_radius_tors.json")


@pytest.mark.parametrize(
    "name, content", [("box.json", gearbox()), ("pump.csv", CSV), ("radii.json", RADII)]
)
def test_an_imported_train_comes_back_from_its_toml(tmp_path, name, content):
    path = write(tmp_path, name, content)
    text, beside = scene_text(path)
    assert beside == {}
    back = load_scene(write(tmp_path, "back.toml", text))
    assert same(back, load_scene(path))


@pytest.mark.parametrize("name", scene_names())
@pytest.mark.parametrize("expand", [False, True])
def test_a_packaged_scene_comes_back_from_its_toml(tmp_path, name, expand):
    text, beside = scene_text(name, expand=expand)
    for file, source in beside.items():
        (tmp_path / file).write_bytes(source.read_bytes())
    back = load_scene(write(tmp_path, "back.toml", text))
    train = load_scene(name)
    assert same(back, train)
    assert back.topology.name == name
    assert back.tune == train.tune


def test_elements_come_back_from_their_toml(tmp_path):
    table = ((0.0, 1e5), (360.0, 8e6), (720.0, 1e5))
    burning = Combustion(
        compression_ratio=16.0, charge_pressure=2e5, start=-5.0, duration=60.0, imep=1e6
    )
    parts = [
        Disk(name="a", inertia=np.float64(1.0), radius=0.1, teeth=20),
        Disk(name="b", inertia=0.0, radius=0.2, teeth=40),
        Disk(name="c", inertia=1.0),
        Shaft(between=("a", "c"), stiffness=1e5, loss_factor=0.02),
        Mesh(
            between=("a", "b"),
            stiffness=1e8,
            backlash=1e-4,
            law="fridman2009",
            kind="internal",
        ),
        Damper(name='"ring"', disk="c", inertia=0.1, damping=3.0, stiffness=5.0),
        Ground(disk="a", stiffness=10.0),
        Load(disk="c", harmonics=[(4.0, 0.1, 0.0)]),
        Torque(
            disk="b",
            harmonics=np.array([[1.0, 2.0, 3.0]]).tolist(),
            rated_rpm=900.0,
            orders_of="own",
        ),
        Cylinder(
            disk="b",
            bore=0.1,
            stroke=0.12,
            rod=0.2,
            traces=[Trace(rpm=1e3, pressure=table), Trace(rpm=2e3, pressure=table)],
        ),
        Engine(
            cylinders=2,
            disks=("a", "c"),
            firing_order=(1, 2),
            combustion=burning,
            gas_factor=[1.0, 0.9],
            bore=0.1,
            stroke=0.12,
            rod=0.2,
        ),
    ]
    table = {"rpm": [1.0]}
    built, text = (
        make(parts, name="all", reference="a", revolutions_per_cycle=4, tune=table)
        for make in (build, elements_text)
    )
    train = load_scene(write(tmp_path, "all.toml", text))
    assert same(train, built)
    assert train.tune == table


@pytest.mark.parametrize(
    "name, content, begins", reference("cases")["files of other programs"]
)
def test_all_faults_of_a_file_are_told_at_once(tmp_path, name, content, begins):
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, name, content))
    faults = [
        text.removeprefix(f"{name}: ").removeprefix(f"{name}, ")
        for text in caught.value.sentences
    ]
    assert len(faults) == len(begins), faults
    assert all(map(str.startswith, faults, begins)), faults
    assert all(text.startswith(name) for text in caught.value.sentences)
