"""Tables of responses as text: speeds in rpm, torques in N m, tooth forces in kN."""

import math
import textwrap

import numpy as np

from .balance import balance_line, mean_angles_of
from .report import contacts_of, gears, hardest_impact, hardest_shaft, notes, shafts_of, status_line, status_of, verdict

NONE = "-"


def solve_text(response, linear):
    """The answer at one speed: verdict, tooth forces, torques of gears and shafts, notes.

    Parameters
    ----------
    response, linear : Response
        With backlash, and with all teeth in contact (:func:`jaxhb.linear_response`), at the same speed.

    Returns
    -------
    str
    """
    name = response.topology.name or "scene"
    means = "; ".join(filter(None, [balance_line(response), f"mean angles: {mean_angles_of(response.topology)}"]))
    head = [verdict(response), "", f"{name} at {float(response.rpm):g} rpm", status_line(response), means]
    parts = ["\n".join(head)]
    if response.topology.mesh_names:
        parts += [_mesh_table(response, linear), _contact_table(response), _gear_table(response, linear)]
    if shafts_of(response.topology):
        parts.append(_shaft_table(response, linear))
    if not response.topology.link_names:
        parts.append(_disk_table(response))
    return "\n\n".join([*parts, *notes_text(response)])


def notes_text(*responses):
    """The notes on the tooth law as one paragraph in a list; an empty list where there are none."""
    remarks = [
        textwrap.fill(remark, 116, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)
        for remark in notes(*responses)
    ]
    return ["\n".join(["Notes", *remarks])] if remarks else []


def _mesh_table(response, linear):
    names = response.topology.mesh_names
    forces = [response.force(name) for name in names]
    before = [linear.force(name) for name in names]
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
    return title + "\n" + aligned(heads, [names, *columns], groups)


def _contact_table(response):
    contacts = contacts_of(response)
    ends = {
        name: [response.topology.disk_names[disk] for disk in pair]
        for name, pair in zip(response.topology.mesh_names, response.topology.mesh_ends, strict=True)
    }
    columns = [
        shares([contact and contact.separated_fraction for contact in contacts.values()]),
        shares([contact and contact.reverse_contact_fraction for contact in contacts.values()]),
        [NONE if contact is None else str(len(contact.impacts)) for contact in contacts.values()],
        [_speed(contact) for contact in contacts.values()],
        [_driver(contact, ends[name]) for name, contact in contacts.items()],
    ]
    heads = ["mesh", "apart %", "reverse %", "impacts", "hardest m/s", "driven by"]
    title = "Contact over the cycle (apart: in the gap; reverse: on the flank that does not drive)"
    return title + "\n" + aligned(heads, [contacts, *columns])


def _speed(contact):
    return NONE if contact is None or not contact.impacts else f"{hardest_impact(contact):.2f}"


def _driver(contact, ends):
    if contact is None or not contact.drive_side:
        return NONE
    return ends[0] if contact.drive_side > 0 else ends[1]


def _gear_table(response, linear):
    names = gears(response)
    after = [response.gear_torque(name) for name in names]
    before = [linear.gear_torque(name) for name in names]
    title = "Torque that a gear passes to its mates, N m"
    return title + "\n" + _torque_columns("gear", names, after, before)


def _shaft_table(response, linear):
    names = shafts_of(response.topology)
    after = [response.torque(name) for name in names]
    before = [linear.torque(name) for name in names]
    if any(response.topology.mesh_backlash):
        return "Torque of shafts and dampers, N m\n" + _torque_columns("shaft", names, after, before)
    columns = alike([s.mean for s in after], [s.half_peak_to_peak for s in after], [s.sum_of_amplitudes for s in after])
    heads = ["shaft", "mean", "half peak-to-peak", "sum of amplitudes"]
    return "Torque of shafts and dampers, N m\n" + aligned(heads, [names, *columns])


def _disk_table(response):
    names = response.topology.disk_names
    signals = [response.disk(name) for name in names]
    columns = alike(*([1e3 * getattr(s, what) for s in signals] for what in ("half_peak_to_peak", "sum_of_amplitudes")))
    heads = ["disk", "half peak-to-peak", "sum of amplitudes"]
    return "Vibratory angle of disks, mrad\n" + aligned(heads, [names, *columns])


