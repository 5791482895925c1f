"""The command line as such: what is refused in a sentence, and what --help shows."""

import importlib.util

import pytest

import jaxhb
from jaxhb.cli.main import main


def test_scenes_lists_every_packaged_scene(capsys):
    assert main(["scenes"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in said] == jaxhb.scene_names()


BAD = {
    "an unknown scene": (["solve", "gear_train", "--rpm", "1"], "Did you mean 'gear_train_30'?"),
    "a missing file": (["solve", "no.toml", "--rpm", "1"], "there is no such file"),
    "speed zero": (["solve", "spur_pair", "--rpm", "0"], "greater than 0 rpm"),
    "a negative speed": (["solve", "spur_pair", "--rpm", "-3"], "greater than 0 rpm"),
    "no number": (["solve", "spur_pair", "--rpm", "fast"], "must be a number greater than 0 rpm"),
    "an infinite speed": (["solve", "spur_pair", "--rpm", "inf"], "must be a number greater than 0 rpm"),
    "a speed beyond any train": (
        ["solve", "spur_pair", "--rpm", "1e9"],
        "the speed is '1e9', must be at most 1000000 rpm: give revolutions per minute.",
    ),
    "a sweep beyond any train": (["sweep", "spur_pair", "--rpm", "1e5:2e6:3"], "the speed is '2e6', must be at most"),
    "orders beyond any train": (["forced", "spur_pair", "--rpm", "900,1e7"], "the speed is '1e7', must be at most"),
    "a report beyond any train": (["report", "spur_pair", "--rpm", "1e6,1000001"], "'1000001', must be at most"),
    "half a range": (["sweep", "spur_pair", "--rpm", "600:2450"], "A:B:COUNT"),
    "no speeds": (["sweep", "spur_pair", "--rpm", "600:2450:0"], "whole number of at least 1"),
    "one speed between two": (["sweep", "spur_pair", "--rpm", "600:2450:1"], "COUNT of at least 2"),
    "no speed given": (["solve", "spur_pair"], "--rpm"),
    "too few harmonics": (["solve", "gear_train_30", "--rpm", "9", "--harmonics", "5"], "ask for at least 24"),
    "half a harmonic": (["solve", "spur_pair", "--rpm", "9", "--harmonics", "2.5"], "whole number"),
    "a tolerance of 1": (["solve", "spur_pair", "--rpm", "9", "--tolerance", "1"], "less than 1"),
    "an unknown cylinder": (["solve", "gear_train_30", "--rpm", "9", "--misfire", "A1"], "there is no cylinder 'A1'"),
    "an unknown element": (["solve", "spur_pair", "--rpm", "9", "--set", "x.y=1"], "there is no element 'x'"),
    "a value that is none": (["solve", "spur_pair", "--rpm", "9", "--set", "gear a.inertia"], "NAME.FIELD=VALUE"),
    "a negative inertia": (["solve", "spur_pair", "--rpm", "9", "--set", "gear a.inertia=-1"], "-1"),
    "an unknown gear": (["solve", "spur_pair", "--rpm", "9", "--gear", "gear c"], "there is no disk 'gear c'"),
    "a disk without teeth": (["solve", "gear_train_30", "--rpm", "9", "--gear", "hub"], "carries no mesh"),
    "another speed to draw": (["report", "spur_pair", "--rpm", "9", "--at", "8"], "not one of the speeds"),
    "an unknown command": (["guess"], "No such command 'guess'. See jaxhb --help"),
    "no picture": (["solve", "spur_pair", "--rpm", "9", "--plot", "r.gif"], ".png"),
    "a folder that is no file": (["solve", "spur_pair", "--rpm", "9", "--csv", "."], "is a folder"),
    "an option of another command": (
        ["solve", "spur_pair", "--rpm", "9", "--chunk", "4"],
        "No such option '--chunk'. See jaxhb solve --help",
    ),
    "a misspelt option": (["solve", "spur_pair", "--rmp", "2000"], "No such option '--rmp'. Did you mean '--rpm'? See"),
    "a synonym": (["solve", "spur_pair", "--speed", "1500"], "No such option '--speed'. Did you mean '--rpm'? See"),
    "several speeds of a solve": (
        ["solve", "spur_pair", "--rpm", "1333,1600"],
        "'1333,1600' are 2 speeds, and this command takes one: jaxhb sweep and jaxhb report take several",
    ),
    "a range of a solve": (["solve", "spur_pair", "--rpm", "600:900:4"], "'600:900:4' are 4 speeds"),
    "modes at a speed": (["modes", "spur_pair", "--rpm", "1500"], "do not depend on the speed; --at R takes the teeth"),
    "a unit": (
        ["solve", "spur_pair", "--rpm", "9", "--set", "gear a|gear b.stiffness=36kN"],
        "36kN is no number; values are numbers in SI units, as 3.6e4",
    ),
    "a misspelt command": (["sovle", "spur_pair"], "No such command 'sovle'. Did you mean 'solve'? See"),
    "a word too many": (["solve", "spur_pair", "3000", "--rpm", "9"], "unexpected extra argument (3000)"),
    "no scene": (["solve", "--rpm", "9"], "jaxhb solve: Missing argument 'SCENE'. See jaxhb solve --help"),
    "no command": ([], "jaxhb: Missing command. See jaxhb --help"),
    "an option at the end without its value": (["solve", "spur_pair", "--rpm"], "'--rpm' requires an argument. See"),
    "an option for a value": (["sweep", "spur_pair", "--csv", "--quiet"], "Option '--csv' requires an argument. See"),
    "a value for a switch": (["solve", "spur_pair", "--orbit=1"], "jaxhb solve: Option '--orbit' does not take a"),
    "no choice": (["sweep", "spur_pair", "--rpm", "9", "--direction", "x"], "'x' is not one of 'up', 'down', 'both'"),
    "frequencies and modes": (["holzer", "spur_pair", "--hz", "1", "--mode", "1"], "--hz and --mode exclude each"),
    "an abbreviation": (["solve", "spur_pair", "--rpm", "9", "--har", "4"], "No such option '--har'."),
    "half a tooth": (["solve", "spur_pair", "--rpm", "9", "--set", "gear a.teeth=4.5"], "must be a whole number"),
    "an unknown law": (["solve", "spur_pair", "--rpm", "9", "--set", "gear a|gear b.law=x"], "Known: 'fridman2009'"),
    "a word for a number": (
        ["solve", "spur_pair", "--rpm", "9", "--set", "gear a.inertia=big"],
        "'big', must be finite",
    ),
    "one value": (["sweep", "spur_pair", "--rpm", "9", "--over", "gear a.inertia=1"], "A:B:COUNT"),
    "several speeds beside values": (
        ["sweep", "spur_pair", "--rpm", "8,9", "--over", "gear a.damping=1,2"],
        "one speed",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_exits_2_with_one_sentence_and_writes_nothing(case, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command, sentence = BAD[case]
    json_option = ["--json", "out.json"] if command[:1] in (["solve"], ["sweep"], ["report"]) else []
    assert main([*command[:1], *json_option, *command[1:]]) == 2
    said = capsys.readouterr()
    assert sentence in said.err
    assert len(said.err.splitlines()) == 1
    assert "Traceback" not in said.err
    assert said.out == ""
    assert list(tmp_path.iterdir()) == []


COMMANDS = [
    "new",
    "check",
    "scenes",
    "scene",
    "modes",
    "forced",
    "campbell",
    "holzer",
    "solve",
    "sweep",
    "report",
    "tune",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_shows_up_to_three_examples_of_its_own(command, capsys):
    assert main([command, "--help"]) == 0
    said = capsys.readouterr().out
    shown = [line.split()[1] for line in said[said.index("Examples:") :].splitlines() if "  jaxhb " in line]
    assert 1 <= len(shown) <= 3 and set(shown) == {command}
    assert "Exit status: 0" in said


def test_help_shows_examples_of_all_commands(capsys):
    assert main(["--help"]) == 0
    said = capsys.readouterr().out
    assert all(f"\n  jaxhb {command}" in said for command in COMMANDS)


def test_all_errors_of_a_scene_are_told_one_a_line(capsys, tmp_path):
    scene = tmp_path / "bad.toml"
    scene.write_text(
        '[scene]\nname = "bad"\n'
        '[[disk]]\nname = "a"\ninertia = -1.0\n'
        '[[disk]]\nname = "b"\ninertia = 1.0\n'
        '[[shaft]]\nbetween = ["a", "b"]\nstifness = 1e5\n'
    )
    assert main(["solve", str(scene), "--rpm", "100", "--json", str(tmp_path / "r.json")]) == 2
    said = capsys.readouterr().err.splitlines()
    assert any("unknown key 'stifness'. Did you mean 'stiffness'?" in line for line in said)
    assert any("inertia" in line and "kg m2" in line for line in said)
    assert not (tmp_path / "r.json").exists()


@pytest.mark.parametrize("option", ["--json", "--csv", "--plot"])
def test_a_path_that_cannot_be_written_is_refused_before_anything_is_computed(option, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("jaxhb.report.compute.solve_speeds", lambda *_, **__: pytest.fail("computed"))
    missing = tmp_path / "nowhere" / "r.png"
    assert main(["sweep", "spur_pair", "--rpm", "9", option, str(missing)]) == 2
    assert capsys.readouterr().err.startswith(f"{option}: there is no folder ")
    assert main(["sweep", "spur_pair", "--rpm", "9", option, str(tmp_path)]) == 2
    assert "is a folder" in capsys.readouterr().err


def test_two_outputs_to_one_file_are_refused(capsys, tmp_path):
    same = str(tmp_path / "r.png")
    assert main(["solve", "spur_pair", "--rpm", "9", "--json", same, "--plot", same]) == 2
    assert "the same file" in capsys.readouterr().err


def test_without_matplotlib_a_picture_is_refused_with_the_name_of_the_extra(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr("jaxhb.report.compute.steady_state", lambda *_, **__: pytest.fail("computed"))
    assert main(["solve", "spur_pair", "--rpm", "2000", "--plot", str(tmp_path / "r.png")]) == 2
    assert "jaxhb[plot]" in capsys.readouterr().err
