"""From a gentler train to the wanted one where a cold start finds no periodic motion."""

import dataclasses

import numpy as np
from tolerances import ALGEBRAIC

import jaxhb
from jaxhb.periodic import homotopy
from jaxhb.periodic.newton import Status


def test_the_path_ends_at_the_train_itself():
    train = jaxhb.load_scene("gear_train_30")
    for found, given in zip(
        vars(homotopy.gentle(train, 0.0).meshes).values(), vars(train.meshes).values(), strict=True
    ):
        np.testing.assert_allclose(found, given, rtol=ALGEBRAIC)
    softest = homotopy.gentle(train, 1.0).meshes
    np.testing.assert_allclose(softest.damping, 4 * np.asarray(train.meshes.damping))
    np.testing.assert_allclose(softest.transition, 0.4)
    np.testing.assert_allclose(softest.epsilon, 0.03)


def test_steps_shrink_where_the_path_is_hard_and_a_lost_path_is_told():
    train = jaxhb.load_scene("spur_pair")
    least = np.asarray(train.meshes.damping)[0]
    wall = [0.0]

    def solve(softer, start):
        """Succeeds for short steps, and never beyond the wall."""
        damping = np.asarray(softer.meshes.damping)[0]
        tried.append(damping / least)
        return damping / least > wall[0] and (start is None or start / damping < 1.5), damping

    tried = []
    motion, solves = homotopy.follow(train, solve)
    assert motion == least and solves == len(tried) > 4
    tried, wall[0] = [], 2.0
    motion, solves = homotopy.follow(train, solve)
    assert motion is None and solves == len(tried) <= homotopy.MOST


def test_homotopy_finds_a_motion_at_which_time_integration_does_not_settle():
    train = jaxhb.load_scene("gear_train_30")
    meshes = train.meshes
    topology = dataclasses.replace(train.topology, mesh_damping_law=("contact",) * 4)
    hard = dataclasses.replace(train, topology=topology, meshes=dataclasses.replace(meshes, epsilon=np.full(4, 0.03)))

    def solve(softer, start):
        response = jaxhb.solve(softer, rpm=2450.0, harmonics=384, start=start)
        return response.status <= Status.TOLERANCE_NOT_MET, response

    response, _ = homotopy.follow(hard, solve)
    assert response.residual <= 1e-10 and response.truncation_error < 0.02
