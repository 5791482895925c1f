"""The periodic response of a drive train: disks, shafts, gears and meshes, read by
name.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import jax
import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import Array, namespace, refuse_tracers, traced
from jaxhb._shown import brief, counts, html_table, number, span
from jaxhb.equations import backlash, fourier
from jaxhb.results.answers import solved
from jaxhb.results.bounds import Certificate
from jaxhb.results.contact import Contact, contact_of
from jaxhb.results.dataset import Dataset, to_xarray
from jaxhb.results.display import table_of_links, table_of_speeds
from jaxhb.results.motion import Motion
from jaxhb.results.signal import Lines, Signal
from jaxhb.results.status import AnyResponse, Status
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.kinematics import rotor_ratios
from jaxhb.train.mesh_parameters import all_meshes
from jaxhb.train.topology import Topology


@jax.tree_util.register_dataclass
@brief
@dataclass(frozen=True)
class Fields:
    """Motion, torques and forces over one cycle, as complex Fourier coefficients."""

    angles: Array  # (..., S, N+1) rad, vibratory angle of every disk
    torques: Array  # (..., K, N+1) N m, of the shafts and then the dampers
    elastic_torques: Array
    deflections: Array  # (..., M, N+1) m, of the meshes
    # (..., M, F+1) N, of the meshes; F is more harmonics than the motion has
    forces: Array
    elastic_forces: Array


@jax.tree_util.register_dataclass
@brief
@dataclass(frozen=True)
class LineMotion(Fields):
    """Motion, torques and forces at L fixed frequencies ``hz`` ``(..., L)``, as the
    coefficients of :class:`jaxhb.results.signal.Lines`: the last axis of every field.
    """

    hz: Array


SMOOTH = "jaxhb.design.objectives.separated_fraction and impact_severity"
"""Quantities that tell of contact and have derivatives."""
FIELDS = tuple(field.name for field in dataclasses.fields(Fields))


@dataclass(frozen=True)
class Response(Fields, Motion[Signal, Contact, Array]):
    """Steady periodic motion at one speed, or at several (every array then has a
    leading axis).

    Made by :func:`jaxhb.solve`, :func:`jaxhb.solve_speeds` and
    :func:`jaxhb.linear_response`; read by name with :meth:`force`, :meth:`torque`,
    :meth:`disk` and the like. A pytree of its arrays; a response that comes out of a
    transformation has no ``train``, ``path`` and ``certificate``, which are no arrays.

    Parameters
    ----------
    rpm : ``(...)`` of the reference rotor
    load_torque : ``(..., n)`` N m, of every load, negative where it takes power
    load_power : ``(...)`` W, taken by the loads
    ground_reaction : ``(..., n)`` N m
        Mean torque that each ground takes. Mean angles are those that the soft grounds
        set; without a ground their inertia-weighted mean is zero.
    radius : ``(..., S)`` m, of the gears
    law : Law ``(..., M)`` of the meshes
    status : ``(...)`` int, :class:`jaxhb.Status` of the solve
    residual, truncation_error : ``(...)``
        What is left of the equations, and the estimated change of the tooth force by
        omitted harmonics, over the largest tooth force.
    power_defect : ``(...)``
        Power of the torques less what is turned into heat, over the power that they
        exchange with the train.
    steps : ``(...)`` int, of Newton's method; sweeps, and marches of that method on
    them
    topology : Topology, names and connections
    resolution : int, time samples per cycle at which extremes are looked for
    sharp : bool, whether the contact of teeth was an unknown of the solve, at one of
    the speeds at least; see
        :class:`Signal`
    train : DriveTrain or None
    path : tuple of events, how the solve went; of a sweep one tuple per speed
    certificate : Certificate or None, where it was asked for
    lines : LineMotion or None
        Motion at the fixed frequencies of torques with lines, of a forced response
        alone.
    """

    rpm: Array
    load_torque: Array
    load_power: Array
    ground_reaction: Array
    radius: Array
    law: backlash.Law
    status: Array
    residual: Array
    truncation_error: Array
    power_defect: Array
    steps: Array
    topology: Topology
    resolution: int
    sharp: bool = False
    # Neither the log nor what the response was made from is part of what is compared.
    train: DriveTrain | None = field(default=None, compare=False)
    path: tuple = field(default=(), compare=False)
    certificate: Certificate | None = field(default=None, compare=False)
    lines: LineMotion | None = None

    @property
    def harmonics(self) -> int:
        """Number of harmonics of the motion."""
        return self.angles.shape[-1] - 1

    @property
    def highest_harmonic(self) -> Array:
        """Highest harmonic that moves a disk, per speed: of a sweep :attr:`harmonics`
        is the largest among them.
        """
        refuse_tracers(
            "highest_harmonic", self.angles, instead="read .harmonics there", host=True
        )
        moves = np.any(np.asarray(self.angles) != 0, axis=-2)
        return np.max(np.where(moves, np.arange(moves.shape[-1]), 0), axis=-1)

    @property
    def solved(self) -> Array:
        """True where the equations are solved, so that the numbers are those of a
        motion: CONVERGED, or TOLERANCE_NOT_MET, with too few harmonics for the
        tolerance. Elsewhere they are those of the last iterate.
        """
        return solved(self.status)

    @property
    def converged(self) -> Array:
        """True where the equations are solved and the truncation error is within its
        limit.
        """
        return self.status == Status.CONVERGED

    @property
    def status_name(self) -> str | np.ndarray:
        """Name of :attr:`status`, "CONVERGED"; of several speeds an array of names."""
        refuse_tracers(
            "status_name", self.status, instead="read .status there", host=True
        )
        names = np.array([status.name for status in Status])[np.asarray(self.status)]
        return names if np.ndim(names) else str(names)

    @property
    def load_kW(self) -> Array:
        """Power taken by the loads in kW."""
        return self.load_power / 1e3

    @property
    def outcome(self) -> str:
        """Status, number of harmonics and truncation error of one motion, in words."""
        error = 100 * float(self.truncation_error)
        return (
            f"{self.status_name}, {self.harmonics} harmonics, truncation error"
            f" {error:.2g} %"
        )

    def __repr__(self) -> str:
        beginning = f"<{type(self).__name__} of {self.topology.title}"
        if traced(self):
            return f"{beginning}, traced, {self.harmonics} harmonics>"
        if not np.ndim(self.rpm):
            return f"{beginning} at {number(float(self.rpm))} rpm: {self.outcome}>"
        many = np.ndim(self.rpm) == 1
        speeds = (
            span(np.asarray(self.rpm), "rpm")
            if many
            else f"{' x '.join(map(str, np.shape(self.rpm)))} motions"
        )
        return (
            f"{beginning} at {speeds}: {counts(self.status_name)}, {self.harmonics}"
            " harmonics>"
        )

    def _repr_html_(self) -> str:
        caption = repr(self)[1:-1]
        if traced(self) or np.ndim(self.rpm) > 1:
            return html_table(caption, [], [])
        if not np.ndim(self.rpm):
            return (
                table_of_links(caption, self)
                if self.solved
                else html_table(caption, [], [])
            )

        def cells(motion: "Response") -> tuple[list[Any], Any]:
            return [motion.status_name, int(motion.highest_harmonic)], motion.solved

        return table_of_speeds(caption, self, ["status", "harmonics"], cells)

    def __bool__(self) -> bool:
        if np.ndim(self.rpm):
            raise TypeError(
                "a sweep is neither true nor false: read .converged, which has each of"
                " its speeds"
            )
        refuse_tracers(
            "if response",
            self.status,
            instead="read .converged or .solved there",
            host=True,
        )
        return bool(self.converged)

    def __len__(self) -> int:
        return len(self.rpm)

    def __getitem__(self, index: Any) -> Self:
        """Response number ``index`` (or a slice) of a batch."""
        if not np.ndim(self.rpm):
            raise TypeError(
                "this is the response at one speed, not a sweep: it cannot be indexed"
            )
        rows = jax.tree.map(lambda leaf: leaf[index], self)
        return dataclasses.replace(
            rows, train=self.train, path=self.path[index] if self.path else ()
        )

    @property
    def solution(self) -> Self:
        """The response itself: the numbers of any motion are read from its solution."""
        return self

    def _signal(self, coefficients: Array, elastic: Array | None = None) -> Signal:
        return Signal(
            coefficients,
            elastic,
            self.topology.revolutions_per_cycle,
            self.resolution,
            self.sharp,
        )

    def _read(self, quantity: str, index: Any, sense: int = 1) -> Any:
        answer = self._read_orders(quantity, index, sense)
        if self.lines is None or not isinstance(answer, Signal):
            return answer
        return dataclasses.replace(answer, lines=self._lines(quantity, index, sense))

    def _lines(self, quantity: str, index: Any, sense: int) -> Lines:
        """The :class:`Lines` of a quantity."""
        motion = self.lines
        assert motion is not None  # there are lines
        rate = 2j * np.pi * motion.hz
        elastic = None
        match quantity:
            case "angle":
                values = motion.angles[..., index, :]
            case "speed":
                values = rate * motion.angles[..., index, :]
            case "acceleration":
                values = rate**2 * motion.angles[..., index, :]
            case "twist":
                first, second = index
                values = motion.angles[..., first, :] - motion.angles[..., second, :]
            case "torque" | "force":
                values = sense * getattr(motion, f"{quantity}s")[..., index, :]
                elastic = sense * getattr(motion, f"elastic_{quantity}s")[..., index, :]
            case "gear_torque":
                values, elastic = self._gear_torques(motion, index)
            case "deflection" | "transmission_error":
                # Errors of teeth follow the rotation: they have no lines.
                values = sense * motion.deflections[..., index, :]
            case _:
                raise AssertionError(f"{quantity} is no signal")
        return Lines(motion.hz, values, elastic)

    def _gear_torques(self, fields: Fields, index: int) -> tuple[Array, Array]:
        """Coefficients of the torque that a gear passes on, and of its elastic part."""
        senses = np.array(
            [(a == index) - (b == index) for a, b in self.topology.mesh_ends],
            dtype=float,
        )
        radius = self.radius[..., index, None]

        def torque(forces: Array) -> Array:
            return radius * namespace(forces).einsum("g,...gk->...k", senses, forces)

        return torque(fields.forces), torque(fields.elastic_forces)

    def _refuse_lines(self, quantity: str) -> None:
        """Refuse what is of one cycle alone, where torques have lines."""
        if self.lines is not None:
            raise ValueError(
                f"{quantity} is that of a cycle, and torques have lines at fixed"
                " frequencies: no cycle is like the next. Read forces and torques, or"
                " march the motion with jaxhb.transient"
            )

    def _read_orders(self, quantity: str, index: Any, sense: int) -> Any:
        """A quantity by its orders."""
        match quantity:
            case "angle":
                return self._signal(self.angles[..., index, :])
            case "speed" | "acceleration":
                rate = fourier.derivative(self.angles[..., index, :], self._frequency)
                if quantity == "acceleration":
                    return self._signal(fourier.derivative(rate, self._frequency))
                ratio = rotor_ratios(self.topology, self.radius)[
                    ..., self.topology.rotor[index]
                ]
                mean = (2 * np.pi / 60 * self.rpm * ratio)[..., None] + 0j
                # The derivative has no mean: that of the speed is the rotation.
                return self._signal(
                    namespace(rate, mean).concatenate([mean, rate[..., 1:]], axis=-1)
                )
            case "twist":
                first, second = index
                return self._signal(
                    self.angles[..., first, :] - self.angles[..., second, :]
                )
            case "torque" | "force":
                return self._signal(
                    sense * getattr(self, f"{quantity}s")[..., index, :],
                    sense * getattr(self, f"elastic_{quantity}s")[..., index, :],
                )
            case "deflection":
                return self._signal(sense * self.deflections[..., index, :])
            case "transmission_error":
                approach = self.deflections[..., index, :]
                error = all_meshes(self._solved).error
                if error is not None:
                    most = max(approach.shape[-1], error.shape[-1]) - 1
                    approach = fourier.resize(approach, most) + fourier.resize(
                        error[index], most
                    )
                return self._signal(sense * approach)
            case "gear_torque":
                return self._signal(*self._gear_torques(self, index))
            case "power":
                return self._power(index)
            case "contact":
                if self.topology.mesh_backlash[index]:
                    self._refuse_lines("contact")
                refuse_tracers(
                    "mesh", self.deflections, instead=f"read {SMOOTH} there", host=True
                )
                law = jax.tree.map(
                    lambda values: np.asarray(values)[..., index], self.law
                )
                signals = self.deflections, self.forces, self.elastic_forces
                deflection, force, elastic_force = (
                    np.asarray(coefficients[..., index, :]) for coefficients in signals
                )
                return contact_of(
                    law if self.topology.mesh_backlash[index] else None,
                    deflection,
                    force,
                    elastic_force,
                    self.topology.cycle_frequency(np.asarray(self.rpm)),
                    self.resolution,
                )

    @property
    def _frequency(self) -> Array:
        """Omega of the cycle in rad/s, with an axis for the harmonics."""
        return self.topology.cycle_frequency(namespace(self.rpm).asarray(self.rpm))[
            ..., None
        ]

    @property
    def _solved(self) -> DriveTrain:
        """The train, where there is one."""
        if self.train is None:
            raise ValueError(
                "the response comes out of a transformation without its train: solve"
                " outside of it"
            )
        return self.train

    def _power(self, index: int) -> Array:
        """Mean power ``(...)`` in W that a link turns into heat."""
        shafts = self.torques.shape[-2]
        if index < shafts:
            bent = self._read("twist", self.topology.link_ends[index]).coefficients
            passed = self.torques[..., index, : bent.shape[-1]]
        else:
            bent = self.deflections[..., index - shafts, :]
            # Harmonics of the force beyond those of the motion do no work.
            passed = self.forces[..., index - shafts, : bent.shape[-1]]
            # The elastic force of a stiffness that varies does work, which is no heat.
            if self.topology.mesh_varies[index - shafts]:
                passed = (
                    passed - self.elastic_forces[..., index - shafts, : bent.shape[-1]]
                )
        xp = namespace(passed, bent)
        rate = fourier.derivative(bent, self._frequency)
        return 2 * xp.sum((passed * xp.conj(rate)).real, axis=-1)

    def deflection_samples(self, count: int) -> Array:
        """Deflections of all meshes at ``count`` time samples of the cycle, ``(..., M,
        count)`` m.
        """
        self._refuse_lines("deflection_samples")
        return fourier.sample(self.deflections, count)

    def impact_energy(self, a: str, b: str | None = None) -> float:
        """Energy in J that the impacts of a mesh bring in a cycle, their sum of ``m v^2
        / 2``: v the approach speed, m that of the two gears alone, ``m_a m_b / (m_a +
        m_b)``, J / r^2 each. ValueError without a train.
        """
        disks = self._solved.disks
        ends = list(self.topology.mesh_ends[self._mesh_index(a, b)[0]])
        mass = np.asarray(disks.inertia)[ends] / np.asarray(disks.radius)[ends] ** 2
        speeds = np.array([impact["speed"] for impact in self.mesh(a, b).impacts])
        return float(mass.prod() / max(mass.sum(), 1e-300) * np.sum(speeds**2) / 2)

    def contacts(self) -> dict[str, Contact]:
        """:class:`Contact` of every mesh by name."""
        return {name: self.mesh(name) for name in self.topology.mesh_names}

    def to_xarray(self, *, orders: float | None = None) -> Dataset:
        """The response as a data set of xarray (extra ``data``), with names as labels
        and units as attributes.

        ``orders`` : highest order whose amplitudes and phases are given; default: all
        of the motion.

        Dimensions ``rpm`` (of a sweep), ``disk``, ``shaft`` (dampers behind them),
        ``gear``, ``mesh``, ``load``, ``ground`` and ``order``. Of ``angle``, ``speed``,
        ``acceleration``, ``torque``, ``gear_torque`` and ``tooth_force`` the variables
        ``_mean``, ``_min``, ``_max``, ``_half_peak_to_peak``, ``_sum_of_amplitudes``,
        and but for the second and third ``_amplitude`` and ``_phase``;
        ``irregularity``, ``heat``, contact, loads. Numbers of speeds that did not
        converge are nan, and ``status`` says why. ImportError without xarray.

        >>> sweep = jaxhb.solve_speeds(
        ...     jaxhb.load_scene("six_cylinder_diesel"), rpm=[1000.0, 1500.0]
        ... )
        >>> swing = sweep.to_xarray(orders=12).torque_half_peak_to_peak.sel(
        ...     shaft="cyl6|flywheel"
        ... )
        >>> swing.sel(rpm=1500).item().__round__(1), swing.attrs["units"]
        (2900.6, 'N m')
        """
        refuse_tracers("to_xarray", self, host=True)
        motions = [self[i] for i in range(len(self))] if np.ndim(self.rpm) else [self]
        return to_xarray(motions, self.topology, np.asarray(self.rpm), orders=orders)


def register(cls: type) -> type:
    """Make :class:`Response`, or a class that extends it, a pytree.

    Leaves are what depends on the speed: ``train`` would copy pressure tables, ``path``
    make programs retrace.
    """
    # Not by register_dataclass, whose drop_fields fail on jax 0.9.
    static = ("topology", "resolution", "sharp")
    aside = ("train", "path", "certificate")
    names = [f.name for f in dataclasses.fields(cls) if f.name not in (*static, *aside)]

    def flatten(response: Any) -> tuple[list, tuple]:
        leaves = [
            (jax.tree_util.GetAttrKey(name), getattr(response, name)) for name in names
        ]
        return leaves, tuple(getattr(response, name) for name in static)

    def unflatten(metadata: tuple[Any, ...], leaves: Iterable[Any]) -> Any:
        fields = dict(zip(names, leaves, strict=True))
        fields |= dict(zip(static, metadata, strict=True))
        return cls(**fields)

    jax.tree_util.register_pytree_with_keys(cls, flatten, unflatten)
    return by_value(cls)


register(Response)


def stack(responses: Sequence[AnyResponse]) -> AnyResponse:
    """Stack responses of one train at several speeds along a leading axis; all get the
    most harmonics among them.
    """
    most = {
        name: max(getattr(response, name).shape[-1] for response in responses) - 1
        for name in FIELDS
    }
    resolution = max(response.resolution for response in responses)
    sharp = any(response.sharp for response in responses)

    def padded(response: AnyResponse) -> AnyResponse:
        wider = {
            name: fourier.resize(np.asarray(getattr(response, name)), count)
            for name, count in most.items()
        }
        return dataclasses.replace(
            response, resolution=resolution, sharp=sharp, **wider
        )

    joined = jax.tree.map(lambda *leaves: np.stack(leaves), *map(padded, responses))
    return dataclasses.replace(
        joined,
        train=responses[0].train,
        path=tuple(response.path for response in responses),
    )
