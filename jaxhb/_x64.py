"""jax with double precision for every array: the only place that touches ``jax.config``."""

import os
from contextlib import contextmanager

import jax

from . import _environment_before
from ._arrays import register_waiting

jax.config.update("jax_enable_x64", True)
register_waiting()
os.environ.pop("JAX_ENABLE_X64", None)  # jax has read what the package set: processes started from now on do not
os.environ.update(_environment_before)


def check_settings():
    """Refuse settings of jax under which numbers would be wrong, or jax fails somewhere inside.

    Raises
    ------
    RuntimeError
        Without double precision, and with implicit promotion of types or ranks forbidden.
    """
    config = jax.config
    if not config.jax_enable_x64:
        raise RuntimeError(
            "jax_enable_x64 is off, but jaxhb computes in double precision: its answers would be wrong by more than "
            "their tolerances. Leave it on, as importing jaxhb does, and make arrays of your own with dtype='float32'."
        )
    if config.jax_numpy_dtype_promotion == "strict" or config.jax_numpy_rank_promotion == "raise":
        raise RuntimeError(
            "jax_numpy_dtype_promotion is 'strict' or jax_numpy_rank_promotion is 'raise', but jaxhb mixes types and "
            "ranks. Set them to 'standard' and 'allow' by jax.config.update while it computes."
        )


def debugging():
    """Whether jax stops at numbers that are not finite."""
    return jax.config.jax_debug_nans or jax.config.jax_debug_infs


@contextmanager
def not_debugging():
    """Let programs have numbers that are not finite: they mask them, and a status tells of those that are left."""
    with jax.debug_nans(False), jax.debug_infs(False):
        yield


def keep_compiled(folder):
    """Let jax keep what it compiles in ``folder``, unless the user has chosen one."""
    if jax.config.jax_compilation_cache_dir is None:
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
