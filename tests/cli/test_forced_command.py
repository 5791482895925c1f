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

CALL = "forced gear_train_30 --rpm 800:2400:5"
SHAFT = "throw 2|throw 1"
MESH = "crank gear|idler"
DAMPER = "crank damper"


@pytest.fixture(scope="module")
def response():
    return jaxhb.forced_response(
        jaxhb.load_scene("gear_train_30"), rpm=np.linspace(800.0, 2400.0, 5)
    )


@pytest.fixture(scope="module")
def answer(told):
    return told(CALL, "json", "csv", "plot")


@pytest.mark.slow
def test_the_json_holds_every_element_in_full_precision(answer, response):
    record = answer.json
    topology = response.topology
    assert list(record["disks"]) == list(topology.disk_names)
    assert list(record["shafts"]) == [*topology.shaft_names, *topology.damper_names]
    assert list(record["meshes"]) == list(topology.mesh_names)
    assert (
        record["rpm"] == response.rpm.tolist() and record["status"] == ["CONVERGED"] * 5
    )
    assert record["orders"] == [k / 2 for k in range(1, 25)]
    assert record["input_power_W"] == response.input_power.tolist()
    signals = [("shafts", name, response.torque(name)) for name in (SHAFT, DAMPER)]
    for kind, name, signal in (
        *signals,
        ("meshes", MESH, response.force(MESH)),
        ("disks", DAMPER, response.disk(DAMPER)),
    ):
        found = record[kind][name]
        for quantity in (
            "half_peak_to_peak",
            "sum_of_amplitudes",
            "amplitudes",
            "phases_deg",
            "mean",
        ):
            assert found[quantity] == getattr(signal, quantity).tolist()
        assert ("elastic" in found) == (kind != "disks")
    heat = sum(
        np.array(r["power_W"])
        for kind in ("disks", "shafts", "meshes")
        for r in record[kind].values()
    )
    np.testing.assert_allclose(heat, record["input_power_W"], rtol=1e-10)


@pytest.mark.slow
def test_the_csv_has_one_row_for_each_speed_and_heads_of_its_own(answer, response):
    rows = answer.rows
    assert [float(row["rpm"]) for row in rows] == response.rpm.tolist()
    assert [float(row[f"{SHAFT} order 2.5 N m"]) for row in rows] == response.torque(
        SHAFT
    ).order(2.5).tolist()
    assert (
        float(rows[3][f"{DAMPER} angle half peak-to-peak rad"])
        == response.disk(DAMPER).half_peak_to_peak[3]
    )
    assert float(rows[3][f"{MESH} heat W"]) == response.power(MESH)[3]
    # Every reading has its own columns: half peak-to-peak, sum, heat and its orders; no
    # head stands for two.
    assert len(rows[0]) == 4 + sum(3 + len(one.listed()) for one in readings(response))


@pytest.mark.slow
def test_the_picture_shows_the_hardest_shaft_and_mesh_or_those_asked_for(
    answer, response
):
    assert (
        answer.is_drawn
        and len(plot_forced({"": response}, readings(response)).axes) == 2
    )
    figure = plot_forced({"": response}, readings(response, [SHAFT, "flywheel", MESH]))
    drawn = [axes.get_lines()[0].get_ydata() for axes in figure.axes]
    swings = (response.torque(SHAFT), response.disk("flywheel"), response.force(MESH))
    for line, signal, factor in zip(
        drawn, swings, (1e-3, 180 / np.pi, 1e-3), strict=True
    ):  # kN m, deg, kN
        np.testing.assert_allclose(
            line, factor * signal.half_peak_to_peak, rtol=0.5 * 10 ** (1 - DIGITS)
        )


@pytest.mark.slow
def test_without_elements_the_table_tells_the_largest_values_of_all(response, answer):
    for title in (
        "angle of disks, deg",
        "torque of shafts and dampers, N m",
        "tooth force, kN",
    ):
        assert title in answer.out
    (row,) = [
        line.split()
        for line in answer.out.splitlines()
        if line.strip().startswith(MESH)
    ]
    force = response.force(MESH).half_peak_to_peak / 1e3
    assert float(row[2]) == pytest.approx(force.max(), abs=0.006)
    assert float(row[3]) == response.rpm[force.argmax()]


