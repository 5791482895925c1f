"""Trains without some of their elements against trains that were built without them."""

import dataclasses

import numpy as np
import pytest

import jaxhb
from jaxhb import Cylinder, Damper, Disk, Ground, Load, Mesh, SceneError, Shaft, Torque

GAS = {"bore": 0.2, "stroke": 0.3, "rod": 0.6, "reciprocating_mass": 20.0}
TWO_STROKE = tuple(
    (float(a), 1e5 + 4e6 * max(0.0, np.cos(np.deg2rad(a))) ** 8)
    for a in range(-180, 181, 10)
)
BURNT = {
    "compression_ratio": 12.0,
    "charge_pressure": 2e5,
    "start": -5.0,
    "duration": 60.0,
    "imep": 1e6,
}


def engine(name, angle, gas):
    """An engine of two cylinders with a damper, its pinion behind a clutch."""
    a, b, fly, pinion = (
        f"{name} {part}" for part in ("throw 1", "throw 2", "flywheel", "pinion")
    )
    yield from (
        Disk(name=a, inertia=3.0, damping=2.0),
        Disk(name=b, inertia=3.5, damping=2.0),
    )
    yield from (
        Disk(name=fly, inertia=60.0),
        Disk(name=pinion, inertia=4.0, radius=0.2, teeth=20),
    )
    yield Shaft(between=(a, b), stiffness=4e6, damping=80.0)
    yield Shaft(between=(b, fly), stiffness=6e6, damping=90.0)
    yield Shaft(
        name=f"{name} clutch", between=(fly, pinion), stiffness=3e5, damping=500.0
    )
    yield Damper(
        name=f"{name} damper", disk=a, inertia=1.0, stiffness=8e4, damping=60.0
    )
    yield Mesh(
        name=f"{name} mesh",
        between=(pinion, "wheel"),
        stiffness=2e9,
        damping=3e4,
        transmission_error=((1.0, 1e-6, 0.0),) if name == "port" else (),
    )
    for k, disk in enumerate((a, b)):
        yield Cylinder(
            name=f"{name} {k + 1}",
            disk=disk,
            firing_angle=angle + 180.0 * k,
            **GAS,
            **gas,
        )


def plant(*, port=True, starboard=True, pto=True, blades=((4.0, 0.05, 0.02),)):
    """Two engines on one wheel, a propeller and a power take-off, of which some may be
    there.
    """
    yield from engine("port", 0.0, {"pressure": TWO_STROKE}) if port else ()
    yield Disk(name="wheel", inertia=40.0, radius=0.6, teeth=60)
    yield from (
        Disk(name="propeller", inertia=300.0),
        Shaft(between=("wheel", "propeller"), stiffness=2e6, damping=2e3),
    )
    yield Load(name="screw", disk="propeller", share=1.0, harmonics=blades)
    if pto:
        yield from (
            Disk(name="pto", inertia=5.0, radius=0.15, teeth=15),
            Disk(name="generator", inertia=8.0),
        )
        yield Mesh(
            name="pto mesh", between=("pto", "wheel"), stiffness=1e9, damping=1e4
        )
        yield Shaft(between=("pto", "generator"), stiffness=1e5, damping=30.0)
        yield Torque(
            name="consumers",
            disk="generator",
            mean=-500.0,
            harmonics=((3.0, 20.0, 5.0),),
            orders_of="reference",
        )
    yield from (
        engine(
            "starboard", 30.0, {"combustion": jaxhb.Combustion(**BURNT, stroke_cycle=2)}
        )
        if starboard
        else ()
    )
    yield Ground(disk="propeller", stiffness=1.0)


SCENARIOS = {
    "port alone": {"without": ["starboard clutch"], "wheel|propeller.damping": 1e3},
    "starboard, pto out": {"without": ["port clutch", "pto mesh"]},
    "zero pitch": {"screw.harmonics": [[4.0, 0.01, 0.0]], "port 2.fires": False},
}


