"""Motions of teeth in contact are found on the host: as those of the program, to
rounding.
"""

import dataclasses

import jax
import numpy as np
import pytest
from tolerances import ALGEBRAIC

import jaxhb
from jaxhb.balance import program
from jaxhb.balance.plan import Request
from jaxhb.balance.problem import problem_at
from jaxhb.solutions import planning
from jaxhb.train.changes import linearised

RPM = 1000.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["engine_with_damper", "inline_four_timing_drive", "spur_pair"]
)
def test_a_motion_in_contact_is_that_of_the_program(name):
    """With rings that no spring holds, a train that floats, and teeth held on their
    flanks.
    """
    train = jaxhb.load_scene(name)
    train = train if name == "spur_pair" else linearised(train)
    (plan,) = planning.plan_speeds(
        train, np.array([RPM]), Request.of(train, few_levels=True)
    )
    assert not plan.active
    problem = problem_at(train, RPM, plan.shape.excited)
    of_host = program._of_the_host(problem, plan)
    outcome = program.solve_problem(
        problem,
        plan.active_meshes,
        program.first_start(plan),
        plan.goals,
        plan.shape,
    )
    of_program = jax.tree.map(np.asarray, outcome)
    assert int(of_host.status) == int(of_program.status) == 0
    for field in dataclasses.fields(of_host.fields):
        actual = getattr(of_host.fields, field.name)
        expected = getattr(of_program.fields, field.name)
        assert isinstance(actual, np.ndarray)
        assert actual.dtype == expected.dtype
        scale = np.abs(expected).max(initial=0.0)
        np.testing.assert_allclose(actual, expected, rtol=0, atol=ALGEBRAIC * scale)
