"""``jaxhb campbell``: critical speeds that a calculation by hand gives, in the table, the files and the picture."""

import csv
import json
from types import SimpleNamespace

import numpy as np
import pytest

import jaxhb
from jaxhb.cli.main import main
from jaxhb.linear.critical import Critical, campbell
from jaxhb.report.figures.figure import DIGITS
from jaxhb.report.figures.linear import counting, plot_campbell
from jaxhb.report.text.linear import shares_in_mode

SCENE = "six_cylinder_diesel"
TORQUES = (1, 200.0), (1, 1.0), (2, 0.5), (2, 0.25), (3, 0.0)
"""Modes and modal torques, N m."""
PENDULUM = """
[scene]
name = "pendulum"
revolutions_per_cycle = 1
[[disk]]
name = "crank"
inertia = 1.0
[[disk]]
name = "load"
inertia = 3.0
[[shaft]]
name = "shaft"
between = ["crank", "load"]
stiffness = 4e5
over_hz = [[0, 1.0, 1.0], [100, 1.0, 1.0]]
[[damper]]
name = "ring"
disk = "crank"
inertia = 0.1
order = 3
[[torque]]
disk = "load"
harmonics = [[3, 100.0, 0.0]]
"""


def test_the_table_and_the_files_hold_sixty_times_hz_over_the_order_by_rising_speed(capsys, tmp_path):
    files = [f"--json={tmp_path / 'c.json'}", f"--csv={tmp_path / 'c.csv'}", f"--plot={tmp_path / 'c.png'}"]
    assert main(["campbell", SCENE, "--rpm", "1000:2600", "--orders", "6,9,3", *files]) == 0
    hz = jaxhb.natural_frequencies(jaxhb.load_scene(SCENE)).frequencies_hz[1]
    record = json.loads((tmp_path / "c.json").read_text())
    found = [(c["rpm"], c["order"], c["mode"], c["hz"]) for c in record["critical_speeds"]]
    assert found == [(60 * hz / 9, 9.0, 1, hz), (60 * hz / 6, 6.0, 1, hz)]
    assert record["orders"] == [3.0, 6.0, 9.0] and record["rpm"][0] == 1000.0 and record["rpm"][-1] == 2600.0
    assert [m["kind"] for m in record["modes"]] == ["rigid"] + ["elastic"] * 6
    with (tmp_path / "c.csv").open() as text:
        rows = list(csv.DictReader(text))
    assert [float(row["rpm"]) for row in rows] == [row[0] for row in found]
    said = capsys.readouterr().out
    assert [line.split()[:4] for line in said.splitlines()[-2:]] == [
        ["1443.9", "9", "1", "216.58"],
        ["2165.8", "6", "1", "216.58"],
    ]
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")


def test_orders_are_those_of_the_torques_unless_given(tmp_path, capsys):
    (tmp_path / "p.toml").write_text(PENDULUM)
    assert main(["campbell", str(tmp_path / "p.toml"), "--rpm", "600:4000:9", "--links-at", "hz=50"]) == 0
    said = capsys.readouterr().out
    assert "Orders: 3." in said and "Hz at 600 rpm  at 4000 rpm" in said
    assert said.splitlines()[-3].split()[:4] == ["1162.3", "3", "1", "58.12"]  # sqrt(4e5 / 3) / 2 pi, times 60 / 3


def test_a_link_that_varies_with_the_frequency_must_be_made_constant(tmp_path, capsys):
    (tmp_path / "p.toml").write_text(PENDULUM)
    assert main(["campbell", str(tmp_path / "p.toml"), "--rpm", "600:4000"]) == 2
    assert "'shaft' has over_hz" in capsys.readouterr().err


def test_the_picture_has_modes_rays_and_circles_at_the_critical_speeds():
    found = campbell(jaxhb.load_scene(SCENE), rpm=[1000.0, 2600.0], orders=[3.0, 6.0])
    (axes,) = plot_campbell(found, 6, SCENE).axes
    lines = axes.get_lines()
    (ray,) = [line for line in lines if line.get_linestyle() == "--" and line.get_ydata()[1] == 260.0]
    assert ray.get_ydata()[0] == 100.0
    circles = [line.get_xdata() for line in lines if line.get_marker() == "o"]
    assert sorted(np.concatenate(circles)) == pytest.approx(
        [c.rpm for c in found.critical], rel=0.5 * 10 ** (1 - DIGITS)
    )
    filled = [line.get_xdata() for line in lines if line.get_marker() == "o" and line.get_markerfacecolor() != "none"]
    assert [len(own) for own in filled] == [len(counting(found))]
    said = [text.get_text().strip() for text in axes.texts]
    assert {"mode 0: rigid", "mode 1: 216.6 Hz", "3", "6"} == set(said)


