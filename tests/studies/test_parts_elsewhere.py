"""Functions that hand out parts give the same bits as without an executor."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import jaxhb
from jaxhb.design import Objective, Parameter, Tolerance
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


@pytest.mark.slow
def test_starts_of_a_tuning(threads, tmp_path):
    train = jaxhb.load_scene("six_cylinder_diesel")
    swing = Objective(quantity="shaft torque", of="cyl6|flywheel")
    pulley = Parameter(name="pulley.inertia", low=0.005, high=0.05)
    steps = []

    def tuned(starts, executor, **options):
        return jaxhb.tune(
            train,
            parameters=[pulley],
            rpm=[1800.0, 2000.0, 2200.0],
            objective=swing,
            steps=3,
            starts=starts,
            executor=executor,
            **options,
        )

    apart = tuned(3, threads, out=tmp_path / "kept", on_step=steps.append)
    assert len(apart.outcomes) == 3
    # The train as it is goes its way whether or not others do.
    assert apart.outcomes[0] == tuned(1, None).outcomes[0]
    values = [objective for objective, _, _ in apart.outcomes]
    best = apart.outcomes[int(np.argmin(values))]
    assert apart.after.parameters == best[1]
    assert steps[-1].parameters == best[1]
    with ThreadPoolExecutor(1) as one_thread:
        again = tuned(3, one_thread)
    assert again.outcomes == apart.outcomes
    assert digest(again.after) == digest(apart.after)
    resumed = tuned(3, threads, out=tmp_path / "kept")
    assert resumed.outcomes == apart.outcomes


def test_an_optimizer_of_optax_stays_in_its_process(threads):
    optax = pytest.importorskip("optax")
    train = jaxhb.load_scene("six_cylinder_diesel")
    with pytest.raises(jaxhb.SceneError, match="cannot be sent to an executor"):
        jaxhb.tune(
            train,
            parameters=[Parameter(name="pulley.inertia", low=0.005, high=0.05)],
            rpm=[1800.0],
            objective=Objective(quantity="shaft torque", of="cyl6|flywheel"),
            optimizer=optax.sgd(0.1),
            executor=threads,
        )
