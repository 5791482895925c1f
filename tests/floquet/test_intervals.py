"""The variational equation in damped modes, interval by interval, against the dense
equation solved arc by arc.

Multipliers are those of the equation around any motion: the tests choose motions, and
no train is solved.
"""

import dataclasses
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from integrated_trains import dense_monodromy, one_mass
from numpy.polynomial import legendre
from reference_data import DATA, method_case, refused
from trains import build, gearbox_parts, refined

import jaxhb
from jaxhb.equations import fourier
from jaxhb.equations.state_space import partition, state_space, unheld_modes
from jaxhb.floquet import intervals, slopes
from jaxhb.floquet.stability import stability
from jaxhb.train import chain
from jaxhb.train.mesh_parameters import law_meshes

LIGHT_PAIR = jaxhb.load_scene(DATA / "scenes" / "light_pair.toml")
PLAY = 1e-4  # m, half the backlash of the light pair


def pair(teeth=(None, None), **changes):
    """The light pair with other numbers of its mesh."""
    mesh = jaxhb.Mesh(
        between=("pinion", "wheel"),
        stiffness=2e6,
        damping=500.0,
        backlash=2 * PLAY,
        epsilon=0.01,
        transition=0.3,
    )
    parts = [
        jaxhb.Disk(name="motor", inertia=0.02, damping=0.5),
        jaxhb.Disk(name="pinion", inertia=0.01, radius=0.05, teeth=teeth[0]),
        jaxhb.Disk(name="wheel", inertia=0.05, radius=0.1, teeth=teeth[1], damping=0.4),
        jaxhb.Shaft(between=("motor", "pinion"), stiffness=2000.0, damping=2.0),
        dataclasses.replace(mesh, **changes),
        jaxhb.Ground(disk="motor", stiffness=0.5),
        jaxhb.Torque(disk="motor", mean=10.0),
        jaxhb.Torque(disk="wheel", mean=-20.0),
    ]
    return build(parts, reference="motor")


def varying_pair(**changes):
    """The light pair with a stiffness that varies with the teeth."""
    return pair(
        teeth=(20, 40),
        stiffness_orders=((1.0, 0.2, 0.05), (2.0, 0.05, 0.02)),
        transition=0.1,
        **changes,
    )


def clutch(**changes):
    disc = jaxhb.Shaft(
        between=("engine", "gear"), stiffness=200.0, damping=0.4, name="disc"
    )
    parts = [
        jaxhb.Disk(name="engine", inertia=0.2, damping=0.3),
        jaxhb.Disk(name="gear", inertia=0.05, damping=0.5),
        dataclasses.replace(disc, **changes),
        jaxhb.Torque(disk="engine", mean=20.0),
        jaxhb.Torque(disk="gear", mean=-20.0),
    ]
    return build(parts, reference="engine")


def rough(count, size, harmonics=16, seed=0):
    """Deflections ``(count, N+1)`` m of some harmonics that swing by ``size``."""
    rng = np.random.default_rng(seed)
    wave = rng.normal(size=(count, harmonics)) + 1j * rng.normal(
        size=(count, harmonics)
    )
    wave = wave / (1 + np.arange(harmonics)) ** 1.5
    return np.concatenate([np.full((count, 1), 0.4 * size), 0.4 * size * wave], axis=1)


def moving(train, rpm, size, seed=0):
    """The train as if it were solved at a speed, with rough deflections."""
    count = len(train.topology.mesh_names) + len(train.topology.springs)
    deflections = rough(count, size, seed=seed)
    return SimpleNamespace(
        train=train, rpm=rpm, topology=train.topology, deflections=deflections
    )


def both(response, monkeypatch):
    """Multipliers ``(n,)`` of the largest modulus first, of the intervals and of the
    dense equation.
    """
    monkeypatch.setattr(
        "jaxhb.floquet.stability.train_of", lambda response: response.train
    )
    computed = stability(response)
    expected = np.linalg.eigvals(dense_monodromy(response).matrix)
    return computed, expected[np.argsort(-np.abs(expected))]


