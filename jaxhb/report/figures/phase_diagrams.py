"""Picture of the firing: a phase diagram for each group of orders that share one, a
vector for every cylinder.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jaxhb.linear.vector_sums import VectorSums
from jaxhb.report.figures.draw import empty

if TYPE_CHECKING:
    from jaxhb.report.figures.draw import Axes, Picture

ACROSS = 4  # diagrams in a row
MOST = 12  # diagrams
INCHES = 2.5  # of a diagram
TOGETHER = 1e-6  # distance of vectors that are drawn as one
SUM = "#b03030"
NAMED = 4  # orders in the title of a diagram
ROUND = np.linspace(0.0, 2 * np.pi, 121)


def plot_vector_sums(sums: VectorSums, title: str) -> Picture:
    """Draw the vector exp(i order x firing angle) of every cylinder for each group of
    orders that have one diagram, up to 12 of them, angle 0 upwards and clockwise.

    Cylinders with one direction stand together at their arrow; the second arrow, in the
    middle, is the sum over the number of cylinders.

    >>> import jaxhb
    >>> sums = jaxhb.vector_sums(jaxhb.load_scene("six_cylinder_diesel"))
    >>> picture = plot_vector_sums(sums, "six cylinders")
    >>> picture.axes[0].get_title()
    'order 0.5, 3.5, 6.5, 9.5'
    """
    groups = sums.diagrams()[:MOST]
    rows = -(-len(groups) // ACROSS)
    across = min(ACROSS, len(groups))
    picture = empty(INCHES * across, INCHES * rows + 0.4, layout="constrained")
    picture.suptitle(title, fontsize="medium")
    panels = picture.subplots(rows, across, squeeze=False).ravel()
    for axes in panels:
        axes.set_axis_off()
    for axes, group in zip(panels, groups, strict=False):
        _draw_star(axes, sums, group)
    return picture


def _draw_star(axes: Axes, sums: VectorSums, group: list[int]) -> None:
    """Draw the vectors and their sum."""
    orders = [f"{order:g}" for order in sums.orders[group]]
    more = ", ..." if len(orders) > NAMED else ""
    axes.set_title(f"order {', '.join(orders[:NAMED])}{more}", fontsize="small")
    axes.set(xlim=(-1.5, 1.5), ylim=(-1.5, 1.5), aspect="equal")
    axes.plot(np.cos(ROUND), np.sin(ROUND), color="#c8c8c8", linewidth=0.8)
    # The imaginary part to the right, the real part upwards: clockwise from the top
    vectors = np.asarray(sums.vectors[group[0]])
    by_arrow: dict[int, list[str]] = {}
    for i, name in enumerate(sums.cylinders):
        first = int(np.argmax(np.abs(vectors - vectors[i]) < TOGETHER))
        by_arrow.setdefault(first, []).append(name.rpartition(" ")[2])
    for i, names in by_arrow.items():
        end = vectors[i].imag, vectors[i].real
        axes.annotate("", end, (0, 0), arrowprops={"arrowstyle": "->"})
        axes.text(
            1.22 * end[0],
            1.22 * end[1],
            ", ".join(names),
            ha="center",
            va="center",
            fontsize="x-small",
        )
    total = sums.sums[group[0]] / len(sums.cylinders)
    if abs(total) > TOGETHER:
        arrow = {"arrowstyle": "-|>", "color": SUM, "linewidth": 2.0}
        axes.annotate("", (total.imag, total.real), (0, 0), arrowprops=arrow)
