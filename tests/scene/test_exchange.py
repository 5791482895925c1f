"""Trains from TORS and CSV files, scenes written as TOML: what is read, what comes back, what is refused."""

import json

import numpy as np
import pytest
from built_trains import same
from reference_data import DATA, reference, text_of

from jaxhb import Combustion, Cylinder, Damper, Disk, Engine, Ground, Load, Mesh, SceneError, Shaft, Torque, Trace
from jaxhb.linear.modal import natural_frequencies
from jaxhb.scene.files import load_scene, scene_names
from jaxhb.scene.writer import elements_text, scene_text
from jaxhb.train.assembly import build


def disk(name, inertia, damping=0.0):
    return {"type": "Disk", "name": name, "inertia": inertia, "damping": damping}


def shaft(name, stiffness):
    return {"type": "ShaftDiscrete", "name": name, "stiffness": stiffness, "damping": 0.1}


def gear(name, teeth, parent=None):
    found = {"type": "GearElement", "name": name, "inertia": 25e-6, "teeth": teeth}
    return found | ({"parent": parent} if parent else {})


def gearbox(**changes):
    """A motor that drives two shafts by gears."""
    parts = json.loads(text_of("gearbox.json"))
    components = [{"name": name, "elements": elements} for name, elements in (parts | changes).items()]
    joints = [["motor.s", "box.g1"], ["box.g2", "left.a"], ["box.g3", "right.a"]]
    return {"structure": joints, "components": components}


def write(tmp_path, name, content):
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_a_tors_file_has_the_frequencies_that_opentorsion_finds(tmp_path):
    """Those of openTorsion 0.3.2, Hz, for the same file."""
    found = natural_frequencies(load_scene(write(tmp_path, "box.json", gearbox()))).frequencies_hz
    np.testing.assert_allclose(found[1:5], [337.22723011, 529.06874559, 2100.4776236, 2955.8700736], rtol=1e-6)
    assert found[5] > 1e6  # the stiff meshes


def test_a_tors_file_has_its_disks_gears_and_shafts(tmp_path):
    train = load_scene(write(tmp_path, "box.json", gearbox()))
    topology = train.topology
    names = ("motor.rotor", "box.g1", "box.g2", "left.wheel", "box.g3", "right.hub", "right.fan")
    assert topology.name == "box" and topology.disk_names == names
    assert topology.mesh_names == ("box.g1|box.g2", "box.g1|box.g3")
    assert [train.value(f"{name}.radius") for name in ("box.g1", "box.g2", "box.g3")] == [0.05, 0.075, 0.1]
    assert train.value("right.long.stiffness") == 7e4 and train.value("left.a.damping") == 0.1


def test_an_excitation_that_is_not_read_is_told(tmp_path):
    motor = [disk("rotor", 4e-4) | {"excitation": {"values": [1.0]}}, shaft("s", 1e4)]
    text, _ = scene_text(write(tmp_path, "box.json", gearbox(motor=motor)))
    assert "excitations" in text
    assert "excitations" not in scene_text(write(tmp_path, "box.json", gearbox()))[0]


def test_disks_of_one_node_are_added_and_gears_of_one_node_joined(tmp_path):
    box = [gear("g1", 20), gear("g2", 30, "g1"), disk("clutch", 1e-4, 0.5), gear("g3", 15), gear("g4", 45, "g3")]
    content = {"structure": [["motor.s", "box.g1"]], "components": gearbox(box=box)["components"][:2]}
    train = load_scene(write(tmp_path, "box.json", content))
    assert train.value("box.g2.inertia") == 25e-6 + 1e-4 + 25e-6 and train.value("box.g2.damping") == 0.5
    assert train.topology.mesh_names == ("box.g1|box.g2", "box.g3|box.g4")
    assert train.value("box.g2|box.g3.stiffness") == 1e9


