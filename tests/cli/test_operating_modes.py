"""Several scenarios in one call of a command, against calls for each alone."""

import pytest
from reference_data import DATA

import jaxhb
from jaxhb.cli import linear_commands

PLANT = DATA / "scenes" / "two_engines.toml"
MODES = {
    "as written": "",
    "port alone": " --scenario 'port alone'",
    "zero pitch": " --scenario 'zero pitch'",
}


def train_of(scenario):
    """The plant in a mode."""
    plant = jaxhb.load_scene(PLANT)
    return plant if scenario == "as written" else plant.scenario(scenario)


def listed_last(completed, name):
    """Cells of the row of a name in the table of the largest values over all modes."""
    table = completed.out.split("Largest over all modes")[1]
    (row,) = (line.split() for line in table.splitlines() if name in line)
    return row


@pytest.fixture(scope="module")
def forced(run_once):
    """The forced response in all modes, and in each alone."""
    options = {"all": " --scenario all"} | MODES
    return {
        name: run_once(f"forced {PLANT} --rpm 200:700:6{option}", "json", "csv")
        for name, option in options.items()
    }


@pytest.mark.slow
def test_files_of_all_modes_hold_what_each_alone_gives(forced):
    completed = forced["all"]
    scenarios = completed.json["scenarios"]
    assert list(scenarios) == list(MODES)
    for name in MODES:
        assert scenarios[name] == forced[name].json
        # A link that is open has no number there.
        rows = [
            {head: cell for head, cell in row.items() if cell and head != "scenario"}
            for row in completed.rows
            if row["scenario"] == name
        ]
        assert rows == [
            {head: cell for head, cell in row.items() if cell}
            for row in forced[name].rows
        ]


@pytest.mark.slow
def test_the_worst_of_every_quantity_is_named_with_its_mode_and_speed(forced):
    worst = forced["all"].json["worst"]
    head = "port clutch half peak-to-peak N m"
    rows = [
        (float(row[head]), name, float(row["rpm"]))
        for name in MODES
        for row in forced[name].rows
    ]
    value, mode, rpm = max(rows, key=lambda row: row[0])
    assert worst[head] == {
        "value": value,
        "unit": "N m",
        "scenario": mode,
        "case": "",
        "rpm": rpm,
    }
    assert "line stress Pa" in worst
    assert not any("limit" in name for name in worst)
    row = " ".join(listed_last(forced["all"], "port clutch half"))
    assert row.endswith(f"{value:.0f} N m {rpm:g} {mode}")


def test_chosen_modes_are_those_named_and_other_files_are_theirs(run, tmp_path):
    line = f"modes {PLANT} --scenario 'zero pitch' --scenario 'port alone'"
    completed = run(line, "json", "plot")
    completed.check_printed("modes_of_two_scenarios")
    scenarios = completed.json["scenarios"]
    assert list(scenarios) == ["zero pitch", "port alone"]
    pictures = sorted(path.name for path in tmp_path.glob("*.png"))
    assert pictures == ["plot_port_alone.png", "plot_zero_pitch.png"]
    alone = jaxhb.natural_frequencies(train_of("port alone")).frequencies_hz.tolist()
    frequencies = scenarios["port alone"]["frequencies_hz"]
    assert frequencies == pytest.approx(alone, rel=1e-12, abs=1e-9)
    quiet = run(f"modes {PLANT} --scenario all --json -")
    assert quiet.out.startswith('{"scenarios": ')


@pytest.mark.slow
def test_a_report_and_its_page_tell_every_mode(run, tmp_path):
    page = tmp_path / "page.html"
    line = f"report {PLANT} --rpm 300,500 --scenario all --html {page}"
    completed = run(line, "json", "csv")
    pages = {path.stem: path.read_text("utf-8") for path in tmp_path.glob("*.html")}
    assert set(pages) == {"page_as_written", "page_port_alone", "page_zero_pitch"}
    assert ">starboard engine<" in pages["page_as_written"]
    assert ">starboard engine<" not in pages["page_port_alone"]
    assert {row["scenario"] for row in completed.rows} == set(MODES)
    worst = completed.json["worst"]["line torque half peak-to-peak N m"]
    assert worst["scenario"] in MODES


@pytest.mark.slow
def test_the_command_of_phases_finds_the_worst_angle_in_every_mode(run):
    line = f"phase {PLANT} --rpm 300,360 --of 'shaft torque of line'"
    completed = run(line, "json", "csv")
    completed.check_printed("phase")
    expected = jaxhb.worst_phase(
        jaxhb.load_scene(PLANT),
        "turn",
        rpm=[300.0, 360.0],
        of=[jaxhb.design.Objective(quantity="shaft torque", of="line")],
    )
    torques = [float(row["worst"]) for row in completed.rows]
    assert torques == pytest.approx(expected.worst[:, 0].tolist(), rel=1e-12)
    angles = [row["angle"] for row in completed.json["phases"]]
    assert angles == pytest.approx(expected.angle[:, 0].tolist(), rel=1e-12)
    of_all = run(f"{line} --scenario all", "json")
    worst = of_all.json["worst"]["shaft torque of line N m"]
    assert worst["scenario"] in MODES
    assert worst["unit"] == "N m"
    row = listed_last(of_all, "line")
    assert " ".join(row).endswith(f"N m {worst['rpm']:g} {worst['scenario']}")
    assert float(row[4]) == pytest.approx(worst["value"], rel=1e-3)


@pytest.mark.slow
def test_a_sweep_goes_over_the_phase_in_every_mode(run, tmp_path):
    line = f"sweep {PLANT} --rpm 350 --over turn.angle=0:360:3 --scenario all"
    completed = run(f"{line} --out {tmp_path}/kept", "csv", "json")
    head = "line torque half peak-to-peak N m"
    for row in completed.rows:
        angle = float(row["turn.angle, deg"])
        turned = train_of(row["scenario"]).replace({"turn.angle": angle})
        swing = jaxhb.forced_response(turned, rpm=350.0).torque("line")
        expected = float(swing.half_peak_to_peak)
        assert float(row[head]) == pytest.approx(expected, rel=1e-4)
    assert len(completed.rows) == 9
    assert completed.json["worst"][head]["turn.angle, deg"] in (0.0, 180.0, 360.0)


def test_modes_that_are_done_are_written_when_another_is_stopped(run, monkeypatch):
    modes = linear_commands.modes
    calls = []

    def stopped(*arguments, **options):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return modes(*arguments, **options)

    monkeypatch.setattr(linear_commands, "modes", stopped)
    completed = run(f"modes {PLANT} --scenario all", "json", status=130)
    assert list(completed.json["scenarios"]) == ["as written"]
    assert "1 of 3 modes are done" in completed.err


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
    line = f"forced {fired} --rpm 300 --misfire 'starboard 1'"
    completed = run(f"{line} --scenario all", "json")
    record = completed.json
    assert list(record["scenarios"]) == ["as written", "zero pitch"]
    reason = "which has no 'starboard 1' that --misfire names."
    assert record["skipped"] == {"port alone": reason}
    assert f"Skipped: port alone, {reason}" in completed.out
    alone = run(line, "json").json
    assert record["scenarios"]["as written"]["shafts"] == alone["shafts"]
    refused = run(f"{line} --scenario 'port alone'", status=2)
    assert "there is no cylinder 'starboard 1'" in refused.err


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
    command, options = line.split(" ", 1)
    completed = run(f"{command} {fired} {options} --scenario all", "json")
    assert completed.err == ""
    record = completed.json
    assert list(record["skipped"]) == ["port alone"]
    assert list(record["scenarios"]) == ["as written", "zero pitch"]
