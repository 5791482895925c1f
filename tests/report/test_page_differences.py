"""What the page says of two designs that differ."""

import pytest
from page_cases import SCENE
from reference_data import reference, text_of

import jaxhb
from jaxhb.report.page.differences import differences
from jaxhb.scene.writer import elements_of

BURNING = text_of("third_cylinder.toml")
TWO = SCENE + BURNING
CHANGES = reference("cases")["differences of two designs"]


def told(tmp_path, *texts):
    """What the page tells of two designs."""
    designs = []
    for text in texts:
        (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
        designs.append(
            (
                jaxhb.load_scene(tmp_path / "scene.toml"),
                elements_of(tmp_path / "scene.toml"),
            )
        )
    return differences(*zip(*designs, strict=True))


@pytest.mark.parametrize(
    ("before", "after", "row"), CHANGES, ids=[row[0] for *_, row in CHANGES]
)
def test_whatever_differs_between_two_designs_is_told(tmp_path, before, after, row):
    assert before in TWO
    (table,) = told(tmp_path, TWO, TWO.replace(before, after, 1))
    assert [list(cells) for cells in zip(*table.columns, strict=True)] == [row]


def test_nothing_differs_only_where_everything_is_equal(tmp_path):
    assert told(tmp_path, TWO, TWO.replace("Prüfstand", "Anlage"))[0].startswith(
        "Nothing differs"
    )
    one = BURNING.replace("three", "four")
    two = BURNING
    (said,) = told(tmp_path, SCENE + one + two, SCENE + two + one)
    assert said.startswith(
        "Same numbers, tables and words of the elements, in another order or with other"
        " cylinder "
    )
