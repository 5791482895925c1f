"""Stiffness from dimensions, damping from a magnifier or a ratio, and referred numbers
against energies and resonances.
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


def sized(**values):
    """Shaft between the disks that has its stiffness from its dimensions."""
    return Shaft(between=("a", "b"), **SIZE | values)


def train(*elements):
    """Two disks and further elements."""
    return jaxhb.build([*AB, *elements])


def test_a_stiffness_from_dimensions_stores_the_shear_energy_of_the_shaft():
    radius = np.linspace(SIZE["inner"] / 2, SIZE["outer"] / 2, 100_001)
    twist = 0.01
    shear = SIZE["shear_modulus"] * twist * radius / SIZE["length"]
    density = shear**2 / (2 * SIZE["shear_modulus"])
    energy = np.trapezoid(density * 2 * np.pi * radius, radius) * SIZE["length"]
    stiffness = train(sized()).value("a|b.stiffness")
    assert stiffness * twist**2 / 2 == pytest.approx(energy, rel=1e-8)


@pytest.mark.parametrize("way", [{"magnifier": 25.0}, {"damping_ratio": 0.02}])
def test_a_magnifier_is_the_amplification_at_resonance(way):
    k = 1e6
    reduced = 2.0 * 3.0 / 5.0
    hz = float(np.sqrt(k / reduced) / (2 * np.pi))
    link = Shaft(between=("a", "b"), stiffness=k, damping_hz=hz, **way)
    torques = [
        Torque(disk="a", harmonics=((1.0, 10.0, 0.0),)),
        Torque(disk="b", harmonics=((1.0, -10.0, 0.0),)),
    ]
    disks_on_shaft = jaxhb.build([*AB, link, *torques], revolutions_per_cycle=1)
    response = jaxhb.forced_response(disks_on_shaft, rpm=60.0 * hz)
    twist = response.twist("a", "b").order(1.0)
    assert twist == pytest.approx(25.0 * 10.0 / k, rel=1e-9)


def test_a_mesh_has_the_tooth_damping_ratio_at_its_own_frequency():
    masses = (2.0 / 0.1**2, 3.0 / 0.2**2)
    mass = masses[0] * masses[1] / sum(masses)
    stiffness = 1e8
    hz = np.sqrt(stiffness / mass) / (2 * np.pi)
    mesh = Mesh(
        between=("a", "b"), stiffness=stiffness, damping_ratio=0.03, damping_hz=hz
    )
    gears = jaxhb.build([*AB, mesh], reference="a", name="pair")
    ratio = gears.value("a|b.damping") / (2 * np.sqrt(stiffness * mass))
    assert ratio == pytest.approx(0.03, rel=ALGEBRAIC)
    assert jaxhb.damped_modes(gears).damping_ratio[0] == pytest.approx(0.03, rel=1e-9)


def test_what_follows_is_changed_with_what_it_follows_from():
    damping = {"magnifier": 25.0, "damping_hz": 50.0}
    original = train(sized(**damping))
    for changed in (
        {"outer": 0.12},
        {"inner": 0.01},
        {"length": 0.3, "shear_modulus": 7e10},
        {"damping_hz": 60.0},
    ):
        changes = {f"a|b.{key}": value for key, value in changed.items()}
        replaced = original.replace(changes)
        expected = train(sized(**damping | changed))
        for key in ("a|b.stiffness", "a|b.damping"):
            np.testing.assert_allclose(
                replaced.value(key), expected.value(key), rtol=ALGEBRAIC
            )
    damped = Shaft(
        between=("a", "b"), stiffness=1e5, damping_ratio=0.02, damping_hz=50.0
    )
    stiffer = train(damped).replace({"a|b.stiffness": 3e5})
    assert stiffer.value("a|b.damping") == pytest.approx(
        2 * 0.02 * 3e5 / (2 * np.pi * 50.0), rel=ALGEBRAIC
    )


def test_the_derivative_to_a_dimension_is_that_of_differences():
    original = train(sized(magnifier=25.0, damping_hz=50.0))

    def stiffness_and_damping(values):
        replaced = original.replace(
            {"a|b.outer": values[0], "a|b.inner": values[1], "a|b.magnifier": values[2]}
        )
        return jax.numpy.stack(
            [replaced.value("a|b.stiffness"), replaced.value("a|b.damping")]
        )

    at = np.array([0.1, 0.05, 25.0])
    direction = 1e-3 * np.array([0.1, -0.05, 25.0])
    _, slope = jax.jvp(stiffness_and_damping, (at,), (direction,))

    def change(steps):
        ahead = stiffness_and_damping(at + steps * direction)
        return ahead - stiffness_and_damping(at - steps * direction)

    near = change(1)
    far = change(2)
    np.testing.assert_allclose(slope, (8 * near - far) / 12, rtol=GRADIENT)


def test_a_traced_wall_without_thickness_is_invalid_input():
    original = train(sized(), Torque(disk="a", harmonics=((1.0, 1.0, 0.0),)))

    @jax.jit
    def status(inner):
        replaced = original.replace({"a|b.inner": inner})
        return jaxhb.forced_response(replaced, rpm=100.0).status

    assert int(status(0.05)) == jaxhb.Status.CONVERGED
    assert int(status(0.2)) == jaxhb.Status.INVALID_INPUT


@pytest.mark.parametrize(
    ("key", "sentence"), reference("cases")["changes of what follows"]
)
def test_numbers_without_effect_are_refused(key, sentence):
    original = train(
        Disk(name="c", inertia=1.0),
        Shaft(between=("b", "c"), stiffness=1e4),
        sized(magnifier=25.0, damping_hz=50.0),
    )
    with pytest.raises(SceneError) as caught:
        original.replace({key: -1.0 if "length" in key else 0.3})
    assert sentence in str(caught.value)


FAULTS = reference("cases")["shafts"]


@pytest.mark.parametrize("case", FAULTS)
def test_each_fault_is_one_sentence(case):
    keys, expected = FAULTS[case]
    with pytest.raises(SceneError) as caught:
        jaxhb.build([*AB, Shaft(between=("a", "b"), **keys)], rated_rpm=1000.0)
    (sentence,) = caught.value.sentences
    assert expected in sentence
    assert sentence.startswith("scene, [[shaft]] no. 1: ")


@pytest.mark.parametrize("rated", [0.0, -5.0, "fast", float("nan")])
def test_a_rated_speed_is_greater_than_0(rated):
    with pytest.raises(SceneError, match=r"scene, \[scene\]: rated_rpm is .*, must be"):
        jaxhb.build([*AB, Shaft(between=("a", "b"), stiffness=1.0)], rated_rpm=rated)


def test_a_scene_of_elements_is_read_as_it_was_written(tmp_path):
    parts = [
        *AB,
        Disk(name="c", inertia=1.0, radius=0.1),
        sized(
            damping_ratio=0.01,
            damping_hz=40.0,
            stress_concentration=0.6,
            tensile_strength=6e8,
            power_limit=100.0,
        ),
        Mesh(
            between=("b", "c"),
            stiffness=1e8,
            magnifier=20.0,
            damping_hz=900.0,
            rated_torque=50.0,
        ),
    ]
    path = tmp_path / "scene.toml"
    path.write_text(elements_text(parts, name="one", reference="a", rated_rpm=1500.0))
    original = jaxhb.build(parts, name="one", reference="a", rated_rpm=1500.0)
    read = jaxhb.load_scene(path)
    assert original.topology == read.topology
    assert read.topology.rated_rpm == 1500.0
    leaves = zip(jax.tree.leaves(original), jax.tree.leaves(read), strict=True)
    for leaf, read_leaf in leaves:
        np.testing.assert_array_equal(leaf, read_leaf)
    text, _ = changed_scene(path, {("shaft", 0, "outer"): 0.11})
    path.write_text(text)
    changed = original.replace({"a|b.outer": 0.11}).value("a|b.stiffness")
    assert jaxhb.load_scene(path).value("a|b.stiffness") == pytest.approx(
        changed, rel=ALGEBRAIC
    )


def test_referred_numbers_keep_the_energies():
    gears = jaxhb.load_scene("gear_train_30")
    referred = jaxhb.referred(gears)
    topology = gears.topology
    angle = np.random.default_rng(1).normal(size=topology.n_disks)
    reference = angle / referred.factor
    ends = np.array(topology.link_ends)
    twist = reference[ends[:, 0]] - reference[ends[:, 1]]
    kinetic = (referred.inertia_referred * reference**2).sum() / 2
    expected = float(jaxhb.kinetic_energy(gears, angle))
    assert kinetic == pytest.approx(expected, rel=ALGEBRAIC)
    ground = topology.ground_disk[0]
    ground_energy = gears.grounds.stiffness[0] * angle[ground] ** 2
    energy = ((referred.stiffness_referred * twist**2).sum() + ground_energy) / 2
    assert energy == pytest.approx(float(jaxhb.strain_energy(gears, angle)), rel=1e-9)
