"""Kinds of excitation: elements and a speed go in, torques on disks come out.

Each module of this folder that has an ``EXCITATION`` is one kind, and is found by lying
here: a new kind is one new file.
"""

import importlib
import pkgutil

from jaxhb.elements.declared import table_name
from jaxhb.elements.excitations.kind import Excitation, Seats

_MODULES = [
    importlib.import_module(f"{__name__}.{module.name}")
    for module in pkgutil.iter_modules(__path__)
]
EXCITATIONS: dict[str, Excitation] = {
    table_name(kind.element): kind
    for kind in sorted(
        (module.EXCITATION for module in _MODULES if hasattr(module, "EXCITATION")),
        key=lambda kind: (kind.of_engines, table_name(kind.element)),
    )
}
"""Kinds by the names of their tables; those that engines make come last."""

__all__ = ["EXCITATIONS", "Excitation", "Seats"]
