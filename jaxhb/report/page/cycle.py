"""Part of the page on one speed: what happens over the cycle, and every force and torque there."""

from jaxhb.report.figures.cycle import cycle_figure
from jaxhb.report.figures.style import plain
from jaxhb.report.page.parts import Heading
from jaxhb.report.selection import default_gear, hardest_shaft, meshes_of
from jaxhb.report.text.cases import hardest, speed_tables
from jaxhb.report.text.sentences import status_lines, verdict

MESHES = 3
"""Meshes of the gear that are drawn beside the one with the largest force."""


def cycle_part(report):
    """One speed in full: verdicts, the cycle, tables of forces and torques, normal and misfiring."""
    cases, blocks = report.shown, []
    chosen = [(case, case.answers[report.place]) for case in cases]
    first = chosen[0][1]
    why = "as asked for" if report.asked else f"the speed of the largest {hardest(first)[0]} with {cases[0].title}"
    blocks.append(f"Shown is {first.rpm:g} rpm, {why}.")
    gear = report.gear or default_gear(first)
    subject = gear or (hardest_shaft([first]) if first.topology.link_names else None)
    own = meshes_of(first.topology, gear) if gear else ()
    meshes = list(dict.fromkeys([*own[:MESHES], first.worst_mesh or own[0]])) if own else ()
    for case, answer in chosen:
        lines = [f"{said[0].upper()}{said[1:]}." for said in status_lines(answer)]
        blocks += [Heading(f"With {case.title}"), "\n".join([verdict(answer), *lines])]
        if subject and answer.answered:
            caption = f"{answer.rpm:g} rpm, {plain(case.title)}: torque of {plain(subject)}"
            caption += " and tooth forces" * bool(meshes)
            blocks.append(cycle_figure(answer, subject, meshes, caption))
    return blocks + speed_tables(cases, report.place)
