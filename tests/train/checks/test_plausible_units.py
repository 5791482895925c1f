"""Numbers in units of drawings and catalogues (mm, N mm, kg cm2, kW, kN m) are noted,
and sound plants are not.
"""

import dataclasses

import numpy as np
import pytest

import jaxhb
from jaxhb.elements.elements import Damper, Disk, Load, Mesh, Shaft
from jaxhb.elements.excitations.crank_slider import Cylinder
from jaxhb.elements.excitations.torque import Torque
from jaxhb.linear.forced import forced_response
from jaxhb.report.text.scene_check import scene_notes
from jaxhb.scene.files import load_scene, scene_names
from jaxhb.train.assembly import build
from jaxhb.train.checks.plausible import compressors, plausibility

SHAFTED = [name for name in scene_names() if load_scene(name).topology.shaft_names]


def line(**shaft):
    """Two disks and a steel shaft."""
    parts = [
        Disk(name="a", inertia=8.0),
        Disk(name="b", inertia=20.0),
        Shaft(between=("a", "b"), **shaft),
    ]
    return build(parts, revolutions_per_cycle=1)


def test_a_shaft_whose_length_is_in_mm_is_noted():
    sentence = (
        "[[shaft]] 'a|b': length is 900 m, usual 0.001 to 24 m: is it in m, not in mm?"
    )
    long = line(length=900.0, outer=0.08, shear_modulus=8e10)
    assert plausibility(long) == [sentence]
    sound = line(length=0.9, outer=0.08, shear_modulus=8e10)
    assert plausibility(sound) == []
    # Closed form of two disks on a round shaft.
    stiffness = 8e10 * np.pi * 0.08**4 / 32 / 0.9
    hz = np.sqrt(stiffness * (1 / 8.0 + 1 / 20.0)) / (2 * np.pi)
    np.testing.assert_allclose(
        jaxhb.natural_frequencies(sound).frequencies_hz[1], hz, rtol=1e-12
    )
    assert hz == pytest.approx(39.805, abs=5e-4)


@pytest.mark.parametrize(
    "length, outer", [(20.0, 0.45), (2.0, 0.04), (0.01, 0.2), (55.0, 0.5)]
)
def test_shafts_of_ships_cars_and_couplings_have_usual_lengths(length, outer):
    notes = plausibility(line(length=length, outer=outer, shear_modulus=8e10))
    assert not any("length" in note for note in notes)


@pytest.mark.parametrize("size", ["outer", "inner", "diameter"])
def test_a_diameter_in_mm_is_refused(size):
    sizes = {"length": 0.9, "outer": 0.08, "shear_modulus": 8e10} | {size: 80.0}
    sentence = rf"{size} is 80 m, must be .*at most 5 m\. Give it in m\."
    with pytest.raises(jaxhb.SceneError, match=sentence):
        line(**sizes)


@pytest.mark.parametrize("name", SHAFTED)
def test_stiffnesses_in_n_mm_are_noted_of_all_shafts_and_of_one(name):
    train = load_scene(name)
    topology = train.topology
    stiffness = train.shafts.stiffness
    milli = {
        f"{shaft}.stiffness": 1000.0 * k
        for shaft, k in zip(topology.shaft_names, stiffness, strict=True)
    }
    notes = plausibility(train.replace(milli))
    note = next(note for note in notes if "N mm/rad" in note)
    assert note.startswith("[[shaft]] ")
    assert "is it in N m/rad, not in N mm/rad?" in note
    assert not any("N mm/rad" in note for note in plausibility(train))


def test_one_stiffness_in_n_mm_among_others_is_noted():
    train = load_scene("six_cylinder_diesel")
    change = {"cyl3|cyl4.stiffness": 1000.0 * train.value("cyl3|cyl4.stiffness")}
    (note,) = plausibility(train.replace(change))
    assert note.startswith("[[shaft]] 'cyl3|cyl4': stiffness is ")
    assert "not in N mm/rad?" in note


def test_a_bare_shaft_in_short_pieces_is_not_noted():
    """A steel shaft of 100 mm and 2 m in 200 pieces."""
    polar = np.pi / 32 * 0.1**4
    names = [f"piece {i}" for i in range(200)]
    parts = [Disk(name=name, inertia=7850.0 * polar * 0.01) for name in names]
    parts += [
        Shaft(between=ends, stiffness=8e10 * polar / 0.01)
        for ends in zip(names, names[1:], strict=False)
    ]
    assert plausibility(build(parts, revolutions_per_cycle=1)) == []


def test_a_shaft_that_is_stiff_on_purpose_is_not_noted():
    assert plausibility(line(stiffness=1e13)) == []
    assert len(plausibility(line(stiffness=3.57e8))) == 1


@pytest.mark.parametrize(
    "name", ["six_cylinder_diesel", "inline_four_timing_drive", "gear_train_30"]
)
def test_inertias_in_kg_cm2_are_noted(name):
    train = load_scene(name)
    names = train.topology.disk_names[: train.topology.n_scene_disks]
    centi = {
        f"{disk}.inertia": 1e4 * j
        for disk, j in zip(names, train.disks.inertia, strict=True)
    }
    notes = plausibility(train.replace(centi))
    sentence = "kg m2 for its bore and stroke: is it in kg m2, not in kg cm2?"
    assert any(sentence in note for note in notes)


