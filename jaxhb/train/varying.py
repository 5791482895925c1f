"""Links whose stiffness and damping vary: over the frequency, over their own amplitude,
and numbers of any element that depend on the speed.

At the vibration frequency f and the amplitude A of its twist a link of stiffness k,
damping r and loss factor eta has the complex stiffness ``k s (1 + i eta d) + i omega r
d``, where s and d are the products of the factors that its tables give at f and at A,
linear between their rows and constant outside. The mean torque meets the stiffness at 0
Hz.

At a speed of the reference rotor, ``damping_over_rpm`` and ``stiffness_over_rpm`` give
r and k, linear between their rows and constant outside, and an order-tuned absorber
adds ``J n^2 Omega^2`` to the stiffness of its link, Omega the speed of its rotor (den
Hartog, Mechanical Vibrations, sec. 5.9, for small angles of a pendulum): the order n of
its rotor then meets a node. Disks of loads with ``archer`` have the damping of
:func:`archer_damping`. All that computes at a speed takes the train :func:`at_speed`,
which is the train itself where nothing depends on the speed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb._jax import Array, Number, namespace, traced
from jaxhb.elements.sentences import SceneError
from jaxhb.excitation.mean_torques import between_points
from jaxhb.train.kinematics import speed_ratios
from jaxhb.train.tables import with_table

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
    """Tell whether any link varies, or any number depends on the speed."""
    return topology.depends_on_speed or any(getattr(topology, field) for field in NEEDS)


def refuse_varying(topology: Topology) -> None:
    """Refuse what varies, naming each, where constants are needed."""
    if varying(topology):
        by_vibration = "which only the forced response takes. Make it constant"
        reasons = dict.fromkeys(NEEDS, by_vibration)
        reasons["order_links"] = NO_SPEED
        raise SceneError(
            [
                sentence
                for field in NEEDS
                for sentence in _sentences(topology, [field], reasons[field])
            ]
            + _table_sentences(topology, NO_SPEED)
        )


NO_SPEED = "which needs a speed, and there is none here. Make it constant"


def _sentences(topology: Topology, fields: Iterable[str], why: str) -> list[str]:
    """A sentence for each link that varies by one of ``fields``."""
    return [
        _sentence(topology, topology.link_names[i], *NEEDS[field], why)
        for field in fields
        for i in getattr(topology, field)
    ]


def _table_sentences(topology: Topology, why: str) -> list[str]:
    """A sentence for each number that rows over the speed give, or Archer's
    formula.
    """
    keys = [
        (topology.names_of(table)[i], f"{field}_over_rpm")
        for table, field, i, _ in topology.rpm_tables
    ]
    keys += [(topology.load_names[i], "archer") for i in topology.archer_loads]
    return [_sentence(topology, name, key, "rpm", why) for name, key in keys]


def _sentence(topology: Topology, name: str, key: str, number: str, why: str) -> str:
    """A sentence on an element that varies by its ``key``, over a number."""
    return (
        f"{topology.title}: {name!r} has {key}, {why}:"
        f" train.with_constant_links({number}=...), on the command line"
        f" --links-at {number}=VALUE."
    )


def at_speed(train: Train, rpm: Number) -> Train:
    """The train as it is at one speed of the reference rotor, which may be traced: with
    what rows over the speed give, and the stiffness of order-tuned dampers. The train
    itself where nothing depends on the speed.
    """
    if not train.topology.depends_on_speed:
        return train
    train = tables_at(train, rpm)
    if not train.topology.order_links:
        return train
    dampers: Any = train.dampers
    stiffness = dampers.stiffness + order_stiffness(train, speed_ratios(train), rpm)
    return dataclasses.replace(
        train,
        topology=_without(train.topology, "order_links"),
        dampers=dataclasses.replace(
            dampers, stiffness=stiffness, order=0.0 * dampers.order
        ),
    )


def tables_at(train: Train, rpm: Number) -> Train:
    """The train with what rows over the speed and Archer's formula give at one speed as
    constants; the train itself where it has none.
    """
    topology = train.topology
    if topology.archer_loads:
        disks: Any = train.disks
        damping = disks.damping + archer_damping(train, rpm)
        topology = _without(topology, "archer_loads")
        train = dataclasses.replace(
            train, topology=topology, disks=dataclasses.replace(disks, damping=damping)
        )
    if not topology.rpm_tables:
        return train
    alike: dict[tuple[str, str, int], list[int]] = {}
    for table, field, i, count in topology.rpm_tables:
        alike.setdefault((table, field, count), []).append(i)
    changed = train
    for (table, field, count), members in alike.items():
        index = np.array(members, dtype=int)
        rows = getattr(train.table(table), f"{field}_over_rpm")[index, :count]
        values = between_points(rpm, rows[..., 0], rows[..., 1])
        numbers = changed.table(table)
        vector = _put(getattr(numbers, field), index, values)
        constants: dict[str, Any] = {field: vector, f"{field}_over_rpm": None}
        changed = with_table(changed, table, dataclasses.replace(numbers, **constants))
    return dataclasses.replace(changed, topology=_without(topology, "rpm_tables"))


def archer_damping(train: TrainArrays, rpm: Number) -> Array:
    """Damping N m s/rad [n_scene_disks] of propellers to ground at ``rpm`` of the
    reference rotor, ``c = a M / n`` with the torque M in N m and the speed n in rpm of
    the propeller; 0 of disks without one. Differentiable.

    With ``M = M_N (n / N)^2`` it is proportional to the speed. Where the inflow follows
    the speed, the torque has the slope ``dM/d(omega) = 60 M / (pi n)``, a = 19.1; no
    inflow follows a vibration, and a is larger: 20 to 40 over pitch and blade area, as
    the formula of S. Archer (Proc. IMechE 164, 1951, p. 351) is commonly quoted.

    Examples
    --------
    >>> from jaxhb import Disk, Load, build
    >>> law = {"law": "propeller", "rated_torque": 1e6, "rated_rpm": 100.0}
    >>> train = build(
    ...     [
    ...         Disk(name="screw", inertia=5e4),
    ...         Load(disk="screw", archer=30.0, **law),
    ...     ]
    ... )
    >>> [archer_damping(train, rpm).tolist() for rpm in (50.0, 100.0)]
    [[150000.0], [300000.0]]
    """
    topology = train.topology
    loads = train.loads
    xp = namespace(train, rpm)
    rows = np.array(topology.archer_loads, dtype=int)
    disks = np.array(topology.archer_disks, dtype=int)
    ratio = speed_ratios(train)[np.array(topology.rotor, dtype=int)[disks]]
    factor, torque, rated_rpm = (
        xp.asarray(numbers)[rows]
        for numbers in (loads.archer, loads.rated_torque, loads.rated_rpm)
    )
    damping = factor * torque * rpm / (ratio * rated_rpm**2)
    on_disks = np.arange(topology.n_scene_disks)[:, None] == disks
    return on_disks @ damping


@lru_cache(maxsize=256)
def _without(topology: Topology, *fields: str) -> Topology:
    """The topology with nothing in some of its fields."""
    emptied: dict[str, Any] = dict.fromkeys(fields, ())
    return dataclasses.replace(topology, **emptied)


def _put(values: Array, index: np.ndarray, new: Array) -> Array:
    """``values`` [n] with those at ``index`` replaced."""
    xp = namespace(values, new)
    if xp is np:
        replaced = np.array(values, dtype=np.float64)
        replaced[index] = new
        return replaced
    return xp.asarray(values).at[index].set(new)


def with_constant_links(
    train: Train,
    *,
    hz: Number | None,
    amplitude: Number | None,
    rpm: Number | None,
) -> Train:
    """Evaluate what varies; see :meth:`DriveTrain.with_constant_links`."""
    topology = train.topology
    numbers: dict[str, Number | None] = {
        "hz_links": hz,
        "amplitude_links": amplitude,
        "order_links": rpm,
    }
    why = "which is constant at one number. Give it"
    errors = _sentences(
        topology, [field for field in NEEDS if numbers[field] is None], why
    )
    errors += _table_sentences(topology, why) if rpm is None else []
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
    if rpm is not None:
        train = at_speed(train, rpm)
    fixed = without_tables(train)
    n_shafts = len(topology.shaft_names)
    links, stiffness_factors, damping_factors = factors(
        train, hz, [amplitude] * len(topology.amplitude_links)
    )

    def constant(table: Any, first: int) -> Any:
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
            stiffness=scaled(table.stiffness, seats, stiffness_factors[places]),
            damping=scaled(table.damping, seats, damping_factors[places]),
            loss_factor=scaled(table.loss_factor, seats, damping_factors[places]),
        )

    return dataclasses.replace(
        fixed,
        shafts=constant(fixed.shafts, 0),
        dampers=constant(fixed.dampers, n_shafts),
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
