"""Double precision for every array: the only place that touches ``jax.config``."""

import jax

jax.config.update("jax_enable_x64", True)
