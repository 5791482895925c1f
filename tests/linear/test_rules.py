"""Rules as data: those of a file against built-in ones, formulas, faults of files,
barred ranges after M68.5, separation margins.
"""

import dataclasses

import jax
import numpy as np
import pytest
from reference_data import DATA

import jaxhb
from jaxhb import SceneError
from jaxhb.elements.rules import RULES
from jaxhb.elements.rules.chosen import DEFAULT, File, choose
from jaxhb.elements.rules.formula import FormulaError, formula
from jaxhb.elements.rules.written import rule_of
from jaxhb.linear.critical import modes_of
from jaxhb.linear.margins import separations
from jaxhb.linear.strength import barred_ranges
from jaxhb.report.text.strength import strength_text

TEXT = (DATA / "rules/intermediate_shafts.toml").read_text()
FILE = File("intermediate_shafts.toml", TEXT)
LINE = (DATA / "scenes/limited_line.toml").read_text()


def line(tmp_path, head):
    """The line of shafts with more keys in its [scene], and the file beside it."""
    path = tmp_path / "line.toml"
    path.write_text(LINE.replace("rated_rpm = 900", f"rated_rpm = 900\n{head}"))
    (tmp_path / FILE.name).write_text(TEXT)
    return path


@pytest.mark.parametrize("on_jax", [False, True])
def test_m68_written_as_a_file_is_that_of_jaxhb(on_jax):
    ratio = np.linspace(0.0, 1.1, 111)
    rule = rule_of(FILE.text, FILE.name)
    for diameter, strength, form in ((0.4, 6e8, 1.0), (0.055, 9e8, 0.45)):
        section = {
            "diameter": diameter,
            "tensile_strength": strength,
            "stress_concentration": form,
        }

        def limits(rule, ratio, section=section):
            return jaxhb.permissible_stress(rule=rule, speed_ratio=ratio, **section)

        read = (
            jax.jit(lambda x: limits(rule, x))(ratio) if on_jax else limits(rule, ratio)
        )
        np.testing.assert_allclose(read, limits("M68", ratio), rtol=1e-12)
    built_in = RULES["M68"]
    assert rule.barred(420.0, 900.0) == pytest.approx(built_in.barred(420.0, 900.0))
    assert (rule.highest, rule.passed, rule.corners[-1]) == (1.05, 0.8, 1.05)
    assert set(rule.needs) == set(built_in.needs)


