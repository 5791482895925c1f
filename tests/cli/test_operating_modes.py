"""Several scenarios in one call of a command, against calls for each alone."""

from pathlib import Path

import pytest

import jaxhb
from jaxhb.cli import linear_commands

PLANT = Path(__file__).parents[1] / "data" / "scenes" / "two_engines.toml"
MODES = {
    "as written": "",
    "port alone": " --scenario 'port alone'",
    "zero pitch": " --scenario 'zero pitch'",
}


@pytest.fixture(scope="module")
def forced(told):
    lines = {"all": " --scenario all"} | MODES
    return {
        name: told(f"forced {PLANT} --rpm 200:700:6{more}", "json", "csv")
        for name, more in lines.items()
    }


@pytest.mark.slow
def test_files_of_all_modes_hold_what_each_alone_gives(forced):
    found = forced["all"]
    assert {called.status for called in forced.values()} == {0}
    assert list(found.json["scenarios"]) == list(MODES)
    assert all(found.json["scenarios"][name] == forced[name].json for name in MODES)
    for name in MODES:
        own = [row for row in found.rows if row["scenario"] == name]
        # A link that is open has no number there.
        assert [
            {k: v for k, v in row.items() if v and k != "scenario"} for row in own
        ] == [{k: v for k, v in row.items() if v} for row in forced[name].rows]


@pytest.mark.slow
def test_the_worst_of_every_quantity_is_named_with_its_mode_and_speed(forced):
    worst = forced["all"].json["worst"]
    head = "port clutch half peak-to-peak N m"
    rows = [
        (float(r[head]), name, float(r["rpm"]))
        for name in MODES
        for r in forced[name].rows
    ]
    value, mode, rpm = max(rows, key=lambda row: row[0])
    assert worst[head] == {
        "value": value,
        "unit": "N m",
        "scenario": mode,
        "case": "",
        "rpm": rpm,
    }
    assert "line stress Pa" in worst and not any("limit" in name for name in worst)
    table = forced["all"].out.split("Largest over all modes")[1]
    (line,) = (line for line in table.splitlines() if "port clutch half" in line)
    assert " ".join(line.split()).endswith(f"{value:.0f} N m {rpm:g} {mode}")


def test_chosen_modes_are_those_named_and_other_files_are_theirs(run, tmp_path):
    found = run(
        f"modes {PLANT} --scenario 'zero pitch' --scenario 'port alone'", "json", "plot"
    )
    assert found.status == 0 and list(found.json["scenarios"]) == [
        "zero pitch",
        "port alone",
    ]
    assert sorted(path.name for path in tmp_path.glob("*.png")) == [
        "plot_port_alone.png",
        "plot_zero_pitch.png",
    ]
    assert [line for line in found.out.splitlines() if line.startswith("Mode: ")] == [
        "Mode: zero pitch",
        "Mode: port alone",
    ]
    alone = jaxhb.natural_frequencies(jaxhb.load_scene(PLANT).scenario("port alone"))
    record = found.json["scenarios"]["port alone"]["frequencies_hz"]
    assert record == pytest.approx(alone.frequencies_hz.tolist(), rel=1e-12, abs=1e-9)
    quiet = run(f"modes {PLANT} --scenario all --json -")
    assert quiet.out.startswith('{"scenarios": ')


@pytest.mark.slow
def test_a_report_and_its_page_tell_every_mode(run, tmp_path):
    found = run(
        f"report {PLANT} --rpm 300,500 --scenario all --html {tmp_path}/page.html",
        "json",
        "csv",
    )
    assert found.status == 0
    pages = {
        path.stem: path.read_text(encoding="utf-8") for path in tmp_path.glob("*.html")
    }
    assert set(pages) == {"page_as_written", "page_port_alone", "page_zero_pitch"}
    assert (
        ">starboard engine<" in pages["page_as_written"]
        and ">starboard engine<" not in pages["page_port_alone"]
    )
    assert {row["scenario"] for row in found.rows} == set(MODES)
    assert found.json["worst"]["line torque half peak-to-peak N m"]["scenario"] in MODES


