"""A fault hides no other: every check runs on what is sound, and a fault breeds no false sentences."""

import tomllib

import pytest
from reference_data import DATA, reference

from jaxhb.elements.elements import Cylinder, Disk, Load, SceneError, Shaft
from jaxhb.scene.files import load_scene
from jaxhb.train.assembly import build

TABLE = [(float(a), 1e5) for a in range(0, 721, 10)]
AB = [Disk(name=name, inertia=1.0) for name in "ab"] + [Shaft(between=("a", "b"), stiffness=1e4)]
FAULTY = tomllib.loads((DATA / "faulty_scenes.toml").read_text(encoding="utf-8"))


def refusal(tmp_path, text):
    """The sentences that a scene is refused with."""
    path = tmp_path / "gears.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    return caught.value.sentences


@pytest.mark.parametrize("case", FAULTY)
def test_each_fault_of_a_scene_is_told_and_nothing_else(tmp_path, case):
    said, wanted = refusal(tmp_path, FAULTY[case]["scene"]), FAULTY[case]["sentences"]
    assert len(said) == len(wanted), said
    assert [sum(text in sentence for sentence in said) for text in wanted] == [1] * len(wanted), said


@pytest.mark.parametrize(
    "span, good", [(200, False), (360, True), (350, True), (340, False), (720, True), (710, True), (700, False)]
)
def test_a_pressure_table_covers_the_gas_cycle_but_for_one_step(span, good):
    table = [row for row in TABLE if row[0] <= span]
    parts = [*AB, Load(disk="b"), Cylinder(disk="a", bore=0.1, stroke=0.1, rod=0.2, pressure=table)]
    if good:
        build(parts)
        return
    with pytest.raises(
        SceneError, match=f"pressure covers 0 to {span} deg, must cover a whole gas cycle of (36|72)0 deg"
    ):
        build(parts)


@pytest.mark.parametrize("digits", ["9" * 400, "9" * 5000, "0x" + "f" * 5000], ids=["400", "5000", "hex"])
@pytest.mark.parametrize("place", reference("cases")["places of integers"])
def test_an_integer_too_large_for_a_double_is_a_sentence(tmp_path, digits, place):
    disks = "[[disk]]\nname = 'a'\ninertia = 1\n[[disk]]\nname = 'b'\ninertia = 1\n"
    said = refusal(tmp_path, disks + place.format(digits))
    assert any(words in "\n".join(said) for words in ("digits", "too long to be written", "9999"))
    assert max(map(len, said)) < 300
