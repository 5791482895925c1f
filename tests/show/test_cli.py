"""The command line: exit status, files, sentences, and the same numbers as from Python."""

import csv
import dataclasses
import importlib.util
import json
import math
import re

import numpy as np
import pytest

import jaxhb
from jaxhb.show.answer import Answer, orbit_state
from jaxhb.show.cli import main
from jaxhb.show.output import as_json, write_files
from jaxhb.show.record import answer_record
from jaxhb.show.words import verdict

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


def read(path):
    """JSON as a strict reader takes it: no NaN, no Infinity."""

    def refuse(word):
        raise ValueError(f"{word} is no JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


@pytest.fixture(scope="module")
def hammering(tmp_path_factory):
    """One hammering solve with all its files, and what it said."""
    folder = tmp_path_factory.mktemp("hammering")
    status = main([*HAMMERING, "--json", str(folder / "r.json"), "--plot", str(folder / "r.png")])
    return status, folder, read(folder / "r.json")


def test_scenes_lists_every_packaged_scene(capsys):
    assert main(["scenes"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in said] == jaxhb.scene_names()


def test_modes_are_those_of_python(capsys, tmp_path):
    file = tmp_path / "modes.json"
    assert main(["modes", "gear_train_30", "--json", str(file)]) == 0
    modes = jaxhb.natural_frequencies(jaxhb.load_scene("gear_train_30"))
    record = read(file)
    told = {"frequencies_hz", "mesh_energy_share", "modes", "kinds", "node_count", "generalised_mass", "damping_ratios"}
    assert set(record) == {"scenario", "set", "links_at", "viscous", "kinetic_share", "strain_share"} | told
    assert record["mesh_energy_share"] == modes.mesh_energy_share.tolist()
    assert record["frequencies_hz"] == modes.frequencies_hz.tolist()
    assert record["modes"]["crank gear"] == modes.shapes[:, modes.names.index("crank gear")].tolist()
    assert (
        record["strain_share"]["idler|cam gear A"]
        == modes.strain_share[:, modes.link_names.index("idler|cam gear A")].tolist()
    )
    assert f"{modes.frequencies_hz[1]:.2f}" in capsys.readouterr().out


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


def test_an_error_bound_is_told_in_words_and_written_as_from_python(capsys, tmp_path):
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
    (sentence,) = [line for line in said.splitlines() if line.startswith("Error bound: ")]
    largest, within = re.search(r"largest tooth force is (\S+) kN, certainly within (\S+) kN", sentence).groups()
    assert float(largest) == pytest.approx(float(response.force("gear a|gear b").peak) / 1e3, rel=1e-3)
    assert mesh["force_N"] <= 1e3 * float(within) <= 1.12 * mesh["force_N"]  # two digits, rounded up
    assert "no interval arithmetic" in said
    (row,) = [line.split() for line in said.partition("Error bound")[2].splitlines() if line.split()[:1] == ["gear"]]
    assert row[-2] == within


@pytest.mark.parametrize("command", [["spur_pair", "--rpm", "2000"], ["six_cylinder_diesel", "--rpm", "1500"]])
def test_teeth_in_contact_and_trains_without_teeth_have_an_error_bound_too(command, capsys, tmp_path):
    file = tmp_path / "r.json"
    assert main(["solve", *command, "--certify", "--json", str(file)]) == 0
    told, said = read(file)["certificate"], capsys.readouterr().out
    assert told["holds"]
    if not told["meshes"]:
        assert "Error bound: no mesh has backlash" in said
    for mesh in told["meshes"].values():
        assert mesh["force_N"] < 1e-3


def test_a_motion_that_never_repeats_has_no_error_bound(capsys, tmp_path):
    file = tmp_path / "r.json"
    light = ["--set", "gear a|gear b.damping=31.8"]
    assert main(["solve", "spur_pair", "--rpm", "6000", *light, "--certify", "--json", str(file)]) == 0
    told = read(file)["certificate"]
    assert told["holds"] is False
    assert told["reason"].startswith("The motion does not repeat itself") and "--orbit" in told["reason"]
    assert f"Error bound: none. {told['reason']}" in capsys.readouterr().out


def test_without_the_option_nothing_is_said_of_an_error_bound(hammering):
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


def test_a_sweep_writes_one_response_and_one_row_per_speed(capsys, tmp_path):
    files = {kind: tmp_path / f"s.{kind}" for kind in ("json", "csv", "png")}
    options = ["--json", str(files["json"]), "--csv", str(files["csv"]), "--plot", str(files["png"])]
    assert main(["sweep", "spur_pair", "--rpm", "2000:3000:2", *options]) == 0
    record = read(files["json"])
    assert record["rpm"] == [2000.0, 3000.0]
    assert [row["rpm"] for row in record["responses"]] == [2000.0, 3000.0]
    largest = [row["meshes"]["gear a|gear b"]["max"] for row in record["responses"]]
    with files["csv"].open() as text:
        rows = list(csv.DictReader(text))
    assert [float(row["gear a|gear b max N"]) for row in rows] == largest
    assert files["png"].read_bytes().startswith(b"\x89PNG")
    said = capsys.readouterr()
    assert said.out.startswith("All teeth stay in contact at all 2 speeds from 2000 to 3000 rpm.")
    assert said.err == ""


def test_a_ring_without_stiffness_is_not_called_a_motion_of_all_disks(capsys):
    """A viscous damper's ring turns freely: its motion of 0 Hz is told apart from that of the train."""
    assert main(["modes", "engine_with_damper"]) == 0
    rows = capsys.readouterr().out.splitlines()[2:]
    said = [row.split(maxsplit=6)[-1] for row in rows[:2]]
    assert said == ["rigid-body mode", "ring only: viscous damper turns freely"]
    assert "rigid-body" not in rows[2]
    assert main(["modes", "gear_train_30"]) == 0
    assert capsys.readouterr().out.splitlines()[2].endswith("rigid-body mode on the ground's spring")


def test_a_sweep_says_of_each_speed_how_many_harmonics_it_took_and_what_was_changed(tmp_path):
    files = [tmp_path / "s.json", tmp_path / "s.csv"]
    command = ["sweep", "spur_pair", "--rpm", "2000,5600", "--set", "gear a.damping=0.01"]
    assert main([*command, "--json", str(files[0]), "--csv", str(files[1])]) == 0
    record = read(files[0])
    assert (record["set"], record["misfire"]) == ({"gear a.damping": 0.01}, [])
    taken = [row["harmonics"] for row in record["responses"]]
    with files[1].open() as text:
        rows = list(csv.DictReader(text))
    assert [int(row["harmonics"]) for row in rows] == taken
    assert taken[0] < taken[1]
    without = [row["without_backlash"]["meshes"]["gear a|gear b"]["max"] for row in record["responses"]]
    assert without == [float(row["gear a|gear b max N without backlash"]) for row in rows]
    assert all(float(row["gear a|gear b min N without backlash"]) < 0 for row in rows[1:])


def test_a_sweep_agrees_with_single_solves(tmp_path):
    file = tmp_path / "s.json"
    assert main(["sweep", "six_cylinder_diesel", "--rpm", "1000,1800,2600", "--json", str(file)]) == 0
    train = jaxhb.load_scene("six_cylinder_diesel")
    for row in read(file)["responses"]:
        alone = jaxhb.solve(train, rpm=row["rpm"]).torque("cyl4", "cyl5").half_peak_to_peak
        assert row["shafts"]["cyl4|cyl5"]["half_peak_to_peak"] == pytest.approx(float(alone), rel=1e-9)


BAD = {
    "an unknown scene": (["solve", "gear_train", "--rpm", "1"], "Did you mean 'gear_train_30'?"),
    "a missing file": (["solve", "no.toml", "--rpm", "1"], "there is no such file"),
    "speed zero": (["solve", "spur_pair", "--rpm", "0"], "greater than 0 rpm"),
    "a negative speed": (["solve", "spur_pair", "--rpm", "-3"], "greater than 0 rpm"),
    "no number": (["solve", "spur_pair", "--rpm", "fast"], "must be a number greater than 0 rpm"),
    "an infinite speed": (["solve", "spur_pair", "--rpm", "inf"], "must be a number greater than 0 rpm"),
    "half a range": (["sweep", "spur_pair", "--rpm", "600:2450"], "A:B:COUNT"),
    "no speeds": (["sweep", "spur_pair", "--rpm", "600:2450:0"], "whole number of at least 1"),
    "one speed between two": (["sweep", "spur_pair", "--rpm", "600:2450:1"], "COUNT of at least 2"),
    "no speed given": (["solve", "spur_pair"], "--rpm"),
    "too few harmonics": (["solve", "gear_train_30", "--rpm", "9", "--harmonics", "5"], "ask for at least 24"),
    "half a harmonic": (["solve", "spur_pair", "--rpm", "9", "--harmonics", "2.5"], "whole number"),
    "a tolerance of 1": (["solve", "spur_pair", "--rpm", "9", "--tolerance", "1"], "less than 1"),
    "an unknown cylinder": (["solve", "gear_train_30", "--rpm", "9", "--misfire", "A1"], "there is no cylinder 'A1'"),
    "an unknown element": (["solve", "spur_pair", "--rpm", "9", "--set", "x.y=1"], "there is no element 'x'"),
    "a value that is none": (["solve", "spur_pair", "--rpm", "9", "--set", "gear a.inertia"], "NAME.FIELD=VALUE"),
    "a negative inertia": (["solve", "spur_pair", "--rpm", "9", "--set", "gear a.inertia=-1"], "-1"),
    "an unknown gear": (["solve", "spur_pair", "--rpm", "9", "--gear", "gear c"], "there is no disk 'gear c'"),
    "a disk without teeth": (["solve", "gear_train_30", "--rpm", "9", "--gear", "hub"], "carries no mesh"),
    "another speed to draw": (["report", "spur_pair", "--rpm", "9", "--at", "8"], "not one of the speeds"),
    "an unknown command": (["guess"], "there is no command 'guess'. Commands: "),
    "no picture": (["solve", "spur_pair", "--rpm", "9", "--plot", "r.gif"], ".png"),
    "a folder that is no file": (["solve", "spur_pair", "--rpm", "9", "--csv", "."], "is a folder"),
    "an option of another command": (
        ["solve", "spur_pair", "--rpm", "9", "--chunk", "4"],
        "there is no option --chunk",
    ),
    "a misspelt option": (["solve", "spur_pair", "--rmp", "2000"], "no option --rmp. Did you mean --rpm?"),
    "a synonym": (["solve", "spur_pair", "--speed", "1500"], "no option --speed. Did you mean --rpm?"),
    "several speeds of a solve": (
        ["solve", "spur_pair", "--rpm", "1333,1600"],
        "'1333,1600' are 2 speeds, and this command takes one: jaxhb sweep and jaxhb report take several",
    ),
    "a range of a solve": (["solve", "spur_pair", "--rpm", "600:900:4"], "'600:900:4' are 4 speeds"),
    "modes at a speed": (["modes", "spur_pair", "--rpm", "1500"], "do not depend on the speed; --at R takes the teeth"),
    "a unit": (
        ["solve", "spur_pair", "--rpm", "9", "--set", "gear a|gear b.stiffness=36kN"],
        "36kN is no number; values are numbers in SI units, as 3.6e4",
    ),
    "a misspelt command": (["sovle", "spur_pair"], "no command 'sovle'. Did you mean solve?"),
    "a word too many": (["solve", "spur_pair", "3000", "--rpm", "9"], "unknown argument 3000"),
    "half a tooth": (["solve", "spur_pair", "--rpm", "9", "--set", "gear a.teeth=4.5"], "must be a whole number"),
    "an unknown law": (["solve", "spur_pair", "--rpm", "9", "--set", "gear a|gear b.law=x"], "Known: 'fridman2009'"),
    "a word for a number": (
        ["solve", "spur_pair", "--rpm", "9", "--set", "gear a.inertia=big"],
        "'big', must be finite",
    ),
    "one value": (["sweep", "spur_pair", "--rpm", "9", "--over", "gear a.inertia=1"], "A:B:COUNT"),
    "several speeds beside values": (
        ["sweep", "spur_pair", "--rpm", "8,9", "--over", "gear a.damping=1,2"],
        "one speed",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_exits_2_with_one_sentence_and_writes_nothing(case, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command, sentence = BAD[case]
    json_option = ["--json", "out.json"] if command[0] in ("solve", "sweep", "report") else []
    assert main([*command, *json_option]) == 2
    said = capsys.readouterr()
    assert sentence in said.err
    assert len(said.err.splitlines()) == 1
    assert "Traceback" not in said.err
    assert said.out == ""
    assert list(tmp_path.iterdir()) == []


COMMANDS = [
    "new",
    "check",
    "scenes",
    "scene",
    "modes",
    "forced",
    "campbell",
    "holzer",
    "solve",
    "sweep",
    "report",
    "tune",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_shows_up_to_three_examples_of_its_own(command, capsys):
    assert main([command, "--help"]) == 0
    said = capsys.readouterr().out
    shown = [line.split()[1] for line in said[said.index("examples:") :].splitlines() if line.startswith("  jaxhb ")]
    assert 1 <= len(shown) <= 3 and set(shown) == {command}
    assert "exit status: 0" in said


def test_help_shows_examples_of_all_commands(capsys):
    assert main(["--help"]) == 0
    said = capsys.readouterr().out
    assert all(f"\n  jaxhb {command}" in said for command in COMMANDS)


def test_all_errors_of_a_scene_are_told_one_a_line(capsys, tmp_path):
    scene = tmp_path / "bad.toml"
    scene.write_text(
        '[scene]\nname = "bad"\n'
        '[[disk]]\nname = "a"\ninertia = -1.0\n'
        '[[disk]]\nname = "b"\ninertia = 1.0\n'
        '[[shaft]]\nbetween = ["a", "b"]\nstifness = 1e5\n'
    )
    assert main(["solve", str(scene), "--rpm", "100", "--json", str(tmp_path / "r.json")]) == 2
    said = capsys.readouterr().err.splitlines()
    assert any("unknown key 'stifness'. Did you mean 'stiffness'?" in line for line in said)
    assert any("inertia" in line and "kg m2" in line for line in said)
    assert not (tmp_path / "r.json").exists()


@pytest.mark.parametrize("option", ["--json", "--csv", "--plot"])
def test_a_path_that_cannot_be_written_is_refused_before_anything_is_computed(option, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("jaxhb.show.compute.solve_speeds", lambda *_, **__: pytest.fail("computed"))
    missing = tmp_path / "nowhere" / "r.png"
    assert main(["sweep", "spur_pair", "--rpm", "9", option, str(missing)]) == 2
    assert capsys.readouterr().err.startswith(f"{option}: there is no folder ")
    assert main(["sweep", "spur_pair", "--rpm", "9", option, str(tmp_path)]) == 2
    assert "is a folder" in capsys.readouterr().err


def test_two_outputs_to_one_file_are_refused(capsys, tmp_path):
    same = str(tmp_path / "r.png")
    assert main(["solve", "spur_pair", "--rpm", "9", "--json", same, "--plot", same]) == 2
    assert "the same file" in capsys.readouterr().err


def test_without_matplotlib_a_picture_is_refused_with_the_name_of_the_extra(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr("jaxhb.show.compute.steady_state", lambda *_, **__: pytest.fail("computed"))
    assert main(["solve", "spur_pair", "--rpm", "2000", "--plot", str(tmp_path / "r.png")]) == 2
    assert "jaxhb[plot]" in capsys.readouterr().err


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
