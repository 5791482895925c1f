"""Scenes of thousands of elements are read in a time that grows with their number, or
refused in a dozen sentences.
"""

import time

import pytest
from reference_data import text_of

from jaxhb.elements.declared import LARGEST
from jaxhb.elements.sentences import SceneError
from jaxhb.elements.values import LONGEST_NAME
from jaxhb.scene.files import load_scene

SOUND = text_of("three_disks.toml")
# Processor time for 10,000 disks with their shafts, and for 5000 equal tables
SECONDS = 5.0


def refusal(tmp_path, text):
    path = tmp_path / "gears.toml"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    return caught.value


def test_ten_thousand_disks_and_shafts_are_read_checked_and_built_in_five_seconds(
    tmp_path,
):
    count = 10_000
    disks = "".join(f'[[disk]]\nname = "d{i}"\ninertia = 1.0\n' for i in range(count))
    shafts = "".join(
        f'[[shaft]]\nbetween = ["d{i}", "d{i + 1}"]\nstiffness = 1e6\n'
        for i in range(count - 1)
    )
    path = tmp_path / "chain.toml"
    path.write_text(disks + shafts)
    begin = time.process_time()
    topology = load_scene(path).topology
    assert time.process_time() - begin < SECONDS
    assert topology.n_disks == count
    assert topology.n_rotors == 1
    assert topology.shaft_ends[-1] == (count - 2, count - 1)


SIZES = "bore = 0.1\nstroke = 0.1\nrod = 0.2"
REPEATED = {
    "disks of one name": '[[disk]]\nname = "a"\ninertia = 1.0\n',
    "pieces that nothing joins": '[[disk]]\nname = "x{i}"\ninertia = 1.0\n',
    "shafts to disks that are not there": (
        '[[shaft]]\nbetween = ["a", "x{i}"]\nstiffness = 1e6\n'
    ),
    "misspelt keys": '[[ground]]\ndisk = "a"\nstifness = 1.0\n',
    "orders that are no harmonic": (
        '[[torque]]\ndisk = "a"\nharmonics = [[0.3, 1, 0]]\n'
    ),
    "phases of nothing": '[[phase]]\nname = "p{i}"\nof = ["q{i}"]\n',
    "scenarios of nothing": '[scenario.s{i}]\n"q{i}.inertia" = 1.0\n',
    "pressure tables": (
        f'[[cylinder]]\ndisk = "a"\n{SIZES}\npressure = [[0, 1e5], [360, 1e6], [720,'
        " 1e5]]\n"
    ),
    "pairs of gears": (
        '[[disk]]\nname = "x{i}"\ninertia = 1.0\nradius = 0.1\n[[disk]]\nname ='
        ' "y{i}"\ninertia = 1.0\nradius = 0.1\n[[mesh]]\nbetween = ["x{i}",'
        ' "y{i}"]\nstiffness = 1e8\n'
    ),
}


@pytest.mark.parametrize("table", REPEATED.values(), ids=REPEATED)
def test_a_table_repeated_5000_times_is_refused_in_5_seconds_and_a_dozen_sentences(
    tmp_path, table
):
    text = SOUND + "".join(table.replace("{i}", str(i)) for i in range(5000))
    begin = time.process_time()
    error = refusal(tmp_path, text)
    assert time.process_time() - begin < SECONDS
    lines = str(error).splitlines()
    if len(error.sentences) > 1:
        assert len(lines) == 13
        assert lines[-1] == f"... and {len(error.sentences) - 12} more faults."


def test_pressure_tables_and_padded_lists_have_a_number_that_memory_holds(tmp_path):
    sentence = str(refusal(tmp_path, SOUND + 1001 * REPEATED["pressure tables"]))
    assert (
        sentence
        == "gears.toml, [[cylinder]]: 1001 cylinders need 1001 pressure tables, must be"
        " at most 1000. Give some of them gas_torque instead."
    )
    scale = ", ".join(f"[{rpm}, 1.0]" for rpm in range(2000))
    long = f'[[torque]]\ndisk = "a"\nscale = [{scale}]\n'
    short = '[[torque]]\ndisk = "a"\n'
    sentence = str(refusal(tmp_path, SOUND + long + 1000 * short))
    assert (
        "1001 elements with scale of up to 2000 rows, must be at most 2000000 together"
        in sentence
    )


