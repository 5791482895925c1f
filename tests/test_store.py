"""Programs on disk: found by other processes, made again where damaged, never looked at
where foreign.
"""

import hashlib
import os
import pickle
import stat
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxhb
from jaxhb import _files, _private, _program, _store

CODE = """
import os, jax, jax.numpy as jnp
from jaxhb import _program
compiled = []
def note(*_, fun_name="", **__):
    compiled.append(fun_name)
jax.monitoring.register_event_duration_secs_listener(note)
_program._disk.package_hash = lambda: os.environ["SOURCES"].encode()
keep = _program.cache_programs if "WITH_JAX" in os.environ else _program.keep_programs
keep(_program._disk.user_folder())
def spectrum(matrix):
    return {"values": jnp.linalg.eigvalsh(matrix), "sum": jnp.sum(matrix)}
result = _program.Program(spectrum)(jnp.diag(jnp.arange(1.0, 4.0)).__array__())
count = sum(name.startswith("jit(spectrum") for name in compiled) // 2
print(count, result["values"].tolist(), float(result["sum"]))
"""
RESULT = "[1.0, 2.0, 3.0] 6.0"


def process(folder, sources="these", **variables):
    """A process that runs CODE with some sources of the package and keeps its programs
    in ``folder``.
    """
    settings = {"JAXHB_CACHE": str(folder), "SOURCES": sources}
    variables = os.environ | settings | variables
    # Programs that the tests share, out of jax's cache, would not be stored.
    del variables["JAX_COMPILATION_CACHE_DIR"]
    return subprocess.Popen(
        [sys.executable, "-c", CODE], stdout=-1, stderr=-1, text=True, env=variables
    )


def outcome(running):
    """Number of programs that a process compiled, and the result that it printed."""
    output, errors = running.communicate(timeout=120)
    assert running.returncode == 0, errors
    return output.split(maxsplit=1)


@pytest.fixture
def store(tmp_path):
    """A store in an empty folder of the test, in use while the test runs."""
    before = _program._store
    shared = jax.config.jax_persistent_cache_min_compile_time_secs
    # A program out of jax's cache is not stored: however slow the machine is, none of
    # these gets there.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 1e9)
    _program.keep_programs(tmp_path / "programs")
    yield _program._store
    _program._store = before
    jax.config.update("jax_persistent_cache_min_compile_time_secs", shared)


def double(x):
    return {"twice": 2.0 * x, "nothing": None}


def run(x=3.0):
    """Result of a fresh program, as for a process that has compiled nothing."""
    return _program.Program(double)(np.asarray(x))


def programs(store):
    return sorted(store.own_folder.glob("*.program"))


def compiled(call):
    """Number of programs compiled in a call, and its result."""
    programs_before = _program._held.programs
    names = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda *_, fun_name="", **__: names.append(fun_name)
    )
    result = call()
    assert _program._held.programs > programs_before
    # Each is named twice: lowered and compiled.
    return sum(name.startswith("jit(double") for name in names) // 2, result


@pytest.mark.slow
def test_processes_share_a_folder_and_run_what_another_compiled_lapack_included(
    tmp_path,
):
    """Two processes start together; a program that is loaded before anything else calls
    LAPACK crashes where its kernels are not set up.
    """
    together = [process(tmp_path) for _ in range(2)]
    assert {outcome(running)[1] for running in together} == {RESULT + "\n"}
    assert len(list((tmp_path / _store.SUBFOLDER).glob("*.program"))) == 1
    assert outcome(process(tmp_path)) == ["0", RESULT + "\n"]


@pytest.mark.slow
def test_a_new_version_keeps_its_programs_though_jax_kept_those_of_the_last(tmp_path):
    """A program out of jax's cache cannot be stored: every process would trace it
    again.
    """
    for sources in ("last", "new", "new"):
        result = outcome(process(tmp_path, sources, WITH_JAX="yes"))
    assert list((tmp_path / _store.SUBFOLDER / _store.JAX_SUBFOLDER).iterdir())
    assert result == ["0", RESULT + "\n"]


