"""The command of campaigns, and what is said of workers."""

import pytest
from printed import run_command
from reference_data import DATA

import jaxhb
from jaxhb import Disk, Shaft, Torque

pytest.importorskip("pyarrow")

STUDY = """
scene = "pair.toml"
rpm = "900:1500:4"
keep = ["shaft torque of a|b", "angle of a"]
[[change]]
name = "a|b.stiffness"
values = [6e3, 7e3]
"""


@pytest.fixture
def study(tmp_path):
    parts = [Disk(name="a", inertia=1.0), Disk(name="b", inertia=2.0)]
    parts += [Shaft(between=("a", "b"), stiffness=6.7e3, damping=4.0)]
    parts += [Torque(disk="a", harmonics=[(1.0, 5.0, 0.0)])]
    scene = jaxhb.elements_text(parts, name="pair", revolutions_per_cycle=1)
    (tmp_path / "pair.toml").write_text(scene)
    path = tmp_path / "shafts.toml"
    path.write_text(STUDY)
    return path


def test_a_campaign_tells_its_largest_values(study, run):
    completed = run(f"campaign {study} --out {study.parent / 'out'}", "json")
    completed.check_printed("campaign")
    record = completed.json
    assert record["cases"] == 8
    assert record["kinds"] == {"periodic": 8}
    largest = record["largest"]["shaft torque of a|b [N m]"]
    train = jaxhb.load_scene(study.parent / "pair.toml")
    speeds = [900.0, 1100.0, 1300.0, 1500.0]
    expected = max(
        float(torque)
        for stiffness in (6e3, 7e3)
        for torque in jaxhb.solve_speeds(
            train.replace({"a|b.stiffness": stiffness}), rpm=speeds
        )
        .torque("a", "b")
        .half_peak_to_peak
    )
    assert largest["value"] == pytest.approx(expected, rel=1e-9)


def test_cases_without_an_answer_are_told(study, run):
    scene = study.parent / "pair.toml"
    undamped = scene.read_text().replace("damping = 4.0", "")
    scene.write_text(undamped)
    train = jaxhb.load_scene(scene).replace({"a|b.stiffness": 6e3})
    resonance = 60 * float(jaxhb.natural_frequencies(train).frequencies_hz[-1])
    text = STUDY.replace('"900:1500:4"', f"[900, {resonance!r}]")
    study.write_text(text)
    completed = run(f"campaign {study} --out {study.parent / 'out'} --quiet", status=1)
    assert completed.err.startswith("1 case has no answer: the equations are singular")


FAULTS = {
    "--workers and --scheduler exclude each other": (
        "campaign STUDY --workers 2 --scheduler tcp://127.0.0.1:1"
    ),
    "'0' must be a whole number of at least 1": "campaign STUDY --workers 0",
    "there is no such file": "campaign nothing.toml",
    "--json: there is no folder": "campaign STUDY --json nowhere/a.json",
    "is read by this command and would be lost": "campaign STUDY --json STUDY",
}


@pytest.mark.parametrize("sentence", FAULTS)
def test_what_workers_cannot_do_is_told(study, run, sentence):
    line = FAULTS[sentence].replace("STUDY", str(study))
    assert sentence in run(line, status=2).err


@pytest.mark.slow
@pytest.mark.parametrize(
    "line",
    [
        "sweep spur_pair --rpm 1000:5000:9 --chunk 3",
        "sweep spur_pair --rpm 1000:5000:9 --chunk 3 --orbit",
        "sweep spur_pair --rpm 4600 --direction both"
        " --over 'gear a|gear b.stiffness=1.6e8:2.4e8:5'",
        "report spur_pair --rpm 1000,3000",
        f"tolerance {DATA / 'scenes' / 'toleranced_pair.toml'} --rpm 900,1200 --samples 8",
    ],
)
def test_workers_print_what_one_process_prints(tmp_path, line):
    alone = tmp_path / "alone"
    with_workers = tmp_path / "workers"
    alone.mkdir()
    with_workers.mkdir()
    expected = run_command(alone, line, "json")
    completed = run_command(with_workers, f"{line} --workers 2", "json")
    assert completed.out == expected.out
