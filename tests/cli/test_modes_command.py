"""``jaxhb modes``: tables and files, shapes along the train with its branches, teeth at the mean load of a speed."""

import json
import math

import numpy as np
import pytest
from strict_json import read

import jaxhb
from jaxhb.cli.main import main
from jaxhb.linear.damped import damping_ratios
from jaxhb.report.figures.modes import mode_nodes, plot_modes, train_lines

IDLE = """
[scene]
name = "idle"
reference = "a"
[[disk]]
name = "a"
inertia = 0.1
radius = 0.1
[[disk]]
name = "b"
inertia = 0.1
radius = 0.1
[[mesh]]
between = ["a", "b"]
stiffness = 1e8
backlash = 1e-4
[[torque]]
disk = "a"
mean = 0.2
[[load]]
disk = "b"
"""


def test_modes_are_those_of_python(capsys, tmp_path):
    file = tmp_path / "modes.json"
    assert main(["modes", "gear_train_30", "--json", str(file)]) == 0
    modes = jaxhb.natural_frequencies(jaxhb.load_scene("gear_train_30"))
    record = read(file)
    told = {"frequencies_hz", "mesh_energy_share", "modes", "kinds", "node_count", "generalised_mass", "damping_ratios"}
    assert set(record) == {"scenario", "set", "links_at", "viscous", "kinetic_share", "strain_share"} | told
    assert record["mesh_energy_share"] == modes.mesh_energy_share.tolist()
    assert record["frequencies_hz"] == modes.frequencies_hz.tolist()
    assert record["modes"]["crank gear"] == modes.shapes[:, modes.names.index("crank gear")].tolist()
    assert (
        record["strain_share"]["idler|cam gear A"]
        == modes.strain_share[:, modes.link_names.index("idler|cam gear A")].tolist()
    )
    assert f"{modes.frequencies_hz[1]:.2f}" in capsys.readouterr().out


def test_a_ring_without_stiffness_is_not_called_a_motion_of_all_disks(capsys):
    """A viscous damper's ring turns freely: its motion of 0 Hz is told apart from that of the train."""
    assert main(["modes", "engine_with_damper"]) == 0
    rows = capsys.readouterr().out.splitlines()[2:]
    said = [row.split(maxsplit=6)[-1] for row in rows[:2]]
    assert said == ["rigid-body mode", "ring only: viscous damper turns freely"]
    assert "rigid-body" not in rows[2]
    assert main(["modes", "gear_train_30"]) == 0
    assert capsys.readouterr().out.splitlines()[2].endswith("rigid-body mode on the ground's spring")


@pytest.mark.parametrize("name", ["gear_train_30", "engine_with_damper", "six_cylinder_diesel"])
def test_every_link_lies_on_one_line_and_branches_begin_on_earlier_lines(name):
    topology = jaxhb.load_scene(name).topology
    ways, seen = train_lines(topology), set()
    links = [tuple(sorted(pair)) for way in ways for pair in zip(way, way[1:], strict=False)]
    assert sorted(links) == sorted(tuple(sorted(ends)) for ends in topology.link_ends)
    for number, way in enumerate(ways):
        assert not number or way[0] in seen
        seen.update(way)


def test_a_link_that_closes_a_loop_is_a_line_of_its_own():
    parts = [jaxhb.Disk(name=name, inertia=1.0) for name in "abc"]
    parts += [jaxhb.Shaft(between=pair, stiffness=1e4) for pair in (("a", "b"), ("b", "c"), ("c", "a"))]
    ways = train_lines(jaxhb.build(parts).topology)
    assert [sorted(way) for way in ways[1:]] == [[0, 2]] and len(ways[0]) == 3


@pytest.mark.parametrize("name", ["gear_train_30", "engine_with_damper", "six_cylinder_diesel"])
def test_the_picture_marks_as_many_nodes_as_the_modes_have(name):
    train = jaxhb.load_scene(name)
    modes = jaxhb.natural_frequencies(train)
    ratios = damping_ratios(train, modes)
    figure = plot_modes(train, modes, [2, 3, 4, 5], ratios)
    for axes, k in zip(figure.axes, (2, 3, 4, 5), strict=True):
        (nodes,) = [line for line in axes.get_lines() if line.get_marker() == "x"]
        assert len(nodes.get_xdata()) == modes.node_count[k]
        (title,) = [text.get_text() for text in axes.texts]
        assert title == f"mode {k}: {modes.frequencies_hz[k]:.4g} Hz, damping ratio {ratios[k]:.3g}"


