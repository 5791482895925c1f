"""A kind of excitation is one file: scenes, checks, trains and torques follow from it."""

import shutil
import subprocess
import sys
from pathlib import Path

import jaxhb

RIPPLE = '''
"""Motors: a torque with a ripple at one order of their own rotor."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb._jax import added
from jaxhb.elements.columns import collected
from jaxhb.elements.declared import declared, not_negative, positive, quantity
from jaxhb.elements.excitations.kind import Excitation, Seats
from jaxhb.excitation.tables import table


@dataclass(frozen=True, kw_only=True)
class Motor:
    """``[[motor]]``: mean + ripple cos(order theta) in N m."""

    disk: str = declared("disk")
    mean: float = quantity("N m", 0.0)
    ripple: float = not_negative("N m", 0.0)
    order: float = positive("", 1.0)
    name: str | None = declared("name", None)


@table
class Motors:
    mean: Any
    ripple: Any


class MotorKind(Excitation):
    element = Motor
    no_mean = ("ripple",)

    def mean_fields(self, element):
        return ("mean",)

    def needs(self, element, ratio, usable):
        if usable("order") and ratio is not None:
            yield f"order {element.order:g}", element.order * ratio, "mean"

    def seats(self, elements, names, disks, ratios, cycle):
        turns = [motor.order * ratio * cycle for motor, ratio in zip(elements, ratios)]
        return Seats(
            names=tuple(names),
            disk=tuple(disks),
            of_own_rotor=(True,) * len(elements),
            harmonics=tuple((round(turn),) for turn in turns),
        )

    def numbers(self, elements):
        return collected(Motors, Motor, elements)

    def means(self, numbers, seats, rpm):
        return np.ones(np.shape(rpm))[..., None] * numbers.mean

    def add_harmonics(self, torque, numbers, seats, rpm, ratios, turned):
        i = np.arange(len(seats.disk))
        n = np.array([n for (n,) in seats.harmonics], dtype=int)
        heard = n < torque.shape[-1]
        values = 0.5 * numbers.ripple * turned(i, n)
        places = (..., np.array(seats.disk, dtype=int)[heard], n[heard])
        return added(torque, places, values[..., heard])

    def highest(self, numbers, seats):
        rows = zip(seats.harmonics, numbers.ripple)
        return [n for (n,), ripple in rows if ripple > 0]


EXCITATION = MotorKind()
'''

SCENE = """
[scene]
name = "mill"
revolutions_per_cycle = 1
[[disk]]
name = "rotor"
inertia = 1.0
[[disk]]
name = "mill"
inertia = 2.0
[[shaft]]
between = ["rotor", "mill"]
stiffness = 1e4
[[load]]
disk = "mill"
[[motor]]
name = "drive"
disk = "rotor"
mean = 20.0
ripple = 6.0
order = 4
[[phase]]
name = "clutch"
of = ["drive"]
angle = 15.0
[scenario.rough]
"drive.ripple" = 9.0
"""

CHECKS = """
import sys
from pathlib import Path

import numpy as np

from jaxhb.elements.sentences import SceneError
from jaxhb.report.orders import order_names
from jaxhb.scene.files import load_scene
from jaxhb.scene.writer import elements_of, scene_text
from jaxhb.train.excitation import excitation, highest_harmonic, listed_harmonic

path = Path(sys.argv[1])
train = load_scene(path)
assert train.topology.parts_text == "2 disks, 1 shaft, 1 load, 1 motor, 1 phase"
torque, load, left = excitation(train, 1200.0, 5)
turned = 3.0 * np.exp(-1j * np.deg2rad(4 * 15.0))
np.testing.assert_allclose(torque[0], [20, 0, 0, 0, turned, 0], rtol=1e-14)
np.testing.assert_allclose(load, [-20.0], rtol=1e-14)
assert (highest_harmonic(train), listed_harmonic(train.topology)) == (4, 4)
assert listed_harmonic(train.repeated(3).topology) == 12
assert highest_harmonic(train.replace({"drive.ripple": 0.0})) == 1
assert train.scenario("rough").value("drive.ripple") == 9.0
assert train.without("drive").topology.parts_text == "2 disks, 1 shaft, 1 load"
assert "[[motor]]" in scene_text(path)[0]
assert elements_of(path)["drive"].ripple == 6.0
for wrong, sentence in {
    "order = 4.5": "order 4.5 is harmonic 4.5 of a cycle of 1 revolutions",
    "ripple = -1.0": "ripple is -1 N m, must be at least 0 N m",
}.items():
    key = wrong.split()[0]
    text = path.read_text()
    line = next(row for row in text.splitlines() if row.startswith(key + " ="))
    faulty = path.with_name("faulty.toml")
    faulty.write_text(text.replace(line, wrong))
    try:
        load_scene(faulty)
    except SceneError as error:
        assert sentence in str(error), error
    else:
        raise AssertionError(wrong)
"""


def test_a_file_in_the_folder_of_excitations_is_a_kind_that_scenes_may_hold(tmp_path):
    package = tmp_path / "jaxhb"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(jaxhb.__file__).parent, package, ignore=ignored)
    (package / "elements" / "excitations" / "motor.py").write_text(RIPPLE)
    scene = tmp_path / "mill.toml"
    scene.write_text(SCENE)
    subprocess.run(
        [sys.executable, "-c", CHECKS, str(scene)], cwd=tmp_path, check=True, timeout=60
    )
