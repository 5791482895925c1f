"""Standard output that is full, closed or of another encoding, signals, files that
would be lost: a sentence each.
"""

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
from printed import HAMMERING
from reference_data import PACKAGED, reference

import jaxhb
from jaxhb import _store
from jaxhb.cli import commands, resume
from jaxhb.cli.main import main
from jaxhb.cli.progress import Progress
from jaxhb.cli.streams import Ended, guarded
from jaxhb.report.files.output import write_files
from jaxhb.results.steady import orbit_state
from jaxhb.steady import orbits

MESH = "gear a|gear b"


def process(*arguments, stdout=subprocess.PIPE, env=None, encoding=None):
    """A process of its own: (exit status, output, errors)."""
    completed = subprocess.run(
        [sys.executable, "-m", "jaxhb", *arguments],
        check=False,
        text=True,
        stdout=stdout,
        stderr=subprocess.PIPE,
        env=os.environ | (env or {}),
        encoding=encoding,
    )
    return completed.returncode, completed.stdout, completed.stderr


@pytest.fixture
def scene(tmp_path):
    """The pair of gears and its table, in a folder of its own."""
    for name in ("spur_pair.toml", "spur_pair_omega_squared.csv"):
        (tmp_path / name).write_bytes((PACKAGED / name).read_bytes())
    return tmp_path / "spur_pair.toml"


def test_the_package_runs_as_a_module_and_tells_its_version():
    status, output, _ = process("--version")
    assert (status, output.split()[0]) == (0, "jaxhb")


@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="no device that is always full"
)
def test_a_full_disk_and_a_closed_pipe_behind_standard_output_are_sentences():
    reading, writing = os.pipe()
    os.close(reading)
    full = "standard output cannot be written: No space left on device."
    closed = "standard output was closed before all of it was"
    for place, code, sentence in (("/dev/full", 2, full), (writing, 141, closed)):
        with open(place, "w") as stream:
            status, _, errors = process("scenes", stdout=stream)
        assert status == code
        assert errors.startswith(sentence)
        assert errors.count("\n") == 1


SHELL = pytest.mark.skipif(
    os.name != "posix", reason="the shell of the test is that of POSIX"
)


def shell(line, *arguments):
    """A line of the shell in which ``jaxhb`` is the program: (exit status, output,
    errors).
    """
    command = f'jaxhb() {{ {shlex.quote(sys.executable)} -m jaxhb "$@"; }}\n{line}'
    completed = subprocess.run(
        ["sh", "-c", command, "sh", *arguments],
        check=False,
        text=True,
        capture_output=True,
    )
    return completed.returncode, completed.stdout, completed.stderr


CLOSED = "standard output cannot be written: it is closed.\n"
GONE = (
    "the folder in which jaxhb was started is not there any more. Go to another one.\n"
)


@SHELL
@pytest.mark.parametrize(
    "words", ["scenes", "--version", "scene spur_pair", "scenes --help"]
)
def test_a_closed_standard_output_is_a_sentence(words):
    assert shell(f"jaxhb {words} >&-") == (2, "", CLOSED)


@SHELL
def test_an_error_goes_nowhere_else_where_standard_error_is_closed():
    assert shell("jaxhb modes nowhere.toml 2>&-") == (2, "", "")


@SHELL
def test_files_are_written_though_standard_output_is_closed(tmp_path):
    copy = tmp_path / "copy.toml"
    status, _, errors = shell('jaxhb scene spur_pair --out "$1" >&-', str(copy))
    assert (status, errors) == (2, CLOSED)
    assert jaxhb.load_scene(copy).topology.mesh_names == (MESH,)


@SHELL
@pytest.mark.parametrize(
    "words", ["new x.toml", "tune spur_pair", "scene spur_pair --out x.toml"]
)
def test_a_working_folder_that_was_removed_is_a_sentence(words, tmp_path):
    line = f'mkdir "$1" && cd "$1" && rmdir "$1" && jaxhb {words}'
    assert shell(line, str(tmp_path / "gone")) == (2, "", GONE)


