"""What a command keeps until it is done: alone, as one of several, and where it cannot
be kept.
"""

import os

import pytest

import jaxhb
from jaxhb.cli.resume import GOES_ON, Unfinished, as_one


@pytest.fixture
def train(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXHB_CACHE", str(tmp_path / "cache"))
    return jaxhb.load_scene("spur_pair")


def folder_of(train, question):
    """Folder of what a command has kept."""
    return Unfinished([train], question).folder.folder


def done(train, question):
    """The folder of a command that has run."""
    unfinished = Unfinished([train], question)
    unfinished.run(lambda folder: (folder.folder / "found").write_text(""), str)
    unfinished.forget()
    return unfinished.folder.folder


def test_what_a_command_has_kept_is_there_until_it_is_done(train):
    unfinished = Unfinished([train], ("sweep", [900.0]))
    folder = unfinished.folder.folder
    assert folder.is_dir()
    assert folder_of(train, ("sweep", [900.0])) == folder
    assert folder_of(train, ("sweep", [900.0000001])) != folder
    unfinished.forget()
    assert not folder.exists()


def test_what_commands_of_several_scenarios_have_kept_is_there_until_all_are_done(
    train,
):
    def all_of_them(last):
        with as_one():
            folders.append(done(train, "first"))
            assert folders[0].exists()
            folders.append(done(train, last()))

    def stopped():
        raise KeyboardInterrupt

    folders = []
    with pytest.raises(KeyboardInterrupt) as stop:
        all_of_them(stopped)
    assert folders[0].exists()
    assert GOES_ON in stop.value.__notes__[0]
    folders.clear()
    all_of_them(lambda: "second")
    assert not any(folder.exists() for folder in folders)


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no modes of files")
@pytest.mark.parametrize(
    "levels",
    [2, 1, 0],
    ids=["the cache", "all that is under way", "that of the command"],
)
def test_a_folder_in_which_others_could_write_is_not_used_and_that_is_told_once(
    train, levels, capsys
):
    folder = folder_of(train, levels)
    (folder, *folder.parents)[levels].chmod(0o777)
    for _ in range(2):
        assert Unfinished([train], levels).folder is None
    errors = capsys.readouterr().err
    assert errors.count("is not kept on disk") == 1
    assert "Remove it with all that is in it" in errors
