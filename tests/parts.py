"""Parts of a work for tests of executors: functions that worker processes import, which
must not import jax.
"""

import os
import signal
import time
from pathlib import Path


def square(number):
    return number**2


def processor_limit(number):
    return os.environ["NPROC"]


def refused(number):
    raise ValueError(f"{number} is refused")


def killed_once(folder, number):
    """Kill the worker at the first attempt at number 3."""
    mark = Path(folder) / "mark"
    if number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def killing(number):
    """Kill the worker at every attempt at number 3."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def endless(folder):
    """Note the process, and never end."""
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(600)
