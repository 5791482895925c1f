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
jax.monitoring.register_event_duration_secs_listener(lambda *_, fun_name="", **__: compiled.append(fun_name))
_program._disk.package_hash = lambda: os.environ["SOURCES"].encode()
(_program.cache_programs if "WITH_JAX" in os.environ else _program.keep_programs)(_program._disk.user_folder())
def spectrum(matrix):
    return {"values": jnp.linalg.eigvalsh(matrix), "sum": jnp.sum(matrix)}
found = _program.Program(spectrum)(jnp.diag(jnp.arange(1.0, 4.0)).__array__())
print(sum(name.startswith("jit(spectrum") for name in compiled) // 2, found["values"].tolist(), float(found["sum"]))
"""
RESULT = "[1.0, 2.0, 3.0] 6.0"


def process(folder, sources="these", **environment):
    """A process that runs CODE with some sources of the package, its programs kept in
    ``folder``.
    """
    environment = (
        os.environ | {"JAXHB_CACHE": str(folder), "SOURCES": sources} | environment
    )
    if "WITH_JAX" in environment:
        del environment["JAX_COMPILATION_CACHE_DIR"]
    return subprocess.Popen(
        [sys.executable, "-c", CODE], stdout=-1, stderr=-1, text=True, env=environment
    )


def told(running):
    """How many programs it compiled, and what it found."""
    output, errors = running.communicate(timeout=120)
    assert running.returncode == 0, errors
    return output.split(maxsplit=1)


@pytest.fixture
def kept(tmp_path):
    """A store in an empty folder of the test, in use while the test runs."""
    before = _program._store
    _program.keep_programs(tmp_path / "programs")
    yield _program._store
    _program._store = before


def double(x):
    return {"twice": 2.0 * x, "nothing": None}


def run(x=3.0):
    """A fresh program's result, as a process that has compiled nothing would get it."""
    return _program.Program(double)(np.asarray(x))


def programs(store):
    return sorted(store.own_folder.glob("*.program"))


def compiled(call):
    """Programs compiled in a call, and what it returns."""
    before = _program._held.programs
    names = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda *_, fun_name="", **__: names.append(fun_name)
    )
    result = call()
    assert _program._held.programs > before
    return (
        sum(name.startswith("jit(double") for name in names) // 2,
        result,
    )  # lowered and compiled


def test_processes_share_a_folder_and_run_what_another_compiled_lapack_included(
    tmp_path,
):
    """Two start together; loaded before anything else calls LAPACK, such a program
    crashes where its kernels are not set up.
    """
    running = [process(tmp_path) for _ in range(2)]
    assert {told(one)[1] for one in running} == {RESULT + "\n"}
    assert len(list((tmp_path / _store.SUBFOLDER).glob("*.program"))) == 1
    assert told(process(tmp_path)) == ["0", RESULT + "\n"]


def test_a_new_version_keeps_its_programs_though_jax_kept_those_of_the_last(tmp_path):
    """One out of jax's cache cannot be stored: every process would trace it again."""
    for sources in ("last", "new", "new"):
        compiled = told(process(tmp_path, sources, WITH_JAX="yes"))
    assert list((tmp_path / _store.SUBFOLDER / _store.JAX_SUBFOLDER).iterdir())
    assert compiled == ["0", RESULT + "\n"]


def test_a_program_is_found_by_its_function_its_static_arguments_and_the_kinds_of_the_others(
    kept,
):
    assert compiled(run)[0] == 1 and compiled(run)[0] == 0
    assert compiled(lambda: run(np.float32(3.0)))[0] == 1
    assert compiled(lambda: run([1.0, 2.0]))[0] == 1
    assert len(programs(kept)) == 3
    powers = [
        _program.Program(lambda x, n: x**n, static_argnames="n")(np.asarray(3.0), n=n)
        for n in (2, 3, 2)
    ]
    assert [float(power) for power in powers] == [9.0, 27.0, 9.0]
    assert len(programs(kept)) == 5


@pytest.mark.parametrize(
    "damage", [lambda b: b[:-7], lambda b: b"", lambda b: b[:60] + b"?" + b[61:], None]
)
def test_a_damaged_program_is_made_again(kept, damage):
    assert run()["twice"] == 6.0
    (file,) = programs(kept)
    if damage:
        file.write_bytes(damage(file.read_bytes()))
    else:
        kept.private.write(file.name, b"no pickle at all")
    count, result = compiled(run)
    assert (count, float(result["twice"]), result["nothing"]) == (1, 6.0, None)
    assert compiled(run)[0] == 0