def difference(computed, expected, count=6):
    """Distance of the largest of ``expected`` from the computed multipliers, the
    largest, over the largest multiplier of all.
    """
    nearest = [np.abs(computed.multipliers - value).min() for value in expected[:count]]
    return max(nearest) / np.abs(expected[0])


STOPPED = clutch(
    clearance=1.0, stages=[(3.0, 1000.0)], stops=[(-5.0, 3000.0), (6.0, 5000.0)]
)
TRAINS = {
    "damping in contact": (pair(), 2 * PLAY, 1e-7),
    "damping always": (pair(damping_law="always"), 2 * PLAY, 1e-7),
    "strong damping and a sharp law": (
        pair(damping=5000.0, transition=0.01),
        2 * PLAY,
        1e-6,
    ),
    "a stiffness that varies": (varying_pair(), 2 * PLAY, 1e-7),
    "a stiffness that varies, damped always": (
        varying_pair(damping_law="always"),
        2 * PLAY,
        1e-7,
    ),
    "play, stages and stops": (STOPPED, 0.1, 1e-6),
    "friction": (clutch(friction=3.0), 0.1, 1e-4),
    "friction that sticks at once": (clutch(friction=3.0, slip_speed=0.002), 0.1, 2e-3),
}


@pytest.mark.parametrize("name", TRAINS)
def test_multipliers_are_those_of_the_dense_equation(name, monkeypatch):
    train, size, bound = TRAINS[name]
    for rpm in (900.0, 3000.0):
        computed, expected = both(moving(train, rpm, size), monkeypatch)
        assert len(computed.multipliers) == len(expected)
        assert difference(computed, expected) < bound


@pytest.mark.parametrize("grounded", [True, False])
def test_loops_rings_massless_disks_and_free_rotation_are_served(grounded, monkeypatch):
    """Teeth of a closed loop that part; loss factors damp modes alike in both
    equations.
    """
    parts = gearbox_parts(grounded=grounded)
    parts = [
        (
            dataclasses.replace(part, backlash=1e-4)
            if getattr(part, "stiffness", 0) in (1e8, 2e8)
            else part
        )
        for part in parts
    ]
    train = build(parts, reference="motor")
    computed, expected = both(moving(train, 900.0, 1e-4), monkeypatch)
    assert train.topology.law_index.tolist() == [0, 1]
    assert len(computed.multipliers) == len(expected)
    assert difference(computed, expected, 8) < 1e-6
    if not grounded:
        np.testing.assert_allclose(
            np.sort(np.abs(computed.multipliers - 1))[:2], 0.0, atol=1e-9
        )


def test_modes_of_a_finely_divided_train_all_take_part(monkeypatch):
    train = refined(LIGHT_PAIR, 30)
    computed, expected = both(moving(train, 900.0, 2 * PLAY), monkeypatch)
    assert len(computed.multipliers) == len(expected) == 60
    assert computed.rotation.sum() == 2
    assert difference(computed, expected, 8) < 1e-6


def mathieu(monkeypatch, count):
    """Error of the monodromy matrix of a damped Mathieu equation from ``count``
    intervals: ``x'' + b x' + (c0 + a cos 2t) x = 0`` is that of a law in its smooth
    zone.
    """
    monkeypatch.setattr(intervals, "PER_PERIOD", 2.0**-30)
    monkeypatch.setattr(intervals, "FEWEST", count)
    params, expected = method_case("A7_damped_mathieu_monodromy")
    b, c0, a = (float(params[key]) for key in ("b", "c0", "a"))
    contact = 3.0
    gap = 0.3
    system, meshes = one_mass(
        mass=1,
        damping=b,
        stiffness=contact,
        epsilon=gap / contact,
        transition=0.2,
        backlash=1.0,
    )
    middle = 0.4 + 0.2 * (c0 - gap) / (contact - gap)
    swing = 0.2 * a / (contact - gap)
    deflection = np.array([[middle, 0.0, swing / 2]], dtype=complex)
    parts = partition(system, meshes)
    space = jax.tree.map(np.asarray, state_space(system, meshes, 1.0, parts))
    modes = unheld_modes(system, meshes, space, 1.0, parts)
    reactions = slopes.reactions_of(modes, meshes)
    monodromy = intervals.monodromy(modes, reactions, deflection, 1.0)
    to_motion = intervals.real_states(modes, modes.motion)
    matrix = to_motion @ monodromy.matrix @ np.linalg.inv(to_motion)
    return np.abs(matrix - np.array(expected["Phi"], dtype=float)).max()


