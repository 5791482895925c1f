"""Holzer's tables against published ones and against dense solutions of the same
motion.
"""

import itertools

import dense
import numpy as np
import pytest
from reference_data import torsional_model
from tolerances import ALGEBRAIC
from trains import branched_parts, build, chain_parts, gearbox_parts

import jaxhb
from jaxhb import Disk, Mesh, Shaft
from jaxhb.linear.holzer import holzer_residual, holzer_table


def test_published_tables_of_three_disks():
    entry = torsional_model("thomson_12_4_1")
    train = build(chain_parts(entry["model"]["J"], entry["model"]["k"]))
    for printed in entry["published_holzer"]:
        table = holzer_table(train, hz=printed["omega"] / (2 * np.pi))
        # Ordinates are printed with three digits.
        np.testing.assert_allclose(
            table.ordinate, printed["theta"], rtol=0, atol=5.1e-4
        )
        np.testing.assert_allclose(table.torque_sum, printed["torque"], rtol=5e-4)
        assert table.names == ("1", "2", "3")
        assert table.links == ("1|2", "2|3", "")
        np.testing.assert_allclose(
            table.torque_sum, np.cumsum(table.torque), rtol=1e-11
        )
        np.testing.assert_allclose(
            table.twist[:-1], -np.diff(table.ordinate), rtol=1e-11
        )
        assert str(table).splitlines()[2].split()[:2] == ["1", "5.0000e+00"]


def tooth_tree():
    """A branched train over two meshes without loop, one of its branches held and one
    viscous ring at rest.
    """
    return [
        Disk(name="a", inertia=2.0),
        Disk(name="b", inertia=0.3, radius=0.1),
        Disk(name="c", inertia=0.2, radius=0.05),
        Disk(name="d", inertia=0.7),
        Disk(name="e", inertia=0.1, radius=0.07),
        Disk(name="f", inertia=0.4),
        Shaft(between=("b", "a"), stiffness=3e4),
        Shaft(between=("c", "d"), stiffness=2e4),
        Shaft(between=("e", "f"), stiffness=4e4),
        Mesh(between=("c", "b"), stiffness=4e6),
        Mesh(between=("b", "e"), stiffness=3e6),
        jaxhb.Damper(name="ring", disk="a", inertia=0.5, damping=3.0),
    ]


@pytest.mark.parametrize(
    "parts", [tooth_tree(), chain_parts([1.0, 2.0, 3.0], [50.0, 70.0], ground=20.0)]
)
def test_the_residual_is_the_torque_that_makes_the_motion(parts):
    train = build(parts, reference="a" if parts[0].name == "a" else None)
    names = dense.disk_names(parts)
    for hz in (0.3, 11.0, 47.0):
        table = holzer_table(train, hz=hz)
        motion = np.zeros(len(names))
        motion[[names.index(name) for name in table.names]] = table.ordinate
        torque = dense.dynamic_stiffness(parts, 2 * np.pi * hz).real @ motion
        expected = np.zeros(len(names))
        expected[names.index(table.names[-1])] = -table.residual
        np.testing.assert_allclose(
            torque, expected, rtol=1e-11, atol=1e-11 * np.abs(table.torque).max()
        )
        deflection = {
            getattr(part, "name", None) or "|".join(part.between): row @ motion
            for part, row in dense.links(parts)
        }
        for link, twist in zip(table.links[:-1], table.twist, strict=False):
            if link != "ring":
                # The dense deflection is a difference.
                np.testing.assert_allclose(abs(twist), abs(deflection[link]), rtol=1e-9)
        assert table.ordinate[table.names.index(names[0])] == pytest.approx(1.0)


def test_the_residual_vanishes_at_every_natural_frequency_and_has_no_poles():
    train = build(tooth_tree(), reference="a")
    frequencies = jaxhb.natural_frequencies(train).frequencies_hz[2:]
    around = np.sort(np.concatenate([0.999 * frequencies, 1.001 * frequencies]))
    sign = np.sign(holzer_residual(train, hz=around)).reshape(-1, 2)
    assert (sign[:, 0] == -sign[:, 1]).all()
    assert (sign[:-1, 1] == sign[1:, 0]).all()


def test_branches_with_a_node_where_they_meet_keep_the_table_finite():
    # Two equal branches move against each other, the hub rests.
    hub = [Disk(name=name, inertia=1.0) for name in ("left", "hub", "right")]
    shafts = [
        Shaft(between=("left", "hub"), stiffness=9.0),
        Shaft(between=("hub", "right"), stiffness=9.0),
    ]
    more = [
        Disk(name="tail", inertia=2.0),
        Shaft(between=("hub", "tail"), stiffness=5.0),
    ]
    table = holzer_table(build([*hub, *shafts, *more]), hz=3.0 / (2 * np.pi))
    values = dict(zip(table.names, table.ordinate, strict=True))
    assert np.isfinite(table.ordinate).all()
    assert abs(values["hub"]) < ALGEBRAIC
    assert abs(table.residual) < 1e-11


