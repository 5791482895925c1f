"""What the page tells of what excites the train: the scene's numbers, files, pressures, orders and loads."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

import jaxhb
from jaxhb.report.answer import Case
from jaxhb.report.page.page import parts_of
from jaxhb.report.page.parts import Report
from jaxhb.report.page.train import assumptions, excitation_tables, torque_over_speed
from jaxhb.report.text.columns import NONE
from jaxhb.scene.writer import element_files


def told(scene, speeds, train=None):
    """Tables of a scene, by the first word of their titles; of orders all."""
    train = train or jaxhb.load_scene(scene)
    responses = [jaxhb.linear_response(train, rpm=rpm) for rpm in speeds]
    answers = [SimpleNamespace(linear=one, balance=one, rpm=float(one.rpm)) for one in responses]
    case = SimpleNamespace(answers=answers)
    report = SimpleNamespace(train=train, rpm=list(speeds), files=element_files(scene), cases=[case])
    found = {}
    for table in excitation_tables(report):
        found.setdefault(table.title.split(" of ")[0].split(":")[0], []).append(table)
    return {title: own if title == "Orders" else own[0] for title, own in found.items()}


def column(table, head):
    return table.columns[table.heads.index(head)]


def test_pressure_tables_are_told_by_file_peak_angle_and_what_changes_them_over_the_speed():
    tables = told("six_cylinder_diesel", [1000.0, 2000.0])
    source, over_speed = tables["Combustion"], tables["Gas"]
    assert [cells[0] for cells in source.columns[:3]] == [
        "pressure table",
        "all 6 cylinders",
        "six_cylinder_diesel_pressure.csv",
    ]
    (said,) = column(source, "factor over the speed")
    assert said.endswith("16 points from 997.847 to 2550.55 rpm, six_cylinder_diesel_peak_pressure.csv")
    folder = jaxhb.__path__[0] + "/scene/scenes/"
    factor = np.loadtxt(folder + "six_cylinder_diesel_peak_pressure.csv", delimiter=",")
    pressure = np.loadtxt(folder + "six_cylinder_diesel_pressure.csv", delimiter=",")
    place = pressure[:, 1].argmax()
    for row, rpm in enumerate((1000.0, 2000.0)):
        peak = 1e-5 * pressure[place, 1] * np.interp(rpm, *factor.T)
        assert float(column(over_speed, "largest pressure bar")[row]) == pytest.approx(peak, rel=1e-3)
        angle = float(column(over_speed, "deg after firing TDC")[row])
        assert angle == pytest.approx(pressure[place, 0] - 360.0, abs=0.1)
        mean = float(column(over_speed, "mean torque N m")[row])
        swept = np.pi / 4 * 0.105**2 * 0.137
        assert float(column(over_speed, "imep bar")[row]) == pytest.approx(4e-5 * np.pi * mean / swept, rel=1e-3)
        load = tables["Mean torques over the speed, N m on the disk's own shaft (positive"].columns[2 + row]
        assert float(load[1]) == pytest.approx(-6 * mean, rel=1e-2)
        assert float(load[2]) == pytest.approx(6 * mean * rpm * np.pi / 30e3, rel=1e-2)


def test_a_cylinder_that_does_not_fire_has_a_row_of_its_own_and_no_pressure():
    train = jaxhb.load_scene("six_cylinder_diesel").misfire("cylinder 2")
    table = told("six_cylinder_diesel", [1000.0], train)["Gas"]
    row = table.columns[0].index("cylinder 2")
    assert column(table, "largest pressure bar")[row] == NONE and column(table, "mean torque N m")[row] == "0"


def test_given_orders_are_amplitudes_and_phases_of_the_reference_rotor_the_same_amplitudes_in_one_table():
    valves, pump, gas = told("gear_train_30", [1200.0])["Orders"]
    assert valves.title.startswith("Orders of 10 torques with the same amplitudes: ")
    assert valves.heads[2:] == [f"valves {bank}{k}" for bank in "AB" for k in range(1, 6)]
    assert pump.columns[0] == ["3", "6"]
    assert "gear_train_30_gas_torque.csv" in gas.title and "all 10 cylinders" in gas.title
    given = np.loadtxt(jaxhb.__path__[0] + "/scene/scenes/gear_train_30_gas_torque.csv", delimiter=",")
    for part in range(3):
        cells = zip(*gas.columns[3 * part : 3 * part + 3], given[8 * part : 8 * part + 8], strict=True)
        for order, amplitude, phase, (wanted, real, imaginary) in cells:
            assert float(order) == wanted and float(amplitude) == pytest.approx(abs(real + 1j * imaginary), abs=0.6)
            assert float(phase) == pytest.approx(np.degrees(np.arctan2(imaginary, real)), abs=0.06)


def test_orders_of_a_shaft_of_its_own_are_counted_in_revolutions_of_the_reference_rotor():
    tables = told("inline_four_timing_drive", [900.0])
    assert tables["Orders"][-1].columns[0] == [
        "1.5",
        "3",
        "4.5",
    ]  # of the pump, 3, 6 and 9 of its own at half the speed
    assert column(tables["Combustion"], "crankcase bar") == ["1"]


def test_a_torque_tells_how_it_changes_over_the_speed():
    train = jaxhb.load_scene("spur_pair")
    files = element_files("spur_pair")["torque"]
    said = "0.0025 to 9, 60 points from 281.25 to 16875 rpm, spur_pair_omega_squared.csv"
    assert [torque_over_speed(train, i, files) for i in range(4)] == [NONE, NONE, said, said]
    fan = jaxhb.build([jaxhb.Disk(name="a", inertia=1.0), jaxhb.Torque(disk="a", harmonics=[(1, 2, 0)], rated_rpm=900)])
    assert torque_over_speed(fan, 0, None) == "(rpm / 900)^2"


def test_a_combustion_model_is_told_by_its_numbers():
    table = told("first_scene", [2000.0])["Combustion model"]
    assert table.columns[1] == ["imep 8 bar"] and column(table, "compression ratio") == ["17"]


def test_what_the_assumptions_advise_keeps_the_compression_of_a_cylinder():
    row = {"disk": "a", "bore": 0.1, "stroke": 0.1, "rod": 0.2, "name": "x"}
    given = {"compression_ratio": 16.0, "charge_pressure": 2e5, "start": -5.0, "duration": 60.0}
    for by, much in (("imep", 1e6), ("heat", 2000.0)):
        parts = [jaxhb.Disk(name="a", inertia=1.0, damping=1.0), jaxhb.Disk(name="b", inertia=1.0)]
        parts += [jaxhb.Load(disk="b"), jaxhb.Shaft(between=("a", "b"), stiffness=1e4)]
        parts += [jaxhb.Cylinder(**row, combustion=jaxhb.Combustion(**given, **{by: much}))]
        train = jaxhb.build(parts, revolutions_per_cycle=2)
        report = Report([Case("", [SimpleNamespace(train=train, orbit=False)])], facts={"date": "today"})
        (part,) = parts_of(report, {"": ("assumptions", assumptions)})
        (key,) = re.findall(r"--set &#34;(.*)=0&#34;", part.html)
        swings = [
            float(jaxhb.forced_response(one, rpm=1000.0).torque("a|b").half_peak_to_peak)
            for one in (train, train.replace({key: 0.0}), train.misfire("x"))
        ]
        assert swings[0] > 1.05 * swings[1] and swings[1] > 10.0 and swings[2] < 1e-9