def _torque_columns(what, names, after, before):
    swings = [signal.half_peak_to_peak for signal in after], [signal.half_peak_to_peak for signal in before]
    peaks = [signal.peak for signal in after], [signal.peak for signal in before]
    columns = alike([signal.mean for signal in after], peaks[0], swings[0], peaks[1], swings[1])
    columns.append(ratios(*swings))
    heads = [what, "mean", "peak", "half p-p", "peak", "half p-p", "ratio of half p-p"]
    return aligned(heads, [names, *columns], [("with backlash", 1, 3), ("without", 4, 5)])


def sweep_text(sweep, linear):
    """One row per speed: the mesh with the largest tooth force, or the shaft with the largest torque."""
    count = len(sweep)
    responses, before = [sweep[i] for i in range(count)], [linear[i] for i in range(count)]
    toothed = bool(sweep.topology.mesh_names)
    heads, columns = (_sweep_meshes if toothed else _sweep_shafts)(responses, before)
    states = [status_of(response).name.lower().replace("_", " ") for response in responses]
    table = aligned(
        ["rpm", *heads, "harmonics", "status"],
        [[f"{float(r.rpm):g}" for r in responses], *columns, [str(r.highest_harmonic) for r in responses], states],
    )
    lines = [_sweep_verdict(responses), "", table]
    failed = sorted({status_of(r) for r in responses if not r.converged})
    lines += [""] if failed else []
    for status in failed:
        speeds = [f"{float(r.rpm):g}" for r in responses if status_of(r) == status]
        lines.append(f"{status.name} at {', '.join(speeds)} rpm: {status.sentence}.")
    return "\n\n".join(["\n".join(lines), *notes_text(*responses)])


def _sweep_meshes(responses, before):
    names = [worst_mesh(response) for response in responses]
    contacts = [contacts_of(response) for response in responses]
    apart = [most_apart(contact) for contact in contacts]
    columns = [
        names,
        *alike(*([r.force(name).peak / 1e3 for r, name in zip(rs, names, strict=True)] for rs in (responses, before))),
        [name or NONE for name in apart],
        shares([0.0 if name is None else c[name].separated_fraction for c, name in zip(contacts, apart, strict=True)]),
        [_hardest(contact) for contact in contacts],
    ]
    heads = ["largest tooth force", "with kN", "without kN", "longest apart", "apart %", "hardest m/s"]
    return heads, columns


def _sweep_shafts(responses, before):
    if not shafts_of(responses[0].topology):
        return _sweep_disks(responses)
    names = [hardest_shaft(response) for response in responses]
    swings = [r.torque(name).half_peak_to_peak for r, name in zip(responses, names, strict=True)]
    sums = [r.torque(name).sum_of_amplitudes for r, name in zip(responses, names, strict=True)]
    heads = ["largest shaft torque", "half p-p N m", "sum of amplitudes N m"]
    return heads, [names, *alike(swings, sums)]


def _sweep_disks(responses):
    """A train without links: its disks alone."""
    disks = [{name: response.disk(name) for name in response.topology.disk_names} for response in responses]
    names = [max(signals, key=lambda name, s=signals: float(s[name].half_peak_to_peak)) for signals in disks]
    largest = [signals[name] for signals, name in zip(disks, names, strict=True)]
    columns = alike([1e3 * s.half_peak_to_peak for s in largest], [1e3 * s.sum_of_amplitudes for s in largest])
    return ["largest angle", "half p-p mrad", "sum of amplitudes mrad"], [names, *columns]


def worst_mesh(response):
    """The mesh with the largest tooth force."""
    return max(response.topology.mesh_names, key=lambda name: float(response.force(name).peak))


def most_apart(contacts):
    """The mesh that is apart for the largest share of the cycle; None where all stay in contact."""
    known = {name: contact.separated_fraction for name, contact in contacts.items() if contact is not None}
    name = max(known, key=known.get, default=None)
    return name if name is not None and known[name] else None


def _hardest(contacts):
    speeds = [hardest_impact(contact) for contact in contacts.values() if contact is not None]
    return f"{max(speeds):.2f}" if any(speeds) else NONE


