"""Motions of hammering teeth by sweeps of the cycle: for the trains that sweeps serve,
with as many steps as they need, at any speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import numpy as np

from jaxhb._jax import Array, remembered
from jaxhb.balance.march import InstantSolve, MarchModes, modes_for_march
from jaxhb.balance.plan import Plan, Request, excited_harmonic
from jaxhb.balance.problem import ActiveMeshes, problem_at
from jaxhb.balance.program import response_of
from jaxhb.balance.sweeps import STEPS, SweepPlan, steps_for
from jaxhb.balance.swept import SETTLED, solve_by_sweeps
from jaxhb.integration.batch import linear_motions, linear_start
from jaxhb.results.response import Response
from jaxhb.results.status import Status
from jaxhb.solutions import planning
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import listed_harmonic
from jaxhb.train.mesh_parameters import law_meshes
from jaxhb.train.varying import at_speed

# Speed at which the modes for all speeds are made: only the slowest depend on it, by a
# soft hold, and no bit of them on the speed that is solved
MODES_RPM = 1000.0


def swept_train(train: DriveTrain, plan: Plan, request: Request) -> SweptTrain | None:
    """The train ready to be solved by sweeps, with the tolerance of a plan made for it;
    None where sweeps do not serve.

    They serve where the number of harmonics is free and the law is sampled; and not on
    accelerators, which need lanes side by side.
    """
    free = (
        request.harmonics is None
        and request.method == "reduced"
        and request.integrals == "sampled"
    )
    return (
        SweptTrain.of(train, plan, request)
        if free and jax.default_backend() == "cpu"
        else None
    )


@remembered
def _modes_of(train_and_meshes: tuple[DriveTrain, ActiveMeshes]) -> MarchModes:
    """The modes of a train that some meshes of it notice."""
    train, active_meshes = train_and_meshes
    return modes_for_march(problem_at(train, MODES_RPM, 1), active_meshes)


@dataclass(frozen=True)
class SweptTrain:
    """A train ready to be solved by sweeps at any speed.

    plan : with every mesh that has a law as an unknown; excited : the highest harmonic
    that torques have; modes : those that the meshes notice, at a speed
    (:meth:`modes_at`).
    """

    train: DriveTrain
    plan: Plan
    excited: int
    modes: MarchModes

    @classmethod
    def of(cls, train: DriveTrain, plan: Plan, request: Request) -> SweptTrain | None:
        """Prepare a train with the tolerance of a plan; None for disks without inertia
        that leave no equation in time.
        """
        plan = planning.all_active(train, plan, request)
        constant = at_speed(train, MODES_RPM)
        try:
            modes = _modes_of((constant, plan.active_meshes))
        except ValueError:
            return None
        return cls(train, plan, excited_harmonic(train, request.method), modes)

    def modes_at(self, rpm: float) -> MarchModes:
        """The modes that the meshes notice at a speed."""
        if not self.train.topology.depends_on_speed:
            return self.modes
        return _modes_of((at_speed(self.train, rpm), self.plan.active_meshes))

    def solve(
        self,
        rpm: float,
        *,
        motion: np.ndarray | None = None,
        deflection: Array | None = None,
        settled: float = SETTLED,
        newton: bool = True,
        at_hand: Response | None = None,
        steps: int = 0,
    ) -> Response:
        """The response at a speed: the first that meets the tolerance, with twice and
        more times the steps, twice where it finds nothing.

        motion : ``(2S,)``, displacements and velocities of the disks at the beginning
        of a cycle, in m and m/s, where sweeps start; deflection : ``(G, n+1)`` m of the
        meshes that have a law, of a motion at that speed where sweeps start; by default
        teeth are on their drive sides. settled : share of the tolerance that may be
        left of the vibration; newton : whether Newton's method may find a motion at
        which sweeps do not settle, which may be unstable, or not where a train from
        there would go; at_hand : a motion at that speed, which is the answer where
        sweeps settle at it; steps : of a cycle at least. A status above
        TOLERANCE_NOT_MET says that no periodic motion was found.
        """
        problem = problem_at(self.train, rpm, self.plan.excited)
        deviation = None if motion is None else motion - self._linear_start(rpm)
        deflection = None if deflection is None else self._padded(deflection)
        known_deflection = (
            None
            if at_hand is None
            else self._padded(at_hand.deflections[list(self.plan.active)])
        )
        path = []
        outcomes = []
        failures = 0
        plans = self.sweep_plans(rpm, steps)
        for plan in plans:
            solution = solve_by_sweeps(
                problem,
                self.plan.active_meshes,
                self.modes_at(rpm),
                self.plan.tolerance,
                plan,
                deviation=deviation,
                deflection=deflection,
                settled=settled,
                newton=newton,
                at_hand=known_deflection,
            )
            path += solution.path
            outcome = solution.outcome
            if outcome is None:
                assert at_hand is not None, "the motion at which sweeps settle"
                return at_hand
            status = Status(int(outcome.status))
            outcomes.append(outcome)
            if status == Status.TOLERANCE_NOT_MET:
                deflection = solution.deflection
            elif newton and status.another_start_may_help and not failures:
                # Sweeps that go astray with long steps may settle with shorter ones
                failures += 1
            else:
                break
        # The finest of the best.
        best = min(reversed(outcomes), key=lambda outcome: int(outcome.status))
        return response_of(self.train, rpm, problem, best, path)

    def sweep_plans(self, rpm: float, steps: int = 0) -> list[SweepPlan]:
        """The plans that are tried at a speed one after another, with more and more
        steps, at least ``steps``.
        """
        topology = self.train.topology
        frequency = float(topology.cycle_frequency(rpm))
        instant = InstantSolve.of(len(topology.springs))
        by_rate = bool(topology.springs) or "contact" in topology.mesh_damping_law
        least = max(
            steps,
            steps_for(self.modes_at(rpm), frequency),
            4 * planning.ABOVE_EXCITATION * self.excited,
        )
        enough = [count for count in STEPS if count >= least] or STEPS[-1:]
        return [SweepPlan(count, instant, by_rate) for count in enough]

    def _padded(self, deflection: Array) -> np.ndarray:
        """Deflections of the active meshes, with the rows that pad them."""
        idle = len(self.plan.active_meshes.mask) - len(deflection)
        return np.pad(deflection, ((0, idle), (0, 0)))

    def _linear_start(self, rpm: float) -> np.ndarray:
        """Motion (x, x') ``(2S,)`` of the linear train at the beginning of a cycle."""
        train = at_speed(self.train, rpm)
        system = chain.assemble(train)
        meshes = law_meshes(train)
        highest = listed_harmonic(train.topology)
        motions = linear_motions(train, [rpm], system, meshes, highest)
        return linear_start(motions)[0]
