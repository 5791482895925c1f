"""Pages for those who sign them and who check them: names, units, words and ranges that
they know, and numbers that agree from part to part.
"""

import dataclasses

import numpy as np
import pytest
import trains
from reference_data import text_of

import jaxhb
from jaxhb.report.compute import Asked, solve_cases
from jaxhb.report.figures.cycle import cycle_figure
from jaxhb.report.figures.draw import as_svg
from jaxhb.report.figures.figure import legend_columns, line
from jaxhb.report.figures.sketch import plot_train
from jaxhb.report.orders import order_names
from jaxhb.report.page.first_page import (
    compliance,
    operating_modes,
    result,
    rule_of,
)
from jaxhb.report.page.judgement import for_readers, notes_of
from jaxhb.report.page.linear import modes
from jaxhb.report.page.motion import motions
from jaxhb.report.page.page import as_page
from jaxhb.report.page.parts import Report
from jaxhb.report.page.train import excitation_tables, train_data
from jaxhb.report.page.words import Words
from jaxhb.report.text.scene_check import referred_tables
from jaxhb.report.text.transients import _instant
from jaxhb.report.units import shown_in
from jaxhb.results.status import Status
from jaxhb.scene.writer import elements_of

LINE = "tests/data/scenes/limited_line.toml"
LOW = 300.0
HIGH = 1000.0


@pytest.fixture(scope="module")
def report():
    """The report of a linear train with limits at few speeds."""
    train = jaxhb.load_scene(LINE)
    cases = solve_cases({"firing": train}, np.linspace(LOW, HIGH, 4).tolist(), Asked())
    facts = {"date": "now", "command": "jaxhb report limits"}
    return Report(cases, facts=facts, mode="ice", elements=elements_of(LINE))


def test_an_order_of_many_cylinders_has_one_name():
    disks = [
        jaxhb.Disk(name=f"throw {k}", inertia=5.0, radius=0.1 if k == 3 else None)
        for k in range(4)
    ]
    shafts = [
        jaxhb.Shaft(between=(f"throw {k}", f"throw {k + 1}"), stiffness=1e6)
        for k in range(3)
    ]
    torques = [
        jaxhb.Torque(
            disk=f"throw {k}",
            mean=10.0,
            orders_of="own",
            harmonics=[(1.0, 5.0, 0.0)],
        )
        for k in range(3)
    ]
    wheel = jaxhb.Disk(name="wheel", inertia=9.0, radius=0.3)
    mesh = jaxhb.Mesh(between=("throw 3", "wheel"), stiffness=1e9)
    load = jaxhb.Load(disk="wheel")
    train = jaxhb.build(
        [*disks, wheel, *shafts, mesh, *torques, load], reference="wheel"
    )
    assert order_names(train).number(3.0) == "3 (1 of throw 0)"


def test_the_legend_has_as_many_columns_as_its_letters_leave_room_for():
    x = [1.0, 2.0]
    short = [line(x, x, "all cylinders firing"), line(x, x, "cylinder 3 not firing")]
    assert legend_columns(short, 334) == 2
    wide = [line(x, x, "WWWWWWWWWWWWWWWWWWWW") for _ in range(2)]
    assert legend_columns(wide, 334) == 1


def test_the_first_page_finds_the_resonance_between_the_speeds(report):
    (table, *_) = tables_of(result(report))
    shown = dict(zip(table.columns[0], table.columns[5], strict=True))
    train = jaxhb.load_scene(LINE)
    dense = jaxhb.forced_response(train, rpm=np.linspace(LOW, HIGH, 4001))
    # The critical speed of the undamped train misses the peak by less than 1 %.
    share = np.max(dense.power("coupling")) / 300
    assert float(shown["coupling"]) == pytest.approx(share, rel=0.01)


def test_barred_ranges_are_those_that_the_rule_bars_in_full(report):
    (strength,) = report.strengths.values()
    (barred,) = strength.barred["line shaft"]
    assert barred.bar_low < barred.low
    assert barred.bar_high > barred.high
    text = next(block for block in result(report) if "Barred" in block)
    assert text == (
        f"Barred speed ranges: {barred.bar_low:.4g} to {barred.bar_high:.4g} rpm, by"
        " line shaft."
    )


