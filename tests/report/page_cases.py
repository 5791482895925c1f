"""A scene with umlauts whose page is looked at, and how tests and a browser read the
parts of a page.
"""

import dataclasses
import shutil
import subprocess

import numpy as np
from reference_data import text_of

from jaxhb.report.answer import Answer
from jaxhb.report.figures.figure import Figure
from jaxhb.report.text.columns import Table
from jaxhb.results.status import Status

SCENE = text_of("two_cylinders.toml")

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))),
    None,
)
WIDE = """
const wide = [...document.querySelectorAll(".scroll")].filter(one => one.scrollWidth > one.clientWidth + 1);
document.body.dataset.wide = wide.map(one => one.textContent.trim().slice(0, 60)).join("; ");
"""
"""Tables wider than the sheet, for which a browser would print the whole page
smaller.
"""


WIDER = (
    "<style>th, td, p, h1, h2, h3, .caption, figcaption { letter-spacing: 0.25em;"
    " }</style>"
)
"""Makes the letters of every font half as wide again."""


def blocks(data, kind):
    """Blocks of a kind, in their order."""
    return [block for block in data if isinstance(block, kind)]


def figures(parts):
    """Every figure, in the order of the page."""
    return [block for part in parts.values() for block in blocks(part.blocks, Figure)]


def tables(part):
    """Tables of a part."""
    return blocks(part.blocks, Table)


def without_an_answer(answer):
    """The same speed with numbers a thousand times as large that have not converged."""
    response = answer.response
    wrong = {
        name: 1e3 * getattr(response, name)
        for name in ("forces", "torques", "elastic_forces")
    }
    response = dataclasses.replace(response, status=np.int32(Status.MAX_STEPS), **wrong)
    return Answer(
        answer.train,
        dataclasses.replace(answer.state, response=response),
        answer.linear,
    )


def browse(file, *options):
    """What Chromium makes of a page without a network."""
    command = [
        CHROMIUM,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
    ]
    command += [
        "--host-resolver-rules=MAP * ~NOTFOUND",
        "--virtual-time-budget=120000",
        "--enable-logging=stderr",
    ]
    command += [f"--user-data-dir={file.parent / 'profile'}", *options, file.as_uri()]
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=300,
        check=True,
    )