def test_programs_of_other_versions_flags_and_settings_are_not_looked_at(
    kept, monkeypatch
):
    run()
    with jax.default_matmul_precision("float32"):
        assert compiled(run)[0] == 1 and compiled(run)[0] == 0
    monkeypatch.setenv("XLA_FLAGS", os.environ["XLA_FLAGS"] + " ")
    _program.keep_programs(kept.folder)
    assert compiled(run)[0] == 1
    monkeypatch.setattr(jax, "__version__", "0.0.0")
    _program.keep_programs(kept.folder)
    assert compiled(run)[0] == 1
    assert len(programs(kept)) == 4


def test_programs_not_used_for_longest_give_way(kept):
    run()
    (first,) = programs(kept)
    os.utime(first, (1.0, 1.0))
    kept.limit = int(2.5 * first.stat().st_size)
    run([1.0])
    assert first in programs(kept)
    run([1.0, 2.0])
    assert first not in programs(kept) and len(programs(kept)) == 2


def test_no_file_but_programs_is_ever_removed(kept, tmp_path):
    """All older than the program, and in its way, as no byte may be kept."""
    given = Path(kept.folder)
    own = kept.own_folder
    name = "0" * 64 + ".program"
    foreign = [
        given / name,
        given / "thesis.tex",
        given / "jax" / f"jit_f-{'0' * 64}-cache",
        given / "a" / "b" / name,
    ]
    foreign += [
        own / "thesis.tex",
        own / "mine.program",
        own / f"copy of {name}",
        own / "a" / name,
    ]
    foreign += [
        own / "jax" / "letter-cache",
        own / "jax" / name,
        own / f".mine.{2**22 + 1}.part",
    ]
    outside = tmp_path / "outside"
    outside.mkdir()
    aims = [outside / "letter.odt", outside / "a" / name]
    for path in foreign + aims:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("not replaceable")
        os.utime(path, (1.0, 1.0))
    links = [
        own / ("1" * 64 + ".program"),
        own / ("2" * 64 + ".program"),
        own / "jax" / f"jit_f-{'3' * 64}-cache",
    ]
    for link, aim in zip(links, [aims[0], outside, aims[1]], strict=True):
        link.symlink_to(aim)
    kept.limit = 0
    run()
    run([1.0])
    assert {path.read_text() for path in foreign + aims} == {"not replaceable"} and all(
        map(os.path.islink, links)
    )
    run([1.0, 2.0])
    programs = [path for path in own.glob("*.program") if path not in links + foreign]
    assert len(programs) == 1  # each made room for the next


def test_what_killed_processes_left_half_written_is_removed_and_what_others_write_is_not(
    kept,
):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    left, written = (
        kept.own_folder / f".{'0' * 64}.program.{number}.part"
        for number in (ended.pid, os.getpid())
    )
    for path in (left, written):
        path.write_bytes(b"half")
    run()
    assert not left.exists() and written.exists()


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

    def there(limit):
        command = [sys.executable, "-c", code, str(tmp_path), str(limit)]
        return subprocess.run(
            command, capture_output=True, text=True, check=True, env=environment
        ).stdout.split()

    assert there(10**9) == [] and there(10**8) == ["jit__l"] and there(0) == []


def test_a_folder_that_others_may_write_is_refused_and_one_that_cannot_be_made_keeps_nothing(
    tmp_path, capsys
):
    (tmp_path / "file").write_text("")
    store = _store.Store(tmp_path / "file" / "programs")
    assert store.own_folder is None and store.load("key", ()) is None
    store.save("key", None)
    tmp_path.chmod(0o777)
    assert _store.Store(tmp_path).own_folder is None
    assert (
        "a change of its mode does not undo that. Remove it" in capsys.readouterr().err
    )


