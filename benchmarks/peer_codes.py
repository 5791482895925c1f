"""Other people's harmonic-balance codes on the task of :mod:`chain_task`; prints one
JSON line.

    python benchmarks/peer_codes.py pyHarm 10 100

Run by :mod:`peers` with the interpreter of the environment that has them, since
pyHarm-os needs an older JAX than jaxhb. Seconds are those of the sweep alone: one of
five speeds comes first and takes the compilation.
"""

import json
import logging
import sys
import time
from importlib import metadata

import numpy as np
from chain_task import (
    BACKLASH,
    CONTACT,
    GAP,
    HARMONICS,
    MEAN,
    RESIDUAL,
    SAMPLES,
    SWEEP,
    SWING,
    TRANSITION,
    chain_matrices,
    law,
    middle,
)


def backlash_element():
    """An element of pyHarm with law (18), written like its own penalty elements."""
    from numba import njit
    from pyHarm.Elements.NodeToNodeElements.NodeToNodeElement import NodeToNodeElement

    gap, step = GAP, CONTACT - GAP
    low, width = (1 - TRANSITION) * BACKLASH / 2, TRANSITION * BACKLASH

    @njit
    def residual(x, apart, synthesis, analysis):
        l = (apart @ x) @ synthesis
        distance = np.abs(l)
        u = np.minimum(np.maximum(distance - low, 0.0), width)
        v = np.maximum(distance - low - width, 0.0)
        force = gap * l + np.sign(l) * step * (u * u / (2 * width) + v)
        return apart.T @ (force @ analysis)

    @njit
    def jacobian(x, apart, synthesis, analysis):
        l = (apart @ x) @ synthesis
        slope = gap + step * np.minimum(np.maximum(np.abs(l) - low, 0.0), width) / width
        return apart.T @ ((synthesis * slope) @ analysis).T @ apart

    class BacklashLink(NodeToNodeElement):
        factory_keyword = "BacklashLink"

        def __flag_update__(self):
            self.flag_nonlinear = True
            self.flag_AFT = True

        def generateIndices(self, expl_dofs):
            super().generateIndices(expl_dofs)
            self.apart = np.ascontiguousarray(
                self.Pdir[0] @ (self.Pslave - self.Pmaster)
            )

        def adim(self, lc, wc):
            raise NotImplementedError

        def evalResidual(self, xg, om):
            self.R = residual(xg[self.indices], self.apart, self.D["ft"], self.D["tf"])
            return self.R

        def evalJacobian(self, xg, om):
            x = xg[self.indices]
            self.J = jacobian(x, self.apart, self.D["ft"], self.D["tf"])
            self.dJdom = np.zeros_like(x)
            return self.J, self.dJdom

    return BacklashLink


def pyharm_sweep(masses, speeds, reductors):
    """The link's coefficients ``(speeds, 2N+1)`` and seconds: previous solution as
    predictor, constant step, Newton.
    """
    from pyHarm.Maestro import Maestro

    mass, damping, stiffness = chain_matrices(masses)
    step = float(speeds[0] - speeds[1])
    first = middle(masses)
    forcing = {"connect": {"chain": [0]}, "dirs": [0], "type": "GOForcing", "dto": 0}
    study = {
        "study": "frf",
        "solver": "NewtonRaphson",
        "solver_options": {"tol_residual": RESIDUAL, "tol_delta_x": 1e-6},
        "predictor": "previous",
        "predictor_options": {"bifurcation_detect": False, "verbose": False},
        "corrector": "nocontinuation",
        "stepsizer": "constant",
        "reductors": reductors,
        "ds_max": 1.0,
        "ds_min": 1e-8,
        "ds0": step,
        "sign_ds": -1,
        "puls_inf": float(speeds[-1]) + step / 2,
        "puls_sup": float(speeds[0]) + step / 2,
        "puls_start": float(speeds[0]),
        "verbose": False,
    }
    task = Maestro(
        {
            "plugin": [backlash_element()],
            "system": {"type": "Base", "nh": HARMONICS, "nti": SAMPLES},
            "substructures": {
                "chain": {
                    "matrix": {"M": mass, "C": damping, "K": stiffness},
                    "ndofs": 1,
                }
            },
            "connectors": {
                "link": {
                    "type": "BacklashLink",
                    "connect": [("chain", [first]), ("chain", [first + 1])],
                    "dirs": [0],
                },
                "mean": {**forcing, "ho": 0, "amp": MEAN},
                "swing": {**forcing, "ho": 1, "amp": SWING},
            },
            "analysis": {"sweep": study},
        }
    )
    logging.disable(logging.CRITICAL)
    begin = time.perf_counter()
    task.operate()
    seconds = time.perf_counter() - begin
    solved = task.nls["sweep"].SolList
    if len(solved) != len(speeds) or not all(s.flag_accepted for s in solved):
        raise RuntimeError(
            f"{len(solved)} points, {sum(s.flag_accepted for s in solved)} of them"
            " accepted"
        )
    states = np.array([s.x[:-1] for s in solved]).reshape(
        len(solved), 2 * HARMONICS + 1, masses
    )
    link = states[..., first] - states[..., first + 1]
    return np.concatenate([link[:, :1], link[:, 1::2], link[:, 2::2]], axis=1), seconds


