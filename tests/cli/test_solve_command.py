"""``jaxhb solve`` and ``jaxhb sweep``: exit status, files, sentences, computed bounds,
numbers as from Python.
"""

import dataclasses
import json
import math
import re

import numpy as np
import pytest
from printed import HAMMERING

import jaxhb
from jaxhb.balance import plan as planning
from jaxhb.report.answer import Answer
from jaxhb.report.files.numbers import answer_record
from jaxhb.report.files.output import as_json
from jaxhb.report.text.sentences import verdict
from jaxhb.results.bounds import NORM_MARGIN, ROW_SUM_MARGIN
from jaxhb.results.steady import orbit_state

MESH = "gear a|gear b"
SIGNAL = {
    "mean",
    "min",
    "max",
    "rms",
    "half_peak_to_peak",
    "sum_of_amplitudes",
    "amplitudes",
}
CONTACT = {
    "elastic",
    "separated_fraction",
    "reverse_contact_fraction",
    "impacts",
    "impacts_per_cycle",
    "hardest_impact",
    "drive_side",
    "gap_spring_force",
    "knee_force",
}
KEYS = {
    "rpm",
    "motion",
    "converged",
    "status",
    "harmonics",
    "residual",
    "truncation_error",
    "path",
    "load_kW",
    "power_defect",
    "load_torque_Nm",
    "ground_reaction_Nm",
    "mean_angles",
    "disks",
    "shafts",
    "gears",
    "meshes",
}
HAMMERING_PAIR = "solve spur_pair --rpm 5000"
DIESEL = "solve six_cylinder_diesel --rpm 1500"


@pytest.fixture(scope="module")
def hammering(run_once):
    """A hammering solve with files and a computed bound."""
    return run_once(f"{HAMMERING_PAIR} --certify", "json", "plot")


@pytest.fixture(scope="module")
def response():
    """The same from Python."""
    return jaxhb.steady_state(jaxhb.load_scene("spur_pair"), rpm=5000.0).response


@pytest.mark.slow
def test_a_hammering_pair_exits_0_and_its_file_follows_the_contract(hammering):
    hammering.check_printed("solve_hammering", HAMMERING)
    files = sorted(path.name for path in hammering.folder.iterdir())
    assert files == ["json.json", "plot.png"]
    record = hammering.json
    assert set(record) >= KEYS
    assert record == record | {
        "rpm": 5000.0,
        "converged": True,
        "status": "CONVERGED",
        "set": {},
        "misfire": [],
    }
    assert all(isinstance(line, str) for line in record["path"])
    assert set(record["disks"]) == {"gear a", "gear b"}
    assert set(record["disks"]["gear a"]) == {
        "mean",
        "half_peak_to_peak",
        "amplitudes",
        "speed",
        "acceleration",
        "irregularity",
    }
    assert set(record["gears"]["gear a"]) == SIGNAL
    mesh = record["meshes"][MESH]
    assert set(mesh) >= SIGNAL | CONTACT
    assert set(mesh["elastic"]) == SIGNAL
    assert mesh["separated_fraction"] > 0.1
    assert mesh["drive_side"] == 1
    without = record["without_backlash"]["meshes"][MESH]
    assert without["separated_fraction"] == 0
    assert 0 < without["max"] < mesh["max"]


@pytest.mark.slow
def test_the_numbers_of_the_file_are_those_of_python(hammering, response):
    force = response.force("gear a", "gear b")
    contact = response.mesh("gear a", "gear b")
    record = hammering.json
    mesh = record["meshes"][MESH]
    assert mesh["max"] == float(force.max)
    assert mesh["elastic"]["max"] == float(force.elastic.max)
    assert mesh["separated_fraction"] == contact.separated_fraction
    speeds = [impact["speed"] for impact in mesh["impacts"]]
    assert speeds == [impact["speed"] for impact in contact.impacts]
    assert mesh["amplitudes"][0] == [
        32.0,
        float(force.amplitudes[0]),
        float(force.phases_deg[0]),
    ]
    total = sum(row[1] for row in mesh["amplitudes"])
    assert total == pytest.approx(mesh["sum_of_amplitudes"], rel=1e-9)
    mean = float(response.gear_torque("gear b").mean)
    assert record["gears"]["gear b"]["mean"] == mean