def test_the_folder_is_in_the_cache_of_the_user_unless_the_environment_says_otherwise(
    tmp_path, monkeypatch
):
    monkeypatch.delenv("JAXHB_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert _store.user_folder() == tmp_path / "jaxhb"
    monkeypatch.setenv("JAXHB_CACHE", str(tmp_path / "here"))
    assert _store.user_folder() == tmp_path / "here"
    monkeypatch.setenv("JAXHB_CACHE", "off")
    assert _store.user_folder() is None and jaxhb.cache_programs() is None


def test_arguments_that_the_program_was_not_compiled_for_are_left_to_jit(kept):
    """Traced ones and those spread over devices have no executable of their own."""
    program = _program.Program(double)
    assert jax.jit(lambda x: program(x)["twice"])(2.0) == 4.0
    assert not programs(kept)
    assert program(jnp.asarray(2.0))["twice"] == 4.0
    assert len(programs(kept)) == 1


def test_a_program_whose_result_holds_functions_is_not_kept_and_runs(kept):
    def pulled(x):
        return jax.vjp(lambda x: jax.jit(jnp.sin)(x) ** 2, x)

    value, pull = _program.Program(pulled)(np.asarray(1.0))
    assert float(pull(np.asarray(1.0))[0]) == pytest.approx(
        np.sin(2.0), rel=1e-12
    )  # d sin2 = sin 2x
    assert float(value) == pytest.approx(np.sin(1.0) ** 2, rel=1e-12)


def planted(content):
    """What another user writes who knows how files look, but not the key of the
    folder.
    """
    seal = hashlib.blake2b(content, key=bytes(32), digest_size=32).digest()
    return content + seal


class Harmful:
    """An object whose pickle does harm where it is read."""

    def __reduce__(self):
        return exec, ("import os; os.environ['JAXHB_HARMED'] = 'yes'",)


def test_a_program_that_was_planted_is_never_read_and_is_made_again(kept):
    run()
    (file,) = programs(kept)
    file.write_bytes(planted(pickle.dumps(Harmful())))
    assert compiled(run)[0] == 1 and "JAXHB_HARMED" not in os.environ
    assert compiled(run)[0] == 0


def test_a_program_under_the_name_of_another_is_damage_and_is_made_again(kept):
    """Sound in itself, and its arguments alike."""

    def power(n):
        return float(
            _program.Program(lambda x, n: x**n, static_argnames="n")(
                np.asarray(3.0), n=n
            )
        )

    assert power(2) == 9.0
    (first,) = programs(kept)
    assert power(3) == 27.0
    (second,) = set(programs(kept)) - {first}
    second.write_bytes(first.read_bytes())
    assert power(3) == 27.0 and second.read_bytes() != first.read_bytes()


IN_PLACE = {
    "a pipe": lambda path, aside: os.mkfifo(path),
    "a link": lambda path, aside: path.symlink_to(aside),
    "a folder": lambda path, aside: path.mkdir(),
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
@pytest.mark.parametrize("kind", IN_PLACE)
def test_what_is_no_file_in_place_of_a_program_is_neither_waited_for_nor_followed(
    kept, tmp_path, kind
):
    run()
    (file,) = programs(kept)
    aside = file.rename(tmp_path / "aside")
    content = aside.read_bytes()
    IN_PLACE[kind](file, aside)
    assert compiled(run)[0] == 1 and compiled(run)[0] == (
        kind == "a folder"
    )  # which nobody removes
    assert (
        (file.is_file() or kind == "a folder")
        and not file.is_symlink()
        and aside.read_bytes() == content
    )


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no modes of files")
@pytest.mark.parametrize("name", [_private.KEY, "program"])
def test_a_file_that_others_could_write_counts_for_nothing(kept, name):
    run()
    (file,) = programs(kept)
    (file if name == "program" else file.with_name(name)).chmod(0o666)
    _program.keep_programs(kept.folder)
    assert compiled(run)[0] == 1 and compiled(run)[0] == 0
    assert all(
        not stat.S_IMODE(path.stat().st_mode) & 0o077
        for path in kept.own_folder.iterdir()
    )


@pytest.mark.skipif(
    not hasattr(os, "getuid") or os.getuid() != 0, reason="only root gives files away"
)
@pytest.mark.parametrize("name", [_private.KEY, "program", "."])
def test_what_another_user_owns_counts_for_nothing(kept, name, capsys):
    run()
    (file,) = programs(kept)
    os.chown({"program": file}.get(name, file.parent / name), 12345, -1)
    _program.keep_programs(kept.folder)
    assert compiled(run)[0] == 1
    assert ("Remove it with all that is in it" in capsys.readouterr().err) == (
        name == "."
    )


def test_what_jax_would_find_of_others_is_removed_before_it_looks(kept, tmp_path):
    folder = kept.jax_folder()
    names = {"mine": 0o600, "open to others": 0o666}
    for name, mode in names.items():
        (folder / name).write_text("")
        (folder / name).chmod(mode)
    (folder / "link").symlink_to(tmp_path)
    assert [path.name for path in kept.jax_folder().iterdir()] == [
        "mine"
    ] and tmp_path.is_dir()
    folder.chmod(0o777)
    assert kept.jax_folder() is None


def test_files_keep_their_modes_and_no_link_leads_what_is_written_elsewhere(
    tmp_path, monkeypatch
):
    report, new, elsewhere = (
        tmp_path / name for name in ("report.json", "new.json", "elsewhere")
    )
    report.write_text("old")
    report.chmod(0o600)
    elsewhere.write_text("not mine to change")
    monkeypatch.setattr("os.urandom", lambda count: count * b"\0")  # guessed
    (tmp_path / f".new.json.00000000.{os.getpid()}.part").symlink_to(elsewhere)
    _files.write_whole({report: [b"new"]})
    assert report.read_text() == "new" and stat.S_IMODE(report.stat().st_mode) == 0o600
    with pytest.raises(FileExistsError):
        _files.write_whole({new: [b"new"]})
    assert elsewhere.read_text() == "not mine to change"
