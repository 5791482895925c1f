"""The public residual A(x) against the equations of motion written out here in time,
its Jacobian against autodiff, the block sweep against a dense solve, and what solves
give against zero.
"""

import dataclasses
from functools import cache

import dense
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference_data import refused
from scipy.linalg import null_space
from tolerances import ALGEBRAIC, PATHS
from trains import branched_parts, gearbox_parts

import jaxhb
from jaxhb import Damper, Disk, Ground, Load, Mesh, Shaft, Status, Torque

LAW = {
    "stiffness": 2e8,
    "damping": 2e3,
    "backlash": 2e-4,
    "epsilon": 1e-2,
    "transition": 0.2,
}
SPRINGS = {
    "clearance": 1.0,
    "stages": [(3.0, 1000.0)],
    "stops": [(-5.0, 3000.0), (6.0, 5000.0)],
    "friction": 3.0,
    "slip_speed": 2.0,
}
SMOOTH = 0.04  # half the width of a stage over its twist


def loop_parts():
    """Two meshes between two shafts, one of them with backlash; nothing holds the
    train, nor its viscous ring.
    """
    return [
        (
            dataclasses.replace(p, **LAW)
            if isinstance(p, Mesh) and p.between[0] == "lay 2"
            else p
        )
        for p in gearbox_parts(grounded=False)
    ]


def meshing_parts():
    """An idler between two gears: varying stiffness and errors, one mesh with backlash
    and one without.
    """
    return [
        Disk(name="a", inertia=0.02, radius=0.05, teeth=5),
        Disk(name="b", inertia=0.05, radius=0.1, teeth=10),
        Disk(name="c", inertia=0.01, radius=0.05, teeth=5),
        Mesh(
            between=("a", "b"),
            phase=40.0,
            first_gear_error=[(1, 6e-6, 0.0)],
            stiffness_orders=[(1, 0.2, 0.1), (2, 0.0, -0.05)],
            transmission_error=[(1, 4e-6, 2e-6)],
            **LAW,
        ),
        Mesh(
            between=("c", "b"),
            stiffness=1e8,
            damping=500.0,
            transmission_error=[(2, 0.0, 3e-6)],
        ),
        Torque(disk="a", mean=60.0, harmonics=[(1.0, 15.0, 4.0)]),
        Torque(disk="c", mean=-60.0),
        Ground(disk="a", stiffness=100.0),
    ]


def clutch_parts(springs=SPRINGS, ring_stiffness=0.0):
    """An engine and a gear on a clutch disc with all that springs have, and a ring that
    friction and damping drive.
    """
    return [
        Disk(name="engine", inertia=0.2, damping=0.3),
        Disk(name="gear", inertia=0.05, damping=0.5),
        Shaft(
            between=("engine", "gear"),
            stiffness=200.0,
            damping=0.4,
            loss_factor=0.02,
            name="disc",
            **springs,
        ),
        Damper(
            name="ring",
            disk="engine",
            inertia=0.03,
            stiffness=ring_stiffness,
            friction=2.0,
            damping=0.1,
        ),
        Torque(
            disk="engine", mean=20.0, harmonics=[(2.0, 120.0, 30.0), (4.0, 20.0, 0.0)]
        ),
        Load(disk="gear"),
    ]


def ringed_parts():
    """A pair of gears that nothing holds, with a viscous ring."""
    return [
        Disk(name="a", inertia=0.1, radius=0.05, damping=0.2),
        Disk(name="b", inertia=0.02, radius=0.1, damping=0.1),
        Mesh(between=("a", "b"), **LAW),
        Damper(name="ring", disk="a", inertia=0.05, damping=2.0),
        Torque(disk="a", mean=10.0, harmonics=((1.0, 60.0, 0.0), (2.0, 20.0, -30.0))),
        Torque(disk="b", mean=-20.0),
    ]


CASES = {
    "damping in contact": (branched_parts(("contact", "contact")), 1500.0, 8, 2e-3),
    "one damping always": (branched_parts(("always", "contact")), 1500.0, 8, 2e-3),
    "loop": (loop_parts(), 900.0, 4, 2e-3),
    "meshing": (meshing_parts(), 900.0, 10, 2e-3),
    "springs": (clutch_parts(), 700.0, 6, 0.1),
    "viscous ring": (ringed_parts(), 900.0, 6, 2e-3),
}
TREES = [name for name in CASES if name != "loop"]


