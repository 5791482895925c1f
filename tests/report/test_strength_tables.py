"""Limits in what the commands print and write: forced, solve, sweep, report, tune;
nothing where a scene has none.
"""

import csv
import json
import re

import numpy as np
import pytest
from limited_line import SCENE, strength_of, written
from reference_data import text_of

import jaxhb
from jaxhb.cli.main import main
from jaxhb.report.text.strength import AID

SPEEDS = "300:960:23"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return written(tmp_path_factory.mktemp("line"))


@pytest.fixture(scope="module")
def wanted(scene):
    return strength_of(scene)


def run(scene, capsys, command, *options):
    file = scene.with_name("r.json")
    assert main([command, str(scene), *options, "--json", str(file)]) == 0
    return capsys.readouterr().out, json.loads(file.read_text())


def test_forced_lists_what_is_worst_over_the_speeds_and_bars_ranges(
    scene, wanted, capsys
):
    said, record = run(scene, capsys, "forced", "--rpm", SPEEDS)
    assert said.count(AID) == 4
    assert "IACS UR M68" in said
    assert "to be checked\nagainst its current text" in said
    assert (
        "They do NOT hold for crankshafts: these have a rule of their own, IACS UR M53"
        in said
    )
    found = record["strength"]
    stress = wanted.stresses["line shaft"]
    line = found["stresses"]["line shaft"]
    assert line["stress_Pa"] == stress.stress.tolist()
    assert line["continuous_Pa"][0] == stress.continuous[0]
    assert line["continuous_Pa"][-1] is None
    assert found["rated_rpm"] == 900  # above 1.05 of the rated speed
    (barred,) = wanted.barred["line shaft"]
    assert line["barred"] == [vars(barred) | {"passable": barred.passable}]
    assert (
        f"line shaft: {barred.low:.4g} to {barred.high:.4g} rpm, {barred.share:.2f} of"
        " the continuous limit" in said
    )
    tooth = wanted.tooth_torques["pinion|wheel"]
    assert (
        found["tooth_torques"]["pinion|wheel"]["vibratory_Nm"]
        == tooth.vibratory.tolist()
    )
    assert found["tooth_torques"]["pinion|wheel"]["limit_Nm"] == pytest.approx(500.0)
    assert found["tooth_torques"]["pinion|wheel"]["reverses"] == tooth.reverses.tolist()
    assert list(found["heat"]) == ["coupling", "ring"]
    assert found["heat"]["ring"]["limit_W"] == 40.0
    worst = int(
        np.argmax(
            np.where(
                np.isfinite(stress.continuous), stress.stress / stress.continuous, 0
            )
        )
    )
    table = said[said.index("Torsional stress") :].split("\n\n")[0].splitlines()
    cells = table[2].split()
    assert float(cells[2]) == pytest.approx(stress.stress[worst] / 1e6, abs=0.01)
    assert float(cells[3]) == np.linspace(300.0, 960.0, 23)[worst]
    assert float(cells[6]) == pytest.approx(
        stress.stress[worst] / stress.continuous[worst], abs=0.006
    )


def test_one_speed_has_its_limits_and_no_ranges(scene, wanted, capsys):
    assert (
        "pinion|wheel       3873    500   624   7.75       yes"
        in run(scene, capsys, "solve", "--rpm", "420")[0]
    )
    said, record = run(scene, capsys, "solve", "--rpm", "600")
    assert said.count(AID) == 3
    assert "Barred" not in said
    assert "barred" not in record["strength"]["stresses"]["line shaft"]
    found = record["strength"]["stresses"]["line shaft"]
    at = int(np.argmin(np.abs(wanted.rpm - 600.0)))
    assert found["stress_Pa"] == pytest.approx(
        wanted.stresses["line shaft"].stress[at], rel=1e-6
    )
    assert found["continuous_Pa"] == pytest.approx(
        wanted.stresses["line shaft"].continuous[at], rel=1e-12
    )
    heat = record["strength"]["heat"]["ring"]["power_W"]
    assert heat == pytest.approx(wanted.heat["ring"].power[at], rel=1e-6)


def test_a_sweep_and_a_report_bar_ranges_too(scene, wanted, capsys):
    (barred,) = wanted.barred["line shaft"]
    for command, read in (
        ("sweep", lambda r: r["strength"]),
        ("report", lambda r: r["cases"][0]["strength"]),
    ):
        said, record = run(scene, capsys, command, "--rpm", SPEEDS)
        (found,) = read(record)["stresses"]["line shaft"]["barred"]
        assert (found["low"], found["high"]) == pytest.approx(
            (barred.low, barred.high), rel=1e-6
        )
        assert "Barred speed ranges between 300 and 930 rpm" in said
        assert f"{barred.low:.4g} to {barred.high:.4g}" in said


