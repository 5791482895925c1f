"""The variational equation in damped modes, interval by interval, against the dense
equation solved arc by arc.

Multipliers are those of the equation around any motion: these are given, and no train
is solved.
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

LIGHT_PAIR = jaxhb.load_scene(DATA / "scenes" / "light_pair.toml")
PLAY = 1e-4  # m, half the backlash of the light pair


def pair(teeth=(None, None), **mesh):
    """The light pair with other numbers of its mesh."""
    disks = [
        jaxhb.Disk(name="motor", inertia=0.02, damping=0.5),
        jaxhb.Disk(name="pinion", inertia=0.01, radius=0.05, teeth=teeth[0]),
        jaxhb.Disk(name="wheel", inertia=0.05, radius=0.1, teeth=teeth[1], damping=0.4),
    ]
    numbers = {
        "stiffness": 2e6,
        "damping": 500.0,
        "backlash": 2 * PLAY,
        "epsilon": 0.01,
        "transition": 0.3,
    } | mesh
    links = [jaxhb.Shaft(between=("motor", "pinion"), stiffness=2000.0, damping=2.0)]
    links += [
        jaxhb.Mesh(between=("pinion", "wheel"), **numbers),
        jaxhb.Ground(disk="motor", stiffness=0.5),
    ]
    return build(
        [
            *disks,
            *links,
            jaxhb.Torque(disk="motor", mean=10.0),
            jaxhb.Torque(disk="wheel", mean=-20.0),
        ],
        reference="motor",
    )


def clutch(**disc):
    parts = [
        jaxhb.Disk(name="engine", inertia=0.2, damping=0.3),
        jaxhb.Disk(name="gear", inertia=0.05, damping=0.5),
    ]
    parts += [
        jaxhb.Shaft(
            between=("engine", "gear"),
            stiffness=200.0,
            damping=0.4,
            name="disc",
            **disc,
        )
    ]
    return build(
        [
            *parts,
            jaxhb.Torque(disk="engine", mean=20.0),
            jaxhb.Torque(disk="gear", mean=-20.0),
        ],
        reference="engine",
    )


def rough(count, size, harmonics=16, seed=0):
    """Deflections ``(count, N+1)`` m of some harmonics that swing by ``size``."""
    rng = np.random.default_rng(seed)
    wave = rng.normal(size=(count, harmonics)) + 1j * rng.normal(
        size=(count, harmonics)
    )
    wave = wave / (1 + np.arange(harmonics)) ** 1.5
    return np.concatenate([np.full((count, 1), 0.4 * size), 0.4 * size * wave], axis=1)


def moving(train, rpm, size, seed=0):
    """The train as if it were solved at a speed with given deflections."""
    deflections = rough(
        len(train.topology.mesh_names) + len(train.topology.springs), size, seed=seed
    )
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
    found = stability(response)
    expected = np.linalg.eigvals(dense_monodromy(response).matrix)
    return found, expected[np.argsort(-np.abs(expected))]


def difference(found, expected, count=6):
    """Largest distance of the largest of ``expected`` from what was found, over the
    largest of all.
    """
    nearest = [np.abs(found.multipliers - value).min() for value in expected[:count]]
    return max(nearest) / np.abs(expected[0])


STOPS = {
    "clearance": 1.0,
    "stages": [(3.0, 1000.0)],
    "stops": [(-5.0, 3000.0), (6.0, 5000.0)],
}
VARYING = {
    "teeth": (20, 40),
    "stiffness_orders": ((1.0, 0.2, 0.05), (2.0, 0.05, 0.02)),
    "transition": 0.1,
}
TRAINS = {
    "damping in contact": (pair(), 2 * PLAY, 1e-7),
    "damping always": (pair(damping_law="always"), 2 * PLAY, 1e-7),
    "strong damping and a sharp law": (
        pair(damping=5000.0, transition=0.01),
        2 * PLAY,
        1e-6,
    ),
    "a stiffness that varies": (pair(**VARYING), 2 * PLAY, 1e-7),
    "a stiffness that varies, damped always": (
        pair(**VARYING, damping_law="always"),
        2 * PLAY,
        1e-7,
    ),
    "play, stages and stops": (clutch(**STOPS), 0.1, 1e-6),
    "friction": (clutch(friction=3.0), 0.1, 1e-4),
    "friction that sticks at once": (clutch(friction=3.0, slip_speed=0.002), 0.1, 2e-3),
}


@pytest.mark.parametrize("name", TRAINS)
def test_multipliers_are_those_of_the_dense_equation(name, monkeypatch):
    train, size, bound = TRAINS[name]
    for rpm in (900.0, 3000.0):
        found, expected = both(moving(train, rpm, size), monkeypatch)
        assert len(found.multipliers) == len(expected)
        assert difference(found, expected) < bound


@pytest.mark.parametrize("grounded", [True, False])
def test_loops_rings_massless_disks_and_free_rotation_are_served(grounded, monkeypatch):
    """Teeth of a closed loop that part; loss factors damp modes alike in both
    equations.
    """
    parts = gearbox_parts(grounded=grounded)
    parts = [
        (
            dataclasses.replace(p, backlash=1e-4)
            if getattr(p, "stiffness", 0) in (1e8, 2e8)
            else p
        )
        for p in parts
    ]
    train = build(parts, reference="motor")
    found, expected = both(moving(train, 900.0, 1e-4), monkeypatch)
    assert train.topology.law_index.tolist() == [0, 1]
    assert len(found.multipliers) == len(expected)
    assert difference(found, expected, 8) < 1e-6
    if not grounded:
        np.testing.assert_allclose(
            np.sort(np.abs(found.multipliers - 1))[:2], 0.0, atol=1e-9
        )


def test_modes_of_a_finely_divided_train_all_take_part(monkeypatch):
    train = refined(LIGHT_PAIR, 30)
    found, expected = both(moving(train, 900.0, 2 * PLAY), monkeypatch)
    assert len(found.multipliers) == len(expected) == 60
    assert found.rotation.sum() == 2
    assert difference(found, expected, 8) < 1e-6


def mathieu(monkeypatch, count):
    """Error of the monodromy matrix of a damped Mathieu equation from ``count``
    intervals: ``x'' + b x' + (c0 + a cos 2t) x = 0`` is that of a law in its smooth
    zone.
    """
    monkeypatch.setattr(intervals, "PER_PERIOD", 2.0**-30)
    monkeypatch.setattr(intervals, "FEWEST", count)
    params, wanted = method_case("A7_damped_mathieu_monodromy")
    b, c0, a = (float(params[k]) for k in ("b", "c0", "a"))
    contact = 3.0
    gap = 0.3
    mass = one_mass(
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
    parts = partition(*mass)
    space = jax.tree.map(np.asarray, state_space(*mass, 1.0, parts))
    modes = unheld_modes(*mass, space, 1.0, parts)
    found = intervals.monodromy(
        modes, slopes.reactions_of(modes, mass[1]), deflection, 1.0
    )
    to_motion = intervals.real_states(modes, modes.motion)
    return np.abs(
        to_motion @ found.matrix @ np.linalg.inv(to_motion)
        - np.array(wanted["Phi"], dtype=float)
    ).max()


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
    for train in (pair(transition=0.05), pair(**VARYING)):
        response = moving(train, 900.0, 2 * PLAY)
        system = chain.assemble(train)
        meshes = jax.tree.map(np.asarray, slopes.backlash.law_meshes(train))
        frequency = train.topology.cycle_frequency(900.0)
        parts = partition(system, meshes)
        space = jax.tree.map(np.asarray, state_space(system, meshes, frequency, parts))
        reactions = slopes.reactions_of(
            unheld_modes(system, meshes, space, frequency, parts), meshes
        )
        motion = slopes.SampledMotion(reactions, response.deflections, frequency)
        edges = np.linspace(0.0, 1.0, 201) ** 1.1
        found = slopes.moments(reactions, motion, edges, 4)
        for i in range(0, 200, 7):
            at = (np.arange(20_000) + 0.5) / 20_000
            share = edges[i] + (edges[i + 1] - edges[i]) * at
            value = fourier.values_at(response.deflections, share)
            which = np.zeros(1, int)
            slope = reactions.slopes(which, value, share[None])[0]
            scale = np.abs(slope).max()
            expected = slope @ legendre.legvander(2 * at - 1, 3) / len(at)
            np.testing.assert_allclose(found[0, i], expected, rtol=0, atol=1e-5 * scale)


def test_slow_cycles_are_taken_arc_by_arc(monkeypatch):
    """So many intervals that arcs between switching times are fewer: the dense
    equation, for few disks.
    """
    found, expected = both(moving(pair(), 900.0, 2 * PLAY), monkeypatch)
    monkeypatch.setattr("jaxhb.floquet.stability.MOST_INTERVALS", 10)
    again = stability(moving(pair(), 900.0, 2 * PLAY))
    assert difference(again, expected) < 1e-14 < difference(found, expected)
    monkeypatch.setattr("jaxhb.floquet.stability.DENSE_DISKS", 2)
    slow = moving(pair(), 900.0, 2 * PLAY)
    refused(
        lambda: stability(slow), "intervals a cycle, as teeth vibrate fast", ValueError
    )
