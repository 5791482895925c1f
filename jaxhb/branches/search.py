"""Every periodic motion of a train at one speed that searches find: those it may run
in, and those that repel.
"""

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import refuse_tracers
from jaxhb.balance.plan import Plan, Request
from jaxhb.balance.swept import difference
from jaxhb.floquet.stability import Stability, tendency
from jaxhb.results.response import Response
from jaxhb.solutions import starts
from jaxhb.solutions.orbits import OrbitSearch
from jaxhb.solutions.planning import all_active, plan_speeds
from jaxhb.solutions.sweeping import SweptTrain
from jaxhb.steady.classification import Classifier, SolvedMotion
from jaxhb.steady.closure import Cycles
from jaxhb.steady.marching import Equations
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed
from jaxhb.train.varying import at_speed

# Neighbouring speeds, over that of the search, from whose motions marches begin
NEIGHBOURS = (0.9, 0.95, 0.98, 1.02, 1.05, 1.1)
# Difference of the deflections, as a share of the largest, up to which two solutions
# are one motion
SAME = 0.01
SCATTERED = 24  # starts of marches at random states
# How far off these are at most, in shifts of the teeth from mid-gap to their flanks
FARTHEST = 2.5


@by_value
@dataclass(frozen=True)
class PeriodicMotion:
    """A periodic motion and whether the train runs in it; made by :func:`solve_all`.

    Parameters
    ----------
    response : Response, of one cycle of the excitation, or over ``period`` cycles as
    one
    period : int, in cycles of the excitation
    attracts : bool, whether disturbances die away; None where that is not decided
    (massless disks, very many disks:
        :func:`jaxhb.stability` of ``response`` raises the reason)
    stability : Stability, None where it is not decided
    """

    response: Response
    period: int
    attracts: bool | None
    stability: Stability | None

    @property
    def largest_force(self) -> float:
        """Largest tooth force of all meshes, N."""
        forces = (
            self.response.force(name).peak for name in self.response.topology.mesh_names
        )
        return float(max(forces, default=0.0))

    def __str__(self) -> str:
        span = "one cycle" if self.period == 1 else f"{self.period} cycles"
        tendency = {True: "attracts", False: "repels", None: "stability not decided"}[
            self.attracts
        ]
        if self.stability is not None:
            tendency += (
                f" ({self.stability.loses_by or 'stable'}, multiplier"
                f" {self.stability.largest:.3g})"
            )
        return (
            f"period of {span}, largest tooth force {self.largest_force / 1e3:.4g} kN,"
            f" {tendency}"
        )


def solve_all(
    train: DriveTrain,
    *,
    rpm: float,
    harmonics: int | None = None,
    tolerance: float | None = None,
) -> tuple[PeriodicMotion, ...]:
    """The periodic motions of a drive train at one speed, as many as several searches
    find.

    Teeth that hammer allow several motions at one speed; where the train comes from
    decides in which of those that attract it runs. Marches begin with teeth on their
    drive sides, in the middle of their gaps, on the other flanks, at scattered places,
    and from the motions at neighbouring speeds; they find what attracts, over one or
    several cycles. Newton's method from many cycles and from scattered states, and the
    curve from a linear law, find motions of one cycle that repel, too.

    Arguments as in :func:`jaxhb.solve`, errors as in :func:`jaxhb.steady_state`, which
    finds in a fraction of a second what the train does; this takes minutes. The motions
    that attract come first, then those not decided, the largest tooth force first;
    there are none where none is found. That no other exists is not claimed.

    >>> motions = jaxhb.solve_all(jaxhb.load_scene("spur_pair"), rpm=2000.0)
    >>> [(motion.period, motion.attracts) for motion in motions]
    [(1, True)]
    """
    refuse_tracers("solve_all", train, rpm)
    check_speed(train, rpm)
    rpm = float(rpm)
    request = Request.of(train, harmonics, tolerance)
    (plan,) = plan_speeds(train, np.array([rpm]), request)
    solved: list[SolvedMotion] = []
    marched = _marched(train, rpm, request) if train.topology.has_law.any() else ()
    of_one_cycle = (
        SolvedMotion(response, 1) for response in searched(train, rpm, plan, request)
    )
    for motion in itertools.chain(marched, of_one_cycle):
        if not any(_same(motion, other) for other in solved):
            solved.append(motion)
    motions = [_periodic_motion(motion) for motion in solved]
    rank = (True, None, False)
    return tuple(
        sorted(
            motions,
            key=lambda motion: (rank.index(motion.attracts), -motion.largest_force),
        )
    )


