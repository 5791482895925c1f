"""Trains without gears, without shafts, without any link: every command, what loads and
grounds take.
"""

import numpy as np
import pytest

import jaxhb
from jaxhb.cli import commands
from jaxhb.report import compute
from jaxhb.report.answer import Case
from jaxhb.report.compute import Asked, answer_one, answer_speeds
from jaxhb.report.figures.cycle import plot_cycle
from jaxhb.report.figures.figure import DIGITS
from jaxhb.report.figures.speeds import plot_sweep
from jaxhb.report.files.output import OutputError, write_files
from jaxhb.report.selection import hardest_shaft
from jaxhb.report.text.cases import speed_tables

DISK = """
disk = [{ name = "hub", inertia = 0.5, damping = 1.0 }]
ground = [{ name = "bed", disk = "hub", stiffness = 1000.0 }]

[[torque]]
disk = "hub"
mean = 500.0
harmonics = [[0.5, 20.0, 10.0], [1.0, 30.0, -5.0]]
"""
DAMPER = """
[[damper]]
name = "ring"
disk = "hub"
inertia = 0.1
stiffness = 9e4
damping = 30.0
"""
LOAD = """
[[load]]
name = "pump"
disk = "hub"
"""
SPEEDS = {"solve": "1000", "sweep": "1000:1500:3", "report": "1000,1500"}


@pytest.fixture
def scene(tmp_path):
    """Writes a scene of parts; its path."""

    def write(*parts):
        file = tmp_path / "scene.toml"
        text = '[scene]\nname = "hub"\nrevolutions_per_cycle = 2\n'
        file.write_text("".join(parts) + text)
        return file

    return write


@pytest.mark.parametrize("command", SPEEDS)
def test_a_train_of_a_disk_and_a_damper_works_in_every_command(command, scene, run):
    line = f"{command} {scene(DISK, DAMPER)} --rpm {SPEEDS[command]}"
    completed = run(line, "json", "plot")
    completed.check_printed(f"{command}_disk_and_damper")
    assert completed.json


def test_a_train_without_teeth_has_no_columns_with_and_without_backlash(scene):
    train = jaxhb.load_scene(scene(DISK, DAMPER, "stages = [[0.5, 1e5]]\n"))
    answer = answer_one(train, 1000.0, Asked())
    tables = speed_tables([Case("as it is", [answer])], 0)
    assert tables[0].heads == ["shaft", "N m"]


@pytest.mark.parametrize("command", ["solve", "sweep"])
def test_a_motion_without_teeth_is_called_periodic_in_files_too(command, scene, run):
    line = f"{command} {scene(DISK, DAMPER)} --rpm {SPEEDS[command]}"
    record = run(line, "json").json
    records = record["responses"] if command == "sweep" else [record]
    assert {record["motion"]["kind"] for record in records} == {"periodic"}


@pytest.mark.parametrize("command", SPEEDS)
def test_a_train_of_one_disk_is_told_by_its_angle_and_has_no_picture(
    command, scene, run, tmp_path
):
    line = f"{command} {scene(DISK)} --rpm {SPEEDS[command]}"
    assert "no torque to draw" in run(line, "json", "plot", status=2).err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]
    run(line).check_printed(f"{command}_disk")


def test_the_hardest_shaft_may_be_a_damper(scene):
    train = jaxhb.load_scene(scene(DISK, DAMPER))
    answer = answer_one(train, 1000.0, Asked())
    sweep = answer_speeds(train, [1000.0, 1500.0], Asked())
    name = train.topology.damper_names[0]
    assert hardest_shaft([answer]) == hardest_shaft(sweep["up"]) == name
    torque = plot_cycle(answer).axes[0].get_lines()[0].get_ydata()
    largest = float(jaxhb.solve(train, rpm=1000.0).torque(name).max)
    assert torque.max() == pytest.approx(largest, rel=1e-3)
    swing = plot_sweep(sweep).axes[0].get_lines()[0].get_ydata()
    responses = jaxhb.solve_speeds(train, rpm=[1000.0, 1500.0])
    expected = np.asarray(responses.torque(name).half_peak_to_peak)
    np.testing.assert_allclose(swing, expected, rtol=0.5 * 10 ** (1 - DIGITS))