@pytest.mark.slow
def test_an_element_is_told_speed_by_speed_with_its_main_orders(response, told):
    said = told(f"{CALL} --element '{SHAFT}' --element flywheel").out
    table = said[said.index(SHAFT) :].split("\n\n")[0].splitlines()
    assert (
        len(table) == 2 + 5
        and table[1].count("order") == SHOWN
        and "18 smaller orders are left out" in table[0]
    )
    signal = response.torque(SHAFT)
    half, total = (float(word) for word in table[4].split()[1:3])
    assert half == pytest.approx(signal.half_peak_to_peak[2], abs=0.6)
    assert total == pytest.approx(signal.sum_of_amplitudes[2], abs=0.6)
    assert "flywheel, deg" in said and MESH not in said


SCENE = text_of("soft.toml")
AT = 10 * 30 / np.pi
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
    *_, row, _, said = run(
        f"forced {tmp_path / 'one.toml'} --rpm 1000", "csv", "plot"
    ).out.splitlines()
    assert row.split() == ["hub", "0", "-", "0", "-", "-", "0", "-", "0"]
    assert said.startswith("Nothing excites the train.")


def test_a_scenario_is_taken_and_noted(soft, run):
    found = []
    for scenario in (None, "hot"):
        record = run(
            f"forced {soft} --rpm {AT / 4!r}"
            + (f" --scenario {scenario}" if scenario else ""),
            "json",
        ).json
        found.append(record["shafts"]["coupling"]["amplitudes"][0][0])
        assert record["scenario"] == scenario
    wanted = [
        5.0 * k / (k - 2.5**2) for k in (100.0, 64.0)
    ]  # of 10 N m on two equal disks
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_a_resonance_without_damping_exits_1_with_its_speed(soft, run):
    called = run(f"forced {soft} --rpm 50,{AT!r} --element coupling", "json", "csv")
    assert called.status == 1
    assert (
        "soft at 95.493 rpm: NEAR_SINGULAR: the equations are singular here"
        in called.err
    )
    found = called.json["shafts"]["coupling"]
    assert found["amplitudes"][0][0] > 0 and found["amplitudes"][1] == [None] * len(
        found["amplitudes"][0]
    )
    assert found["half_peak_to_peak"][1] is None and found["power_W"][1] is None


@pytest.mark.parametrize("command", ["modes", "solve --rpm 50", "sweep --rpm 50,60"])
def test_other_commands_refuse_links_that_vary_by_name(soft, command, run):
    called = run(f"{command} {soft}")
    assert (
        called.status == 2
        and "soft: 'coupling' has over_hz, which only the forced response takes"
        in called.err
    )
    assert run(f"{command} {soft} --links-at hz=50").status == 0


DIESEL = "forced six_cylinder_diesel"
NAMED = "cyl6|flywheel"
RPM = np.linspace(1800.0, 2400.0, 4)


@pytest.mark.slow
def test_what_was_changed_is_told_below_the_tables_and_a_misfire_above_them_too(told):
    changed = told(
        f"{DIESEL} --rpm 1800:2400:4 --set pulley.inertia=0.02 --misfire 'cylinder 2'"
    ).out
    assert changed.startswith(
        "six_cylinder_diesel, cylinder 2 not firing: linear forced response"
    )
    assert changed.endswith(
        "\n\nAsked with --set 'pulley.inertia=0.02', --misfire 'cylinder 2'.\n"
    )
    said = told(f"{DIESEL} --rpm 1800:2400:4").out
    assert "Asked with" not in said and said.startswith("six_cylinder_diesel: linear")


@pytest.mark.slow
def test_the_worst_of_all_misfires_is_that_of_python(told):
    called = told(f"{DIESEL} --rpm 1800:2400:4 --misfire each", "json", "csv", "plot")
    record = called.json
    train = jaxhb.load_scene("six_cylinder_diesel")
    misfires = jaxhb.misfire_each(train, rpm=RPM, solve=jaxhb.forced_response)
    worst = misfires.worst(lambda r: r.torque(NAMED).half_peak_to_peak)
    wanted = {
        "cylinder": worst.cylinder,
        "rpm": worst.rpm,
        "quantity": "torque",
        "unit": "N m",
    }
    assert record["worst_misfires"][NAMED] == wanted | {
        "value": worst.value,
        "firing": worst.firing,
    }
    values = {
        name: record["worst_misfires"][name]["value"]
        for name in train.topology.shaft_names
    }
    hardest = record["worst_misfire"]
    assert hardest["of"] == max(values, key=values.get) and hardest["value"] == max(
        values.values()
    )
    assert (
        f"The worst misfire is that of {hardest['cylinder']}: torque of"
        f" {hardest['value']:.4g} N m" in called.out
    )
    assert list(record["misfires"]) == list(train.topology.cylinders.names)
    alone = jaxhb.forced_response(train.misfire("cylinder 2"), rpm=RPM).torque(NAMED)
    found = record["misfires"]["cylinder 2"]["shafts"][NAMED]
    np.testing.assert_allclose(
        found["half_peak_to_peak"], alone.half_peak_to_peak, rtol=1e-12
    )
    rows = called.rows
    assert [row["misfire"] for row in rows[::4]] == [
        "",
        *train.topology.cylinders.names,
    ]
    assert [
        float(row[f"{NAMED} half peak-to-peak N m"]) for row in rows[8:12]
    ] == found["half_peak_to_peak"]
    assert called.is_drawn


