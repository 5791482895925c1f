"""Trains without gears, without shafts, without any link: every command, what loads and
grounds take.
"""

import numpy as np
import pytest

import jaxhb
from jaxhb.cli import commands
from jaxhb.report import compute
from jaxhb.report.compute import Asked, answer_one, answer_speeds
from jaxhb.report.figures.cycle import plot_cycle
from jaxhb.report.figures.figure import DIGITS
from jaxhb.report.figures.speeds import plot_sweep
from jaxhb.report.files.output import OutputError, write_files
from jaxhb.report.selection import hardest_shaft

DISK = """
disk = [{ name = "hub", inertia = 0.5, damping = 1.0 }]
ground = [{ name = "bed", disk = "hub", stiffness = 1000.0 }]
torque = [{ disk = "hub", mean = 500.0, harmonics = [[0.5, 20.0, 10.0], [1.0, 30.0, -5.0]] }]
"""
DAMPER = (
    'damper = [{ name = "ring", disk = "hub", inertia = 0.1, stiffness = 9e4, damping ='
    " 30.0 }]\n"
)
LOAD = 'load = [{ name = "pump", disk = "hub" }]\n'
SPEEDS = {"solve": "1000", "sweep": "1000:1500:3", "report": "1000,1500"}


@pytest.fixture
def scene(tmp_path):
    """Writes a scene of the given parts; its path."""

    def written(*parts):
        file = tmp_path / "scene.toml"
        file.write_text(
            "".join(parts) + 'scene = { name = "hub", revolutions_per_cycle = 2 }'
        )
        return file

    return written


@pytest.mark.parametrize("command", SPEEDS)
def test_a_train_of_a_disk_and_a_damper_works_in_every_command(command, scene, run):
    called = run(
        f"{command} {scene(DISK, DAMPER)} --rpm {SPEEDS[command]}", "json", "plot"
    )
    assert (called.status, called.err) == (0, "") and "ring" in called.out
    assert called.is_drawn and called.json
    if command != "report":
        assert "periodic" in called.out and "contact" not in called.out
        # One word for one thing: files say it too.
        answers = called.json["responses"] if command == "sweep" else [called.json]
        assert {answer["motion"]["kind"] for answer in answers} == {"periodic"}


@pytest.mark.parametrize("command", SPEEDS)
def test_a_train_of_one_disk_is_told_by_its_angle_and_has_no_picture(
    command, scene, run, tmp_path
):
    call = f"{command} {scene(DISK)} --rpm {SPEEDS[command]}"
    called = run(call, "json", "plot")
    assert called.status == 2 and "no torque to draw" in called.err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]
    called = run(call)
    assert called.status == 0 and " deg" in called.out and "hub" in called.out


def test_the_hardest_shaft_may_be_a_damper(scene):
    train = jaxhb.load_scene(scene(DISK, DAMPER))
    answer = answer_one(train, 1000.0, Asked())
    sweep = answer_speeds(train, [1000.0, 1500.0], Asked())
    name = train.topology.damper_names[0]
    assert hardest_shaft([answer]) == hardest_shaft(sweep["up"]) == name
    torque = plot_cycle(answer).axes[0].get_lines()[0].get_ydata()
    assert torque.max() == pytest.approx(
        float(jaxhb.solve(train, rpm=1000.0).torque(name).max), rel=1e-3
    )
    swing = plot_sweep(sweep).axes[0].get_lines()[0].get_ydata()
    solved = jaxhb.solve_speeds(train, rpm=[1000.0, 1500.0])
    assert swing == pytest.approx(
        np.asarray(solved.torque(name).half_peak_to_peak), rel=0.5 * 10 ** (1 - DIGITS)
    )


def test_a_ground_in_place_of_a_load_is_reported_and_noted(scene, run):
    called = run(f"solve {scene(DISK, DAMPER)} --rpm 1000", "json")
    record = called.json
    assert record["ground_reaction_Nm"] == {"bed": pytest.approx(500.0)}
    assert record["disks"]["hub"]["mean"] == pytest.approx(0.5)
    assert record["load_torque_Nm"] == {}
    assert record["mean_angles"] == "set by the ground 'bed'"
    assert (
        "ground: bed takes 500 N m; mean angles: set by the ground 'bed'"
        in called.words
    )
    (note,) = record["notes"]
    assert note.startswith("The ground 'bed' takes 500 N m") and note.endswith(
        "is a [[load]] missing?"
    )
    assert note in called.words


def test_with_a_load_the_ground_takes_nothing(scene, run):
    called = run(f"sweep {scene(DISK, DAMPER, LOAD)} --rpm 1000:1500:3", "json", "csv")
    record = called.json["responses"][0]
    assert record["ground_reaction_Nm"]["bed"] == pytest.approx(0.0, abs=1e-6)
    assert record["load_torque_Nm"] == {"pump": pytest.approx(-500.0)}
    assert record["load_kW"] == pytest.approx(500.0 * 2 * np.pi * 1000 / 60 / 1e3)
    assert record["notes"] == []
    assert [float(row["pump load torque N m"]) for row in called.rows] == pytest.approx(
        [-500.0] * 3
    )
    assert float(called.rows[0]["bed ground reaction N m"]) == pytest.approx(
        0.0, abs=1e-6
    )


def test_a_sweep_without_backlash_is_solved_once_and_tells_the_progress_how_many_speeds_are_done(
    scene, run, monkeypatch
):
    calls, made, solve_speeds = [], [], compute.solve_speeds

    class Kept(commands.Progress):
        def __init__(self, *arguments, **given):
            super().__init__(*arguments, **given)
            made.append(self)

    monkeypatch.setattr(commands, "Progress", Kept)
    monkeypatch.setattr(
        compute,
        "solve_speeds",
        lambda *a, **k: calls.append(a) or solve_speeds(*a, **k),
    )
    assert run(f"sweep {scene(DISK, DAMPER)} --rpm 1000:1500:3").status == 0
    assert len(calls) == 1 and (made[0].done, made[0].total) == (3, 3)


def test_a_picture_that_cannot_be_drawn_leaves_no_file(
    scene, monkeypatch, run, tmp_path
):
    def refuse(*_):
        raise OutputError("no picture today")

    monkeypatch.setattr("jaxhb.cli.commands.plot_cycle", refuse)
    called = run(f"solve {scene(DISK, DAMPER)} --rpm 1000", "json", "plot")
    assert (called.status, called.out, called.err) == (2, "", "no picture today\n")
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def test_files_are_written_all_or_none(tmp_path):
    def failing():
        yield b"begun"
        raise ValueError("half way")

    with pytest.raises(ValueError, match="half way"):
        write_files({str(tmp_path / "a"): [b"whole"], str(tmp_path / "b"): failing()})
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OutputError, match="cannot be written"):
        write_files(
            {str(tmp_path / "a"): [b"whole"], str(tmp_path / "nowhere" / "b"): [b""]}
        )
    assert list(tmp_path.iterdir()) == []
    write_files({str(tmp_path / "a"): [b"who", b"le"]})
    assert (tmp_path / "a").read_bytes() == b"whole"


def test_an_error_of_the_program_is_neither_not_converged_nor_bad_input(
    scene, monkeypatch, run
):
    monkeypatch.setattr(compute, "steady_state", lambda *_, **__: {}["gone"])
    called = run(f"solve {scene(DISK)} --rpm 1000")
    assert called.status == 3 and "KeyError: 'gone'" in called.err
