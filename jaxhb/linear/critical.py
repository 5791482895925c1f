"""Critical speeds: where an order of the excitation meets a natural frequency, order x
rpm / 60 = Hz.

Order-tuned absorbers make frequencies depend on the speed: roots are then looked for
between speeds and refined.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, refuse_tracers
from jaxhb._shown import brief
from jaxhb.elements.elements import SceneError
from jaxhb.equations.backlash import all_meshes, error_load
from jaxhb.excitation.torques import excitation, listed_harmonic
from jaxhb.linear.damped import DAMPED_DISKS, damping_ratios
from jaxhb.linear.modal import natural_frequencies
from jaxhb.linear.sensitivity import frequencies_hz, mode_shares
from jaxhb.linear.tangent import at_pressed_load, linear_train
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed
from jaxhb.train.varying import varying, without_tables

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
# Share of all torques of an order below which what they do on a shape is rounding
ROUNDED = 1e-12


@dataclass(frozen=True)
class Critical:
    """One critical speed: ``rpm``, ``order``, ``mode`` as natural_frequencies counts,
    ``hz`` and ``torque``.

    The torque in N m is the modal one of the order, ``|sum phi T|``, amplitude, with 1
    the largest angle of the shape.
    """

    rpm: float
    order: float
    mode: int
    hz: float
    torque: float


@brief
@dataclass(frozen=True)
class Campbell:
    """Natural frequencies over the speed and where orders meet them; made by
    :func:`campbell`.

    Parameters
    ----------
    rpm : ``(n,)``, rising; orders : ``(o,)``, both of the reference rotor
    kinds : tuple of str, of each of m modes "elastic", "rigid" or "ring only"
    frequencies_hz : ``(n, m)`` Hz
    critical : tuple of Critical, elastic modes only, by rising speed
    """

    rpm: np.ndarray
    orders: np.ndarray
    kinds: tuple
    frequencies_hz: np.ndarray
    critical: tuple

    def elastic(self, count: int) -> list[int]:
        """Numbers of the first ``count`` elastic modes."""
        return [k for k, kind in enumerate(self.kinds) if kind == ELASTIC][:count]

    def shown(self, count: int) -> list[int]:
        """Numbers of the first ``count`` elastic modes and of all below that are rigid
        or of rings only.
        """
        elastic = self.elastic(count)
        return list(range((elastic[-1] if elastic else len(self.kinds) - 1) + 1))

    def reached(self) -> int:
        """How many elastic modes have a frequency that an order reaches within the
        speeds.
        """
        top = max(self.orders, default=0.0) * float(self.rpm[-1]) / 60
        return sum(
            float(self.frequencies_hz[:, k].min()) <= top
            for k in self.elastic(len(self.kinds))
        )


def shares_in_mode(critical, torques):
    """Modal torques of critical speeds over the largest of their mode, as those of
    different modes do not compare.
    """
    largest = {}
    for one, torque in zip(critical, torques, strict=True):
        largest[one.mode] = max(torque, largest.get(one.mode, 0.0))
    return [
        torque / (largest[one.mode] or 1.0)
        for one, torque in zip(critical, torques, strict=True)
    ]


def mode_kinds(modes, rings):
    """Of each mode "elastic", "rigid" (no link is strained) or "ring only" (rigid, only
    disks named ``rings`` move).
    """
    ring = modes.kinetic_share[:, [name in rings for name in modes.names]].sum(1)
    # At 0 Hz no energy is shared out; on soft grounds nearly all of it lies in their
    # springs.
    loose = modes.strain_share.sum(1) < STRAINED
    return tuple(
        ELASTIC if not free else RING if share > RINGS else RIGID
        for free, share in zip(loose, ring, strict=True)
    )


def modes_of(train, most=None):
    """Natural frequencies, of a train of many disks ``most`` of them, the kind of every
    mode and its damping ratio.
    """
    few = train.topology.n_disks <= DAMPED_DISKS
    found = natural_frequencies(train, count=None if few else most)
    kinds = mode_kinds(found, train.topology.damper_names)
    return (
        found,
        kinds,
        damping_ratios(train, found) if few else np.full(len(kinds), np.nan),
    )


def excited_orders(train, *, rpm):
    """Orders of the reference rotor, rising, that the excitation has at any speed,
    above 1e-3 of the largest.
    """
    harmonics = listed_harmonic(train.topology)
    torque = [
        np.abs(np.asarray(_torques(train, speed, harmonics))).max(0) for speed in rpm
    ]
    # Harmonic 0 is the mean torque, which excites nothing.
    largest = np.max(torque, axis=0)[1:]
    there = np.flatnonzero(largest > EXCITED * largest.max(initial=0.0)) + 1
    return (there / train.topology.revolutions_per_cycle).tolist()


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
    rpm or do not rise, or a link varies by what is not given.

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
        Of how many elastic modes, the lowest.
    links_at : mapping, optional
        ``hz`` and ``amplitude`` at which links that vary are taken, see
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
    name = train.topology.title
    check_speed(train, rpm, many=True)
    falling = len(rpm) < 2 or np.any(np.diff(rpm) <= 0)
    errors = [
        f"{name}: a Campbell diagram needs at least two speeds, in rising order."
    ] * bool(falling)
    wrong = [
        order
        for order in (() if orders is None else orders)
        if not (np.isfinite(order) and order > 0)
    ]
    errors += [
        f"{name}: the order is {order}, must be greater than 0." for order in wrong
    ]
    if errors:
        raise SceneError(errors)
    orders = excited_orders(train, rpm=rpm) if orders is None else sorted(set(orders))
    # Order-tuned absorbers, unless ``links_at`` holds theirs, and stages under changing
    # mean torques make frequencies depend on the speed.
    tuned = train.topology.order_links and "rpm" not in dict(links_at)
    constant = not (tuned or _stages_change(train, rpm))

    def modes_at(speed):
        return natural_frequencies(_held(train, speed, links_at))

    modes = [modes_at(speed) for speed in (rpm[:1] if constant else rpm)]
    hz = np.array([one.frequencies_hz for one in modes * (len(rpm) if constant else 1)])
    # A mode has one kind, though absorbers change with the speed: the middle of the
    # range decides.
    kinds = mode_kinds(modes[len(modes) // 2], train.topology.damper_names)
    found = Campbell(np.array(rpm, float), np.array(orders, float), kinds, hz, ())
    critical = []
    for k in found.elastic(count):
        for order in orders:
            for speed in _crossings(modes_at, found.rpm, hz[:, k], k, order, constant):
                shape = (modes[0] if constant else modes_at(speed)).shapes[k]
                torque, largest = map(float, _order_torque(train, shape, speed, order))
                torque = torque if torque > ROUNDED * largest else 0.0
                critical.append(
                    Critical(
                        float(speed), float(order), k, order * float(speed) / 60, torque
                    )
                )
    return replace(
        found, critical=tuple(sorted(critical, key=lambda c: (c.rpm, c.order, c.mode)))
    )


def critical_speed(
    train: DriveTrain,
    near: Critical,
    *,
    links_at: Mapping[str, float] | tuple[()] = (),
    heavy: Array | None = None,
) -> Critical:
    """A critical speed and its modal torque with their derivatives with respect to the
    train.

    Two steps of Newton's method from ``near.rpm`` on ``f(rpm) - order rpm / 60 = 0``:
    as it converges quadratically, the first one has the first derivative of the root,
    the second one also the second and the third.

    ``near``, found by :func:`campbell` in this train, tells the mode, the order, and
    where to look; ``links_at`` as there, ``heavy`` as in :func:`jaxhb.frequencies_hz`.
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

    def left(speed):
        return (
            frequencies_hz(_held(train, speed, links_at), heavy)[near.mode]
            - near.order * speed / 60
        )

    # A constant: all derivatives come from the two steps.
    rpm = float(near.rpm)
    for _ in range(2):
        miss, slope = jax.value_and_grad(left)(rpm)
        rpm = rpm - miss / slope
    shape = mode_shares(_held(train, rpm, links_at), heavy).shapes[near.mode]
    return Critical(
        rpm,
        near.order,
        near.mode,
        near.order * rpm / 60,
        _order_torque(train, shape, rpm, near.order)[0],
    )