def test_a_ground_in_place_of_a_load_is_reported_and_noted(scene, run):
    completed = run(f"solve {scene(DISK, DAMPER)} --rpm 1000", "json")
    record = completed.json
    assert record == record | {
        "ground_reaction_Nm": {"bed": pytest.approx(500.0)},
        "load_torque_Nm": {},
        "mean_angles": "set by the ground 'bed'",
    }
    assert record["disks"]["hub"]["mean"] == pytest.approx(0.5)
    (note,) = record["notes"]
    assert note.startswith("The ground 'bed' takes 500 N m")
    assert note.endswith("is a [[load]] missing?")
    assert note in completed.words


def test_with_a_load_the_ground_takes_nothing(scene, run):
    line = f"sweep {scene(DISK, DAMPER, LOAD)} --rpm 1000:1500:3"
    completed = run(line, "json", "csv")
    record = completed.json["responses"][0]
    assert record == record | {
        "ground_reaction_Nm": {"bed": pytest.approx(0.0, abs=1e-6)},
        "load_torque_Nm": {"pump": pytest.approx(-500.0)},
        "load_kW": pytest.approx(500.0 * 2 * np.pi * 1000 / 60 / 1e3),
        "notes": [],
    }
    rows = completed.rows
    torques = [float(row["pump load torque N m"]) for row in rows]
    assert torques == pytest.approx([-500.0] * 3)
    assert float(rows[0]["bed ground reaction N m"]) == pytest.approx(0.0, abs=1e-6)


def test_a_sweep_without_backlash_is_solved_once_and_tells_how_many_speeds_are_done(
    scene, run, monkeypatch
):
    calls = []
    reported = []
    solve_speeds = compute.solve_speeds

    class Recorded(commands.Progress):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            reported.append(self)

    def counted(*arguments, **options):
        calls.append(arguments)
        return solve_speeds(*arguments, **options)

    monkeypatch.setattr(commands, "Progress", Recorded)
    monkeypatch.setattr(compute, "solve_speeds", counted)
    run(f"sweep {scene(DISK, DAMPER)} --rpm 1000:1500:3")
    assert len(calls) == 1
    assert (reported[0].done, reported[0].total) == (3, 3)


def test_a_picture_that_cannot_be_drawn_leaves_no_file(
    scene, monkeypatch, run, tmp_path
):
    def refuse(*_):
        raise OutputError("no picture today")

    monkeypatch.setattr("jaxhb.cli.commands.plot_cycle", refuse)
    completed = run(f"solve {scene(DISK, DAMPER)} --rpm 1000", "json", "plot", status=2)
    assert (completed.out, completed.err) == ("", "no picture today\n")
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def test_files_are_written_all_or_none(tmp_path):
    def failing():
        yield b"begun"
        raise ValueError("half way")

    first = str(tmp_path / "a")
    with pytest.raises(ValueError, match="half way"):
        write_files({first: [b"whole"], str(tmp_path / "b"): failing()})
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OutputError, match="cannot be written"):
        write_files({first: [b"whole"], str(tmp_path / "nowhere" / "b"): [b""]})
    assert list(tmp_path.iterdir()) == []
    write_files({first: [b"who", b"le"]})
    assert (tmp_path / "a").read_bytes() == b"whole"


def test_an_error_of_the_program_is_neither_not_converged_nor_bad_input(
    scene, monkeypatch, run
):
    monkeypatch.setattr(compute, "steady_state", lambda *_, **__: {}["gone"])
    assert "KeyError: 'gone'" in run(f"solve {scene(DISK)} --rpm 1000", status=3).err
