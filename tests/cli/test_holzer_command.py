"""``jaxhb holzer``: the table of Python as engineers print it, and its residual over
the frequency.
"""

import numpy as np
import pytest

import jaxhb
from jaxhb.report.text.linear import holzer_text

SCENE = "six_cylinder_diesel"


@pytest.fixture(scope="module")
def train():
    return jaxhb.load_scene(SCENE)


def test_without_a_choice_there_are_tables_of_the_first_three_modes_that_strain_links(
    train, told
):
    called = told(f"holzer {SCENE}", "json", "plot")
    modes = jaxhb.natural_frequencies(train)
    tables = called.json["tables"]
    assert [one["mode"] for one in tables] == [1, 2, 3] and called.is_drawn
    for one in tables:
        table = jaxhb.holzer_table(train, hz=modes.frequencies_hz[one["mode"]])
        assert one["residual"] == table.residual and one["disks"] == list(table.names)
        for field in (
            "inertia",
            "ordinate",
            "torque",
            "torque_sum",
            "stiffness",
            "twist",
        ):
            assert one[field] == getattr(table, field).tolist()
    row = next(
        line.split() for line in called.out.splitlines() if line.startswith("  cyl6 ")
    )
    assert (
        float(row[2]) == pytest.approx(0.077298)
        and row[6] == "cyl6|flywheel"
        and row[-1] == "18.7"
    )


def test_the_energies_of_a_natural_frequency_are_those_of_its_mode():
    train = jaxhb.load_scene("gear_train_30")
    modes = jaxhb.natural_frequencies(train)
    table = jaxhb.holzer_table(train, hz=modes.frequencies_hz[3])
    kinetic = dict(
        zip(table.names, table.kinetic_energy / table.kinetic_energy.sum(), strict=True)
    )
    strain = dict(
        zip(table.links, table.strain_energy / table.kinetic_energy.sum(), strict=True)
    )
    np.testing.assert_allclose(
        [kinetic[n] for n in modes.names], modes.kinetic_share[3], atol=1e-6
    )
    np.testing.assert_allclose(
        [strain[n] for n in modes.link_names], modes.strain_share[3], atol=1e-6
    )


def test_a_table_at_rest_has_no_shares_of_the_kinetic_energy(train):
    text = holzer_text([(None, jaxhb.holzer_table(train, hz=0.0))], SCENE)
    (row,) = [row for row in map(str.split, text.splitlines()) if row[:1] == ["cyl6"]]
    assert row[5] == row[-1] == "-"


def test_tables_are_at_the_frequencies_and_modes_asked_for(train, told):
    said = told(f"holzer {SCENE} --hz 100 250.5").out
    assert (
        f"\n100 Hz, residual {jaxhb.holzer_table(train, hz=100.0).residual:.4g} N m"
        in said
        and "\n250.5 Hz" in said
    )
    assert "mode 4, 1171.02 Hz" in told(f"holzer {SCENE} --mode 4").out
