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

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb._jax import Array, Number, namespace, traced
from jaxhb.elements.sentences import SceneError

if TYPE_CHECKING:
    from jaxhb.train.tables import Dampers, Shafts, Train, TrainArrays
    from jaxhb.train.topology import Topology

NEEDS = {
    "hz_links": ("over_hz", "hz"),
    "amplitude_links": ("over_amplitude", "amplitude"),
    "order_links": ("order", "rpm"),
}
"""Key of the scene that makes a link vary, and the number at which it is constant."""


def varying(topology: Topology) -> bool:
    """Tell whether any link varies."""
    return any(getattr(topology, field) for field in NEEDS)


def refuse_varying(topology: Topology) -> None:
    """Refuse links that vary, naming each, where constants are needed."""
    if varying(topology):
        verbs = dict.fromkeys(NEEDS, " takes") | {
            "order_links": " and the Campbell diagram take"
        }
        reasons = {
            field: f"which only the forced response{verb}. Make it constant"
            for field, verb in verbs.items()
        }
        raise SceneError(
            [
                sentence
                for field in NEEDS
                for sentence in _sentences(topology, [field], reasons[field])
            ]
        )


def _sentences(topology: Topology, fields: Iterable[str], why: str) -> list[str]:
    """A sentence for each link that varies by one of ``fields``."""
    return [
        f"{topology.title}: {topology.link_names[i]!r} has {NEEDS[field][0]}, {why}:"
        f" train.with_constant_links({NEEDS[field][1]}=...), on the command line"
        f" --links-at {NEEDS[field][1]}=VALUE."
        for field in fields
        for i in getattr(topology, field)
    ]


def with_constant_links(
    train: Train,
    ratios: Array,
    *,
    hz: Number | None,
    amplitude: Number | None,
    rpm: Number | None,
) -> Train:
    """Evaluate the links that vary; see :meth:`DriveTrain.with_constant_links`.

    ``ratios`` : ``[n_rotors]`` speed of each rotor over that of the reference rotor.
    """
    topology = train.topology
    numbers: dict[str, Number | None] = {
        "hz_links": hz,
        "amplitude_links": amplitude,
        "order_links": rpm,
    }
    errors = _sentences(
        topology,
        [field for field in NEEDS if numbers[field] is None],
        "which is constant at one number. Give it",
    )
    for (_, name), value in zip(NEEDS.values(), numbers.values(), strict=True):
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
    n_shafts = len(topology.shaft_names)
    links, stiffness_factors, damping_factors = factors(
        train, hz, [amplitude] * len(topology.amplitude_links)
    )
    # Without a speed no link is tuned to an order, or an error was raised above.
    tuned_stiffness = order_stiffness(train, ratios, 0.0 if rpm is None else rpm)

    def constant(table: Any, first: int, added_stiffness: Number) -> Any:
        """A table whose links count from ``first`` on, times their factors."""
        rows = [
            k
            for k, link in enumerate(links)
            if first <= link < first + len(table.stiffness)
        ]
        seats = [links[k] - first for k in rows]
        places = np.array(rows, dtype=int)
        return dataclasses.replace(
            table,
            stiffness=scaled(
                table.stiffness + added_stiffness, seats, stiffness_factors[places]
            ),
            damping=scaled(table.damping, seats, damping_factors[places]),
            loss_factor=scaled(table.loss_factor, seats, damping_factors[places]),
        )

    return dataclasses.replace(
        fixed,
        shafts=constant(fixed.shafts, 0, 0.0),
        dampers=constant(fixed.dampers, n_shafts, tuned_stiffness),
    )


def without_tables(train: Train) -> Train:
    """The train with its links as they are without any factor and without order-tuned
    stiffness.
    """

    shafts: Any = train.shafts
    dampers: Any = train.dampers
    return dataclasses.replace(
        train,
        topology=dataclasses.replace(
            train.topology, hz_links=(), amplitude_links=(), order_links=()
        ),
        shafts=dataclasses.replace(
            shafts,
            over_hz=shafts.over_hz[:, :0],
            over_amplitude=shafts.over_amplitude[:, :0],
        ),
        dampers=dataclasses.replace(
            dampers,
            over_hz=dampers.over_hz[:, :0],
            over_amplitude=dampers.over_amplitude[:, :0],
            order=0.0 * dampers.order,
        ),
    )


def factors(
    train: TrainArrays, hz: Number | None, amplitudes: Sequence[Any]
) -> tuple[list[int], Array, Array]:
    """Links with tables (V of them), and their factors of stiffness and of damping,
    arrays [V, ...].

    ``hz`` of the shape that follows; ``amplitudes``: an array of it in rad for each of
    the ``amplitude_links``.
    """
    topology = train.topology
    xp = namespace(train.shafts, train.dampers, hz, *amplitudes)
    links = sorted({*topology.hz_links, *topology.amplitude_links})
    conditions = [(link, "over_hz", hz) for link in topology.hz_links]
    conditions += [
        (link, "over_amplitude", amplitude)
        for link, amplitude in zip(topology.amplitude_links, amplitudes, strict=True)
    ]
    pairs = {link: [1.0, 1.0] for link in links}
    n_shafts = len(topology.shaft_names)
    for link, field, position in conditions:
        is_shaft = link < n_shafts
        table: Shafts | Dampers = train.shafts if is_shaft else train.dampers
        index = link if is_shaft else link - n_shafts
        points, *columns = getattr(table, field)[index].T
        pairs[link] = [
            factor * xp.interp(position, points, column)
            for factor, column in zip(pairs[link], columns, strict=True)
        ]
    if not links:
        return links, xp.ones(0), xp.ones(0)
    stiffness = xp.stack([xp.asarray(factor) for factor, _ in pairs.values()])
    damping = xp.stack([xp.asarray(factor) for _, factor in pairs.values()])
    return links, stiffness, damping


def scaled(values: Array, index: Sequence[int] | np.ndarray, factor: Number) -> Array:
    """``values`` [n, ...] with those at ``index`` multiplied by ``factor``."""
    xp = namespace(values, factor)
    places = np.array(index, dtype=int)
    if xp is np:
        scaled_values = np.array(values, dtype=np.float64)
        scaled_values[places] *= factor
        return scaled_values
    return xp.asarray(values).at[places].multiply(factor, unique_indices=True)


def order_stiffness(train: TrainArrays, ratios: Array, rpm: Number) -> Array:
    """Stiffness J n^2 Omega^2 of order-tuned dampers in N m/rad [..., n_dampers], at
    ``rpm`` [...] of the reference rotor.
    """
    xp = namespace(train, rpm)
    dampers = train.dampers
    topology = train.topology
    rotor = np.array(topology.rotor, dtype=int)[
        np.array(topology.damper_disk, dtype=int)
    ]
    speed = xp.asarray(rpm)[..., None] * ratios[rotor] * (2.0 * math.pi / 60.0)
    return xp.asarray(dampers.inertia) * (dampers.order * speed) ** 2