def test_operating_modes_of_a_linear_train_have_the_peak_between_its_speeds(report):
    """The largest force is that of a dense run of the linear response."""
    (table, *_) = tables_of(operating_modes(report))
    ((_, _, _, value, _, mesh),) = zip(*table.columns, strict=True)
    dense = jaxhb.forced_response(report.train, rpm=np.linspace(LOW, HIGH, 3001))
    peak = np.max(dense.force(mesh).half_peak_to_peak) / 1e3
    at_speeds = max(
        float(answer.response.force(mesh).half_peak_to_peak) / 1e3
        for answer in report.cases[0].answers
    )
    # The critical speed of the undamped train misses the peak by less than 1 %.
    assert float(value) == pytest.approx(peak, rel=0.01)
    assert float(value) > 1.1 * at_speeds


@pytest.mark.parametrize(
    ("rated", "statement"), [(600, "complies with barred ranges"), (560, "NOT")]
)
def test_a_range_barred_where_the_rule_accepts_none_does_not_comply(
    rated, statement, tmp_path
):
    """UR M68 accepts barred ranges up to 0.8 of the rated speed alone."""
    path = tmp_path / "line.toml"
    path.write_text(text_of("limited_line.toml").replace("= 900", f"= {rated}"))
    train = jaxhb.load_scene(path)
    rpm = np.linspace(LOW, 600.0, 4).tolist()
    made = Report(solve_cases({"firing": train}, rpm, Asked()), facts={})
    (strength,) = made.strengths.values()
    (barred,) = strength.barred["line shaft"]
    assert barred.passable
    assert (barred.bar_high <= 0.8 * rated) == ("NOT" not in statement)
    (row,) = [
        row
        for row in zip(*compliance(made)[0].columns, strict=True)
        if row[0] == "line shaft"
    ]
    assert statement in row[-1]


def test_irregularity_of_a_linear_train_is_the_largest_between_its_speeds_too(report):
    (table,) = motions(report)
    row = dict(zip(table.columns[0], zip(*table.columns[1:], strict=True), strict=True))
    dense = jaxhb.forced_response(report.train, rpm=np.linspace(LOW, HIGH, 4001))
    swing = np.asarray(dense.disk("propeller").half_peak_to_peak)  # of the angle
    assert swing.shape == dense.rpm.shape
    speed = dense.speed("propeller").half_peak_to_peak
    mean = dense.rpm * np.pi / 30 / 3  # the wheel is three times the pinion
    assert float(row["propeller"][0]) == pytest.approx(
        100 * np.max(2 * speed / mean), rel=0.01
    )


def test_a_rule_is_named_by_what_the_limit_is_called(report):
    (strength,) = report.strengths.values()
    rules = {
        name: rule_of(strength, key, name)
        for key, name in (
            ("stresses", "line shaft"),
            ("heat", "coupling"),
            ("tooth_torques", "pinion|wheel"),
            ("mean_torques", "coupling"),
        )
    }
    assert rules == {
        "line shaft": "IACS UR M68",
        "coupling": "nominal torque",
        "pinion|wheel": "a third of the rated torque",
    }
    assert rule_of(strength, "heat", "coupling") == "limit of the scene"


def test_notes_have_no_keys_options_or_names_of_statuses(report):
    (case,) = report.cases
    answer = case.answers[0]
    response = dataclasses.replace(
        answer.response, status=np.int32(Status.TOLERANCE_NOT_MET)
    )
    state = dataclasses.replace(answer.state, response=response)
    failed = dataclasses.replace(answer, state=state)
    doubtful = dataclasses.replace(case, answers=[failed, *case.answers[1:]])
    note = notes_of(Report([doubtful]))[0]
    assert note == (
        f"No result at 300 rpm with firing: the motion was found, but"
        f" {answer.harmonics} harmonics are too few for the accuracy asked for."
    )


@pytest.mark.parametrize(
    ("note", "words"),
    [
        (
            "[[cylinder]] 'A1', 'A2': the charge pressure follows the power: 1.014e5 Pa"
            " at 20 rpm, 3.2e5 Pa at full load: give charge_over_load or"
            " charge_over_rpm where it is known",
            "Cylinders A1, A2: the charge pressure follows the power: 1.014 bar at 20"
            " rpm, 3.2 bar at full load.",
        ),
        (
            "The orders reach 14 of them, order 36 at 350 rpm is 210 Hz; jaxhb campbell"
            " SCENE --rpm 120:350 --modes 14 lists all.",
            "The orders reach 14 of them, order 36 at 350 rpm is 210 Hz.",
        ),
        (
            "The numbers are those of recorded cycles (another tolerance or number of"
            " harmonics may find it) (alike at 180 rpm).",
            "The numbers are those of recorded cycles (alike at 180 rpm).",
        ),
        ("a|b: the teeth separate.", "a|b: the teeth separate."),
    ],
)
def test_readers_are_not_told_what_the_user_of_the_program_may_do(note, words):
    assert for_readers(note) == words


