"""Limits in what the commands print and write: forced, solve, sweep, report, tune; nothing where a scene has none."""

import csv
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

import jaxhb
from jaxhb.show.cli import main
from jaxhb.show.compute import Asked, answer_speeds
from jaxhb.show.forced import readings
from jaxhb.show.forced_misfires import worst_of
from jaxhb.show.forced_plots import plot_forced
from jaxhb.show.limit_plots import judged_elements
from jaxhb.show.strength import AID
from jaxhb.show.sweep_plots import plot_sweep

SCENE = """
[scene]
name = "line"
reference = "engine"
rated_rpm = 900
[[disk]]
name = "engine"
inertia = 20.0
damping = 2.0
[[disk]]
name = "pinion"
inertia = 1.0
radius = 0.1
[[disk]]
name = "wheel"
inertia = 8.0
radius = 0.3
[[disk]]
name = "propeller"
inertia = 90.0
damping = 20.0
[[shaft]]
name = "coupling"
between = ["engine", "pinion"]
stiffness = 1e5
magnifier = 12
damping_hz = 15
power_limit = 300
[[shaft]]
name = "line shaft"
between = ["wheel", "propeller"]
length = 3.0
outer = 0.11
shear_modulus = 8e10
damping_ratio = 0.01
damping_hz = 15
stress_concentration = 0.45
tensile_strength = 5e8
[[mesh]]
between = ["pinion", "wheel"]
stiffness = 5e8
damping = 2e4
rated_torque = 1500
[[damper]]
name = "ring"
disk = "engine"
inertia = 3.0
damping = 100.0
power_limit = 40
[[load]]
disk = "propeller"
[[torque]]
disk = "engine"
mean = 1200.0
harmonics = [[0.5, 100.0, 0.0], [1.5, 1100.0, 300.0], [3.0, 150.0, 0.0]]
scale = [[300, 0.4], [900, 1.0]]
"""
SPEEDS = "300:960:23"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("line") / "line.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="module")
def wanted(scene):
    return jaxhb.strength(jaxhb.forced_response(jaxhb.load_scene(scene), rpm=np.linspace(300.0, 960.0, 23)))


def run(scene, capsys, command, *options):
    file = scene.with_name("r.json")
    assert main([command, str(scene), *options, "--json", str(file)]) == 0
    return capsys.readouterr().out, json.loads(file.read_text())


def test_forced_lists_what_is_worst_over_the_speeds_and_bars_ranges(scene, wanted, capsys):
    said, record = run(scene, capsys, "forced", "--rpm", SPEEDS)
    assert said.count(AID) == 4 and "IACS UR M68" in said and "to be checked\nagainst its current text" in said
    assert "They do NOT hold for crankshafts: these have a rule of their own, IACS UR M53" in said
    found, stress = record["strength"], wanted.stresses["line shaft"]
    line = found["stresses"]["line shaft"]
    assert line["stress_Pa"] == stress.stress.tolist() and line["continuous_Pa"][0] == stress.continuous[0]
    assert line["continuous_Pa"][-1] is None and found["rated_rpm"] == 900  # above 1.05 of the rated speed
    (barred,) = wanted.barred["line shaft"]
    assert line["barred"] == [vars(barred) | {"passable": barred.passable}]
    assert f"line shaft: {barred.low:.4g} to {barred.high:.4g} rpm, {barred.share:.2f} of the continuous limit" in said
    tooth = wanted.tooth_torques["pinion|wheel"]
    assert found["tooth_torques"]["pinion|wheel"]["vibratory_Nm"] == tooth.vibratory.tolist()
    assert found["tooth_torques"]["pinion|wheel"]["limit_Nm"] == pytest.approx(500.0)
    assert found["tooth_torques"]["pinion|wheel"]["reverses"] == tooth.reverses.tolist()
    assert list(found["heat"]) == ["coupling", "ring"] and found["heat"]["ring"]["limit_W"] == 40.0
    worst = int(np.argmax(np.where(np.isfinite(stress.continuous), stress.stress / stress.continuous, 0)))
    table = said[said.index("Torsional stress") :].split("\n\n")[0].splitlines()
    cells = table[2].split()
    assert float(cells[2]) == pytest.approx(stress.stress[worst] / 1e6, abs=0.01)
    assert float(cells[3]) == np.linspace(300.0, 960.0, 23)[worst]
    assert float(cells[6]) == pytest.approx(stress.stress[worst] / stress.continuous[worst], abs=0.006)


