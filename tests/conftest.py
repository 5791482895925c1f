"""Makes the modules of ``tests`` (``tolerances``, ``reference_data``, ``dense``,
``trains``) importable by all tests.

Pytest puts the directory of a conftest.py on the path; the double precision of every
test comes with the package. All processes of the run share compiled programs, those
that tests start too; ``compiling`` sets how they compile.
"""

import os
import tempfile
from functools import partial
from pathlib import Path

import pytest

programs_folder = None
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    programs_folder = tempfile.TemporaryDirectory(prefix="jaxhb-tests-")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = programs_folder.name

# By default jax shares what took a second; workers, and the runs of quick and slow tests
# one after another, have far more programs in common that take less.
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")

import compiling  # noqa: E402, F401
import jax  # noqa: E402
from printed import run_command  # noqa: E402

from jaxhb import _program  # noqa: E402

MOST_MAPS = 20_000
"""Memory maps of a process above which its programs are dropped between modules: within
one the package does it itself from 32,000 on, and tests that count programs miss them.
docs/how_to/start_up.md has what a solve takes.
"""

LONGEST = ("test_examples", "test_notebooks", "test_tuning", "test_gear_train_30")
"""Files that take longest though they have few tests; those with tests marked "slow"
follow, the others by folder.
"""


@pytest.hookimpl(tryfirst=True)  # before marks select
def pytest_collection_modifyitems(items):
    """Runs the longest files first: a worker that takes one of them last leaves the
    others idle.
    """
    rank = {name: place for place, name in enumerate(LONGEST)}
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(
        key=lambda item: rank.get(item.path.stem, len(rank) + (item.path not in slow))
    )


@pytest.fixture(scope="module", autouse=True)
def few_memory_maps():
    """Drops compiled programs before their memory maps exceed the limit, which ends
    the process with a segmentation fault.
    """
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_text().count("\n") > MOST_MAPS:
        _program._compiled.clear()
        jax.clear_caches()


@pytest.fixture
def run(tmp_path):
    """Runs a command whose files go to the folder of the test."""
    return partial(run_command, tmp_path)


@pytest.fixture(scope="session")
def run_once(tmp_path_factory):
    """Runs a command on packaged scenes, once for all tests with the same files."""
    completed = {}

    def once(line, *options, status=0):
        if (line, options) not in completed:
            folder = tmp_path_factory.mktemp("once")
            command = run_command(folder, line, *options, status=status)
            completed[line, options] = command
        return completed[line, options]

    return once
