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
from reference_data import reference

import jaxhb
from jaxhb import _store
from jaxhb.cli import commands, resume
from jaxhb.cli.main import main
from jaxhb.cli.progress import Progress
from jaxhb.cli.streams import Ended, guarded
from jaxhb.report.files.output import write_files
from jaxhb.results.steady import orbit_state
from jaxhb.steady import orbits

SCENES = Path(__file__).parents[2] / "jaxhb" / "scene" / "scenes"
MESH = "gear a|gear b"


def process(*arguments, **options):
    """A process of its own: (exit status, output, errors)."""
    command = [sys.executable, "-m", "jaxhb", *arguments]
    given = {
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "env": os.environ,
    } | options
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


@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="no device that is always full"
)
def test_a_full_disk_and_a_closed_pipe_behind_standard_output_are_sentences():
    reading, writing = os.pipe()
    os.close(reading)
    told = (
        "standard output cannot be written: No space left on device.",
        "standard output was closed before all of it was",
    )
    for place, code, sentence in zip(
        ("/dev/full", writing), (2, 141), told, strict=True
    ):
        with open(place, "w") as stream:
            status, _, said = process("scenes", stdout=stream)
        assert status == code and said.startswith(sentence) and said.count("\n") == 1


SHELL = pytest.mark.skipif(
    os.name != "posix", reason="the shell of the test is that of POSIX"
)


def shell(line, *arguments, **options):
    """A line of the shell in which ``jaxhb`` is the program: (exit status, output,
    errors).
    """
    command = f'jaxhb() {{ {shlex.quote(sys.executable)} -m jaxhb "$@"; }}\n{line}'
    done = subprocess.run(
        ["sh", "-c", command, "sh", *arguments],
        check=False,
        text=True,
        capture_output=True,
        **options,
    )
    return done.returncode, done.stdout, done.stderr


@SHELL
@pytest.mark.parametrize(
    "words", ["scenes", "--version", "scene spur_pair", "scenes --help"]
)
def test_a_closed_standard_output_is_a_sentence(words):
    told = "standard output cannot be written: it is closed.\n"
    assert shell(f"jaxhb {words} >&-") == (2, "", told)


@SHELL
def test_an_error_goes_nowhere_else_where_standard_error_is_closed():
    assert shell("jaxhb modes nowhere.toml 2>&-") == (2, "", "")


@SHELL
def test_files_are_written_though_standard_output_is_closed(tmp_path):
    status, _, told = shell(
        'jaxhb scene spur_pair --out "$1" >&-', str(tmp_path / "copy.toml")
    )
    assert status == 2 and told == "standard output cannot be written: it is closed.\n"
    assert jaxhb.load_scene(tmp_path / "copy.toml").topology.mesh_names == (MESH,)


@SHELL
@pytest.mark.parametrize(
    "words", ["new x.toml", "tune spur_pair", "scene spur_pair --out x.toml"]
)
def test_a_working_folder_that_was_removed_is_a_sentence(words, tmp_path):
    status, said, told = shell(
        f'mkdir "$1" && cd "$1" && rmdir "$1" && jaxhb {words}', str(tmp_path / "gone")
    )
    wanted = (
        "the folder in which jaxhb was started is not there any more. Go to another"
        " one.\n"
    )
    assert (status, said, told) == (2, "", wanted)


@SHELL
def test_a_limit_of_memory_that_the_compiler_cannot_keep_is_a_sentence():
    status, said, told = shell("ulimit -v 1000000 && jaxhb solve spur_pair --rpm 2000")
    wanted = (
        "the limit of memory (ulimit -v) is 1 GB, must be at least 2 GB. Raise it.\n"
    )
    assert (status, said, told) == (2, "", wanted)
    assert shell("ulimit -v 1000000 && jaxhb scenes && jaxhb --version")[0] == 0
    program = "import jaxhb; jaxhb.solve(jaxhb.load_scene('spur_pair'), rpm=2000.0)"
    status, _, told = shell(f'ulimit -v 1000000 && "{sys.executable}" -c "{program}"')
    assert status == 1 and told.endswith(f"MemoryError: {wanted}")


@SHELL
@pytest.mark.parametrize(
    ("make", "kind"),
    [("mkdir", "folder"), ("mkfifo", "pipe"), ("ln -s /dev/null", "device")],
)
def test_what_is_there_and_is_no_file_is_not_called_missing(make, kind, tmp_path):
    status, said, told = shell(
        f'cd "$1" && {make} train && jaxhb modes train', str(tmp_path)
    )
    wanted = f"train: the file is a {kind}, must be a regular file. Correct the name.\n"
    assert (status, said, told) == (2, "", wanted)


