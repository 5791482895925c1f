"""``jaxhb forced``: the same numbers as from Python, in tables, files and a picture; bad input in sentences."""

import csv
import json

import numpy as np
import pytest

import jaxhb
from jaxhb.cli.main import main
from jaxhb.report.figures.figure import DIGITS
from jaxhb.report.figures.forced import plot_forced
from jaxhb.report.text.forced import SHOWN, forced_rows, readings
from jaxhb.scene.writer import changed_scene

SPEEDS = "800:2400:5"
SHAFT, MESH, DAMPER = "throw 2|throw 1", "crank gear|idler", "crank damper"


@pytest.fixture(scope="module")
def response():
    return jaxhb.forced_response(jaxhb.load_scene("gear_train_30"), rpm=np.linspace(800.0, 2400.0, 5))


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    folder = tmp_path_factory.mktemp("forced")
    files = [f"--{kind}={folder / f'r.{end}'}" for kind, end in (("json", "json"), ("csv", "csv"), ("plot", "png"))]
    assert main(["forced", "gear_train_30", "--rpm", SPEEDS, *files]) == 0
    return folder


def test_the_json_holds_every_element_in_full_precision(answer, response):
    record = json.loads((answer / "r.json").read_text())
    topology = response.topology
    assert list(record["disks"]) == list(topology.disk_names)
    assert list(record["shafts"]) == [*topology.shaft_names, *topology.damper_names]
    assert list(record["meshes"]) == list(topology.mesh_names)
    assert record["rpm"] == response.rpm.tolist() and record["status"] == ["CONVERGED"] * 5
    assert record["orders"] == [k / 2 for k in range(1, 25)]
    assert record["input_power_W"] == response.input_power.tolist()
    for kind, name, signal in (
        ("shafts", SHAFT, response.torque(SHAFT)),
        ("shafts", DAMPER, response.torque(DAMPER)),
        ("meshes", MESH, response.force(MESH)),
        ("disks", DAMPER, response.disk(DAMPER)),
    ):
        found = record[kind][name]
        for quantity in ("half_peak_to_peak", "sum_of_amplitudes", "amplitudes", "phases_deg", "mean"):
            assert found[quantity] == getattr(signal, quantity).tolist()
        assert ("elastic" in found) == (kind != "disks")
    heat = sum(np.array(r["power_W"]) for kind in ("disks", "shafts", "meshes") for r in record[kind].values())
    np.testing.assert_allclose(heat, record["input_power_W"], rtol=1e-10)


def test_the_csv_has_one_row_for_each_speed(answer, response):
    with (answer / "r.csv").open() as text:
        rows = list(csv.DictReader(text))
    assert [float(row["rpm"]) for row in rows] == response.rpm.tolist()
    found = [float(row[f"{SHAFT} order 2.5 N m"]) for row in rows]
    assert found == response.torque(SHAFT).order(2.5).tolist()
    assert float(rows[3][f"{DAMPER} angle half peak-to-peak rad"]) == response.disk(DAMPER).half_peak_to_peak[3]
    assert float(rows[3][f"{MESH} heat W"]) == response.power(MESH)[3]


def test_the_heads_of_the_csv_are_unique(response):
    heads, _ = forced_rows(response, readings(response))
    assert len(set(heads)) == len(heads)


def test_the_picture_shows_the_hardest_shaft_and_mesh_or_those_asked_for(answer, response):
    assert (answer / "r.png").read_bytes().startswith(b"\x89PNG")
    figure = plot_forced(response, readings(response))
    assert len(figure.axes) == 2
    found = readings(response, [SHAFT, "flywheel", MESH])
    figure = plot_forced(response, found)
    drawn = [axes.get_lines()[0].get_ydata() for axes in figure.axes]
    swings = (response.torque(SHAFT), response.disk("flywheel"), response.force(MESH))
    for line, signal, factor in zip(drawn, swings, (1.0, 180 / np.pi, 1e-3), strict=True):
        np.testing.assert_allclose(line, factor * signal.half_peak_to_peak, rtol=0.5 * 10 ** (1 - DIGITS))


