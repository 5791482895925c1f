"""Marches of one train at several speeds: its equations in modal form, lanes that run side by side, their records."""

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import jax
import numpy as np

from .._program import WHOLE, across, along
from ..harmonic import chain
from ..harmonic.excitation import listed_harmonic
from ..harmonic.residual import backlash_meshes
from ..model.ratios import speed_ratios
from ..response.record import Record, RecordedSignal, SteadyContact
from ..transient import lanes as marching, record as recording
from ..transient.modes import damped_modes, modes_of
from ..transient.reduced_model import reduced_model
from ..transient.statespace import partition
from .planning import mesh_mode_harmonics
from .returns import Returns
from .time_steps import COUNTS

PER_MODE_PERIOD = 5
"""Steps per period of the highest mesh mode, at least. On ``gear_train_30``, five speeds from 1422 to 2039 rpm,
extremes of the elastic tooth forces are then good to 0.7 % (5.3 steps), with 4 to 1.2 %, with 3.5 to 1.8 %, with 8 to
0.2 %."""

LEAST = 256
"""Steps of a cycle, at least."""

BATCHES = (64, 41), (16, 8), (1, 1)
"""Lanes of a batch, each a program, and how many speeds at least it is faster for than smaller batches; on each
device."""

RECORDED = 16
"""Lanes of a recorded batch at most, for the sake of memory."""

DENSE_MODES, REACH = 300, 6
"""Disks up to which a march takes all modes; beyond, frequencies up to 1.5 times the highest mesh mode (a quarter of so
many steps per period of it) are kept as far as meshes see them."""

CHUNK = 8
"""Cycles that are marched at a time."""


class Equations:
    """A train as a march takes it; loss factors damp each mode at its own frequency.

    Raises
    ------
    ValueError
        Naming massless disks that leave no equation to integrate.
    """

    def __init__(self, train):
        self.train, topology = train, train.topology
        self.system, self.meshes = chain.assemble(train), backlash_meshes(train)
        self.parts = partition(self.system, self.meshes, topology.disk_names, topology.link_names, lossy=True)
        self.own = np.flatnonzero(np.array(topology.mesh_backlash, dtype=bool))
        self.linear = np.flatnonzero(~np.array(topology.mesh_backlash, dtype=bool))
        self.shafts = len(topology.link_names) - len(topology.mesh_names)
        self.gears = sorted({disk for ends in topology.mesh_ends for disk in ends})
        self.small = topology.n_disks <= DENSE_MODES

    @cached_property
    def modes(self):
        """The damped :class:`~jaxhb.transient.modes.Modes`: all of them, or of a finely divided train the slow ones
        that its meshes see most."""
        frequency = self.train.topology.cycle_frequency(1000.0)
        if self.small:
            return damped_modes(self.system, self.meshes, frequency, self.parts)
        return self._reduced[0]

    @cached_property
    def missing(self):
        """Share of a mesh's own compliance that modes have which a march leaves out, the largest."""
        return 0.0 if self.small else self._reduced[1]

    @cached_property
    def _reduced(self):
        frequency = self.train.topology.cycle_frequency(1000.0)
        steps = next(n for n in COUNTS if n >= min(REACH * self.highest_hz * 2 * np.pi / frequency, COUNTS[-1]))
        active = np.ones(len(self.own))
        links = np.asarray(self.meshes.link)
        model = reduced_model(self.system, links, active, frequency, steps)
        stiff = np.abs(np.diag(np.asarray(model.static))) * np.asarray(self.meshes.law.stiffness)
        return modes_of(model.space, np.asarray(model.motion)), float(stiff.max(initial=0.0))

    @cached_property
    def highest_hz(self):
        """The highest natural frequency that strains tooth meshes noticeably, Hz."""
        return float(mesh_mode_harmonics(self.train, 2 * np.pi)[0])

    def steps(self, rpm):
        """Steps of a cycle at a speed."""
        topology = self.train.topology
        highest = 2 * np.pi * self.highest_hz / topology.cycle_frequency(rpm)
        least = max(PER_MODE_PERIOD * highest, 4 * listed_harmonic(topology), LEAST)
        return next(n for n in (*COUNTS, *(COUNTS[-1] * 2**k for k in range(1, 20))) if n >= least)

    def pose(self, rpm):
        """The :class:`~jaxhb.transient.lanes.Posed` of speeds."""
        return marching.pose(self.train, rpm, self.system, self.meshes, listed_harmonic(self.train.topology))

    @cached_property
    def gear_sums(self):
        """Radius and sense ``(P, R)`` with which the forces of linear meshes, then of the others, act on gears."""
        ends = [self.train.topology.mesh_ends[i] for i in (*self.linear, *self.own)]
        sense = np.array([[float(a == gear) - float(b == gear) for a, b in ends] for gear in self.gears])
        return sense * np.asarray(self.train.disks.radius)[self.gears][:, None]

    def outputs(self, posed, steps):
        """The :class:`~jaxhb.transient.record.Outputs` of posed speeds."""
        linear = self.shafts + self.linear
        return recording.outputs_of(self.modes, self.system, self.shafts, linear, self.gear_sums, posed, steps)


