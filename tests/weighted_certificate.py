"""The certificate of method.md A4.5 as it stands there, with dense matrices: one mass, one mesh, weighted norm."""

import numpy as np

from jaxhb.equations import fourier

SAMPLES = 2**14
FAR = 200_000
"""Harmonic up to which receptances are looked at."""


def weighted_certificate(deflection, outer, nu, *, m, b, c, eps, h, q0, q1, transition=0.2):
    """Y0, M3, Z1, Z2, h0, r and the factor E from the weighted norm to the largest value.

    ``deflection`` ``(N+1,)`` in backlashes; ``outer``: harmonics N3 to which the derivative is evaluated; ``nu``: where
    the weights begin to rise; lengths in backlashes.
    """
    inner = len(deflection) - 1
    value = fourier.synthesize(deflection, SAMPLES)
    u = np.clip(np.abs(value) - (1 - transition) / 2, 0, transition)
    beyond = np.maximum(np.abs(value) - (1 + transition) / 2, 0)
    force = eps * value + np.sign(value) * (1 - eps) * (u**2 / (2 * transition) + beyond)
    slope = eps + (1 - eps) * u / transition
    middle, half = (slope.max() + slope.min()) / 2, (slope.max() - slope.min()) / 2
    psi, share = (fourier.analyze(values - middle * by, 4 * outer) for values, by in ((force, value), (slope, 1)))

    def two_sided(a):
        return np.concatenate([np.conj(a[outer:0:-1]), a[: outer + 1]])

    def gain(n):
        return c / (-m * n**2 + 1j * b * n + middle * c)

    def weight(n):
        return np.sqrt(1 + (n / nu) ** 2)

    n = np.arange(-outer, outer + 1)
    load = two_sided(fourier.resize(np.array([q0, q1 / 2 + 0j]), outer)) / (c * h)
    F = two_sided(fourier.resize(deflection, outer)) - gain(n) * (load - two_sided(psi))
    lags = n[:, None] - n
    dF = np.eye(len(n)) + gain(n)[:, None] * np.where(lags >= 0, share[abs(lags)], np.conj(share[abs(lags)]))
    block = np.ix_(abs(n) <= inner, abs(n) <= inner)
    A = np.eye(len(n), dtype=complex)
    A[block] = np.linalg.inv(dF[block])
    w, far = weight(n), np.arange(outer + 1, FAR)
    near = abs(n) <= inner
    alpha = np.linalg.norm((w[:, None] * A * gain(n))[block], 2)
    middle_gain = (w * abs(gain(n)))[~near].max()
    tail = (weight(far) * abs(gain(far))).max()
    left = np.sqrt(2 * np.sum(abs(psi[outer + 1 :]) ** 2))
    E = np.sqrt(np.pi * nu / np.tanh(np.pi * nu))
    Y0 = np.hypot(np.linalg.norm(w * (A @ F)), tail * left)
    M3 = np.linalg.norm(w[:, None] * (np.eye(len(n)) - A @ dF) / w, 2)
    Z1 = np.hypot(M3 + max(alpha, middle_gain) * half / weight(outer + 1), tail * half)
    Z2 = max(alpha, middle_gain, tail) * (1 - eps) / transition * E
    r = 2 * Y0 / ((1 - Z1) + np.sqrt((1 - Z1) ** 2 - 2 * Z2 * Y0))
    return {"Y0": Y0, "M3": M3, "Z1": Z1, "Z2": Z2, "h0": Z2 * Y0 / (1 - Z1) ** 2, "r": r, "E": E}
