"""A chain with one backlash link: the task that public harmonic-balance codes are
compared on, with two numpy floors.

Needs numpy alone: :mod:`peer_codes` runs it in an environment without JAX.
``data/chain_backlash_task.json`` has the definition, and what the codes took on another
machine. Masses of 1, links of stiffness 1, damping 0.02 at each mass, a ground spring
of 0.1 at the last one, a force ``0.3 + 0.25 cos(w t)`` on the first; the link in the
middle has the backlash law (18) with h = 1. All in consistent units.
"""

import json
from pathlib import Path

import numpy as np

HARMONICS = 15
SAMPLES = 240
DAMPING = 0.02
GROUND = 0.1
MEAN = 0.3
SWING = 0.25
CONTACT = 1.0
GAP = 0.05
BACKLASH = 1.0
TRANSITION = 0.2
SWEEP = np.linspace(1.30, 0.93, 100)
RESIDUAL = 1e-8


def published():
    """The task file: definition, known points and times of other codes."""
    return json.loads(
        (Path(__file__).parent / "data" / "chain_backlash_task.json").read_text()
    )


def middle(masses):
    """First mass of the backlash link."""
    return (masses - 1) // 2


def chain_matrices(masses, link=0.0):
    """Mass, damping and stiffness ``(S, S)``; ``link`` is the stiffness of the backlash
    link, 0 to leave it out.
    """
    stiffness = np.zeros((masses, masses))
    for m in range(masses - 1):
        k = link if m == middle(masses) else 1.0
        stiffness[m : m + 2, m : m + 2] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    stiffness[-1, -1] += GROUND
    return np.eye(masses), DAMPING * np.eye(masses), stiffness


def law(l):
    """Force and its slope at the deflections ``l``: law (18)."""
    distance = np.abs(l)
    step = CONTACT - GAP
    u = np.clip(distance - (1 - TRANSITION) * BACKLASH / 2, 0.0, TRANSITION * BACKLASH)
    v = np.maximum(distance - (1 + TRANSITION) * BACKLASH / 2, 0.0)
    width = 2 * TRANSITION * BACKLASH
    return GAP * l + np.sign(l) * step * (u * u / width + v), GAP + 2 * step * u / width


def fourier_matrices():
    """Synthesis ``(samples, 2N+1)`` from [mean, cosines, sines] and analysis ``(2N+1,
    samples)``.
    """
    angle = (
        2 * np.pi * np.outer(np.arange(SAMPLES), np.arange(1, HARMONICS + 1)) / SAMPLES
    )
    synthesis = np.hstack([np.ones((SAMPLES, 1)), np.cos(angle), np.sin(angle)])
    analysis = synthesis.T * (2.0 / SAMPLES)
    analysis[0] /= 2
    return synthesis, analysis


SYNTHESIS, ANALYSIS = fourier_matrices()


def extremes(coefficients):
    """Least and largest deflection of the link, from its [mean, cosines, sines]."""
    angle = 2 * np.pi * np.outer(np.arange(4096), np.arange(1, HARMONICS + 1)) / 4096
    values = (
        coefficients[0] + np.hstack([np.cos(angle), np.sin(angle)]) @ coefficients[1:]
    )
    return float(values.min()), float(values.max())


def _real(blocks):
    """``(N+1, ...)`` complex matrices of the harmonics as one on [mean, cosines, sines]
    of every mass.
    """
    count, size = blocks.shape[:2]
    whole = np.zeros((2 * count - 1, size, 2 * count - 1, size))
    whole[0, :, 0] = blocks[0].real
    cosine = np.arange(1, count)
    sine = cosine + count - 1
    whole[cosine, :, cosine] = whole[sine, :, sine] = blocks[1:].real
    whole[cosine, :, sine], whole[sine, :, cosine] = blocks[1:].imag, -blocks[1:].imag
    return whole.reshape((2 * count - 1) * size, -1)


def dynamic_stiffness(masses, w, link):
    """``Z(n) = K - (n w)^2 M + i n w C``, ``(N+1, S, S)``."""
    mass, damping, stiffness = chain_matrices(masses, link)
    n = np.arange(HARMONICS + 1)[:, None, None] * w
    return stiffness - n**2 * mass + 1j * n * damping


def _newton(x, step):
    """Full Newton steps until the norm of the residual is small."""
    for _ in range(50):
        residual, change = step(x)
        if np.linalg.norm(residual) < RESIDUAL:
            return x
        x = x - change()
    raise RuntimeError("Newton's method did not converge")


def full_sweep(masses, speeds):
    """All masses as unknowns, dense Newton, each speed from the one before; the link's
    coefficients per speed.
    """
    link = np.zeros(masses)
    link[middle(masses) : middle(masses) + 2] = 1.0, -1.0
    down, up = np.kron(SYNTHESIS, link), np.kron(ANALYSIS, link[:, None])
    load = np.zeros((2 * HARMONICS + 1, masses))
    load[0, 0], load[1, 0] = MEAN, SWING
    load, found = load.ravel(), []
    x = np.linalg.solve(_real(dynamic_stiffness(masses, speeds[0], CONTACT)), load)
    for w in speeds:
        linear = _real(dynamic_stiffness(masses, w, 0.0))

        def step(x, linear=linear):
            force, slope = law(down @ x)
            residual = linear @ x + up @ force - load
            return residual, lambda: np.linalg.solve(
                linear + up @ (slope[:, None] * down), residual
            )

        x = _newton(x, step)
        found.append(x.reshape(-1, masses) @ link)
    return np.array(found)


def condensed_sweep(masses, speeds):
    """The deflection of the link as the only unknown, everything linear condensed; each
    speed from the one before.
    """
    link = np.zeros(masses)
    push = np.zeros((HARMONICS + 1, masses))
    link[middle(masses) : middle(masses) + 2] = 1.0, -1.0
    push[0, 0], push[1, 0] = MEAN, SWING
    right = np.stack([np.broadcast_to(link, push.shape), push], axis=-1)
    x, found = None, []
    for w in speeds:
        answer = link @ np.linalg.solve(dynamic_stiffness(masses, w, CONTACT), right)
        receptance = _real(answer[:, 0][:, None, None])
        linear = np.concatenate([answer[:, 1].real, -answer[1:, 1].imag])

        def step(x, receptance=receptance, linear=linear):
            l = SYNTHESIS @ x
            force, slope = law(l)
            residual = x - linear + receptance @ (ANALYSIS @ (force - CONTACT * l))
            matrix = (
                np.eye(x.size) + receptance @ (ANALYSIS * (slope - CONTACT)) @ SYNTHESIS
            )
            return residual, lambda: np.linalg.solve(matrix, residual)

        x = _newton(linear if x is None else x, step)
        found.append(x)
    return np.array(found)
