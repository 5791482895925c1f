"""What the command line tells of every kind of motion: the same as Python, in words, tables, files and pictures."""

import csv
import json

import numpy as np
import pytest

import jaxhb
from jaxhb.balance import plan as planning
from jaxhb.cli.main import main
from jaxhb.report import compute
from jaxhb.report.compute import Asked, answer_one, answer_speeds
from jaxhb.report.figures.cycle import cycle_figures, plot_cycle
from jaxhb.report.figures.figure import DIGITS
from jaxhb.report.figures.sweep import sweep_figures
from jaxhb.report.text.sweep_tables import sweep_text

MESH = "gear a|gear b"
DAMPING = f"{MESH}.damping"
LIGHT, LIGHTER = 106.1, 10.0
"""Tooth damping in N s/m with which the pair at 6000 rpm has a period of two cycles, and none."""


def read(path):
    return json.loads(path.read_text(encoding="utf-8"))


def pair(damping):
    return jaxhb.load_scene("spur_pair").replace({DAMPING: damping})


@pytest.fixture(scope="module", params=[LIGHT, LIGHTER], ids=["two cycles", "irregular"])
def told(request, tmp_path_factory):
    """The steady state from Python, and what the command line told and wrote of it."""
    folder, said = tmp_path_factory.mktemp("told"), pytest.MonkeyPatch()
    lines = []
    said.setattr("builtins.print", lambda text, **_: lines.append(text))
    files = ["--json", str(folder / "r.json"), "--plot", str(folder / "r.png")]
    status = main(["solve", "spur_pair", "--rpm", "6000", "--set", f"{DAMPING}={request.param}", *files])
    said.undo()
    state = jaxhb.steady_state(pair(request.param), rpm=6000.0)
    return state, status, "\n".join(lines), read(folder / "r.json"), folder / "r.png"


def test_the_kind_and_the_numbers_are_those_of_the_motion(told):
    state, status, said, record, picture = told
    assert status == 0
    motion, mesh, force = record["motion"], record["meshes"][MESH], state.force(MESH)
    assert (motion["kind"], motion["period"], motion["cycles"]) == (state.kind, state.period, state.cycles)
    assert (mesh["max"], mesh["min"], mesh["rms"]) == (float(force.max), float(force.min), float(force.rms))
    assert motion["per_cycle"][MESH]["max"] == force.per_cycle.max.tolist()
    contact = state.mesh(MESH)
    assert (mesh["impacts_per_cycle"], mesh["hardest_impact"]) == (contact.impacts_per_cycle, contact.hardest_impact)
    assert mesh["separated_fraction"] == contact.separated_fraction
    gear = record["gears"]["gear a"]
    assert gear["half_peak_to_peak"] == float(state.gear_torque("gear a").half_peak_to_peak)
    assert record["disks"]["gear b"]["half_peak_to_peak"] == float(state.disk("gear b").half_peak_to_peak)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "at 6000 rpm: gear a|gear b is apart 71 % of the time" in said


def test_a_motion_of_two_cycles_has_impacts_over_both_and_a_multiplier(told):
    state, _, said, record, _ = told
    if state.kind != "subharmonic":
        pytest.skip("a motion that does not repeat has none")
    motion, mesh = record["motion"], record["meshes"][MESH]
    found = jaxhb.stability(state.response)
    assert (motion["stable"], motion["multiplier"]) == (True, found.largest)
    assert record["converged"] and record["status"] == "CONVERGED"
    # One impact in two cycles of 11.25 deg, in the second of them.
    assert [11.25 < hit["theta_deg"] < 22.5 for hit in mesh["impacts"]] == [True]
    assert mesh["impacts_per_cycle"] == 0.5
    assert mesh["amplitudes"][0][0] == 16.0  # half the tooth frequency
    assert "motion: period of 2 cycles (of 0.0625 revolutions); stable" in said


def test_a_motion_that_never_repeats_has_a_distribution_and_no_solution(told):
    state, _, said, record, _ = told
    if state.kind != "irregular":
        pytest.skip("a motion that repeats is solved")
    mesh = record["meshes"][MESH]
    keys = "converged", "status", "harmonics", "residual", "truncation_error", "power_defect", "path"
    assert [record[key] for key in keys] == [None] * 7
    assert [record["motion"][key] for key in ("stable", "multiplier")] == [None, None]
    assert mesh["impacts"] is None
    assert all(phase is None for _, _, phase in mesh["amplitudes"])
    assert "irregular: the motion never repeats; numbers are the extremes over 64 recorded cycles" in said
    low, middle, high = state.force(MESH).per_cycle.max / 1e3
    line = said[said.index("Largest tooth force of a cycle") :].splitlines()[2]
    assert line.split()[-3:] == [f"{low:.3f}", f"{middle:.3f}", f"{high:.3f}"]


