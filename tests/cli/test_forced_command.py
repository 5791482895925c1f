"""``jaxhb forced``: the same numbers as from Python, in tables, files and a picture;
bad input in sentences.
"""

import numpy as np
import pytest
from reference_data import text_of

import jaxhb
from jaxhb.report.figures.figure import DIGITS
from jaxhb.report.figures.speeds import plot_forced
from jaxhb.report.text.forced import SHOWN, readings

LINE = "forced gear_train_30 --rpm 800:2400:5"
SHAFT = "throw 2|throw 1"
MESH = "crank gear|idler"
DAMPER = "crank damper"


@pytest.fixture(scope="module")
def response():
    return jaxhb.forced_response(
        jaxhb.load_scene("gear_train_30"), rpm=np.linspace(800.0, 2400.0, 5)
    )


@pytest.fixture(scope="module")
def completed(run_once):
    return run_once(LINE, "json", "csv", "plot")


@pytest.mark.slow
def test_the_json_holds_every_element_in_full_precision(completed, response):
    record = completed.json
    topology = response.topology
    kinds = ("disks", "shafts", "meshes")
    assert [tuple(record[kind]) for kind in kinds] == [
        topology.disk_names,
        topology.shaft_names + topology.damper_names,
        topology.mesh_names,
    ]
    assert record == record | {
        "rpm": response.rpm.tolist(),
        "status": ["CONVERGED"] * 5,
        "orders": [k / 2 for k in range(1, 25)],
        "input_power_W": response.input_power.tolist(),
    }
    powers = [element["power_W"] for kind in kinds for element in record[kind].values()]
    heat = np.sum(powers, axis=0)
    np.testing.assert_allclose(heat, record["input_power_W"], rtol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "name"),
    [("shafts", SHAFT), ("shafts", DAMPER), ("meshes", MESH), ("disks", DAMPER)],
)
def test_the_json_holds_what_a_signal_has(completed, response, kind, name):
    read = {"shafts": response.torque, "meshes": response.force, "disks": response.disk}
    signal = read[kind](name)
    element = completed.json[kind][name]
    assert element == element | {
        "half_peak_to_peak": signal.half_peak_to_peak.tolist(),
        "sum_of_amplitudes": signal.sum_of_amplitudes.tolist(),
        "amplitudes": signal.amplitudes.tolist(),
        "phases_deg": signal.phases_deg.tolist(),
        "mean": signal.mean.tolist(),
    }
    assert ("elastic" in element) == (kind != "disks")


@pytest.mark.slow
def test_the_csv_has_one_row_for_each_speed_and_heads_of_its_own(completed, response):
    rows = completed.rows
    assert [float(row["rpm"]) for row in rows] == response.rpm.tolist()
    amplitudes = [float(row[f"{SHAFT} order 2.5 N m"]) for row in rows]
    assert amplitudes == response.torque(SHAFT).order(2.5).tolist()
    swing = float(rows[3][f"{DAMPER} angle half peak-to-peak rad"])
    assert swing == response.disk(DAMPER).half_peak_to_peak[3]
    assert float(rows[3][f"{MESH} heat W"]) == response.power(MESH)[3]
    # Every reading has its own columns: half peak-to-peak, sum, heat and its orders; no
    # head stands for two.
    columns = [3 + len(reading.listed()) for reading in readings(response)]
    assert len(rows[0]) == 4 + sum(columns)


@pytest.mark.slow
def test_the_picture_shows_the_hardest_shaft_and_mesh_or_those_asked_for(
    completed, response
):
    assert len(plot_forced({"": response}, readings(response)).axes) == 2
    figure = plot_forced({"": response}, readings(response, [SHAFT, "flywheel", MESH]))
    swings = (
        1e-3 * response.torque(SHAFT).half_peak_to_peak,  # kN m
        180 / np.pi * response.disk("flywheel").half_peak_to_peak,  # deg
        1e-3 * response.force(MESH).half_peak_to_peak,  # kN
    )
    for axes, swing in zip(figure.axes, swings, strict=True):
        drawn = axes.get_lines()[0].get_ydata()
        np.testing.assert_allclose(drawn, swing, rtol=0.5 * 10 ** (1 - DIGITS))


@pytest.mark.slow
def test_without_elements_the_table_tells_the_largest_values_of_all(
    response, completed
):
    completed.check_printed("forced_gear_train")
    (row,) = [
        line.split()
        for line in completed.out.splitlines()
        if line.strip().startswith(MESH)
    ]
    force = response.force(MESH).half_peak_to_peak / 1e3
    assert float(row[2]) == pytest.approx(force.max(), abs=0.006)
    assert float(row[3]) == response.rpm[force.argmax()]


