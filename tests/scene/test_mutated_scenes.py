"""Scenes changed at random are trains, or are refused in sentences."""

import copy
import math

import numpy as np
import pytest
import tomlkit
from click.testing import CliRunner
from reference_data import DATA

import jaxhb
from jaxhb.cli.main import program

EVENTS = str(DATA / "scenes" / "events.toml")
SCENES = ("first_scene", "engine_with_damper", "inline_four_timing_drive", EVENTS)
COUNT = 60  # mutations of each scene
VALUES = (
    *(0, -1, 1, 2, 1e300, -1e300, 1e-300, math.nan, math.inf, 1e6, 10**400),
    *("", "x", "\u0000", "crank", "=1+1", "a" * 100_000, True),
    *([], [[]], [1.0], [[1.0, 2.0]], [["a", 1, 2]], {}, {"a": 1}),
)
MOST_SENTENCES = 13  # a dozen, and how many more there are


def leaves(table, path=()):
    """Paths to all values of a scene."""
    rows = table.items() if isinstance(table, dict) else enumerate(table)
    for key, value in rows:
        yield (*path, key)
        if isinstance(value, dict) or (
            isinstance(value, list) and value and isinstance(value[0], dict)
        ):
            yield from leaves(value, (*path, key))


def mutated(scene, random):
    """A copy of a scene in which one value is replaced, removed, renamed or
    repeated.
    """
    changed = copy.deepcopy(scene)
    paths = list(leaves(changed))
    *outer, key = paths[random.integers(len(paths))]
    table = changed
    for part in outer:
        table = table[part]
    way = random.integers(6)
    if way == 0:
        del table[key]
    elif way == 1 and isinstance(table, list):
        table.append(copy.deepcopy(table[key]))
    elif way == 1:
        table[f"{key}x"] = table.pop(key)
    else:
        table[key] = copy.deepcopy(VALUES[random.integers(len(VALUES))])
    return changed


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_a_mutated_scene_is_read_or_refused_in_a_few_short_sentences(name, tmp_path):
    file = tmp_path / "sound.toml"
    written = CliRunner().invoke(program, ["scene", name, "--out", str(file)])
    assert written.exit_code == 0
    sound = tomlkit.parse(file.read_text(encoding="utf-8")).unwrap()
    random = np.random.default_rng(20261126)
    refused = 0
    for number in range(COUNT):
        changed = mutated(sound, random)
        path = tmp_path / "changed.toml"
        path.write_text(tomlkit.dumps(changed), encoding="utf-8")
        try:
            jaxhb.plausibility(jaxhb.load_scene(path))
        except jaxhb.SceneError as error:
            refused += 1
            lines = str(error).splitlines()
            assert len(lines) <= MOST_SENTENCES, number
            assert all(len(line) < 1000 for line in lines), number
    assert 10 <= refused < COUNT
