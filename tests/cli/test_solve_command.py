"""``jaxhb solve`` and ``jaxhb sweep``: exit status, files, sentences, computed bounds,
numbers as from Python.
"""

import dataclasses
import json
import math
import re

import numpy as np
import pytest

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
}
CONTACT |= {"hardest_impact", "drive_side", "gap_spring_force", "knee_force"}
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
}
KEYS |= {
    "power_defect",
    "load_torque_Nm",
    "ground_reaction_Nm",
    "mean_angles",
    "disks",
    "shafts",
    "gears",
    "meshes",
}
HAMMERING = "solve spur_pair --rpm 5000"
DIESEL = "solve six_cylinder_diesel --rpm 1500"


@pytest.fixture(scope="module")
def hammering(told):
    """One hammering solve with files and a computed bound."""
    return told(f"{HAMMERING} --certify", "json", "plot")


@pytest.fixture(scope="module")
def response():
    """The same from Python."""
    return jaxhb.steady_state(jaxhb.load_scene("spur_pair"), rpm=5000.0).response


@pytest.mark.slow
def test_a_hammering_pair_exits_0_and_its_file_follows_the_contract(hammering):
    assert (hammering.status, hammering.err) == (0, "")
    assert hammering.out.startswith(
        "The teeth hammer at 5000 rpm: gear a|gear b is apart "
    )
    assert (
        sorted(path.name for path in hammering.folder.iterdir())
        == ["json.json", "plot.png"]
        and hammering.is_drawn
    )
    record = hammering.json
    assert set(record) >= KEYS
    assert (record["rpm"], record["converged"], record["status"]) == (
        5000.0,
        True,
        "CONVERGED",
    )
    assert (record["set"], record["misfire"]) == ({}, [])
    assert all(isinstance(line, str) for line in record["path"])
    assert set(record["disks"]) == {"gear a", "gear b"}
    turning = {"speed", "acceleration", "irregularity"}
    assert (
        set(record["disks"]["gear a"])
        == {"mean", "half_peak_to_peak", "amplitudes"} | turning
    )
    assert set(record["gears"]["gear a"]) == SIGNAL
    mesh = record["meshes"][MESH]
    without = record["without_backlash"]["meshes"][MESH]
    assert set(mesh) >= SIGNAL | CONTACT and set(mesh["elastic"]) == SIGNAL
    assert mesh["separated_fraction"] > 0.1 and mesh["drive_side"] == 1
    assert without["separated_fraction"] == 0 and 0 < without["max"] < mesh["max"]


@pytest.mark.slow
def test_the_numbers_of_the_file_are_those_of_python(hammering, response):
    force = response.force("gear a", "gear b")
    contact = response.mesh("gear a", "gear b")
    record = hammering.json
    mesh = record["meshes"][MESH]
    assert (mesh["max"], mesh["elastic"]["max"]) == (
        float(force.max),
        float(force.elastic.max),
    )
    assert mesh["separated_fraction"] == contact.separated_fraction
    assert [hit["speed"] for hit in mesh["impacts"]] == [
        hit["speed"] for hit in contact.impacts
    ]
    assert mesh["amplitudes"][0] == [
        32.0,
        float(force.amplitudes[0]),
        float(force.phases_deg[0]),
    ]
    assert sum(row[1] for row in mesh["amplitudes"]) == pytest.approx(
        mesh["sum_of_amplitudes"], rel=1e-9
    )
    assert record["gears"]["gear b"]["mean"] == float(
        response.gear_torque("gear b").mean
    )


@pytest.mark.slow
def test_a_computed_bound_is_told_in_words_with_its_margins_and_written_as_from_python(
    hammering, response
):
    found = jaxhb.certify(response)
    said = hammering.out
    bound = hammering.json["certificate"]
    assert (bound["holds"], bound["reason"]) == (True, "")
    mesh = bound["meshes"][MESH]
    own = {
        "force_N": found.force_bound,
        "elastic_force_N": found.elastic_bound,
        "deflection_m": found.deflection_bound,
    }
    assert mesh == pytest.approx(
        {key: float(value[0]) for key, value in own.items()}, rel=1e-6
    )
    assert (
        bound["h0"] == pytest.approx(bound["Y0"] * bound["Z2"]) and bound["h0"] <= 0.5
    )
    (sentence,) = [
        line for line in said.splitlines() if line.startswith("Computed bound: ")
    ]
    largest, within = re.search(
        r"largest tooth force is (\S+) kN, within (\S+) kN of", sentence
    ).groups()
    assert float(largest) == pytest.approx(
        float(response.force(MESH).peak) / 1e3, rel=1e-3
    )
    assert (
        mesh["force_N"] <= 1e3 * float(within) <= 1.12 * mesh["force_N"]
    )  # two digits, rounded up
    margins = {"iterated_norms": NORM_MARGIN, "estimated_row_sums": ROW_SUM_MARGIN}
    assert bound["margins"] == margins
    for (
        name,
        margin,
    ) in margins.items():  # both stand beside the number, here and in Python
        words = f"{name.replace('_', ' ')} x{margin:g}"
        assert words in said and words in str(found)


def test_trains_without_teeth_have_a_computed_bound_too(told):
    called = told(f"{DIESEL} --certify", "json")
    assert (
        called.json["certificate"]["holds"]
        and called.json["certificate"]["meshes"] == {}
    )
    assert "Computed bound: no mesh has backlash" in called.out