def _same(motion: SolvedMotion, other: SolvedMotion) -> bool:
    """Whether two solutions are one motion."""
    if motion.period != other.period:
        return False
    deflections = motion.response.deflections
    return difference(deflections, other.response.deflections, motion.period) <= SAME


def _periodic_motion(motion: SolvedMotion) -> PeriodicMotion:
    """The PeriodicMotion of a solution."""
    decided = tendency(motion.response)
    return PeriodicMotion(
        motion.response, motion.period, decided.attracts, decided.stability
    )


def _marched(train: DriveTrain, rpm: float, request: Request) -> list[SolvedMotion]:
    """Motions to which marches come, from several starts side by side."""
    neighbour_rpm = rpm * np.array(NEIGHBOURS)
    states = Classifier(train, neighbour_rpm, request, True, Cycles()).states_from(
        list(range(len(neighbour_rpm))), {}
    )
    start_motions = _starts(train, rpm) + [
        state.motion for state in states.values() if state.motion is not None
    ]
    classifier = Classifier(
        train, np.full(len(start_motions) + 1, rpm), request, True, Cycles()
    )
    # The first begins on the drive sides.
    states = classifier.states_from(
        list(range(len(start_motions) + 1)), dict(enumerate(start_motions, 1))
    )
    return [
        SolvedMotion(state.response, state.period)
        for state in states.values()
        if state.response is not None
    ]


def _starts(train: DriveTrain, rpm: float) -> list[np.ndarray]:
    """Motions ``(2S,)`` with the teeth in the middle of their gaps, on the flanks that
    do not drive, and scattered.
    """
    try:
        linear_motion = Equations(at_speed(train, rpm)).linear_motion([rpm])
    except ValueError:  # a massless disk leaves no equation: nothing can be marched
        return []
    flank = linear_motion.flank[0]
    displacement = linear_motion.displacement[0]
    rest = displacement[:, 0].real
    power = np.abs(displacement[:, 1:]) ** 2
    # Speeds of the scattered starts in proportion to the root mean square frequency of
    # the linear motion.
    harmonics = np.arange(1, power.shape[1] + 1)
    omega = linear_motion.frequency[0] * np.sqrt(
        (harmonics**2 * power).sum() / max(power.sum(), 1e-300)
    )
    shares = np.random.default_rng(0).uniform(-FARTHEST, FARTHEST, (SCATTERED, 2))
    shares = np.concatenate([[[0.0, 0.0], [-1.0, 0.0]], shares])
    return [
        np.concatenate([rest + position * flank, speed * omega * flank])
        for position, speed in shares
    ]


def searched(
    train: DriveTrain, rpm: float, plan: Plan, request: Request
) -> Iterator[Response]:
    """Yield the Responses of the motions of one cycle that searches find, some more
    than once; each has the path that led to it.
    """
    attempts = starts.Attempts(starts.SolveCase(train, rpm, request, plan))
    if not train.topology.has_law.any():
        yield from _attempted(attempts, starts.in_contact(attempts))
        return
    # Teeth that the linear motion holds on a flank another motion may separate.
    attempts.reached = starts.Reached(all_active(train, plan, request))
    swept = SweptTrain.of(train, plan, dataclasses.replace(request, harmonics=None))
    if swept is None:
        yield from _attempted(attempts, starts.in_contact(attempts))
        yield from _attempted(attempts, starts.from_sweeps(attempts))
    else:
        search = OrbitSearch(swept, rpm)
        for response in search.motions():
            if request.harmonics is None:
                yield response
            else:
                from_response = starts.from_response(response, attempts)
                yield from _attempted(attempts, from_response, response.path)
        attempts.reached = dataclasses.replace(
            attempts.reached, sweep_change=search.sweep_change
        )
    yield from _attempted(attempts, starts.shooting(attempts))


def _attempted(
    attempts: starts.Attempts, further: Iterable[starts.Attempt], path: Sequence = ()
) -> Iterator[Response]:
    """Yield the Responses of all further attempts that Newton's method solves, after
    the events of a path.
    """
    case = attempts.case
    for attempt in further:
        attempts.path = list(path)
        attempts.refine(attempt)
        reached = attempts.reached
        # In contact: other motions, if there are any, need all meshes unknown.
        if not reached.plan.active:
            every_mesh = all_active(case.train, reached.plan, case.request)
            attempts.reached = dataclasses.replace(reached, plan=every_mesh)
        if attempts.response.solved:
            yield attempts.response