def test_a_scene_judges_by_its_file_as_by_the_rule_of_jaxhb(tmp_path):
    rpm = np.linspace(300.0, 960.0, 12)
    by_name = jaxhb.load_scene(line(tmp_path, ""))
    by_file = jaxhb.load_scene(line(tmp_path, f'rules = ["{FILE.name}", "gears"]'))
    name = "line shaft"
    judged = jaxhb.strength(jaxhb.forced_response(by_file, rpm=rpm))
    expected = jaxhb.strength(jaxhb.forced_response(by_name, rpm=rpm))
    assert judged.rules == {name: "intermediate shafts"}
    np.testing.assert_allclose(
        judged.stresses[name], expected.stresses[name], rtol=1e-12
    )
    for barred, other in zip(judged.barred[name], expected.barred[name], strict=True):
        assert barred.bar_low == pytest.approx(other.bar_low, rel=1e-12)
    given = by_name.with_rules(FILE)
    assert given.topology.rules.names == ("intermediate shafts", *DEFAULT)
    assert given.topology.rule_of(1) == by_file.topology.rule_of(1)
    # Without the rule of gears their torques are not judged.
    alone = jaxhb.load_scene(line(tmp_path, f'rules = ["{FILE.name}"]'))
    assert not jaxhb.strength(jaxhb.forced_response(alone, rpm=rpm)).tooth_torques


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2 + 3 * 4 ** 2 / 8 - -1", 9.0),
        ("sqrt(max(a, 9, b)) + min(a, b)", 6.0),
        ("where(a <= 4, lambda, 1 / 0.5) * 2", 1.0),
        ("where(lambda > 0.5, 1, 2)", 2.0),
        ("3", 3.0),
        ("\n  2 *\n  a\n", 8.0),
    ],
)
def test_a_formula_has_the_value_of_its_arithmetic(text, value):
    read = formula(text, ("a", "b", "lambda"))
    numbers = {"a": 4.0, "b": 16.0, "lambda": 0.5}
    if "max(" in text:
        value = 4.0 + 4.0
    assert float(read.value(numbers)) == value
    gradient = jax.grad(lambda a: read.value(numbers | {"a": a}))(4.5)
    assert np.isfinite(gradient)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("3 + * 2", "no formula, at column 5"),
        ("a + c", "unknown name 'c' at column 5"),
        ("a ^ 2", r"Write \*\* for powers"),
        ("__import__('os')", "at column 1 is not understood"),
        ("a.real", "is not understood"),
        ("a[0]", "is not understood"),
        ("(lambda x: x)(a)", "no formula|not understood"),
        ("sqrt(a, b)", "has 2 arguments, must have 1"),
        ("min(a)", "must have at least 2"),
        ("where(a, 1, 2)", "needs a comparison first"),
        ("a < b", "is not understood"),
        ("True", "is not understood"),
        ("'a'", "is not understood"),
        ("2,5 * a", "Write decimals with a point"),
        ("1" + 400 * "0", "is not understood"),
        ("1 +" * 400, "1200 characters, must have at most 1000"),
    ],
)
def test_what_is_no_formula_is_refused_with_its_column(text, sentence):
    with pytest.raises(FormulaError, match=sentence):
        formula(text, ("a", "b", "lambda"))


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("[0.9, 1.05]", "[0.95, 1.05]", "no span of lambda from 0.9 to 0.95"),
        ("[0.9, 1.05]", "[0.8, 1.05]", "lambda from 0.8 to 0.9 is in the span before"),
        ("[0.9, 1.05]", "[1.05, 0.9]", r"must be \[from, to\], rising"),
        ("sigma_B", "sigma_C", "strength: unknown name 'sigma_C' at column 5"),
        ('"MPa"', '["MPa"]', "stress_unit is .'MPa'., must be"),
        ('"MPa"', '"kPa"', "stress_unit is 'kPa', must be 'Pa' or 'MPa'"),
        ('name = "intermediate shafts"', "", "the key 'name' is missing"),
        ("accepted_to", "accept_to", "unknown key 'accept_to'. Did you mean"),
        ("C_D =", "C_K =", "the name is taken"),
        ('high = "(18', 'hig = "(18', r"\[barred\] must have the keys low and high"),
        ("(18 - lambda) * n_c / 16", "0.9 * n_c", "low is 271.2 and high is 270 rpm"),
        ("[[span]]\nlambda = [0.0", "[[spa]]\nlambda = [0.0", "unknown key 'spa'"),
        ("0.8\ncrank", "-1\ncrank", "accepted_to is -1, must be a number greater"),
        ("crankshafts", "year = 1.5\ncrankshafts", "year is 1.5, must be a whole"),
        ("1.38", "1.38 *", "continuous: it is no formula, at column"),
        ("[define]", "[define", "invalid TOML"),
        ("crankshafts = false", "crankshafts = 'no'", "'no', must be true or false"),
        ("[0.9, 1.05]", "[0.9, inf]", r"must be \[from, to\], rising"),
    ],
)
def test_faults_of_a_file_are_told_in_sentences(old, new, sentence):
    assert old in TEXT
    with pytest.raises(SceneError, match=sentence) as error:
        rule_of(TEXT.replace(old, new, 1), "mine.toml")
    assert str(error.value).startswith("mine.toml: ")


KOREAN = """
name = "main engines"
source = "after KR 201, times d / 400 mm"
stress_unit = "MPa"
length_unit = "mm"

[[span]]
lambda = [0.0, 1.0]
continuous = "d / 400 * (45 - 24 * lambda ** 2)"
transient = "2 * tau_C"

[[span]]
lambda = [1.0, 1.15]
continuous = "d / 400 * (21 + 237 * (lambda - 0.8) * sqrt(lambda - 1))"
transient = "tau_C"
"""


def test_a_root_beyond_its_span_has_no_part_in_limits_and_derivatives():
    rule = rule_of(KOREAN, "main.toml")
    ratio = np.array([0.5, 0.9, 1.1, 1.15])
    steel = {"tensile_strength": 440e6, "yield_strength": 225e6}

    def limit(diameter, ratio, rule=rule):
        return jaxhb.permissible_stress(
            diameter=diameter, speed_ratio=ratio, rule=rule, **steel
        )[0]

    # The rule of jaxhb does not depend on the diameter.
    built_in = limit(0.4, ratio, "KR crankshaft A")
    np.testing.assert_allclose(limit(0.4, ratio), built_in, rtol=1e-12)
    over_size = jax.jacobian(limit)(0.4, ratio)
    np.testing.assert_allclose(over_size, built_in / 0.4, rtol=1e-12)
    slopes = jax.vmap(jax.grad(lambda x: limit(0.4, x)))(ratio)
    built_in_slopes = jax.vmap(jax.grad(lambda x: limit(0.4, x, "KR crankshaft A")))
    np.testing.assert_allclose(slopes, built_in_slopes(ratio), rtol=1e-12)


