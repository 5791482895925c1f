"""Newton's method on the map of a sweep, on the host: corrections by GCR, products by
differences of one program.
"""

import numpy as np

from jaxhb.balance.sweeps import (
    UNSETTLED,
    Settled,
    SweepEquation,
    SweepPlan,
    SweepPoint,
    marched_program,
    sweep_program,
)
from jaxhb.equations import fourier
from jaxhb.equations.iterations import gcr_on_host

FORCING = 0.03  # share of what is unclosed that a correction may leave
KRYLOV_STEPS = 60
SHORTEST = 1 / 256  # step that is tried at last
DIFFERENCE = 1e-7  # length of a difference over that of the point
# Share of what is unclosed that counts as left at least: a correction that was not
# solved for may be far too short.
NEAREST = 0.03
LENGTHS = 1.0, 0.6, 0.36, 0.2, 0.1, 0.03  # of a step on the state alone
CLOSING, CLOSING_STEPS = (
    0.01,
    30,
)  # share of what is missed that such a step may leave, and its Krylov steps at most
FAINT = 1e-9  # share of the largest visibility that a state has at least


class PackedPoint:
    """Points as real vectors of deflections: states as the meshes see them, forces over
    the stiffness.
    """

    def __init__(self, sweeps: SweepEquation, point: SweepPoint):
        visible = np.linalg.norm(np.asarray(sweeps.modes.deflections), axis=0)
        self.visibility = np.tile(visible + FAINT * visible.max(), 2)
        stiffness = np.abs(np.asarray(sweeps.equation.law.stiffness))
        self.flexibility = 1 / np.maximum(stiffness, 1.0)
        self.shape = np.shape(fourier.pack(np.asarray(point.linear)))

    def pack(self, point: SweepPoint) -> np.ndarray:
        linear = fourier.pack(np.asarray(point.linear)).ravel()
        state = np.asarray(point.state) * self.visibility
        force = np.asarray(point.force) * self.flexibility
        return np.concatenate([linear, state, force])

    def unpack(self, packed: np.ndarray) -> SweepPoint:
        deflections = self.shape[0] * self.shape[1]
        states = len(self.visibility)
        linear, state, force = np.split(packed, [deflections, deflections + states])
        unpacked = fourier.unpack(linear.reshape(self.shape))
        return SweepPoint(unpacked, state / self.visibility, force / self.flexibility)


def least_changed(
    sweeps: SweepEquation, points: list[SweepPoint], plan: SweepPlan
) -> SweepPoint:
    """The one of some points that a sweep changes least."""

    def change(point):
        packing = PackedPoint(sweeps, point)
        following, _ = sweep_program(sweeps, point, plan=plan)
        return np.linalg.norm(packing.pack(following) - packing.pack(point))

    return min(points, key=change)


def solve_map(
    sweeps: SweepEquation,
    point: SweepPoint,
    plan: SweepPlan,
    *,
    goal: float,
    most_marches: int = 400,
) -> Settled:
    """Newton's method from a point until ``goal`` of the vibration or less is left to
    the fixed point, as long as steps lead closer.

    What is left is told from how far the last correction led for what it closed: beside
    a bifurcation a cycle that nearly closes may be far from one that does.
    """
    packing = PackedPoint(sweeps, point)
    marches = 0

    def left_at(packed):
        nonlocal marches
        marches += 1
        following, deflection = sweep_program(sweeps, packing.unpack(packed), plan=plan)
        return packed - packing.pack(following), np.asarray(deflection)

    def correction(packed, left):
        def apply(direction):
            short = DIFFERENCE * np.linalg.norm(packed) / np.linalg.norm(direction)
            return (left_at(packed + short * direction)[0] - left) / short

        return gcr_on_host(apply, -left, tolerance=FORCING, steps=KRYLOV_STEPS)

    packed = packing.pack(point)
    unclosed, deflection = left_at(packed)
    backlash = np.max(np.asarray(sweeps.equation.law.backlash))
    scale = np.linalg.norm(fourier.pack(deflection)[:, 1:]) + 1e-8 * backlash
    size = np.linalg.norm(unclosed)
    left, distance, closer = UNSETTLED * deflection, UNSETTLED * scale, True
    while closer and distance > goal * scale and marches < most_marches:
        change = correction(packed, unclosed)
        length = 1.0
        closer = False
        while not closer and length >= SHORTEST:
            after, moved = left_at(packed + length * change)
            share = np.linalg.norm(after) / size
            closer = bool(share < 1 - length / 4)
            if closer:
                packed, unclosed, size = packed + length * change, after, share * size
                # A whole correction closed all but a share: as much of it is what the
                # next one will change.
                left = (moved - deflection) * share / length
                distance = max(np.linalg.norm(change) * share, NEAREST * size)
                deflection = moved
            length /= 2
    ended = packing.unpack(packed), deflection, np.array(marches)
    return Settled(*ended, size / scale, left, distance / scale)


def close_cycle(
    sweeps: SweepEquation,
    point: SweepPoint,
    plan: SweepPlan,
    *,
    tolerance: float,
    most: int = 15,
):
    """Newton's method on state and force of a point alone, under its linear motion,
    until the cycle closes to ``tolerance`` of them: the point, by how much its cycle
    misses, and marches taken.

    A search, for points far from any motion: of several lengths of a step the one is
    taken that closes best, whether or not the cycle closed better before.
    """
    packing = PackedPoint(sweeps, point)
    states, marches = len(packing.visibility), 0

    def at(packed):
        state = packed[:states] / packing.visibility
        force = packed[states:] / packing.flexibility
        return SweepPoint(point.linear, state, force)

    def missed(packed):
        nonlocal marches
        marches += 1
        end, _ = marched_program(sweeps, at(packed), plan=plan)
        return packing.pack(end)[-len(packed) :] - packed

    packed = packing.pack(point)[-states - len(packing.flexibility) :]
    left = missed(packed)
    for _ in range(most):
        size = np.linalg.norm(packed)
        if not np.linalg.norm(left) > tolerance * size:
            break

        def apply(direction, packed=packed, left=left, size=size):
            short = DIFFERENCE * size / np.linalg.norm(direction)
            return (missed(packed + short * direction) - left) / short

        change = gcr_on_host(apply, -left, tolerance=CLOSING, steps=CLOSING_STEPS)
        trials = [(length, missed(packed + length * change)) for length in LENGTHS]
        length, left = min(
            trials,
            key=lambda trial: np.nan_to_num(np.linalg.norm(trial[1]), nan=np.inf),
        )
        packed = packed + length * change
    return at(packed), float(np.linalg.norm(left) / np.linalg.norm(packed)), marches
