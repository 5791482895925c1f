"""Compiled programs: options of the compiler where the host calls, plain ``jax.jit``
elsewhere.
"""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiling import executables

import jaxhb
from jaxhb import _program


@pytest.fixture
def compiled_options(monkeypatch):
    """The options of every program compiled."""
    options = []
    jit = jax.jit

    def watched(*args, compiler_options=None, **kwargs):
        options.append(compiler_options)
        return jit(*args, compiler_options=compiler_options, **kwargs)

    monkeypatch.setattr(jax, "jit", watched)
    # Memory maps have just been counted: programs of tests before are not dropped, and
    # compiled again, meanwhile.
    monkeypatch.setattr(_program._held, "counted", _program._held.programs)
    return options


def cube(x):
    return x**3


def test_the_host_compiles_with_options_that_transformations_do_not_take(
    compiled_options,
):
    program = _program.Program(cube)
    assert program(2.0) == 8.0
    assert compiled_options[0] is None
    assert compiled_options[-1] == _program._known_options()
    assert compiled_options[-1].items() <= _program.OPTIONS.items()
    assert "xla_disable_hlo_passes" in compiled_options[-1]
    assert jax.grad(program)(2.0) == 12.0
    assert jax.jit(lambda x: program(x) + 1.0)(2.0) == 9.0
    assert np.array_equal(jax.vmap(program)(jnp.arange(3.0)), [0.0, 1.0, 8.0])
    assert np.array_equal(
        jax.vmap(lambda x: x * program(2.0))(jnp.arange(3.0)), [0.0, 8.0, 16.0]
    )
    assert jax.jit(lambda x: x * program(2.0))(3.0) == 24.0


def test_a_program_prepared_is_the_one_that_is_called(compiled_options):
    square = _program.Program(lambda x: x * x)
    made = square.compile_ahead(3.0)
    assert made.result()({"x": 3.0}) == 9.0
    compiled = len(compiled_options)
    assert (
        square(4.0) == 16.0
        and len(compiled_options) == compiled
        and executables(square) == 1
    )
    assert square.compile_ahead(5.0) is None  # it is there


def test_shapes_asked_for_beforehand_are_traced_once():
    traces = []

    def counted(x):
        traces.append(x)
        return 2 * x

    program = _program.Program(counted)
    argument = np.arange(3.0)
    assert not program.at_hand(argument)
    assert program.shapes(argument).shape == (3,)
    assert program(argument).tolist() == [0.0, 2.0, 4.0] and len(traces) == 1
    assert program.at_hand(argument)


def test_a_preparation_given_up_is_made_by_the_call():
    wait = threading.Event()
    square = _program.Program(lambda x: x * x)
    threads = _program._compiler_threads()
    busy = [threads.submit(wait.wait) for _ in range(threads._max_workers)]
    made = square.compile_ahead(3.0)
    assert made.cancel() and executables(square) == 0
    assert square(3.0) == 9.0 and executables(square) == 1
    second = square.compile_ahead(np.ones(3))
    assert (
        square(np.ones(3)).tolist() == [1.0, 1.0, 1.0] and second.cancelled()
    )  # nobody waits for the other thread
    wait.set()
    assert all(future.result() for future in busy)


def test_threads_that_call_a_program_at_once_make_it_once(compiled_options):
    _program._known_options()

    def square_of(x):
        time.sleep(0.2)  # in tracing: the other thread asks meanwhile
        return x * x

    square = _program.Program(square_of)
    compiled = len(compiled_options)
    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(square, (3.0, 4.0))) == [9.0, 16.0]
    assert len(compiled_options) == compiled + 1 and executables(square) == 1


def test_a_program_that_fails_is_tried_again_by_the_next_call():
    wrong = _program.Program(lambda x: jnp.reshape(x, (7,)))
    for _ in range(2):
        with pytest.raises(TypeError):
            wrong(np.ones(3))
    assert executables(wrong) == 0


