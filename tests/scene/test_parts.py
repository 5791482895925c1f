"""Catalogue parts in scenes: whose keys win, what is told, and what copies keep."""

import shutil

import numpy as np
import platformdirs
import pytest

import jaxhb
from jaxhb.cli.main import main
from jaxhb.scene.files import load_scene
from jaxhb.scene.writer import changed_scene, elements_of, scene_text

MAKERS = """
[coupling."X 31"]
stiffness = 21000.0
relative_damping = 0.8
over_temperature = [[20, 1.0, 1.0], [80, 0.5, 0.9]]

[damper."D 7"]
inertia = 0.4
stiffness = 3e4
damping = 20.0

[disk.hub]
inertia = 2.0
"""

PLANT = """# a plant
[scene]
reference = "a"
temperature = 50.0

[parts]
files = ["makers.toml"]

[[disk]]
name = "a"
inertia = 1.0

[[disk]]
name = "b"
part = "hub"

[[shaft]]
name = "coupling"
between = ["a", "b"]
part = "X 31"   # the smaller one
relative_damping = 0.6

[[damper]]
name = "ring"
disk = "a"
part = "D 7"

[[torque]]
disk = "a"
harmonics = [[1.0, 10.0, 0.0]]
"""


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """Path of a scene beside its parts, with an empty folder of the user."""
    monkeypatch.setattr(
        platformdirs, "user_config_path", lambda *_, **__: tmp_path / "user"
    )
    (tmp_path / "plant").mkdir()
    (tmp_path / "plant" / "makers.toml").write_text(MAKERS)
    path = tmp_path / "plant" / "plant.toml"
    path.write_text(PLANT)
    return path


def written_out():
    """Scene with the keys of its parts in it, written by hand."""
    text = PLANT.replace('[parts]\nfiles = ["makers.toml"]\n', "")
    text = text.replace('part = "hub"', "inertia = 2.0")
    text = text.replace(
        'part = "X 31"   # the smaller one',
        "stiffness = 21000.0\nover_temperature = [[20, 1.0, 1.0], [80, 0.5, 0.9]]",
    )
    damper = "inertia = 0.4\nstiffness = 3e4\ndamping = 20.0"
    return text.replace('part = "D 7"', damper)


def test_a_scene_with_parts_is_the_scene_with_their_keys(scene):
    expected = scene.with_name("expected.toml")
    expected.write_text(written_out().replace("[scene]", '[scene]\nname = "plant"'))
    assert load_scene(scene) == load_scene(expected)


def test_numbers_of_parts_may_have_units(scene):
    expected = load_scene(scene)
    makers = scene.with_name("makers.toml")
    text = makers.read_text()
    text = text.replace("= 21000.0", '= "21 kN m/rad"')
    text = text.replace("[20, 1.0, 1.0]", '["68 deg F", 1.0, 1.0]')
    makers.write_text(text)
    changed = load_scene(scene)
    for number in ("coupling.stiffness", "coupling.over_temperature"):
        np.testing.assert_allclose(changed.value(number), expected.value(number))


def test_numbers_of_parts_have_units_and_are_expanded_as_they_are_written(scene):
    """The same numbers as in SI."""
    si = load_scene(scene)
    makers = scene.with_name("makers.toml")
    text = MAKERS.replace("21000.0", '"21 kN m/rad"').replace("0.4", '"4000 kg cm2"')
    text = text.replace("[20, 1.0, 1.0]", '[20, "100 %", 1.0]')
    makers.write_text(text.replace("inertia = 2.0", 'gd2 = "8 kgf m2"'))
    assert load_scene(scene) == si
    expanded, _ = scene_text(scene, expand=True)
    assert 'stiffness = "21 kN m/rad"' in expanded


def test_an_expanded_scene_is_the_same_train_without_its_parts(scene, tmp_path):
    text, beside = scene_text(scene, expand=True)
    alone = tmp_path / "plant.toml"
    alone.write_text(text)
    assert "part" not in text.replace("# a plant", "")
    assert list(beside) == ["makers.toml"]
    assert load_scene(alone) == load_scene(scene)


def test_parts_of_the_folder_of_the_user_are_found_and_not_copied(scene, tmp_path):
    shared = tmp_path / "user" / "parts"
    shared.mkdir(parents=True)
    expected = load_scene(scene)
    shutil.move(scene.with_name("makers.toml"), shared)
    assert load_scene(scene) == expected
    copy = tmp_path / "copy" / "plant.toml"
    copy.parent.mkdir()
    assert main(["scene", str(scene), "--out", str(copy)]) == 0
    assert [path.name for path in copy.parent.iterdir()] == ["plant.toml"]
    assert load_scene(copy) == expected


