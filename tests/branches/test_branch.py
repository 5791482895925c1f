"""Branches through folds: the chain of public harmonic-balance codes against dense
equations written down in numpy.
"""

import shutil
from functools import cache
from pathlib import Path

import chain_task
import numpy as np
import pytest
from event_exact import long_run, multipliers
from peers import chain_train, rpm_of
from reference_data import reference, refused
from scipy.optimize import root
from trains import ONE_RADIAN_PER_SECOND, Pair, pair_train

import jaxhb
from jaxhb.branches.branch import BranchOptions, extremes

PUBLISHED = chain_task.published()["main_folds_w_S3"]


@cache
def chain(longest):
    return jaxhb.follow(
        chain_train(3),
        "rpm",
        start=float(rpm_of(1.30)),
        to=float(rpm_of(0.70)),
        harmonics=15,
        tolerance=0.5,
        options=BranchOptions(longest=longest),
    )


def dense_residual(x, w):
    """The equation of the link with 15 harmonics at a frequency, dense, and its
    Jacobian; [mean, cosines, sines].
    """
    link = np.zeros(3)
    push = np.zeros((16, 3))
    link[1:] = 1.0, -1.0
    push[:2, 0] = chain_task.MEAN, chain_task.SWING
    right = np.stack([np.broadcast_to(link, push.shape), push], axis=-1)
    answer = link @ np.linalg.solve(chain_task.dynamic_stiffness(3, w, 1.0), right)
    receptance = chain_task._real(answer[:, 0][:, None, None])
    linear = np.concatenate([answer[:, 1].real, -answer[1:, 1].imag])
    l = chain_task.SYNTHESIS @ x
    force, slope = chain_task.law(l)
    matrix = (
        np.eye(x.size)
        + receptance @ (chain_task.ANALYSIS * (slope - 1.0)) @ chain_task.SYNTHESIS
    )
    return x - linear + receptance @ (chain_task.ANALYSIS @ (force - l)), matrix


def dense_fold(x, w):
    """Frequency at which the dense equations are singular near a point ``(x, w)`` of
    their curve.
    """

    def singular(y):
        x = y[: len(x0)]
        v = y[len(x0) : -1]
        w = y[-1]
        value, matrix = dense_residual(x, w)
        return np.concatenate([value, matrix @ v, [v @ v - 1]])

    x0 = x
    v = np.linalg.svd(dense_residual(x, w)[1])[2][-1]
    return root(singular, np.concatenate([x, v, [w]]), tol=1e-13).x[-1]


def dense_point(branch, number):
    """``(x, w)`` of the dense equations at a point of a branch."""
    deflection = branch.response(number).deflections[0]
    rest = deflection[1:]
    return (
        np.concatenate([deflection[:1].real, 2 * rest.real, -2 * rest.imag]),
        branch.value[number] * 2 * np.pi / 60,
    )


@pytest.mark.slow
@pytest.mark.parametrize("longest", [0.1, 0.025])
def test_the_eight_folds_of_the_chain_are_found_at_any_limit_of_the_steps(longest):
    """Published are extremes of sampled curves: within 1e-3, the last within 1.5e-3
    (the dense equations decide).
    """
    branch = chain(longest)
    folds = branch.folds * 2 * np.pi / 60
    assert len(folds) == 8
    assert "end of the range" in branch.ended
    np.testing.assert_allclose(folds, PUBLISHED, atol=1.5e-3)
    points = [point for point in branch.special if point.kind == "fold"]
    for point, w in zip(points, folds, strict=True):
        x_before, w_before = dense_point(branch, point.after)
        x_after, w_after = dense_point(branch, point.after + 1)
        fold = dense_fold((x_before + x_after) / 2, (w_before + w_after) / 2)
        assert abs(fold - w) < 1e-8 * w


@pytest.mark.slow
def test_every_change_of_stability_has_its_name():
    branch = chain(0.1)
    changes = np.flatnonzero(np.diff(branch.stable.astype(int)))
    near = {point.after + shift for point in branch.special for shift in (-1, 0, 1)}
    assert len(changes) >= 6
    assert set(changes.tolist()) <= near
    assert {"fold", "period doubling", "Neimark-Sacker"} == {
        point.kind for point in branch.special
    }
    assert np.all(branch.stable == (np.abs(branch.multiplier) <= 1 + 1e-8))


