"""Periodic motions of one cycle of a train at one speed: Newton's method on the map of
a sweep, from many starts.

Sweeps lead to one of the motions that attract. Cycles of long marches that nearly close
pass near others, stable or not; states at random are near some that no march passes;
and at the end of the curve from a linear law (:mod:`jaxhb.solutions.homotopy`) there is
one where neither leads anywhere. A march costs a thousandth of a second, so that
hundreds of starts are tried.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TypeAlias

import jax
import numpy as np

from jaxhb._jax import Array, on_host
from jaxhb.balance import map_newton, sweeps, swept
from jaxhb.balance.map_newton import PackedPoint
from jaxhb.balance.problem import problem_at
from jaxhb.balance.program import response_of
from jaxhb.balance.sweeps import Settled, SweepPlan, SweepPoint
from jaxhb.balance.swept import MOST_SWEEPS, SETTLED, difference
from jaxhb.results.response import Response
from jaxhb.results.status import Homotopy, March, NewtonOnSweeps, Status, Sweeps
from jaxhb.solutions import continuation, homotopy
from jaxhb.solutions.sweeping import SweptTrain

CYCLES = 128  # marched from each start
# Of the teeth where the first marches start: on their drive sides, on the other sides,
# in their gaps
PLACES = (1.0, -1.0, 0.0)
# States at random where further marches start, and how far off they are at most, over
# the states that the first marches visit
SCATTERED = 8
REACH = 2.0
# First cycle of a march from which Newton's method starts where it nearly closes
FIRST_CYCLE = 2
# Cycles of a march from a state at random from which it starts whatever they do
EARLY = 6
RANDOM = 32  # states at random from which it starts at once
# Difference of states, as a share of their size, up to which they lead to the same
# motion
NEAR = 0.02
# Difference of the deflections, as a share of the largest, up to which two solutions
# are one motion
SAME = 0.01
# Of Newton's method from one start at most: one in ten of those that arrive takes more
MARCHES = 80
# Starts of a kind one after another that lead to no new motion, after which there are
# no more of it
IDLE = 16
# Marches of a search at most, all steps of these, and the share of both after which
# nothing begins but curves.
MOST = 10000
WORK = 4e7
STARTED = 0.75
FEWEST = 150  # marches without which no curve begins
JACOBIANS = 150  # points of a curve at most
# Share of state and force by which a cycle may miss its beginning, aimed at, and from
# which a motion is near.
CLOSED = 1e-6
NEARLY = 1e-3
CURVE = continuation.StepControl(closed=1e-6, longest=0.2)
LEAST_P = -0.1  # where a curve that turned back is given up


Event: TypeAlias = Homotopy | March | NewtonOnSweeps | Sweeps


class _Map:
    """A train at one speed with so many steps of a cycle, ready for Newton's method on
    the map.
    """

    def __init__(self, train: SweptTrain, rpm: float, plan: SweepPlan):
        self.train = train
        self.rpm = rpm
        self.plan = plan
        self.problem = problem_at(train.train, rpm, train.plan.excited)
        self.swept, self.condensed = swept.ready(
            self.problem, train.plan.active_meshes, train.modes_at(rpm), plan
        )
        self.goal = SETTLED * train.plan.tolerance

    def flank(self) -> SweepPoint:
        """The point with all teeth on their drive sides, on the host."""
        return jax.tree.map(np.asarray, self.swept.flank)

    def point_of(self, deflection: Array) -> SweepPoint:
        """The point from which deflections ``(G, n+1)`` m are marched."""
        return sweeps.point_of(
            on_host(self.swept.sweeps), np.asarray(deflection), self.plan
        )

    def settle(self) -> Settled:
        """Sweeps from the drive sides."""
        return sweeps.settle_program(
            self.swept.sweeps,
            self.swept.flank,
            goal=self.goal,
            most=MOST_SWEEPS,
            plan=self.plan,
        )

    def newton(self, point: SweepPoint) -> Settled:
        """Newton's method from a point."""
        return map_newton.solve_map(
            self.swept.sweeps, point, self.plan, goal=self.goal, most_marches=MARCHES
        )

    def arrived(self, ended: Settled) -> bool:
        """Whether an iteration ended at a motion."""
        return bool(ended.distance <= self.goal)

    def response(self, ended: Settled, path: Sequence[Event]) -> Response:
        """The Response at the end of an iteration."""
        swept_problem, ended = jax.tree.map(np.asarray, (self.swept, ended))
        train = self.train
        with np.errstate(all="ignore"):  # a status tells of numbers that are not finite
            outcome = swept.conclude_sweeps(
                self.problem,
                train.plan.active_meshes,
                self.condensed,
                swept_problem,
                ended,
                train.plan.tolerance,
                self.goal,
                self.plan,
            )
            outcome = jax.tree.map(np.asarray, outcome)
        return response_of(train.train, self.rpm, self.problem, outcome, path)


