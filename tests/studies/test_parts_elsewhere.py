"""Functions that hand out parts give the same bits as without an executor."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import jaxhb
from jaxhb.design import Objective, Tolerance
from jaxhb.results.checkpoint import digest

SPEEDS = np.linspace(1500.0, 5500.0, 20)


@pytest.fixture(scope="module")
def pair():
    return jaxhb.load_scene("spur_pair")


@pytest.fixture
def threads():
    with ThreadPoolExecutor(3) as executor:
        yield executor


@pytest.mark.slow
def test_misfires_of_the_linear_train(threads):
    train = jaxhb.load_scene("six_cylinder_diesel")
    options = {"rpm": [1200.0, 1800.0], "solve": jaxhb.forced_response}
    for each in (jaxhb.misfire_each, jaxhb.cut_off_each):
        alone = each(train, **options)
        assert digest(each(train, executor=threads, **options)) == digest(alone)
        assert list(alone.responses) == list(train.topology.firing_cylinders)


@pytest.mark.slow
def test_responses_over_the_speed(pair, threads):
    alone = jaxhb.solve_speeds(pair, rpm=SPEEDS)
    responses = jaxhb.solve_speeds(pair, rpm=SPEEDS, executor=threads)
    assert digest(responses) == digest(alone)
    separated = [
        alone[place].contacts()["gear a|gear b"].separated_fraction > 0
        for place in range(len(SPEEDS))
    ]
    assert {True, False} == set(map(bool, separated))


@pytest.mark.slow
@pytest.mark.parametrize("chunk", [1, 7, None])
def test_steady_states_reached_from_both_sides(pair, threads, chunk, tmp_path):
    alone = jaxhb.steady_state(pair, rpm=SPEEDS, direction="both")
    counts = []
    sweeps = jaxhb.steady_state(
        pair,
        rpm=SPEEDS,
        direction="both",
        executor=threads,
        chunk=chunk,
        progress=counts.append,
        out=tmp_path / "kept",
    )
    assert digest(sweeps) == digest(alone)
    assert sum(counts) == len(SPEEDS)
    assert alone[0].kind.tolist() != alone[1].kind.tolist()


@pytest.mark.slow
def test_the_sample_of_tolerances(pair, threads):
    backlash = Tolerance(name="gear a|gear b.backlash", low=0.9e-4, high=1.1e-4)
    force = Objective(quantity="tooth force", of="gear a|gear b")

    def spread(executor):
        return jaxhb.tolerance(
            pair,
            rpm=[2000.0, 4000.0],
            of=[force],
            tolerances=[backlash],
            samples=12,
            bounds=False,
            executor=executor,
        )

    alone = spread(None)
    assert np.isfinite(alone.samples).all()
    assert digest(spread(threads)) == digest(alone)
