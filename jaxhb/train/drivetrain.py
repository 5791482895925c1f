"""The drive train: arrays of numbers over a fixed topology;
:func:`jaxhb.train.assembly.build` makes it.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxhb._equal import by_value
from jaxhb._jax import Number, pytree, traced
from jaxhb._shown import html_table
from jaxhb.elements.checks import ORDER_ROWS
from jaxhb.elements.rules.chosen import STRENGTH_KEYS, File, choose, lacking
from jaxhb.elements.rules.margins import MARGINS
from jaxhb.elements.sentences import SceneError, shown, suggestion
from jaxhb.elements.values import joined
from jaxhb.excitation import gas
from jaxhb.train import changes, omission, varying
from jaxhb.train.checks import limits
from jaxhb.train.tables import TrainArrays


@pytree
@by_value
@dataclass(frozen=True, kw_only=True, eq=False)
class DriveTrain(TrainArrays):
    """A drive train: a pytree of float64 vectors (one for each field of each kind of
    element) and static topology.

    Make one with :func:`jaxhb.build` or :func:`jaxhb.load_scene`. Its arrays are
    read-only: change numbers with :meth:`replace`, which returns another train. The
    fields are described in :mod:`jaxhb.train.tables`, the topology in
    :mod:`jaxhb.train.topology`.
    """

    def __repr__(self) -> str:
        return (
            f"<DriveTrain {self.topology.name or 'without a name'}:"
            f" {self.topology.parts_text}>"
        )

    def _repr_html_(self) -> str:
        return html_table(
            repr(self)[1:-1], ["elements", "number", "names"], self.topology.parts_rows
        )

    @property
    def tune(self) -> dict[str, Any]:
        """The ``[tune]`` table of the scene, untouched."""
        return json.loads(self.topology.tune)

    @property
    def tolerance(self) -> dict[str, Any]:
        """The ``[tolerance]`` table of the scene, untouched."""
        return json.loads(self.topology.tolerance)

    @property
    def report_units(self) -> dict[str, str]:
        """Units in which reports show quantities, ``units`` of the ``[report]`` table
        of the scene.
        """
        return json.loads(self.topology.report)

    def value(self, key: str) -> Any:
        """Read one number ``"NAME.FIELD"`` in the unit of the scene format, a float or
        an array.

        A damper's ring has the damper's fields; those of a table inside an element are
        ``"NAME.combustion.start"``. ``harmonics`` and ``gas_torque`` are [n, 2] (Re,
        Im), ``traces.rpm`` [R], ``traces.load`` [S], ``traces.pressure`` [R, S, 7200]
        from firing top dead centre on. :class:`SceneError` if no element has the name,
        or its kind no such field.
        """
        return changes.read(self, key)

    def replace(self, values: dict[str, Any]) -> DriveTrain:
        """Return the train with some numbers changed; the topology stays, so that
        nothing is compiled anew.

        Three changes go beyond numbers: ``damping_law`` and ``law`` of a mesh take the
        words of the scene format, and ``teeth`` of a gear with teeth changes its
        radius, at the same pitch, and the ratios. ``gas_factor`` can be changed in any
        train: where the scene gives none, the train gets a vector of ones first.

        ``{"NAME.FIELD": value}`` in the units of the scene format; values may be
        traced. :class:`SceneError` tells all unknown names and fields, wrong shapes,
        values that contradict each other and numbers that have no effect because the
        train was built without them, one sentence each; of concrete values also those
        out of range, and stiffnesses that leave a mean torque unheld.

        >>> jaxhb.load_scene("gear_train_30").replace(
        ...     {"crank damper.damping": 300.0}
        ... ).value("crank damper.damping")
        300.0
        """
        return changes.replace(self, values)

    def with_viscous_damping(self, *, hz: Number) -> DriveTrain:
        """Return the train with every loss factor turned into viscous damping: r += eta
        k / omega, omega = 2 pi hz.

        At ``hz`` > 0, in Hz, both dissipate the same. :class:`SceneError` if it is not,
        or a link varies.

        >>> train = jaxhb.load_scene("six_cylinder_diesel").with_viscous_damping(
        ...     hz=100.0
        ... )
        >>> round(float(train.value("cyl6|flywheel.damping")), 2)
        110.07
        """
        varying.refuse_varying(self.topology)
        if not traced(hz) and not np.all(np.asarray(hz) > 0.0):
            raise SceneError(
                f"with_viscous_damping: hz is {hz}, must be greater than 0 Hz. Give the"
                " main frequency."
            )
        omega = 2.0 * np.pi * hz

        def viscous(table: Any) -> Any:
            """A table of links with its loss factors in the damping."""
            damping = table.damping + table.loss_factor * table.stiffness / omega
            return dataclasses.replace(
                table, damping=damping, loss_factor=0.0 * table.loss_factor
            )

        return dataclasses.replace(
            self, shafts=viscous(self.shafts), dampers=viscous(self.dampers)
        )

    def with_constant_links(
        self,
        *,
        hz: Number | None = None,
        amplitude: Number | None = None,
        rpm: Number | None = None,
    ) -> DriveTrain:
        """Return the train with its varying links, and all numbers that depend on the
        speed, as they are at one frequency, amplitude and speed.

        Needed for links that vary with the vibration in everything but the linear
        forced response, and for numbers that depend on the speed where no speed is
        asked for, as of natural frequencies. Stiffness ``(k + J (order Omega)^2) s``,
        damping ``r d``, loss factor ``eta d``, with the factors s and d of the tables;
        nothing varies any more.

        ``hz`` (Hz) is for links with ``over_hz``, ``amplitude`` (rad, of the vibratory
        twist) for those with ``over_amplitude``, ``rpm`` of the reference rotor for
        dampers with ``order`` and for ``damping_over_rpm`` and ``stiffness_over_rpm``
        of any element. :class:`SceneError` names the elements that need one that is not
        given; none may be below 0.

        >>> rows = [(0.0, 1.0, 1.0), (100.0, 1.5, 0.5)]
        >>> coupling = jaxhb.Shaft(
        ...     between=("a", "b"), stiffness=1e4, loss_factor=0.2, over_hz=rows
        ... )
        >>> train = jaxhb.build(
        ...     [
        ...         jaxhb.Disk(name="a", inertia=1.0),
        ...         jaxhb.Disk(name="b", inertia=2.0),
        ...         coupling,
        ...     ]
        ... )
        >>> stiffer = train.with_constant_links(hz=50.0)
        >>> stiffer.value("a|b.stiffness"), round(stiffer.value("a|b.loss_factor"), 12)
        (12500.0, 0.15)
        """
        return varying.with_constant_links(self, hz=hz, amplitude=amplitude, rpm=rpm)

    def repeated(self, cycles: int) -> DriveTrain:
        """Return the same train with a cycle ``cycles`` times as long, for motions with
        a period of several cycles.

        The excitation over time is the same; responses have orders that are multiples
        of ``1 / (cycles x revolutions_per_cycle)``. :class:`SceneError` if ``cycles``
        is not a whole number of at least 1.
        """
        if not (isinstance(cycles, int) and cycles >= 1):
            raise SceneError(
                f"repeated: cycles is {cycles}, must be a whole number of at least 1."
            )
        return dataclasses.replace(self, topology=self.topology.repeated(cycles))

    @property
    def scenarios(self) -> dict[str, dict[str, Any]]:
        """Values of every ``[scenario.NAME]`` of the scene, and the elements that it
        leaves out (``without``).
        """
        return json.loads(self.topology.scenarios)

    @property
    def sequences(self) -> dict[str, dict[str, Any]]:
        """Names of the ``events`` of every ``[sequence.NAME]`` of the scene, and by how
        many seconds all of them begin later (``begin``).
        """
        return json.loads(self.topology.sequences)

    def scenario(self, name: str) -> DriveTrain:
        """Return the train of its ``[scenario.NAME]``.

        It is the train :meth:`without` the elements that the scenario leaves out, with
        the cylinders that fire there, and with its values by :meth:`replace`; the
        errors of both.

        >>> parts = [
        ...     jaxhb.Disk(name="a", inertia=1.0),
        ...     jaxhb.Disk(name="b", inertia=2.0),
        ... ]
        >>> parts += [jaxhb.Shaft(between=("a", "b"), stiffness=1e4)]
        >>> jaxhb.build(parts, scenarios={"hot": {"a|b.stiffness": 8e3}}).scenario(
        ...     "hot"
        ... ).value("a|b.stiffness")
        8000.0
        """
        if name not in self.scenarios:
            near = suggestion(name, self.scenarios)
            remark = near if self.scenarios else " The scene has none."
            raise SceneError(
                f"{self.topology.title}: there is no scenario {shown(name)}.{remark}"
            )
        values = dict(self.scenarios[name])
        train = self.without(*values.pop("without", ()))
        cylinders = train.topology.cylinders
        fires_by_name = zip(cylinders.names, cylinders.fires, strict=True)
        fires = tuple(
            values.pop(f"{cylinder}.fires", fires) for cylinder, fires in fires_by_name
        )
        topology = train.topology.with_cylinders(fires=fires)
        # Rows of orders are (order, Re, Im), of the orders that the train has.
        numbers = {
            key: np.array(value)[:, 1:]
            if isinstance(value, list) and key.rpartition(".")[2] in ORDER_ROWS
            else value
            for key, value in values.items()
        }
        return dataclasses.replace(train, topology=topology).replace(numbers)

    def with_rules(self, *rules: str | File) -> DriveTrain:
        """Return the train judged by rules before those of its scene: names, or
        ``jaxhb.elements.rules.chosen.File`` objects.

        The first one for shafts judges those that name none. :class:`SceneError` if
        there is no such rule, or if a shaft lacks a number that it needs.

        >>> train = jaxhb.load_scene("spur_pair").with_rules("KR generator shaft")
        >>> train.topology.rules.default
        'KR generator shaft'
        """
        topology = self.topology
        chosen = topology.rules.with_first(choose(rules))
        topology = dataclasses.replace(topology, rules=chosen)
        errors = []
        for shaft, name in enumerate(topology.shaft_names):
            keys = topology.link_keys[shaft] if topology.link_keys else ()
            rule = topology.rule_of(shaft)
            missing = lacking(rule, keys)
            if missing and "tensile_strength" in keys:
                words = joined(STRENGTH_KEYS[key] for key in missing)
                errors.append(
                    f"[[shaft]] {shown(name)}: the limits of {rule.name} need {words}."
                    " Give it."
                )
        if any(name in MARGINS for name in chosen.names) and not topology.operating_rpm:
            errors.append(
                "the rules of separation margins need operating_rpm = [lowest, highest]"
                " in [scene]. Give the operating speeds of the reference rotor in rpm."
            )
        train = dataclasses.replace(self, topology=topology)
        errors = errors or limits.limit_errors(train)
        if errors:
            raise SceneError(errors)
        return train

    def without(self, *names: str) -> DriveTrain:
        """Return the train without elements, as with a clutch open (its shaft left out)
        or a pump taken off.

        With a disk goes all that sits on it, and whatever no link joins to the
        reference disk any more goes as well, such as an engine behind an open clutch:
        it stands still, or turns by itself. :class:`SceneError` if there is no such
        element, if the reference disk goes, or if a mean torque is left that nothing
        holds.

        >>> train = jaxhb.load_scene("gear_train_30").without("crank damper")
        >>> "crank damper" in train.topology.elements
        False
        """
        return omission.without(self, names) if names else self

    def misfire(self, *cylinders: str) -> DriveTrain:
        """Return the train with cylinders, by their names, that do not fire: no
        injection, compression and the inertia torque stay. This is the misfire that
        classification rules ask for.

        The pressure of compression alone is told from a pressure table
        (``jaxhb.excitation.compression``), traces or the combustion model without heat.
        From a given ``gas_torque`` it cannot be told: all of that goes, as by
        :meth:`cut_off`; :meth:`not_firing` says what holds. A table of tangential
        pressures has it in its rows at imep 0. :class:`SceneError` if there is no such
        cylinder, or no such row.

        >>> train = jaxhb.load_scene("six_cylinder_diesel").misfire("cylinder 3")
        >>> train.topology.cylinders.fires
        (True, True, False, True, True, True)
        """
        return self._with_flag("fires", cylinders, False)

    def cut_off(self, *cylinders: str) -> DriveTrain:
        """Return the train with cylinders, by their names, that have no gas torque at
        all, neither of combustion nor of compression, as with valves that stay open;
        the inertia torque stays. :class:`SceneError` as :meth:`misfire`.
        """
        return self._with_flag("cut_off", cylinders, True)

    def _with_flag(
        self, field: str, cylinders: Sequence[str], flag: bool
    ) -> DriveTrain:
        """The train with a flag of some cylinders, all of which it has to have."""
        seats = self.topology.cylinders
        unknown = [name for name in cylinders if name not in seats.names]
        if unknown:
            where = self.topology.title
            raise SceneError(
                [
                    f"{where}: there is no cylinder"
                    f" {shown(name)}.{suggestion(name, seats.names)}"
                    for name in unknown
                ]
            )
        if field == "fires":
            omission.check_compressions(self, cylinders)
        flags = tuple(
            flag if name in cylinders else before
            for name, before in zip(seats.names, getattr(seats, field), strict=True)
        )
        topology = self.topology.with_cylinders(**{field: flags})
        return dataclasses.replace(self, topology=topology)

    def misfires(self) -> dict[str, DriveTrain]:
        """Return the trains without one cylinder each that fires: every such cylinder
        in turn does not, by its name.

        As by :meth:`misfire`, but their injections alone differ: they share all that is
        compiled, and can be stacked.

        >>> trains = jaxhb.load_scene("six_cylinder_diesel").misfires()
        >>> list(trains)[2], trains["cylinder 3"].cylinders.injection
        ('cylinder 3', array([1., 1., 0., 1., 1., 1.]))
        """
        return {
            name: self.replace({f"{name}.injection": 0.0})
            for name in self.topology.firing_cylinders
        }

    def cut_offs(self) -> dict[str, DriveTrain]:
        """Return the trains with one cylinder each cut off that fires, every such
        cylinder in turn, by its name.

        As by :meth:`cut_off`, but their gas factors alone differ: they share all that
        is compiled, and can be stacked.
        """
        return {
            name: self.replace({f"{name}.gas_factor": 0.0})
            for name in self.topology.firing_cylinders
        }

    def not_firing(self) -> list[str]:
        """Say what is computed of cylinders without injection or gas torque, one
        sentence for those alike.

        Injections and gas factors that are traced count as there. Empty where every
        cylinder fires.

        >>> jaxhb.load_scene("first_scene").misfire("cylinder 1").not_firing()
        ['cylinder 1: no injection, compression stays']
        """
        return omission.not_firing(self)

    def outside_traces(self, rpm: float) -> list[str]:
        """Say where the pressure traces or the tangential pressures of cylinders do not
        cover a speed or its load, so that the nearest is used.

        ``rpm`` of the reference rotor. One sentence for all cylinders with the same
        traces; empty where all is covered.
        """
        return gas.outside_traces(self.topology.cylinder_names, self.cylinders, rpm)
