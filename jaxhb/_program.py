"""Compiled programs: ``jax.jit``, with options of the compiler and a store on disk
where the host calls, and not too many of them.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial, update_wrapper
from pathlib import Path
from threading import Lock
from typing import Any, Generic, ParamSpec, TypeVar
from weakref import WeakSet

import jax
import numpy as np

# The settings in jit's own keys: there is no public name for them.
from jax._src.config import trace_context
from jax.sharding import Mesh, PartitionSpec, SingleDeviceSharding

from jaxhb import _jax, _store as _disk
from jaxhb._jax import HOST_TYPES, processors, staged, traced

OPTIONS: dict[str, bool | int | str] = {
    # Kernels without its fusion dialects run as fast and compile in two thirds of the
    # time (jaxlib 0.9).
    "xla_cpu_use_fusion_emitters": False,
    # The second and third level of optimisation take a seventh more time to compile,
    # and programs run as fast.
    "xla_backend_optimization_level": 1,
    # Sums as trees of kernels: a fifth of the memory maps and a tenth of the compile
    # time, and nothing won.
    "xla_disable_hlo_passes": "tree_reduction_rewriter",
    # Threads that share a product sum it up in another order: numbers would depend on
    # how many processors there are.
    "xla_cpu_multi_thread_eigen": False,
}
"""Options of the compiler for CPUs, each passed where the compiler knows it."""

COMPILED_BETWEEN_COUNTS = 20
"""Programs compiled, several for a solve, after which the memory maps of the process
are counted again.
"""


Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Key:
    """Everything that decides which executable a call runs.

    program : the :class:`Program`; static : names and values of its static arguments;
    structure : the pytree of the others; kinds : shape, type and weakness of their
    leaves; settings : those of jax that change what is traced.
    """

    program: Program
    static: tuple[tuple[str, Any], ...]
    structure: Any
    kinds: tuple[Hashable, ...]
    settings: Any


@dataclass(frozen=True)
class Call:
    """A call that the host makes: static arguments and arrays by name, and the
    :class:`Key` of its executable.
    """

    static: Mapping[str, Any]
    arrays: Mapping[str, Any]
    key: Key


class Program(Generic[Parameters, Result]):
    """``jax.jit`` of a function. Only an outermost program has options, and a place in
    the store on disk.
    """

    __name__: str
    __qualname__: str

    def __init__(
        self,
        function: Callable[Parameters, Result],
        static_argnames: str | Sequence[str] = (),
    ):
        self.function = function
        self.signature = inspect.signature(function)
        self.static = (
            (static_argnames,)
            if isinstance(static_argnames, str)
            else tuple(static_argnames)
        )
        self.nested: Any = jax.jit(function, static_argnames=static_argnames)
        update_wrapper(self, function)
        _programs.add(self)

    def __call__(self, *args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        _jax.check_settings()
        if _jax.debugging():
            with _jax.not_debugging():
                return self._run(args, kwargs)
        return self._run(args, kwargs)

    def _run(self, args: tuple, kwargs: dict[str, Any]) -> Any:
        call = self._call(args, kwargs)
        if call is None:
            return self.nested(*args, **kwargs)
        _held.limit()
        # Hashed once: the hash of a large train takes a tenth of a millisecond.
        executable = _compiled.get(call.key)
        if executable is None or isinstance(executable, Future):
            executable = self._executable(call)
        return executable(call.arrays)

    def compile_ahead(self, *args: Any, **kwargs: Any) -> Future | None:
        """Begin to make what a call with such arguments will run, in a thread of its
        own; the call waits for it.

        Gives its Future; None where the program is there, or cannot be made beforehand.
        """
        call = self._call(args, kwargs)
        if call is None or call.key.settings != _settings_of_threads():
            return None
        with _making:
            if call.key in _compiled:
                return None
            future = _compiler_threads().submit(self._outermost, call)
            _compiled[call.key] = future
        return future

    def at_hand(self, *args: Any, **kwargs: Any) -> bool:
        """Whether a call with such arguments compiles nothing, as far as can be told
        without it.
        """
        call = self._call(args, kwargs)
        return (
            call is None or call.key in _compiled or _store.holds(self._name(call.key))
        )

    def shapes(self, *args: Any, **kwargs: Any) -> Any:
        """Shapes and types of what a call with such arguments gives; what is traced for
        them, the call compiles.
        """
        call = self._call(args, kwargs)
        if call is None:
            return jax.eval_shape(partial(self.nested, **kwargs), *args)
        _traced[call.key] = self._trace(call)
        return _traced[call.key].out_info

    def _executable(self, call: Call) -> Callable:
        """The executable of a call, made here unless another thread is at it."""
        with _making:
            held = _compiled.get(call.key)
            # One that waits for another program is made here, which is sooner.
            if isinstance(held, Future) and held.cancel():
                held = None
            if held is None:
                future: Future = Future()
                future.set_running_or_notify_cancel()
                _compiled[call.key] = future
        try:
            if held is None:
                executable = self._outermost(call)
                future.set_result(executable)
            else:
                executable = held.result() if isinstance(held, Future) else held
        except BaseException as failure:
            _compiled.pop(call.key, None)
            if held is None:
                future.set_exception(failure)
            raise
        _compiled[call.key] = executable
        return executable

    def _call(self, args: tuple, kwargs: dict) -> Call | None:
        """The call with an executable; None where something is traced, or arrays lie
        elsewhere.
        """
        arrays = self.signature.bind(*args, **kwargs).arguments
        static = {name: arrays.pop(name) for name in self.static if name in arrays}
        leaves, structure = jax.tree.flatten(arrays)
        if traced(leaves) or staged() or not _plain(leaves):
            return None
        kinds = tuple(map(_kind, leaves))
        key = Key(self, tuple(static.items()), structure, kinds, trace_context())
        return Call(static, arrays, key)

    def _outermost(self, call: Call) -> Callable:
        """The executable of a program that the host calls, from the store or new."""
        name = self._name(call.key)
        traced_before = _traced.pop(call.key, None)
        stored = _store.load(name, call.arrays)
        if stored is not None:
            _held.programs += 1
            return stored
        retrieved = _held.retrieved
        compiled = (traced_before or self._trace(call)).lower().compile()
        # One out of jax's cache does not run any more when it is stored again.
        if _held.retrieved == retrieved:
            _store.save(name, compiled)
        return compiled

    def _name(self, key: Key) -> str:
        """The name under which the store has an executable."""
        # Addresses differ from process to process.
        settings = re.sub(" at 0x[0-9a-f]+", "", repr(key.settings))
        return repr(
            (
                self.__module__,
                self.__qualname__,
                dict(key.static),
                str(key.structure),
                key.kinds,
                settings,
                _known_options(),
            )
        )

    def _trace(self, call: Call) -> Any:
        by_name: Callable[..., Any] = self.function

        def function(arrays: Mapping[str, Any]) -> Any:
            return by_name(**arrays, **call.static)

        function.__name__ = self.__name__
        # Without a store jax's cache has what other versions made, which is never
        # stored.
        if _store.own_folder is not None:
            function.__name__ += "_" + _store.origin.hex()[:8]
        return jax.jit(function, compiler_options=_known_options()).trace(call.arrays)


_programs: WeakSet[Program] = WeakSet()


SHARED_AXIS = "lanes"
WHOLE = PartitionSpec()
"""The :class:`~jax.sharding.PartitionSpec` of an array that every device has."""


def along(axis: int) -> PartitionSpec:
    """The :class:`~jax.sharding.PartitionSpec` of an array whose lanes lie along an
    axis.
    """
    return PartitionSpec(*[None] * axis, SHARED_AXIS)


@cache
def across(
    program: Program,
    devices: tuple[jax.Device, ...],
    in_specs: Any,
    out_specs: Any,
    **static: Hashable,
) -> Callable:
    """A Program with its static arguments, its lanes cut into equal parts, one for each
    of the ``devices``.

    in_specs, out_specs : what :func:`along` gives, or WHOLE, for the arrays of the
    positional arguments and of the result
    """
    mesh = Mesh(np.array(devices), (SHARED_AXIS,))
    function = partial(program.function, **static)
    cut = jax.shard_map(
        function, mesh=mesh, in_specs=in_specs, out_specs=out_specs, check_vma=False
    )
    on_processors = devices[0].platform == "cpu"
    return jax.jit(cut, compiler_options=_known_options() if on_processors else None)


_compiled: dict[Key, Any] = {}
"""Executables of the process; of one that is being made, the Future."""


_traced: dict[Key, Any] = {}
"""Traces of programs whose shapes were asked for before they were called."""


_making = Lock()
"""Held by a thread that looks whether an executable is there or being made."""


def _settings_of_threads() -> Any:
    """The settings of jax in a thread that has set none itself."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(trace_context).result()


