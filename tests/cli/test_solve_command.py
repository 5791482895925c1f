"""``jaxhb solve``: exit status, files, sentences, computed bounds, and the same numbers as from Python."""

import dataclasses
import math
import re

import numpy as np
import pytest
from strict_json import read

import jaxhb
from jaxhb.cli.main import main
from jaxhb.report.answer import Answer, orbit_state
from jaxhb.report.files.output import as_json, write_files
from jaxhb.report.files.record import answer_record
from jaxhb.report.text.sentences import verdict
from jaxhb.results.bounds import NORM_MARGIN, ROW_SUM_MARGIN

SIGNAL = {"mean", "min", "max", "rms", "half_peak_to_peak", "sum_of_amplitudes", "amplitudes"}
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
HAMMERING = ["solve", "spur_pair", "--rpm", "5000"]


@pytest.fixture(scope="module")
def hammering(tmp_path_factory):
    """One hammering solve with all its files, and what it said."""
    folder = tmp_path_factory.mktemp("hammering")
    status = main([*HAMMERING, "--json", str(folder / "r.json"), "--plot", str(folder / "r.png")])
    return status, folder, read(folder / "r.json")


def test_a_hammering_pair_exits_0_and_its_file_follows_the_contract(hammering):
    status, _, record = hammering
    assert status == 0
    keys = ["rpm", "motion", "converged", "status", "harmonics", "residual", "truncation_error", "path", "load_kW"]
    keys += ["power_defect"]
    keys += ["load_torque_Nm", "ground_reaction_Nm", "mean_angles"]
    assert set(keys) | {"disks", "shafts", "gears", "meshes"} <= set(record)
    assert record["rpm"] == 5000.0
    assert record["converged"] is True
    assert record["status"] == "CONVERGED"
    assert all(isinstance(line, str) for line in record["path"])
    assert set(record["disks"]) == {"gear a", "gear b"}
    turning = {"speed", "acceleration", "irregularity"}
    assert set(record["disks"]["gear a"]) == {"mean", "half_peak_to_peak", "amplitudes"} | turning
    assert set(record["gears"]["gear a"]) == SIGNAL
    mesh = record["meshes"]["gear a|gear b"]
    assert set(mesh) >= SIGNAL | CONTACT
    assert set(mesh["elastic"]) == SIGNAL
    assert mesh["separated_fraction"] > 0.1
    assert mesh["drive_side"] == 1
    without = record["without_backlash"]["meshes"]["gear a|gear b"]
    assert without["separated_fraction"] == 0 and 0 < without["max"] < mesh["max"]
    assert (record["set"], record["misfire"]) == ({}, [])


def test_the_numbers_of_the_file_are_those_of_python(hammering):
    record = hammering[2]
    response = jaxhb.steady_state(jaxhb.load_scene("spur_pair"), rpm=5000.0).response
    force, contact = response.force("gear a", "gear b"), response.mesh("gear a", "gear b")
    mesh = record["meshes"]["gear a|gear b"]
    assert mesh["max"] == float(force.max)
    assert mesh["elastic"]["max"] == float(force.elastic.max)
    assert mesh["separated_fraction"] == contact.separated_fraction
    assert [hit["speed"] for hit in mesh["impacts"]] == [hit["speed"] for hit in contact.impacts]
    assert mesh["amplitudes"][0] == [32.0, float(force.amplitudes[0]), float(force.phases_deg[0])]
    listed = sum(row[1] for row in mesh["amplitudes"])
    assert listed == pytest.approx(mesh["sum_of_amplitudes"], rel=1e-9)
    assert record["gears"]["gear b"]["mean"] == float(response.gear_torque("gear b").mean)