def test_an_orbit_is_the_solution_of_solve_and_the_word_for_its_stability(tmp_path, capsys):
    file = tmp_path / "r.json"
    command = ["solve", "spur_pair", "--rpm", "6000", "--set", f"{DAMPING}={LIGHTER}"]
    assert main([*command, "--orbit", "--json", str(file)]) == 0
    record, response = read(file), jaxhb.solve_speeds(pair(LIGHTER), rpm=[6000.0])[0]
    assert record["meshes"][MESH]["max"] == float(response.force(MESH).max)
    # As solve has it with the harmonics that it takes by itself: within the tolerance.
    assert record["meshes"][MESH]["max"] == pytest.approx(
        float(jaxhb.solve(pair(LIGHTER), rpm=6000.0).force(MESH).max), rel=0.01
    )
    assert record["motion"]["orbit"] and record["motion"]["kind"] == "periodic"
    found = jaxhb.stability(response)
    assert (record["motion"]["stable"], record["motion"]["multiplier"]) == (found.stable, found.largest)
    assert f"orbit: periodic, period one cycle; {'stable' if found.stable else 'UNSTABLE'}" in capsys.readouterr().out


def test_a_sweep_both_ways_tells_hysteresis(tmp_path, capsys):
    """At 4500 rpm the pair hammers when it comes from above and stays in contact from below (published branches)."""
    files = [tmp_path / name for name in ("s.json", "s.csv", "s.png")]
    options = [part for kind, file in zip(("json", "csv", "plot"), files, strict=True) for part in (f"--{kind}", file)]
    command = ["sweep", "spur_pair", "--rpm", "4500,5000", "--direction", "both", *map(str, options)]
    assert main(command) == 0
    said, record = capsys.readouterr().out, read(files[0])
    assert said.startswith("Upwards: Teeth separate at 1 of 2 speeds between 4500 and 5000 rpm: 5000 rpm.")
    assert "Downwards: Teeth separate at 2 of 2 speeds" in said
    assert "Upwards and downwards differ at 4500 rpm" in said
    assert record["direction"] == "both" and "responses" not in record
    kinds = {way: [row["motion"]["kind"] for row in record[way]] for way in ("up", "down")}
    assert kinds == {"up": ["contact", "periodic"], "down": ["periodic", "periodic"]}
    with files[1].open() as text:
        rows = list(csv.DictReader(text))
    assert [(row["direction"], row["rpm"], row["motion"]) for row in rows] == [
        ("up", "4500.0", "contact"),
        ("up", "5000.0", "periodic"),
        ("down", "4500.0", "periodic"),
        ("down", "5000.0", "periodic"),
    ]
    assert files[2].read_bytes().startswith(b"\x89PNG")


def test_a_direction_is_none_of_an_orbit(capsys):
    assert main(["sweep", "spur_pair", "--rpm", "4500,5000", "--orbit", "--direction", "down"]) == 2
    assert "--direction: periodic solutions (--orbit) do not depend on it" in capsys.readouterr().err


def test_a_periodic_solution_has_the_same_bits_alone_and_in_a_sweep():
    """One speed in contact, one with an unknown on a flank, two that hammer: of different plans."""
    train, asked = jaxhb.load_scene("engine_with_damper"), Asked(orbit=True)
    rpm = [1000.0, 1863.0, 2074.0, 2179.0]
    sweep = answer_speeds(train, rpm, asked)["orbit"]
    assert [answer.state.response.harmonics for answer in sweep] == [24, 48, 768, 768]
    for answer in sweep:
        alone = answer_one(train, answer.rpm, asked).state.response
        np.testing.assert_array_equal(answer.state.response.elastic_forces, alone.elastic_forces)


def test_a_sweep_of_orbits_says_which_are_unstable():
    """A lightly loaded pair, which does something else at the second speed."""
    train = jaxhb.load_scene("spur_pair").replace({"drive.mean": 12.5, "brake.mean": -12.5})
    sweep = answer_speeds(train, [4000.0, 6000.0], Asked(orbit=True))
    for answer, stable in zip(sweep["orbit"], (True, False), strict=True):
        truth = jaxhb.stability(jaxhb.solve(train, rpm=answer.rpm))
        assert answer.growth.stable == truth.stable == stable
        # The cheap multiplier of a sweep is good to 10 % (its docstring).
        assert answer.growth.multiplier == pytest.approx(truth.largest, rel=0.1)
    said = sweep_text(sweep)
    assert "UNSTABLE, the train does not run in these motions, at 6000 rpm." in said
    assert "The periodic motion at 6000 rpm is UNSTABLE (a disturbance grows" in said
    assert sweep_figures(sweep)[0].traces[0]["marker"]["symbol"] == ["square", "triangle-down"]
    assert answer_one(train, 6000.0, Asked()).state.kind != "periodic"


def test_the_picture_of_several_cycles_shows_them_all():
    answer = answer_one(pair(LIGHT), 6000.0, Asked())
    above, below = plot_cycle(answer).axes
    after, before = above.get_lines()[:2]
    assert after.get_xdata()[-1] == pytest.approx(22.5) and before.get_xdata()[-1] == pytest.approx(22.5)
    assert after.get_ydata().max() == pytest.approx(float(answer.gear_torque("gear a").max), rel=1e-3)
    # Without backlash both cycles are alike.
    one, other = np.split(before.get_ydata()[:-1], 2)
    np.testing.assert_allclose(one, other)


