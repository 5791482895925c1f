"""``jaxhb new`` writes a scene to begin with; ``jaxhb check`` and the answers tell what
is far from usual, once.
"""

import tomllib

import numpy as np
import pytest

import jaxhb
from jaxhb.scene.writer import scene_text
from jaxhb.train.excitation import excitation
from jaxhb.train.kinematics import tooth_damping_ratios

ENGINE = "inline_four_timing_drive"
NOTE = (
    "[[mesh]] 'gear a|gear b': backlash is 0.002 m, usual 2e-5 to 0.001 m: is it in m,"
    " not in mm?"
)
TWO = (
    '[[disk]]\nname = "a"\ninertia = 1\n[[disk]]\nname = "b"\ninertia ='
    ' 1\n[[shaft]]\nbetween = ["a", "b"]\n'
)


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Folder of the test, in which commands run."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_a_scene_to_begin_with_is_written_and_has_nothing_to_note(here, run):
    run("new 'my engine.toml'").check_printed("new")
    text = (here / "my engine.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["scene"]["name"] == "my engine"
    # Comments tell what may be changed.
    assert text.count("#") > 40
    run("check 'my engine.toml'").check_printed("check_new_scene")


def test_a_copy_has_the_tables_and_the_comments_of_its_scene(here, run):
    run(f"new four.toml --from {ENGINE}").check_printed("new_from_scene")
    table = f"{ENGINE}_pressure.csv"
    assert sorted(path.name for path in here.iterdir()) == ["four.toml", table]
    copy = jaxhb.load_scene("four.toml")
    train = jaxhb.load_scene(ENGINE)
    assert copy.topology.name == "four"
    np.testing.assert_array_equal(copy.cylinders.pressure, train.cylinders.pressure)
    text = (here / "four.toml").read_text(encoding="utf-8")
    assert "# m: four times 0.499 litres" in text


def test_nothing_is_overwritten(here, run):
    files = here / "mine.toml", here / "spur_pair_omega_squared.csv"
    for file in files:
        file.write_text("mine")
    run("new mine.toml", status=2).check_printed("new_over_a_scene")
    run("new other.toml --from spur_pair", status=2).check_printed("new_over_a_table")
    contents = {path: path.read_text() for path in here.iterdir()}
    assert contents == dict.fromkeys(files, "mine")


@pytest.mark.slow
@pytest.mark.parametrize("name", jaxhb.scene_names())
def test_there_is_nothing_to_note_on_a_packaged_scene_and_its_loads(name, run_once):
    assert run_once(f"check {name}", "json").json["notes"] == []


def test_check_tells_torques_tooth_forces_and_damping(run):
    completed = run(f"check {ENGINE}", "json")
    completed.check_printed("check_engine")
    record = completed.json
    train = jaxhb.load_scene(ENGINE)
    assert record == record | {"notes": [], "scene": ENGINE}
    assert record["mean_torque_Nm"]["pump plungers"] == [-20.0]
    # Statics: the pump and the camshaft turn at half speed, the load takes what is left
    # of the gas torque.
    gas = [record["mean_torque_Nm"][f"cylinder {k}"][0] for k in (1, 2, 3, 4)]
    load = record["mean_torque_Nm"]["vehicle:load"]
    assert load == pytest.approx([-sum(gas) + 14.0], rel=1e-9)
    force = {name: mesh["mean_force"][0] for name, mesh in record["meshes"].items()}
    assert force["idler|pump gear"] == pytest.approx(20.0 / 0.075, rel=1e-9)
    assert force["crank gear|idler"] == pytest.approx(28.0 / 0.075, rel=1e-9)
    ratios = [mesh["damping_ratio"] for mesh in record["meshes"].values()]
    np.testing.assert_allclose(ratios, tooth_damping_ratios(train), rtol=1e-12)
    frequencies = jaxhb.natural_frequencies(train).frequencies_hz.tolist()
    assert record["modes"]["frequencies_hz"] == frequencies


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "torques"), [("", [-778, -4761]), ("--rpm 1800", [-2317])]
)
def test_check_takes_the_ends_of_what_the_scene_gives_over_the_speed(
    run_once, options, torques
):
    record = run_once(f"check gear_train_30 {options}", "json").json
    assert record["mean_torque_Nm"]["load:load"] == pytest.approx(torques, abs=0.5)