def _held(train, rpm, links_at):
    """The train with stages and the links that vary as they are at a speed."""
    train = linear_train(train, rpm=rpm)
    return (
        train.with_constant_links(**{"rpm": rpm} | dict(links_at))
        if varying(train.topology)
        else train
    )


def _stages_change(train, rpm):
    """Whether shafts and dampers with stages have other stiffnesses at other speeds."""
    if not train.topology.springs:
        return False
    slopes = np.array(
        [at_pressed_load(train, rpm=float(speed)).link_stiffness for speed in rpm]
    )
    return bool(np.ptp(slopes, axis=0).max() > ROUNDED * np.abs(slopes).max())


def _crossings(modes_at, rpm, hz, mode, order, constant):
    """Speeds at which ``order`` has the frequency of ``mode``, given at ``rpm``."""
    if constant:
        speed = 60 * hz[0] / order
        return [speed] if rpm[0] <= speed <= rpm[-1] else []
    from scipy.optimize import (
        brentq,
    )  # a tenth of a second, which other commands are spared

    distance = hz - order * rpm / 60
    # At a root the product with either neighbour is 0, not negative.
    exact = rpm[distance == 0].tolist()
    changes = np.flatnonzero(distance[:-1] * distance[1:] < 0)

    def left(speed):
        return modes_at(speed).frequencies_hz[mode] - order * speed / 60

    return exact + [brentq(left, rpm[i], rpm[i + 1], rtol=1e-12) for i in changes]


def _torques(train, rpm, harmonics):
    """Torques ``(S, N+1)`` N m on the disks, of the excitation and of the transmission
    errors of the meshes.
    """
    torque = excitation(train, rpm, harmonics)[0]
    meshes = all_meshes(train)
    if meshes.error is None:
        return torque
    system = chain.assemble(without_tables(train))
    frequency = train.topology.cycle_frequency(rpm)
    load = error_load(system, meshes, frequency, torque / system.radius[:, None])
    return load[:, : harmonics + 1] * system.radius[:, None]


def _order_torque(train, shape, rpm, order):
    """Amplitude in N m of what the torques of an order do on a mode shape, and the sum
    of those on all disks.
    """
    harmonic = order * train.topology.revolutions_per_cycle
    if abs(harmonic - round(harmonic)) > 1e-9:
        return 0.0, 0.0
    torque = _torques(train, rpm, round(harmonic))[:, round(harmonic)]
    # Coefficients are two-sided: an amplitude is twice their modulus.
    return 2 * jnp.abs(shape @ torque), 2 * jnp.abs(torque).sum()
