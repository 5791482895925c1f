"""Executors run every part once, whatever becomes of their workers."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import parts
import pytest

import jaxhb
from jaxhb._executors import in_parts
from jaxhb._jax import processors

NUMBERS = [(number,) for number in range(8)]
LONG = 60  # seconds after which a test of processes has failed


def test_parts_have_the_same_results_in_any_executor():
    expected = {number: number**2 for (number,) in NUMBERS}
    assert dict(in_parts(parts.square, NUMBERS)) == expected
    with ThreadPoolExecutor(2) as threads:
        assert dict(in_parts(parts.square, NUMBERS, threads)) == expected
    with ProcessPoolExecutor(2, get_context("spawn")) as processes:
        assert dict(in_parts(parts.square, NUMBERS, processes)) == expected
    with jaxhb.Workers(2) as workers:
        assert dict(in_parts(parts.square, NUMBERS, workers)) == expected


def test_no_more_parts_are_taken_than_workers_can_be_given():
    numbers = []

    def endless_parts():
        number = 0
        while True:
            numbers.append(number)
            yield (number,)
            number += 1

    with ThreadPoolExecutor(2) as threads:
        results = in_parts(parts.square, endless_parts(), threads)
        for _ in range(20):
            next(results)
        results.close()
    assert len(numbers) <= 20 + 3 * 2


def test_a_worker_has_one_processor(monkeypatch):
    with jaxhb.Workers(1) as workers:
        assert dict(in_parts(parts.processor_limit, [(0,)], workers)) == {0: "1"}
    monkeypatch.setenv("NPROC", "3")
    assert processors() == 3
    monkeypatch.delenv("NPROC")
    assert 1 <= processors() <= os.cpu_count()


def test_what_a_part_raises_is_raised_where_it_is_asked_for():
    with (
        jaxhb.Workers(1) as workers,
        pytest.raises(ValueError, match=r"\d is refused"),
    ):
        dict(in_parts(parts.refused, NUMBERS, workers))


def test_parts_of_a_worker_that_died_run_again(tmp_path):
    call = partial(parts.killed_once, tmp_path)
    with jaxhb.Workers(2) as workers:
        results = dict(in_parts(call, NUMBERS, workers))
    assert results == {number: number for (number,) in NUMBERS}
    assert (tmp_path / "mark").exists()


def test_a_part_that_kills_every_worker_is_lost_and_no_other():
    with jaxhb.Workers(2) as workers:
        results = dict(
            in_parts(parts.killing, NUMBERS, workers, lost=lambda number, failure: -1)
        )
    assert results == {number: number for (number,) in NUMBERS} | {3: -1}


def test_a_lost_part_raises_where_nothing_else_is_asked_for():
    with jaxhb.Workers(1) as workers, pytest.raises(jaxhb.WorkerLost, match="memory"):
        dict(in_parts(parts.killing, [(3,)], workers))


def started(folder, count):
    """Process numbers of ``count`` workers that are at an endless part."""
    deadline = time.monotonic() + LONG
    while len(list(folder.iterdir())) < count:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return [int(path.name) for path in folder.iterdir()]


def assert_ended(processes):
    deadline = time.monotonic() + LONG
    for process in processes:
        while Path(f"/proc/{process}").exists():
            assert time.monotonic() < deadline
            time.sleep(0.05)


DRIVER = """
import sys
import jaxhb, parts
from jaxhb._executors import in_parts

if __name__ == "__main__":
    with jaxhb.Workers(2) as workers:
        try:
            list(in_parts(parts.endless, [(sys.argv[1],)] * 2, workers))
        except KeyboardInterrupt:
            workers.shutdown(cancel_futures=True)
"""


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks at processes")
@pytest.mark.parametrize("ending", [signal.SIGKILL, signal.SIGINT])
def test_workers_end_with_the_process_that_started_them(tmp_path, ending):
    script = tmp_path / "driver.py"
    script.write_text(DRIVER)
    folder = tmp_path / "workers"
    folder.mkdir()
    path = os.pathsep.join([*sys.path, str(Path(parts.__file__).parent)])
    driver = subprocess.Popen(
        [sys.executable, script, folder],
        env=os.environ | {"PYTHONPATH": path},
        start_new_session=True,
    )
    workers = started(folder, 2)
    driver.send_signal(ending)
    driver.wait(LONG)
    assert_ended(workers)
