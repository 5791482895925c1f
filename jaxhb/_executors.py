"""Executors: independent parts of a work on processes of this machine or of a cluster.

A part is a function of a module and plain arguments. Any executor of
:mod:`concurrent.futures` runs parts; those made here go on where a worker dies.
Nothing here imports numpy or jax: a worker sets its environment first.
"""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    wait,
)
from concurrent.futures.process import BrokenProcessPool, ProcessPoolExecutor
from functools import partial
from importlib import import_module
from itertools import islice
from multiprocessing import get_context, parent_process
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TypeVar

Result = TypeVar("Result")

BESIDE_OTHERS = 1  # deaths of its worker after which a part runs alone
OPENED = 3  # times that workers are opened for a part which they do not take
ALONE = 3  # deaths of a worker that ran nothing else after which a part is given up
WAITING = 2  # parts that wait for each worker, so that none is idle
MANY = 1000  # parts handed out where an executor does not tell how many workers it has

ONE_PROCESSOR = {"NPROC": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment of a worker: threads of jax, and of numpy."""


class WorkerLost(RuntimeError):
    """A part whose worker died each time: a sentence."""


def in_parts(
    function: Callable[..., Result],
    parts: Iterable[Sequence[Any]],
    executor: Executor | None = None,
    lost: Callable[[int, WorkerLost], Result] | None = None,
) -> Generator[tuple[int, Result]]:
    """Yield the number of each part and ``function(*arguments)`` for it as soon as it
    is there; without an executor one after another, in this process.

    parts : arguments of each part, taken when there is room for it; lost : gives the
    result of a part that killed its workers, by default :class:`WorkerLost` is raised
    """
    numbered = enumerate(parts)
    if executor is None:
        for number, arguments in numbered:
            yield number, function(*arguments)
        return
    from jaxhb._program import kept_programs

    call = partial(_computed, os.getpid(), kept_programs() is not None, function)
    pending: dict[Future, int] = {}
    try:
        while True:
            room = _room(executor) - len(pending)
            for number, arguments in islice(numbered, max(room, 0)):
                future = executor.submit(call, *arguments)
                pending[future] = number
            if not pending:
                return
            done, _ = wait(pending, return_when=FIRST_COMPLETED)
            for future in done:
                number = pending.pop(future)
                failure = future.exception()
                if isinstance(failure, WorkerLost) and lost is not None:
                    yield number, lost(number, failure)
                else:
                    yield number, future.result()
    finally:
        for future in pending:
            future.cancel()


def _computed(
    driver: int, keeps: bool, function: Callable[..., Result], *arguments: Any
) -> Result:
    """``function(*arguments)``; in a process other than the ``driver``, if that keeps
    its programs, with those of the user on its disk.
    """
    if keeps and os.getpid() != driver:
        from jaxhb._program import keep_programs, kept_programs
        from jaxhb._store import user_folder

        if kept_programs() is None:
            keep_programs(user_folder())
    return function(*arguments)


def _room(executor: Executor) -> int:
    """Number of parts that an executor is given at a time."""
    workers = getattr(executor, "workers", getattr(executor, "_max_workers", None))
    return (1 + WAITING) * workers if isinstance(workers, int) else MANY


class _Part:
    """A part under way: its call, the future of its caller, and how often its worker
    died.
    """

    def __init__(self, call: Callable[[], Any]):
        self.call = call
        self.future: Future = Future()
        self.deaths = 0

    def end(self, failure: BaseException | None, result: Any = None) -> None:
        """Tell the caller how it ended."""
        if not self.future.set_running_or_notify_cancel():
            return
        if failure is None:
            self.future.set_result(result)
        else:
            self.future.set_exception(failure)


class LastingExecutor(Executor):
    """An executor that outlives its workers: what ran on one that died runs again.

    A part whose worker died beside others runs alone, so that the one that kills
    workers is told from those that were near it; in the end it is
    :class:`WorkerLost`. A subclass opens what runs the parts, and knows which failures
    are its.
    """

    workers: int

    def __init__(self) -> None:
        # What is to be done next, by one thread: pools call back under locks of theirs.
        self._tasks: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._inner: Executor | None = None
        self._inner_alone: Executor | None = None
        self._suspects: deque[_Part] = deque()
        self._suspect: _Part | None = None
        self._closed = False

    def open(self, workers: int) -> Executor:
        """Open an executor with so many workers."""
        raise NotImplementedError

    def broke(self, failure: BaseException) -> bool:
        """Whether a failure is that of workers, not of the part."""
        raise NotImplementedError

    def end(self, inner: Executor, wait: bool, cancel_futures: bool) -> None:
        """End an executor that :meth:`open` opened."""
        inner.shutdown(wait=wait, cancel_futures=cancel_futures)

    def submit(self, function: Callable, /, *args: Any, **kwargs: Any) -> Future:
        """Run a function on a worker."""
        if self._closed:
            raise RuntimeError("the executor is closed")
        if self._thread.ident is None:
            self._thread.start()
        part = _Part(partial(function, *args, **kwargs))
        self._tasks.put(partial(self._run, part))
        return part.future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers, what is under way too where futures are cancelled."""
        self._closed = True
        if self._thread.ident is None:
            self._close(wait, cancel_futures)
            return
        self._tasks.put(partial(self._close, wait, cancel_futures))
        self._tasks.put(None)
        if wait:
            self._thread.join()

    def _work(self) -> None:
        """Do what is to be done, until the executor is closed."""
        while (task := self._tasks.get()) is not None:
            task()

    def _close(self, wait: bool, cancel_futures: bool) -> None:
        for executor in (self._inner, self._inner_alone):
            if executor is not None:
                self.end(executor, wait, cancel_futures)

    def _run(self, part: _Part) -> None:
        """Hand a part to the workers, to new ones where these have died."""
        failure: Exception | None = None
        for _ in range(OPENED):
            if part.future.cancelled():
                return
            try:
                inner = self._inner = self._inner or self.open(self.workers)
                attempt = inner.submit(part.call)
            except Exception as error:
                failure = error
                if self._inner is not None:  # workers died that never had it
                    self._forget(self._inner)
            else:
                self._await(part, inner, attempt)
                return
        part.end(failure)

    def _run_alone(self) -> None:
        """Hand the next suspect to a worker that runs nothing else."""
        if self._suspect is not None or not self._suspects:
            return
        part = self._suspect = self._suspects.popleft()
        try:
            inner = self._inner_alone = self._inner_alone or self.open(1)
            attempt = inner.submit(part.call)
        except Exception as failure:
            self._suspect = None
            part.end(failure)
        else:
            self._await(part, inner, attempt)

    def _await(self, part: _Part, inner: Executor, attempt: Future) -> None:
        ended = partial(self._ended, part, inner, attempt)
        attempt.add_done_callback(lambda _: self._tasks.put(ended))
        part.future.add_done_callback(
            lambda caller: attempt.cancel() if caller.cancelled() else None
        )

    def _ended(self, part: _Part, inner: Executor, attempt: Future) -> None:
        """Take the end of an attempt at a part: its result, or that of its workers."""
        if part is self._suspect:
            self._suspect = None
        if part.future.cancelled():
            self._run_alone()
            return
        failure = (
            CancelledError() if attempt.cancelled() else attempt.exception(timeout=0)
        )
        if failure is None:
            part.end(None, attempt.result(timeout=0))
        elif self._closed or not self.broke(failure):
            part.end(failure)
        else:
            self._forget(inner)
            part.deaths += 1
            if part.deaths <= BESIDE_OTHERS:
                self._run(part)
            elif part.deaths < BESIDE_OTHERS + ALONE:
                self._suspects.append(part)
            else:
                part.end(
                    WorkerLost(
                        "the worker process ended each time it was computed, as where"
                        " memory is too little"
                    )
                )
        self._run_alone()

    def _forget(self, inner: Executor) -> None:
        """Let go of an executor whose workers have died."""
        if inner is self._inner:
            self._inner = None
        if inner is self._inner_alone:
            self._inner_alone = None
        self.end(inner, wait=False, cancel_futures=True)


class Workers(LastingExecutor):
    """Processes of this machine, one processor each, as an executor.

    They share compiled programs on disk where :func:`jaxhb.cache_programs` was called
    before. A worker that dies, for lack of memory say, is replaced, and what it
    computed is computed again; a part that kills its worker each time raises
    ``WorkerLost``. Scripts that use it need the usual ``if __name__ == "__main__":`` of
    :mod:`multiprocessing`.

    Parameters
    ----------
    workers : int, optional
        Number of processes; default: one for each processor.

    Examples
    --------
    >>> import jaxhb
    >>> with jaxhb.Workers(2) as workers:  # doctest: +SKIP
    ...     sweep = jaxhb.steady_state(train, rpm=speeds, executor=workers, chunk=50)
    """

    def __init__(self, workers: int | None = None):
        from jaxhb._jax import processors

        super().__init__()
        self.workers = processors() if workers is None else workers
        if self.workers < 1:
            raise ValueError(f"workers is {workers}, must be at least 1")

    def open(self, workers: int) -> Executor:
        """Open a pool of processes, which all begin at once."""
        from jaxhb._program import kept_programs

        pool = ProcessPoolExecutor(
            workers,
            get_context("spawn"),
            initializer=_begin,
            initargs=(kept_programs(),),
        )
        for _ in range(workers):
            pool.submit(int)
        return pool

    def broke(self, failure: BaseException) -> bool:
        """Whether a process of the pool died."""
        return isinstance(failure, BrokenProcessPool)

    def end(self, inner: Executor, wait: bool, cancel_futures: bool) -> None:
        """End a pool; its processes at once, if nobody wants what they are at."""
        processes = list((getattr(inner, "_processes", None) or {}).values())
        inner.shutdown(wait=wait and not cancel_futures, cancel_futures=cancel_futures)
        if cancel_futures:
            for process in processes:
                process.terminate()


def _begin(programs: Path | None) -> None:
    """Begin as a worker: one processor, the programs of all, and an end with the
    process that started it.
    """
    os.environ.update(ONE_PROCESSOR)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who started it sees to that
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    if programs is not None:
        from jaxhb._program import keep_programs

        keep_programs(programs)
        # What nearly every part needs, while the first part is computed elsewhere.
        import_module("jaxhb.steady.steady_state")


def _end_with(parent: Any) -> None:
    """End this process when its parent has ended, however it did."""
    parent.join()
    os._exit(1)


class Cluster(LastingExecutor):
    """Workers of a Dask scheduler as an executor; needs ``jaxhb[cluster]``, there too.

    The scheduler runs again what a worker that died was at; where the scheduler itself
    was started anew, what was handed to it is handed out again.

    Parameters
    ----------
    address : str
        Of the scheduler, as ``"tcp://10.0.0.5:8786"``.
    wait : float
        Seconds to wait for a scheduler that is not there.
    """

    def __init__(self, address: str, *, wait: float = 600.0):
        super().__init__()
        self.address = address
        self.wait = wait
        self.dashboard = ""

    def connect(self) -> str:
        """Wait for the scheduler; the address of the page that shows its work. OSError
        where it does not answer.
        """
        self._inner = self._inner or self.open(self.workers)
        return self.dashboard

    def open(self, workers: int) -> Executor:
        """Open a client of the scheduler."""
        from distributed import Client

        client = Client(self.address, timeout=self.wait)
        self.dashboard = client.dashboard_link
        return client.get_executor(pure=False)

    @property
    def workers(self) -> int:  # type: ignore[override]
        """Number of threads of all workers at the moment."""
        client: Any = getattr(self._inner, "_client", None)
        return max(sum(client.ncores().values()), 1) if client else 1

    def end(self, inner: Any, wait: bool, cancel_futures: bool) -> None:
        """Leave the scheduler."""
        inner.shutdown(wait=wait and not cancel_futures)
        inner._client.close()

    def broke(self, failure: BaseException) -> bool:
        """Whether the scheduler or its workers ended, not the part."""
        from distributed import KilledWorker
        from distributed.comm import CommClosedError

        return isinstance(failure, KilledWorker | CancelledError | CommClosedError)