@pytest.mark.slow
def test_the_command_of_phases_finds_the_worst_angle_in_every_mode(run):
    line = f"phase {PLANT} --rpm 300,360 --of 'shaft torque of line'"
    found = run(line, "json", "csv")
    assert found.status == 0
    wanted = jaxhb.worst_phase(
        jaxhb.load_scene(PLANT),
        "turn",
        rpm=[300.0, 360.0],
        of=[jaxhb.design.Objective(quantity="shaft torque", of="line")],
    )
    assert [float(row["worst"]) for row in found.rows] == pytest.approx(
        wanted.worst[:, 0].tolist(), rel=1e-12
    )
    assert [row["angle"] for row in found.json["phases"]] == pytest.approx(
        wanted.angle[:, 0].tolist(), rel=1e-12
    )
    assert "phase turn, turned through 360 deg of its rotor, 2 speeds" in found.words
    every = run(f"{line} --scenario all", "json")
    worst = every.json["worst"]["shaft torque of line N m"]
    assert worst["scenario"] in MODES and worst["unit"] == "N m"
    (told,) = [
        line
        for line in every.out.split("Largest over all modes")[1].splitlines()
        if "line" in line
    ]
    assert " ".join(told.split()).endswith(f"N m {worst['rpm']:g} {worst['scenario']}")
    assert float(told.split()[4]) == pytest.approx(worst["value"], rel=1e-3)


@pytest.mark.slow
def test_a_sweep_goes_over_the_phase_in_every_mode(run, tmp_path):
    line = f"sweep {PLANT} --rpm 350 --over turn.angle=0:360:3 --scenario all"
    found = run(f"{line} --out {tmp_path}/kept", "csv", "json")
    assert found.status == 0
    train = jaxhb.load_scene(PLANT)
    head = "line torque half peak-to-peak N m"
    for row in found.rows:
        mode = (
            train
            if row["scenario"] == "as written"
            else train.scenario(row["scenario"])
        )
        one = mode.replace({"turn.angle": float(row["turn.angle, deg"])})
        wanted = jaxhb.forced_response(one, rpm=350.0).torque("line").half_peak_to_peak
        assert float(row[head]) == pytest.approx(float(wanted), rel=1e-4)
    assert len(found.rows) == 9
    assert found.json["worst"][head]["turn.angle, deg"] in (0.0, 180.0, 360.0)


def test_modes_that_are_done_are_written_when_another_is_stopped(run, monkeypatch):
    own, called = linear_commands.modes, []

    def stopped(*given, **more):
        called.append(1)
        if len(called) == 2:
            raise KeyboardInterrupt
        return own(*given, **more)

    monkeypatch.setattr(linear_commands, "modes", stopped)
    found = run(f"modes {PLANT} --scenario all", "json")
    assert found.status == 130 and list(found.json["scenarios"]) == ["as written"]
    assert "1 of 3 modes are done" in found.err


CYLINDER = """
[[cylinder]]
name = "starboard 1"
disk = "starboard engine"
gas_torque_mean = 10.0
gas_torque = [[0.5, 30.0, 0.0]]
[[cylinder]]
name = "port 1"
disk = "port engine"
gas_torque_mean = 10.0
gas_torque = [[0.5, 30.0, 0.0]]
"""


@pytest.fixture
def fired(tmp_path):
    path = tmp_path / "fired.toml"
    path.write_text(PLANT.read_text() + CYLINDER)
    return path


@pytest.mark.slow
def test_a_mode_without_the_cylinder_that_misfires_is_skipped_with_a_note(run, fired):
    called = run(
        f"forced {fired} --rpm 300 --scenario all --misfire 'starboard 1'", "json"
    )
    assert called.status == 0 and list(called.json["scenarios"]) == [
        "as written",
        "zero pitch",
    ]
    assert called.json["skipped"] == {
        "port alone": "which has no 'starboard 1' that --misfire names."
    }
    assert (
        "Skipped: port alone, which has no 'starboard 1' that --misfire names."
        in called.out
    )
    found = called.json["scenarios"]["as written"]
    alone = run(f"forced {fired} --rpm 300 --misfire 'starboard 1'", "json").json
    assert found["shafts"] == alone["shafts"]
    alone = run(
        f"forced {fired} --rpm 300 --scenario 'port alone' --misfire 'starboard 1'"
    )
    assert alone.status == 2 and "there is no cylinder 'starboard 1'" in alone.err


@pytest.mark.slow
@pytest.mark.parametrize(
    "line",
    [
        "modes --set 'starboard engine.inertia=30'",
        "forced --rpm 300 --element 'starboard clutch'",
        "forced --rpm 300 --cut-off 'starboard 1'",
        "phase --rpm 300 --phases 4 --of 'shaft torque of starboard clutch'",
    ],
)
def test_every_option_that_names_what_a_mode_lacks_skips_it(run, fired, line):
    command, rest = line.split(" ", 1)
    called = run(f"{command} {fired} {rest} --scenario all", "json")
    assert (called.status, called.err) == (0, "") and list(called.json["skipped"]) == [
        "port alone"
    ]
    assert list(called.json["scenarios"]) == ["as written", "zero pitch"]