@pytest.mark.slow
def test_an_element_is_told_speed_by_speed_with_its_main_orders(response, run_once):
    completed = run_once(f"{LINE} --element '{SHAFT}' --element flywheel")
    completed.check_printed("forced_elements")
    output = completed.out
    table = output[output.index(SHAFT) :].split("\n\n")[0].splitlines()
    assert table[1].count("order") == SHOWN
    signal = response.torque(SHAFT)
    half, total = (float(word) for word in table[4].split()[1:3])
    # In kN m, with thousandths
    assert 1e3 * half == pytest.approx(signal.half_peak_to_peak[2], abs=0.6)
    assert 1e3 * total == pytest.approx(signal.sum_of_amplitudes[2], abs=0.6)


SCENE = text_of("soft.toml")
RESONANCE = 10 * 30 / np.pi
"""The resonance of the two disks, rpm."""


@pytest.fixture
def soft(tmp_path):
    (tmp_path / "soft.toml").write_text(SCENE)
    (tmp_path / "stiffness.csv").write_text(
        "# hz, stiffness, damping\n0, 1, 1\n100, 1, 1\n"
    )
    return tmp_path / "soft.toml"


def test_a_train_that_nothing_excites_rests(tmp_path, run):
    (tmp_path / "one.toml").write_text(
        '[[disk]]\nname = "hub"\ninertia = 1.0\ndamping = 1.0\n'
    )
    completed = run(f"forced {tmp_path / 'one.toml'} --rpm 1000", "csv", "plot")
    completed.check_printed("forced_at_rest")


@pytest.mark.parametrize(
    ("scenario", "options", "stiffness"),
    [(None, "", 100.0), ("hot", "--scenario hot", 64.0)],
)
def test_a_scenario_is_taken_and_noted(soft, run, scenario, options, stiffness):
    record = run(f"forced {soft} --rpm {RESONANCE / 4!r} {options}", "json").json
    amplitude = record["shafts"]["coupling"]["amplitudes"][0][0]
    # Of 10 N m on two equal disks
    expected = 5.0 * stiffness / (stiffness - 2.5**2)
    np.testing.assert_allclose(amplitude, expected, rtol=1e-12)
    assert record["scenario"] == scenario


def test_a_resonance_without_damping_exits_1_with_its_speed(soft, run):
    line = f"forced {soft} --rpm 50,{RESONANCE!r} --element coupling"
    completed = run(line, "json", "csv", status=1)
    completed.check_printed("forced_resonance")
    coupling = completed.json["shafts"]["coupling"]
    amplitudes, at_resonance = coupling["amplitudes"]
    assert amplitudes[0] > 0
    assert at_resonance == [None] * len(amplitudes)
    assert coupling["half_peak_to_peak"][1] is coupling["power_W"][1] is None


@pytest.mark.parametrize("command", ["modes", "solve --rpm 50", "sweep --rpm 50,60"])
def test_other_commands_refuse_links_that_vary_by_name(soft, command, run):
    completed = run(f"{command} {soft}", status=2)
    sentence = "soft: 'coupling' has over_hz, which only the forced response takes"
    assert sentence in completed.err
    run(f"{command} {soft} --links-at hz=50")


DIESEL = "forced six_cylinder_diesel"
NAMED = "cyl6|flywheel"
RPM = np.linspace(1800.0, 2400.0, 4)


@pytest.mark.slow
def test_what_was_changed_is_told_below_the_tables_and_a_misfire_above_them_too(
    run_once,
):
    line = f"{DIESEL} --rpm 1800:2400:4"
    changes = "--set pulley.inertia=0.02 --misfire 'cylinder 2'"
    run_once(f"{line} {changes}").check_printed("forced_changed_diesel")
    run_once(line).check_printed("forced_diesel")


@pytest.mark.slow
def test_the_worst_of_all_misfires_is_that_of_python(run_once):
    line = f"{DIESEL} --rpm 1800:2400:4 --misfire each"
    completed = run_once(line, "json", "csv", "plot")
    record = completed.json
    train = jaxhb.load_scene("six_cylinder_diesel")
    misfires = jaxhb.misfire_each(train, rpm=RPM, solve=jaxhb.forced_response)
    worst = misfires.worst(lambda r: r.torque(NAMED).half_peak_to_peak)
    assert record["worst_misfires"][NAMED] == {
        "cylinder": worst.cylinder,
        "rpm": worst.rpm,
        "quantity": "torque",
        "unit": "N m",
        "value": worst.value,
        "firing": worst.firing,
    }
    values = {
        name: record["worst_misfires"][name]["value"]
        for name in train.topology.shaft_names
    }
    hardest = record["worst_misfire"]
    assert hardest == hardest | {
        "of": max(values, key=values.get),
        "value": max(values.values()),
    }
    sentence = (
        f"The worst misfire is that of {hardest['cylinder']}: torque of"
        f" {hardest['value']:.4g} N m"
    )
    assert sentence in completed.out
    cylinders = train.topology.cylinder_names
    assert list(record["misfires"]) == list(cylinders)
    alone = jaxhb.forced_response(train.misfire("cylinder 2"), rpm=RPM).torque(NAMED)
    swing = record["misfires"]["cylinder 2"]["shafts"][NAMED]["half_peak_to_peak"]
    np.testing.assert_allclose(swing, alone.half_peak_to_peak, rtol=1e-12)
    rows = completed.rows
    assert [row["misfire"] for row in rows[::4]] == ["", *cylinders]
    cells = [float(row[f"{NAMED} half peak-to-peak N m"]) for row in rows[8:12]]
    assert cells == swing


