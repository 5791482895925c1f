"""Every sentence a scene can be refused with; and that all of them come at once."""

import tomllib

import pytest
from reference_data import DATA, reference

from jaxhb.elements.elements import Disk, SceneError, Shaft, Torque
from jaxhb.scene.files import load_scene, scene_description
from jaxhb.train.assembly import build

HEAD = """
[scene]
reference = "a"
revolutions_per_cycle = 2
[[disk]]
name = "a"
inertia = 1.0
radius = 0.1
[[disk]]
name = "b"
inertia = 1.0
[[disk]]
name = "c"
inertia = 1.0
radius = 0.2
[[shaft]]
between = ["a", "b"]
stiffness = 1e4
"""
MESH = '[[mesh]]\nbetween = ["a", "c"]\nstiffness = 1e8\n'
CYLINDER = '[[load]]\ndisk = "c"\n[[cylinder]]\ndisk = "a"\nbore = 0.1\nstroke = 0.1\nrod = 0.2\n'
TRACE = "pressure = [[0, 1e5], [720, 1e5]]\n"


def load(tmp_path, text):
    path = tmp_path / "gears.toml"
    path.write_text(text)
    return load_scene(path)


CASES = tomllib.loads((DATA / "refused_scenes.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("case", CASES)
def test_sentence(tmp_path, case):
    with pytest.raises(SceneError) as caught:
        load(tmp_path, HEAD + CASES[case]["added"])
    assert CASES[case]["sentence"] in str(caught.value)
    assert len(caught.value.sentences) <= 3
    assert all(s.startswith("gears.toml") for s in caught.value.sentences)


def test_the_scene_the_errors_are_put_in_is_sound(tmp_path):
    load(tmp_path, HEAD + MESH)
    load(tmp_path, HEAD + MESH + CYLINDER + TRACE)


@pytest.mark.parametrize("head, sentence", reference("cases")["heads of scenes"])
def test_sentence_on_the_head(tmp_path, head, sentence):
    body = HEAD[HEAD.index("[[disk]]") :] + MESH
    with pytest.raises(SceneError) as caught:
        load(tmp_path, head + "\n" + body)
    assert sentence in str(caught.value)


@pytest.mark.parametrize("content, sentence", reference("cases")["tables of pressures"])
def test_sentence_on_a_csv(tmp_path, content, sentence):
    (tmp_path / "p.csv").write_text(content)
    with pytest.raises(SceneError) as caught:
        load(tmp_path, HEAD + MESH + CYLINDER + "pressure = 'p.csv'")
    assert sentence in str(caught.value)


def test_a_csv_stands_for_its_rows(tmp_path):
    (tmp_path / "p.csv").write_text("# angle; Pa\n0; 1e5\n\n720; 3e5\n")
    one = load(tmp_path, HEAD + MESH + CYLINDER + "pressure = 'p.csv'")
    two = load(tmp_path, HEAD + MESH + CYLINDER + "pressure = [[0, 1e5], [720, 3e5]]")
    assert (one.cylinders.pressure == two.cylinders.pressure).all()


def test_a_syntax_error_names_file_and_line(tmp_path):
    with pytest.raises(SceneError, match=r"gears.toml: invalid TOML: .*line 2.*Correct the line 'name = = 3'\.$"):
        load(tmp_path, "[scene]\nname = = 3\n")
    comma = r"Correct the line 'inertia = 0,3  # kg m2': decimals take a point, not a comma\.$"
    with pytest.raises(SceneError, match=comma):
        load(tmp_path, "[[disk]]\nname = 'a'\ninertia = 0,3  # kg m2\n")


def test_unknown_scenes_and_files_are_named():
    with pytest.raises(SceneError, match="there is no packaged scene 'gear_trian_30'. Did you mean 'gear_train_30'?"):
        load_scene("gear_trian_30")
    with pytest.raises(SceneError, match="nowhere.toml: there is no such file"):
        scene_description("nowhere.toml")


def test_a_byte_order_mark_is_no_fault(tmp_path):
    """Spreadsheets and editors that save UTF-8 write it."""
    table = '[[torque]]\ndisk = "a"\nharmonics = "h.csv"\n[[load]]\ndisk = "b"\n'
    (tmp_path / "h.csv").write_text("1.0, 2.0, 3.0\n", encoding="utf-8-sig")
    (tmp_path / "gears.toml").write_text(
        HEAD.partition('[[disk]]\nname = "c"')[0] + HEAD[HEAD.index("[[shaft]]") :] + table, encoding="utf-8-sig"
    )
    assert load_scene(tmp_path / "gears.toml").topology.torque_harmonics == ((2,),)


def test_what_is_no_element_is_told():
    with pytest.raises(SceneError, match="3 is no element of a drive train"):
        build([3])


def test_scaled_means_that_balance_at_every_speed_are_no_fault():
    scale = [(100.0, 0.5), (200.0, 1.0)]
    parts = [Disk(name="a", inertia=1.0), Disk(name="b", inertia=1.0), Shaft(between=("a", "b"), stiffness=1.0)]
    build([*parts, *(Torque(disk=d, mean=mean, scale=scale) for d, mean in (("a", 5.0), ("b", -5.0)))])
