"""Part of the page on one speed: what happens over the cycle, and every force and torque there."""

import numpy as np

from .cases import speed_tables
from .choose import default_gear, gears, hardest_shaft, meshes_of, worst_mesh
from .misfire_cases import hardest
from .page_figures import Figure, bands, layout, line, marks, top_of
from .page_parts import Heading
from .plots import angles_of, closed, count_of, in_the_gap, periods_of, plain
from .words import status_lines, verdict

SPIKES = 3
"""Cycles up to which every sample is drawn; of longer periods as many points in all."""


def cycle_part(report):
    """One speed in full: verdicts, the cycle, tables of forces and torques, normal and misfiring."""
    cases, blocks = report.shown, []
    chosen = [(case, case.answers[report.place]) for case in cases]
    first = chosen[0][1]
    why = "as asked for" if report.asked else f"the speed of the largest {hardest(first)[0]} with {cases[0].title}"
    blocks.append(f"Shown is {first.rpm:g} rpm, {why}.")
    gear = report.gear or default_gear(first)
    subject = gear or (hardest_shaft([first]) if first.topology.link_names else None)
    for case, answer in chosen:
        lines = [f"{said[0].upper()}{said[1:]}." for said in status_lines(answer)]
        blocks += [Heading(f"With {case.title}"), "\n".join([verdict(answer), *lines])]
        blocks += [_cycle(case, answer, subject, worst_mesh(first))] if subject and answer.answered else []
    return blocks + speed_tables(cases, report.place)


def _cycle(case, answer, subject, worst):
    """Torque of a gear, forces of its meshes and of the hardest one over the period; or the torque of a shaft."""
    if subject in gears(answer.topology):
        meshes = meshes_of(answer.topology, subject)
        after, before = answer.gear_torque(subject), answer.linear.gear_torque(subject)
    else:
        meshes, after, before = (), answer.torque(subject), answer.linear.torque(subject)
    drawn = meshes if worst in (None, *meshes) else (*meshes, worst)
    caption = f"{answer.rpm:g} rpm, {plain(case.title)}: torque of {plain(subject)}"
    if answer.response is None:
        return _record(answer, caption, after, before, drawn)
    return _period(answer, caption, after, before, meshes, drawn)


def _period(answer, caption, after, before, meshes, drawn):
    """Signals over the period of the motion, with and without backlash; grey where teeth of the meshes are apart."""
    backlash = any(answer.topology.mesh_backlash)
    x = {"x0": 0.0, "dx": answer.cycle_deg * periods_of(answer) / count_of(answer) * _step(answer)}
    traces = [_sampled(answer, after, x, "with backlash" if backlash else "torque", 0)]
    traces += [_sampled(answer, before, x, "without backlash", 1)] if backlash else []
    for number, name in enumerate(drawn):
        force = _sampled(answer, answer.force(name), x, plain(name), 2 * number, factor=1e-3, panel=1)
        traces.append(force)
        if backlash:
            said = f"{plain(name)}, without"
            traces.append(_sampled(answer, answer.linear.force(name), x, said, 2 * number + 1, factor=1e-3, panel=1))
    apart = [in_the_gap(answer, name, count_of(answer)) for name in meshes]
    edges = _runs(np.any(apart, axis=0), angles_of(answer)) if meshes else []
    panels = [("torque, N m", None)] + [("tooth force, kN", None)] * bool(drawn)
    zero = " (0: firing top dead centre of a cylinder with firing angle 0)" if answer.topology.cylinder_names else ""
    end = answer.cycle_deg * periods_of(answer)
    title = f"angle of the reference rotor, deg{zero}"
    made = layout(title, panels, traces, x_range=(0.0, end), heights=[190] * len(panels), shapes=bands(edges))
    if answer.cycle_deg % 90 == 0 and periods_of(answer) == 1:
        made["xaxis"] |= {"dtick": 90}
    shaded = "; grey: its teeth are apart" if edges else ""
    both = " and tooth forces" if drawn else ""
    return Figure(f"{caption}{both} over the period{shaded}", traces, made)


def _step(answer):
    return max(1, periods_of(answer) // SPIKES)


def _sampled(answer, signal, x, name, style, *, factor=1.0, panel=0):
    values = factor * np.asarray(closed(answer, signal))[:: _step(answer)]
    trace = line([], values, name, style, panel=panel) | x
    trace["line"] |= {"width": 1.1}
    del trace["x"]
    return trace


def _runs(apart, angles):
    """Pairs of angles between which teeth are apart."""
    steps = np.diff(np.concatenate([[0], np.asarray(apart, int), [0]]))
    starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
    return [(float(angles[i]), float(angles[min(j, len(angles) - 1)])) for i, j in zip(starts, ends, strict=True)]


def _record(answer, caption, after, before, meshes):
    """A motion that never repeats: extremes of every recorded cycle."""
    cycles = np.arange(1, len(after.highest) + 1)
    traces = [
        marks(cycles, after.highest, "largest of a cycle", "triangle-up", size=6),
        marks(cycles, after.lowest, "smallest of a cycle", "triangle-down-open", size=6),
    ]
    for value, said in ((before.max, "extremes without backlash"), (before.min, "")):
        ends = [cycles[0], cycles[-1]]
        traces.append(line(ends, [float(value)] * 2, said, 1, showlegend=bool(said)))
    symbols = "circle", "square-open", "diamond", "cross", "star", "x"
    for number, name in enumerate(meshes):
        peaks = np.asarray(answer.force(name).highest) / 1e3
        traces.append(marks(cycles, peaks, plain(name), symbols[number % 6], size=5, panel=1))
    limits = top_of(*(trace["y"] for trace in traces if trace["yaxis"] == "y2"))
    panels = [("torque, N m", None)] + [("largest force, kN", limits)] * bool(meshes)
    made = layout("recorded cycle", panels, traces, x_range=(0.0, len(cycles) + 1.0))
    return Figure(f"{caption}, extremes of every recorded cycle: the motion never repeats", traces, made)