@SHELL
def test_a_limit_of_memory_that_the_compiler_cannot_keep_is_a_sentence():
    sentence = (
        "the limit of memory (ulimit -v) is 1 GB, must be at least 2 GB. Raise it.\n"
    )
    line = "ulimit -v 1000000 && jaxhb solve spur_pair --rpm 2000"
    assert shell(line) == (2, "", sentence)
    assert shell("ulimit -v 1000000 && jaxhb scenes && jaxhb --version")[0] == 0
    program = "import jaxhb; jaxhb.solve(jaxhb.load_scene('spur_pair'), rpm=2000.0)"
    line = f'ulimit -v 1000000 && "{sys.executable}" -c "{program}"'
    status, _, errors = shell(line)
    assert status == 1
    assert errors.endswith(f"MemoryError: {sentence}")


@SHELL
@pytest.mark.parametrize(
    ("make", "kind"),
    [("mkdir", "folder"), ("mkfifo", "pipe"), ("ln -s /dev/null", "device")],
)
def test_what_is_there_and_is_no_file_is_not_called_missing(make, kind, tmp_path):
    line = f'cd "$1" && {make} train && jaxhb modes train'
    sentence = (
        f"train: the file is a {kind}, must be a regular file. Correct the name.\n"
    )
    assert shell(line, str(tmp_path)) == (2, "", sentence)


def test_memory_that_does_not_suffice_is_a_sentence(monkeypatch, capsys):
    def fails(*_, **__):
        raise MemoryError

    monkeypatch.setattr(commands, "solve", fails)
    assert main(["solve", "spur_pair", "--rpm", "2000"]) == 3
    sentence = "there is not enough memory for this request."
    assert capsys.readouterr().err.startswith(sentence)


@pytest.mark.slow
def test_names_that_a_terminal_cannot_encode_are_written_with_a_backslash(scene):
    text = scene.read_text(encoding="utf-8").replace("gear a", "Zahnrad ä")
    scene.write_text(text, encoding="utf-8")
    ascii_only = {"PYTHONIOENCODING": "ascii"}
    status, output, errors = process("scene", str(scene), env=ascii_only)
    assert (status, errors) == (0, "")
    assert "Zahnrad \\xe4" in output
    status, output, errors = process(
        "modes", str(scene), "--json", "-", env=ascii_only, encoding="utf-8"
    )
    assert (status, errors) == (0, "")
    assert "Zahnrad ä" in json.loads(output)["modes"]


def test_a_signal_ends_a_command_as_ctrl_c_does():
    before = signal.getsignal(signal.SIGTERM)

    def run():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)
        return 0

    with pytest.raises(Ended) as stop:
        guarded(run)
    assert stop.value.status == 143
    assert isinstance(stop.value, KeyboardInterrupt)
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize(("line", "option"), reference("cases")["never written over"])
def test_what_a_command_reads_is_never_written_over(line, option, scene, run):
    table = scene.with_name("spur_pair_omega_squared.csv")
    link = scene.with_name("link")
    link.symlink_to(table)
    before = [path.read_bytes() for path in (scene, table)]
    for word, path in (("SCENE", scene), ("TABLE", table), ("LINK", link)):
        line = line.replace(word, str(path))
    assert run(line, status=2).err.startswith(f"{option}: ")
    assert [path.read_bytes() for path in (scene, table)] == before


def test_a_tuning_writes_over_nothing_that_it_did_not_write(tmp_path, run, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tuned = Path("engine_with_damper_tuned.toml")
    tuned.write_text("# mine")
    completed = run("tune engine_with_damper", status=2)
    assert "is there and is not from jaxhb tune" in completed.err
    assert tuned.read_text() == "# mine"


def test_half_written_files_of_killed_processes_are_removed(tmp_path):
    (tmp_path / ".r.json.999999999.part").write_bytes(b"{")
    write_files({str(tmp_path / "r.json"): [b"{}"]})
    assert [path.name for path in tmp_path.iterdir()] == ["r.json"]


def test_json_on_standard_output_is_all_that_is_there_and_quiet_commands_print_nothing(
    run,
):
    completed = run("solve spur_pair --rpm 2000 --json -")
    assert json.loads(completed.out)["rpm"] == 2000.0
    assert completed.err == ""
    completed = run("solve spur_pair --rpm 2000 --quiet", "csv")
    assert (completed.out, completed.err) == ("", "")
    assert completed.rows[0]["rpm"] == "2000.0"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "powershell"])
