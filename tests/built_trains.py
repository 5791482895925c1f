"""A pair of disks for tests of excitation, and what makes two trains equal."""

import dataclasses

import jax
import numpy as np

from jaxhb.elements.elements import Disk, Load, Shaft
from jaxhb.train.assembly import build


def pair(*more, **options):
    """Two disks on a shaft, with a load on the second."""
    parts = [Disk(name="a", inertia=1.0), Disk(name="b", inertia=2.0), Load(disk="b")]
    return build([*parts, Shaft(between=("a", "b"), stiffness=1e5), *more], **options)


def same(one, two):
    """Two trains are equal but for their names."""
    alike = dataclasses.replace(one.topology, name=two.topology.name)
    leaves = zip(jax.tree.leaves(one), jax.tree.leaves(two), strict=True)
    return alike == two.topology and all(np.array_equal(a, b) for a, b in leaves)
