"""Run-up of a train by the compiled Runge-Kutta method of :mod:`integrators`, with a
table of its excitation at the momentary speed, made by products of matrices for some
hundred steps at a time.
"""

import time
from dataclasses import dataclass

import numpy as np
from integrators import runge_kutta
from tasks import fastest_rate, prepare

from jaxhb.equations import backlash
from jaxhb.train.excitation import excitation, highest_harmonic
from jaxhb.train.kinematics import inertias, speed_ratios

RPM = np.pi / 30
PANELS = 256
"""Ranges of the speed, in each of which the harmonics are a parabola over it."""
CHUNK = 512
"""Steps of which a table is made at a time, so that it stays in the cache."""


@dataclass(frozen=True)
class RunUp:
    """Largest and smallest elastic force N of each mesh, and seconds of the table and
    of the steps.
    """

    highest: np.ndarray
    lowest: np.ndarray
    table_seconds: float
    step_seconds: float
    step: float

    @property
    def peaks(self):
        """Largest absolute elastic forces ``(M,)`` N."""
        return np.maximum(self.highest, -self.lowest)


@dataclass(frozen=True)
class Excited:
    """A train between two speeds as arrays for :func:`run_up`.

    harmonics ``(P, 3, E, N+1)`` N of the excited disks ``moved`` at begin, middle and
    end of panels of the speed; constant ``(S,)`` N of the acceleration.
    """

    task: object
    model: object
    moved: np.ndarray
    harmonics: np.ndarray
    constant: np.ndarray
    revolutions: float
    low: float
    high: float
    seconds: float

    @classmethod
    def of(cls, train, seconds, low, high):
        """A train that is accelerated from ``low`` to ``high`` rpm; its loads take the
        power of the acceleration.
        """
        task = prepare(train, low)
        nodes = np.linspace(low, high, 2 * PANELS + 1)
        torque, _, _ = excitation(train, nodes, highest_harmonic(train))
        ratio = speed_ratios(train)[np.array(train.topology.rotor)]
        alpha = (high - low) * RPM / seconds
        inertia = inertias(train)
        constant = -inertia * ratio * alpha
        load_disk = np.array(train.topology.load_disk)
        share = np.asarray(train.loads.share)
        taken = (inertia * ratio**2).sum() * alpha * share / (share @ ratio[load_disk])
        np.add.at(constant, load_disk, taken)
        order = task.order
        force = torque[:, order] / task.radius[:, None]
        moved = np.flatnonzero(np.abs(force).max(axis=(0, 2)))
        places = 2 * np.arange(PANELS)[:, None] + np.arange(3)
        return cls(
            task=task,
            model=task.model._replace(pushed=np.arange(len(order)).astype(np.uintp)),
            moved=moved,
            harmonics=np.ascontiguousarray(force[:, moved][places]),
            constant=constant[order] / task.radius,
            revolutions=float(train.topology.revolutions_per_cycle),
            low=low * RPM,
            high=high * RPM,
            seconds=seconds,
        )

    @property
    def longest_step(self):
        """Longest stable step in s, about."""
        return 2.7 / fastest_rate(self.task)

    def table(self, times):
        """Forces ``(n, S)`` N on the disks at increasing times ``(n,)`` s."""
        rate = (self.high - self.low) / self.seconds
        theta = (self.low + rate * times / 2) * times / self.revolutions
        ends = self.low + rate * times[[0, len(times) // 2, -1]]
        width = (self.high - self.low) / PANELS
        panel = min(int((ends[1] - self.low) / width), PANELS - 1)
        share = ((ends - self.low) / width - panel)[:, None, None]
        begin, middle, end = self.harmonics[panel]
        # The parabola over the speed, at begin, middle and end of the chunk
        rise = 4 * middle - 3 * begin - end
        bend = 2 * begin - 4 * middle + 2 * end
        first, half, last = begin + share * (rise + share * bend)
        rise = 4 * half - 3 * first - last
        bend = 2 * first - 4 * half + 2 * last
        orders = first.shape[-1]
        powers = np.empty((len(times), orders), dtype=complex)
        powers[:, 0] = 1.0
        powers[:, 1] = np.exp(1j * theta)
        filled = 2
        while filled < orders:
            more = min(filled, orders - filled)
            factor = powers[:, filled - 1 : filled] * powers[:, 1:2]
            powers[:, filled : filled + more] = factor * powers[:, :more]
            filled += more
        twice = np.where(np.arange(orders) > 0, 2.0, 1.0)
        coefficients = np.concatenate([first, rise, bend]) * twice
        values = powers.real @ coefficients.real.T - powers.imag @ coefficients.imag.T
        first, rise, bend = np.split(values, 3, axis=1)
        passed = np.linspace(0.0, 1.0, len(times))[:, None]
        table = np.empty((len(times), len(self.constant)))
        table[:] = self.constant
        table[:, self.moved] += first + passed * (rise + passed * bend)
        return table


def run_up(excited, motion, steps):
    """The :class:`RunUp` in so many steps from a motion ``(2S,)`` m, m/s of the
    disks.
    """
    order = excited.task.order
    disks = len(order)
    x = np.array(motion[:disks])[order]
    v = np.array(motion[disks:])[order]
    dt = excited.seconds / steps
    meshes = excited.model.mesh_k.size
    highest = np.full(meshes, -np.inf)
    lowest = np.full(meshes, np.inf)
    law = excited.task.law.expand()
    table_seconds = 0.0
    step_seconds = 0.0
    for first in range(0, steps, CHUNK):
        count = min(CHUNK, steps - first)
        begin = time.perf_counter()
        table = excited.table((2 * first + np.arange(2 * count + 1)) * (dt / 2))
        # An odd row more: the last one of the method would be the first again.
        table = np.concatenate([table, table[-1:]])
        made = time.perf_counter()
        deflection = np.empty((meshes, count))
        rate = np.empty((meshes, count))
        runge_kutta(excited.model, x, v, table, dt, deflection, rate)
        force = np.asarray(backlash.force(law, deflection))
        highest = np.maximum(highest, force.max(axis=1))
        lowest = np.minimum(lowest, force.min(axis=1))
        step_seconds += time.perf_counter() - made
        table_seconds += made - begin
    return RunUp(highest, lowest, table_seconds, step_seconds, dt)