@dataclass
class March:
    """One speed on its way: state ``(2m,)``, cycles done, what was seen of them, the trace of the last, its record.

    again : cycles from which a period counts again, after one that harmonic balance did not find, or that repels.
    """

    place: int
    rpm: float
    state: np.ndarray
    returns: Returns
    cycles: int = 0
    again: int = 0
    done: bool = False
    trace: np.ndarray | None = None
    reduced: list = dataclasses.field(default_factory=list)
    teeth: list = dataclasses.field(default_factory=list)

    @property
    def recorded(self):
        """Cycles of the record."""
        return sum(len(part.max) for part in self.reduced)


class Batch:
    """Marches of some speeds with equal numbers of steps, on one device or side by side on several."""

    def __init__(self, equations, rpm, steps, devices=()):
        self.equations, self.steps, self.devices = equations, steps, devices
        self.posed = equations.pose(rpm)
        self.lanes = marching.lanes_of(equations.modes, equations.system, equations.meshes, self.posed, steps)
        gap = (1 - equations.meshes.law.epsilon) * equations.meshes.law.backlash
        begun = marching.state_of(equations.modes, marching.on_flank(self.posed), self.posed)
        self.marches = [
            March(i, float(speed), begun[:, i], Returns(np.concatenate([gap, omega * gap])))
            for i, (speed, omega) in enumerate(zip(rpm, self.posed.frequency, strict=True))
        ]

    @property
    def work(self):
        """Steps times modes of a cycle."""
        return self.steps * len(self.equations.modes.rates)

    def begin(self, place, motion):
        """Let a march begin at a motion (x, x') ``(2S,)``."""
        one = _of(self.posed, [place])
        self.marches[place].state = marching.state_of(self.equations.modes, motion[None], one)[:, 0]

    def motion(self, march):
        """(x, x') ``(2S,)`` where a march stands, at the beginning of a cycle."""
        return marching.motion_of(self.equations.modes, march.state[:, None], _of(self.posed, [march.place]))[0]

    def run(self, marches, record=False, cycles=CHUNK):
        """Some more cycles of some marches, recorded or not."""
        left, most, count = list(marches), RECORDED if record else BATCHES[0][0], max(len(self.devices), 1)
        while left:
            fits = (size for size, least in BATCHES if size <= most and len(left) >= least * count)
            size = next(fits, BATCHES[-1][0]) * count
            self._run(left[:size], size, record, cycles)
            left = left[size:]

    def _run(self, marches, size, record, cycles):
        places = [march.place for march in marches] + [marches[-1].place] * (size - len(marches))
        lanes, blank = _lanes(self.lanes, places), np.zeros(cycles)
        state = np.stack([self.marches[place].state for place in places], axis=1)
        if record:
            outputs = self.equations.outputs(_of(self.posed, places), self.steps)
            state, seen, trace, reduced, teeth = self._recording(lanes, outputs)(lanes, outputs, state, blank)
            reduced, teeth = jax.tree.map(np.asarray, (reduced, teeth))
        else:
            state, seen, trace = self._marching(lanes)(lanes, state, blank)
        state, seen, trace = (np.asarray(a) for a in (state, seen, trace))
        for i, march in enumerate(marches):
            march.state, march.trace = state[:, i], trace[..., i]
            march.returns.add(seen[..., i])
            march.cycles += cycles
            if record:
                march.reduced.append(_of_lane(reduced, i))
                march.teeth.append(_of_lane(teeth, i))

    def _marching(self, lanes):
        """The program that marches lanes."""
        if len(self.devices) < 2:
            return marching.march
        given = _specs(lanes, _PER_LANE, last=True), along(1), WHOLE
        return across(marching.march, self.devices, given, (along(1), along(3), along(2)))

    def _recording(self, lanes, outputs):
        """The program that marches and records lanes."""
        if len(self.devices) < 2:
            return recording.record
        given = _specs(lanes, _PER_LANE, last=True), _specs(outputs, ("linear", "mesh_linear")), along(1), WHOLE
        reduced = recording.Reduced(*[along(1)] * 4, power=along(0))
        return across(recording.record, self.devices, given, (along(1), along(3), along(2), reduced, along(1)))

    def traced(self, march, cycles):
        """(l, l') ``(2G, cycles x steps)`` of the next cycles, which the march goes through; of the last one if 1."""
        if cycles == 1:
            return march.trace[:-1].T
        parts, lanes, state = [], _lanes(self.lanes, [march.place]), march.state[:, None]
        for _ in range(cycles):
            state, seen, trace = marching.march(lanes, state, np.zeros(1))
            march.returns.add(np.asarray(seen)[..., 0])
            parts.append(np.asarray(trace)[:-1, :, 0].T)
        march.state, march.cycles = np.asarray(state)[:, 0], march.cycles + cycles
        return np.concatenate(parts, axis=1)


