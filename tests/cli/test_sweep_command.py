"""``jaxhb sweep``: a response and a row for every speed, the same as of single solves."""

import csv

import pytest
from strict_json import read

import jaxhb
from jaxhb.cli.main import main


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