def test_a_page_names_its_operating_mode_and_is_written_once(report, monkeypatch):
    page = as_page(report)
    text = page.html().decode()
    assert "<p>Operating mode: ice</p>" in text
    assert 'content: "line, ice, now"' in text
    monkeypatch.setattr(type(page), "_written", lambda *_: pytest.fail("once more"))
    assert b"Operating mode" in page.phrases()
    # A command is typed as it stands, whatever replaces its words.
    words = as_page(report, {"report": "Bericht", "limits": "Grenzen"}).words
    assert words("jaxhb report limits") == "jaxhb report limits"


def test_words_of_drawings_are_replaced_but_for_lines_of_names():
    train = jaxhb.load_scene("spur_pair")
    words = Words({"gear": "Rad", "pitch circle of a": "Teilkreis:"}, ["gear a"])
    svg = words.drawing(as_svg(plot_train(train)))
    assert ">Teilkreis: Rad<" in svg
    assert ">gear a<" in svg
    strip = '<text x="1" y="2" class="name">long gear</text><text>gear</text>'
    assert words.drawing(strip) == strip.replace(">gear<", ">Rad<")


def test_torques_of_the_excitation_follow_the_units_that_are_chosen():
    train = jaxhb.load_scene("six_cylinder_diesel")
    cases = solve_cases({"firing": train}, [1200.0, 1800.0], Asked())
    data = Report(cases, elements=elements_of("six_cylinder_diesel"))
    usual = {table.caption: table for table in excitation_tables(data)}
    with shown_in({"N m": (1e-3, "kN m")}):
        chosen = excitation_tables(data)
    for table in chosen:
        if table.caption.startswith("Gas"):
            (before,) = [each for name, each in usual.items() if name.startswith("Gas")]
            assert table.heads[-1] == "mean torque kN m"
            assert before.heads[-1] == "mean torque N m"
            assert float(table.columns[-1][0]) == pytest.approx(
                1e-3 * float(before.columns[-1][0]), rel=1e-3
            )
    assert any("kN m" in table.caption for table in chosen)


def test_one_speed_has_no_referred_columns():
    train = jaxhb.load_scene("six_cylinder_diesel")
    for table in referred_tables(train):
        assert not [head for head in table.heads if "i^2" in head or " i" in head]
        assert "referred" not in table.caption
        assert "meshes" not in table.caption


@pytest.mark.slow
def test_a_motion_that_repeats_is_not_said_to_never_repeat():
    train = trains.pair_train(trains.Pair(1.0, epsilon=1e-3), transition=1e-2)
    rpm = 1.1 * trains.ONE_RADIAN_PER_SECOND  # where it has no period
    (answer,) = solve_cases({"": train}, [rpm], Asked())[0].answers
    assert answer.state.kind == "irregular"
    repeating = dataclasses.replace(answer.state, kind="subharmonic", period=4)
    for state, never in ((answer.state, True), (repeating, False)):
        drawn = cycle_figure(dataclasses.replace(answer, state=state), "a", [], "")
        assert "recorded cycle" in drawn.caption
        assert ("never repeats" in drawn.caption) is never


def test_what_happens_at_the_begin_of_a_transient_is_an_instant():
    assert _instant(0.0) == "0"
    assert _instant(float("nan")) == "-"


def test_cases_and_parts_are_told_in_words(report):
    (table, *_) = tables_of(operating_modes(report))
    assert table.caption.startswith("Operating modes; largest tooth force")
    assert "with a result" in table.heads
    assert train_data(report)


def tables_of(blocks):
    """Tables among blocks."""
    from jaxhb.report.table import Table

    return [block for block in blocks if isinstance(block, Table)]


@pytest.mark.parametrize("rated", [None, 900.0])
def test_modes_of_the_page_are_those_of_the_rated_speed(rated):
    """Without a rated speed those of the highest."""
    stiffness = [(300.0, 1e4), (900.0, 3e4), (1200.0, 9e4)]
    parts = [
        jaxhb.Disk(name="a", inertia=1.0),
        jaxhb.Disk(name="b", inertia=1.0),
        jaxhb.Shaft(between=("a", "b"), stiffness_over_rpm=stiffness),
        jaxhb.Torque(disk="a", harmonics=[(1.0, 5.0, 0.0)]),
    ]
    train = jaxhb.build(parts, revolutions_per_cycle=1, rated_rpm=rated)
    table, *_ = modes(Report(solve_cases({"": train}, [300.0, 1200.0], Asked())))
    expected = np.sqrt(2 * dict(stiffness)[rated or 1200.0]) / (2 * np.pi)
    assert f"{expected:.2f}" in str(table)