@pytest.mark.slow
def test_a_load_that_drives_is_noted_with_its_torque_and_a_motor_given_as_a_load_is_not(
    here, run
):
    run(f"new four.toml --from {ENGINE}")
    path = here / "four.toml"
    text = path.read_text()
    path.write_text(text.replace("table_firing_tdc = 0.0", "table_firing_tdc = 180.0"))
    pressure, load = run("check four.toml", "json").json["notes"]
    assert "169 deg" in pressure
    beginning = "[[load]] 'vehicle:load': it drives the train with 285.8 N m, "
    assert load.startswith(beginning)
    motor = '[[load]]\ndisk = "a"\n[[torque]]\ndisk = "b"\nmean = -50.0\n'
    (here / "mill.toml").write_text(f"{TWO}stiffness = 1e4\n{motor}")
    record = run("check mill.toml", "json").json
    assert record["notes"] == []
    assert record["mean_torque_Nm"]["a:load"] == [50.0]


def test_check_of_links_that_vary_says_what_it_lacks(here, run):
    varying = "over_hz = [[0, 1, 1], [100, 2, 1]]"
    (here / "rubber.toml").write_text(f"{TWO}stiffness = 1e4\n{varying}\n")
    run("check rubber.toml").check_printed("check_links_vary")
    words = run("check rubber.toml --links-at hz=100").words
    assert f"{np.sqrt(4e4) / (2 * np.pi):.2f}" in words


def test_check_shows_numbers_over_the_speed_and_modes_are_those_of_a_speed(here, run):
    rows = "stiffness_over_rpm = [[500, 1e4], [1500, 3e4]]"
    (here / "joint.toml").write_text(f"{TWO}{rows}\n")
    run("check joint.toml").check_printed("check_over_rpm")
    record = run("check joint.toml", "json").json
    assert record["over_rpm"] == {"a|b.stiffness": [[500.0, 1e4], [1500.0, 3e4]]}
    # Halfway between the rows.
    words = run("modes joint.toml --links-at rpm=1000").words
    assert f"{np.sqrt(4e4) / (2 * np.pi):.2f}" in words


@pytest.mark.parametrize(
    ("scene", "rpm", "stiffness"),
    [("rated_rpm = 1000", 1000, 2e4), ("", 1500, 3e4)],
)
def test_modes_and_holzer_are_those_of_the_rated_speed_and_say_so(
    here, run, scene, rpm, stiffness
):
    """Without one those of the highest speed that the scene gives."""
    rows = "stiffness_over_rpm = [[500, 1e4], [1500, 3e4]]"
    drive = '[[torque]]\ndisk = "a"\nharmonics = [[1, 5.0, 0.0]]\nscale = [[1500, 1]]\n'
    (here / "joint.toml").write_text(f"[scene]\n{scene}\n{TWO}{rows}\n{drive}")
    hz = f"{np.sqrt(2 * stiffness) / (2 * np.pi):.4f}"[:5]
    sentence = f"Modes are those at {rpm} rpm; --links-at takes another speed."
    for command in ("modes joint.toml", "holzer joint.toml"):
        completed = run(command, "json")
        assert completed.json["notes"] == [sentence]
        assert sentence in completed.out
        assert hz in completed.words
    assert sentence not in run("modes joint.toml --links-at rpm=700").out


def test_modes_at_a_mean_load_say_nothing_of_teeth_that_a_train_does_not_have(
    here, run
):
    (here / "shaft.toml").write_text(f"{TWO}stiffness = 1e4\n")
    for command in ("modes", "holzer"):
        words = run(f"{command} shaft.toml --at 900").out
        assert "teeth" not in words
        assert "of a mesh" not in words


