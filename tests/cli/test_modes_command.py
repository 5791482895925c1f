"""``jaxhb modes``: tables and files, shapes along the train with its branches, teeth at
the mean load of a speed.
"""

import math

import numpy as np
import pytest
from reference_data import text_of

import jaxhb
from jaxhb.linear.damped import damping_ratios

IDLE = text_of("idle.toml")


def test_modes_are_those_of_python(told):
    called = told("modes gear_train_30", "json")
    modes = jaxhb.natural_frequencies(jaxhb.load_scene("gear_train_30"))
    record = called.json
    link = "idler|cam gear A"
    keys = {
        "frequencies_hz",
        "mesh_energy_share",
        "modes",
        "kinds",
        "node_count",
        "generalised_mass",
        "damping_ratios",
    }
    keys |= {
        "scenario",
        "set",
        "links_at",
        "viscous",
        "kinetic_share",
        "strain_share",
        "notes",
    }
    assert set(record) == keys and record["notes"] == []
    for name in (
        "mesh_energy_share",
        "frequencies_hz",
        "node_count",
        "generalised_mass",
    ):
        assert record[name] == getattr(modes, name).tolist()
    assert (
        record["modes"]["crank gear"]
        == modes.shapes[:, modes.names.index("crank gear")].tolist()
    )
    assert (
        record["strain_share"][link]
        == modes.strain_share[:, modes.link_names.index(link)].tolist()
    )
    assert f"{modes.frequencies_hz[1]:.2f}" in called.out
    assert called.out.splitlines()[2].endswith("rigid-body mode on the ground's spring")


def test_the_table_and_the_json_tell_nodes_damping_ratios_and_kinds(told):
    """A viscous damper's ring turns freely: its motion of 0 Hz is told apart from that
    of the train.
    """
    called = told("modes engine_with_damper", "json")
    train = jaxhb.load_scene("engine_with_damper")
    modes = jaxhb.natural_frequencies(train)
    ratios = damping_ratios(train, modes)
    record = called.json
    assert record["damping_ratios"] == [None, None, *ratios[2:]]
    assert record["kinds"][:3] == ["rigid", "ring only", "elastic"]
    rows = [line.split(maxsplit=6) for line in called.out.splitlines()[2:]]
    assert [row[4] for row in rows] == [
        "-",
        "-",
        *(f"{ratio:.4f}" for ratio in ratios[2:]),
    ]
    assert [row[3] for row in rows] == ["-", "-", *map(str, modes.node_count[2:])]
    assert [row[-1] for row in rows[:2]] == [
        "rigid-body mode",
        "ring only: viscous damper turns freely",
    ]
    assert (
        "rigid-body" not in called.out.splitlines()[4]
        and "energy of the first" not in called.out
    )


LOOP = [
    jaxhb.Disk(name=name, inertia=k) for k, name in ((1.0, "a"), (2.0, "b"), (3.0, "c"))
]
LOOP += [
    jaxhb.Shaft(between=b, stiffness=k)
    for k, b in ((1e4, ("a", "b")), (2e4, ("b", "c")), (3e4, ("c", "a")))
]


def test_modes_campbell_and_holzer_take_the_teeth_at_the_mean_load_of_a_speed(
    tmp_path, run
):
    (tmp_path / "idle.toml").write_text(IDLE)
    found = []
    for command in ("modes", "holzer", "campbell --rpm 100:100000"):
        called = run(f"{command} {tmp_path / 'idle.toml'} --at 900", "json", "plot")
        assert "mean load" in called.words and called.is_drawn
        last = called.out.splitlines()[-1]
        assert (
            last
            == "Mean load of 900 rpm: a|b 0.002 kN in the gap, 0.1 % of its stiffness."
        )
        found.append(called.json)
    modes, holzer, campbell = found
    hz = math.sqrt(2 * 1e-3 * 1e8 * 0.1**2 / 0.1) / (2 * math.pi)
    assert (
        modes["frequencies_hz"] == pytest.approx([0.0, hz]) and modes["at_rpm"] == 900.0
    )
    mesh = {
        "force": pytest.approx(2.0),
        "stiffness": pytest.approx(1e5),
        "engagement": 0.0,
    }
    assert (
        modes["mean_load"]
        == holzer["mean_load"]
        == campbell["mean_load"]
        == {"a|b": mesh}
    )
    hz = modes["frequencies_hz"][1]
    assert holzer["tables"][0]["hz"] == campbell["modes"][1]["frequencies_hz"][0] == hz
    assert campbell["critical_speeds"][0]["rpm"] == pytest.approx(30.0 * hz)


def test_an_order_tuned_ring_is_as_stiff_as_at_the_speed(tmp_path, run):
    scene = tmp_path / "ring.toml"
    scene.write_text(
        IDLE + '[[damper]]\nname = "ring"\ndisk = "a"\ninertia = 0.01\norder = 2\n'
    )
    called = run(f"modes {scene}")
    assert called.status == 2 and "'ring' has order" in called.err
    train = (
        jaxhb.load_scene(scene)
        .with_constant_links(rpm=900.0)
        .replace({"a|b.stiffness": 1e5})
    )
    wanted = jaxhb.natural_frequencies(train).frequencies_hz
    assert run(f"modes {scene} --at 900", "json").json[
        "frequencies_hz"
    ] == pytest.approx(wanted.tolist())


def test_a_train_in_which_nothing_is_strained_has_no_shape_to_draw(tmp_path, run):
    (tmp_path / "one.toml").write_text('[[disk]]\nname = "hub"\ninertia = 1.0\n')
    called = run(f"modes {tmp_path / 'one.toml'}", "plot")
    assert (
        called.status == 2
        and "no mode strains a link" in called.err
        and not called.path("plot").exists()
    )


def test_the_energies_of_a_looped_train_are_in_the_file_and_no_teeth_are_told(
    tmp_path, run
):
    (tmp_path / "loop.toml").write_text(jaxhb.elements_text(LOOP, name="loop"))
    called = run(f"modes {tmp_path / 'loop.toml'}", "json")
    record = called.json
    shapes = np.array([record["modes"][name] for name in "abc"])
    kinetic = np.array([1.0, 2.0, 3.0])[:, None] * shapes**2
    found = np.array([record["kinetic_share"][name] for name in "abc"])
    np.testing.assert_allclose(found, kinetic / kinetic.sum(0), rtol=1e-12)
    strain = (
        np.array([1e4, 2e4, 3e4])[:, None] * (shapes - np.roll(shapes, -1, axis=0)) ** 2
    )
    found = np.array([record["strain_share"][name] for name in ("a|b", "b|c", "c|a")])
    np.testing.assert_allclose(found[:, 1:], (strain / strain.sum(0))[:, 1:], rtol=1e-9)
    assert "teeth" not in called.out
    _, disks, links = called.out.split("\n\n")
    for table, head, shares in ((disks, "disk", kinetic), (links, "link", strain)):
        rows = [line.split() for line in table.splitlines()[1:]]
        assert rows[0] == [head, "mode", "1", "mode", "2"]
        printed = np.array([[float(cell) for cell in row[1:]] for row in rows[1:]])
        np.testing.assert_allclose(
            printed, 100 * (shares / shares.sum(0))[:, 1:], atol=0.0501
        )
