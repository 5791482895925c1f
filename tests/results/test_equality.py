"""Trains and results are equal by their numbers, whoever computed them, and may be keys
of dictionaries.
"""

import copy
import dataclasses

import jax
import numpy as np
import pytest

import jaxhb

TRAIN = jaxhb.load_scene("spur_pair")


def results_of_every_kind():
    """Results by their kind, computed anew."""
    train = jaxhb.load_scene("spur_pair")
    response = jaxhb.solve(train, rpm=3000.0)
    forced = jaxhb.forced_response(train, rpm=[1000.0, 2000.0])
    return {
        "train": train,
        "response": response,
        "sweep": forced,
        "signal": response.force("gear a", "gear b"),
        "contact": response.mesh("gear a", "gear b"),
        "modes": jaxhb.natural_frequencies(train),
        "damped modes": jaxhb.damped_modes(train),
        "stability": jaxhb.stability(response),
        "steady state": jaxhb.steady_state(train, rpm=3000.0),
        "strength": jaxhb.strength(forced),
        "mean load": jaxhb.at_mean_load(train, rpm=3000.0),
    }


ONCE = results_of_every_kind()
AGAIN = results_of_every_kind()


@pytest.mark.parametrize("name", ONCE)
def test_results_computed_twice_are_equal_and_have_one_hash(name):
    first = ONCE[name]
    second = AGAIN[name]
    assert first is not second
    assert first == second
    assert (first == second) is True
    assert hash(first) == hash(second)
    assert len({first, second}) == 1
    assert first == copy.copy(first)
    assert first != "another thing"


def test_another_number_makes_another_train_and_another_response():
    stiffer = TRAIN.replace(
        {"gear a|gear b.stiffness": 1.01 * TRAIN.value("gear a|gear b.stiffness")}
    )
    assert stiffer != TRAIN
    assert hash(stiffer) != hash(TRAIN)
    response = ONCE["response"]
    assert dataclasses.replace(response, status=np.asarray(4)) != response
    # Neither the log nor the train of a response is compared.
    assert dataclasses.replace(response, train=None, path=()) == response


def test_numbers_that_are_nan_are_equal_to_themselves():
    lost = dataclasses.replace(ONCE["signal"], coefficients=np.full(3, np.nan + 0j))
    assert lost == dataclasses.replace(lost, coefficients=np.full(3, np.nan + 0j))


def test_equality_traces_nothing_and_compiles_nothing():
    traces = []

    @jax.jit
    def mean(response):
        traces.append(response == response)
        return response.force("gear a", "gear b").mean

    assert float(mean(ONCE["response"])) == float(mean(AGAIN["response"]))
    assert traces == [True]
