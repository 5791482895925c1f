"""Contributions of cylinders to a linear response, against responses to one alone."""

import numpy as np
import pytest

import jaxhb
from jaxhb.elements.sentences import SceneError

SPEEDS = [1200.0, 1900.0]


def read(response):
    return response.torque("cyl6", "flywheel")


def complex_of(signal):
    return np.asarray(signal.amplitudes) * np.exp(
        1j * np.deg2rad(np.asarray(signal.phases_deg))
    )


def test_a_cylinder_adds_the_response_to_itself_alone():
    """All others have neither gas nor mass there; together they are the whole."""
    train = jaxhb.load_scene("six_cylinder_diesel")
    added = jaxhb.cylinder_contributions(train, read, rpm=SPEEDS)
    count = added.total.shape[-1]
    for i, name in ((0, "cylinder 1"), (3, "cylinder 4")):
        others = [other for other in added.cylinders if other != name]
        changes = {f"{other}.gas_factor": 0.0 for other in others}
        changes |= {f"{other}.reciprocating_mass": 0.0 for other in others}
        alone = complex_of(
            read(
                jaxhb.forced_response(
                    train.replace(changes), rpm=SPEEDS, harmonics=count
                )
            )
        )
        # A difference of responses that are some ten times as large
        scale = np.abs(added.total).max()
        np.testing.assert_allclose(added.parts[i], alone, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(
        added.parts.sum(axis=0), added.total, rtol=0, atol=1e-11 * scale
    )
    place = list(added.orders).index(3.0)
    np.testing.assert_allclose(added.shares()[:, :, place].sum(axis=0), 1.0, rtol=1e-9)


def test_cylinders_add_up_to_the_response_of_a_damper_that_grows_warm():
    """At each speed another temperature, with rows that the hotter of them leaves."""
    engine = [
        jaxhb.Disk(name="crank", inertia=2.0),
        jaxhb.Damper(
            name="ring",
            disk="crank",
            inertia=0.5,
            damping=80.0,
            over_temperature=[(20.0, 1.0, 1.0), (90.0, 1.0, 0.4)],
            surface=0.05,
            heat_transfer=25.0,
            ambient=40.0,
        ),
        *[
            jaxhb.Cylinder(
                name=f"cylinder {i}",
                disk="crank",
                bore=0.1,
                stroke=0.1,
                rod=0.2,
                reciprocating_mass=1.5,
                firing_angle=angle,
                gas_torque_mean=50.0,
                gas_torque=[(1.0, 1500.0, -500.0), (2.0, 500.0, 250.0)],
            )
            for i, angle in ((1, 0.0), (2, 180.0))
        ],
        jaxhb.Load(disk="crank"),
    ]
    train = jaxhb.build(engine)

    def ring(response):
        return response.torque("ring")

    whole = jaxhb.heat_balance(train, rpm=SPEEDS)
    temperatures = np.asarray(whole.temperature("ring"))
    assert temperatures.min() < 90 - 5 and temperatures.max() > 90 + 5, temperatures
    added = jaxhb.cylinder_contributions(train, ring, rpm=SPEEDS)
    expected = complex_of(ring(whole))
    # Differences of responses of that size; temperatures are found to 1e-3 K.
    scale = np.abs(expected).max()
    np.testing.assert_allclose(added.total, expected, rtol=0, atol=1e-6 * scale)
    np.testing.assert_allclose(
        added.parts.sum(axis=0), expected, rtol=0, atol=1e-6 * scale
    )


def test_what_does_not_add_up_or_has_no_cylinder_is_refused():
    with pytest.raises(SceneError, match="there is no cylinder"):
        jaxhb.cylinder_contributions(jaxhb.load_scene("spur_pair"), read, rpm=SPEEDS)


def test_the_command_tells_them_at_the_largest_vibration(run):
    completed = run(
        'forced six_cylinder_diesel --rpm 1200,1900 --element "cyl6|flywheel"'
        " --by-cylinder",
        "json",
    )
    completed.check_printed("forced_by_cylinder")
    record = completed.json["by_cylinder"]["cyl6|flywheel"]
    train = jaxhb.load_scene("six_cylinder_diesel")
    added = jaxhb.cylinder_contributions(train, read, rpm=[record["rpm"]])
    np.testing.assert_allclose(
        record["cylinders"]["cylinder 2"]["amplitude"],
        np.abs(added.parts[1, 0]),
        rtol=0,
        atol=1e-12 * np.abs(added.total).max(),
    )
