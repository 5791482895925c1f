"""The command line as such: what is refused in a sentence, and what --help shows."""

import importlib.util

import pytest

import jaxhb
from jaxhb.cli.main import program

BAD = {
    "solve gear_train --rpm 1": "Did you mean 'gear_train_30'?",
    "solve no.toml --rpm 1": "there is no such file",
    "solve spur_pair --rpm 0": "greater than 0 rpm",
    "solve spur_pair --rpm fast": "must be a number greater than 0 rpm",
    "solve spur_pair --rpm inf": "must be a number greater than 0 rpm",
    "sweep spur_pair --rpm 1e5:2e6:3": "'2e6', must be at most 1000000 rpm: give revolutions per minute.",
    "sweep spur_pair --rpm 600:2450": "A:B:COUNT",
    "sweep spur_pair --rpm 600:2450:0": "whole number of at least 1",
    "sweep spur_pair --rpm 600:2450:1": "COUNT of at least 2",
    "solve spur_pair": "--rpm",
    "solve spur_pair --rpm 1333,1600": "2 speeds, and this command takes one: jaxhb sweep and jaxhb report take",
    "campbell spur_pair --rpm 2000:1000": "at least two speeds, in rising order",
    "campbell spur_pair --rpm 900:1000 --orders 3,x": "'x' must be a number greater than 0",
    "holzer spur_pair --hz nan": "'nan' must be a number greater than 0",
    "holzer spur_pair --hz 1 --mode 1": "--hz and --mode exclude each other",
    "modes spur_pair --at 0": "greater than 0 rpm",
    "modes spur_pair --rpm 1500": "do not depend on the speed; --at R takes the teeth",
    "solve gear_train_30 --rpm 9 --harmonics 5": "ask for at least 24",
    "solve spur_pair --rpm 9 --harmonics 2.5": "whole number",
    "solve spur_pair --rpm 9 --tolerance 1": "less than 1",
    "solve gear_train_30 --rpm 9 --misfire A1": "there is no cylinder 'A1'",
    "solve six_cylinder_diesel --rpm 9 --misfire each": "only jaxhb report, forced and campbell take every cylinder",
    "forced six_cylinder_diesel --rpm 9 --misfire each --misfire 'cylinder 1'": "Leave out the other --misfire.",
    "report spur_pair --rpm 9 --misfire each": "--misfire each: no cylinder of the train fires.",
    "forced spur_pair --rpm 9 --element 'gear aa'": "damper or mesh 'gear aa'. Did you mean 'gear a'?",
    "forced spur_pair --rpm 9 --scenario hot": "there is no scenario 'hot'",
    "forced spur_pair --rpm 9 --links-at Hz=50": "'Hz=50' is none of hz=VALUE",
    "solve spur_pair --rpm 9 --set x.y=1": "there is no element 'x'",
    "solve spur_pair --rpm 9 --set 'gear a.inertia'": "NAME.FIELD=VALUE",
    "solve spur_pair --rpm 9 --set 'gear a.inertia=-1'": "-1",
    "solve spur_pair --rpm 9 --set 'gear a|gear b.stiffness=36kN'": "36kN is no number; values are numbers in SI units",
    "solve spur_pair --rpm 9 --set 'gear a.teeth=4.5'": "must be a whole number",
    "solve spur_pair --rpm 9 --set 'gear a|gear b.law=x'": "Known: 'fridman2009'",
    "solve spur_pair --rpm 9 --set 'gear a.inertia=big'": "'big', must be finite",
    "sweep spur_pair --rpm 9 --over 'gear a.inertia=1'": "A:B:COUNT",
    "sweep spur_pair --rpm 9 --over 'gear a.inertia=1:2:1'": "COUNT of at least 2",
    "sweep spur_pair --rpm 8,9 --over 'gear a.damping=1,2'": "one speed",
    "sweep spur_pair --rpm 9 --direction x": "'x' is not one of 'up', 'down', 'both'",
    "sweep spur_pair --rpm 9 --orbit --direction down": "periodic solutions (--orbit) do not depend on it",
    "solve spur_pair --rpm 9 --gear 'gear c'": "there is no disk 'gear c'",
    "solve gear_train_30 --rpm 9 --gear hub": "carries no mesh",
    "report spur_pair --rpm 9 --at 8": "not one of the speeds",
    "solve spur_pair --rpm 9 --plot r.gif": ".png",
    "solve spur_pair --rpm 9 --csv .": "--csv: '.' is a folder",
    "sweep spur_pair --rpm 9 --csv no/r.csv": "--csv: there is no folder",
    "solve spur_pair --rpm 9 --json r --csv r": "the same file",
    "scene spur_pair --out x.json": "--out: 'x.json' is no scene. Give a name that ends in .toml.",
    "new engine": "FILE: 'engine' is no scene. Give a name that ends in .toml.",
    "new no/engine.toml": "FILE: there is no folder",
    "new engine.toml --from inline_four": "there is no packaged scene 'inline_four'. Did you mean",
    "tune six_cylinder_diesel": "six_cylinder_diesel: the scene has no [tune] table. Write [tune]",
    "tune engine_with_damper --json -": "--json: a tuning writes it again",
    "guess": "No such command 'guess'. See jaxhb --help",
    "sovle spur_pair": "No such command 'sovle'. Did you mean 'solve'? See",
    "": "jaxhb: Missing command. See jaxhb --help",
    "solve spur_pair --rpm 9 --chunk 4": "No such option '--chunk'. See jaxhb solve --help",
    "solve spur_pair --rmp 2000": "No such option '--rmp'. Did you mean '--rpm'? See",
    "solve spur_pair --speed 1500": "No such option '--speed'. Did you mean '--rpm'? See",
    "solve spur_pair --rpm 9 --har 4": "No such option '--har'.",
    "solve spur_pair 3000 --rpm 9": "unexpected extra argument (3000)",
    "solve --rpm 9": "jaxhb solve: Missing argument 'SCENE'. See jaxhb solve --help",
    "solve spur_pair --rpm": "'--rpm' requires an argument. See",
    "sweep spur_pair --csv --quiet": "Option '--csv' requires an argument. See",
    "report spur_pair --rpm 2000 --html page.txt": "Give a name that ends in .html, .htm.",
    "report spur_pair --rpm 2000 --tuned spur_pair": "Add --html FILE.html.",
    "report spur_pair --rpm 2000 --html page.html --tuned no.toml": "there is no such file",
    "report spur_pair --rpm 2000 --html page.html --tune": "the scene has no [tune] table",
    "report spur_pair --rpm 2000 --html page.html --tune --tuned a.toml": "--tuned and --tune exclude each other",
    "report spur_pair --rpm 2000 --html page.html --json page.html": "name the same file",
    "sweep spur_pair --rpm 3000 --over 'gear a.damping=0.002,-1' --csv r.csv": "damping is -1 N m s/rad, must be",
    "solve spur_pair --orbit=1": "jaxhb solve: Option '--orbit' does not take a",
}