@pytest.mark.parametrize("command", ["forced", "sweep"])
def test_the_csv_has_columns_of_the_limits(scene, wanted, command):
    file = scene.with_name("r.csv")
    assert main([command, str(scene), "--rpm", "420,600", "--csv", str(file)]) == 0
    with file.open() as text:
        rows = list(csv.DictReader(text))
    stress = wanted.stresses["line shaft"]
    tooth = wanted.tooth_torques["pinion|wheel"]
    for row, at in zip(rows, (4, 10), strict=True):
        found = [
            float(row[f"line shaft {what} Pa"])
            for what in ("stress", "continuous limit", "transient limit")
        ]
        assert found == pytest.approx([values[at] for values in stress], rel=1e-5)
        assert float(row["pinion|wheel vibratory torque N m"]) == pytest.approx(
            tooth.vibratory[at], rel=1e-5
        )
        assert row["pinion|wheel reverses"] == str(bool(tooth.reverses[at]))
        assert float(row["ring limit of heat W"]) == 40.0


@pytest.mark.parametrize("command", ["forced", "solve"])
def test_a_scene_without_limits_tells_of_none(tmp_path, capsys, command):
    path = tmp_path / "plain.toml"
    keys = (
        "rated",
        "power_limit",
        "stress_conc",
        "tensile",
        "length",
        "outer",
        "shear",
        "magnifier",
        "damping_",
    )
    lines = [line for line in SCENE.splitlines() if not line.startswith(keys)]
    text = "\n".join(lines).replace(
        '["wheel", "propeller"]', '["wheel", "propeller"]\nstiffness = 3e5'
    )
    path.write_text(text)
    said, record = run(path, capsys, command, "--rpm", "600")
    assert AID not in said
    assert "strength" not in record


TUNE = "\n" + text_of("line_tune.toml")


def test_a_tuning_keeps_the_stress_within_its_limit(scene, tmp_path, capsys):
    path = tmp_path / "line.toml"
    path.write_text(SCENE + TUNE)
    out = tmp_path / "out"
    out.mkdir()
    assert main(["tune", str(path), "--output", str(out / "tuned.toml")]) == 0
    record = json.loads((out / "tuned.json").read_text())
    found = record["readings"]["stress over continuous limit of line shaft"]
    heat = record["readings"]["power over limit of ring"]
    assert max(found["before"]) < 1.5
    assert max(heat["after"]) < 0.96 * max(heat["before"])
    between = record["checked"]["after"]["worst"][
        "stress over continuous limit of line shaft"
    ]
    tuned = jaxhb.load_scene(out / "tuned.toml")
    fine = jaxhb.strength(
        jaxhb.forced_response(tuned, rpm=np.linspace(390.0, 450.0, 1201))
    ).stresses["line shaft"]
    peak = (fine.stress / fine.continuous).max()
    # It lies between the speeds asked for; the ring, with all the damping that it may
    # have, leaves room to the limit.
    assert max(found["after"]) < between["value"] < 1.6
    assert between["value"] == pytest.approx(peak, rel=1e-4)
    assert record["parameters"]["ring.damping"]["after"] > 0.99 * 400.0
    judged = jaxhb.strength(jaxhb.forced_response(tuned, rpm=record["rpm"])).stresses[
        "line shaft"
    ]
    np.testing.assert_allclose(
        judged.stress / judged.continuous, found["after"], rtol=1e-5
    )
    said = capsys.readouterr().out
    assert "stress over continuous limit of line shaft" in said
    assert "at most 1.6" in said
    # Without the limit between the speeds the tuning would end beyond it.
    assert re.search(
        r"limit of line shaft 1\.0\d+ of its limit at .* rpm, between the speeds"
        r" asked for",
        said,
    )


def test_speeds_for_which_the_rule_has_no_limit_are_not_called_free_of_barred_ranges(
    scene, capsys
):
    beyond = (
        "Above 945 rpm, 1.05 of the rated speed, the rule has no limit: NOT judged;"
        " largest there: line shaft "
    )
    assert main(["forced", str(scene), "--rpm", "900:1200:4"]) == 0
    said = capsys.readouterr().out
    stress = jaxhb.strength(
        jaxhb.forced_response(
            jaxhb.load_scene(scene), rpm=np.linspace(900.0, 1200.0, 4)
        )
    )
    largest = stress.stresses["line shaft"].stress[1:]
    at = 1000 + 100 * int(largest.argmax())
    assert "No barred speed range between 900 and 900 rpm" in said
    assert (
        "Judged from 1 speed: resonances between them are NOT seen, take 50 or more."
        " The rule looks up to 945" in said
    )
    assert f"{beyond}{largest.max() / 1e6:.4g} MPa at {at} rpm." in said
    assert main(["forced", str(scene), "--rpm", "1000:1200:3"]) == 0
    said = capsys.readouterr().out
    assert "arred speed range" not in said
    assert beyond in said


@pytest.mark.parametrize(
    ("speeds", "said"),
    [
        ("500:945:60", "Judged from 60 speeds.\n"),
        ("500:800:4", "Judged from 4 speeds: resonances between them are NOT"),
    ],
)
def test_barred_ranges_say_from_how_many_speeds_they_were_judged(
    scene, capsys, speeds, said
):
    assert main(["forced", str(scene), "--rpm", speeds]) == 0
    assert said in capsys.readouterr().out