@cache
def posed(case):
    """A, random angles ``(S, N+1)`` whose meshes cross their gaps, and their x."""
    parts, rpm, harmonics, size = CASES[case]
    train = jaxhb.build(parts, revolutions_per_cycle=1, reference=parts[0].name)
    A = jaxhb.harmonic_residual(train, rpm=rpm, harmonics=harmonics)
    draw = np.random.default_rng(12)
    shape = train.topology.n_disks, harmonics + 1
    angles = (
        size
        * (draw.normal(size=shape) + 1j * draw.normal(size=shape))
        / (1 + np.arange(harmonics + 1))
    )
    angles[:, 0] = angles[:, 0].real
    return A, angles, np.asarray(A.pack(A.radius[:, None] * angles))


def knee(l, at):
    """A spring of stiffness 1 that begins at a deflection, its slope rising over 8 % of
    it.
    """
    inside = np.clip(l - (1 - SMOOTH) * at, 0, 2 * SMOOTH * at)
    beyond = np.maximum(l - (1 + SMOOTH) * at, 0)
    return inside**2 / (4 * SMOOTH * at) + beyond


def spring_torque(part, twist, rate, lossy):
    """Torque of a shaft or damper; ``lossy`` is the twist a quarter of a period ahead,
    harmonic by harmonic.
    """
    play = np.deg2rad(part.clearance or 0.0) / 2
    free = (
        1e-3 * twist + 0.999 * np.sign(twist) * knee(np.abs(twist), play)
        if play
        else twist
    )
    torque = part.stiffness * (free + part.loss_factor * lossy) + part.damping * rate
    before = part.stiffness
    for at, stiffness in part.stages:
        torque = torque + (stiffness - before) * np.sign(twist) * knee(
            np.abs(twist), np.deg2rad(at)
        )
        before = stiffness
    for at, stiffness in part.stops:
        torque = torque + np.sign(at) * stiffness * knee(
            np.sign(at) * twist, np.deg2rad(abs(at))
        )
    return torque + (part.friction or 0.0) * np.clip(
        rate / (part.slip_speed or 0.1), -1, 1
    )


def tooth_force(mesh, teeth, approach, approach_rate, t, frequency):
    """Force of a mesh whose first gear, of so many teeth, is on the reference rotor or
    turns as fast; t = Omega time.
    """
    phase = np.deg2rad(mesh.phase)
    errors = [
        (teeth * k, complex(re, im) * np.exp(1j * k * phase))
        for k, re, im in mesh.transmission_error
    ]
    errors += [(k, complex(re, im)) for k, re, im in mesh.first_gear_error]
    l = approach - sum((c * np.exp(1j * n * t)).real for n, c in errors)
    per_radian = sum((1j * n * c * np.exp(1j * n * t)).real for n, c in errors)
    varies = sum(
        (complex(re, im) * np.exp(1j * k * (teeth * t + np.deg2rad(mesh.phase)))).real
        for k, re, im in mesh.stiffness_orders
    )
    elastic, share = dense.law(mesh, l) if mesh.backlash else (mesh.stiffness * l, 1.0)
    share = share if mesh.damping_law == "contact" else 1.0
    return (1 + varies) * elastic + mesh.damping * share * (
        approach_rate - frequency * per_radian
    )


