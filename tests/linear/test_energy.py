"""Quadratic forms against the assembled matrices, damped modes against the companion
form of dense ones.
"""

import dataclasses

import dense
import jax
import numpy as np
import pytest
from differences import differences
from scipy.linalg import eigvals
from tolerances import ALGEBRAIC, GRADIENT
from trains import branched_parts, build, gearbox_parts

import jaxhb
from jaxhb import Damper, Disk, Shaft
from jaxhb.linear.damped import damped_modes
from jaxhb.linear.sensitivity import inertia_and_stiffness

TRAINS = {
    "branched": (branched_parts(), "flywheel"),
    "gearbox": (gearbox_parts(), "motor"),
}


def inertia_of(parts):
    masses = dense.of_kind(parts, Disk) + dense.of_kind(parts, Damper)
    return np.array([mass.inertia for mass in masses])


@pytest.mark.parametrize("case", TRAINS)
def test_matrices_of_lashko_are_second_derivatives_of_the_energies(case):
    parts, reference = TRAINS[case]
    J, C = jax.jit(inertia_and_stiffness)(build(parts, reference=reference))
    np.testing.assert_allclose(J, np.diag(inertia_of(parts)), rtol=ALGEBRAIC)
    K = dense.dynamic_stiffness(parts, 0.0).real
    np.testing.assert_allclose(C, K, rtol=0, atol=ALGEBRAIC * np.abs(K).max())


def companion(parts):
    """Finite eigenvalues of (lambda^2 M + lambda B + K), K complex by loss factors, of
    disks that all have inertia.
    """
    M = np.diag(inertia_of(parts))
    K = dense.dynamic_stiffness(parts, 1e-30).real
    loss = dense.dynamic_stiffness(parts, 1e-30).imag
    B = dense.dynamic_stiffness(parts, 1.0).imag - loss
    n = len(M)
    lower = [-np.linalg.solve(M, K + 1j * loss), -np.linalg.solve(M, B)]
    return eigvals(np.block([[np.zeros((n, n)), np.eye(n)], lower]))


def test_damped_modes_are_the_eigenvalues_of_the_dense_companion():
    parts = [
        dataclasses.replace(part, inertia=0.003)
        if getattr(part, "inertia", 1) == 0
        else part
        for part in gearbox_parts(grounded=False)
    ]
    modes = damped_modes(build(parts, reference="motor"))
    expected = companion(parts)
    expected = expected[expected.imag > 0.01 * np.abs(expected).clip(min=1.0)]
    # The tolerance is the condition of both.
    np.testing.assert_allclose(
        modes.eigenvalues, expected[np.argsort(expected.imag)], rtol=1e-9
    )
    M = np.diag(inertia_of(parts))
    for value, shape in zip(modes.eigenvalues, modes.shapes, strict=True):
        # With the loss factors, at a frequency that is not the mean.
        Z = dense.dynamic_stiffness(parts, 1e-30)
        B = (dense.dynamic_stiffness(parts, 1.0) - Z).imag
        rest = value**2 * (M @ shape) + value * (B @ shape) + Z @ shape
        assert np.abs(rest).max() < 1e-10 * (np.abs(Z) @ np.abs(shape)).max()
    assert np.abs(np.abs(modes.shapes).max(1) - 1).max() < ALGEBRAIC


def test_damped_eigenvalues_have_the_derivatives_of_differences():
    keys = [
        "motor.inertia",
        "viscous ring.damping",
        "rubber ring.loss_factor",
        "output|mill.stiffness",
        "input 1|lay 1.stiffness",
        "lay 3.radius",
        "mill.damping",
        "lay 2:ground.stiffness",
    ]
    train = build(gearbox_parts(), reference="motor")
    at = np.array([float(train.value(key)) for key in keys])
    modes = damped_modes(train)

    def changed(share):
        numbers = at * (1 + share * np.arange(1, 9) / 8)
        return train.replace(dict(zip(keys, numbers, strict=True)))

    def value(share):
        return jaxhb.damped_eigenvalues(changed(share), modes)

    values, slopes = jax.jit(lambda share: jax.jvp(value, (share,), (1.0,)))(0.0)
    np.testing.assert_allclose(values, modes.eigenvalues, rtol=1e-10)

    def eigenvalues(shares):
        return [damped_modes(changed(share)).eigenvalues for (share,) in shares]

    (expected,) = differences(eigenvalues, np.zeros(1), np.array([1e-3]))
    # Noise of the QZ method.
    size = np.abs(modes.eigenvalues)
    noise = 1e-15 * size[-1] ** 2 / size / 1e-3
    assert (np.abs(slopes - expected) <= GRADIENT * np.abs(expected) + noise).all()