def test_a_copy_keeps_its_parts_beside_it(scene, tmp_path):
    inner = scene.parent / "inner"
    inner.mkdir()
    named = inner / "plant.toml"
    named.write_text(PLANT.replace("makers.toml", "../makers.toml"))
    copy = tmp_path / "copy" / "deep" / "plant.toml"
    copy.parent.mkdir(parents=True)
    assert main(["scene", str(named), "--out", str(copy)]) == 0
    assert 'files = ["makers.toml"]' in copy.read_text()
    assert (copy.parent / "makers.toml").read_text() == MAKERS
    assert load_scene(copy) == load_scene(scene)


def test_a_changed_scene_keeps_its_parts_and_loads_to_the_changed_train(scene):
    values = {"coupling.stiffness": 9e3, "ring.damping": 7.0}
    places = {("shaft", 0, "stiffness"): 9e3, ("damper", 0, "damping"): 7.0}
    text, _ = changed_scene(scene, places)
    changed = scene.with_name("changed.toml")
    changed.write_text(text.replace("[scene]", '[scene]\nname = "plant"'))
    assert 'part = "X 31"   # the smaller one' in text
    for key, value in values.items():
        # The file has the stiffness at 20 deg C, which rounds.
        assert load_scene(changed).value(key) == pytest.approx(value, rel=1e-14)
    assert elements_of(scene, places)["coupling"].part == "X 31 of makers.toml"


@pytest.mark.parametrize(
    ("file", "old", "new", "sentences"),
    [
        (
            "makers.toml",
            "stiffness = 21000.0",
            "stiffness = -1",
            ["makers.toml, [coupling.'X 31']: stiffness is -1 N m/rad"],
        ),
        (
            "makers.toml",
            "stiffness = 21000.0",
            'stiffness = "21 kN/m"',
            ["[coupling.'X 31']: stiffness is '21 kN/m', must be in N m/rad or a unit"],
        ),
        (
            "makers.toml",
            "damping = 20.0",
            "dampin = 20.0",
            ["makers.toml, [damper.'D 7']: unknown key 'dampin'. Did you mean"],
        ),
        (
            "makers.toml",
            "[disk.hub]",
            "[disc.hub]",
            ["no. 2 'b': there is no part 'hub'", "makers.toml: unknown table 'disc'"],
        ),
        (
            "makers.toml",
            "[disk.hub]",
            '[shaft."X 31"]\nstiffness = 1.0\n[disk.hub]',
            ["makers.toml, [shaft.'X 31']: there are two parts of this name"],
        ),
        (
            "plant.toml",
            '"X 31"',
            '"X 13"',
            [
                "[[shaft]] no. 1 'coupling': there is no part 'X 13'. Did you mean 'X 31'"
            ],
        ),
        (
            "plant.toml",
            "relative_damping = 0.6",
            "loss_factor = 0.1",
            ["'coupling' (part X 31 of makers.toml): relative_damping = 0.8 is given"],
        ),
        (
            "plant.toml",
            'files = ["makers.toml"]',
            'files = ["maker.toml"]',
            [
                "there is no file 'maker.toml'",
            ],
        ),
        (
            "plant.toml",
            'files = ["makers.toml"]',
            "file = 3",
            [
                "[parts]: unknown key 'file'. Did you mean 'files'?",
            ],
        ),
        (
            "plant.toml",
            '[parts]\nfiles = ["makers.toml"]',
            "",
            [
                "there is no part 'hub'. Name its file in [parts]",
                "there is no part 'X 31'",
                "there is no part 'D 7'",
            ],
        ),
        (
            "makers.toml",
            "damping = 20.0",
            'damping = "20 N m"',
            ["makers.toml, [damper.'D 7']: damping is '20 N m', must be in N m s/rad"],
        ),
        ("plant.toml", "temperature = 50.0\n", "", ["over_temperature is given witho"]),
    ],
)
def test_a_fault_of_a_part_is_told_with_its_part_and_file(
    scene, file, old, new, sentences
):
    path = scene.with_name(file)
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
    with pytest.raises(jaxhb.SceneError) as caught:
        load_scene(scene)
    assert len(caught.value.sentences) == len(sentences)
    for words in sentences:
        assert any(words in sentence for sentence in caught.value.sentences)