@pytest.mark.slow
def test_a_solve_that_does_not_converge_marks_its_tables_and_says_what_to_try(
    told, run, monkeypatch
):
    """The kind is known, the solution is not within its tolerance."""
    asked = f"{HAMMERING} --harmonics 16 --tolerance 1e-12"
    called = told(asked, "json")
    (line,) = called.err.splitlines()
    assert called.status == 1 and "motion: periodic, period one cycle" in called.out
    assert (
        "TOLERANCE_NOT_MET" in line
        and "leave out --harmonics or give more" in line
        and "--tolerance" in line
    )
    assert "Not converged" in called.out
    tables = [
        block.splitlines()[0]
        for block in called.out.split("\n\n")
        if block.count("\n  ")
    ]
    assert (
        all(head.startswith("NOT CONVERGED: ") for head in tables[:-1])
        and tables[-1] == "Notes"
    )
    monkeypatch.setitem(planning.MOST_HARMONICS, "reduced", 16)
    most = (
        "TOLERANCE_NOT_MET, the motion is solved, but 16 harmonics, the most that are"
        " taken, are too few"
    )
    assert (
        f"{most} for the tolerance: accept its error with --tolerance."
        in run(asked).err
    )


def test_orders_shorten_the_lists_and_nothing_else(told):
    whole, short = (
        told(line, "json").json["shafts"]["cyl1|cyl2"]
        for line in (DIESEL, f"{DIESEL} --orders 3")
    )
    assert short["amplitudes"] == whole["amplitudes"][:6]
    assert short | {"amplitudes": 0} == whole | {"amplitudes": 0}
    record = told(DIESEL, "json").json
    assert record["meshes"] == record["gears"] == {} and "certificate" not in record


def test_a_misfire_and_a_changed_number_are_those_of_python(told):
    record = told(f"{DIESEL} --misfire 'cylinder 3' --set cyl1.damping=20", "json").json
    train = (
        jaxhb.load_scene("six_cylinder_diesel")
        .misfire("cylinder 3")
        .replace({"cyl1.damping": 20.0})
    )
    swing = jaxhb.solve(train, rpm=1500.0).torque("cyl2", "cyl3").half_peak_to_peak
    assert record["shafts"]["cyl2|cyl3"]["half_peak_to_peak"] == float(swing)
    assert record["not_firing"] == ["cylinder 3: no injection, compression stays"]


@pytest.mark.slow
def test_a_cylinder_that_is_cut_off_carries_nothing_and_one_that_misfires_pumps():
    mean, misfire, cut = (
        jaxhb.forced_response(train, rpm=1500.0).torque("cyl6", "flywheel").mean
        for diesel in [jaxhb.load_scene("six_cylinder_diesel")]
        for train in (
            diesel,
            diesel.misfire("cylinder 3"),
            diesel.cut_off("cylinder 3"),
        )
    )
    assert cut == pytest.approx(5 / 6 * mean)
    assert cut < misfire < 1.01 * cut  # it takes in at 2.7 bar and pushes out at 2.5


def test_the_command_tells_what_is_computed_of_a_cylinder_that_is_cut_off(told):
    called = told(f"{DIESEL} --cut-off 'cylinder 3'", "json")
    assert (called.json["misfire"], called.json["cut_off"]) == ([], ["cylinder 3"])
    assert called.json["not_firing"] == ["cylinder 3: cut off, no gas torque at all"]
    assert (
        "\nsix_cylinder_diesel, cylinder 3 cut off at 1500 rpm\nNot firing, cylinder 3:"
        " cut off" in called.out
    )
    swing = jaxhb.solve(
        jaxhb.load_scene("six_cylinder_diesel").cut_off("cylinder 3"), rpm=1500.0
    )
    assert called.json["shafts"]["cyl2|cyl3"]["max"] == float(
        swing.torque("cyl2", "cyl3").max
    )


def test_numbers_that_are_not_finite_become_null(response):
    nothing = {
        name: np.full_like(getattr(response, name), np.nan)
        for name in ("forces", "elastic_forces", "angles")
    }
    broken = dataclasses.replace(
        response, **nothing, residual=np.array(math.inf), status=np.array(7)
    )
    train = jaxhb.load_scene("spur_pair")
    answer = Answer(
        train, orbit_state(broken), jaxhb.linear_response(train, rpm=5000.0), orbit=True
    )
    record = json.loads(b"".join(as_json(answer_record(answer))))
    assert (record["residual"], record["status"]) == (None, "NONFINITE")
    assert (
        record["meshes"][MESH]["max"]
        is record["meshes"][MESH]["separated_fraction"]
        is None
    )
    assert verdict(answer).startswith("No answer at 5000 rpm")


def test_a_sweep_writes_one_response_and_one_row_per_speed(told):
    called = told(
        "sweep spur_pair --rpm 2000,5600 --set 'gear a.damping=0.01'",
        "json",
        "csv",
        "plot",
    )
    record = called.json
    rows = called.rows
    assert called.err == "" and called.is_drawn
    assert (
        record["rpm"] == [row["rpm"] for row in record["responses"]] == [2000.0, 5600.0]
    )
    assert (record["set"], record["misfire"]) == ({"gear a.damping": 0.01}, [])
    taken = [row["harmonics"] for row in record["responses"]]
    assert [int(row["harmonics"]) for row in rows] == taken and taken[0] < taken[1]
    assert [float(row[f"{MESH} max N"]) for row in rows] == [
        row["meshes"][MESH]["max"] for row in record["responses"]
    ]
    without = [
        row["without_backlash"]["meshes"][MESH]["max"] for row in record["responses"]
    ]
    assert without == [float(row[f"{MESH} max N without backlash"]) for row in rows]
