"""Notes on numbers far from usual: none for packaged and published trains, a note for
each slip.
"""

import dataclasses

import numpy as np
import pytest
from reference_data import PACKAGED, reference
from trains import branched_parts, branched_thirty, build, gearbox_parts, pinions_parts

import jaxhb
from jaxhb.scene.files import load_scene
from jaxhb.train.checks.plausible import plausibility

ENGINE = "inline_four_timing_drive"
TABLE = f"{ENGINE}_pressure.csv"
ALL_FOUR = "[[cylinder]] 'cylinder 1', 'cylinder 2', 'cylinder 3', 'cylinder 4': "


@pytest.mark.parametrize("name", ["six_cylinder_diesel", "engine_with_damper", ENGINE])
def test_a_misfire_is_no_slip(name):
    train = load_scene(name)
    assert plausibility(train.misfire("cylinder 2")) == []
    assert all(plausibility(misfiring) == [] for misfiring in train.misfires().values())


def test_there_is_nothing_to_note_on_published_and_ordinary_trains():
    trains = [
        branched_thirty(reference("branched_30_disk_linear")),
        build(pinions_parts(10.0), reference="crank gear"),
        build(gearbox_parts(), reference="motor"),
        build(branched_parts(), cycle=2, reference="crank gear"),
        load_scene("gear_train_30").repeated(2),
    ]
    assert [plausibility(train) for train in trains] == [[]] * len(trains)


@pytest.fixture
def scene(tmp_path):
    """Writes the inline four with replaced texts and pressures, and returns its
    notes.
    """
    text = (PACKAGED / f"{ENGINE}.toml").read_text(encoding="utf-8")
    rows = np.loadtxt(PACKAGED / TABLE, delimiter=",")

    def notes(*changes, pressure=lambda angle, p: (angle, p)):
        changed = text
        for old, new in changes:
            assert old in changed
            changed = changed.replace(old, new)
        (tmp_path / f"{ENGINE}.toml").write_text(changed, encoding="utf-8")
        np.savetxt(tmp_path / TABLE, np.stack(pressure(*rows.T), axis=1), delimiter=",")
        return plausibility(load_scene(tmp_path / f"{ENGINE}.toml"))

    return notes


@pytest.mark.parametrize(
    "unit, peak", [(1e5, "160 Pa"), (1e6, "16 Pa")], ids=["bar", "MPa"]
)
def test_a_pressure_in_another_unit_is_noted(scene, unit, peak):
    sentence = (
        f"the largest pressure is {peak}, usual 5e5 to 4e7 Pa: is it in Pa, not in bar"
        " or MPa?"
    )
    assert scene(pressure=lambda angle, p: (angle, p / unit)) == [ALL_FOUR + sentence]


def test_pressures_count_with_their_scale(scene):
    scaled = ("rod = 0.145", "scale = [[800, 0.5e5], [4500, 1e5]]\nrod = 0.145")
    assert scene(scaled, pressure=lambda angle, p: (angle, p / 1e5)) == []


@pytest.mark.parametrize("change, where", reference("cases")["dead centres"])
def test_a_table_read_from_another_dead_centre_is_noted(scene, change, where):
    sentence = (
        f"the pressure is largest {where} firing top dead centre, usual 15 deg before"
        " to 45 deg after: is table_firing_tdc the angle at which the table fires?"
    )
    assert scene(("table_firing_tdc = 0.0", change)) == [ALL_FOUR + sentence]


def test_a_table_may_be_that_of_a_motored_or_of_a_late_firing_cylinder(scene):
    for turn in (-12, 33):
        notes = scene(pressure=lambda angle, p, turn=turn: (angle, np.roll(p, turn)))
        assert notes == []


@pytest.mark.parametrize("old, new, sentence", reference("cases")["notes on sizes"])
def test_sizes_in_other_units_are_noted(scene, old, new, sentence):
    (note,) = scene((old, new))
    assert note.startswith(ALL_FOUR + sentence)


