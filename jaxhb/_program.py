"""Compiled programs: ``jax.jit``, with options of the compiler and a store on disk
where the host calls, and not too many of them.
"""

from __future__ import annotations

import inspect
import os
import re
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache, partial, update_wrapper
from pathlib import Path
from threading import Lock
from weakref import WeakSet

import jax
import numpy as np
from jax._src.config import (
    trace_context,
)  # what jit's own keys hold of the settings: it has no public name
from jax.sharding import Mesh, PartitionSpec, SingleDeviceSharding

from jaxhb import _jax, _store as _disk
from jaxhb._jax import HOST_TYPES, staged, traced

OPTIONS = {
    # Kernels without its fusion dialects run as fast and compile in two thirds of the
    # time (jaxlib 0.9).
    "xla_cpu_use_fusion_emitters": False,
    # The second and third level of optimisation take a seventh more time to compile,
    # and programs run as fast.
    "xla_backend_optimization_level": 1,
    # Sums as trees of kernels: a fifth of the memory maps and a tenth of the compile
    # time, and nothing won.
    "xla_disable_hlo_passes": "tree_reduction_rewriter",
}
"""Of the compiler for CPUs, each passed where it is known."""

COMPILED_BETWEEN_COUNTS = 20
"""Programs compiled, several for a solve, after which the memory maps of the process
are counted again.
"""


class Program:
    """``jax.jit`` of a function. Only an outermost program has options, and a place in
    the store on disk.
    """

    def __init__(self, function, static_argnames=()):
        self.function, self.signature = function, inspect.signature(function)
        self.static = (
            (static_argnames,)
            if isinstance(static_argnames, str)
            else tuple(static_argnames)
        )
        self.nested = jax.jit(function, static_argnames=static_argnames)
        update_wrapper(self, function)
        _programs.add(self)

    def __call__(self, *args, **kwargs):
        _jax.check_settings()
        if _jax.debugging():
            with _jax.not_debugging():
                return self._called(args, kwargs)
        return self._called(args, kwargs)

    def _called(self, args, kwargs):
        asked = self._question(args, kwargs)
        if asked is None:
            return self.nested(*args, **kwargs)
        _held.limit()
        static, arguments, key = asked
        found = _compiled.get(
            key
        )  # hashed once: that of a large train takes a tenth of a millisecond
        if found is None or isinstance(found, Future):
            found = self._made(static, arguments, key)
        return found(arguments)

    def compile_ahead(self, *args, **kwargs):
        """Begin to make what a call with such arguments will run, in a thread of its
        own; the call waits for it.

        Gives a Future, to be cancelled where no such call comes; None where the program
        is there, or cannot be made beforehand.
        """
        asked = self._question(args, kwargs)
        if asked is None:
            return None
        static, arguments, key = asked
        if key[-1] != _settings_of_threads():
            return None
        with _making:
            if key in _compiled:
                return None
            _compiled[key] = made = _beside().submit(
                self._outermost, static, arguments, key
            )
        return made

    def at_hand(self, *args, **kwargs):
        """Whether a call with such arguments compiles nothing, as far as can be told
        without it.
        """
        asked = self._question(args, kwargs)
        return (
            asked is None
            or asked[2] in _compiled
            or _store.holds(self._name(asked[0], asked[2]))
        )

    def shapes(self, *args, **kwargs):
        """Shapes and types of what a call with such arguments gives; what is traced for
        them, the call compiles.
        """
        asked = self._question(args, kwargs)
        if asked is None:
            return jax.eval_shape(partial(self.nested, **kwargs), *args)
        static, arguments, key = asked
        traced = _traced[key] = self._trace(static, arguments)
        return traced.out_info

    def _made(self, static, arguments, key):
        """The executable for arguments, made here unless another thread is at it."""
        with _making:
            there = _compiled.get(key)
            if (
                isinstance(there, Future) and there.cancel()
            ):  # it waits for another program: sooner here
                there = None
            if there is None:
                made = _compiled[key] = Future()
                made.set_running_or_notify_cancel()
        try:
            if there is None:
                there = self._outermost(static, arguments, key)
                made.set_result(there)
            found = _compiled[key] = (
                there.result() if isinstance(there, Future) else there
            )
        except BaseException as failure:
            _compiled.pop(key, None)
            if there is None:
                made.set_exception(failure)
            raise
        return found

    def _question(self, args, kwargs):
        """Static arguments and others by name, and the key of the executable that they
        want; None where something is traced, or arrays lie elsewhere.
        """
        arguments = self.signature.bind(*args, **kwargs).arguments
        static = {
            name: arguments.pop(name) for name in self.static if name in arguments
        }
        leaves, tree = jax.tree.flatten(arguments)
        if traced(leaves) or staged() or not _plain(leaves):
            return None
        return (
            static,
            arguments,
            (
                self,
                tuple(static.items()),
                tree,
                tuple(map(_kind, leaves)),
                trace_context(),
            ),
        )

    def _outermost(self, static, arguments, key):
        """The executable of a program that the host calls, from the store or new."""
        name = self._name(static, key)
        traced = _traced.pop(key, None)
        found = _store.load(name, arguments)
        if found is not None:
            _held.programs += 1
            return found
        retrieved = _held.retrieved
        made = (traced or self._trace(static, arguments)).lower().compile()
        if (
            _held.retrieved == retrieved
        ):  # one out of jax's cache does not run any more when it is stored again
            _store.save(name, made)
        return made

    def _name(self, static, key):
        """What an executable is kept by on disk."""
        settings = re.sub(
            " at 0x[0-9a-f]+", "", repr(key[4])
        )  # addresses differ from process to process
        return repr(
            (
                self.__module__,
                self.__qualname__,
                static,
                str(key[2]),
                key[3],
                settings,
                _known_options(),
            )
        )

    def _trace(self, static, arguments):
        def call(arguments):
            return self.function(**arguments, **static)

        call.__name__ = self.__name__
        if (
            _store.own_folder is not None
        ):  # else jax's cache has what other versions made, which is never stored
            call.__name__ += "_" + _store.origin.hex()[:8]
        return jax.jit(call, compiler_options=_known_options()).trace(arguments)


