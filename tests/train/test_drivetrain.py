"""Topology, changes of numbers, rotors, the law's defaults, viscous damping."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference_data import reference, refused

from jaxhb.elements.elements import Damper, Disk, Ground, Load, Mesh, Shaft
from jaxhb.elements.excitations.crank_slider import Cylinder
from jaxhb.elements.excitations.torque import Torque
from jaxhb.elements.sentences import SceneError
from jaxhb.scene.files import load_scene
from jaxhb.train.assembly import build
from jaxhb.train.kinematics import inertias, speed_ratios

GEARS = [
    Disk(name="a", inertia=1.0, radius=0.1),
    Disk(name="b", inertia=2.0, radius=0.2),
    Disk(name="c", inertia=3.0, damping=4.0),
    Shaft(between=("b", "c"), stiffness=1e4, damping=5.0, loss_factor=0.1),
    Mesh(between=("a", "b"), stiffness=1e8, backlash=1e-4),
    Damper(
        name="ring",
        disk="c",
        inertia=0.5,
        damping=7.0,
        stiffness=100.0,
        loss_factor=0.2,
    ),
    Load(disk="c"),
]


@pytest.fixture
def train():
    return build([*GEARS, Torque(disk="a", harmonics=[(1.0, 2.0, 3.0)])], reference="a")


def test_links_are_shafts_then_dampers_then_meshes(train):
    topology = train.topology
    assert topology.disk_names == ("a", "b", "c", "ring")
    assert topology.link_names == ("b|c", "ring", "a|b")
    assert topology.link_ends == ((1, 2), (2, 3), (0, 1))
    assert topology.link_index("c", "b") == (0, -1)
    assert topology.link_index("a|b") == (2, 1)
    assert topology.disk_index("ring") == 3
    assert topology.ring_disks == (3,)


def test_elements_without_a_name_are_called_by_their_disks():
    parts = [
        *GEARS,
        Torque(disk="a"),
        Torque(disk="a"),
        Shaft(between=("b", "c"), stiffness=1.0),
        Ground(disk="c", stiffness=1.0),
        Cylinder(disk="a", fires=False),
    ]
    topology = build(parts, reference="a").topology
    assert topology.torque_names == ("a:torque", "a:torque#2")
    assert topology.shaft_names == ("b|c", "b|c#2")
    assert topology.ground_names == ("c:ground",)
    assert topology.load_names == ("c:load",)
    assert topology.cylinder_names == ("a:cylinder",)
    refused(
        lambda: topology.link_index("b", "c"),
        r"several links join 'b' and 'c': 'b\|c', 'b\|c#2'. Ask for one",
    )


def test_every_leaf_is_a_double_vector_over_its_elements(train):
    for name in (
        "disks",
        "shafts",
        "meshes",
        "dampers",
        "grounds",
        "loads",
        "torques",
        "cylinders",
    ):
        leaves = jax.tree.leaves(getattr(train, name))
        assert len({np.shape(leaf)[0] for leaf in leaves}) == 1
        assert all(np.asarray(leaf).dtype == np.float64 for leaf in leaves)


def test_topologies_of_equal_scenes_are_equal_and_hash_alike(train):
    topology = build(
        [*GEARS, Torque(disk="a", harmonics=[(1.0, 2.0, 3.0)])], reference="a"
    ).topology
    assert topology == train.topology
    assert hash(topology) == hash(train.topology)
    assert dataclasses.replace(topology, name="other") != topology


def test_speed_ratios_follow_the_radii_and_are_differentiable(train):
    np.testing.assert_allclose(speed_ratios(train), [1.0, 0.5])

    def ratio(radius):
        return speed_ratios(train.replace({"b.radius": radius}))[1]

    np.testing.assert_allclose(jax.jit(jax.grad(ratio))(0.2), -0.1 / 0.2**2)
    reverse = build(GEARS, reference="c")
    np.testing.assert_allclose(speed_ratios(reverse), [2.0, 1.0])


def test_teeth_make_the_ratio_exact():
    parts = [
        Disk(name="a", inertia=1.0, radius=0.1, teeth=20),
        Disk(name="b", inertia=1.0, radius=0.15005, teeth=30),
    ]
    train = build([*parts, Mesh(between=("a", "b"), stiffness=1e8)], reference="a")
    np.testing.assert_allclose(speed_ratios(train)[1], 2 / 3, rtol=1e-15)
    assert train.topology.teeth == (20, 30)


def test_a_closed_loop_that_turns_is_legal():
    disks = [Disk(name=name, inertia=1.0, radius=0.1) for name in "abcd"]
    meshes = [
        Mesh(between=ends, stiffness=1e8)
        for ends in (("a", "b"), ("b", "c"), ("c", "d"), ("d", "a"))
    ]
    train = build([*disks, *meshes], reference="a")
    np.testing.assert_array_equal(speed_ratios(train), np.ones(4))


@pytest.mark.parametrize(
    "key, value",
    [("b|c.loss_factor", 0.3), ("a|b.backlash", 2e-4), ("c:load.share", 2.0)],
)
def test_replace_changes_one_number_and_keeps_the_topology(train, key, value):
    changed = train.replace({key: value})
    assert changed.value(key) == value
    assert changed.topology is train.topology
    assert train.value(key) != value
    leaves = zip(jax.tree.leaves(train), jax.tree.leaves(changed), strict=True)
    differing = [np.sum(np.asarray(x) != np.asarray(y)) for x, y in leaves]
    assert sum(differing) == 1


def test_replace_does_not_compile_anew(train):
    traces = []

    @jax.jit
    def total(t):
        traces.append(1)
        return jnp.sum(inertias(t)) + jnp.sum(t.shafts.stiffness)

    for k in range(4):
        total(train.replace({"a.inertia": 1.0 + k, "b|c.stiffness": 10.0 * k + 1}))
    assert len(traces) == 1


def test_replace_works_under_jit_grad_and_vmap(train):
    def energy(values):
        changes = {
            "a.inertia": values[0],
            "ring.inertia": values[1],
            "c.inertia": 2 * values[0],
        }
        return jnp.sum(inertias(train.replace(changes)) ** 2)

    values = jnp.array([3.0, 4.0])
    expected = [2 * 3.0 + 8 * 3.0, 2 * 4.0]
    np.testing.assert_allclose(jax.jit(jax.grad(energy))(values), expected)
    np.testing.assert_allclose(jax.jit(jax.jacfwd(energy))(values), expected)
    batch = jnp.array([[3.0, 4.0], [1.0, 1.0]])
    np.testing.assert_allclose(
        jax.jit(jax.vmap(energy))(batch), [energy(v) for v in batch]
    )

    def changed_energy(train):
        return jnp.sum(inertias(train.replace({"a.inertia": 1.5})) ** 2)

    slopes = jax.jit(jax.grad(changed_energy))(train)
    np.testing.assert_allclose(slopes.disks.inertia, [0.0, 4.0, 6.0])


def test_viscous_damping_dissipates_as_the_loss_factor_at_its_frequency(train):
    viscous = train.with_viscous_damping(hz=50.0)
    omega = 100 * np.pi
    np.testing.assert_allclose(viscous.shafts.damping, [5.0 + 0.1 * 1e4 / omega])
    np.testing.assert_allclose(viscous.dampers.damping, [7.0 + 0.2 * 100.0 / omega])
    assert viscous.shafts.loss_factor == 0.0
    assert viscous.dampers.loss_factor == 0.0
    refused(
        lambda: train.with_viscous_damping(hz=0.0),
        "hz is 0.0, must be greater than 0 Hz",
    )


def test_the_law_has_its_defaults_and_those_of_fridman_2009():
    def mesh(ends, **law):
        return Mesh(between=tuple(ends), stiffness=1e8, backlash=1e-4, **law)

    disks = [Disk(name=name, inertia=1.0, radius=0.1) for name in "abcde"]
    meshes = [
        mesh("ab"),
        mesh("bc", law="fridman2009"),
        mesh("cd", epsilon=0.01),
        mesh("de", transition=0.5),
    ]
    train = build([*disks, *meshes], reference="a")
    # Without a torque in the train no mesh has a mean load.
    np.testing.assert_array_equal(train.meshes.epsilon, [1e-4, 0.03, 0.01, 1e-4])
    np.testing.assert_array_equal(train.meshes.transition, [0.004, 0.2, 0.004, 0.5])


def test_a_mesh_without_backlash_is_always_in_contact():
    disks = [Disk(name=name, inertia=1.0, radius=0.1) for name in "ab"]
    mesh = Mesh(between=("a", "b"), stiffness=1e8, kind="internal")
    train = build([*disks, mesh], reference="a")
    assert train.topology.mesh_backlash == (False,)
    assert train.meshes.backlash[0] == 0.0
    assert train.topology.mesh_internal == (True,)
    assert train.topology.mesh_damping_law == ("contact",)
    for field in ("backlash", "epsilon", "transition"):

        def replaced(value, key=f"a|b.{field}"):
            return train.replace({key: value}).meshes.backlash

        for call in (replaced, jax.jit(replaced)):
            with pytest.raises(SceneError, match="the mesh has no backlash"):
                call(0.5)


@pytest.mark.parametrize("key, sentence", reference("cases")["names of numbers"])
def test_unknown_names_and_fields_are_named(train, key, sentence):
    refused(lambda: train.replace({key: 1.0}), sentence)
    refused(lambda: train.value(key), sentence)


def test_all_errors_of_a_replace_are_collected(train):
    changes = {
        "a.inertia": -1.0,
        "zz.inertia": 1.0,
        "b|c.stiffness": [1.0, 2.0],
        "b.inertia": np.nan,
    }
    with pytest.raises(SceneError) as caught:
        train.replace(changes)
    assert len(caught.value.sentences) == 4
    assert "inertia is -1 kg m2, must be at least 0 kg m2" in str(caught.value)
    assert "the value has shape (2,), must have ()" in str(caught.value)


def test_rows_as_a_scene_has_them_are_refused_for_their_orders(train):
    refused(
        lambda: train.replace({"a:torque.harmonics": [(1.0, 2.0, 3.0)]}),
        r"must have \(1, 2\). Leave the orders out: rows are \(Re, Im\) of those of the"
        r" scene.",
    )


def test_radii_that_turn_an_engine_at_another_speed_are_refused():
    train = load_scene("gear_train_30")
    assert train.replace({"cam gear A.radius": 0.17}).value("cam gear A.radius") == 0.17
    parts = [*GEARS, Torque(disk="c", harmonics=[(2.0, 1.0, 0.0)], orders_of="own")]
    sentence = "the new radii change the speed of 'c:torque' from 0.5 to 0.333333 times"
    with pytest.raises(SceneError, match=sentence):
        build(parts, reference="a").replace({"b.radius": 0.3})


def test_unknown_disks_and_links_are_named_with_the_nearest(train):
    refused(
        lambda: train.topology.disk_index("rin"),
        "there is no disk 'rin'. Did you mean 'ring'?",
    )
    refused(
        lambda: train.topology.link_index("a|c"), "there is no link 'a|c'. Did you mean"
    )
    refused(
        lambda: train.topology.link_index("a", "c"),
        r"no link joins 'a' and 'c'. Links there: b\|c, ring, a\|b",
    )


@pytest.mark.parametrize(
    "geometry", [{}, {"stroke": 0.1}, {"stroke": 0.1, "rod": 0.2, "orders": 0.5}]
)
def test_a_reciprocating_mass_without_inertia_torque_is_refused(geometry):
    cylinder = Cylinder(name="p", disk="a", gas_torque_mean=1.0, **geometry)
    train = build([*GEARS, cylinder], reference="a")

    def replaced(mass):
        changed = train.replace({"p.reciprocating_mass": mass})
        return changed.cylinders.reciprocating_mass

    sentence = (
        "'p.reciprocating_mass': it has no effect, as the cylinder was built without"
    )
    with pytest.raises(SceneError, match=sentence):
        replaced(3.0)
    with pytest.raises(SceneError, match="it has no effect"):
        jax.jit(replaced)(3.0)
    refused(lambda: train.replace({"p.bore": 0.1}), "has no pressure table")
    train.replace({"p.reciprocating_mass": 0.0})


def test_radii_that_contradict_the_teeth_are_refused():
    train = load_scene("spur_pair")
    radius = train.value("gear a.radius")
    assert train.replace({"gear a.radius": 2 * radius, "gear b.radius": 2 * radius})
    sentence = r"the new radii of mesh 'gear a\|gear b' are .* but its teeth 32:32"
    with pytest.raises(SceneError, match=sentence):
        train.replace({"gear a.radius": 1.1 * radius})


def test_a_stiffness_that_holds_a_mean_torque_cannot_be_removed():
    grounded = build([*GEARS, Ground(disk="ring", stiffness=1.0)], reference="a")
    sentence = (
        r"the \[\[ground\]\] on 'ring' holds the train only through links without"
    )
    with pytest.raises(SceneError, match=sentence):
        grounded.replace({"ring.stiffness": 0.0})
    pulled = build([*GEARS, Torque(name="pull", disk="ring", mean=1.0)], reference="a")
    sentence = "a mean torque acts on 'ring', which no static stiffness holds"
    with pytest.raises(SceneError, match=sentence):
        pulled.replace({"ring.stiffness": 0.0})
    loose = pulled.replace({"ring.stiffness": 0.0, "pull.mean": 0.0})
    assert loose.value("ring.stiffness") == 0.0

    @jax.jit
    def replaced(stiffness):
        return pulled.replace({"ring.stiffness": stiffness}).dampers.stiffness

    assert replaced(0.0)[0] == 0.0
    off = Torque(name="pull", disk="ring", mean=1.0, scale=[(100.0, 0.0), (200.0, 0.0)])
    free = build([*GEARS, off], reference="a").replace({"ring.stiffness": 0.0})
    with pytest.raises(SceneError, match=sentence):
        free.replace({"pull.scale_factor": np.array([0.0, 1.0])})


def test_a_ring_cannot_be_left_loose():
    train = build(GEARS, reference="a")
    assert train.replace({"ring.stiffness": 0.0}).value("ring.stiffness") == 0.0
    sentence = "'ring': damping and stiffness are both 0, so that the ring is loose"
    with pytest.raises(SceneError, match=sentence):
        train.replace({"ring.stiffness": 0.0, "ring.damping": 0.0})


def test_teeth_change_the_radius_at_the_same_pitch_and_with_it_the_ratio():
    pair = load_scene("spur_pair")
    changed = pair.replace({"gear a.teeth": 40})
    assert changed.topology.teeth == (40, 32)
    np.testing.assert_allclose(changed.disks.radius, [0.0625, 0.05], rtol=1e-12)
    np.testing.assert_allclose(speed_ratios(changed), [1.0, 1.25], rtol=1e-12)
    both = pair.replace({"gear a.teeth": 40.0, "gear b.teeth": 40})
    np.testing.assert_allclose(both.disks.radius, [0.0625, 0.0625], rtol=1e-12)


@pytest.mark.parametrize(
    ("mesh", "load", "values", "sentence"),
    [
        (
            {"stiffness_orders": [(1, 0.1, 0.0)]},
            {},
            {"a.teeth": 21, "b.teeth": 42},
            "have 21 mesh periods .*, not 20,",
        ),
        (
            {"second_gear_error": [(1, 1e-6, 0.0)]},
            {},
            {"a.teeth": 40},
            r"change the speed of 'a\|b' from 0.5 to 1 times",
        ),
        (
            {},
            {"harmonics": [(4.0, 0.1, 0.0)]},
            {"b.teeth": 20},
            "change the speed of 'l' from 0.5 to 1 times",
        ),
    ],
)
def test_orders_that_new_teeth_would_change_are_not_left_as_they_were(
    mesh, load, values, sentence
):
    """Orders of a mesh that has them by its teeth, of a gear with errors, and of a load
    that pulsates.
    """
    parts = [
        Disk(name="a", inertia=0.1, radius=0.05, teeth=20),
        Disk(name="b", inertia=0.2, radius=0.1, teeth=40),
        Mesh(between=("a", "b"), stiffness=1e8, **mesh),
        Load(disk="b", name="l", **load),
    ]
    train = build(parts, revolutions_per_cycle=2, reference="a")
    with pytest.raises(SceneError, match=sentence):
        train.replace(values)


def test_laws_of_a_mesh_change_by_their_words():
    pair = load_scene("spur_pair")
    mesh = "gear a|gear b"
    changed = pair.replace(
        {f"{mesh}.damping_law": "contact", f"{mesh}.law": "fridman2009"}
    )
    assert changed.topology.mesh_damping_law == ("contact",)
    assert changed.value(f"{mesh}.epsilon") == 0.03
    assert changed.value(f"{mesh}.transition") == 0.2
    assert pair.topology.mesh_damping_law == ("always",)


@pytest.mark.parametrize(
    ("scene", "values", "sentence"),
    reference("cases")["words and teeth"]
    + [
        (
            "spur_pair",
            {"gear a.teeth": float("inf")},
            "teeth is inf, must be a whole number of at least 1",
        )
    ],
)
def test_words_and_teeth_that_cannot_be_are_sentences(scene, values, sentence):
    with pytest.raises(SceneError) as error:
        load_scene(scene).replace(values)
    assert sentence in str(error.value)


@pytest.mark.parametrize(
    "field, value, follower, derived",
    [("teeth", 40, "radius", 0.0625), ("law", "fridman2009", "epsilon", 0.03)],
)
def test_what_follows_from_a_choice_is_not_given_otherwise_beside_it(
    field, value, follower, derived
):
    train = load_scene("spur_pair")
    name = "gear a" if field == "teeth" else "gear a|gear b"
    values = {f"{name}.{field}": value, f"{name}.{follower}": 2 * derived}
    for changes in (values, dict(reversed(values.items()))):
        with pytest.raises(SceneError) as caught:
            train.replace(changes)
        (sentence,) = caught.value.sentences
        for text in (*values, f"{derived:g}", f"{2 * derived:g}", "Keep one of them."):
            assert text in sentence
    key = f"{name}.{follower}"
    assert train.replace(values | {key: derived}).value(key) == derived
