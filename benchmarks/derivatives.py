"""Derivatives of a solve on every path, for every kind of parameter: against
differences, forwards and backwards.

One train with a cylinder, a damper and two meshes with backlash, solved linearly (no
backlash), with teeth held in contact, by the condensed equation with both meshes
separating (sampled and with exact integrals), and by the chain. The number
differentiated is one that tooth forces, shaft torques and positions enter, with respect
to factors on the parameters.

    python benchmarks/derivatives.py --json rows.jsonl         what the truncation does to 200 random derivatives

Each case is the derivative of the smooth peak of a tooth force by one number of a
packaged train, at a random speed at which teeth separate: with the harmonics of the
default tolerance and with twice as many (the difference of the two is what
:func:`jaxhb.gradient_and_error` estimates), against 2048 or twice as many again, from
the same motion.
"""

import dataclasses
import time
from functools import cache, partial

import jax
import numpy as np
from known_trains import branched_parts
from records import cases_line, run_cases

import jaxhb
from jaxhb import Cylinder, Mesh, Torque
from jaxhb.equations import fourier

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


def tight(**given):
    """A plan solved to rounding, as differences divide what is left of the residual by
    the step, and differentiated at the time samples of its solve: differences are those
    of the sampled equations.
    """
    return jaxhb.Plan(
        residual_tolerance=1e-13, max_steps=12, averaged=False, estimated=False, **given
    )


MARCHED = {
    "active": (0, 1),
    "flank": (0, 0),
    "start": "march",
    "time_steps": 768,
    "tolerance": 0.5,
    "excited": 4,
}
PLANS = {
    "linear": tight(harmonics=8, active=(), flank=(0, 0), excited=4),
    "contact": tight(harmonics=8, active=(), flank=(1, -1), excited=4),
    "reduced": tight(harmonics=32, **MARCHED),
    "exact": tight(harmonics=32, **MARCHED, integrals="exact"),
    "chain": tight(harmonics=12, **MARCHED, method="chain"),
}


@cache
def train(path):
    """Of a path: pressed by a load 50 times as large where teeth stay in contact."""
    pressed = 50.0 if path == "contact" else 1.0
    parts = branched_parts()[:-2]
    if path == "linear":
        parts = [
            dataclasses.replace(part, backlash=None) if isinstance(part, Mesh) else part
            for part in parts
        ]
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
        Torque(
            disk="pump",
            mean=-8.0 * pressed,
            harmonics=((1.0, 3.0, 5.0), (3.0, 4.0, 0.0)),
        ),
    ]
    return jaxhb.build(
        parts, revolutions_per_cycle=1, reference="crank gear", name="derivatives"
    )


def parameters(path):
    """Kinds of parameters that the path has."""
    absent = {
        "linear": ("backlash", "transition", "gap stiffness"),
        "contact": ("transition",),
    }
    return [kind for kind in KINDS if kind not in absent.get(path, ())]


def value(factors, path):
    """One number that every part of the response enters, and (status, deflections)."""
    at = train(path)
    plan = PLANS[path]
    kinds = dict(zip(parameters(path), factors, strict=True))
    speed = RPM * kinds.pop("speed")
    changes = {
        KINDS[kind]: at.value(KINDS[kind]) * factor for kind, factor in kinds.items()
    }
    response = jaxhb.solve(at.replace(changes), rpm=speed, plan=plan)
    tooth = response.force("crank gear", "idler").smooth_peak(8) / 700
    shaft = response.torque("pump gear", "pump").order(1.0) / 10
    swing = 1e4 * response.twist("flywheel", "crank gear").rms
    return tooth + shaft + swing + 10 * response.disk("pump").mean, (
        response.status,
        response.deflections,
    )


