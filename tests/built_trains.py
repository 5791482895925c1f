"""A pair of disks for tests of excitation, and equality of trains."""

import dataclasses

import jax
import numpy as np

from jaxhb.elements.elements import Disk, Load, Shaft
from jaxhb.train.assembly import build


def pair(*more, **options):
    """Two disks on a shaft, with a load on the second."""
    parts = [
        Disk(name="a", inertia=1.0),
        Disk(name="b", inertia=2.0),
        Load(disk="b"),
        Shaft(between=("a", "b"), stiffness=1e5),
        *more,
    ]
    return build(parts, **options)


def same(train, other):
    """Whether two trains are equal but for their names."""
    renamed = dataclasses.replace(train.topology, name=other.topology.name)
    leaves = zip(jax.tree.leaves(train), jax.tree.leaves(other), strict=True)
    return renamed == other.topology and all(np.array_equal(a, b) for a, b in leaves)
