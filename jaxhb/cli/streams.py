"""Standard output and error as they are found, full, closed or of another encoding, and
the signals that end a run.
"""

import contextlib
import errno
import io
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from typing import Any

CLOSED = 141  # exit status: the reader of the output had enough, as after SIGPIPE
UNWRITABLE = 2  # exit status: the output cannot be written


class Ended(KeyboardInterrupt):
    """A signal that asks the process to end; commands clean up as after Ctrl-C."""

    def __init__(self, number: int):
        super().__init__()
        self.status = 128 + number


class _Closed(io.TextIOBase):
    """Stands for a standard output that is closed: Python has none then, and what is
    printed would be lost unseen.
    """

    def write(self, text: str) -> int:
        raise OSError(errno.EBADF, "it is closed")

    def writelines(self, lines: Iterable) -> None:
        self.write("")

    @property
    def buffer(self) -> "_Closed":
        """Takes bytes as little as the stream takes text."""
        return self


def _take_closed_streams() -> None:
    """Put the null device in the place of closed standard streams: the next file that
    is opened would be taken for them.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    if sys.stdout is None:
        sys.stdout = _Closed()
    if sys.stderr is None:
        # What is printed to none would go to standard output.
        sys.stderr = io.StringIO()


def guarded(run: Callable[[], int]) -> int:
    """The exit status of ``run()``, which prints; what is wrong with standard output is
    told in a sentence.
    """
    _take_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure") and stream.errors == "strict":
            # Any name can be written, whatever the encoding lacks.
            stream.reconfigure(errors="backslashreplace")
    with _ending_by_signals():
        try:
            status = run()
            sys.stdout.flush()
        except OSError as error:
            closed = isinstance(error, BrokenPipeError)
            status = CLOSED if closed else UNWRITABLE
            # Else the interpreter tries again when it exits.
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            reason = f"cannot be written: {error.strerror}"
            if closed:
                reason = "was closed before all of it was written"
            tell(f"standard output {reason}.")
    return status


def tell(sentence: str) -> None:
    """Print a sentence on standard error, if that can be written."""
    with contextlib.suppress(OSError, AttributeError, ValueError):
        print(sentence, file=sys.stderr)
        sys.stderr.flush()


@contextlib.contextmanager
def _ending_by_signals() -> Iterator[None]:
    """Raise :class:`Ended` where the system asks the process to end, in the main thread
    alone.
    """

    def end(number: int, _: Any) -> None:
        raise Ended(number)

    before = {}
    with contextlib.suppress(ValueError):  # another thread than the main one
        hangup = getattr(signal, "SIGHUP", signal.SIGTERM)  # Windows has none
        for number in (signal.SIGTERM, hangup):
            if signal.getsignal(number) == signal.SIG_DFL:
                before[number] = signal.signal(number, end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
