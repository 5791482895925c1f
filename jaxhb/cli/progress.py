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
MANY = 1000  # steps from which their rate tells how long all take
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
        self.before = 0
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

    def resume(self, count: int) -> None:
        """Count steps that were done before."""
        self.before = count
        self.done += count

    def _left(self, seconds: float) -> str:
        """How long it takes yet, as a line tells it; "" where nothing is known."""
        done = self.done - self.before
        if not done or self.total < MANY:
            return ""
        rate = done / seconds
        return f", {rate:.3g} a second, {(self.total - self.done) / rate:.0f} s to go"

    def _tick(self) -> None:
        while not self.ended.wait(INTERVAL if self.terminal else LOGGED):
            count = f"{self.done} of {self.total}" if self.total > 1 else ""
            text = ": ".join(filter(None, [count, self.text])) or BEGUN
            seconds = time.monotonic() - self.begin
            line = f"{text} ({seconds:.0f} s{self._left(seconds)})"
            self._write(f"\r{line:<{self.width}}" if self.terminal else f"{line}\n")
            self.width = len(line)

    def _write(self, text: str) -> None:
        if self.stream is None:
            return
        # A log that is full or closed ends no computation.
        with contextlib.suppress(OSError, ValueError):
            self.stream.write(text)
            self.stream.flush()
