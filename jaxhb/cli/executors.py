"""Where a command computes independent parts: this process, worker processes of this
machine, or the workers of a scheduler.
"""

import contextlib
import importlib.util
import sys
from collections.abc import Iterator
from concurrent.futures import Executor

from jaxhb import _executors
from jaxhb._store import user_folder
from jaxhb.cli import arguments as cli
from jaxhb.report.files.output import OutputError


@contextlib.contextmanager
def executor_of(arguments: cli.ParallelOptions) -> Iterator[Executor | None]:
    """The executor that a command is given, None for this process; its workers end with
    the block.
    """
    if arguments.workers and arguments.scheduler:
        raise OutputError("--workers and --scheduler exclude each other.")
    if arguments.scheduler:
        if importlib.util.find_spec("distributed") is None:
            raise OutputError(
                '--scheduler: it needs distributed. Install it: pip install "jaxhb'
                '[cluster]".'
            )
        cluster = _executors.Cluster(arguments.scheduler)
        with cluster:
            try:
                dashboard = cluster.connect()
            except OSError as error:
                raise OutputError(
                    f"--scheduler: no scheduler answers at {arguments.scheduler!r}:"
                    f" {error}."
                ) from None
            if not arguments.quiet:
                print(f"The scheduler shows its work at {dashboard}", file=sys.stderr)
            yield cluster
    elif arguments.workers:
        with _executors.Workers(arguments.workers, programs=user_folder()) as workers:
            yield workers
    else:
        yield None
