"""Result of a transient: the motion of a train over time, read by name."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import Array, namespace, refuse_tracers
from jaxhb._shown import html_table, number
from jaxhb.equations import backlash
from jaxhb.equations.backlash import MeshParameters
from jaxhb.linear.strength import having, stress_of
from jaxhb.results.dataset import trace_to_xarray
from jaxhb.results.motion import Motion
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.topology import Topology
from jaxhb.transients.fatigue import CountedCycles, SNCurve, count_cycles, damage_of
from jaxhb.transients.history import History
from jaxhb.transients.march import Varying

if TYPE_CHECKING:
    from jaxhb.results.dataset import Dataset


@by_value
@dataclass(frozen=True)
class ToothContact:
    """Contact of one mesh over a transient: seconds with the teeth separated and on
    the flank that does not drive, entries from separation to contact, largest approach
    speed of an entry in m/s, and the sign of the mean force; and the time in s of the
    first separation, entry and contact on the flank that does not drive, nan of what
    does not happen.
    """

    separated: float
    reverse_contact: float
    impacts: int
    hardest_impact: float
    drive_side: int
    first_separation: float = np.nan
    first_impact: float = np.nan
    first_reverse_contact: float = np.nan

    @property
    def troubles(self) -> tuple[str, ...]:
        """Kinds of trouble: "separation", "hits" and "reversal"."""
        kinds = {
            "separation": self.separated > 0,
            "hits": self.impacts > 0,
            "reversal": self.reverse_contact > 0,
        }
        return tuple(kind for kind, happens in kinds.items() if happens)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Readings:
    """Arrays that turn states into quantities; n states, C loads, G meshes that have a
    law, R linear meshes.

    displacement, velocity ``(S, n)`` of the disks, and what follows loads at once,
    ``(S, C)`` each; radius ``(S,)`` m; ratio ``(S,)`` of the speeds of rotors; ends
    ``(links,)`` radius in m at the first end of links; bend ``(links, S)`` deflections
    of links; stiffness N/m, viscous N s/m ``(links,)``; meshes : those that have a law;
    beside ``(shafts, G)`` m or None: torques of shafts of the forces beside them;
    varying : stiffness and viscous over the speed of the links ``varying_links``
    ``(V,)``, None where nothing depends on it; clutches ``(C,)`` : links with clutches.
    """

    displacement: Array
    velocity: Array
    displacement_of_loads: Array
    velocity_of_loads: Array
    radius: Array
    ratio: Array
    ends: Array
    bend: Array
    stiffness: Array
    viscous: Array
    meshes: MeshParameters
    beside: Array | None
    varying: Varying | None
    varying_links: np.ndarray
    clutches: np.ndarray


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class States:
    """States ``(n,)`` of all instants, in parts ``(instants, n)`` as they were marched:
    joined they would be copied.
    """

    parts: tuple[Array, ...]

    def times(self, rows: Array) -> Array:
        """Products ``(R, instants)`` with rows ``(R, n)``."""
        products = [rows @ part.T for part in self.parts]
        return namespace(products).concatenate(products, axis=1)


@by_value
@dataclass(frozen=True, repr=False)
class Transient(Motion[History, ToothContact, Array]):
    """Motion of a train over time; made by :func:`jaxhb.transient`.

    Readers by name as of other motions: :meth:`torque`, :meth:`force`,
    :meth:`gear_torque`, :meth:`twist`, :meth:`disk`, :meth:`speed`, :meth:`deflection`
    give a :class:`History`, :meth:`mesh` a :class:`ToothContact`.

    Parameters
    ----------
    time, rpm, angle : ``(n,)`` s, speed of the reference rotor in rpm, rad that its
    mean rotation has turned
    notes : what to know about the numbers; interrupted : whether the user ended it
    """

    topology: Topology = field(repr=False)
    train: DriveTrain = field(repr=False)
    time: Array = field(repr=False)
    rpm: Array = field(repr=False)
    angle: Array = field(repr=False)
    states: States = field(repr=False)
    loads: Array = field(repr=False)
    teeth: Array = field(repr=False)
    readings: Readings = field(repr=False)
    notes: tuple[str, ...] = ()
    interrupted: bool = False

    solution = None

    def __repr__(self) -> str:
        speeds = np.asarray(self.rpm, dtype=float)
        return (
            f"<Transient of {self.topology.title}: {number(float(self.time[-1]))} s,"
            f" {number(float(speeds.min()))} to {number(float(speeds.max()))} rpm>"
        )

    def _repr_html_(self) -> str:
        topology = self.topology
        rows = []
        for name in topology.link_names:
            toothed = name in topology.mesh_names
            signal = self.force(name) if toothed else self.torque(name)
            numbers = (
                signal.max,
                signal.min,
                signal.time_of_peak,
                signal.rpm_of_peak,
            )
            cells = [number(float(value)) for value in numbers]
            apart = number(self.mesh(name).separated) if toothed else ""
            rows.append([name, *cells, "N" if toothed else "N m", apart])
        head = [
            "shaft, damper or mesh",
            "max",
            "min",
            "peak at s",
            "at rpm",
            "unit",
            "separated s",
        ]
        return html_table(repr(self)[1:-1], head, rows)

    def stress(self, a: str, b: str | None = None) -> History:
        """Nominal torsional stress of a shaft in Pa, its torque over W_p of its
        section (:func:`jaxhb.torsional_stress`).

        ValueError where the scene gives neither ``diameter`` nor ``outer``.
        """
        link, _ = self.topology.link_index(a, b)
        name = self.topology.link_names[link]
        if name not in having(self.topology, "shaft", "outer", "diameter"):
            raise ValueError(
                f"stress: {name!r} has no section: give the shaft a diameter (or outer)"
            )
        torque = self.torque(a, b)
        return replace(
            torque,
            values=stress_of(self.train, name, torque.values),
            elastic_values=stress_of(self.train, name, torque.elastic.values),
        )

    def sn_curve(self, a: str, b: str | None = None) -> SNCurve:
        """S-N curve of a shaft by its ``sn_curve``, over the amplitude of the stress in
        Pa; ValueError where the scene gives none.
        """
        link, _ = self.topology.link_index(a, b)
        curves = self.topology.shaft_curves
        points, source = curves[link] if link < len(curves) else ((), "")
        if not points:
            name = self.topology.link_names[link]
            raise ValueError(
                f"sn_curve: {name!r} has none: give the shaft an sn_curve and its"
                " sn_source"
            )
        return SNCurve(points, source)

    def to_xarray(self) -> Dataset:
        """Signals of all elements along ``time`` as a data set of xarray, with ``rpm``
        and ``rotation`` of the reference rotor; needs ``jaxhb[data]``.

        >>> import jaxhb
        >>> data = jaxhb.transient(
        ...     jaxhb.load_scene("spur_pair"), seconds=0.02, speed=1000.0
        ... ).to_xarray()
        >>> data.tooth_force.dims, data.tooth_force.attrs["units"]
        (('time', 'mesh'), 'N')
        """
        refuse_tracers("to_xarray", self.states, self.rpm, host=True)
        return trace_to_xarray(self, self.time, self.rpm, self.angle)

    def passage(self, low: float, high: float) -> Array:
        """Seconds during which the speed of the reference rotor is between ``low`` and
        ``high`` rpm.
        """
        if not low < high:
            raise ValueError(
                f"passage({low:g}, {high:g}): the first speed must be the lower one"
            )
        xp = namespace(self.rpm)
        before = xp.asarray(self.rpm)[:-1]
        after = xp.asarray(self.rpm)[1:]
        change = after - before
        still = xp.abs(change) < 1e-12 * high
        safe = xp.where(still, 1.0, change)
        # Share of each step inside, the speed linear over it
        shares = xp.sort(
            xp.clip(xp.stack([low - before, high - before]) / safe, 0.0, 1.0), axis=0
        )
        inside = (before >= low) & (before <= high)
        share = xp.where(still, xp.where(inside, 1.0, 0.0), shares[1] - shares[0])
        return (share * np.diff(self.time)).sum()

    def cycles(self, signal: History) -> CountedCycles:
        """Cycles of a signal, counted by rainflow (ASTM E1049)."""
        return count_cycles(signal)

    def damage(self, signal: History, curve: SNCurve) -> Array:
        """Damage of a signal by a S-N curve in its unit, the sum of Palmgren and Miner:
        1 is the end of the life.
        """
        return damage_of(count_cycles(signal), curve)

    def _history(self, values: Array, elastic: Array | None = None) -> History:
        return History(self.time, values, self.rpm, self.angle, elastic)

    def _displacements(self, rows: Array) -> tuple[Array, Array]:
        """Values ``(n,)`` of a row ``(S,)`` of the displacements, and their rates,
        in one pass over the states.
        """
        readings = self.readings
        xp = namespace(rows, self.states)
        of_states = [rows @ readings.displacement, rows @ readings.velocity]
        of_loads = [
            rows @ readings.displacement_of_loads,
            rows @ readings.velocity_of_loads,
        ]
        both = self.states.times(xp.stack(of_states))
        values, rates = both + xp.stack(of_loads) @ self.loads.T
        return values, rates

    def _law(self, place: int) -> tuple[MeshParameters, Array, Array]:
        """Parameters, deflections and rates ``(n,)`` of a mesh that has a law."""
        meshes = self.readings.meshes
        one = jax.tree.map(lambda values: values[place], meshes)
        if meshes.variation is not None:
            turns = self.angle / self.topology.revolutions_per_cycle
            harmonics = np.arange(one.variation.shape[-1])
            xp = namespace(self.angle)
            waves = xp.exp(1j * turns[:, None] * harmonics)
            variation = 2 * (waves @ one.variation).real - one.variation[0].real
            law = jax.tree.map(lambda values: values * xp.ones(len(turns)), one.law)
            one = replace(one, law=backlash.at_instant(law, variation))
        half = (self.teeth.shape[1] - len(self.readings.clutches)) // 2
        return one, self.teeth[:, place], self.teeth[:, half + place]

    def _mesh_force(self, place: int) -> tuple[Array, Array]:
        """Transmitted and elastic force ``(n,)`` N of a mesh that has a law."""
        one, deflection, rate = self._law(place)
        elastic = backlash.force(one.law, deflection)
        transmitted = backlash.mesh_force(
            one.law, one.viscous, one.contact_damping, deflection, rate
        )
        return transmitted, elastic

    def _link(self, link: int) -> tuple[Array, Array]:
        """Transmitted and elastic force ``(n,)`` N of a link, that of its first end."""
        readings = self.readings
        places = self.topology.law_index
        mesh = link - self._shafts
        if mesh >= 0 and mesh in places:
            return self._mesh_force(list(places).index(mesh))
        clutches = list(readings.clutches)
        if link in clutches:
            carried = self.teeth[:, clutches.index(link) - len(clutches)]
            return carried, carried
        bend, rate = self._deflection(link)
        stiffness = readings.stiffness[link]
        viscous = readings.viscous[link]
        place = np.flatnonzero(np.asarray(readings.varying_links) == link)
        if readings.varying is not None and len(place):
            over_time = readings.varying.of(place).at(self.rpm * (np.pi / 30))
            stiffness, viscous = (values[:, 0] for values in over_time)
        elastic = stiffness * bend
        transmitted = elastic + viscous * rate
        return transmitted, elastic

    def _deflection(self, link: int) -> tuple[Array, Array]:
        """Deflection and its rate ``(n,)`` m of a linear link."""
        return self._displacements(self.readings.bend[link])

    def _torque(self, link: int) -> tuple[Array, Array]:
        """Transmitted and elastic torque ``(n,)`` N m of a shaft or damper."""
        readings = self.readings
        transmitted, elastic = (
            readings.ends[link] * force for force in self._link(link)
        )
        if readings.beside is None:
            return transmitted, elastic
        for place in np.flatnonzero(np.asarray(readings.beside[link])):
            one, deflection, _ = self._law(int(place))
            both = self._mesh_force(int(place))
            linear = one.law.linear_stiffness * deflection
            arm = readings.beside[link, place]
            transmitted = transmitted + arm * (both[0] - linear)
            elastic = elastic + arm * (both[1] - linear)
        return transmitted, elastic

    def _gear_torque(self, disk: int) -> tuple[Array, Array]:
        """Transmitted and elastic torque ``(n,)`` N m of a gear."""
        transmitted: Array = np.zeros(len(self.time))
        elastic = transmitted
        for mesh, ends in enumerate(self.topology.mesh_ends):
            if disk not in ends:
                continue
            force, part = self._link(self._shafts + mesh)
            arm = self.readings.bend[self._shafts + mesh, disk]
            arm = arm * self.readings.radius[disk]
            transmitted = transmitted + arm * force
            elastic = elastic + arm * part
        return transmitted, elastic

    def _read(self, quantity: str, index: Any, sense: int = 1) -> Any:
        readings = self.readings
        if quantity == "contact":
            return self._contact(index)
        if quantity == "power":
            return self._power(index)
        if quantity in ("angle", "speed"):
            row = np.eye(self.topology.n_disks)[index]
            angle, rate = self._displacements(row / readings.radius[index])
            if quantity == "angle":
                return self._history(angle)
            turning = readings.ratio[index] * self.rpm * (np.pi / 30)
            return self._history(rate + turning)
        if quantity == "twist":
            row = np.eye(self.topology.n_disks)
            a, b = index
            row = row[a] / readings.radius[a] - row[b] / readings.radius[b]
            return self._history(self._displacements(row)[0])
        if quantity == "deflection":
            places = list(self.topology.law_index)
            if index in places:
                deflection = self._law(places.index(index))[1]
            else:
                deflection = self._deflection(self._shafts + index)[0]
            history = self._history(deflection)
            return history if sense > 0 else history.reversed()
        by_quantity = {
            "torque": self._torque,
            "force": lambda mesh: self._link(self._shafts + mesh),
            "gear_torque": self._gear_torque,
        }
        if quantity not in by_quantity:
            raise ValueError(f"a transient has no {quantity.replace('_', ' ')}s")
        history = self._history(*by_quantity[quantity](index))
        return history if sense > 0 else history.reversed()

    def _power(self, link: int) -> Array:
        """Mean power in W that a shaft, damper or mesh turns into heat."""
        transmitted, elastic = self._link(link)
        places = list(self.topology.law_index)
        mesh = link - self._shafts
        if mesh in places:
            rate = self._law(places.index(mesh))[2]
        else:
            rate = self._deflection(link)[1]
        return self._history((transmitted - elastic) * rate).mean

    def _contact(self, mesh: int) -> ToothContact:
        """Contact of a mesh; one without backlash never parts."""
        places = list(self.topology.law_index)
        force = self._history(*self._link(self._shafts + mesh))
        side = int(np.sign(float(force.mean)))
        if mesh not in places or not self.topology.mesh_backlash[mesh]:
            return ToothContact(0.0, 0.0, 0, 0.0, side)
        one, deflection, rate = self._law(places.index(mesh))
        distance = np.abs(deflection) - one.law.gap
        steps = np.diff(self.time, prepend=self.time[0])
        entry = np.flatnonzero((distance[:-1] < 0) & (distance[1:] >= 0))
        reverse = (distance >= 0) & (np.sign(deflection) == -side)

        def first(happens: np.ndarray) -> float:
            return float(self.time[happens][0]) if happens.any() else np.nan

        enters = np.zeros(len(distance), dtype=bool)
        enters[entry + 1] = True
        return ToothContact(
            separated=float(steps[distance < 0].sum()),
            reverse_contact=float(steps[reverse].sum()),
            impacts=len(entry),
            hardest_impact=float(np.abs(rate[entry + 1]).max(initial=0.0)),
            drive_side=side,
            first_separation=first(distance < 0),
            first_impact=first(enters),
            first_reverse_contact=first(reverse),
        )
