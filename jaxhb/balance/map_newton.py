"""Newton's method on the map of a sweep, on the host: corrections by GCR, products by differences of one program."""

from dataclasses import dataclass

import numpy as np

from jaxhb.balance.sweeps import SweepEquation, SweepPlan, SweepPoint, unclosed_program
from jaxhb.equations import fourier

FORCING = 0.03  # share of what is unclosed that a correction may leave
KRYLOV_STEPS = 60
SHORTEST = 1 / 256  # step that is tried at last
DIFFERENCE = 1e-7  # length of a difference over that of the point
FAINT = 1e-9  # share of the largest visibility that a state has at least


@dataclass(frozen=True)
class MapSolution:
    """Point; deflection ``(G, N+1)`` m; left, size of what is unclosed over that of the vibration; marches."""

    point: SweepPoint
    deflection: np.ndarray
    left: float
    marches: int


class PackedPoint:
    """Points as real vectors of deflections: states as the meshes see them, forces over the stiffness."""

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


def solve_map(
    sweeps: SweepEquation, point: SweepPoint, plan: SweepPlan, *, goal: float, most_marches: int = 400
) -> MapSolution:
    """Newton's method from a point until ``goal`` of the vibration is unclosed, as long as steps lead closer."""
    packing = PackedPoint(sweeps, point)
    marches = 0

    def left_at(packed):
        nonlocal marches
        marches += 1
        left, deflection = unclosed_program(sweeps, packing.unpack(packed), plan=plan)
        return packing.pack(left), np.asarray(deflection)

    def correction(packed, left):
        size = np.linalg.norm(left)
        images, directions = np.zeros((0, len(left))), np.zeros((0, len(left)))
        change, remaining = np.zeros_like(left), -left
        while len(images) < KRYLOV_STEPS and np.linalg.norm(remaining) > FORCING * size:
            direction = remaining
            short = DIFFERENCE * np.linalg.norm(packed) / np.linalg.norm(direction)
            image = (left_at(packed + short * direction)[0] - left) / short
            for _ in range(2):  # twice: orthogonal to rounding
                shares = images @ image
                image = image - shares @ images
                direction = direction - shares @ directions
            length = np.linalg.norm(image)
            images = np.vstack([images, image / length])
            directions = np.vstack([directions, direction / length])
            share = images[-1] @ remaining
            change = change + share * directions[-1]
            remaining = remaining - share * images[-1]
        return change

    packed = packing.pack(point)
    left, deflection = left_at(packed)
    backlash = np.max(np.asarray(sweeps.equation.law.backlash))
    scale = np.linalg.norm(fourier.pack(deflection)[:, 1:]) + 1e-8 * backlash
    while np.linalg.norm(left) > goal * scale and marches < most_marches:
        change = correction(packed, left)
        length = 1.0
        after, moved = left_at(packed + change)
        while not np.linalg.norm(after) < (1 - length / 4) * np.linalg.norm(left):
            length /= 2
            if length < SHORTEST:
                return MapSolution(packing.unpack(packed), deflection, np.linalg.norm(left) / scale, marches)
            after, moved = left_at(packed + length * change)
        packed, left, deflection = packed + length * change, after, moved
    return MapSolution(packing.unpack(packed), deflection, np.linalg.norm(left) / scale, marches)
