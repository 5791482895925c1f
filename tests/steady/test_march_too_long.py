"""A march is counted before it begins: what would take too many steps is not marched,
and told.
"""

import time

import numpy as np
import pytest
from reference_data import DATA

import jaxhb
from jaxhb.integration.reference import integrate
from jaxhb.steady.marching import MEMORY, MOST_STEPS, Equations
from jaxhb.train.speeds import read_range, read_speeds


def test_a_cycle_of_too_many_steps_is_told_within_seconds_and_not_marched():
    """Light gears on stiff teeth: 5e8 steps a cycle, 16 GiB of samples."""
    train = jaxhb.load_scene(DATA / "scenes" / "march_too_long.toml")
    begin = time.process_time()
    state = jaxhb.steady_state(train, rpm=0.392)
    assert time.process_time() - begin < 10
    assert state.kind == "unknown"
    assert "5.37e+08 steps a cycle" in state.notes[0]
    assert "ask for a higher speed" in state.notes[0]
    with pytest.raises(ValueError, match=r"steps a cycle .* ask for a higher speed"):
        integrate(train, rpm=0.392)


@pytest.mark.slow
def test_teeth_in_contact_are_solved_where_their_march_would_be_too_long():
    """Far below the resonances tooth forces follow from the torques and inertias alone,
    whatever the law.
    """
    train = jaxhb.load_scene("first_scene")
    state = jaxhb.steady_state(train, rpm=0.5)
    linear = jaxhb.linear_response(train, rpm=0.5)
    force = state.force("crank gear", "pump gear")
    rigid = linear.force("crank gear", "pump gear")
    assert state.known
    assert state.stability.stable
    assert "other motions were not looked for" in state.notes[0]
    actual, expected = (
        [float(f.mean), float(f.max), float(f.min)] for f in (force, rigid)
    )
    assert actual == pytest.approx(expected, rel=2e-3)


def test_ranges_of_too_many_values_are_refused_before_they_are_made():
    for reader, text in (
        (read_speeds, "600:2400:2000000000"),
        (read_range, "ring.damping=1:2:2000000000"),
    ):
        with pytest.raises(ValueError, match="100000"):
            reader(text)


def test_the_memory_of_every_march_stays_below_a_gigabyte():
    """``_bytes_of_step`` is what the arrays of a recorded cycle take; a march of more
    is refused at any speed.
    """
    for scene in jaxhb.scene_names():
        equations = Equations(jaxhb.load_scene(scene))
        if not len(equations.own):
            continue
        speeds = np.geomspace(1e-3, 3000, 40)
        marched = [
            equations.steps(rpm) for rpm in speeds if not equations.too_long(rpm)
        ]
        assert marched
        assert max(marched) <= MOST_STEPS
        assert max(marched) * equations._bytes_of_step <= MEMORY < 2**30
        assert equations.too_long(1e-3)
