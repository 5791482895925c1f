"""Files that scenes and people name: a sentence tells what is no regular file, is too
large or lies elsewhere, and nothing waits for it.
"""

import csv
import io
import os

import pytest
from reference_data import text_of

from jaxhb.design.measurements import read_measured
from jaxhb.elements.sentences import SceneError
from jaxhb.report.files.output import as_csv
from jaxhb.scene.csv_tables import read_csv
from jaxhb.scene.files import load_scene
from jaxhb.scene.input_files import MOST_BYTES, Unreadable, is_beside, read_bytes

SOUND = text_of("three_disks.toml")
SECRET = "root:x:0:0:the password is swordfish\n0;swordfish\n"
pipes = pytest.mark.skipif(
    not hasattr(os, "mkfifo"), reason="the system has no named pipes"
)


def a_folder(path):
    path.mkdir()


def a_large_file(path):
    path.touch()
    os.truncate(path, 3 * 2**30)  # sparse: it takes no room


def a_link_to_a_device(path):
    path.symlink_to("/dev/zero")


NO_FILES = {
    "folder": (a_folder, "the file is a folder, must be a regular file."),
    "pipe": pytest.param(
        os.mkfifo, "the file is a pipe, must be a regular file.", marks=pipes
    ),
    "device": pytest.param(
        a_link_to_a_device, "the file is a device, must be a regular file.", marks=pipes
    ),
    "3 GiB": (a_large_file, "the file has 3072 MiB, must have at most 8 MiB."),
    "nothing": (lambda path: None, "no such file"),
}


def torque(file):
    """Tables of a torque that names a file of harmonics, and of a load."""
    return f'[[torque]]\ndisk = "a"\nharmonics = "{file}"\n[[load]]\ndisk = "b"\n'


def read_table(path):
    (path.parent / "gears.toml").write_text(SOUND + torque(path.name))
    load_scene(path.parent / "gears.toml")


READERS = {
    "scene": load_scene,
    "table": read_table,
    "measurement": lambda path: read_measured(path, None),
}


@pytest.mark.parametrize(("make", "sentence"), NO_FILES.values(), ids=NO_FILES)
@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_what_is_no_regular_file_of_usual_size_is_told_at_once(
    tmp_path, make, sentence, read
):
    path = tmp_path / "given.csv"
    make(path)
    with pytest.raises(SceneError) as caught:
        read(path)
    if read is read_table:
        sentence = sentence.replace("no such file", "no ")
    assert sentence in str(caught.value)
    assert len(caught.value.sentences) == 1
    assert "given.csv" in str(caught.value)


@pytest.mark.skipif(
    not os.path.exists("/proc/self/environ"), reason="the system has no such files"
)
def test_a_file_of_the_system_that_tells_no_size_is_read_no_further_than_others():
    assert read_bytes("/proc/self/environ")
    assert os.stat("/proc/self/environ").st_size == 0
    with pytest.raises(Unreadable, match="a device"):
        read_bytes("/dev/zero")


def absolute(folder, secret):
    return str(secret)


def relative(folder, secret):
    return "../secret.csv"


def linked(folder, secret):
    (folder / "beside.csv").symlink_to(secret)
    return "beside.csv"


@pytest.mark.parametrize("named", [absolute, relative, linked])
@pytest.mark.parametrize("line", ["0;swordfish", "0;1,5\n1;2.5swordfish\n3;2.5"])
def test_nothing_of_a_file_outside_of_the_folder_of_the_scene_is_quoted(
    tmp_path, named, line
):
    secret = tmp_path / "secret.csv"
    folder = tmp_path / "scenes"
    folder.mkdir()
    secret.write_text(f"# a comment\n{line}\n")
    (folder / "gears.toml").write_text(SOUND + torque(named(folder, secret)))
    with pytest.raises(SceneError, match="line 2") as caught:
        load_scene(folder / "gears.toml")
    assert not any(word in str(caught.value) for word in ("swordfish", "1,5", "2.5"))


def test_a_file_below_the_folder_of_the_scene_is_quoted_in_short(tmp_path):
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "h.csv").write_text("1, 2, 3\n" + "x" * 10**5 + ",1,2\n")
    (tmp_path / "gears.toml").write_text(
        SOUND + '[[torque]]\ndisk = "a"\nharmonics = "tables/h.csv"\n'
    )
    with pytest.raises(SceneError, match="h.csv, line 2 is 'xxx") as caught:
        load_scene(tmp_path / "gears.toml")
    assert max(map(len, caught.value.sentences)) < 300
    assert is_beside(tmp_path / "tables" / "h.csv", tmp_path)
    assert not is_beside(tmp_path, tmp_path / "tables")


def test_a_table_outside_of_the_folder_is_read(tmp_path):
    (tmp_path / "h.csv").write_text("1;2,5;3\n")
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "gears.toml").write_text(SOUND + torque("../h.csv"))
    train = load_scene(tmp_path / "scenes" / "gears.toml")
    assert train.torques.harmonics.ravel().tolist() == [2.5, 3.0]


def test_a_file_of_the_greatest_size_is_read(tmp_path):
    path = tmp_path / "large.csv"
    path.write_bytes(b"#" * MOST_BYTES)
    assert len(read_bytes(path)) == MOST_BYTES
    path.write_bytes(b"#" * (MOST_BYTES + 1))
    with pytest.raises(Unreadable, match="must have at most 8 MiB"):
        read_bytes(path)


NAMES = [
    "=cmd|'/C calc'!A0",
    "+1+1",
    "-x",
    "@SUM(A1)",
    "\tgear",
    "'=1",
    "''@x",
    "'quoted",
    "gear, 'large'",
    "a|b",
]


def test_no_cell_of_a_csv_is_a_formula_and_names_come_back():
    heads = ["rpm", *(f"{name} max N" for name in NAMES)]
    rows = [[900.0, *NAMES], [-1.5, *[-2.0] * len(NAMES)]]
    content = b"".join(as_csv(heads, rows)).decode()
    cells = [cell for row in csv.reader(io.StringIO(content)) for cell in row]
    numbers = [
        cell
        for cell in cells
        if cell.startswith("-") and cell.removeprefix("-").replace(".", "").isdecimal()
    ]
    assert len(numbers) == 1 + len(NAMES)
    texts = [cell for cell in cells if cell not in numbers]
    assert not any(text.startswith(("=", "+", "-", "@", "\t", "\r")) for text in texts)
    lines = read_csv(content, "sweep.csv").lines
    assert list(lines[0].cells) == heads
    assert list(lines[1].cells) == ["900.0", *NAMES]