@pytest.mark.slow
def test_a_computed_bound_is_told_in_words_with_its_margins_and_written_as_from_python(
    hammering, response
):
    certificate = jaxhb.certify(response)
    output = hammering.out
    bound = hammering.json["certificate"]
    margins = {"iterated_norms": NORM_MARGIN, "estimated_row_sums": ROW_SUM_MARGIN}
    assert bound == bound | {
        "holds": True,
        "reason": "",
        "h0": pytest.approx(bound["Y0"] * bound["Z2"]),
        "margins": margins,
    }
    assert bound["h0"] <= 0.5
    mesh = bound["meshes"][MESH]
    expected = {
        "force_N": float(certificate.force_bound[0]),
        "elastic_force_N": float(certificate.elastic_bound[0]),
        "deflection_m": float(certificate.deflection_bound[0]),
    }
    assert mesh == pytest.approx(expected, rel=1e-6)
    (numbers,) = re.findall(
        r"^Computed bound: the largest tooth force is (\S+) kN, within (\S+) kN of",
        output,
        re.MULTILINE,
    )
    largest, within = map(float, numbers)
    peak = float(response.force(MESH).peak) / 1e3
    assert largest == pytest.approx(peak, rel=1e-3)
    # Two digits, rounded up: 10.1 becomes 11.
    assert mesh["force_N"] <= 1e3 * within <= 1.12 * mesh["force_N"]
    # Both stand beside the number, here and in Python.
    for name, margin in margins.items():
        words = f"{name.replace('_', ' ')} x{margin:g}"
        assert words in output
        assert words in str(certificate)


def test_trains_without_teeth_have_a_computed_bound_too(run_once):
    completed = run_once(f"{DIESEL} --certify", "json")
    completed.check_printed("solve_diesel_bound")
    certificate = completed.json["certificate"]
    assert certificate == certificate | {"holds": True, "meshes": {}}


BEYOND = f"{HAMMERING_PAIR} --harmonics 16 --tolerance 1e-12"


@pytest.mark.slow
def test_a_solve_that_does_not_converge_marks_its_tables_and_says_what_to_try(run_once):
    """The kind is known, the solution is not within its tolerance."""
    completed = run_once(BEYOND, "json", status=1)
    completed.check_printed("solve_not_converged", HAMMERING)
    *tables, notes = [
        block.splitlines()[0]
        for block in completed.out.split("\n\n")
        if block.count("\n  ")
    ]
    for head in tables:
        assert head.startswith("NOT CONVERGED: ")
    assert notes == "Notes"


@pytest.mark.slow
def test_a_solve_with_the_most_harmonics_says_that_they_are_too_few(run, monkeypatch):
    monkeypatch.setitem(planning.MOST_HARMONICS, "reduced", 16)
    sentence = (
        "TOLERANCE_NOT_MET, the motion is solved, but 16 harmonics, the most that are"
        " taken, are too few for the tolerance: accept its error with --tolerance."
    )
    assert sentence in run(BEYOND, status=1).err


def test_orders_shorten_the_lists_and_nothing_else(run_once):
    whole = run_once(DIESEL, "json").json
    shaft = whole["shafts"]["cyl1|cyl2"]
    short = run_once(f"{DIESEL} --orders 3", "json").json["shafts"]["cyl1|cyl2"]
    assert short == shaft | {"amplitudes": shaft["amplitudes"][:6]}
    assert whole["meshes"] == whole["gears"] == {}
    assert "certificate" not in whole


