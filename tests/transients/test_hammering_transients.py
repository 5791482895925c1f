"""Transients of trains whose teeth hammer, against equations written anew."""

import numpy as np
import pytest
from transient_twins import Ramps, Twin, worst_difference

import jaxhb
from jaxhb import Damper, Disk, Ground, Mesh, Shaft, Torque

SPEED = Ramps(((0.0, 550.0), (0.25, 700.0)))
TEETH = ("gear a", "gear b")


def hammering_parts(damping_law="contact"):
    """Two shafts on gears that hammer at 600 rpm."""
    return [
        Disk(name="flywheel", inertia=2.0, damping=0.5),
        Disk(name="gear a", inertia=0.01, radius=0.05),
        Disk(name="gear b", inertia=0.03, radius=0.1),
        Disk(name="driven", inertia=0.1, damping=1.0),
        Shaft(between=("flywheel", "gear a"), stiffness=2e4, damping=5.0),
        Shaft(between=("gear b", "driven"), stiffness=1e4, damping=4.0),
        Mesh(
            between=TEETH,
            stiffness=1e8,
            damping=1500.0,
            damping_law=damping_law,
            backlash=1e-4,
            epsilon=1e-3,
            transition=0.1,
        ),
        Damper(name="ring", disk="flywheel", inertia=0.2, damping=20.0),
        Torque(
            disk="flywheel",
            mean=20.0,
            harmonics=[(1.0, 50.0, -20.0), (2.0, 10.0, 60.0), (3.0, 0.0, 40.0)],
        ),
        Torque(disk="driven", mean=-40.0, harmonics=[(1.0, 60.0, 10.0)]),
        Ground(disk="driven", stiffness=10.0),
    ]


def built(parts):
    return jaxhb.build(parts, revolutions_per_cycle=1, reference="flywheel")


def run_up(train, **options):
    return jaxhb.transient(
        train, seconds=0.25, speed=SPEED.rows, start="rest", **options
    )


@pytest.mark.slow
@pytest.mark.parametrize("damping_law", ["contact", "always"])
def test_hammering_teeth_move_as_their_twin(damping_law):
    parts = hammering_parts(damping_law)
    train = built(parts)
    usual = run_up(train)
    contact = usual.mesh(*TEETH)
    assert contact.impacts >= 1
    assert contact.separated > 0.004
    twin = Twin(parts, "flywheel")
    errors = []
    for refine in (1, 4):
        found = run_up(train, refine=refine)
        places = np.linspace(0, len(found.time) - 1, 400).astype(int)
        moved = twin.integrate(0.25, SPEED, found.time[places])
        errors.append(worst_difference(twin, moved, found, places))
    # Eight steps in a period of the teeth: a step that meets a flank errs by 1 %, and
    # is of third order, as the law has a kink in its slope.
    assert errors[0] < 1e-2
    assert errors[1] < errors[0] / 4**2.5


def test_a_constant_speed_keeps_the_steady_motion():
    """Teeth part at 600 rpm; the harmonic solution and the steps err by 0.2 % each."""
    train = built(hammering_parts())
    steady = jaxhb.steady_state(train, rpm=600.0)
    assert steady.kind == "periodic"
    stays = jaxhb.transient(train, seconds=1.0, speed=600.0, start=steady)
    last = stays.force(*TEETH).between(0.9, 1.0)
    force = steady.force(*TEETH)
    assert float(last.max) == pytest.approx(float(force.max), rel=5e-3)
    swing = float(force.max - force.min)
    assert float(last.min) == pytest.approx(float(force.min), abs=5e-3 * swing)


@pytest.mark.slow
@pytest.mark.parametrize("rpm, kind", [(600.0, "contact"), (2255.0, "periodic")])
def test_gear_train_30_keeps_its_steady_motion(rpm, kind):
    train = jaxhb.load_scene("gear_train_30")
    steady = jaxhb.steady_state(train, rpm=rpm)
    assert steady.kind == kind
    cycle = 120.0 / rpm
    stays = jaxhb.transient(train, seconds=8 * cycle, speed=rpm, start=steady)
    names = train.topology.disk_names
    # Where teeth part, both solutions err by some tenths of a percent.
    close = 1e-5 if kind == "contact" else 5e-3
    for a, b in train.topology.mesh_ends:
        last = stays.force(names[a], names[b]).between(7 * cycle, 8 * cycle)
        force = steady.force(names[a], names[b])
        size = float(force.max - force.min)
        assert float(last.max) == pytest.approx(float(force.max), abs=close * size)
        assert float(last.min) == pytest.approx(float(force.min), abs=close * size)


@pytest.mark.slow
def test_a_subharmonic_motion_goes_on_with_its_period():
    pair = jaxhb.load_scene("spur_pair").replace({"gear a|gear b.damping": 31.8})
    steady = jaxhb.steady_state(pair, rpm=6000.0, cycles=None)
    assert (steady.kind, steady.period) == ("subharmonic", 2)
    cycle = pair.topology.revolutions_per_cycle * 60 / 6000.0
    stays = jaxhb.transient(pair, seconds=40 * cycle, speed=6000.0, start=steady)
    force = stays.force(*TEETH)
    time = np.linspace(37 * cycle, 38 * cycle, 200)
    size = float(steady.force(*TEETH).max - steady.force(*TEETH).min)
    once = force.at(time + cycle) - force.at(time)
    twice = force.at(time + 2 * cycle) - force.at(time)
    # Every second cycle is the same one, and the one between is another.
    assert np.abs(once).max() > 0.05 * size
    assert np.abs(twice).max() < 0.01 * size
    last = force.between(38 * cycle, 40 * cycle)
    assert float(last.max) == pytest.approx(
        float(steady.force(*TEETH).max), abs=5e-3 * size
    )


def test_contact_says_how_long_and_how_hard_teeth_part():
    """Counted from the deflections of the record."""
    train = built(hammering_parts())
    found = run_up(train, refine=2)
    contact = found.mesh(*TEETH)
    deflection = found.deflection(*TEETH).values
    gap = 1e-4 * (1 - 0.1) / 2
    steps = np.diff(found.time)
    apart = np.abs(deflection) < gap
    assert contact.separated == pytest.approx(steps[apart[1:]].sum())
    assert contact.impacts == np.count_nonzero(apart[:-1] & ~apart[1:])
    assert contact.drive_side == 1
    assert "separation" in contact.troubles
    slope = np.gradient(deflection, found.time)[1:][apart[:-1] & ~apart[1:]]
    # Differences over two steps of an eighth of a period of the teeth
    assert contact.hardest_impact == pytest.approx(np.abs(slope).max(), rel=0.2)