def _sweep_verdict(responses):
    speeds = [float(response.rpm) for response in responses]
    first, last = min(speeds), max(speeds)
    if not any(responses[0].topology.mesh_backlash):
        return f"No mesh with backlash: {len(speeds)} speeds from {first:g} to {last:g} rpm."
    failed = sum(not response.converged for response in responses)
    doubt = f"; {failed} did not converge, do not rely on those" if failed else ""
    hammering = [float(r.rpm) for r in responses if most_apart(contacts_of(r)) is not None]
    if not hammering:
        return f"All teeth stay in contact at all {len(speeds)} speeds from {first:g} to {last:g} rpm{doubt}."
    return (
        f"Teeth separate at {len(hammering)} of {len(speeds)} speeds between {first:g} and {last:g} rpm: "
        f"{_ranges(speeds, hammering)} rpm{doubt}."
    )


def _ranges(speeds, chosen):
    """``1500-2450`` for speeds that follow each other."""
    runs, ordered = [], sorted(speeds)
    for i, speed in enumerate(ordered):
        if speed not in chosen:
            continue
        if runs and i and runs[-1][1] == ordered[i - 1]:
            runs[-1][1] = speed
        else:
            runs.append([speed, speed])
    return ", ".join(f"{a:g}" if a == b else f"{a:g}-{b:g}" for a, b in runs)


def modes_text(modes, name):
    """Natural frequencies, the share of the teeth in their energy, and the disks that move most."""
    rows, loose = [], int(np.sum(modes.frequencies_hz == 0))
    for k, hz in enumerate(modes.frequencies_hz):
        shape = modes.shape(k)
        most = sorted(shape, key=lambda disk: -abs(shape[disk]))[:3]
        moving = ", ".join(f"{disk} {shape[disk]:+.2f}" for disk in most)
        if not hz and loose > 1:
            moving = f"one of {loose} rigid-body modes"
        elif not hz and all(shape.values()):
            moving = "rigid-body mode"
        rows.append([str(k), f"{hz:.2f}", f"{60 * hz:.0f}", f"{100 * modes.mesh_energy_share[k]:.0f}", moving])
    heads = ["mode", "Hz", "per minute", "in teeth %", "largest angles (relative)"]
    title = f"Natural frequencies of {name}: undamped, teeth in contact; share of the strain energy in the teeth"
    return title + "\n" + aligned(heads, list(zip(*rows, strict=True)), left=(4,))


def aligned(heads, columns, groups=(), left=()):
    """Columns of strings under their heads; the first flush left, as those numbered in ``left``, the others right."""
    columns = [[head, *map(str, column)] for head, column in zip(heads, columns, strict=True)]
    widths = [max(map(len, column)) for column in columns]
    for title, first, last in groups:
        room = sum(widths[first : last + 1]) + 2 * (last - first)
        widths[first] += max(0, len(title) - room)
    flush = [str.ljust if i == 0 or i in left else str.rjust for i in range(len(columns))]
    rows = [
        "  ".join(put(cell, width) for put, cell, width in zip(flush, row, widths, strict=True)).rstrip()
        for row in zip(*columns, strict=True)
    ]
    return "\n".join("  " + row for row in [*_group_line(groups, widths), *rows])


def _group_line(groups, widths):
    line = ""
    for title, first, last in groups:
        begin = sum(widths[:first]) + 2 * first
        room = sum(widths[first : last + 1]) + 2 * (last - first)
        line = line.ljust(begin) + f" {title} ".center(room, "-")
    return [line] if groups else []


def alike(*columns, digits=4):
    """Columns of numbers with the same decimals: ``digits`` significant ones for the largest of all."""
    numbers = [[float(value) for value in column] for column in columns]
    largest = max((abs(x) for column in numbers for x in column if math.isfinite(x)), default=0.0)
    places = 0 if largest == 0 else min(max(digits - 1 - math.floor(math.log10(largest)), 0), 12)
    # Adding 0.0 after rounding turns -0.0 into 0.0.
    return [
        [f"{round(x, places) + 0.0:.{places}f}" if math.isfinite(x) else NONE for x in column] for column in numbers
    ]


def shares(fractions):
    """Fractions of the cycle in %; a small one is not shown as 0."""
    return [NONE if share is None else _percent(share) for share in fractions]


def _percent(share):
    return "<0.1" if 0 < share < 5e-4 else f"{100 * share:.1f}"


def ratios(numbers, before):
    """Quotients with two decimals, ``-`` where nothing is compared."""
    quotient = [float(a) / float(b) if b else np.nan for a, b in zip(numbers, before, strict=True)]
    return [f"{value:.2f}" if math.isfinite(value) else NONE for value in quotient]
