"""The lowest modes of large trains of any shape, against all modes of the dense
solve.
"""

import numpy as np

from jaxhb import Disk, Ground, Shaft, build
from jaxhb.linear.modal import natural_frequencies


def test_the_lowest_modes_of_a_large_tree_are_those_of_the_dense_solve():
    """Free, and held by a ground; every fifth shaft begins a branch."""
    disks = 700
    parts = [Disk(name=f"d{k}", inertia=1.0 + 0.1 * (k % 7)) for k in range(disks)]
    for k in range(1, disks):
        before = k - 1 if k % 5 else max(0, k - 8)
        parts.append(
            Shaft(
                between=(f"d{before}", f"d{k}"), stiffness=1e6 * (1 + 0.03 * (k % 11))
            )
        )
    for grounds in ([], [Ground(disk="d3", stiffness=1e3)]):
        train = build([*parts, *grounds], reference="d0")
        few = natural_frequencies(train, count=12)
        every = natural_frequencies(train)
        np.testing.assert_allclose(
            few.frequencies_hz, every.frequencies_hz[:12], rtol=1e-9, atol=1e-12
        )
        np.testing.assert_allclose(few.strain_share, every.strain_share[:12], atol=1e-8)
