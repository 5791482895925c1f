"""Every sentence that refuses a scene: each fault is told at once with all others, and
breeds no false one.
"""

import tomllib

import pytest
from reference_data import DATA, reference, refused, text_of

from jaxhb.elements.elements import Disk, Load, Shaft
from jaxhb.elements.excitations.crank_slider import Cylinder
from jaxhb.elements.excitations.torque import Torque
from jaxhb.elements.sentences import SceneError
from jaxhb.scene.files import load_scene, scene_description
from jaxhb.train.assembly import build

SOUND = text_of("three_disks.toml")
CYLINDER = (
    '[[load]]\ndisk = "c"\n[[cylinder]]\ndisk = "a"\nbore = 0.1\nstroke = 0.1\nrod ='
    " 0.2\n"
)
TABLE = [(float(a), 1e5) for a in range(0, 721, 10)]
AB = [
    Disk(name="a", inertia=1.0),
    Disk(name="b", inertia=1.0),
    Shaft(between=("a", "b"), stiffness=1e4),
]
FAULTY = tomllib.loads((DATA / "faulty_scenes.toml").read_text(encoding="utf-8"))


def load(tmp_path, text):
    path = tmp_path / "gears.toml"
    path.write_text(text, encoding="utf-8")
    return load_scene(path)


def refusal(tmp_path, text):
    """Sentences that a scene is refused with."""
    with pytest.raises(SceneError) as caught:
        load(tmp_path, text)
    sentences = caught.value.sentences
    assert all(sentence.startswith("gears.toml") for sentence in sentences)
    return sentences


@pytest.mark.parametrize("case", FAULTY)
def test_each_fault_of_a_scene_is_told_and_nothing_else(tmp_path, case):
    scene = FAULTY[case]
    text = scene["scene"] if "scene" in scene else SOUND + scene["added"]
    sentences = refusal(tmp_path, text)
    expected = scene["sentences"]
    assert len(sentences) == len(expected), sentences
    counts = [sum(part in sentence for sentence in sentences) for part in expected]
    assert counts == [1] * len(expected), sentences


def test_the_scene_that_faults_are_added_to_is_sound(tmp_path):
    load(tmp_path, SOUND)
    load(tmp_path, SOUND + CYLINDER + "pressure = [[0, 1e5], [720, 1e5]]\n")


@pytest.mark.parametrize(
    "span, good",
    [
        (200, False),
        (360, True),
        (350, True),
        (340, False),
        (720, True),
        (710, True),
        (700, False),
    ],
)
def test_a_pressure_table_covers_the_gas_cycle_but_for_one_step(span, good):
    table = [row for row in TABLE if row[0] <= span]
    parts = [
        *AB,
        Load(disk="b"),
        Cylinder(disk="a", bore=0.1, stroke=0.1, rod=0.2, pressure=table),
    ]
    if good:
        build(parts)
        return
    sentence = (
        f"pressure covers 0 to {span} deg, must cover a whole gas cycle of (36|72)0 deg"
    )
    with pytest.raises(SceneError, match=sentence):
        build(parts)


@pytest.mark.parametrize(
    "digits", ["9" * 400, "9" * 5000, "0x" + "f" * 5000], ids=["400", "5000", "hex"]
)
@pytest.mark.parametrize("place", reference("cases")["places of integers"])
def test_an_integer_too_large_for_a_double_is_a_sentence(tmp_path, digits, place):
    disks = "[[disk]]\nname = 'a'\ninertia = 1\n[[disk]]\nname = 'b'\ninertia = 1\n"
    sentences = refusal(tmp_path, disks + place.format(digits))
    text = "\n".join(sentences)
    alternatives = ("digits", "too long to be written", "9999")
    assert any(words in text for words in alternatives)
    assert max(map(len, sentences)) < 300


@pytest.mark.parametrize("content, sentence", reference("cases")["tables of pressures"])
def test_sentence_on_a_csv(tmp_path, content, sentence):
    (tmp_path / "p.csv").write_text(content)
    sentences = refusal(tmp_path, SOUND + CYLINDER + "pressure = 'p.csv'")
    assert sentence in "\n".join(sentences)


def test_a_csv_stands_for_its_rows(tmp_path):
    (tmp_path / "p.csv").write_text("# angle; Pa\n0; 1e5\n\n720; 3e5\n")
    from_file = load(tmp_path, SOUND + CYLINDER + "pressure = 'p.csv'")
    from_rows = load(tmp_path, SOUND + CYLINDER + "pressure = [[0, 1e5], [720, 3e5]]")
    assert (from_file.cylinders.pressure == from_rows.cylinders.pressure).all()


def test_a_faulty_table_that_all_cylinders_name_is_told_once(tmp_path):
    (tmp_path / "p.csv").write_text("0; 1e5\nx; 2e5\n")
    cylinders = [CYLINDER.replace('"a"', f'"{disk}"') for disk in "ab"]
    parts = [f"{cylinder}pressure = 'p.csv'\n" for cylinder in cylinders]
    scene = SOUND + "".join(parts)
    sentences = refusal(tmp_path, scene.replace('[[load]]\ndisk = "c"\n', "", 1))
    assert [text for text in sentences if "p.csv" in text] == [
        "gears.toml, [[cylinder]] no. 1: pressure: p.csv, line 2 is 'x; 2e5', must be 2"
        " numbers angle, pressure, separated by semicolons. Correct it or put #"
        " before it."
    ]


def test_a_syntax_error_names_file_and_line(tmp_path):
    with pytest.raises(
        SceneError,
        match=r"gears.toml: invalid TOML: .*line 2.*Correct the line 'name = = 3'\.$",
    ):
        load(tmp_path, "[scene]\nname = = 3\n")
    comma = (
        r"Correct the line 'inertia = 0,3  # kg m2': decimals take a point, not a"
        r" comma\.$"
    )
    with pytest.raises(SceneError, match=comma):
        load(tmp_path, "[[disk]]\nname = 'a'\ninertia = 0,3  # kg m2\n")


def test_unknown_scenes_and_files_are_named():
    advice = "there is no packaged scene 'gear_trian_30'. Did you mean 'gear_train_30'?"
    with pytest.raises(SceneError, match=advice):
        load_scene("gear_trian_30")
    refused(
        lambda: scene_description("nowhere.toml"), "nowhere.toml: there is no such file"
    )


def test_a_byte_order_mark_is_no_fault(tmp_path):
    """Spreadsheets and editors that save UTF-8 write it."""
    (tmp_path / "h.csv").write_text("1.0, 2.0, 3.0\n", encoding="utf-8-sig")
    table = '[[torque]]\ndisk = "a"\nharmonics = "h.csv"\n[[load]]\ndisk = "b"\n'
    (tmp_path / "gears.toml").write_text(SOUND + table, encoding="utf-8-sig")
    assert load_scene(tmp_path / "gears.toml").topology.torques.harmonics == ((2,),)


def test_what_is_no_element_is_told():
    refused(lambda: build([3]), "3 is no element of a drive train")


def test_scaled_means_that_balance_at_every_speed_are_no_fault():
    scale = [(100.0, 0.5), (200.0, 1.0)]
    parts = [
        Disk(name="a", inertia=1.0),
        Disk(name="b", inertia=1.0),
        Shaft(between=("a", "b"), stiffness=1.0),
        Torque(disk="a", mean=5.0, scale=scale),
        Torque(disk="b", mean=-5.0, scale=scale),
    ]
    build(parts)