@pytest.mark.parametrize(
    "least, is_absolute", [(0.0, False), (0.98e5, True), (2e5, True), (2.6e5, False)]
)
def test_no_crankcase_pressure_beside_absolute_pressures_is_noted(
    scene, least, is_absolute
):
    def pressure(angle, p):
        return angle, p - p.min() + least

    sentence = (
        "ambient_pressure is 0 Pa, usual 3e4 to 1e6 Pa: the pressure in the cylinder is"
        " absolute, and the crankcase"
    )
    absent = scene(("ambient_pressure = 1e5", ""), pressure=pressure)
    assert absent == [f"{ALL_FOUR}{sentence} has about 1e5 Pa"] * is_absolute
    assert scene(pressure=pressure) == []


def test_two_cylinders_that_fire_together_are_noted(scene):
    together = (
        "firing_order = [1, 3, 4, 2]",
        "firing_order = [1, 3, 4, 2]\nfiring_intervals = [180, 0.5, 359.5, 180]",
    )
    sentence = (
        "they fire together, at 180 deg, usual one every 720 / 4 = 180 deg: has each"
        " its own firing_angle?"
    )
    assert scene(together) == [f"[[cylinder]] 'cylinder 3', 'cylinder 4': {sentence}"]


def test_two_engines_of_a_train_may_fire_together():
    train = load_scene("gear_train_30")
    rotor = tuple(range(len(train.topology.rotor)))
    apart = dataclasses.replace(
        train, topology=dataclasses.replace(train.topology, rotor=rotor)
    )
    same = {f"{name}.firing_angle": 0.0 for name in ("cylinder A1", "cylinder A2")}

    def together(engines):
        notes = plausibility(engines.replace(same))
        return [note for note in notes if "fire together" in note]

    assert len(together(train)) == 1
    assert together(apart) == []


def test_a_pump_that_drives_is_noted(scene):
    sentence = (
        "it drives with a mean of 20 N m, usually below 0 with cylinders: what takes"
        " power has a negative mean"
    )
    assert scene(("mean = -20.0", "mean = 20.0")) == [
        f"[[torque]] 'pump plungers': {sentence}"
    ]


@pytest.mark.parametrize("values, sentence", reference("cases")["notes on meshes"])
def test_meshes_out_of_reach_are_noted(values, sentence):
    mesh = "crank gear|idler"
    train = load_scene(ENGINE).replace(
        {f"{mesh}.{field}": value for field, value in values.items()}
    )
    assert plausibility(train) == [f"[[mesh]] '{mesh}': {sentence}"]


@pytest.mark.parametrize(
    "change, sentence", reference("cases")["notes on a first scene"]
)
def test_numbers_of_a_first_scene_far_from_usual_are_noted(change, sentence):
    notes = plausibility(load_scene("first_scene").replace(change))
    assert len(notes) == len(change)
    assert sentence in notes[0]


def test_the_median_is_that_of_the_own_rotor():
    train = load_scene("gear_train_30")
    # The idler is alone on its rotor: behind gears anything may hang.
    assert plausibility(train.replace({"idler.inertia": 165.0})) == []


def test_the_tooth_damping_ratio_is_that_of_two_free_gears():
    """Damped modes of two free gears on their teeth have no other ratio."""
    pair = jaxhb.load_scene("spur_pair")
    damped = jaxhb.damped_modes(pair).damping_ratio
    np.testing.assert_allclose(jaxhb.tooth_damping_ratios(pair), damped[-1], rtol=1e-9)
    massless = pair.replace({"gear a.inertia": 0.0})
    assert np.isnan(jaxhb.tooth_damping_ratios(massless)).all()
    diesel = jaxhb.load_scene("six_cylinder_diesel")
    assert jaxhb.tooth_damping_ratios(diesel).shape == (0,)


def test_limits_of_propulsion_shafts_on_a_crank_are_noted(scene):
    steel = "diameter = 0.05\nstress_concentration = 1.0\ntensile_strength = 6e8\n"
    rated = ("[scene]\n", "[scene]\nrated_rpm = 4000\n")
    throws = 'between = ["throw 2", "throw 3"]\n'
    behind = 'between = ["throw 4", "flywheel primary"]\n'
    (note,) = scene(rated, (throws, f"{throws}{steel}"))
    sentence = "tensile_strength sets the limits of IACS UR M68, which do not hold"
    assert note.startswith(f"[[shaft]] 'throw 2|throw 3': {sentence}")
    assert scene(rated, (behind, f"{behind}{steel}")) == []
