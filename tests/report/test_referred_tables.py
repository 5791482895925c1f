"""``jaxhb scene --referred``: numbers as they are and referred to the reference
rotor.
"""

import math

import pytest
from limited_line import write_scene
from reference_data import text_of

from jaxhb.cli.main import main

VARYING = text_of("links_that_vary.toml")


def test_referred_numbers_are_printed_beside_the_actual_ones(tmp_path, capsys):
    assert main(["scene", str(write_scene(tmp_path)), "--referred"]) == 0
    rows = {
        line.split("  ")[1].strip(): line.split()
        for line in capsys.readouterr().out.splitlines()
        if "  " in line
    }
    assert rows["propeller"][-5:] == ["0.333333", "90", "10", "20", "2.22222"]
    assert float(rows["line shaft"][-3]) == pytest.approx(
        float(rows["line shaft"][-4]) / 9, rel=1e-5
    )
    assert rows["pinion|wheel"][-5:-2] == ["0.1", "5e+08", "5e+06"]


def test_referred_numbers_have_loss_factors_orders_and_rows_of_links_that_vary(
    tmp_path, capsys
):
    (tmp_path / "v.toml").write_text(VARYING)
    assert main(["scene", str(tmp_path / "v.toml"), "--referred"]) == 0
    disks, links, orders, rows = capsys.readouterr().out.split("\n\n")
    assert [line.split() for line in disks.splitlines()[-2:]] == [
        ["end", "2", "1", "4", "50", "200"],
        ["pendulum", "2", "0.05", "0.2", "0", "0"],
    ]
    assert (
        "  ".join(links.split("coupling")[1].split()[:7])
        == "shaft  2  20000  80000  3  12  0.1"
    )
    stiffness = 0.05 * (9.0 * 2.0 * math.pi / 60.0) ** 2
    assert orders.splitlines()[-1].split() == [
        "pendulum",
        "4.5",
        "9",
        f"{stiffness:.6g}",
        f"{4 * stiffness:.6g}",
    ]
    assert [" ".join(line.split()) for line in rows.splitlines()[2:]] == [
        "coupling over_hz 0 0 20000 80000 3 12 0.1",
        "coupling over_hz 10 10 30000 120000 2.7 10.8 0.09",
        "coupling over_amplitude 0.002 0.001 25000 100000 2.4 9.6 0.08",
        "coupling over_amplitude 0.02 0.01 20000 80000 3 12 0.1",
        "coupling over_amplitude 0.03 0.015 18000 72000 3.3 13.2 0.11",
    ]
