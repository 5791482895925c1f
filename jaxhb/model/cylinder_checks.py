"""Checks of a cylinder by itself: where its gas torque comes from, and what this needs."""

from __future__ import annotations

from collections import Counter

from jaxhb.model import gas
from jaxhb.model.elements import Combustion, Trace, Unread
from jaxhb.model.value_checks import number_like, row_errors


def cylinder_errors(cylinder) -> list[str]:
    """Check that a cylinder has one source of its gas torque and the numbers this source needs."""
    found = [key for key in gas.COMPUTED if getattr(cylinder, key) is not None]
    given = cylinder.gas_torque is not None or cylinder.gas_torque_mean is not None
    sources, errors = [*found, *["gas_torque"] * given], []
    if len(sources) > 1:
        several = "both" if len(sources) == 2 else "all"
        errors.append(f"{', '.join(sources[:-1])} and {sources[-1]} are {several} given. Keep one of them.")
    if cylinder.fires is True and not sources:
        errors.append("neither pressure nor gas_torque is given. Give one of them, or set fires = false.")
    needed, why = [], found[0] if found else "reciprocating_mass"
    if found:
        needed = ["bore", "stroke", "rod"]
    elif number_like(cylinder.reciprocating_mass) and cylinder.reciprocating_mass > 0:
        needed = ["stroke", "rod"]
    missing = [key for key in needed if getattr(cylinder, key) is None]
    errors += [f"the key {key!r} is missing; {why} needs it. Give it in m." for key in missing]
    if number_like(cylinder.rod) and number_like(cylinder.stroke) and cylinder.rod <= cylinder.stroke / 2:
        errors.append(
            f"rod is {cylinder.rod:g} m, must be longer than half the stroke ({cylinder.stroke / 2:g} m)."
            " Correct rod or stroke."
        )
    if cylinder.load and not {"traces", "combustion"} & set(found):
        errors.append("load is given without traces or combustion, which it acts on. Give scale instead.")
    errors += trace_errors(cylinder.traces) if isinstance(cylinder.traces, tuple | list) else []
    return errors + (combustion_errors(cylinder.combustion) if isinstance(cylinder.combustion, Combustion) else [])


def trace_errors(traces) -> list[str]:
    """Check that traces stand at every pair of their speeds and loads, once, and have the same gas cycle."""
    traces = [trace for trace in traces if isinstance(trace, Trace)]
    if not all(number_like(trace.rpm) and number_like(trace.load) for trace in traces):
        return []
    count = Counter((float(trace.rpm), float(trace.load)) for trace in traces)
    errors = [
        f"traces: {n} of them are for {rpm:g} rpm and load {load:g}. Keep one."
        for (rpm, load), n in count.items()
        if n > 1
    ]
    speeds, loads = ({key[k] for key in count} for k in (0, 1))
    lacking = sorted({(rpm, load) for rpm in speeds for load in loads} - set(count))
    if lacking:
        rpm, load = lacking[0]
        errors.append(
            f"traces: there is none for {rpm:g} rpm and load {load:g}, but for this speed and for this load: every"
            " speed needs all loads. Add it; for one load curve leave out load."
        )
    tables = [trace.pressure for trace in traces]
    if all(not row_errors("pressure", ("angle", "pressure"), rows) for rows in tables if not isinstance(rows, Unread)):
        strokes = {gas.is_four_stroke(rows) for rows in tables if not isinstance(rows, Unread)}
        if len(strokes) > 1:
            errors.append("traces: some span 720 deg, some 360 deg. Give one gas cycle, the same for all.")
    return errors


def combustion_errors(combustion) -> list[str]:
    """Check that either the heat or the mean pressure is given, and the strokes of a cycle."""
    both = [key for key in ("heat", "imep") if getattr(combustion, key) is not None]
    errors = []
    if len(both) == 2:
        errors.append("combustion: heat and imep are both given. Keep one of them.")
    if not both:
        errors.append("combustion: neither heat nor imep is given. Give one of them.")
    if number_like(combustion.stroke_cycle) and combustion.stroke_cycle not in (2, 4):
        errors.append(f"combustion: stroke_cycle is {combustion.stroke_cycle:g}, must be 2 or 4. Correct it.")
    return errors
