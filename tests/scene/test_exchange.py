"""Trains from TORS and CSV files, scenes written as TOML: what is read, what comes back, what is refused."""

import json

import numpy as np
import pytest
from built_trains import same
from reference_data import text_of

from jaxhb.elements.elements import (
    Combustion,
    Cylinder,
    Damper,
    Disk,
    Ground,
    Load,
    Mesh,
    SceneError,
    Shaft,
    Torque,
    Trace,
)
from jaxhb.elements.engine import Engine
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
    parts = {
        "motor": [disk("rotor", 4e-4), shaft("s", 1e4)],
        "box": [gear("g1", 20), gear("g2", 30, "g1"), gear("g3", 40, "g1")],
        "left": [shaft("a", 5e3), disk("wheel", 7e-4)],
        "right": [shaft("a", 6e3), disk("hub", 7e-4), shaft("long", 7e4), disk("fan", 1e-3)],
    }
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
    assert "its excitations are not read" in text
    assert "excitations" not in scene_text(write(tmp_path, "box.json", gearbox()))[0]


def test_disks_of_one_node_are_added_and_gears_of_one_node_joined(tmp_path):
    box = [gear("g1", 20), gear("g2", 30, "g1"), disk("clutch", 1e-4, 0.5), gear("g3", 15), gear("g4", 45, "g3")]
    content = {"structure": [["motor.s", "box.g1"]], "components": gearbox(box=box)["components"][:2]}
    train = load_scene(write(tmp_path, "box.json", content))
    assert train.value("box.g2.inertia") == 25e-6 + 1e-4 + 25e-6 and train.value("box.g2.damping") == 0.5
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
    train = load_scene(write(tmp_path, "round.json", {"structure": [], "components": [parts]}))
    polar = np.pi / 32 * (0.04**4 - 0.02**4)
    np.testing.assert_allclose(train.value("c.r.stiffness"), 80e9 * polar / 0.5)
    np.testing.assert_allclose(train.value("c.a.inertia"), 1.0 + 8000 * polar * 0.5 / 2)


CSV = text_of("pump.csv")


def pump():
    return build(
        [
            Disk(name="crank", inertia=0.24, damping=1.5),
            Disk(name="crank gear", inertia=0.03, radius=0.08, teeth=40),
            Disk(name="pump gear", inertia=0.05, radius=0.16, teeth=80, damping=0.05),
            Shaft(between=("crank", "crank gear"), stiffness=5e6, damping=60.0, loss_factor=0.02),
            Mesh(between=("crank gear", "pump gear"), stiffness=5e8, damping=2800.0, backlash=1.5e-4),
        ],
        reference="crank",
    )


@pytest.mark.parametrize("text", [CSV, CSV.replace(",", ";")], ids=["commas", "semicolons"])
def test_two_tables_of_a_csv_file_are_a_train(tmp_path, text):
    assert same(load_scene(write(tmp_path, "pump.csv", text)), pump())


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


BAD = {
    "no json": ("x.json", "{", "x.json: invalid JSON: "),
    "another json": ("x.json", {"disks": []}, "x.json: this is not TORS, which has 'components'"),
    "a list": ("x.json", [1], "x.json: this is not TORS"),
    "an unknown element": (
        "x.json",
        gearbox(left=[{"type": "ShaftDiscret", "name": "a"}, disk("wheel", 1.0)]),
        "x.json, 'left.a': unknown type 'ShaftDiscret'. Did you mean 'ShaftDiscrete'?",
    ),
    "no begin": (
        "x.json",
        gearbox() | {"structure": [["motor.s", "box.g1"], ["box.g2", "motor.rotor"]]},
        "x.json: the train must begin at one component, not 'left', 'right'.",
    ),
    "no component": (
        "x.json",
        gearbox() | {"structure": [*gearbox()["structure"], ["left.wheel", "fan.x"]]},
        "'fan' does not",
    ),
    "no head": ("x.csv", "a, 1\n", "x.csv: the first line must name columns"),
    "a missing key": ("x.csv", CSV.replace("5e6", ""), "x.csv, [[shaft]] no. 1: the key 'stiffness' is missing"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_file_that_cannot_be_read_is_told(tmp_path, case):
    name, content, sentence = BAD[case]
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, name, content))
    assert sentence in str(caught.value)
    assert len(caught.value.sentences) <= 2