def test_a_disk_at_rest_between_two_that_move_against_each_other_is_one_node():
    assert mode_nodes([[0, 1, 2]], [0], np.array([1.0, 0.0, -1.0])) == [1.0]
    assert mode_nodes([[0, 1], [1, 2]], [0, 3], np.array([1.0, 0.0, -1.0])) == [1.0]
    assert mode_nodes([[0, 1, 2]], [0], np.array([1.0, 0.0, 0.0])) == []
    assert mode_nodes([[0, 1]], [0], np.array([1.0, -3.0])) == [0.25]


def test_angles_are_referred_to_the_reference_rotor_so_that_teeth_in_contact_do_not_jump():
    parts = [jaxhb.Disk(name="a", inertia=0.1, radius=0.1), jaxhb.Disk(name="b", inertia=0.1, radius=0.05)]
    parts += [jaxhb.Disk(name="c", inertia=1.0), jaxhb.Shaft(between=("b", "c"), stiffness=1e4)]
    train = jaxhb.build([*parts, jaxhb.Mesh(between=("a", "b"), stiffness=1e12)], reference="a")
    modes = jaxhb.natural_frequencies(train)
    (axes,) = plot_modes(train, modes, [1], np.full(3, np.nan)).axes
    a, b, c = axes.get_lines()[0].get_ydata()
    assert a == pytest.approx(b, rel=1e-6) and b * c < 0
    assert axes.texts[0].get_text() == f"mode 1: {modes.frequencies_hz[1]:.4g} Hz"


def test_the_damping_ratio_of_a_mode_is_that_of_two_disks_by_hand():
    parts = [jaxhb.Disk(name=name, inertia=2.0) for name in "ab"]
    train = jaxhb.build([*parts, jaxhb.Shaft(between=("a", "b"), stiffness=100.0, damping=2.0)])
    ratios = damping_ratios(train, jaxhb.natural_frequencies(train))
    assert math.isnan(ratios[0]) and ratios[1] == pytest.approx(0.1)


def test_at_a_speed_the_teeth_have_the_stiffness_of_their_mean_load(tmp_path, capsys):
    (tmp_path / "idle.toml").write_text(IDLE)
    files = ["--json", str(tmp_path / "m.json"), "--plot", str(tmp_path / "m.png")]
    assert main(["modes", str(tmp_path / "idle.toml"), "--at", "900", *files]) == 0
    said, record = capsys.readouterr().out, json.loads((tmp_path / "m.json").read_text())
    assert said.startswith("Natural frequencies of idle: undamped, teeth at the mean load of 900 rpm")
    assert said.splitlines()[-1] == "Mean load of 900 rpm: a|b 0.002 kN in the gap, 0.1 % of its stiffness."
    hz = math.sqrt(2 * 1e-3 * 1e8 * 0.1**2 / 0.1) / (2 * math.pi)
    assert record["frequencies_hz"] == pytest.approx([0.0, hz]) and record["at_rpm"] == 900.0
    mesh = record["mean_load"]["a|b"]
    assert mesh == {"force": pytest.approx(2.0), "stiffness": pytest.approx(1e5), "engagement": 0.0}
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")


def test_the_table_and_the_json_tell_nodes_damping_ratios_and_kinds(tmp_path, capsys):
    file = tmp_path / "m.json"
    assert main(["modes", "engine_with_damper", "--json", str(file)]) == 0
    train = jaxhb.load_scene("engine_with_damper")
    modes = jaxhb.natural_frequencies(train)
    ratios, record = damping_ratios(train, modes), json.loads(file.read_text())
    assert record["damping_ratios"] == [None, None, *ratios[2:]]
    assert record["node_count"] == modes.node_count.tolist()
    assert record["generalised_mass"] == modes.generalised_mass.tolist()
    assert record["kinds"][:3] == ["rigid", "ring only", "elastic"]
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[2:]]
    assert [row[4] for row in rows] == ["-", "-", *(f"{ratio:.4f}" for ratio in ratios[2:])]
    assert [row[3] for row in rows] == ["-", "-", *map(str, modes.node_count[2:])]