@partial(jax.jit, static_argnums=1)
def linearised(factors, path):
    """Of a batch of factors: (value, status, deflections), gradient, change along
    ALONG.
    """

    def lane(factors):
        number, push, aux = jax.linearize(
            partial(value, path=path), factors, has_aux=True
        )
        along = ALONG[: len(factors)]
        return (number, *aux), jax.linear_transpose(push, factors)(1.0)[0], push(along)

    return jax.lax.map(lane, factors)


@cache
def table(path):
    """Rows of one path, one for each kind: dict of path, kind, gradient, differences,
    error, transpose, solved, apart.

    ``error`` : gradient against central differences of fourth order, relative to itself
    or to a thousandth of the largest where it is small; ``transpose`` : forwards
    against backwards, relative; ``apart`` : least share of the cycle in which a mesh is
    out of contact.
    """
    kinds = parameters(path)
    steps = STEPS[-len(kinds) :]
    away = np.diag(steps)
    lanes = 1.0 + np.concatenate([0 * away[:1], away, -away, 2 * away, -2 * away])
    (values, status, deflections), gradients, along = jax.tree.map(
        np.asarray, linearised(lanes, path)
    )
    near, back, far, farther = np.split(values[1:], 4)
    wanted = (8 * (near - back) - (far - farther)) / (12 * steps)
    found = gradients[0]
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
        {
            "kind": kind,
            "gradient": float(f),
            "differences": float(w),
            "error": float(e),
            **common,
        }
        for kind, f, w, e in columns
    ]


SCENES = (
    "gear_train_30",
    "gear_train_30",
    "engine_with_damper",
    "inline_four_timing_drive",
    "first_scene",
)
SPEEDS = 600.0, 2450.0
LEAST_REFERENCE = 2048
"""Harmonics of the derivative that counts as true, or four times those of the
motion.
"""
TIME_STEPS = 3072
"""Of the preconditioner, for the lowest of the speeds."""
FIELDS = {
    "damper": ("damping", "stiffness", "inertia"),
    "shaft": ("stiffness",),
    "mesh": ("stiffness", "damping", "backlash"),
    "disk": ("inertia",),
}


class Continued(jaxhb.Plan):
    """A plan from a given start, with no program for another or for the truncation
    error; one for all speeds.
    """

    @property
    def sizes(self):
        return dataclasses.replace(super().sizes, estimated=False, marches=False)


@cache
def sampled_train(scene):
    """A packaged train, the names of its numbers above 0 of FIELDS, by table, and its
    meshes with backlash.
    """
    train = jaxhb.load_scene(scene)
    names = {
        table: [
            f"{name}.{field}"
            for name, (kind, _) in train.topology.elements.items()
            for field in fields
            if kind == table
            and (
                field != "backlash"
                or train.topology.mesh_backlash[train.topology.mesh_names.index(name)]
            )
            and train.value(f"{name}.{field}") > 0
        ]
        for table, fields in FIELDS.items()
    }
    meshes = [
        m
        for m, gap in zip(
            train.topology.mesh_names, train.topology.mesh_backlash, strict=True
        )
        if gap
    ]
    return train, names, meshes


# Compiled for each number of harmonics of each scene, for a few calls: not optimised,
# as that would take longer.
@partial(
    jax.jit,
    static_argnames=("scene", "plan"),
    compiler_options={"xla_backend_optimization_level": 0},
)
def peak_and_slopes(factors, train, rpm, of_mesh, deflections, scene, plan):
    """Smooth peak of one mesh's force and its status, and the derivative by a factor on
    each number.
    """
    _, names, meshes = sampled_train(scene)
    names = sum(names.values(), [])
    start = dataclasses.replace(some_response(scene), deflections=deflections)

    def peak(factors):
        changes = {name: train.value(name) * factors[i] for i, name in enumerate(names)}
        response = jaxhb.solve(train.replace(changes), rpm=rpm, plan=plan, start=start)
        return (
            sum(
                of_mesh[i] * response.force(mesh).smooth_peak()
                for i, mesh in enumerate(meshes)
            ),
            response.status,
        )

    return jax.value_and_grad(peak, has_aux=True)(factors)