@pytest.mark.slow
def test_a_branch_never_turns_back_on_itself():
    """Distance along the branch only grows: no point comes near one that is more than a
    few steps before it.
    """
    branch = chain(0.1)
    y = np.array([point for point, _ in branch._path])
    distance = np.linalg.norm(y[:, None] - y, axis=-1)
    number = np.arange(len(y))
    apart = np.abs(np.subtract.outer(number, number)) > 1
    steps = np.linalg.norm(np.diff(y, axis=0), axis=1)
    assert np.all(distance[apart] > 0)
    assert distance[1:][:, :-1][apart[1:, :-1]].min() > 0.5 * steps.min()
    tangents = np.array([tangent for _, tangent in branch._path])
    assert np.all(np.einsum("ij,ij->i", np.diff(y, axis=0), tangents[:-1]) > 0)


@pytest.mark.slow
def test_a_branch_is_resumed_from_any_of_its_points_forwards_and_backwards():
    branch = chain(0.1)
    middle = len(branch) // 2
    onward = branch.resume(middle, options=BranchOptions(longest=0.1))
    assert onward.value[0] == branch.value[middle]
    assert abs(onward.value[-1] - branch.value[-1]) < 1e-6
    later_folds = branch.folds[
        [point.after >= middle for point in branch.special if point.kind == "fold"]
    ]
    np.testing.assert_allclose(onward.folds, later_folds, rtol=1e-6)
    back = branch.resume(10, backwards=True, to=1.05 * branch.value[0])
    assert abs(back.value[-1] - 1.05 * branch.value[0]) < 1e-6
    assert len(back.folds) == 0


@pytest.mark.slow
def test_points_are_solutions_of_the_harmonic_equations():
    branch = chain(0.1)
    number = int(np.argmax(branch.largest_deflection[:, 0]))
    response = branch.response(number)
    assert response.residual < 1e-10
    assert response.steps == 0
    x, w = dense_point(branch, number)
    residual, _ = dense_residual(x, w)
    assert np.abs(residual).max() < 1e-9
    deflection = response.deflection("m1", "m2").max
    force = response.force("m1", "m2").max
    assert abs(deflection - branch.largest_deflection[number, 0]) < 1e-6
    assert abs(force - branch.largest_force[number, 0]) < 1e-6


def test_columns_of_a_branch_do_not_depend_on_which_gear_is_named_first(tmp_path):
    """A pair that hammers, its driven gear named second and first: forces are of either
    sign, columns the same.
    """
    pair = "gear a|gear b"
    twin = "gear b|gear a"
    packaged = Path(jaxhb.__path__[0], "scene", "scenes")
    shutil.copy(packaged / "spur_pair_omega_squared.csv", tmp_path)
    text = (packaged / "spur_pair.toml").read_text(encoding="utf-8")
    assert 'between = ["gear a", "gear b"]' in text
    (tmp_path / "twin.toml").write_text(
        text.replace('["gear a", "gear b"]', '["gear b", "gear a"]'), encoding="utf-8"
    )
    response = jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=5000.0)
    turned = jaxhb.load_scene(tmp_path / "twin.toml")
    reversed_response = jaxhb.solve(turned, rpm=5000.0)
    assert response.force(pair).mean > 0 > reversed_response.force(twin).mean
    columns = extremes(response)
    reversed_columns = extremes(reversed_response)
    assert columns["largest_force"] == [response.force(pair).peak]
    for name, values in columns.items():
        assert reversed_columns[name] == pytest.approx(values, rel=1e-6), name