def _of(posed, places):
    return dataclasses.replace(
        posed, **{field.name: getattr(posed, field.name)[places] for field in dataclasses.fields(posed)}
    )


_PER_LANE = "full", "half", "weights", "first", "second", "third", "end", "linear"


def _lanes(lanes, places):
    """The Lanes at some places."""
    return dataclasses.replace(lanes, **{name: getattr(lanes, name)[..., places] for name in _PER_LANE})


def _specs(tree, per_lane, last=False):
    """How the arrays of a dataclass are cut: those of the names along their first or last axis."""
    named = {f.name: getattr(tree, f.name) for f in dataclasses.fields(tree)}
    cut = {name: along(np.ndim(named[name]) - 1 if last else 0) for name in per_lane}
    return dataclasses.replace(tree, **dict.fromkeys(named, WHOLE) | cut)


def _of_lane(numbers, i):
    """Host numbers of one lane; the lanes of what is not per cycle come first."""
    values = {f.name: getattr(numbers, f.name) for f in dataclasses.fields(numbers)}
    return dataclasses.replace(numbers, **{name: a[i] if name == "power" else a[:, i] for name, a in values.items()})


def record_of(equations, march):
    """The :class:`~jaxhb.response.steady.Record` of a march's recorded cycles."""
    topology, signals = equations.train.topology, _signals(march, equations.train.topology.revolutions_per_cycle)
    shafts, own, linear = equations.shafts, len(equations.own), len(equations.linear)

    def take(count):
        return tuple(next(signals) for _ in range(count))

    disks, rates = take(topology.n_disks), take(topology.n_disks)
    twists, twist_rates, torques = take(shafts), take(shafts), take(shafts)
    stiffness, radius = np.asarray(equations.system.stiffness), np.asarray(equations.system.radius)
    ends = radius[equations.system.tree.end_a]
    torques = tuple(
        dataclasses.replace(torque, elastic_part=twist.scaled(k * r**2))
        for torque, twist, k, r in zip(torques, twists, stiffness[:shafts], ends[:shafts], strict=True)
    )
    deflections, forces = [None] * (own + linear), [None] * (own + linear)
    straight = take(linear), take(linear)
    for index, deflection, force in zip(equations.linear, *straight, strict=True):
        deflections[index] = deflection
        elastic = deflection.scaled(stiffness[shafts + index])
        forces[index] = dataclasses.replace(force, elastic_part=elastic)
    for index, deflection, elastic, total in zip(equations.own, take(own), take(own), take(own), strict=True):
        deflections[index], forces[index] = deflection, dataclasses.replace(total, elastic_part=elastic)
    count = len(equations.gears)
    total, elastic = take(count), take(count)
    gears = (dataclasses.replace(t, elastic_part=e) for t, e in zip(total, elastic, strict=True))
    contacts = _contacts(equations, march, forces)
    gears = dict(zip(equations.gears, gears, strict=True))
    turning = 2 * np.pi / 60 * march.rpm * speed_ratios(equations.train)[np.array(topology.rotor, dtype=int)]
    speeds = tuple(rate.shifted(mean) for rate, mean in zip(rates, turning, strict=True))
    heat = _heat(equations, topology.cycle_frequency(march.rpm), ends[:shafts], twists, twist_rates)
    found = tuple(deflections), tuple(forces), gears, contacts
    return Record(march.recorded, disks, twists, torques, *found, speeds, heat)


