"""Excitation of the train on the page: numbers and files of the scene, pressures,
orders and loads.
"""

import re
from types import SimpleNamespace

import numpy as np
import pytest

import jaxhb
from jaxhb.report.answer import Case
from jaxhb.report.page.page import parts_of
from jaxhb.report.page.parts import Report
from jaxhb.report.page.train import assumptions, excitation_tables
from jaxhb.report.text.columns import NONE
from jaxhb.scene.writer import element_files, elements_of
from jaxhb.train.changes import scene_values

FOLDER = jaxhb.__path__[0] + "/scene/scenes/"


def tables_of(scene, speeds, settings=None):
    """Tables of a scene by the first word of their titles, all tables of orders."""
    train = jaxhb.load_scene(scene)
    elements = elements_of(scene, scene_values(train, settings or {}))
    train = train.replace(settings or {})
    responses = [jaxhb.linear_response(train, rpm=rpm) for rpm in speeds]
    answers = [
        SimpleNamespace(linear=response, balance=response, rpm=float(response.rpm))
        for response in responses
    ]
    report = SimpleNamespace(
        train=train,
        rpm=speeds,
        cases=[SimpleNamespace(answers=answers)],
        elements=elements,
        files=element_files(scene),
    )
    tables = {}
    for table in excitation_tables(report):
        title = re.split(" of |[:,] | given | over ", table.caption)[0]
        tables.setdefault(title, []).append(table)
    orders = {"Orders": tables["Orders"]} if "Orders" in tables else {}
    return {title: alike[0] for title, alike in tables.items()} | orders


def numbers_of(tables):
    """Numbers of the elements by their names."""
    names, values = tables["Numbers"].columns
    return dict(zip(names, values, strict=True))


def column(table, head):
    """Cells of a table below a head."""
    return table.columns[table.heads.index(head)]


def test_pressure_tables_are_told_by_file_peak_angle_and_scale_over_the_speed():
    tables = tables_of("six_cylinder_diesel", [1000.0, 2000.0])
    assert column(tables["Cylinders"], "numbers as of") == ["cylinder 1"] * 6
    numbers = numbers_of(tables)
    assert numbers["bore mm"] == "105"
    assert numbers["pressure"].endswith(", six_cylinder_diesel_pressure.csv")
    assert numbers["scale"].startswith("16 rows, rpm 997.847 to 2550.55, factor 0.")
    assert numbers["scale"].endswith(", six_cylinder_diesel_peak_pressure.csv")
    over_speed = tables["Gas"]
    means = tables["Mean torques"]
    speeds, factors = np.loadtxt(
        FOLDER + "six_cylinder_diesel_peak_pressure.csv", delimiter=",", unpack=True
    )
    pressure = np.loadtxt(FOLDER + "six_cylinder_diesel_pressure.csv", delimiter=",")
    place = pressure[:, 1].argmax()
    for row, rpm in enumerate((1000.0, 2000.0)):
        peak = 1e-5 * pressure[place, 1] * np.interp(rpm, speeds, factors)
        assert float(column(over_speed, "largest pressure bar")[row]) == pytest.approx(
            peak, rel=1e-3
        )
        angle = float(column(over_speed, "deg after firing TDC")[row])
        assert angle == pytest.approx(pressure[place, 0] - 360.0, abs=0.1)
        mean = float(column(over_speed, "mean torque N m")[row])
        swept = np.pi / 4 * 0.105**2 * 0.137
        assert float(column(over_speed, "imep bar")[row]) == pytest.approx(
            4e-5 * np.pi * mean / swept, rel=1e-3
        )
        _, load, power = map(float, means.columns[2 + row])
        assert load == pytest.approx(-6 * mean, rel=1e-2)
        assert power == pytest.approx(6 * mean * rpm * np.pi / 30e3, rel=1e-2)


def test_a_cylinder_whose_gas_differs_has_numbers_and_rows_of_its_own():
    tables = tables_of("six_cylinder_diesel", [1000.0], {"cylinder 2.gas_factor": 0.5})
    sources = column(tables["Cylinders"], "numbers as of")
    assert sources[:3] == ["cylinder 1", "cylinder 2", "cylinder 1"]
    row = tables["Numbers"].columns[0].index("gas factor")
    assert column(tables["Numbers"], "cylinder 2")[row] == "0.5"
    assert tables["Gas"].columns[0] == ["cylinder 1", "cylinder 2"]
    whole, half = map(float, column(tables["Gas"], "largest pressure bar"))
    assert half == pytest.approx(whole / 2, rel=1e-3)


