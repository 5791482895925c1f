"""Pictures of what a train does: kinds of motion over the speed, peaks of cycles, orders.

Forces are transmitted tooth forces; a peak is the largest absolute value. ``sweeps`` is one SteadySweep, or two of one
train, upwards and downwards: the second is drawn hollow. ``mesh`` is by default the one with the largest force; a train
without meshes is refused with a ValueError.
"""

import dataclasses

import numpy as np

from jaxhb.report.answer import Answer, Case
from jaxhb.report.figures.branch import branch_traces
from jaxhb.report.figures.draw import drawn
from jaxhb.report.figures.figure import bars, figure, kind_marks, line, marks, plain, speed_range, top_of
from jaxhb.report.figures.sweep import over_speed
from jaxhb.report.quantities import forces

STEM = 4.0
"""Height of the largest order of a waterfall, in distances of its speeds."""

SEEN = 0.02
"""Share of the largest from which the tip of a stem is marked."""


def plot_motions(*sweeps, mesh=None, branches=(), orbits=None):
    """Largest tooth force of a mesh over the speed, marked with the kind of motion.

    Beside the marker of a subharmonic motion stands its period in cycles; a bar goes over the largest forces of the
    cycles, from 5 to 95 %, where the motion is irregular; a cross is at the bottom where it is unknown.
    ``branches`` over the speed are lines that are solid where stable and dashed where not; ``orbits``, a Response of
    many speeds (:func:`jaxhb.solve_speeds`), are the periodic motions, whether or not they occur.
    """
    mesh, cases = mesh or hardest_mesh(*sweeps), _cases(sweeps)
    quantity = dataclasses.replace(forces(sweeps[0][0]), signal=None)
    more = [trace for branch in branches for trace in branch_traces(branch, mesh)]
    if orbits is not None:
        solved = np.asarray(orbits.converged)
        peaks = quantity.factor * np.asarray(orbits.force(mesh).peak)[solved]
        more.append(marks(np.asarray(orbits.rpm)[solved], peaks, "periodic solution", "cross-thin", size=10))
    style = {"showarrow": False, "font": {"size": 10}}
    notes = [
        style | {"text": f"{a.state.period}", "x": a.rpm, "y": value, "yshift": -12 if number else 12}
        for number, case in enumerate(cases)
        for a, value in zip(case.answers, quantity.of(case.answers, mesh), strict=True)
        if a.state.kind == "subharmonic"
    ]
    caption = f"{plain(mesh)}: largest tooth force and the kind of motion"
    caption += "; numbers: periods in cycles" * bool(notes)
    made = over_speed(quantity, [mesh], cases, caption, more=more, height=300, annotations=notes)
    return drawn(made, title=sweeps[0][0].topology.name or "scene")


def plot_cycle_peaks(*sweeps, mesh=None):
    """Bifurcation diagram: peak of the tooth force in every cycle, over the speed.

    One point a speed where every cycle is as the one before, k points where the motion repeats after k cycles, all
    recorded cycles where it is irregular.
    """
    mesh, traces = mesh or hardest_mesh(*sweeps), []
    for number, case in enumerate(_cases(sweeps)):
        peaks = [_peaks(answer, mesh) / 1e3 if answer.answered else np.zeros(1) for answer in case.answers]
        points = [(np.full(len(y), answer.rpm), y) for answer, y in zip(case.answers, peaks, strict=True)]
        traces += kind_marks(case.answers, points, case.title, hollow=number > 0, size=8 if number else 5)
    panels, axis = [("tooth force, kN", top_of(traces))], speed_range(sweeps[0].rpm)
    made = figure(f"{plain(mesh)}: peak of each cycle", "speed, rpm", panels, traces, x_range=axis, height=300)
    return drawn(made, title=sweeps[0][0].topology.name or "scene")


def plot_waterfall(sweep, mesh=None, *, highest=None):
    """Amplitudes of the orders of a tooth force, speed above speed.

    A stem for each order, on a line for each speed, with the symbol of the kind of motion. A subharmonic motion of k
    cycles has k times as many orders; those of an irregular one are quadratic means over the recorded cycles.
    ``highest`` is the order up to which is drawn, by default the last with a tenth of the largest amplitude at some
    speed.
    """
    mesh, (case,) = mesh or hardest_mesh(sweep), _cases([sweep])
    signals = {answer.rpm: answer.force(mesh) for answer in case.answers if answer.answered}
    largest = max((float(np.max(signal.amplitudes)) for signal in signals.values()), default=1.0)
    if highest is None:
        seen = [signal.orders[np.asarray(signal.amplitudes) > largest / 10] for signal in signals.values()]
        highest = float(max((orders.max(initial=1.0) for orders in seen), default=1.0))
    distance = np.min(np.diff(np.sort(sweep.rpm)), initial=np.ptp(sweep.rpm) or sweep.rpm.max())
    scale = STEM * distance / largest
    stems = {rpm: np.column_stack([signal.orders, scale * signal.amplitudes]) for rpm, signal in signals.items()}
    stems = {rpm: stem[stem[:, 0] <= highest] for rpm, stem in stems.items()}
    tips = {rpm: stem[stem[:, 1] > SEEN * scale * largest] + (0.0, rpm) for rpm, stem in stems.items()}
    speeds = np.repeat(list(stems), [len(stem) for stem in stems.values()])
    orders, heights = np.concatenate([np.zeros((0, 2)), *stems.values()]).T
    base = np.repeat(sweep.rpm, 3), np.tile([0.0, highest, np.nan], len(sweep.rpm))
    traces = [line(*base[::-1], "", 3, look={"dash": "solid", "width": 0.5}, showlegend=False)]
    traces.append(bars(orders, speeds, speeds + heights, "", style=1, look={"dash": "solid"}, showlegend=False))
    places = [tips.get(answer.rpm, np.array([[highest / 100, answer.rpm]])).T for answer in case.answers]
    traces += kind_marks(case.answers, places, size=4)
    top = sweep.rpm.max() + scale * largest
    traces.append(bars([highest], [sweep.rpm.max()], [top], "", look={"color": "black"}, showlegend=False))
    note = {"x": highest, "y": top, "xanchor": "right", "xshift": -6, "showarrow": False, "font": {"size": 11}}
    panels, note = [("speed, rpm", None)], note | {"text": f"{largest / 1e3:.3g} kN"}
    title, more = "order, per revolution of the reference rotor", {"x_range": (0.0, 1.02 * highest), "height": 420}
    made = figure(f"{plain(mesh)}: orders of the tooth force", title, panels, traces, annotations=[note], **more)
    return drawn(made, title=sweep[0].topology.name or "scene")


def hardest_mesh(*sweeps):
    """Name of the mesh with the largest tooth force of all known motions."""
    topology = sweeps[0][0].topology
    if not topology.mesh_names:
        raise ValueError(f"{topology.name or 'scene'} has no mesh: these pictures show tooth forces.")
    known = [state for sweep in sweeps for state in sweep if state.known]
    return max(topology.mesh_names, key=lambda mesh: max((_peaks(s, mesh).max() for s in known), default=0.0))


def _cases(sweeps):
    """Sweeps as cases of answers: of their train only the topology is asked, which a state has too."""
    titles = [f"{sweep.direction}wards" * (len(sweeps) > 1) for sweep in sweeps]
    return [Case(title, [Answer(s, s, None) for s in sweep]) for title, sweep in zip(titles, sweeps, strict=True)]


def _peaks(motion, mesh):
    """Peak of the tooth force in each cycle, N."""
    signal = motion.force(mesh)
    return np.maximum(signal.highest, -signal.lowest)
