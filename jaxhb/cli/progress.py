"""One line on the terminal that says what is being computed and for how long; now and
then a line in a log.
"""

import contextlib
import sys
import threading
import time
from typing import TextIO

BEGUN = "computing"  # before anything is said
INTERVAL = 0.5  # seconds between lines on a terminal
LOGGED = 30.0  # the same where stderr is none


class Progress:
    """A status line on ``stream`` (stderr) while a block runs, for a ``total`` of
    steps; a count only of several.
    """

    def __init__(
        self, total: int = 1, stream: TextIO | None = None, quiet: bool = False
    ):
        self.total = total
        self.done = 0
        self.text = ""
        self.width = 0
        self.stream = None if quiet else stream or sys.stderr
        self.terminal = self.stream is not None and self.stream.isatty()
        self.begin = time.monotonic()
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._tick, daemon=True)

    def __enter__(self) -> "Progress":
        if self.stream is not None:
            self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.ended.set()
        if self.stream is not None:
            self.thread.join()
        if self.terminal:
            self._write(f"\r{'':<{self.width}}\r")

    def say(self, text: str) -> None:
        """Show what is being done, without a further step."""
        self.text = text

    def advance(self, count: int) -> None:
        """Count ``count`` further steps."""
        self.done += count

    def _tick(self) -> None:
        while not self.ended.wait(INTERVAL if self.terminal else LOGGED):
            count = f"{self.done} of {self.total}" if self.total > 1 else ""
            text = ": ".join(filter(None, [count, self.text])) or BEGUN
            line = f"{text} ({time.monotonic() - self.begin:.0f} s)"
            self._write(f"\r{line:<{self.width}}" if self.terminal else f"{line}\n")
            self.width = len(line)

    def _write(self, text: str) -> None:
        if self.stream is None:
            return
        # A log that is full or closed ends no computation.
        with contextlib.suppress(OSError, ValueError):
            self.stream.write(text)
            self.stream.flush()