@cache
def some_response(scene):
    """A response of a scene."""
    return jaxhb.solve(sampled_train(scene)[0], rpm=SPEEDS[0], harmonics=96)


def hammering(random, train, meshes):
    """A random speed at which teeth of a converged motion separate: rpm, Response, a
    mesh that separates, draws.
    """
    for draw in range(1, 41):
        rpm = float(random.uniform(*SPEEDS))
        response = jaxhb.solve(train, rpm=rpm)
        apart = [mesh for mesh in meshes if response.mesh(mesh).separated_fraction > 0]
        if response.converged and apart:
            return rpm, response, str(random.choice(apart)), draw
    raise RuntimeError(
        f"{train.topology.title}: no tooth separates at 40 random speeds"
    )


def sampled(seed, number):
    """The record of one random derivative."""
    random = np.random.default_rng([seed, number])
    begin = time.process_time()
    scene = str(random.choice(SCENES))
    train, names, meshes = sampled_train(scene)
    rpm, response, mesh, draws = hammering(random, train, meshes)
    name = str(
        random.choice(names[random.choice([table for table in names if names[table]])])
    )
    index = sum(names.values(), []).index(name)
    active = tuple(train.topology.mesh_names.index(m) for m in meshes)
    flank = (0,) * len(train.topology.mesh_names)
    of_mesh = np.array([float(m == mesh) for m in meshes])
    slopes = []
    peaks = []
    solved = True
    least = response.harmonics
    deflections = fourier.resize(response.deflections, 4096)
    some_response(scene)  # solved before a program asks for it
    for harmonics in (least, 2 * least, min(max(LEAST_REFERENCE, 4 * least), 4096)):
        plan = Continued(
            harmonics=harmonics, active=active, flank=flank, time_steps=TIME_STEPS
        )
        given = np.ones(sum(map(len, names.values()))), train, rpm, of_mesh, deflections
        (peak, status), slope = peak_and_slopes(*given, scene=scene, plan=plan)
        peaks.append(float(peak))
        slopes.append(float(slope[index]))
        solved &= int(status) <= jaxhb.Status.TOLERANCE_NOT_MET
    return {
        "seed": seed,
        "case": number,
        "scene": scene,
        "rpm": rpm,
        "parameter": name,
        "mesh": mesh,
        "harmonics": response.harmonics,
        "solved": solved,
        "peaks": peaks,
        "slopes": slopes,
        "draws": draws,
        "seconds": time.process_time() - begin,
    }


def report(records):
    """Median, 90 % and worst error of the derivatives, and how far their estimate
    reaches.
    """
    solved = [r for r in records if r["solved"]]
    found, twice, reference = np.array([r["slopes"] for r in solved]).T
    estimate = np.abs(twice - found)
    off = np.abs(twice - reference)
    print(
        f"{len(solved)} of {len(records)} solved at all harmonics,"
        f" {sum(r['draws'] for r in records)} speeds drawn"
    )
    for title, error in (
        ("default tolerance", np.abs(found - reference)),
        ("twice the harmonics", off),
    ):
        share = 100 * error / np.abs(reference)
        median, most = np.quantile(share, [0.5, 0.9])
        print(
            f"{title}: off by {median:.2g} % (median), {most:.2g} % (90 %),"
            f" {share.max():.3g} % (worst)"
        )
    known = estimate > 0
    reach = np.where(
        known, off / np.where(known, estimate, 1.0), np.where(off > 0, np.inf, 0.0)
    )
    within = ", ".join(f"{100 * np.mean(reach <= k):.0f} % by {k:g}" for k in (1, 2, 4))
    print(f"error with twice the harmonics covered by the estimate times k: {within}")


def main():
    """Read the command line and run."""
    asked = cases_line(__doc__, seed=20261124).parse_args()
    report(run_cases(asked, "derivatives", sampled))


if __name__ == "__main__":
    main()