def harmonicbalance_sweep(masses, speeds):
    """The same by ``fouriersolve_ode`` on displacements and velocities, its Jacobian by
    finite differences.
    """
    from harmonicbalance.fourier import Fourier
    from harmonicbalance.solvers import fouriersolve_ode

    _, _, stiffness = chain_matrices(masses)
    damping = chain_matrices(masses)[1][0, 0]
    first = middle(masses)

    def slopes(states, push):
        x = states[:masses]
        v = states[masses:]
        force = (x[first] - x[first + 1]).nonlinearity(lambda l: law(l)[0])
        rates = []
        for s in range(masses):
            total = -damping * v[s]
            for near in range(max(s - 1, 0), min(s + 2, masses)):
                if stiffness[s, near]:
                    total = total - stiffness[s, near] * x[near]
            if s == first:
                total = total - force
            if s == first + 1:
                total = total + force
            rates.append(total + push if s == 0 else total)
        return [*v, *rates]

    found = []
    start = None
    begin = time.perf_counter()
    for w in speeds:
        push = Fourier(omega=w, n=HARMONICS)
        push[0], push[1] = MEAN, SWING
        if start is None:
            start = _in_contact(masses, w)
        states = [Fourier.from_coeffs(c, w) for c in start]
        states, solution = fouriersolve_ode(
            lambda s, push=push: slopes(s, push), states, method="hybr", tol=RESIDUAL
        )
        if not solution.success:
            raise RuntimeError(f"not solved at {w}: {solution.message}")
        start = [s.coeffs() for s in states]
        found.append(start[first] - start[first + 1])
    return np.array(found), time.perf_counter() - begin


def _in_contact(masses, w):
    """[mean, cosines, sines] of displacements and velocities with the link in
    contact.
    """
    from chain_task import dynamic_stiffness

    z = dynamic_stiffness(masses, w, CONTACT)
    push = np.zeros((HARMONICS + 1, masses, 1))
    push[0, 0], push[1, 0] = MEAN, SWING
    x = np.linalg.solve(z, push)[..., 0].T
    both = np.concatenate([x, 1j * np.arange(HARMONICS + 1) * w * x])
    return np.concatenate([both.real, -both.imag[:, 1:]], axis=1)


CODES = {
    "pyHarm-os": (
        "pyHarm-os",
        lambda s, w: pyharm_sweep(s, w, [{"type": "noreductor"}]),
    ),
    "pyHarm-os, NLdofs": (
        "pyHarm-os",
        lambda s, w: pyharm_sweep(s, w, [{"type": "NLdofs"}]),
    ),
    "harmonicbalance": ("harmonicbalance", harmonicbalance_sweep),
}


def main():
    """``CODE MASSES COUNT``: the first COUNT speeds of the sweep."""
    name = sys.argv[1]
    masses = int(sys.argv[2])
    count = int(sys.argv[3])
    package, sweep = CODES[name]
    begin = time.perf_counter()
    if package == "pyHarm-os":
        sweep(masses, SWEEP[:5])
    prepared = time.perf_counter() - begin
    link, seconds = sweep(masses, SWEEP[:count])
    versions = {p: metadata.version(p) for p in (package, "numpy", "scipy")}
    answer = {
        "link": link.tolist(),
        "seconds": seconds,
        "first": prepared,
        "versions": versions,
    }
    print("\n" + json.dumps(answer))


if __name__ == "__main__":
    main()
