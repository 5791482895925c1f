"""Limits of couplings, crankshafts and disks: numbers of a train of two equal disks by
its closed form.
"""

import dataclasses
import math

import numpy as np
import pytest

import jaxhb
from jaxhb import Damper, Disk, Load, Mesh, SceneError, Shaft, Torque
from jaxhb.linear.strength import LIMITS, Bounded
from jaxhb.report.text.strength import LIMITED, largest_shares, strength_text
from jaxhb.report.units import shown_in

OMEGA = 2.5  # rad/s
RPM = OMEGA * 30.0 / math.pi

COUPLING = Shaft(
    name="coupling",
    between=("a", "b"),
    stiffness=100.0,
    diameter=0.01,
    nominal_torque=5.0,
    vibratory_torque=4.0,
    maximum_torque=10.0,
    power_limit=1.0,
    speed_limit=20.0,
    fillet_factor=1.5,
    oil_bore_factor=1.8,
    alternating_limit=4e7,
)
DISKS = [
    Disk(
        name="a",
        inertia=2.0,
        angle_limit=20.0,
        speed_irregularity_limit=0.5,
        acceleration_limit=3.0,
    ),
    Disk(name="b", inertia=2.0),
]
LOADED = [
    Torque(disk="a", mean=4.0, harmonics=[(1.0, 10.0, 0.0)]),
    Load(disk="b"),
]

TWISTING = 10.0 / 2.0 / (100.0 - OMEGA**2) * 100.0
"""Torque in N m: T / 2 / (k - J omega^2 / 2) k of the motion against each other."""

ANGLE = 10.0 / (4.0 * OMEGA**2) - TWISTING / 100.0 / 2.0
"""Angle in rad of the first disk: T / (2 J omega^2) of both together, against half of
the twist.
"""

EXPECTED = {
    "heat": ("coupling", 0.0, 1.0),
    "mean_torques": ("coupling", 4.0, 5.0),
    "vibratory_torques": ("coupling", TWISTING, 4.0),
    "largest_torques": ("coupling", 4.0 + TWISTING, 10.0),
    "speeds": ("coupling", RPM, 20.0),
    "crank_stresses": ("coupling", 1.8 * 16 * TWISTING / (math.pi * 0.01**3), 4e7),
    "angles": ("a", ANGLE, math.radians(20.0)),
    "irregularities": ("a", 2.0 * ANGLE, 0.5),
    "accelerations": ("a", ANGLE * OMEGA**2, 3.0),
}


def built(parts):
    return jaxhb.build(parts, revolutions_per_cycle=1)


@pytest.fixture(scope="module")
def judged():
    train = built([*DISKS, COUPLING, *LOADED])
    return jaxhb.strength(jaxhb.forced_response(train, rpm=np.array([RPM])))


@pytest.mark.parametrize("kind", LIMITS)
def test_numbers_beside_limits_are_those_of_the_closed_form(judged, kind):
    name, value, limit = EXPECTED[kind]
    ((element, row),) = getattr(judged, kind).items()
    assert element == name
    # One order among 4096 samples: extremes between them are missed by 1e-6.
    np.testing.assert_allclose(row[0], value, rtol=2e-6, atol=1e-12)
    assert row[1] == pytest.approx(limit, rel=1e-12)


def test_every_kind_of_a_strength_is_told_with_its_share(judged):
    assert set(LIMITED) == {"stresses", "tooth_torques", *LIMITS}
    shares = {key: share.share for key, share in largest_shares({"": judged}).items()}
    for kind, (name, value, limit) in EXPECTED.items():
        share = value / limit
        assert shares[kind, name] == pytest.approx(share, rel=2e-6, abs=1e-12)
    text = "\n".join(str(part) for part in strength_text({"": judged}))
    assert f"{TWISTING:.3g}" in text
    assert "Mean torque of couplings, N m, beside" in text
    assert "out of reach of this program" in text