@dataclasses.dataclass(frozen=True)
class _Visited:
    """Points at the beginnings of cycles of marches: states ``(n, 2m)``, forces ``(n,
    G)`` and by how much each cycle misses its beginning, inf where none begins; number
    of its cycle.
    """

    states: np.ndarray
    forces: np.ndarray
    missed: np.ndarray
    cycle: np.ndarray


class OrbitSearch:
    """Search for the motions of one cycle of a train at a speed, with a bounded number
    of marches.
    """

    def __init__(self, train: SweptTrain, rpm: float):
        self.train = train
        self.rpm = rpm
        self.plans = train.sweep_plans(rpm)
        self.maps: dict[SweepPlan, _Map] = {}
        self.map = self._map_of(self.plans[0])
        self.found: list[np.ndarray] = []  # deflections of the motions so far
        # Of the vibration, by the last sweep from the drive sides
        self.sweep_change = np.inf
        self.marches = 0  # taken
        self.idle = 0  # starts since the last motion that was new
        self.most = min(MOST, WORK / self.plans[0].steps)
        self.random = np.random.default_rng(0)

    def motions(self) -> Iterator[Response]:
        """Yield the Response of each motion that is new."""
        settled = self.map.settle()
        event = Sweeps(int(settled.marches), self.map.plan.steps, float(settled.change))
        self.marches += int(settled.marches)
        self.sweep_change = event.change
        attracted = self.map.arrived(settled)
        if attracted:
            yield from self._taken(self.map, settled, [event])
        else:
            yield from self._from(self.map, settled.point, [event])
        flank = self.map.flank()
        yield from self._from(self.map, flank, [])
        visited = self._visited(flank)
        for starts in (
            self._nearly_closed(visited),
            self._early(visited),
            self._at_random(visited),
        ):
            self.idle = 0
            for start, path in starts:
                yield from self._near(start, path)
                if self.idle >= IDLE or self.marches >= STARTED * self.most:
                    break
        yield from self._from_linear_law(once=attracted)

    def _map_of(self, plan: SweepPlan) -> _Map:
        """The map with the steps of a plan, made once."""
        if plan not in self.maps:
            self.maps[plan] = _Map(self.train, self.rpm, plan)
        return self.maps[plan]

    def _visited(self, flank: SweepPoint) -> _Visited:
        """The points that marches from several starts visit."""
        starts = [
            SweepPoint(flank.linear, share * flank.state, share * flank.force)
            for share in PLACES
        ]
        visits = [self._march(start) for start in starts]
        starts = self._scattered(
            flank, np.concatenate([states for states, *_ in visits]), SCATTERED
        )
        visits += [self._march(start) for start in starts]
        states, forces, missed, cycle = (
            np.concatenate(parts) for parts in zip(*visits, strict=True)
        )
        return _Visited(states, forces, missed, cycle)

    def _march(
        self, start: SweepPoint
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The parts of :class:`_Visited` for the cycles of one march."""
        visited = sweeps.visited_program(
            self.map.swept.sweeps, start, plan=self.map.plan, cycles=CYCLES
        )
        states, forces, missed = jax.tree.map(np.asarray, visited)
        self.marches += CYCLES
        cycle = np.arange(CYCLES)
        begins = (
            np.isfinite(missed)
            & np.isfinite(states).all(axis=1)
            & (cycle >= FIRST_CYCLE)
        )
        return states, forces, np.where(begins, missed, np.inf), cycle

    def _scattered(
        self, flank: SweepPoint, states: np.ndarray, count: int
    ) -> list[SweepPoint]:
        """Points at random within REACH of the largest of some states ``(n, 2m)``,
        nearer and farther off by turns.
        """
        size = np.abs(np.where(np.isfinite(states), states, 0.0)).max(axis=0)
        reach = REACH / 2.0 ** (np.arange(count) % 3)
        shares = reach[:, None] * self.random.uniform(-1, 1, (count, len(size)))
        return [
            SweepPoint(flank.linear, share * size, 0 * flank.force) for share in shares
        ]

    def _nearly_closed(
        self, visited: _Visited
    ) -> Iterator[tuple[SweepPoint, list[Event]]]:
        """Yield starts from cycles of the marches, with their paths; those first that
        miss their beginning least.
        """
        visibility = PackedPoint(self.map.swept.sweeps, self.map.flank()).visibility
        largest = np.max(visited.missed[np.isfinite(visited.missed)], initial=1e-300)
        tried: list[np.ndarray] = []
        for k in np.argsort(visited.missed).tolist():
            seen = visited.states[k] * visibility
            apart = all(
                np.linalg.norm(seen - other) > NEAR * np.linalg.norm(seen)
                for other in tried
            )
            if np.isfinite(visited.missed[k]) and apart:
                tried.append(seen)
                cycle = int(visited.cycle[k]) + 1
                missed = float(visited.missed[k] / largest)
                yield (
                    self._start(visited, k),
                    [March(cycle, self.map.plan.steps, missed)],
                )

    def _early(self, visited: _Visited) -> Iterator[tuple[SweepPoint, list[Event]]]:
        """Yield starts from the first cycles of the marches from states at random."""
        scattered = np.arange(len(visited.cycle)) >= len(PLACES) * CYCLES
        early = (
            scattered
            & (visited.cycle < EARLY)
            & np.isfinite(visited.states).all(axis=1)
        )
        for k in self.random.permutation(np.flatnonzero(early)).tolist():
            yield self._start(visited, k), []

    def _at_random(self, visited: _Visited) -> Iterator[tuple[SweepPoint, list[Event]]]:
        """Yield starts from states at random, nearer and farther off by turns."""
        for start in self._scattered(self.map.flank(), visited.states, RANDOM):
            yield start, []

    def _start(self, visited: _Visited, k: int) -> SweepPoint:
        """The visited point number k."""
        return SweepPoint(self.map.flank().linear, visited.states[k], visited.forces[k])

    def _from_linear_law(self, once: bool) -> Iterator[Response]:
        """Yield motions from the ends of curves from linear laws; no more of them after
        the first that arrives if ``once``.
        """
        # The damping that is added depends on rates.
        plan = dataclasses.replace(self.map.plan, by_rate=True)
        curve_map = self._map_of(plan)
        for curves, beginning in enumerate(homotopy.BEGINNINGS, 1):
            if self.most - self.marches < FEWEST:
                return
            curve = homotopy.MapCurve(
                curve_map.swept.sweeps,
                curve_map.flank(),
                plan,
                beginning,
                self.most - self.marches,
            )
            end = continuation.follow_curve(
                curve.linearize,
                curve.simplify,
                curve.start(),
                most=JACOBIANS,
                within=(LEAST_P, 1.0),
                control=CURVE,
            )
            self.marches += curve.marches
            arrived = end.arrived and end.y[-1] > 0
            if arrived:
                event = Homotopy(curves, end.steps, end.folds, plan.steps)
                yield from self._from(self.map, curve.point(end.y), [event])
            if arrived and once:
                return

    def _near(self, start: SweepPoint, path: Sequence[Event]) -> Iterator[Response]:
        """Yield the Response of a motion near a start, if it is new."""
        equation = self.map.swept.sweeps
        plan = self.map.plan
        point = swept.corrected(self.map.swept, start, plan)
        point, missed, marches = map_newton.close_cycle(
            equation, point, plan, tolerance=CLOSED
        )
        self.marches += 1 + marches
        if not missed <= NEARLY:
            self.idle += 1
            return
        self.marches += 1
        yield from self._from(
            self.map, swept.corrected(self.map.swept, point, plan), path
        )

    def _from(
        self, train_map: _Map, point: SweepPoint, path: Sequence[Event]
    ) -> Iterator[Response]:
        """Yield the Response of the motion to which Newton's method leads from a point,
        if it is new.
        """
        ended = train_map.newton(point)
        self.marches += int(ended.marches)
        event = NewtonOnSweeps(
            int(ended.marches), train_map.plan.steps, float(ended.change)
        )
        return self._taken(train_map, ended, [*path, event])

    def _taken(
        self, train_map: _Map, ended: Settled, path: Sequence[Event]
    ) -> Iterator[Response]:
        """Yield the Response of the motion where an iteration ended, if it is new."""
        deflection = np.asarray(ended.deflection)
        new = train_map.arrived(ended) and all(
            difference(deflection, other) > SAME for other in self.found
        )
        self.idle = 0 if new else self.idle + 1
        if new:
            self.found.append(deflection)
            response = self._refined(train_map, ended, path)
            if response.solved:
                yield response

    def _refined(
        self, train_map: _Map, ended: Settled, path: Sequence[Event]
    ) -> Response:
        """The Response with as many steps as the tolerance needs, or the best."""
        best = train_map.response(ended, path)
        for plan in self.plans[self.plans.index(train_map.plan) + 1 :]:
            if int(best.status) != Status.TOLERANCE_NOT_MET:
                break
            finer = self._map_of(plan)
            ended = finer.newton(finer.point_of(ended.deflection))
            self.marches += int(ended.marches)
            path = [
                *path,
                NewtonOnSweeps(int(ended.marches), plan.steps, float(ended.change)),
            ]
            response = finer.response(ended, path)
            if response.status > best.status:
                break
            best = response
        return best