def test_there_is_a_script_for_every_shell(shell, run):
    script = run(f"completion {shell}").out
    assert "jaxhb" in script
    assert f"_JAXHB_COMPLETE={shell}" in script.replace(" = '", "=")


@pytest.mark.parametrize(
    ("line", "begun", "proposed"), reference("cases")["completions"]
)
def test_bash_is_told_how_words_go_on(line, begun, proposed, run, monkeypatch):
    words = [*line.split(), begun]
    monkeypatch.setenv("_JAXHB_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", "\n".join(words))
    monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))
    assert sorted(filter(None, run("").out.splitlines())) == sorted(proposed)


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize(
    ("quote", "name"), [("", r"cylinder\ A3"), ("'", "cylinder A3")]
)
def test_bash_itself_completes_a_name_with_a_space(quote, name, tmp_path):
    program = tmp_path / "jaxhb"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m jaxhb "$@"\n')
    program.chmod(0o755)
    typed = shlex.quote(f"{quote}{name}")
    code = f"""compopt() {{ :; }}; eval "$(jaxhb completion bash)"; COMP_CWORD=4
        COMP_WORDS=(jaxhb solve gear_train_30 --misfire {typed})
        _jaxhb_completion jaxhb; echo "${{COMPREPLY[@]}}" """
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    completed = subprocess.run(
        ["bash", "--norc", "-c", code],
        check=False,
        capture_output=True,
        text=True,
        env=os.environ | {"PATH": path},
    )
    assert (completed.stderr, completed.stdout) == ("", f"{name}\n")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """The folder of programs of this test alone."""
    monkeypatch.setattr(resume, "user_folder", lambda: tmp_path / "cache")
    return tmp_path / "cache"


@pytest.mark.slow
@pytest.mark.parametrize("orbit", ["", "--orbit"], ids=["steady", "orbit"])
def test_a_sweep_that_is_stopped_leaves_its_rows_and_goes_on_where_it_was(
    orbit, run, cache, monkeypatch
):
    line = f"sweep spur_pair --rpm 4600,5000,5400 --chunk 1 {orbit}"
    note = commands._SweepFiles.note

    def stop(self, answers):
        note(self, answers)
        if sum(map(len, answers.values())) == 2:
            raise Ended(signal.SIGTERM)

    with monkeypatch.context() as stopped:
        stopped.setattr(commands._SweepFiles, "note", stop)
        completed = run(line, "json", "csv", status=143)
    assert completed.err.startswith("stopped; 2 of 3 speeds are done in ")
    assert completed.err.endswith("the same command goes on from there\n")
    record = completed.json
    assert record["rpm"] == [row["rpm"] for row in record["responses"]]
    assert not record["complete"]
    assert len(completed.rows) == 2
    (folder,) = (cache / resume.FOLDER).glob("[!.]*")
    assert list(folder.glob("*.npz"))
    solved = []
    monkeypatch.setattr(
        orbits,
        "orbit_state",
        lambda response: solved.append(response) or orbit_state(response),
    )
    completed = run(line, "json", "csv")
    assert [float(response.rpm) for response in solved] == ([5400.0] if orbit else [])
    record = completed.json
    assert record == record | {"complete": True, "rpm": [4600.0, 5000.0, 5400.0]}
    # What is done is not kept.
    assert not folder.exists()
    files = sorted(path.name for path in completed.folder.iterdir() if path.is_file())
    assert files == ["csv.csv", "json.json"]


def test_a_report_that_is_stopped_goes_on_where_it_was(run, cache, monkeypatch):
    line = "report spur_pair --rpm 2000,5000 --orbit"

    def stop(progress, count):
        raise KeyboardInterrupt

    with monkeypatch.context() as stopped:
        stopped.setattr(Progress, "advance", stop)
        completed = run(line, "json", status=130)
    assert completed.err.endswith("the same command goes on from there\n")
    (folder,) = (cache / resume.FOLDER).glob("[!.]*")
    assert [path.name for path in folder.glob("[!.]*")] == ["0"]
    completed = run(line, "json")
    assert completed.path("json").exists()
    assert not folder.exists()


