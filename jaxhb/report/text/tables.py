"""One speed as text: speeds in rpm, torques in N m, tooth forces in kN; and natural frequencies."""

import textwrap

import numpy as np

from jaxhb.linear.critical import ELASTIC, RIGID, RING
from jaxhb.report.quantities import shown_unit
from jaxhb.report.selection import gears, shafts_of, train_name
from jaxhb.report.text.certified import certificate_text
from jaxhb.report.text.columns import NONE, Table, alike, ratios, shares
from jaxhb.report.text.holzer import FIRST
from jaxhb.report.text.mean_torques import balance_line, mean_angles_of, plain_number
from jaxhb.report.text.sentences import notes, status_lines, verdict
from jaxhb.report.text.strength import answers_strength, strength_text
from jaxhb.train.plausible import plausibility

RPM = 30 / np.pi
"""rpm per rad/s."""


def solve_text(answer):
    """The answer at one speed: verdict, kind of motion, tooth forces, torques of gears and shafts, notes.

    Parameters
    ----------
    answer : Answer

    Returns
    -------
    str
    """
    topology = answer.topology
    means = "; ".join(filter(None, [balance_line(answer.balance), f"mean angles: {mean_angles_of(topology)}"]))
    head = [verdict(answer), "", f"{train_name(topology)} at {answer.rpm:g} rpm", *status_lines(answer), means]
    parts = []
    if topology.mesh_names:
        parts += [_mesh_table(answer), *peak_table(answer), _contact_table(answer), _gear_table(answer)]
    if shafts_of(topology):
        parts.append(_shaft_table(answer))
    if not topology.link_names:
        parts.append(_disk_table(answer))
    if answer.known and answer.response is not None:
        parts.append(_speed_table(answer))
    if answer.doubt:
        parts = [f"{answer.doubt.upper()}: {part}" for part in parts]
    parts = ["\n".join(head), *parts]
    if answer.certificate is not None:
        parts.append(certificate_text(answer, answer.certificate))
    parts += strength_text({"": answers_strength([answer])})
    return "\n\n".join([*parts, *notes_text(answer)])


def notes_text(*answers):
    """The notes on the scene and on the motions as one paragraph in a list; an empty list where there are none."""
    return remarks_text([*plausibility(answers[0].train), *notes(*answers)])


def remarks_text(remarks):
    """Sentences as one paragraph in a list; an empty list where there are none."""
    return ["\n".join(["Notes", *map(paragraph, remarks)])] if remarks else []


def paragraph(text):
    """A sentence of a list, in lines."""
    return textwrap.fill(text, 116, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)


def _mesh_table(answer):
    names = answer.topology.mesh_names
    forces = [answer.force(name) for name in names]
    before = [answer.linear.force(name) for name in names]
    columns = alike(
        [signal.mean / 1e3 for signal in forces],
        [signal.max / 1e3 for signal in forces],
        [signal.min / 1e3 for signal in forces],
        [signal.max / 1e3 for signal in before],
        [signal.min / 1e3 for signal in before],
    )
    columns.append(ratios([signal.peak for signal in forces], [signal.peak for signal in before]))
    heads = ["mesh", "mean", "max", "min", "max", "min", "peak ratio"]
    groups = [("with backlash", 1, 3), ("without", 4, 5)]
    title = "Tooth force, kN (elastic and damping; positive: the first gear drives the second)"
    return Table(title, heads, [names, *columns], groups)


def peak_table(answer, begin="L"):
    """How the largest tooth forces of recorded cycles are distributed, in a list; empty without a record."""
    if not answer.known or answer.response is not None:
        return []
    names = answer.topology.mesh_names
    columns = alike(*np.array([answer.force(name).per_cycle.max for name in names]).T / 1e3)
    title = f"{begin}argest tooth force of a cycle, kN: 5, 50 and 95 % of the recorded cycles stay below"
    return [Table(title, ["mesh", "5 %", "50 %", "95 %"], [names, *columns])]


def _contact_table(answer):
    topology = answer.topology
    contacts = [answer.contacts[name] for name in topology.mesh_names]
    columns = [
        shares([contact.separated_fraction for contact in contacts]),
        shares([contact.reverse_contact_fraction for contact in contacts]),
        [_count(contact.impacts_per_cycle) for contact in contacts],
        [hardest_text(contact) for contact in contacts],
        [_driver(answer, name) for name in topology.mesh_names],
    ]
    heads = ["mesh", "apart %", "reverse %", "impacts", "hardest m/s", "driven by"]
    title = "Contact, % of the time (apart: in the gap; reverse: on the flank that does not drive), impacts a cycle"
    return Table(title, heads, [topology.mesh_names, *columns])


def _count(number):
    return plain_number(number, digits=3) if np.isfinite(number) else NONE


def hardest_text(*contacts):
    """Approach speed of the hardest impact, a dash without one."""
    speed = max((contact.hardest_impact for contact in contacts), default=0.0)
    return f"{speed:.2f}" if speed > 0 else NONE


def _driver(answer, name):
    topology, side = answer.topology, answer.contacts[name].drive_side
    first, second = topology.mesh_ends[topology.mesh_names.index(name)]
    return topology.disk_names[first if side > 0 else second] if side else NONE


def _gear_table(answer):
    names = gears(answer.topology)
    after = [answer.gear_torque(name) for name in names]
    before = [answer.linear.gear_torque(name) for name in names]
    return _torque_table("Torque that a gear passes to its mates, N m", "gear", names, after, before)