@pytest.mark.parametrize(
    ("formula_of_limit", "sentence"),
    [
        ("tau * (1 - 2 * lambda ** 2)", r"is -\S* Pa at lambda = 0.7087"),
        ("tau * sqrt(0.5 - lambda)", "is nan Pa at lambda = 0.504"),
    ],
)
def test_limits_that_are_none_are_refused(tmp_path, formula_of_limit, sentence):
    path = line(tmp_path, f'rules = ["{FILE.name}"]')
    text = TEXT.replace("tau * (3 - 2 * lambda ** 2)", formula_of_limit)
    (tmp_path / FILE.name).write_text(text)
    with pytest.raises(SceneError, match=f"continuous limit of inter.* {sentence}"):
        jaxhb.load_scene(path)
    path.write_text(LINE)
    rule = File(FILE.name, text)
    with pytest.raises(SceneError, match=f"continuous limit of inter.* {sentence}"):
        jaxhb.load_scene(path).with_rules(rule)


def test_nothing_is_within_a_limit_of_no_stress():
    rpm = np.array([100.0, 200.0, 300.0])
    stress = np.full(3, 10.0)
    (barred,) = barred_ranges(
        rpm, stress, np.array([20.0, 5.0, 20.0]), np.array([30.0, 0.0, 30.0])
    )
    assert not barred.passable
    assert (barred.share, barred.transient_share) == (2.0, np.inf)


def test_a_rule_that_is_not_there_or_lacks_a_number_is_refused(tmp_path):
    for head, sentence in {
        'rules = ["M86"]': "there is no rule 'M86'. Did you mean 'M68'?",
        "rules = 3": "rules is 3, must be a list of names and files",
        'rules = ["other.toml"]': "other.toml: there is no such file",
        'rules = ["API"]': "needs operating_rpm",
        "operating_rpm = [900, 100]": "two rising speeds above 0 rpm",
        "tachometer_tolerance = 0.5": "tachometer_tolerance is 0.5, must be at least 0",
    }.items():
        with pytest.raises(SceneError, match=sentence):
            jaxhb.load_scene(line(tmp_path, head))
    with pytest.raises(SceneError, match="is that of another rule. Rename"):
        choose([File("a.toml", TEXT.replace("intermediate shafts", "M68"))])
    yielding = File("y.toml", TEXT.replace("min(sigma_B", "min(Y"))
    train = jaxhb.load_scene(line(tmp_path, ""))
    with pytest.raises(SceneError, match="limits of intermediate shafts need yield_st"):
        train.with_rules(yielding)


def test_the_range_to_bar_is_that_above_the_limit_and_that_of_the_rule():
    rpm = np.array([80.0, 90.0, 100.0, 110.0, 120.0])
    stress = np.array([10.0, 10.0, 50.0, 10.0, 10.0])
    limit = np.full(5, 30.0)
    (above,) = barred_ranges(rpm, stress, limit, 1.7 * limit)
    assert (above.low, above.high) == (95.0, 105.0)
    rule = RULES["M68"]
    barred = above.widened(rule, 125.0, 0.02)
    # lambda = 0.8: 16 x 100 / 17.2 and 17.2 x 100 / 16, wider than 2.5 rpm each way
    assert barred.rule_low == pytest.approx(1600.0 / 17.2, rel=1e-12)
    assert barred.rule_high == pytest.approx(107.5, rel=1e-12)
    assert barred.tolerance == pytest.approx(2.5)
    # 95 - 2.5 is below that of the rule, 105 + 2.5 is its end.
    assert barred.bar_low == pytest.approx(92.5)
    assert barred.bar_high == pytest.approx(107.5)
    # A rule without a range of its own leaves the range as it is.
    other = RULES["KR generator shaft"]
    assert above.widened(other, 125.0, 0.02) is above
    assert (above.bar_low, above.bar_high) == (95.0, 105.0)

    def end(top):
        traced = stress + (top - 50.0) * (rpm == 100.0)
        (each,) = barred_ranges(rpm, traced, limit, 1.7 * limit)
        return each.widened(rule, 125.0, 0.02).bar_low

    # low = 90 + 10 x 20 / (top - 10), where that is what bars.
    assert float(jax.grad(end)(50.0)) == pytest.approx(-200.0 / 40.0**2, rel=1e-9)


