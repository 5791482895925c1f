"""Derivatives of natural frequencies against differences, closed forms and sums over
clusters.
"""

from functools import partial

import jax
import numpy as np
import pytest
from differences import check_derivative
from tolerances import ALGEBRAIC
from trains import branched_parts, build, chain_parts, gearbox_parts

import jaxhb
from jaxhb import Shaft
from jaxhb.linear.sensitivity import cluster_sums_hz, clusters_of, frequencies_hz

BRANCHED = build(branched_parts(), reference="flywheel")
GEARBOX = build(gearbox_parts(), reference="motor")


def test_values_are_the_natural_frequencies():
    for train in (BRANCHED, GEARBOX):
        expected = jaxhb.natural_frequencies(train).frequencies_hz
        np.testing.assert_allclose(
            jax.jit(partial(frequencies_hz, train))(), expected, rtol=1e-10
        )


KEYS_OF_GEARBOX = [
    "mill.inertia",
    "rubber ring.inertia",
    "rubber ring.stiffness",
    "coupling|motor.stiffness",
    "lay 3|output.stiffness",
    "lay 2:ground.stiffness",
    "input 1|lay 1.stiffness",
]
RADII_OF_BRANCHED = [
    f"{BRANCHED.topology.disk_names[disk]}.radius"
    for disk in BRANCHED.topology.mesh_ends[-1]
]


# Stiffness and inertia of disks, ring, shaft and mesh, ground, radius; massless disks
# and a closed loop among them.
@pytest.mark.parametrize(
    ("train", "keys"), [(GEARBOX, KEYS_OF_GEARBOX), (BRANCHED, RADII_OF_BRANCHED)]
)
def test_frequencies_have_the_derivatives_of_differences(train, keys):
    heavy = np.concatenate([train.disks.inertia, train.dampers.inertia]) > 0
    moving = np.flatnonzero(jaxhb.natural_frequencies(train).frequencies_hz)

    def value(numbers):
        changed = train.replace(dict(zip(keys, numbers, strict=True)))
        return frequencies_hz(changed, heavy)[moving]

    check_derivative(value, [float(train.value(key)) for key in keys], step=1e-3)


def test_second_derivative_is_that_of_two_disks():
    # omega^2 = k (1/J1 + 1/J2): f'' = -f / (4 k^2)
    parts = chain_parts([2.0, 3.0], [100.0])

    def value(stiffness):
        return frequencies_hz(build(parts).replace({"1|2.stiffness": stiffness}))[1]

    hz, second = jax.jit(lambda k: (value(k), jax.grad(jax.grad(value))(k)))(100.0)
    np.testing.assert_allclose(second, -hz / 4e4, rtol=ALGEBRAIC)


def test_sums_over_repeated_frequencies_have_the_derivatives_of_differences():
    train = build(
        [*chain_parts([1.0] * 6, [1.0] * 5), Shaft(between=("1", "6"), stiffness=1.0)]
    )
    clusters = clusters_of(jaxhb.natural_frequencies(train).frequencies_hz)
    assert clusters == ((0,), (1, 2), (3, 4), (5,))

    def of_host(values):
        hz = jaxhb.natural_frequencies(train.replace(values)).frequencies_hz
        return np.array([hz[list(cluster)].sum() for cluster in clusters])

    heavy = np.ones(6, bool)
    h = 1e-3

    def sums(values):
        return cluster_sums_hz(train.replace(values), clusters, heavy)

    slopes = jax.jit(jax.jacrev(sums))({"2.inertia": 1.0, "3|4.stiffness": 1.0})
    for key, slope in slopes.items():
        up = of_host({key: 1 + h})
        down = of_host({key: 1 - h})
        # Differences leave h^2 of the third derivative.
        np.testing.assert_allclose(slope, (up - down) / (2 * h), rtol=0, atol=2e-6)


def test_viscous_link_has_a_derivative_to_its_stiffness_of_zero():
    # A ring J2 behind stiffness s -> 0 gives its own eigenvalue s (1/J1 + 1/J2); the
    # oscillating pair moves by s phi1^2.
    ring = jaxhb.Damper(name="ring", disk="1", inertia=0.1, damping=5.0)
    train = build([*chain_parts([1.0, 1.0], [50.0]), ring])

    def value(stiffness):
        return frequencies_hz(train.replace({"ring.stiffness": stiffness}))[2]

    slope = jax.jit(jax.grad(value))(0.0)
    # phi1^2 = 1/2 over 2 omega.
    np.testing.assert_allclose(slope, 0.5 / (2 * 10.0) / (2 * np.pi), rtol=1e-11)
