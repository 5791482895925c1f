"""Derivatives of natural frequencies against differences, closed forms and sums over clusters.

Each test compiles one program: taken one by one, the operations would be a hundred.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from tolerances import ALGEBRAIC, GRADIENT, TANGENT
from trains import branched_parts, build, chain_parts, gearbox_parts

import jaxhb
from jaxhb import Shaft
from jaxhb.linear.sensitivity import cluster_sums_hz, clusters_of, frequencies_hz

BRANCHED = build(branched_parts(), reference="flywheel")
GEARBOX = build(gearbox_parts(), reference="motor")


def by_differences(train, key, step=1e-5):
    """Central differences of fourth order of the host's frequencies to the relative change of one number."""
    at = float(train.value(key))

    def value(h):
        return jaxhb.natural_frequencies(train.replace({key: at * (1 + h)})).frequencies_hz

    return (8 * (value(step) - value(-step)) - (value(2 * step) - value(-2 * step))) / (12 * step * at)


def test_values_are_the_natural_frequencies():
    for train in (BRANCHED, GEARBOX):
        wanted = jaxhb.natural_frequencies(train).frequencies_hz
        np.testing.assert_allclose(jax.jit(partial(frequencies_hz, train))(), wanted, rtol=1e-10)


def test_gradients_to_every_kind_of_number_are_those_of_differences():
    # stiffness and inertia of disks, ring, shaft and mesh, ground, radius; massless disks and a closed loop among them
    heavy = np.concatenate([GEARBOX.disks.inertia, GEARBOX.dampers.inertia]) > 0
    highest = jaxhb.natural_frequencies(GEARBOX).frequencies_hz[-1]
    keys = ("mill.inertia", "rubber ring.inertia", "rubber ring.stiffness", "coupling|motor.stiffness")
    keys += ("lay 3|output.stiffness", "lay 2:ground.stiffness", "input 1|lay 1.stiffness")
    slopes = jax.jit(jax.jacrev(lambda values: frequencies_hz(GEARBOX.replace(values), heavy)))(
        {key: float(GEARBOX.value(key)) for key in keys}
    )
    for key in keys:
        wanted = by_differences(GEARBOX, key)
        noise = 1e-15 * highest / (1e-5 * float(GEARBOX.value(key)))  # of differences of rounded frequencies
        np.testing.assert_allclose(slopes[key], wanted, rtol=GRADIENT, atol=noise)


def test_gradients_to_radii_of_gears_are_those_of_differences():
    heavy = np.concatenate([BRANCHED.disks.inertia, BRANCHED.dampers.inertia]) > 0
    highest = jaxhb.natural_frequencies(BRANCHED).frequencies_hz[-1]
    keys = [f"{BRANCHED.topology.disk_names[disk]}.radius" for disk in BRANCHED.topology.mesh_ends[-1]]
    slopes = jax.jit(jax.jacfwd(lambda values: frequencies_hz(BRANCHED.replace(values), heavy)))(
        {key: float(BRANCHED.value(key)) for key in keys}
    )
    for key in keys:
        noise = 1e-15 * highest / (1e-5 * float(BRANCHED.value(key)))
        np.testing.assert_allclose(slopes[key], by_differences(BRANCHED, key), rtol=GRADIENT, atol=noise)


def test_forward_and_reverse_derivatives_agree_under_jit_and_vmap():
    def value(k):
        return frequencies_hz(BRANCHED.replace({BRANCHED.topology.shaft_names[0] + ".stiffness": k}))

    @jax.jit
    def slopes(at):
        forward = jax.jacfwd(value)
        return forward(at), jax.jacrev(value)(at), jax.vmap(forward)(jnp.stack([at, 1.1 * at]))

    forward, reverse, batch = slopes(float(BRANCHED.shafts.stiffness[0]))
    np.testing.assert_allclose(forward, reverse, rtol=TANGENT, atol=TANGENT * np.abs(forward).max())
    np.testing.assert_allclose(batch[0], forward, rtol=1e-9, atol=TANGENT * np.abs(forward).max())


def test_second_derivative_is_that_of_two_disks():
    # omega^2 = k (1/J1 + 1/J2): f'' = -f / (4 k^2)
    parts = chain_parts([2.0, 3.0], [100.0])
    value = lambda k: frequencies_hz(build(parts).replace({"1|2.stiffness": k}))[1]  # noqa: E731
    found, second = jax.jit(lambda k: (value(k), jax.grad(jax.grad(value))(k)))(100.0)
    np.testing.assert_allclose(second, -found / 4e4, rtol=ALGEBRAIC)


def ring(n=6):
    return build([*chain_parts([1.0] * n, [1.0] * (n - 1)), Shaft(between=("1", str(n)), stiffness=1.0)])


def test_sums_over_repeated_frequencies_have_the_derivatives_of_differences():
    train = ring()
    clusters = clusters_of(jaxhb.natural_frequencies(train).frequencies_hz)
    assert clusters == ((0,), (1, 2), (3, 4), (5,))

    def of_host(values):
        found = jaxhb.natural_frequencies(train.replace(values)).frequencies_hz
        return np.array([found[list(c)].sum() for c in clusters])

    heavy, h = np.ones(6, bool), 1e-3
    slopes = jax.jit(jax.jacrev(lambda values: cluster_sums_hz(train.replace(values), clusters, heavy)))(
        {"2.inertia": 1.0, "3|4.stiffness": 1.0}
    )
    for key, slope in slopes.items():
        up, down = of_host({key: 1 + h}), of_host({key: 1 - h})
        np.testing.assert_allclose(slope, (up - down) / (2 * h), rtol=0, atol=2e-6)  # h^2 of the third derivative


def test_viscous_link_has_a_derivative_to_its_stiffness_of_zero():
    # a ring J2 behind stiffness s -> 0 gives its own eigenvalue s (1/J1 + 1/J2); the oscillating pair moves by s phi1^2
    rest = jaxhb.Damper(name="ring", disk="1", inertia=0.1, damping=5.0)
    train = build([*chain_parts([1.0, 1.0], [50.0]), rest])
    slope = jax.jit(jax.grad(lambda s: frequencies_hz(train.replace({"ring.stiffness": s}))[2]))(0.0)
    np.testing.assert_allclose(slope, 0.5 / (2 * 10.0) / (2 * np.pi), rtol=1e-11)  # phi1^2 = 1/2, d omega = / (2 omega)
