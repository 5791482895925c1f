"""Stiffness from dimensions, damping from a magnifier or a ratio, referred numbers:
energies, resonances, sentences.
"""

import jax
import numpy as np
import pytest
from reference_data import reference
from tolerances import ALGEBRAIC, GRADIENT

import jaxhb
from jaxhb import Disk, Mesh, SceneError, Shaft, Torque
from jaxhb.scene.writer import changed_scene, elements_text

AB = [Disk(name="a", inertia=2.0, radius=0.1), Disk(name="b", inertia=3.0, radius=0.2)]
SIZE = {"length": 0.5, "outer": 0.1, "inner": 0.05, "shear_modulus": 8e10}


def train(**shaft):
    return jaxhb.build([*AB, Shaft(between=("a", "b"), **shaft)])


def test_a_stiffness_from_dimensions_stores_the_shear_energy_of_the_shaft():
    radius = np.linspace(SIZE["inner"] / 2, SIZE["outer"] / 2, 100_001)
    twist = 0.01
    shear = SIZE["shear_modulus"] * twist * radius / SIZE["length"]
    energy = (
        np.trapezoid(
            shear**2 / (2 * SIZE["shear_modulus"]) * 2 * np.pi * radius, radius
        )
        * SIZE["length"]
    )
    assert train(**SIZE).value("a|b.stiffness") * twist**2 / 2 == pytest.approx(
        energy, rel=1e-8
    )


@pytest.mark.parametrize("way", [{"magnifier": 25.0}, {"damping_ratio": 0.02}])
def test_a_magnifier_is_the_amplification_at_resonance(way):
    a, b = AB
    k = 1e6
    reduced = 2.0 * 3.0 / 5.0
    hz = float(np.sqrt(k / reduced) / (2 * np.pi))
    link = Shaft(between=("a", "b"), stiffness=k, damping_hz=hz, **way)
    torques = [
        Torque(disk=d, harmonics=((1.0, sign * 10.0, 0.0),))
        for d, sign in (("a", 1.0), ("b", -1.0))
    ]
    r = jaxhb.forced_response(
        jaxhb.build([a, b, link, *torques], revolutions_per_cycle=1), rpm=60.0 * hz
    )
    assert r.twist("a", "b").order(1.0) == pytest.approx(25.0 * 10.0 / k, rel=1e-9)


def test_a_mesh_has_the_tooth_damping_ratio_at_its_own_frequency():
    masses = 2.0 / 0.1**2, 3.0 / 0.2**2
    m = masses[0] * masses[1] / sum(masses)
    c = 1e8
    hz = np.sqrt(c / m) / (2 * np.pi)
    mesh = Mesh(between=("a", "b"), stiffness=c, damping_ratio=0.03, damping_hz=hz)
    made = jaxhb.build([*AB, mesh], reference="a", name="pair")
    assert made.value("a|b.damping") / (2 * np.sqrt(c * m)) == pytest.approx(
        0.03, rel=ALGEBRAIC
    )
    assert jaxhb.damped_modes(made).damping_ratio[0] == pytest.approx(0.03, rel=1e-9)


def test_what_follows_is_changed_with_what_it_follows_from():
    made = train(**SIZE, magnifier=25.0, damping_hz=50.0)
    for changed in (
        {"outer": 0.12},
        {"inner": 0.01},
        {"length": 0.3, "shear_modulus": 7e10},
        {"damping_hz": 60.0},
    ):
        values = SIZE | {"magnifier": 25.0, "damping_hz": 50.0} | changed
        new = made.replace({f"a|b.{key}": value for key, value in changed.items()})
        for field in ("stiffness", "damping"):
            np.testing.assert_allclose(
                new.value(f"a|b.{field}"),
                train(**values).value(f"a|b.{field}"),
                rtol=ALGEBRAIC,
            )
    stiffer = train(stiffness=1e5, damping_ratio=0.02, damping_hz=50.0).replace(
        {"a|b.stiffness": 3e5}
    )
    assert stiffer.value("a|b.damping") == pytest.approx(
        2 * 0.02 * 3e5 / (2 * np.pi * 50.0), rel=ALGEBRAIC
    )


def test_the_derivative_to_a_dimension_is_that_of_differences():
    made = train(**SIZE, magnifier=25.0, damping_hz=50.0)

    def both(values):
        new = made.replace(
            {"a|b.outer": values[0], "a|b.inner": values[1], "a|b.magnifier": values[2]}
        )
        return jax.numpy.stack([new.value("a|b.stiffness"), new.value("a|b.damping")])

    at = np.array([0.1, 0.05, 25.0])
    direction = 1e-3 * np.array([0.1, -0.05, 25.0])
    _, slope = jax.jvp(both, (at,), (direction,))
    near, far = (both(at + k * direction) - both(at - k * direction) for k in (1, 2))
    np.testing.assert_allclose(slope, (8 * near - far) / 12, rtol=GRADIENT)


