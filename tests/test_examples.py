"""Examples in docstrings, which the pages of the reference show, give what they say."""

import doctest
import importlib
from pathlib import Path

import pytest

import jaxhb

PACKAGE = Path(jaxhb.__file__).parent
WITH_EXAMPLES = sorted(
    path for path in PACKAGE.rglob("*.py") if ">>> " in path.read_text(encoding="utf-8")
)
NAMES = [
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
    for path in WITH_EXAMPLES
]
SLOW = {
    "balance.derivative",
    "balance.harmonic_residual",
    "branches.branch",
    "branches.search",
    "certificate.certificate",
    "design.identification",
    "design.phases",
    "design.tuning",
    "design.worst_case",
    "integration.reference",
    "linear.critical",
    "linear.polynomial",
    "linear.sensitivity",
    "solutions.misfires",
    "solutions.solve",
}
SLOW = {f"jaxhb.{name}" for name in SLOW}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else [])
        for name in NAMES
    ],
)
def test_the_examples_of_a_module_hold(name):
    if ".report." in name:
        pytest.importorskip("matplotlib")
    failures, examples = doctest.testmod(
        importlib.import_module(name), extraglobs={"jaxhb": jaxhb}
    )
    assert examples
    assert not failures


def test_most_modules_have_examples():
    assert len(NAMES) >= 40
    assert set(NAMES) >= SLOW
