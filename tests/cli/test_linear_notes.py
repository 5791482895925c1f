"""Linear commands on a clutch disc of two stages: which stage they take, and what they
say of it.
"""

from pathlib import Path

import pytest

RATTLE = Path(__file__).parents[1] / "data" / "scenes" / "idle_rattle.toml"


@pytest.mark.slow
def test_commands_take_the_stage_under_the_mean_and_say_so(run):
    """55.4 Hz and a clutch torque of order 2 of 3.11 N m with a drag of 40 N m; 10.1 Hz
    is the first stage.
    """
    drag = '--set "counter gear:torque.mean=-40"'
    for command in ("modes", "modes --at 1000"):
        called = run(f"{command.replace('modes', f'modes {RATTLE}')} {drag}", "json")
        assert called.json["frequencies_hz"][1] == pytest.approx(55.36, abs=0.01)
        assert any(
            "clutch disc: linear with 600 N m/rad" in note
            for note in called.json["notes"]
        )
        assert "dry friction of 0.6 N m is left out" in called.words
    called = run(f"forced {RATTLE} --rpm 1000 {drag}", "json")
    reduced = 1 / (1 / 0.15 + 1 / (0.004 + 0.002 * (0.03 / 0.04) ** 2))
    static = 60.0 * reduced / 0.15 / (1 - (1000 / 30) ** 2 / 55.361**2)
    assert called.json["shafts"]["clutch disc"]["amplitudes"][0][1] == pytest.approx(
        static, rel=1e-3
    )
    assert (
        any("clutch disc" in note for note in called.json["notes"])
        and "linear with 600 N m/rad" in called.words
    )
    called = run(f"holzer {RATTLE} --mode 1 {drag}", "json")
    assert (
        called.json["tables"][0]["hz"] == pytest.approx(55.36, abs=0.01)
        and called.json["notes"]
    )
    called = run(f"campbell {RATTLE} --rpm 500:3000:3 {drag}", "json")
    assert (
        called.json["modes"][1]["frequencies_hz"]
        == pytest.approx([55.36] * 3, abs=0.01)
        and called.json["notes"]
    )
