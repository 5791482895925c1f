"""The command line as such: what is refused in a sentence, and what --help shows."""

import importlib.util
import tomllib

import pytest
from reference_data import DATA

import jaxhb
from jaxhb.cli.main import program

REFUSED = tomllib.loads((DATA / "refused_commands.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(("line", "sentence"), REFUSED.items(), ids=REFUSED)
def test_bad_input_exits_2_with_one_sentence_and_writes_nothing(
    line, sentence, run, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    if {"--csv", "--plot", "--gear", "--html"} & set(line.split()):
        for name in ("solve_speeds", "steady_state"):
            monkeypatch.setattr(
                f"jaxhb.report.compute.{name}", lambda *_, **__: pytest.fail("computed")
            )
    completed = run(line, status=2)
    (error,) = completed.err.splitlines()
    assert sentence in error
    assert completed.out == ""
    assert list(tmp_path.iterdir()) == []


def test_all_errors_are_told_line_by_line(run, tmp_path):
    scene = tmp_path / "bad.toml"
    disks = (
        '[[disk]]\nname = "a"\ninertia = -1.0\n[[disk]]\nname = "b"\ninertia = 1.0\n'
    )
    scene.write_text(f'{disks}[[shaft]]\nbetween = ["a", "b"]\nstifness = 1e5\n')
    completed = run(f"solve {scene} --rpm 100", "json", status=2)
    completed.check_printed("errors_of_a_scene")
    assert not completed.path("json").exists()
    refused = run("holzer six_cylinder_diesel --mode 0 30", status=2)
    refused.check_printed("errors_of_modes")


@pytest.mark.parametrize(
    "text",
    [
        "disk = 5",
        "disk = [1, 2]",
        "[[disk]]\nname = 3",
        "[[torque]]\nscale = 'none.csv'",
    ],
)
def test_a_scene_that_is_none_is_told_as_such_where_files_are_asked_for(
    text, tmp_path, run
):
    (tmp_path / "bad.toml").write_text(text)
    completed = run(f"solve {tmp_path / 'bad.toml'} --rpm 9", "json", status=2)
    assert "bad.toml" in completed.err


@pytest.mark.parametrize(
    ("file", "extra"), [("plot", "plot"), ("html", "report"), ("netcdf", "data")]
)
def test_what_needs_a_library_that_is_missing_is_refused_with_the_name_of_the_extra(
    file, extra, run, monkeypatch
):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert f"jaxhb[{extra}]" in run("report spur_pair --rpm 2000", file, status=2).err


def test_scenes_lists_every_packaged_scene(run):
    names = [line.split()[0] for line in run("scenes").out.splitlines()]
    assert names == jaxhb.scene_names()


@pytest.mark.parametrize("command", sorted(set(program.commands) - {"completion"}))
def test_every_command_and_all_together_show_examples(command, run):
    output = run(f"{command} --help").out
    examples = output[output.index("Examples:") :].splitlines()
    shown = [line.split()[1] for line in examples if "  jaxhb " in line]
    assert 1 <= len(shown) <= 3
    assert set(shown) == {command}
    assert "Exit status: 0" in output
    assert f"\n  jaxhb {command}" in run("--help").out
