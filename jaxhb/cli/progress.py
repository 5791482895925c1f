"""One line on the terminal that says what is being computed and for how long; now and then a line in a log."""

import contextlib
import sys
import threading
import time

INTERVAL = 0.5

LOGGED = 30.0
"""Seconds between lines where stderr is no terminal."""


UNWRITTEN = contextlib.suppress(OSError, ValueError)
"""A log that is full or closed ends no computation."""


class Progress:
    """A status line on stderr, refreshed twice a second while a block runs.

    Where stderr is no terminal, a line is added every 30 seconds, so that a log tells that something goes on.

    Parameters
    ----------
    total : int, number of steps to come (1: no count is shown)
    stream : text stream, by default stderr
    quiet : bool, whether nothing is written

    Examples
    --------
    >>> with Progress(2) as progress:
    ...     progress.step("600 rpm")
    ...     progress.step("1200 rpm")
    """

    def __init__(self, total=1, stream=None, quiet=False):
        self.total = total
        self.stream = sys.stderr if stream is None else stream
        self.visible = not quiet and self.stream is not None
        self.terminal = self.visible and self.stream.isatty()
        self.done, self.text, self.width = 0, "", 0
        self.begin = time.monotonic()
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._tick, daemon=True)

    def __enter__(self):
        if self.visible:
            self.thread.start()
        return self

    def __exit__(self, *_):
        self.ended.set()
        if self.visible:
            self.thread.join()
        if self.terminal:
            with UNWRITTEN:
                self._write("")
                self.stream.write("\r")
                self.stream.flush()

    def step(self, text):
        """Begin the next step."""
        self.advance(1)
        self.text = text

    def say(self, text):
        """What is being done, without a further step."""
        self.text = text

    def advance(self, count):
        """Count ``count`` further steps."""
        self.done += count

    def line(self):
        """Text of the line at this moment."""
        count = f"{self.done} of {self.total}: " if self.total > 1 else ""
        return f"{count}{self.text} ({time.monotonic() - self.begin:.0f} s)"

    def _tick(self):
        while not self.ended.wait(INTERVAL if self.terminal else LOGGED):
            with UNWRITTEN:
                self._write(self.line())

    def _write(self, line):
        self.stream.write("\r" + line.ljust(self.width) if self.terminal else f"{line}\n")
        self.stream.flush()
        self.width = len(line)
