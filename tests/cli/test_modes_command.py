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


def test_modes_are_those_of_python(run_once):
    completed = run_once("modes gear_train_30", "json")
    completed.check_printed("modes_gear_train")
    modes = jaxhb.natural_frequencies(jaxhb.load_scene("gear_train_30"))
    record = completed.json
    assert set(record) == {
        "damping_ratios",
        "frequencies_hz",
        "generalised_mass",
        "kinds",
        "kinetic_share",
        "links_at",
        "mesh_energy_share",
        "modes",
        "node_count",
        "notes",
        "scenario",
        "set",
        "strain_share",
        "viscous",
    }
    assert record == record | {
        "notes": [],
        "mesh_energy_share": modes.mesh_energy_share.tolist(),
        "frequencies_hz": modes.frequencies_hz.tolist(),
        "node_count": modes.node_count.tolist(),
        "generalised_mass": modes.generalised_mass.tolist(),
    }
    shape = modes.shapes[:, modes.names.index("crank gear")]
    assert record["modes"]["crank gear"] == shape.tolist()
    link = "idler|cam gear A"
    share = modes.strain_share[:, modes.link_names.index(link)]
    assert record["strain_share"][link] == share.tolist()
    assert f"{modes.frequencies_hz[1]:.2f}" in completed.out


def test_the_table_and_the_json_tell_nodes_damping_ratios_and_kinds(run_once):
    """A viscous damper's ring turns freely: its motion of 0 Hz is told apart from that
    of the train.
    """
    completed = run_once("modes engine_with_damper", "json")
    completed.check_printed("modes_engine_with_damper")
    train = jaxhb.load_scene("engine_with_damper")
    modes = jaxhb.natural_frequencies(train)
    ratios = damping_ratios(train, modes)[2:]
    record = completed.json
    assert record["damping_ratios"] == [None, None, *ratios]
    assert record["kinds"][:3] == ["rigid", "ring only", "elastic"]
    rows = [line.split(maxsplit=6) for line in completed.out.splitlines()[2:]]
    assert [row[4] for row in rows[2:]] == [f"{ratio:.4f}" for ratio in ratios]
    assert [row[3] for row in rows[2:]] == [str(n) for n in modes.node_count[2:]]


def test_modes_campbell_and_holzer_take_the_teeth_at_the_mean_load_of_a_speed(
    tmp_path, run
):
    (tmp_path / "idle.toml").write_text(IDLE)
    records = []
    for command in ("modes", "holzer", "campbell --rpm 100:100000"):
        completed = run(f"{command} {tmp_path / 'idle.toml'} --at 900", "json", "plot")
        completed.check_printed(f"{command.split()[0]}_at_mean_load")
        records.append(completed.json)
    modes, holzer, campbell = records
    hz = math.sqrt(2 * 1e-3 * 1e8 * 0.1**2 / 0.1) / (2 * math.pi)
    assert modes["frequencies_hz"] == pytest.approx([0.0, hz])
    assert modes["at_rpm"] == 900.0
    mesh = {"force": 2.0, "stiffness": 1e5, "engagement": 0.0}
    assert modes["mean_load"] == {"a|b": pytest.approx(mesh)}
    assert modes["mean_load"] == holzer["mean_load"] == campbell["mean_load"]
    hz = modes["frequencies_hz"][1]
    assert holzer["tables"][0]["hz"] == campbell["modes"][1]["frequencies_hz"][0] == hz
    assert campbell["critical_speeds"][0]["rpm"] == pytest.approx(30.0 * hz)


def test_an_order_tuned_ring_is_as_stiff_as_at_the_speed(tmp_path, run):
    scene = tmp_path / "ring.toml"
    scene.write_text(
        IDLE + '[[damper]]\nname = "ring"\ndisk = "a"\ninertia = 0.01\norder = 2\n'
    )
    assert "'ring' has order" in run(f"modes {scene}", status=2).err
    train = (
        jaxhb.load_scene(scene)
        .with_constant_links(rpm=900.0)
        .replace({"a|b.stiffness": 1e5})
    )
    expected = jaxhb.natural_frequencies(train).frequencies_hz.tolist()
    record = run(f"modes {scene} --at 900", "json").json
    assert record["frequencies_hz"] == pytest.approx(expected)


def test_a_train_in_which_nothing_is_strained_has_no_shape_to_draw(tmp_path, run):
    (tmp_path / "one.toml").write_text('[[disk]]\nname = "hub"\ninertia = 1.0\n')
    completed = run(f"modes {tmp_path / 'one.toml'}", "plot", status=2)
    assert "no mode strains a link" in completed.err
    assert not completed.path("plot").exists()


def test_the_energies_of_a_looped_train_are_in_the_file_and_no_teeth_are_told(
    tmp_path, run
):
    parts = [
        jaxhb.Disk(name="a", inertia=1.0),
        jaxhb.Disk(name="b", inertia=2.0),
        jaxhb.Disk(name="c", inertia=3.0),
        jaxhb.Shaft(between=("a", "b"), stiffness=1e4),
        jaxhb.Shaft(between=("b", "c"), stiffness=2e4),
        jaxhb.Shaft(between=("c", "a"), stiffness=3e4),
    ]
    (tmp_path / "loop.toml").write_text(jaxhb.elements_text(parts, name="loop"))
    completed = run(f"modes {tmp_path / 'loop.toml'}", "json")
    completed.check_printed("modes_loop")
    record = completed.json
    shapes = np.array([record["modes"][name] for name in "abc"])
    kinetic = np.array([1.0, 2.0, 3.0])[:, None] * shapes**2
    shares = [record["kinetic_share"][name] for name in "abc"]
    np.testing.assert_allclose(shares, kinetic / kinetic.sum(0), rtol=1e-12)
    twists = shapes - np.roll(shapes, -1, axis=0)
    strain = np.array([1e4, 2e4, 3e4])[:, None] * twists**2
    shares = np.array([record["strain_share"][name] for name in ("a|b", "b|c", "c|a")])
    expected = (strain / strain.sum(0))[:, 1:]
    np.testing.assert_allclose(shares[:, 1:], expected, rtol=1e-9)
    _, disks, links = completed.out.split("\n\n")
    for table, head, energies in ((disks, "disk", kinetic), (links, "link", strain)):
        heads, *rows = [line.split() for line in table.splitlines()[1:]]
        assert heads == [head, "mode", "1", "mode", "2"]
        printed = [[float(cell) for cell in row[1:]] for row in rows]
        expected = 100 * (energies / energies.sum(0))[:, 1:]
        np.testing.assert_allclose(printed, expected, atol=0.0501)


def test_vector_sums_stand_beside_the_modes(tmp_path, monkeypatch, run):
    """Files have every mode that strains a link."""
    monkeypatch.chdir(tmp_path)
    completed = run("modes six_cylinder_diesel --vector-sums --csv sums.csv", "json")
    completed.check_printed("modes_vector_sums")
    train = jaxhb.load_scene("six_cylinder_diesel")
    modes = jaxhb.natural_frequencies(train)
    sums = jaxhb.vector_sums(train, modes=modes, numbers=range(1, 9))
    record = completed.json["vector_sums"]
    assert record["modes"] == list(range(1, 9))
    np.testing.assert_array_equal(
        record["mode_sums"]["magnitude"], np.abs(sums.mode_sums)
    )
    rows = (tmp_path / "sums.csv").read_text().splitlines()
    assert rows[0].startswith("order,sum,sum deg,mode 1 sum,mode 1 deg,mode 2 sum")
    assert len(rows) == 1 + len(sums.orders)