@pytest.mark.slow
def test_of_an_element_every_misfire_is_listed(run_once):
    line = f"{DIESEL} --rpm 1800:2400:4 --misfire each"
    completed = run_once(f"{line} --element '{NAMED}' --element flywheel")
    completed.check_printed("forced_misfires_of_elements")


@pytest.mark.slow
def test_speeds_without_an_answer_have_no_worst_misfire(tmp_path, run):
    parts = [
        jaxhb.Disk(name="a", inertia=2.0),
        jaxhb.Disk(name="b", inertia=2.0),
        jaxhb.Shaft(between=("a", "b"), stiffness=100.0),
        jaxhb.Load(disk="b"),
    ]
    parts += [
        jaxhb.Cylinder(
            name=name,
            disk=disk,
            firing_angle=0.0,
            gas_torque_mean=10.0,
            gas_torque=[(1.0, 5.0, 4.0)],
        )
        for name, disk in (("one", "a"), ("two", "b"))
    ]
    (tmp_path / "free.toml").write_text(jaxhb.elements_text(parts, name="free"))
    line = f"forced {tmp_path / 'free.toml'} --misfire each --rpm"
    completed = run(f"{line} 50,{RESONANCE!r}", "json", status=1)
    assert completed.json["worst_misfire"]["rpm"] == 50.0
    assert "free, one not firing, at 95.493 rpm: NEAR_SINGULAR" in completed.err
    completed = run(f"{line} {RESONANCE!r}", "json", status=1)
    assert "worst misfire" not in completed.out
    assert "worst_misfire" not in completed.json
    # With both firing the torques of both disks cancel: the amplitude may be any.
    assert completed.err.count("NEAR_SINGULAR") == 3


LIMITED = "--rpm 80,85,120 --cut-off each"


@pytest.fixture
def two_stroke(tmp_path):
    """A scene whose stress limit falls over the speed."""
    scene = tmp_path / "e.toml"
    scene.write_text(text_of("slow_two_stroke.toml"))
    return scene


@pytest.mark.slow
def test_the_worst_misfire_is_that_with_the_largest_share_of_a_limit(run, two_stroke):
    completed = run(f"forced {two_stroke} {LIMITED}", "json")
    completed.check_printed("forced_cut_offs_with_limits")
    train = jaxhb.load_scene(two_stroke)
    shares = {}
    for name, case in ({"": train} | train.cut_offs()).items():
        response = jaxhb.forced_response(case, rpm=[80.0, 85.0, 120.0])
        stresses = jaxhb.strength(response).stresses["intermediate"]
        shares[name] = stresses.stress / stresses.continuous
    assert max(shares, key=lambda name: shares[name].max()) == "cylinder 1"
    worst = completed.json["worst_misfire"]
    assert worst == worst | {
        "cylinder": "cylinder 1",
        "of": "intermediate",
        "rpm": 120.0,
        "share": pytest.approx(shares["cylinder 1"][2], rel=1e-9),
        "firing_share": pytest.approx(shares[""][2], rel=1e-9),
    }
    sentence = f"stress {worst['share']:.2f} of the continuous limit; "
    assert sentence in completed.out


@pytest.mark.slow
def test_without_limits_the_worst_misfire_is_that_with_the_largest_torque(
    run, two_stroke
):
    """Another cylinder's than with limits."""
    text = two_stroke.read_text()
    for key in (
        "diameter = 0.42\n",
        "stress_concentration = 1.0\n",
        "tensile_strength = 8e8\n",
    ):
        text = text.replace(key, "")
    two_stroke.write_text(text)
    worst = run(f"forced {two_stroke} {LIMITED}", "json").json["worst_misfire"]
    expected = {"cylinder": "cylinder 4", "of": "intermediate", "rpm": 85.0}
    assert worst == worst | expected
    assert "share" not in worst
