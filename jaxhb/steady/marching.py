"""Marches of one train at several speeds: its equations in modal form, lanes that run side by side."""

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import jax
import numpy as np

from jaxhb._program import WHOLE, across, along
from jaxhb.balance.request import TIME_STEPS
from jaxhb.equations.reduced_model import reduced_model
from jaxhb.equations.residual import backlash_meshes
from jaxhb.equations.state_space import march_modes, modes_of, partition
from jaxhb.excitation.torques import listed_harmonic
from jaxhb.integration import batch, record as recording
from jaxhb.integration.batch import LANES
from jaxhb.linear.mesh_modes import mesh_mode_harmonics
from jaxhb.steady.closure import Returns
from jaxhb.train import chain


@dataclass(frozen=True)
class MarchOptions:
    """How speeds are marched.

    Parameters
    ----------
    steps_per_mode_period : steps per period of the highest mesh mode, at least. On ``gear_train_30``, five speeds from
        1422 to 2039 rpm, extremes of the elastic tooth forces are then good to 0.7 % (5.3 steps), with 4 to 1.2 %, with
        3.5 to 1.8 %, with 8 to 0.2 %
    steps : of a cycle, at least
    batches : lanes of a batch, each a program, and how many speeds at least it is faster for than smaller batches; on
        each device
    recorded_lanes : of a recorded batch at most, for the sake of memory
    modal_disks : disks up to which all modes are marched
    kept_modes : of larger trains those modes are kept, as far as meshes see them, which so many steps per period of the
        highest mesh mode resolve, with four steps per period of their own: up to 1.5 times its frequency
    noticed : share of a mesh's own compliance from which teeth notice a mode
    """

    steps_per_mode_period: float = 5
    steps: int = 256
    batches: tuple[tuple[int, int], ...] = ((64, 41), (16, 8), (1, 1))
    recorded_lanes: int = 16
    modal_disks: int = 300
    kept_modes: float = 6
    noticed: float = 1e-4


MARCH = MarchOptions()


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
        self.own = topology.backlash_index
        self.linear = np.flatnonzero(~np.array(topology.mesh_backlash, dtype=bool))
        self.shafts = len(topology.link_names) - len(topology.mesh_names)
        self.gears = sorted({disk for ends in topology.mesh_ends for disk in ends})
        self.small = topology.n_disks <= MARCH.modal_disks

    @cached_property
    def modes(self):
        """The damped :class:`~jaxhb.equations.state_space.Modes`: all, or of a finely divided train the slow ones that
        its meshes see most."""
        frequency = self.train.topology.cycle_frequency(1000.0)
        if self.small:
            return march_modes(self.system, self.meshes, frequency, self.parts)
        return self._reduced[0]

    @cached_property
    def missing(self):
        """Share of a mesh's own compliance that modes have which a march leaves out, the largest."""
        return 0.0 if self.small else self._reduced[1]

    @cached_property
    def _reduced(self):
        frequency = self.train.topology.cycle_frequency(1000.0)
        wanted = MARCH.kept_modes * self.highest_hz * 2 * np.pi / frequency
        steps = next(n for n in TIME_STEPS.counts if n >= min(wanted, TIME_STEPS.counts[-1]))
        active = np.ones(len(self.own))
        links = np.asarray(self.meshes.link)
        model = reduced_model(self.system, links, active, frequency, steps)
        # What is left out is the residual flexibility of a mesh times its stiffness: a share of its own compliance.
        stiff = np.abs(np.diag(np.asarray(model.residual_flexibility))) * np.asarray(self.meshes.law.stiffness)
        return modes_of(model.space, np.asarray(model.motion)), float(stiff.max(initial=0.0))

    @cached_property
    def decay(self):
        """Seconds in which the slowest mode that teeth notice falls by the factor e.

        Impacts keep exciting such a mode, and it needs many times as long until its motion is the one that they keep
        up; rotation of the train and rings without spring, that decay over hours, bend no tooth.
        """
        modes, meshes = self.modes, len(self.own)
        static = np.abs(
            modes.observation[:meshes].T[:, :, None] * modes.forcing[:, None, :] / modes.rates[:, None, None]
        )
        share = (static * np.asarray(self.meshes.law.stiffness)).max(axis=(1, 2))
        slowest = np.max(modes.rates.real[share > MARCH.noticed], initial=-np.inf)
        return -1 / slowest if slowest < 0 else np.inf

    def decay_cycles(self, rpm):
        """The same in cycles of a speed."""
        return self.decay * self.train.topology.cycle_frequency(rpm) / (2 * np.pi)

    @cached_property
    def highest_hz(self):
        """The highest natural frequency that strains tooth meshes noticeably, Hz."""
        return float(mesh_mode_harmonics(self.train, 2 * np.pi)[0])

    def steps(self, rpm):
        """Steps of a cycle at a speed."""
        topology = self.train.topology
        highest = 2 * np.pi * self.highest_hz / topology.cycle_frequency(rpm)
        least = max(MARCH.steps_per_mode_period * highest, 4 * listed_harmonic(topology), MARCH.steps)
        more = (TIME_STEPS.counts[-1] * 2**k for k in range(1, 20))
        return next(n for n in (*TIME_STEPS.counts, *more) if n >= least)

    def linear_motion(self, rpm):
        """The :class:`~jaxhb.integration.batch.LinearMotion` of speeds."""
        return batch.linear_motions(self.train, rpm, self.system, self.meshes, listed_harmonic(self.train.topology))

    @cached_property
    def gear_sums(self):
        """Radius and sense ``(P, R)`` with which the forces of linear meshes, then of the others, act on gears."""
        ends = [self.train.topology.mesh_ends[i] for i in (*self.linear, *self.own)]
        sense = np.array([[float(a == gear) - float(b == gear) for a, b in ends] for gear in self.gears])
        return sense * np.asarray(self.train.disks.radius)[self.gears][:, None]

    def outputs(self, linear_motion, steps):
        """The :class:`~jaxhb.integration.record.Outputs` of speeds."""
        linear = self.shafts + self.linear
        return recording.outputs_of(self.modes, self.system, self.shafts, linear, self.gear_sums, linear_motion, steps)


