"""Generators that wait for work in other threads, driven side by side."""

import os
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import contextmanager
from contextvars import copy_context

import jax

MOST_THREADS = 8
"""In which marches and classifications run: each holds some memory."""


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

    A generator yields a Future, and is sent its result as soon as it is there; or it yields a list of generators, and
    goes on when the last of these has returned.
    """
    returned, waiting, left = {}, {}, {}

    def go_on(generator, parent, result=None):
        """From one yield to the next; ``parent``: what yielded it in a list, with its own parent."""
        try:
            wanted = generator.send(result)
        except StopIteration as end:
            returned[generator] = end.value
            if parent is not None:
                left[parent[0]] -= 1
                if not left[parent[0]]:
                    go_on(*parent)
            return
        if isinstance(wanted, list):
            left[generator] = len(wanted)
            for one in wanted:
                go_on(one, (generator, parent))
        else:
            waiting[wanted] = generator, parent

    for generator in generators:
        go_on(generator, None)
    while waiting:
        for future in wait(waiting, return_when=FIRST_COMPLETED).done:
            go_on(*waiting.pop(future), future.result())
    return [returned[generator] for generator in generators]
