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
    return np.array(
        [p.inertia for p in dense.of_kind(parts, Disk) + dense.of_kind(parts, Damper)]
    )


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
    parts = [dataclasses.replace(p, inertia=0.003) if getattr(p, "inertia", 1) == 0 else p
             for p in gearbox_parts(grounded=False)]  # fmt: skip
    modes = damped_modes(build(parts, reference="motor"))
    wanted = companion(parts)
    wanted = wanted[wanted.imag > 0.01 * np.abs(wanted).clip(min=1.0)]
    # Condition of both.
    np.testing.assert_allclose(
        modes.eigenvalues, wanted[np.argsort(wanted.imag)], rtol=1e-9
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
    keys = ["motor.inertia", "viscous ring.damping", "rubber ring.loss_factor", "output|mill.stiffness",
            "input 1|lay 1.stiffness", "lay 3.radius", "mill.damping", "lay 2:ground.stiffness"]  # fmt: skip
    train = build(gearbox_parts(), reference="motor")
    at, modes = np.array([float(train.value(key)) for key in keys]), damped_modes(train)

    def changed(share):
        return train.replace(
            dict(zip(keys, at * (1 + share * np.arange(1, 9) / 8), strict=True))
        )

    def value(share):
        return jaxhb.damped_eigenvalues(changed(share), modes)

    found, slopes = jax.jit(lambda share: jax.jvp(value, (share,), (1.0,)))(0.0)
    np.testing.assert_allclose(found, modes.eigenvalues, rtol=1e-10)
    wanted = differences(
        lambda shares: [damped_modes(changed(s)).eigenvalues for (s,) in shares],
        np.zeros(1),
        np.array([1e-3]),
    )[0]
    # Of the QZ method.
    noise = (
        1e-15 * np.abs(modes.eigenvalues[-1]) ** 2 / np.abs(modes.eigenvalues) / 1e-3
    )
    assert (np.abs(slopes - wanted) <= GRADIENT * np.abs(wanted) + noise).all()


def test_massless_disks_behind_dampers_are_the_limit_of_light_ones():
    def parts(inertia):
        light = Disk(name="light", inertia=inertia, damping=0.3)
        disks = [Disk(name="a", inertia=1.0), light, Disk(name="b", inertia=2.0)]
        disks.append(Shaft(between=("a", "light"), stiffness=100.0, damping=4.0))
        return [*disks, Shaft(between=("light", "b"), stiffness=50.0)]

    found = damped_modes(build(parts(0.0)))
    limit = companion(parts(1e-9))
    nearest = [limit[np.abs(limit - value).argmin()] for value in found.eigenvalues]
    assert len(found.eigenvalues) == 1
    # First order in the inertia left out.
    np.testing.assert_allclose(found.eigenvalues, nearest, rtol=1e-7)
    for rate in found.decay_rates:
        assert np.abs(limit + rate).min() < 1e-6 * rate


def pair(**link):
    """Damped modes of two disks of 2 kg m2 on a link of 100 N m/rad, 10 rad/s."""
    disks = [Disk(name=name, inertia=2.0) for name in "ab"]
    return damped_modes(
        build([*disks, Shaft(between=("a", "b"), stiffness=100.0, **link)])
    )


def test_damping_ratios_and_decay_rates_are_those_of_the_closed_form():
    for r, ratio in ((2.0, 0.1), (10.0, 0.5)):
        modes = pair(damping=r)
        # R / sqrt(2 k J).
        np.testing.assert_allclose(modes.damping_ratio, [ratio], rtol=ALGEBRAIC)
        np.testing.assert_allclose(
            2 * np.pi * modes.frequencies_hz, 10 * np.sqrt(1 - ratio**2), rtol=ALGEBRAIC
        )
    assert not len(pair(damping=40.0).eigenvalues)
    np.testing.assert_allclose(
        pair(damping=40.0).decay_rates,
        20 + np.array([-1, 1]) * np.sqrt(300),
        rtol=1e-11,
    )
    np.testing.assert_allclose(
        pair(loss_factor=0.02).eigenvalues, 10j * np.sqrt(1 + 0.02j), rtol=ALGEBRAIC
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
