"""Limits in the text and files of the commands forced, solve, sweep, report and tune;
none where a scene has none.
"""

import json
import re

import numpy as np
import pytest
from limited_line import SCENE, strength_of, write_scene
from reference_data import text_of

import jaxhb
from jaxhb.report.text.strength import AID, range_record

SPEEDS = "300:960:23"


@pytest.fixture
def scene(tmp_path):
    return write_scene(tmp_path)


@pytest.fixture(scope="module")
def strength(tmp_path_factory):
    return strength_of(write_scene(tmp_path_factory.mktemp("line")))


def test_forced_lists_the_worst_over_the_speeds_and_bars_ranges(scene, strength, run):
    completed = run(f"forced {scene} --rpm {SPEEDS}", "json")
    completed.check_printed("strength_forced")
    limits = completed.json["strength"]
    stress = strength.stresses["line shaft"]
    stresses = limits["stresses"]["line shaft"]
    (barred,) = strength.barred["line shaft"]
    assert stresses == stresses | {
        "stress_Pa": stress.stress.tolist(),
        "barred": [range_record(barred)],
    }
    # The last speed is above 1.05 of the rated speed.
    assert stresses["continuous_Pa"][0] == stress.continuous[0]
    assert stresses["continuous_Pa"][-1] is None
    assert limits["rated_rpm"] == 900
    sentence = (
        f"line shaft: {barred.low:.4g} to {barred.high:.4g} rpm, {barred.share:.2f} of"
        " the continuous limit"
    )
    assert sentence in completed.out
    tooth = strength.tooth_torques["pinion|wheel"]
    mesh = limits["tooth_torques"]["pinion|wheel"]
    assert mesh == mesh | {
        "vibratory_Nm": tooth.vibratory.tolist(),
        "limit_Nm": pytest.approx(500.0),
        "reverses": tooth.reverses.tolist(),
    }
    assert list(limits["heat"]) == ["coupling", "ring"]
    assert limits["heat"]["ring"]["limit_W"] == 40.0


def test_the_table_of_stresses_has_the_speed_of_the_largest_share(scene, strength, run):
    output = run(f"forced {scene} --rpm {SPEEDS}").out
    stress = strength.stresses["line shaft"]
    shares = stress.stress / stress.continuous
    worst = int(np.argmax(np.where(np.isfinite(stress.continuous), shares, 0)))
    cells = output[output.index("Torsional stress") :].splitlines()[2].split()
    assert float(cells[2]) == pytest.approx(stress.stress[worst] / 1e6, abs=0.01)
    assert float(cells[3]) == np.linspace(300.0, 960.0, 23)[worst]
    assert float(cells[6]) == pytest.approx(shares[worst], abs=0.006)


def test_a_single_speed_has_its_limits_and_no_ranges(scene, strength, run):
    run(f"solve {scene} --rpm 420").check_printed("strength_solve_420_rpm")
    completed = run(f"solve {scene} --rpm 600", "json")
    completed.check_printed("strength_solve_600_rpm")
    limits = completed.json["strength"]
    shaft = limits["stresses"]["line shaft"]
    assert "barred" not in shaft
    place = int(np.argmin(np.abs(strength.rpm - 600.0)))
    stresses = strength.stresses["line shaft"]
    assert shaft["stress_Pa"] == pytest.approx(stresses.stress[place], rel=1e-6)
    limit = stresses.continuous[place]
    assert shaft["continuous_Pa"] == pytest.approx(limit, rel=1e-12)
    heat = strength.heat["ring"].power[place]
    assert limits["heat"]["ring"]["power_W"] == pytest.approx(heat, rel=1e-6)


@pytest.mark.parametrize("command", ["sweep", "report"])
def test_a_sweep_and_a_report_bar_ranges_too(scene, strength, run, command):
    (barred,) = strength.barred["line shaft"]
    completed = run(f"{command} {scene} --rpm {SPEEDS}", "json")
    record = completed.json
    case = record["cases"][0] if command == "report" else record
    (listed,) = case["strength"]["stresses"]["line shaft"]["barred"]
    limits = (barred.low, barred.high)
    assert (listed["low"], listed["high"]) == pytest.approx(limits, rel=1e-6)
    assert "Barred speed ranges between 300 and 930 rpm" in completed.out
    assert f"{barred.low:.4g} to {barred.high:.4g}" in completed.out