def sentences(tmp_path, name, content):
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, name, content))
    return [text.removeprefix(f"{name}: ").removeprefix(f"{name}, ") for text in caught.value.sentences]


FAULTY = text_of("faulty.csv")


def test_wrong_columns_and_numbers_of_a_csv_file_are_told_at_once(tmp_path):
    said = sentences(tmp_path, "x.csv", FAULTY)
    begins = [
        "unknown column 'inertai'. Did you mean 'inertia'?",
        "unknown column 'colour'.",
        "row 8: link is 'belt', must be 'shaft' or 'mesh'.",
        "row 9: 6 cells under 5 heads.",
        "[[shaft]] no. 2: unknown key 'backlash'.",
        "[[disk]] no. 1 'crank': inertia is -0.24 kg m2",
        "[[disk]] no. 3 'wheel': inertia is 'heavy', must be a number in kg m2",
        "[[shaft]] no. 1: stiffness is -5e+06 N m/rad",
        "[[mesh]] no. 1: backlash is -0.0001 m",
        "[[shaft]] no. 2: there is no disk 'whel'. Did you mean 'wheel'?",
    ]
    assert len(said) == len(begins)
    for begin in begins:
        assert any(text.startswith(begin) for text in said), begin


def test_faults_of_the_links_of_a_csv_file_without_inertias_or_heads_are_told_too(tmp_path):
    links = "from, to, link, stiffness, colour\na, b,, -5e6,\nb, c, belt, 1\n"
    own = ["unknown column 'colour'.", "row 3: link is 'belt', must be"]
    for begin, row in (("", 3), ("a, 1\nb, 2\n", 5)):
        said = sentences(tmp_path, "x.csv", begin + links)
        missing = "the first line must name columns" if begin else "there is no table of inertias"
        wanted = [own[0], own[1].replace("3", str(row)), missing, "[[shaft]] no. 1: stiffness is -5e+06 N m/rad"]
        assert len(said) == len(wanted), said
        assert all(text.startswith(start) for text, start in zip(said, wanted, strict=True)), said
    assert sentences(tmp_path, "x.csv", "")[0].startswith("there is no table of inertias")


def test_faults_of_structure_elements_and_numbers_of_a_tors_file_are_told_at_once(tmp_path):
    content = gearbox(
        motor=[disk("rotor", -4e-4), shaft("s", "stiff")],
        box=[gear("g1", 20), gear("g2", 30, "g0"), gear("g3", 0, "g1"), {"type": "Disk"}],
        left=[shaft("a", -5e3), disk("wheel", 7e-4), disk("wheel", 7e-4)],
    )
    content["structure"] += [["left.whel", "fan.x"]]
    said = sentences(tmp_path, "x.json", content)
    begins = [
        "'motor.s': the key 'stiffness' is missing or no number.",
        "'box.g2': its parent 'g0' is no gear before it in 'box'.",
        "'box.g3': teeth or diameter is 0, must be greater than 0.",
        "component 'box', element no. 4: the key 'name' is missing.",
        "'left.wheel': the element is given twice.",
        "'structure' names 'left.whel', which does not exist. Did you mean 'left.wheel'?",
        "[[disk]] no. 1 'motor.rotor': inertia is -0.0004 kg m2",
        "[[shaft]] no. 2 'left.a': stiffness is -5000 N m/rad",
    ]
    assert len(said) == len(begins)
    for begin in begins:
        assert any(text.startswith(begin) for text in said), begin


def test_a_component_that_nothing_leads_to_or_two_lead_to_is_told(tmp_path):
    joints = gearbox()["structure"]
    for more, begin in (
        ([["left.wheel", "right.a"]], "component 'right' is connected twice."),
        ([["left.wheel", "box.g1"]], "component 'box' leads back to itself."),
    ):
        first, *_ = sentences(tmp_path, "x.json", gearbox() | {"structure": joints + more})
        assert first.startswith(begin)
    ring = gearbox(one=[shaft("a", 1.0)], two=[shaft("b", 1.0)])
    ring["structure"] += [["one.a", "two.b"], ["two.b", "one.a"]]
    said = [f"component '{name}' is not connected to the others. Correct 'structure'." for name in ("one", "two")]
    assert sentences(tmp_path, "x.json", ring)[:2] == said
