"""Critical speeds: where an order of the excitation meets a natural frequency, order x
rpm / 60 = Hz.

Order-tuned absorbers make frequencies depend on the speed: roots are then bracketed
between speeds and refined.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, Number, refuse_tracers
from jaxhb._shown import brief
from jaxhb.elements.sentences import SceneError
from jaxhb.equations.backlash import error_load
from jaxhb.linear.damped import DAMPED_DISKS, damping_ratios
from jaxhb.linear.modal import Modes, natural_frequencies
from jaxhb.linear.sensitivity import frequencies_hz, mode_shares
from jaxhb.linear.tangent import at_pressed_load, linear_train
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import excitation, line_torques, listed_harmonic
from jaxhb.train.mesh_parameters import all_meshes
from jaxhb.train.speeds import check_speed
from jaxhb.train.varying import at_speed, varying, without_tables

ELASTIC = "elastic"
RIGID = "rigid"
RING = "ring only"
# Share of the strain energy in links below which a mode is rigid: on ground springs, or
# at 0 Hz
STRAINED = 0.01
# Share of the kinetic energy in the rings of dampers from which a rigid mode is that of
# rings only
RINGS = 0.99
EXCITED = 1e-3  # torque of an order over the largest from which it counts as excited
# Share of the sum of all torques of an order below which a modal torque is rounding
ROUNDED = 1e-12


@dataclass(frozen=True)
class Critical:
    """One critical speed: ``rpm``, ``order``, ``mode`` as natural_frequencies counts,
    ``hz`` and ``torque``.

    The torque in N m is the amplitude of the modal torque of the order, ``|sum phi
    T|``, with a shape whose largest angle is 1.
    """

    rpm: Number
    order: float
    mode: int
    hz: Number
    torque: Number


@dataclass(frozen=True)
class LineCritical:
    """The elastic mode that is nearest to a line of a torque at ``hz``: number,
    frequency ``mode_hz`` and modal torque in N m.

    ``rpm`` is the speed at which it is nearest, on the line where its frequency crosses
    that. It is None where natural frequencies do not depend on the speed: the mode is
    then nearest at every speed, and the modal torque is the largest of the speeds.
    """

    hz: float
    mode: int
    mode_hz: float
    rpm: float | None
    torque: float

    @property
    def apart(self) -> float:
        """Frequency of the mode over that of the line, less 1."""
        return self.mode_hz / self.hz - 1


@brief
@dataclass(frozen=True)
class Campbell:
    """Natural frequencies over the speed and where orders meet them; made by
    :func:`campbell`.

    Parameters
    ----------
    rpm : ``(n,)``, rising; orders : ``(o,)``, both of the reference rotor
    kinds : tuple of str, one for each of m modes: "elastic", "rigid" or "ring only"
    frequencies_hz : ``(n, m)`` Hz
    critical : tuple of Critical, elastic modes only, by rising speed
    lines : tuple of LineCritical, of torques with lines at fixed frequencies
    """

    rpm: np.ndarray
    orders: np.ndarray
    kinds: tuple
    frequencies_hz: np.ndarray
    critical: tuple
    lines: tuple = ()

    def elastic(self, count: int) -> list[int]:
        """Numbers of the first ``count`` elastic modes."""
        return [k for k, kind in enumerate(self.kinds) if kind == ELASTIC][:count]

    def shown(self, count: int) -> list[int]:
        """Numbers of the first ``count`` elastic modes and of all modes below them that
        are rigid or of rings only.
        """
        elastic = self.elastic(count)
        last = elastic[-1] if elastic else len(self.kinds) - 1
        return list(range(last + 1))

    def reached(self) -> int:
        """Count the elastic modes with a frequency that an order reaches within the
        speeds.
        """
        top = max(self.orders, default=0.0) * float(self.rpm[-1]) / 60
        return sum(
            float(self.frequencies_hz[:, k].min()) <= top
            for k in self.elastic(len(self.kinds))
        )


def shares_in_mode(
    critical: Iterable[Critical], torques: Sequence[float] | np.ndarray
) -> list[float]:
    """Modal torques of critical speeds over the largest torque of their mode: torques
    of different modes do not compare.
    """
    largest: dict = {}
    for speed, torque in zip(critical, torques, strict=True):
        largest[speed.mode] = max(torque, largest.get(speed.mode, 0.0))
    return [
        torque / (largest[speed.mode] or 1.0)
        for speed, torque in zip(critical, torques, strict=True)
    ]


def mode_kinds(modes: Modes, rings: Collection[str]) -> tuple[str, ...]:
    """Kind of each mode: "elastic", "rigid" (no link is strained) or "ring only"
    (rigid, and only disks named ``rings`` move).
    """
    is_ring = [name in rings for name in modes.names]
    ring_share = modes.kinetic_share[:, is_ring].sum(1)
    # At 0 Hz no energy is shared out; on soft grounds nearly all of it lies in their
    # springs.
    rigid = modes.strain_share.sum(1) < STRAINED
    rigid_kind = np.where(ring_share > RINGS, RING, RIGID)
    return tuple(np.where(rigid, rigid_kind, ELASTIC).tolist())


def modes_of(
    train: DriveTrain, most: int | None = None
) -> tuple[Modes, tuple[str, ...], Array]:
    """Natural frequencies, the kind of every mode and its damping ratio; of a train of
    many disks only the ``most`` lowest modes, whose ratios are nan.
    """
    few = train.topology.n_disks <= DAMPED_DISKS
    modes = natural_frequencies(train, count=None if few else most)
    kinds = mode_kinds(modes, train.topology.damper_names)
    ratios = damping_ratios(train, modes) if few else np.full(len(kinds), np.nan)
    return modes, kinds, ratios


def excited_orders(train: DriveTrain, *, rpm: Sequence[float] | Array) -> list[float]:
    """Orders of the reference rotor, rising, in which the excitation has at any speed a
    torque above 1e-3 of the largest.
    """
    harmonics = listed_harmonic(train.topology, beside_lines=True)
    torque = [
        np.abs(np.asarray(_torques(train, speed, harmonics))).max(0) for speed in rpm
    ]
    # Harmonic 0 is the mean torque, which excites nothing.
    largest = np.max(torque, axis=0)[1:]
    excited = np.flatnonzero(largest > EXCITED * largest.max(initial=0.0)) + 1
    return (excited / train.topology.revolutions_per_cycle).tolist()


def campbell(
    train: DriveTrain,
    *,
    rpm: Sequence[float] | Array,
    orders: Sequence[float] | None = None,
    count: int = 6,
    links_at: Mapping[str, float] | tuple[()] = (),
) -> Campbell:
    """Natural frequencies over the speed, undamped, teeth in contact, and the critical
    speeds between them.

    The diagram of W. Campbell, Trans. ASME 46 (1924) 31. :func:`critical_speed` has the
    derivatives.

    :class:`SceneError` if speeds or orders are not greater than 0, speeds are above 1e6
    rpm or do not rise, or a link varies with a number that is not given.

    Parameters
    ----------
    train : DriveTrain, concrete
    rpm : sequence of float ``(n,)``, rising
        Speeds of the reference rotor; critical speeds lie between the first and the
        last. Where frequencies depend on the speed, two crossings between neighbours
        are not seen.
    orders : sequence of float, optional
        Default: those of the excitation above 1e-3 of the largest.
    count : int
        Number of elastic modes, the lowest.
    links_at : mapping, optional
        ``hz`` and ``amplitude`` at which varying links are held, see
        :meth:`DriveTrain.with_constant_links`.

    Examples
    --------
    Two disks of 2 kg m2 on 100 N m/rad, 10 rad/s.

    >>> parts = [jaxhb.Disk(name=name, inertia=2.0) for name in "ab"]
    >>> train = jaxhb.build([*parts, jaxhb.Shaft(between=("a", "b"), stiffness=100.0)])
    >>> [
    ...     round(c.rpm, 3)
    ...     for c in campbell(train, rpm=[20.0, 100.0], orders=[1.0, 2.0]).critical
    ... ]
    [47.746, 95.493]
    """
    refuse_tracers(
        "campbell",
        train,
        rpm,
        instead="pass its critical speeds to jaxhb.critical_speed, which traces",
    )
    title = train.topology.title
    check_speed(train, rpm, many=True)
    errors = []
    if len(rpm) < 2 or np.any(np.diff(rpm) <= 0):
        errors.append(
            f"{title}: a Campbell diagram needs at least two speeds, in rising order."
        )
    listed = () if orders is None else orders
    invalid = [order for order in listed if not (np.isfinite(order) and order > 0)]
    errors += [
        f"{title}: the order is {order}, must be greater than 0." for order in invalid
    ]
    if errors:
        raise SceneError(errors)
    orders = excited_orders(train, rpm=rpm) if orders is None else sorted(set(orders))
    # Order-tuned absorbers and stiffness over the speed, unless ``links_at`` holds
    # theirs, and stages under changing mean torques make frequencies depend on it.
    tuned = train.topology.depends_on_speed and "rpm" not in dict(links_at)
    constant = not (tuned or _stages_change(train, rpm))

    def modes_at(speed: Number) -> Modes:
        return natural_frequencies(_at_speed(train, speed, links_at))

    modes = [modes_at(speed) for speed in (rpm[:1] if constant else rpm)]
    rows = modes * len(rpm) if constant else modes
    hz = np.array([row.frequencies_hz for row in rows])
    # A mode has one kind, though absorbers change with the speed: the middle of the
    # range decides.
    kinds = mode_kinds(modes[len(modes) // 2], train.topology.damper_names)
    diagram = Campbell(np.array(rpm, float), np.array(orders, float), kinds, hz, ())
    critical = []
    for k in diagram.elastic(count):
        for order in orders:
            crossings = _crossings(modes_at, diagram.rpm, hz[:, k], k, order, constant)
            for speed in crossings:
                modes_there = modes[0] if constant else modes_at(speed)
                shape = modes_there.shapes[k]
                torque, largest = map(float, _order_torque(train, shape, speed, order))
                torque = torque if torque > ROUNDED * largest else 0.0
                critical.append(
                    Critical(
                        float(speed), float(order), k, order * float(speed) / 60, torque
                    )
                )
    critical.sort(key=lambda speed: (speed.rpm, speed.order, speed.mode))
    lines = _line_criticals(train, diagram, modes_at, constant)
    return replace(diagram, critical=tuple(critical), lines=tuple(lines))


def _line_criticals(
    train: DriveTrain,
    diagram: Campbell,
    modes_at: Callable[[Number], Modes],
    constant: bool,
) -> list[LineCritical]:
    """Where modes cross the lines of torques at fixed frequencies, and of a line that
    none crosses the nearest mode.
    """
    elastic = diagram.elastic(len(diagram.kinds))
    if not elastic:
        return []
    every_hz, _ = line_torques(train, diagram.rpm)
    criticals = []
    for hz in np.unique(np.asarray(every_hz)).tolist():
        distance = np.abs(diagram.frequencies_hz[:, elastic] - hz)
        row, column = np.unravel_index(distance.argmin(), distance.shape)
        places = [(elastic[column], float(diagram.rpm[row]))]
        if not constant:
            crossed = [
                (mode, speed)
                for mode in elastic
                for speed in _roots(modes_at, diagram, mode, hz)
            ]
            places = crossed or places
        for mode, rpm in places:
            modes = modes_at(rpm)
            criticals.append(
                LineCritical(
                    hz=hz,
                    mode=mode,
                    mode_hz=float(modes.frequencies_hz[mode]),
                    rpm=None if constant else rpm,
                    torque=_line_torque(
                        train, modes.shapes[mode], hz, diagram.rpm if constant else rpm
                    ),
                )
            )
    return criticals


def _line_torque(train: DriveTrain, shape: Array, hz: float, rpm: Number) -> float:
    """Amplitude in N m of the modal torque of a line on a mode shape ``(S,)``, the
    largest of some speeds.
    """
    every_hz, torques = line_torques(train, rpm)
    together = torques[..., np.asarray(every_hz) == hz].sum(axis=-1)
    return float(2 * np.abs(together @ np.asarray(shape)).max())


def _roots(
    modes_at: Callable[[Number], Modes], diagram: Campbell, mode: int, hz: float
) -> list[float]:
    """Speeds at which the frequency of a mode, which depends on the speed, is
    ``hz``.
    """
    distance = diagram.frequencies_hz[:, mode] - hz

    def distance_at(speed: float) -> Number:
        return modes_at(speed).frequencies_hz[mode] - hz

    return _zeros(distance_at, diagram.rpm, distance)


def critical_speed(
    train: DriveTrain,
    near: Critical,
    *,
    links_at: Mapping[str, float] | tuple[()] = (),
    heavy: Array | None = None,
) -> Critical:
    """Differentiable critical speed and its modal torque, with derivatives with respect
    to the train.

    Two steps of Newton's method from ``near.rpm`` on ``f(rpm) - order rpm / 60 = 0``:
    as it converges quadratically, the first one has the first derivative of the root,
    the second one also the second and the third.

    ``near``, which :func:`campbell` finds in this train, gives the mode, the order and
    the speed to begin at; ``links_at`` as there, ``heavy`` as in
    :func:`jaxhb.frequencies_hz`.
    ``rpm``, ``hz`` and ``torque`` (N m) of the result are arrays with three
    derivatives, of simple natural frequencies.

    Two disks of 2 kg m2: the speed grows with the root of the stiffness.

    >>> import jax
    >>> parts = [jaxhb.Disk(name=name, inertia=2.0) for name in "ab"]
    >>> train = jaxhb.build([*parts, jaxhb.Shaft(between=("a", "b"), stiffness=100.0)])
    >>> (near,) = jaxhb.campbell(train, rpm=[20.0, 60.0], orders=[2.0]).critical
    >>> slope = jax.grad(
    ...     lambda k: (
    ...         jaxhb.critical_speed(train.replace({"a|b.stiffness": k}), near).rpm
    ...     )
    ... )(100.0)
    >>> round(near.rpm, 6), round(float(slope), 9)
    (47.746483, 0.238732415)
    """

    def distance(speed: Number) -> Array:
        hz = frequencies_hz(_at_speed(train, speed, links_at), heavy)
        return hz[near.mode] - near.order * speed / 60

    # A constant: all derivatives come from the two steps.
    rpm = float(near.rpm)
    for _ in range(2):
        miss, slope = jax.value_and_grad(distance)(rpm)
        rpm = rpm - miss / slope
    shape = mode_shares(_at_speed(train, rpm, links_at), heavy).shapes[near.mode]
    torque, _ = _order_torque(train, shape, rpm, near.order)
    return Critical(rpm, near.order, near.mode, near.order * rpm / 60, torque)


def _at_speed(
    train: DriveTrain, rpm: Number, links_at: Mapping[str, float] | tuple[()]
) -> DriveTrain:
    """The train with its stages and varying links held as they are at a speed."""
    held = dict(links_at)
    train = linear_train(at_speed(train, held.pop("rpm", rpm)), rpm=rpm)
    return train.with_constant_links(**held) if varying(train.topology) else train


def _stages_change(train: DriveTrain, rpm: Sequence[float] | Array) -> bool:
    """Whether shafts and dampers with stages have another stiffness at another
    speed.
    """
    if not train.topology.springs:
        return False
    slopes = np.array(
        [at_pressed_load(train, rpm=float(speed)).link_stiffness for speed in rpm]
    )
    return bool(np.ptp(slopes, axis=0).max() > ROUNDED * np.abs(slopes).max())


def _crossings(
    modes_at: Callable[[Number], Modes],
    rpm: np.ndarray,
    hz: np.ndarray,
    mode: int,
    order: float,
    constant: bool,
) -> list[float]:
    """Speeds at which ``order`` meets the frequency of ``mode``, which is ``hz``
    ``(n,)`` at ``rpm`` ``(n,)``.
    """
    if constant:
        speed = 60 * hz[0] / order
        return [speed] if rpm[0] <= speed <= rpm[-1] else []

    def distance_at(speed: float) -> Number:
        return modes_at(speed).frequencies_hz[mode] - order * speed / 60

    return _zeros(distance_at, rpm, hz - order * rpm / 60)


def _zeros(
    distance_at: Callable[[float], Number], rpm: np.ndarray, distance: np.ndarray
) -> list[float]:
    """Speeds at which a distance, which is known at some ``rpm``, is zero."""
    # Takes a tenth of a second, which other commands are spared.
    from scipy.optimize import brentq

    # At a root the product with either neighbour is 0, not negative.
    exact = rpm[distance == 0].tolist()
    changes = np.flatnonzero(distance[:-1] * distance[1:] < 0)
    return exact + [
        brentq(distance_at, rpm[i], rpm[i + 1], rtol=1e-12) for i in changes
    ]


def _torques(train: DriveTrain, rpm: Number, harmonics: int) -> Array:
    """Torques ``(S, N+1)`` in N m on the disks, from the excitation and the
    transmission errors of the meshes.
    """
    torque, _, _ = excitation(train, rpm, harmonics, beside_lines=True)
    meshes = all_meshes(at_speed(train, rpm))
    if meshes.error is None:
        return torque
    system = chain.assemble(without_tables(train), rpm)
    frequency = train.topology.cycle_frequency(rpm)
    load = error_load(system, meshes, frequency, torque / system.radius[:, None])
    return load[:, : harmonics + 1] * system.radius[:, None]


def _order_torque(
    train: DriveTrain, shape: Array, rpm: Number, order: float
) -> tuple[Number, Number]:
    """Amplitude in N m of the modal torque of an order on a mode shape ``(S,)``, and
    the sum of the amplitudes on all disks.
    """
    harmonic = order * train.topology.revolutions_per_cycle
    if abs(harmonic - round(harmonic)) > 1e-9:
        return 0.0, 0.0
    torque = _torques(train, rpm, round(harmonic))[:, round(harmonic)]
    # Coefficients are two-sided: an amplitude is twice their modulus.
    return 2 * jnp.abs(shape @ torque), 2 * jnp.abs(torque).sum()
