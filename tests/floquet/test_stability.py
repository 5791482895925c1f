"""Floquet multipliers against exact cases, Liouville's formula and dense pencils."""

import dataclasses
from functools import cache

import dense
import numpy as np
import pytest
import scipy.linalg
from reference_data import DATA, method_case, reference, refused
from trains import ONE_RADIAN_PER_SECOND, build, gearbox_parts, one_mass_parts

import jaxhb
from jaxhb import NotConverged, Stability
from jaxhb.branches.search import PeriodicMotion
from jaxhb.floquet import stability


def one_mass(**changes):
    """The case of docs/theory A7 as a pair of gears: its two multipliers beside the two
    of the free rotation.
    """
    params, _ = method_case("A7_true_periodic_one_mass")
    numbers = {key: float(value) for key, value in params.items()} | changes
    return build(one_mass_parts(**numbers), reference="a")


def of_teeth(response):
    """Multipliers without those of the rotation."""
    result = jaxhb.stability(response)
    # Intervals are of high order, not exact: the dense equation leaves 1e-10.
    assert abs(result.liouville) < 1e-9
    return result.multipliers[~result.rotation]


@cache
def error_of_trace(harmonics):
    train = one_mass()
    response = jaxhb.solve(
        train, rpm=ONE_RADIAN_PER_SECOND, harmonics=harmonics, integrals="exact"
    )
    _, expected = method_case("A7_true_periodic_one_mass")
    multipliers = of_teeth(response)
    assert abs(np.prod(multipliers) - float(expected["monodromy_det"])) < 1e-11
    return abs(np.sum(multipliers) - float(expected["monodromy_trace"]))


@pytest.mark.slow
def test_multipliers_converge_to_those_of_the_true_periodic_motion():
    """Fourth order, as the largest error of the motion does."""
    assert error_of_trace(128) < 2e-7
    assert np.log2(error_of_trace(32) / error_of_trace(128)) / 2 > 3


@pytest.mark.slow
def test_moduli_and_labels_of_the_sharp_dead_zone_up_and_down():
    """Each speed starts from its neighbour, or is marched where the branch ends. Moduli
    are those of a damped mass whatever the transition of the law is; the motion is off
    by its square, and tells the two branches apart.
    """
    rows = reference("backlash_one_mass_exact")["kahraman_singh_form"]["rows"]
    train = one_mass(m=1.0, b=0.1, c=1.0, eps=0.0, h=2.0, q0=0.1, q1=0.05)
    train = train.replace({"a|b.transition": 0.01})
    response = "march"
    compared = 0
    for row in rows:
        swing = 0.05 * row["Omega"] ** 2  # a sine: a quarter of a cycle later
        here = train.replace(
            {
                "a:torque.harmonics": [[0.0, -swing]],
                "b:torque.harmonics": [[0.0, swing]],
            }
        )
        for start in (response, "march"):
            response = jaxhb.solve(
                here,
                rpm=row["Omega"] * ONE_RADIAN_PER_SECOND,
                harmonics=64,
                start=start,
            )
            if response.status <= 1:
                break
        assert response.status <= 1
        assert abs(response.deflection("a", "b").max - row["max"]) < 1e-3
        moduli = np.sort(np.abs(of_teeth(response)))
        np.testing.assert_allclose(
            moduli, np.sort(row["floquet_abs"]), rtol=0, atol=1e-9
        )
        assert jaxhb.stability(response).stable == row["stable"]
        compared += 1
    assert compared == len(rows) == 26


@cache
def floating():
    return jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=3000.0)


def test_a_train_that_floats_has_a_double_root_of_one():
    """It keeps half the digits. Liouville's formula on the engine:
    ``tests/solutions/test_gear_train_30.py``.
    """
    result = jaxhb.stability(floating())
    assert abs(result.liouville) < 1e-10
    assert result.stable
    np.testing.assert_allclose(
        result.multipliers[result.rotation], [1.0, 1.0], atol=1e-6
    )