def test_memory_that_does_not_suffice_is_a_sentence(monkeypatch, capsys):
    def fails(*_, **__):
        raise MemoryError

    monkeypatch.setattr(commands, "solve", fails)
    assert main(["solve", "spur_pair", "--rpm", "2000"]) == 3
    assert capsys.readouterr().err.startswith(
        "there is not enough memory for what was asked."
    )


@pytest.mark.slow
def test_names_that_a_terminal_cannot_encode_are_written_with_a_backslash(scene):
    scene.write_text(
        scene.read_text(encoding="utf-8").replace("gear a", "Zahnrad ä"),
        encoding="utf-8",
    )
    env = os.environ | {"PYTHONIOENCODING": "ascii"}
    status, said, told = process("scene", str(scene), env=env)
    assert (status, told) == (0, "") and "Zahnrad \\xe4" in said
    status, said, told = process(
        "modes", str(scene), "--json", "-", env=env, encoding="utf-8"
    )
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


@pytest.mark.parametrize(("line", "option"), reference("cases")["never written over"])
def test_what_a_command_reads_is_never_written_over(line, option, scene, run):
    table = scene.with_name("spur_pair_omega_squared.csv")
    link = scene.with_name("link")
    link.symlink_to(table)
    before = scene.read_bytes(), table.read_bytes()
    called = run(
        line.replace("SCENE", str(scene))
        .replace("TABLE", str(table))
        .replace("LINK", str(link))
    )
    assert called.status == 2 and called.err.startswith(f"{option}: ")
    assert (scene.read_bytes(), table.read_bytes()) == before


def test_a_tuning_writes_over_nothing_that_it_did_not_write(tmp_path, run, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("engine_with_damper_tuned.toml").write_text("# mine")
    called = run("tune engine_with_damper")
    assert called.status == 2 and "is there and is not from jaxhb tune" in called.err
    assert Path("engine_with_damper_tuned.toml").read_text() == "# mine"


def test_half_written_files_of_killed_processes_are_removed(tmp_path):
    (tmp_path / ".r.json.999999999.part").write_bytes(b"{")
    write_files({str(tmp_path / "r.json"): [b"{}"]})
    assert [path.name for path in tmp_path.iterdir()] == ["r.json"]


def test_json_on_standard_output_is_all_that_is_there_and_quiet_commands_print_nothing(
    run,
):
    called = run("solve spur_pair --rpm 2000 --json -")
    assert json.loads(called.out)["rpm"] == 2000.0 and called.err == ""
    called = run("solve spur_pair --rpm 2000 --quiet", "csv")
    assert (called.out, called.err) == ("", "") and called.rows[0]["rpm"] == "2000.0"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "powershell"])
def test_there_is_a_script_for_every_shell(shell, run):
    script = run(f"completion {shell}").out
    assert "jaxhb" in script and f"_JAXHB_COMPLETE={shell}" in script.replace(
        " = '", "="
    )


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
@pytest.mark.parametrize("quote, given", [("", r"cylinder\ A3"), ("'", "cylinder A3")])
def test_bash_itself_completes_a_name_with_a_space(quote, given, tmp_path):
    program = tmp_path / "jaxhb"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m jaxhb "$@"\n')
    program.chmod(0o755)
    typed = shlex.quote(f"{quote}{given}")
    code = f'''compopt() {{ :; }}; eval "$(jaxhb completion bash)"; COMP_CWORD=4
        COMP_WORDS=(jaxhb solve gear_train_30 --misfire {typed}); _jaxhb_completion jaxhb; echo "${{COMPREPLY[@]}}"'''
    env = os.environ | {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "--norc", "-c", code],
        check=False,
        capture_output=True,
        text=True,
        env=env,
    )
    assert (done.stderr, done.stdout) == ("", f"{given}\n")


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
    call = (f"sweep spur_pair --rpm 4600,5000,5400 --chunk 1 {orbit}", "json", "csv")
    solved = []
    note = commands._SweepFiles.note

    def stop(self, found):
        note(self, found)
        if sum(map(len, found.values())) == 2:
            raise Ended(signal.SIGTERM)

    with monkeypatch.context() as stopped:
        stopped.setattr(commands._SweepFiles, "note", stop)
        called = run(*call)
    assert called.status == 143 and called.err.startswith(
        "stopped; 2 of 3 speeds are done in "
    )
    assert called.err.endswith("the same command goes on from there\n")
    assert (
        called.json["rpm"] == [row["rpm"] for row in called.json["responses"]]
        and not called.json["complete"]
    )
    assert len(called.rows) == 2
    (folder,) = (cache / resume.FOLDER).glob("[!.]*")
    assert list(folder.glob("*.npz"))
    monkeypatch.setattr(
        orbits,
        "orbit_state",
        lambda response: solved.append(response) or orbit_state(response),
    )
    called = run(*call)
    assert [float(response.rpm) for response in solved] == ([5400.0] if orbit else [])
    assert (
        called.status == 0
        and called.json["complete"]
        and called.json["rpm"] == [4600.0, 5000.0, 5400.0]
    )
    assert not folder.exists()  # what is done is not kept
    assert sorted(path.name for path in called.folder.iterdir() if path.is_file()) == [
        "csv.csv",
        "json.json",
    ]


