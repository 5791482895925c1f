"""Numbers with units are the numbers that hand computation makes of them, or one
sentence.
"""

import dataclasses
import importlib.util
import math
import subprocess
import sys

import numpy as np
import pytest

import jaxhb
from jaxhb.design.tolerances import read_tolerances
from jaxhb.elements import units
from jaxhb.elements.declared import unit_of
from jaxhb.elements.elements import TABLES, Head
from jaxhb.elements.engine import Engine
from jaxhb.elements.sentences import SceneError
from jaxhb.elements.units import (
    Refused,
    UnitError,
    in_unit,
    si_value,
    units_of_columns,
)
from jaxhb.train.changes import in_si

G = 9.80665  # m/s2, of kgf
LB = 0.45359237  # kg
IN = 0.0254  # m
FT = 12 * IN
DEG = math.pi / 180
TURN = 2 * math.pi

WRITTEN = {
    "kg m2": {
        "350 kg cm2": 350e-4,
        "350 kg cm^2": 350e-4,
        "350 kg cm²": 350e-4,
        "350 kg·cm²": 350e-4,
        "350 kgcm2": 350e-4,
        "350kg*cm**2": 350e-4,
        "3.5e8 g mm2": 3.5e8 * 1e-9,
        "1.5 t m2": 1500.0,
        "12 kgf m s2": 12 * G,
        "12 kp m s^2": 12 * G,
        "5 lbf ft s2": 5 * LB * G * FT,
        "5 lb in2": 5 * LB * IN**2,
        "5 slug ft2": 5 * LB * G * FT,
        "2 N m s2": 2.0,
    },
    "N m/rad": {
        "1.976 MN m/rad": 1.976e6,
        "1.976e3 kNm/rad": 1.976e6,
        "1.976 MNm": 1.976e6,
        "120 N m/deg": 120 / DEG,
        "120 N m/°": 120 / DEG,
        "120 N m deg^-1": 120 / DEG,
        "120 Nm/mrad": 120e3,
        "7 lbf in/rad": 7 * LB * G * IN,
        "7 kgf m/rad": 7 * G,
    },
    "N m s/rad": {
        "300 N m s/rad": 300.0,
        "300 Nms/rad": 300.0,
        "0.3 kN m/(rad/s)": 300.0,
        "0.3 kN m s": 300.0,
        "5 N m/rpm": 5 * 60 / TURN,
    },
    "N/m": {"75 N/µm": 75e6, "75 kN/mm": 75e6, "7 lbf/in": 7 * LB * G / IN},
    "m": {"0.2 mm": 2e-4, "0.35 in": 0.35 * IN, "8 mil": 8e-3 * IN, "20 µm": 2e-5},
    "Pa": {
        "110 bar": 110e5,
        "75 N/mm2": 75e6,
        "75 MPa": 75e6,
        "20 psi": 20 * LB * G / IN**2,
        "3 kgf/cm2": 3e4 * G,
    },
    "W": {"85 kW": 85e3, "10 PS": 750 * G, "10 hp": 5500 * LB * G * FT},
    "deg": {"30 deg": 30.0, "30°": 30.0, "0.5 rad": 0.5 / DEG, "0.25 rev": 90.0},
    "rpm": {
        "1500 1/min": 1500.0,
        "1500 min^-1": 1500.0,
        "1500 rpm": 1500.0,
        "25 Hz": 1500.0,
        "157 rad/s": 157 * 60 / TURN,
    },
    "Hz": {"1500 rpm": 25.0, "25 1/s": 25.0, "10 rad/s": 10 / TURN, "2 kHz": 2000.0},
    "rad/s": {"3 deg/s": 3 * DEG, "60 rpm": TURN, "2 Hz": 2 * TURN},
    "": {"5 %": 0.05, "5%": 0.05, "5 ‰": 0.005},
    "kg": {"4300 g": 4.3, "0.0043 t": 4.3, "2 lb": 2 * LB},
    "s": {"20 ms": 0.02, "2 min": 120.0},
    "J": {"3 kJ": 3000.0, "3 kN m": 3000.0},
}
"""Numbers as people write them, by the unit of the key."""

