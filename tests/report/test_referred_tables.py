"""``jaxhb scene --referred``: numbers as they are and referred to the reference
rotor.
"""

import math

import pytest
from limited_line import write_scene
from reference_data import text_of

VARYING = text_of("links_that_vary.toml")


def test_referred_numbers_are_printed_beside_the_actual_ones(tmp_path, run):
    completed = run(f"scene {write_scene(tmp_path)} --referred")
    completed.check_printed("referred_line")
    rows = {
        line.split("  ")[1].strip(): line.split()
        for line in completed.out.splitlines()
        if "  " in line
    }
    # Three times slower: a ninth of the numbers.
    assert rows["propeller"][-5:] == ["0.333333", "90", "10", "20", "2.22222"]
    stiffness, referred = map(float, rows["line shaft"][-4:-2])
    assert referred == pytest.approx(stiffness / 9, rel=1e-5)
    assert rows["pinion|wheel"][-5:-2] == ["0.1", "500", "5000"]


def test_referred_numbers_have_loss_factors_orders_and_rows_of_links_that_vary(
    tmp_path, run
):
    (tmp_path / "v.toml").write_text(VARYING)
    completed = run(f"scene {tmp_path / 'v.toml'} --referred")
    completed.check_printed("referred_links_that_vary")
    _, _, orders, _ = completed.out.split("\n\n")
    stiffness = 0.05 * (9.0 * 2.0 * math.pi / 60.0) ** 2
    cells = orders.splitlines()[-1].split()
    assert cells[-2:] == [f"{stiffness:.6g}", f"{4 * stiffness:.6g}"]