def _shaft_table(answer):
    names = shafts_of(answer.topology)
    after = [answer.torque(name) for name in names]
    before = [answer.linear.torque(name) for name in names]
    title, (heat,) = "Torque of shafts and dampers, N m", alike([answer.power(name) for name in names])
    if any(answer.topology.mesh_backlash):
        return _torque_table(title, "shaft", names, after, before, heat)
    columns = alike([s.mean for s in after], [s.half_peak_to_peak for s in after], [s.sum_of_amplitudes for s in after])
    heads = ["shaft", "mean", "half peak-to-peak", "sum of amplitudes", "heat W"]
    return Table(title, heads, [names, *columns, heat])


def _disk_table(answer):
    names = answer.topology.disk_names
    signals = [answer.disk(name) for name in names]
    factor, unit = shown_unit("rad")
    swings = ([factor * getattr(s, what) for s in signals] for what in ("half_peak_to_peak", "sum_of_amplitudes"))
    heads = ["disk", "half peak-to-peak", "sum of amplitudes"]
    return Table(f"Vibratory angle of disks, {unit}", heads, [names, *alike(*swings)])


def irregularity_text(answer, disk):
    """Cyclic irregularity of a disk in %, a dash where it is not known."""
    value = answer.irregularity(disk)
    return plain_number(100 * value, digits=3) if np.isfinite(value) else NONE


def _speed_table(answer):
    names = answer.topology.disk_names
    speeds = [answer.speed(name) for name in names]
    means = [f"{RPM * float(speed.mean):.6g}" for speed in speeds]
    (swings,) = alike([RPM * float(speed.half_peak_to_peak) for speed in speeds])
    irregular = [irregularity_text(answer, name) for name in names]
    (accelerations,) = alike([answer.acceleration(name).half_peak_to_peak for name in names])
    title = "Speed of disks, rpm; cyclic irregularity: (largest - smallest) / mean; acceleration, rad/s2, half p-p"
    heads = ["disk", "mean", "half p-p", "irregularity %", "acceleration"]
    return Table(title, heads, [names, means, swings, irregular, accelerations])


def _torque_table(title, what, names, after, before, *more):
    swings = [signal.half_peak_to_peak for signal in after], [signal.half_peak_to_peak for signal in before]
    peaks = [signal.peak for signal in after], [signal.peak for signal in before]
    columns = alike([signal.mean for signal in after], peaks[0], swings[0], peaks[1], swings[1])
    columns.append(ratios(*swings))
    heads = [what, "mean", "peak", "half p-p", "peak", "half p-p", "ratio of half p-p", *["heat W"] * len(more)]
    return Table(title, heads, [names, *columns, *more], [("with backlash", 1, 3), ("without", 4, 5)])


def energies_text(modes, kinds):
    """Where the energies of the first elastic modes lie, in disks and links; Holzer's table has them of trees.

    Parameters
    ----------
    modes : Modes
    kinds : sequence of str, as for :func:`modes_text`

    Returns
    -------
    list of str
        Two tables, none where no mode strains a link.
    """
    shown = [k for k, kind in enumerate(kinds) if kind == ELASTIC][:FIRST]

    def table(what, heads, names, share):
        columns = [shares(share[k]) for k in shown]
        title = f"{what} energy of the first elastic modes, %"
        return Table(title, [heads, *(f"mode {k}" for k in shown)], [names, *columns])

    tables = (
        ("Kinetic", "disk", modes.names, modes.kinetic_share),
        ("Strain", "link", modes.link_names, modes.strain_share),
    )
    return [table(*one) for one in tables if shown]


def modes_text(modes, name, kinds, ratios, teeth=""):
    """Natural frequencies, nodes, damping ratios, the share of the teeth in their energy, what moves most.

    Parameters
    ----------
    modes : Modes
    name : str, of the scene
    kinds : sequence of str, of each mode, from :func:`jaxhb.linear.critical.mode_kinds`
    ratios : array ``(m,)``, Lehr's damping ratios, nan where there is none
    teeth : str, how stiff they are; empty of a train without

    Returns
    -------
    str
    """
    rows, loose = [], sum(kind == RIGID for kind in kinds)
    for k, hz in enumerate(modes.frequencies_hz):
        shape = modes.shape(k)
        most = sorted(shape, key=lambda disk: -abs(shape[disk]))[:3]
        moving = ", ".join(f"{disk} {shape[disk]:+.2f}" for disk in most)
        if kinds[k] == RING:
            moving = f"ring only: {most[0]} turns freely"
        elif kinds[k] == RIGID:
            moving = f"one of {loose} rigid-body modes" if loose > 1 else "rigid-body mode"
            moving += " on the ground's spring" if hz else ""
        damping = f"{ratios[k]:.4f}" if np.isfinite(ratios[k]) else NONE
        nodes = modes.node_count[k] if kinds[k] == ELASTIC else NONE
        teeth_share = f"{100 * modes.mesh_energy_share[k]:.0f}"
        rows.append([k, f"{hz:.2f}", f"{60 * hz:.0f}", nodes, damping, *[teeth_share] * bool(teeth), moving])
    heads = ["mode", "Hz", "per minute", "nodes", "damping ratio", *["in teeth %"] * bool(teeth)]
    title = f"Natural frequencies of {name}: undamped"
    title += f", {teeth}; share of the strain energy in the teeth" if teeth else ""
    columns = list(zip(*rows, strict=True))
    return Table(title, [*heads, "largest angles, on own shafts, the largest 1"], columns, left=(len(heads),))
