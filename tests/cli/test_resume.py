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


def done(train, asked):
    """The folder of a command that has run."""
    kept = Unfinished([train], asked)
    kept.run(lambda folder: (folder.folder / "found").write_text(""), str)
    kept.forget()
    return kept.folder.folder


def test_what_a_command_has_kept_is_there_until_it_is_done(train):
    kept = Unfinished([train], ("sweep", [900.0]))
    folder = kept.folder.folder
    assert (
        folder.is_dir()
        and Unfinished([train], ("sweep", [900.0])).folder.folder == folder
    )
    assert Unfinished([train], ("sweep", [900.0000001])).folder.folder != folder
    kept.forget()
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
    assert folders[0].exists() and GOES_ON in stop.value.__notes__[0]
    folders.clear()
    all_of_them(lambda: "second")
    assert not any(folder.exists() for folder in folders)


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no modes of files")
@pytest.mark.parametrize(
    "which", ["the cache", "all that is under way", "that of the command"]
)
def test_a_folder_in_which_others_could_write_is_not_used_and_that_is_told_once(
    train, which, capsys
):
    folder = Unfinished([train], which).folder.folder
    {"the cache": folder.parents[1], "all that is under way": folder.parent}.get(
        which, folder
    ).chmod(0o777)
    assert (
        Unfinished([train], which).folder is None
        and Unfinished([train], which).folder is None
    )
    told = capsys.readouterr().err
    assert (
        told.count("is not kept on disk") == 1
        and "Remove it with all that is in it" in told
    )
