"""Energies, matrices and natural frequencies that can be differentiated, in any mode of
jax.

Where eigenvalues repeat, neither their shapes nor the derivative of each is unique; the
first derivative of their sum is: shapes are not turned among themselves there. Higher
derivatives hold for simple eigenvalues. Masses and stiffnesses enter as they are, never
as roots, so that a stiffness of 0 has a derivative too.
"""

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, Numbers, concrete, on_host, refuse_tracers, traced
from jaxhb._program import Program
from jaxhb.linear.modal import ModeShares, shares
from jaxhb.linear.tangent import linear_train
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain

# Relative distance of squares below which eigenvalues count as repeated: some rounding
CLUSTER = 1e-9
# Frequency over the highest one, for each disk, that is rounding of a rigid motion
RIGID = 1e-13


def kinetic_energy(train: DriveTrain, velocity: Array) -> Array:
    """Kinetic energy in J, ``T = 1/2 sum J_i phi_i'^2`` (Lashko, (3.1)), of disks with
    ``velocity`` ``(S,)`` in rad/s.

    Rings of dampers come last.

    >>> import jax.numpy as jnp
    >>> train = jaxhb.build([jaxhb.Disk(name="a", inertia=2.0)])
    >>> float(jaxhb.kinetic_energy(train, jnp.array([3.0])))
    9.0
    """
    system = chain.assemble(train)
    return jnp.sum(system.mass * (system.radius * velocity) ** 2) / 2


def strain_energy(train: DriveTrain, angle: Array) -> Array:
    """Strain energy in J of links and grounds, ``Pi = 1/2 sum c_i l_i^2`` (Lashko,
    (3.2)), at ``angle`` ``(S,)`` rad.

    Rings of dampers come last.

    >>> import jax.numpy as jnp
    >>> parts = [jaxhb.Disk(name="a", inertia=2.0), jaxhb.Disk(name="b", inertia=1.0)]
    >>> train = jaxhb.build([*parts, jaxhb.Shaft(between=("a", "b"), stiffness=100.0)])
    >>> float(jaxhb.strain_energy(train, jnp.array([0.3, 0.1]))).__round__(12)
    2.0
    """
    system = chain.assemble(linear_train(train))
    displacement = system.radius * jnp.asarray(angle)
    links = jnp.sum(system.stiffness * system.deflections(displacement) ** 2)
    return (links + jnp.sum(system.ground * displacement**2)) / 2


def inertia_and_stiffness(train: DriveTrain) -> tuple[Array, Array]:
    """Matrices J in kg m2 and C in N m/rad, ``(S, S)``, of ``J phi'' + C phi = 0``
    (Lashko, (3.3) and (3.4)).

    The second derivatives of :func:`kinetic_energy` and :func:`strain_energy`.

    >>> parts = [jaxhb.Disk(name="a", inertia=2.0), jaxhb.Disk(name="b", inertia=1.0)]
    >>> train = jaxhb.build([*parts, jaxhb.Shaft(between=("a", "b"), stiffness=100.0)])
    >>> jaxhb.inertia_and_stiffness(train)[1].tolist()
    [[100.0, -100.0], [-100.0, 100.0]]
    """
    rest = jnp.zeros(train.topology.n_disks)
    inertia = jax.hessian(lambda velocity: kinetic_energy(train, velocity))(rest)
    stiffness = jax.hessian(lambda angle: strain_energy(train, angle))(rest)
    return inertia, stiffness


def frequencies_hz(train: DriveTrain, heavy: Array | None = None) -> Array:
    """Natural frequencies ``(m,)`` in Hz, rising: those of
    :func:`jaxhb.natural_frequencies`, differentiable.

    ``d(omega^2) = y^T (dK - omega^2 dM) y`` with y the mass-normalised shape (R. L.
    Fox, M. P. Kapoor, AIAA J. 6 (1968) 2426); 0 with derivative 0 for rigid motions. Of
    frequencies that repeat only the sum has a derivative: :func:`cluster_sums_hz`.

    ``heavy`` ``(S,)`` is true for disks with inertia, needed where inertias are traced;
    the others are condensed statically.

    >>> import jax
    >>> train = jaxhb.build(
    ...     [
    ...         *(jaxhb.Disk(name=n, inertia=2.0) for n in "ab"),
    ...         jaxhb.Shaft(between=("a", "b"), stiffness=100.0),
    ...     ]
    ... )
    >>> slope = jax.grad(
    ...     lambda k: jaxhb.frequencies_hz(train.replace({"a|b.stiffness": k}))[1]
    ... )(100.0)
    >>> (
    ...     round(float(slope), 12),
    ...     round(10 / (2 * jax.numpy.pi) / 200.0, 12),
    ... )  # f is proportional to the root of k
    (0.007957747155, 0.007957747155)
    """
    return _frequencies(linear_train(train), _heavy(train, heavy))


