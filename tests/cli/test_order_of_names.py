"""A scene and its twin, in which every link names its ends in the other order: people
read the same of both.
"""

import dataclasses
import json
import re

import numpy as np
import pytest
from reference_data import text_of

import jaxhb
from jaxhb.report.figures import draw
from jaxhb.results.record import RecordedSignal

BETWEEN = re.compile(r'between = \["([^"]*)", "([^"]*)"\]')
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")
OF_A_FILE = (
    r"SHA-256 \w+|\d{4}-\d\d-\d\d \d\d:\d\d UTC"
    r"|[^\s'\"<>]*\b(scene|twin)(\b|_)[^\s'\"<>]*|\b\d+ s\b"
    r"|<script>.*?</script>|<style>.*?</style>|<details.*</details>|<svg.*?</svg>"
)
"""What differs by the file, the time and the scene as it is written; the lines of the
sketch begin at either end.
"""
ROUNDED = 2e-3
NOTHING = 1e-8
"""Of numbers that both have but for rounding to digits, and what is 0 but for
rounding.
"""

TRAINS = {
    "hammering": text_of("two_cylinders.toml")
    + """
[tune]
rpm = [3800, 4000]
steps = 1
[[tune.parameter]]
name = "Dämpfer.damping"
low = 1.0
high = 50.0
[[tune.objective]]
quantity = "tooth force peak"
of = "first link"
[tolerance]
"first link.stiffness" = { share = 0.1 }
"Welle.stiffness" = { share = 0.1 }
[scenario.idle]
"one.gas_torque_mean" = 20.0
"two.gas_torque_mean" = 20.0
""",
    "two engines": text_of("two_engines.toml"),
}
COMMANDS = (
    ("hammering", "check", ""),
    ("hammering", "solve --rpm 4000", "plot"),
    ("hammering", "sweep --rpm 1500,4000 --scenario all", "plot"),
    ("hammering", "report --rpm 1500,4000 --misfire two", "html"),
    pytest.param("hammering", "tune --tolerance 0.1", "plot", marks=pytest.mark.slow),
    pytest.param(
        "hammering",
        "tolerance --rpm 4000 --harmonics 48",
        "plot",
        marks=pytest.mark.slow,
    ),
    ("hammering", "transient --seconds 0.05 --speed 0:3000,0.05:4000", "plot"),
    ("two engines", "check", ""),
    ("two engines", "modes", "plot"),
    ("two engines", "campbell --rpm 200:700", "plot"),
    ("two engines", "forced --rpm 200:700:6 --scenario all", "plot"),
    ("two engines", "phase --rpm 300,360", ""),
    ("two engines", "solve --rpm 300", "plot"),
    ("two engines", "transient --seconds 2 --speed 0:250,2:300", "plot"),
    ("two engines", "sweep --rpm 350 --over turn.angle=0:360:3 --scenario all", ""),
    ("two engines", "holzer --hz 5", "plot"),
    ("two engines", "identify measured.csv --fit line.stiffness=5e5:2e6", "plot"),
    ("hammering", "sweep --rpm 1500,4000 --direction both", "plot"),
    ("hammering", "forced --rpm 1500,4000 --misfire each", "plot"),
    ("hammering", "campbell --rpm 1000:9000 --misfire each", "plot"),
)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """Files of every train and its twin, whose links have names that do not depend on
    their ends.
    """
    folder = tmp_path_factory.mktemp("twins")
    files = {}
    for title, text in TRAINS.items():
        names = (f"{place} link" for place in ("first", "second"))
        text = re.sub(
            r"\[\[mesh\]\]\n",
            lambda head, names=names: f'{head[0]}name = "{next(names)}"\n',
            text,
        )
        subfolder = folder / title.replace(" ", "_")
        subfolder.mkdir()
        scene = subfolder / "scene.toml"
        scene.write_text(text, encoding="utf-8")
        twin = subfolder / "twin.toml"
        twin.write_text(BETWEEN.sub(r'between = ["\2", "\1"]', text), encoding="utf-8")
        files[title] = scene, twin
    return files


@pytest.fixture
def drawn(monkeypatch):
    """Specifications of the figures that pictures show."""
    figures = []
    draw_one = draw._draw
    monkeypatch.setattr(
        draw,
        "_draw",
        lambda figure, panels: figures.append(figure) or draw_one(figure, panels),
    )
    return figures


def same_for_people(text, twin):
    """Whether two texts have the same words, and the same numbers but for rounding."""
    text = re.sub(OF_A_FILE, "", text, flags=re.DOTALL)
    twin = re.sub(OF_A_FILE, "", twin, flags=re.DOTALL)
    assert NUMBER.sub("#", text) == NUMBER.sub("#", twin)
    pairs = zip(NUMBER.findall(text), NUMBER.findall(twin), strict=True)
    different = [
        pair
        for pair in pairs
        if float(pair[0]) != pytest.approx(float(pair[1]), rel=ROUNDED, abs=NOTHING)
    ]
    assert different == []


