"""``jaxhb transient``: peaks, stresses and passages as text and for programs, the
signals in files, and a picture.
"""

import csv

import numpy as np
import pytest
from printed import HAMMERING
from reference_data import text_of

import jaxhb
from jaxhb.linear.strength import stress_limits
from jaxhb.report.figures import draw
from jaxhb.report.text.transients import transient_verdict
from jaxhb.report.transients import steady_extremes, transient_report

CURVE = (
    'tensile_strength = 5e8\nsn_curve = [[1e4, 6e7], [1e6, 2e7]]\nsn_source = "rods"'
)
SPEED = "--seconds 3 --speed 0:360,2:480"
HAMMER = "transient spur_pair --seconds 0.1 --speed 0:4600,0.1:4800"
SHAFT = "line shaft"
MESH = "pinion|wheel"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "line.toml"
    text = text_of("limited_line.toml").replace("tensile_strength = 5e8", CURVE)
    kick = '\n[[event]]\nname = "kick"\ndisk = "propeller"\nbegin = 2.5\nstep = -5e3\n'
    path.write_text(text + kick)
    return path


@pytest.fixture(scope="module")
def motion(scene):
    train = jaxhb.load_scene(scene)
    return jaxhb.transient(train, seconds=3.0, speed=[(0, 360), (2, 480)])


@pytest.fixture(scope="module")
def run_up(scene, run_once):
    line = f"transient {scene} {SPEED} --passage 400:460"
    return run_once(line, "json", "csv", "netcdf", "plot")


def test_people_read_peaks_stresses_damage_and_passages(run_up, scene):
    text = run_up.transcript.replace(str(scene), "line.toml")
    from printed import check_text

    check_text("transient_run_up", text)


def test_the_json_holds_what_python_gives(run_up, motion):
    record = run_up.json
    for kind, name, signal in (
        ("shafts", SHAFT, motion.torque(SHAFT)),
        ("meshes", MESH, motion.force(MESH)),
        ("gears", "pinion", motion.gear_torque("pinion")),
    ):
        told = record[kind][name]
        assert told == told | {
            "max": float(signal.max),
            "min": float(signal.min),
            "peak": float(signal.peak),
            "mean": float(signal.mean),
            "time_of_peak_s": float(signal.time_of_peak),
            "rpm_of_peak": float(signal.rpm_of_peak),
        }
    expected = {
        "seconds": 3.0,
        "first_rpm": 360.0,
        "last_rpm": 480.0,
        "start": "steady",
        "events": [],
    }
    assert record == record | expected


def test_a_stress_is_beside_the_limit_of_its_own_speed(run_up, motion):
    stress = run_up.json["strength"]["stresses"][SHAFT]
    _, limit = stress_limits(motion.train, SHAFT, stress["rpm"])
    assert stress["transient_Pa"] == pytest.approx(float(limit), rel=1e-12)
    assert stress["share"] == pytest.approx(stress["stress_Pa"] / float(limit))
    # In the cycle around it, half of the peak-to-peak torque over W_p = pi d^3 / 16
    cycle = 2 * 60 / stress["rpm"]
    around = motion.torque(SHAFT).between(
        stress["time_s"] - cycle / 2, stress["time_s"] + cycle / 2
    )
    swing = float(around.half_peak_to_peak) / (np.pi * 0.11**3 / 16)
    # The speed is not constant over the cycle
    assert stress["stress_Pa"] == pytest.approx(swing, rel=0.02)


def test_the_damage_is_that_of_python(run_up, motion):
    stress = run_up.json["strength"]["stresses"][SHAFT]
    damage = motion.damage(motion.stress(SHAFT), motion.sn_curve(SHAFT))
    assert stress["damage"] == pytest.approx(float(damage), rel=1e-12)
    assert stress["sn_source"] == "rods"


def test_passages_are_those_of_the_ramp(run_up):
    """60 rpm a second."""
    barred, asked = run_up.json["passages"]
    assert asked["seconds"] == pytest.approx(1.0, rel=1e-9)
    assert barred["shaft"] == SHAFT
    width = barred["high_rpm"] - barred["low_rpm"]
    assert width > barred["barred"]["high"] - barred["barred"]["low"]
    assert barred["seconds"] == pytest.approx(width / 60, rel=1e-9)


