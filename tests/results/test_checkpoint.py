"""Sweeps that are stopped and go on compute nothing twice, and their numbers are the
same to the last bit.
"""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
import trains
from reference_data import refused

import jaxhb
from jaxhb._private import KEY
from jaxhb.results.checkpoint import (
    MANIFEST,
    Cached,
    Checkpoint,
    CheckpointError,
    digest,
)
from jaxhb.results.serial import pack, unpack

OMEGA = np.array([0.7, 0.8, 1.0, 1.1, 1.2, 1.5])
"""Speeds over the natural frequency with motions of period one and two cycles, and an
irregular one.
"""


@pytest.fixture(scope="module")
def pair():
    return trains.pair_train(trains.Pair(1.0), transition=1e-3)


def swept(train, folder, *, chunk=2, harmonics=64, exact=True, progress=None):
    """A sweep over OMEGA that a folder stores."""
    return jaxhb.steady_state(
        train,
        rpm=OMEGA * trains.ONE_RADIAN_PER_SECOND,
        out=folder,
        chunk=chunk,
        harmonics=harmonics,
        exact=exact,
        progress=progress,
    )


def assert_same_numbers(sweep, expected_sweep):
    """Two sweeps hold the same numbers to the last bit."""
    for state, expected in zip(sweep, expected_sweep, strict=True):
        index, arrays = pack(state)
        expected_index, expected_arrays = pack(expected)
        assert index == expected_index
        for array, expected_array in zip(arrays, expected_arrays, strict=True):
            np.testing.assert_array_equal(array, expected_array)


@pytest.fixture(scope="module")
def stored_sweep(pair, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep") / "whole"
    return folder, swept(pair, folder)


@pytest.mark.slow
def test_a_sweep_that_was_stopped_goes_on_with_the_same_numbers(
    pair, stored_sweep, tmp_path
):
    folder, whole = stored_sweep
    assert len(set(whole.kind)) > 1
    solved = 0

    def stop(count):
        nonlocal solved
        solved += count
        if solved > 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        swept(pair, tmp_path, progress=stop)
    before = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")}
    assert 0 < len(before) < len(list(folder.glob("*.npz")))
    assert_same_numbers(swept(pair, tmp_path), whole)
    after = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert before.items() <= after.items()
    assert sorted(after) == sorted(path.name for path in folder.iterdir())


@pytest.mark.slow
def test_a_sweep_that_is_done_is_only_read(pair, stored_sweep):
    folder, whole = stored_sweep
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    again = swept(pair, folder)
    assert_same_numbers(again, whole)
    assert before == {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert again[0].response is None or jaxhb.stability(again[0].response).stable
    assert jax.tree.structure(again[0].response) == jax.tree.structure(
        whole[0].response
    )


@pytest.mark.slow
def test_a_damaged_file_is_made_again(pair, stored_sweep, tmp_path):
    folder, whole = stored_sweep
    for path in folder.iterdir():
        shutil.copy(path, tmp_path)
    first, second, *_ = sorted(tmp_path.glob("*.npz"))
    (tmp_path / ".half.999999999.part").write_bytes(b"of a process that was killed")
    first.write_bytes(first.read_bytes()[:500])
    second.write_bytes(b"")
    assert_same_numbers(swept(pair, tmp_path), whole)
    assert first.read_bytes() == (folder / first.name).read_bytes()
    assert [path.name for path in tmp_path.glob(".*")] == [KEY]


@pytest.mark.slow
def test_a_folder_of_another_question_is_refused(pair, stored_sweep, tmp_path):
    folder, _ = stored_sweep
    questions = {
        "the same scene with other numbers": (pair.replace({"a.inertia": 3.0}), {}),
        "other options: harmonics 64 there, 128 now": (pair, {"harmonics": 128}),
        "other options: speeds of a chunk 2 there, 3 now": (pair, {"chunk": 3}),
        "other options: exact True there, False now": (pair, {"exact": False}),
        "scene 'test train'": (jaxhb.load_scene("spur_pair"), {}),
    }
    for words, (train, changes) in questions.items():
        with pytest.raises(CheckpointError, match=words):
            swept(train, folder, **changes)
    refused(lambda: swept(pair, folder, chunk=0), "chunk is 0", CheckpointError)
    manifest = json.loads((folder / MANIFEST).read_text())
    manifest["versions"]["jax"] = "0.1"
    (tmp_path / MANIFEST).write_text(json.dumps(manifest))
    refused(
        lambda: swept(pair, tmp_path), "other versions: jax 0.1 there", CheckpointError
    )
    (tmp_path / MANIFEST).write_text("[")
    refused(lambda: swept(pair, tmp_path), "no readable", CheckpointError)
    (tmp_path / MANIFEST).rename(tmp_path / "notes.txt")
    refused(lambda: swept(pair, tmp_path), "holds other files", CheckpointError)
    refused(
        lambda: swept(pair, tmp_path / "notes.txt"),
        "cannot be written: .* What is in it stays",
        CheckpointError,
    )


@pytest.mark.slow
@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="no device that is always full"
)
def test_a_full_disk_is_reported_and_leaves_no_half_file(pair, tmp_path):
    code = f"""
import resource, signal, sys
sys.path[:0] = {[str(Path(trains.__file__).parent)]}
import compiling, trains, jaxhb
train = trains.pair_train(trains.Pair(1.0), transition=1e-3)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
try:
    jaxhb.steady_state(
        train, rpm=[14.0, 15.0], out={str(tmp_path / "full")!r}, harmonics=64
    )
except jaxhb.CheckpointError as error:
    print(error)
"""
    completed = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env=os.environ,
        check=True,
    )
    assert "cannot be written" in completed.stdout
    assert "the same sweep goes on" in completed.stdout
    left = sorted(path.name for path in (tmp_path / "full").iterdir())
    assert left == [KEY, MANIFEST]


