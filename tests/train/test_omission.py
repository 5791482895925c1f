"""Trains without some of their elements against trains that were built without them."""

import dataclasses

import numpy as np
import pytest

import jaxhb
from jaxhb import Cylinder, Damper, Disk, Ground, Load, Mesh, SceneError, Shaft, Torque

TWO_STROKE = tuple(
    (float(a), 1e5 + 4e6 * max(0.0, np.cos(np.deg2rad(a))) ** 8)
    for a in range(-180, 181, 10)
)
COMBUSTION = jaxhb.Combustion(
    compression_ratio=12.0,
    charge_pressure=2e5,
    start=-5.0,
    duration=60.0,
    imep=1e6,
    stroke_cycle=2,
)


def engine(name, angle, *, pressure=None, combustion=None):
    """An engine of two cylinders with a damper, its pinion behind a clutch."""
    a = f"{name} throw 1"
    b = f"{name} throw 2"
    flywheel = f"{name} flywheel"
    pinion = f"{name} pinion"
    yield Disk(name=a, inertia=3.0, damping=2.0)
    yield Disk(name=b, inertia=3.5, damping=2.0)
    yield Disk(name=flywheel, inertia=60.0)
    yield Disk(name=pinion, inertia=4.0, radius=0.2, teeth=20)
    yield Shaft(between=(a, b), stiffness=4e6, damping=80.0)
    yield Shaft(between=(b, flywheel), stiffness=6e6, damping=90.0)
    yield Shaft(
        name=f"{name} clutch", between=(flywheel, pinion), stiffness=3e5, damping=500.0
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
            bore=0.2,
            stroke=0.3,
            rod=0.6,
            reciprocating_mass=20.0,
            pressure=pressure,
            combustion=combustion,
        )


def plant(*, port=True, starboard=True, pto=True, blades=((4.0, 0.05, 0.02),)):
    """Two engines on one wheel, a propeller and a power take-off, of which some may be
    there.
    """
    if port:
        yield from engine("port", 0.0, pressure=TWO_STROKE)
    yield Disk(name="wheel", inertia=40.0, radius=0.6, teeth=60)
    yield Disk(name="propeller", inertia=300.0)
    yield Shaft(between=("wheel", "propeller"), stiffness=2e6, damping=2e3)
    yield Load(name="screw", disk="propeller", share=1.0, harmonics=blades)
    if pto:
        yield Disk(name="pto", inertia=5.0, radius=0.15, teeth=15)
        yield Disk(name="generator", inertia=8.0)
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
    if starboard:
        yield from engine("starboard", 30.0, combustion=COMBUSTION)
    yield Ground(disk="propeller", stiffness=1.0)


SCENARIOS = {
    "port alone": {"without": ["starboard clutch"], "wheel|propeller.damping": 1e3},
    "starboard, pto out": {"without": ["port clutch", "pto mesh"]},
    "zero pitch": {"screw.harmonics": [[4.0, 0.01, 0.0]], "port 2.fires": False},
}


def assembled(parts, scenarios=None):
    return jaxhb.build(
        list(parts),
        scenarios=scenarios,
        reference="wheel",
        revolutions_per_cycle=1,
        name="plant",
    )


def built(scenarios=None, **parts):
    """The plant as a train."""
    return assembled(plant(**parts), scenarios)


def assert_same_motion(train, expected, rpm=(180.0, 420.0)):
    response = jaxhb.forced_response(train, rpm=np.array(rpm))
    exact = jaxhb.forced_response(expected, rpm=np.array(rpm))
    assert response.topology.disk_names == exact.topology.disk_names
    assert response.topology.link_names == exact.topology.link_names
    for name in exact.topology.link_names:
        signal = "force" if name in exact.topology.mesh_names else "torque"
        a = np.asarray(getattr(response, signal)(name).coefficients)
        b = np.asarray(getattr(exact, signal)(name).coefficients)
        # Trains with other elements list other highest orders.
        orders = min(a.shape[-1], b.shape[-1])
        np.testing.assert_allclose(
            a[..., :orders], b[..., :orders], rtol=0, atol=1e-9 * np.abs(b).max()
        )
        assert not np.abs(a[..., orders:]).any()


@pytest.mark.slow
def test_a_scenario_with_an_open_clutch_is_the_train_built_without_that_engine():
    train = built(SCENARIOS)

    def stays(element):
        """Whether an element is no starboard one: the pinion stays on the wheel, as
        only what is behind the clutch goes.
        """
        name = str(getattr(element, "name", ""))
        ends = (*getattr(element, "between", ()), getattr(element, "disk", ""))
        if any("starboard" in end for end in ends):
            return False
        return not name.startswith("starboard") or "pinion" in name

    def changed(element):
        if getattr(element, "between", ()) == ("wheel", "propeller"):
            return dataclasses.replace(element, damping=1e3)
        return element

    elements = list(plant())
    alone = [element for element in elements if stays(element)]
    meshes = (e for e in elements if getattr(e, "name", "") == "starboard mesh")
    alone.append(next(meshes))
    by_hand = assembled(changed(element) for element in alone)
    assert_same_motion(train.scenario("port alone"), by_hand)


@pytest.mark.slow
def test_what_hangs_on_a_disk_goes_with_it_and_what_it_joined():
    train = built(SCENARIOS)
    assert_same_motion(
        train.without("port pinion", "pto"), built(port=False, pto=False)
    )
    assert_same_motion(train.without("starboard mesh"), built(starboard=False))


@pytest.mark.slow
def test_a_scenario_switches_cylinders_and_the_pulsation_of_a_load():
    train = built(SCENARIOS).scenario("zero pitch")
    assert_same_motion(train, built(blades=((4.0, 0.01, 0.0),)).misfire("port 2"))
    assert train.topology.cylinders.fires == (True, False, True, True)


@pytest.mark.slow
def test_numbers_of_what_stays_are_those_of_the_train_changed_before():
    changes = {"starboard 1.combustion.imep": 8e5, "starboard damper.damping": 30.0}
    changed = built().replace(changes)
    train = changed.without("port mesh")
    assert train.value("starboard 1.combustion.imep") == 8e5
    assert train.value("starboard damper.damping") == 30.0
    assert_same_motion(train, built(port=False).replace(changes))


def test_what_cannot_be_left_out_is_said_in_a_sentence():
    train = built()
    sentence = "there is no element 'port cluch'. Did you mean 'port clutch'?"
    with pytest.raises(SceneError, match=sentence):
        train.without("port cluch")
    sentence = "'wheel' is the reference disk, to which the speed belongs"
    with pytest.raises(SceneError, match=sentence):
        train.without("wheel")
    wrong = {
        "a": {"without": ["prt clutch"]},
        "b": {"port 1.fires": "no"},
        "c": {"screw.harmonics": [[3.0, 0.1, 0.0]]},
    }
    with pytest.raises(SceneError) as caught:
        built(wrong)
    faults = [sentence.split(": ", 1)[1] for sentence in caught.value.sentences]
    assert faults == [
        "without: there is no element 'prt clutch'. Did you mean 'port clutch'?",
        "'port 1': fires is 'no', must be true or false.",
        "screw.harmonics has other orders than the scene, must have 4, in this order.",
    ]
