"""Pages as PDF, by the browser at hand: their script draws the figures."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from jaxhb.report.files.output import OutputError

VARIABLE = "JAXHB_BROWSER"
"""Environment variable with the path of a browser that is taken before all others."""

NAMES = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "microsoft-edge-stable",
    "msedge",
    "brave-browser",
)
"""Browsers that print without a window, by the names of their programs on PATH."""

PLACES = {
    "darwin": (
        "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
        "/Applications/Chromium.app/Contents/MacOS/Chromium",
        "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    ),
    "win32": (
        r"C:\Program Files\Google\Chrome\Application\chrome.exe",
        r"C:\Program Files (x86)\Google\Chrome\Application\chrome.exe",
        r"C:\Program Files (x86)\Microsoft\Edge\Application\msedge.exe",
        r"C:\Program Files\Microsoft\Edge\Application\msedge.exe",
    ),
}
"""Where browsers lie on systems that keep them off PATH, by ``sys.platform``."""

LONGEST = 300  # seconds that printing may take
DRAWING = 120_000  # milliseconds that the script of a page has to draw its figures
_PAGE = re.compile(rb"(?m)^(\d+) 0 obj\s*<<\s*/Type\s*/Page\b")
_PLACE = re.compile(rb"/(part-\d+)\s*\[\s*(\d+) 0 R")


def find_browser() -> str:
    """Find the browser that prints; :class:`~jaxhb.report.files.output.OutputError`
    where there is none.
    """
    named = os.environ.get(VARIABLE)
    if named:
        found = shutil.which(named)
        if found is None:
            raise OutputError(
                f"--pdf: {VARIABLE} is {named!r}, which is no program. Correct it."
            )
        return found
    candidates = [*map(shutil.which, NAMES), *PLACES.get(sys.platform, ())]
    for candidate in candidates:
        if candidate is not None and Path(candidate).is_file():
            return candidate
    raise OutputError(
        "--pdf: a browser prints the page, and none was found: install Chromium, Chrome"
        f" or Edge, or put the path of one in {VARIABLE}. Or write --html FILE.html and"
        " print it."
    )


def printed(page: Callable[[Mapping[str, int]], bytes]) -> bytes:
    """Print a page as PDF, its contents with the numbers of the pages: a function that
    writes the page for numbers by the names of its parts, which are known when it was
    printed once.
    """
    numbers = page_numbers(_print(page({})))
    return _print(page(numbers))


def page_numbers(pdf: bytes) -> dict[str, int]:
    """Read on which page of a PDF of a browser each part of the page begins.

    >>> pdf = (
    ...     b"3 0 obj\\n<</Type /Page\\n>>\\nendobj\\n7 0 obj\\n<</Type /Page\\n>>\\n"
    ...     b"9 0 obj\\n<</part-1 [3 0 R /XYZ 0 7 0]\\n/part-2 [7 0 R /XYZ 0 9 0]>>"
    ... )
    >>> page_numbers(pdf)
    {'part-1': 1, 'part-2': 2}
    """
    pages = {int(found): k for k, found in enumerate(_PAGE.findall(pdf), start=1)}
    return {
        name.decode(): pages[int(place)]
        for name, place in _PLACE.findall(pdf)
        if int(place) in pages
    }


def _print(html: bytes) -> bytes:
    """Print the bytes of a page as those of a PDF."""
    # It loads modules that no command line without a file needs.
    import tempfile

    browser = find_browser()
    with tempfile.TemporaryDirectory(prefix="jaxhb") as name:
        folder = Path(name)
        source = folder / "page.html"
        target = folder / "page.pdf"
        source.write_bytes(html)
        command = [
            browser,
            "--headless",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--no-first-run",
            "--no-pdf-header-footer",
            "--generate-pdf-document-outline",
            # Nothing is loaded when the page is opened.
            "--host-resolver-rules=MAP * ~NOTFOUND",
            f"--virtual-time-budget={DRAWING}",
            f"--user-data-dir={folder / 'profile'}",
            f"--print-to-pdf={target}",
        ]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            command.append("--no-sandbox")  # browsers have none for root
        try:
            subprocess.run(
                [*command, source.as_uri()],
                capture_output=True,
                timeout=LONGEST,
                check=True,
            )
            return target.read_bytes()
        except (OSError, subprocess.SubprocessError) as error:
            raise OutputError(
                f"--pdf: {browser!r} did not print the page: {_reason(error)} Put the"
                f" path of another browser in {VARIABLE}, or write --html FILE.html and"
                " print it."
            ) from None


def _reason(error: Exception) -> str:
    """Say in a sentence why a browser failed."""
    if isinstance(error, subprocess.TimeoutExpired):
        return f"it took more than {LONGEST} s."
    if isinstance(error, subprocess.CalledProcessError):
        lines = error.stderr.decode(errors="replace").strip().splitlines()
        return f"exit status {error.returncode}, {lines[-1] if lines else 'silently'}."
    return f"{error}."
