"""Temperatures of dampers that give off their heat against a search by scipy with a
closed form of the train, and what is told of them.
"""

import json

import jax
import numpy as np
import pytest
from compiling import executables
from scipy.optimize import brentq

import jaxhb
from jaxhb import Damper, Disk, Shaft, Torque
from jaxhb.cli.main import main
from jaxhb.linear import forced, heat
from jaxhb.scene.writer import elements_text

LAW = ((20.0, 1.0, 1.0), (60.0, 1.0, 0.6), (100.0, 1.0, 0.35), (150.0, 1.0, 0.2))
COOLED = {"over_temperature": LAW, "surface": 0.2, "heat_transfer": 25.0}
AMBIENT = 40.0
CRANK = 2.0
RING = 0.5
DAMPING = 80.0
TORQUE = 1000.0
FOUND = 2e-4
"""K: the temperature is found to 1e-4, and the search by scipy to less."""


def damped(**keys):
    """Free crank with the ring of a viscous damper, under a torque of first order."""
    ring = {"damping": DAMPING, "ambient": AMBIENT} | COOLED | keys
    return [
        Disk(name="crank", inertia=CRANK),
        Damper(name="ring", disk="crank", inertia=RING, **ring),
        Torque(disk="crank", harmonics=((1.0, TORQUE, 0.0),)),
    ]


def built(elements):
    return jaxhb.build(elements, revolutions_per_cycle=1, name="crank and ring")


def power(temperature, rpm):
    """Heat of the ring in W: of a free crank by the torque that its ring takes."""
    omega = rpm * np.pi / 30
    factor = np.interp(temperature, *np.transpose(LAW)[[0, 2]])
    link = 1j * omega * DAMPING * factor
    twist = TORQUE / (link * (CRANK + RING) / RING - CRANK * omega**2)
    return omega * link.imag * abs(twist) ** 2 / 2


@pytest.mark.parametrize("rpm", [150.0, 400.0, 1200.0])
def test_the_temperature_is_that_at_which_the_heat_is_given_off(rpm):
    response = jaxhb.heat_balance(built(damped()), rpm=rpm)
    conductance = COOLED["surface"] * COOLED["heat_transfer"]

    def excess(temperature):
        return AMBIENT + power(temperature, rpm) / conductance - temperature

    expected = brentq(excess, AMBIENT, 1e5, xtol=1e-9)
    assert float(response.temperature("ring")) == pytest.approx(expected, abs=FOUND)
    heat = float(response.power("ring"))
    assert heat == pytest.approx(conductance * (expected - AMBIENT), abs=1e-3)
    warm = built(damped()).replace({"ring.temperature": min(expected, 150.0)})
    fixed = jaxhb.forced_response(warm, rpm=rpm)
    np.testing.assert_allclose(
        response.torque("ring").order(1.0), fixed.torque("ring").order(1.0), rtol=1e-5
    )


@pytest.mark.slow
def test_speeds_are_found_beside_each_other_as_alone():
    speeds = np.linspace(200.0, 1500.0, 6)
    train = built(damped())
    together = jaxhb.heat_balance(train, rpm=speeds).temperature("ring")
    alone = [
        float(jaxhb.heat_balance(train, rpm=r).temperature("ring")) for r in speeds
    ]
    np.testing.assert_allclose(together, alone, atol=FOUND)


def test_few_speeds_more_or_less_compile_nothing():
    train = built(damped())
    response = jaxhb.heat_balance(train, rpm=[500.0, 700.0, 900.0])
    before = executables(heat._balanced), executables(forced._respond)
    fewer = jaxhb.heat_balance(train, rpm=[500.0, 700.0])
    assert (executables(heat._balanced), executables(forced._respond)) == before
    np.testing.assert_array_equal(fewer.temperatures, response.temperatures[:2])


@pytest.mark.slow
def test_two_links_and_stages_beside_them_have_their_own_balance():
    coupling = Shaft(
        between=("crank", "mill"),
        stiffness=2e4,
        relative_damping=0.8,
        over_temperature=((20.0, 1.0, 1.0), (90.0, 0.6, 0.8)),
        surface=0.3,
        heat_transfer=15.0,
        ambient=30.0,
    )
    staged = Shaft(between=("mill", "fan"), stiffness=1e4, stages=((2.0, 3e4),))
    elements = [*damped(), coupling, Disk(name="mill", inertia=3.0)]
    for extra in ([], [staged, Disk(name="fan", inertia=1.0)]):
        train = built([*elements, *extra])
        response = jaxhb.heat_balance(train, rpm=[700.0, 1400.0])
        jaxhb.check(response)
        for name, ambient, conductance in (
            ("ring", AMBIENT, 5.0),
            ("crank|mill", 30.0, 4.5),
        ):
            np.testing.assert_allclose(
                response.temperature(name),
                ambient + response.power(name) / conductance,
                atol=FOUND,
            )