def write_measured(path, scene):
    """Orders of the propeller's speed with a softer line shaft, as they are
    measured.
    """
    response = jaxhb.forced_response(
        jaxhb.load_scene(scene).replace({"line.stiffness": 9e5}),
        rpm=[250.0, 300.0, 350.0],
    )
    speed = response.speed("propeller")
    lines = ["rpm,order,element,quantity,amplitude,phase"]
    for place, rpm in enumerate(response.rpm):
        for order in (2.0, 4.0, 6.0):
            k = list(speed.orders).index(order)
            amplitude = speed.amplitudes[place, k]
            phase = speed.phases_deg[place, k]
            lines.append(f"{rpm},{order},propeller,speed,{amplitude:.12g},{phase:.12g}")
    path.write_text("\n".join(lines), encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize(("train", "command", "file"), COMMANDS)
def test_what_people_read_does_not_depend_on_which_end_of_a_link_is_named_first(
    scenes, drawn, run, monkeypatch, tmp_path, train, command, file
):
    monkeypatch.chdir(tmp_path)
    word, _, options = command.partition(" ")
    if "measured" in options:
        write_measured(tmp_path / "measured.csv", scenes[train][0])
    files = [file] if file else []
    outputs = []
    figures = []
    pages = []
    for path in scenes[train]:
        completed = run(f"{word} {path} {options}", *files)
        outputs.append(completed.out)  # errors tell how long it takes
        figures.append(json.dumps([dataclasses.asdict(figure) for figure in drawn]))
        if file == "html":
            pages.append(completed.path("html").read_text(encoding="utf-8"))
        drawn.clear()
    for text, twin in (outputs, figures, pages or ("", "")):
        same_for_people(text, twin)
    assert file != "plot" or len(figures[0]) > 100


def test_signals_of_links_in_files_change_their_sign_with_the_order_of_the_ends(
    scenes, run
):
    """And nothing else, as docs/reference/conventions.md says: positive where the first
    end drives the second.
    """
    scene, twin_scene = scenes["two engines"]
    record = run(f"solve {scene} --rpm 300", "json").json
    completed = run(f"solve {twin_scene} --rpm 300", "json", "csv")
    twin = completed.json
    (row,) = completed.rows
    for kind in ("shafts", "meshes"):
        assert record[kind].keys() == twin[kind].keys()
        for name, signal in record[kind].items():
            reverse = twin[kind][name]
            signs = {"mean": -1, "rms": 1, "half_peak_to_peak": 1}
            expected = {key: sign * signal[key] for key, sign in signs.items()}
            expected |= {"min": -signal["max"], "max": -signal["min"]}
            numbers = {key: reverse[key] for key in expected}
            assert numbers == pytest.approx(expected, rel=1e-9)
            amplitudes = np.array(signal["amplitudes"], float)
            reversed_ones = np.array(reverse["amplitudes"], float)
            counted = amplitudes[:, 1] > 1.0
            order_and_size = reversed_ones[counted, :2]
            np.testing.assert_allclose(
                order_and_size, amplitudes[counted, :2], rtol=1e-9
            )
            turned = (reversed_ones - amplitudes)[counted, 2] % 360
            np.testing.assert_allclose(turned, 180.0, atol=1e-6)
    meshes = record["meshes"]
    smallest = [float(row[f"{name} min N"]) for name in meshes]
    assert smallest == pytest.approx([-force["max"] for force in meshes.values()])
    peaks = [max(force["max"], -force["min"]) for force in meshes.values()]
    cells = [float(row[f"{name} peak N"]) for name in meshes]
    assert cells == pytest.approx(peaks)
    mean = record["gears"]["wheel"]["mean"]
    assert twin["gears"]["wheel"]["mean"] == pytest.approx(mean, rel=1e-9)


def test_the_largest_tooth_force_of_all_modes_is_that_of_the_flank_with_the_larger_one(
    run, tmp_path
):
    """The driven gear stands first: all forces are negative in the files."""
    text = text_of("two_engines.toml").replace(
        '["port pinion", "wheel"]', '["wheel", "port pinion"]'
    )
    (tmp_path / "plant.toml").write_text(text)
    record = run(f"sweep {tmp_path}/plant.toml --rpm 300 --scenario all", "json").json
    (response,) = record["scenarios"]["as written"]["responses"]
    force = response["meshes"]["wheel|port pinion"]
    assert force["max"] < 0
    assert record["worst"]["wheel|port pinion peak N"]["value"] >= -force["min"]


def test_the_largest_tooth_force_of_a_cycle_is_that_of_the_flank_with_the_larger_one():
    signal = RecordedSignal(
        np.array([-30.0, -20.0, -10.0]),
        np.array([-90.0, -80.0, -70.0]),
        mean=-45.0,
        rms=50.0,
        amplitudes=np.zeros(1),
        revolutions_per_cycle=1.0,
    )
    for percentiles in (
        signal.per_cycle.peak,
        signal.reversed().per_cycle.peak,
        signal.reversed().per_cycle.max,
    ):
        assert percentiles.tolist() == [71.0, 80.0, 89.0]