REFUSED = {
    ("5 kN", "N m/rad"): "must be in N m/rad or a unit like it.",
    ("5 KNm", "N m"): "whose unit is not known, must be in N m or a unit like it. Did"
    " you mean 'kN m'?",
    ("5 Mpa", "Pa"): "whose unit is not known, must be in Pa or a unit like it. Did you"
    " mean 'MPa'?",
    ("4 lb-ft", "N m"): "must be in N m or a unit like it. Did you mean 'lbf-ft'?",
    ("4 kg/cm2", "Pa"): "must be in Pa or a unit like it. Did you mean 'kgf/cm2'?",
    ("100 kgf m2", "kg m2"): "must be in kg m2 or a unit like it. The flywheel effect"
    " GD2 in kgf m2 is the key gd2.",
    ("10 000 N m", "N m"): "must be one number and a unit. Write thousands without",
    ("10'000 N m", "N m"): "must be one number and a unit. Write thousands without",
    ("1,5 kN m", "N m"): "must have a point before its decimals, and not a comma.",
    ("5 N m/rad s", "N m s/rad"): "whose unit is not known, must be in N m s/rad or a"
    " unit like it. Did you mean 'N m s/rad'?",
    ("157 1/s", "rpm"): "may be rad/s or revolutions a second. Write rad/s, Hz or rpm.",
    ("3 1/s", "rad/s"): "may be rad/s or revolutions a second. Write rad/s, Hz or rpm.",
    ("5 degC", "Pa"): "must be in Pa or a unit like it. Known: Pa, MPa,",
    ("5 %", "deg"): "must be in deg or a unit like it. Known: deg, rad, mrad, rev.",
    ("5 PS", "N m"): "must be in N m or a unit like it.",
    ("5 rad", "m"): "must be in m or a unit like it.",
    ("5 m", ""): "must be a number without unit. Write the number alone.",
    ("5 dB", ""): "whose unit is not known, must be a number without unit.",
    ("5 a", "s"): "whose unit is not known, must be in s or a unit like it.",
    ("5 %", "N m"): "must be in N m or a unit like it.",
    ("5 __import__('os')", "N"): "whose unit is not known",
}


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [(text, unit, n) for unit, row in WRITTEN.items() for text, n in row.items()],
)
def test_a_number_with_a_unit_is_what_hand_computation_makes_of_it(text, unit, number):
    # Factors of pint round like those here: a few units of the last digit.
    assert in_unit(text, unit) == pytest.approx(number, rel=4e-15)


@pytest.mark.parametrize(("text", "unit"), REFUSED)
def test_a_unit_that_does_not_fit_is_told_in_a_sentence(text, unit):
    with pytest.raises(UnitError) as caught:
        in_unit(text, unit)
    assert str(caught.value).startswith(REFUSED[text, unit])


def test_numbers_in_the_unit_of_the_key_keep_their_bits():
    numbers = (0.1, 1.976e6, 1 / 3, 1e-300)
    assert [in_unit(f"{n!r} N m/rad", "N m/rad") for n in numbers] == [*numbers]


ALL_CLASSES = {*TABLES.values(), Head, Engine} | {
    field.metadata["of"]
    for cls in TABLES.values()
    for field in dataclasses.fields(cls)
    if "of" in field.metadata
}