def test_massless_disks_behind_dampers_are_the_limit_of_light_ones():
    def parts(inertia):
        light = Disk(name="light", inertia=inertia, damping=0.3)
        disks = [Disk(name="a", inertia=1.0), light, Disk(name="b", inertia=2.0)]
        disks.append(Shaft(between=("a", "light"), stiffness=100.0, damping=4.0))
        return [*disks, Shaft(between=("light", "b"), stiffness=50.0)]

    modes = damped_modes(build(parts(0.0)))
    limit = companion(parts(1e-9))
    nearest = [limit[np.abs(limit - value).argmin()] for value in modes.eigenvalues]
    assert len(modes.eigenvalues) == 1
    # The limit is off by the first order of the inertia.
    np.testing.assert_allclose(modes.eigenvalues, nearest, rtol=1e-7)
    for rate in modes.decay_rates:
        assert np.abs(limit + rate).min() < 1e-6 * rate


def modes_of_pair(damping=0.0, loss_factor=0.0):
    """Damped modes of two disks of 2 kg m2 on a link of 100 N m/rad, 10 rad/s."""
    disks = [Disk(name=name, inertia=2.0) for name in "ab"]
    link = Shaft(
        between=("a", "b"), stiffness=100.0, damping=damping, loss_factor=loss_factor
    )
    return damped_modes(build([*disks, link]))


def test_damping_ratios_and_decay_rates_are_those_of_the_closed_form():
    for r, ratio in ((2.0, 0.1), (10.0, 0.5)):
        modes = modes_of_pair(damping=r)
        # R / sqrt(2 k J).
        np.testing.assert_allclose(modes.damping_ratio, [ratio], rtol=ALGEBRAIC)
        np.testing.assert_allclose(
            2 * np.pi * modes.frequencies_hz, 10 * np.sqrt(1 - ratio**2), rtol=ALGEBRAIC
        )
    overdamped = modes_of_pair(damping=40.0)
    assert not len(overdamped.eigenvalues)
    rates = 20 + np.array([-1, 1]) * np.sqrt(300)
    np.testing.assert_allclose(overdamped.decay_rates, rates, rtol=1e-11)
    np.testing.assert_allclose(
        modes_of_pair(loss_factor=0.02).eigenvalues,
        10j * np.sqrt(1 + 0.02j),
        rtol=ALGEBRAIC,
    )


@pytest.mark.parametrize("relaxation", [1e9, 2e11, 1e12])
def test_a_massless_disk_that_relaxes_fast_hides_no_mode(relaxation):
    # Two disks J and links k, r in series: lambda^2 + lambda r/J + k/J = 0, and the
    # disk between them creeps at k/r.
    J = 1e3
    k = 1e5
    disks = [
        Disk(name=name, inertia=inertia)
        for name, inertia in (("a", J), ("between", 0.0), ("b", J))
    ]
    links = [
        Shaft(between=pair, stiffness=k, damping=k / relaxation)
        for pair in (("a", "between"), ("between", "b"))
    ]
    train = build([*disks, *links])
    modes = damped_modes(train)
    omega = np.sqrt(k / J)
    np.testing.assert_allclose(modes.eigenvalues.imag, [omega], rtol=ALGEBRAIC)
    # QZ rounds to omega, 1e-11 of it.
    np.testing.assert_allclose(modes.decay_rates, [relaxation], rtol=1e-3)
    ratio = jaxhb.damping_ratios(train, jaxhb.natural_frequencies(train))
    np.testing.assert_allclose(
        ratio[1:], [omega / (2 * relaxation)], rtol=0, atol=10 * np.finfo(float).eps
    )
