"""``jaxhb tolerance``: tables, files, what was kept, and what is refused."""

import dataclasses

import numpy as np
import pytest
from reference_data import reference, text_of

import jaxhb
from jaxhb.design.evaluation import Evaluator

SCENE = text_of("toleranced_pair.toml")


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "pair.toml"
    path.write_text(SCENE, encoding="utf-8")
    return path


@pytest.mark.slow
def test_the_worst_case_is_told_and_written(scene, run):
    called = run(
        f"tolerance {scene} --rpm 900:1200:4 --samples 16",
        "json",
        "csv",
        "netcdf",
        "plot",
    )
    assert called.status == 0 and called.is_drawn
    (one,) = called.json["quantities"]
    assert one["name"] == "shaft torque of a|b" and one["unit"] == "N m"
    assert all(
        worst >= nominal
        for worst, nominal in zip(one["worst"], one["nominal"], strict=True)
    )
    assert all(
        worst <= bound < 1.03 * worst
        for worst, bound in zip(one["worst"], one["bound"], strict=True)
    )
    assert one["no_bound"] == [""] * 4 and "at most" in called.out
    assert (
        "No train within the tolerances has more than stands under 'at most'."
        in called.out
    )
    # The resonance is inside the range at 900 rpm and at its end at 1200.
    stiffness = np.array(one["numbers_at_worst"])[:, 0]
    assert 5.7e3 < stiffness[0] < 7.7e3 and stiffness[-1] == 7.7e3
    rows = called.rows
    assert [float(row["worst"]) for row in rows] == one["worst"] and len(rows) == 4
    assert [float(row["bound"]) for row in rows] == one["bound"] and rows[0][
        "no bound"
    ] == ""
    assert (
        called.json["kind"] == ["periodic"] * 4 and called.json["solved"] == [1.0] * 4
    )
    import xarray

    with xarray.open_dataset(called.path("netcdf")) as data:
        np.testing.assert_array_equal(data.worst.values[:, 0], one["worst"])
        np.testing.assert_array_equal(data.bound.values[:, 0], one["bound"])
        assert data.unit.values.tolist() == ["N m"] and data.sample.shape == (4, 16, 1)
    largest = called.json["rpm"][int(np.argmax(one["worst"]))]
    head = next(
        line
        for line in called.out.splitlines()
        if line.startswith("  shaft torque of a|b, N m")
    )
    assert head.split()[-2] == f"{largest:g}"


def same(one, other):
    """Whether two Spreads hold the same numbers to the last bit."""
    for field in dataclasses.fields(one):
        if field.name not in ("train", "of", "tolerances"):
            np.testing.assert_array_equal(
                getattr(one, field.name), getattr(other, field.name), field.name
            )


@pytest.mark.slow
def test_a_search_goes_on_where_it_was_stopped_with_the_same_numbers(
    scene, tmp_path, monkeypatch
):
    """Stopped after every third part: what it had found is not solved again."""
    train = jaxhb.load_scene(scene)
    rpm = np.linspace(900.0, 1200.0, 9)
    asked = {"samples": 4, "seed": 0, "harmonics": 4}
    whole = jaxhb.tolerance(train, rpm=rpm, **asked)
    solved, at_once = Evaluator.solved, []

    def counted(self, z, *args, **options):
        at_once.append(len(z))
        if at_once.count(None) < 12 and len(at_once) % 4 == 0:
            at_once.append(None)
            raise KeyboardInterrupt
        return solved(self, z, *args, **options)

    monkeypatch.setattr(Evaluator, "solved", counted)
    stops = 0
    again = None
    while again is None:
        try:
            again = jaxhb.tolerance(train, rpm=rpm, **asked, out=tmp_path / "kept")
        except KeyboardInterrupt:
            stops += 1
    assert 2 < stops < 13
    same(again, whole)
    monkeypatch.setattr(Evaluator, "solved", None)
    same(jaxhb.tolerance(train, rpm=rpm, **asked, out=tmp_path / "kept"), whole)


@pytest.mark.slow
def test_the_command_finds_what_the_function_finds_however_many_the_speeds(scene, run):
    """More than are solved together; and with other speeds that begin alike nothing of
    these comes back.
    """
    rpm = np.linspace(900.0, 1200.0, 10)
    called = run(f"tolerance {scene} --rpm 900:1200:10 --harmonics 4", "json")
    found = jaxhb.tolerance(jaxhb.load_scene(scene), rpm=rpm, harmonics=4)
    (one,) = called.json["quantities"]
    assert (
        one["worst"] == found.worst[:, 0].tolist()
        and one["bound"] == found.bound[:, 0].tolist()
    )