@cache
def _compiler_threads() -> ThreadPoolExecutor:
    """The threads in which programs are made beforehand."""
    return ThreadPoolExecutor(processors(), "jaxhb-compiler")


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
    base = _disk.user_folder() if folder is None else Path(folder)
    programs = keep_programs(base, limit)
    if programs is not None:
        _store.make_room()
        jax_folder = _store.jax_folder()
        if jax_folder is not None:
            _jax.keep_compiled(jax_folder)
    return programs


def keep_programs(folder: Path | None, limit: int = _disk.LIMIT) -> Path | None:
    """Keep what a Program compiles in ``folder``; the sub-folder for it, None where
    nothing can be kept.
    """
    global _store
    _store = _disk.Store(folder, limit)
    return _store.own_folder


def kept_programs() -> Path | None:
    """The folder given to :func:`keep_programs`, None where nothing is kept."""
    return None if _store.own_folder is None else _store.folder


def _plain(leaves: Sequence) -> bool:
    """Whether all arrays lie where programs run by default, and that is the processor
    of the host.
    """
    config: Any = jax.config
    device = config.jax_default_device or jax.devices()[0]
    if isinstance(device, str):
        device = jax.devices(device)[0]
    if (
        device.platform != "cpu"
        or device != jax.devices("cpu")[0]
        or config.jax_disable_jit
    ):
        return False
    here = SingleDeviceSharding(device)
    arrays = (
        leaf
        for leaf in leaves
        if type(leaf) not in HOST_TYPES and isinstance(leaf, jax.Array)
    )
    return all(array.sharding == here for array in arrays)


