"""Random drive trains: a skeleton filled with numbers.

What jaxhb compiles for (names, connections, rotors, orders, damping laws, what holds
the train) is fixed by the skeleton; there are 34, two of each size, so that a thousand
cases share their programs. Everything else is drawn for each case: radii, inertias,
stiffnesses (spread up to 1e6 within a train), tooth damping ratio 0.5 to 10 % and
shafts likewise, backlash 0.05 to 0.3 mm, epsilon, transition, amplitudes, mean load
from zero to five times the first amplitude, 300 to 8000 rpm. Loss factors exist only in
harmonic methods and are left out, as the reference integration integrates in time.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

import jaxhb
from jaxhb import Damper, Disk, Ground, Load, Mesh, Shaft, Torque

SIZES = {3: (1, 2), 6: (1, 2, 4), 12: (1, 2, 4, 8), 27: (1, 2, 4, 8), 60: (1, 2, 4, 8)}
VARIANTS = 2
ORDERS = (5, 10, 20, 40)


@dataclass(frozen=True)
class Skeleton:
    """What is fixed when a program is compiled: connections by disk number, the first
    disk of each rotor a gear.
    """

    name: str
    rotor: tuple
    shafts: tuple
    meshes: tuple
    tied: bool
    internal: int | None
    laws: tuple
    excited: tuple
    consumers: tuple
    orders: int
    ring: int | None
    grounded: bool
    cycle: int


SKELETONS = tuple(
    (n, m, v) for n, meshes in SIZES.items() for m in meshes for v in range(VARIANTS)
)


@cache
def skeleton(disks, meshes, variant):
    """Skeleton with ``disks`` disks (a damper's ring is one) and ``meshes`` meshes.

    Rotors are joined as a tree; variant 1 has two meshes between the same two rotors (a
    closed loop) where it is large enough for them, a damper, an excited accessory and a
    soft ground instead of a load.
    """
    rng = np.random.default_rng([disks, meshes, variant])
    tied = variant == 1 and meshes > 1 and disks >= meshes + 3
    rotors = meshes + 1 - tied
    spare = disks - rotors - 2 * tied
    ringed = variant == 1 and spare > 0
    spare -= ringed
    rotor, shafts, pairs = list(range(rotors)), [], []

    def grow(k, chain=0.7):
        seats = [d for d, r in enumerate(rotor) if r == k]
        shafts.append(
            (seats[-1] if rng.random() < chain else int(rng.choice(seats)), len(rotor))
        )
        rotor.append(k)
        return len(rotor) - 1

    for k in range(1, rotors):
        parent = k - 1 if rng.random() < 0.5 else int(rng.integers(k))
        new = spare > 0 and any(parent in pair for pair in pairs) and rng.random() < 0.5
        spare -= new
        pairs.append((grow(parent) if new else parent, k))
    if tied:
        pairs.append((grow(rotor[pairs[-1][0]]), grow(rotors - 1)))
    internal = rotors - 2 if variant == 0 and meshes > 1 else None
    for _ in range(spare):
        grow(0 if rng.random() < 0.4 else int(rng.integers(rotors)))
    first = [d for d, r in enumerate(rotor) if r == 0]
    last = [max(d for d, r in enumerate(rotor) if r == k) for k in range(rotors)]
    others = rng.permutation(np.arange(1, rotors))[: 1 + variant]
    laws = {0: ("contact",), 1: ("contact", "always")}[variant]
    return Skeleton(
        name=f"{disks} disks, {meshes} meshes, variant {variant}",
        rotor=tuple(rotor),
        shafts=tuple(shafts),
        meshes=tuple(pairs),
        tied=tied,
        internal=internal,
        laws=(
            tuple(laws[i % len(laws)] for i in range(meshes))
            if disks != 12
            else ("always",) * meshes
        ),
        excited=(*first[-3:], *(last[-1:] if variant else ())),
        consumers=tuple(int(last[k]) for k in others),
        orders=ORDERS[(SKELETONS.index((disks, meshes, variant)) * 3) % len(ORDERS)],
        ring=first[-1] if ringed else None,
        grounded=variant == 1,
        cycle=1 + (disks + meshes + variant) % 2,
    )


def span(rng, low, high, size=None):
    """Numbers between ``low`` and ``high``, uniform in their logarithm."""
    return np.exp(rng.uniform(np.log(low), np.log(high), size))


def random_case(rng, size=None):
    """A random train, its speed in rpm, and what was drawn: skeleton, ``zeta``
    (smallest tooth damping ratio), ``load`` (mean over first amplitude) and more;
    ``size`` is one of SKELETONS, drawn without.
    """
    drawn = SKELETONS[rng.integers(len(SKELETONS))]
    bones = skeleton(*(size or drawn))
    zeta = span(rng, 0.005, 0.1)
    load = span(rng, 0.02, 5.0) * (rng.random() > 0.15)
    radius, inertia = _gears(rng, bones)
    parts = [
        Disk(
            name=f"d{i}",
            inertia=inertia[i],
            radius=radius.get(i),
            damping=0.2 if i in bones.consumers else 0.0,
        )
        for i in range(len(bones.rotor))
    ]
    parts += _links(rng, bones, radius, inertia, zeta)
    parts += _torques(rng, bones, radius, load)
    train = jaxhb.build(
        parts, name=bones.name, reference="d0", revolutions_per_cycle=bones.cycle
    )
    facts = {
        "skeleton": bones.name,
        "disks": train.topology.n_disks,
        "meshes": len(bones.meshes),
    }
    facts |= {"orders": bones.orders, "zeta": float(zeta), "load": float(load)}
    facts |= {
        "epsilon": train.meshes.epsilon.tolist(),
        "transition": train.meshes.transition.tolist(),
    }
    return train, float(span(rng, 300.0, 8000.0)), facts


def random_train(rng):
    """The train of :func:`random_case`, without its speed."""
    return random_case(rng)[0]


def _gears(rng, bones):
    """Radius m of every gear and inertia kg m2 of every disk; steel gears 20 to 50 mm
    wide.
    """
    radius = {}
    for i, (a, b) in enumerate(bones.meshes):
        for gear in (a, b):
            radius.setdefault(gear, span(rng, 0.03, 0.15))
        if i == bones.internal:
            radius[b] = radius[a] * rng.uniform(1.5, 3.0)
    if bones.tied:
        (a, b), (c, d) = bones.meshes[-2:]
        radius[c] = radius[a] * rng.uniform(0.6, 1.6)
        radius[d] = radius[b] * radius[c] / radius[a]
    inertia = span(rng, 1e-3, 0.5, len(bones.rotor))
    for gear, r in radius.items():
        inertia[gear] = 7850 * np.pi / 2 * rng.uniform(0.02, 0.05) * r**4
    return radius, inertia


def _links(rng, bones, radius, inertia, zeta):
    """Shafts, meshes and the damper."""
    spread = span(rng, 10.0, 1e6)
    middle = span(rng, 3e4, 1e6)
    parts = []
    for a, b in bones.shafts:
        k = middle * spread ** rng.uniform(-0.5, 0.5)
        common = inertia[a] * inertia[b] / (inertia[a] + inertia[b])
        damping = 2 * zeta * rng.uniform(0.3, 1.0) * np.sqrt(k * common)
        parts.append(Shaft(between=(f"d{a}", f"d{b}"), stiffness=k, damping=damping))
    for i, (a, b) in enumerate(bones.meshes):
        c = span(rng, 5e7, 7e8)
        masses = [inertia[g] / radius[g] ** 2 for g in (a, b)]
        damping = (
            2
            * min(0.1, zeta * (1.0 if i == 0 else rng.uniform(1.0, 1.5)))
            * np.sqrt(c / sum(1 / m for m in masses))
        )
        parts.append(
            Mesh(
                between=(f"d{a}", f"d{b}"),
                kind="internal" if i == bones.internal else "external",
                stiffness=c,
                damping=damping,
                damping_law=bones.laws[i],
                backlash=span(rng, 5e-5, 3e-4),
                epsilon=rng.choice([1e-3, 3e-3, 1e-2, 3e-2], p=[0.7, 0.1, 0.1, 0.1]),
                transition=rng.choice([0.04, 0.02, 0.1, 0.2], p=[0.7, 0.1, 0.1, 0.1]),
            )
        )
    if bones.ring is not None:
        size = inertia[bones.ring] * rng.uniform(0.1, 0.5)
        speed = 2 * np.pi * span(rng, 30.0, 500.0)
        drag = 2 * rng.uniform(0.05, 0.3) * size * speed
        parts.append(
            Damper(
                name="ring",
                disk=f"d{bones.ring}",
                inertia=size,
                stiffness=size * speed**2,
                damping=drag,
            )
        )
    return parts


def _torques(rng, bones, radius, load):
    """Excitation, and what balances its mean: loads, or consumers' torques with a soft
    ground.
    """
    amplitude = span(rng, 300.0, 2e4) * radius[0] / len(bones.excited)
    decay = rng.uniform(0.8, 2.0)
    mean = load * amplitude
    parts = []
    for disk in bones.excited:
        k = np.arange(1, bones.orders + 1)
        torque = amplitude * k**-decay * np.exp(2j * np.pi * rng.random(k.size))
        rows = tuple(
            zip(
                (k / bones.cycle).tolist(),
                torque.real.tolist(),
                torque.imag.tolist(),
                strict=True,
            )
        )
        driven = bones.rotor[disk] == 0
        parts.append(
            Torque(disk=f"d{disk}", mean=mean if driven else 0.0, harmonics=rows)
        )
    shares = rng.dirichlet(np.ones(len(bones.consumers)))
    if not bones.grounded:
        return parts + [
            Load(disk=f"d{d}", share=s)
            for d, s in zip(bones.consumers, shares, strict=True)
        ]
    total = mean * sum(bones.rotor[d] == 0 for d in bones.excited)
    ratio = {0: 1.0}
    for a, b in bones.meshes:
        ratio.setdefault(bones.rotor[b], ratio[bones.rotor[a]] * radius[a] / radius[b])
    for d, s in zip(bones.consumers, shares, strict=True):
        parts.append(
            Torque(
                disk=f"d{d}",
                mean=-total * s / ratio[bones.rotor[d]],
                name=f"consumer d{d}",
            )
        )
    return [*parts, Ground(disk="d0", stiffness=span(rng, 1e-2, 1e3))]
