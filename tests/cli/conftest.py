"""How tests call the command line in their process, and read what it printed and
wrote.
"""

import contextlib
import csv
import io
import json
import shlex
import threading
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

from jaxhb.cli import progress
from jaxhb.cli.main import main

ENDS = {"plot": "png", "netcdf": "nc", "trace": "trace.csv"}


@dataclass(frozen=True)
class Called:
    """What came of a call: files that were asked for lie in ``folder`` under the name
    of their option.
    """

    status: int
    out: str
    err: str
    folder: Path

    def path(self, option):
        return self.folder / f"{option}.{ENDS.get(option, option)}"

    @property
    def json(self):
        """The JSON as a strict reader takes it: no NaN, no Infinity."""

        def refuse(word):
            raise ValueError(f"{word} is no JSON")

        return json.loads(
            self.path("json").read_text(encoding="utf-8"), parse_constant=refuse
        )

    @property
    def rows(self):
        with self.path("csv").open(encoding="utf-8", newline="") as text:
            return list(csv.DictReader(text))

    @property
    def is_drawn(self):
        return self.path("plot").read_bytes().startswith(b"\x89PNG")

    @property
    def words(self):
        """What was printed, on one line."""
        return " ".join(self.out.split())


def call(folder, line, *files):
    """Run a command as it is typed, with a file for each of these options."""
    called = Called(0, "", "", folder)
    words = [
        word for option in files for word in (f"--{option}", str(called.path(option)))
    ]
    out = io.TextIOWrapper(io.BytesIO(), "utf-8", newline="")
    err = io.StringIO()
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        pytest.MonkeyPatch.context() as patch,
    ):
        # Lines on the progress depend on how fast the machine is; tests of them ask for
        # them.
        patch.setattr(progress, "LOGGED", threading.TIMEOUT_MAX)
        status = main([*shlex.split(line), *words])
    out.flush()
    return Called(status, out.buffer.getvalue().decode(), err.getvalue(), folder)


@pytest.fixture
def run(tmp_path):
    """Runs a command whose files go to the folder of the test."""
    return partial(call, tmp_path)


@pytest.fixture(scope="session")
def told(tmp_path_factory):
    """Runs a command on packaged scenes, once for all tests that ask for it with the
    same files.
    """
    found = {}

    def once(line, *files):
        if (line, files) not in found:
            found[line, files] = call(tmp_path_factory.mktemp("told"), line, *files)
        return found[line, files]

    return once