def test_a_program_is_found_by_function_static_arguments_and_kinds_of_others(store):
    assert compiled(run)[0] == 1
    assert compiled(run)[0] == 0
    assert compiled(lambda: run(np.float32(3.0)))[0] == 1
    assert compiled(lambda: run([1.0, 2.0]))[0] == 1
    assert len(programs(store)) == 3
    powers = [
        _program.Program(lambda x, n: x**n, static_argnames="n")(np.asarray(3.0), n=n)
        for n in (2, 3, 2)
    ]
    assert [float(power) for power in powers] == [9.0, 27.0, 9.0]
    assert len(programs(store)) == 5


@pytest.mark.parametrize(
    "damage", [lambda b: b[:-7], lambda b: b"", lambda b: b[:60] + b"?" + b[61:], None]
)
def test_a_damaged_program_is_made_again(store, damage):
    assert run()["twice"] == 6.0
    (file,) = programs(store)
    if damage:
        file.write_bytes(damage(file.read_bytes()))
    else:
        store.private.write(file.name, b"no pickle at all")
    count, result = compiled(run)
    assert count == 1
    assert float(result["twice"]) == 6.0
    assert result["nothing"] is None
    assert compiled(run)[0] == 0


def test_programs_of_other_versions_flags_and_settings_are_not_looked_at(
    store, monkeypatch
):
    run()
    with jax.default_matmul_precision("float32"):
        assert compiled(run)[0] == 1
        assert compiled(run)[0] == 0
    monkeypatch.setenv("XLA_FLAGS", os.environ["XLA_FLAGS"] + " ")
    _program.keep_programs(store.folder)
    assert compiled(run)[0] == 1
    monkeypatch.setattr(jax, "__version__", "0.0.0")
    _program.keep_programs(store.folder)
    assert compiled(run)[0] == 1
    assert len(programs(store)) == 4


def test_programs_not_used_for_longest_give_way(store):
    run()
    (first,) = programs(store)
    os.utime(first, (1.0, 1.0))
    store.limit = int(2.5 * first.stat().st_size)
    run([1.0])
    assert first in programs(store)
    run([1.0, 2.0])
    assert first not in programs(store)
    assert len(programs(store)) == 2


def test_no_file_but_programs_is_ever_removed(store, tmp_path):
    """Foreign files are older than the program and in its way: the limit is 0 bytes."""
    user_folder = Path(store.folder)
    folder = store.own_folder
    name = "0" * 64 + ".program"
    foreign = [
        user_folder / name,
        user_folder / "thesis.tex",
        user_folder / "jax" / f"jit_f-{'0' * 64}-cache",
        user_folder / "a" / "b" / name,
        folder / "thesis.tex",
        folder / "mine.program",
        folder / f"copy of {name}",
        folder / "a" / name,
        folder / "jax" / "letter-cache",
        folder / "jax" / name,
        folder / f".mine.{2**22 + 1}.part",
    ]
    outside = tmp_path / "outside"
    outside.mkdir()
    targets = [outside / "letter.odt", outside / "a" / name]
    for path in foreign + targets:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("not replaceable")
        os.utime(path, (1.0, 1.0))
    links = [
        folder / ("1" * 64 + ".program"),
        folder / ("2" * 64 + ".program"),
        folder / "jax" / f"jit_f-{'3' * 64}-cache",
    ]
    for link, target in zip(links, [targets[0], outside, targets[1]], strict=True):
        link.symlink_to(target)
    store.limit = 0
    run()
    run([1.0])
    assert {path.read_text() for path in foreign + targets} == {"not replaceable"}
    assert all(map(os.path.islink, links))
    run([1.0, 2.0])
    placed = links + foreign
    remaining = [path for path in folder.glob("*.program") if path not in placed]
    # Each made room for the next.
    assert len(remaining) == 1


