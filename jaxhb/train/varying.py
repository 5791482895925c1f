"""Links whose stiffness and damping vary: over the frequency, over their own amplitude,
with the square of the speed.

At the vibration frequency f and the amplitude A of its twist a link of stiffness k,
damping r and loss factor eta has the complex stiffness ``k s (1 + i eta d) + i omega r
d``, where s and d are the products of the factors that its tables give at f and at A,
linear between their rows and constant outside. The mean torque meets the stiffness at 0
Hz. An order-tuned absorber adds ``J n^2 Omega^2`` to the stiffness of its link, Omega
the speed of its rotor (den Hartog, Mechanical Vibrations, sec. 5.9, for small angles of
a pendulum): the order n of its rotor then meets a node.
"""

import dataclasses
import math

import numpy as np

from jaxhb._jax import namespace, traced
from jaxhb.elements.elements import SceneError

NEEDS = {
    "hz_links": ("over_hz", "hz"),
    "amplitude_links": ("over_amplitude", "amplitude"),
    "order_links": ("order", "rpm"),
}
"""Key of the scene that makes a link vary, and the number at which it is constant."""


def varying(topology) -> bool:
    """Tell whether any link varies."""
    return any(getattr(topology, field) for field in NEEDS)


def refuse_varying(topology) -> None:
    """Refuse links that vary, naming each, where constants are needed."""
    if varying(topology):
        taken = dict.fromkeys(NEEDS, " takes") | {
            "order_links": " and the Campbell diagram take"
        }
        why = {
            field: f"which only the forced response{by}. Make it constant"
            for field, by in taken.items()
        }
        raise SceneError(
            [
                sentence
                for field in NEEDS
                for sentence in _sentences(topology, [field], why[field])
            ]
        )


def _sentences(topology, fields, why) -> list[str]:
    """A sentence for each link that varies by one of ``fields``."""
    return [
        f"{topology.title}: {topology.link_names[i]!r} has {NEEDS[field][0]}, {why}:"
        f" train.with_constant_links({NEEDS[field][1]}=...), on the command line"
        f" --links-at {NEEDS[field][1]}=VALUE."
        for field in fields
        for i in getattr(topology, field)
    ]


def with_constant_links(train, ratios, *, hz, amplitude, rpm):
    """Evaluate the links that vary; see :meth:`DriveTrain.with_constant_links`.
    ``ratios`` : of the rotors' speeds.
    """
    topology = train.topology
    given = dict(zip(NEEDS, (hz, amplitude, rpm), strict=True))
    errors = _sentences(
        topology,
        [f for f in NEEDS if given[f] is None],
        "which is constant at one number. Give it",
    )
    for (_, name), value in zip(NEEDS.values(), given.values(), strict=True):
        if (
            value is not None
            and not traced(value)
            and not np.all(np.asarray(value) >= 0.0)
        ):
            errors.append(
                f"with_constant_links: {name} is {value}, must be at least 0."
                " Correct it."
            )
    if errors:
        raise SceneError(errors)
    fixed = without_tables(train)
    shafts = len(topology.shaft_names)
    links, stiffer, damped = factors(
        train, hz, [amplitude] * len(topology.amplitude_links)
    )
    # Without a speed no link is tuned to an order, or an error was raised above.
    extra = order_stiffness(train, ratios, 0.0 if rpm is None else rpm)

    def table(old, first, extra):
        own = [
            k
            for k, link in enumerate(links)
            if first <= link < first + len(old.stiffness)
        ]
        index = [links[k] - first for k in own]
        return dataclasses.replace(
            old,
            stiffness=scaled(
                old.stiffness + extra, index, stiffer[np.array(own, dtype=int)]
            ),
            damping=scaled(old.damping, index, damped[np.array(own, dtype=int)]),
            loss_factor=scaled(
                old.loss_factor, index, damped[np.array(own, dtype=int)]
            ),
        )

    return dataclasses.replace(
        fixed,
        shafts=table(fixed.shafts, 0, 0.0),
        dampers=table(fixed.dampers, shafts, extra),
    )


def without_tables(train):
    """The train with its links as they are without any factor and without order-tuned
    stiffness.
    """

    def bare(table, **change):
        return dataclasses.replace(
            table,
            over_hz=table.over_hz[:, :0],
            over_amplitude=table.over_amplitude[:, :0],
            **change,
        )

    return dataclasses.replace(
        train,
        topology=dataclasses.replace(train.topology, **dict.fromkeys(NEEDS, ())),
        shafts=bare(train.shafts),
        dampers=bare(train.dampers, order=0.0 * train.dampers.order),
    )


def factors(train, hz, amplitudes):
    """Links with tables (V of them), and their factors of stiffness and of damping,
    arrays [V, ...].

    ``hz`` of the shape that follows; ``amplitudes``: an array of it in rad for each of
    the ``amplitude_links``.
    """
    topology = train.topology
    xp = namespace(train.shafts, train.dampers, hz, *amplitudes)
    links = sorted({*topology.hz_links, *topology.amplitude_links})
    used = [(link, "over_hz", hz) for link in topology.hz_links]
    used += [
        (link, "over_amplitude", a)
        for link, a in zip(topology.amplitude_links, amplitudes, strict=True)
    ]
    found = {link: [1.0, 1.0] for link in links}
    shafts = len(topology.shaft_names)
    for link, field, at in used:
        table, index = (
            (train.shafts, link) if link < shafts else (train.dampers, link - shafts)
        )
        points, *values = getattr(table, field)[index].T
        found[link] = [
            f * xp.interp(at, points, v)
            for f, v in zip(found[link], values, strict=True)
        ]
    if not links:
        return links, xp.ones(0), xp.ones(0)
    return links, *(
        xp.stack([xp.asarray(pair[k]) for pair in found.values()]) for k in (0, 1)
    )


def scaled(values, index, by):
    """``values`` [n, ...] with those at ``index`` multiplied."""
    xp = namespace(values, by)
    index = np.array(index, dtype=int)
    if xp is np:
        values = np.array(values, dtype=np.float64)
        values[index] *= by
        return values
    return xp.asarray(values).at[index].multiply(by, unique_indices=True)


def order_stiffness(train, ratios, rpm):
    """Stiffness J n^2 Omega^2 of order-tuned dampers in N m/rad [..., n_dampers], at
    ``rpm`` [...] of the reference.
    """
    xp = namespace(train, rpm)
    dampers = train.dampers
    topology = train.topology
    rotor = np.array(topology.rotor, dtype=int)[
        np.array(topology.damper_disk, dtype=int)
    ]
    speed = xp.asarray(rpm)[..., None] * ratios[rotor] * (2.0 * math.pi / 60.0)
    return xp.asarray(dampers.inertia) * (dampers.order * speed) ** 2