def torque_balance(parts, angles, frequency, samples):
    """Torques ``(S, N+1)`` in N m that the equations of motion leave: evaluated in
    time, Fourier integrals by plain sums.
    """
    names = dense.disk_names(parts)
    rows = dense.links(parts)
    disks = {name: k for k, name in enumerate(names)}
    n = np.arange(angles.shape[1])
    t = 2 * np.pi * np.arange(samples) / samples
    wave = np.exp(1j * np.outer(n, t)) * np.where(n == 0, 1, 2)[:, None]
    angle, rate, acceleration = (
        ((1j * n * frequency) ** k * angles @ wave).real for k in range(3)
    )
    left = np.zeros((len(names), samples))
    (ratio,) = null_space(np.array([row for _, row in rows])).T
    inertia = np.array(
        [p.inertia for kind in (Disk, Damper) for p in dense.of_kind(parts, kind)]
    )
    held = np.zeros(len(names))
    if not dense.of_kind(parts, Ground):
        held += (
            frequency**2
            * inertia
            * ratio
            * (inertia * ratio @ angles[:, 0].real)
            / (inertia @ ratio**2)
        )
    for p in parts:
        if isinstance(p, Disk | Damper):
            k = disks[p.name]
            left[k] += p.inertia * acceleration[k] + (
                p.damping * rate[k] if isinstance(p, Disk) else 0.0
            )
        if isinstance(p, Ground):
            left[disks[p.disk]] += p.stiffness * angle[disks[p.disk]]
        if isinstance(p, Torque):
            alternating = sum(
                (complex(re, im) * np.exp(1j * k * t)).real for k, re, im in p.harmonics
            )
            left[disks[p.disk]] -= p.mean + alternating
        if isinstance(p, Load):
            means = sum(
                q.mean * ratio[disks[q.disk]] for q in dense.of_kind(parts, Torque)
            )
            left[disks[p.disk]] += means / ratio[disks[p.disk]]
    for p, row in rows:
        l = row @ angle
        l_rate = row @ rate
        ahead = (1j * (n > 0) * (row @ angles) @ wave).real
        if isinstance(p, Mesh):
            teeth = next(
                q.teeth for q in dense.of_kind(parts, Disk) if q.name == p.between[0]
            )
            force = tooth_force(p, teeth, l, l_rate, t, frequency)
        else:
            force = spring_torque(p, l, l_rate, ahead)
        if isinstance(p, Damper) and not p.stiffness:
            held += row * frequency**2 * p.inertia * (row @ angles[:, 0].real)
        left += np.outer(row, force)
    left = left @ np.exp(-1j * np.outer(t, n)) / samples
    left[:, 0] += held
    return left


def close(actual, expected, tolerance):
    np.testing.assert_allclose(
        actual, expected, rtol=0, atol=tolerance * np.abs(expected).max()
    )


@pytest.mark.parametrize("case", CASES)
def test_the_residual_is_what_the_equations_of_motion_leave(case):
    A, angles, x = posed(case)
    parts, rpm = CASES[case][:2]
    expected = torque_balance(parts, angles, 2 * np.pi * rpm / 60, A.samples)
    assert A.size == x.size
    assert A.disk_names == tuple(dense.disk_names(parts))
    close(A.radius[:, None] * A.unpack(A(x)), expected, ALGEBRAIC)
    np.testing.assert_allclose(
        A.unpack(x) / A.radius[:, None], angles, rtol=ALGEBRAIC, atol=0
    )


@pytest.mark.parametrize("case", CASES)
def test_random_motions_pass_through_all_parts_of_the_laws(case):
    A, _, x = posed(case)
    meshes = A.balance.meshes
    deflection = A.balance.system.deflections(A.unpack(x), meshes.link)
    l = np.abs(np.fft.irfft(deflection, A.samples, norm="forward"))
    for k in np.flatnonzero(np.asarray(meshes.law.epsilon) < 1):
        gap = np.asarray(meshes.law.gap)[k]
        width = np.asarray(meshes.law.width)[k]
        assert (l[k] < gap).any()
        assert (l[k] > gap + width).any()


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_analytic_jacobian_is_that_of_autodiff(case):
    A, _, x = posed(case)
    analytic = np.asarray(A.jacobian(x))
    close(jax.jacfwd(A)(x), analytic, ALGEBRAIC)
    if case == "loop":
        close(jax.jacrev(A)(x), analytic, ALGEBRAIC)