def test_a_misfire_and_a_changed_number_are_those_of_python(run_once):
    line = f"{DIESEL} --misfire 'cylinder 3' --set cyl1.damping=20"
    record = run_once(line, "json").json
    train = (
        jaxhb.load_scene("six_cylinder_diesel")
        .misfire("cylinder 3")
        .replace({"cyl1.damping": 20.0})
    )
    swing = jaxhb.solve(train, rpm=1500.0).torque("cyl2", "cyl3").half_peak_to_peak
    assert record["shafts"]["cyl2|cyl3"]["half_peak_to_peak"] == float(swing)
    assert record["not_firing"] == ["cylinder 3: no injection, compression stays"]


@pytest.mark.slow
def test_a_cylinder_that_is_cut_off_carries_nothing_and_a_misfiring_cylinder_pumps():
    diesel = jaxhb.load_scene("six_cylinder_diesel")
    mean, misfire, cut_off = (
        jaxhb.forced_response(train, rpm=1500.0).torque("cyl6", "flywheel").mean
        for train in (
            diesel,
            diesel.misfire("cylinder 3"),
            diesel.cut_off("cylinder 3"),
        )
    )
    assert cut_off == pytest.approx(5 / 6 * mean)
    # It takes in at 2.7 bar and pushes out at 2.5.
    assert cut_off < misfire < 1.01 * cut_off


def test_the_command_tells_what_is_computed_of_a_cylinder_that_is_cut_off(run_once):
    completed = run_once(f"{DIESEL} --cut-off 'cylinder 3'", "json")
    completed.check_printed("solve_cut_off")
    record = completed.json
    assert record == record | {
        "misfire": [],
        "cut_off": ["cylinder 3"],
        "not_firing": ["cylinder 3: cut off, no gas torque at all"],
    }
    train = jaxhb.load_scene("six_cylinder_diesel").cut_off("cylinder 3")
    torque = jaxhb.solve(train, rpm=1500.0).torque("cyl2", "cyl3")
    assert record["shafts"]["cyl2|cyl3"]["max"] == float(torque.max)


def test_numbers_that_are_not_finite_become_null(response):
    broken = dataclasses.replace(
        response,
        forces=np.full_like(response.forces, np.nan),
        elastic_forces=np.full_like(response.elastic_forces, np.nan),
        angles=np.full_like(response.angles, np.nan),
        residual=np.array(math.inf),
        status=np.array(7),
    )
    train = jaxhb.load_scene("spur_pair")
    linear = jaxhb.linear_response(train, rpm=5000.0)
    answer = Answer(train, orbit_state(broken), linear, orbit=True)
    record = json.loads(b"".join(as_json(answer_record(answer))))
    assert record == record | {"residual": None, "status": "NONFINITE"}
    mesh = record["meshes"][MESH]
    assert mesh["max"] is mesh["separated_fraction"] is None
    assert verdict(answer).startswith("No answer at 5000 rpm")


def test_a_sweep_writes_one_response_and_one_row_per_speed(run_once):
    line = "sweep spur_pair --rpm 2000,5600 --set 'gear a.damping=0.01'"
    completed = run_once(line, "json", "csv", "plot")
    completed.check_printed("sweep_two_speeds", HAMMERING)
    record = completed.json
    responses = record["responses"]
    rows = completed.rows
    assert [row["rpm"] for row in responses] == [2000.0, 5600.0]
    assert record == record | {
        "rpm": [2000.0, 5600.0],
        "set": {"gear a.damping": 0.01},
        "misfire": [],
    }
    harmonics = [row["harmonics"] for row in responses]
    assert [int(row["harmonics"]) for row in rows] == harmonics
    assert harmonics[0] < harmonics[1]
    largest = [row["meshes"][MESH]["max"] for row in responses]
    assert [float(row[f"{MESH} max N"]) for row in rows] == largest
    without = [row["without_backlash"]["meshes"][MESH]["max"] for row in responses]
    cells = [float(row[f"{MESH} max N without backlash"]) for row in rows]
    assert cells == without
