"""Rivals in the benchmarks integrate the same equations, and refined trains are the
same trains.
"""

from pathlib import Path

import numpy as np
import pytest
from chain_task import SWEEP, condensed_sweep, extremes, full_sweep, published
from design_gradients import FORCE, many_parameters, viscous_engine
from figures import curves, draw, read
from peers import ALLOWED, chain_train, deviation, listed, rpm_of
from refined_trains import refined, tooth_damping_ratio, with_tooth_damping

import jaxhb
from jaxhb.design.quantities import check_all
from jaxhb.train import chain
from jaxhb.train.mesh_parameters import law_meshes

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[1] / "benchmarks"
STEPS = 12000


@pytest.fixture(scope="module")
def gears():
    return jaxhb.load_scene("gear_train_30")


def test_tooth_damping_is_set_by_its_ratio(gears):
    np.testing.assert_allclose(tooth_damping_ratio(gears), 0.05, rtol=2e-5)
    np.testing.assert_allclose(
        tooth_damping_ratio(with_tooth_damping(gears, 0.02)), 0.02, rtol=1e-12
    )


def test_a_refined_train_keeps_inertia_stiffness_and_low_frequencies(gears):
    fine = refined(gears, 300)
    assert fine.topology.n_disks == 300
    assert np.isclose(fine.disks.inertia.sum(), gears.disks.inertia.sum(), rtol=1e-12)
    compliance = dict.fromkeys(gears.topology.shaft_names, 0.0)
    for name, stiffness in zip(
        fine.topology.shaft_names, fine.shafts.stiffness, strict=True
    ):
        compliance[name.partition(".")[0]] += 1 / stiffness
    np.testing.assert_allclose(
        1 / np.array(list(compliance.values())), gears.shafts.stiffness, rtol=1e-12
    )
    coarse, many = (
        jaxhb.natural_frequencies(t).frequencies_hz[:6] for t in (gears, fine)
    )
    np.testing.assert_allclose(many, coarse, rtol=0.01)


def test_a_refined_train_is_what_build_makes_of_its_pieces():
    def parts(inertia, shafts):
        elements = [jaxhb.Disk(name=name, inertia=J) for name, J in inertia.items()]
        elements += [
            jaxhb.Shaft(between=ends, stiffness=k, damping=r, name=n)
            for n, (ends, k, r) in shafts.items()
        ]
        return [
            *elements,
            jaxhb.Damper(
                name="ring", disk="a", inertia=0.2, damping=3.0, stiffness=10.0
            ),
            jaxhb.Ground(disk="b", stiffness=5.0),
            jaxhb.Torque(disk="a", harmonics=[(1.0, 5.0, 2.0)]),
        ]

    whole = parts({"a": 1.0, "b": 2.0}, {"a|b": (("a", "b"), 1e4, 4.0)})
    inertia = {"a": 0.9, "b": 1.9, "piece 1": 0.1, "piece 2": 0.1}
    ends = (("a", "piece 1"), ("piece 1", "piece 2"), ("piece 2", "b"))
    cut = parts(
        inertia, {f"a|b.{k + 1}": (disks, 3e4, 12.0) for k, disks in enumerate(ends)}
    )
    fine = refined(jaxhb.build(whole), 5)
    expected = jaxhb.build(cut)
    assert fine.topology == expected.topology
    refined_system = chain.assemble(fine)
    built_system = chain.assemble(expected)
    for field in ("mass", "damping", "ground", "stiffness", "viscous"):
        np.testing.assert_allclose(
            getattr(refined_system, field), getattr(built_system, field), rtol=1e-12
        )


@pytest.fixture(scope="module")
def orbit(gears):
    return jaxhb.integrate(gears, rpm=1833.0, cycles=1, steps=STEPS)


@pytest.mark.parametrize(("method", "tolerance"), [("rk4", 1e-4), ("implicit", 2e-2)])
def test_compiled_integrators_agree_with_the_referee_over_one_cycle(
    gears, orbit, method, tolerance
):
    pytest.importorskip("numba")
    pytest.importorskip("scipy")
    from marches import march
    from tasks import prepare

    marched = march(prepare(gears, 1833.0), method, STEPS, cycles=1)
    assert len(law_meshes(gears).link) == len(marched.force)
    error = np.abs(marched.force - orbit.elastic).max()
    assert error < tolerance * np.abs(orbit.elastic).max()
    assert orbit.separated.max() > 0.05


