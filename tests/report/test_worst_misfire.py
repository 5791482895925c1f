"""The misfire that governs has the largest share of a limit, element by element, in
tables and on the page.

In the scene the torque of the intermediate shaft is largest with cylinder 4 cut off, at
85 rpm, but its stress comes nearest to its limit, which falls over the speed, with
cylinder 1 cut off, at 120 rpm. The load of a crank of the engine is largest with
cylinder 2 cut off.
"""

import numpy as np
import pytest
from reference_data import text_of

import jaxhb
from jaxhb.linear.critical import campbell
from jaxhb.report.compute import Asked, solve_cases
from jaxhb.report.page.first_page import compliance, result
from jaxhb.report.page.linear import campbell as campbell_part, forced as forced_part
from jaxhb.report.page.parts import Report
from jaxhb.report.selection import case_title
from jaxhb.report.table import Table
from jaxhb.report.text.cases import misfires_text, worst_misfire, worst_misfires
from jaxhb.report.text.forced import (
    forced_record,
    forced_text,
    hardest_of,
    readings,
    worst_of,
)

SPEEDS = [80.0, 85.0, 120.0]
SHAFT = "intermediate"
CRANK = "crank"
OF_CRANK = (
    'name = "crank"\ndiameter = 0.45\ntensile_strength = 6e8\nrule = "KR crankshaft'
    ' B"\n'
)


