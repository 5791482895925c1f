"""How fast Galerkin's method converges: motion, tooth force and tooth stiffness against the number of harmonics.

Where teeth pass the knots of their law the slope of the stiffness jumps, so that coefficients fall (docs/theory A6) as
``c ~ n^-2``, ``f ~ n^-3``, ``x ~ n^-5`` of disks that carry the mesh, and ``n^-7`` one shaft further. What a series
with N harmonics omits of ``n^-p`` has the root mean square ``~ N^-(p - 1/2)``. The harmonics that it keeps are wrong by
``~ N^-6``, the product of what is missing of x with c; one shaft further that is more than what is missing there.
Errors are root mean squares over the cycle, against FINE harmonics; the mean angles, a convention, are left out.

Newton's method on the truncated equations is that of certificates, with exact integrals: all numbers of harmonics then
have one program. That it solves the equations of ``jaxhb.solve`` stands in ``test_certificate.py``.
"""

import dense
import jax
import numpy as np
import pytest
from reference_data import method_case
from trains import ONE_RADIAN_PER_SECOND, build, one_mass_parts

import jaxhb
from jaxhb import Disk, Ground, Mesh, Shaft, Torque
from jaxhb.balance.problem import problem_at
from jaxhb.certificate import certificate
from jaxhb.certificate.linearization import Linearization
from jaxhb.equations import backlash, fourier
from jaxhb.equations.residual import backlash_meshes

pytestmark = pytest.mark.oracle

LEVELS, FINE = (12, 17, 24, 34, 48, 68, 96), 256
SAMPLES = 2**14
"""Of force and stiffness: what aliases is what their coefficients are at this harmonic, 1e-8 of the stiffness."""

RATES = {"deflection": 4.5, "law": 4.5, "touching": 4.5, "far": 6.25, "force": 2.5, "stiffness": 1.5}
"""``touching``, ``far``: angles of a disk with a mesh and of one a shaft further; ``law``: the force of the law at the
computed deflection, as wrong as that; ``force``, ``stiffness``: their series of N harmonics. ``far`` lies between its
two parts, which fall as 6 and 6.5."""

WITHIN = 0.3
"""On a slope over three octaves: the coefficients of several crossings beat, so that an error lies up to 1.5 times
above or below its trend; both ends together change the slope by 0.4 at most, in a fit of seven about half of that."""

LAW = {"stiffness": 4.0, "epsilon": 0.05, "transition": 0.2, "backlash": 0.4}


def one_mass():
    return one_mass_parts(transition=0.2, **{k: float(v) for k, v in method_case("A4_hb_one_mass_N4")[0].items()})


def chain():
    """Three masses in a row, one mesh."""
    return [
        Disk(name="far", inertia=1.5, damping=0.3),
        Disk(name="a", inertia=1.0, radius=1.0, damping=0.3),
        Disk(name="b", inertia=1.0, radius=1.0, damping=0.3),
        Shaft(between=("far", "a"), stiffness=3.0),
        Mesh(between=("a", "b"), **LAW),
        Ground(disk="far", stiffness=0.5),
        Torque(disk="a", mean=0.1, harmonics=((1.0, 1.5, 0.3), (2.0, 0.4, 0.0))),
        Torque(disk="b", mean=-0.1, harmonics=((1.0, -0.6, 0.0),)),
    ]


def branched():
    """A gear between two others, a disk behind one of them."""
    return [
        Disk(name="a", inertia=1.0, radius=1.0, damping=0.4),
        Disk(name="b", inertia=0.7, radius=0.8, damping=0.3),
        Disk(name="c", inertia=0.9, radius=1.2, damping=0.3),
        Disk(name="far", inertia=1.2, damping=0.3),
        Mesh(between=("a", "b"), **LAW),
        Mesh(between=("a", "c"), **(LAW | {"stiffness": 3.0})),
        Shaft(between=("c", "far"), stiffness=2.0),
        Ground(disk="a", stiffness=0.5),
        Torque(disk="a", mean=0.3, harmonics=((1.0, 1.5, 0.0), (2.0, 0.0, 0.5))),
        Torque(disk="b", mean=-0.1, harmonics=((1.0, -0.8, 0.2),)),
        Torque(disk="c", mean=-0.1),
    ]


def truncated(train):
    """A function that solves the equations truncated to some harmonics, and gives the deflections in m."""
    first = jaxhb.check(jaxhb.solve(train, rpm=ONE_RADIAN_PER_SECOND, harmonics=32))
    assert all(0 < contact.separated_fraction < 1 for contact in first.contacts().values())
    problem = problem_at(train, ONE_RADIAN_PER_SECOND, 8)
    sizes = certificate._sizes(FINE, 4.0, 8)
    at = Linearization(problem, train, np.asarray(first.deflections), sizes, 1.0)

    def solve(harmonics):
        lin = at.moved(fourier.resize(fourier.resize(at.deflection, harmonics), FINE) - at.deflection)
        for _ in range(8):
            own = lin.galerkin(harmonics)
            left = fourier.resize(fourier.resize(own.residual(), harmonics), FINE)
            change = fourier.resize(fourier.resize(own.inverse(left), harmonics), FINE)
            lin = lin.moved(-change)
            if np.abs(change).max() < 1e-12:
                return fourier.resize(lin.deflection, harmonics) * lin.law.backlash[:, None]
        raise AssertionError(f"{harmonics} harmonics: {np.abs(change).max():.1e} in the last step")

    return solve


def quantities(train, parts, deflection):
    """Coefficients of what converges, each to its own number of harmonics; of angles without what loads do alone."""
    law = jax.tree.map(np.asarray, backlash_meshes(train).law).expand()
    value = fourier.synthesize(deflection, SAMPLES)
    force, kept = fourier.analyze(backlash.force(law, value), SAMPLES // 2), deflection.shape[1] - 1
    found = {"deflection": deflection, "law": force, "force": force[:, : kept + 1]}
    found["stiffness"] = fourier.analyze(backlash.slope(law, value), kept)
    shafts = [part for part in parts if not isinstance(part, Mesh)]
    rows = np.array([row for part, row in dense.links(parts) if isinstance(part, Mesh)])
    angles = np.zeros((rows.shape[1], kept + 1), complex)
    for n in range(1, kept + 1):
        angles[:, n] = np.linalg.solve(dense.dynamic_stiffness(shafts, float(n)), -rows.T @ force[:, n])
    names = dense.disk_names(parts)
    return found | {
        key: angles[names.index(name)] for key, name in (("touching", "a"), ("far", "far")) if name in names
    }


def off(found, true):
    """Root mean square of the difference."""
    most = max(found.shape[-1], true.shape[-1]) - 1
    return np.linalg.norm(fourier.pack(fourier.resize(found, most) - fourier.resize(true, most)))


@pytest.mark.parametrize("parts", [one_mass, chain, branched], ids=lambda parts: parts.__name__)
def test_rates_of_motion_force_and_stiffness_are_those_of_theory(parts):
    parts = parts()
    train = build(parts, reference="a")
    solve = truncated(train)
    true, *levels = (quantities(train, parts, solve(n)) for n in (FINE, *LEVELS))
    for key in true:
        errors = np.array([off(level[key], true[key]) for level in levels])
        slope = -np.polyfit(np.log(LEVELS), np.log(errors), 1)[0]
        assert abs(slope - RATES[key]) < WITHIN + (key == "far") * 0.25, (key, errors, slope)
