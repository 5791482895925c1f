"""Standard output and error as they are found, full, closed or of another encoding, and
the signals that end a run.
"""

import contextlib
import errno
import io
import os
import signal
import sys

CLOSED, UNWRITABLE = (
    141,
    2,
    # Exit status: the reader of the output had enough, as after SIGPIPE; it cannot be
    # written
)


class Ended(KeyboardInterrupt):
    """A signal that asks the process to end; commands clean up as after Ctrl-C."""

    def __init__(self, number):
        super().__init__()
        self.status = 128 + number


class _Closed(io.TextIOBase):
    """Stands for a standard output that is closed: Python has none then, and what is
    printed would be lost unseen.
    """

    def write(self, text):
        raise OSError(errno.EBADF, "it is closed")

    def writelines(self, lines):
        self.write("")

    @property
    def buffer(self):
        """Takes bytes as little as the stream takes text."""
        return self


def _take_closed_streams():
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
        sys.stderr = (
            io.StringIO()
        )  # what is printed to none would go to standard output


def guarded(run):
    """The exit status of ``run()``, which prints; what is wrong with standard output is
    told in a sentence.
    """
    _take_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure") and stream.errors == "strict":
            stream.reconfigure(
                errors="backslashreplace"
            )  # any name can be written, whatever the encoding lacks
    with _ending_by_signals():
        try:
            status = run()
            sys.stdout.flush()
        except OSError as error:
            closed = isinstance(error, BrokenPipeError)
            status = CLOSED if closed else UNWRITABLE
            with contextlib.suppress(
                OSError, ValueError
            ):  # else the interpreter tries again when it exits
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            why = (
                "was closed before all of it was written"
                if closed
                else f"cannot be written: {error.strerror}"
            )
            tell(f"standard output {why}.")
    return status


def tell(sentence):
    """Print a sentence on standard error, if that can be written."""
    with contextlib.suppress(OSError, AttributeError, ValueError):
        print(sentence, file=sys.stderr)
        sys.stderr.flush()


@contextlib.contextmanager
def _ending_by_signals():
    """Raise :class:`Ended` where the system asks the process to end, in the main thread
    alone.
    """

    def end(number, _):
        raise Ended(number)

    before = {}
    with contextlib.suppress(ValueError):  # another thread than the main one
        for number in (
            signal.SIGTERM,
            getattr(signal, "SIGHUP", signal.SIGTERM),
        ):  # Windows has no SIGHUP
            if signal.getsignal(number) == signal.SIG_DFL:
                before[number] = signal.signal(number, end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