@pytest.fixture(scope="module")
def train(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "engine.toml"
    between = 'between = ["cyl 1", "cyl 2"]\n'
    path.write_text(
        text_of("slow_two_stroke.toml").replace(between, between + OF_CRANK)
    )
    return jaxhb.load_scene(path)


@pytest.fixture(scope="module")
def trains(train):
    return {"": train.replace({"cylinder 1.gas_factor": 1.0})} | train.cut_offs()


@pytest.fixture(scope="module")
def expected(trains):
    """Shares of the continuous limit and torques of the shaft, and shares of the crank,
    over the speeds by case.
    """
    readings = {}
    for name, case in trains.items():
        response = jaxhb.forced_response(case, rpm=SPEEDS)
        stresses = jaxhb.strength(response).stresses
        shares, crank_shares = (
            stresses[shaft].stress / stresses[shaft].continuous
            for shaft in (SHAFT, CRANK)
        )
        torques = np.asarray(response.torque(SHAFT).half_peak_to_peak)
        readings[name] = shares, torques, crank_shares
    return readings


@pytest.fixture(scope="module")
def report(train, trains):
    titled = {case_title(case, name): case for name, case in trains.items()}
    return Report(solve_cases(titled, SPEEDS, Asked()), facts={"date": "today"})


@pytest.mark.slow
def test_the_largest_torque_and_the_largest_share_have_other_cylinders_and_speeds(
    expected,
):
    cut_off = [expected[f"cylinder {k}"] for k in range(1, 5)]
    shares = np.array([shares for shares, _, _ in cut_off])
    torques = np.array([torques for _, torques, _ in cut_off])
    assert np.unravel_index(shares.argmax(), shares.shape) == (0, 2)
    assert np.unravel_index(torques.argmax(), torques.shape) == (3, 1)


@pytest.mark.slow
def test_the_page_answers_with_what_governs_each_element_and_draws_it(report, trains):
    titles = [case.title for case in report.shown]
    assert titles == ["all cylinders firing", "cylinder 1 cut off"]
    answer = next(block for block in result(report) if isinstance(block, Table))
    rows: dict = {}
    for row in zip(*answer.columns, strict=True):  # the worst of an element first
        rows.setdefault(row[0], row)
    # A linear train is judged at more speeds than it was solved at.
    response = jaxhb.forced_response(trains["cylinder 1"], rpm=report.fine_rpm)
    stress = jaxhb.strength(response).stresses[SHAFT]
    shares = np.asarray(stress.stress / stress.continuous)
    largest = int(shares.argmax())
    assert f"{shares[largest]:.2f}" in rows[SHAFT]
    assert f"{report.fine_rpm[largest]:g}" in rows[SHAFT]
    assert "cylinder 1 cut off" in rows[SHAFT]
    assert "cylinder 2 cut off" in rows[CRANK]
    (table, *_) = compliance(report)
    assert isinstance(table, Table)
    governing = dict(zip(table.columns[0], table.columns[5], strict=True))
    assert governing[SHAFT] == "cylinder 1 cut off"
    assert governing[CRANK] == "cylinder 2 cut off"


@pytest.mark.slow
def test_the_tables_of_the_page_name_the_worst_cylinder_row_by_row(report, trains):
    (table,) = (
        block
        for block in campbell_part(report)
        if isinstance(block, Table) and "case" in block.heads
    )
    orders, modes, named = (
        table.columns[table.heads.index(head)] for head in ("order", "mode", "case")
    )
    rpm = np.linspace(80.0, 120.0, 33)
    numbers = sorted(set(map(float, orders)))
    torques = {}
    for name, case in trains.items():
        if name:
            critical = campbell(case, rpm=rpm, orders=numbers, count=12).critical
            torques[name] = {(c.order, c.mode): c.torque for c in critical}
    for order, mode, name in zip(orders, modes, named, strict=True):
        place = float(order), int(mode)
        largest = max(torques_at[place] for torques_at in torques.values())
        assert torques[name.removesuffix(" cut off")][place] == largest
    (table,) = (
        block
        for block in forced_part(report)
        if isinstance(block, Table)
        and "Vibratory torque" in block
        and "that of" in block.heads
    )
    cylinders = table.columns[table.heads.index("that of")]
    rows = dict(zip(table.columns[0], cylinders, strict=True))
    assert rows[SHAFT] == "cylinder 1 cut off"


@pytest.mark.slow
def test_the_misfire_that_governs_each_element_is_told_in_words_and_files(
    report, expected
):
    records = worst_misfires(report.cases)
    assert records[SHAFT] == worst_misfire(report.cases)
    assert list(records) == [SHAFT, CRANK]
    for name, place in ((SHAFT, 0), (CRANK, 2)):
        cases = {case: values[place] for case, values in expected.items() if case}
        cylinder = max(cases, key=lambda case: cases[case].max())
        speed = int(cases[cylinder].argmax())
        assert records[name]["cylinder"] == cylinder
        assert records[name]["rpm"] == SPEEDS[speed]
        shares = records[name]["share"], records[name]["firing_share"]
        np.testing.assert_allclose(
            shares, [cases[cylinder][speed], expected[""][place][speed]], rtol=1e-3
        )
        (line,) = (
            row
            for row in misfires_text(report.cases).splitlines()
            if row.split()[:2] == [name, "stress"]
        )
        assert line.endswith(f"{cylinder} cut off")
        assert f" {shares[0]:.2f} " in line


@pytest.fixture(scope="module")
def small():
    """Responses of an engine with a damper by the cylinder that does not fire, and what
    is judged of them; the disk of its load has a limit, the coupling another one.
    """
    parts = [
        jaxhb.Disk(name="e", inertia=1.0, damping=1.0),
        jaxhb.Disk(name="g", inertia=2.0, speed_irregularity_limit=0.001),
        jaxhb.Damper(name="d", disk="e", inertia=0.2, damping=20.0),
        jaxhb.Shaft(
            name="c",
            between=("e", "g"),
            stiffness=1e4,
            damping=5.0,
            vibratory_torque=100.0,
        ),
        jaxhb.Load(disk="g"),
    ]
    parts += [
        jaxhb.Cylinder(
            name=name,
            disk="e",
            firing_angle=angle,
            gas_torque_mean=50.0,
            gas_torque=[(0.5, size, 0.0), (1.0, 200.0, 0.0)],
        )
        for name, angle, size in (("one", 0.0, 100.0), ("two", 360.0, 150.0))
    ]
    train = jaxhb.build(parts, revolutions_per_cycle=2)
    cases = {"": train} | train.misfires()
    responses = {
        name: jaxhb.forced_response(case, rpm=[800.0, 1000.0])
        for name, case in cases.items()
    }
    strengths = {name: jaxhb.strength(each) for name, each in responses.items()}
    return responses, strengths


def test_a_ring_has_the_misfire_of_its_angle_its_damper_that_of_its_torque(small):
    responses, strengths = small
    elements = readings(responses[""])
    worst = worst_of(responses, elements, strengths)
    record = forced_record(responses, elements, strengths, worst)["worst_misfires"]
    for head, signal, read in (
        ("d angle", "angle", lambda response: response.disk("d")),
        ("d", "torque", lambda response: response.torque("d")),
    ):
        largest = {
            name: float(np.max(read(each).half_peak_to_peak))
            for name, each in responses.items()
            if name
        }
        assert record[head]["quantity"] == signal
        assert record[head]["cylinder"] == max(largest, key=largest.get)
        assert record[head]["value"] == pytest.approx(max(largest.values()), rel=1e-12)


def test_limits_of_disks_count_in_the_worst_misfire_and_are_told_by_name(small):
    responses, strengths = small
    elements = readings(responses[""])
    worst = worst_of(responses, elements, strengths)
    shares = {
        name: each.irregularities["g"].value / 0.001
        for name, each in strengths.items()
        if name
    }
    share = max(values.max() for values in shares.values())
    coupling = worst["shafts", "c"].share.share
    assert 1.0 < coupling < share
    assert worst["disks", "g"].share.share == pytest.approx(share, rel=1e-12)
    assert hardest_of(elements, worst).name == "g"
    told = " ".join(forced_text(responses, elements, worst, each=False).split())
    assert f"cyclic irregularity {share:.2f} of its limit;" in told
    links = [element for element in elements if element.kind == "shafts"]
    told = " ".join(forced_text(responses, links, worst, each=False).split())
    assert f", {coupling:.2f} of the permissible vibratory torque;" in told