def test_modes_that_are_left_out_are_counted_with_why_and_how_to_have_them(capsys):
    command = ["campbell", "gear_train_30", "--rpm", "700:2450", "--orders", "0.5,12"]
    hz = jaxhb.natural_frequencies(jaxhb.load_scene("gear_train_30")).frequencies_hz[1:]
    crossed = int((hz <= 12 * 2450 / 60).sum())
    assert main(command) == 0
    said = capsys.readouterr().out
    assert f"These are the 6 lowest of {len(hz)} modes that strain links; the orders reach {crossed} of them" in said
    assert f"jaxhb campbell SCENE --rpm 700:2450 --modes {crossed} lists all." in said
    assert main([*command, "--modes", str(crossed)]) == 0
    assert " of them, all shown: order 12 at 2450 rpm is 490 Hz." in capsys.readouterr().out


def test_modal_torques_count_beside_those_of_their_mode_alone(capsys):
    own = [Critical(1000.0 + k, 1.0, mode, 50.0, torque) for k, (mode, torque) in enumerate(TORQUES)]
    found = SimpleNamespace(critical=own)
    assert shares_in_mode(own, [c.torque for c in own]) == [1.0, 0.005, 1.0, 0.5, 0.0]
    assert counting(found) == [own[0], own[2], own[3]]
    assert main(["campbell", SCENE, "--rpm", "1000:2600"]) == 0
    assert "Every mode has a scale of its own: compare the orders of one mode, not modes." in capsys.readouterr().out


@pytest.mark.parametrize(
    "options, why",
    [
        (["--rpm", "1000"], "at least two speeds, in rising order"),
        (["--rpm", "2000:1000"], "at least two speeds, in rising order"),
        (["--rpm", "900:1000", "--orders", "3,x"], "'x' must be a number greater than 0"),
        (["--rpm", "900:1000", "--modes", "0"], "a whole number of at least 1"),
    ],
)
def test_bad_input_exits_2_with_a_sentence(options, why, capsys):
    assert main(["campbell", SCENE, *options]) == 2
    assert why in capsys.readouterr().err


def test_an_order_that_does_nothing_on_a_shape_has_a_modal_torque_of_zero(tmp_path, capsys):
    """At the order to which it is tuned an absorber holds its disk, on which alone the torque acts."""
    (tmp_path / "p.toml").write_text(PENDULUM.replace('[[torque]]\ndisk = "load"', '[[torque]]\ndisk = "crank"'))
    command = ["campbell", str(tmp_path / "p.toml"), "--rpm", "500:6000:40", "--links-at", "hz=0"]
    assert main([*command, "--orders", "3", "--json", str(tmp_path / "c.json")]) == 0
    (only,) = json.loads((tmp_path / "c.json").read_text())["critical_speeds"]
    assert only["modal_torque"] == 0.0
    assert capsys.readouterr().out.splitlines()[-3].split()[-1] == "0"


def test_the_modal_torques_of_every_misfire_are_those_of_its_train(tmp_path, capsys):
    files = [f"--json={tmp_path / 'c.json'}", f"--csv={tmp_path / 'c.csv'}"]
    assert main(["campbell", SCENE, "--rpm", "1000:2600", "--misfire", "each", *files]) == 0
    said, record = capsys.readouterr().out, json.loads((tmp_path / "c.json").read_text())
    assert (
        main(["campbell", SCENE, "--rpm", "1000:2600", "--misfire", "cylinder 3", f"--json={tmp_path / 'd.json'}"]) == 0
    )
    alone = {
        (c["order"], c["mode"]): c["modal_torque"]
        for c in json.loads((tmp_path / "d.json").read_text())["critical_speeds"]
    }
    speeds = record["critical_speeds"]
    assert all(c["misfires"]["cylinder 3"] == pytest.approx(alone[c["order"], c["mode"]], rel=1e-12) for c in speeds)
    worst = record["worst_misfire"]
    assert worst["modal_torque"] == max(torque for c in speeds for torque in c["misfires"].values())
    assert f"The worst misfire is that of {worst['cylinder']}" in said
    with (tmp_path / "c.csv").open() as text:
        row = next(csv.DictReader(text))
    assert float(row["modal torque N m, cylinder 3 not firing"]) == speeds[0]["misfires"]["cylinder 3"]


def test_a_range_without_critical_speeds_has_no_worst_misfire(tmp_path, capsys):
    call = [
        "campbell",
        SCENE,
        "--rpm",
        "900:901",
        "--orders",
        "1",
        "--misfire",
        "each",
        f"--json={tmp_path / 'c.json'}",
    ]
    assert main(call) == 0
    assert "No critical speed lies in the range" in capsys.readouterr().out
    assert json.loads((tmp_path / "c.json").read_text())["worst_misfire"] is None