def test_intervals_have_twice_the_order_of_their_polynomials(monkeypatch):
    """Eight with four degrees, where slopes are smooth."""
    coarse = mathieu(monkeypatch, 4)
    fine = mathieu(monkeypatch, 8)
    assert fine < 1e-5
    assert np.log2(coarse / fine) > 2 * intervals.DEGREES - 1
    assert mathieu(monkeypatch, 32) < 1e-9


@pytest.mark.parametrize(
    "x", [0.01 - 0.1j, -1.5 + 3.0j, -3.0 + 5.0j, -40.0 + 90.0j, -300.0 + 0.0j]
)
def test_integrals_of_exponentials_with_polynomials_are_exact(x):
    moment, repeated = (a[0] for a in intervals._exponential_integrals(np.array([x])))
    node, weight = legendre.leggauss(200)
    s = (node + 1) / 2
    weight = weight / 2
    polynomial = legendre.legvander(node, intervals.DEGREES - 1)
    inner = np.einsum(
        "sr,srq->sq",
        s[:, None] * weight * np.exp(x * s[:, None] * (1 - s)),
        legendre.legvander(2 * s[:, None] * s - 1, intervals.DEGREES - 1),
    )
    np.testing.assert_allclose(
        moment, (weight * np.exp(x * s)) @ polynomial, rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(
        repeated, (polynomial.T * weight) @ inner, rtol=0, atol=1e-12
    )


def test_moments_of_slopes_are_those_of_a_fine_sum():
    """A law that is passed often, and one that varies: midpoints of equal parts of an
    interval.
    """
    for train in (pair(transition=0.05), varying_pair()):
        response = moving(train, 900.0, 2 * PLAY)
        system = chain.assemble(train)
        meshes = jax.tree.map(np.asarray, law_meshes(train))
        frequency = train.topology.cycle_frequency(900.0)
        parts = partition(system, meshes)
        space = jax.tree.map(np.asarray, state_space(system, meshes, frequency, parts))
        reactions = slopes.reactions_of(
            unheld_modes(system, meshes, space, frequency, parts), meshes
        )
        motion = slopes.SampledMotion(reactions, response.deflections, frequency)
        edges = np.linspace(0.0, 1.0, 201) ** 1.1
        moments = slopes.moments(reactions, motion, edges, 4)
        for i in range(0, 200, 7):
            at = (np.arange(20_000) + 0.5) / 20_000
            share = edges[i] + (edges[i + 1] - edges[i]) * at
            value = fourier.values_at(response.deflections, share)
            which = np.zeros(1, int)
            slope = reactions.slopes(which, value, share[None])[0]
            scale = np.abs(slope).max()
            expected = slope @ legendre.legvander(2 * at - 1, 3) / len(at)
            np.testing.assert_allclose(
                moments[0, i], expected, rtol=0, atol=1e-5 * scale
            )


def test_slow_cycles_are_taken_arc_by_arc(monkeypatch):
    """So many intervals that arcs between switching times are fewer: the dense
    equation, for few disks.
    """
    computed, expected = both(moving(pair(), 900.0, 2 * PLAY), monkeypatch)
    monkeypatch.setattr("jaxhb.floquet.stability.MOST_INTERVALS", 10)
    again = stability(moving(pair(), 900.0, 2 * PLAY))
    assert difference(again, expected) < 1e-14 < difference(computed, expected)
    monkeypatch.setattr("jaxhb.floquet.stability.DENSE_DISKS", 2)
    slow = moving(pair(), 900.0, 2 * PLAY)
    refused(
        lambda: stability(slow), "intervals a cycle, as teeth vibrate fast", ValueError
    )
