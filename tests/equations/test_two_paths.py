"""Two ways to solve the same equations: the condensed equation on the meshes, and the sweep over the whole chain."""

import dataclasses

import numpy as np
import pytest
from differences import TIGHT
from tolerances import PATHS, RESIDUAL
from trains import branched_parts, build

import jaxhb
from jaxhb.results.status import Status

pytestmark = pytest.mark.oracle

RPM, HARMONICS = 12000.0, 32
"""Both meshes are separated for a fifth and more of the cycle; the mesh modes lie at harmonics 7 and 13."""


@pytest.fixture(scope="module", params=[("contact", "always"), ("always", "contact")], ids="-".join)
def responses(request):
    """The train, and its response by both methods, solved to rounding: what is compared is the methods, not where they
    stop. The damping laws are data, nothing is compiled twice."""
    train = build(branched_parts(request.param), reference="flywheel")
    found = []
    for method in ("reduced", "chain"):
        asked = {"rpm": RPM, "harmonics": HARMONICS, "method": method}
        plan = dataclasses.replace(jaxhb.plan(train, **asked), **TIGHT | {"max_steps": 24})
        found.append(jaxhb.solve(train, rpm=RPM, plan=plan))
        assert found[-1].status == Status.CONVERGED and found[-1].residual < RESIDUAL
        assert all(contact.separated_fraction > 0.2 for contact in found[-1].contacts().values())
    return train, found


def test_reduced_equation_and_chain_sweep_give_the_same_response(responses):
    reduced, chain = responses[1]
    for name in ("angles", "torques", "elastic_torques", "deflections", "forces", "elastic_forces"):
        a, b = np.asarray(getattr(reduced, name)), np.asarray(getattr(chain, name))
        assert np.abs(a - b).max() < PATHS * np.abs(a).max(), name
