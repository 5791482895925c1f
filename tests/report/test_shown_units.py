"""Tables, sentences and pictures show quantities in the units that a scene or a command
chooses; files of numbers stay in SI.
"""

import re

import pytest

import jaxhb
from jaxhb.elements.sentences import SceneError
from jaxhb.elements.units import UnitError, chosen_units
from jaxhb.report.figures.figure import Axis, figure, line
from jaxhb.report.table import Column, Table
from jaxhb.report.units import said, shown_in, shown_unit

PAIR = """
[scene]
revolutions_per_cycle = 1

[[disk]]
name = "a"
inertia = 1.0

[[disk]]
name = "b"
inertia = 2.0

[[shaft]]
between = ["a", "b"]
stiffness = 1e6
damping = 10.0

[[torque]]
disk = "a"
mean = 500.0
harmonics = [[1.0, 300.0, 0.0]]

[[load]]
disk = "b"
"""
TORQUE = Column("{N m}", "torque", unit="N m")


def test_a_command_shows_its_answer_in_chosen_units_and_files_in_si(run_once):
    command = "solve engine_with_damper --rpm 1600"
    usual = run_once(command, "csv")
    units = "torque=kN m,angle=mrad,speed=Hz,power=kW,force=N"
    chosen = run_once(f"{command} --units '{units}'", "csv")
    chosen.check_printed("solve_in_chosen_units")
    assert chosen.rows == usual.rows


def test_the_scene_chooses_units_and_the_command_goes_before_it(run, tmp_path):
    scene = tmp_path / "pair.toml"
    scene.write_text(f'{PAIR}\n[report]\nunits = {{ torque = "lbf ft" }}\n')
    of_scene = run(f"solve {scene} --rpm 1600")
    assert "Torque of shafts and dampers, lbf ft (mean" in of_scene.out
    of_command = run(f"solve {scene} --rpm 1600 --units 'torque=kgf m'")
    assert "Torque of shafts and dampers, kgf m (mean" in of_command.out
    # lbf ft and kgf m from the definitions of both, by hand
    ratio = 9.80665 / (0.45359237 * 9.80665 * 0.3048)

    def first(out):
        row = re.search(r"^  a\|b +(\S+) +(\S+)", out, re.MULTILINE)
        return float(row[2])

    # Both are printed with four digits.
    assert first(of_scene.out) == pytest.approx(ratio * first(of_command.out), rel=1e-3)


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ("units = { torke = 'N m' }", "there is no quantity 'torke'. Did you mean"),
        ("units = { torque = 'kN' }", "torque is 'kN', must be in N m or a unit like"),
        ("units = { torque = 3 }", "torque is 3, must be a unit in quotes."),
        ("units = 'kN m'", "units is 'kN m', must be a table. Write units ="),
        ("unit = {}", "unknown key 'unit'. Did you mean 'units'?"),
    ],
)
def test_a_report_table_that_cannot_be_read_is_told(tmp_path, table, sentence):
    scene = tmp_path / "pair.toml"
    scene.write_text(f"{PAIR}\n[report]\n{table}\n")
    with pytest.raises(SceneError) as caught:
        jaxhb.load_scene(scene)
    (only,) = caught.value.sentences
    assert only.startswith(f"pair.toml, [report]: {sentence}")


def test_torques_of_10_kN_m_and_more_are_in_kN_m_with_all_their_digits():
    small = Table("Torque, {N m}", ["", TORQUE], [["a", 9999.4], ["b", 12.0]])
    assert small.splitlines() == ["Torque, N m", "      N m", "  a  9999", "  b    12"]
    large = Table("Torque, {N m}", ["", TORQUE], [["a", -1e4], ["b", 12.0]])
    assert large.splitlines() == [
        "Torque, kN m",
        "        kN m",
        "  a  -10.000",
        "  b    0.012",
    ]


def test_a_chosen_unit_stays_whatever_the_size():
    with shown_in(chosen_units({"torque": "N m"})):
        table = Table("Torque, {N m}", ["", TORQUE], [["a", 2e4]])
        assert table.splitlines()[0] == "Torque, N m"
        picture = figure("c", Axis("x"), "torque, N m", [line([0, 1], [0, 2e4], "a")])
        assert picture.panels[0].title == "torque, N m"
        assert said(2e4, "N m") == "20000 N m"
    assert shown_unit("N m") == (1.0, "N m")
    picture = figure("c", Axis("x"), "torque, N m", [line([0, 1], [0, 2e4], "a")])
    assert picture.panels[0].title == "torque, kN m"


@pytest.mark.parametrize(
    ("quantity", "unit", "si_unit", "factor"),
    [
        ("torque", "MN m", "N m", 1e-6),
        ("angle", "mrad", "rad", 1e3),
        ("speed", "Hz", "rad/s", 1 / 6.283185307179586),
        ("speed", "1/min", "rad/s", 60 / 6.283185307179586),
        ("stress", "ksi", "Pa", 0.0254**2 / (0.45359237 * 9.80665 * 1e3)),
        ("power", "PS", "W", 1 / (75 * 9.80665)),
    ],
)
def test_factors_of_chosen_units_are_those_of_hand_computation(
    quantity, unit, si_unit, factor
):
    assert chosen_units({quantity: unit}) == {
        si_unit: (pytest.approx(factor, rel=1e-15), unit)
    }


def test_a_choice_ends_with_its_block():
    with pytest.raises(UnitError), shown_in({"N": (1.0, "N")}):
        chosen_units({"force": "m"})
    assert shown_unit("N") == (1e-3, "kN")
