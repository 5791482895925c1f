"""Imports go down the layers only, and the package loads neither matplotlib nor optax
by itself.
"""

import ast
import re
import subprocess
import sys
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import jaxhb

ROOT = Path(__file__).parents[1] / "jaxhb"
ROOMS = [
    "equations",
    "excitation",
    "elements",
    "train",
    "scene",
    "results",
    "integration",
    "linear",
    "balance",
    "floquet",
    "certificate",
    "solutions",
    "steady",
    "transients",
    "branches",
    "design",
    "studies",
    "report",
    "cli",
]
MOST_FILES = 14


def name_of(path):
    """Dotted name of a module of the package; that of a folder for its ``__init__``."""
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {name_of(path): path for path in ROOT.rglob("*.py")}


def imported_modules(path):
    """Modules of the package that a module imports, when it runs or for types alone, by
    name or relative.
    """
    package = path.relative_to(ROOT.parent).with_suffix("").parts[:-1]
    names = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            parents = package[: len(package) - node.level + 1]
            base = ".".join(parents) if node.level else ""
            module = ".".join(filter(None, (base, node.module)))
            names += [f"{module}.{alias.name}" for alias in node.names]
    for name in names:
        parts = name.split(".")
        prefixes = (".".join(parts[:size]) for size in range(len(parts), 0, -1))
        yield from [module for module in prefixes if module in MODULES][:1]


def room_of(module):
    """Room of a module; None of one beside the rooms."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 and parts[1] in ROOMS else None


def test_every_folder_is_a_room_that_imports_those_below_alone_and_can_be_looked_over():
    def is_package(path):
        return (path / "__init__.py").exists()

    assert {path.name for path in ROOT.iterdir() if is_package(path)} == set(ROOMS)
    for rank, name in enumerate(ROOMS):
        for path in (ROOT / name).rglob("*.py"):
            rooms = filter(None, map(room_of, imported_modules(path)))
            assert [room for room in rooms if ROOMS.index(room) > rank] == [], path
    for folder in filter(is_package, ROOT.rglob("*")):
        modules = [file for file in folder.glob("*.py") if file.name != "__init__.py"]
        assert len(modules) <= MOST_FILES, folder
        source = (folder / "__init__.py").read_text()
        assert ast.get_docstring(ast.parse(source)), folder


def test_no_modules_name_each_other_in_a_circle():
    graph = {name: {*imported_modules(path)} - {name} for name, path in MODULES.items()}
    # Raises CycleError with the circle.
    assert set(TopologicalSorter(graph).static_order()) >= set(graph)


def test_only_their_owners_import_matplotlib_optax_plotly_and_jinja2():
    owners = {
        "matplotlib": {"report/figures/draw.py"},
        "optax": {"design/descent.py"},
        "plotly": {"report/page/page.py"},
        "jinja2": {"report/page/parts.py"},
    }
    for path in ROOT.rglob("*.py"):
        text = path.read_text()
        for library, allowed in owners.items():
            if f"import {library}" in text or f"from {library}" in text:
                assert path.relative_to(ROOT).as_posix() in allowed


def test_only_one_place_touches_the_configuration_of_jax():
    texts = {path.name: path.read_text() for path in ROOT.rglob("*.py")}
    touching = [
        name
        for name, text in texts.items()
        if "jax.config" in text and "config.update" in text
    ]
    assert touching == ["_jax.py"]


def test_only_the_layout_of_coefficients_transforms_between_instants_and_harmonics():
    calling = [
        path.relative_to(ROOT).as_posix()
        for path in ROOT.rglob("*.py")
        if ".fft" in path.read_text()
    ]
    assert calling == ["equations/fourier.py"]


def printed(code):
    """Output of a process that runs ``code``."""
    completed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    return completed.stdout.strip()


LOADED = (
    "print([m for m in ('jax', 'numpy', 'matplotlib', 'optax') if m in sys.modules])"
)
SOLVES = "import sys, jaxhb; jaxhb.solve; "
COMMANDS = (
    "import sys, jaxhb.cli.identify_command, jaxhb.cli.linear_commands,"
    " jaxhb.cli.many_trains; "
)
FROM_TERMINAL = "import os, jaxhb.cli.main as c; c.main(['--version']); import jax; "
PRINTED = {
    "the package loads neither matplotlib nor optax": (
        SOLVES + LOADED,
        "['jax', 'numpy']",
    ),
    "the command line loads neither jax nor numpy": (
        "import sys, jaxhb.cli.main; " + LOADED,
        "[]",
    ),
    "nor what only files need": (
        (
            "import sys, jaxhb.cli.main; print([m for m in ('hmac', 'random',"
            " 'secrets') if m in sys.modules])"
        ),
        "[]",
    ),
    "commands do not wait for statistics": (
        COMMANDS + "print('scipy.stats' in sys.modules)",
        "False",
    ),
    "the command line keeps BLAS to one thread": (
        FROM_TERMINAL + "print(os.environ['OPENBLAS_NUM_THREADS'])",
        "1",
    ),
    "double precision if jax comes first": (
        "import jax, jaxhb; print(jax.numpy.ones(1).dtype)",
        "float64",
    ),
    "double precision if jax comes later": (
        "import jaxhb; import jax; print(jax.numpy.ones(1).dtype)",
        "float64",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("fact", PRINTED)
def test_what_is_loaded_and_set_when_the_package_is_imported(fact):
    code, expected = PRINTED[fact]
    assert printed(code).splitlines()[-1] == expected


def test_programs_are_kept_before_anything_of_the_package_has_loaded_jax(tmp_path):
    code = (
        "from jaxhb._program import cache_programs;"
        f" print(cache_programs({str(tmp_path)!r}).parent)"
    )
    assert printed(code) == str(tmp_path)


@pytest.mark.parametrize("before", ["0", None])
def test_processes_started_after_the_first_use_have_the_precision_that_they_had(
    before, monkeypatch
):
    monkeypatch.delenv("JAX_ENABLE_X64", raising=False)
    if before is not None:
        monkeypatch.setenv("JAX_ENABLE_X64", before)
    code = (
        "import os, jaxhb; jaxhb.solve; import jax; print(jax.numpy.ones(1).dtype,"
        " os.environ.get('JAX_ENABLE_X64'))"
    )
    assert printed(code) == f"float64 {before}"


def test_packages_that_are_always_imported_are_declared():
    """Modules import at their top what is always needed, and what belongs to an extra
    where they use it.
    """
    project = tomllib.loads((ROOT.parent / "pyproject.toml").read_text())["project"]
    declared = {
        re.match(r"[a-z]+", requirement)[0] for requirement in project["dependencies"]
    }
    imported = set()
    for path in ROOT.rglob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add(node.module.split(".")[0])
    required = imported - {"jaxhb", *sys.stdlib_module_names}
    assert "scipy" in required
    assert required <= declared


def test_every_public_name_is_there():
    assert set(jaxhb.__all__) <= set(dir(jaxhb))
    assert all(getattr(jaxhb, name).__name__ == name for name in jaxhb.__all__)
    with pytest.raises(AttributeError, match="no attribute 'solv'"):
        jaxhb.solv  # noqa: B018