def built(scenarios=None, **there):
    how = {"reference": "wheel", "revolutions_per_cycle": 1, "name": "plant"}
    return jaxhb.build([*plant(**there)], scenarios=scenarios, **how)


def assert_same_motion(found, wanted, rpm=(180.0, 420.0)):
    one, two = (
        jaxhb.forced_response(train, rpm=np.array(rpm)) for train in (found, wanted)
    )
    assert one.topology.disk_names == two.topology.disk_names
    assert one.topology.link_names == two.topology.link_names
    for name in two.topology.link_names:
        read = "force" if name in two.topology.mesh_names else "torque"
        a, b = (np.asarray(getattr(r, read)(name).coefficients) for r in (one, two))
        orders = min(
            a.shape[-1], b.shape[-1]
        )  # trains with other elements list other highest orders
        np.testing.assert_allclose(
            a[..., :orders], b[..., :orders], rtol=0, atol=1e-9 * np.abs(b).max()
        )
        assert not np.abs(a[..., orders:]).any()


def test_a_scenario_with_an_open_clutch_is_the_train_built_without_that_engine():
    train = built(SCENARIOS)
    # The pinion stays on the wheel: only what is behind the clutch goes.
    alone = [
        e
        for e in plant()
        if not str(getattr(e, "name", "")).startswith("starboard")
        or "pinion" in str(e.name)
    ]
    alone = [
        e
        for e in alone
        if not any(
            "starboard" in end
            for end in (*getattr(e, "between", ()), getattr(e, "disk", ""))
        )
    ]
    alone.append(next(e for e in plant() if getattr(e, "name", "") == "starboard mesh"))
    alone = [
        (
            dataclasses.replace(e, damping=1e3)
            if getattr(e, "between", ()) == ("wheel", "propeller")
            else e
        )
        for e in alone
    ]
    hand = jaxhb.build(alone, reference="wheel", revolutions_per_cycle=1, name="plant")
    assert_same_motion(train.scenario("port alone"), hand)


def test_what_hangs_on_a_disk_goes_with_it_and_what_it_joined():
    train = built(SCENARIOS)
    assert_same_motion(
        train.without("port pinion", "pto"), built(port=False, pto=False)
    )
    assert_same_motion(train.without("starboard mesh"), built(starboard=False))


def test_a_scenario_switches_cylinders_and_the_pulsation_of_a_load():
    found = built(SCENARIOS).scenario("zero pitch")
    assert_same_motion(found, built(blades=((4.0, 0.01, 0.0),)).misfire("port 2"))
    assert found.topology.cylinder_fires == (True, False, True, True)


def test_numbers_of_what_stays_are_those_of_the_train_changed_before():
    changed = built().replace(
        {"starboard 1.combustion.imep": 8e5, "starboard damper.damping": 30.0}
    )
    found = changed.without("port mesh")
    assert found.value("starboard 1.combustion.imep") == 8e5
    assert found.value("starboard damper.damping") == 30.0
    wanted = built(port=False).replace(
        {"starboard 1.combustion.imep": 8e5, "starboard damper.damping": 30.0}
    )
    assert_same_motion(found, wanted)


def test_what_cannot_be_left_out_is_said_in_a_sentence():
    train = built()
    with pytest.raises(
        SceneError,
        match="there is no element 'port cluch'. Did you mean 'port clutch'?",
    ):
        train.without("port cluch")
    with pytest.raises(
        SceneError, match="'wheel' is the reference disk, to which the speed belongs"
    ):
        train.without("wheel")
    wrong = {
        "a": {"without": ["prt clutch"]},
        "b": {"port 1.fires": "no"},
        "c": {"screw.harmonics": [[3.0, 0.1, 0.0]]},
    }
    with pytest.raises(SceneError) as told:
        built(wrong)
    assert [s.split(": ", 1)[1] for s in told.value.sentences] == [
        "without: there is no element 'prt clutch'. Did you mean 'port clutch'?",
        "'port 1': fires is 'no', must be true or false.",
        "screw.harmonics has other orders than the scene, must have 4, in this order.",
    ]
