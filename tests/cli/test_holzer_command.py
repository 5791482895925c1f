"""``jaxhb holzer``: the table of Python as engineers print it, and its residual over the frequency."""

import json

import numpy as np
import pytest

import jaxhb
from jaxhb.cli.main import main
from jaxhb.report.figures.linear import plot_holzer

SCENE = "six_cylinder_diesel"


@pytest.fixture(scope="module")
def train():
    return jaxhb.load_scene(SCENE)


def test_without_a_choice_there_are_tables_of_the_first_three_modes_that_strain_links(train, capsys, tmp_path):
    file = tmp_path / "h.json"
    assert main(["holzer", SCENE, "--json", str(file), "--plot", str(tmp_path / "h.png")]) == 0
    record, modes = json.loads(file.read_text()), jaxhb.natural_frequencies(train)
    assert [one["mode"] for one in record["tables"]] == [1, 2, 3]
    for one in record["tables"]:
        table = jaxhb.holzer_table(train, hz=modes.frequencies_hz[one["mode"]])
        assert one["residual"] == table.residual and one["disks"] == list(table.names)
        for field in ("inertia", "ordinate", "torque", "torque_sum", "stiffness", "twist"):
            assert one[field] == getattr(table, field).tolist()
    said = capsys.readouterr().out
    row = next(line.split() for line in said.splitlines() if line.startswith("  cyl6 "))
    assert float(row[2]) == pytest.approx(0.077298) and row[6] == "cyl6|flywheel" and row[-1] == "18.7"
    assert (tmp_path / "h.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name, number", [(SCENE, 2), ("gear_train_30", 3)])
def test_the_energies_of_a_natural_frequency_are_those_of_its_mode(name, number):
    train = jaxhb.load_scene(name)
    modes = jaxhb.natural_frequencies(train)
    table = jaxhb.holzer_table(train, hz=modes.frequencies_hz[number])
    kinetic = dict(zip(table.names, table.kinetic_energy / table.kinetic_energy.sum(), strict=True))
    strain = dict(zip(table.links, table.strain_energy / table.kinetic_energy.sum(), strict=True))
    np.testing.assert_allclose([kinetic[n] for n in modes.names], modes.kinetic_share[number], atol=1e-6)
    np.testing.assert_allclose([strain[n] for n in modes.link_names], modes.strain_share[number], atol=1e-6)


def test_tables_are_at_the_frequencies_and_modes_asked_for(train, capsys):
    assert main(["holzer", SCENE, "--hz", "100", "250.5"]) == 0
    said = capsys.readouterr().out
    assert f"\n100 Hz, residual {jaxhb.holzer_table(train, hz=100.0).residual:.4g} N m" in said and "\n250.5 Hz" in said
    assert main(["holzer", SCENE, "--mode", "4"]) == 0
    assert "mode 4, 1171.02 Hz" in capsys.readouterr().out


def test_the_picture_has_the_residual_and_its_zeros(train):
    hz = float(jaxhb.natural_frequencies(train).frequencies_hz[1])
    tables = [(None, jaxhb.holzer_table(train, hz=400.0))]
    figure = plot_holzer(lambda f: jaxhb.holzer_residual(train, hz=f), tables, {1: hz, 2: 592.7}, SCENE)
    curve, zero, asked, _ = figure.axes[0].get_lines()
    changes = curve.get_xdata()[:-1][np.diff(np.sign(curve.get_ydata())) != 0]
    assert zero.get_xdata() == pytest.approx([hz], rel=1e-4) and changes == pytest.approx([hz], abs=1.0)
    assert asked.get_xdata()[0] == 400.0


def test_bad_input_is_told_in_a_sentence_each(capsys):
    assert main(["holzer", SCENE, "--mode", "0", "30"]) == 2
    said = capsys.readouterr().err.splitlines()
    assert said == [
        f"{SCENE}: --mode 0: this mode is rigid, no link is strained. The first that strains one is 1.",
        f"{SCENE}: --mode 30: there are modes 0 to 8.",
    ]
    assert main(["holzer", SCENE, "--hz", "-3"]) == 2
    assert main(["holzer", SCENE, "--hz", "3", "--mode", "1"]) == 2
    assert "--hz and --mode exclude each other" in capsys.readouterr().err
