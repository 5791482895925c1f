"""What the pages on files and the command line show is what the program takes and the data sets hold."""

import re
import shlex
from pathlib import Path

import pytest

import jaxhb
from jaxhb.show.cli import parser

PAGES = [Path(__file__).parents[2] / "docs" / "how_to" / name for name in ("data_and_files.md", "command_line.md")]


def blocks(page, language):
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_is_understood(page):
    lines = [shlex.split(line, comments=True) for block in blocks(page, "sh") for line in block.splitlines()]
    commands = [words[1 : words.index("|") if "|" in words else None] for words in lines if words[:1] == ["jaxhb"]]
    assert commands
    for words in commands:
        if not {"--help", "--version"} & set(words):
            parser().parse_args(words)


def test_every_variable_that_is_shown_is_in_a_data_set():
    pytest.importorskip("xarray")
    code = "\n".join(blocks(PAGES[0], "python"))
    shown = set(re.findall(r"data\.([a-z_]+)", code)) - {"where", "sel"}
    parts = [jaxhb.Disk(name="a", inertia=1.0), jaxhb.Disk(name="b", inertia=1.0)]
    parts += [jaxhb.Shaft(between=("a", "b"), stiffness=1e4, damping=1.0)]
    parts += [jaxhb.Torque(disk="a", harmonics=[(1.0, 1.0, 0.0)])]
    forced = jaxhb.forced_response(jaxhb.build(parts), rpm=[900.0])
    sets = forced.to_xarray(), jaxhb.linear_response(jaxhb.load_scene("spur_pair"), rpm=2000.0).to_xarray()
    assert shown and shown <= set(sets[0]) | set(sets[1])
    text = PAGES[0].read_text(encoding="utf-8")
    named = set(re.findall(r"`([a-z_]+)_\*`", text))
    assert named and all(any(f"{name}_max" in data for data in sets) for name in named)
