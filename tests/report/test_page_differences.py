"""Differences of two designs on the page."""

import pytest
from page_cases import SCENE
from reference_data import reference, text_of

import jaxhb
from jaxhb.report.page.differences import differences
from jaxhb.scene.writer import elements_of

BURNING = text_of("third_cylinder.toml")
TWO = SCENE + BURNING
CHANGES = reference("cases")["differences of two designs"]


def differences_of(tmp_path, first, second):
    """Differences of two designs that the page shows."""
    trains = []
    elements = []
    for text in (first, second):
        path = tmp_path / "scene.toml"
        path.write_text(text, encoding="utf-8")
        trains.append(jaxhb.load_scene(path))
        elements.append(elements_of(path))
    return differences(trains, elements)


@pytest.mark.parametrize(
    ("before", "after", "row"), CHANGES, ids=[row[0] for *_, row in CHANGES]
)
def test_every_difference_of_two_designs_is_a_row(tmp_path, before, after, row):
    assert before in TWO
    (table,) = differences_of(tmp_path, TWO, TWO.replace(before, after, 1))
    assert [list(cells) for cells in zip(*table.columns, strict=True)] == [row]


def test_nothing_differs_only_where_everything_is_equal(tmp_path):
    assert differences_of(tmp_path, TWO, TWO.replace("Prüfstand", "Anlage"))[
        0
    ].startswith("Nothing differs")
    first = BURNING.replace("three", "four")
    second = BURNING
    (sentence,) = differences_of(
        tmp_path, SCENE + first + second, SCENE + second + first
    )
    assert sentence.startswith(
        "Same parameters, tables and words of the elements, in another order or with other"
        " cylinder "
    )
