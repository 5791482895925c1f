"""Renews what the pages show of the program's output: ``python docs/shown.py [--check]
[PAGE ...]``.

A page shows a command and what it prints in a block of text whose first line is ``$
jaxhb ...``. A line ``...`` stands for lines that are left out; the lines behind it are
found in the output by their words. The commands of a page run one after another in a
folder of their own, so that a block may read what an earlier one wrote; a block of TOML
whose first line is ``# NAME.toml`` is a file there. Seconds that a run took stay as
they are shown.
"""

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"```text\n(\$ jaxhb [^\n]*)\n(.*?)```", re.DOTALL)
WRITTEN = re.compile(r"```toml\n# (\w+\.toml)\n(.*?)```", re.DOTALL)
"""A block of TOML that begins with its name: commands of the page read it."""

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)")
SECONDS = re.compile(r"\b\d+ s\b")
LEFT_OUT = "..."
SCENES = {"how_to/strength.md": {"line.toml": "tests/data/scenes/limited_line.toml"}}
"""Scenes that the commands of a page read, beside those that the package brings."""

NOISE = 0.03  # of the measurement that is fitted on a page, over the amplitude
MEASURED_ORDERS = (0.5, *np.arange(1.5, 13.0, 1.5))


@dataclass(frozen=True)
class Shown:
    """One command of a page and the lines of its output that the page shows."""

    page: Path
    command: str
    lines: tuple[str, ...]

    def name(self) -> str:
        return f"{self.page.relative_to(ROOT)}: {self.command}"


def pages() -> list[Path]:
    """Pages that show output."""
    written = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return [page for page in written if BLOCK.search(page.read_text(encoding="utf-8"))]


def shown_on(page: Path) -> list[Shown]:
    """Blocks that a page shows, in its order."""
    text = page.read_text(encoding="utf-8")
    return [
        Shown(page, command, tuple(body.splitlines()))
        for command, body in BLOCK.findall(text)
    ]


def write_inputs(page: Path, folder: Path) -> None:
    """Write the files that the commands of a page read."""
    relative = page.relative_to(ROOT).as_posix().removeprefix("docs/")
    for name, source in SCENES.get(relative, {}).items():
        shutil.copy(ROOT / source, folder / name)
    for name, content in WRITTEN.findall(page.read_text(encoding="utf-8")):
        (folder / name).write_text(content, encoding="utf-8")
    if relative == "how_to/measurements.md":
        write_measurement(folder / "measured.csv")


def write_measurement(path: Path) -> None:
    """Write twelve orders of a flywheel torque, of a diesel whose cylinder 4 is weak,
    with 3 % of noise.
    """
    import jaxhb  # here, so that the pages are read without it

    true_values = {
        "cyl6|flywheel.stiffness": 1.85e6,
        "pulley.inertia": 0.02,
        "cylinder 4.injection": 0.8,
    }
    train = jaxhb.load_scene("six_cylinder_diesel").replace(
        true_values | {"cyl6.inertia": 0.0487 * 1.1}
    )
    speeds = np.linspace(800.0, 2400.0, 15)
    torque = jaxhb.forced_response(train, rpm=speeds).torque("cyl6", "flywheel")
    amplitudes, phases = np.asarray(torque.amplitudes), np.deg2rad(torque.phases_deg)
    random = np.random.default_rng(4)
    rows = ["rpm,order,element,quantity,amplitude,phase"]
    for index, order in enumerate(torque.orders):
        if order not in MEASURED_ORDERS:
            continue
        noise = random.normal(0.0, NOISE, (2, len(speeds)))
        noisy = (
            amplitudes[:, index]
            * np.exp(1j * phases[:, index])
            * (1.0 + noise[0] + 1j * noise[1])
        )
        for rpm, value in zip(speeds, noisy, strict=True):
            phase = np.angle(value, deg=True)
            rows.append(
                f"{rpm:.0f},{order:g},cyl6|flywheel,torque,{abs(value):.4g},{phase:.1f}"
            )
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def printed(command: str, folder: Path) -> list[str]:
    """Lines that a command prints in a folder; RuntimeError if it is refused."""
    words = [sys.executable, "-m", *shlex.split(command.removeprefix("$ "))]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run(
        words, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    if run.returncode not in (0, 1):
        raise RuntimeError(f"{command}\n{run.stderr}")
    return run.stdout.rstrip("\n").splitlines()


def renewed(shown: Sequence[str], output: Sequence[str]) -> list[str]:
    """The output with as many lines left out as the lines ``shown`` leave out;
    ValueError where one is not found.
    """
    parts: list[list[str]] = [[]]
    for line in shown:
        if line == LEFT_OUT:
            parts.append([])
        else:
            parts[-1].append(line)
    lines: list[str] = []
    place = 0
    for number, part in enumerate(parts):
        if number:
            lines.append(LEFT_OUT)
        if not part:
            continue
        begin = place if number == 0 else _first_like(part[0], output, place)
        last = number == len(parts) - 1
        end = len(output) if last else begin + len(part)
        lines += output[begin:end]
        place = end
    return [_with_seconds_of(shown, line) for line in lines]


def _first_like(line: str, output: Sequence[str], place: int) -> int:
    """Index from ``place`` on of the line of the output that is ``line``, or else that
    has its words.
    """
    for alike in (str, words_of):
        wanted = alike(line)
        for index in range(place, len(output)):
            if alike(output[index]) == wanted:
                return index
    raise ValueError(f"no line of the output reads like {line!r}")


def _with_seconds_of(shown: Sequence[str], line: str) -> str:
    """The line of the page where the two differ by how long the run took alone."""
    timeless = SECONDS.sub("", line)
    return next((old for old in shown if SECONDS.sub("", old) == timeless), line)


def words_of(line: str) -> str:
    """Words of a line without its numbers and spaces."""
    return " ".join(NUMBER.sub("#", line).split())


def renew(page: Path, folder: Path) -> list[tuple[Shown, list[str]]]:
    """Run the commands of a page; what it shows, and what it should."""
    write_inputs(page, folder)
    return [
        (shown, renewed(shown.lines, printed(shown.command, folder)))
        for shown in shown_on(page)
    ]


def main() -> int:
    """Renew pages, or with ``--check`` tell which are out of date."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--check", action="store_true", help="write nothing, tell what differs"
    )
    parser.add_argument(
        "pages", nargs="*", type=Path, help="pages to renew, all by default"
    )
    asked = parser.parse_args()
    outdated = 0
    for page in [path.resolve() for path in asked.pages] or pages():
        with tempfile.TemporaryDirectory() as folder:
            results = renew(page, Path(folder))
        text = page.read_text(encoding="utf-8")
        for shown, lines in results:
            if list(shown.lines) != lines:
                outdated += 1
                print(
                    f"renewed: {shown.name()}"
                    if not asked.check
                    else f"out of date: {shown.name()}"
                )
            before = "\n".join(["```text", shown.command, *shown.lines])
            text = text.replace(before, "\n".join(["```text", shown.command, *lines]))
        if not asked.check:
            page.write_text(text, encoding="utf-8")
    return 1 if asked.check and outdated else 0


if __name__ == "__main__":
    raise SystemExit(main())