def test_values_of_other_packages_are_not_stored_and_none_of_their_classes_called():
    for value in (object(), {"a": Path()}, np.array([None])):
        with pytest.raises(TypeError, match="cannot be kept"):
            pack(value)
    for name in ("os:system", "jaxhb.results.serial:pack", "subprocess:Popen"):
        with pytest.raises((TypeError, AttributeError)):
            unpack({"value": {"shared": 0}, "shared": [{"class": name, "of": {}}]}, [])


@pytest.mark.slow
def test_an_answer_is_the_same_bits_whatever_speeds_stand_beside_it(pair, stored_sweep):
    """A speed by itself, in a sweep and from a folder; a speed reached from its
    neighbour, as from that motion alone.
    """
    _, whole = stored_sweep
    rpm = OMEGA * trains.ONE_RADIAN_PER_SECOND
    starts = [None, *whole]
    assert {state.started_from for state in whole} > {None}
    for speed, before, state in zip(rpm, starts, whole, strict=False):
        assert state.started_from in (None, before and before.rpm)
        start = None if state.started_from is None else before
        single = jaxhb.steady_state(pair, rpm=speed, harmonics=64, start=start)
        assert_same_numbers([single], [dataclasses.replace(state, notes=single.notes)])


@pytest.mark.slow
def test_a_part_that_was_planted_is_not_believed(pair, tmp_path):
    """A part written as by another user, who knows all but the key, and a sound part
    that answers another question.
    """
    keep = Checkpoint(tmp_path, pair, {}, None).keep
    answers = [keep(number, lambda number=number: number) for number in (3, 9)]
    assert answers == [3, 9]
    paths = {
        keep(number, list): path
        for number, path in zip((3, 9), _by_time(tmp_path), strict=True)
    }
    paths[3].write_bytes(paths[9].read_bytes())
    assert keep(3, lambda: 3) == 3
    keep_elsewhere = Checkpoint(tmp_path / "other", pair, {}, None).keep
    keep_elsewhere(3, lambda: 12)
    shutil.copy(*(tmp_path / "other").glob("*.npz"), tmp_path)
    assert keep(3, lambda: 3) == 3


def _by_time(folder):
    return sorted(folder.glob("*.npz"), key=lambda path: path.stat().st_mtime_ns)


@pytest.mark.slow
def test_a_folder_that_others_may_write_is_refused_with_all_that_is_in_it(
    pair, tmp_path
):
    tmp_path.chmod(0o775)
    refused(
        lambda: Checkpoint(tmp_path, pair, {}),
        "is not yours alone: .* Remove it with all that is in it",
        CheckpointError,
    )


@pytest.mark.slow
def test_questions_that_differ_in_the_last_digit_have_answers_of_their_own(
    pair, tmp_path
):
    speeds = np.array([900.0, np.nextafter(900.0, 901.0)])
    questions = (*speeds, *speeds.tolist(), 900, True, "900.0", [900.0])
    digests = {digest(question) for question in questions}
    assert len(digests) == 8
    long = np.arange(2000.0)
    assert digest(long) != digest(np.where(long == 1000.0, 1000.5, long))
    keep = Checkpoint(tmp_path, pair, {}, None).keep
    answers = [keep(speed, lambda speed=speed: speed) for speed in speeds]
    assert answers == speeds.tolist()


@pytest.mark.slow
def test_work_goes_on_without_a_folder_that_nobody_asked_for_and_says_so(
    pair, tmp_path
):
    warnings = []
    (tmp_path / "file").write_text("")
    keep = Checkpoint(Cached(tmp_path / "file", warnings.append), pair, {}, None).keep
    assert keep("question", lambda: 1) == 1
    assert keep("question", lambda: 2) == 2
    assert len(warnings) == 1
    assert "cannot be written" in warnings[0]


@pytest.mark.slow
def test_a_folder_of_the_cache_that_answers_another_question_begins_anew(
    pair, tmp_path
):
    folder = Cached(tmp_path, pytest.fail)
    assert Checkpoint(folder, pair, {"a": 1}, None).keep("question", lambda: 1) == 1
    assert Checkpoint(folder, pair, {"a": 2}, None).keep("question", lambda: 2) == 2
    (tmp_path / MANIFEST).write_text("[")
    assert Checkpoint(folder, pair, {"a": 2}, None).keep("question", lambda: 3) == 3
    assert Checkpoint(folder, pair, {"a": 2}, None).keep("question", lambda: 4) == 3