def test_one_speed_has_its_limits_and_no_ranges(scene, wanted, capsys):
    assert "pinion|wheel       3873    500   624   7.75       yes" in run(scene, capsys, "solve", "--rpm", "420")[0]
    said, record = run(scene, capsys, "solve", "--rpm", "600")
    assert (
        said.count(AID) == 3 and "Barred" not in said and "barred" not in record["strength"]["stresses"]["line shaft"]
    )
    found = record["strength"]["stresses"]["line shaft"]
    at = int(np.argmin(np.abs(wanted.rpm - 600.0)))
    assert found["stress_Pa"] == pytest.approx(wanted.stresses["line shaft"].stress[at], rel=1e-6)
    assert found["continuous_Pa"] == pytest.approx(wanted.stresses["line shaft"].continuous[at], rel=1e-12)
    heat = record["strength"]["heat"]["ring"]["power_W"]
    assert heat == pytest.approx(wanted.heat["ring"].power[at], rel=1e-6)


def test_a_sweep_and_a_report_bar_ranges_too(scene, wanted, capsys):
    (barred,) = wanted.barred["line shaft"]
    for command, read in (("sweep", lambda r: r["strength"]), ("report", lambda r: r["cases"][0]["strength"])):
        said, record = run(scene, capsys, command, "--rpm", SPEEDS)
        (found,) = read(record)["stresses"]["line shaft"]["barred"]
        assert (found["low"], found["high"]) == pytest.approx((barred.low, barred.high), rel=1e-6)
        assert (
            "Barred speed ranges between 300 and 930 rpm" in said and f"{barred.low:.4g} to {barred.high:.4g}" in said
        )


@pytest.mark.parametrize("command", ["forced", "sweep"])
def test_the_csv_has_columns_of_the_limits(scene, wanted, command):
    file = scene.with_name("r.csv")
    assert main([command, str(scene), "--rpm", "420,600", "--csv", str(file)]) == 0
    with file.open() as text:
        rows = list(csv.DictReader(text))
    stress, tooth = wanted.stresses["line shaft"], wanted.tooth_torques["pinion|wheel"]
    for row, at in zip(rows, (4, 10), strict=True):
        found = [float(row[f"line shaft {what} Pa"]) for what in ("stress", "continuous limit", "transient limit")]
        assert found == pytest.approx([values[at] for values in stress], rel=1e-5)
        assert float(row["pinion|wheel vibratory torque N m"]) == pytest.approx(tooth.vibratory[at], rel=1e-5)
        assert row["pinion|wheel reverses"] == str(bool(tooth.reverses[at]))
        assert float(row["ring limit of heat W"]) == 40.0


@pytest.mark.parametrize("command", ["forced", "solve"])
def test_a_scene_without_limits_tells_of_none(tmp_path, capsys, command):
    path = tmp_path / "plain.toml"
    keys = ("rated", "power_limit", "stress_conc", "tensile", "length", "outer", "shear", "magnifier", "damping_")
    lines = [line for line in SCENE.splitlines() if not line.startswith(keys)]
    text = "\n".join(lines).replace('["wheel", "propeller"]', '["wheel", "propeller"]\nstiffness = 3e5')
    path.write_text(text)
    said, record = run(path, capsys, command, "--rpm", "600")
    assert AID not in said and "strength" not in record


def test_referred_numbers_are_printed_beside_the_actual_ones(scene, capsys):
    assert main(["scene", str(scene), "--referred"]) == 0
    rows = {line.split("  ")[1].strip(): line.split() for line in capsys.readouterr().out.splitlines() if "  " in line}
    assert rows["propeller"][-5:] == ["0.333333", "90", "10", "20", "2.22222"]
    assert float(rows["line shaft"][-3]) == pytest.approx(float(rows["line shaft"][-4]) / 9, rel=1e-5)
    assert rows["pinion|wheel"][-5:-2] == ["0.1", "5e+08", "5e+06"]


ENGINE = """
[engine]
cylinders = 2
disks = ["engine", "engine"]
firing_order = [1, 2]
bore = 0.1
stroke = 0.1
rod = 0.2
reciprocating_mass = 1.0
gas_torque_mean = 100.0
gas_torque = [[0.5, 90.0, 20.0], [1.0, 150.0, 30.0], [1.5, 80.0, 10.0]]
"""


