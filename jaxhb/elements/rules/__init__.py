"""Rules by which the torsional stresses of shafts are judged: a section and a speed go
in, permissible stresses come out.

Each module of this folder has the :class:`Rule` objects of one publication in its
``RULES``, and is found by lying here: a new publication is one new file.
"""

import importlib
import pkgutil

from jaxhb.elements.rules.rule import Rule, Section

_MODULES = sorted(
    module.name for module in pkgutil.iter_modules(__path__) if module.name != "rule"
)
_ALL = [
    rule
    for module in _MODULES
    for rule in importlib.import_module(f"{__name__}.{module}").RULES
]
RULES: dict[str, Rule] = {
    rule.name: rule for rule in sorted(_ALL, key=lambda rule: not rule.default)
}
"""Rules by the names that a scene gives them, the default first."""

__all__ = ["RULES", "Rule", "Section"]
