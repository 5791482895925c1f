"""Rules by which the torsional stresses of shafts are judged: a section and a speed go
in, permissible stresses come out.

Each module of this folder that has the :class:`Rule` objects of one publication in its
``RULES`` is found by lying here: a new publication is one new file. Users write rules
of their own as files (:mod:`jaxhb.elements.rules.written`); scenes choose among all
(:mod:`jaxhb.elements.rules.chosen`).
"""

import importlib
import pkgutil

from jaxhb.elements.rules.rule import Rule, Section

# Imports this one
_CHOOSING = "chosen"
_MODULES = sorted(
    module.name for module in pkgutil.iter_modules(__path__) if module.name != _CHOOSING
)
_ALL = [
    rule
    for module in _MODULES
    for rule in getattr(importlib.import_module(f"{__name__}.{module}"), "RULES", ())
]
RULES: dict[str, Rule] = {
    rule.name: rule for rule in sorted(_ALL, key=lambda rule: not rule.default)
}
"""Rules by the names that a scene gives them, the default first."""


__all__ = ["RULES", "Rule", "Section"]
