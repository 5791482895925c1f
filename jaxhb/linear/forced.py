"""Forced response of the linear train: all speeds and all orders at once, meshes in
contact.

Speeds and harmonics are one axis of the scalar sweep along the tree
(:func:`jaxhb.equations.dynamic_stiffness.solve_linear`, which has the derivatives as
well).

Power is exact from the harmonics: a link of complex stiffness C that transmits f turns
``sum_n 2 n Omega Im(C) |f^n / C|^2`` into heat, a disk with damping b ``sum_n 2 (n
Omega)^2 b |x^n|^2``; the torques of the excitation bring in ``sum_n 2 Re(q^n conj(i n
Omega x^n))``, n > 0, and transmission errors e of the meshes the work of their forces
on -e'.

The stiffness of a link may depend on its amplitude A, that of the sine with the mean
square of its vibratory twist, ``A^2 = sum_k A_k^2`` over the orders: a fixed point ``A
= g(A)`` with g a whole linear response. It is where ``dA/dt = g(A) - A`` comes to rest
from A = 0, by implicit steps that grow into those of Newton's method (pseudo-transient
continuation: C. T. Kelley, D. E. Keyes, SIAM J. Numer. Anal. 35 (1998) 508). With one
such link that is the smallest fixed point, which always exists; with several the path
need not come to rest. The derivative is that of the implicit function, ``(1 - dg/dA) dA
= dg``; second derivatives work forwards over backwards, not twice backwards.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxhb._jax import (
    Array,
    Number,
    Numbers,
    concrete,
    namespace,
    on_host,
    staged,
    traced,
)
from jaxhb._program import Program
from jaxhb.elements.sentences import SceneError
from jaxhb.equations import dynamic_stiffness, fourier
from jaxhb.equations.backlash import Law
from jaxhb.equations.system import System
from jaxhb.linear.tangent import at_pressed_load, linear_train
from jaxhb.results.answers import solved
from jaxhb.results.response import LineMotion, Response, register
from jaxhb.results.status import Status
from jaxhb.train import chain
from jaxhb.train.changes import linearised, within_range
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import (
    excitation,
    line_disks,
    line_torques,
    listed_harmonic,
    load_power_kW,
)
from jaxhb.train.kinematics import displacement_radii
from jaxhb.train.mesh_parameters import all_meshes, law_of
from jaxhb.train.speeds import HIGHEST_RPM, check_speed
from jaxhb.train.varying import (
    at_speed,
    factors,
    scaled,
    varying,
    without_tables,
)

STEPS = 100  # at most, of the path from A = 0 to amplitudes A = g(A)
SETTLED = 1e-11  # g(A) - A at which the path ends, over g(0)
ACCEPTED = 1e-8  # the same over A, up to which an amplitude is found
CURVED = 0.5  # share of g(A) - A by which a step may miss what its linearisation says
LANES = 500
CELLS = 500_000
"""Speeds times harmonics swept together, and times disks: the arrays of a sweep then
stay in the cache of a processor.
"""
SIZES = 1, 4, 16, 32, 64, 128, 256, 512
"""Numbers of speeds to which fewer are padded, where that takes no more than CELLS."""
DIGITS = 6  # decimals of stiffnesses in N m/rad that count as alike
# Force of a link or disk over load beyond which rounding alone is left: an undamped
# resonance
SINGULAR = 1e11
# Force left on a disk, over the largest force, from which the equations count as
# singular
UNSOLVED = 1e-6
# The same of the mean, over mean loads and forces, from which mean torques count as
# unbalanced
UNBALANCED = 1e-9
# Time samples per cycle, at least, and 16 per harmonic, at which extremes are looked
# for
SAMPLES = 4096

AmplitudeEquations = tuple[DriveTrain, System, Array, Array]
"""Equations of :func:`settled_amplitudes`: the train at a speed, its system without
tables, omega ``(H,)`` rad/s, and load ``(S, H)`` N.
"""


def varied(train: DriveTrain, system: System, omega: Array, amplitude: Array) -> System:
    """The ``system`` of a train without its tables, with the stiffness of every link at
    every frequency ``omega`` ``(H,)`` rad/s; ``amplitude`` ``(A,)`` rad of the links
    that depend on it.
    """
    amplitudes = jnp.broadcast_to(amplitude[:, None], (len(amplitude), len(omega)))
    links, stiffer, damped = factors(train, omega / (2 * np.pi), list(amplitudes))
    stiffness, viscous, loss = (
        jnp.broadcast_to(a[:, None], (len(a), len(omega)))
        for a in (system.stiffness, system.viscous, system.loss)
    )
    return dataclasses.replace(
        system,
        stiffness=scaled(stiffness, links, stiffer),
        viscous=scaled(viscous, links, damped),
        loss=scaled(loss, links, damped),
    )


def twist_amplitude(train: DriveTrain, system: System, deflection: Array) -> jax.Array:
    """Amplitudes ``(A,)`` in rad of the links that depend on them, from deflections
    ``(L, H)`` in m.
    """
    links = np.array(train.topology.amplitude_links, dtype=int)
    twist = deflection[links] / system.radius[system.tree.end_a[links]][:, None]
    # One-sided amplitudes are twice the coefficients; the mean is no vibration.
    square = (4 * _square(twist))[:, 1:].sum(-1)
    # The root has no derivative at 0, where nothing twists the link.
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)


def is_settled(amplitude: Array, resulting: Array) -> jax.Array:
    """Whether all amplitudes ``(A,)`` equal the ``resulting`` ones of the response with
    them.
    """
    return jnp.all(jnp.abs(resulting - amplitude) <= ACCEPTED * resulting)


def _resulting(equations: AmplitudeEquations, amplitude: jax.Array) -> jax.Array:
    """g ``(A,)``: the amplitudes of the response with links at ``amplitude``."""
    train, system, omega, load = equations
    system = varied(train, system, omega, amplitude)
    _, force = dynamic_stiffness.solve_linear(system, omega, load[:, None])
    C = dynamic_stiffness.link_stiffness(system, omega)
    return twist_amplitude(train, system, force[:, 0] / jnp.where(C == 0, 1.0, C))


def _linearised(
    resulting: Callable[[jax.Array], Array], place: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """g - A ``(A,)`` at a place A, and 1 - dg/dA ``(A, A)``, of a function g."""
    value, push = jax.linearize(resulting, place)
    basis = jnp.eye(len(place))
    return value - place, basis - jax.vmap(push)(basis).T


@jax.custom_jvp
def settled_amplitudes(equations: AmplitudeEquations) -> jax.Array:
    """Amplitudes ``(A,)`` in rad that lead to themselves; see :func:`is_settled`."""
    train, *_ = equations
    start = jnp.zeros(len(train.topology.amplitude_links))
    return at_rest(lambda amplitude: _resulting(equations, amplitude), start, SETTLED)


def at_rest(
    resulting: Callable[[jax.Array], Array], start: Array, settled: float
) -> jax.Array:
    """Where ``dA/dt = g(A) - A`` comes to rest from ``start`` ``(A,)`` upwards, with g
    the function ``resulting``; to ``settled`` of its first change, or as far as STEPS
    lead.
    """
    start = jnp.asarray(start, dtype=float)

    State = tuple[jax.Array, jax.Array, jax.Array, jax.Array, jax.Array, int]

    def size(change: jax.Array, scale: jax.Array) -> jax.Array:
        return jnp.max(jnp.abs(change) / scale, initial=0.0)

    def unsettled(state: State) -> jax.Array:
        _, change, _, scale, _, steps = state
        return (steps == 0) | ((steps <= STEPS) & (size(change, scale) > settled))

    def step(state: State) -> State:
        amplitude, change, matrix, scale, time, steps = state
        # The first step only finds the change at the start: there g stands once in the
        # program, which takes half the time to compile.
        first = steps == 0
        implicit = matrix + jnp.eye(len(matrix)) / time
        move = jnp.linalg.solve(implicit, change)
        trial = jnp.maximum(amplitude + move, start)
        trial_change, trial_matrix = _linearised(resulting, trial)
        predicted = change - matrix @ (trial - amplitude)
        # Where 1 - dg/dA is negative a long step goes against g - A, to an amplitude
        # that repels: it is refused.
        forward = jnp.sum(move * change / scale**2) > 0
        missed = size(trial_change - predicted, scale)
        before = size(change, scale)
        good = first | (forward & (missed <= CURVED * before))
        gain = before / jnp.maximum(size(trial_change, scale), 1e-3 * before)
        # Steps in time grow as g - A falls (switched evolution relaxation), which makes
        # the last ones Newton's.
        longer = jnp.where(good, time * jnp.clip(gain, 2.0, 1000.0), time / 4)
        first_scale = jnp.where(trial_change > 0, trial_change, 1.0)
        return (
            jnp.where(good, trial, amplitude),
            jnp.where(good, trial_change, change),
            jnp.where(good, trial_matrix, matrix),
            jnp.where(first, first_scale, scale),
            jnp.where(first, time, longer),
            steps + 1,
        )

    still = jnp.zeros_like(start)
    matrix = jnp.zeros((len(start), len(start)))
    state = start, still, matrix, jnp.ones_like(start), jnp.ones(()), 0
    return lax.while_loop(unsettled, step, state)[0]


@settled_amplitudes.defjvp
def _settled_jvp(
    primals: tuple[AmplitudeEquations], tangents: tuple[AmplitudeEquations]
) -> tuple[jax.Array, jax.Array]:
    (equations,) = primals
    (equations_dot,) = tangents
    amplitude = settled_amplitudes(equations)
    _, pushed = jax.jvp(
        lambda e: _resulting(e, amplitude), (equations,), (equations_dot,)
    )
    _, matrix = _linearised(lambda a: _resulting(equations, a), amplitude)
    return amplitude, jnp.linalg.solve(matrix, pushed)


@register
@dataclass(frozen=True, repr=False)
class ForcedResponse(Response):
    """A :class:`~jaxhb.Response` of the linear train, with powers in W; made by
    :func:`forced_response`.

    Parameters
    ----------
    disk_power : ``(..., S)``, turned into heat by damping to ground
    link_power : ``(..., L)``, turned into heat by shafts, dampers and meshes
    input_power : ``(...)``, brought in by the alternating torques: the sum of all heat
    temperatures : ``(..., W)`` deg C of the links with ``surface``, made by
        :func:`jaxhb.heat_balance`, else None
    """

    # Always given: a default, as it comes after defaults.
    disk_power: Array = None  # type: ignore[assignment]
    link_power: Array = None  # type: ignore[assignment]
    input_power: Array = None  # type: ignore[assignment]
    temperatures: Array | None = None

    def power(self, a: str, b: str | None = None) -> Array:
        """Power ``(...)`` in W that a disk, a damper or a link turns into heat; a link
        is given by name or by its two disks.
        """
        topology = self.topology
        if b is None and a in topology.disk_names and a not in topology.damper_names:
            return self.disk_power[..., topology.disk_index(a)]
        return self.link_power[..., topology.link_index(a, b)[0]]

    def temperature(self, a: str, b: str | None = None) -> Array | None:
        """Temperature ``(...)`` in deg C of a damper or shaft that gives off its heat,
        as :func:`jaxhb.heat_balance` found it; None of others.
        """
        warm = self.topology.warm_links
        link, _ = self.topology.link_index(a, b)
        if self.temperatures is None or link not in warm:
            return None
        return self.temperatures[..., warm.index(link)]


def forced_response(
    train: DriveTrain, *, rpm: Numbers, harmonics: int | None = None
) -> ForcedResponse:
    """Linear forced response of any train at many speeds, teeth in contact: ``Z(n) x^n
    = q^n``, docs/theory A1.

    Lines of torques at fixed frequencies stand beside the orders: ``.line(hz)`` of a
    signal is their amplitude, and extremes are those of the orders and of all lines
    together (:class:`jaxhb.results.signal.Signal`).

    Trees, closed loops, several gears on a shaft; loss factors, damping of links and to
    ground, grounds, disks without inertia; links that vary over frequency or amplitude,
    order-tuned absorbers. Eliminated along the tree as in Fridman 2009, (10)-(12). A
    thousand speeds of a train of 30 disks with 24 orders take some hundredths of a
    second.

    :class:`SceneError` if a speed is not greater than 0 or above 1e6 rpm, or
    ``harmonics`` is no whole number of at least 1.

    Parameters
    ----------
    train : DriveTrain, may be traced
    rpm : float or array ``(n,)``
        Speeds of the reference rotor.
    harmonics : int, optional
        Harmonics of the cycle; orders above are left out. Default: all that the
        excitation has.

    Returns
    -------
    ForcedResponse
        Of one speed, or with a leading axis of n. Its train has no backlash: tooth
        forces are linear and may pull. ``status`` is UNBALANCED where mean torques
        accelerate a train that nothing holds, NEAR_SINGULAR at an undamped resonance,
        MAX_STEPS where no amplitude of a link with ``over_amplitude`` was found that
        leads to itself. ``residual`` is the largest force left on a disk over the
        largest force. Every number has derivatives with respect to the train and the
        speeds.

    Examples
    --------
    Two disks under 10 N m of order 1 at a quarter of their natural frequency of 10
    rad/s.

    >>> import math
    >>> parts = [jaxhb.Disk(name=name, inertia=2.0) for name in "ab"]
    >>> parts += [jaxhb.Shaft(between=("a", "b"), stiffness=100.0, damping=0.5)]
    >>> parts += [jaxhb.Torque(disk="a", harmonics=[(1.0, 10.0, 0.0)])]
    >>> r = jaxhb.forced_response(
    ...     jaxhb.build(parts, revolutions_per_cycle=1), rpm=[2.5 * 30 / math.pi, 90.0]
    ... )
    >>> r.torque("a", "b").order(1.0).round(4).tolist(), r.status.tolist()
    ([5.3333, 41.2773], [0, 0])
    >>> r.power("a", "b").round(6).tolist(), r.input_power.round(6).tolist()
    ([0.004444, 3.77522], [0.004444, 3.77522])
    """
    original = train
    train = linearised(train)
    harmonics = checked_harmonics(train, rpm, harmonics)
    speeds = jnp.atleast_1d(jnp.asarray(rpm, dtype=float))
    if original.topology.springs:
        train, response = _at_mean_loads(original, speeds, harmonics)
    else:
        response = at_padded_speeds(_respond, train, speeds, harmonics)
    if not (traced(response) or staged()):
        response = on_host(response)
    response = dataclasses.replace(response, train=train)
    return response if np.ndim(rpm) else response[0]


def checked_harmonics(train: DriveTrain, rpm: Numbers, harmonics: int | None) -> int:
    """Number of harmonics of the linear response, by default all that the excitation
    has; :class:`SceneError` where it or a speed is none.
    """
    if harmonics is None:
        harmonics = listed_harmonic(train.topology, beside_lines=True)
    elif not (isinstance(harmonics, int | np.integer) and harmonics >= 1):
        raise SceneError(
            f"{train.topology.title}: harmonics is {harmonics}, must be a whole number"
            " of at least 1."
        )
    if not traced(rpm):
        check_speed(train, rpm, many=True)
    return int(harmonics)


def frequency_response(train: DriveTrain, disk: str, at: str, hz: Numbers) -> Array:
    """Receptance ``(n,)`` in rad/(N m) of a train, teeth in contact: the angle of
    ``disk`` over a torque on the disk ``at``, at positive ``hz`` ``(n,)``; nan where
    the equations count as singular, as at an undamped resonance.

    :class:`SceneError` if there is no such disk.

    >>> import jax.numpy as jnp
    >>> train = jaxhb.build(
    ...     [
    ...         *(jaxhb.Disk(name=n, inertia=2.0) for n in "ab"),
    ...         jaxhb.Shaft(between=("a", "b"), stiffness=100.0),
    ...     ]
    ... )
    >>> H = jaxhb.frequency_response(
    ...     train, "a", "b", jnp.array([5.0 / (2 * jnp.pi)])
    ... )  # 100 / (p^2 (p^2 + 100) 2 2)
    >>> [round(float(value), 9) for value in H.real]
    [-0.013333333]
    """
    ends = train.topology.disk_index(disk), train.topology.disk_index(at)
    return _receptance(linear_train(train), 2 * np.pi * jnp.asarray(hz, float), ends)


@partial(Program, static_argnames="ends")
def _receptance(train: DriveTrain, omega: Array, ends: tuple[int, int]) -> Array:
    """Receptance ``(n,)`` in rad/(N m) between two disks."""
    topology = train.topology
    disk, at = ends
    # A load at the root meets no difference: on a branch that is tuned to the frequency
    # its motion would lose all digits.
    rooted = chain.span_links(topology.link_ends, topology.n_disks, at)
    system = dataclasses.replace(chain.assemble(train), tree=rooted)
    column = np.eye(topology.n_disks)[:, [at]]
    load = dynamic_stiffness.unit_forces(column, len(omega))
    motion = dynamic_stiffness.solve_linear(system, omega, load)
    displacement, force = (a[:, 0] for a in motion)
    balance = dynamic_stiffness.balance(system, omega, load[:, 0], displacement, force)
    # Every frequency is judged by itself, beside a mean of zero.
    _, status = residual_and_status(
        *(jnp.stack([jnp.zeros_like(a), a], axis=-1) for a in balance)
    )
    response = displacement[disk] / (system.radius[disk] * system.radius[at])
    return jnp.where(solved(status), response, jnp.nan)


def _at_mean_loads(
    train: DriveTrain, speeds: jax.Array, harmonics: int
) -> tuple[DriveTrain, ForcedResponse]:
    """The train linearised at the mean load of the first speed, and the ForcedResponse
    at ``speeds`` ``(n,)`` of a train whose shafts or dampers have stages, stops or
    clearance: speeds with the same slopes are solved together.
    """
    loads = [at_pressed_load(train, rpm=speed) for speed in speeds]
    alike: dict = {}
    for place, load in enumerate(loads):
        (slopes,) = concrete(load.link_stiffness)
        speed_group = place if train.topology.depends_on_speed else None
        alike.setdefault((speed_group, *np.round(slopes, DIGITS)), []).append(place)
    groups = [np.array(places) for places in alike.values()]
    responses = [
        at_padded_speeds(
            _respond, linearised(loads[places[0]].train), speeds[places], harmonics
        )
        for places in groups
    ]
    order = np.argsort(np.concatenate(groups), kind="stable")
    response = jax.tree.map(lambda *parts: jnp.concatenate(parts)[order], *responses)
    # Twists of stages begin at their own zero, not at that of the slope.
    means = jnp.stack([jnp.asarray(load.angle) for load in loads])
    angles = jnp.asarray(response.angles).at[..., 0].set(means)
    ground = np.array(train.topology.ground_disk, dtype=int)
    stiffness = jnp.stack([load.train.grounds.stiffness for load in loads])
    reaction = stiffness * angles[:, ground, 0].real
    response = dataclasses.replace(response, angles=angles, ground_reaction=reaction)
    return linearised(loads[0].train), response


def at_padded_speeds(
    respond: Program, train: DriveTrain, speeds: Array, harmonics: int
) -> ForcedResponse:
    """The ForcedResponse that the program ``respond`` finds at ``speeds`` ``(n,)``,
    padded to the next of SIZES: every number of speeds is a program.
    """
    padded = next((size for size in SIZES if size >= len(speeds)), len(speeds))
    cells = padded * train.topology.n_disks * (harmonics + 1)
    if padded == len(speeds) or cells > CELLS or traced(train, speeds) or staged():
        return respond(train, speeds, harmonics)
    count = len(speeds)
    padded_speeds = np.pad(np.asarray(speeds), (0, padded - count), mode="edge")
    response = on_host(respond(train, padded_speeds, harmonics))
    return jax.tree.map(lambda values: values[:count], response)


@partial(Program, static_argnames="harmonics")
def _respond(train: DriveTrain, rpm: Array, harmonics: int) -> ForcedResponse:
    """The ForcedResponse at speeds ``(n,)``."""
    # The host refuses numbers out of range with a sentence; where they are traced they
    # become a status.
    inside = jax.vmap(lambda speed: within_range(at_speed(train, speed)))(rpm)
    valid = inside & (rpm > 0) & (rpm <= HIGHEST_RPM)
    train = jax.tree.map(lambda a: jnp.asarray(a, dtype=float), train)
    topology = train.topology
    system = None
    if not topology.depends_on_speed:
        system = chain.assemble(without_tables(train))
    rigid = chain.rigid_shape(train, displacement_radii(train))
    together = _together(topology.n_disks, harmonics, len(rpm))
    # The last speed again: a speed of 0 could make nan, which derivatives would spread.
    padded_rpm = jnp.pad(rpm, (0, -len(rpm) % together), mode="edge")
    fields_at = partial(_fields, train, system, rigid, harmonics)
    grouped = lax.map(jax.vmap(fields_at), padded_rpm.reshape(-1, together))
    fields = jax.tree.map(
        lambda a: a.reshape(len(padded_rpm), *a.shape[2:])[: len(rpm)], grouped
    )
    load_torque = fields.pop("load_torque")
    if fields["lines"] is not None:
        valid = valid & (fields["lines"].hz > 0).all(axis=-1)
    status = jnp.where(valid, fields.pop("status"), Status.INVALID_INPUT)
    ground = np.array(topology.ground_disk, dtype=int)

    def numbers_at(speed: Array) -> tuple[Law, Array, Array]:
        fixed = at_speed(train, speed)
        return law_of(fixed.meshes), fixed.disks.radius, fixed.grounds.stiffness

    law, radius, ground_stiffness = jax.vmap(numbers_at)(rpm)
    return ForcedResponse(
        **fields,
        radius=radius,
        law=law,
        rpm=rpm,
        load_torque=load_torque,
        load_power=1e3 * load_power_kW(train, rpm, load_torque),
        ground_reaction=ground_stiffness * fields["angles"][:, ground, 0].real,
        status=status,
        truncation_error=jnp.zeros(len(rpm)),
        steps=jnp.zeros(len(rpm), dtype=int),
        topology=topology,
        resolution=16 * harmonics * max(1, -(-SAMPLES // (16 * harmonics))),
    )


def _together(disks: int, harmonics: int, speeds: int) -> int:
    """Number of speeds that are swept together, one that divides them if there is."""
    most = min(speeds, max(1, min(LANES, CELLS // disks) // (harmonics + 1)))
    return min(range(most, most // 2, -1), key=lambda size: -speeds % size)


def _fields(
    train: DriveTrain,
    system: System | None,
    rigid: Array,
    harmonics: int,
    rpm: Number,
) -> dict[str, Array]:
    """Fields of the response at a speed, by name; ``system`` is None where it depends
    on the speed.
    """
    if system is None:
        train = at_speed(train, rpm)
        system = chain.assemble(without_tables(train))
    topology = train.topology
    torque, load_torque, _ = excitation(train, rpm, harmonics, beside_lines=True)
    omega = topology.cycle_frequency(rpm) * jnp.arange(harmonics + 1)
    hz = None
    if len(line_disks(topology)):
        # Lines at fixed frequencies are further columns of the same solve.
        hz, line_torque = line_torques(train, rpm)
        omega = jnp.concatenate([omega, 2 * jnp.pi * hz])
        torque = jnp.concatenate([torque, line_torque], axis=1)
    load = torque / system.radius[:, None]
    amplitude = jnp.zeros(0)
    if topology.amplitude_links:
        amplitude = settled_amplitudes((train, system, omega, load))
    if varying(topology):
        system = varied(train, system, omega, amplitude)
    C = dynamic_stiffness.link_stiffness(system, omega)
    shafts = len(topology.link_names) - len(topology.mesh_names)
    exciting = load
    error = all_meshes(train).error
    if error is not None:
        # Teeth deflect by D x - e: errors e act on the linear train as a load D^T C e,
        # and reduce the link's own force.
        error = fourier.resize(error, harmonics)
        error = jnp.pad(error, ((0, 0), (0, len(omega) - harmonics - 1)))
        load = load + system.spread(C[shafts:] * error, slice(shafts, None))
    displacement, force = (
        a[:, 0] for a in dynamic_stiffness.solve_linear(system, omega, load[:, None])
    )
    residual, status = residual_and_status(
        *dynamic_stiffness.balance(system, omega, load, displacement, force)
    )
    _, probed = residual_and_status(
        *dynamic_stiffness.probe_balance(system, omega, load)
    )
    status = jnp.maximum(status, probed)
    # For the mean the sweep holds a floating train at its root: the rigid rotation that
    # this leaves is taken out again.
    mean = (omega == 0) * chain.drift(system, rigid, displacement.real)
    angles = chain.to_angles(system, displacement - mean)

    if error is not None:
        force = jnp.asarray(force).at[shafts:].add(-C[shafts:] * error)
    # From the forces: differences of displacements lose the digits of stiff links.
    deflection = force / jnp.where(C == 0, 1.0, C)
    elastic = C.real * deflection
    if topology.amplitude_links:
        settled = is_settled(amplitude, twist_amplitude(train, system, deflection))
        status = jnp.where(settled, status, jnp.maximum(status, Status.MAX_STEPS))
    ends = system.radius[system.tree.end_a][:, None]

    def power(values: Array) -> Array:
        return (2 * omega * values).sum(-1)

    def work_rate(force: Array, displacement: Array) -> Array:
        return power((force * jnp.conj(1j * displacement)).real.sum(0))

    disk_power = power(omega * system.damping[:, None] * _square(displacement))
    link_power = power(C.imag * _square(deflection))
    input_power = work_rate(exciting, displacement)
    if error is not None:
        input_power = input_power - work_rate(force[shafts:], error)
    power_defect = (input_power - disk_power.sum() - link_power.sum()) / jnp.where(
        input_power > 0, input_power, 1.0
    )
    motion = {
        "angles": angles,
        "torques": (force * ends)[:shafts],
        "elastic_torques": (elastic * ends)[:shafts],
        "deflections": deflection[shafts:],
        "forces": force[shafts:],
        "elastic_forces": elastic[shafts:],
    }
    of_lines = {name: values[:, harmonics + 1 :] for name, values in motion.items()}
    of_orders = {name: values[:, : harmonics + 1] for name, values in motion.items()}
    return of_orders | {
        "lines": None if hz is None else LineMotion(hz=hz, **of_lines),
        "load_torque": load_torque,
        "residual": residual,
        "status": status,
        "power_defect": power_defect,
        "disk_power": disk_power,
        "link_power": link_power,
        "input_power": input_power,
    }


def _square(values: Array) -> Array:
    """Square of the modulus, whose derivative at 0 is 0."""
    return values.real**2 + values.imag**2


def residual_and_status(left: Array, load: Array, force: Array) -> tuple[Array, Array]:
    """Residual and status ``(...)`` of linear solves, from their
    ``dynamic_stiffness.balance`` ``(..., H)``.

    Singular equations have a huge motion, or forces that miss the balance, but are
    finite; numbers that are not finite have overflowed.
    """
    xp = namespace(left, load, force)
    size = xp.max(load, axis=-1) + xp.max(force, axis=-1)
    # The mean is judged by itself below: torques that do not balance are no fault of
    # the sweep.
    residual = xp.max(left[..., 1:], axis=-1, initial=0.0) / xp.where(
        size > 0, size, 1.0
    )
    balanced = left[..., 0] <= UNBALANCED * (load[..., 0] + force[..., 0])
    regular = (residual <= UNSOLVED) & (
        xp.max(force, axis=-1) <= SINGULAR * xp.max(load, axis=-1)
    )
    status = xp.where(balanced, Status.CONVERGED, Status.UNBALANCED)
    status = xp.where(regular, status, Status.NEAR_SINGULAR)
    return residual, xp.where(
        xp.isfinite(size + left.sum(-1)), status, Status.NONFINITE
    )