def test_a_report_that_is_stopped_goes_on_where_it_was(run, cache, monkeypatch):
    call = "report spur_pair --rpm 2000,5000 --orbit", "json"

    def stop(progress, count):
        raise KeyboardInterrupt

    with monkeypatch.context() as stopped:
        stopped.setattr(Progress, "advance", stop)
        called = run(*call)
    assert called.status == 130 and called.err.endswith(
        "the same command goes on from there\n"
    )
    (folder,) = (cache / resume.FOLDER).glob("[!.]*")
    assert [path.name for path in folder.glob("[!.]*")] == ["0"]
    called = run(*call)
    assert called.status == 0 and called.path("json").exists() and not folder.exists()


def test_what_a_stopped_command_left_is_forgotten_after_a_month(cache):
    train = jaxhb.load_scene("spur_pair")
    month = 86400 * resume.FORGOTTEN_AFTER
    folders = [
        resume.Unfinished([train], asked).folder.folder for asked in ("old", "recent")
    ]
    for folder, age in zip(folders, (month + 60, month - 60), strict=True):
        (folder / "0 2000").mkdir(parents=True)
        (folder / "0 2000" / "sweep.json").write_text("")
        os.utime(folder, (time.time() - age,) * 2)
    own = resume.Unfinished([train], "another command")
    assert [folder.exists() for folder in folders] == [False, True]
    own.forget()  # there is none


def test_a_sweep_that_cannot_be_kept_goes_on_without_and_says_so_once(
    run, cache, monkeypatch
):
    cache.write_text("no folder")
    monkeypatch.setattr(_store, "_printed", set())
    called = run("sweep spur_pair --rpm 5000", "csv")
    assert called.status == 0 and called.path("csv").exists()
    assert called.err.count("\n") == 1 and str(cache) in called.err


def test_a_sweep_lists_amplitudes_only_where_it_is_asked_to(told):
    sizes = []
    for asked in ("", "--orders 64", "--full"):
        (mesh,) = (
            told(f"sweep spur_pair --rpm 2000,5000 {asked}", "json")
            .json["responses"][1]["meshes"]
            .values()
        )
        sizes.append(len(mesh["amplitudes"]))
    assert sizes[:2] == [0, 2] and sizes[2] > 100


def test_a_sweep_goes_over_a_number_of_the_scene(run):
    name = f"{MESH}.backlash"
    called = run(
        f"sweep spur_pair --rpm 5000 --over '{name}=1e-4:2e-4:2'",
        "json",
        "csv",
        "netcdf",
        "plot",
    )
    record = called.json
    assert called.status == 0 and called.out.startswith(
        f"Teeth separate at 2 of 2 values of {name} between 0.0001 and"
    )
    assert (
        record["over"] == {"name": name, "unit": "m", "values": [1e-4, 2e-4]}
        and record["rpm"] == [5000.0] * 2
    )
    wide = jaxhb.load_scene("spur_pair").replace({name: 2e-4})
    alone = jaxhb.steady_state(wide, rpm=5000.0).force(MESH).max
    assert record["responses"][1]["meshes"][MESH]["max"] == pytest.approx(
        float(alone), rel=1e-2
    )
    assert [float(row[f"{name}, m"]) for row in called.rows] == [1e-4, 2e-4]
    assert called.path("netcdf").read_bytes()[:3] == b"CDF" and called.is_drawn


@pytest.mark.slow
def test_a_trace_is_the_motion_over_the_crank_angle(run):
    called = run("solve spur_pair --rpm 5000", "trace")
    heads, *rows = called.path("trace").read_text().splitlines()
    values = dict(zip(heads.split(","), np.loadtxt(rows, delimiter=",").T, strict=True))
    force = jaxhb.steady_state(jaxhb.load_scene("spur_pair"), rpm=5000.0).force(MESH)
    np.testing.assert_array_equal(
        values[f"{MESH} tooth force N"], force.samples(len(rows))
    )
    np.testing.assert_allclose(
        values["angle deg"], force.angles_deg(len(rows)), rtol=1e-12
    )
    assert values["time s"][1] == pytest.approx(
        values["angle deg"][1] / 360 / 5000 * 60
    )
    called.path("trace").unlink()
    called = run(
        "solve spur_pair --rpm 6000 --set drive.mean=12.5 --set brake.mean=-12.5",
        "trace",
    )
    assert (
        called.status == 1
        and "--trace: no file, the motion never repeats" in called.err
    )
    assert not called.path("trace").exists()
