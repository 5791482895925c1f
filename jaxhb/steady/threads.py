"""Generators that wait for work in other threads, driven side by side."""

import os
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import contextmanager
from contextvars import copy_context

import jax

MOST_THREADS = 8  # in which marches and classifications run: each holds some memory


@contextmanager
def side_by_side(devices):
    """What begins a function in one of some threads, and gives its Future. Across several devices one at a time."""
    # More threads than processors: some wait for programs that others make.
    threads = ThreadPoolExecutor(min(2 * (os.cpu_count() or 1), MOST_THREADS) if len(devices) < 2 else 1, "jaxhb-march")
    device = jax.config.jax_default_device

    def run(context, function, *args):
        with jax.default_device(device):
            return context.run(function, *args)

    try:
        yield lambda function, *args: threads.submit(run, copy_context(), function, *args)
    finally:
        threads.shutdown(cancel_futures=True)


def driven(generators):
    """What generators return, in their order, driven side by side.

    A generator yields a Future, and is sent its result as soon as it is there.
    """
    returned, waiting = {}, {}

    def go_on(generator, result=None):
        """From one yield to the next."""
        try:
            waiting[generator.send(result)] = generator
        except StopIteration as end:
            returned[generator] = end.value

    for generator in generators:
        go_on(generator)
    while waiting:
        for future in wait(waiting, return_when=FIRST_COMPLETED).done:
            go_on(waiting.pop(future), future.result())
    return [returned[generator] for generator in generators]
