"""Tables of laboratories and spreadsheets have one meaning, whatever separates columns
and marks decimals.
"""

import math

import pytest

from jaxhb.elements.sentences import SceneError
from jaxhb.scene.csv_tables import number_rows

COLUMNS = "angle", "pressure"
UNITS = "deg", "Pa"
ROWS = ((0.0, 1.0e5), (180.0, 1.5e5), (340.0, 38e5), (720.0, 1.0e5))
WAYS_TO_WRITE = {
    "header": "crank_deg,p_Pa\n0,1.0e5\n180,1.5e5\n340,38e5\n720,1.0e5\n",
    "semicolons and decimal commas": (
        "crank angle;pressure\n0;1,0e5\n180;1,5e5\n340;38e5\n720;1,0e5\n"
    ),
    "semicolons and points": "0;1.0e5\n180;1.5e5\n340;38e5\n720;1.0e5\n",
    "tabs": "0\t1.0e5\n180\t1.5e5\n340\t38e5\n720\t1.0e5\n",
    "tabs and decimal commas": "0,0\t1,0e5\n180\t1,5e5\n340\t38e5\n720\t1,0e5\n",
    "blanks": "  0 1.0e5\n180   1.5e5\n340 38e5\n720 1.0e5",
    "blanks and decimal commas": "0 1,0e5\n180 1,5e5\n340 3800000,0\n720 1,0e5",
    "commas and blanks": "0, 1.0e5\n180, 1.5e5\n340, 38e5\n720, 1.0e5",
    "quoted decimal commas": (
        '"0","1,0e5"\n"180","1,5e5"\n"340","38e5"\n"720","1,0e5"\n'
    ),
    "named by a spreadsheet": (
        "sep=;\ncrank angle;pressure\n0;1,0e5\n180;1,5e5\n340;38e5\n720;1,0e5\n"
    ),
    "names, units and remarks": (
        "# test bed"
        " 3\ncrank;pressure\ndeg;Pa\n\n0;1,0e5;\n180;1,5e5\n340;38e5\n720;1,0e5\n"
    ),
    "columns in the other order": (
        "pressure Pa,angle deg\n1.0e5,0\n1.5e5,180\n38e5,340\n1.0e5,720\n"
    ),
}


@pytest.mark.parametrize("text", WAYS_TO_WRITE.values(), ids=WAYS_TO_WRITE)
def test_a_table_has_the_same_rows_however_it_is_written(text):
    assert number_rows(text, COLUMNS, "p.csv", units=UNITS) == ROWS


HEADS = {
    "angle [deg];pressure [Pa]": (1.0, 1.0),
    "crank angle in rad;pressure in bar": (180 / math.pi, 1e5),
    "angle [°CA];pressure [MPa]": (1.0, 1e6),
    "angle_rad;p_mpa": (180 / math.pi, 1e6),
    "angle (of crank);pressure (N/mm2)": (1.0, 1e6),
    "angle;pressure in cylinder 1": (1.0, 1.0),
}


@pytest.mark.parametrize(("heads", "factors"), HEADS.items())
def test_a_head_that_names_a_unit_converts_its_column(heads, factors):
    rows = number_rows(f"{heads}\n2;3\n", COLUMNS, "p.csv", units=UNITS)
    assert rows == (pytest.approx((2 * factors[0], 3 * factors[1]), rel=1e-15),)


def test_three_columns_with_heads_that_are_parts_of_words_keep_their_order():
    text = "order,pressure_real,imaginary\n0.5,1,2\n"
    assert number_rows(text, ("order", "Re", "Im"), "h.csv") == ((0.5, 1.0, 2.0),)


REFUSED = {
    "0;1,5\n180;2.5\n": (
        "p.csv, line 1: '1,5' has a comma, and in line 2 decimals have a point. Write"
        " decimals"
    ),
    "0\t101,325\n180\t101,325\n": (
        "p.csv, line 1: '101,325' may have decimals or thousands behind its comma."
    ),
    "0;1.000,5\n": "p.csv, line 1: '1.000,5' has several marks.",
    "0;1,000,500\n": "p.csv, line 1: '1,000,500' has several marks.",
    "0,1,5\n180,2,5\n": (
        "p.csv, line 1 is '0, 1, 5', must be 2 numbers angle, pressure, separated by"
        " commas, or"
    ),
    "0,1e5\n180,one\n": "p.csv, line 2 is '180, one', must be 2 numbers",
    "angle;p in kN\n0;1\n": (
        "p.csv, line 1: the head of pressure is 'p in kN', must be in Pa or a unit like"
        " it. Known: Pa, MPa,"
    ),
    "angle;pressure [bra]\n0;1\n": (
        "p.csv, line 1: the head of pressure is 'pressure [bra]', whose unit is not"
        " known, must be in Pa or a unit like it. Did you mean 'bar'?"
    ),
    "some words\nand others\n": (
        "p.csv holds no rows. Give angle, pressure on each line."
    ),
    "": "p.csv holds no rows.",
}


@pytest.mark.parametrize(("text", "begin"), REFUSED.items())
def test_what_may_mean_two_things_is_refused_in_a_sentence(text, begin):
    with pytest.raises(SceneError) as caught:
        number_rows(text, COLUMNS, "p.csv", units=UNITS)
    assert str(caught.value).startswith(begin)
    assert len(caught.value.sentences) == 1


@pytest.mark.parametrize("text", REFUSED)
def test_a_sentence_quotes_nothing_of_a_file_that_is_not_to_be_quoted(text):
    with pytest.raises(SceneError) as caught:
        number_rows(text, COLUMNS, "p.csv", units=UNITS, quoted=False)
    cells = ("1,5", "101,325", "1.000,5", "1,000,500", "one", "kN", "bra")
    assert not any(cell in str(caught.value) for cell in cells)