def test_orders_of_torques_with_the_same_amplitudes_stand_in_one_table():
    valves, pump, gas = tables_of("gear_train_30", [1200.0])["Orders"]
    assert valves.caption.startswith("Orders of 10 torques with the same amplitudes: ")
    assert valves.heads[2:] == [
        f"valves {bank}{k}" for bank in "AB" for k in range(1, 6)
    ]
    assert pump.columns[0] == ["3", "6"]
    gas_torque = np.loadtxt(FOLDER + "gear_train_30_gas_torque.csv", delimiter=",")
    orders, amplitudes, phases = gas.columns
    for order, amplitude, phase, (expected, real, imaginary) in zip(
        orders, amplitudes, phases, gas_torque, strict=True
    ):
        assert float(order) == expected
        assert float(amplitude) == pytest.approx(abs(real + 1j * imaginary), abs=0.6)
        assert float(phase) == pytest.approx(
            np.degrees(np.arctan2(imaginary, real)), abs=0.06
        )


def test_orders_of_another_rotor_count_revolutions_of_the_reference_rotor():
    tables = tables_of("inline_four_timing_drive", [900.0])
    # Orders 3, 6 and 9 of the pump, which turns at half the speed.
    assert tables["Orders"][-1].columns[0] == ["1.5", "3", "4.5"]
    assert numbers_of(tables)["ambient pressure bar"] == "1"


def test_a_torque_tells_how_it_changes_over_the_speed():
    scale = (
        "60 rows, rpm 281.25 to 16875, factor 0.0025 to 9, spur_pair_omega_squared.csv"
    )
    assert column(tables_of("spur_pair", [900.0])["Torques"], "scale") == [
        NONE,
        NONE,
        scale,
        scale,
    ]


def test_a_combustion_model_is_told_by_its_numbers():
    numbers = numbers_of(tables_of("first_scene", [2000.0]))
    assert numbers["combustion: imep bar"] == "8"
    assert numbers["combustion: compression ratio"] == "17"


def test_a_unit_at_the_end_of_a_name_is_not_told_twice(tmp_path):
    scene = tmp_path / "fan.toml"
    scene.write_text(
        '[[disk]]\nname = "fan"\ninertia = 1\n[[load]]\ndisk = "fan"\nlaw ='
        ' "propeller"\nrated_torque = 9\nrated_rpm = 900\n[[torque]]\ndisk = "fan"\n'
        "mean = 9\n[scene]\nrevolutions_per_cycle = 1\n"
    )
    assert tables_of(scene, [900.0])["Loads"].heads[-2:] == [
        "rated torque N m",
        "rated rpm",
    ]


@pytest.mark.slow
def test_the_assumptions_tell_what_is_left_of_a_cylinder_that_does_not_fire():
    combustion = jaxhb.Combustion(
        compression_ratio=16.0,
        charge_pressure=2e5,
        start=-5.0,
        duration=60.0,
        imep=1e6,
    )
    parts = [
        jaxhb.Disk(name="a", inertia=1.0, damping=1.0),
        jaxhb.Disk(name="b", inertia=1.0),
        jaxhb.Load(disk="b"),
        jaxhb.Shaft(between=("a", "b"), stiffness=1e4),
        jaxhb.Cylinder(
            name="x", disk="a", bore=0.1, stroke=0.1, rod=0.2, combustion=combustion
        ),
    ]
    train = jaxhb.build(parts, revolutions_per_cycle=2)
    report = Report(
        [Case("", [SimpleNamespace(train=train, orbit=False, response=None)])],
        facts={"date": "today"},
    )
    (part,) = parts_of(report, {"": assumptions})
    assert "has no injection: its compression stays" in part.html
    assert "cut off has no gas torque at all" in part.html
    firing, misfiring, cut_off = (
        float(jaxhb.forced_response(case, rpm=1000.0).torque("a|b").half_peak_to_peak)
        for case in (train, train.misfire("x"), train.cut_off("x"))
    )
    assert firing > 1.05 * misfiring
    assert misfiring > 10.0
    assert cut_off < 1e-9
