"""Commands run in the process of a test, and golden files of what they print.

``completed.check_printed("name")`` compares with ``tests/data/printed/name.txt``;
``JAXHB_RENEW_PRINTED=1 python -m pytest ...`` writes these files anew.
"""

import contextlib
import csv
import difflib
import io
import json
import os
import shlex
import threading
from dataclasses import dataclass
from pathlib import Path

import pytest
from reference_data import DATA
from shown import NUMBER, SECONDS, words_of

from jaxhb.cli import progress
from jaxhb.cli.main import main

GOLDEN = DATA / "printed"
ENDS = {"plot": "png", "netcdf": "nc", "trace": "trace.csv"}
ROUNDING = 1e-6
HAMMERING = 0.02
"""Share by which a number may differ between machines; where teeth hammer, processors
that round otherwise come to motions whose times in the gap differ by so much.
"""
# Residuals are what rounding leaves
NOTHING = 1e-6


@dataclass(frozen=True)
class Completed:
    """A command that has run; files that it wrote lie in ``folder`` under the name of
    their option.
    """

    line: str
    status: int
    out: str
    err: str
    folder: Path

    def path(self, option):
        return path_of(self.folder, option)

    @property
    def json(self):
        """The JSON as a strict reader takes it: no NaN, no Infinity."""

        def refuse(word):
            raise ValueError(f"{word} is no JSON")

        text = self.path("json").read_text(encoding="utf-8")
        return json.loads(text, parse_constant=refuse)

    @property
    def rows(self):
        with self.path("csv").open(encoding="utf-8", newline="") as text:
            return list(csv.DictReader(text))

    @property
    def words(self):
        """The output on one line."""
        return " ".join(self.out.split())

    @property
    def transcript(self):
        """The command, its output and errors, without what differs between runs."""
        text = f"$ jaxhb {self.line.strip()}\n{self.out}"
        if self.status or self.err:
            text += f"\nexit status {self.status}\n{self.err}"
        text = text.replace(str(self.folder), "FOLDER").replace(str(DATA), "DATA")
        return SECONDS.sub("? s", text)

    def check_printed(self, name, share=ROUNDING):
        """Compares the transcript with a golden file."""
        check_text(name, self.transcript, share)


def check_text(name, text, share=ROUNDING):
    """Compares a text with a golden file; numbers may differ by a share and by rounding
    of their last digit.
    """
    path = GOLDEN / f"{name}.txt"
    if "JAXHB_RENEW_PRINTED" in os.environ:
        path.write_text(text.rstrip("\n") + "\n", encoding="utf-8")
    expected = path.read_text(encoding="utf-8").splitlines()
    lines = text.splitlines()
    alike = len(lines) == len(expected) and all(
        reads_alike(before, after, share)
        for before, after in zip(expected, lines, strict=True)
    )
    assert alike, "\n".join(difflib.ndiff(expected, lines))


def tolerance_of(number, share):
    """Tolerance of a printed number: a unit of its last digit, but for counts, and a
    share.
    """
    digits, _, exponent = number.partition("e")
    decimals = len(digits.partition(".")[2])
    is_count = number.isdigit() and len(number) == 1
    last_digit = 0.0 if is_count else 10.0 ** (int(exponent or 0) - decimals)
    return 1.001 * last_digit + share * abs(float(number)) + NOTHING


def reads_alike(before, after, share):
    """Whether two lines have the same words, and the same numbers but for rounding."""
    if words_of(before) != words_of(after):
        return False
    pairs = zip(NUMBER.findall(before), NUMBER.findall(after), strict=True)
    return all(
        abs(float(number) - float(other)) <= tolerance_of(number, share)
        for number, other in pairs
    )


def path_of(folder, option):
    """File that an option is to write."""
    return folder / f"{option}.{ENDS.get(option, option)}"


def run_command(folder, line, *options, status=0):
    """Run a command as it is typed, with a file for each of these options; checks its
    exit status, and that pictures are PNG files.
    """
    words = shlex.split(line)
    for option in options:
        words += [f"--{option}", str(path_of(folder, option))]
    ended, out, err = run_words(words)
    assert ended == status, err
    if "plot" in options and status == 0:
        pictures = [path.read_bytes() for path in folder.glob("plot*.png")]
        assert pictures
        assert all(picture.startswith(b"\x89PNG") for picture in pictures)
    return Completed(line, status, out, err, folder)


def run_words(words):
    """Exit status, output and errors of a command run in this process."""
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
        status = main(words)
    out.flush()
    return status, out.buffer.getvalue().decode(), err.getvalue()
