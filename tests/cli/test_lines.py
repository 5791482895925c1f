"""Torques with lines at fixed frequencies at a terminal: told, drawn, written, and
refused where a periodic motion is asked for.
"""

import numpy as np
import pytest

import jaxhb

SCENE = """
[scene]
name = "grid"
revolutions_per_cycle = 1

[[disk]]
name = "motor"
inertia = 1.0

[[disk]]
name = "fan"
inertia = 2.0

[[shaft]]
name = "line"
between = ["motor", "fan"]
stiffness = 1e4
damping = 2.0

[[torque]]
name = "ripple"
disk = "motor"
harmonics = [[2.0, 3.0, 0.0]]
lines = [[90.0, 0.0, 1.5], [18.0, 5.0, 0.0]]
"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "grid.toml"
    path.write_text(SCENE)
    return path


def test_forced_tells_and_writes_the_lines(scene, run):
    completed = run(f"forced {scene} --rpm 300:900:3", "json", "csv", "plot")
    response = jaxhb.forced_response(
        jaxhb.load_scene(scene), rpm=np.linspace(300.0, 900.0, 3)
    )
    signal = response.torque("line")
    assert "lines at fixed frequencies, largest amplitude over the speeds" in (
        completed.out
    )
    assert "synthesis and sum hold their amplitudes" in completed.out
    record = completed.json
    assert record["lines_hz"] == [18.0, 90.0]
    shaft = record["shafts"]["line"]
    amplitudes = [signal.line(18.0).tolist(), signal.line(90.0).tolist()]
    assert shaft["line_amplitudes"] == amplitudes
    assert shaft["half_peak_to_peak"] == signal.half_peak_to_peak.tolist()
    rows = completed.rows
    assert [float(row["line 18 Hz N m"]) for row in rows] == amplitudes[0]
    each = run(f"forced {scene} --rpm 300:900:3 --element line")
    assert "18 Hz" in each.out
    assert "90 Hz" in each.out


def test_check_and_campbell_list_the_lines(scene, run):
    checked = run(f"check {scene}", "json")
    assert "Lines of torques at fixed frequencies" in checked.out
    lines = checked.json["lines"]
    assert [(line["torque"], line["hz"]) for line in lines] == [
        ("ripple", 90.0),
        ("ripple", 18.0),
    ]
    assert [line["amplitude_Nm"][0] for line in lines] == [1.5, 5.0]
    diagram = run(f"campbell {scene} --rpm 100:1000", "json", "plot")
    assert "nearest elastic mode, at every speed" in diagram.out
    nearest = diagram.json["lines"][0]
    assert nearest["hz"] == 18.0
    assert nearest["rpm"] is None
    natural = np.sqrt(1e4 * 1.5) / (2 * np.pi)
    assert abs(nearest["mode_hz"] - natural) < 1e-9 * natural


@pytest.mark.parametrize("command", ["solve", "sweep", "report"])
def test_commands_of_periodic_motions_refuse_the_lines(command, scene, run):
    rpm = "300:900:3" if command == "sweep" else "300"
    refused = run(f"{command} {scene} --rpm {rpm}", status=2)
    assert "[[torque]] 'ripple' has lines at fixed frequencies" in refused.err
    assert "jaxhb forced" in refused.err
