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
    run_once,
):
    line = f"campbell {SCENE} --rpm 1000:2600 --orders 6,9,3"
    completed = run_once(line, "json", "csv", "plot")
    completed.check_printed("campbell_diesel")
    hz = jaxhb.natural_frequencies(jaxhb.load_scene(SCENE)).frequencies_hz[1]
    record = completed.json
    speeds = [
        (c["rpm"], c["order"], c["mode"], c["hz"]) for c in record["critical_speeds"]
    ]
    assert speeds == [(60 * hz / 9, 9.0, 1, hz), (60 * hz / 6, 6.0, 1, hz)]
    assert record["orders"] == [3.0, 6.0, 9.0]
    assert (record["rpm"][0], record["rpm"][-1]) == (1000.0, 2600.0)
    assert [m["kind"] for m in record["modes"]] == ["rigid"] + ["elastic"] * 6
    assert [float(row["rpm"]) for row in completed.rows] == [row[0] for row in speeds]


def test_orders_are_those_of_the_torques_and_links_that_vary_must_be_made_constant(
    tmp_path, run
):
    (tmp_path / "p.toml").write_text(PENDULUM)
    line = f"campbell {tmp_path / 'p.toml'} --rpm 600:4000:9"
    run(line, status=2).check_printed("campbell_links_vary")
    completed = run(f"{line} --links-at hz=50")
    completed.check_printed("campbell_links_at_50_hz")
    # sqrt(4e5 / 3) / 2 pi, times 60 / 3
    assert completed.out.splitlines()[-3].split()[:4] == ["1162.3", "3", "1", "58.12"]


def test_modes_that_are_left_out_are_counted_with_why_and_how_to_have_them(run_once):
    line = "campbell gear_train_30 --rpm 700:2450 --orders 0.5,12"
    hz = jaxhb.natural_frequencies(jaxhb.load_scene("gear_train_30")).frequencies_hz[1:]
    crossed = int((hz <= 12 * 2450 / 60).sum())
    completed = run_once(line)
    completed.check_printed("campbell_modes_left_out")
    assert f"--modes {crossed} lists all." in completed.out
    sentence = " of them, all shown: order 12 at 2450 rpm is 490 Hz."
    assert sentence in run_once(f"{line} --modes {crossed}").out


def test_modal_torques_count_beside_those_of_their_mode_alone():
    torques = (1, 200.0), (1, 1.0), (2, 0.5), (2, 0.25), (3, 0.0)  # of modes, N m
    critical = [
        Critical(1000.0 + k, 1.0, mode, 50.0, torque)
        for k, (mode, torque) in enumerate(torques)
    ]
    shares = shares_in_mode(critical, [c.torque for c in critical])
    assert shares == [1.0, 0.005, 1.0, 0.5, 0.0]
    counted = counting(SimpleNamespace(critical=critical))
    assert counted == [critical[0], critical[2], critical[3]]


@pytest.mark.slow
def test_the_modal_torques_of_every_misfire_are_those_of_its_train(run_once):
    line = f"campbell {SCENE} --rpm 1000:2600 --misfire"
    completed = run_once(f"{line} each", "json", "csv")
    alone = run_once(f"{line} 'cylinder 3'", "json").json["critical_speeds"]
    speeds = completed.json["critical_speeds"]
    torques = {(c["order"], c["mode"]): c["modal_torque"] for c in alone}
    of_misfires = {(c["order"], c["mode"]): c["misfires"]["cylinder 3"] for c in speeds}
    expected = {place: torques[place] for place in of_misfires}
    assert of_misfires == pytest.approx(expected, rel=1e-12)
    cell = completed.rows[0]["modal torque N m, cylinder 3 not firing"]
    assert float(cell) == speeds[0]["misfires"]["cylinder 3"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "rpm"),
    [(SCENE, "700:1500"), (DATA / "scenes" / "slow_two_stroke.toml", "60:130")],
    ids=["torque", "limit"],
)
def test_the_worst_misfire_is_that_of_the_forced_response_at_the_critical_speeds(
    run_once, scene, rpm
):
    """By the largest share of a limit of stress, or without limits the largest torque
    of a shaft.
    """
    completed = run_once(f"campbell {scene} --rpm {rpm} --misfire each", "json")
    worst = completed.json["worst_misfire"]
    critical = completed.json["critical_speeds"]
    speeds = ",".join(repr(speed) for speed in sorted({c["rpm"] for c in critical}))
    line = f"forced {scene} --rpm {speeds} --misfire each"
    forced = run_once(line, "json").json["worst_misfire"]
    assert {key: worst[key] for key in forced} == pytest.approx(forced)
    assert ("share" in worst) == ("stroke" in str(scene))
    place = (worst["rpm"], worst["order"])
    (at,) = (c for c in critical if (c["rpm"], c["order"]) == place)
    assert worst["modal_torque"] == at["misfires"][worst["cylinder"]]
    assert worst["modal_torque_firing"] == at["modal_torque"]
    if "share" in worst:  # the largest modal torque is another's
        largest = max(critical, key=lambda c: max(c["misfires"].values()))["misfires"]
        assert max(largest, key=largest.get) != worst["cylinder"]
    sentence = f"The worst misfire is that of {worst['cylinder']}: torque of "
    assert sentence in completed.out


def test_misfires_at_critical_speeds_that_nothing_damps_are_not_compared(run, tmp_path):
    parts = [
        jaxhb.Disk(name="a", inertia=2.0),
        jaxhb.Disk(name="b", inertia=2.0),
        jaxhb.Shaft(between=("a", "b"), stiffness=100.0),
        jaxhb.Load(disk="b"),
    ]
    parts += [
        jaxhb.Cylinder(
            name=name,
            disk="a",
            firing_angle=angle,
            gas_torque_mean=10.0,
            gas_torque=[(1.0, 5.0, 4.0)],
        )
        for name, angle in (("one", 0.0), ("two", 90.0))
    ]
    (tmp_path / "free.toml").write_text(jaxhb.elements_text(parts, name="free"))
    line = f"campbell {tmp_path / 'free.toml'} --rpm 50:200 --misfire each"
    completed = run(line, "json")
    completed.check_printed("campbell_undamped_misfires")
    assert completed.json["worst_misfire"] is None


def test_a_range_without_critical_speeds_has_no_worst_misfire(run_once):
    line = f"campbell {SCENE} --rpm 900:901 --orders 1 --misfire each"
    completed = run_once(line, "json")
    completed.check_printed("campbell_without_critical_speeds")
    assert completed.json["worst_misfire"] is None