@partial(Program, static_argnames="heavy")
def _frequencies(train: DriveTrain, heavy: tuple[bool, ...]) -> Array:
    squares, _ = mode_squares(train, heavy)
    moving = squares > 0
    return jnp.where(moving, jnp.sqrt(jnp.where(moving, squares, 1.0)), 0.0) / (
        2 * np.pi
    )


def mode_shares(train: DriveTrain, heavy: Array | None = None) -> ModeShares:
    """Mode shapes and where the energy of each mode lies, differentiable; arguments are
    those of :func:`frequencies_hz`.

    ``d y_i = sum_j y_j (y_j^T (dK - lambda_i dM) y_i) / (lambda_i - lambda_j)``, j
    other than i (Fox and Kapoor, as there).

    ``shapes`` ``(m, S)``, ``generalised_mass`` ``(m,)`` kg m2, ``kinetic_share`` ``(m,
    S)`` and ``strain_share`` ``(m, L)`` are those of :class:`jaxhb.Modes`. Where
    frequencies repeat, they have no derivatives.

    >>> import jax
    >>> parts = [
    ...     *(jaxhb.Disk(name=n, inertia=J) for n, J in zip("abc", (1.0, 2.0, 1.0))),
    ...     *(
    ...         jaxhb.Shaft(between=e, stiffness=100.0)
    ...         for e in (("a", "b"), ("b", "c"))
    ...     ),
    ... ]
    >>> train = jaxhb.build(parts)
    >>> share = lambda k: jaxhb.mode_shares(
    ...     train.replace({"a|b.stiffness": k})
    ... ).strain_share[1, 0]
    >>> round(float(share(100.0)), 9), round(float(jax.grad(share)(100.0)), 9)
    (0.5, -0.0075)
    """
    return _shares(linear_train(train), _heavy(train, heavy))


@partial(Program, static_argnames="heavy")
def _shares(train: DriveTrain, heavy: tuple[bool, ...]) -> ModeShares:
    squares, displacement = mode_squares(train, heavy)
    return shares(on_host(chain.assemble(train)), squares, displacement)


def cluster_sums_hz(
    train: DriveTrain, clusters: Sequence[Sequence[int]], heavy: Array | None = None
) -> Array:
    """Sums ``(clusters,)`` in Hz of natural frequencies that repeat; the sums have
    first derivatives, the single frequencies do not.

    ``clusters`` are numbers of modes, which :func:`clusters_of` finds; other arguments
    are those of :func:`frequencies_hz`.

    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> jaxhb.clusters_of(jaxhb.natural_frequencies(train).frequencies_hz)[:3]
    ((0,), (1,), (2,))
    >>> round(float(jaxhb.cluster_sums_hz(train, [(1, 2)])[0]), 1)
    809.3
    """
    hz = frequencies_hz(train, heavy)
    return jnp.stack([hz[np.array(cluster)].sum() for cluster in clusters])


def clusters_of(
    frequencies_hz: Numbers, tolerance: float = CLUSTER
) -> tuple[tuple[int, ...], ...]:
    """Numbers of the modes of each cluster of frequencies ``(m,)``, rising, that repeat
    to a relative ``tolerance``; on the host.
    """
    refuse_tracers(
        "clusters_of",
        frequencies_hz,
        instead="pass its result to jaxhb.cluster_sums_hz",
        host=True,
    )
    hz = np.asarray(frequencies_hz)
    begins = np.diff(hz, prepend=-np.inf) > tolerance * np.abs(hz)
    starts = np.flatnonzero(begins).tolist()
    ends = [*starts[1:], len(hz)]
    return tuple(tuple(range(a, b)) for a, b in zip(starts, ends, strict=True))