def test_a_misfire_stands_beside_normal_running_in_the_panels_of_limits(tmp_path):
    (tmp_path / "e.toml").write_text(SCENE + ENGINE)
    rpm = np.linspace(300.0, 900.0, 7)
    misfires = jaxhb.misfire_each(jaxhb.load_scene(tmp_path / "e.toml"), rpm=rpm, solve=jaxhb.forced_response)
    found = readings(misfires.firing)
    worst = worst_of(misfires, found)
    stress = plot_forced(misfires.firing, found, misfires, worst).axes[2]
    cylinder = worst["line shaft"].cylinder
    wanted = jaxhb.strength(misfires.responses[cylinder]).stresses["line shaft"].stress
    np.testing.assert_allclose(labelled(stress, f"stress, {cylinder} not firing")[1], 1e-6 * wanted)


def labelled(axes, label):
    (line,) = [line for line in axes.get_lines() if line.get_label() == label]
    return line.get_xdata(), line.get_ydata()


def test_the_picture_has_stresses_torques_and_heat_beside_their_limits_and_shades_barred_ranges(scene, wanted):
    response = jaxhb.forced_response(jaxhb.load_scene(scene), rpm=wanted.rpm)
    stress, tooth, heat = plot_forced(response, readings(response)).axes[-3:]
    row, rated = wanted.stresses["line shaft"], wanted.tooth_torques["pinion|wheel"]
    for label, values in (
        ("stress", row.stress),
        ("continuous limit", row.continuous),
        ("transient limit", row.transient),
    ):
        np.testing.assert_allclose(labelled(stress, label)[1], 1e-6 * values)
    (shaded,), (one,) = stress.patches, wanted.barred["line shaft"]
    assert (shaded.get_x(), shaded.get_x() + shaded.get_width()) == pytest.approx((one.low, one.high))
    np.testing.assert_allclose(labelled(tooth, "vibratory torque")[1], rated.vibratory)
    np.testing.assert_allclose(labelled(tooth, "a third of the rated torque")[1], 500.0)
    assert heat.get_ylabel() == "heat, W\nring"  # nearer to its limit than the coupling
    np.testing.assert_allclose(labelled(heat, "heat")[1], wanted.heat["ring"].power)
    drawn = plot_forced(response, readings(response, ["coupling"])).axes
    assert [axes.get_ylabel() for axes in drawn] == ["coupling, N m", "heat, W\ncoupling"]
    five = readings(response, ["coupling", "engine", "pinion", "wheel", "propeller"])
    assert [axes.get_ylabel() for axes in plot_forced(response, five).axes] == ["coupling, N m", "heat, W\ncoupling"]


def test_the_picture_of_a_sweep_has_the_limits_of_the_motion(scene):
    train, rpm = jaxhb.load_scene(scene), [360.0, 420.0, 480.0]
    axes = plot_sweep(answer_speeds(train, rpm, Asked())).axes
    found = jaxhb.strength(jaxhb.solve_speeds(train, rpm=rpm)).stresses["line shaft"].stress
    np.testing.assert_allclose(labelled(axes[2], "stress")[1], 1e-6 * np.asarray(found), rtol=1e-6)
    assert len(axes) == 5 and axes[2].patches


VARYING = """
[scene]
reference = "slow"
[[disk]]
name = "slow"
inertia = 2.0
radius = 0.2
[[disk]]
name = "fast"
inertia = 2.0
radius = 0.1
[[disk]]
name = "end"
inertia = 1.0
[[mesh]]
between = ["slow", "fast"]
stiffness = 1e8
[[shaft]]
name = "coupling"
between = ["fast", "end"]
stiffness = 2e4
damping = 3.0
loss_factor = 0.1
over_hz = [[0, 1.0, 1.0], [10, 1.5, 0.9]]
over_amplitude = [[0.002, 1.25, 0.8], [0.02, 1.0, 1.0], [0.03, 0.9, 1.1]]
[[damper]]
name = "pendulum"
disk = "end"
inertia = 0.05
order = 4.5
[[ground]]
disk = "end"
stiffness = 50.0
"""