def _heat(equations, frequency, ends, twists, rates):
    """Mean power in W that shafts and dampers turn into heat: viscous from the rates, loss factors from the orders."""
    viscous, loss = np.asarray(equations.system.viscous), np.asarray(equations.system.loss * equations.system.stiffness)
    found = []
    for k, (radius, twist, rate) in enumerate(zip(ends, twists, rates, strict=True)):
        lossy = frequency * np.sum(np.arange(1, len(twist.amplitudes) + 1) * twist.amplitudes**2) / 2
        found.append(float(radius**2 * (viscous[k] * rate.rms**2 + loss[k] * lossy)))
    return tuple(found)


def _signals(march, revolutions):
    """The quantities of a record, one after another."""
    numbers = {
        name: np.concatenate([getattr(part, name) for part in march.reduced])
        for name in ("max", "min", "mean", "square")
    }
    power = sum(part.power for part in march.reduced) / march.recorded
    for i in range(len(power)):
        yield RecordedSignal(
            highest=numbers["max"][:, i],
            lowest=numbers["min"][:, i],
            mean=float(numbers["mean"][:, i].mean()),
            rms=float(np.sqrt(numbers["square"][:, i].mean())),
            amplitudes=2 * np.sqrt(power[i, 1:]),
            revolutions_per_cycle=revolutions,
        )


def _contacts(equations, march, forces):
    """:class:`SteadyContact` of every mesh."""
    above, below, impacts, hardest = (
        np.concatenate([getattr(part, name) for part in march.teeth])
        for name in ("above", "below", "impacts", "hardest")
    )
    found = [SteadyContact(0.0, 0.0, 0.0, 0.0, int(np.sign(force.mean))) for force in forces]
    for g, index in enumerate(equations.own):
        shares = above[:, g].mean(), below[:, g].mean()
        drive = int(np.sign(forces[index].mean))
        reverse = shares[0] if drive < 0 else shares[1]
        found[index] = SteadyContact(
            float(1 - sum(shares)), float(reverse), float(impacts[:, g].mean()), float(hardest[:, g].max()), drive
        )
    return tuple(found)