def mode_squares(
    train: DriveTrain, heavy: Sequence[bool] | np.ndarray
) -> tuple[Array, Array]:
    """omega^2 ``(m,)`` in 1/s2, rising, and mass-normalised displacements ``(S, m)`` in
    kg^(-1/2), differentiable.
    """
    system = chain.assemble(train)
    heavy_disks = np.flatnonzero(heavy)
    light_disks = np.flatnonzero(~np.array(heavy))
    rows, stiffness = system.springs()
    # Rows of disks without ground would be zeros.
    links = len(system.loss)
    grounds = links + np.unique(train.topology.ground_disk).astype(int)
    elastic = np.append(np.arange(links), grounds)
    rows = rows[elastic]
    stiffness = stiffness[elastic]
    follow = jnp.eye(len(heavy))[:, heavy_disks]
    if len(light_disks):
        light_rows = rows[:, light_disks]
        weighted = light_rows.T * stiffness
        # The pseudo-inverse lets a disk rest that no elastic link moves.
        follow = follow.at[light_disks].set(
            -jnp.linalg.pinv(weighted @ light_rows) @ weighted @ rows[:, heavy_disks]
        )
    mass = jnp.asarray(system.mass)[heavy_disks]
    squares, shapes = modal_basis(stiffness, rows @ follow, mass)
    return squares, follow @ shapes


def _heavy(train: DriveTrain, heavy: Array | None) -> tuple[bool, ...]:
    """Which disks have inertia: ``heavy`` if it is not None, else from the values."""
    if heavy is not None:
        return tuple(np.asarray(heavy, bool).tolist())
    inertia = concrete(train.disks.inertia, train.dampers.inertia)
    if traced(inertia):
        raise ValueError(
            "frequencies_hz: inertias are traced by jit or vmap, and which are zero"
            " decides how many modes there are. Give heavy, true for every disk with"
            " inertia."
        )
    return tuple((np.concatenate(inertia) > 0).tolist())


@jax.custom_jvp
def modal_basis(stiffness: Array, rows: Array, mass: Array) -> tuple[Array, Array]:
    """omega^2 ``(H,)`` in 1/s2, rising, and mass-normalised shapes ``(H, H)`` in
    kg^(-1/2) of disks ``mass`` ``(H,)`` kg joined by links of ``stiffness`` ``(L,)``
    N/m with deflections ``rows @ x``.
    """
    root = jnp.sqrt(mass)
    E = jnp.sqrt(stiffness)[:, None] * rows / root
    # Rows of zeros make one singular value for each disk.
    E = jnp.pad(E, ((0, max(0, len(mass) - len(stiffness))), (0, 0)))
    _, singular, right = jnp.linalg.svd(E, full_matrices=False)
    shapes = right[::-1].T / root[:, None]
    rigid = singular[::-1] <= RIGID * len(mass) * singular[0]
    squares = (stiffness[:, None] * (rows @ shapes) ** 2).sum(0)
    return jnp.where(rigid, 0.0, squares), shapes


@modal_basis.defjvp
def _modal_basis_jvp(
    primals: tuple[Array, Array, Array],
    tangents: tuple[Array, Array, Array],
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    stiffness, rows, mass = primals
    stiffness_dot, rows_dot, mass_dot = tangents
    squares, shapes = modal_basis(stiffness, rows, mass)
    bent = rows @ shapes
    bent_dot = rows_dot @ shapes
    across = bent_dot.T @ (stiffness[:, None] * bent)
    stiffer = bent.T @ (stiffness_dot[:, None] * bent) + across + across.T
    heavier = shapes.T @ (mass_dot[:, None] * shapes)
    change = stiffer - squares * heavier
    gap = squares - squares[:, None]
    same = jnp.abs(gap) <= CLUSTER * jnp.maximum(squares, squares[:, None])
    # Within a cluster shapes keep their length alone: a turn among them would be
    # divided by zero.
    turn = jnp.where(same, -heavier / 2, change / jnp.where(same, 1.0, gap))
    # Rigid motions stay at 0 Hz whatever changes.
    squares_dot = jnp.where(squares > 0, jnp.diagonal(change), 0.0)
    return (squares, shapes), (squares_dot, shapes @ turn)
