"""The command line as such: what is refused in a sentence, and what --help shows."""

import importlib.util
import tomllib

import pytest
from reference_data import DATA

import jaxhb
from jaxhb.cli.main import program

BAD = tomllib.loads((DATA / "refused_commands.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(("line", "sentence"), BAD.items(), ids=BAD)
def test_bad_input_exits_2_with_one_sentence_and_writes_nothing(
    line, sentence, run, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    if {"--csv", "--plot", "--gear", "--html"} & set(line.split()):
        for name in ("solve_speeds", "steady_state"):
            monkeypatch.setattr(
                f"jaxhb.report.compute.{name}", lambda *_, **__: pytest.fail("computed")
            )
    called = run(line)
    assert (called.status, called.out, len(called.err.splitlines())) == (2, "", 1)
    assert sentence in called.err
    assert list(tmp_path.iterdir()) == []


def test_all_errors_are_told_one_a_line(run, tmp_path):
    scene = tmp_path / "bad.toml"
    disks = (
        '[[disk]]\nname = "a"\ninertia = -1.0\n[[disk]]\nname = "b"\ninertia = 1.0\n'
    )
    scene.write_text(f'{disks}[[shaft]]\nbetween = ["a", "b"]\nstifness = 1e5\n')
    called = run(f"solve {scene} --rpm 100", "json")
    assert called.status == 2 and not called.path("json").exists()
    said = called.err.splitlines()
    assert any(
        "unknown key 'stifness'. Did you mean 'stiffness'?" in line for line in said
    )
    assert any("inertia" in line and "kg m2" in line for line in said)
    assert run("holzer six_cylinder_diesel --mode 0 30").err.splitlines() == [
        (
            "six_cylinder_diesel: --mode 0: this mode is rigid, no link is strained."
            " The first that strains one is 1."
        ),
        "six_cylinder_diesel: --mode 30: there are modes 0 to 8.",
    ]


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
    called = run(f"solve {tmp_path / 'bad.toml'} --rpm 9", "json")
    assert called.status == 2 and "bad.toml" in called.err


@pytest.mark.parametrize(
    ("file", "extra"), [("plot", "plot"), ("html", "report"), ("netcdf", "data")]
)
def test_what_needs_a_library_that_is_missing_is_refused_with_the_name_of_the_extra(
    file, extra, run, monkeypatch
):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    called = run("report spur_pair --rpm 2000", file)
    assert called.status == 2 and f"jaxhb[{extra}]" in called.err


def test_scenes_lists_every_packaged_scene(run):
    assert [
        line.split()[0] for line in run("scenes").out.splitlines()
    ] == jaxhb.scene_names()


def test_every_command_and_all_together_show_examples(run):
    commands = set(program.commands) - {"completion"}
    together = run("--help")
    assert together.status == 0
    for command in commands:
        said = run(f"{command} --help").out
        shown = [
            line.split()[1]
            for line in said[said.index("Examples:") :].splitlines()
            if "  jaxhb " in line
        ]
        assert 1 <= len(shown) <= 3 and set(shown) == {command}
        assert "Exit status: 0" in said
        assert f"\n  jaxhb {command}" in together.out
