"""What the errors of the work-precision benchmark refer to: periodic motions found by
time integration.

Several periodic motions may exist at one speed. A case has up to two references: the
motion on the branch of the harmonic solution, corrected in time, and the motion on
which a long march from the linear solution settles. The error of a method is the
smaller of its distances to them, and its row names the branch.
"""

import time
from dataclasses import dataclass

import numpy as np
from integrators import stepping
from marches import march
from scipy.sparse.linalg import LinearOperator, gmres

import jaxhb

SAME = 2e-3
"""Two references closer than this are one motion."""

SHOOTING_DISKS = 60
"""Up to so many disks, :func:`jaxhb.shooting_correction`; above, Newton-Krylov on the
implicit tree integrator.
"""


@dataclass(frozen=True)
class Reference:
    """A periodic motion of the meshes over one cycle.

    branch : "harmonic", "march" or "both"; deflection, rate ``(M, n)`` m, m/s;
    periodicity error of its cycle; steps per cycle.
    """

    branch: str
    source: str
    deflection: np.ndarray
    rate: np.ndarray
    periodicity_error: float
    period: float
    task: object

    def force(self, count):
        """Elastic tooth forces ``(M, count)`` N at equal time samples, cubic between
        the samples of l and l'.
        """
        size = self.deflection.shape[1]
        place = np.arange(count) * size / count
        j = place.astype(int)
        s = place - j
        k = (j + 1) % size
        l = self.deflection
        slope = self.rate * self.period / size
        values = (1 + 2 * s) * (1 - s) ** 2 * l[:, j] + s * (1 - s) ** 2 * slope[:, j]
        values += s**2 * (3 - 2 * s) * l[:, k] + s**2 * (s - 1) * slope[:, k]
        return self.task.force(values)

    def error(self, force):
        """Largest difference over the cycle and the meshes / largest force."""
        wanted = self.force(force.shape[1])
        return float(np.abs(force - wanted).max() / np.abs(wanted).max())


def distance(references, force):
    """(error, branch) of the nearest reference; (nan, "") without any or where the
    force is not finite.
    """
    if not references or not np.isfinite(force).all():
        return np.nan, ""
    return min((reference.error(force), reference.branch) for reference in references)


def references(train, rpm, task, *, tolerance=1e-3, steps=None, budget=300.0):
    """The references of one train at one speed, and a sentence for each attempt that
    failed.

    tolerance : of the harmonic solution that is corrected; steps : per cycle of the
    implicit method, default 48000 (its own error is then about 3e-4); budget : seconds
    for each of them
    """
    notes = []
    small = train.topology.n_disks <= SHOOTING_DISKS
    method, steps = ("rk4", 12000) if small else ("implicit", steps or 48000)
    found = []
    response = jaxhb.solve(train, rpm=rpm, tolerance=tolerance)
    if int(response.status) <= jaxhb.Status.TOLERANCE_NOT_MET:
        found.append(
            _shot(response, task)
            if small
            else _krylov(task.started(response), steps, budget)
        )
    else:
        status = jaxhb.Status(int(response.status)).name
        notes.append(
            f"harmonic solution at {tolerance:g}: {status}, {response.harmonics}"
            " harmonics"
        )
    own = march(task, method, steps, aim=1e-6, most=400 if small else 60, budget=budget)
    if own.finite and own.periodicity_error <= 1e-5:
        name = f"march of {own.cycles} cycles, {method}, {steps} steps"
        found.append(
            Reference(
                "march",
                name,
                own.deflection,
                own.rate,
                own.periodicity_error,
                task.period,
                task,
            )
        )
    else:
        notes.append(
            f"march of {own.cycles} cycles, {method}, {steps} steps: closure"
            f" {own.periodicity_error:.1e}"
        )
    notes += [
        f"{r.source}: closure {r.periodicity_error:.1e}"
        for r in found
        if not r.periodicity_error <= 1e-4
    ]
    found = [r for r in found if r.periodicity_error <= 1e-4]
    if len(found) == 2 and found[1].error(found[0].force(8192)) < SAME:
        first = found[0]
        source = f"{first.source} = {found[1].source}"
        found = [
            Reference(
                "both",
                source,
                first.deflection,
                first.rate,
                first.periodicity_error,
                task.period,
                task,
            )
        ]
    return found, notes


def _shot(response, task):
    """The harmonic solution after one-cycle shooting; meshes without backlash are those
    of the response.
    """
    orbit = jaxhb.shooting_correction(response).orbit
    own = np.flatnonzero(response.topology.mesh_backlash)
    count = orbit.deflection.shape[1]
    deflection = response.deflection_samples(count)
    rate = np.zeros((len(task.model.mesh_k), count))
    deflection[own], rate[own] = orbit.deflection, orbit.rate
    name = f"shooting, {count} steps"
    return Reference(
        "harmonic", name, deflection, rate, orbit.periodicity_error, task.period, task
    )


def _krylov(task, steps, budget):
    """Newton's method with GMRES on the map over one implicit cycle; each product is
    one cycle.
    """
    advance, (x, v) = stepping(task, "implicit", steps)
    deflection, rate = np.empty((2, task.model.mesh_k.size, steps))
    gap = float(np.max(task.model.low))
    scale = np.repeat([gap, gap * 2 * np.pi * 1000], x.size)
    begin = time.perf_counter()

    def over(state):
        x[:], v[:] = np.split(state * scale, 2)
        advance(deflection, rate)
        return np.concatenate([x, v]) / scale

    def periodicity_error(state, end):
        change = _forces(task, end * scale) - _forces(task, state * scale)
        return float(np.abs(change).max() / np.abs(task.force(deflection)).max())

    state = np.concatenate([x, v]) / scale
    end = over(state)
    best = periodicity_error(state, end)
    for _ in range(5):
        if best < 1e-6 or time.perf_counter() - begin > budget:
            break
        small = 1e-5

        def product(direction, state=state, end=end, small=small):
            size = np.linalg.norm(direction) or 1.0
            return (
                direction
                - (over(state + small / size * direction) - end) * size / small
            )

        operator = LinearOperator((state.size, state.size), matvec=product)
        change, _ = gmres(operator, end - state, rtol=1e-2, restart=40, maxiter=1)
        trial = state + change
        reached = over(trial)
        now = periodicity_error(trial, reached)
        if not now < best:
            trial = end
            reached = over(end)
            now = periodicity_error(trial, reached)
        state, end, best = trial, reached, now
    over(state)
    name = f"Newton-Krylov, implicit, {steps} steps"
    return Reference("harmonic", name, deflection, rate, best, task.period, task)


def _forces(task, state):
    """Elastic tooth forces ``(M, 1)`` N in a state."""
    m = task.model
    x = state[: task.model.mass.size]
    return task.force((m.arm_a * x[m.mesh_a] - m.arm_b * x[m.mesh_b])[:, None])
