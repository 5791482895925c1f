"""One line on the terminal that says what is being computed and for how long; silent when stderr is no terminal."""

import sys
import threading
import time

INTERVAL = 0.5


class Progress:
    """A status line on stderr, refreshed twice a second while a block runs.

    Nothing is written where stderr is not a terminal, so that logs and pipes stay clean.

    Parameters
    ----------
    total : int, number of steps to come (1: no count is shown)
    stream : text stream, by default stderr

    Examples
    --------
    >>> with Progress(2) as progress:
    ...     progress.step("600 rpm")
    ...     progress.step("1200 rpm")
    """

    def __init__(self, total=1, stream=None):
        self.total = total
        self.stream = sys.stderr if stream is None else stream
        self.visible = self.stream.isatty()
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
        while not self.ended.wait(INTERVAL):
            self._write(self.line())

    def _write(self, line):
        self.stream.write("\r" + line.ljust(self.width))
        self.stream.flush()
        self.width = len(line)