@pytest.mark.parametrize("command", ["forced", "sweep"])
def test_the_csv_has_columns_of_the_limits(scene, strength, run, command):
    rows = run(f"{command} {scene} --rpm 420,600", "csv").rows
    stress = strength.stresses["line shaft"]
    tooth = strength.tooth_torques["pinion|wheel"]
    for row, place in zip(rows, (4, 10), strict=True):
        stresses = [
            float(row[f"line shaft {quantity} Pa"])
            for quantity in ("stress", "continuous limit", "transient limit")
        ]
        assert stresses == pytest.approx([values[place] for values in stress], rel=1e-5)
        torque = float(row["pinion|wheel vibratory torque N m"])
        assert torque == pytest.approx(tooth.vibratory[place], rel=1e-5)
        assert row["pinion|wheel reverses"] == str(bool(tooth.reverses[place]))
        assert float(row["ring limit of heat W"]) == 40.0


@pytest.mark.parametrize("command", ["forced", "solve"])
def test_a_scene_without_limits_mentions_none(tmp_path, run, command):
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
    scene_text = "\n".join(lines).replace(
        '["wheel", "propeller"]', '["wheel", "propeller"]\nstiffness = 3e5'
    )
    path.write_text(scene_text)
    completed = run(f"{command} {path} --rpm 600", "json")
    assert AID not in completed.out
    assert "strength" not in completed.json


TUNE = "\n" + text_of("line_tune.toml")


@pytest.mark.slow
def test_a_tuning_keeps_the_stress_within_its_limit(tmp_path, run):
    path = tmp_path / "line.toml"
    path.write_text(SCENE + TUNE)
    out = tmp_path / "out"
    out.mkdir()
    completed = run(f"tune {path} --output {out / 'tuned.toml'}")
    record = json.loads((out / "tuned.json").read_text())
    stress = record["readings"]["stress over continuous limit of line shaft"]
    heat = record["readings"]["power over limit of ring"]
    assert max(stress["before"]) < 1.5
    assert max(heat["after"]) < 0.96 * max(heat["before"])
    between = record["checked"]["after"]["worst"][
        "stress over continuous limit of line shaft"
    ]
    tuned = jaxhb.load_scene(out / "tuned.toml")
    fine = jaxhb.strength(
        jaxhb.forced_response(tuned, rpm=np.linspace(390.0, 450.0, 1201))
    ).stresses["line shaft"]
    peak = (fine.stress / fine.continuous).max()
    # The peak lies between the speeds of the tuning; the ring, with all the damping
    # that it may have, leaves room to the limit.
    assert max(stress["after"]) < between["value"] < 1.6
    assert between["value"] == pytest.approx(peak, rel=1e-4)
    assert record["parameters"]["ring.damping"]["after"] > 0.99 * 400.0
    judged = jaxhb.strength(jaxhb.forced_response(tuned, rpm=record["rpm"])).stresses[
        "line shaft"
    ]
    np.testing.assert_allclose(
        judged.stress / judged.continuous, stress["after"], rtol=1e-5
    )
    text = completed.out
    assert "stress over continuous limit of line shaft" in text
    assert "at most 1.6" in text
    # Without the limit between the speeds the tuning would end beyond it.
    assert re.search(
        r"limit of line shaft 1\.0\d+ of its limit at .* rpm, between the speeds"
        r" asked for",
        text,
    )


def test_speeds_for_which_the_rule_has_no_limit_are_not_judged(scene, run):
    rpm = np.linspace(900.0, 1200.0, 4)
    response = jaxhb.forced_response(jaxhb.load_scene(scene), rpm=rpm)
    above = jaxhb.strength(response).stresses["line shaft"].stress[1:]
    sentence = (
        "Above 945 rpm, 1.05 of the rated speed, the rule has no limit: NOT judged;"
        f" largest there: line shaft {above.max() / 1e6:.4g} MPa at"
        f" {rpm[1:][above.argmax()]:.0f} rpm."
    )
    completed = run(f"forced {scene} --rpm 900:1200:4")
    completed.check_printed("strength_around_the_limit_of_the_rule")
    assert sentence in completed.out
    completed = run(f"forced {scene} --rpm 1000:1200:3")
    completed.check_printed("strength_above_the_limit_of_the_rule")
    assert sentence in completed.out


@pytest.mark.parametrize(
    ("speeds", "sentence"),
    [
        ("500:945:60", "Judged from 60 speeds.\n"),
        ("500:800:4", "Judged from 4 speeds: resonances between them are NOT"),
    ],
)
def test_barred_ranges_say_from_how_many_speeds_they_were_judged(
    scene, run, speeds, sentence
):
    assert sentence in run(f"forced {scene} --rpm {speeds}").out
