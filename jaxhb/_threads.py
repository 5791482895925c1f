"""Work for many speeds, in some threads side by side."""

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import Context, copy_context
from typing import Any, TypeVar

import jax

from jaxhb._jax import processors

MOST_THREADS = 8  # each holds some memory


Item = TypeVar("Item")
Made = TypeVar("Made")


def side_by_side(
    function: Callable[[Item], Made], items: Sequence[Item], devices: Sequence = ()
) -> Generator[Made]:
    """Yield the result of a function for each of a list of items, in order; across
    several devices one after another.
    """
    if len(devices) > 1 or len(items) == 1:
        yield from map(function, items)
        return
    # More threads than processors: some wait for programs that others make.
    threads = ThreadPoolExecutor(min(2 * processors(), MOST_THREADS), "jaxhb")
    config: Any = jax.config
    device = config.jax_default_device

    def run(context: Context, item: Item) -> Made:
        with jax.default_device(device):
            return context.run(function, item)

    try:
        for future in [threads.submit(run, copy_context(), item) for item in items]:
            yield future.result()
    finally:
        threads.shutdown(cancel_futures=True)
