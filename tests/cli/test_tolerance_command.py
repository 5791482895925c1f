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
    import xarray

    line = f"tolerance {scene} --rpm 900:1200:4 --samples 16"
    completed = run(line, "json", "csv", "netcdf", "plot")
    record = completed.json
    (quantity,) = record["quantities"]
    assert quantity == quantity | {
        "name": "shaft torque of a|b",
        "unit": "N m",
        "no_bound": [""] * 4,
    }
    worst = np.array(quantity["worst"])
    bound = np.array(quantity["bound"])
    assert (worst >= quantity["nominal"]).all()
    assert (worst <= bound).all()
    assert (bound < 1.03 * worst).all()
    sentence = "No train within the tolerances has more than stands under 'at most'."
    assert sentence in completed.out
    # The resonance is inside the range at 900 rpm and at its end at 1200.
    stiffness = np.array(quantity["numbers_at_worst"])[:, 0]
    assert 5.7e3 < stiffness[0] < 7.7e3
    assert stiffness[-1] == 7.7e3
    rows = completed.rows
    assert [float(row["worst"]) for row in rows] == quantity["worst"]
    assert [float(row["bound"]) for row in rows] == quantity["bound"]
    assert rows[0]["no bound"] == ""
    assert record == record | {"kind": ["periodic"] * 4, "solved": [1.0] * 4}
    with xarray.open_dataset(completed.path("netcdf")) as data:
        np.testing.assert_array_equal(data.worst.values[:, 0], worst)
        np.testing.assert_array_equal(data.bound.values[:, 0], bound)
        assert data.unit.values.tolist() == ["N m"]
        assert data.sample.shape == (4, 16, 1)
    head = "  shaft torque of a|b, N m"
    (row,) = [line for line in completed.out.splitlines() if line.startswith(head)]
    assert row.split()[-2] == f"{record['rpm'][worst.argmax()]:g}"


def same(spread, other):
    """Whether two Spreads hold the same numbers to the last bit."""
    for field in dataclasses.fields(spread):
        if field.name not in ("train", "of", "tolerances"):
            np.testing.assert_array_equal(
                getattr(spread, field.name), getattr(other, field.name), field.name
            )


@pytest.mark.slow
def test_a_search_goes_on_where_it_was_stopped_with_the_same_numbers(
    scene, tmp_path, monkeypatch
):
    """Stopped after every third part: what it had found is not solved again."""
    train = jaxhb.load_scene(scene)

    def search(out=None):
        rpm = np.linspace(900.0, 1200.0, 9)
        return jaxhb.tolerance(train, rpm=rpm, samples=4, seed=0, harmonics=4, out=out)

    whole = search()
    solved = Evaluator.solved
    at_once = []

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
            again = search(out=tmp_path / "kept")
        except KeyboardInterrupt:
            stops += 1
    assert 2 < stops < 13
    same(again, whole)
    monkeypatch.setattr(Evaluator, "solved", None)
    same(search(out=tmp_path / "kept"), whole)


@pytest.mark.slow
def test_the_command_finds_what_the_function_finds_however_many_the_speeds(scene, run):
    """More than are solved together; and with other speeds that begin alike nothing of
    these comes back.
    """
    rpm = np.linspace(900.0, 1200.0, 10)
    completed = run(f"tolerance {scene} --rpm 900:1200:10 --harmonics 4", "json")
    spread = jaxhb.tolerance(jaxhb.load_scene(scene), rpm=rpm, harmonics=4)
    (quantity,) = completed.json["quantities"]
    assert quantity["worst"] == spread.worst[:, 0].tolist()
    assert quantity["bound"] == spread.bound[:, 0].tolist()


@pytest.mark.slow
def test_a_cache_that_cannot_be_written_is_told_before_the_work_which_goes_on(
    scene, run, tmp_path, monkeypatch
):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("JAXHB_CACHE", str(tmp_path / "file"))
    completed = run(f"tolerance {scene} --rpm 900 --harmonics 4", "json")
    assert completed.json["quantities"][0]["worst"][0] > 0
    assert completed.err.count("is not kept on disk") == 1
    assert "Traceback" not in completed.err


@pytest.mark.parametrize(("line", "sentence"), reference("cases")["tolerances"])
def test_what_cannot_be_asked_is_refused_in_a_sentence(scene, run, line, sentence):
    assert sentence in run(f"tolerance {scene} --rpm 900 {line}", status=2).err


@pytest.mark.slow
def test_the_page_of_a_report_has_the_worst_cases(scene, run, tmp_path):
    pytest.importorskip("plotly")
    page = tmp_path / "page.html"
    line = f"report {scene} --rpm 900,1000 --tolerances"
    run(f"{line} --html {page}")
    text = page.read_text(encoding="utf-8")
    assert "Worst case over the tolerances" in text
    assert "worst case found" in text
    assert "--tolerances: they appear on the page only" in run(line, status=2).err


SHARE = "stress over continuous limit of shaft"


@pytest.fixture
def limited(tmp_path):
    """A shaft whose rule ends at 1.05 of the rated speed, 126 rpm: 140 rpm has a
    stress, but no limit.
    """
    path = tmp_path / "line.toml"
    tolerance = '\n[tolerance]\n"shaft.outer" = { share = 0.01 }\n'
    path.write_text(text_of("propeller_shaft.toml") + tolerance)
    return path


@pytest.mark.slow
def test_no_share_of_a_limit_is_told_where_the_rule_has_none(limited, run):
    import xarray

    line = f'tolerance {limited} --rpm 100,120,140 --samples 4 --of "{SHARE}"'
    completed = run(f'{line} --of "stress of shaft"', "json", "csv", "netcdf", "plot")
    record = completed.json
    share, stress = record["quantities"]
    rpm = np.array([100.0, 120.0, 140.0])
    response = jaxhb.forced_response(jaxhb.load_scene(limited), rpm=rpm)
    judged = jaxhb.strength(response).stresses["shaft"]
    expected = (judged.stress / judged.continuous)[:2]
    np.testing.assert_allclose(share["nominal"][:2], expected, rtol=1e-3)
    np.testing.assert_allclose(stress["nominal"], judged.stress, rtol=1e-3)
    for key in ("nominal", "worst", "slopes", "effects", "numbers_at_worst"):
        assert np.ravel(share[key][2]).tolist() == [None]
        assert None not in np.ravel(share[key][:2]).tolist()
    assert None not in stress["worst"]
    percentile = share["percentiles"]["95"]
    assert percentile[2] is None
    assert percentile[0] > 0
    assert share["judged"] == [True, True, False]
    assert stress["judged"] == [True] * 3
    assert share["no_bound"][2] == "the rule of the shaft has no limit there"
    assert record["solved"] == [1.0] * 3  # of the sample
    (beyond,) = [
        row
        for row in completed.rows
        if row["rpm"].startswith("140") and row["quantity"] == SHARE
    ]
    assert (beyond["worst"], beyond["judged"]) == ("", "False")
    sentence = f"NOT judged, as the rule has no limit there: {SHARE} at 140 rpm."
    assert sentence in completed.out
    assert "NOT solved" not in completed.out
    with xarray.open_dataset(completed.path("netcdf")) as data:
        assert np.isnan(data.worst.values[2, 0])
        assert np.isnan(data["sample"].values[2, :, 0]).all()


@pytest.mark.slow
def test_beyond_the_limit_nothing_is_left_to_tell_but_that(limited, run):
    completed = run(f'tolerance {limited} --rpm 140,150 --of "{SHARE}"')
    completed.check_printed("tolerance_beyond_limit")
