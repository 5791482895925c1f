"""jax with double precision for every array: the only place that touches ``jax.config``."""

import jax

from ._arrays import register_waiting

jax.config.update("jax_enable_x64", True)
register_waiting()


def keep_compiled(folder):
    """Let jax keep what it compiles in ``folder``, unless the user has chosen one."""
    if jax.config.jax_compilation_cache_dir is None:
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