def test_programs_are_dropped_before_their_memory_maps_are_too_many():
    """Beyond the limit of Linux the process would end: here the limit is 0 maps, and
    one program is enough.
    """
    compiled, double = _program.Held(), jax.jit(lambda x: 2.0 * x)

    def compiles_again(most, between):
        compiled.limit(most=most, between=between)
        before = compiled.programs
        assert double(1.0) == 2.0
        return compiled.programs > before

    assert compiles_again(most=0, between=10)
    assert not compiles_again(most=0, between=10)  # too few programs to look
    assert not compiles_again(most=10**9, between=1)  # few maps
    assert jax.jit(lambda x: 3.0 * x)(1.0) == 3.0
    assert compiles_again(most=0, between=1)


def test_programs_of_others_stay_where_dropping_those_of_the_package_is_enough():
    held = _program.Held()
    of_another = jax.jit(lambda x: 5.0 * x)
    square = _program.Program(lambda x: jnp.sin(x) @ x)
    assert of_another(1.0) == 5.0
    before = len(Path("/proc/self/maps").read_bytes().splitlines())
    square(np.ones(7)), square(np.ones(8)), jax.grad(square)(np.ones(7))
    held.limit(most=before, between=1)
    compiled = held.programs
    assert (
        executables(square) == 0
        and of_another(1.0) == 5.0
        and held.programs == compiled
    )
    assert square(np.ones(7)) == pytest.approx(7 * np.sin(1.0), rel=1e-14)


def test_settings_of_jax_that_change_what_is_traced_have_programs_of_their_own():
    traced = []
    square = _program.Program(
        lambda x: traced.append(jax.config.jax_default_matmul_precision) or x @ x
    )
    square(np.ones((2, 2)))
    with jax.default_matmul_precision("float32"):
        square(np.ones((2, 2)))
        assert (
            square.compile_ahead(np.ones((3, 3))) is None
        )  # another thread would not have the setting
        square(np.ones((2, 2)))
    square(np.ones((2, 2)))
    assert traced == [None, "float32"] and executables(square) == 2


REFUSED = {
    "jax_enable_x64 is off": lambda: jax.enable_x64(False),
    "jax_numpy_dtype_promotion is": lambda: jax.numpy_dtype_promotion("strict"),
    "or jax_numpy_rank_promotion is": lambda: jax.numpy_rank_promotion("raise"),
}


@pytest.mark.parametrize("sentence", REFUSED)
def test_settings_of_jax_that_spoil_numbers_are_refused_with_a_sentence(sentence):
    program = _program.Program(cube)
    train = jaxhb.load_scene("engine_with_damper")
    with REFUSED[sentence]():
        for call in (program, jax.grad(program), jax.jit(program)):
            with pytest.raises(RuntimeError, match=sentence):
                call(2.0)
        with pytest.raises(RuntimeError, match=sentence):
            jaxhb.linear_response(train, rpm=1500.0)


@pytest.mark.parametrize(
    ("setting", "value"), [(jax.debug_nans, -1.0), (jax.debug_infs, 0.0)]
)
def test_numbers_that_are_not_finite_are_found_in_code_of_users_alone(setting, value):
    """The logarithm of a negative number is nan, and that of zero infinite."""
    program = _program.Program(
        lambda x: jnp.where(x > 0, x, jax.lax.stop_gradient(jnp.log(x)))
    )
    with setting(True):
        assert (
            not np.isfinite(program(np.asarray(value)))
            and program(np.asarray(2.0)) == 2.0
        )
        assert jax.grad(program)(2.0) == 1.0
        with pytest.raises(FloatingPointError):
            jax.jit(jnp.log)(value)


def test_threads_ask_the_compiler_once_what_it_knows(compiled_options):
    """Several at once would write and read the same entries of jax's cache."""
    _program._options_compiler_knows.cache_clear()
    with ThreadPoolExecutor(4) as threads:
        answers = list(threads.map(lambda _: _program._known_options(), range(4)))
    unknown = len(_program.OPTIONS) - len(answers[0])  # each of which is refused once
    assert len(compiled_options) == unknown + 1 and compiled_options[-1] == answers[0]
    assert all(answer is answers[0] for answer in answers)


def test_a_compiler_gets_only_options_that_it_knows(monkeypatch):
    _program._options_compiler_knows.cache_clear()
    monkeypatch.setattr(_program, "OPTIONS", {"xla_cpu_of_another_version": False})
    try:
        assert _program._known_options() == {} and _program.Program(cube)(2.0) == 8.0
    finally:
        _program._options_compiler_knows.cache_clear()
