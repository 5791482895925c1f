"""Contact of teeth over a cycle, for a deflection ``m + A cos(Omega t)`` with known
crossings.
"""

import numpy as np
import pytest
from tolerances import ALGEBRAIC

from jaxhb.equations.backlash import Law
from jaxhb.results.contact import contact_of

LAW = Law(stiffness=2e8, epsilon=1e-3, transition=0.04, backlash=1e-4)
GAP = 0.96 * 0.5e-4
KNEE = 1.04 * 0.5e-4
AMPLITUDE = 1.5e-4
FREQUENCY = 50.0

FRACTION = 1e-6
"""Error, in cycles, of a crossing interpolated linearly between 4096 time samples:
(2 pi / 4096)^2 / 8.
"""


def contact(mean=0.0, *, drive=1.0, viscous=0.0):
    """Contact of LAW in the motion ``mean + AMPLITUDE cos(FREQUENCY t)``."""
    deflection = np.array([mean, AMPLITUDE / 2, 0.0]) + 0j
    elastic = np.zeros(33, complex)
    elastic[0] = drive
    force = elastic.copy()
    force[1] += viscous * 1j * FREQUENCY * deflection[1]
    return contact_of(LAW, deflection, force, elastic, FREQUENCY, 512)


def test_fractions_of_a_symmetric_motion_are_those_of_the_arc_sine():
    teeth = contact()
    assert teeth.separated_fraction == pytest.approx(
        2 / np.pi * np.arcsin(GAP / AMPLITUDE), abs=FRACTION
    )
    assert teeth.reverse_contact_fraction == pytest.approx(
        np.arccos(GAP / AMPLITUDE) / np.pi, abs=FRACTION
    )


def test_reverse_contact_is_on_the_flank_that_does_not_drive():
    mean = 0.7e-4
    ahead = np.arccos((GAP - mean) / AMPLITUDE) / np.pi
    behind = np.arccos((GAP + mean) / AMPLITUDE) / np.pi
    driven = contact(mean, drive=5.0)
    braked = contact(mean, drive=-5.0)
    assert driven.drive_side == 1
    assert braked.drive_side == -1
    assert driven.reverse_contact_fraction == pytest.approx(behind, abs=FRACTION)
    assert braked.reverse_contact_fraction == pytest.approx(ahead, abs=FRACTION)
    assert driven.separated_fraction == pytest.approx(1 - ahead - behind, abs=FRACTION)


def test_every_entry_into_contact_is_an_impact_with_its_speed_and_side():
    impacts = contact().impacts
    angle = np.arccos(GAP / AMPLITUDE) / (2 * np.pi)
    assert [hit["side"] for hit in impacts] == [-1, 1]
    # The wave falls from its crest: it meets the other flank half a cycle after it left
    # the mirror image of this flank.
    assert [hit["cycle"] for hit in impacts] == pytest.approx(
        [0.5 - angle, 1 - angle], abs=FRACTION
    )
    speed = FREQUENCY * np.sqrt(AMPLITUDE**2 - GAP**2)
    assert [hit["speed"] for hit in impacts] == pytest.approx([speed, speed], rel=1e-5)


def test_forces_at_the_ends_of_the_smooth_zone():
    teeth = contact(3e-4)  # on one flank
    assert teeth.separated_fraction == 0.0
    assert teeth.reverse_contact_fraction == 0.0
    assert teeth.impacts == []
    assert teeth.gap_spring_force == pytest.approx(1e-3 * 2e8 * 1e-4 / 2, rel=ALGEBRAIC)
    knee = 1e-3 * 2e8 * KNEE + 2e8 * (1 - 1e-3) * 0.04 * 1e-4 / 2
    assert teeth.knee_force == pytest.approx(knee, rel=ALGEBRAIC)


def test_force_of_the_damper_in_the_gap_is_largest_where_the_gap_is_crossed_fastest():
    assert contact(viscous=1000.0).pulling_force == pytest.approx(
        1000.0 * FREQUENCY * AMPLITUDE, rel=1e-5
    )
    assert contact().pulling_force == 0.0


def test_contact_is_read_speed_by_speed():
    with pytest.raises(ValueError, match="speed by speed"):
        contact_of(LAW, np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)), 1.0, 64)
