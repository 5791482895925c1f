"""``jaxhb campbell``: critical speeds that a calculation by hand gives, in the table,
the files and the picture.
"""

from types import SimpleNamespace

import pytest
from reference_data import DATA, text_of

import jaxhb
from jaxhb.linear.critical import Critical, shares_in_mode
from jaxhb.report.figures.linear import counting

SCENE = "six_cylinder_diesel"
PENDULUM = text_of("pendulum.toml")


def test_the_table_and_the_files_hold_sixty_times_hz_over_the_order_by_rising_speed(
    told,
):
    called = told(
        f"campbell {SCENE} --rpm 1000:2600 --orders 6,9,3", "json", "csv", "plot"
    )
    hz = jaxhb.natural_frequencies(jaxhb.load_scene(SCENE)).frequencies_hz[1]
    record = called.json
    found = [
        (c["rpm"], c["order"], c["mode"], c["hz"]) for c in record["critical_speeds"]
    ]
    assert found == [(60 * hz / 9, 9.0, 1, hz), (60 * hz / 6, 6.0, 1, hz)]
    assert (
        record["orders"] == [3.0, 6.0, 9.0]
        and record["rpm"][0] == 1000.0
        and record["rpm"][-1] == 2600.0
    )
    assert [m["kind"] for m in record["modes"]] == ["rigid"] + ["elastic"] * 6
    assert [float(row["rpm"]) for row in called.rows] == [row[0] for row in found]
    rows = [line.split()[:4] for line in called.out.splitlines()[-2:]]
    assert rows == [["1443.9", "9", "1", "216.58"], ["2165.8", "6", "1", "216.58"]]
    assert called.is_drawn


def test_orders_are_those_of_the_torques_and_links_that_vary_must_be_made_constant(
    tmp_path, run
):
    (tmp_path / "p.toml").write_text(PENDULUM)
    call = f"campbell {tmp_path / 'p.toml'} --rpm 600:4000:9"
    called = run(call)
    assert called.status == 2 and "'shaft' has over_hz" in called.err
    said = run(f"{call} --links-at hz=50").out
    assert "Orders: 3." in said and "Hz at 600 rpm  at 4000 rpm" in said
    assert said.splitlines()[-3].split()[:4] == [
        "1162.3",
        "3",
        "1",
        "58.12",
    ]  # sqrt(4e5 / 3) / 2 pi, times 60 / 3


def test_modes_that_are_left_out_are_counted_with_why_and_how_to_have_them(told):
    call = "campbell gear_train_30 --rpm 700:2450 --orders 0.5,12"
    hz = jaxhb.natural_frequencies(jaxhb.load_scene("gear_train_30")).frequencies_hz[1:]
    crossed = int((hz <= 12 * 2450 / 60).sum())
    said = told(call).out
    assert (
        f"These are the 6 lowest of {len(hz)} modes that strain links; the orders reach"
        f" {crossed} of them" in said
    )
    assert f"jaxhb campbell SCENE --rpm 700:2450 --modes {crossed} lists all." in said
    assert (
        " of them, all shown: order 12 at 2450 rpm is 490 Hz."
        in told(f"{call} --modes {crossed}").out
    )


def test_modal_torques_count_beside_those_of_their_mode_alone():
    torques = (1, 200.0), (1, 1.0), (2, 0.5), (2, 0.25), (3, 0.0)  # of modes, N m
    own = [
        Critical(1000.0 + k, 1.0, mode, 50.0, torque)
        for k, (mode, torque) in enumerate(torques)
    ]
    assert shares_in_mode(own, [c.torque for c in own]) == [1.0, 0.005, 1.0, 0.5, 0.0]
    assert counting(SimpleNamespace(critical=own)) == [own[0], own[2], own[3]]


@pytest.mark.slow
def test_the_modal_torques_of_every_misfire_are_those_of_its_train(told):
    call = f"campbell {SCENE} --rpm 1000:2600 --misfire"
    called = told(f"{call} each", "json", "csv")
    alone = told(f"{call} 'cylinder 3'", "json").json["critical_speeds"]
    speeds = called.json["critical_speeds"]
    torques = {(c["order"], c["mode"]): c["modal_torque"] for c in alone}
    assert all(
        c["misfires"]["cylinder 3"]
        == pytest.approx(torques[c["order"], c["mode"]], rel=1e-12)
        for c in speeds
    )
    row = called.rows[0]
    assert (
        float(row["modal torque N m, cylinder 3 not firing"])
        == speeds[0]["misfires"]["cylinder 3"]
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "rpm"),
    [(SCENE, "700:1500"), (DATA / "scenes" / "slow_two_stroke.toml", "60:130")],
    ids=["torque", "limit"],
)
def test_the_worst_misfire_is_that_of_the_forced_response_at_the_critical_speeds(
    told, scene, rpm
):
    """By the largest share of a limit of stress, or without limits the largest torque
    of a shaft.
    """
    called = told(f"campbell {scene} --rpm {rpm} --misfire each", "json")
    worst = called.json["worst_misfire"]
    critical = called.json["critical_speeds"]
    speeds = ",".join(repr(speed) for speed in sorted({c["rpm"] for c in critical}))
    forced = told(f"forced {scene} --rpm {speeds} --misfire each", "json").json[
        "worst_misfire"
    ]
    assert {key: worst[key] for key in forced} == pytest.approx(forced)
    assert ("share" in worst) == ("stroke" in str(scene))
    (at,) = (
        c for c in critical if (c["rpm"], c["order"]) == (worst["rpm"], worst["order"])
    )
    assert worst["modal_torque"] == at["misfires"][worst["cylinder"]]
    assert worst["modal_torque_firing"] == at["modal_torque"]
    if "share" in worst:  # the largest modal torque is another's
        largest = max(critical, key=lambda c: max(c["misfires"].values()))["misfires"]
        assert max(largest, key=largest.get) != worst["cylinder"]
    assert f"The worst misfire is that of {worst['cylinder']}: torque of " in called.out


def test_misfires_at_critical_speeds_that_nothing_damps_are_not_compared(run, tmp_path):
    gas = {"gas_torque_mean": 10.0, "gas_torque": [(1.0, 5.0, 4.0)]}
    parts = [jaxhb.Disk(name=name, inertia=2.0) for name in "ab"]
    parts += [jaxhb.Shaft(between=("a", "b"), stiffness=100.0), jaxhb.Load(disk="b")]
    parts += [
        jaxhb.Cylinder(name=name, disk="a", firing_angle=k, **gas)
        for name, k in (("one", 0.0), ("two", 90.0))
    ]
    (tmp_path / "free.toml").write_text(jaxhb.elements_text(parts, name="free"))
    called = run(
        f"campbell {tmp_path / 'free.toml'} --rpm 50:200 --misfire each", "json"
    )
    assert called.status == 0 and called.json["worst_misfire"] is None
    assert "At 1 of 1 critical speeds nothing damps the mode" in called.out


def test_a_range_without_critical_speeds_has_no_worst_misfire(told):
    called = told(f"campbell {SCENE} --rpm 900:901 --orders 1 --misfire each", "json")
    assert called.status == 0 and called.json["worst_misfire"] is None
    assert "No critical speed lies in the range" in called.out