@pytest.mark.parametrize("cls", sorted(ALL_CLASSES, key=lambda cls: cls.__name__))
def test_every_key_with_a_unit_takes_its_own_and_those_in_which_it_is_often_written(
    cls,
):
    for field in dataclasses.fields(cls):
        kind = field.metadata["kind"]
        unit = unit_of(field)
        if kind in ("number", "shorthand") and unit:
            assert si_value(cls, field, f"2.5 {unit}") == 2.5, field.name
            for other in units.OFTEN[unit]:
                value = si_value(cls, field, f"2.5 {other}")
                assert isinstance(value, float), (field.name, other)
        if kind in ("number", "shorthand", "count"):
            refused = si_value(cls, field, "2.5 mol")
            assert isinstance(refused, Refused), field.name
        if kind in ("rows", "numbers"):
            columns = units_of_columns(cls, field)
            row = [f"2.5 {unit}" if unit else 2.5 for unit in columns]
            rows = [row] if kind == "rows" else row
            numbers = si_value(cls, field, rows)
            assert numbers in ([[2.5] * len(row)], [2.5] * len(row)), field.name


SCENE = """
[scene]
revolutions_per_cycle = 1
rated_rpm = {rated}
reference = "flywheel"

[[disk]]
name = "flywheel"
{inertia}
damping_over_rpm = [[{rpm0}, {damping}], [{rpm1}, {damping}]]

[[disk]]
name = "rotor"
inertia = 2.0
radius = {radius}

[[shaft]]
between = ["flywheel", "rotor"]
stiffness = {stiffness}
loss_factor = {loss}
clearance = {clearance}
stages = [[{twist}, {stage}]]

[[torque]]
disk = "flywheel"
harmonics = [[1.0, {re}, 0.0]]

[[event]]
name = "shock"
disk = "rotor"
begin = {begin}
ramp = [{ramp}, {rise}]

[sequence.all]
events = ["shock"]
begin = {later}

[scenario.hot]
"flywheel|rotor.stiffness" = {hot}
"flywheel.gd2" = "160 kgf m2"

[tolerance]
"rotor.inertia" = {{ std = {std} }}
"""
PLAIN = {
    "rated": 1500.0,
    "inertia": "inertia = 30.0",
    "rpm0": 600.0,
    "rpm1": 1200.0,
    "damping": 3.0,
    "radius": 0.127,
    "stiffness": 2e6,
    "loss": 0.05,
    "clearance": 0.9,
    "twist": 2.0,
    "stage": 4e6,
    "re": 90.0,
    "begin": 0.5,
    "ramp": 700.0,
    "rise": 0.02,
    "later": 60.0,
    "hot": 1e6,
    "std": 0.02,
}
IN_OTHER_UNITS = {
    "rated": "25 Hz",
    "inertia": 'gd2 = "0.12 tf m2"',
    "rpm0": "10 Hz",
    "rpm1": "20 Hz",
    "damping": "3e-3 kNm s/rad",
    "radius": "5 in",
    "stiffness": "2 MN m/rad",
    "loss": "5 %",
    "clearance": f"{math.radians(0.9)!r} rad",
    "twist": f"{1e3 * math.radians(2.0)!r} mrad",
    "stage": f"{4e6 * math.pi / 180!r} N m/deg",
    "re": "0.09 kN m",
    "begin": "500 ms",
    "ramp": "0.7 kNm",
    "rise": "20 ms",
    "later": "1 min",
    "hot": "1000 kN m/rad",
    "std": "200 kg cm2",
}


def written(tmp_path, numbers):
    """Path of the scene with these numbers, texts quoted."""
    texts = {
        key: value if key == "inertia" else repr(value).replace("'", '"')
        for key, value in numbers.items()
    }
    path = tmp_path / "train.toml"
    path.write_text(SCENE.format(**texts))
    return path