def test_without_elements_the_table_tells_the_largest_values_of_all(response, capsys):
    assert main(["forced", "gear_train_30", "--rpm", SPEEDS]) == 0
    said = capsys.readouterr().out
    for title in ("angle of disks, deg", "torque of shafts and dampers, N m", "tooth force, kN"):
        assert title in said
    (row,) = [line.split() for line in said.splitlines() if line.strip().startswith(MESH)]
    force = response.force(MESH).half_peak_to_peak / 1e3
    assert float(row[2]) == pytest.approx(force.max(), abs=0.006)
    assert float(row[3]) == response.rpm[force.argmax()]


def test_an_element_is_told_speed_by_speed_with_its_main_orders(response, capsys):
    assert main(["forced", "gear_train_30", "--rpm", SPEEDS, "--element", SHAFT, "--element", "flywheel"]) == 0
    said = capsys.readouterr().out
    table = said[said.index(SHAFT) :].split("\n\n")[0].splitlines()
    assert len(table) == 2 + 5 and table[1].count("order") == SHOWN and "18 smaller orders are left out" in table[0]
    signal = response.torque(SHAFT)
    half, total = (float(word) for word in table[4].split()[1:3])
    assert half == pytest.approx(signal.half_peak_to_peak[2], abs=0.6)
    assert total == pytest.approx(signal.sum_of_amplitudes[2], abs=0.6)
    assert "flywheel, deg" in said and MESH not in said


def test_unknown_elements_are_bad_input_all_at_once(capsys):
    call = ["forced", "gear_train_30", "--rpm", "900,1000", "--element", "flywhel", "--element", "hubb"]
    assert main(call) == 2
    said = capsys.readouterr().err
    assert "there is no disk, shaft, damper or mesh 'flywhel'. Did you mean 'flywheel'?" in said and "'hubb'" in said


SCENE = """
[scene]
name = "soft"
revolutions_per_cycle = 1
[[disk]]
name = "a"
inertia = 2.0
[[disk]]
name = "b"
inertia = 2.0
[[shaft]]
name = "coupling"
between = ["a", "b"]
stiffness = 100.0
over_hz = "stiffness.csv"
[[torque]]
disk = "a"
harmonics = [[1, 10.0, 0.0]]
[scenario.hot]
coupling.stiffness = 64.0
"""


@pytest.fixture
def soft(tmp_path):
    (tmp_path / "soft.toml").write_text(SCENE)
    (tmp_path / "stiffness.csv").write_text("# hz, stiffness, damping\n0, 1, 1\n100, 1, 1\n")
    return str(tmp_path / "soft.toml")


def test_a_train_that_nothing_excites_rests(tmp_path, capsys):
    (tmp_path / "one.toml").write_text('[[disk]]\nname = "hub"\ninertia = 1.0\ndamping = 1.0\n')
    files = ["--csv", str(tmp_path / "r.csv"), "--plot", str(tmp_path / "r.png")]
    assert main(["forced", str(tmp_path / "one.toml"), "--rpm", "1000", *files]) == 0
    *_, row, _, said = capsys.readouterr().out.splitlines()
    assert row.split() == ["hub", "0", "-", "0", "-", "-", "0", "-", "0"]
    assert said.startswith("Nothing excites the train.")