def test_a_bad_row_among_tables_is_one_sentence(tmp_path):
    good = ", ".join(f'{{ name = "d{i}", inertia = 1.0 }}' for i in range(40))
    links = "".join(
        f'[[shaft]]\nbetween = ["d{i}", "lost"]\nstiffness = 1e6\n' for i in range(39)
    )
    error = refusal(tmp_path, f'disk = [{good}, "lost"]\n{links}')
    assert error.sentences == (
        "gears.toml, [[disk]] no. 41 is 'lost', must be a table. Write [[disk]].",
    )
    error = refusal(
        tmp_path,
        f"[[dsik]]\nname = 'lost'\ninertia = 1.0\n{SOUND}{links.replace('d', 'a')}",
    )
    assert "unknown table 'dsik'. Did you mean 'disk'?" in error.sentences[0]
    assert not any("there is no disk" in sentence for sentence in error.sentences)


def test_a_list_of_wrong_orders_is_a_dozen_sentences(tmp_path):
    orders = ", ".join(f"[-{k}, 1, 0]" for k in range(50_000))
    torque = f'[[torque]]\ndisk = "a"\nharmonics = [{orders}]\n'
    error = refusal(tmp_path, SOUND + torque)
    assert len(error.sentences) == 13
    assert "49988 more rows are so" in error.sentences[-1]
    orders = ", ".join(f"[{k}.3, 1, 0]" for k in range(5000))
    torque = f'[[torque]]\ndisk = "a"\nharmonics = [{orders}]\n'
    error = refusal(tmp_path, SOUND + torque)
    assert str(error).endswith("... and 4988 more faults.")


LONG = "x" * 10**6
WHERE_LONG = {
    "name": f'[[disk]]\nname = "{LONG}"\ninertia = 1.0\n',
    "key": f'[[ground]]\ndisk = "a"\nstiffness = 1.0\n{LONG} = 1\n',
    "table": f"[[{LONG}]]\nx = 1\n",
    "disk": f'[[torque]]\ndisk = "{LONG}"\n',
    "word": f'[[torque]]\ndisk = "a"\norders_of = "{LONG}"\n',
    "file": f'[[torque]]\ndisk = "a"\nharmonics = "{LONG}"\n',
    "scenario": f'[scenario."{LONG}"]\n"{LONG}.inertia" = 1.0\n',
    "note": f'[[phase]]\nname = "p"\nof = ["{LONG}"]\n',
}


@pytest.mark.parametrize("added", WHERE_LONG.values(), ids=WHERE_LONG)
def test_a_text_of_a_million_characters_is_not_echoed(tmp_path, added):
    error = refusal(tmp_path, SOUND + added)
    assert max(map(len, error.sentences)) < 700
    assert "xxx" in error.sentences[0]


def test_a_number_whose_quotients_overflow_is_refused(tmp_path):
    error = refusal(tmp_path, SOUND + '[[torque]]\ndisk = "a"\nmean = 1e-300\n')
    sentence = error.sentences[0]
    assert sentence.endswith("mean is 1e-300 N m, must be 0 or at least 1e-60 in size.")


def test_a_name_has_a_length_that_tables_show(tmp_path):
    names = ["x" * LONGEST_NAME, "x" * (LONGEST_NAME + 1)]
    text = "".join(f'[[disk]]\nname = "{name}"\ninertia = 1.0\n' for name in names)
    sentences = refusal(tmp_path, text).sentences
    limit = "must be a text of at most 100"
    assert sum(limit in sentence for sentence in sentences) == 1


@pytest.mark.parametrize("value", ["1e61", "-1e300"])
def test_a_number_whose_products_overflow_is_refused(tmp_path, value):
    error = refusal(tmp_path, SOUND + f'[[torque]]\ndisk = "a"\nmean = {value}\n')
    sentence = error.sentences[0]
    assert sentence.endswith(
        f"mean is {float(value):g} N m, must be at most 1e+60 in size."
    )
    torque = f'[[torque]]\ndisk = "a"\nharmonics = [[1.0, {value}, 0.0]]\n'
    error = refusal(tmp_path, SOUND + torque)
    assert "must be finite numbers, at most 1e+60 in size" in error.sentences[0]
    (tmp_path / "gears.toml").write_text(SOUND)
    train = load_scene(tmp_path / "gears.toml")
    with pytest.raises(
        SceneError, match=r"must be finite and real, at most 1e\+60 in size"
    ):
        train.replace({"a.inertia": 10.0 * LARGEST})


def test_a_file_name_that_no_system_has_is_a_sentence(tmp_path):
    torque = '[[torque]]\ndisk = "a"\nharmonics = "\\u0000"\n'
    assert refusal(tmp_path, SOUND + torque).sentences == (
        (
            r"gears.toml, [[torque]] no. 1: harmonics: there is no file '\x00' in the"
            r" folder of the scene. Correct the name."
        ),
    )