def test_a_scene_in_other_units_is_the_same_train(tmp_path):
    plain = jaxhb.load_scene(written(tmp_path, PLAIN))
    other = jaxhb.load_scene(written(tmp_path, IN_OTHER_UNITS))
    assert other.topology.rated_rpm == pytest.approx(1500.0, rel=1e-12)
    assert other.sequences == {"all": {"events": ["shock"], "begin": 60.0}}
    for train in (plain, other):
        assert train.scenario("hot").value("flywheel|rotor.stiffness") == 1e6
        assert train.scenario("hot").value("flywheel.inertia") == 40.0
    for table in ("disks", "shafts", "torques", "events"):
        a = getattr(plain, table)
        b = getattr(other, table)
        for field in dataclasses.fields(a):
            first, second = getattr(a, field.name), getattr(b, field.name)
            if isinstance(first, np.ndarray):
                np.testing.assert_allclose(
                    second, first, rtol=1e-12, err_msg=field.name
                )
    first, second = map(read_tolerances, (plain, other))
    assert second[0].std == pytest.approx(first[0].std, rel=1e-12)


def test_a_train_takes_numbers_with_units_and_the_flywheel_effect(tmp_path):
    train = jaxhb.load_scene(written(tmp_path, PLAIN))
    shaft = "flywheel|rotor.stiffness"
    changed = train.replace({shaft: "3 MN m/rad", "flywheel.gd2": "16 kgf m2"})
    assert changed.value(shaft) == 3e6
    assert changed.value("flywheel.inertia") == 4.0
    assert changed.value("flywheel.gd2") == 16.0
    # A weight of 9.80665 kN is that of a tonne.
    changed = train.replace({"flywheel.gd2": "9.80665 kN m2"})
    assert changed.value("flywheel.inertia") == pytest.approx(250.0, rel=1e-15)
    with pytest.raises(SceneError, match="the value is '3 kN', must be in N m/rad"):
        train.replace({shaft: "3 kN"})
    assert in_si(train.topology, {"no.such": "3 kN"}) == {"no.such": "3 kN"}


def test_sentences_name_element_key_unit_and_what_was_meant(tmp_path):
    faults = {
        "inertia": 'inertia = "30 kgm"',
        "stiffness": "2 MN",
        "rated": "25 kN",
        "twist": "2 mm",
        "re": "90 Nmm/m2",
        "ramp": "7 kW",
        "hot": "1 blah",
    }
    with pytest.raises(SceneError) as caught:
        jaxhb.load_scene(written(tmp_path, IN_OTHER_UNITS | faults))
    found = sorted(caught.value.sentences)
    expected = [
        "[[disk]] no. 1 'flywheel': inertia is '30 kgm', must be in kg m2",
        "[[event]] no. 1 'shock': ramp: torque is '7 kW', must be in N m",
        "[[shaft]] no. 1: stages, row 1: twist is '2 mm', must be in deg",
        "[[shaft]] no. 1: stiffness is '2 MN', must be in N m/rad",
        "[[torque]] no. 1: harmonics, row 1: Re is '90 Nmm/m2', must be in N m",
        "[scenario.hot]: 'flywheel|rotor': stiffness is '1 blah', whose unit is not",
        "[scene]: rated_rpm is '25 kN', must be in rpm or a unit like it. Known: rpm",
    ]
    assert len(found) == len(expected)
    for sentence, begin in zip(found, expected, strict=True):
        assert sentence.startswith(f"train.toml, {begin}"), sentence


def test_counts_take_no_unit():
    (field,) = [f for f in dataclasses.fields(TABLES["disk"]) if f.name == "teeth"]
    refused = si_value(TABLES["disk"], field, "20 %")
    assert refused.why == "must be a number without unit. Write the number alone."


def test_without_pint_a_sentence_says_what_to_install(monkeypatch):
    units._factor.cache_clear()
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name: None if name == "pint" else find(name),
    )
    with pytest.raises(UnitError) as caught:
        in_unit("5 kN m", "N m")
    assert str(caught.value) == (
        "must be a number in N m where pint is not installed. Install it: pip install"
        ' "jaxhb[units]".'
    )
    assert in_unit("5 N m", "N m") == 5.0


def test_a_scene_without_units_imports_no_pint():
    code = "import jaxhb, sys; jaxhb.load_scene('spur_pair'); sys.exit('pint' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
