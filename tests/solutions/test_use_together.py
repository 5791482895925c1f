"""Trains and answers may be pickled and copied, and asked by several threads at
once.
"""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import jaxhb

RPM = (3000.0, 4000.0, 5000.0, 5500.0)
THREADS = 8
CALLS = 40


@pytest.fixture(scope="module")
def train():
    return jaxhb.load_scene("spur_pair")


def read(train, rpm):
    """Numbers of a periodic solution, of the linear train and of its modes."""
    response = jaxhb.solve(train, rpm=rpm)
    linear = jaxhb.forced_response(train, rpm=[rpm])
    extremes = [
        float(response.force("gear a", "gear b").max),
        float(linear.force("gear a", "gear b").max[0]),
    ]
    return [*extremes, *jaxhb.natural_frequencies(train).frequencies_hz.tolist()]


@pytest.mark.slow
def test_eight_threads_get_the_numbers_that_one_gets(train):
    alone = {rpm: read(train, rpm) for rpm in RPM}
    speeds = [RPM[k % len(RPM)] for k in range(CALLS)]
    with ThreadPoolExecutor(THREADS) as threads:
        answers = list(threads.map(lambda rpm: read(train, rpm), speeds))
    assert answers == [alone[rpm] for rpm in speeds]


@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))]
)
def test_a_copy_of_a_train_and_of_an_answer_reads_the_same(train, copied):
    response = jaxhb.solve(train, rpm=5000.0)
    steady = jaxhb.steady_state(train, rpm=5000.0)
    again = copied(response)
    assert int(again.status) == int(response.status)
    assert float(again.residual) == float(response.residual)
    for driver, driven in ("gear a", "gear b"), ("gear b", "gear a"):
        force = again.force(driver, driven).samples(720)
        expected = response.force(driver, driven).samples(720)
        np.testing.assert_array_equal(force, expected)
    assert copied(steady).kind == steady.kind
    assert read(copied(train), 5000.0) == read(train, 5000.0)