@pytest.mark.parametrize(
    ("units", "heads", "mean"),
    [
        ({}, ["kN m", "deg", "MPa", "%"], "40.00"),
        (
            {"N m": (1.0, "N m"), "rad": (1e3, "mrad"), "Pa": (1e-3, "kPa")},
            ["N m", "mrad", "kPa", "%"],
            "40000",
        ),
    ],
)
def test_titles_have_the_units_of_their_columns(units, heads, mean):
    """A load 10,000 times as large, in kN m unless another unit is chosen."""
    loads = [
        Torque(disk="a", mean=4e4, harmonics=[(1.0, 1e5, 0.0)]),
        Load(disk="b"),
    ]
    train = built([*DISKS, COUPLING, *loads])
    strength = jaxhb.strength(jaxhb.forced_response(train, rpm=np.array([RPM])))
    with shown_in(units):
        text = "\n".join(str(part) for part in strength_text({"": strength}))
    torque, angle, stress, share = heads
    for title in (
        f"Mean torque of couplings, {torque},",
        f"Vibratory torque of couplings, {torque}:",
        f"Largest torque of couplings, {torque},",
        f"Vibratory angle of disks, {angle}:",
        f"Alternating torsional stress of crankshafts, {stress}:",
        f"Cyclic irregularity of disks, {share}:",
    ):
        assert title in text
    assert mean in text


def test_the_speed_limit_is_that_of_the_own_rotor():
    parts = [
        Disk(name="motor", inertia=1.0),
        Disk(name="pinion", inertia=0.1, radius=0.1),
        Disk(name="wheel", inertia=1.0, radius=0.3),
        Shaft(between=("motor", "pinion"), stiffness=1e5),
        Mesh(between=("pinion", "wheel"), stiffness=1e8),
        Damper(
            name="ring",
            disk="wheel",
            inertia=0.1,
            damping=3.0,
            speed_limit=400.0,
            maximum_torque=2.0,
        ),
        Torque(disk="motor", harmonics=[(1.0, 5.0, 0.0)]),
    ]
    train = jaxhb.build(parts, reference="motor", revolutions_per_cycle=1)
    judged = jaxhb.strength(jaxhb.forced_response(train, rpm=np.array([900.0, 1500.0])))
    np.testing.assert_allclose(judged.speeds["ring"].value, [300.0, 500.0], rtol=1e-12)
    assert isinstance(judged.largest_torques["ring"], Bounded)
    changed = train.replace({"ring.speed_limit": 600.0})
    again = jaxhb.strength(jaxhb.forced_response(changed, rpm=900.0))
    assert again.speeds["ring"].limit == 600.0
    left = train.without("ring")
    assert not jaxhb.strength(jaxhb.forced_response(left, rpm=900.0))


def test_a_disk_keeps_its_limits_when_others_are_left_out():
    parts = [*DISKS, Disk(name="c", inertia=1.0, angle_limit=3.0), COUPLING, *LOADED]
    parts.append(Shaft(name="tail", between=("b", "c"), stiffness=50.0))
    train = built(parts).without("tail")
    judged = jaxhb.strength(jaxhb.forced_response(train, rpm=RPM))
    assert list(judged.angles) == ["a"]
    with pytest.raises(SceneError, match="the disk was built without angle_limit"):
        train.replace({"b.angle_limit": 2.0})


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"maximum_torque": 4.5}, "maximum_torque is 4.5 N m, less than nominal_torq"),
        ({"alternating_limit": None}, "are given without alternating_limit"),
        ({"fillet_factor": None, "oil_bore_factor": None}, "without fillet_factor or"),
        ({"diameter": None}, "alternating_limit is given without diameter"),
        ({"alternating_limit": 60.0}, "Give it in Pa: 60 MPa is 6e7"),
    ],
)
def test_limits_that_lack_something_are_refused_in_a_sentence(keys, sentence):
    with pytest.raises(SceneError, match=sentence):
        built([*DISKS, dataclasses.replace(COUPLING, **keys), *LOADED])
