"""The numbers of cylinders as arrays, each field one vector over its
elements, and what of their gas cycles is fixed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeVar, cast, dataclass_transform

import numpy as np

from jaxhb._jax import pytree
from jaxhb._shown import brief

Array = Any  # numpy or jax, as the numbers of trains are read by both
Table = TypeVar("Table")

# Fields of a cylinder whose gas torque is computed from its pressure
COMPUTED = ("pressure", "traces", "combustion")
TANGENTIAL = "tangential_pressure"  # Field of a cylinder with a table of its orders
# Fields whose numbers depend on the load
LOADED = ("traces", "combustion", TANGENTIAL)


@dataclass_transform(kw_only_default=True, frozen_default=True, eq_default=False)
def table(cls: type[Table]) -> type[Table]:
    """Make a class of arrays a frozen dataclass and a pytree; its numpy arrays cannot
    be changed in place.
    """
    cast(Any, cls).__post_init__ = _locked
    return pytree(brief(dataclass(frozen=True, kw_only=True, eq=False)(cls)))


def _locked(self: object) -> None:
    """Hold read-only views: the caller may still write to the arrays that it passed."""
    for name, value in list(vars(self).items()):
        if isinstance(value, np.ndarray) and value.flags.writeable:
            view = value.view()
            view.flags.writeable = False
            object.__setattr__(self, name, view)


@table
class Traces:
    """Pressure [n, R, S, M] (Pa) at the speeds ``rpm`` [n, R] and the loads ``load``
    [n, S].

    ``seats`` [n] are the cylinders that have traces, ``sizes`` [n] how many speeds and
    loads are theirs; the rest of their rows never counts.
    """

    seats: tuple[int, ...] = field(metadata={"static": True})
    sizes: tuple[tuple[int, int], ...] = field(metadata={"static": True})
    rpm: Array
    load: Array
    pressure: Array


@table
class Combustions:
    """The numbers of a :class:`~jaxhb.Combustion`, each [n]; ``heat`` or ``imep``, and
    ``exhaust_pressure``, are 0 if absent.

    ``seats`` [n] are the cylinders with a combustion, ``revolutions`` [n] those of
    their gas cycle; ``by_work`` [n] tells which have an ``imep``; ``charge_by`` [n]
    names the variable of the factors of charge and exhaust pressure, "load", "rpm" or
    "": ``charge_factor`` [n, L] at ``charge_at`` [n, L], None where no cylinder has
    any.
    """

    seats: tuple[int, ...] = field(metadata={"static": True})
    revolutions: tuple[int, ...] = field(metadata={"static": True})
    by_work: tuple[bool, ...] = field(metadata={"static": True})
    charge_by: tuple[str, ...] = field(metadata={"static": True})
    compression_ratio: Array
    charge_pressure: Array
    exhaust_pressure: Array
    start: Array
    duration: Array
    shape: Array
    heat: Array
    imep: Array
    compression_exponent: Array
    expansion_exponent: Array
    charge_at: Array | None = None
    charge_factor: Array | None = None


@table
class TangentialPressures:
    """Tangential pressures ``parts`` [n, R, K, 2], cosine and sine (Pa) of every order,
    at the mean indicated pressures ``grid`` [n, R] (Pa), and ``imep`` [n] (Pa), the
    mean indicated pressure at full load.

    ``seats`` [n] are the cylinders that have them, ``sizes`` [n] how many pressures and
    orders are theirs; the rest of their rows never counts. ``revolutions`` [n] are
    those of their gas cycle; ``compresses`` [n] tells which have a row at 0, that of
    compression alone.
    """

    seats: tuple[int, ...] = field(metadata={"static": True})
    sizes: tuple[tuple[int, int], ...] = field(metadata={"static": True})
    revolutions: tuple[int, ...] = field(metadata={"static": True})
    compresses: tuple[bool, ...] = field(metadata={"static": True})
    imep: Array
    grid: Array
    parts: Array


@table
class Cylinders:
    """Geometry (m), mass (kg), firing angle (deg), ambient pressure (Pa), each [nc];
    gas torque and scale.

    ``gas_torque_mean`` [nc] and ``gas_torque`` [nc, K, 2] (N m, for firing at 0);
    ``pressure`` [nc, M] (Pa) on the uniform grid of the gas cycle counted from firing
    top dead centre, zeros where none is given; ``scale_rpm`` and ``scale_factor`` [nc,
    L]. A rod that is not given is 1 m, a bore or stroke 0 m. None where no cylinder has
    them: ``traces``, ``combustion``, ``tangential_pressure``, ``load_rpm`` and
    ``load_share`` [nc, L] of any of these, and ``gas_factor`` and ``injection`` [nc], 1
    for a cylinder without.
    """

    bore: Array
    stroke: Array
    rod: Array
    reciprocating_mass: Array
    firing_angle: Array
    ambient_pressure: Array
    gas_torque_mean: Array
    gas_torque: Array
    pressure: Array
    scale_rpm: Array
    scale_factor: Array
    traces: Traces | None = None
    combustion: Combustions | None = None
    tangential_pressure: TangentialPressures | None = None
    load_rpm: Array | None = None
    load_share: Array | None = None
    gas_factor: Array | None = None
    injection: Array | None = None


@dataclass(frozen=True, kw_only=True)
class GasCycles:
    """Gas cycle of each cylinder: where its torque comes from (one of
    :data:`COMPUTED`, :data:`TANGENTIAL`, "harmonics" or "none"), whether it fires,
    whether it is cut off and has no gas torque at all, the revolutions of its crank in
    a gas cycle, and in every how many of these it is injected.
    """

    source: tuple[str, ...]
    fires: tuple[bool, ...]
    cut_off: tuple[bool, ...]
    revolutions: tuple[int, ...]
    every: tuple[int, ...]

    @property
    def skipping(self) -> bool:
        """Whether some computed cylinder is injected in some of its gas cycles
        alone.
        """
        return any(
            computed and every > 1
            for computed, every in zip(self.computed, self.every, strict=True)
        )

    @property
    def computed(self) -> tuple[bool, ...]:
        """Whether a gas torque is computed from a pressure."""
        cylinders = zip(self.source, self.cut_off, strict=True)
        return tuple(source in COMPUTED and not cut for source, cut in cylinders)

    @property
    def tangential(self) -> tuple[bool, ...]:
        """Whether a gas torque is that of a table of tangential pressures."""
        cylinders = zip(self.source, self.cut_off, strict=True)
        return tuple(source == TANGENTIAL and not cut for source, cut in cylinders)

    @property
    def prescribed(self) -> tuple[bool, ...]:
        """Whether the gas torque is prescribed as harmonics; without injection there is
        none, as its compression is not known.
        """
        cylinders = zip(self.source, self.fires, self.cut_off, strict=True)
        return tuple(
            source == "harmonics" and fires and not cut
            for source, fires, cut in cylinders
        )

    def compressing(self, cylinders: Cylinders) -> bool:
        """Tell whether pressures without injection count anywhere."""
        if self.skipping:
            return True
        idle = any(
            computed and not fires
            for computed, fires in zip(self.computed, self.fires, strict=True)
        )
        return idle or (cylinders.injection is not None and any(self.computed))
