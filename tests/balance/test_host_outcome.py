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
    problem = problem_at(train, RPM, plan.static.excited)
    of_host = program._of_the_host(problem, plan)
    given = problem, plan.active_meshes, program.first_start(plan), plan.goals
    of_program = jax.tree.map(np.asarray, program.solve_problem(*given, plan.static))
    assert int(of_host.status) == int(of_program.status) == 0
    for field in dataclasses.fields(of_host.fields):
        found, exact = (
            getattr(outcome.fields, field.name) for outcome in (of_host, of_program)
        )
        assert isinstance(found, np.ndarray)
        assert found.dtype == exact.dtype
        np.testing.assert_allclose(
            found, exact, rtol=0, atol=ALGEBRAIC * np.abs(exact).max(initial=0.0)
        )
