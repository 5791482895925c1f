"""Limits of couplings and disks in what commands tell and write."""

import pytest
from limited_line import SCENE

LIMITED = SCENE.replace(
    "power_limit = 300",
    "power_limit = 300\nnominal_torque = 1000\nvibratory_torque = 500\n"
    "maximum_torque = 3000\nspeed_limit = 950",
).replace("damping = 2.0", "damping = 2.0\nspeed_irregularity_limit = 0.02")


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "line.toml"
    path.write_text(LIMITED)
    return path


def test_forced_tells_couplings_beside_their_limits(scene, run):
    done = run(f"forced {scene} --rpm 420,900", "json", "csv")
    limits = done.json["strength"]
    mean = limits["mean_torques"]["coupling"]
    # 1200 N m times its scale, 0.4 at 300 rpm and 1 at 900 rpm
    assert mean["value_Nm"] == pytest.approx([1200.0 * 0.52, 1200.0], rel=1e-9)
    assert mean["limit_Nm"] == 1000.0
    swing, most = (
        limits[kind]["coupling"]["value_Nm"]
        for kind in ("vibratory_torques", "largest_torques")
    )
    assert all(big > small for big, small in zip(most, swing, strict=True))
    assert limits["speeds"]["coupling"] == {
        "value_rpm": [420.0, 900.0],
        "limit_rpm": 950.0,
    }
    irregular = limits["irregularities"]["engine"]
    assert irregular["limit"] == 0.02
    for row, place in zip(done.rows, (0, 1), strict=True):
        assert float(row["coupling vibratory torque N m"]) == pytest.approx(
            swing[place], rel=1e-5
        )
        assert float(row["coupling nominal torque N m"]) == 1000.0
        assert float(row["engine cyclic irregularity 1"]) == pytest.approx(
            irregular["value"][place], rel=1e-5
        )
    assert "beside the maximum torque T_Kmax" in done.out


def test_a_transient_compares_every_instant(scene, run):
    done = run(f"transient {scene} --speed 0:410,0.4:430 --seconds 0.4", "json")
    record = done.json
    largest = record["strength"]["largest_torques"]["coupling"]
    signal = record["shafts"]["coupling"]
    assert largest["value_Nm"] == pytest.approx(max(signal["max"], -signal["min"]))
    assert largest["time_s"] == pytest.approx(signal["time_of_peak_s"])
    assert largest["share"] == pytest.approx(largest["value_Nm"] / 3000.0)
    assert record["strength"]["speeds"]["coupling"]["value_rpm"] == pytest.approx(430.0)
    assert "Largest torque of couplings" in done.out