def test_the_picture_of_a_solve_is_a_png(hammering):
    assert (hammering[1] / "r.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    assert sorted(path.name for path in hammering[1].iterdir()) == ["r.json", "r.png"]


def test_the_verdict_comes_first_and_the_table_shows_both_forces(capsys):
    assert main(HAMMERING) == 0
    said = capsys.readouterr()
    assert said.out.startswith("The teeth hammer at 5000 rpm: gear a|gear b is apart ")
    assert "with backlash" in said.out
    assert said.err == ""


def test_a_computed_bound_is_told_in_words_with_its_margins_and_written_as_from_python(capsys, tmp_path):
    file = tmp_path / "r.json"
    assert main([*HAMMERING, "--certify", "--json", str(file)]) == 0
    said = capsys.readouterr().out
    response = jaxhb.steady_state(jaxhb.load_scene("spur_pair"), rpm=5000.0).response
    found = jaxhb.certify(response)
    told = read(file)["certificate"]
    assert (told["holds"], told["reason"]) == (True, "")
    mesh = told["meshes"]["gear a|gear b"]
    own = {"force_N": found.force_bound, "elastic_force_N": found.elastic_bound, "deflection_m": found.deflection_bound}
    assert mesh == pytest.approx({key: float(bound[0]) for key, bound in own.items()}, rel=1e-6)
    assert told["h0"] == pytest.approx(told["Y0"] * told["Z2"]) and told["h0"] <= 0.5
    (sentence,) = [line for line in said.splitlines() if line.startswith("Computed bound: ")]
    largest, within = re.search(r"largest tooth force is (\S+) kN, within (\S+) kN of", sentence).groups()
    assert float(largest) == pytest.approx(float(response.force("gear a|gear b").peak) / 1e3, rel=1e-3)
    assert mesh["force_N"] <= 1e3 * float(within) <= 1.12 * mesh["force_N"]  # two digits, rounded up
    assert told["margins"] == {
        "iterated_norms": NORM_MARGIN,
        "estimated_row_sums": ROW_SUM_MARGIN,
    }
    for name, margin in told["margins"].items():  # both stand beside the number, here and in Python
        words = f"{name.replace('_', ' ')} x{margin:g}"
        assert words in said and words in str(found)
    (row,) = [line.split() for line in said.partition("Computed bound")[2].splitlines() if line.split()[:1] == ["gear"]]
    assert row[-2] == within


@pytest.mark.parametrize("command", [["spur_pair", "--rpm", "2000"], ["six_cylinder_diesel", "--rpm", "1500"]])
def test_teeth_in_contact_and_trains_without_teeth_have_a_computed_bound_too(command, capsys, tmp_path):
    file = tmp_path / "r.json"
    assert main(["solve", *command, "--certify", "--json", str(file)]) == 0
    told, said = read(file)["certificate"], capsys.readouterr().out
    assert told["holds"]
    if not told["meshes"]:
        assert "Computed bound: no mesh has backlash" in said
    for mesh in told["meshes"].values():
        assert mesh["force_N"] < 1e-3


def test_a_motion_that_never_repeats_has_no_computed_bound(capsys, tmp_path):
    file = tmp_path / "r.json"
    light = ["--set", "gear a|gear b.damping=10"]
    assert main(["solve", "spur_pair", "--rpm", "6000", *light, "--certify", "--json", str(file)]) == 0
    told = read(file)["certificate"]
    assert told["holds"] is False
    assert "does not repeat" in told["reason"] and "--orbit" in told["reason"]
    assert f"Computed bound: none. {told['reason']}" in capsys.readouterr().out


def test_without_the_option_nothing_is_said_of_a_computed_bound(hammering):
    assert "certificate" not in hammering[2]


def test_a_solve_that_does_not_converge_exits_1_writes_its_file_and_says_what_to_try(capsys, tmp_path):
    file = tmp_path / "r.json"
    assert main([*HAMMERING, "--harmonics", "16", "--tolerance", "1e-12", "--json", str(file)]) == 1
    said = capsys.readouterr()
    record = read(file)
    assert record["converged"] is False
    assert record["status"] == "TOLERANCE_NOT_MET"
    (line,) = said.err.splitlines()
    assert "TOLERANCE_NOT_MET" in line and "leave out --harmonics or give more" in line and "--tolerance" in line
    assert "Not converged, do not rely on this" in said.out
    tables = [block.splitlines()[0] for block in said.out.split("\n\n") if block.count("\n  ")]
    assert all(head.startswith("NOT CONVERGED: ") for head in tables[:-1]) and tables[-1] == "Notes"


def test_a_train_without_teeth_reports_its_shafts(capsys, tmp_path):
    file = tmp_path / "r.json"
    assert main(["solve", "six_cylinder_diesel", "--rpm", "1500", "--json", str(file)]) == 0
    response = jaxhb.solve(jaxhb.load_scene("six_cylinder_diesel"), rpm=1500.0)
    record = read(file)
    shaft = record["shafts"]["cyl6|flywheel"]
    assert shaft["half_peak_to_peak"] == float(response.torque("cyl6", "flywheel").half_peak_to_peak)
    assert record["load_kW"] == pytest.approx(float(response.load_kW))
    assert record["meshes"] == record["gears"] == {}
    assert "sum of amplitudes" in capsys.readouterr().out


def test_orders_shorten_the_lists_and_nothing_else(tmp_path):
    files = tmp_path / "all.json", tmp_path / "few.json"
    command = ["solve", "six_cylinder_diesel", "--rpm", "1500", "--json"]
    assert main([*command, str(files[0])]) == main([*command, str(files[1]), "--orders", "3"]) == 0
    whole, short = (read(file)["shafts"]["cyl1|cyl2"] for file in files)
    assert short["amplitudes"] == whole["amplitudes"][:6]
    assert short | {"amplitudes": 0} == whole | {"amplitudes": 0}


def test_a_misfire_and_a_changed_number_are_those_of_python(tmp_path):
    file = tmp_path / "r.json"
    changes = ["--misfire", "cylinder 3", "--set", "cyl1.damping=20"]
    assert main(["solve", "six_cylinder_diesel", "--rpm", "1500", *changes, "--json", str(file)]) == 0
    train = jaxhb.load_scene("six_cylinder_diesel").misfire("cylinder 3").replace({"cyl1.damping": 20.0})
    response = jaxhb.solve(train, rpm=1500.0)
    record = read(file)
    swing = response.torque("cyl2", "cyl3").half_peak_to_peak
    assert record["shafts"]["cyl2|cyl3"]["half_peak_to_peak"] == float(swing)
    # Five of six cylinders carry the mean torque.
    untouched = jaxhb.linear_response(jaxhb.load_scene("six_cylinder_diesel"), rpm=1500.0)
    whole = float(untouched.torque("cyl6", "flywheel").mean)
    assert record["shafts"]["cyl6|flywheel"]["mean"] == pytest.approx(5 / 6 * whole)


def test_numbers_that_are_not_finite_become_null(tmp_path):
    train = jaxhb.load_scene("spur_pair")
    response = jaxhb.solve(train, rpm=2000.0)
    nothing = {name: np.full_like(getattr(response, name), np.nan) for name in ("forces", "elastic_forces", "angles")}
    broken = dataclasses.replace(response, **nothing, residual=np.array(math.inf), status=np.array(7))
    answer = Answer(train, orbit_state(broken), jaxhb.linear_response(train, rpm=2000.0), orbit=True)
    write_files({tmp_path / "r.json": as_json(answer_record(answer))})
    record = read(tmp_path / "r.json")
    assert record["residual"] is None
    assert record["status"] == "NONFINITE"
    assert record["meshes"]["gear a|gear b"]["max"] is None
    assert record["meshes"]["gear a|gear b"]["separated_fraction"] is None
    assert verdict(answer).startswith("No answer at 2000 rpm")
