"""A scene with umlauts for a page, and readers of the parts of a page for tests and a
browser.
"""

import dataclasses
import shutil
import subprocess

import numpy as np
from reference_data import text_of

from jaxhb.report.answer import Answer
from jaxhb.report.figures.figure import Figure
from jaxhb.report.table import Table
from jaxhb.results.status import Status

SCENE = text_of("two_cylinders.toml")

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))),
    None,
)
WIDE = """
const wide = [...document.querySelectorAll(".scroll")]
  .filter(table => table.scrollWidth > table.clientWidth + 1);
document.body.dataset.wide =
  wide.map(table => table.textContent.trim().slice(0, 60)).join("; ");
"""
"""Script that lists tables wider than the sheet, for which a browser would print the
whole page smaller.
"""

WIDER = (
    "<style>th, td, p, h1, h2, h3, .caption, figcaption { letter-spacing: 0.25em;"
    " }</style>"
)
"""Style that makes the letters of every font half as wide again."""


def blocks(data, kind):
    """Blocks of a kind, in order."""
    return [block for block in data if isinstance(block, kind)]


def figures(parts):
    """All figures, in the order of the page."""
    return [block for part in parts.values() for block in blocks(part.blocks, Figure)]


def tables(part):
    """Tables of a part."""
    return blocks(part.blocks, Table)


def without_an_answer(answer):
    """The same speed with numbers a thousand times as large that have not converged."""
    response = answer.response
    wrong = dataclasses.replace(
        response,
        status=np.int32(Status.MAX_STEPS),
        forces=1e3 * response.forces,
        torques=1e3 * response.torques,
        elastic_forces=1e3 * response.elastic_forces,
    )
    return Answer(
        answer.train, dataclasses.replace(answer.state, response=wrong), answer.linear
    )


def browse(file, *options):
    """Open a page in Chromium without a network."""
    command = [
        CHROMIUM,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--host-resolver-rules=MAP * ~NOTFOUND",
        "--virtual-time-budget=120000",
        "--enable-logging=stderr",
        f"--user-data-dir={file.parent / 'profile'}",
        *options,
        file.as_uri(),
    ]
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=300,
        check=True,
    )