@pytest.mark.parametrize(("line", "sentence"), BAD.items(), ids=BAD)
def test_bad_input_exits_2_with_one_sentence_and_writes_nothing(line, sentence, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if {"--csv", "--plot", "--gear", "--html"} & set(line.split()):
        for name in ("solve_speeds", "steady_state"):
            monkeypatch.setattr(f"jaxhb.report.compute.{name}", lambda *_, **__: pytest.fail("computed"))
    called = run(line)
    assert (called.status, called.out, len(called.err.splitlines())) == (2, "", 1)
    assert sentence in called.err
    assert list(tmp_path.iterdir()) == []


def test_all_errors_are_told_one_a_line(run, tmp_path):
    scene = tmp_path / "bad.toml"
    disks = '[[disk]]\nname = "a"\ninertia = -1.0\n[[disk]]\nname = "b"\ninertia = 1.0\n'
    scene.write_text(f'{disks}[[shaft]]\nbetween = ["a", "b"]\nstifness = 1e5\n')
    called = run(f"solve {scene} --rpm 100", "json")
    assert called.status == 2 and not called.path("json").exists()
    said = called.err.splitlines()
    assert any("unknown key 'stifness'. Did you mean 'stiffness'?" in line for line in said)
    assert any("inertia" in line and "kg m2" in line for line in said)
    assert run("holzer six_cylinder_diesel --mode 0 30").err.splitlines() == [
        "six_cylinder_diesel: --mode 0: this mode is rigid, no link is strained. The first that strains one is 1.",
        "six_cylinder_diesel: --mode 30: there are modes 0 to 8.",
    ]


@pytest.mark.parametrize("text", ["disk = 5", "disk = [1, 2]", "[[disk]]\nname = 3", "[[torque]]\nscale = 'none.csv'"])
def test_a_scene_that_is_none_is_told_as_such_where_files_are_asked_for(text, tmp_path, run):
    (tmp_path / "bad.toml").write_text(text)
    called = run(f"solve {tmp_path / 'bad.toml'} --rpm 9", "json")
    assert called.status == 2 and "bad.toml" in called.err


@pytest.mark.parametrize(("file", "extra"), [("plot", "plot"), ("html", "report"), ("netcdf", "data")])
def test_what_needs_a_library_that_is_missing_is_refused_with_the_name_of_the_extra(file, extra, run, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    called = run("report spur_pair --rpm 2000", file)
    assert called.status == 2 and f"jaxhb[{extra}]" in called.err


def test_scenes_lists_every_packaged_scene(run):
    assert [line.split()[0] for line in run("scenes").out.splitlines()] == jaxhb.scene_names()


def test_every_command_and_all_together_show_examples(run):
    commands, together = set(program.commands) - {"completion"}, run("--help")
    assert together.status == 0
    for command in commands:
        said = run(f"{command} --help").out
        shown = [line.split()[1] for line in said[said.index("Examples:") :].splitlines() if "  jaxhb " in line]
        assert 1 <= len(shown) <= 3 and set(shown) == {command}
        assert "Exit status: 0" in said
        assert f"\n  jaxhb {command}" in together.out
