"""Tables of motions for a notebook: the links of one, or a row for each speed."""

from collections.abc import Callable
from typing import Any

from jaxhb._shown import MOST_ROWS, html_table, number
from jaxhb.results.motion import Motion


def table_of_speeds(
    caption: str,
    motions: Any,
    head: list[str],
    cells: Callable[[Any], tuple[list[Any], Any]],
) -> str:
    """A table of motions, a row for each speed; ``cells(motion)`` gives its cells below
    ``head`` and whether it has numbers.
    """
    rows = []
    for k in range(min(len(motions), MOST_ROWS)):
        motion = motions[k]
        own_cells, solved = cells(motion)
        peaks = {
            name: float(motion.force(name).peak)
            for name in motion.topology.mesh_names
            if solved
        }
        mesh = max(peaks, key=peaks.__getitem__, default="-")
        rows.append(
            [
                number(float(motion.rpm)),
                *own_cells,
                number(peaks[mesh]) if peaks else "-",
                mesh,
            ]
        )
    caption += f"; the first {MOST_ROWS}" * (len(motions) > MOST_ROWS)
    return html_table(caption, ["rpm", *head, "largest tooth force, N", "mesh"], rows)


def table_of_links(caption: str, motion: Motion) -> str:
    """A table of every mesh, shaft and damper of a motion."""
    topology = motion.topology
    rows = []
    for name in (*topology.mesh_names, *topology.shaft_names, *topology.damper_names):
        toothed = name in topology.mesh_names
        signal = motion.force(name) if toothed else motion.torque(name)
        # Sizes: a sign would tell which end the scene names first.
        values = [
            number(abs(float(value)))
            for value in (signal.mean, signal.half_peak_to_peak, signal.peak)
        ]
        apart = f"{100 * motion.mesh(name).separated_fraction:.3g}" if toothed else ""
        rows.append([name, *values, "N" if toothed else "N m", apart])
    head = [
        "mesh, shaft or damper",
        "mean",
        "half peak-to-peak",
        "peak",
        "unit",
        "separated %",
    ]
    return html_table(caption, head, rows)
