"""Options of commands that take a number with a unit: readers, and commands against the
same commands with plain numbers.
"""

import pytest
from tolerances import ALGEBRAIC

from jaxhb.cli import values


@pytest.mark.parametrize(
    "read, word, expected",
    [
        (values.seconds, "2 min", 120.0),
        (values.seconds, "3", 3.0),
        (values.frequency, "600rpm", 10.0),
        (values.frequency, "0.5 kHz", 500.0),
        (values.speed_step, "0.5 Hz", 30.0),
        (values.angle, "-0.5rev", -180.0),
        (values.speed_pair, "4:7.5Hz", (240.0, 450.0)),
        (values.speed_pair, "400:450", (400.0, 450.0)),
        (values.speed_rows, "0:4,2min:9Hz", [(0.0, 240.0), (120.0, 540.0)]),
        (values.speed_rows, "0:0,20:9Hz", [(0.0, 0.0), (20.0, 540.0)]),
        (values.place, "hz=600 rpm", ("hz", 10.0)),
        (values.place, "amplitude=2mrad", ("amplitude", 0.002)),
        (values.place, "rpm=25 Hz", ("rpm", 1500.0)),
    ],
)
def test_numbers_of_options_have_units(read, word, expected):
    found = read(word)
    if isinstance(expected, list):
        found, expected = sum(found, ()), sum(expected, ())
    if isinstance(found, tuple) and isinstance(found[0], str):
        assert found[0] == expected[0]
        found, expected = found[1:], expected[1:]
    assert found == pytest.approx(expected, rel=ALGEBRAIC)


@pytest.mark.parametrize(
    "read, word, sentence",
    [
        (values.seconds, "2 Hz", "'2 Hz' must be in s or a unit like it."),
        (values.seconds, "-2 min", "'-2 min' must be a number greater than 0 s"),
        (values.seconds, "soon", "'soon' must be a number greater than 0 s"),
        (values.frequency, "3 kW", "'3 kW' must be in Hz or a unit like it."),
        (values.speed_pair, "7 Hz:450", "has the unit 'Hz' and none behind the last"),
        (values.speed_pair, "4:7 mm", "'4 mm' must be in rpm or a unit like it."),
        (values.speed_rows, "0:4,2 Hz:9", "'0 Hz' must be in s or a unit like it."),
        (values.speed_rows, "0:4,2", "'0:4,2' is not S:RPM,S:RPM,..."),
        (values.place, "hz=25 N", "'25 N' must be in Hz or a unit like it."),
        (values.place, "khz=25", "is none of hz=VALUE, amplitude=VALUE and rpm=VALUE"),
        (values.angle, "north", "'north' must be a number"),
    ],
)
def test_units_that_do_not_fit_are_told(read, word, sentence):
    with pytest.raises(ValueError) as refusal:
        read(word)
    assert sentence in str(refusal.value)


def test_commands_take_units(run):
    plain = run("holzer spur_pair --hz 10")
    assert run("holzer spur_pair --hz 600rpm").out == plain.out
    refused = run("holzer spur_pair --hz 3kW", status=2).err
    assert "'3kW' must be in Hz" in refused


def test_transients_take_units(run):
    line = "transient spur_pair --seconds {} --speed {} --passage {}"
    plain = run(line.format("0.06", "0:1200,0.06:1500", "1260:1380")).out
    assert run(line.format("60ms", "0:20,60ms:25Hz", "21:23Hz")).out == plain
    assert "1260" in plain
