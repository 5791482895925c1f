"""Processes beside one in which jax has computed: forked ones end with a sentence,
spawned ones solve.
"""

import os
import subprocess
import sys

import pytest

FORKED = """
import os, signal, sys, warnings
import jaxhb
warnings.simplefilter("ignore")  # jax says that a fork may wait for ever
train = jaxhb.load_scene("spur_pair")
def child(call):
    pid = os.fork()
    if not pid:
        signal.alarm(60)
        try:
            call()
            print("solved", flush=True)
        except RuntimeError as error:
            print(error, flush=True)
        os._exit(0)
    assert os.waitpid(pid, 0)[1] == 0
jaxhb.solve(train, rpm=2000.0)
child(lambda: jaxhb.solve(train, rpm=2000.0))
child(lambda: jaxhb.forced_response(train, rpm=[2000.0]))
child(lambda: jaxhb.steady_state(train, rpm=2000.0))
"""
SPAWNED = """
import multiprocessing
import jaxhb
def solve(rpm):
    return int(jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=rpm).status)
if __name__ == "__main__":
    solve(2000.0)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(pool.map(solve, [2000.0]))
"""


def printed(*command):
    """Output of a process of Python."""
    completed = subprocess.run(
        [sys.executable, *command],
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    return completed.stdout


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_process_forked_after_a_solve_ends_with_a_sentence_without_waiting():
    lines = printed("-c", FORKED).splitlines()
    advice = "Start processes by multiprocessing.get_context('spawn')"
    assert len(lines) == 3
    assert all(advice in line for line in lines)


@pytest.mark.slow
def test_a_spawned_process_solves(tmp_path):
    (tmp_path / "spawned.py").write_text(SPAWNED)
    assert printed(str(tmp_path / "spawned.py")).strip() == "[0]"
