"""From drive trains to chains in circumferential displacements, against dense solves in
angles made by hand.
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
    """Displacements and forces ``(S, H, R)``: those of the program, which are those of
    the host to rounding.
    """
    found = [
        np.asarray(a).transpose(0, 2, 1)
        for a in program(system, omega, load.transpose(0, 2, 1))
    ]
    host = dynamic_stiffness.solve_linear(
        on_host(system), omega, load.transpose(0, 2, 1)
    )
    for of_program, of_host in zip(found, host, strict=True):
        assert isinstance(of_host, np.ndarray)
        assert largest_error(of_host.transpose(0, 2, 1), of_program, 1e-300) < ALGEBRAIC
    return found


def random_torques(draw, names):
    """Torques at every harmonic of OMEGA, none at the mean of the viscous ring, whose
    mean angle nothing holds.
    """
    T = draw.normal(size=(len(names), len(OMEGA))) + 1j * draw.normal(
        size=(len(names), len(OMEGA))
    )
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
    return (
        np.array(chain.to_angles(system, x))[..., 0],
        np.asarray(force)[..., 0] * ends[:, None],
    )


def largest_error(found, exact, floor=0.0):
    """Largest error over the rows of a harmonic, relative to the largest entry of that
    harmonic.
    """
    return (
        np.abs(found - exact).max(0) / np.maximum(np.abs(exact).max(0), floor)
    ).max()


def test_forces_spread_by_the_transpose_of_deflections_on_the_host_and_the_device():
    system = chain.assemble(build(gearbox_parts(), reference="motor"))
    draw = np.random.default_rng(8)
    disks = len(system.mass)
    links = len(system.stiffness)
    x = draw.normal(size=(disks, 3))
    f = draw.normal(size=(links, 3))
    some = np.array([links - 1, 2])
    rows = np.zeros((links, disks))
    for link, (a, b) in enumerate(
        zip(system.tree.end_a, system.tree.end_b, strict=True)
    ):
        rows[link, a], rows[link, b] = system.arm_a[link], -system.arm_b[link]
    held = np.diag(np.diag(system.ground) + rows.T @ np.diag(system.stiffness) @ rows)
    for place in (system, jax.tree.map(jnp.asarray, system)):
        np.testing.assert_array_equal(place.incidence(), rows.T)
        np.testing.assert_array_equal(place.incidence(some), rows[some].T)
        np.testing.assert_allclose(
            place.deflections(x), rows @ x, rtol=0, atol=ALGEBRAIC
        )
        np.testing.assert_allclose(
            place.deflections(x, some), rows[some] @ x, rtol=0, atol=ALGEBRAIC
        )
        np.testing.assert_allclose(place.spread(f), rows.T @ f, rtol=0, atol=ALGEBRAIC)
        np.testing.assert_allclose(
            place.spread(f[some], some), rows[some].T @ f[some], rtol=0, atol=ALGEBRAIC
        )
        np.testing.assert_allclose(place.held_stiffness(), held, rtol=ALGEBRAIC)
    assert isinstance(system.spread(f), np.ndarray)


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
    assert list(train.topology.disk_names) == names and len(system.tree.loops) == 1
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
            Z[ring, ring], Z[ring, hub] = 1.0, -1.0
        if omega == 0 and not grounded:
            Z = np.block([[Z, rigid[:, None]], [rigid[None, :], 0.0]])
            load = np.append(load, 0.0)
            angles[:, k] -= rigid * (rigid @ angles[:, k]) / (rigid @ rigid)
        exact[:, k] = np.linalg.solve(Z, load)[: len(names)]
    # the mean of an ungrounded gearbox: condition 1e5
    assert largest_error(angles, exact) < ALGEBRAIC * (1 if grounded else 100)
    links = dense.links(parts)
    wanted = [
        [dense.link_stiffness(p, w) * (row @ exact[:, k]) for k, w in enumerate(OMEGA)]
        for p, row in links
    ]
    # the oracle takes forces from differences of angles, which cost it three digits
    assert largest_error(transmitted, np.array(wanted)) < 1e3 * ALGEBRAIC


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
    Z = np.asarray(
        dynamic_stiffness.node_stiffness(
            problem.system, dynamic_stiffness.frequencies(problem.frequency, 1)
        )
    )[0]
    stiffness = float(expected["c_tilde"])
    wanted = [
        stiffness,
        stiffness - float(expected["m_tilde"]) + 1j * float(expected["b_tilde"]),
    ]
    np.testing.assert_allclose(Z, wanted, rtol=ALGEBRAIC)
    natural = jaxhb.natural_frequencies(train).frequencies_hz[0] * float(
        params["T_phys"]
    )
    np.testing.assert_allclose(
        natural, float(expected["omega_n_order"]), rtol=ALGEBRAIC
    )


def test_case_a1_two_gears_become_two_masses():
    params, expected = method_case("A1_gear_reduction_two_wheels")
    (J1, J2) = numbers(params["J"])
    (r1, r2) = numbers(params["r"])
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
