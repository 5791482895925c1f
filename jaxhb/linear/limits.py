"""What a motion does to its train beside what the scene allows: stresses, tooth torques, heat; by name.

The numbers are those of :mod:`jaxhb.linear.strength`, of motions with backlash as of the linear forced response. An aid
to evaluation, no approval by a class.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .._jax import namespace
from .._shown import brief
from ..model.derived import link_number
from ..model.drivetrain import DriveTrain
from .strength import BarredRange, barred_ranges, permissible_stress, torsional_stress

SHARE_OF_RATED = 1.0 / 3.0
"""Vibratory torque that a mesh may pass on, over its rated torque."""

NOT_ABOVE = 0.8
"""Share of the rated speed above which the rule does not accept barred ranges in normal operation."""


class Stress(NamedTuple):
    """Amplitude of the nominal torsional stress of a shaft and its limits, ``(...)`` Pa; limits None without."""

    stress: np.ndarray
    continuous: np.ndarray | None
    transient: np.ndarray | None


class ToothTorque(NamedTuple):
    """Torque of a mesh on its first gear, ``(...)`` N m: amplitude, limit, mean; and whether it changes its sign."""

    vibratory: np.ndarray
    limit: np.ndarray
    mean: np.ndarray
    reverses: np.ndarray


class Heat(NamedTuple):
    """Power that a shaft or damper turns into heat and its limit, ``(...)`` W."""

    power: np.ndarray
    limit: np.ndarray


@brief
@dataclass(frozen=True)
class Strength:
    """Stresses, tooth torques and heat beside their limits; made by :func:`strength`.

    Parameters
    ----------
    rpm : ``()`` or ``(n,)``, of the reference rotor; rated_rpm : float or None
    stresses : dict, :class:`Stress` of every shaft with a ``diameter`` or ``outer``
    tooth_torques : dict, :class:`ToothTorque` of every mesh with a ``rated_torque``
    heat : dict, :class:`Heat` of every shaft and damper with a ``power_limit``
    """

    rpm: np.ndarray
    rated_rpm: float | None
    stresses: dict
    tooth_torques: dict
    heat: dict

    def __bool__(self):
        """Whether the scene gives anything to be judged by."""
        return bool(self.stresses or self.tooth_torques or self.heat)

    @property
    def barred(self) -> dict[str, tuple[BarredRange, ...]]:
        """Barred speed ranges of every shaft with limits, see :func:`jaxhb.barred_ranges`; of several speeds."""
        limited = {name: row for name, row in self.stresses.items() if row.continuous is not None}
        return {name: barred_ranges(self.rpm, *row) for name, row in limited.items()}


class _OfMotion:
    """How a response or a steady state is read: signals of links, and their heat."""

    def __init__(self, motion):
        self.torque, self.force, self.power = motion.torque, motion.force, motion.power


def _harmonic(motion):
    """The harmonic solution of a response or a steady state; None of a motion that never repeats."""
    return getattr(motion, "response", motion)


def strength(response: Any, *, train: DriveTrain | None = None) -> Strength:
    """Stresses, tooth torques and heat of a motion beside the limits that the scene gives.

    Parameters
    ----------
    response : Response, ForcedResponse or SteadyState, the first two of one speed or of several
    train : DriveTrain, optional
        What is judged; default: that of the response. A response that comes out of a jax transformation has none, nor
        has a motion that never repeats.

    Returns
    -------
    Strength
        Of every shaft with a ``diameter`` (or ``outer``) half of the peak-to-peak torque over W_p, in Pa, and with a
        ``tensile_strength`` its limits at this speed over ``rated_rpm``; of every mesh with a ``rated_torque`` half of
        the peak-to-peak torque on its first gear and a third of the rated torque, in N m; of every shaft and damper
        with a ``power_limit`` its heat, in W. Differentiable.

    Raises
    ------
    ValueError
        If there is no train.

    Notes
    -----
    Limits of stresses: IACS UR M68, see :func:`jaxhb.permissible_stress` (not for crankshafts).
    Gears: the vibratory torque must not exceed a third of the full transmitted torque, and none may reverse. An
    aid to evaluation, no approval by a class.

    Examples
    --------
    >>> import jaxhb, math
    >>> parts = [jaxhb.Disk(name=name, inertia=2.0) for name in "ab"]
    >>> parts += [jaxhb.Torque(disk="a", harmonics=[(1.0, 10.0, 0.0)])]
    >>> parts += [jaxhb.Shaft(between=("a", "b"), stiffness=100.0, diameter=0.01, bore=0.0)]
    >>> train = jaxhb.build(parts, revolutions_per_cycle=1)
    >>> found = strength(jaxhb.forced_response(train, rpm=2.5 * 30 / math.pi))
    >>> round(float(found.stresses["a|b"].stress) / 1e6, 4), found.stresses["a|b"].continuous
    (27.1624, None)
    """
    return judged(train_of(response, train), response.rpm, _OfMotion(response))


def train_of(response, train=None):
    """The train that is given, or that of the response."""
    train = getattr(_harmonic(response), "train", None) if train is None else train
    if train is None:
        raise ValueError("this response comes out of a jax transformation or of a record and has no train: give train=")
    return train


def judged(train, rpm, motion) -> Strength:
    """The :class:`Strength` of a train; ``motion`` has ``torque(name)`` and ``force(name)``, which tell ``mean``,
    ``min``, ``max`` and ``half_peak_to_peak`` ``(...)``, and ``power(name)``.
    """
    topology, stresses = train.topology, {}
    for name in having(topology, "shaft", "outer", "diameter"):
        stress = stress_of(train, name, motion.torque(name).half_peak_to_peak)
        limited = topology.has_key(topology.link_index(name)[0], "tensile_strength")
        stresses[name] = Stress(stress, *(stress_limits(train, name, rpm) if limited else (None, None)))
    return Strength(
        rpm=rpm,
        rated_rpm=topology.rated_rpm,
        stresses=stresses,
        tooth_torques={name: _tooth_torque(train, name, motion) for name in having(topology, "mesh", "rated_torque")},
        heat={
            name: Heat(motion.power(name), power_limit(train, name))
            for table in ("shaft", "damper")
            for name in having(topology, table, "power_limit")
        },
    )


def having(topology, table, *keys):
    """Names of the links of a table that were built with one of the keys."""
    names = getattr(topology, f"{table}_names") if topology.link_keys else ()
    links = [link_number(topology, table, i) for i in range(len(names))]
    return [n for n, link in zip(names, links, strict=True) if any(topology.has_key(link, key) for key in keys)]


def section(train, name):
    """Outer diameter and bore in m at which a shaft is judged: its own, or those of its stiffness."""
    i, shafts = train.topology.link_index(name)[0], train.shafts
    own = train.topology.has_key(i, "diameter")
    outside, hole = (shafts.diameter, shafts.bore) if own else (shafts.outer, shafts.inner)
    # A field that no shaft of the train has is None, not zeros.
    return outside[i], 0.0 if hole is None else hole[i]


def stress_of(train, name, torque):
    """Nominal stress in Pa that a torque in N m makes in a shaft."""
    diameter, bore = section(train, name)
    return torsional_stress(torque, diameter=diameter, bore=bore)


def stress_limits(train, name, rpm):
    """Continuous and transient limit in Pa of a shaft at speeds of the reference rotor."""
    i, shafts = train.topology.link_index(name)[0], train.shafts
    return permissible_stress(
        diameter=section(train, name)[0],
        stress_concentration=shafts.stress_concentration[i],
        tensile_strength=shafts.tensile_strength[i],
        speed_ratio=namespace(rpm).asarray(rpm) / train.topology.rated_rpm,
    )


def tooth_torque_limit(train, name):
    """Vibratory torque in N m that a mesh may pass on, on its first gear: a third of its rated torque."""
    return SHARE_OF_RATED * train.meshes.rated_torque[train.topology.mesh_names.index(name)]


def first_radius(train, name):
    """Pitch radius in m of the first gear of a mesh."""
    return train.disks.radius[train.topology.mesh_ends[train.topology.mesh_names.index(name)][0]]


def power_limit(train, name):
    """Power in W that a shaft or damper may turn into heat."""
    table, index = train.topology.elements[name]
    return getattr(train, f"{table}s").power_limit[index]


def _tooth_torque(train, name, motion):
    force, radius = motion.force(name), first_radius(train, name)
    return ToothTorque(
        vibratory=radius * force.half_peak_to_peak,
        limit=tooth_torque_limit(train, name),
        mean=radius * force.mean,
        reverses=(force.min < 0) & (force.max > 0),
    )