def test_half_written_files_of_killed_processes_are_removed_and_no_others(store):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    abandoned, current = (
        store.own_folder / f".{'0' * 64}.program.{number}.part"
        for number in (ended.pid, os.getpid())
    )
    for path in (abandoned, current):
        path.write_bytes(b"half")
    run()
    assert not abandoned.exists()
    assert current.exists()


@pytest.mark.slow
def test_what_jax_keeps_beside_the_programs_is_within_the_limit_too(tmp_path):
    code = """if True:
        import sys, jax, jaxhb
        folder = jaxhb.cache_programs(sys.argv[1], limit=int(sys.argv[2]))
        print(*sorted(path.name[:6] for path in folder.glob("jax/*-cache")))
        jax.jit(lambda x: x + float(sys.argv[2]))(1.0)
    """
    environment = {
        name: value
        for name, value in os.environ.items()
        if name != "JAX_COMPILATION_CACHE_DIR"
    }
    environment["JAXHB_CACHE"] = str(tmp_path)

    def programs_of_jax(limit):
        command = [sys.executable, "-c", code, str(tmp_path), str(limit)]
        completed = subprocess.run(
            command, capture_output=True, text=True, check=True, env=environment
        )
        return completed.stdout.split()

    assert programs_of_jax(10**9) == []
    assert programs_of_jax(10**8) == ["jit__l"]
    assert programs_of_jax(0) == []


def test_a_folder_open_to_others_is_refused_and_an_impossible_one_keeps_nothing(
    tmp_path, capsys
):
    (tmp_path / "file").write_text("")
    store = _store.Store(tmp_path / "file" / "programs")
    assert store.own_folder is None
    assert store.load("key", ()) is None
    store.save("key", None)
    tmp_path.chmod(0o777)
    assert _store.Store(tmp_path).own_folder is None
    warning = capsys.readouterr().err
    assert "a change of its mode does not undo that. Remove it" in warning