@pytest.mark.slow
def test_a_number_of_the_train_is_followed_at_one_speed():
    """More drive closes the gap: the end of the branch is what a solve finds there."""
    train = chain_train(3)
    rpm = float(rpm_of(1.2))
    branch = jaxhb.follow(
        train,
        "m1|m2.stiffness",
        start=1.0,
        to=1.3,
        rpm=rpm,
        harmonics=15,
        tolerance=0.5,
    )
    assert branch.value[-1] == pytest.approx(1.3, abs=1e-8)
    stiff = train.replace({"m1|m2.stiffness": 1.3})
    response = jaxhb.solve(
        stiff, rpm=rpm, harmonics=15, tolerance=0.5, start=branch.response(-1)
    )
    deflection = response.deflection("m1", "m2").max
    assert abs(deflection - branch.largest_deflection[-1, 0]) < 1e-7


@pytest.mark.slow
def test_a_branch_that_turns_back_leaves_the_range_with_a_sentence():
    branch = chain(0.1)
    number = next(point.after for point in branch.special if point.kind == "fold")
    first = branch.response(number - 3)
    back = jaxhb.follow(
        chain_train(3),
        "rpm",
        start=float(first.rpm),
        to=0.9 * float(first.rpm),
        harmonics=15,
        tolerance=0.5,
        begin=first,
    )
    assert len(back.folds) == 1
    assert "turns back and leaves the range" in back.ended
    assert back.value[-1] == pytest.approx(back.value[0])


@pytest.mark.parametrize(("arguments", "sentence"), reference("cases")["branches"])
def test_what_cannot_be_followed_is_refused_with_a_sentence(arguments, sentence):
    refused(lambda: jaxhb.follow(chain_train(3), **arguments), sentence, ValueError)


@pytest.mark.slow
def test_what_cannot_be_followed_is_refused_before_the_work():
    refused(lambda: chain(0.1).resume(-1, to=-3.0), "-3 rpm", ValueError)
    massless = jaxhb.load_scene("spur_pair").replace({"gear a.inertia": 0.0})
    with pytest.raises(
        ValueError, match="carries a backlash mesh: no equation of motion in time"
    ):
        jaxhb.follow(massless, "rpm", start=500.0, to=600.0)
    with pytest.raises(ValueError, match="solve_speeds"):
        jaxhb.follow(
            jaxhb.load_scene("six_cylinder_diesel"), "rpm", start=1000.0, to=1500.0
        )


@pytest.mark.slow
def test_a_branch_of_twice_the_period_leaves_at_a_period_doubling():
    """The lightly loaded pair: extremes and multipliers of its stable points are those
    of event-exact motions.
    """
    natural = ONE_RADIAN_PER_SECOND
    train = pair_train(Pair(1.0, epsilon=1e-3), transition=0.01)
    branch = jaxhb.follow(
        train, "rpm", start=1.7 * natural, to=1.5 * natural, harmonics=32
    )
    (point,) = (point for point in branch.special if point.kind == "period doubling")
    doubled = branch.doubled()
    assert doubled.value[0] == pytest.approx(point.value, rel=1e-9)
    revolutions = train.topology.revolutions_per_cycle
    assert doubled.train.topology.revolutions_per_cycle == 2 * revolutions
    compared = 0
    for i in range(3, len(doubled), 2):
        # Beside the doubling the motions move with the root of the distance, and the
        # transition zone shifts that.
        if not doubled.stable[i] or abs(doubled.value[i] / point.value - 1) < 0.01:
            continue
        speed = doubled.value[i] / natural
        x = doubled.response(i).deflection("a", "b").samples(4096)
        state = x[0], (x[1] - x[-1]) * 2048 * speed / (4 * np.pi)
        exact = long_run(Pair(speed, epsilon=1e-3), state)
        assert exact.period == 2
        reached = doubled.largest_deflection[i, 0], doubled.smallest_deflection[i, 0]
        # The transition zone moves extremes by so much.
        np.testing.assert_allclose(reached, (exact.maximum, exact.minimum), atol=3e-3)
        expected = abs(multipliers(exact.cycles)[0])
        assert abs(doubled.multiplier[i]) == pytest.approx(expected, abs=5e-3)
        compared += 1
    assert compared >= 3
    refused(
        lambda: branch.doubled(1),
        "period doubling no. 1 is asked for, and this branch has 1",
        ValueError,
    )
