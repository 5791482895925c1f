"""Drive trains as chains in circumferential displacements, against dense solves in
angles written by hand.
"""

import dense
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference_data import method_case, numbers
from tolerances import ALGEBRAIC
from trains import build, gearbox_parts

import jaxhb
from jaxhb import Disk, Ground, Mesh, Shaft, Torque
from jaxhb._jax import on_host
from jaxhb.balance.problem import problem_at
from jaxhb.equations import dynamic_stiffness
from jaxhb.train import chain

OMEGA = np.array([0.0, 40.0, 333.0, 1500.0, 9000.0])
program = jax.jit(dynamic_stiffness.solve_linear)


def solve(system, omega, load):
    """Displacements and forces ``(S, H, R)`` of the program, equal to those of the host
    to rounding.
    """
    by_load = load.transpose(0, 2, 1)
    results = [
        np.asarray(result).transpose(0, 2, 1)
        for result in program(system, omega, by_load)
    ]
    host = dynamic_stiffness.solve_linear(on_host(system), omega, by_load)
    for result, host_result in zip(results, host, strict=True):
        assert isinstance(host_result, np.ndarray)
        assert largest_error(host_result.transpose(0, 2, 1), result, 1e-300) < ALGEBRAIC
    return results


def random_torques(draw, names):
    """Torques at every harmonic of OMEGA, none at the mean of the viscous ring, whose
    mean angle nothing holds.
    """
    size = (len(names), len(OMEGA))
    T = draw.normal(size=size) + 1j * draw.normal(size=size)
    T[:, 0] = T[:, 0].real
    if "viscous ring" in names:
        T[names.index("viscous ring"), 0] = 0.0
    return T


def in_angles(train, T):
    """Angles, and transmitted torques (shafts, dampers) and forces (meshes), from the
    sweep.
    """
    system = chain.assemble(train)
    x, force = solve(system, OMEGA, T[:, :, None] / system.radius[:, None, None])
    ends = np.asarray(system.radius)[system.tree.end_a]
    ends[len(ends) - len(train.topology.mesh_names) :] = 1.0
    angles = np.array(chain.to_angles(system, x))[..., 0]
    return angles, np.asarray(force)[..., 0] * ends[:, None]


def largest_error(values, exact, floor=0.0):
    """Largest error over the rows of a harmonic, relative to the largest entry of that
    harmonic.
    """
    size = np.maximum(np.abs(exact).max(0), floor)
    return (np.abs(values - exact).max(0) / size).max()


def test_forces_spread_by_the_transpose_of_deflections_on_the_host_and_the_device():
    system = chain.assemble(build(gearbox_parts(), reference="motor"))
    draw = np.random.default_rng(8)
    disks = len(system.mass)
    links = len(system.stiffness)
    displacements = draw.normal(size=(disks, 3))
    forces = draw.normal(size=(links, 3))
    some = np.array([links - 1, 2])
    rows = np.zeros((links, disks))
    for link, (a, b) in enumerate(
        zip(system.tree.end_a, system.tree.end_b, strict=True)
    ):
        rows[link, a] = system.arm_a[link]
        rows[link, b] = -system.arm_b[link]
    stiffness = np.diag(
        np.diag(system.ground) + rows.T @ np.diag(system.stiffness) @ rows
    )
    for place in (system, jax.tree.map(jnp.asarray, system)):
        np.testing.assert_array_equal(place.incidence(), rows.T)
        np.testing.assert_array_equal(place.incidence(some), rows[some].T)
        np.testing.assert_allclose(
            place.deflections(displacements),
            rows @ displacements,
            rtol=0,
            atol=ALGEBRAIC,
        )
        np.testing.assert_allclose(
            place.deflections(displacements, some),
            rows[some] @ displacements,
            rtol=0,
            atol=ALGEBRAIC,
        )
        np.testing.assert_allclose(
            place.spread(forces), rows.T @ forces, rtol=0, atol=ALGEBRAIC
        )
        np.testing.assert_allclose(
            place.spread(forces[some], some),
            rows[some].T @ forces[some],
            rtol=0,
            atol=ALGEBRAIC,
        )
        np.testing.assert_allclose(place.held_stiffness(), stiffness, rtol=ALGEBRAIC)
    assert isinstance(system.spread(forces), np.ndarray)


