"""The pages show what the program prints: ``python docs/shown.py`` renews them."""

import ast
import re
from pathlib import Path

import pytest
import shown

SLOW = {"tune", "tolerance", "identify", "sweep", "solve"}
"""Commands that compile much: their output is compared with the tests marked "oracle"."""
LAST_DIGIT = 1.0  # units by which a number may differ: other versions of jax round otherwise
SEARCHED = 0.1  # share by which the result of a search may differ: it stops where the next step wins little


def number_pairs(old, new):
    return zip(shown.NUMBER.findall(old), shown.NUMBER.findall(new), strict=True)


def unit_of_last_digit(number):
    digits, _, exponent = number.partition("e")
    decimals = len(digits.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals)


def reads_alike(old, new, share):
    """Whether two lines differ by rounding alone, or by a share of their numbers."""
    if shown.words_of(old) != shown.words_of(new):
        return False
    return all(
        abs(float(a) - float(b)) <= 1.001 * LAST_DIGIT * unit_of_last_digit(a) + share * abs(float(a))
        for a, b in number_pairs(old, new)
    )


def compare(page, folder, slow):
    """Run the quick or the slow commands of a page and compare what it shows."""
    shown.write_inputs(page, folder)
    for block in shown.shown_on(page):
        name = block.command.split()[2]
        if name in SLOW and not slow:
            continue
        lines = shown.renewed(block.lines, shown.printed(block.command, folder))
        if (name in SLOW) is slow:
            share = SEARCHED if name in {"tune", "tolerance"} else 0.0
            differing = [(a, b) for a, b in zip(block.lines, lines, strict=True) if not reads_alike(a, b, share)]
            assert not differing, f"{block.name()}: renew the page by python docs/shown.py"


def names_of(page):
    return {block.command.split()[2] for block in shown.shown_on(page)}


@pytest.mark.parametrize("page", [p for p in shown.pages() if names_of(p) - SLOW], ids=lambda p: p.stem)
def test_a_page_shows_what_its_quick_commands_print(page, tmp_path):
    compare(page, tmp_path, slow=False)


@pytest.mark.oracle
@pytest.mark.parametrize("page", [p for p in shown.pages() if names_of(p) & SLOW], ids=lambda p: p.stem)
def test_a_page_shows_what_its_slow_commands_print(page, tmp_path):
    compare(page, tmp_path, slow=True)


def test_a_changed_number_or_word_is_seen():
    assert reads_alike("  a|b  1.23 kN", "  a|b  1.24 kN", 0.0)
    assert not reads_alike("  a|b  1.23 kN", "  a|b  1.25 kN", 0.0)
    assert not reads_alike("  a|b  1.23 kN", "  a|c  1.23 kN", 0.0)


def test_lines_left_out_are_found_again_by_their_words():
    output = ["head 1", "a 2", "b 3", "c 4", "tail 5"]
    assert shown.renewed(["head 9", "...", "c 9", "..."], output) == ["head 1", "...", "c 4", "..."]
    assert shown.renewed(["...", "b 7", "c 8", "tail 9"], output) == ["...", "b 3", "c 4", "tail 5"]
    with pytest.raises(ValueError, match="reads like 'd 9'"):
        shown.renewed(["head 1", "...", "d 9"], output)


def test_how_long_a_run_took_stays_as_it_is_shown():
    assert shown.renewed(["done in 55 s; 3 steps"], ["done in 61 s; 3 steps"]) == ["done in 55 s; 3 steps"]
    assert shown.renewed(["done in 55 s; 3 steps"], ["done in 61 s; 4 steps"]) == ["done in 61 s; 4 steps"]


def test_pages_with_output_are_found():
    names = {Path(page).stem for page in shown.pages()}
    assert names >= {"README", "first_scene", "timing_gears", "tune", "tolerances", "trust", "strength", "linear"}
    assert all(re.match(r"\$ jaxhb \w+ ", b.command) for page in shown.pages() for b in shown.shown_on(page))


@pytest.mark.oracle
def test_python_gives_the_numbers_that_the_readme_says_it_gives():
    """Each expression whose comment begins with a number; a derivative, which compiles for long, says none."""
    (block,) = re.findall(
        r"```python\n(.*?)```", shown.ROOT.joinpath("README.md").read_text(encoding="utf-8"), re.DOTALL
    )
    names, told = {}, {}
    for statement in ast.parse(block).body:
        source = ast.get_source_segment(block, statement)
        comment = re.match(r"\s*# (?=\d)(\S+)", block.splitlines()[statement.end_lineno - 1].partition(source)[2])
        if comment:
            told[comment[1]] = eval(source, names)  # noqa: S307
        elif not isinstance(statement, ast.Expr):
            exec(source, names)
    assert len(told) == 2
    for number, value in told.items():
        assert abs(float(number) - value) <= LAST_DIGIT * unit_of_last_digit(number)