@pytest.mark.slow
def test_check_tells_what_a_tuning_would_refuse(here, run):
    text, _ = scene_text("first_scene")
    wrong = text.replace('of = "crank gear|pump gear"', 'of = "crank gear|pump"')
    (here / "wrong.toml").write_text(wrong, encoding="utf-8")
    completed = run("check wrong.toml", "json")
    (note,) = completed.json["notes"]
    assert "jaxhb tune" in note
    assert "no mesh 'crank gear|pump'" in note
    assert note in completed.words


@pytest.mark.parametrize("command", ["solve", "sweep", "report"])
def test_the_notes_on_the_scene_are_told_once(command, run):
    line = f"{command} spur_pair --rpm 2000 --set 'gear a|gear b.backlash=0.002'"
    completed = run(line, "json")
    assert completed.words.count("backlash is 0.002 m") == 1
    assert completed.json["scene_notes"] == [NOTE]
    text = completed.path("json").read_text(encoding="utf-8")
    assert text.count("backlash is 0.002 m") == 1


def test_check_tells_mass_crank_pressure_and_power_of_every_cylinder(run_once):
    """Work of a cycle is the mean pressure times the swept volume, in two
    revolutions.
    """
    record = run_once("check six_cylinder_diesel", "json").json
    one = record["cylinders"]["cylinder 5"]
    train = jaxhb.load_scene("six_cylinder_diesel")
    bore = float(train.cylinders.bore[0])
    swept = np.pi / 4 * bore**2 * 2 * one["crank_radius_m"]
    assert one["firing_deg"] == 120.0
    np.testing.assert_allclose(one["swept_volume_m3"], swept, rtol=1e-14)
    for rpm, imep, power, mean in zip(
        record["rpm"],
        one["imep_Pa"],
        one["power_W"],
        record["mean_torque_Nm"]["cylinder 5"],
        strict=True,
    ):
        np.testing.assert_allclose(power, imep * swept * rpm / 120, rtol=1e-12)
        np.testing.assert_allclose(power, mean * 2 * np.pi * rpm / 60, rtol=1e-12)


def test_tangential_pressures_of_check_are_read_back(here, run):
    """The CSV file in the place of the combustion gives the same torques."""
    train = jaxhb.load_scene("first_scene")
    command = 'check first_scene --excitation "cylinder 1" --rpm 1500'
    run(f"{command} --csv table.csv", "json").check_printed("check_excitation")
    table = jaxhb.tangential_pressure(train, "cylinder 1", rpm=1500.0)
    text, _ = scene_text("first_scene", expand=True)
    parts = tomllib.loads(text)
    (cylinder,) = parts["cylinder"]
    lines = ["[cylinder.tangential_pressure]", 'cosine_sine = "table.csv"']
    lines += [f"imep = {float(table.imep[-1])!r}"]
    (here / "table.toml").write_text(
        "\n".join(
            [
                '[[disk]]\nname = "a"\ninertia = 1.0\n[[disk]]\nname = "b"',
                'inertia = 1.0\n[[shaft]]\nbetween = ["a", "b"]\nstiffness = 1e5',
                '[[load]]\ndisk = "b"\n[[cylinder]]\ndisk = "a"',
                f"bore = {cylinder['bore']}\nstroke = {cylinder['stroke']}",
                *lines,
            ]
        )
    )
    back = jaxhb.load_scene("table.toml")
    seat = train.topology.cylinders.disk[0]
    mass = train.replace({"cylinder 1.reciprocating_mass": 0.0}).replace(
        {"plungers.mean": 0.0}
    )
    expected = np.asarray(excitation(mass, 1500.0, 20)[0])[seat]
    actual = np.asarray(excitation(back, 1500.0, 20)[0])[0]
    np.testing.assert_allclose(
        actual, expected, rtol=0, atol=1e-10 * np.abs(expected).max()
    )
    run("check first_scene --csv other.csv", status=2).check_printed(
        "check_csv_of_nothing"
    )