@pytest.mark.slow
def test_a_floating_pair_on_a_varying_stiffness_has_two_roots_of_its_rotation():
    """Above a parametric resonance the largest multiplier of the teeth is -1.02, and
    the product of both is the loss by damping in a cycle.
    """
    damping = 0.05
    natural = 500.0
    omega = 2.08
    teeth = 20
    gears = [
        jaxhb.Disk(name=name, inertia=1.0, radius=0.5, teeth=teeth)
        for name in ("a", "b")
    ]
    mesh = jaxhb.Mesh(
        between=("a", "b"),
        stiffness=2.0 * natural**2,
        damping=2 * damping * 2.0 * natural,
        damping_law="always",
        stiffness_orders=[(1, 0.5, 0.0)],
    )
    load = [jaxhb.Torque(disk="a", mean=1.0), jaxhb.Load(disk="b")]
    pair = jaxhb.build(
        [*gears, mesh, *load], reference="a", revolutions_per_cycle=1 / teeth
    )
    result = jaxhb.stability(
        jaxhb.solve(pair, rpm=omega * natural * 30 / np.pi / teeth)
    )
    np.testing.assert_allclose(
        result.multipliers[result.rotation], [1.0, 1.0], atol=1e-6
    )
    of_teeth = result.multipliers[~result.rotation]
    assert len(of_teeth) == 2
    assert np.prod(of_teeth) == pytest.approx(
        np.exp(-2 * damping * 2 * np.pi / omega), rel=1e-6
    )


def light_pair():
    """Lightly loaded gears driven through a shaft, on a soft ground."""
    return jaxhb.load_scene(DATA / "scenes" / "light_pair.toml")


@cache
def rattling():
    response = jaxhb.check(jaxhb.solve(light_pair(), rpm=1500.0, harmonics=128))
    assert response.mesh("pinion", "wheel").separated_fraction > 0.05
    return response


@pytest.mark.slow
def test_the_rotation_against_a_soft_ground_is_labelled():
    """The whole train as one disk: J s^2 + b s + c = 0, gears of half the speed with a
    quarter of their share.
    """
    result = jaxhb.stability(rattling())
    inertia = 0.03 + 0.05 / 4
    damping = 0.5 + 0.4 / 4
    expected = np.exp(60 / 1500 * np.roots([inertia, damping, 0.5]))
    np.testing.assert_allclose(
        result.multipliers[result.rotation], np.sort(expected)[::-1], rtol=1e-3
    )


@pytest.mark.slow
def test_a_cycle_of_two_revolutions_has_the_squares_of_the_multipliers_of_one():
    response = rattling()
    deflections = np.zeros((1, 2 * response.harmonics + 1), dtype=complex)
    deflections[:, ::2] = response.deflections
    repeated = dataclasses.replace(
        response, deflections=deflections, train=response.train.repeated(2)
    )
    once = of_teeth(response)
    twice = of_teeth(repeated)
    # Neither rounding nor 1, whose square is itself
    assert 0.01 < abs(once[0]) < 1
    np.testing.assert_allclose(
        np.sort_complex(twice), np.sort_complex(once**2), atol=1e-8
    )


def with_viscous_damping(part, hz):
    """The part with its loss factor as viscous damping at a frequency."""
    if not getattr(part, "loss_factor", 0.0):
        return part
    damping = part.damping + part.loss_factor * part.stiffness / (2 * np.pi * hz)
    return dataclasses.replace(part, loss_factor=0.0, damping=damping)


def test_a_train_in_contact_has_the_multipliers_of_its_damped_modes():
    """Loops, gears without inertia on damped and undamped shafts, a ring without a
    spring: against the dense pencil ``K + s B + s^2 M``, whose infinite roots are the
    massless disks'.
    """
    parts = [with_viscous_damping(part, 50.0) for part in gearbox_parts()]
    response = jaxhb.solve(build(parts, reference="motor"), rpm=900.0)
    result = jaxhb.stability(response)
    at_one = dense.dynamic_stiffness(parts, 1.0)
    elastic = dense.dynamic_stiffness(parts, 0.0).real
    viscous = at_one.imag
    inertia = elastic - at_one.real
    identity = np.eye(len(elastic))
    zero = np.zeros_like(elastic)
    roots = scipy.linalg.eigvals(
        np.block([[zero, identity], [-elastic, -viscous]]),
        np.block([[identity, zero], [zero, inertia]]),
    )
    expected = np.exp(60 / 900 * roots[np.isfinite(roots) & (np.abs(roots) < 1e8)])
    multipliers = result.multipliers[np.abs(result.multipliers) > 1e-6]
    expected = expected[np.abs(expected) > 1e-6]
    assert len(multipliers) == len(expected) >= 6
    np.testing.assert_allclose(
        np.sort_complex(multipliers), np.sort_complex(expected), atol=1e-7
    )
    # Rounding of a logarithm of -29,000.
    assert abs(result.liouville) < 1e-9
    assert result.stable