def test_a_closed_loop_is_refused_by_name():
    with pytest.raises(
        jaxhb.SceneError,
        match="closes a loop, and Holzer's table is for trains without",
    ):
        holzer_table(build(gearbox_parts(), reference="motor"), hz=10.0)
    assert holzer_table(build(branched_parts(), reference="flywheel"), hz=10.0).names


def viscous_chain(
    order, rings, inertia=(10.0, 20.0, 7.0, 4.0), stiffness=(1e6, 2e6, 5e5)
):
    """A line of disks named by number, listed in some order, with viscous rings on some
    of them.
    """
    parts = [Disk(name=str(place), inertia=inertia[place]) for place in order]
    parts += [
        Shaft(between=(str(i), str(i + 1)), stiffness=k)
        for i, k in enumerate(stiffness)
    ]
    return parts + [
        jaxhb.Damper(name=f"ring {i}", disk=str(i), inertia=3.0 + i, damping=50.0)
        for i in rings
    ]


def elastic_modes(parts):
    """Frequencies in Hz and shapes, columns of angles by the names of disks, of the
    modes that strain links, dense.
    """
    stiffness = dense.dynamic_stiffness(parts, 0.0).real
    mass = np.diag(stiffness - dense.dynamic_stiffness(parts, 1.0).real)
    values, vectors = np.linalg.eigh(stiffness / np.sqrt(np.outer(mass, mass)))
    moving = values > 1e-9 * values.max()
    return (
        np.sqrt(values[moving]) / (2 * np.pi),
        (vectors / np.sqrt(mass)[:, None])[:, moving],
    )


def check_tables(parts, reference):
    """Compare Holzer's table at every frequency with the eigenvector of the dense
    matrices.
    """
    train = build(parts, reference=reference)
    names = dense.disk_names(parts)
    frequencies, shapes = elastic_modes(parts)
    for hz, shape in zip(frequencies, shapes.T, strict=True):
        table = holzer_table(train, hz=float(hz))
        motion = np.zeros(len(names))
        motion[[names.index(name) for name in table.names]] = table.ordinate
        scale = shape @ motion / (shape @ shape)
        np.testing.assert_allclose(
            motion, scale * shape, rtol=0, atol=1e-7 * np.abs(motion).max()
        )
        assert np.abs(table.residual) <= 1e-7 * np.abs(table.torque).max()
        first = abs(table.ordinate[table.names.index(names[0])])
        assert first == pytest.approx(1.0) or first < 1e-6


@pytest.mark.parametrize("rings", [(0,), (1,), (3,), (0, 3), (1, 2, 2), (0, 1, 2, 3)])
def test_tables_of_trains_with_rings_at_rest_are_the_dense_modes_in_any_order_of_disks(
    rings,
):
    rings = list(dict.fromkeys(rings))
    for order in itertools.permutations(range(4)):
        check_tables(viscous_chain(order, rings), None)


def test_rings_on_branches_and_behind_teeth_leave_tables_the_dense_modes():
    disks = [part for part in tooth_tree() if isinstance(part, Disk)]
    links = [part for part in tooth_tree() if not isinstance(part, Disk | jaxhb.Damper)]
    for ringed in ("a", "b", "d", "f"):
        rings = [jaxhb.Damper(name="ring", disk=ringed, inertia=0.5, damping=3.0)]
        for turn in range(len(disks)):
            check_tables([*disks[turn:], *disks[:turn], *links, *rings], "a")


def test_parts_that_a_ring_without_stiffness_joins_each_have_their_tables():
    """A fluid coupling: the shaft behind it hangs on the ring."""
    parts = [*viscous_chain((0, 1, 2, 3), [3]), Disk(name="pump", inertia=2.0)]
    check_tables([*parts, Shaft(between=("ring 3", "pump"), stiffness=3e5)], None)


def test_equal_branches_with_nodes_where_they_meet_have_their_modes():
    """Two and three branches: the joint carries nothing, and the elimination is left
    with rounding.
    """
    for count in (2, 3):
        parts = [
            Disk(name="hub", inertia=1.0),
            *(Disk(name=str(i), inertia=2.0) for i in range(count)),
        ]
        parts += [Shaft(between=("hub", str(i)), stiffness=9.0) for i in range(count)]
        parts += [
            Disk(name="tail", inertia=2.5),
            Shaft(between=("hub", "tail"), stiffness=5.0),
        ]
        train = build(parts)
        names = dense.disk_names(parts)
        table = holzer_table(train, hz=np.sqrt(9.0 / 2.0) / (2 * np.pi))
        motion = np.zeros(len(names))
        motion[[names.index(name) for name in table.names]] = table.ordinate
        left = dense.dynamic_stiffness(parts, np.sqrt(9.0 / 2.0)).real @ motion
        assert np.abs(left).max() <= 1e-9 * np.abs(table.torque).max()
        assert np.abs(motion).max() >= 1.0
        assert abs(motion[0]) < 1e-9
