"""Batches in modal form against the dense integration of one speed, and records against
the cycles that they reduce.
"""

import dataclasses

import jax
import numpy as np
import pytest
import trains
from compiling import executables
from integrated_trains import pair

from jaxhb import Disk, Mesh, Shaft
from jaxhb.integration import batch as marching, cycles as recording
from jaxhb.integration.reference import _discretize, _march
from jaxhb.steady.marching import Batch, Equations
from jaxhb.train.excitation import excitation, listed_harmonic

STEPS = 4096


def dense(equations, batch, place, cycles):
    """Deflections ``(G, steps)`` of the last cycle by the dense stepper, from where its
    march begins.
    """
    linear_motion = batch.linear_motion
    train = equations.train
    rpm = float(batch.marches[place].rpm)
    system = equations.system
    meshes = equations.meshes
    torque, *_ = excitation(train, rpm, listed_harmonic(train.topology))
    load = np.asarray(torque) / np.asarray(system.radius)[:, None]
    frequency = float(linear_motion.frequency[place])
    stepper = _discretize(
        system, meshes, frequency, load, steps=STEPS, parts=equations.parts
    )
    motion = batch.motion(batch.marches[place])
    state = stepper.space.coordinates @ motion - stepper.linear_state
    _, trace, *_ = _march(stepper, state, tolerance=-1.0, max_cycles=cycles)
    return np.asarray(trace.deflection)


def pushed(equations, rpm):
    """A push on a start, ``(2S,)``: speeds in m/s."""
    kick = np.random.default_rng(int(rpm)).normal(size=len(equations.system.mass))
    return np.concatenate([0 * kick, np.where(equations.system.mass > 0, kick, 0.0)])


def gearbox():
    """A closed loop, massless disks with and without damping, rings with and without
    spring, free rotation; a gap.
    """
    parts = trains.gearbox_parts(grounded=False)
    parts = [
        part for part in parts if getattr(part, "between", None) != ("lay 3", "output")
    ]

    def changed(part):
        if part.name == "lay 3":
            part = dataclasses.replace(part, inertia=0.001)
        if getattr(part, "loss_factor", 0):
            part = dataclasses.replace(part, loss_factor=0.0)
        return part

    mesh = Mesh(
        between=("lay 3", "output"),
        stiffness=1.5e8,
        damping=300.0,
        backlash=1e-4,
        epsilon=1e-3,
        transition=0.04,
    )
    parts = [changed(part) for part in parts]
    return trains.build([*parts, mesh], cycle=1, reference="motor")


CASES = {
    "pair": lambda: pair(
        ground=False,
        extra=(
            Disk(name="cap", inertia=0.0),
            Shaft(between=("cap", "driven"), stiffness=1e4),
        ),
    ),
    "gearbox": gearbox,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("count", [1, 16])
def test_a_batch_marches_as_the_dense_integration_does(name, count):
    equations = Equations(CASES[name]())
    batch = Batch(equations, np.linspace(600.0, 900.0, count), STEPS)
    for place, march in enumerate(batch.marches):  # pushed so that the teeth part
        batch.begin(place, batch.motion(march) + pushed(equations, march.rpm))
    expected = [dense(equations, batch, place, 8) for place in (0, count - 1)]
    if count > 1:
        batch.run(batch.marches)
    else:
        batch._run(batch.marches, 1, False, 8)
    for place, exact in zip((0, count - 1), expected, strict=True):
        deflections = np.split(batch.marches[place].trace, 2)[0]
        gap = equations.meshes.law.backlash.max()
        cycles = np.array(batch.marches[place].closure.cycles)
        seen = np.split(cycles, 2, axis=2)[0]
        assert (np.abs(seen) < equations.meshes.law.gap).any()
        # The same scheme in other coordinates: rounding, grown by hammering over eight
        # cycles, and the soft spring on a rotation that the push has carried a thousand
        # gaps away.
        np.testing.assert_allclose(deflections, exact, atol=1e-7 * gap, rtol=0)


def test_any_number_of_cycles_is_one_program_and_the_same_motion():
    """Bit for bit, recorded or not, as a march that stops between is that of one
    call.
    """
    equations = Equations(CASES["pair"]())

    def marched(parts, recorded):
        batch = Batch(equations, np.array([700.0]), 512)
        (march,) = batch.marches
        batch.begin(0, batch.motion(march) + pushed(equations, 700.0))
        for cycles in parts:
            batch.run([march], recorded, cycles)
        return march

    for recorded in (False, True):
        whole = marched((8,), recorded)
        programs = executables(recording.march)
        parted = marched((3, 1, 4), recorded)
        assert executables(recording.march) == programs
        assert parted.cycles == whole.cycles == 8
        assert np.array_equal(parted.state, whole.state)
        assert np.array_equal(parted.trace, whole.trace)
        assert np.array_equal(parted.closure.cycles, whole.closure.cycles)

    assert parted.recorded == whole.recorded == 8
    equal = jax.tree.map(np.array_equal, parted.numbers, whole.numbers)
    assert all(jax.tree.leaves(equal))
    np.testing.assert_allclose(parted.power, whole.power, rtol=1e-12)


def test_modes_hold_the_motion_of_every_disk():
    equations = Equations(gearbox())
    batch = Batch(equations, np.array([700.0]), STEPS)
    modes = equations.modes
    linear = batch.linear_motion
    motion = batch.motion(batch.marches[0])
    state = marching.state_of(modes, motion[None], linear)
    again = marching.motion_of(modes, state, linear)[0]
    before = equations.system.deflections(np.split(motion, 2)[0])
    after = equations.system.deflections(np.split(again, 2)[0])
    np.testing.assert_allclose(before, after, atol=1e-9 * np.abs(before).max())
