"""jax in double precision, and where arithmetic runs: numpy on the host, jax.numpy
under a transformation.

Scenes are read without jax: nothing here imports it but :func:`load`, the only place
that touches ``jax.config``.
"""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    import jax

    Array = jax.Array | np.ndarray
    Number = float | Array
    Numbers = float | Sequence[float] | Array
else:
    Array = Number = Numbers = Any

# Bytes of address space; with less the compiler of jax ends the process without a word
LEAST_MEMORY = 2e9

Tree = TypeVar("Tree")

_jax: Any = None
_waiting: list[type] = []


def too_little_memory() -> str:
    """Say in a sentence that the system allows too little memory to compute; empty
    where it allows enough.
    """
    try:
        import resource
    except ImportError:  # on Windows, which has no such limit
        return ""
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    if allowed == resource.RLIM_INFINITY or allowed >= LEAST_MEMORY:
        return ""
    return (
        f"the limit of memory (ulimit -v) is {allowed / 1e9:.2g} GB, must be at least"
        f" {LEAST_MEMORY / 1e9:g} GB. Raise it."
    )


def processors() -> int:
    """Number of processors that this process may use: NPROC, as for jax, or those that
    the system or the scheduler of a cluster gave it.
    """
    limit = os.environ.get("NPROC", "")
    if limit.isdecimal() and int(limit):
        return int(limit)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def load() -> Any:
    """Import jax, in double precision for every array, and return it; MemoryError where
    too little is allowed.
    """
    global _jax
    if _jax is None:
        refusal = too_little_memory()
        if refusal:
            raise MemoryError(refusal)
        import jax

        jax.config.update("jax_enable_x64", True)
        # jax has read it: processes started from now on are left alone.
        os.environ.pop("JAX_ENABLE_X64", None)
        os.environ.update(vars(sys.modules[__package__])["_environment_before"])
        _jax = jax
        _register_waiting()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=_note_fork)
    return _jax


_forked = False
_computed = False


def _note_fork() -> None:
    """Note in a new process that it was forked from one in which jax had computed,
    whose threads are not in it.
    """
    global _forked
    _forked = _computed


def check_fork() -> None:
    """Refuse to compute where jax would wait for ever for threads that a fork has left
    behind.
    """
    if _forked:
        raise RuntimeError(
            "this process was forked from one in which jaxhb had computed, and the"
            " threads of jax are not in it: it would wait for them for ever. Start"
            " processes by multiprocessing.get_context('spawn'), or fork before the"
            " first solve."
        )


def _loaded() -> Any:
    """jax if anything has imported it, else None: then no array is one of jax."""
    return load() if "jax" in sys.modules else None


def pytree(cls: type[Tree]) -> type[Tree]:
    """Make a dataclass of arrays a pytree, at once or when jax is there."""
    _waiting.append(cls)
    if _jax is not None:
        _register_waiting()
    return cls


def _register_waiting() -> None:
    """Register what :func:`pytree` was given before jax was there."""
    while _waiting:
        _jax.tree_util.register_dataclass(_waiting.pop())


def namespace(*trees: Any) -> Any:
    """jax.numpy if any leaf is a tracer or a device array, else numpy: reading results
    compiles nothing.
    """
    jax = _loaded()
    return jax.numpy if jax and _any_is(jax.Array, trees) else np


HOST_TYPES = frozenset(
    (np.ndarray, np.float64, np.int64, np.bool_, float, int, complex, bool, str)
)
"""Types of leaves that are none of jax: a look into a set takes a tenth of the time of
a question to a class of jax.
"""


def _any_is(kind: type, trees: tuple) -> bool:
    """Whether any leaf is an instance of ``kind``, a class of jax."""
    if HOST_TYPES.issuperset(map(type, trees)):
        return False
    leaves = _jax.tree.leaves(trees)
    # Leaves of one type are arrays all, or none is.
    by_type = dict(zip(map(type, leaves), leaves, strict=True))
    return any(
        isinstance(leaf, kind)
        for leaf_type, leaf in by_type.items()
        if leaf_type not in HOST_TYPES
    )


def added(array: Array, index: Any, values: Array) -> Array:
    """``array`` with ``values`` added at ``index``, where indices may repeat; of the
    host in place.
    """
    if isinstance(array, np.ndarray) and namespace(values) is np:
        np.add.at(array, index, values)
        return array
    return load().numpy.asarray(array).at[index].add(values)


def placed(array: Array, index: Any, values: Array) -> Array:
    """``array`` with ``values`` at ``index``, where no index repeats; of the host in
    place.
    """
    if isinstance(array, np.ndarray) and namespace(values) is np:
        array[index] = values
        return array
    return load().numpy.asarray(array).at[index].set(values, unique_indices=True)