def test_loss_factors_damp_each_mode_as_the_complex_stiffness_does():
    """Moduli of the multipliers of a train in contact, against the eigenvalues with
    complex stiffness. Each is off by the second order of loss factors of up to 0.15.
    """
    train = jaxhb.load_scene("engine_with_damper")
    response = jaxhb.solve(train, rpm=1500.0)
    result = jaxhb.stability(response)
    modes = jaxhb.damped_modes(train)
    period = 2 * np.pi / train.topology.cycle_frequency(1500.0)
    expected = np.sort(np.exp(period * modes.eigenvalues.real))[::-1][:4]
    turning = np.abs(result.multipliers[result.multipliers.imag > 0])[:4]
    np.testing.assert_allclose(np.log(turning), np.log(expected), rtol=0.02)


@pytest.mark.slow
def test_what_takes_too_long_is_refused_and_counts_as_not_decided(monkeypatch):
    monkeypatch.setattr(stability, "MOST_INTERVALS", 10)
    monkeypatch.setattr(stability, "DENSE_DISKS", 2)
    decided = stability.tendency(rattling())
    assert decided.attracts is None
    assert decided.stability is None
    assert "stability would take" in decided.refusal
    assert "intervals a cycle" in decided.refusal
    monkeypatch.setattr(stability, "DISKS", 2)
    assert (
        "has 3 disks, and stability is decided for up to 2"
        in stability.tendency(rattling()).refusal
    )
    assert "stability not decided" in str(PeriodicMotion(rattling(), 1, None, None))


@pytest.mark.slow
def test_a_failure_of_linear_algebra_is_no_refusal(monkeypatch):
    def fail(response):
        raise np.linalg.LinAlgError("no convergence")

    monkeypatch.setattr(stability, "stability", fail)
    with pytest.raises(np.linalg.LinAlgError):
        stability.tendency(rattling())


LOST = [
    ([0.5], None, "falls to 0.5 of its size"),
    ([2.0], "fold", "grows 2 times"),
    ([0.99996], None, "a disturbance falls by 0.004 % in a cycle"),
    ([-3.0], "period doubling", "two cycles differ"),
    ([1 + 1j, 1 - 1j], "Neimark-Sacker", "second frequency"),
]


@pytest.mark.parametrize(("critical", "name", "words"), LOST)
def test_how_stability_is_lost_is_named(critical, name, words):
    multipliers = np.array([5.0, *critical, 0.1], dtype=complex)
    rotation = np.arange(len(multipliers)) == 0
    result = Stability(multipliers, rotation, 0.0)
    assert result.loses_by == name
    assert result.stable == (name is None)
    assert words in str(result)
    assert result.largest == abs(critical[0])


def test_what_has_no_multipliers_is_refused_with_a_sentence():
    train = jaxhb.load_scene("spur_pair")
    refused(
        lambda: jaxhb.stability(jaxhb.solve_speeds(train, rpm=[1000.0, 1100.0])),
        "sweep of 2 speeds",
        ValueError,
    )
    response = floating()
    refused(
        lambda: jaxhb.stability(dataclasses.replace(response, train=None)),
        "without its train",
        ValueError,
    )
    with pytest.raises(NotConverged, match="3000 rpm is no periodic motion"):
        jaxhb.stability(dataclasses.replace(response, status=np.array(4)))
    massless = jaxhb.solve(train.replace({"gear a.inertia": 0.0}), rpm=500.0)
    assert stability.tendency(massless).attracts is None
    refused(
        lambda: jaxhb.stability(massless),
        "carries a backlash mesh: no equation of motion in time",
        ValueError,
    )