def _kind(leaf: Any) -> tuple[Hashable, ...]:
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


def _known_options() -> dict[str, bool | int | str]:
    """The OPTIONS that the compiler knows."""
    # By one thread: of several, one would read from jax's cache what another is writing
    # there, and warn.
    with _asking:
        return _options_compiler_knows()


_asking = Lock()


@cache
def _options_compiler_knows() -> dict[str, bool | int | str]:
    options = dict(OPTIONS)
    while options:
        try:
            jax.jit(lambda: 0, compiler_options=options).lower().compile()
        except jax.errors.JaxRuntimeError as refusal:
            named = [name for name in options if name in str(refusal)]
            del options[named[0] if named else next(iter(options))]
        else:
            break
    return options


class Held:
    """Compiled programs of the process, those of the package dropped before memory maps
    reach the limit of Linux.

    Beyond that limit a process ends with a segmentation fault. Where those of others
    alone are too many they are dropped, too: JAX forgets all or none, and compiles
    again what is called again.
    """

    def __init__(self) -> None:
        self.programs = 0
        self.counted = 0
        self.retrieved = 0
        jax.monitoring.register_event_duration_secs_listener(self.listen)

    def listen(self, event: str, duration_secs: float, **kwargs: str | int) -> None:
        """Count the programs that are compiled, by whatever package, and those that
        jax's cache had.
        """
        self.programs += event == "/jax/core/compile/backend_compile_duration"
        self.retrieved += event == "/jax/compilation_cache/cache_retrieval_time_sec"

    def limit(
        self, most: int | None = None, between: int = COMPILED_BETWEEN_COUNTS
    ) -> None:
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


def _too_many_maps(most: int | None) -> bool:
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