def traced(*trees: Any) -> bool:
    """Whether any leaf is being traced."""
    jax = _loaded()
    return bool(jax) and _any_is(jax.core.Tracer, trees)


def staged() -> bool:
    """Whether ``jit`` is at work: what programs return is then traced, whatever their
    arguments.
    """
    jax = _loaded()
    # jit alone traces an operation none of whose arguments is traced: jax has no public
    # question for it.
    return bool(jax) and traced(jax.lax.full((), 0.0))


def refuse_tracers(
    verb: str, *arguments: Any, instead: str = "", host: bool = False
) -> None:
    """TypeError with a sentence where ``jit``, ``vmap`` or ``grad`` traces the
    arguments of a verb, whose values decide, or ``jit`` what it computes, unless that
    is arithmetic of the ``host``; ``instead`` says what to do besides.
    """
    if traced(arguments) or (not host and staged()):
        advice = f", and {instead}" if instead else ""
        raise TypeError(
            f"{verb} depends on values, so jit, vmap and grad cannot trace it: call it"
            f" outside{advice}"
        )


def concrete(*trees: Any) -> Any:
    """The values, as numpy arrays where differentiation outside ``jit`` and ``vmap``
    holds them; else still traced.
    """
    if not traced(trees):
        return trees
    jax = _loaded()
    values = jax.lax.stop_gradient(trees)
    return values if traced(values) else jax.tree.map(np.asarray, values)


def on_host(tree: Tree) -> Tree:
    """The tree with numpy arrays for its leaves, except those that are traced."""

    def moved(leaf: Any) -> Any:
        return leaf if type(leaf) is np.ndarray or traced(leaf) else np.asarray(leaf)

    jax = _loaded()
    return jax.tree.map(moved, tree) if jax else tree


def remembered(function: Callable) -> Callable:
    """Make ``function(tree, *static)`` remember its results for the numbers of the last
    trees of host arrays.

    The speeds of a sweep share the numbers of their train: what depends on these alone
    is computed once. Numbers count and not arrays, as a train may hold a view of an
    array that its user writes to.
    """

    @lru_cache(maxsize=8)
    def by_numbers(leaves: tuple, structure: Any, *static: Any) -> Any:
        arrays = [
            np.frombuffer(numbers, kind).reshape(shape)
            for numbers, kind, shape in leaves
        ]
        return function(_loaded().tree.unflatten(structure, arrays), *static)

    @wraps(function)
    def remembering(tree: Any, *static: Any) -> Any:
        # A scene that is only checked is read once, without jax.
        if not _loaded() or namespace(tree) is not np:
            return function(tree, *static)
        leaves, structure = _loaded().tree.flatten(tree)
        arrays = map(np.asarray, leaves)
        numbers = tuple(
            (array.tobytes(), array.dtype.str, array.shape) for array in arrays
        )
        return by_numbers(numbers, structure, *static)

    return remembering


def check_settings() -> None:
    """Refuse settings of jax under which numbers would be wrong, or jax fails or waits
    somewhere inside.
    """
    global _computed
    check_fork()
    _computed = True
    config = load().config
    if not config.jax_enable_x64:
        raise RuntimeError(
            "jax_enable_x64 is off, but jaxhb computes in double precision: its answers"
            " would be wrong by more than their tolerances. Leave it on, as importing"
            " jaxhb does, and make arrays of your own with dtype='float32'."
        )
    if (
        config.jax_numpy_dtype_promotion == "strict"
        or config.jax_numpy_rank_promotion == "raise"
    ):
        raise RuntimeError(
            "jax_numpy_dtype_promotion is 'strict' or jax_numpy_rank_promotion is"
            " 'raise', but jaxhb mixes types and ranks. Set them to 'standard' and"
            " 'allow' by jax.config.update while it computes."
        )


def debugging() -> bool:
    """Whether jax stops at numbers that are not finite."""
    return load().config.jax_debug_nans or load().config.jax_debug_infs


@contextmanager
def not_debugging() -> Iterator[None]:
    """Let programs have numbers that are not finite: they mask them, and a status tells
    of those that are left.
    """
    with load().debug_nans(False), load().debug_infs(False):
        yield


def keep_compiled(folder: Path) -> None:
    """Let jax keep what it compiles in ``folder``, unless the user has chosen one."""
    config = load().config
    if config.jax_compilation_cache_dir is None:
        config.update("jax_compilation_cache_dir", str(folder))
        config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        config.update("jax_persistent_cache_min_entry_size_bytes", -1)
