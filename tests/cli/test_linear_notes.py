"""Linear commands on a clutch disc of two stages: which stage they take, and what they
say of it.
"""

import re

import pytest
from reference_data import DATA

RATTLE = DATA / "scenes" / "idle_rattle.toml"
DRAG = '--set "counter gear:torque.mean=-40"'
"""Torque under which the mean angle lies in the second stage."""
HZ = 55.36
"""The first natural frequency there; of the first stage it is 10.1 Hz."""


@pytest.fixture
def under_drag(run):
    """The JSON of a command whose notes name the stage."""

    def record_of(line):
        command, _, options = line.partition(" ")
        completed = run(f"{command} {RATTLE} {options} {DRAG}", "json")
        completed.check_printed("two_stages_" + re.sub(r"\W+", "_", line))
        record = completed.json
        assert any(
            "clutch disc: linear with 600 N m/rad" in note for note in record["notes"]
        )
        return record

    return record_of


@pytest.mark.slow
@pytest.mark.parametrize("line", ["modes", "modes --at 1000"])
def test_modes_are_those_of_the_stage_under_the_mean(under_drag, line):
    assert under_drag(line)["frequencies_hz"][1] == pytest.approx(HZ, abs=0.01)


@pytest.mark.slow
def test_the_forced_response_is_that_of_the_stage_under_the_mean(under_drag):
    """A clutch torque of order 2 of 3.11 N m."""
    record = under_drag("forced --rpm 1000")
    reduced = 1 / (1 / 0.15 + 1 / (0.004 + 0.002 * (0.03 / 0.04) ** 2))
    amplitude = 60.0 * reduced / 0.15 / (1 - (1000 / 30) ** 2 / 55.361**2)
    orders = record["shafts"]["clutch disc"]["amplitudes"][0]
    assert orders[1] == pytest.approx(amplitude, rel=1e-3)


@pytest.mark.slow
def test_holzer_and_campbell_take_the_stage_under_the_mean(under_drag):
    table = under_drag("holzer --mode 1")["tables"][0]
    assert table["hz"] == pytest.approx(HZ, abs=0.01)
    mode = under_drag("campbell --rpm 500:3000:3")["modes"][1]
    assert mode["frequencies_hz"] == pytest.approx([HZ] * 3, abs=0.01)