def test_ranges_to_bar_are_told_with_the_rule_and_the_tachometer(tmp_path, run):
    path = line(tmp_path, "tachometer_tolerance = 0.02")
    done = run(f"forced {path} --rpm 300:960:67", "json")
    (barred,) = done.json["strength"]["stresses"]["line shaft"]["barred"]
    at = barred["at"]
    assert barred["tolerance"] == pytest.approx(18.0)
    assert barred["rule_low"] == pytest.approx(16 * at / (18 - at / 900), rel=1e-12)
    low = min(barred["low"] - 18.0, barred["rule_low"])
    assert barred["bar_low"] == pytest.approx(low, rel=1e-12)
    assert f"M68.5 around {at:g} rpm: {barred['rule_low']:.4g} to" in done.out
    assert f"To be barred and passed rapidly: {low:.4g} to" in done.out
    assert "18 rpm = 2 % of the rated speed for the tachometer" in done.out


SEPARATED = """
[scene]
rated_rpm = 3000
rules = ["M68", "API"]
operating_rpm = [2400, 3000]
[[disk]]
name = "motor"
inertia = 1.0
[[disk]]
name = "fan"
inertia = 1.0
[[shaft]]
between = ["motor", "fan"]
stiffness = {stiffness}
[[torque]]
disk = "motor"
harmonics = [[1, 1.0, 0.0]]
"""


@pytest.mark.parametrize(
    ("hz", "margin", "nearest"),
    [
        (57.5, 0.15, (1, 50.0)),  # 57.5 / 50 - 1; to 2x: 1 - 57.5 / 80 = 0.28
        (54.0, 0.08, (1, 50.0)),
        (71.2, 0.11, (2, 100.0)),  # 1 - 71.2 / 80, from 80 to 100 Hz
        (90.0, 0.0, (2, 100.0)),  # between 2 x 40 and 2 x 50 Hz
        (30.0, 0.25, (1, 50.0)),  # 1 - 30 / 40, from 40 to 50 Hz
        (120.0, 0.2, (2, 100.0)),
    ],
)
def test_separation_margins_are_those_worked_out_by_hand(
    tmp_path, run, hz, margin, nearest
):
    path = tmp_path / "fan.toml"
    # omega^2 = 2 k / J of two equal disks
    stiffness = (2 * np.pi * hz) ** 2 / 2
    path.write_text(SEPARATED.format(stiffness=repr(float(stiffness))))
    train = jaxhb.load_scene(path)
    modes, kinds, _ = modes_of(train)
    rows = separations(train, modes, kinds)
    assert [row.order for row in rows] == [1, 2]
    worst = min(rows, key=lambda row: row.margin)
    assert worst.hz == pytest.approx(hz, rel=1e-9)
    assert worst.margin == pytest.approx(margin, abs=1e-9)
    assert (worst.order, worst.high_hz) == pytest.approx(nearest)
    assert worst.kept == (margin > 0.0999)
    done = run(f"modes {path}", "json")
    assert ("TOO CLOSE" in done.out) == (not worst.kept)
    assert len(done.json["separation_margins"]) == 2
    assert {row.rotor for row in rows} == {"motor"}
    path.write_text(path.read_text().replace("[scene]", '[scene]\nreference = "fan"'))
    train = jaxhb.load_scene(path)
    named = separations(train, *modes_of(train)[:2])
    assert {row.rotor for row in named} == {"fan"}


def test_ranges_of_a_misfire_are_restrictions_and_late_ranges_are_not_accepted(
    tmp_path,
):
    train = jaxhb.load_scene(line(tmp_path, ""))
    judged = jaxhb.strength(
        jaxhb.forced_response(train, rpm=np.linspace(300.0, 960.0, 12))
    )

    def told(strength):
        return "\n".join(map(str, strength_text({"": strength})))

    assert "Barred speed ranges between" in told(judged)
    misfiring = dataclasses.replace(judged, not_firing=("cylinder 1",))
    assert "Restricted speed ranges between" in told(misfiring)
    assert "Restricted with this misfire and passed rapidly: " in told(misfiring)
    # At 500 rpm the same critical speed is above 0.8 of the rated speed.
    late = told(dataclasses.replace(judged, rated_rpm=500.0))
    assert "not accepted above 0.8 of the rated speed" in late
    assert "NOT accepted as a whole" in late
    assert "passed rapidly" not in late


def test_a_scene_that_is_written_elsewhere_takes_its_file_of_rules(tmp_path, run):
    path = line(tmp_path, f'rules = ["{FILE.name}"]')
    folder = tmp_path / "copy"
    folder.mkdir()
    run(f"scene {path} --out {folder / 'line.toml'}")
    assert (folder / FILE.name).read_text() == TEXT
    read = jaxhb.load_scene(folder / "line.toml").topology.rules
    assert read == jaxhb.load_scene(path).topology.rules
