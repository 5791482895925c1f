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
OWN = (
    r"SHA-256 \w+|\d{4}-\d\d-\d\d \d\d:\d\d"
    r" UTC|[^\s'\"<>]*\b(scene|twin)(\b|_)[^\s'\"<>]*"
)
OWN += (
    r"|\b\d+"
    r" s\b|<script>.*?</script>|<style>.*?</style>|<details.*</details>|<svg.*?</svg>"
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
rpm = [3000, 4000]
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
    pytest.param("hammering", "tune", "plot", marks=pytest.mark.slow),
    pytest.param("hammering", "tolerance --rpm 4000", "plot", marks=pytest.mark.slow),
    ("two engines", "check", ""),
    ("two engines", "modes", "plot"),
    ("two engines", "campbell --rpm 200:700", "plot"),
    ("two engines", "forced --rpm 200:700:6 --scenario all", "plot"),
    ("two engines", "phase --rpm 300,360", ""),
    ("two engines", "solve --rpm 300", "plot"),
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
        own = folder / title.replace(" ", "_")
        own.mkdir()
        files[title] = own / "scene.toml", own / "twin.toml"
        files[title][0].write_text(text, encoding="utf-8")
        files[title][1].write_text(
            BETWEEN.sub(r'between = ["\2", "\1"]', text), encoding="utf-8"
        )
    return files


@pytest.fixture
def drawn(monkeypatch):
    """Specifications of the figures that pictures show."""
    figures, draw_one = [], draw._draw
    monkeypatch.setattr(
        draw,
        "_draw",
        lambda figure, panels: figures.append(figure) or draw_one(figure, panels),
    )
    return figures


def same_for_people(text, twin):
    """Whether two texts have the same words, and the same numbers but for rounding."""
    text, twin = (re.sub(OWN, "", one, flags=re.DOTALL) for one in (text, twin))
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
    told = []
    figures = []
    pages = []
    for path in scenes[train]:
        called = run(f"{word} {path} {options}", *filter(None, [file]))
        assert called.status == 0, called.err
        told.append(called.out)  # errors tell how long it takes
        figures.append(json.dumps(list(map(dataclasses.asdict, drawn))))
        pages.append(
            called.path("html").read_text(encoding="utf-8") if file == "html" else ""
        )
        drawn.clear()
    same_for_people(*told)
    same_for_people(*figures)
    same_for_people(*pages)
    assert file != "plot" or len(figures[0]) > 100


def test_signals_of_links_in_files_change_their_sign_with_the_order_of_the_ends_and_nothing_else(
    scenes, run
):
    """As docs/reference/conventions.md says: positive where the first end drives the
    second.
    """
    record, twin = (
        run(f"solve {path} --rpm 300", "json", "csv").json
        for path in scenes["two engines"]
    )
    rows = run(f"solve {scenes['two engines'][1]} --rpm 300", "csv").rows
    for kind in ("shafts", "meshes"):
        assert record[kind].keys() == twin[kind].keys()
        for name, signal in record[kind].items():
            its = twin[kind][name]
            wanted = [
                -signal["mean"],
                -signal["max"],
                -signal["min"],
                signal["rms"],
                signal["half_peak_to_peak"],
            ]
            found = [
                its[key] for key in ("mean", "min", "max", "rms", "half_peak_to_peak")
            ]
            assert found == pytest.approx(wanted, rel=1e-9)
            counted = [
                row
                for row in zip(signal["amplitudes"], its["amplitudes"], strict=True)
                if row[0][1] > 1.0
            ]
            for (order, size, phase), (its_order, its_size, its_phase) in counted:
                assert (its_order, its_size) == pytest.approx((order, size), rel=1e-9)
                assert (its_phase - phase) % 360 == pytest.approx(180.0, abs=1e-6)
    forces = {name: record["meshes"][name] for name in record["meshes"]}
    assert [float(rows[0][f"{name} min N"]) for name in forces] == pytest.approx(
        [-one["max"] for one in forces.values()]
    )
    peaks = [max(one["max"], -one["min"]) for one in forces.values()]
    assert [float(rows[0][f"{name} peak N"]) for name in forces] == pytest.approx(peaks)
    assert twin["gears"]["wheel"]["mean"] == pytest.approx(
        record["gears"]["wheel"]["mean"], rel=1e-9
    )


def test_the_largest_tooth_force_of_all_modes_and_of_a_cycle_is_that_of_the_flank_with_the_larger_one(
    run, tmp_path
):
    """The driven gear stands first: all forces are negative in the files."""
    text = text_of("two_engines.toml").replace(
        '["port pinion", "wheel"]', '["wheel", "port pinion"]'
    )
    (tmp_path / "plant.toml").write_text(text)
    found = run(f"sweep {tmp_path}/plant.toml --rpm 300 --scenario all", "json")
    force = found.json["scenarios"]["as written"]["responses"][0]["meshes"][
        "wheel|port pinion"
    ]
    assert force["max"] < 0
    assert found.json["worst"]["wheel|port pinion peak N"]["value"] >= -force["min"]
    cycles = np.array([-30.0, -20.0, -10.0]), np.array([-90.0, -80.0, -70.0])
    signal = RecordedSignal(
        *cycles, mean=-45.0, rms=50.0, amplitudes=np.zeros(1), revolutions_per_cycle=1.0
    )
    assert (
        signal.per_cycle.peak.tolist()
        == signal.reversed().per_cycle.peak.tolist()
        == [71.0, 80.0, 89.0]
    )
    assert signal.reversed().per_cycle.max.tolist() == [71.0, 80.0, 89.0]
