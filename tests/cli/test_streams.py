"""Standard output that is full, closed or of another encoding, signals, files that would be lost: a sentence each."""

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import jaxhb
from jaxhb.cli import resume, sweeps
from jaxhb.cli.main import main
from jaxhb.cli.progress import Progress
from jaxhb.cli.streams import Ended, guarded
from jaxhb.report import compute
from jaxhb.report.answer import orbit_state
from jaxhb.report.files.output import write_files

SCENES = Path(__file__).parents[2] / "jaxhb" / "scene" / "scenes"


def process(*arguments, **options):
    """A process of its own: (exit status, output, errors)."""
    command = [sys.executable, "-m", "jaxhb", *arguments]
    given = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": os.environ} | options
    done = subprocess.run(command, check=False, text=True, **given)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def scene(tmp_path):
    """The pair of gears and its table, in a folder of its own."""
    for name in ("spur_pair.toml", "spur_pair_omega_squared.csv"):
        (tmp_path / name).write_bytes((SCENES / name).read_bytes())
    return tmp_path / "spur_pair.toml"


def test_the_package_runs_as_a_module_and_tells_its_version():
    status, said, _ = process("--version")
    assert (status, said.split()[0]) == (0, "jaxhb")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_behind_standard_output_is_a_sentence():
    with open("/dev/full", "w") as full:
        status, _, said = process("scenes", stdout=full)
    assert (status, said) == (2, "standard output cannot be written: No space left on device.\n")


def test_a_closed_pipe_is_a_sentence():
    reading, writing = os.pipe()
    os.close(reading)
    with open(writing, "w") as closed:
        status, _, said = process("scenes", stdout=closed)
    assert (status, said) == (141, "standard output was closed before all of it was written.\n")


def test_names_that_a_terminal_cannot_encode_are_written_with_a_backslash_and_told(scene):
    scene.write_text(scene.read_text(encoding="utf-8").replace("gear a", "Zahnrad ä"), encoding="utf-8")
    env = os.environ | {"PYTHONIOENCODING": "ascii"}
    status, said, told = process("scene", str(scene), env=env)
    assert status == 0 and "Zahnrad \\xe4" in said
    assert told == "Some names were written with \\: ascii has no '\\xe4'. PYTHONUTF8=1 helps.\n"
    status, said, told = process("modes", str(scene), "--json", "-", env=env, encoding="utf-8")
    assert (status, told) == (0, "") and "Zahnrad ä" in json.loads(said)["modes"]


def test_a_signal_ends_a_command_as_ctrl_c_does():
    before = signal.getsignal(signal.SIGTERM)

    def run():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)
        return 0

    with pytest.raises(Ended) as stop:
        guarded(run)
    assert stop.value.status == 143 and isinstance(stop.value, KeyboardInterrupt)
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (["solve", "SCENE", "--rpm", "2000", "--json", "SCENE"], "--json"),
        (["sweep", "SCENE", "--rpm", "2000", "--csv", "TABLE"], "--csv"),
        (["sweep", "SCENE", "--rpm", "2000", "--netcdf", "LINK"], "--netcdf"),
        (["report", "SCENE", "--rpm", "2000", "--netcdf", "TABLE"], "--netcdf"),
        (["scene", "SCENE", "--out", "SCENE"], "--out"),
        (["tune", "SCENE", "--output", "SCENE"], "--output"),
    ],
)
def test_what_a_command_reads_is_never_written_over(arguments, option, scene, capsys, monkeypatch):
    table = scene.with_name("spur_pair_omega_squared.csv")
    (scene.parent / "link").symlink_to(table)
    names = {"SCENE": str(scene), "TABLE": str(table), "LINK": str(scene.parent / "link")}
    before = scene.read_bytes(), table.read_bytes()
    assert main([names.get(word, word) for word in arguments]) == 2
    assert capsys.readouterr().err.startswith(f"{option}: ")
    assert (scene.read_bytes(), table.read_bytes()) == before