_programs = WeakSet()


SHARED_AXIS = "lanes"
WHOLE = PartitionSpec()
"""Of an array that every device has."""


def along(axis):
    """Of an array whose lanes lie along an axis, the
    :class:`~jax.sharding.PartitionSpec`.
    """
    return PartitionSpec(*[None] * axis, SHARED_AXIS)


@cache
def across(program, devices, given, made, **static):
    """A Program with its static arguments, its lanes cut into equal parts, one for each
    of the ``devices``.

    given, made : what :func:`along` gives, or WHOLE, for the arrays of the positional
    arguments and of the result
    """
    mesh = Mesh(np.array(devices), (SHARED_AXIS,))
    function = partial(program.function, **static)
    cut = jax.shard_map(
        function, mesh=mesh, in_specs=given, out_specs=made, check_vma=False
    )
    return jax.jit(
        cut, compiler_options=_known_options() if devices[0].platform == "cpu" else None
    )


_compiled = {}
"""Executables of the process by program, static arguments, structure, shapes and types,
and settings of jax; of one that is being made, the Future.
"""


_traced: dict = {}
"""Of programs whose results were asked for beforehand, what was traced, by the same."""


_making = Lock()
"""Held by a thread that looks whether an executable is there or being made."""


def _settings_of_threads():
    """Those of a thread that has set none itself."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(trace_context).result()


@cache
def _beside():
    """The threads in which programs are made beforehand."""
    return ThreadPoolExecutor(os.cpu_count(), "jaxhb-compiler")


_store = _disk.Store()


def cache_programs(
    folder: str | Path | None = None, *, limit: int = _disk.LIMIT
) -> Path | None:
    """Keep compiled programs on disk, so that other processes start with what this one
    has compiled.

    The command line does so by itself. From the disk the programs of a solve are there
    in some tenths of a second. What ``jax.jit`` of your own compiles around a solve
    goes into jax's persistent cache in the same folder, unless you have set one: it is
    traced again, but not compiled.

    Parameters
    ----------
    folder : path, optional
        Programs lie in its sub-folder ``jaxhb-programs``, what else is in it is left
        alone. Made with mode 0700 if it is not there; it must be yours alone, as
        programs in it are run: one that others may write is refused, whatever lies in
        it. Default: that of the command line, ``jaxhb`` in the user's cache folder or
        what the environment variable JAXHB_CACHE says; "off" there turns this call off.
    limit : int
        Bytes that programs and jax's cache there may take (default 1 GiB), looked at in
        this call and when a program is kept. Those not used for longest are removed,
        and no other files.

    Returns
    -------
    pathlib.Path or None
        The sub-folder of programs, None where nothing is kept.

    Examples
    --------
    >>> import jaxhb
    >>> folder = jaxhb.cache_programs()  # doctest: +SKIP
    """
    found = keep_programs(
        _disk.user_folder() if folder is None else Path(folder), limit
    )
    if found is not None:
        _store.make_room()
        folder = _store.jax_folder()
        if folder is not None:
            _jax.keep_compiled(folder)
    return found


def keep_programs(folder, limit=_disk.LIMIT):
    """Keep what a Program compiles in ``folder``; the sub-folder for it, None where
    nothing can be kept.
    """
    global _store
    _store = _disk.Store(folder, limit)
    return _store.own_folder


def _plain(leaves):
    """Whether all arrays lie where programs run by default, and that is the processor
    of the host.
    """
    device = jax.config.jax_default_device or jax.devices()[0]
    if isinstance(device, str):
        device = jax.devices(device)[0]
    if (
        device.platform != "cpu"
        or device != jax.devices("cpu")[0]
        or jax.config.jax_disable_jit
    ):
        return False
    here = SingleDeviceSharding(device)
    arrays = (
        leaf
        for leaf in leaves
        if type(leaf) not in HOST_TYPES and isinstance(leaf, jax.Array)
    )
    return all(array.sharding == here for array in arrays)


def _kind(leaf):
    """Shape and type of an argument, and whether its type gives way to others."""
    if type(leaf) is np.ndarray:
        return leaf.shape, leaf.dtype, False
    if isinstance(leaf, jax.Array):
        return leaf.shape, leaf.dtype, leaf.weak_type
    return (
        np.shape(leaf),
        getattr(leaf, "dtype", type(leaf).__name__),
        getattr(leaf, "weak_type", False),
    )


def _known_options():
    """Those of OPTIONS that the compiler knows."""
    # By one thread: of several, one would read from jax's cache what another is writing
    # there, and warn.
    with _asking:
        return _options_compiler_knows()


_asking = Lock()


@cache
def _options_compiler_knows():
    known = dict(OPTIONS)
    while known:
        try:
            jax.jit(lambda: 0, compiler_options=known).lower().compile()
        except jax.errors.JaxRuntimeError as refusal:  # names what it does not know
            unknown = next(
                (name for name in known if name in str(refusal)), None
            ) or next(iter(known))
            del known[unknown]
        else:
            break
    return known


class Held:
    """Compiled programs of the process, those of the package dropped before memory maps
    reach the limit of Linux.

    Beyond that limit a process ends with a segmentation fault. Where those of others
    alone are too many they are dropped, too: JAX forgets all or none, and compiles
    again what is called again.
    """

    def __init__(self):
        self.programs = self.counted = self.retrieved = 0
        jax.monitoring.register_event_duration_secs_listener(self.listen)

    def listen(self, event, _, **__):
        """Count the programs that are compiled, by whatever package, and those that
        jax's cache had.
        """
        self.programs += event == "/jax/core/compile/backend_compile_duration"
        self.retrieved += event == "/jax/compilation_cache/cache_retrieval_time_sec"

    def limit(self, most=None, between=COMPILED_BETWEEN_COUNTS):
        """Drop programs if the process has too many memory maps."""
        if self.programs - self.counted < between:
            return
        self.counted = self.programs
        if _too_many_maps(most):
            _compiled.clear()
            for program in list(_programs):
                program.nested.clear_cache()
            across.cache_clear()
            if _too_many_maps(most):
                jax.clear_caches()


def _too_many_maps(most):
    """Whether the process has more memory maps than ``most``, by default half of those
    that there are.
    """
    maps = Path("/proc/self/maps")
    allowed = Path("/proc/sys/vm/max_map_count")
    if not maps.exists():
        return False
    return maps.read_bytes().count(b"\n") > (
        int(allowed.read_text()) // 2 if most is None else most
    )


_held = Held()
