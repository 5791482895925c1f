"""Marches of one train at several speeds: its equations in modal form, batches that run
side by side, and records.
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any, TypeVar

import jax
import numpy as np

from jaxhb._program import WHOLE, across, along
from jaxhb.balance.plan import TIME_STEPS
from jaxhb.equations.reduced_model import reduced_model
from jaxhb.equations.state_space import ComplexModes, march_modes, modes_of, partition
from jaxhb.integration import batch, cycles
from jaxhb.integration.batch import LinearMotion
from jaxhb.integration.cycles import CycleNumbers, Marched, Outputs
from jaxhb.linear.mesh_modes import mesh_mode_harmonics
from jaxhb.results.record import Record, RecordedSignal, SteadyContact
from jaxhb.steady.closure import CLOSE, NEAR, Closure, Cycles
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import listed_harmonic
from jaxhb.train.kinematics import speed_ratios
from jaxhb.train.mesh_parameters import law_meshes

# Steps per period of the highest mesh mode, and of a cycle, at least. On
# ``gear_train_30``, five speeds from 1422 to 2039 rpm, extremes of the elastic tooth
# forces are then good to 0.7 % (5.3 steps), with 4 to 1.2 %, with 3.5 to 1.8 %, with 8
# to 0.2 %.
STEPS_PER_MODE_PERIOD = 5
STEPS = 256
# Steps of a cycle at most, with which a cycle of a small train takes a second or two;
# and memory that they may take, B.
MOST_STEPS = 2**18
MEMORY = 3 * 2**28
# Speeds of a batch, each a program, and the number of speeds from which it is faster
# than smaller batches; on each device.
BATCHES = (64, 41), (16, 8), (1, 1)
RECORDED_SPEEDS = 16  # of a recorded batch at most, for the sake of memory
MODAL_DISKS = 300  # disks up to which all modes are marched
# Of larger trains those modes are kept, as far as meshes see them, which so many steps
# per period of the highest mesh mode resolve, with four steps per period of their own:
# up to 1.5 times its frequency.
KEPT_MODES = 6
OBSERVABLE = 1e-4  # share of a mesh's own compliance from which teeth notice a mode


Tree = TypeVar("Tree")


class Equations:
    """Equations of a train in the form that a march integrates; loss factors damp each
    mode at its own frequency. A ValueError names massless disks that leave no equation
    to integrate.
    """

    def __init__(self, train: DriveTrain):
        self.train = train
        topology = train.topology
        self.system = chain.assemble(train)
        self.meshes = law_meshes(train)
        self.parts = partition(
            self.system,
            self.meshes,
            topology.disk_names,
            topology.link_names,
            lossy=True,
        )
        self.own = topology.law_index
        self.linear = np.flatnonzero(~topology.has_law)
        # Those of ``own`` that are meshes; the rest acts beside shafts
        self.teeth = self.own[self.own < len(topology.mesh_names)]
        self.shafts = len(topology.link_names) - len(topology.mesh_names)
        self.gears = sorted({disk for ends in topology.mesh_ends for disk in ends})

    @property
    def modes(self) -> ComplexModes:
        """The damped :class:`~jaxhb.equations.state_space.ComplexModes`."""
        return self.modes_and_missing[0]

    @cached_property
    def modes_and_missing(self) -> tuple[ComplexModes, float]:
        """All modes, or of a finely divided train the slow ones that its meshes see
        most; and the largest share of a mesh's own compliance that the modes hold which
        a march leaves out.
        """
        frequency = self.train.topology.cycle_frequency(1000.0)
        if self.train.topology.n_disks <= MODAL_DISKS:
            return march_modes(self.system, self.meshes, frequency, self.parts), 0.0
        resolving = KEPT_MODES * self.highest_hz * 2 * np.pi / frequency
        least = min(resolving, TIME_STEPS[-1])
        steps = next(count for count in TIME_STEPS if count >= least)
        model = reduced_model(
            self.system,
            np.asarray(self.meshes.link),
            np.ones(len(self.own)),
            frequency,
            steps,
        )
        # What is left out is the residual flexibility of a mesh times its stiffness: a
        # share of its own compliance.
        flexibility = np.abs(np.diag(np.asarray(model.residual_flexibility)))
        missing = flexibility * np.asarray(self.meshes.law.stiffness)
        modes = modes_of(model.space, np.asarray(model.motion))
        return modes, float(missing.max(initial=0.0))

    @cached_property
    def decay(self) -> float:
        """Seconds in which the slowest mode that teeth notice falls by the factor e.

        Impacts keep exciting such a mode, and it needs many times as long until they
        merely keep up its motion; rotation of the train and rings without
        spring, that decay over hours, bend no tooth.
        """
        modes = self.modes
        meshes = len(self.own)
        static = (
            modes.observation[:meshes].T[:, :, None]
            * modes.forcing[:, None, :]
            / modes.rates[:, None, None]
        )
        share = (np.abs(static) * np.asarray(self.meshes.law.stiffness)).max(
            axis=(1, 2)
        )
        slowest = np.max(modes.rates.real[share > OBSERVABLE], initial=-np.inf)
        return -1 / slowest if slowest < 0 else np.inf

    def decay_cycles(self, rpm: float) -> float:
        """Cycles of a speed in which the slowest mode that teeth notice falls by the
        factor e.
        """
        return self.decay * self.train.topology.cycle_frequency(rpm) / (2 * np.pi)

    @cached_property
    def highest_hz(self) -> float:
        """The highest natural frequency that strains tooth meshes noticeably, Hz."""
        return float(mesh_mode_harmonics(self.train, 2 * np.pi)[0])

    def steps(self, rpm: float) -> int:
        """Steps of a cycle at a speed."""
        topology = self.train.topology
        highest = 2 * np.pi * self.highest_hz / topology.cycle_frequency(rpm)
        least = max(
            STEPS_PER_MODE_PERIOD * highest, 4 * listed_harmonic(topology), STEPS
        )
        more = TIME_STEPS[-1] << int(np.ceil(np.log2(max(least / TIME_STEPS[-1], 1))))
        return next((count for count in TIME_STEPS if count >= least), more)

    def too_long(self, rpm: float, refinement: int = 1) -> str:
        """Sentence that says why a speed is not marched with ``refinement`` times its
        steps; empty where it is.
        """
        steps = refinement * self.steps(rpm)
        most = min(MOST_STEPS, int(MEMORY / self._bytes_of_step))
        if steps <= most:
            return ""
        times = (
            f", {refinement} times those of the first march" if refinement > 1 else ""
        )
        return (
            f"time integration would take {steps:.3g} steps a cycle{times}, as teeth"
            f" vibrate at up to {self.highest_hz:.4g} Hz, and takes at most {most:.3g}"
        )

    @property
    def _bytes_of_step(self) -> float:
        """Memory in B that a recorded march takes for each of its steps: the rows of
        the linear motion, the states, and of every quantity its values and their
        Fourier coefficients.
        """
        links = len(self.train.topology.link_names)
        disks = self.train.topology.n_disks
        slow = 2 * disks + 3 * links
        fast = 3 * len(self.own) + 2 * len(self.linear) + 2 * len(self.gears)
        return 8 * (
            16 * len(self.own)
            + 2 * len(self.modes.rates)
            + 4 * slow / cycles.STRIDE
            + 4 * fast
        )

    def linear_motion(self, rpm: Sequence[float] | np.ndarray) -> LinearMotion:
        """The :class:`~jaxhb.integration.batch.LinearMotion` of speeds."""
        return batch.linear_motions(
            self.train,
            rpm,
            self.system,
            self.meshes,
            listed_harmonic(self.train.topology),
        )

    @cached_property
    def gear_sums(self) -> np.ndarray:
        """Arms ``(P, R + G)`` in m, radius times sense, with which the forces of the
        linear meshes, then those of the meshes that have a law, act on gears.
        """
        ends = [self.train.topology.mesh_ends[i] for i in (*self.linear, *self.teeth)]
        sense = np.array(
            [
                [float(first == gear) - float(second == gear) for first, second in ends]
                for gear in self.gears
            ]
        )
        sums = (
            sense * np.asarray(self.train.disks.radius)[self.gears][:, None]
            if self.gears
            else np.zeros((0, 0))
        )
        return np.pad(sums, [(0, 0), (0, len(self.own) - len(self.teeth))])

    @cached_property
    def beside(self) -> np.ndarray | None:
        """Torque ``(shafts, G)`` in m of a shaft or damper per force that acts beside
        it; None where no force does.
        """
        if not self.train.topology.springs:
            return None
        links = np.where(
            self.own < len(self.train.topology.mesh_names),
            -1,
            np.asarray(self.meshes.link),
        )
        radius = np.asarray(self.system.radius)[self.system.tree.end_a]
        return (np.arange(self.shafts)[:, None] == links) * radius[: self.shafts, None]

    def outputs(self, linear_motion: LinearMotion, steps: int) -> Outputs:
        """The :class:`~jaxhb.integration.cycles.Outputs` of speeds."""
        linear = self.shafts + self.linear
        sums = self.gear_sums, self.beside
        return cycles.outputs_of(
            self.modes, self.system, self.shafts, linear, sums, linear_motion, steps
        )


class SpeedMarch:
    """One speed on its way, which only :meth:`go_on` and a start move.

    place : in its batch; state ``(2m,)``; cycles : done; not_before : cycles from which
    a period counts again, after a motion that was not solved, or that repels.
    """

    def __init__(self, place: int, rpm: float, state: np.ndarray, closure: Closure):
        self.place = place
        self.rpm = rpm
        self.state = state
        self.closure = closure
        self.cycles = 0
        self.not_before = 0
        self._trace: np.ndarray | None = None
        self._records: list[CycleNumbers] = []
        self._powers: list[np.ndarray] = []

    def go_on(self, marched: Marched, count: int) -> None:
        """Take over so many marched cycles."""
        self.state = np.asarray(marched.state)
        self._trace = np.asarray(marched.trace)
        self.closure.add(np.asarray(marched.samples)[:count])
        self.cycles += count
        if marched.numbers is not None:
            numbers = jax.tree.map(np.asarray, marched.numbers)
            self._records.append(_of(numbers, slice(count)))
            self._powers.append(np.asarray(marched.power))

    @property
    def trace(self) -> np.ndarray:
        """Samples (l, l') ``(2G, steps)`` of the last cycle."""
        assert self._trace is not None, "no cycle has been marched"
        return self._trace[:-1].T

    @property
    def recorded(self) -> int:
        """Cycles of the record."""
        return sum(len(part.quantities.mean) for part in self._records)

    @property
    def numbers(self) -> CycleNumbers:
        """Numbers of all recorded cycles."""
        return jax.tree.map(lambda *parts: np.concatenate(parts), *self._records)

    @property
    def power(self) -> np.ndarray:
        """Sum ``(Q, H+1)`` of |x^n|^2 over the recorded cycles."""
        return sum(self._powers[1:], start=self._powers[0])


class Batch:
    """Marches of some speeds with equal numbers of steps, on one device or side by side
    on several.
    """

    def __init__(
        self,
        equations: Equations,
        rpm: np.ndarray,
        steps: int,
        devices: Sequence[Any] = (),
    ):
        self.equations = equations
        self.steps = steps
        self.devices = devices
        self.linear_motion = equations.linear_motion(rpm)
        self.steppers = batch.steppers(
            equations.modes,
            equations.system,
            equations.meshes,
            self.linear_motion,
            steps,
        )
        # As in the periodicity error of a CycleTrace: with epsilon 1 there is no gap.
        floor = (1 - equations.meshes.law.epsilon) * equations.meshes.law.backlash
        states = batch.state_of(
            equations.modes,
            batch.motions_on_flank(self.linear_motion),
            self.linear_motion,
        )
        speeds = zip(rpm, self.linear_motion.frequency, strict=True)
        self.marches = [
            SpeedMarch(
                i,
                float(speed),
                states[i],
                Closure(np.concatenate([floor, omega * floor])),
            )
            for i, (speed, omega) in enumerate(speeds)
        ]

    @property
    def work(self) -> int:
        """Steps times modes of a cycle."""
        return self.steps * len(self.equations.modes.rates)

    def begin(self, index: int, motion: np.ndarray) -> None:
        """Let a march begin at a motion (x, x') ``(2S,)``."""
        linear_motion = _of(self.linear_motion, [index])
        self.marches[index].state = batch.state_of(
            self.equations.modes, motion[None], linear_motion
        )[0]

    def motion(self, march: SpeedMarch) -> np.ndarray:
        """Motion (x, x') ``(2S,)`` of a march where it stands, at the beginning of a
        cycle.
        """
        return batch.motion_of(
            self.equations.modes,
            march.state[None],
            _of(self.linear_motion, [march.place]),
        )[0]

    def run(
        self,
        marches: Sequence[SpeedMarch],
        record: bool = False,
        count: int = cycles.CYCLES,
    ) -> None:
        """Let marches go on for ``count`` cycles, recorded or not."""
        devices = max(len(self.devices), 1)
        left = list(marches)
        most = RECORDED_SPEEDS if record else BATCHES[0][0]
        while left:
            fits = (
                size
                for size, least in BATCHES
                if size <= most and len(left) >= least * devices
            )
            size = next(fits, BATCHES[-1][0]) * devices
            self._run(left[:size], size, record, count)
            left = left[size:]

    def _run(
        self, marches: Sequence[SpeedMarch], size: int, record: bool, count: int
    ) -> None:
        """Run marches in one program of ``size`` speeds, the last of them repeated to
        fill it.
        """
        indices = [march.place for march in marches] + [marches[-1].place] * (
            size - len(marches)
        )
        steppers = _of(self.steppers, indices)
        states = np.stack([self.marches[index].state for index in indices])
        cycle_count = np.array(count)
        outputs = (
            self.equations.outputs(_of(self.linear_motion, indices), self.steps)
            if record
            else None
        )
        if size == 1:  # by itself, without the axis of the speeds
            stepper = _of(steppers, 0)
            output = cycles.of_speed(outputs, 0)
            runs = [cycles.march(stepper, states[0], cycle_count, output)]
        else:
            program: Callable[..., cycles.Marched] = cycles.march_side_by_side
            if len(self.devices) > 1:
                cut = along(0), along(0), WHOLE, cycles.cut(outputs, along(0), WHOLE)
                program = across(cycles.march_side_by_side, self.devices, cut, along(0))
            together = program(steppers, states, cycle_count, outputs)
            together = jax.tree.map(np.asarray, together)
            runs = [_of(together, i) for i in range(len(marches))]
        for march, marched in zip(marches, runs, strict=True):
            march.go_on(marched, count)

    def traced(self, march: SpeedMarch, count: int) -> np.ndarray:
        """Samples (l, l') ``(2G, count x steps)`` of the next cycles, through which the
        march goes; of its last cycle if ``count`` is 1.
        """
        if count == 1:
            return march.trace
        parts = []
        for _ in range(count):
            self._run([march], 1, False, 1)
            parts.append(march.trace)
        return np.concatenate(parts, axis=1)


def part_sizes(count: int) -> list[int]:
    """Cycles of each run of a march over ``count`` cycles."""
    whole, rest = divmod(count, cycles.CYCLES)
    return [cycles.CYCLES] * whole + [rest] * (rest > 0)


def _of(tree: Tree, indices: int | slice | Sequence[int]) -> Tree:
    """Take one speed, or some of them, from arrays with a leading axis."""
    return jax.tree.map(lambda leaf: leaf[indices], tree)


def record_of(equations: Equations, march: SpeedMarch) -> Record:
    """The :class:`~jaxhb.results.record.Record` of a march's recorded cycles."""
    topology = equations.train.topology
    signals = _signals(march, equations.train.topology.revolutions_per_cycle)
    shafts = equations.shafts
    gears = equations.gears
    stiffness = np.asarray(equations.system.stiffness)
    radius = np.asarray(equations.system.radius)

    def take(elements: Iterable[Any]) -> tuple[RecordedSignal, ...]:
        """The next signals, one for each of the elements."""
        return tuple(next(signals) for _ in elements)

    def transmitted(
        totals: Sequence[RecordedSignal], elastic_parts: Sequence[RecordedSignal | None]
    ) -> tuple[RecordedSignal, ...]:
        """Forces or torques with their elastic parts."""
        return tuple(
            dataclasses.replace(total, elastic_part=elastic_part)
            for total, elastic_part in zip(totals, elastic_parts, strict=True)
        )

    # In the order of the outputs (jaxhb.integration.cycles).
    disks = take(topology.disk_names)
    rates = take(topology.disk_names)
    twists = take(range(shafts))
    twist_rates = take(range(shafts))
    torques = take(range(shafts))
    bent = take(equations.linear)
    forces = take(equations.linear)
    deflections = take(equations.own)
    elastic = take(equations.own)
    total = take(equations.own)
    of_gears = dict(zip(gears, transmitted(take(gears), take(gears)), strict=True))
    assert next(signals, None) is None, "another order of the outputs"

    ends = radius[equations.system.tree.end_a][:shafts]
    factors = zip(twists, stiffness[:shafts], ends, strict=True)
    springs = {link for link, *_ in topology.springs}
    # A spring beside a shaft has no elastic part of its own in the record.
    elastic_torques = [
        None if i in springs else twist.scaled(constant * arm**2)
        for i, (twist, constant, arm) in enumerate(factors)
    ]
    torques = transmitted(torques, elastic_torques)
    mesh_stiffness = stiffness[shafts + equations.linear]
    elastic_forces = [
        deflection.scaled(constant)
        for deflection, constant in zip(bent, mesh_stiffness, strict=True)
    ]
    forces = transmitted(forces, elastic_forces) + transmitted(total, elastic)
    deflections = bent + deflections
    order = np.argsort(np.concatenate([equations.linear, equations.own]))[
        : len(topology.mesh_names)
    ]
    deflections = tuple(deflections[i] for i in order)
    forces = tuple(forces[i] for i in order)
    contacts = _contacts(equations, march, forces)
    turning = (
        2
        * np.pi
        / 60
        * march.rpm
        * speed_ratios(equations.train)[np.array(topology.rotor, dtype=int)]
    )
    speeds = tuple(
        rate.shifted(mean) for rate, mean in zip(rates, turning, strict=True)
    )
    heat = _heat(
        equations, topology.cycle_frequency(march.rpm), ends, twists, twist_rates
    )
    return Record(
        topology=topology,
        cycles=march.recorded,
        disks=disks,
        speeds=speeds,
        twists=twists,
        torques=torques,
        deflections=deflections,
        forces=forces,
        gears=of_gears,
        contacts=contacts,
        heat=heat,
    )


def _heat(
    equations: Equations,
    frequency: float,
    ends: np.ndarray,
    twists: Sequence[RecordedSignal],
    rates: Sequence[RecordedSignal],
) -> tuple[float, ...]:
    """Mean power in W that shafts and dampers turn into heat: viscous from the rates,
    loss factors from the orders.
    """
    viscous = np.asarray(equations.system.viscous)
    loss = np.asarray(equations.system.loss * equations.system.stiffness)
    heat = []
    for k, (radius, twist, rate) in enumerate(zip(ends, twists, rates, strict=True)):
        harmonics = np.arange(1, len(twist.amplitudes) + 1)
        lossy = frequency * np.sum(harmonics * twist.amplitudes**2) / 2
        heat.append(float(radius**2 * (viscous[k] * rate.rms**2 + loss[k] * lossy)))
    return tuple(heat)


def _signals(march: SpeedMarch, revolutions: float) -> Iterator[RecordedSignal]:
    """Yield the quantities of a record in the order of the outputs."""
    numbers = march.numbers.quantities
    mean = numbers.mean.mean(axis=0)
    rms = np.sqrt(numbers.square.mean(axis=0))
    amplitudes = 2 * np.sqrt(march.power[:, 1:] / march.recorded)
    for i in range(len(mean)):
        yield RecordedSignal(
            highest=np.asarray(numbers.highest[:, i]),
            lowest=np.asarray(numbers.lowest[:, i]),
            mean=float(mean[i]),
            rms=float(rms[i]),
            amplitudes=amplitudes[i],
            revolutions_per_cycle=revolutions,
        )


def _contacts(
    equations: Equations, march: SpeedMarch, forces: Sequence[RecordedSignal]
) -> tuple[SteadyContact, ...]:
    """:class:`SteadyContact` of every mesh."""
    numbers = march.numbers.contacts
    contacts = [
        SteadyContact(0.0, 0.0, 0.0, 0.0, int(np.sign(force.mean))) for force in forces
    ]
    for g, index in enumerate(equations.teeth):
        shares = numbers.above[:, g].mean(), numbers.below[:, g].mean()
        drive = int(np.sign(forces[index].mean))
        reverse = shares[0] if drive < 0 else shares[1]
        contacts[index] = SteadyContact(
            separated_fraction=float(1 - sum(shares)),
            reverse_contact_fraction=float(reverse),
            impacts_per_cycle=float(numbers.impacts[:, g].mean()),
            hardest_impact=float(numbers.hardest[:, g].max()),
            drive_side=drive,
        )
    return tuple(contacts)


def ended(
    batch: Batch, running: Sequence[SpeedMarch], cycles: Cycles, exact: bool = False
) -> list[tuple[SpeedMarch, int]]:
    """Let marches go on until one or more of them end; return these as ``(march,
    period)``, with period 0 where a march ends without a period.

    ``cycles``: Cycles with a number of them before the record; ``exact``: whether
    harmonic balance is asked to confirm periods.
    """
    assert cycles.transient is not None and cycles.recorded is not None
    while running:
        first = [march for march in running if march.cycles < cycles.transient]
        later = [march for march in running if march.cycles >= cycles.transient]
        recording = [march for march in later if march.recorded < cycles.recorded]
        further = [march for march in later if march.recorded >= cycles.recorded]
        for group, record in ((first + further, False), (recording, True)):
            batch.run(group, record)
        periods = [(march, _period(march, cycles, exact)) for march in running]
        if any(period is not None for _, period in periods):
            return [(march, period) for march, period in periods if period is not None]
    return []


def _period(march: SpeedMarch, cycles: Cycles, exact: bool) -> int | None:
    """The period of a march, 0 where it ends without, None where it goes on."""
    assert cycles.transient is not None and cycles.recorded is not None
    if not march.closure.finite:
        return 0
    if march.cycles < march.not_before:
        return None
    # Where harmonic balance confirms or refuses a motion, being near one is worth the
    # question as soon as the cycles are done, whether or not the march goes on.
    close = CLOSE if exact else NEAR
    complete = march.cycles >= cycles.transient and march.recorded >= cycles.recorded
    period = (
        march.closure.period_at_end(close)
        if complete and exact
        else march.closure.period()
    )
    if period:
        return period
    over = complete and (march.cycles >= cycles.most or not march.closure.undecided())
    return march.closure.period_at_end(close) if over else None