def test_a_scenario_is_taken_and_noted(soft, tmp_path):
    file, rpm = tmp_path / "r.json", 2.5 * 30 / np.pi
    found = []
    for options in ([], ["--scenario", "hot"]):
        assert main(["forced", soft, "--rpm", str(rpm), "--json", str(file), *options]) == 0
        record = json.loads(file.read_text())
        found.append(record["shafts"]["coupling"]["amplitudes"][0][0])
        assert record["scenario"] == (options or [None])[-1]
    wanted = [5.0 * k / (k - 2.5**2) for k in (100.0, 64.0)]  # of 10 N m on two equal disks
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_a_scene_written_anew_keeps_tables_and_scenarios(soft, tmp_path):
    text, beside = changed_scene(soft, {("shaft", 0, "stiffness"): 90.0})
    (tmp_path / "again.toml").write_text(text)
    again, before = (jaxhb.load_scene(tmp_path / name) for name in ("again.toml", "soft.toml"))
    assert again.topology == before.topology and list(beside) == ["stiffness.csv"]
    assert again.value("coupling.stiffness") == 90.0
    assert again.scenario("hot").value("coupling.stiffness") == 64.0
    np.testing.assert_array_equal(again.shafts.over_hz, before.shafts.over_hz)


def test_a_resonance_without_damping_exits_1_with_its_speed(soft, capsys):
    at = repr(10 * 30 / np.pi)
    assert main(["forced", soft, "--rpm", f"50,{at}", "--element", "coupling"]) == 1
    assert "soft at 95.493 rpm: NEAR_SINGULAR: the equations are singular here" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["modes"], ["solve", "--rpm", "50"], ["sweep", "--rpm", "50,60"]])
def test_other_commands_refuse_links_that_vary_by_name(soft, command, capsys):
    assert main([command[0], soft, *command[1:]]) == 2
    assert "soft: 'coupling' has over_hz, which only the forced response takes" in capsys.readouterr().err
    assert main([command[0], soft, *command[1:], "--links-at", "hz=50"]) == 0
    assert main([command[0], soft, *command[1:], "--links-at", "Hz=50"]) == 2
    assert "'Hz=50' is none of hz=VALUE" in capsys.readouterr().err


