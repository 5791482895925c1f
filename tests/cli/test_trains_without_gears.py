"""Trains without gears, without shafts, without any link: every command, what loads and grounds take, and doctests."""

import csv
import dataclasses
import json

import numpy as np
import pytest

import jaxhb
from jaxhb.cli import sweeps
from jaxhb.cli.main import main
from jaxhb.report import compute
from jaxhb.report.compute import Asked, answer_one, answer_speeds
from jaxhb.report.figures.cycle import plot_cycle
from jaxhb.report.figures.figure import DIGITS
from jaxhb.report.figures.sweep import plot_sweep
from jaxhb.report.files.output import OutputError, write_files
from jaxhb.report.selection import hardest_shaft
from jaxhb.report.text.mean_torques import balance_line, ground_notes, mean_angles_of

DISK = """
[[disk]]
name = "hub"
inertia = 0.5
damping = 1.0
[[ground]]
name = "bed"
disk = "hub"
stiffness = 1000.0
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
    """Writes a scene of the given parts; its path."""

    def written(*parts):
        file = tmp_path / "scene.toml"
        file.write_text('[scene]\nname = "hub"\nrevolutions_per_cycle = 2\n' + "".join(parts), encoding="utf-8")
        return str(file)

    return written


@pytest.mark.parametrize("command", SPEEDS)
def test_a_train_of_a_disk_and_a_damper_works_in_every_command(command, scene, capsys, tmp_path):
    files = [str(tmp_path / "r.json"), str(tmp_path / "r.png")]
    options = ["--json", files[0], "--plot", files[1]]
    assert main([command, scene(DISK, DAMPER), "--rpm", SPEEDS[command], *options]) == 0
    said = capsys.readouterr()
    assert "ring" in said.out
    assert said.err == ""
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "r.json").stat().st_size


@pytest.mark.parametrize("command", SPEEDS)
def test_a_train_of_one_disk_is_told_by_its_angle_and_has_no_picture(command, scene, capsys, tmp_path):
    call = [command, scene(DISK), "--rpm", SPEEDS[command], "--json", str(tmp_path / "r.json")]
    assert main([*call, "--plot", str(tmp_path / "r.png")]) == 2
    assert "no torque to draw" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]
    assert main(call) == 0
    said = capsys.readouterr().out
    assert " deg" in said and "hub" in said


def test_the_motion_of_a_train_without_teeth_is_periodic_in_every_command(scene, capsys):
    for command in ("solve", "sweep"):
        assert main([command, scene(DISK, DAMPER), "--rpm", SPEEDS[command]]) == 0
        told = capsys.readouterr().out
        assert "periodic" in told and "contact" not in told


def test_a_long_chain_without_gears_is_stable(tmp_path, capsys):
    disks = range(102)
    parts = [jaxhb.Disk(name=f"d{i}", inertia=0.01, damping=0.1) for i in disks]
    parts += [jaxhb.Shaft(between=(f"d{i}", f"d{i + 1}"), stiffness=1e5, damping=1.0) for i in disks[:-1]]
    parts += [jaxhb.Torque(disk="d0", harmonics=[(1.0, 10.0, 0.0)])]
    scene = tmp_path / "chain.toml"
    scene.write_text(jaxhb.elements_text(parts, name="chain", revolutions_per_cycle=1))
    assert main(["solve", str(scene), "--rpm", "500"]) == 0
    # All disks and shafts lose energy in proportion: the slowest mode does at half of damping over inertia, 5 1/s.
    assert f"stable: a disturbance falls to {np.exp(-5.0 * 60 / 500):.2g} of its size" in capsys.readouterr().out


def test_the_hardest_shaft_may_be_a_damper(scene):
    train = jaxhb.load_scene(scene(DISK, DAMPER))
    answer, sweep = answer_one(train, 1000.0, Asked()), answer_speeds(train, [1000.0, 1500.0], Asked())
    name = train.topology.damper_names[0]
    assert hardest_shaft([answer]) == hardest_shaft(sweep["up"]) == name
    torque = plot_cycle(answer).axes[0].get_lines()[0].get_ydata()
    assert torque.max() == pytest.approx(float(jaxhb.solve(train, rpm=1000.0).torque(name).max), rel=1e-3)
    swing = plot_sweep(sweep).axes[0].get_lines()[0].get_ydata()
    solved = jaxhb.solve_speeds(train, rpm=[1000.0, 1500.0])
    assert swing == pytest.approx(np.asarray(solved.torque(name).half_peak_to_peak), rel=0.5 * 10 ** (1 - DIGITS))


def test_a_ground_in_place_of_a_load_is_reported_and_noted(scene, capsys, tmp_path):
    file = tmp_path / "r.json"
    assert main(["solve", scene(DISK, DAMPER), "--rpm", "1000", "--json", str(file)]) == 0
    record, said = json.loads(file.read_text()), " ".join(capsys.readouterr().out.split())
    assert record["ground_reaction_Nm"] == {"bed": pytest.approx(500.0)}
    assert record["disks"]["hub"]["mean"] == pytest.approx(0.5)
    assert record["load_torque_Nm"] == {}
    assert record["mean_angles"] == "set by the ground 'bed'"
    assert "ground: bed takes 500 N m; mean angles: set by the ground 'bed'" in said
    (note,) = record["notes"]
    assert note.startswith("The ground 'bed' takes 500 N m") and note.endswith("is a [[load]] missing?")
    assert note in said


def test_with_a_load_the_ground_takes_nothing(scene, capsys, tmp_path):
    file = tmp_path / "r.json"
    assert main(["solve", scene(DISK, DAMPER, LOAD), "--rpm", "1000", "--json", str(file)]) == 0
    record = json.loads(file.read_text())
    assert record["ground_reaction_Nm"]["bed"] == pytest.approx(0.0, abs=1e-6)
    assert record["load_torque_Nm"] == {"pump": pytest.approx(-500.0)}
    assert record["load_kW"] == pytest.approx(500.0 * 2 * np.pi * 1000 / 60 / 1e3)
    assert record["notes"] == []
    assert "load: pump takes 500 N m, 52.36 kW in all; ground: bed takes 0 N m" in capsys.readouterr().out


def test_torques_that_cancel_leave_no_note_on_the_ground(scene):
    train = jaxhb.load_scene(scene(DISK, '[[torque]]\nname = "brake"\ndisk = "hub"\nmean = -500.0\n'))
    response = jaxhb.solve(train, rpm=1000.0)
    rounded = dataclasses.replace(response, ground_reaction=response.ground_reaction + 1e-13)
    assert ground_notes([rounded], lambda *_: "") == []
    assert balance_line(rounded) == "ground: bed takes 0 N m"


def test_the_note_on_a_ground_is_for_the_speed_at_which_it_takes_most(scene):
    train = jaxhb.load_scene(scene(DISK))
    weaker = train.replace({"hub:torque.mean": 100.0})
    responses = [jaxhb.solve(weaker, rpm=900.0), jaxhb.solve(train, rpm=1000.0)]
    (note,) = ground_notes(responses, lambda all_of, i: f" at {float(all_of[i].rpm):g} rpm")
    assert "500 N m at 1000 rpm" in note


def test_a_ground_beside_a_load_is_noted_above_one_per_cent_only(scene):
    response = jaxhb.solve(jaxhb.load_scene(scene(DISK, LOAD)), rpm=1000.0)
    for share, noted in ((0.005, 0), (0.02, 1)):
        moved = dataclasses.replace(response, ground_reaction=response.ground_reaction + share * 500.0)
        assert len(ground_notes([moved], lambda *_: "")) == noted


def test_without_a_ground_the_mean_angles_are_weighted_by_inertia():
    response = jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=2000.0)
    assert mean_angles_of(response.topology) == "no ground: the inertia-weighted mean is zero"
    assert balance_line(response) == ""


def test_a_sweep_writes_loads_and_grounds_in_its_rows(scene, tmp_path):
    file = tmp_path / "s.csv"
    assert main(["sweep", scene(DISK, LOAD), "--rpm", "1000:1500:2", "--csv", str(file)]) == 0
    with file.open() as text:
        rows = list(csv.DictReader(text))
    assert [float(row["pump load torque N m"]) for row in rows] == pytest.approx([-500.0, -500.0])
    assert float(rows[0]["bed ground reaction N m"]) == pytest.approx(0.0, abs=1e-6)


def test_a_sweep_without_backlash_is_solved_once(scene, monkeypatch):
    calls, solve_speeds = [], compute.solve_speeds

    def counted(*train, **options):
        calls.append(options)
        return solve_speeds(*train, **options)

    monkeypatch.setattr(compute, "solve_speeds", counted)
    assert main(["sweep", scene(DISK, DAMPER), "--rpm", "1000:1500:3"]) == 0
    assert len(calls) == 1


def test_a_sweep_tells_the_progress_how_many_speeds_are_done(scene, monkeypatch):
    made = []

    class Kept(sweeps.Progress):
        def __init__(self, *arguments, **given):
            super().__init__(*arguments, **given)
            made.append(self)

    monkeypatch.setattr(sweeps, "Progress", Kept)
    assert main(["sweep", scene(DISK, DAMPER), "--rpm", "1000:1500:11"]) == 0
    assert (made[0].done, made[0].total) == (11, 11)


def test_a_picture_that_cannot_be_drawn_leaves_no_file(scene, monkeypatch, capsys, tmp_path):
    def refuse(*_):
        raise OutputError("no picture today")

    monkeypatch.setattr("jaxhb.report.figures.cycle.plot_cycle", refuse)
    files = ["--json", str(tmp_path / "r.json"), "--plot", str(tmp_path / "r.png")]
    assert main(["solve", scene(DISK, DAMPER), "--rpm", "1000", *files]) == 2
    said = capsys.readouterr()
    assert said.err == "no picture today\n" and said.out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def test_files_are_written_all_or_none(tmp_path):
    def failing():
        yield b"begun"
        raise ValueError("half way")

    with pytest.raises(ValueError, match="half way"):
        write_files({str(tmp_path / "a"): [b"whole"], str(tmp_path / "b"): failing()})
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OutputError, match="cannot be written"):
        write_files({str(tmp_path / "a"): [b"whole"], str(tmp_path / "nowhere" / "b"): [b""]})
    assert list(tmp_path.iterdir()) == []
    write_files({str(tmp_path / "a"): [b"who", b"le"]})
    assert (tmp_path / "a").read_bytes() == b"whole"


def test_an_error_of_the_program_is_neither_not_converged_nor_bad_input(scene, monkeypatch, capsys):
    monkeypatch.setattr(compute, "steady_state", lambda *_, **__: {}["gone"])
    assert main(["solve", scene(DISK), "--rpm", "1000"]) == 3
    assert "KeyError: 'gone'" in capsys.readouterr().err


def test_a_train_thrown_out_of_balance_by_set_exits_1_and_the_help_says_so(capsys):
    for rpm in ("2000", "5000"):  # in contact and hammering
        assert main(["solve", "spur_pair", "--rpm", rpm, "--set", "drive.mean=70"]) == 1
        assert "the mean torques do not balance" in capsys.readouterr().err
    main(["solve", "--help"])
    assert "If --set unbalances a scene" in " ".join(capsys.readouterr().out.split())
