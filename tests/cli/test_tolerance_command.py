"""``jaxhb tolerance``: tables, files, what was kept, and what is refused."""

import numpy as np
import pytest
from reference_data import reference, text_of

import jaxhb
from jaxhb.cli.tolerance_command import _part
from jaxhb.design import Objective, read_tolerances

SCENE = text_of("toleranced_pair.toml")


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "pair.toml"
    path.write_text(SCENE, encoding="utf-8")
    return path


def test_the_worst_case_is_told_and_written(scene, run):
    called = run(f"tolerance {scene} --rpm 900:1200:4 --samples 16", "json", "csv", "netcdf", "plot")
    assert called.status == 0 and called.is_drawn
    (one,) = called.json["quantities"]
    assert one["name"] == "shaft torque of a|b" and one["unit"] == "N m"
    assert all(worst >= nominal for worst, nominal in zip(one["worst"], one["nominal"], strict=True))
    assert all(worst <= bound < 1.03 * worst for worst, bound in zip(one["worst"], one["bound"], strict=True))
    assert one["no_bound"] == [""] * 4 and "at most" in called.out
    assert "No train within the tolerances has more than stands under 'at most'." in called.out
    # The resonance is inside the range at 900 rpm and at its end at 1200.
    stiffness = np.array(one["numbers_at_worst"])[:, 0]
    assert 5.7e3 < stiffness[0] < 7.7e3 and stiffness[-1] == 7.7e3
    rows = called.rows
    assert [float(row["worst"]) for row in rows] == one["worst"] and len(rows) == 4
    assert [float(row["bound"]) for row in rows] == one["bound"] and rows[0]["no bound"] == ""
    assert called.json["kind"] == ["contact"] * 4 and called.json["solved"] == [1.0] * 4
    import xarray

    with xarray.open_dataset(called.path("netcdf")) as data:
        np.testing.assert_array_equal(data.worst.values[:, 0], one["worst"])
        np.testing.assert_array_equal(data.bound.values[:, 0], one["bound"])
        assert data.unit.values.tolist() == ["N m"] and data.sample.shape == (4, 16, 1)
    largest = called.json["rpm"][int(np.argmax(one["worst"]))]
    head = next(line for line in called.out.splitlines() if line.startswith("  shaft torque of a|b, N m"))
    assert head.split()[-2] == f"{largest:g}"


def test_what_is_kept_of_some_speeds_is_not_computed_again(scene, tmp_path, monkeypatch):
    train = jaxhb.load_scene(scene)
    torque = (Objective(quantity="shaft torque", of="a|b"),)
    asked = {"of": torque, "tolerances": read_tolerances(train), "samples": 0, "seed": 0, "harmonics": 4}
    first = _part(train, [900.0, 1000.0], asked, tmp_path / "kept")
    monkeypatch.setattr("jaxhb.cli.tolerance_command.search", None)
    again = _part(train, [900.0, 1000.0], asked, tmp_path / "kept")
    np.testing.assert_array_equal(again.worst, first.worst)
    np.testing.assert_array_equal(again.bound, first.bound)
    assert again.values(0, 0) == first.values(0, 0) and again.evaluations == first.evaluations


@pytest.mark.parametrize(("line", "sentence"), reference("cases")["tolerances"])
def test_what_cannot_be_asked_is_refused_in_a_sentence(scene, run, line, sentence):
    called = run(f"tolerance {scene} --rpm 900 {line}")
    assert called.status == 2 and sentence in called.err


def test_the_page_of_a_report_has_the_worst_cases(scene, run, tmp_path):
    pytest.importorskip("plotly")
    page = tmp_path / "page.html"
    called = run(f"report {scene} --rpm 900,1000 --tolerances --html {page}")
    text = page.read_text(encoding="utf-8")
    assert called.status == 0 and "Worst case over the tolerances" in text and "worst case found" in text
    called = run(f"report {scene} --rpm 900,1000 --tolerances")
    assert called.status == 2 and "--tolerances: they appear on the page only" in called.err