@pytest.mark.slow
def test_a_cache_that_cannot_be_written_is_told_before_the_work_which_goes_on(
    scene, run, tmp_path, monkeypatch
):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("JAXHB_CACHE", str(tmp_path / "file"))
    called = run(f"tolerance {scene} --rpm 900 --harmonics 4", "json")
    assert called.status == 0 and called.json["quantities"][0]["worst"][0] > 0
    assert (
        called.err.count("is not kept on disk") == 1 and "Traceback" not in called.err
    )


@pytest.mark.parametrize(("line", "sentence"), reference("cases")["tolerances"])
def test_what_cannot_be_asked_is_refused_in_a_sentence(scene, run, line, sentence):
    called = run(f"tolerance {scene} --rpm 900 {line}")
    assert called.status == 2 and sentence in called.err


@pytest.mark.slow
def test_the_page_of_a_report_has_the_worst_cases(scene, run, tmp_path):
    pytest.importorskip("plotly")
    page = tmp_path / "page.html"
    called = run(f"report {scene} --rpm 900,1000 --tolerances --html {page}")
    text = page.read_text(encoding="utf-8")
    assert (
        called.status == 0
        and "Worst case over the tolerances" in text
        and "worst case found" in text
    )
    called = run(f"report {scene} --rpm 900,1000 --tolerances")
    assert (
        called.status == 2
        and "--tolerances: they appear on the page only" in called.err
    )


@pytest.mark.slow
def test_no_share_of_a_limit_is_told_where_the_rule_has_none(tmp_path, run):
    """At 1.05 of the rated speed, 126 rpm, the rule ends: 140 rpm has a stress, but no
    limit.
    """
    path = tmp_path / "line.toml"
    name = "stress over continuous limit of shaft"
    path.write_text(
        text_of("propeller_shaft.toml")
        + '\n[tolerance]\n"shaft.outer" = { share = 0.01 }\n'
    )
    line = (
        f'tolerance {path} --rpm 100,120,140 --samples 4 --of "{name}" --of "stress of'
        ' shaft"'
    )
    called = run(line, "json", "csv", "netcdf", "plot")
    assert called.status == 0 and called.is_drawn
    share, stress = called.json["quantities"]
    limits = jaxhb.strength(
        jaxhb.forced_response(
            jaxhb.load_scene(path), rpm=np.array([100.0, 120.0, 140.0])
        )
    )
    judged = limits.stresses["shaft"]
    np.testing.assert_allclose(
        share["nominal"][:2], (judged.stress / judged.continuous)[:2], rtol=1e-3
    )
    np.testing.assert_allclose(stress["nominal"], judged.stress, rtol=1e-3)
    for key in ("nominal", "worst", "slopes", "effects", "numbers_at_worst"):
        assert np.ravel(share[key][2]).tolist() == [None]
        assert None not in np.ravel(share[key][:2]).tolist()
    assert None not in stress["worst"]
    assert share["percentiles"]["95"][2] is None and share["percentiles"]["95"][0] > 0
    assert (share["judged"], stress["judged"]) == ([True, True, False], [True] * 3)
    assert share["no_bound"][2] == "the rule of the shaft has no limit there"
    assert called.json["solved"] == [1.0] * 3  # of the sample
    beyond = [
        row
        for row in called.rows
        if row["rpm"].startswith("140") and row["quantity"] == name
    ]
    assert [row["worst"] for row in beyond] == [""] and beyond[0]["judged"] == "False"
    assert (
        f"NOT judged, as the rule has no limit there: {name} at 140 rpm." in called.out
    )
    assert "NOT solved" not in called.out
    import xarray

    with xarray.open_dataset(called.path("netcdf")) as data:
        assert (
            np.isnan(data.worst.values[2, 0])
            and np.isnan(data["sample"].values[2, :, 0]).all()
        )
    # Beyond the limit alone nothing is left to tell but that.
    called = run(f'tolerance {path} --rpm 140,150 --of "{name}"')
    assert (
        called.status == 0
        and f"{name} at 140, 150 rpm." in called.out
        and "Worst case" not in called.out
    )
