"""Two ways to solve the same equations: the reduced equation on the meshes, and the sweep over the whole chain."""

import dataclasses

import jax
import numpy as np
import pytest
from differences import Tight
from tolerances import PATHS, RESIDUAL
from trains import branched_parts, build

import jaxhb
from jaxhb import Mesh
from jaxhb.balance.problem import problem_at
from jaxhb.equations import fourier
from jaxhb.equations.residual import residual
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
        first = jaxhb.solve(train, **asked)
        found.append(jaxhb.solve(train, rpm=RPM, plan=Tight(**vars(jaxhb.plan(train, **asked))), start=first))
        assert found[-1].status == Status.CONVERGED and found[-1].residual < RESIDUAL
        assert all(contact.separated_fraction > 0.2 for contact in found[-1].contacts().values())
    return train, found


def test_reduced_equation_and_chain_sweep_give_the_same_response(responses):
    reduced, chain = responses[1]
    for name in ("angles", "torques", "elastic_torques", "deflections", "forces", "elastic_forces"):
        a, b = np.asarray(getattr(reduced, name)), np.asarray(getattr(chain, name))
        assert np.abs(a - b).max() < PATHS * np.abs(a).max(), name


def test_truncation_error_does_not_depend_on_the_method(responses):
    reduced, chain = responses[1]
    # each estimate is one approximate Newton correction whose Krylov solve stops at 5 %
    np.testing.assert_allclose(reduced.truncation_error, chain.truncation_error, rtol=0.1, atol=1e-9)


def test_solution_of_the_reduced_equation_solves_the_equations_of_all_disks(responses):
    train, (reduced, _) = responses
    problem = problem_at(train, RPM, HARMONICS)
    x = fourier.pack(reduced.angles * problem.system.radius[:, None])
    evaluate = jax.jit(residual, static_argnames="samples")
    left = evaluate(x, problem.system, problem.meshes, problem.frequency, problem.load, samples=16 * HARMONICS)
    largest = np.abs(reduced.forces).max()
    assert np.abs(np.asarray(left)).max() < PATHS * largest  # forces from differences of displacements, in N


def test_exchanging_the_names_of_a_mesh_changes_no_share_of_contact(responses):
    train, (reduced, _) = responses
    parts = branched_parts(train.topology.mesh_damping_law)
    turned = [dataclasses.replace(p, between=p.between[::-1]) if isinstance(p, Mesh) else p for p in parts]
    again = jaxhb.solve(build(turned, reference="flywheel"), rpm=RPM, harmonics=HARMONICS)
    for (a, b), contact in zip(
        (("crank gear", "idler"), ("pump gear", "idler")), reduced.contacts().values(), strict=True
    ):
        other = again.mesh(b, a)
        assert other.separated_fraction == pytest.approx(contact.separated_fraction, rel=1e-6)
        assert other.reverse_contact_fraction == pytest.approx(contact.reverse_contact_fraction, rel=1e-6)
        assert other.drive_side == -contact.drive_side and len(other.impacts) == len(contact.impacts)
        np.testing.assert_allclose(again.force(a, b).max, reduced.force(a, b).max, rtol=1e-6)
