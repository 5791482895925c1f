"""The pages show what the program prints: ``python docs/shown.py`` renews them."""

import ast
import re
import shlex
import sys
from pathlib import Path

import pytest
import shown
from printed import HAMMERING, ROUNDING, reads_alike, run_words, tolerance_of

SEARCHED = {"tune", "tolerance"}
"""Commands that search for minutes: ``python docs/shown.py --check`` alone compares
them.
"""

newest_jax = pytest.mark.skipif(
    sys.version_info < (3, 12), reason="the pages show what the newest jax gives"
)


def name_of(block):
    return block.command.split()[2]


@pytest.mark.slow
@newest_jax
@pytest.mark.parametrize(
    "page",
    [p for p in shown.pages() if set(map(name_of, shown.shown_on(p))) - SEARCHED],
    ids=lambda p: p.stem,
)
def test_a_page_shows_what_its_commands_print(page, tmp_path, monkeypatch):
    """In this process, whose programs its commands share."""
    shown.write_inputs(page, tmp_path)
    monkeypatch.chdir(tmp_path)
    for block in shown.shown_on(page):
        if name_of(block) in SEARCHED:
            continue
        status, output, refusal = run_words(shlex.split(block.command)[2:])
        assert status in (0, 1), refusal
        lines = shown.renewed(block.lines, output.rstrip("\n").splitlines())
        differing = [
            (a, b)
            for a, b in zip(block.lines, lines, strict=True)
            if not reads_alike(a, b, HAMMERING)
        ]
        assert not differing, f"{block.name()}: renew the page by python docs/shown.py"


@pytest.mark.parametrize(
    ("line", "share", "is_alike"),
    [
        ("  a|b  1.24 kN at 3 speeds", ROUNDING, True),
        ("  a|b  1.25 kN at 3 speeds", ROUNDING, False),
        ("  a|b  1.25 kN at 3 speeds", HAMMERING, True),
        ("  a|b  1.27 kN at 3 speeds", HAMMERING, False),
        ("  a|b  1.23 kN at 4 speeds", HAMMERING, False),
        ("  a|c  1.23 kN at 3 speeds", HAMMERING, False),
    ],
)
def test_a_changed_number_count_or_word_is_seen(line, share, is_alike):
    assert reads_alike("  a|b  1.23 kN at 3 speeds", line, share) == is_alike


def test_lines_left_out_are_found_again_by_their_words():
    output = ["head 1", "a 2", "b 3", "c 4", "tail 5"]
    assert shown.renewed(["head 9", "...", "c 9", "..."], output) == [
        "head 1",
        "...",
        "c 4",
        "...",
    ]
    assert shown.renewed(["...", "b 7", "c 8", "tail 9"], output) == [
        "...",
        "b 3",
        "c 4",
        "tail 5",
    ]
    with pytest.raises(ValueError, match="reads like 'd 9'"):
        shown.renewed(["head 1", "...", "d 9"], output)


def test_how_long_a_run_took_stays_as_it_is_shown():
    assert shown.renewed(["done in 55 s; 3 steps"], ["done in 61 s; 3 steps"]) == [
        "done in 55 s; 3 steps"
    ]
    assert shown.renewed(["done in 55 s; 3 steps"], ["done in 61 s; 4 steps"]) == [
        "done in 61 s; 4 steps"
    ]


def test_pages_with_output_are_found():
    names = {Path(page).stem for page in shown.pages()}
    assert names >= {
        "README",
        "first_scene",
        "timing_gears",
        "tune",
        "tolerances",
        "trust",
        "strength",
        "linear",
    }
    blocks = [block for page in shown.pages() for block in shown.shown_on(page)]
    assert all(re.match(r"\$ jaxhb \w+ ", block.command) for block in blocks)


@pytest.mark.slow
@newest_jax
def test_python_gives_the_numbers_that_the_readme_says_it_gives():
    """Compares each expression whose comment begins with a number; a derivative, which
    compiles for long, says none.
    """
    readme = shown.ROOT.joinpath("README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    names = {}
    values = {}
    for statement in ast.parse(block).body:
        source = ast.get_source_segment(block, statement)
        line = block.splitlines()[statement.end_lineno - 1]
        comment = re.match(r"\s*# (?=\d)(\S+)", line.partition(source)[2])
        if comment:
            values[comment[1]] = eval(source, names)  # noqa: S307
        elif not isinstance(statement, ast.Expr):
            exec(source, names)
    assert len(values) == 2
    for number, value in values.items():
        assert abs(float(number) - value) <= tolerance_of(number, HAMMERING)