def test_the_barred_range_is_that_of_forced(run_up, run, scene):
    (forced,) = run(f"forced {scene} --rpm 360:480:201", "json").json["strength"][
        "stresses"
    ][SHAFT]["barred"]
    barred = run_up.json["passages"][0]
    assert [barred["low_rpm"], barred["high_rpm"]] == pytest.approx(
        [forced["bar_low"], forced["bar_high"]], rel=1e-6
    )


def test_the_csv_has_a_row_for_every_instant(run_up, motion):
    with run_up.path("csv").open(encoding="utf-8", newline="") as text:
        heads, *rows = csv.reader(text)
    assert heads == [
        "time s",
        "rpm",
        "coupling torque N m",
        "line shaft torque N m",
        "ring torque N m",
        "pinion|wheel tooth force N",
    ]
    values = np.array(rows, dtype=float)
    np.testing.assert_array_equal(values[:, 0], motion.time)
    np.testing.assert_array_equal(values[:, 1], motion.rpm)
    np.testing.assert_array_equal(values[:, 3], motion.torque(SHAFT).values)
    np.testing.assert_array_equal(values[:, 5], motion.force(MESH).values)


def test_the_netcdf_file_has_the_same_signals(run_up, motion):
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(run_up.path("netcdf")) as data:
        torque = data.torque.sel(shaft=SHAFT)
        np.testing.assert_array_equal(torque, motion.torque(SHAFT).values)


def test_an_event_begins_when_the_scene_says(scene, run, motion):
    line = f"transient {scene} {SPEED} --event kick"
    kicked = run(line, "json").json
    assert kicked["events"] == ["kick"]
    (name,) = [SHAFT]
    before = motion.torque(SHAFT).between(0.0, 2.5)
    assert kicked["shafts"][name]["max"] >= float(before.max)
    assert kicked["shafts"][name]["mean"] != motion.torque(SHAFT).mean


def test_teeth_that_part_are_told_with_time_and_speed(run):
    completed = run(HAMMER, "json", "plot")
    completed.check_printed("transient_hammering", HAMMERING)
    mesh = completed.json["meshes"]["gear a|gear b"]
    assert mesh["troubles"] == ["separation", "hits"]
    assert 0 < mesh["first_separation_s"] < mesh["first_impact_s"]
    assert mesh["first_reverse_contact_s"] is None


def test_a_free_speed_is_told_with_the_speeds_it_takes(run, tmp_path):
    path = tmp_path / "events.toml"
    path.write_text(text_of("events.toml"))
    line = f"transient {path} --seconds 2 --rpm 600 --free --event kick --start rest"
    record = run(line, "json").json
    train = jaxhb.load_scene(path)
    motion = jaxhb.transient(
        train, seconds=2.0, speed="free", rpm=600.0, events="kick", start="rest"
    )
    assert record["last_rpm"] == float(motion.rpm[-1])
    assert record["start"] == "rest"


@pytest.fixture
def pictures(monkeypatch):
    """Specifications that are drawn."""
    figures = []
    drawn = draw.drawn

    def noted(*specifications, **more):
        figures.extend(specifications)
        return drawn(*specifications, **more)

    monkeypatch.setattr("jaxhb.report.figures.transients.drawn", noted)
    return figures


def test_the_picture_shows_the_peak_the_steady_motion_and_the_orders(
    scene, run, motion, pictures
):
    run(f"transient {scene} {SPEED} --record 400", "plot")
    over_time, beside_steady, orders = pictures
    speed, torque = over_time.traces
    assert max(speed["y"]) == 480
    # Its unit is kN m
    recorded = jaxhb.transient(
        motion.train, seconds=3.0, speed=[(0, 360), (2, 480)], record=400
    )
    peak = float(np.max(recorded.torque(SHAFT).values))
    assert max(torque["y"]) == pytest.approx(peak / 1e3, rel=1e-4)
    steady = beside_steady.traces[2]
    forced = jaxhb.forced_response(motion.train, rpm=steady["x"])
    swing = np.array(steady["y"]) - np.array(beside_steady.traces[3]["y"])
    np.testing.assert_allclose(
        swing / 2, forced.torque(SHAFT).half_peak_to_peak / 1e3, rtol=1e-3
    )
    assert "order 1.5" in [trace["name"] for trace in orders.traces]