def test_a_traced_wall_without_thickness_is_invalid_input():
    made = jaxhb.build(
        [
            *AB,
            Shaft(between=("a", "b"), **SIZE),
            Torque(disk="a", harmonics=((1.0, 1.0, 0.0),)),
        ]
    )
    status = jax.jit(
        lambda inner: (
            jaxhb.forced_response(made.replace({"a|b.inner": inner}), rpm=100.0).status
        )
    )
    assert (
        int(status(0.05)) == jaxhb.Status.CONVERGED
        and int(status(0.2)) == jaxhb.Status.INVALID_INPUT
    )


@pytest.mark.parametrize(
    ("key", "sentence"), reference("cases")["changes of what follows"]
)
def test_numbers_without_effect_are_refused(key, sentence):
    parts = [*AB, Disk(name="c", inertia=1.0), Shaft(between=("b", "c"), stiffness=1e4)]
    made = jaxhb.build(
        [*parts, Shaft(between=("a", "b"), **SIZE, magnifier=25.0, damping_hz=50.0)]
    )
    with pytest.raises(SceneError) as caught:
        made.replace({key: -1.0 if "length" in key else 0.3})
    assert sentence in str(caught.value)


FAULTS = reference("cases")["shafts"]


@pytest.mark.parametrize("case", FAULTS)
def test_each_fault_is_one_sentence(case):
    keys, wanted = FAULTS[case]
    with pytest.raises(SceneError) as caught:
        jaxhb.build([*AB, Shaft(between=("a", "b"), **keys)], rated_rpm=1000.0)
    assert len(caught.value.sentences) == 1 and wanted in caught.value.sentences[0], (
        caught.value
    )
    assert caught.value.sentences[0].startswith("scene, [[shaft]] no. 1: ")


@pytest.mark.parametrize("rated", [0.0, -5.0, "fast", float("nan")])
def test_a_rated_speed_is_greater_than_0(rated):
    with pytest.raises(SceneError, match=r"scene, \[scene\]: rated_rpm is .*, must be"):
        jaxhb.build([*AB, Shaft(between=("a", "b"), stiffness=1.0)], rated_rpm=rated)


def test_a_scene_of_elements_is_read_as_it_was_written(tmp_path):
    strong = {
        "stress_concentration": 0.6,
        "tensile_strength": 6e8,
        "power_limit": 100.0,
    }
    parts = [*AB, Disk(name="c", inertia=1.0, radius=0.1)]
    parts += [
        Shaft(between=("a", "b"), **SIZE, damping_ratio=0.01, damping_hz=40.0, **strong)
    ]
    parts += [
        Mesh(
            between=("b", "c"),
            stiffness=1e8,
            magnifier=20.0,
            damping_hz=900.0,
            rated_torque=50.0,
        )
    ]
    path = tmp_path / "scene.toml"
    path.write_text(elements_text(parts, name="one", reference="a", rated_rpm=1500.0))
    made = jaxhb.build(parts, name="one", reference="a", rated_rpm=1500.0)
    read = jaxhb.load_scene(path)
    assert made.topology == read.topology and read.topology.rated_rpm == 1500.0
    for one, other in zip(jax.tree.leaves(made), jax.tree.leaves(read), strict=True):
        np.testing.assert_array_equal(one, other)
    text, _ = changed_scene(path, {("shaft", 0, "outer"): 0.11})
    path.write_text(text)
    changed = made.replace({"a|b.outer": 0.11}).value("a|b.stiffness")
    assert jaxhb.load_scene(path).value("a|b.stiffness") == pytest.approx(
        changed, rel=ALGEBRAIC
    )


def test_referred_numbers_keep_the_energies():
    made = jaxhb.load_scene("gear_train_30")
    found = jaxhb.referred(made)
    topology = made.topology
    angle = np.random.default_rng(1).normal(size=topology.n_disks)
    reference = angle / found.factor
    ends = np.array(topology.link_ends)
    twist = reference[ends[:, 0]] - reference[ends[:, 1]]
    kinetic = (found.inertia_referred * reference**2).sum() / 2
    assert kinetic == pytest.approx(
        float(jaxhb.kinetic_energy(made, angle)), rel=ALGEBRAIC
    )
    ground = topology.ground_disk[0]
    held = made.grounds.stiffness[0] * angle[ground] ** 2
    energy = ((found.stiffness_referred * twist**2).sum() + held) / 2
    assert energy == pytest.approx(float(jaxhb.strain_energy(made, angle)), rel=1e-9)