def test_the_implicit_integrator_is_of_second_order_while_teeth_stay_in_contact(gears):
    pytest.importorskip("numba")
    pytest.importorskip("scipy")
    import dataclasses

    from marches import march
    from tasks import prepare

    task = prepare(gears, 1833.0)
    wide = task.model._replace(
        low=-1e3 + 0 * task.model.low, width=1e3 + 0 * task.model.width
    )
    task = dataclasses.replace(task, model=wide._replace(soft=wide.mesh_k))
    finest = march(task, "rk4", 8000, cycles=1).deflection
    coarse = {
        steps: march(task, "implicit", steps, cycles=1).deflection
        for steps in (2000, 4000)
    }
    errors = [
        np.abs(deflection - finest[:, :: 8000 // steps]).max()
        for steps, deflection in coarse.items()
    ]
    # Second order: half the step, a quarter of the error
    assert 3.5 < errors[0] / errors[1] < 4.5


@pytest.mark.parametrize(("masses", "frequency"), [(3, 1.10), (10, 0.94)])
def test_the_chain_task_has_its_published_points(masses, frequency):
    statement = published()["single"]
    ends = {3: (0.218, 1.303), 10: (0.180, 1.225)}[masses]
    printed = [f"{end:.3f}" for end in ends]
    assert all(number in statement for number in printed)
    speeds = np.linspace(1.30, frequency, 12)
    condensed = condensed_sweep(masses, speeds)[-1]
    full = full_sweep(masses, speeds)[-1]
    # Both have a residual of 1e-8.
    np.testing.assert_allclose(condensed, full, atol=1e-7)
    # Half a unit of the last digit.
    np.testing.assert_allclose(extremes(full), ends, atol=5e-4)


def test_the_chain_as_a_drive_train_moves_like_the_numpy_floor():
    speeds = np.linspace(1.30, 0.94, 30)
    response = jaxhb.solve(
        chain_train(10), rpm=float(rpm_of(speeds[-1])), harmonics=15, tolerance=0.5
    )
    assert response.converged
    motion = listed(response.deflections)
    expected = condensed_sweep(10, speeds)[-1:]
    assert deviation(motion, expected) < 1e-7
    assert deviation(motion, 1.01 * expected) > 1e-3


def test_a_peer_solves_the_same_chain():
    pytest.importorskip("harmonicbalance")
    from peer_codes import harmonicbalance_sweep

    motion, _ = harmonicbalance_sweep(3, SWEEP[:2])
    assert deviation(motion, full_sweep(3, SWEEP[:2])) < ALLOWED


def _row(method, setting, seconds, error, status="settled", rpm=1833.0):
    return {
        "benchmark": "work-precision",
        "method": method,
        "setting": setting,
        "disks": 27,
        "damping_percent": 6,
        "rpm": rpm,
        "seconds": seconds,
        "error": error,
        "status": status,
    }


def test_a_curve_has_medians_over_speeds_and_no_setting_that_another_beats():
    rows = [
        *(
            _row("rk4", "steps 10", s, e, rpm=r)
            for s, e, r in ((1.0, 0.1, 1), (2.0, 0.2, 2), (9.0, 0.9, 3))
        ),
        *(
            _row("rk4", "steps 20", s, 0.01, rpm=r)
            for s, r in ((3.0, 1), (4.0, 2), (5.0, 3))
        ),
        *(_row("rk4", "steps 30", 6.0, 0.02, rpm=r) for r in (1, 2, 3)),
        _row("rk4", "steps 5", 0.1, 1e-9, "never settles"),
        _row("jaxhb", "tolerance 0.01", None, None),
    ]
    assert curves(rows) == {"rk4": [(2.0, 0.2, 3), (4.0, 0.01, 3)]}


def test_the_stored_rows_are_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    stored = read(sorted((FOLDER / "results").glob("*.jsonl")))
    drawn = draw(stored)
    assert set(drawn) == {"work_precision", "scaling", "peers"}
    panels = {(r["disks"], r["damping_percent"]) for r in stored["work-precision"]}
    assert len(drawn["work_precision"].axes) == len(panels)
    assert {(27, 6), (27, 1), (3000, 6), (3000, 1)} <= panels
    for name, figure in drawn.items():
        figure.savefig(tmp_path / f"{name}.png")
        assert (FOLDER / "figures" / f"{name}.png").exists()


def test_a_hundred_numbers_of_the_engine_can_be_tuned():
    train = viscous_engine()
    parameters = many_parameters(train, 100)
    assert len({parameter.name for parameter in parameters}) == 100
    check_all(train, parameters, (FORCE,), (), np.array([1000.0]))


def test_random_geared_trees_have_the_frequencies_that_mpmath_finds():
    pytest.importorskip("opentorsion")
    mpmath = pytest.importorskip("mpmath")
    from opentorsion_trees import OURS, compared, random_tree

    random = np.random.default_rng(1)
    with mpmath.workdps(50):
        comparisons = [
            compared(random_tree(random), rigid)[OURS] for rigid in (False, True)
        ]
    assert max(errors.max() for errors, _, _ in comparisons) < 1e-12
    assert {rigid for _, rigid, _ in comparisons} == {0.0}
