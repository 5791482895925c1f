"""From checked elements to topology and tables of a drive train; all errors of a scene
are raised at once.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from jaxhb.elements import checks, derived, meshing, value_checks
from jaxhb.elements.elements import (
    OF_GEARS,
    OF_PERIOD,
    Cylinder,
    Damper,
    Head,
    Mesh,
    SceneError,
    Shaft,
)
from jaxhb.excitation import gas
from jaxhb.excitation.tables import COMPUTED
from jaxhb.train import connections, contact_law, tables
from jaxhb.train.checks import consistency
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.topology import Topology

# Largest orders of computed torques, where a scene says nothing
ORDERS = 12.0
ORDERS_OF_TWO_STROKES = 15.0


def build(
    elements: Iterable[Any],
    *,
    name: str = "",
    reference: str | None = None,
    revolutions_per_cycle: float = 2,
    rated_rpm: float | None = None,
    tune: dict[str, Any] | None = None,
    tolerance: dict[str, Any] | None = None,
    scenarios: dict[str, dict[str, Any]] | None = None,
    source: str = "scene",
) -> DriveTrain:
    """Check elements and put them together to a drive train.

    Where two gears that mesh both have ``teeth``, one of their radii is corrected, by
    up to 0.1 % a mesh, so that the ratio is that of the teeth. :class:`SceneError`
    tells everything that is wrong with the scene, one sentence a line.

    Parameters
    ----------
    elements : iterable
        Elements such as :class:`jaxhb.Disk`, in SI units; disks keep their order.
    name, source : str
        Of the scene, and where its elements come from, for the sentences of errors.
    reference : str, optional
        A disk of the rotor whose rpm is given; needed when there are several rotors.
    revolutions_per_cycle : float
        Period of the excitation in revolutions of the reference rotor.
    rated_rpm : float, optional
        Rated speed of the reference rotor; limits of stresses depend on the speed over
        it.
    tune, tolerance, scenarios : dict, optional
        The first two are passed on untouched; ``{name: {"NAME.FIELD": value}}`` for
        :meth:`DriveTrain.scenario`.

    Examples
    --------
    >>> parts = [jaxhb.Disk(name="a", inertia=1.0), jaxhb.Disk(name="b", inertia=2.0)]
    >>> parts += [jaxhb.Shaft(between=("a", "b"), stiffness=1e4)]
    >>> train = build(
    ...     [*parts, jaxhb.Torque(disk="a", harmonics=[(1.0, 5.0, 0.0)])],
    ...     revolutions_per_cycle=1,
    ... )
    >>> train.value("a|b.stiffness")
    10000.0
    """
    return checked(
        elements,
        name,
        reference,
        revolutions_per_cycle,
        rated_rpm,
        tune=tune,
        tolerance=tolerance,
        scenarios=scenarios,
        source=source,
    )


def checked(
    elements: Iterable[Any],
    name: str,
    reference: Any,
    cycle: Any,
    rated_rpm: Any,
    *,
    tune: Mapping[str, Any] | None,
    tolerance: Mapping[str, Any] | None,
    scenarios: Any,
    source: str,
    notes: tuple[str, ...] = (),
    findings: Iterable[str] = (),
    complete: bool = True,
    disks_read: bool = True,
) -> DriveTrain:
    """Build a train as :func:`build` does, or raise its errors after the sentences
    ``findings`` of the reader.

    ``complete`` is False where tables of the scene were not read, and ``disks_read``
    where disks or rings may be among them. Every check runs on the sound part of the
    scene, and all sentences are raised together.
    """
    parts = checks.Parts(elements, source, complete=complete)
    errors = [
        *findings,
        *parts.engine_errors,
        *checks.element_errors(parts),
        *checks.name_errors(parts),
    ]
    too_large = checks.size_errors(parts)
    if too_large:
        raise SceneError(dict.fromkeys([*errors, *too_large]))
    numbers = {"revolutions_per_cycle": cycle, "rated_rpm": rated_rpm}
    head_errors = []
    where = f"{source}, [scene]"
    for field in dataclasses.fields(Head):
        if field.name in numbers:
            value = numbers[field.name]
            head_errors += value_checks.field_errors(where, field, value) or []
    errors += head_errors
    errors += checks.reference_errors(parts, reference, disks_read=disks_read)
    errors += consistency.connection_errors(parts)
    rotor = connections.pieces(len(parts.disk_names), consistency.elastic_pairs(parts))
    errors += consistency.reference_error(parts, reference, rotor)
    errors += consistency.gear_errors(parts, rotor)
    errors += consistency.inertia_errors(parts)
    main_disk = 0 if reference is None and parts.disk_names else parts.disk(reference)
    # Without a reference the first disk stands for it if there is one rotor; else
    # speeds would be guessed.
    one_rotor = parts.connected and max(rotor, default=0) == 0
    root = main_disk if reference is not None or one_rotor else None
    radii = _exact_radii(parts)
    _expand_meshes(parts)
    rotors, ratio, locked = _gearing(parts, root, radii)
    errors += consistency.loop_errors(parts, locked)
    if not head_errors:
        errors += consistency.cycle_errors(parts, _harmonic_needs(parts, ratio), cycle)
    errors += consistency.hold_errors(parts, main_disk)
    errors += consistency.balance_errors(parts, ratio) if not locked else []
    errors += consistency.phase_errors(parts, ratio)
    errors += checks.rated_errors(parts, rated_rpm)
    scenarios, scenario_errors = checks.read_scenarios(parts, scenarios)
    errors += scenario_errors
    if errors:
        # Each once: cylinders of one engine share sentences.
        raise SceneError(dict.fromkeys(errors))
    # Without errors every disk has a rotor and a ratio.
    assert rotors is not None
    assert main_disk is not None
    disks = parts.tables["disk"]
    parts.tables["disk"] = [
        dataclasses.replace(disk, radius=radius)
        for disk, radius in zip(disks, radii, strict=False)
    ]
    # As text: a topology is hashed, and dictionaries are not.
    settings = {
        "scenarios": scenarios,
        "tune": tune or {},
        "tolerance": tolerance or {},
    }
    head: dict[str, Any] = {
        key: json.dumps(table, default=str) for key, table in settings.items()
    }
    head |= {
        "name": name,
        "rated_rpm": None if rated_rpm is None else float(rated_rpm),
        "notes": notes,
    }
    topology = _topology(parts, rotors, main_disk, float(cycle), ratio, head)
    # Only now: nothing follows from keys with an error.
    for table in derived.LINKS:
        parts.tables[table] = [derived.completed(link) for link in parts.tables[table]]
    train = DriveTrain(topology=topology, **tables.of_elements(parts.tables))
    return contact_law.with_contact_law(train, parts.tables["mesh"])


def _expand_meshes(parts: checks.Parts) -> None:
    """Put stiffness and orders in the place of the shorthands of sound meshes."""
    fields = [field.name for field in dataclasses.fields(Mesh)]
    disks = parts.tables["disk"]
    for i, ends in parts.links("mesh"):
        if not parts.usable("mesh", i, *fields) or any(
            disk >= len(disks) for disk in ends
        ):
            continue
        mesh = parts.tables["mesh"][i]
        gears = [disks[disk] for disk in ends]
        sound_gears = all(
            parts.usable("disk", disk, "radius", "teeth") and disks[disk].radius
            for disk in ends
        )
        if sound_gears and (mesh.width is None or all(gear.teeth for gear in gears)):
            parts.tables["mesh"][i] = meshing.expanded(mesh, gears)


def _exact_radii(parts: checks.Parts) -> list[float | None]:
    """Radii that the numbers of teeth make exact, None where absent, for disks and
    rings.
    """
    radii: list[float | None] = [None] * len(parts.disk_names)
    teeth = [0] * len(parts.disk_names)
    for i, disk in enumerate(parts.tables["disk"]):
        if parts.usable("disk", i, "radius", "teeth") and disk.radius is not None:
            radii[i] = disk.radius
            teeth[i] = int(disk.teeth or 0)
    return connections.exact_radii(radii, teeth, parts.ends("mesh"))


def _gearing(
    parts: checks.Parts, root: int | None, radii: Sequence[float | None]
) -> tuple[
    connections.Rotors | None, list[float | None], list[tuple[int, list[int], str]]
]:
    """Find the rotors seen from disk ``root``, the speed ratio of each disk (None:
    unknown) and locked loops.
    """
    n_disks = len(parts.disk_names)
    pairs = consistency.elastic_pairs(parts)
    meshes = parts.links("mesh")
    ends = [pair for _, pair in meshes]
    internal = [parts.tables["mesh"][i].kind == "internal" for i, _ in meshes]
    numbers = [math.nan if radius is None else radius for radius in radii]
    # Piece by piece: a locked loop has its sentence wherever it lies.
    piece = connections.pieces(n_disks, pairs + ends)
    starts = {piece[disk]: disk for disk in reversed(range(n_disks))}
    if root is not None:
        starts[piece[root]] = root
    kinds_known = all(parts.usable("mesh", i, "kind") for i, _ in meshes)
    gearing = connections.Gearing(n_disks, pairs, ends, internal, numbers)
    geared = {gearing.rotor[disk] for pair in ends for disk in pair}
    rotors = None
    for start in starts.values():
        if start == root:
            rotors = gearing.rotors(gearing.lead(start))
        elif gearing.rotor[start] in geared:
            gearing.lead(start)
    # A kind that cannot be read leaves senses unknown, but not ratios.
    locked = [
        (meshes[mesh][0], disks, why)
        for mesh, disks, why in gearing.locked
        if kinds_known or "senses" not in why
    ]
    # Without meshes all disks turn alike, whatever the reference is.
    if parts.complete and not parts.tables["mesh"]:
        return rotors, [1.0] * n_disks, locked
    if rotors is None or root is None:
        return rotors, [None] * n_disks, locked
    is_reached = [
        rotor == rotors.rotor[root] or bool(path)
        for rotor, path in enumerate(rotors.path)
    ]
    ratios = [
        ratio if ok and math.isfinite(ratio) else None
        for ratio, ok in zip(rotors.ratio, is_reached, strict=True)
    ]
    return rotors, [ratios[rotor] for rotor in rotors.rotor], locked


def _harmonic_needs(
    parts: checks.Parts, ratio: Sequence[float | None]
) -> list[tuple[str, int, str, float, str]]:
    """Harmonics per revolution of the reference rotor that must be whole over the
    cycle: (table, i, text, value, key of the mean).
    """
    needs: list[tuple[str, int, str, float, str]] = []

    def need(
        table: str,
        i: int,
        rows: Any,
        factor: float | None,
        mean: str = "",
        of: str = "",
    ) -> None:
        """Note the orders of rows, which turn ``factor`` times a revolution."""
        if factor is not None:
            needs.extend(
                (table, i, f"order {order:g}{of}", order * factor, mean)
                for order in _orders(rows)
            )

    seat = dict(parts.seats("torque"))
    for i, torque in enumerate(parts.tables["torque"]):
        if parts.usable("torque", i, "orders_of"):
            factor: float | None = 1.0
            if torque.orders_of == "own":
                factor = ratio[seat[i]] if i in seat else None
            need("torque", i, torque.harmonics, factor, "mean")
    for i, ends in parts.links("mesh"):
        mesh = parts.tables["mesh"][i]
        periods = _mesh_periods(parts, ends, ratio)
        turns_per_order = [(name, periods) for name in OF_PERIOD]
        turns_per_order += zip(OF_GEARS, (ratio[disk] for disk in ends), strict=True)
        for name, turns in turns_per_order:
            need("mesh", i, getattr(mesh, name), turns, of=f" of {name}")
    for i, disk in parts.seats("load"):
        need("load", i, parts.tables["load"][i].harmonics, ratio[disk])
    for i, disk in parts.seats("cylinder"):
        cylinder = parts.tables["cylinder"][i]
        factor = ratio[disk]
        need("cylinder", i, cylinder.gas_torque, factor, "gas_torque_mean")
        if factor is None:
            continue
        if gas.source(cylinder) and parts.usable("cylinder", i, *COMPUTED):
            revolutions = gas.gas_revolutions(cylinder)
            if parts.usable("cylinder", i, "fires_every"):
                revolutions *= int(cylinder.fires_every)
            plural = "s" if revolutions > 1 else ""
            text = f"one gas cycle of {revolutions} revolution{plural}"
            needs.append(("cylinder", i, text, factor / revolutions, ""))
        moving = (
            parts.usable("cylinder", i, "stroke", "reciprocating_mass")
            and cylinder.stroke is not None
        )
        if moving and cylinder.reciprocating_mass > 0:
            needs.append(
                ("cylinder", i, "order 1 of the reciprocating mass", factor, "")
            )
    return needs


def _mesh_periods(
    parts: checks.Parts, ends: tuple[int, int], ratio: Sequence[float | None]
) -> float | None:
    """Mesh periods per revolution of the reference rotor, from the gear that has teeth;
    None where that is unknown.
    """
    disks = parts.tables["disk"]
    for disk in ends:
        own_ratio = ratio[disk]
        is_known = disk < len(disks) and parts.usable("disk", disk, "teeth")
        if is_known and own_ratio is not None and disks[disk].teeth:
            return disks[disk].teeth * own_ratio
    return None


def _orders(rows: Any) -> list[float]:
    """Orders of the sound rows of a table of harmonics."""
    if not isinstance(rows, tuple | list):
        return []
    firsts = [row[0] for row in rows if isinstance(row, tuple | list) and row]
    orders = [float(first) for first in firsts if value_checks.number_like(first)]
    return [order for order in orders if math.isfinite(order) and order > 0.0]


def _topology(
    parts: checks.Parts,
    rotors: connections.Rotors,
    reference_disk: int,
    cycle: float,
    ratio: Sequence[Any],
    settings: Mapping[str, Any],
) -> Topology:
    """Collect the static half of the train; ``settings`` are the fields that the scene
    gives for the whole train.
    """
    elements = parts.tables
    links = [*elements["shaft"], *elements["damper"]]
    seats = {
        table: tuple(parts.sits_on(table))
        for table in ("damper", "ground", "load", "torque", "cylinder")
    }
    fields: dict[str, Any] = {
        f"{table}_names": tuple(names)
        for table, names in parts.names.items()
        if table != "disk"
    }
    fields |= {f"{table}_disk": disks for table, disks in seats.items()}
    fields |= settings
    torque_factors = [
        ratio[disk] if torque.orders_of == "own" else 1.0
        for disk, torque in zip(seats["torque"], elements["torque"], strict=True)
    ]
    cylinder_turns = [_whole(ratio[disk] * cycle) for disk in seats["cylinder"]]
    fields |= _computed_torques(elements["cylinder"], cylinder_turns)

    def harmonics(
        tables: Iterable[Sequence[Any]], per_order: Iterable[float]
    ) -> tuple[tuple[int, ...], ...]:
        """Harmonics of the cycle of the orders of every element."""
        return tuple(
            tuple(round(row[0] * factor) for row in rows)
            for rows, factor in zip(tables, per_order, strict=True)
        )

    phased = [parts.phased(i) for i in range(len(elements["phase"]))]
    for table in ("cylinder", "torque"):
        fields[f"phase_{table}s"] = tuple(tuple(members[table]) for members in phased)
    phased_disks = []
    for members in phased:
        table = "cylinder" if members["cylinder"] else "torque"
        phased_disks.append(seats[table][members[table][0]])
    meshes = elements["mesh"]
    mesh_ends = tuple(parts.ends("mesh"))
    per_revolution = [_mesh_periods(parts, ends, ratio) or 0.0 for ends in mesh_ends]
    needs_periods = [any(getattr(mesh, name) for name in OF_PERIOD) for mesh in meshes]
    periods = [
        round(number * cycle) if is_needed else 0
        for number, is_needed in zip(per_revolution, needs_periods, strict=True)
    ]
    first_turns = [ratio[first] * cycle for first, _ in mesh_ends]
    second_turns = [ratio[second] * cycle for _, second in mesh_ends]
    for name, per_order in zip(
        (*OF_PERIOD, *OF_GEARS),
        (periods, periods, first_turns, second_turns),
        strict=True,
    ):
        rows = [getattr(mesh, name) for mesh in meshes]
        fields[f"mesh_{name}"] = harmonics(rows, per_order)
    return Topology(
        revolutions_per_cycle=cycle,
        disk_names=tuple(parts.disk_names),
        n_scene_disks=len(elements["disk"]),
        teeth=tuple(int(disk.teeth or 0) for disk in elements["disk"]),
        rotor=rotors.rotor,
        n_rotors=len(rotors.ratio),
        reference_disk=reference_disk,
        reference_rotor=rotors.rotor[reference_disk],
        rotor_path=rotors.path,
        shaft_ends=tuple(parts.ends("shaft")),
        shaft_rules=tuple(shaft.rule for shaft in elements["shaft"]),
        mesh_ends=mesh_ends,
        mesh_periods=tuple(periods),
        mesh_internal=tuple(mesh.kind == "internal" for mesh in meshes),
        mesh_backlash=tuple(mesh.backlash is not None for mesh in meshes),
        mesh_damping_law=tuple(mesh.damping_law for mesh in meshes),
        torque_own=tuple(torque.orders_of == "own" for torque in elements["torque"]),
        torque_harmonics=harmonics(
            [torque.harmonics for torque in elements["torque"]],
            [factor * cycle for factor in torque_factors],
        ),
        load_harmonics=harmonics(
            [load.harmonics for load in elements["load"]],
            [ratio[disk] * cycle for disk in seats["load"]],
        ),
        cylinder_harmonics=harmonics(
            [cylinder.gas_torque or () for cylinder in elements["cylinder"]],
            cylinder_turns,
        ),
        cylinder_turn=tuple(cylinder_turns),
        phase_turn=tuple(_whole(ratio[disk] * cycle) for disk in phased_disks),
        cylinder_series=tuple(
            cylinder.kinematics == "mendes2008" for cylinder in elements["cylinder"]
        ),
        cylinder_fires=tuple(cylinder.fires for cylinder in elements["cylinder"]),
        cylinder_cut_off=(False,) * len(elements["cylinder"]),
        cylinder_every=tuple(
            int(cylinder.fires_every) for cylinder in elements["cylinder"]
        ),
        link_keys=derived.link_keys(
            [link for table in derived.LINKS for link in elements[table]]
        ),
        hz_links=tuple(i for i, link in enumerate(links) if link.over_hz),
        amplitude_links=tuple(i for i, link in enumerate(links) if link.over_amplitude),
        order_links=tuple(
            i
            for i, link in enumerate(links)
            if getattr(link, "order", None) is not None
        ),
        springs=tuple(
            spring for i, link in enumerate(links) for spring in _springs(i, link)
        ),
        **fields,
    )


def _whole(number: float) -> float:
    """Round a number that is whole to 1e-6: ratios of radii round."""
    return float(round(number)) if consistency.whole(number) else number


def _springs(link: int, element: Shaft | Damper) -> Iterator[tuple[int, str, int]]:
    """Springs that act beside the stiffness of a shaft or damper, as ``springs`` of the
    topology holds them.
    """
    for name in ("clearance", "friction"):
        if getattr(element, name) is not None:
            yield link, name, 0
    for name in ("stages", "stops"):
        for row in range(len(getattr(element, name))):
            yield link, name, row


def _computed_torques(
    cylinders: Sequence[Cylinder], turns_per_cycle: Sequence[float]
) -> dict[str, tuple[Any, ...]]:
    """Source of the gas torque of each cylinder, and numbers of harmonics to compute,
    as fields of the topology.
    """
    columns: dict[str, list[Any]] = {
        "source": [],
        "step": [],
        "gas_revolutions": [],
        "gas": [],
        "inertia": [],
    }
    for cylinder, turns in zip(cylinders, turns_per_cycle, strict=True):
        is_computed = gas.source(cylinder) is not None
        revolutions = gas.gas_revolutions(cylinder)
        # Of all gas cycles from one with injection to the next
        span = revolutions * cylinder.fires_every
        has_crank = cylinder.stroke is not None and cylinder.rod is not None
        largest = ORDERS_OF_TWO_STROKES if is_computed and revolutions == 1 else ORDERS
        orders = cylinder.orders or largest
        # 1e-9 keeps a product that rounds below a whole number.
        gas_harmonics = math.floor(orders * revolutions * cylinder.fires_every + 1e-9)
        moves = has_crank and consistency.whole(turns)
        columns["source"].append(gas.source_word(cylinder))
        columns["step"].append(round(turns / span) if is_computed else 0)
        columns["gas_revolutions"].append(revolutions)
        columns["gas"].append(gas_harmonics if is_computed else 0)
        columns["inertia"].append(math.floor(orders + 1e-9) if moves else 0)
    return {f"cylinder_{name}": tuple(column) for name, column in columns.items()}
