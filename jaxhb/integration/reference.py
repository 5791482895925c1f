"""The reference integration on the host, and by it the true error of a harmonic
solution.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import Array, Number, on_host, refuse_tracers
from jaxhb._program import Program
from jaxhb.equations import backlash, fourier
from jaxhb.equations.backlash import MeshParameters
from jaxhb.equations.state_space import dense_linear_motion, matrices, partition
from jaxhb.equations.system import System
from jaxhb.integration import shooting
from jaxhb.integration.step import CycleTrace, Stepper, discretize, march
from jaxhb.results.answers import need_solved
from jaxhb.results.response import Response
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import excitation, listed_harmonic
from jaxhb.train.mesh_parameters import all_meshes, law_meshes
from jaxhb.train.speeds import check_speed
from jaxhb.train.varying import at_speed

# Steps per period of the highest mesh mode, and at most, where a narrow transition of
# the law asks for more.
STEPS_PER_PERIOD = 40
MOST_STEPS_PER_PERIOD = 400
STEPS = 256  # steps of a cycle, at least
# Steps of a cycle times meshes, at most: samples of such a cycle, and those between,
# take 1 GiB.
MOST_STEPS = 2**21
# Share of the strain energy of a mode that backlash meshes hold from which it is a mesh
# mode
MESH_SHARE = 0.01
CORRECTIONS = 10  # Newton steps on the segments of a cycle, at most
# Multiple of the estimated truncation error above which a correction is repeated with
# more steps
CONTRADICTS = 3.0
# Error that the steps leave in an elastic tooth force, as a share of the largest
STEP_ERROR = 1e-4
# Share of a displacement that the coordinates of the integration may lose
ROUNDED = 1e-11

_discretize = Program(discretize, static_argnames=("steps", "parts"))
_march = Program(march)


@Program
def _close(
    stepper: Stepper,
    system: System,
    load: Array,
    coefficients: Array,
    tolerance: float | Array,
) -> tuple[Array, CycleTrace, Array]:
    """First state ``(n,)``, cycle and Newton steps of the motion that closes next to
    displacements ``(S, N+1)`` m.
    """
    assert stepper.space is not None  # a stepper of one speed
    assert stepper.frequency is not None
    system, load = jax.tree.map(jnp.asarray, (system, load))
    linear = dense_linear_motion(system, stepper.frequency, load)
    harmonics = max(coefficients.shape[-1], linear.shape[-1]) - 1
    deviation = fourier.resize(coefficients, harmonics) - fourier.resize(
        linear, harmonics
    )
    motion = jnp.concatenate(
        [deviation, fourier.derivative(deviation, stepper.frequency)]
    )
    nodes = (stepper.space.coordinates @ fourier.sample(motion, shooting.SEGMENTS)).T
    nodes, trace, steps = shooting.close(
        stepper, nodes, tolerance=tolerance, most=CORRECTIONS
    )
    return nodes[0], trace, steps


@by_value
@dataclass(frozen=True)
class Orbit:
    """A cycle found by time integration, on the host; samples at ``t_j = 2 pi j /
    (Omega steps)``, backlash meshes.

    Attributes
    ----------
    deflection, rate : arrays ``(G, steps)``, m and m/s
    elastic, transmitted : arrays ``(G, steps)`` N, f(l), and f(l) with the damping
    force
    smallest, largest : arrays ``(G,)`` N, of the elastic force, between the samples too
    (cubic through l and l')
    separated : array ``(G,)``, share of the cycle in which the teeth are apart
    periodicity_error : float, relative change over the cycle, see
    :class:`jaxhb.integration.step.CycleTrace`
    settled : bool, whether the periodicity error met the tolerance
    cycles, newton_steps : int, cycles marched, 0 after shooting, and Newton steps of
    shooting
    state : array ``(n,)``, deviation at the beginning of the cycle after the last one
    stepper : Stepper
    """

    deflection: Array
    rate: Array
    elastic: Array
    transmitted: Array
    smallest: Array
    largest: Array
    separated: Array
    periodicity_error: float
    settled: bool
    cycles: int
    newton_steps: int
    state: np.ndarray
    stepper: Stepper


def resolving_steps(
    system: System,
    meshes: MeshParameters,
    frequency: Number,
    *,
    per_period: float = STEPS_PER_PERIOD,
) -> int:
    """Steps per cycle at Omega ``frequency`` rad/s that resolve the teeth.

    At least ``per_period`` steps per period of the highest natural frequency omega in
    which the backlash meshes hold 1 % of the strain energy; and ``pi / (2 transition)``
    (at most 400), so that a step at the speed ``omega h/2`` covers no more than two
    transition zones. On ``gear_train_30`` at 1800 rpm the elastic force is then within
    0.004 % of its maximum all cycle, with 12 steps per period within 0.12 %, with 7
    within 1 %.
    """
    if not len(np.asarray(meshes.link)):
        return STEPS
    parts = partition(system, meshes)
    system = jax.tree.map(np.asarray, system)
    K = matrices(system)[1]
    inertial = np.array(parts.inertial, int)
    rest = np.array(parts.damped + parts.static, int)
    stiffness = K[np.ix_(inertial, inertial)]
    if rest.size:
        coupling = K[np.ix_(rest, inertial)]
        # Disks without inertia follow the others: condensed statically, which is exact
        # without damping.
        stiffness = (
            stiffness
            - coupling.T
            @ np.linalg.lstsq(K[np.ix_(rest, rest)], coupling, rcond=None)[0]
        )
    root_mass = np.sqrt(system.mass[inertial])
    squares, modes = np.linalg.eigh(stiffness / root_mass[:, None] / root_mass)
    shapes = np.zeros((K.shape[0], inertial.size))
    shapes[inertial] = modes / root_mass[:, None]
    link = np.asarray(meshes.link)
    stiffness = np.maximum(system.stiffness[link], np.asarray(meshes.law.stiffness))
    strain = (stiffness[:, None] * system.deflections(shapes, link) ** 2).sum(axis=0)
    taking_part = strain > MESH_SHARE * np.maximum(squares, 0)
    highest = np.sqrt(squares[taking_part].max(initial=0.0))
    sharpest = np.min(np.asarray(meshes.law.transition))
    # At the speed omega h/2 a step of 2 pi/(omega n) covers pi h/n: two zones of width
    # tau h for n = pi/(2 tau).
    per_period = max(per_period, min(np.pi / (2 * sharpest), MOST_STEPS_PER_PERIOD))
    return int(np.ceil(max(STEPS, per_period * highest / float(frequency))))


def reference_orbit(
    system: System,
    meshes: MeshParameters,
    frequency: Number,
    load: Array,
    start_coefficients: Array | None = None,
    *,
    steps: int | None = None,
    cycles: int | None = None,
    tolerance: float = 1e-9,
    max_cycles: int = 300,
) -> Orbit:
    """The :class:`Orbit` of a System and its backlash meshes under ``load``
    ``(S, N+1)`` N, as :func:`integrate` finds it.

    start_coefficients : complex ``(S, N+1)`` m, displacements of a motion to check: it
    is corrected by shooting in segments of the cycle, of which ``steps`` are made a
    multiple; that also holds unstable motions. Without them the train is marched from
    its drive sides.
    """
    if cycles is not None and cycles < 1:
        raise ValueError(f"cycles is {cycles}, must be at least 1.")
    parts = partition(system, meshes)
    if steps is None:
        steps = max(resolving_steps(system, meshes, frequency), 4 * np.shape(load)[-1])
    if steps * max(len(np.asarray(meshes.link)), 1) > MOST_STEPS:
        raise ValueError(
            f"time integration would take {steps:.3g} steps a cycle of"
            f" {2 * np.pi / float(frequency):.3g} s, and takes at most"
            f" {MOST_STEPS // len(np.asarray(meshes.link)):.3g}: ask for a higher"
            " speed."
        )
    has_start = start_coefficients is not None
    newton_steps: int | Array = 0
    cycles_marched: int | Array = 0
    if has_start:
        steps += -steps % shooting.SEGMENTS
    stepper = _discretize(system, meshes, frequency, load, steps=steps, parts=parts)
    if has_start:
        state, trace, newton_steps = _close(
            stepper, system, load, jnp.asarray(start_coefficients), tolerance
        )
    else:
        assert stepper.flank_state is not None  # a stepper of one speed
        # No cycle closes to less than nothing: exactly so many are marched.
        closing_tolerance = tolerance if cycles is None else -1.0
        most_cycles = max_cycles if cycles is None else cycles
        state, trace, cycles_marched = _march(
            stepper,
            stepper.flank_state,
            tolerance=closing_tolerance,
            max_cycles=most_cycles,
        )
    meshes, deflection, rate = on_host((meshes, trace.deflection, trace.rate))
    law, viscous, contact_damping = backlash.at_samples(
        meshes, fourier.Equidistant(steps).synthesize
    )
    fine_deflection = _between(deflection, rate, 2 * np.pi / float(frequency) / steps)
    fine_law, *_ = backlash.at_samples(
        meshes, fourier.Equidistant(fine_deflection.shape[1]).synthesize
    )
    elastic = backlash.force(fine_law, fine_deflection)
    return Orbit(
        deflection=deflection,
        rate=rate,
        elastic=backlash.force(law, deflection),
        transmitted=backlash.mesh_force(
            law, viscous, contact_damping, deflection, rate
        ),
        smallest=elastic.min(axis=1, initial=np.inf),
        largest=elastic.max(axis=1, initial=-np.inf),
        separated=backlash.separated(law, deflection).mean(axis=1),
        periodicity_error=float(trace.periodicity_error),
        settled=bool(trace.periodicity_error <= tolerance),
        cycles=int(cycles_marched),
        newton_steps=int(newton_steps),
        state=np.asarray(state),
        stepper=stepper,
    )


def _between(l: Array, rate: Array, dt: float) -> np.ndarray:
    """Deflections ``(G, 16 steps)`` m on the cubics through l and l' at the samples
    ``(G, steps)``.
    """
    slope = rate * dt
    next_l = np.roll(l, -1, axis=1)
    next_slope = np.roll(slope, -1, axis=1)
    s = np.arange(16)[:, None, None] / 16
    # Hermite's cubics: the samples have the rates as well.
    values = (1 + 2 * s) * (1 - s) ** 2 * l + s * (1 - s) ** 2 * slope
    values += s**2 * (3 - 2 * s) * next_l + s**2 * (s - 1) * next_slope
    return np.moveaxis(values, 0, -1).reshape(len(l), 16 * l.shape[1])


def equations_of(
    train: DriveTrain, rpm: float
) -> tuple[System, MeshParameters, float, Array]:
    """System, meshes that have a law, Omega and load of a train at a speed."""
    check_speed(train, rpm)
    train = at_speed(train, rpm)
    system = chain.assemble(train)
    meshes = law_meshes(train)
    partition(system, meshes, train.topology.disk_names, train.topology.link_names)
    torque, _, _ = excitation(train, rpm, listed_harmonic(train.topology))
    frequency = train.topology.cycle_frequency(rpm)
    load = torque / jnp.asarray(system.radius)[:, None]
    return (
        system,
        meshes,
        frequency,
        backlash.error_load(system, all_meshes(train), frequency, load),
    )


def integrate(
    train: DriveTrain,
    *,
    rpm: float,
    cycles: int | None = None,
    steps: int | None = None,
    tolerance: float = 1e-06,
    max_cycles: int = 300,
) -> Orbit:
    """Integrate a drive train in time until it is periodic.

    Parameters
    ----------
    train : DriveTrain
    rpm : float
        Speed of the reference rotor.
    cycles : int, optional
        March exactly so many cycles of the excitation; without it until a cycle closes
        to ``tolerance``, relative, but at most ``max_cycles``.
    steps : int, optional
        Steps per cycle; without it 40 per period of the highest mesh mode, or more for
        a narrow transition of the law.

    Returns
    -------
    Orbit
        Meshes with backlash in the order of the scene.

    Raises
    ------
    ValueError
        Naming links with loss factors, or massless disks that leave no equation to
        integrate.

    Examples
    --------
    >>> from jaxhb.scene.files import load_scene
    >>> orbit = integrate(load_scene("spur_pair"), rpm=3000.0, steps=1000)
    >>> orbit.settled, orbit.elastic.max(axis=1).round(-1).tolist()
    (True, [1200.0])
    """
    refuse_tracers("integrate", train, rpm)
    system, meshes, frequency, load = equations_of(train, rpm)
    return reference_orbit(
        system,
        meshes,
        frequency,
        load,
        steps=steps,
        cycles=cycles,
        tolerance=tolerance,
        max_cycles=max_cycles,
    )


@by_value
@dataclass(frozen=True)
class Correction:
    """Change that one-cycle shooting makes to a harmonic solution: its true error.

    Attributes
    ----------
    error, peak_error : float
        Largest difference of the elastic tooth forces over the cycle and the meshes,
        and of their extremes / largest elastic tooth force.
    orbit : Orbit
        The corrected motion; ``orbit.settled`` says whether shooting closed the cycle.
    """

    error: float
    peak_error: float
    orbit: Orbit


def shooting_correction(
    response: Response, *, steps: int | None = None, tolerance: float = 1e-09
) -> Correction:
    """Start at a harmonic solution, integrate one cycle, correct by Newton: the change
    is the solution's true error.

    The cycle is cut into 32 segments that Newton's method joins (multiple shooting):
    valid on unstable motions too. The answer is as good as the integration: see
    :func:`integrate`. Teeth without damping need more steps: a change above three times
    ``response.truncation_error`` is computed again with 4 and 16 times as many, which
    overrule it if they close.

    Parameters
    ----------
    response : Response
        At one speed.
    steps : int, optional
        Exactly so many per cycle, rounded up to a multiple of 32.
    tolerance : float
        Periodicity error to reach.

    Returns
    -------
    Correction
        ``orbit.deflection.shape[1]`` steps were taken.

    Raises
    ------
    ValueError
        For scenes that cannot be integrated in time, see :func:`integrate`, and where a
        soft ground lets the mean torques turn the train so far that rounding hides the
        backlash.

    NotConverged
        For a response that solves no equations.

    Examples
    --------
    >>> import jaxhb
    >>> r = jaxhb.solve(jaxhb.load_scene("spur_pair"), rpm=3000.0)
    >>> jaxhb.shooting_correction(r).error < 1e-3
    True
    """
    refuse_tracers("shooting_correction", response)
    train = response.train
    rpm = float(response.rpm)
    if train is None:
        raise ValueError(
            "the response comes out of a transformation without its train: solve"
            " outside of it"
        )
    need_solved(response)
    if not train.topology.has_law.any():
        raise ValueError(
            f"{train.topology.title} has no mesh with backlash: its response is exact"
        )
    system, meshes, frequency, load = equations_of(train, rpm)
    start = np.asarray(response.angles) * np.asarray(system.radius)[:, None]
    farthest = np.abs(start[:, 0]).max()
    least = np.min(meshes.law.backlash, where=meshes.law.epsilon < 1, initial=np.inf)
    if ROUNDED * farthest > least:
        raise ValueError(
            f"{train.topology.title}: the mean torques turn a gear by {farthest:.1e} m"
            " along its teeth, and time integration keeps no digits for a backlash of"
            f" {least:.1e} m: add a [[load]] or a stiffer [[ground]]."
        )

    def correction(steps: int | None) -> Correction:
        orbit = reference_orbit(
            system, meshes, frequency, load, start, steps=steps, tolerance=tolerance
        )
        return _difference(response, meshes, orbit)

    best = correction(steps)
    credible = CONTRADICTS * max(float(response.truncation_error), STEP_ERROR)
    for _ in range(2 if steps is None else 0):
        if not best.orbit.settled or best.error <= credible:
            break
        # A correction far above the estimate is more often an error of the steps than
        # of the harmonics: teeth without damping ring under what coarse steps leave.
        finer = correction(4 * best.orbit.deflection.shape[1])
        if not finer.orbit.settled:
            break
        best = finer
    return best


def _difference(response: Response, meshes: MeshParameters, orbit: Orbit) -> Correction:
    """The Correction of a response by the motion that closes beside it."""
    train = response.train
    assert train is not None  # the one that was integrated
    mesh_indices = train.topology.law_index
    samples = orbit.elastic.shape[1]
    law, *_ = backlash.at_samples(
        on_host(meshes), fourier.Equidistant(samples).synthesize
    )
    deflections = np.asarray(response.deflections)[mesh_indices]
    rates = fourier.derivative(
        deflections, train.topology.cycle_frequency(float(response.rpm))
    )
    force = backlash.force(law, fourier.sample(deflections, samples))
    force = force + backlash.dry_friction(law, fourier.sample(rates, samples))
    reference_force = orbit.elastic + backlash.dry_friction(law, orbit.rate)
    signals = [response._read("force", mesh).elastic for mesh in mesh_indices]
    extremes = np.array([[signal.min, signal.max] for signal in signals])
    change = extremes - np.stack([orbit.smallest, orbit.largest], axis=1)
    largest = np.abs(reference_force).max()
    error = float(np.abs(force - reference_force).max() / largest)
    peak_error = float(np.abs(change).max() / largest)
    return Correction(error, peak_error, orbit)
