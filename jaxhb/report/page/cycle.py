"""Part of the page on one speed: what happens over the cycle, and every force and torque there."""

from dataclasses import dataclass

import numpy as np

from jaxhb.report.figures.cycle import angles_of, closed, count_of, in_the_gap, periods_of
from jaxhb.report.figures.style import plain
from jaxhb.report.page.figures import Figure, above, bands, layout, line, marks
from jaxhb.report.page.parts import Heading
from jaxhb.report.selection import default_gear, gears, hardest_shaft, meshes_of, worst_mesh
from jaxhb.report.text.cases import hardest, speed_tables
from jaxhb.report.text.sentences import status_lines, verdict

MESHES, PANEL = 3, 130
"""Meshes of the gear that are drawn, and height of a panel."""

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
    """Torque of a gear, forces of its meshes and of the hardest one; or the torque of a shaft."""
    drawn = _drawn(answer, subject, worst)
    both = " and tooth forces" if len(drawn) > 1 else ""
    caption = f"{answer.rpm:g} rpm, {plain(case.title)}: torque of {plain(subject)}{both}"
    return (_record if answer.response is None else _period)(answer, caption, drawn)


@dataclass(frozen=True)
class Drawn:
    """A panel: what it shows, its unit and the factor to it from SI, the signal, that without backlash, and the meshes
    whose gaps are shaded."""

    name: str
    unit: str
    factor: float
    after: object
    before: object
    meshes: tuple


def _drawn(answer, subject, worst):
    """The panels of a figure."""
    if subject not in gears(answer.topology):
        return [Drawn(subject, "N m", 1.0, answer.torque(subject), answer.linear.torque(subject), ())]
    meshes = meshes_of(answer.topology, subject)
    torques = answer.gear_torque(subject), answer.linear.gear_torque(subject)
    forces = [
        Drawn(name, "kN", 1e-3, answer.force(name), answer.linear.force(name), (name,))
        for name in dict.fromkeys([*meshes[:MESHES], worst or meshes[0]])
    ]
    return [Drawn(subject, "N m", 1.0, *torques, meshes), *forces]


def _period(answer, caption, drawn):
    """Signals over the period of the motion, with and without backlash; grey where the teeth are apart."""
    backlash = any(answer.topology.mesh_backlash)
    traces, shapes, notes = [], [], []
    for panel, one in enumerate(drawn):
        more = {"panel": panel, "showlegend": backlash and not panel}
        traces.append(_sampled(answer, one, one.after, "with backlash" if backlash else plain(one.name), 0, **more))
        traces += [_sampled(answer, one, one.before, "without backlash", 1, **more)] if backlash else []
        apart = [in_the_gap(answer, name, count_of(answer)) for name in one.meshes]
        edges = _runs(np.any(apart, axis=0), angles_of(answer)) if apart else []
        shapes += bands(edges, rows=f"y{panel + 1 if panel else ''} domain")
        notes.append(above(plain(one.name), panel))
    zero = " (0: firing top dead centre of a cylinder with firing angle 0)" if answer.topology.cylinder_names else ""
    end, title = answer.cycle_deg * periods_of(answer), f"angle of the reference rotor, deg{zero}"
    panels = [(one.unit, None) for one in drawn]
    more = {"heights": [PANEL] * len(panels), "shapes": shapes, "annotations": notes, "x_range": (0.0, end)}
    made = layout(title, panels, traces, **more)
    made["legend"] |= {"x": 1, "xanchor": "right"}
    if answer.cycle_deg % 90 == 0 and periods_of(answer) == 1:
        made["xaxis"] |= {"dtick": 90}
    shaded = "; grey: its teeth are apart" if shapes else ""
    return Figure(f"{caption} over the period{shaded}", traces, made)


def _step(answer):
    return max(1, periods_of(answer) // SPIKES)


def _sampled(answer, one, signal, name, style, **more):
    """A signal over the whole period."""
    values = one.factor * np.asarray(closed(answer, signal))[:: _step(answer)]
    trace = line([], values, name, style, **more)
    trace["line"] |= {"width": 1.1}
    # Equal steps: a start and a step in place of all angles keep the page small.
    del trace["x"]
    return trace | {"x0": 0.0, "dx": answer.cycle_deg * periods_of(answer) / count_of(answer) * _step(answer)}


def _runs(apart, angles):
    """Pairs of angles between which teeth are apart."""
    steps = np.diff(np.concatenate([[0], np.asarray(apart, int), [0]]))
    starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
    return [(float(angles[i]), float(angles[min(j, len(angles) - 1)])) for i, j in zip(starts, ends, strict=True)]


def _record(answer, caption, drawn):
    """A motion that never repeats: extremes of every recorded cycle, and those without backlash."""
    traces, notes = [], []
    for panel, one in enumerate(drawn):
        more = {"panel": panel, "showlegend": not panel, "size": 5}
        cycles = np.arange(1, len(one.after.highest) + 1)
        traces += [
            marks(cycles, one.factor * one.after.highest, "largest of a cycle", "triangle-up", **more),
            marks(cycles, one.factor * one.after.lowest, "smallest of a cycle", "triangle-down-open", **more),
        ]
        for value, said in ((one.before.max, "extremes without backlash"), (one.before.min, "")):
            shown = bool(said) and not panel
            traces.append(
                line(cycles[[0, -1]], [one.factor * float(value)] * 2, said, 1, panel=panel, showlegend=shown)
            )
        notes.append(above(plain(one.name), panel))
    panels = [(one.unit, None) for one in drawn]
    more = {"heights": [PANEL] * len(panels), "annotations": notes, "x_range": (0.0, len(cycles) + 1.0)}
    made = layout("recorded cycle", panels, traces, **more)
    made["legend"] |= {"x": 1, "xanchor": "right"}
    return Figure(f"{caption}, extremes of every recorded cycle: the motion never repeats", traces, made)
