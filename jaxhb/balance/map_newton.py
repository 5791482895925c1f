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

FORCING = 0.03  # share of the unclosed part that a correction may leave
KRYLOV_STEPS = 60
SHORTEST = 1 / 256  # length of a step that is tried last
DIFFERENCE = 1e-7  # length of a difference over that of the point
# Share of the unclosed part that counts as left at least: a correction that was not
# solved for may be far too short.
NEAREST = 0.03
LENGTHS = 1.0, 0.6, 0.36, 0.2, 0.1, 0.03  # of a step on the state alone
# Share of the miss that such a step may leave, and its Krylov steps at most
CLOSING = 0.01
CLOSING_STEPS = 30
FAINT = 1e-9  # share of the largest visibility that a state has at least


class PackedPoint:
    """Packing of points as real vectors of deflections in m: states as the meshes see
    them, forces over the stiffness.
    """

    def __init__(self, sweeps: SweepEquation, point: SweepPoint):
        visible = np.linalg.norm(np.asarray(sweeps.modes.deflections), axis=0)
        self.visibility = np.tile(visible + FAINT * visible.max(), 2)
        stiffness = np.abs(np.asarray(sweeps.equation.law.stiffness))
        self.flexibility = 1 / np.maximum(stiffness, 1.0)
        self.shape = np.shape(fourier.pack(np.asarray(point.linear)))

    def pack(self, point: SweepPoint) -> np.ndarray:
        """Real vector of a point."""
        linear = fourier.pack(np.asarray(point.linear)).ravel()
        state = np.asarray(point.state) * self.visibility
        force = np.asarray(point.force) * self.flexibility
        return np.concatenate([linear, state, force])

    def unpack(self, packed: np.ndarray) -> SweepPoint:
        """Point of a real vector."""
        deflections = self.shape[0] * self.shape[1]
        states = len(self.visibility)
        linear, state, force = np.split(packed, [deflections, deflections + states])
        unpacked = fourier.unpack(linear.reshape(self.shape))
        return SweepPoint(unpacked, state / self.visibility, force / self.flexibility)


def least_changed(
    sweeps: SweepEquation, points: list[SweepPoint], plan: SweepPlan
) -> SweepPoint:
    """The point among several that a sweep changes least."""

    def change(point: SweepPoint) -> float:
        packing = PackedPoint(sweeps, point)
        following, _ = sweep_program(sweeps, point, plan=plan)
        return float(np.linalg.norm(packing.pack(following) - packing.pack(point)))

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

    The distance is estimated from the length of the last correction and the part that
    it closed: beside a bifurcation a cycle that nearly closes may be far from one that
    does.
    """
    packing = PackedPoint(sweeps, point)
    marches = 0

    def unclosed_at(packed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nonlocal marches
        marches += 1
        following, deflection = sweep_program(sweeps, packing.unpack(packed), plan=plan)
        return packed - packing.pack(following), np.asarray(deflection)

    def correction(packed: np.ndarray, unclosed: np.ndarray) -> np.ndarray:
        def apply(direction: np.ndarray) -> np.ndarray:
            step = DIFFERENCE * np.linalg.norm(packed) / np.linalg.norm(direction)
            return (unclosed_at(packed + step * direction)[0] - unclosed) / step

        return gcr_on_host(apply, -unclosed, tolerance=FORCING, steps=KRYLOV_STEPS)

    packed = packing.pack(point)
    unclosed, deflection = unclosed_at(packed)
    backlash = np.max(np.asarray(sweeps.equation.law.backlash))
    scale = np.linalg.norm(fourier.pack(deflection)[:, 1:]) + 1e-8 * backlash
    size = np.linalg.norm(unclosed)
    left = UNSETTLED * deflection
    distance = UNSETTLED * scale
    closer = True
    while closer and distance > goal * scale and marches < most_marches:
        change = correction(packed, unclosed)
        length = 1.0
        closer = False
        while not closer and length >= SHORTEST:
            unclosed_after, deflection_after = unclosed_at(packed + length * change)
            share = np.linalg.norm(unclosed_after) / size
            closer = bool(share < 1 - length / 4)
            if closer:
                packed = packed + length * change
                unclosed = unclosed_after
                size = share * size
                # A whole correction closed all but a share: the next one will change
                # about as large a share of it.
                left = (deflection_after - deflection) * share / length
                distance = max(np.linalg.norm(change) * share, NEAREST * size)
                deflection = deflection_after
            length /= 2
    return Settled(
        point=packing.unpack(packed),
        deflection=deflection,
        marches=np.array(marches),
        change=size / scale,
        left=left,
        distance=distance / scale,
    )


def close_cycle(
    sweeps: SweepEquation,
    point: SweepPoint,
    plan: SweepPlan,
    *,
    tolerance: float,
    most: int = 15,
) -> tuple[SweepPoint, float, int]:
    """Newton's method on state and force of a point alone, under its linear motion,
    until the cycle closes to ``tolerance`` of them: the point, the miss of its cycle
    relative to them, and marches taken.

    A search, for points far from any motion: the best closing length of a step is
    taken, whether or not the cycle closed better before.
    """
    packing = PackedPoint(sweeps, point)
    states = len(packing.visibility)
    marches = 0

    def point_from(packed: np.ndarray) -> SweepPoint:
        state = packed[:states] / packing.visibility
        force = packed[states:] / packing.flexibility
        return SweepPoint(point.linear, state, force)

    def miss_of(packed: np.ndarray) -> np.ndarray:
        nonlocal marches
        marches += 1
        end, _ = marched_program(sweeps, point_from(packed), plan=plan)
        return packing.pack(end)[-len(packed) :] - packed

    packed = packing.pack(point)[-states - len(packing.flexibility) :]
    miss = miss_of(packed)
    for _ in range(most):
        size = float(np.linalg.norm(packed))
        if not np.linalg.norm(miss) > tolerance * size:
            break

        def apply(
            direction: np.ndarray,
            packed: np.ndarray = packed,
            miss: np.ndarray = miss,
            size: float = size,
        ) -> np.ndarray:
            step = DIFFERENCE * size / np.linalg.norm(direction)
            return (miss_of(packed + step * direction) - miss) / step

        change = gcr_on_host(apply, -miss, tolerance=CLOSING, steps=CLOSING_STEPS)
        trials = [(length, miss_of(packed + length * change)) for length in LENGTHS]
        length, miss = min(
            trials,
            key=lambda trial: np.nan_to_num(np.linalg.norm(trial[1]), nan=np.inf),
        )
        packed = packed + length * change
    return (
        point_from(packed),
        float(np.linalg.norm(miss) / np.linalg.norm(packed)),
        marches,
    )