def notes_of(train):
    """Notes on a train and on its mean motion at a speed."""
    response = forced_response(train, rpm=[1000.0], harmonics=1)
    return scene_notes([dataclasses.replace(response[0], train=train)])


def pair(*, radius_b=0.1, kind="external", rated_torque=None):
    """Two gears under a mean torque."""
    parts = [
        Disk(name="a", inertia=0.05, radius=0.1),
        Disk(name="b", inertia=0.05, radius=radius_b),
        Mesh(
            between=("a", "b"),
            stiffness=2e8,
            damping=3e3,
            backlash=1e-4,
            kind=kind,
            rated_torque=rated_torque,
        ),
        Torque(disk="a", mean=12500.0),
        Load(disk="b"),
    ]
    return build(parts, reference="a", revolutions_per_cycle=1)


def test_internal_gears_of_equal_radii_are_noted():
    sentence = (
        "[[mesh]] 'a|b': its gears have radii of 0.1 and 0.1 m, and kind is 'internal':"
        " a ring is larger than the gear"
    )
    assert plausibility(pair(kind="internal")) == [
        f"{sentence} inside it; is it external?"
    ]
    assert plausibility(pair()) == []
    assert plausibility(pair(kind="internal", radius_b=0.25)) == []


@pytest.mark.parametrize(
    "rated, noted", [(12.5, True), (12500.0, False), (9000.0, False)]
)
def test_a_rated_torque_in_kn_m_is_noted_beside_the_mean_torque(rated, noted):
    notes = notes_of(pair(rated_torque=rated))
    sentence = (
        "rated_torque is 12.5 N m, and the mean torque of its first gear 12500 N m: is"
        " it in N m, not in kN m?"
    )
    assert notes == [f"[[mesh]] 'a|b': {sentence}"] * noted


@pytest.mark.parametrize(
    "limit, noted", [(0.4, True), (8.0, True), (40.0, False), (3e4, False)]
)
def test_a_power_limit_in_kw_is_noted(limit, noted):
    damper = Damper(
        name="ring", disk="a", inertia=0.5, damping=100.0, power_limit=limit
    )
    parts = [
        Disk(name="a", inertia=8.0),
        Disk(name="b", inertia=20.0),
        Shaft(between=("a", "b"), stiffness=4e5),
        damper,
    ]
    notes = plausibility(build(parts, revolutions_per_cycle=1))
    sentence = (
        f"power_limit is {limit:.4g} W, usual 10 to 1e6 W: is it in W, not in kW?"
    )
    assert notes == [f"[[damper]] 'ring': {sentence}"] * noted


def crosshead(mass):
    """A two-stroke cylinder of 350 mm with a stroke of 1.55 m."""
    angle = np.arange(0.0, 361.0, 5.0)
    pressure = 3e5 + 140e5 * np.exp(-(((angle + 180.0) % 360.0 - 190.0) ** 2) / 800.0)
    table = tuple(zip(angle.tolist(), pressure.tolist(), strict=True))
    parts = [
        Disk(name="a", inertia=900.0),
        Disk(name="b", inertia=2000.0),
        Load(disk="b"),
        Shaft(between=("a", "b"), stiffness=2e8),
        Cylinder(
            disk="a",
            pressure=table,
            bore=0.35,
            stroke=1.55,
            rod=1.5,
            ambient_pressure=1e5,
            reciprocating_mass=mass,
        ),
    ]
    return build(parts, revolutions_per_cycle=1)


def test_the_reciprocating_mass_of_a_crosshead_engine_is_usual():
    assert plausibility(crosshead(1000.0)) == []
    (note,) = plausibility(crosshead(1e6))
    assert "reciprocating_mass is 1e6 kg" in note


def compressor(unit=1.0):
    """An air compressor from 1 to 3.5 bar that the load, a motor, drives."""
    angle = np.arange(0.0, 360.0, 2.0)
    # Travel of the piston, with the clearance, over the stroke
    travel = 0.5 * (1 - np.cos(np.deg2rad(angle))) + 0.06
    expansion = np.maximum(3.5e5 * (0.06 / travel) ** 1.3, 1e5)
    compression = np.minimum(1e5 * (1.06 / travel) ** 1.3, 3.5e5)
    pressure = np.where(angle < 180.0, expansion, compression) / unit
    table = tuple(zip(angle.tolist(), pressure.tolist(), strict=True))
    parts = [
        Disk(name="a", inertia=0.05),
        Disk(name="motor", inertia=0.2),
        Load(disk="motor"),
        Shaft(between=("a", "motor"), stiffness=1e5, damping=5.0),
        Cylinder(
            name="air",
            disk="a",
            pressure=table,
            bore=0.1,
            stroke=0.08,
            rod=0.15,
            ambient_pressure=1e5,
            reciprocating_mass=1.2,
        ),
    ]
    return build(parts, revolutions_per_cycle=1)


def test_a_compressor_that_a_motor_drives_is_usual():
    assert compressors(compressor()) == {0}
    assert notes_of(compressor()) == []
    notes = notes_of(compressor(unit=1e5))
    assert any("the largest pressure is 3.5 Pa" in note for note in notes)


def test_an_engine_is_no_compressor():
    assert all(compressors(load_scene(name)) == set() for name in scene_names())
    assert compressors(crosshead(1000.0)) == set()