@pytest.mark.parametrize("grounded", [True, False], ids=["grounded", "free"])
def test_closed_loop_massless_disks_and_a_viscous_ring_equal_a_dense_solve_in_angles(
    grounded,
):
    """A free train has the solution without rigid rotation, under torques that do no
    work in it.
    """
    parts = gearbox_parts(grounded=grounded)
    train = build(parts, reference="motor")
    names = dense.disk_names(parts)
    system = chain.assemble(train)
    assert list(train.topology.disk_names) == names
    assert len(system.tree.loops) == 1
    assert system.floating == (not grounded)
    rigid = np.array([1.0] * 4 + [0.5] * 3 + [1 / 3] * 2 + [1.0, 1 / 3])
    np.testing.assert_allclose(
        chain.rigid_shape(train, system.radius) / system.radius, rigid, rtol=ALGEBRAIC
    )
    T = random_torques(np.random.default_rng(9), names)
    ring = names.index("viscous ring")
    hub = names.index("motor")
    T[hub, 0] -= rigid @ T[:, 0] * (not grounded)
    angles, transmitted = in_angles(train, T)
    exact = np.empty_like(angles)
    for k, omega in enumerate(OMEGA):
        Z = dense.dynamic_stiffness(parts, omega)
        load = T[:, k]
        if omega == 0:  # the ring rests on its hub by convention
            Z[ring, ring] = 1.0
            Z[ring, hub] = -1.0
        if omega == 0 and not grounded:
            Z = np.block([[Z, rigid[:, None]], [rigid[None, :], 0.0]])
            load = np.append(load, 0.0)
            angles[:, k] -= rigid * (rigid @ angles[:, k]) / (rigid @ rigid)
        exact[:, k] = np.linalg.solve(Z, load)[: len(names)]
    # The mean of an ungrounded gearbox has a condition of 1e5.
    assert largest_error(angles, exact) < ALGEBRAIC * (1 if grounded else 100)
    links = dense.links(parts)
    expected = [
        [dense.link_stiffness(p, w) * (row @ exact[:, k]) for k, w in enumerate(OMEGA)]
        for p, row in links
    ]
    # The oracle takes forces from differences of angles, which cost it three digits.
    assert largest_error(transmitted, np.array(expected)) < 1e3 * ALGEBRAIC


def test_case_a1_time_is_scaled_by_the_cycle():
    params, expected = method_case("A1_time_scaling")
    m, b, c = (float(params[key]) for key in "mbc")
    train = build(
        [Disk(name="mass", inertia=m, damping=b), Ground(disk="mass", stiffness=c)]
    )
    problem = problem_at(train, 60 / float(params["T_phys"]), 1)
    np.testing.assert_allclose(
        problem.frequency, float(expected["Omega"]), rtol=ALGEBRAIC
    )
    frequencies = dynamic_stiffness.frequencies(problem.frequency, 1)
    Z = dynamic_stiffness.node_stiffness(problem.system, frequencies)
    stiffness = float(expected["c_tilde"])
    expected_stiffness = [
        stiffness,
        stiffness - float(expected["m_tilde"]) + 1j * float(expected["b_tilde"]),
    ]
    np.testing.assert_allclose(np.asarray(Z)[0], expected_stiffness, rtol=ALGEBRAIC)
    hz = jaxhb.natural_frequencies(train).frequencies_hz[0]
    np.testing.assert_allclose(
        hz * float(params["T_phys"]), float(expected["omega_n_order"]), rtol=ALGEBRAIC
    )


def test_case_a1_two_gears_become_two_masses():
    params, expected = method_case("A1_gear_reduction_two_wheels")
    J1, J2 = numbers(params["J"])
    r1, r2 = numbers(params["r"])
    disks = [
        Disk(name="a", inertia=J1, radius=r1),
        Disk(name="b", inertia=J2, radius=r2),
    ]
    train = build(
        [*disks, Mesh(between=("a", "b"), stiffness=float(params["k"]))], reference="a"
    )
    np.testing.assert_allclose(
        chain.assemble(train).mass, numbers(expected["m"]), rtol=ALGEBRAIC
    )
    modes = jaxhb.natural_frequencies(train)
    assert modes.frequencies_hz[0] == 0.0
    np.testing.assert_allclose(
        (2 * np.pi * modes.frequencies_hz[1]) ** 2,
        float(expected["omega2"]),
        rtol=ALGEBRAIC,
    )


def test_case_a1_shafts_and_torques_are_taken_to_the_pitch_circle():
    params, expected = method_case("A1_shaft_reduction")
    k, beta, M, r = (float(params[key]) for key in ("k_t", "beta", "M", "r"))
    disks = [
        Disk(name="gear", inertia=1.0, radius=r, damping=beta),
        Disk(name="disk", inertia=2.0),
    ]
    mate = Disk(name="mate", inertia=1.0, radius=0.7)
    links = [
        Shaft(between=("gear", "disk"), stiffness=k, damping=beta),
        Mesh(between=("gear", "mate"), stiffness=1.0),
    ]
    ends = [Torque(disk="disk", mean=M), Ground(disk="mate", stiffness=1.0)]
    train = build([*disks, mate, *links, *ends], reference="gear")
    problem = problem_at(train, 100.0, 1)
    system = problem.system
    np.testing.assert_allclose(
        system.stiffness[0], float(expected["c"]), rtol=ALGEBRAIC
    )
    np.testing.assert_allclose(
        [system.viscous[0], system.damping[0]], float(expected["b"]), rtol=ALGEBRAIC
    )
    np.testing.assert_allclose(problem.load[1, 0], float(expected["q"]), rtol=ALGEBRAIC)
    np.testing.assert_allclose(
        chain.to_angles(system, np.array([r, r, 0.7])), 1.0, rtol=ALGEBRAIC
    )