@pytest.mark.slow
@pytest.mark.parametrize("case", TREES)
def test_the_block_sweep_is_the_dense_solve_and_so_is_its_derivative(case):
    A, _, x = posed(case)
    right = np.random.default_rng(3).normal(size=A.size)
    matrix = np.asarray(A.jacobian(x))
    expected = np.linalg.solve(matrix, right)
    change = jaxhb.block_sweep(A, x, right)
    close(change, expected, PATHS)
    if case != "viscous ring":  # floating, its mean torques not in balance
        return
    back = jax.grad(lambda right: jaxhb.block_sweep(A, x, right) @ expected)(right)
    close(back, np.linalg.solve(matrix.T, expected), PATHS)
    # d(J^-1 r) = -J^-1 dJ J^-1 r
    direction = 1e-3 * np.abs(x).max() * np.random.default_rng(4).normal(size=A.size)
    _, moved = jax.jvp(lambda x: jaxhb.block_sweep(A, x, right), (x,), (direction,))
    _, bent = jax.jvp(A.jacobian, (x,), (direction,))
    close(moved, -np.linalg.solve(matrix, np.asarray(bent) @ expected), PATHS)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", ["one damping always", "meshing", "springs", "viscous ring"]
)
def test_solutions_make_it_zero(case):
    parts, rpm, *_ = CASES[case]
    # Without a stiffness the mean of its friction would turn the ring on, and no motion
    # repeats.
    parts = clutch_parts(ring_stiffness=50.0) if case == "springs" else parts
    train = jaxhb.build(parts, revolutions_per_cycle=1, reference=parts[0].name)
    response = jaxhb.solve(train, rpm=rpm, harmonics=32, tolerance=0.5)
    A = jaxhb.harmonic_residual(train, rpm=rpm, harmonics=32)
    assert response.solved
    load = np.abs(A(np.zeros(A.size))).max()
    residual = A(A.pack(A.radius[:, None] * response.angles))
    assert np.abs(residual).max() < PATHS * load


@pytest.mark.slow
def test_a_ring_that_dry_friction_turns_on_is_no_periodic_motion():
    """A(x) has the mean torque that nothing takes, 5 % of the dry friction, and the
    status tells it.
    """
    train = jaxhb.build(clutch_parts(), revolutions_per_cycle=1, reference="engine")
    response = jaxhb.solve(train, rpm=700.0, harmonics=32, tolerance=0.5)
    A = jaxhb.harmonic_residual(train, rpm=700.0, harmonics=32)
    residual = A.unpack(A(A.pack(A.radius[:, None] * response.angles)))
    assert abs(residual[train.topology.disk_names.index("ring"), 0]) > 0.05 * 2.0
    assert response.status == Status.UNBALANCED
    assert not response.solved
    refused(
        lambda: jaxhb.check(response),
        "creeps: give it a small stiffness",
        jaxhb.NotConverged,
    )


@pytest.mark.slow
def test_newton_by_the_block_sweep_from_the_motion_in_contact_finds_teeth_that_part():
    train = jaxhb.load_scene("spur_pair")
    A = jaxhb.harmonic_residual(train, rpm=7000.0, harmonics=32)
    x = A.pack(A.radius[:, None] * jaxhb.linear_response(train, rpm=7000.0).angles)
    for _ in range(8):
        x = x - jaxhb.block_sweep(A, x, A(x))
    response = jaxhb.solve(train, rpm=7000.0, harmonics=32)
    assert response.mesh("gear a", "gear b").separated_fraction > 0
    close(A.unpack(x) / A.radius[:, None], response.angles, PATHS)


@pytest.mark.slow
def test_the_method_of_the_chain_solves_a_grounded_train_with_a_viscous_ring():
    """The mean angle of the ring, which no force decides, is no unknown that a sweep
    divides by nothing for.
    """
    train = jaxhb.build(
        [*ringed_parts(), Ground(disk="b", stiffness=100.0)],
        revolutions_per_cycle=1,
        reference="a",
    )
    reduced, chain = (
        jaxhb.solve(train, rpm=900.0, harmonics=16, method=method, tolerance=0.5)
        for method in ("reduced", "chain")
    )
    assert reduced.solved
    assert chain.solved
    close(chain.angles[:, 1:], reduced.angles[:, 1:], PATHS)


