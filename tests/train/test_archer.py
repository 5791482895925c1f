"""Archer's damping of propellers: values by hand, and a train with it against trains
whose disk has rows over the speed.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from differences import check_derivative
from tolerances import ALGEBRAIC, GRADIENT

import jaxhb
from jaxhb import Disk, Load, Mesh, SceneError, Shaft, Torque
from jaxhb.scene.workbook.writing import scene_workbook
from jaxhb.train.varying import archer_damping, at_speed

RATED = 400.0
FACTOR = 30.0
AT_RATED = FACTOR * 48000.0 / 100.0  # the gear makes 100 rpm of 400
LINE = ((0.0, 0.0), (RATED, AT_RATED))


def parts(*, rows=None, backlash=None, law="propeller"):
    """A ship with a gear of 4 to 1, with Archer's damping of its propeller or with
    ``rows`` of it over the speed.
    """
    archer = FACTOR if rows is None else None
    return [
        Disk(name="engine", inertia=800.0),
        Disk(name="pinion", inertia=20.0, radius=0.2),
        Disk(name="wheel", inertia=300.0, radius=0.8),
        Disk(name="screw", inertia=2000.0, damping_over_rpm=rows or ()),
        Shaft(between=("engine", "pinion"), stiffness=2e6, damping=100.0),
        Mesh(
            between=("pinion", "wheel"),
            name="teeth",
            stiffness=5e9,
            damping=1e6,
            backlash=backlash,
        ),
        Shaft(between=("wheel", "screw"), name="line", stiffness=8e6),
        Torque(
            disk="engine",
            mean=12000.0,
            harmonics=((1.0, 3000.0, 0.0), (3.0, 5000.0, 100.0)),
        ),
        Load(
            name="water",
            disk="screw",
            law=law,
            rated_torque=48000.0,
            rated_rpm=RATED,
            archer=archer,
        ),
    ]


def ship(**changes):
    return jaxhb.build(
        parts(**changes), reference="engine", revolutions_per_cycle=1, name="ship"
    )


def assert_close(actual, expected):
    scale = np.abs(expected).max()
    np.testing.assert_allclose(actual, expected, rtol=0, atol=ALGEBRAIC * scale)


@pytest.mark.parametrize(
    # M = 48 kN m at 100 rpm of the propeller: 3, 27 and 75 kN m at 25, 75 and 125 rpm
    "rpm, expected",
    [(100.0, 30 * 3e3 / 25), (300.0, 30 * 27e3 / 75), (500.0, 30 * 75e3 / 125)],
)
def test_the_damping_is_the_factor_times_the_torque_over_the_speed(rpm, expected):
    train = ship()
    damping = archer_damping(train, rpm)
    np.testing.assert_allclose(damping, [0.0, 0.0, 0.0, expected], rtol=ALGEBRAIC)
    fixed = at_speed(train, rpm)
    assert fixed.value("screw.damping") == pytest.approx(expected, rel=ALGEBRAIC)
    assert not fixed.topology.depends_on_speed


def test_forced_responses_are_those_of_rows_over_the_speed():
    speeds = [0.5 * RATED, 317.0, RATED]
    own = jaxhb.forced_response(ship(), rpm=speeds)
    # A line between two rows is the formula itself.
    expected = jaxhb.forced_response(ship(rows=LINE), rpm=speeds)
    assert_close(own.angles, expected.angles)
    assert_close(own.torques, expected.torques)
    # Without it the screw swings more.
    bare = jaxhb.forced_response(ship(rows=((0.0, 0.0), (1.0, 0.0))), rpm=speeds)
    assert np.abs(bare.angles - own.angles).max() > 0.1 * np.abs(own.angles).max()


def test_motions_with_backlash_are_those_of_rows_over_the_speed():
    own = jaxhb.solve(ship(backlash=2e-4), rpm=317.0)
    expected = jaxhb.solve(ship(backlash=2e-4, rows=LINE), rpm=317.0)
    assert int(own.status) == jaxhb.Status.CONVERGED
    assert_close(own.forces, expected.forces)


@pytest.mark.parametrize(
    "speed", [{"speed": [(0.0, 250.0), (1.0, 380.0)]}, {"speed": "free", "rpm": 250.0}]
)
def test_transients_are_those_of_rows_over_the_speed(speed):
    """At a given speed, and at a free one, whose mean the law alone brakes."""

    def history(rows=None):
        motion = jaxhb.transient(ship(rows=rows), seconds=1.0, **speed)
        return motion.rpm, motion.torque("wheel", "screw").values

    rpm, torque = history()
    twice_rated = ((0.0, 0.0), (2 * RATED, 2 * AT_RATED))
    expected_rpm, expected = history(twice_rated)
    assert_close(rpm, expected_rpm)
    # Sums of some 1e4 steps
    np.testing.assert_allclose(
        torque, expected, rtol=0, atol=1e-9 * np.abs(torque).max()
    )
    undamped_rpm, undamped = history(((0.0, 0.0), (1.0, 0.0)))
    assert_close(rpm, undamped_rpm)
    assert np.abs(torque - undamped).max() > 0.01 * np.abs(torque).max()


def test_derivatives_by_all_numbers_of_the_formula():
    train = ship()
    keys = ("water.archer", "water.rated_torque", "water.rated_rpm", "wheel.radius")

    def value(numbers):
        changed = train.replace(dict(zip(keys, numbers[:4], strict=True)))
        response = jaxhb.forced_response(changed, rpm=numbers[4])
        return jnp.stack([response.torques[1, 3].real, response.torques[1, 3].imag])

    check_derivative(value, [*(train.value(key) for key in keys), 317.0])


@pytest.mark.slow
def test_transients_have_derivatives_by_the_factor():
    train = ship()
    run_up = {"seconds": 0.3, "speed": [(0.0, 250.0), (0.3, 380.0)]}

    def value(factor):
        motion = jaxhb.transient(train.replace({"water.archer": factor}), **run_up)
        return jnp.sum(motion.torque("wheel", "screw").values ** 2)

    step = 0.01
    expected = (value(FACTOR + step) - value(FACTOR - step)) / (2 * step)
    assert jax.grad(value)(FACTOR) == pytest.approx(float(expected), rel=GRADIENT)


def test_it_is_changed_read_and_left_out():
    train = ship()
    changed = train.replace({"water.archer": 20.0})
    assert at_speed(changed, RATED).value("screw.damping") == pytest.approx(
        AT_RATED * 20 / 30
    )
    outside = r"archer is 12, must be at least 20 and at most 40. Archer's chart"
    with pytest.raises(SceneError, match=outside):
        train.replace({"water.archer": 12.0})
    for change in (train.value, lambda key: train.replace({key: 5.0})):
        with pytest.raises(SceneError, match="its damping depends on the speed, by"):
            change("screw.damping")
    bare = ship(rows=LINE)
    with pytest.raises(SceneError, match="nothing in the scene has archer"):
        bare.replace({"water.archer": 25.0})
    with pytest.raises(SceneError, match="the load was built without archer"):
        at_speed(train, RATED).replace({"water.archer": 25.0})
    with pytest.raises(SceneError, match=r"'water' has archer, which needs a speed"):
        jaxhb.natural_frequencies(train)
    rest = train.without("water")
    assert at_speed(rest, RATED).value("screw.damping") == 0.0


@pytest.mark.parametrize("suffix", ["toml", "xlsx"])
def test_it_is_written_and_read_again(suffix, tmp_path):
    path = tmp_path / "ship.toml"
    path.write_text(jaxhb.elements_text(parts(), reference="engine"))
    if suffix == "xlsx":
        content = scene_workbook(str(path))
        path = tmp_path / "ship.xlsx"
        path.write_bytes(content)
    again = jaxhb.load_scene(path)
    assert again.value("water.archer") == FACTOR
    assert again.topology.archer_disks == (3,)


def test_checks_tell_it_with_its_source(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = jaxhb.elements_text(parts(), reference="engine")
    (tmp_path / "ship.toml").write_text(text)
    printed = run("check ship.toml").out
    assert "screw: Archer's formula (Proc. IMechE 164, 1951), a = 30" in printed
    assert f"{RATED:g}  {AT_RATED:g}  N m s/rad" in printed
    printed = run("check ship.toml --set water.archer=25").out
    assert f"{RATED:g}  {AT_RATED * 25 / 30:g}  N m s/rad" in printed