def test_what_a_stopped_command_left_is_forgotten_after_a_month(cache):
    train = jaxhb.load_scene("spur_pair")
    month = 86400 * resume.FORGOTTEN_AFTER
    folders = []
    for age in (month + 60, month - 60):
        folder = resume.Unfinished([train], age).folder.folder
        (folder / "0 2000").mkdir(parents=True)
        (folder / "0 2000" / "sweep.json").write_text("")
        folders.append(folder)
    for folder, age in zip(folders, (month + 60, month - 60), strict=True):
        os.utime(folder, (time.time() - age,) * 2)
    unfinished = resume.Unfinished([train], "another command")
    assert [folder.exists() for folder in folders] == [False, True]
    unfinished.forget()  # there is none


def test_a_sweep_that_cannot_be_kept_goes_on_without_and_says_so_once(
    run, cache, monkeypatch
):
    cache.write_text("no folder")
    monkeypatch.setattr(_store, "_printed", set())
    completed = run("sweep spur_pair --rpm 5000", "csv")
    assert completed.path("csv").exists()
    assert completed.err.count("\n") == 1
    assert str(cache) in completed.err


@pytest.mark.parametrize(
    ("options", "least", "most"),
    [("", 0, 0), ("--orders 64", 2, 2), ("--full", 101, 1e9)],
)
def test_a_sweep_lists_amplitudes_only_where_it_is_asked_to(
    run_once, options, least, most
):
    completed = run_once(f"sweep spur_pair --rpm 2000,5000 {options}", "json")
    (mesh,) = completed.json["responses"][1]["meshes"].values()
    assert least <= len(mesh["amplitudes"]) <= most


def test_a_sweep_goes_over_a_number_of_the_scene(run):
    name = f"{MESH}.backlash"
    line = f"sweep spur_pair --rpm 5000 --over '{name}=1e-4:2e-4:2'"
    completed = run(line, "json", "csv", "netcdf", "plot")
    completed.check_printed("sweep_over_backlash", HAMMERING)
    record = completed.json
    assert record == record | {
        "over": {"name": name, "unit": "m", "values": [1e-4, 2e-4]},
        "rpm": [5000.0] * 2,
    }
    wide = jaxhb.load_scene("spur_pair").replace({name: 2e-4})
    alone = float(jaxhb.steady_state(wide, rpm=5000.0).force(MESH).max)
    largest = record["responses"][1]["meshes"][MESH]["max"]
    assert largest == pytest.approx(alone, rel=1e-2)
    assert [float(row[f"{name}, m"]) for row in completed.rows] == [1e-4, 2e-4]
    assert completed.path("netcdf").read_bytes()[:3] == b"CDF"


@pytest.mark.slow
def test_a_trace_is_the_motion_over_the_crank_angle(run):
    completed = run("solve spur_pair --rpm 5000", "trace")
    heads, *rows = completed.path("trace").read_text().splitlines()
    values = dict(zip(heads.split(","), np.loadtxt(rows, delimiter=",").T, strict=True))
    force = jaxhb.steady_state(jaxhb.load_scene("spur_pair"), rpm=5000.0).force(MESH)
    samples = force.samples(len(rows))
    np.testing.assert_array_equal(values[f"{MESH} tooth force N"], samples)
    angles = values["angle deg"]
    np.testing.assert_allclose(angles, force.angles_deg(len(rows)), rtol=1e-12)
    assert values["time s"][1] == pytest.approx(angles[1] / 360 / 5000 * 60)


@pytest.mark.slow
def test_a_motion_that_never_repeats_has_no_trace(run):
    completed = run(
        "solve spur_pair --rpm 6000 --set drive.mean=12.5 --set brake.mean=-12.5",
        "trace",
        status=1,
    )
    assert "--trace: no file, the motion never repeats" in completed.err
    assert not completed.path("trace").exists()
