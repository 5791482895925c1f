"""The equations of harmonic balance as a function that users call: A(x), its Jacobian,
and Newton steps by the block sweep.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np

from jaxhb._jax import Array, Number, check_settings, namespace, traced
from jaxhb._program import Program
from jaxhb._shown import number
from jaxhb.balance.plan import check_harmonics
from jaxhb.balance.problem import force_balance, problem_at
from jaxhb.elements.sentences import SceneError, shown
from jaxhb.equations import fourier
from jaxhb.equations.residual import ForceBalance
from jaxhb.train import chain
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.speeds import check_speed
from jaxhb.train.topology import Topology

MOST_GIB = 8.0  # GiB that a Jacobian or the blocks of a sweep may take


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class HarmonicResidual:
    """The equations A(x) = 0 of a train at one speed, made by
    :func:`harmonic_residual`; ``A(x)`` is their residual.

    A pytree: its arrays are leaves, names and sizes static. It can be an argument and a
    result of transformations, and a function that they take: ``jax.jit(A)``,
    ``jax.jacfwd(A)``, ``jax.vmap(A)``.

    Parameters
    ----------
    balance : ForceBalance, the arrays of the equations
    topology : Topology, names and connections
    """

    balance: ForceBalance
    topology: Topology = field(metadata={"static": True})

    @property
    def harmonics(self) -> int:
        """Harmonics N of the cycle."""
        return self.balance.harmonics

    @property
    def samples(self) -> int:
        """Time samples of the cycle at which tooth laws are evaluated."""
        return self.balance.samples

    @property
    def size(self) -> int:
        """Number of unknowns, and of equations: S (2N+1)."""
        return self.topology.n_disks * (2 * self.harmonics + 1)

    @property
    def disk_names(self) -> tuple[str, ...]:
        """Names of the S disks in the order of the unknowns; rings of dampers come
        last.
        """
        return self.topology.disk_names

    @property
    def radius(self) -> Array:
        """``(S,)`` m, displacement over angle of each disk: the pitch radius of the
        first gear of its rotor, 1 m on a rotor without gears.
        """
        return self.balance.system.radius

    def pack(self, coefficients: Array) -> Array:
        """Unknowns x ``(size,)`` of complex displacements ``(S, n+1)`` in m, n at most
        N; harmonics above n are 0.

        Angles in rad times :attr:`radius` are displacements: ``A.pack(A.radius[:, None]
        * response.angles)``. ValueError if the shape is another.
        """
        shape = np.shape(coefficients)
        disks = self.topology.n_disks
        if (
            len(shape) != 2
            or shape[0] != disks
            or not 1 <= shape[1] <= self.harmonics + 1
        ):
            raise ValueError(
                f"the coefficients have shape {shape}, must be ({disks}, n+1) with n at"
                f" most {self.harmonics}: a row of displacements in m for every disk,"
                " rings of dampers included."
            )
        coefficients = namespace(coefficients).asarray(coefficients) + 0j
        return fourier.pack(fourier.resize(coefficients, self.harmonics)).reshape(
            self.size
        )

    def unpack(self, x: Array) -> Array:
        """Complex displacements x^n ``(S, N+1)`` in m of unknowns ``(size,)``: ``x_s(t)
        = x^0 + 2 Re sum x^n e^{i n Omega t}``; over ``radius[:, None]`` angles in rad.
        Of a residual the complex forces in N. ValueError if the shape is another.
        """
        self._check(x)
        return fourier.unpack(
            namespace(x).asarray(x).reshape(self.topology.n_disks, -1)
        )

    def __call__(self, x: Array) -> Array:
        """The residual A(x) ``(size,)`` in N at ``x`` ``(size,)`` m. ValueError if the
        shape is another.
        """
        return _residual(self.balance, self._check(x))

    def jacobian(self, x: Array) -> Array:
        """The Jacobian A'(x) ``(size, size)`` in N/m, analytic: Fridman's (38),
        Toeplitz blocks of the slope of the tooth laws, that of the samples;
        ``jax.jacfwd(A)(x)`` is the same.

        ValueError if ``x`` has another shape, MemoryError if the matrix would take more
        than 8 GiB.
        """
        self._check(x)
        self._refuse_size(
            self.size**2,
            "the Jacobian",
            "take jax.jvp(A, (x,), (change,)), which makes no matrix",
        )
        return _jacobian(self.balance, x)

    def __repr__(self) -> str:
        frequency = self.balance.frequency
        speed = ""
        if not (traced(frequency) or np.ndim(frequency)):
            speed = f" at Omega = {number(float(frequency))} rad/s"
        return (
            f"<HarmonicResidual of {self.topology.title}{speed}: {self.harmonics}"
            f" harmonics, {self.size} unknowns>"
        )

    def _check(self, x: Array) -> Array:
        """Return the unknowns unchanged; refuse with a sentence those of another
        shape.
        """
        if np.ndim(self.balance.load) != 2:
            raise ValueError(
                "these are the equations of several trains or speeds: call them under"
                " jax.vmap"
            )
        if np.shape(x) != (self.size,) or np.iscomplexobj(x):
            kind = "complex" if np.iscomplexobj(x) else "real"
            raise ValueError(
                f"x is {kind} of shape {np.shape(x)}, must be real of shape"
                f" ({self.size},): {self.topology.n_disks} disks times 2 x"
                f" {self.harmonics} + 1 coordinates. A.pack makes it of complex"
                " coefficients."
            )
        return x

    def _refuse_size(self, numbers: int, what: str, instead: str) -> None:
        gib = 8 * numbers / 2**30
        if gib > MOST_GIB:
            raise MemoryError(
                f"{self.topology.title}: {what} at {self.harmonics} harmonics would"
                f" take {gib:.1f} GiB, more than {MOST_GIB:g}: use fewer harmonics, or"
                f" {instead}."
            )


def harmonic_residual(
    train: DriveTrain, *, rpm: Number, harmonics: int, samples: int | None = None
) -> HarmonicResidual:
    """The equations of harmonic balance A(x) = 0 of a train at one speed, as a pure
    function of packed coefficients.

    The balance of forces on every disk in the harmonics 0 .. N of the cycle,

        A(x) = Z x + D^T f(D x, D x') - q,
        Z = -n^2 Omega^2 M + i n Omega B + ground,

    Fridman 2009, (19) and (10)-(12) with the opposite sign, f the forces of all links:
    what :func:`jaxhb.solve` solves, there condensed to the meshes that can leave
    contact. A motion that it finds with as many harmonics makes A zero.

    Parameters
    ----------
    train : DriveTrain
    rpm : float
        Speed of the reference rotor.
    harmonics : int
        Harmonics N of the cycle.
    samples : int, optional
        Equidistant times of the cycle at which the tooth laws are evaluated, more than
        4 N; default 16 N, as in :func:`jaxhb.solve`.

    Returns
    -------
    HarmonicResidual
        ``A(x)`` in N of ``x`` in m, both ``(A.size,)``, ``A.jacobian(x)`` in N/m,
        ``A.pack``, ``A.unpack``, ``A.radius``, ``A.disk_names``.

    Raises
    ------
    SceneError
        Speed not greater than 0 or above 1e6 rpm, harmonics or samples that cannot
        work, links that vary over the frequency or their amplitude. What is traced is
        not checked, and its excitation above N left out.

    See Also
    --------
    block_sweep : a Newton step.

    Notes
    -----
    ``x`` holds, disk by disk in the order of ``A.disk_names``, the coordinates ``x^0,
    sqrt(2) Re x^1 .. x^N, -sqrt(2) Im x^1 .. x^N`` of its displacement ``x_s(t) = sum
    x^n exp(i n Omega t)`` along the pitch circle of the first gear of its rotor, that
    is radius times angle, the radius 1 m on a rotor without gears. The residual has the
    same coordinates of the force in N along that circle, torque over radius. Euclidean
    norms are root mean squares.

    Meshes of every law and damping, varying stiffness and transmission errors, stages,
    stops, play and dry friction of shafts, loss factors, rings, disks without inertia
    and closed loops are in it. Mean angles that no force decides are held: that of a
    train without ground by Omega^2 times inertia on its inertia-weighted mean rotation,
    and a ring behind a link without stiffness likewise at its hub. Where mean torques
    are in balance these springs carry nothing, and the angles are those of
    :class:`jaxhb.Response`; a mean torque that nothing else takes (torques out of
    balance, dry friction with a mean on such a ring) shows as a mean angle.

    Valid under ``jit``, ``vmap`` and differentiation with a traced train and speed.
    Under these A holds tracers, and so it does where it is made by ``jax.vmap``: then
    call it under ``jax.vmap`` too.

    Examples
    --------
    Newton's method by the block sweep, from the motion in contact all cycle, where the
    teeth of a pair part:

    >>> import jax, jaxhb, numpy as np
    >>> train = jaxhb.load_scene("spur_pair")
    >>> A = jaxhb.harmonic_residual(train, rpm=7000.0, harmonics=32)
    >>> linear = jaxhb.linear_response(train, rpm=7000.0)
    >>> x = A.pack(A.radius[:, None] * linear.angles)
    >>> by_autodiff, analytic = jax.jacfwd(A)(x), A.jacobian(x)
    >>> bool(abs(by_autodiff - analytic).max() < 1e-12 * abs(analytic).max())
    True
    >>> for step in range(12):
    ...     x = x - jaxhb.block_sweep(A, x, A(x))
    >>> bool(abs(A(x)).max() < 1e-9 * 1000)  # of the mean tooth force of 1000 N
    True
    >>> r = jaxhb.solve(train, rpm=7000.0, harmonics=32)
    >>> bool(abs(A(A.pack(A.radius[:, None] * r.angles))).max() < 1e-9 * 1000)
    True
    """
    check_settings()
    check_speed(train, rpm)
    _check_sizes(train, harmonics, samples)
    harmonics = int(harmonics)
    samples = (
        fourier.SAMPLES_PER_HARMONIC * harmonics if samples is None else int(samples)
    )
    return HarmonicResidual(
        force_balance(problem_at(train, rpm, harmonics), harmonics, samples),
        train.topology,
    )


def block_sweep(A: HarmonicResidual, x: Array, right_side: Array) -> Array:
    """Solve for ``A'(x)^-1 right_side``, such as a Newton step, by block elimination
    along the tree of links.

    Fridman 2009, (10)-(12), with the Newton-Kantorovich blocks (38): from the leaves to
    the root and back under ``lax.scan``, without assembling the Jacobian. Work grows
    with ``S N^3``, memory with ``S N^2``; of a dense solve with ``S^3 N^3`` and ``S^2
    N^2``.

    Parameters
    ----------
    A : HarmonicResidual
    x : ``(size,)`` m, where the Jacobian is taken
    right_side : ``(size,)`` N

    Returns
    -------
    ``(size,)`` m

    Raises
    ------
    SceneError
        The train has a closed loop: take ``jax.numpy.linalg.solve(A.jacobian(x),
        right_side)``.
    MemoryError
        The blocks would take more than 8 GiB.
    ValueError
        A shape is another.

    Notes
    -----
    Elimination without pivoting between blocks breaks down at a part of the train that
    is singular with its upper disk held (a parametric resonance of that part), though
    the whole may be regular. The residual ``jax.jvp(A, (x,), (change,))[1] -
    right_side`` tells.

    Valid under ``jit``, ``vmap`` and differentiation, forwards and backwards.

    Examples
    --------
    >>> import jax.numpy as jnp, jaxhb
    >>> train = jaxhb.load_scene("spur_pair")
    >>> A = jaxhb.harmonic_residual(train, rpm=7000.0, harmonics=32)
    >>> x = jnp.zeros(A.size)
    >>> dense = jnp.linalg.solve(A.jacobian(x), A(x))
    >>> bool(abs(jaxhb.block_sweep(A, x, A(x)) - dense).max() < 1e-9 * abs(dense).max())
    True
    """
    A._check(x)
    A._check(right_side)
    topology = A.topology
    loops = chain.span(topology).loops
    if len(loops):
        names = ", ".join(repr(topology.link_names[link]) for link in loops)
        raise SceneError(
            f"{topology.title}: {names} closes a loop, and the block sweep needs a"
            " tree: use jax.numpy.linalg.solve(A.jacobian(x), right_side)."
        )
    # Blocks of disks and links, and those that the elimination stores
    blocks = 6 * topology.n_disks * (2 * A.harmonics + 1) ** 2
    A._refuse_size(
        blocks,
        "the blocks of the sweep",
        "jaxhb.solve, which condenses the train to its meshes",
    )
    return _swept(A.balance, x, right_side)


def _check_sizes(train: DriveTrain, harmonics: int, samples: int | None) -> None:
    """Refuse harmonics and samples that cannot work, with a sentence."""
    name = train.topology.title
    if traced(harmonics, samples):
        raise TypeError(
            "harmonics and samples are sizes of arrays, which jit and vmap cannot"
            " trace: fix them outside"
        )
    if not traced(train):
        with jax.ensure_compile_time_eval():  # under jit, too
            check_harmonics(train, harmonics, "reduced")
    elif not (isinstance(harmonics, int | np.integer) and harmonics >= 1):
        raise SceneError(
            f"{name}: harmonics is {harmonics}, must be a whole number of at least 1."
        )
    if samples is not None and not (
        isinstance(samples, int | np.integer) and samples > 4 * harmonics
    ):
        raise SceneError(
            f"{name}: samples is {shown(samples)}, must be a whole number greater than"
            f" {4 * harmonics}, 4 per harmonic: the slope of a law couples harmonics"
            " that lie 2 N apart."
        )


@Program
def _residual(balance: ForceBalance, x: Array) -> Array:
    return balance.residual(
        jnp.asarray(x, float).reshape(len(balance.system.mass), -1)
    ).reshape(-1)


@Program
def _jacobian(balance: ForceBalance, x: Array) -> Array:
    x = jnp.asarray(x, float)
    return balance.jacobian(x.reshape(len(balance.system.mass), -1)).reshape(
        len(x), len(x)
    )


@Program
def _swept(balance: ForceBalance, x: Array, right_side: Array) -> Array:
    disks = len(balance.system.mass)
    x = jnp.asarray(x, float).reshape(disks, -1)
    right_side = jnp.asarray(right_side, float).reshape(disks, -1)
    return balance.solve(x, right_side).reshape(-1)