def test_at_a_constant_speed_orders_go_over_the_time(scene, run, pictures):
    run(f'transient {scene} --seconds 4 --rpm 600 --link "{MESH}"', "plot")
    over_time, orders = pictures
    assert orders.x.title == "time, s"
    assert over_time.panels[1].title.startswith("tooth force")


def test_where_the_speed_goes_up_and_down_all_goes_over_the_time(run, scene, pictures):
    line = f"transient {scene} --seconds 3 --speed 0:360,1.5:480,3:360"
    run(line, "plot")
    assert [figure.x.title for figure in pictures] == ["time, s"] * 3
    steady = pictures[1].traces[2]
    # The same speeds come again in the other order, in windows at other times
    there = np.array(steady["y"])
    assert there[2] == pytest.approx(
        np.interp(3 - steady["x"][2], steady["x"], there), rel=1e-2
    )


def test_a_picture_of_many_instants_keeps_their_extremes(run, pictures):
    run(HAMMER.replace("0.1 --speed", "0.3 --speed"), "plot")
    train = jaxhb.load_scene("spur_pair")
    motion = jaxhb.transient(train, seconds=0.3, speed=[(0, 4600), (0.1, 4800)])
    force = motion.force("gear a|gear b")
    assert len(motion.time) > 6000
    (_, drawn_force) = pictures[0].traces
    assert max(drawn_force["y"]) == pytest.approx(float(force.max) / 1e3, rel=1e-4)
    assert min(drawn_force["y"]) == pytest.approx(float(force.min) / 1e3, rel=1e-3)


def test_the_page_of_a_report_shows_a_transient(run, scene):
    speed = "--transient 0:360,2:480,3:480"
    completed = run(f"report {scene} --rpm 400,500 {speed} --event kick", "html")
    text = completed.path("html").read_text(encoding="utf-8")
    section = text[text.rindex("&ensp;Transient") : text.rindex("&ensp;Limits")]
    for words in (
        "line: 3 s from 360 to 480 rpm, from the steady motion; events: kick",
        "Torsional stress of shafts, MPa: half of peak-to-peak torque within a cycle",
        "Torque of line shaft over time",
        "beside the steady motion",
        "amplitudes of the largest orders",
    ):
        assert words in section


def test_scenarios_are_compared_by_the_time_of_their_peaks(scene, run, tmp_path):
    path = tmp_path / "modes.toml"
    path.write_text(
        scene.read_text() + '\n[scenario.soft]\n"coupling.stiffness" = 5e4\n'
    )
    completed = run(f"transient {path} {SPEED} --scenario all", "json", "csv")
    worst = completed.json["worst"][f"{SHAFT} torque N m"]
    peaks = {
        title: record["shafts"][SHAFT]["peak"]
        for title, record in completed.json["scenarios"].items()
    }
    assert worst["value"] == max(peaks.values())
    assert "at s" in completed.out
    assert {row["scenario"] for row in completed.rows} == {"as written", "soft"}


def test_without_rainflow_a_curve_is_refused_before_the_march(scene, run, monkeypatch):
    import importlib.util

    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(
        "jaxhb.cli.commands.march_transient", lambda *_, **__: pytest.fail("marched")
    )
    assert "jaxhb[transients]" in run(f"transient {scene} {SPEED}", status=2).err


def test_a_steady_motion_is_in_the_sense_of_the_transient(motion):
    """The other end first: both are turned."""
    mean = float(motion.torque("wheel", "propeller").mean)
    steady = steady_extremes(motion, SHAFT)
    assert mean > 0
    assert np.all(steady.highest > -steady.lowest)


def test_a_train_without_teeth_or_backlash_says_so(motion):
    report = transient_report(motion, start="steady", events=(), passages=())
    assert transient_verdict(report).startswith("No mesh has backlash")
