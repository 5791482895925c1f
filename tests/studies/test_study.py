"""Studies: all combinations, each case once; and every fault of a file in a sentence."""

import numpy as np
import pytest

import jaxhb
from jaxhb.elements.sentences import SceneError
from jaxhb.studies.study import load_study

CATALOGUE = """
scene = ["six_cylinder_diesel", "engine_with_damper"]
rpm = "900:2100:7"
keep = ["shaft torque of cyl6|flywheel", "shaft torque order 3 of cyl6|flywheel"]
misfires = ["", "cylinder 3"]
part = 3
answers = "forced"
[[change]]
name = "flywheel.inertia"
values = "1.0:2.0:5"
[[change]]
names = ["cyl6|flywheel.stiffness", "cyl6|flywheel.damping"]
rows = "shafts.csv"
"""
SHAFTS = "cyl6|flywheel.stiffness;cyl6|flywheel.damping\n1.9e6;50\n2.1e6;60\n"


@pytest.fixture
def file(tmp_path):
    (tmp_path / "shafts.csv").write_text(SHAFTS)
    path = tmp_path / "catalogue.toml"
    path.write_text(CATALOGUE)
    return path


def pieces_of(study):
    return [piece for number in range(study.parts) for piece in study.pieces_of(number)]


@pytest.mark.parametrize("part", [1, 3, 7, 20, 1000])
def test_every_combination_is_computed_once(file, part):
    file.write_text(CATALOGUE.replace("part = 3", f"part = {part}"))
    study = load_study(file)
    assert study.designs == 2 * 2 * 5 * 2
    assert study.cases == 7 * study.designs
    cases = []
    designs = set()
    for piece in pieces_of(study):
        cases += range(piece.case, piece.case + len(piece.rpm))
        variant = piece.variant
        designs.add((variant.scene, variant.misfire, *piece.values.items()))
        first = piece.case % 7
        assert piece.rpm.tolist() == study.rpm[first : first + part].tolist()
    assert sorted(cases) == list(range(study.cases))
    assert len(designs) == study.designs
    sizes = [
        sum(len(piece.rpm) for piece in study.pieces_of(number))
        for number in range(study.parts)
    ]
    assert sizes == [study.cases_of(number) for number in range(study.parts)]
    # As large as is asked for, and no larger.
    assert max(sizes) == min(part if part < 7 else part // 7 * 7, study.cases)


def test_numbers_of_a_row_change_together(file):
    study = load_study(file)
    assert study.numbers == [
        "flywheel.inertia",
        "cyl6|flywheel.stiffness",
        "cyl6|flywheel.damping",
    ]
    pairs = {
        (
            piece.values["cyl6|flywheel.stiffness"],
            piece.values["cyl6|flywheel.damping"],
        )
        for piece in pieces_of(study)
    }
    assert pairs == {(1.9e6, 50.0), (2.1e6, 60.0)}
    inertias = {piece.values["flywheel.inertia"] for piece in pieces_of(study)}
    np.testing.assert_allclose(sorted(inertias), np.linspace(1, 2, 5), rtol=1e-15)


def test_each_misfire_and_all_scenarios_are_there_with_the_scene_as_written(tmp_path):
    scene = jaxhb.load_scene("six_cylinder_diesel")
    path = tmp_path / "study.toml"
    path.write_text(
        'scene = "six_cylinder_diesel"\nrpm = [1800]\nmisfires = "each"\n'
        'scenarios = "all"\nkeep = ["shaft torque of cyl6|flywheel"]\n'
    )
    study = load_study(path)
    misfires = [variant.misfire for variant in study.variants]
    scenarios = ["", *scene.scenarios]
    assert misfires == ["", *scene.topology.firing_cylinders] * len(scenarios)


FAULTS = {
    "unknown key 'scenes'. Did you mean 'scene'?": ("scene = [", "scenes = ["),
    "the key 'scene' is missing: give the name of a scene": ("scene = [", "#"),
    "there is no packaged scene 'six_cylinder_disel'": ("_diesel", "_disel"),
    "rpm: '900:2100' is not A:B:COUNT": ("900:2100:7", "900:2100"),
    "rpm: the speed is '-3', must be a number greater than 0": (
        '"900:2100:7"',
        "[900, -3]",
    ),
    "keep: 'shaft torc of cyl6|flywheel': write": ("shaft torque of", "shaft torc of"),
    "there is no shaft or damper 'cyl7|flywheel'": (
        "shaft torque of cyl6",
        "shaft torque of cyl7",
    ),
    "answers is 'linear', must be 'steady', 'orbit' or 'forced'": (
        '"forced"',
        '"linear"',
    ),
    "misfires is 'all', must be a list of cylinders": ('["", "cylinder 3"]', '"all"'),
    "there is no cylinder 'cylinder 9'": ("cylinder 3", "cylinder 9"),
    "part is 0, must be a whole number of at least 1": ("part = 3", "part = 0"),
    "samples is 1.5, must be a whole number": ("part = 3", "samples = 1.5"),
    "the scene has no [tolerance] table": ("part = 3", "samples = 2"),
    "tolerance is 2, must be a number greater than 0": ("part = 3", "tolerance = 2"),
    "[[change]] no. 1: unknown key 'value'. Did you mean 'values'?": (
        'values = "1.0',
        'value = "1.0',
    ),
    "[[change]] no. 1: give values, a list of numbers or A:B:COUNT": (
        '"1.0:2.0:5"',
        '["a"]',
    ),
    "is not NAME.FIELD=A:B:COUNT": ("1.0:2.0:5", "1.0:2.0"),
    "[[change]] no. 2: shafts.cvs: there is no such file": (
        "shafts.csv",
        "shafts.cvs",
    ),
    "there is no element 'flywheels'": ("flywheel.inertia", "flywheels.inertia"),
    "inertia is -1": ("1.0:2.0:5", "-1.0:2.0:2"),
    "cases: ask for 100000000 at most": ("part = 3", "part = 3\nseed = 1"),
}


@pytest.mark.parametrize("sentence", FAULTS)
def test_a_fault_of_a_study_is_told(file, sentence):
    text, wrong = FAULTS[sentence]
    content = CATALOGUE.replace(text, wrong, 1)
    if "cases: ask" in sentence:
        content = content.replace(":7", ":99999").replace(":5", ":99999")
    file.write_text(content)
    with pytest.raises(SceneError) as error:
        load_study(file)
    assert sentence in "\n".join(error.value.sentences)


def test_all_faults_are_told_at_once(file):
    file.write_text(
        CATALOGUE.replace("part = 3", "part = -3").replace("order 3", "order x")
    )
    with pytest.raises(SceneError) as error:
        load_study(file)
    assert len(error.value.sentences) >= 2


def test_a_file_that_is_no_study_is_told(tmp_path):
    with pytest.raises(SceneError, match="there is no such file"):
        load_study(tmp_path / "nothing.toml")
    (tmp_path / "wrong.toml").write_text("scene = ")
    with pytest.raises(SceneError, match=r"wrong.toml: invalid TOML"):
        load_study(tmp_path / "wrong.toml")
