"""Packaged scenes against the reference data."""

import numpy as np
from reference_data import reference

from jaxhb import linear_response, natural_frequencies
from jaxhb.scene.files import load_scene, scene_description, scene_names
from jaxhb.train.excitation import excitation, highest_harmonic
from jaxhb.train.kinematics import inertias


def test_every_packaged_scene_loads_and_has_a_description():
    assert scene_names() == [
        "engine_with_damper",
        "first_scene",
        "gear_train_30",
        "inline_four_timing_drive",
        "six_cylinder_diesel",
        "spur_pair",
    ]
    for name in scene_names():
        assert load_scene(name).topology.name == name
        assert scene_description(name)


def test_gear_train_30_is_its_specification():
    spec = reference("gear_train_30")
    train = load_scene("gear_train_30")
    t = train.topology
    ring = {9: "crank damper", 17: "cam damper B", 30: "cam damper A"}
    name = {d["node"]: ring.get(d["node"], d["name"]) for d in spec["disks"]}
    assert list(t.disk_names[:24]) == [
        d["name"] for d in spec["disks"] if d["node"] not in ring
    ]
    inertia = dict(zip(t.disk_names, np.asarray(inertias(train)), strict=True))
    assert inertia == {name[d["node"]]: d["inertia_kgm2"] for d in spec["disks"]}
    links = {}
    for table, names in (
        (train.shafts, t.shaft_names),
        (train.dampers, t.damper_names),
    ):
        ends = dict(zip(t.link_names, t.link_ends, strict=True))
        for link, k, r in zip(names, table.stiffness, table.damping, strict=True):
            links[frozenset(t.disk_names[d] for d in ends[link])] = (k, r)
    values = {
        tuple(s["between"]): (s["stiffness_Nm_rad"], s["damping_Nms_rad"])
        for s in spec["shafts"]
    }
    assert links == {
        frozenset(name[n] for n in between): numbers
        for between, numbers in values.items()
    }
    assert t.mesh_names == tuple(
        f"{name[m['driver']]}|{name[m['driven']]}" for m in spec["meshes"]
    )
    np.testing.assert_array_equal(
        train.meshes.damping, [m["damping_N_s_m"] for m in spec["meshes"]]
    )
    assert set(t.mesh_damping_law) == {"always"}
    assert t.ground_disk == (t.disk_index("cam gear A"),)


def test_scenes_have_the_natural_frequencies_of_the_reference():
    published = reference("gear_train_30")[
        "natural_frequencies_hz_meshes_in_contact_no_ground"
    ]
    frequencies = natural_frequencies(load_scene("gear_train_30")).frequencies_hz
    np.testing.assert_allclose(frequencies[1:], published[1:], atol=0.051)
    frequencies = natural_frequencies(load_scene("six_cylinder_diesel")).frequencies_hz
    np.testing.assert_allclose(
        frequencies[1:],
        reference("six_cylinder_diesel_2008")["undamped_Hz"][1:],
        rtol=1e-9,
    )


def test_valve_torques_follow_the_firing_of_their_cylinder():
    spec = reference("gear_train_30")["excitation"]
    train = load_scene("gear_train_30")
    torque, _, _ = excitation(train, 2000.0, 24)
    for bank, later in (("A", 0.0), ("B", 90.0)):
        for k, angle in enumerate(spec["firing_deg_crank"]["bank A, throw 1..5"]):
            disk = train.topology.disk_index(f"cam {bank}{k + 1}")
            for order, re, im in spec["cam_section"]["harmonics_order_re_im_Nm"]:
                turn = np.exp(-1j * order * np.deg2rad(angle + later))
                expected = 0.5 * complex(re, im) * turn
                assert abs(torque[disk, round(2 * order)] - expected) < 1e-12


def test_six_cylinder_diesel_has_the_torque_harmonics_and_mean_of_the_reference():
    spec = reference("six_cylinder_diesel_2008")
    train = load_scene("six_cylinder_diesel")
    published = spec["cyl_torque_harmonics_2200rpm_exact_orders"]
    torque, _, _ = excitation(train, 2200.0, 24)
    order = np.array(published["order"])
    expected = (
        np.array(published["re_im_Nm"]) @ [1, 1j] * np.exp(1j * order * 2 * np.pi)
    )
    slots = spec["engine"]["firing_order_slots_by_cylinder"]
    for k, slot in enumerate(slots):
        row = np.asarray(torque[train.topology.disk_index(f"cyl{k + 1}")])
        np.testing.assert_allclose(row[0].real, published["mean_Nm"], rtol=1e-12)
        later = np.exp(-1j * order * slot * 2 * np.pi / 3)
        np.testing.assert_allclose(2 * row[1:], expected * later, atol=1e-10)


def test_spur_pair_is_the_oscillator_of_the_reference_while_in_contact():
    form = reference("backlash_one_mass_exact")["kahraman_singh_form"]
    train = load_scene("spur_pair")
    half = train.value("gear a|gear b.backlash") / 2
    assert highest_harmonic(train) == 1
    for row in form["rows"][:5]:
        response = linear_response(train, rpm=row["Omega"] * 3000 * 60 / 32)
        deflection = response.deflection("gear a", "gear b")
        assert abs(deflection.amplitudes[0] / half - row["amp_h"][0]) < 1e-8
        assert abs(1 + deflection.mean / half - row["mean"]) < 1e-12
