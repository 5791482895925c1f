"""A small system of masses and links, in numbers of any kind: what characteristic polynomials are made of."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from .._jax import concrete, traced
from ..model.elements import SceneError


@dataclass(frozen=True)
class Links:
    """A small system of masses and links, numbers of any exact or inexact kind.

    inertia, damping, ground : dict mass -> I, b, stiffness to ground
    ends : dict link -> (mass, mass); arms : dict link -> (arm, arm); stiffness : dict link -> (c, r)
    """

    inertia: dict
    damping: dict
    ground: dict
    ends: dict
    arms: dict
    stiffness: dict

    def over(self, mass, link):
        """``k a^2 / I_m`` of a link at one of its masses, as a polynomial."""
        arm = self.arms[link][self.ends[link].index(mass)]
        return times(self.spring(link), (arm**2 / self.inertia[mass],))

    def spring(self, link):
        """``r p + c``."""
        c, r = self.stiffness[link]
        return (r, c) if traced(concrete(r)) or r else (c,)

    def at(self, mass, links):
        """Those of ``links`` that end at a mass."""
        return [link for link in links if mass in self.ends[link]]


def links_of(train, *, exact=True):
    """The :class:`Links` of a train, masses and links by their names; shafts in angles, meshes with radii as arms.

    Parameters
    ----------
    train : DriveTrain, without loss factors, may be traced where ``exact`` is false, loss factors by ``grad`` alone
    exact : bool
        Fractions of the decimals as they print, 0.1 as 1/10; else floats.

    Raises
    ------
    SceneError
        If a link has a loss factor, which is no polynomial in p.
    ValueError
        If ``jit`` or ``vmap`` traces loss factors.

    Examples
    --------
    >>> import jaxhb
    >>> from jaxhb.linear.splitting import links_of
    >>> parts = [jaxhb.Disk(name="a", inertia=0.1), jaxhb.Disk(name="b", inertia=2.0)]
    >>> links_of(jaxhb.build([*parts, jaxhb.Shaft(between=("a", "b"), stiffness=3.0)])).inertia["a"]
    Fraction(1, 10)
    """
    topology, held = train.topology, (train.shafts.loss_factor, train.dampers.loss_factor)
    loss = concrete(*held)
    if traced(loss):
        raise ValueError(
            "characteristic_coefficients: jit or vmap traces the loss factors, and with one there is no polynomial. "
            "Close over the train and trace only what changes."
        )
    # Meshes, the last links, have no loss factor.
    lossy = [name for name, eta in zip(topology.link_names, np.concatenate(loss), strict=False) if eta]
    if lossy:
        raise SceneError(
            f"{topology.title}: link {lossy[0]!r} has a loss factor, which is no polynomial in p. "
            "Use with_viscous_damping."
        )

    if exact and traced(train):
        raise ValueError("characteristic_coefficients: fractions cannot be traced. Leave out exact.")

    def number(value):
        return Fraction(repr(float(value))) if exact else value if traced(value) else float(value)

    inertia = [*train.disks.inertia, *train.dampers.inertia]
    damping = [*train.disks.damping, *(0.0 for _ in topology.damper_names)]
    ground = dict.fromkeys(topology.disk_names, number(0.0))
    for disk, k in zip(topology.ground_disk, train.grounds.stiffness, strict=True):
        ground[topology.disk_names[disk]] += number(k)
    tables = (train.shafts, train.dampers, train.meshes)
    springs = [pair for table in tables for pair in zip(table.stiffness, table.damping, strict=True)]
    turning = len(topology.link_names) - len(topology.mesh_names)
    arms = [(1.0, 1.0)] * turning + [tuple(train.disks.radius[np.array(ends)]) for ends in topology.mesh_ends]
    names = topology.disk_names
    return Links(
        inertia={name: number(J) for name, J in zip(names, inertia, strict=True)},
        damping={name: number(b) for name, b in zip(names, damping, strict=True)},
        ground=ground,
        ends={n: (names[a], names[b]) for n, (a, b) in zip(topology.link_names, topology.link_ends, strict=True)},
        arms={n: tuple(map(number, pair)) for n, pair in zip(topology.link_names, arms, strict=True)},
        stiffness={n: tuple(map(number, pair)) for n, pair in zip(topology.link_names, springs, strict=True)},
    )


def times(a, b):
    """Product of two polynomials, coefficients of the highest power first."""
    product = [0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            product[i + j] += x * y
    return tuple(product)


def less(a, b):
    """Their difference."""
    return plus(a, tuple(-value for value in b))


def plus(a, b):
    """Their sum."""
    size = max(len(a), len(b))
    a, b = (0,) * (size - len(a)) + tuple(a), (0,) * (size - len(b)) + tuple(b)
    return tuple(x + y for x, y in zip(a, b, strict=True))
