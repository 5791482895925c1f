"""One line on the terminal that says what is being computed and for how long; now and then a line in a log."""

import contextlib
import sys
import threading
import time

INTERVAL = 0.5

LOGGED = 30.0
"""Seconds between lines where stderr is no terminal."""


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
    ...     progress.say("600 rpm")
    ...     progress.advance(1)
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
            self._write(self._renewed("") + "\r")

    def say(self, text):
        """What is being done, without a further step."""
        self.text = text

    def advance(self, count):
        """Count ``count`` further steps."""
        self.done += count

    def _tick(self):
        while not self.ended.wait(INTERVAL if self.terminal else LOGGED):
            count = f"{self.done} of {self.total}: " if self.total > 1 else ""
            line = f"{count}{self.text} ({time.monotonic() - self.begin:.0f} s)"
            self._write(self._renewed(line) if self.terminal else f"{line}\n")

    def _renewed(self, line):
        width, self.width = self.width, len(line)
        return f"\r{line:<{width}}"

    def _write(self, text):
        with contextlib.suppress(OSError, ValueError):  # a log that is full or closed ends no computation
            self.stream.write(text)
            self.stream.flush()
