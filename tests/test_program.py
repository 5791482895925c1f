"""Compiled programs: options of the compiler where the host calls, plain ``jax.jit`` elsewhere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxhb import _program


@pytest.fixture
def asked(monkeypatch):
    """The options of every program compiled."""
    found, jit = [], jax.jit

    def watched(*args, compiler_options=None, **kwargs):
        found.append(compiler_options)
        return jit(*args, compiler_options=compiler_options, **kwargs)

    monkeypatch.setattr(jax, "jit", watched)
    return found


def cube(x):
    return x**3


def test_the_host_compiles_with_options_that_transformations_do_not_take(asked):
    program = _program.Program(cube)
    assert program(2.0) == 8.0 and asked[0] is None and asked[-1] == _program.OPTIONS
    with pytest.raises(ValueError, match="top-level"):
        jax.grad(program.outermost)(2.0)
    assert jax.grad(program)(2.0) == 12.0
    assert jax.jit(lambda x: program(x) + 1.0)(2.0) == 9.0
    assert np.array_equal(jax.vmap(program)(jnp.arange(3.0)), [0.0, 1.0, 8.0])
    assert np.array_equal(jax.vmap(lambda x: x * program(2.0))(jnp.arange(3.0)), [0.0, 8.0, 16.0])
    assert jax.jit(lambda x: x * program(2.0))(3.0) == 24.0


def test_a_program_begins_when_the_one_before_has_ended():
    slow = _program.Program(lambda x: jnp.linalg.eigh(jnp.cos(x * jnp.arange(500.0) * jnp.arange(500.0)[:, None]))[0])
    slow(1.0).block_until_ready()
    before = slow(2.0)
    assert not before.is_ready()  # else what follows says nothing
    after = _program.Program(cube)(3.0)
    assert before.is_ready() and after == 27.0


def test_a_compiler_that_does_not_know_the_options_gets_none(monkeypatch):
    _program._known_options.cache_clear()
    monkeypatch.setattr(_program, "OPTIONS", {"xla_cpu_of_another_version": False})
    try:
        assert _program._known_options() is None and _program.Program(cube)(2.0) == 8.0
    finally:
        _program._known_options.cache_clear()