def test_a_round_shaft_has_the_stiffness_and_inertia_of_its_sizes(tmp_path):
    round_shaft = {"type": "ShaftContinuous", "name": "r", "length": 500.0}
    round_shaft |= {"outerDiameter": 40.0, "innerDiameter": 20.0}
    parts = {"name": "c", "elements": [disk("a", 1.0), round_shaft, disk("b", 1.0)]}
    train = load_scene(write(tmp_path, "round.json", {"structure": [], "components": [parts]}))
    polar = np.pi / 32 * (0.04**4 - 0.02**4)
    np.testing.assert_allclose(train.value("c.r.stiffness"), 80e9 * polar / 0.5)
    np.testing.assert_allclose(train.value("c.a.inertia"), 1.0 + 8000 * polar * 0.5 / 2)


CSV = text_of("pump.csv")


@pytest.mark.parametrize("text", [CSV, CSV.replace(",", ";")], ids=["commas", "semicolons"])
def test_two_tables_of_a_csv_file_are_a_train(tmp_path, text):
    assert same(load_scene(write(tmp_path, "pump.csv", text)), load_scene(DATA / "scenes" / "pump.toml"))


@pytest.mark.parametrize("name, content", [("box.json", gearbox()), ("pump.csv", CSV)])
def test_an_imported_train_comes_back_from_its_toml(tmp_path, name, content):
    path = write(tmp_path, name, content)
    text, beside = scene_text(path)
    assert beside == {} and same(load_scene(write(tmp_path, "back.toml", text)), load_scene(path))


@pytest.mark.parametrize("name", scene_names())
@pytest.mark.parametrize("expand", [False, True])
def test_a_packaged_scene_comes_back_from_its_toml(tmp_path, name, expand):
    text, beside = scene_text(name, expand=expand)
    for file, source in beside.items():
        (tmp_path / file).write_bytes(source.read_bytes())
    back, train = load_scene(write(tmp_path, "back.toml", text)), load_scene(name)
    assert same(back, train) and back.topology.name == name and back.tune == train.tune


def test_elements_come_back_from_their_toml(tmp_path):
    table = ((0.0, 1e5), (360.0, 8e6), (720.0, 1e5))
    sizes = {"bore": 0.1, "stroke": 0.12, "rod": 0.2}
    burning = Combustion(compression_ratio=16.0, charge_pressure=2e5, start=-5.0, duration=60.0, imep=1e6)
    parts = [
        Disk(name="a", inertia=np.float64(1.0), radius=0.1, teeth=20),
        Disk(name="b", inertia=0.0, radius=0.2, teeth=40),
        Disk(name="c", inertia=1.0),
        Shaft(between=("a", "c"), stiffness=1e5, loss_factor=0.02),
        Mesh(between=("a", "b"), stiffness=1e8, backlash=1e-4, law="fridman2009", kind="internal"),
        Damper(name='"ring"', disk="c", inertia=0.1, damping=3.0, stiffness=5.0),
        Ground(disk="a", stiffness=10.0),
        Load(disk="c", harmonics=[(4.0, 0.1, 0.0)]),
        Torque(disk="b", harmonics=np.array([[1.0, 2.0, 3.0]]).tolist(), rated_rpm=900.0, orders_of="own"),
        Cylinder(disk="b", **sizes, traces=[Trace(rpm=1e3, pressure=table), Trace(rpm=2e3, pressure=table)]),
        Engine(cylinders=2, disks=("a", "c"), firing_order=(1, 2), combustion=burning, gas_factor=[1.0, 0.9], **sizes),
    ]
    head = {"name": "all", "reference": "a", "revolutions_per_cycle": 4}
    path = write(tmp_path, "all.toml", elements_text(parts, **head, tune={"rpm": [1.0]}))
    train = load_scene(path)
    assert same(train, build(parts, **head, tune={"rpm": [1.0]})) and train.tune == {"rpm": [1.0]}


@pytest.mark.parametrize("name, content, begins", reference("cases")["files of other programs"])
def test_all_faults_of_a_file_are_told_at_once(tmp_path, name, content, begins):
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, name, content))
    said = [text.removeprefix(f"{name}: ").removeprefix(f"{name}, ") for text in caught.value.sentences]
    assert len(said) == len(begins) and all(map(str.startswith, said, begins)), said
    assert all(text.startswith(name) for text in caught.value.sentences)