@dataclass
class SpeedMarch:
    """One speed on its way: state ``(2m,)``, cycles done, what was seen of them, the trace of the last, its record.

    not_before : cycles from which a period counts again, after one that harmonic balance did not find, or that repels.
    """

    lane: int
    rpm: float
    state: np.ndarray
    returns: Returns
    cycles: int = 0
    not_before: int = 0
    done: bool = False
    trace: np.ndarray | None = None
    statistics: list = dataclasses.field(default_factory=list)
    contacts: list = dataclasses.field(default_factory=list)

    @property
    def recorded(self):
        """Cycles of the record."""
        return sum(len(part.max) for part in self.statistics)


class Batch:
    """Marches of some speeds with equal numbers of steps, on one device or side by side on several."""

    def __init__(self, equations, rpm, steps, devices=()):
        self.equations, self.steps, self.devices = equations, steps, devices
        self.linear_motion = equations.linear_motion(rpm)
        self.lanes = batch.lanes_of(equations.modes, equations.system, equations.meshes, self.linear_motion, steps)
        gap = (1 - equations.meshes.law.epsilon) * equations.meshes.law.backlash
        begun = batch.state_of(equations.modes, batch.motions_on_flank(self.linear_motion), self.linear_motion)
        self.marches = [
            SpeedMarch(i, float(speed), begun[:, i], Returns(np.concatenate([gap, omega * gap])))
            for i, (speed, omega) in enumerate(zip(rpm, self.linear_motion.frequency, strict=True))
        ]

    @property
    def work(self):
        """Steps times modes of a cycle."""
        return self.steps * len(self.equations.modes.rates)

    @property
    def decay(self):
        """Of the slowest mode that teeth notice, in cycles of the highest speed."""
        return self.equations.decay_cycles(max(march.rpm for march in self.marches))

    def begin(self, index, motion):
        """Let a march begin at a motion (x, x') ``(2S,)``."""
        one = _of(self.linear_motion, [index])
        self.marches[index].state = batch.state_of(self.equations.modes, motion[None], one)[:, 0]

    def motion(self, march):
        """(x, x') ``(2S,)`` where a march stands, at the beginning of a cycle."""
        return batch.motion_of(self.equations.modes, march.state[:, None], _of(self.linear_motion, [march.lane]))[0]

    def run(self, marches, record=False, cycles=LANES.cycles):
        """Some more cycles of some marches, recorded or not."""
        batches, count = MARCH.batches, max(len(self.devices), 1)
        left, most = list(marches), MARCH.recorded_lanes if record else batches[0][0]
        while left:
            fits = (size for size, least in batches if size <= most and len(left) >= least * count)
            size = next(fits, batches[-1][0]) * count
            self._run(left[:size], size, record, cycles)
            left = left[size:]

    def _run(self, marches, size, record, cycles):
        indices = [march.lane for march in marches] + [marches[-1].lane] * (size - len(marches))
        cut, count = _lanes(self.lanes, indices), np.array(cycles)
        state = np.stack([self.marches[index].state for index in indices], axis=1)
        if record:
            outputs = self.equations.outputs(_of(self.linear_motion, indices), self.steps)
            state, samples, trace, statistics, contacts = self._recording(cut, outputs)(cut, outputs, state, count)
            statistics, contacts = jax.tree.map(np.asarray, (statistics, contacts))
        else:
            state, samples, trace = self._marching(cut)(cut, state, count)
        state, samples, trace = (np.asarray(a) for a in (state, samples, trace))
        for i, march in enumerate(marches):
            march.state, march.trace = state[:, i], trace[..., i]
            march.returns.add(samples[:cycles, ..., i])
            march.cycles += cycles
            if record:
                march.statistics.append(_of_lane(statistics, i, cycles))
                march.contacts.append(_of_lane(contacts, i, cycles))

    def _marching(self, cut):
        """The program that marches some of the lanes."""
        if len(self.devices) < 2:
            return batch.march
        given = _specs(cut, _PER_LANE, last=True), along(1), WHOLE
        return across(batch.march, self.devices, given, (along(1), along(3), along(2)))

    def _recording(self, cut, outputs):
        """The program that marches and records some of the lanes."""
        if len(self.devices) < 2:
            return recording.record
        given = _specs(cut, _PER_LANE, last=True), _specs(outputs, ("linear", "mesh_linear")), along(1), WHOLE
        statistics = recording.CycleStatistics(*[along(1)] * 4, power=along(0))
        return across(recording.record, self.devices, given, (along(1), along(3), along(2), statistics, along(1)))

    def traced(self, march, cycles):
        """(l, l') ``(2G, cycles x steps)`` of the next cycles, which the march goes through; of the last one if 1."""
        if cycles == 1:
            return march.trace[:-1].T
        parts, cut, state = [], _lanes(self.lanes, [march.lane]), march.state[:, None]
        for _ in range(cycles):
            state, samples, trace = batch.march(cut, state, np.array(1))
            march.returns.add(np.asarray(samples)[:1, ..., 0])
            parts.append(np.asarray(trace)[:-1, :, 0].T)
        march.state, march.cycles = np.asarray(state)[:, 0], march.cycles + cycles
        return np.concatenate(parts, axis=1)


def _of(linear_motion, indices):
    return dataclasses.replace(
        linear_motion,
        **{field.name: getattr(linear_motion, field.name)[indices] for field in dataclasses.fields(linear_motion)},
    )


_PER_LANE = "full", "half", "weights", "first", "second", "third", "end", "linear"


def _lanes(every, indices):
    """Some of the Lanes."""
    return dataclasses.replace(every, **{name: getattr(every, name)[..., indices] for name in _PER_LANE})


def _specs(tree, per_lane, last=False):
    """How the arrays of a dataclass are cut: those of the names along their first or last axis."""
    named = {f.name: getattr(tree, f.name) for f in dataclasses.fields(tree)}
    cut = {name: along(np.ndim(named[name]) - 1 if last else 0) for name in per_lane}
    return dataclasses.replace(tree, **dict.fromkeys(named, WHOLE) | cut)


def _of_lane(numbers, i, cycles):
    """Host numbers of some cycles of one lane; the lanes of what is not per cycle come first."""
    values = {f.name: getattr(numbers, f.name) for f in dataclasses.fields(numbers)}
    own = {name: a[i] if name == "power" else a[:cycles, i] for name, a in values.items()}
    return dataclasses.replace(numbers, **own)
