"""Marching through cycles with a compiled integrator until the tooth force repeats;
only the steps are timed.
"""

import time
from dataclasses import dataclass

import numpy as np
from integrators import RHO, stepping


@dataclass(frozen=True)
class Marched:
    """Last cycle of a march.

    deflection, rate ``(M, steps)`` m, m/s; force ``(M, steps)`` N elastic;
    periodicity_error : largest change of the elastic tooth force against the cycle
    before / largest force; cycles; seconds : of the steps alone.
    """

    deflection: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    periodicity_error: float
    cycles: int
    seconds: float

    @property
    def finite(self):
        """Whether the motion stayed finite."""
        return bool(np.isfinite(self.force).all())

    @property
    def seconds_per_step(self):
        """Run time of one step in s."""
        return self.seconds / self.cycles / self.force.shape[1]


def march(
    task,
    method,
    steps,
    *,
    cycles=None,
    aim=0.0,
    most=100,
    budget=np.inf,
    rho=RHO,
    clock=time.perf_counter,
):
    """Integrate a Task by "rk4" or "implicit", so many ``steps`` a cycle, until the
    elastic tooth force repeats.

    cycles : exactly so many; else until ``periodicity_error <= aim``, at most ``most``
    cycles (above it: not settled); budget : seconds after which no cycle is begun; rho
    : of generalized-alpha; clock : the function that seconds are taken from
    """
    advance, _ = stepping(task, method, steps, rho)
    deflection, rate = np.empty((2, task.model.mesh_k.size, steps))
    before = np.full_like(deflection, np.inf)
    periodicity_error = np.inf
    seconds = 0.0
    done = 0
    while done < (cycles or most) and seconds < budget:
        begin = clock()
        advance(deflection, rate)
        seconds += clock() - begin
        done += 1
        force = task.force(deflection)
        if not np.isfinite(force).all():
            periodicity_error = np.inf
            break
        periodicity_error = float(np.abs(force - before).max() / np.abs(force).max())
        before = force
        if not cycles and periodicity_error <= aim:
            break
    return Marched(deflection, rate, force, periodicity_error, done, seconds)