@pytest.mark.slow
def test_numbers_and_speeds_are_traced_batched_and_differentiated():
    parts, rpm, harmonics, _ = CASES["viscous ring"]
    train = jaxhb.build(parts, revolutions_per_cycle=1, reference="a")
    A, _, x = posed("viscous ring")

    def residual(damping, rpm):
        changed = train.replace({"ring.damping": damping})
        return jaxhb.harmonic_residual(changed, rpm=rpm, harmonics=harmonics)

    def size(damping, rpm):
        return jnp.sum(residual(damping, rpm)(x) ** 2)

    speeds = np.array([rpm, 1.3 * rpm])
    batch = jax.jit(jax.vmap(residual, (None, 0)))(2.0, speeds)
    values = jax.vmap(lambda A: A(x))(batch)
    close(values[0], A(x), ALGEBRAIC)
    close(values[1], residual(2.0, speeds[1])(x), ALGEBRAIC)
    close(jax.vmap(A)(np.stack([x, 2 * x]))[1], jax.jit(A)(2 * x), ALGEBRAIC)
    # The square of an affine function of the damping: central differences are exact but
    # for their rounding.
    expected = (size(3.0, rpm) - size(1.0, rpm)) / 2
    assert float(jax.jit(jax.grad(size))(2.0, rpm)) == pytest.approx(
        float(expected), rel=PATHS
    )
    refused(lambda: batch(x), "call them under jax.vmap", ValueError)


def test_names_that_change_places_in_between_change_nothing():
    for case, springs in (
        ("one damping always", None),
        ("springs", {"stages": [(3.0, 1000.0)]}),
    ):
        parts = clutch_parts(springs) if springs else CASES[case][0]
        turned = [
            (
                dataclasses.replace(p, between=p.between[::-1])
                if isinstance(p, Mesh | Shaft)
                else p
            )
            for p in parts
        ]
        _, rpm, harmonics, _ = CASES[case]
        x = posed(case)[2]
        trains = [
            jaxhb.build(p, revolutions_per_cycle=1, reference=parts[0].name)
            for p in (parts, turned)
        ]
        before, after = (
            jaxhb.harmonic_residual(train, rpm=rpm, harmonics=harmonics)
            for train in trains
        )
        close(after(x), before(x), ALGEBRAIC)


def test_fewer_harmonics_are_padded_and_other_shapes_refused():
    A, angles, x = posed("springs")
    few = A.pack(angles[:, :3])
    np.testing.assert_array_equal(A.unpack(few)[:, 3:], 0.0)
    close(A.unpack(few)[:, :3], angles[:, :3], ALGEBRAIC)
    refused(
        lambda: A.pack(angles[1:]), r"must be \(3, n\+1\) with n at most 6", ValueError
    )
    refused(
        lambda: A(x[1:]), r"shape \(38,\), must be real of shape \(39,\)", ValueError
    )
    refused(lambda: A.jacobian(x + 1j), "x is complex", ValueError)
    assert "6 harmonics, 39 unknowns" in repr(A)
    assert "springs" not in repr(A)


def test_what_cannot_work_is_refused_with_a_sentence():
    train = jaxhb.load_scene("spur_pair")

    def residual(rpm=1500.0, harmonics=8, samples=None):
        return jaxhb.harmonic_residual(
            train, rpm=rpm, harmonics=harmonics, samples=samples
        )

    refused(lambda: residual(rpm=0.0), "must be greater than 0 rpm")
    refused(lambda: residual(harmonics=8.0), "harmonics is 8.0, must be a whole number")
    refused(
        lambda: residual(samples=32),
        "samples is 32, must be a whole number greater than 32, 4 per harmonic",
    )
    refused(
        lambda: jax.jit(lambda n: residual(harmonics=n))(8),
        "sizes of arrays",
        TypeError,
    )
    A, _, x = posed("loop")
    refused(
        lambda: jaxhb.block_sweep(A, x, x),
        r"closes a loop, and the block sweep needs a tree",
    )
    large = jaxhb.harmonic_residual(
        jaxhb.load_scene("gear_train_30"), rpm=1800.0, harmonics=1500
    )
    x = np.zeros(large.size)
    refused(
        lambda: large.jacobian(x),
        r"the Jacobian at 1500 harmonics would take 48\.9 GiB, more than 8",
        MemoryError,
    )
    refused(
        lambda: jaxhb.block_sweep(large, x, x),
        "blocks of the sweep .* would take 10.9 GiB",
        MemoryError,
    )
