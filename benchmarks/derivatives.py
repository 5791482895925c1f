"""Derivatives of a solve on every path, for every kind of parameter: against differences, forwards and backwards.

One train with a cylinder, a damper and two meshes with backlash, solved linearly (no backlash), with teeth held in
contact, by the reduced equation with both meshes separating (sampled and with exact integrals), and by the chain. The
number differentiated is one that tooth forces, shaft torques and positions enter, with respect to factors on the
parameters.
"""

import dataclasses
from functools import cache, partial

import jax
import numpy as np
from known_trains import branched_parts

import jaxhb
from jaxhb import Cylinder, Mesh, Torque

KINDS = {
    "inertia": "flywheel.inertia",
    "stiffness": "flywheel|crank gear.stiffness",
    "tooth stiffness": "crank gear|idler.stiffness",
    "damping": "ring.damping",
    "tooth damping": "crank gear|idler.damping",
    "loss factor": "pump gear|pump.loss_factor",
    "backlash": "pump gear|idler.backlash",
    "transition": "pump gear|idler.transition",
    "gap stiffness": "crank gear|idler.epsilon",
    "radius": "pump gear.radius",
    "torque": "pump:torque.harmonics",
    "mean load": "pump:torque.mean",
    "piston mass": "cylinder.reciprocating_mass",
    "stroke": "cylinder.stroke",
    "speed": None,
}
RPM = 1500.0
ALONG = np.random.default_rng(0).normal(size=len(KINDS))
STEPS = np.array([1e-4] * (len(KINDS) - 1) + [1e-5])
"""Rounding asks for large steps, the curvature in speed for a small one."""


class Tight(jaxhb.Plan):
    """A plan solved to rounding: differences divide what is left of the residual by the step."""

    @property
    def sizes(self):
        return dataclasses.replace(super().sizes, residual_tolerance=1e-13, max_steps=12, estimated=False)


MARCHED = {"active": (0, 1), "flank": (0, 0), "start": "march", "time_steps": 768, "tolerance": 0.5, "excited": 4}
PLANS = {
    "linear": Tight(harmonics=8, active=(), flank=(0, 0), excited=4),
    "contact": Tight(harmonics=8, active=(), flank=(1, -1), excited=4),
    "reduced": Tight(harmonics=32, **MARCHED),
    "exact": Tight(harmonics=32, **MARCHED, integrals="exact"),
    "chain": Tight(harmonics=12, **MARCHED, method="chain"),
}


@cache
def train(path):
    """Of a path: pressed by a load 50 times as large where teeth stay in contact."""
    pressed = 50.0 if path == "contact" else 1.0
    parts = branched_parts()[:-2]
    if path == "linear":
        parts = [dataclasses.replace(part, backlash=None) if isinstance(part, Mesh) else part for part in parts]
    parts += [
        Cylinder(
            name="cylinder",
            disk="flywheel",
            bore=0.08,
            stroke=0.09,
            rod=0.15,
            reciprocating_mass=0.6,
            gas_torque_mean=12.0 * pressed,
            gas_torque=((1.0, 300.0, -80.0), (2.0, 60.0, 90.0)),
            orders=4.0,
        ),
        Torque(disk="pump", mean=-8.0 * pressed, harmonics=((1.0, 3.0, 5.0), (3.0, 4.0, 0.0))),
    ]
    return jaxhb.build(parts, revolutions_per_cycle=1, reference="crank gear", name="derivatives")


def parameters(path):
    """Kinds of parameters that the path has."""
    absent = {"linear": ("backlash", "transition", "gap stiffness"), "contact": ("transition",)}
    return [kind for kind in KINDS if kind not in absent.get(path, ())]


def value(factors, path):
    """One number that every part of the response enters, and (status, deflections)."""
    at, plan = train(path), PLANS[path]
    kinds = dict(zip(parameters(path), factors, strict=True))
    speed = RPM * kinds.pop("speed")
    changes = {KINDS[kind]: at.value(KINDS[kind]) * factor for kind, factor in kinds.items()}
    response = jaxhb.solve(at.replace(changes), rpm=speed, plan=plan)
    tooth = response.force("crank gear", "idler").smooth_peak(8) / 700
    shaft = response.torque("pump gear", "pump").order(1.0) / 10
    swing = 1e4 * response.twist("flywheel", "crank gear").rms
    return tooth + shaft + swing + 10 * response.disk("pump").mean, (response.status, response.deflections)


@partial(jax.jit, static_argnums=1)
def linearised(factors, path):
    """Of a batch of factors: (value, status, deflections), gradient, change along ALONG."""

    def lane(factors):
        number, push, aux = jax.linearize(partial(value, path=path), factors, has_aux=True)
        along = ALONG[: len(factors)]
        return (number, *aux), jax.linear_transpose(push, factors)(1.0)[0], push(along)

    return jax.lax.map(lane, factors)


@cache
def table(path):
    """Rows of one path, one for each kind: dict of path, kind, gradient, differences, error, transpose, solved, apart.

    ``error`` : gradient against central differences of fourth order, relative to itself or to a thousandth of the
    largest where it is small; ``transpose`` : forwards against backwards, relative; ``apart`` : least share of the
    cycle in which a mesh is out of contact.
    """
    kinds = parameters(path)
    steps = STEPS[-len(kinds) :]
    away = np.diag(steps)
    lanes = 1.0 + np.concatenate([0 * away[:1], away, -away, 2 * away, -2 * away])
    (values, status, deflections), gradients, along = jax.tree.map(np.asarray, linearised(lanes, path))
    near, back, far, farther = np.split(values[1:], 4)
    wanted, found = (8 * (near - back) - (far - farther)) / (12 * steps), gradients[0]
    size = np.maximum(np.abs(wanted), 1e-3 * np.abs(wanted).max())
    backwards = found @ ALONG[: len(kinds)]
    swing = np.fft.irfft(deflections[0], n=1024, norm="forward")
    gap = 0.0 if path == "linear" else 0.5 * (1 - 0.3) * 1e-4
    common = {
        "path": path,
        "transpose": float(abs(along[0] / backwards - 1)),
        "solved": bool((status == jaxhb.Status.CONVERGED).all()),
        "apart": float(np.mean(np.abs(swing) < gap, axis=-1).min()),
    }
    columns = zip(kinds, found, wanted, np.abs(found - wanted) / size, strict=True)
    return [
        {"kind": kind, "gradient": float(f), "differences": float(w), "error": float(e), **common}
        for kind, f, w, e in columns
    ]