def test_the_folder_is_in_the_cache_of_the_user_unless_the_environment_says_otherwise(
    tmp_path, monkeypatch
):
    monkeypatch.delenv("JAXHB_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert _store.user_folder() == tmp_path / "jaxhb"
    monkeypatch.setenv("JAXHB_CACHE", str(tmp_path / "here"))
    assert _store.user_folder() == tmp_path / "here"
    monkeypatch.setenv("JAXHB_CACHE", "off")
    assert _store.user_folder() is None
    assert jaxhb.cache_programs() is None


def test_arguments_that_the_program_was_not_compiled_for_are_left_to_jit(store):
    """Traced arguments and ones spread over devices have no executable of their own."""
    program = _program.Program(double)
    assert jax.jit(lambda x: program(x)["twice"])(2.0) == 4.0
    assert not programs(store)
    assert program(jnp.asarray(2.0))["twice"] == 4.0
    assert len(programs(store)) == 1


def test_a_program_whose_result_holds_functions_is_not_kept_and_runs(store):
    def pulled(x):
        return jax.vjp(lambda x: jax.jit(jnp.sin)(x) ** 2, x)

    value, pull = _program.Program(pulled)(np.asarray(1.0))
    # The derivative of sin^2 x is sin 2x.
    assert float(pull(np.asarray(1.0))[0]) == pytest.approx(np.sin(2.0), rel=1e-12)
    assert float(value) == pytest.approx(np.sin(1.0) ** 2, rel=1e-12)


def planted(content):
    """File of another user who knows how files look, but not the key of the folder."""
    seal = hashlib.blake2b(content, key=bytes(32), digest_size=32).digest()
    return content + seal


class Harmful:
    """An object whose pickle does harm where it is read."""

    def __reduce__(self):
        return exec, ("import os; os.environ['JAXHB_HARMED'] = 'yes'",)


def test_a_program_that_was_planted_is_never_read_and_is_made_again(store):
    run()
    (file,) = programs(store)
    file.write_bytes(planted(pickle.dumps(Harmful())))
    assert compiled(run)[0] == 1
    assert "JAXHB_HARMED" not in os.environ
    assert compiled(run)[0] == 0


def test_a_program_under_the_name_of_another_is_damage_and_is_made_again(store):
    """The other program is sound in itself, and its arguments are alike."""

    def power(n):
        program = _program.Program(lambda x, n: x**n, static_argnames="n")
        return float(program(np.asarray(3.0), n=n))

    assert power(2) == 9.0
    (first,) = programs(store)
    assert power(3) == 27.0
    (second,) = set(programs(store)) - {first}
    second.write_bytes(first.read_bytes())
    assert power(3) == 27.0
    assert second.read_bytes() != first.read_bytes()


IN_PLACE = {
    "a pipe": lambda path, aside: os.mkfifo(path),
    "a link": lambda path, aside: path.symlink_to(aside),
    "a folder": lambda path, aside: path.mkdir(),
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
@pytest.mark.parametrize("kind", IN_PLACE)
def test_what_is_no_file_in_place_of_a_program_is_neither_waited_for_nor_followed(
    store, tmp_path, kind
):
    run()
    (file,) = programs(store)
    aside = file.rename(tmp_path / "aside")
    content = aside.read_bytes()
    IN_PLACE[kind](file, aside)
    # Nobody removes a folder.
    stays = kind == "a folder"
    assert compiled(run)[0] == 1
    assert compiled(run)[0] == stays
    assert file.is_file() or stays
    assert not file.is_symlink()
    assert aside.read_bytes() == content


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no modes of files")
@pytest.mark.parametrize("name", [_private.KEY, "program"])
def test_a_file_that_others_could_write_counts_for_nothing(store, name):
    run()
    (file,) = programs(store)
    (file if name == "program" else file.with_name(name)).chmod(0o666)
    _program.keep_programs(store.folder)
    assert compiled(run)[0] == 1
    assert compiled(run)[0] == 0
    modes = [stat.S_IMODE(path.stat().st_mode) for path in store.own_folder.iterdir()]
    assert all(not mode & 0o077 for mode in modes)


@pytest.mark.skipif(
    not hasattr(os, "getuid") or os.getuid() != 0, reason="only root gives files away"
)
@pytest.mark.parametrize("name", [_private.KEY, "program", "."])
def test_what_another_user_owns_counts_for_nothing(store, name, capsys):
    run()
    (file,) = programs(store)
    os.chown({"program": file}.get(name, file.parent / name), 12345, -1)
    _program.keep_programs(store.folder)
    assert compiled(run)[0] == 1
    warned = "Remove it with all that is in it" in capsys.readouterr().err
    assert warned == (name == ".")


def test_what_jax_would_find_of_others_is_removed_before_it_looks(store, tmp_path):
    folder = store.jax_folder()
    names = {"mine": 0o600, "open to others": 0o666}
    for name, mode in names.items():
        (folder / name).write_text("")
        (folder / name).chmod(mode)
    (folder / "link").symlink_to(tmp_path)
    assert [path.name for path in store.jax_folder().iterdir()] == ["mine"]
    assert tmp_path.is_dir()
    folder.chmod(0o777)
    assert store.jax_folder() is None


def test_files_keep_their_modes_and_no_link_leads_what_is_written_elsewhere(
    tmp_path, monkeypatch
):
    report = tmp_path / "report.json"
    new = tmp_path / "new.json"
    elsewhere = tmp_path / "elsewhere"
    report.write_text("old")
    report.chmod(0o600)
    elsewhere.write_text("not mine to change")
    # Another user guesses the name of the unfinished file.
    monkeypatch.setattr("os.urandom", lambda count: count * b"\0")
    (tmp_path / f".new.json.00000000.{os.getpid()}.part").symlink_to(elsewhere)
    _files.write_whole({report: [b"new"]})
    assert report.read_text() == "new"
    assert stat.S_IMODE(report.stat().st_mode) == 0o600
    with pytest.raises(FileExistsError):
        _files.write_whole({new: [b"new"]})
    assert elsewhere.read_text() == "not mine to change"