def test_an_order_tuned_ring_is_as_stiff_as_at_the_speed(tmp_path, capsys):
    text = IDLE + '[[damper]]\nname = "ring"\ndisk = "a"\ninertia = 0.01\norder = 2\n'
    (tmp_path / "ring.toml").write_text(text)
    assert main(["modes", str(tmp_path / "ring.toml")]) == 2
    assert "'ring' has order" in capsys.readouterr().err
    file = tmp_path / "m.json"
    assert main(["modes", str(tmp_path / "ring.toml"), "--at", "900", "--json", str(file)]) == 0
    train = jaxhb.load_scene(tmp_path / "ring.toml").with_constant_links(rpm=900.0).replace({"a|b.stiffness": 1e5})
    wanted = jaxhb.natural_frequencies(train).frequencies_hz
    assert json.loads(file.read_text())["frequencies_hz"] == pytest.approx(wanted.tolist())


def test_a_train_in_which_nothing_is_strained_has_no_shape_to_draw(tmp_path, capsys):
    (tmp_path / "one.toml").write_text('[[disk]]\nname = "hub"\ninertia = 1.0\n')
    assert main(["modes", str(tmp_path / "one.toml"), "--plot", str(tmp_path / "m.png")]) == 2
    assert "no mode strains a link" in capsys.readouterr().err and not (tmp_path / "m.png").exists()
    assert main(["modes", "spur_pair", "--at", "0"]) == 2


LOOP = """
[[disk]]
name = "a"
inertia = 1.0
[[disk]]
name = "b"
inertia = 2.0
[[disk]]
name = "c"
inertia = 3.0
[[shaft]]
between = ["a", "b"]
stiffness = 1e4
[[shaft]]
between = ["b", "c"]
stiffness = 2e4
[[shaft]]
between = ["c", "a"]
stiffness = 3e4
"""


def test_the_energies_of_a_looped_train_are_in_the_file_and_no_teeth_are_told(tmp_path, capsys):
    (tmp_path / "loop.toml").write_text(LOOP)
    assert main(["modes", str(tmp_path / "loop.toml"), "--json", str(tmp_path / "m.json")]) == 0
    said = capsys.readouterr().out
    assert "teeth" not in said
    record = json.loads((tmp_path / "m.json").read_text())
    shapes = np.array([record["modes"][name] for name in "abc"])
    kinetic = np.array([1.0, 2.0, 3.0])[:, None] * shapes**2
    found = np.array([record["kinetic_share"][name] for name in "abc"])
    np.testing.assert_allclose(found, kinetic / kinetic.sum(0), rtol=1e-12)
    twist = shapes - np.roll(shapes, -1, axis=0)
    strain = np.array([1e4, 2e4, 3e4])[:, None] * twist**2
    found = np.array([record["strain_share"][name] for name in ("a|b", "b|c", "c|a")])
    np.testing.assert_allclose(found[:, 1:], (strain / strain.sum(0))[:, 1:], rtol=1e-9)
    _, disks, links = said.split("\n\n")
    for table, head, shares in ((disks, "disk", kinetic), (links, "link", strain)):
        rows = [line.split() for line in table.splitlines()[1:]]
        assert rows[0] == [head, "mode", "1", "mode", "2"]
        printed = np.array([[float(cell) for cell in row[1:]] for row in rows[1:]])
        np.testing.assert_allclose(printed, 100 * (shares / shares.sum(0))[:, 1:], atol=0.0501)
    assert main(["modes", "engine_with_damper"]) == 0
    assert "energy of the first" not in capsys.readouterr().out


def test_campbell_and_holzer_take_the_teeth_at_a_mean_load_as_modes_does(tmp_path, capsys):
    (tmp_path / "idle.toml").write_text(IDLE.replace("mean = 0.2", "mean = 0.2\nharmonics = [[2, 1.0, 0.0]]"))
    scene, found = str(tmp_path / "idle.toml"), {}
    for command, more in (("modes", []), ("holzer", []), ("campbell", ["--rpm", "100:100000"])):
        file = tmp_path / f"{command}.json"
        assert main([command, scene, "--at", "1000", "--json", str(file), *more]) == 0
        said = capsys.readouterr().out
        assert "teeth at the mean load of 1000 rpm" in said and "Mean load of 1000 rpm: a|b" in said
        found[command] = json.loads(file.read_text())
    hz = found["modes"]["frequencies_hz"][1]
    assert found["modes"]["mean_load"] == found["holzer"]["mean_load"] == found["campbell"]["mean_load"]
    assert found["modes"]["mean_load"]["a|b"]["engagement"] < 1.0
    assert found["holzer"]["tables"][0]["hz"] == found["campbell"]["modes"][1]["frequencies_hz"][0] == hz
    assert found["campbell"]["critical_speeds"][0]["rpm"] == pytest.approx(30.0 * hz)