def test_referred_numbers_have_loss_factors_orders_and_the_rows_of_links_that_vary(tmp_path, capsys):
    (tmp_path / "v.toml").write_text(VARYING)
    assert main(["scene", str(tmp_path / "v.toml"), "--referred"]) == 0
    disks, links, orders, rows = capsys.readouterr().out.split("\n\n")
    assert [line.split() for line in disks.splitlines()[-2:]] == [
        ["end", "2", "1", "4", "50", "200"],
        ["pendulum", "2", "0.05", "0.2", "0", "0"],
    ]
    assert "  ".join(links.split("coupling")[1].split()[:7]) == "shaft  2  20000  80000  3  12  0.1"
    own = 0.05 * (9.0 * 2.0 * math.pi / 60.0) ** 2
    assert orders.splitlines()[-1].split() == ["pendulum", "4.5", "9", f"{own:.6g}", f"{4 * own:.6g}"]
    assert [" ".join(line.split()) for line in rows.splitlines()[2:]] == [
        "coupling over_hz 0 0 20000 80000 3 12 0.1",
        "coupling over_hz 10 10 30000 120000 2.7 10.8 0.09",
        "coupling over_amplitude 0.002 0.001 25000 100000 2.4 9.6 0.08",
        "coupling over_amplitude 0.02 0.01 20000 80000 3 12 0.1",
        "coupling over_amplitude 0.03 0.015 18000 72000 3.3 13.2 0.11",
    ]


TUNE = """
[tune]
rpm = "390:450:13"
steps = 12
widths = [0.02]
[[tune.parameter]]
name = "ring.damping"
low = 10
high = 400
[[tune.parameter]]
name = "line shaft.outer"
low = 0.109
high = 0.111
[[tune.objective]]
quantity = "power over limit"
of = "ring"
[[tune.penalty]]
quantity = "stress over continuous limit"
of = "line shaft"
most = 1.6
"""


def test_a_tuning_keeps_the_stress_within_its_limit(scene, tmp_path, capsys):
    path = tmp_path / "line.toml"
    path.write_text(SCENE + TUNE)
    out = tmp_path / "out"
    out.mkdir()
    assert main(["tune", str(path), "--output", str(out / "tuned.toml")]) == 0
    record = json.loads((out / "tuned.json").read_text())
    found = record["readings"]["stress over continuous limit of line shaft"]
    heat = record["readings"]["power over limit of ring"]
    assert max(found["before"]) < 1.5 and max(heat["after"]) < 0.96 * max(heat["before"])
    assert max(found["after"]) == pytest.approx(1.6, rel=0.01)  # the limit holds back the objective
    tuned = jaxhb.load_scene(out / "tuned.toml")
    judged = jaxhb.strength(jaxhb.forced_response(tuned, rpm=record["rpm"])).stresses["line shaft"]
    np.testing.assert_allclose(judged.stress / judged.continuous, found["after"], rtol=1e-5)
    said = capsys.readouterr().out
    assert "stress over continuous limit of line shaft" in said and "at most 1.6" in said


def test_speeds_for_which_the_rule_has_no_limit_are_not_called_free_of_barred_ranges(scene, capsys):
    beyond = "Above 945 rpm, 1.05 of the rated speed, the rule has no limit: NOT judged; largest there: line shaft "
    assert main(["forced", str(scene), "--rpm", "900:1200:4"]) == 0
    said = capsys.readouterr().out
    stress = jaxhb.strength(jaxhb.forced_response(jaxhb.load_scene(scene), rpm=np.linspace(900.0, 1200.0, 4)))
    largest = stress.stresses["line shaft"].stress[1:]
    at = 1000 + 100 * int(largest.argmax())
    assert "No barred speed range between 900 and 900 rpm" in said
    assert (
        "Judged from 1 speed: resonances between them are NOT seen, take 50 or more. The rule looks up to 945" in said
    )
    assert f"{beyond}{largest.max() / 1e6:.4g} MPa at {at} rpm." in said
    assert main(["forced", str(scene), "--rpm", "1000:1200:3"]) == 0
    said = capsys.readouterr().out
    assert "arred speed range" not in said and beyond in said


def test_barred_ranges_say_from_how_many_speeds_they_were_judged(scene, capsys):
    assert main(["forced", str(scene), "--rpm", "500:945:60"]) == 0
    assert "Judged from 60 speeds.\n" in capsys.readouterr().out
    assert main(["forced", str(scene), "--rpm", "500:800:4"]) == 0
    said = capsys.readouterr().out
    assert (
        "Judged from 4 speeds: resonances between them are NOT seen, take 50 or more. The rule looks up to 945" in said
    )


def test_the_shaft_with_the_largest_stress_has_the_panel_where_no_shaft_has_a_limit():
    rows = {name: SimpleNamespace(stress=[1e6, top], continuous=None) for name, top in {"a": 3e6, "b": 9e6}.items()}
    found = SimpleNamespace(stresses=rows, tooth_torques={}, heat={})
    assert judged_elements(found) == [("stresses", "b")]
    rows["a"].continuous = [4e7, 4e7]
    assert judged_elements(found) == [("stresses", "a")]