def test_a_tuning_writes_over_nothing_that_it_did_not_write(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("engine_with_damper_tuned.toml").write_text("# mine")
    assert main(["tune", "engine_with_damper"]) == 2
    assert "is there and is not from jaxhb tune" in capsys.readouterr().err
    assert Path("engine_with_damper_tuned.toml").read_text() == "# mine"
    assert main(["tune", "engine_with_damper", "--output", "nowhere/x.toml"]) == 2
    assert capsys.readouterr().err.startswith("--output: there is no folder")
    assert main(["tune", "engine_with_damper", "--json", "-", "--output", "x.toml"]) == 2
    assert "--json: a tuning writes it again" in capsys.readouterr().err


def test_half_written_files_of_killed_processes_are_removed(tmp_path):
    (tmp_path / ".r.json.999999999.part").write_bytes(b"{")
    write_files({str(tmp_path / "r.json"): [b"{}"]})
    assert [path.name for path in tmp_path.iterdir()] == ["r.json"]


def test_json_on_standard_output_is_all_that_is_there(capsys):
    assert main(["solve", "spur_pair", "--rpm", "2000", "--json", "-"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["rpm"] == 2000.0 and said.err == ""


def test_quiet_commands_print_nothing(capsys, tmp_path):
    file = tmp_path / "r.csv"
    assert main(["solve", "spur_pair", "--rpm", "2000", "--quiet", "--csv", str(file)]) == 0
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "") and file.read_text().startswith("rpm,motion,")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "powershell"])
def test_there_is_a_script_for_every_shell(shell):
    status, script, told = process("completion", shell)
    assert (status, told) == (0, "") and "jaxhb" in script and f"_JAXHB_COMPLETE={shell}" in script.replace(" = '", "=")


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize(
    ("words", "proposed"),
    [
        (["jaxhb", "swe"], ["sweep"]),
        (["jaxhb", "solve", "gear_t"], ["gear_train_30"]),
        (["jaxhb", "sweep", "spur_pair", "--dir"], ["--direction"]),
        (["jaxhb", "sweep", "spur_pair", "--direction", ""], ["up", "down", "both"]),
        (
            ["jaxhb", "solve", "gear_train_30", "--misfire", "cylinder"],
            [rf"cylinder\ {r}{k}" for r in "AB" for k in "12345"],
        ),
        (["jaxhb", "solve", "gear_train_30", "--misfire", r"cylinder\ A2"], [r"cylinder\ A2"]),
        (["jaxhb", "solve", "gear_train_30", "--misfire", "'cylinder A3"], ["cylinder A3"]),
        (["jaxhb", "forced", "six_cylinder_diesel", "--element", "cyl6"], ["cyl6", r"cyl6\|flywheel"]),
        (["jaxhb", "sweep", "spur_pair", "--csv", "--json", "--dir"], ["--direction"]),
        (["jaxhb", "sweep", "spur_pair", "--csv", "r"], []),
        (["jaxhb", "report", "no_such_scene", "--misfire", "c"], []),
        (["jaxhb", "report", "--misfire", "c"], []),
    ],
    ids=lambda given: given[-1] if given else "nothing",
)
def test_bash_is_told_how_words_go_on(words, proposed, tmp_path):
    """What its function for the program proposes, names with spaces as they have to stand on the line."""
    program = tmp_path / "jaxhb"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m jaxhb "$@"\n')
    program.chmod(0o755)
    line = " ".join(map(shlex.quote, words))
    code = f'''compopt() {{ echo "$@" >> "{tmp_path}/files"; }}; eval "$(jaxhb completion bash)"
        COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _jaxhb_completion jaxhb; printf "%s\\n" "${{COMPREPLY[@]}}"'''
    env = os.environ | {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(["bash", "--norc", "-c", code], check=False, capture_output=True, text=True, env=env)
    assert done.stderr == "" and sorted(done.stdout.splitlines()) == (sorted(proposed) or [""])
    assert (tmp_path / "files").exists() == (words[-1] in ("gear_t", "r"))  # completed by bash itself


@pytest.mark.parametrize("orbit", [[], ["--orbit"]], ids=["steady", "orbit"])
def test_a_sweep_that_is_stopped_leaves_its_rows_and_goes_on_where_it_was(orbit, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(resume, "user_folder", lambda: tmp_path / "cache")
    files = {kind: tmp_path / f"s.{kind}" for kind in ("json", "csv")}
    options = [word for kind, file in files.items() for word in (f"--{kind}", str(file))]
    command = ["sweep", "spur_pair", "--rpm", "4600,5000,5400", "--chunk", "1", *orbit, *options]
    note, folders = sweeps._Sweep.note, []

    def stop(self, found):
        note(self, found)
        folders.append(self.kept.folder)
        if sum(map(len, found.values())) == 2:
            raise Ended(signal.SIGTERM)

    with monkeypatch.context() as stopped:
        stopped.setattr(sweeps._Sweep, "note", stop)
        assert main(command) == 143
    said = capsys.readouterr().err
    assert said.startswith("stopped; 2 of 3 speeds are done in ") and "the same command goes on from there" in said
    record = json.loads(files["json"].read_text())
    assert not record["complete"] and record["rpm"] == [row["rpm"] for row in record["responses"]]
    assert len(files["csv"].read_text().splitlines()) == 3
    assert len(list(folders[0].glob("*.npz"))) >= 1
    with monkeypatch.context() as once:
        solved = []
        once.setattr(compute, "orbit_state", lambda response: solved.append(response) or orbit_state(response))
        assert main(command) == 0
    assert [response.rpm for response in solved] == ([5400.0] if orbit else [])
    record = json.loads(files["json"].read_text())
    assert record["complete"] and record["rpm"] == [4600.0, 5000.0, 5400.0]
    assert not folders[0].exists()  # what is done is not kept
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == ["s.csv", "s.json"]


def test_a_sweep_lists_amplitudes_only_where_it_is_asked_to(tmp_path):
    file, sizes = tmp_path / "s.json", {}
    for asked in ("", "--orders 64", "--full"):
        assert main(["sweep", "spur_pair", "--rpm", "2000,5000", "--json", str(file), *asked.split()]) == 0
        (mesh,) = json.loads(file.read_text())["responses"][1]["meshes"].values()
        sizes[asked] = len(mesh["amplitudes"])
    assert sizes[""] == 0 and sizes["--orders 64"] == 2 and sizes["--full"] > 100


def test_a_sweep_goes_over_a_number_of_the_scene(tmp_path, capsys):
    files = [tmp_path / f"s.{kind}" for kind in ("json", "csv", "nc", "png")]
    options = [w for o, f in zip(("json", "csv", "netcdf", "plot"), files, strict=True) for w in (f"--{o}", str(f))]
    name = "gear a|gear b.backlash"
    assert main(["sweep", "spur_pair", "--rpm", "5000", "--over", f"{name}=1e-4:2e-4:2", *options]) == 0
    said, record = capsys.readouterr().out, json.loads(files[0].read_text())
    assert said.startswith(f"Teeth separate at 2 of 2 values of {name} between 0.0001 and 0.0002 m: {name} = 0.0001")
    assert record["over"] == {"name": name, "unit": "m", "values": [1e-4, 2e-4]} and record["rpm"] == [5000.0] * 2
    wide = jaxhb.load_scene("spur_pair").replace({name: 2e-4})
    alone = jaxhb.steady_state(wide, rpm=5000.0).force("gear a|gear b").max
    assert record["responses"][1]["meshes"]["gear a|gear b"]["max"] == pytest.approx(float(alone), rel=1e-2)
    assert files[1].read_text().splitlines()[0].startswith(f'rpm,"{name}, m",direction')
    assert files[2].read_bytes()[:3] == b"CDF" and files[3].read_bytes().startswith(b"\x89PNG")


def test_a_trace_is_the_motion_over_the_crank_angle(tmp_path, capsys):
    file = tmp_path / "t.csv"
    assert main(["solve", "spur_pair", "--rpm", "5000", "--trace", str(file)]) == 0
    heads, *rows = file.read_text().splitlines()
    values = dict(zip(heads.split(","), np.loadtxt(rows, delimiter=",").T, strict=True))
    state = jaxhb.steady_state(jaxhb.load_scene("spur_pair"), rpm=5000.0)
    force = state.force("gear a|gear b")
    np.testing.assert_array_equal(values["gear a|gear b tooth force N"], force.samples(len(rows)))
    np.testing.assert_allclose(values["angle deg"], force.angles_deg(len(rows)), rtol=1e-12)
    assert values["time s"][1] == pytest.approx(values["angle deg"][1] / 360 / 5000 * 60)
    capsys.readouterr()
    light = ["--set", "gear a|gear b.damping=10", "--trace", str(tmp_path / "none.csv")]
    assert main(["solve", "spur_pair", "--rpm", "6000", *light]) == 1
    assert "--trace: no file, the motion never repeats" in capsys.readouterr().err
    assert not (tmp_path / "none.csv").exists()


def test_what_a_stopped_command_left_is_forgotten_after_a_month_and_files_of_others_are_not(tmp_path, monkeypatch):
    monkeypatch.setattr(resume, "user_folder", lambda: tmp_path)
    train, month = jaxhb.load_scene("spur_pair"), 86400 * resume.FORGOTTEN_AFTER
    folders = [resume.Kept([train], asked).folder for asked in ("old", "recent", "with a letter")]
    for folder in folders:
        (folder / "0 2000").mkdir(parents=True)
        for name in ("sweep.json", f"{'0' * 32}.npz", f".{'1' * 32}.npz.1.part"):
            (folder / "0 2000" / name).write_text("")
    letter = folders[2] / "0 2000" / "letter.odt"
    letter.write_text("")
    for folder, age in zip(folders, (month + 60, month - 60, month + 60), strict=True):
        os.utime(folder, (time.time() - age,) * 2)
    own = resume.Kept([train], "another command")
    assert not folders[0].exists() and len(list((folders[1] / "0 2000").iterdir())) == 3
    assert list(letter.parent.iterdir()) == [letter]
    own.forget()  # there is none


def test_a_sweep_that_cannot_be_kept_goes_on_without(tmp_path, capsys, monkeypatch):
    (tmp_path / "cache").write_text("no folder")
    monkeypatch.setattr(resume, "user_folder", lambda: tmp_path / "cache")
    assert main(["sweep", "spur_pair", "--rpm", "5000", "--csv", str(tmp_path / "s.csv")]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("text", ["disk = 5", "disk = [1, 2]", "[[disk]]\nname = 3", "[[torque]]\nscale = 'none.csv'"])
def test_a_scene_that_is_none_is_told_as_such_where_files_are_asked_for(text, tmp_path, capsys):
    scene = tmp_path / "bad.toml"
    scene.write_text(text)
    assert main(["solve", str(scene), "--rpm", "9", "--json", str(tmp_path / "r.json")]) == 2
    assert "bad.toml" in capsys.readouterr().err


@pytest.mark.parametrize("orbit", [[], ["--orbit"]], ids=["steady", "orbit"])
def test_a_report_that_is_stopped_goes_on_where_it_was(orbit, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(resume, "user_folder", lambda: tmp_path / "cache")
    command = ["report", "spur_pair", "--rpm", "2000,5000", *orbit, "--json", str(tmp_path / "r.json")]

    def stop(progress, count):
        raise KeyboardInterrupt

    with monkeypatch.context() as stopped:
        stopped.setattr(Progress, "advance", stop)
        assert main(command) == 130
    assert capsys.readouterr().err.endswith("the same command goes on from there\n")
    (folder,) = (tmp_path / "cache" / resume.FOLDER).iterdir()
    assert [path.name for path in folder.iterdir()] == ["0"]
    assert main(command) == 0
    assert not folder.exists() and (tmp_path / "r.json").exists()