@pytest.mark.slow
def test_of_an_element_every_misfire_is_listed(told):
    said = told(
        f"{DIESEL} --rpm 1800:2400:4 --misfire each --element '{NAMED}' --element"
        " flywheel"
    ).out
    assert said.count("The worst misfire is that of") == 2
    assert said.count("cylinder 4 not firing") == 2 and "cyl1|cyl2" not in said


@pytest.mark.slow
def test_speeds_without_an_answer_have_no_worst_misfire(tmp_path, run):
    gas = {
        "firing_angle": 0.0,
        "gas_torque_mean": 10.0,
        "gas_torque": [(1.0, 5.0, 4.0)],
    }
    parts = [jaxhb.Disk(name=name, inertia=2.0) for name in "ab"]
    parts += [jaxhb.Shaft(between=("a", "b"), stiffness=100.0), jaxhb.Load(disk="b")]
    parts += [
        jaxhb.Cylinder(name=name, disk=disk, **gas)
        for name, disk in (("one", "a"), ("two", "b"))
    ]
    (tmp_path / "free.toml").write_text(jaxhb.elements_text(parts, name="free"))
    call = f"forced {tmp_path / 'free.toml'} --misfire each --rpm"
    called = run(f"{call} 50,{AT!r}", "json")
    assert called.status == 1 and called.json["worst_misfire"]["rpm"] == 50.0
    assert "free, one not firing, at 95.493 rpm: NEAR_SINGULAR" in called.err
    called = run(f"{call} {AT!r}", "json")
    assert (
        called.status == 1
        and "worst misfire" not in called.out
        and "worst_misfire" not in called.json
    )
    assert (
        called.err.count("NEAR_SINGULAR") == 2
    )  # with both firing the torques of both disks cancel


@pytest.mark.slow
def test_the_worst_misfire_is_that_with_the_largest_share_of_a_limit(run, tmp_path):
    """Stress over its limit, which falls over the speed; without limits the largest
    torque, another cylinder's.
    """
    scene = tmp_path / "e.toml"
    scene.write_text(text_of("slow_two_stroke.toml"))
    called = run(f"forced {scene} --rpm 80,85,120 --cut-off each", "json")
    worst = called.json["worst_misfire"]
    text = called.out
    rows = {}
    for name, train in (
        {"": (loaded := jaxhb.load_scene(scene))} | loaded.cut_offs()
    ).items():
        row = jaxhb.strength(
            jaxhb.forced_response(train, rpm=[80.0, 85.0, 120.0])
        ).stresses["intermediate"]
        rows[name] = row.stress / row.continuous
    assert max(rows, key=lambda name: rows[name].max()) == "cylinder 1"
    assert (worst["cylinder"], worst["of"], worst["rpm"]) == (
        "cylinder 1",
        "intermediate",
        120.0,
    )
    np.testing.assert_allclose(
        [worst["share"], worst["firing_share"]],
        [rows["cylinder 1"][2], rows[""][2]],
        rtol=1e-9,
    )
    assert f"{worst['share']:.2f} of the continuous limit of stress; " in text
    assert any(
        "cylinder 1  " in line and f"{worst['share']:.2f}, stress" in line
        for line in text.splitlines()
    )
    assert (
        "Not firing, cylinder 1, cylinder 2, cylinder 3, cylinder 4: cut off, no gas"
        " torque at all." in text
    )
    for key in (
        "diameter = 0.42\n",
        "stress_concentration = 1.0\n",
        "tensile_strength = 8e8\n",
    ):
        scene.write_text(scene.read_text().replace(key, ""))
    worst = run(f"forced {scene} --rpm 80,85,120 --cut-off each", "json").json[
        "worst_misfire"
    ]
    assert (worst["cylinder"], worst["of"], worst["rpm"]) == (
        "cylinder 4",
        "intermediate",
        85.0,
    )
    assert "share" not in worst
