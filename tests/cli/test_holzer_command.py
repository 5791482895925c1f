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
    train, run_once
):
    completed = run_once(f"holzer {SCENE}", "json", "plot")
    completed.check_printed("holzer_diesel")
    modes = jaxhb.natural_frequencies(train)
    records = completed.json["tables"]
    assert [record["mode"] for record in records] == [1, 2, 3]
    for record in records:
        table = jaxhb.holzer_table(train, hz=modes.frequencies_hz[record["mode"]])
        assert record == record | {
            "residual": table.residual,
            "disks": list(table.names),
            "inertia": table.inertia.tolist(),
            "ordinate": table.ordinate.tolist(),
            "torque": table.torque.tolist(),
            "torque_sum": table.torque_sum.tolist(),
            "stiffness": table.stiffness.tolist(),
            "twist": table.twist.tolist(),
        }


def test_the_energies_of_a_natural_frequency_are_those_of_its_mode():
    train = jaxhb.load_scene("gear_train_30")
    modes = jaxhb.natural_frequencies(train)
    table = jaxhb.holzer_table(train, hz=modes.frequencies_hz[3])
    total = table.kinetic_energy.sum()
    kinetic = dict(zip(table.names, table.kinetic_energy / total, strict=True))
    strain = dict(zip(table.links, table.strain_energy / total, strict=True))
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


def test_tables_are_at_the_frequencies_and_modes_asked_for(train, run_once):
    completed = run_once(f"holzer {SCENE} --hz 100 250.5")
    completed.check_printed("holzer_at_frequencies")
    residual = jaxhb.holzer_table(train, hz=100.0).residual
    assert f"\n100 Hz, residual {residual:.4g} N m" in completed.out
    assert "mode 4, 1171.02 Hz" in run_once(f"holzer {SCENE} --mode 4").out