def test_a_train_without_a_balance_of_heat_has_its_forced_response():
    elements = damped(surface=None, heat_transfer=None, ambient=None, temperature=50.0)
    train = built(elements)
    response = jaxhb.heat_balance(train, rpm=900.0)
    assert response == jaxhb.forced_response(train, rpm=900.0)
    assert response.temperature("ring") is None


def test_a_transient_tells_at_which_temperature_it_takes_a_damper():
    """It is that of the air, or its own; no note where nothing gives off heat."""
    air, own, none = (
        jaxhb.transient(built(damped(**keys)), seconds=0.05, speed=900.0).notes
        for keys in (
            {},
            {"temperature": 55.0},
            {"surface": None, "heat_transfer": None, "ambient": None}
            | {"temperature": 55.0},
        )
    )
    assert "ring stays at 40 deg C: the linear forced response" in " ".join(air)
    assert "ring stays at 55 deg C" in " ".join(own)
    assert "deg C" not in " ".join(none)


def test_traced_numbers_are_refused_with_what_to_do():
    train = built(damped())

    def heat(rpm):
        return jaxhb.heat_balance(train, rpm=rpm).power("ring")

    with pytest.raises(jaxhb.SceneError, match="found outside jit, vmap and grad"):
        jax.grad(heat)(900.0)


def test_a_temperature_that_is_not_found_is_told(monkeypatch):
    monkeypatch.setattr("jaxhb.linear.heat.AGREES", -1.0)
    with pytest.raises(jaxhb.SceneError) as caught:
        jaxhb.heat_balance(built(damped()), rpm=[400.0, 900.0])
    assert "the temperature of 'ring' is not found at 2 of 2 speeds, the first 400" in (
        str(caught.value)
    )


def test_the_command_tells_temperature_and_damping(tmp_path, capsys):
    path = tmp_path / "warm.toml"
    path.write_text(elements_text(damped(), name="warm", revolutions_per_cycle=1))
    record = tmp_path / "warm.json"
    command = ["forced", str(path), "--rpm", "150,900", "--json", str(record)]
    assert main(command) == 0
    text = capsys.readouterr().out
    expected = jaxhb.heat_balance(built(damped()), rpm=[150.0, 900.0])
    temperatures = expected.temperature("ring")
    ring = json.loads(record.read_text())["shafts"]["ring"]
    np.testing.assert_allclose(ring["temperature_deg_C"], temperatures, atol=FOUND)
    assert "Balance of heat: largest temperature over the speeds, and there" in text
    assert temperatures[0] > 150.0 > temperatures[1]
    assert "at 1 of 2 speeds its temperature lies outside over_temperature, 20 to" in (
        text
    )
    assert main([*command[:4], "--element", "ring"]) == 0
    last = capsys.readouterr().out.split("heat W")[1].splitlines()[2].split()
    damping = DAMPING * np.interp(temperatures[1], *np.transpose(LAW)[[0, 2]])
    assert float(last[-2]) == pytest.approx(damping, rel=1e-3)


def test_commands_without_a_balance_of_heat_tell_the_temperature(tmp_path, capsys):
    path = tmp_path / "warm.toml"
    path.write_text(elements_text(damped(), name="warm", revolutions_per_cycle=1))
    note = "ring stays at 40 deg C: the linear forced response"
    record = tmp_path / "warm.json"
    page = tmp_path / "warm.html"
    for command in (
        ["solve", "--rpm", "900", "--json", str(record)],
        ["sweep", "--rpm", "800,900"],
        ["report", "--rpm", "800,900", "--html", str(page)],
        ["modes"],
    ):
        assert main([command[0], str(path), *command[1:]]) == 0
        assert capsys.readouterr().out.count(note) == 1
    assert any(note in each for each in json.loads(record.read_text())["notes"])
    # Among the notes and beside the modes, but not beside the linear forced response
    assert page.read_text().count(note) == 2


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        (
            {"ambient": None},
            "surface and heat_transfer ask for a balance of heat, with",
        ),
        ({"over_temperature": ()}, "without over_temperature. Give all of these"),
        (
            {"stiffness": 1e4, "friction": 3.0},
            "friction is given together with surface, which only linear links have",
        ),
    ],
)
def test_each_fault_is_one_sentence(keys, expected):
    with pytest.raises(jaxhb.SceneError) as caught:
        built(damped(**keys))
    (sentence,) = caught.value.sentences
    assert expected in sentence
