"""Pictures of 03_what_the_engine_does.ipynb: kinds of motion over the speed, peaks of
cycles, orders; branches and multipliers.

``sweeps`` is one SteadySweep, or two of one train, upwards and downwards: the second is
drawn hollow. ``mesh`` is by default the one with the largest tooth force; a train
without meshes is refused with a ValueError.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from jaxhb.report.answer import Answer, Case
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import (
    GREY,
    MOTIONS,
    WITH,
    WITHOUT,
    Axis,
    bars,
    crosses,
    figure,
    kind_of,
    line,
    marks,
    note,
    plain,
    speed_range,
    top_of,
)
from jaxhb.report.figures.speeds import over_speed
from jaxhb.report.quantities import forces
from jaxhb.report.text.tuned import parameter_unit

STEM = 4.0  # height of the largest order of a waterfall, in distances of its speeds
SEEN = 0.02  # share of the largest from which the tip of a stem is marked


def plot_motions(*sweeps, mesh=None, branches=(), orbits=None):
    """Largest tooth force of a mesh over the speed, marked with the kind of motion.

    Beside a subharmonic motion stands its period in cycles; a bar goes over 5 to 95 %
    of the cycles of an irregular one. ``branches`` over the speed are solid where
    stable, dashed where not; ``orbits``, a Response of many speeds
    (:func:`jaxhb.solve_speeds`), are the periodic motions, whether or not they occur.
    """
    mesh, cases = mesh or hardest_mesh(*sweeps), _cases(sweeps)
    quantity = forces(sweeps[0][0])
    more = [trace for branch in branches for trace in branch_traces(branch, mesh)]
    if orbits is not None:
        solved = np.asarray(orbits.converged)
        peaks = quantity.factor * np.asarray(orbits.force(mesh).peak)[solved]
        more.append(
            marks(
                np.asarray(orbits.rpm)[solved],
                peaks,
                "periodic solution",
                "cross-thin",
                size=10,
            )
        )
    notes = [
        note(f"{a.state.period}", a.rpm, value, yshift=-12 if number else 12)
        for number, case in enumerate(cases)
        for a, value in zip(case.answers, quantity.of(case.answers, mesh), strict=True)
        if a.state.kind == "subharmonic"
    ]
    caption = f"{plain(mesh)}: largest tooth force and the kind of motion"
    caption += "; numbers: periods in cycles" * bool(notes)
    made = over_speed(quantity, [mesh], cases, caption, more=more)
    made = replace(made, height=300, notes=notes)
    return drawn(made, title=sweeps[0][0].topology.title)


def plot_cycle_peaks(*sweeps, mesh=None):
    """Bifurcation diagram: peak of the tooth force in every cycle, over the speed.

    One point a speed where every cycle is as the one before, k points where the motion
    repeats after k cycles, all recorded cycles where it is irregular.
    """
    mesh, traces = mesh or hardest_mesh(*sweeps), []
    for number, case in enumerate(_cases(sweeps)):
        peaks = [
            _peaks(answer, mesh) / 1e3 if answer.answered else np.zeros(1)
            for answer in case.answers
        ]
        points = [
            (np.full(len(y), answer.rpm), y)
            for answer, y in zip(case.answers, peaks, strict=True)
        ]
        traces += kind_marks(
            case.answers, points, case.title, hollow=number > 0, size=8 if number else 5
        )
    made = figure(
        f"{plain(mesh)}: peak of each cycle",
        Axis("speed, rpm", speed_range(sweeps[0].rpm)),
        [Axis("tooth force, kN", top_of(traces))],
        traces,
        height=300,
    )
    return drawn(made, title=sweeps[0][0].topology.title)


def plot_waterfall(sweep, mesh=None, *, highest=None):
    """Amplitudes of the orders of a tooth force, speed above speed.

    Orders of an irregular motion are quadratic means over the recorded cycles.
    ``highest`` is the order up to which is drawn, by default the last with a tenth of
    the largest amplitude at some speed.
    """
    mesh, (case,) = mesh or hardest_mesh(sweep), _cases([sweep])
    signals = {
        answer.rpm: answer.force(mesh) for answer in case.answers if answer.answered
    }
    largest = max(
        (float(np.max(signal.amplitudes)) for signal in signals.values()), default=1.0
    )
    if highest is None:
        seen = [
            signal.orders[np.asarray(signal.amplitudes) > largest / 10]
            for signal in signals.values()
        ]
        highest = float(max((orders.max(initial=1.0) for orders in seen), default=1.0))
    distance = np.min(
        np.diff(np.sort(sweep.rpm)), initial=np.ptp(sweep.rpm) or sweep.rpm.max()
    )
    scale = STEM * distance / largest
    stems = {
        rpm: np.column_stack([signal.orders, scale * signal.amplitudes])
        for rpm, signal in signals.items()
    }
    stems = {rpm: stem[stem[:, 0] <= highest] for rpm, stem in stems.items()}
    tips = {
        rpm: stem[stem[:, 1] > SEEN * scale * largest] + (0.0, rpm)
        for rpm, stem in stems.items()
    }
    speeds = np.repeat(list(stems), list(map(len, stems.values())))
    orders, heights = np.concatenate([np.zeros((0, 2)), *stems.values()]).T
    base = np.repeat(sweep.rpm, 3), np.tile([0.0, highest, np.nan], len(sweep.rpm))
    traces = [
        line(*base[::-1], "", 3, look={"dash": "solid", "width": 0.5}, showlegend=False)
    ]
    traces.append(
        bars(
            orders,
            speeds,
            speeds + heights,
            "",
            style=1,
            look={"dash": "solid"},
            showlegend=False,
        )
    )
    places = [
        tips.get(answer.rpm, np.array([[highest / 100, answer.rpm]])).T
        for answer in case.answers
    ]
    traces += kind_marks(case.answers, places, size=4)
    top = sweep.rpm.max() + scale * largest
    traces.append(
        bars(
            [highest],
            [sweep.rpm.max()],
            [top],
            "",
            look={"color": "black"},
            showlegend=False,
        )
    )
    scaled = note(
        f"{largest / 1e3:.3g} kN", highest, top, size=11, xanchor="right", xshift=-6
    )
    caption, title = (
        f"{plain(mesh)}: orders of the tooth force",
        "order, per revolution of the reference rotor",
    )
    made = figure(
        caption,
        Axis(title, (0.0, 1.02 * highest)),
        [Axis("speed, rpm")],
        traces,
        height=420,
        notes=[scaled],
    )
    return drawn(made, title=sweep[0].topology.title)


def kind_marks(answers, points, title="", *, hollow=False, **more):
    """Points of answers, each with arrays x and y, in traces by their kinds of
    motion.
    """
    found, kinds = [], [kind_of(answer) for answer in answers]
    for kind, (symbol, said) in MOTIONS.items():
        own = [
            point for point, other in zip(points, kinds, strict=True) if other == kind
        ]
        if own:
            places = [np.concatenate(column) for column in zip(*own, strict=True)]
            hover = {
                "hovertemplate": f"%{{x}} {answers[0].axis.unit}: {said}<extra></extra>"
            }
            name, symbol = (
                f"{said}, {title}".removesuffix(", "),
                symbol + "-open" * (hollow and kind is not None),
            )
            found.append(marks(*places, name, symbol, **hover, **more))
    return found


def hardest_mesh(*sweeps):
    """Name of the mesh with the largest tooth force of all known motions."""
    topology = sweeps[0][0].topology
    if not topology.mesh_names:
        raise ValueError(
            f"{topology.name or 'scene'} has no mesh: these pictures show tooth forces."
        )
    known = [state for sweep in sweeps for state in sweep if state.known]
    return max(
        topology.mesh_names,
        key=lambda mesh: max((_peaks(s, mesh).max() for s in known), default=0.0),
    )


def _cases(sweeps):
    """Sweeps as cases of answers: of their train only the topology is asked, which a
    state has too.
    """
    titles = [f"{sweep.direction}wards" * (len(sweeps) > 1) for sweep in sweeps]
    return [
        Case(title, [Answer(s, s, None) for s in sweep])
        for title, sweep in zip(titles, sweeps, strict=True)
    ]


def _peaks(motion, mesh):
    """Peak of the tooth force in each cycle, N."""
    signal = motion.force(mesh)
    return np.maximum(signal.highest, -signal.lowest)


POINTS = {
    "fold": "diamond",
    "branch point": "star",
    "period doubling": "triangle-up",
    "Neimark-Sacker": "cross",
}
LOST = "fold", "period doubling", "Neimark-Sacker"
LOWEST = 0.05  # modulus at the bottom of a picture, if none is smaller
STABLE, UNSTABLE = {"color": WITHOUT, "dash": "solid"}, {"color": WITH, "dash": "dash"}


def plot_branch(branch, mesh=None):
    """A branch of periodic motions over its parameter: largest tooth force, and below
    it the critical multiplier.

    Lines are solid where the motion is stable, dashed where not; folds, period
    doublings and the like are marked. ``mesh`` is by default the one with the largest
    force.
    """
    topology, moduli = branch.train.topology, np.abs(branch.multiplier)
    mesh = mesh or topology.mesh_names[int(np.argmax(branch.largest_force.max(axis=0)))]
    traces = branch_traces(branch, mesh)
    force_axis = Axis("largest tooth force, kN", top_of(traces))
    traces.append(
        line(
            branch.value,
            moduli,
            "critical multiplier",
            3,
            panel=1,
            look={"dash": "solid", "width": 0.9},
        )
    )
    points, modulus_axis = _moduli(branch.value, moduli, branch.stable, panel=1)
    unit = (
        "rpm"
        if branch.parameter == "rpm"
        else parameter_unit(branch.train, branch.parameter)
    )
    title = f"{branch.parameter.replace('rpm', 'speed')}, {unit}".removesuffix(", ")
    made = figure(
        f"{plain(mesh)}: a branch and its folds",
        Axis(title),
        [force_axis, modulus_axis],
        traces + points,
        height=210,
    )
    return drawn(made, title=topology.title)


def plot_multipliers(rpm, stabilities):
    """Moduli of Floquet multipliers over the speed: from 1 on, the train does not run
    in the periodic motion.

    A small grey dot for each multiplier, a large mark for that of largest modulus with
    how stability is lost. Of the n ``stabilities`` one is None where there is no motion
    to ask about.
    """
    asked = [
        (speed, found)
        for speed, found in zip(rpm, stabilities, strict=True)
        if found is not None
    ]
    every = [
        (speed, abs(value))
        for speed, found in asked
        for value in found.multipliers[~found.rotation]
    ]
    traces = [
        marks(*np.reshape(every, (-1, 2)).T, "multiplier", "circle", size=3, color=GREY)
    ]
    speeds, largest = (
        np.array([(speed, found.largest) for speed, found in asked]).reshape(-1, 2).T
    )
    points, modulus_axis = _moduli(
        speeds, largest, np.array([found.stable for _, found in asked], dtype=bool)
    )
    traces += points
    for manner in LOST:
        at = [
            (speed, found.largest) for speed, found in asked if found.loses_by == manner
        ]
        if at:
            traces.append(
                marks(
                    *np.transpose(at), f"unstable: {manner}", POINTS[manner], color=WITH
                )
            )
    traces += crosses(
        [speed for speed, found in zip(rpm, stabilities, strict=True) if found is None],
        LOWEST,
    )
    caption = "Multipliers of the periodic motions: growth of a disturbance in a cycle"
    axis = Axis("speed, rpm", speed_range(rpm))
    made = figure(caption, axis, [modulus_axis], traces, height=300)
    return drawn(made)


def branch_traces(branch, mesh):
    """Largest forces of a branch in kN as lines, solid where stable, with its special
    points on them.
    """
    peaks = branch.largest_force[:, branch.train.topology.mesh_names.index(mesh)] / 1e3
    at, special = [point.after for point in branch.special], branch.special
    shares = [
        _share(point, *branch.value[point.after : point.after + 2]) for point in special
    ]
    marked = np.array(
        [
            peaks[k] + share * (peaks[k + 1] - peaks[k])
            for k, share in zip(at, shares, strict=True)
        ]
    )
    values = np.insert(
        branch.value, np.add(at, 1).astype(int), [point.value for point in special]
    )
    forces = np.insert(peaks, np.add(at, 1).astype(int), marked)
    # Stability changes at special points alone; between two of one step nothing is
    # known to be stable.
    sound = np.insert(np.asarray(branch.stable, float), np.add(at, 1).astype(int), 0.5)
    stable = sound[:-1] + sound[1:] > 1.0
    edges, traces, met = (
        [0, *(np.flatnonzero(np.diff(stable)) + 1), len(stable)],
        [],
        set(),
    )
    for begin, end in pairwise(edges):
        said, look = (
            ("stable branch", STABLE)
            if stable[begin]
            else ("unstable branch", UNSTABLE)
        )
        own = values[begin : end + 1], forces[begin : end + 1]
        traces.append(line(*own, said, look=look, showlegend=said not in met))
        met.add(said)
    for kind in dict.fromkeys(point.kind for point in special):
        own = [point.kind == kind for point in special]
        x = [point.value for point in special if point.kind == kind]
        traces.append(marks(x, marked[own], kind, f"{POINTS[kind]}-open"))
    return traces


def _share(point, before, after):
    """Of the way between two points of a branch where a special one lies; at a fold
    values go with its square.
    """
    power = 0.5 if point.kind == "fold" else 1.0
    one, other = abs(point.value - before) ** power, abs(point.value - after) ** power
    return one / (one + other) if one + other else 0.5


def _moduli(x, moduli, stable, panel=0):
    """Moduli of critical multipliers and their limit 1, and the logarithmic axis that
    they need.
    """
    across = [min(x, default=0.0), max(x, default=0.0)]
    limit = line(
        across,
        [1.0, 1.0],
        "limit, unstable above",
        panel=panel,
        look={"color": "black"},
    )
    points = {
        "stable": (stable, "circle", WITHOUT),
        "unstable": (~stable, "circle-open", WITH),
    }
    points = [
        marks(x[chosen], moduli[chosen], said, symbol, panel=panel, size=5, color=color)
        for said, (chosen, symbol, color) in points.items()
        if chosen.any()
    ]
    ends = (
        min(LOWEST, np.min(moduli, initial=1.0) / 2),
        max(3.0, 2 * np.max(moduli, initial=0.0)),
    )
    return [limit, *points], Axis("modulus of the multiplier", ends, log=True)