def test_what_was_changed_is_told_below_the_tables_and_a_misfire_above_them_too(capsys):
    command = ["forced", "six_cylinder_diesel", "--rpm", "900", "--set", "pulley.inertia=0.02"]
    assert main([*command, "--misfire", "cylinder 2"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("six_cylinder_diesel, cylinder 2 not firing: linear forced response")
    assert said.endswith("\n\nAsked with --set 'pulley.inertia=0.02', --misfire 'cylinder 2'.\n")
    assert main(command[:4]) == 0
    said = capsys.readouterr().out
    assert "Asked with" not in said and said.startswith("six_cylinder_diesel: linear")


def test_an_unknown_scenario_is_bad_input(soft, capsys):
    assert main(["forced", soft, "--rpm", "50", "--scenario", "hott"]) == 2
    assert "there is no scenario 'hott'. Did you mean 'hot'?" in capsys.readouterr().err


def test_the_misfire_of_each_is_that_of_report_forced_and_campbell(capsys):
    for command, rpm in (("sweep", "900:1000:2"), ("solve", "900")):
        assert main([command, "six_cylinder_diesel", "--rpm", rpm, "--misfire", "each"]) == 2
        said = capsys.readouterr().err
        assert "only jaxhb report, forced and campbell take every cylinder in turn" in said


DIESEL, NAMED = "six_cylinder_diesel", "cyl6|flywheel"


def test_the_worst_of_all_misfires_is_that_of_python(tmp_path, capsys):
    files = [f"--{kind}={tmp_path / f'r.{end}'}" for kind, end in (("json", "json"), ("csv", "csv"), ("plot", "png"))]
    assert main(["forced", DIESEL, "--rpm", "1800:2400:4", "--misfire", "each", *files]) == 0
    said, record = capsys.readouterr().out, json.loads((tmp_path / "r.json").read_text())
    rpm = np.linspace(1800.0, 2400.0, 4)
    train = jaxhb.load_scene(DIESEL)
    misfires = jaxhb.misfire_each(train, rpm=rpm, solve=jaxhb.forced_response)
    worst = misfires.worst(lambda r: r.torque(NAMED).half_peak_to_peak)
    assert record["worst_misfires"][NAMED] == {
        "cylinder": worst.cylinder,
        "rpm": worst.rpm,
        "quantity": "torque",
        "unit": "N m",
        "value": worst.value,
        "firing": worst.firing,
    }
    values = {name: record["worst_misfires"][name]["value"] for name in train.topology.shaft_names}
    hardest = record["worst_misfire"]
    assert hardest["of"] == max(values, key=values.get) and hardest["value"] == max(values.values())
    assert f"The worst misfire is that of {hardest['cylinder']}: torque of {hardest['value']:.4g} N m" in said
    assert list(record["misfires"]) == list(train.topology.cylinder_names)
    alone = jaxhb.forced_response(train.misfire("cylinder 2"), rpm=rpm).torque(NAMED)
    found = record["misfires"]["cylinder 2"]["shafts"][NAMED]
    np.testing.assert_allclose(found["half_peak_to_peak"], alone.half_peak_to_peak, rtol=1e-12)
    with (tmp_path / "r.csv").open() as text:
        rows = list(csv.DictReader(text))
    assert [row["misfire"] for row in rows[::4]] == ["", *train.topology.cylinder_names]
    assert [float(row[f"{NAMED} half peak-to-peak N m"]) for row in rows[8:12]] == found["half_peak_to_peak"]
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")


def test_of_an_element_every_misfire_is_listed(capsys):
    call = ["forced", DIESEL, "--rpm", "1800:2400:4", "--misfire", "each", "--element", NAMED, "--element", "flywheel"]
    assert main(call) == 0
    said = capsys.readouterr().out
    assert said.count("The worst misfire is that of") == 2
    assert said.count("cylinder 4 not firing") == 2 and "cyl1|cyl2" not in said


def test_each_stands_alone_and_needs_a_cylinder(capsys):
    for command in ("forced", "campbell"):
        call = [command, DIESEL, "--rpm", "900:1000:2", "--misfire", "each", "--misfire", "cylinder 1"]
        assert main(call) == 2
        assert "Leave out the other --misfire." in capsys.readouterr().err
        assert main([command, "spur_pair", "--rpm", "900:1000:2", "--misfire", "each"]) == 2
        assert "no cylinder" in capsys.readouterr().err


RESONANCE = """
[scene]
name = "free"
[[disk]]
name = "a"
inertia = 2.0
[[disk]]
name = "b"
inertia = 2.0
[[shaft]]
between = ["a", "b"]
stiffness = 100.0
[[load]]
disk = "b"
"""
CYLINDER = """
[[cylinder]]
name = "NAME"
disk = "DISK"
bore = 0.1
stroke = 0.1
rod = 0.2
reciprocating_mass = 1.0
firing_angle = 0.0
gas_torque_mean = 10.0
gas_torque = [[1.0, 5.0, 4.0]]
"""


def test_speeds_without_an_answer_have_no_worst_misfire(tmp_path, capsys):
    cylinders = [CYLINDER.replace("NAME", name).replace("DISK", disk) for name, disk in (("one", "a"), ("two", "b"))]
    (tmp_path / "free.toml").write_text(RESONANCE + "".join(cylinders))
    at, file = repr(10 * 30 / np.pi), tmp_path / "r.json"
    call = ["forced", str(tmp_path / "free.toml"), "--misfire", "each", "--json", str(file), "--rpm"]
    assert main([*call, f"50,{at}"]) == 1
    said = capsys.readouterr()
    assert json.loads(file.read_text())["worst_misfire"]["rpm"] == 50.0
    assert "free, one not firing, at 95.493 rpm: NEAR_SINGULAR" in said.err
    assert main([*call, at]) == 1
    said = capsys.readouterr()
    assert "worst misfire" not in said.out and "worst_misfire" not in json.loads(file.read_text())
    assert said.err.count("NEAR_SINGULAR") == 2  # with both firing the torques of both disks cancel