def test_the_picture_of_an_irregular_motion_shows_the_distribution_over_the_cycles():
    answer = answer_one(pair(LIGHTER), 6000.0, Asked())
    digits = 0.5 * 10 ** (1 - DIGITS)
    extremes, below = cycle_figures(answer)
    torque, force = answer.gear_torque("gear a"), answer.force(MESH)
    np.testing.assert_allclose(extremes.traces[0]["y"], torque.highest, rtol=digits)
    shares = [trace["y"][0] for trace in extremes.traces if trace["name"] == "95 % of the cycles"]
    wanted = [
        torque.per_cycle.max[2],
        torque.per_cycle.min[2],
        force.per_cycle.max[2] / 1e3,
        force.per_cycle.min[2] / 1e3,
    ]
    np.testing.assert_allclose(shares, wanted, rtol=digits)
    assert below.traces[0]["x"][-1] == pytest.approx(force.max / 1e3, rel=digits) and below.traces[0]["y"][-1] == 100
    (axes,) = [one for one in plot_cycle(answer).axes if one.get_ylabel() == "cycles below it, %"]
    assert axes.get_lines()[0].get_drawstyle() == "steps-post"
    low, _, high = force.per_cycle.max / 1e3
    (bars,) = [one for one in sweep_figures({"up": [answer]})[0].traces if one["name"] == "5 to 95 % of the cycles"]
    assert bars["x"] == [6000.0, 6000.0, None] and bars["y"][:2] == pytest.approx([low, high], rel=digits)


def test_what_is_not_known_exits_1_with_the_reason_and_no_numbers(tmp_path, capsys):
    file = tmp_path / "s.csv"
    command = ["sweep", "spur_pair", "--rpm", "2000,5000", "--set", "drive.mean=70", "--csv", str(file)]
    assert main([*command, "--plot", str(tmp_path / "s.png")]) == 1
    said = capsys.readouterr()
    assert said.out.startswith(
        "No answer at any of 2 speeds from 2000 to 5000 rpm.\nThe motion is unknown at 2000-5000"
    )
    assert [line.split()[1:7] for line in said.out.splitlines()[4:6]] == [["-"] * 6] * 2
    (line,) = said.err.splitlines()  # of both speeds, once
    assert line.startswith("2000, 5000 rpm: the kind of motion is unknown: the mean torques do not balance")
    with file.open() as text:
        assert all(row[f"{MESH} max N"] == "" for row in csv.DictReader(text))


def test_what_is_periodic_and_not_converged_exits_1(monkeypatch, capsys):
    """As where too few harmonics are asked for: the kind is known, the solution is not within its tolerance."""
    command = ["solve", "spur_pair", "--rpm", "5000", "--harmonics", "16", "--tolerance", "1e-12"]
    assert main(command) == 1
    said = capsys.readouterr()
    assert "motion: periodic, period one cycle" in said.out
    assert "too few for the tolerance: leave out --harmonics or give more, or accept" in said.err
    monkeypatch.setitem(planning.MOST_HARMONICS, "reduced", 16)
    assert main(command) == 1
    most = "TOLERANCE_NOT_MET, the motion is solved, but 16 harmonics, the most that are taken, are too few"
    assert f"{most} for the tolerance: accept its error with --tolerance." in capsys.readouterr().err


def test_a_sweep_tells_how_many_speeds_are_done(monkeypatch):
    done = []
    answer_speeds(pair(LIGHT), [4000.0, 4500.0], Asked(), progress=done.append, say=done.append)
    assert sum(count for count in done if isinstance(count, int)) == 2
    assert "speeds marched until the motion settles" in done
    monkeypatch.setattr(compute, "_orbit", lambda *_, **__: pytest.fail("an orbit nobody asked for"))
    answer_one(pair(LIGHT), 4000.0, Asked())


def test_a_sweep_that_is_kept_goes_on_and_a_folder_of_another_sweep_is_refused(tmp_path, capsys):
    folder, file = tmp_path / "kept", tmp_path / "numbers.json"
    command = ["sweep", "spur_pair", "--rpm", "4500,5000", "--out", str(folder), "--json", str(file)]
    assert main([*command, "--chunk", "1"]) == 0
    first, told = file.read_bytes(), capsys.readouterr().out
    assert len(list(folder.glob("*.npz"))) == 2
    assert main([*command, "--chunk", "1"]) == 0
    assert file.read_bytes() == first and capsys.readouterr().out == told
    refused = {
        "other options: speeds of a chunk 1 there, 16 now": command,
        "the same scene with other numbers": [*command, "--chunk", "1", "--set", "gear a.inertia=0.02"],
        "answers steady states there, periodic solutions now": [*command, "--chunk", "1", "--orbit"],
    }
    for words, wrong in refused.items():
        assert main(wrong) == 2
        assert words in capsys.readouterr().err
    assert file.read_bytes() == first
