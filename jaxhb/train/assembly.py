"""From checked elements to topology and tables of a drive train; all errors of a scene
are raised at once.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from jaxhb.elements import checks, derived, meshing
from jaxhb.elements.elements import (
    OF_GEARS,
    OF_PERIOD,
    TACHOMETER,
    Damper,
    Head,
    Mesh,
    Shaft,
)
from jaxhb.elements.event_tables import EventSeat, seat_of
from jaxhb.elements.excitations import EXCITATIONS
from jaxhb.elements.excitations.blades import with_blades
from jaxhb.elements.rules.chosen import DEFAULT, Chosen, File, choose
from jaxhb.elements.sentences import SceneError
from jaxhb.elements.values import field_errors, rounded, sound_orders
from jaxhb.excitation.orders import harmonics_of
from jaxhb.train import connections, contact_law, tables
from jaxhb.train.checks import consistency, limits
from jaxhb.train.checks.events import event_errors, read_sequences, shaft_of
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.topology import Topology


def build(
    elements: Iterable[Any],
    *,
    name: str = "",
    reference: str | None = None,
    revolutions_per_cycle: float = 2,
    rated_rpm: float | None = None,
    temperature: float | None = None,
    tune: dict[str, Any] | None = None,
    tolerance: dict[str, Any] | None = None,
    scenarios: dict[str, dict[str, Any]] | None = None,
    sequences: dict[str, dict[str, Any]] | None = None,
    rules: Sequence[str | File] = DEFAULT,
    tachometer_tolerance: float = TACHOMETER,
    operating_rpm: Sequence[float] = (),
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
    temperature : float, optional
        In deg C, of the elements with ``over_temperature`` that have none.
    tune, tolerance, scenarios, sequences : dict, optional
        The first two are passed on untouched; ``{name: {"NAME.FIELD": value}}`` for
        :meth:`DriveTrain.scenario`; ``{name: {"events": names, "begin": s}}`` of events
        that begin together, all later by ``begin``, 0 unless given.
    rules, tachometer_tolerance, operating_rpm : optional
        Names of the rules that judge the train, the tolerance of its tachometer as a
        share of the rated speed, lowest and highest operating speed in rpm.

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
        temperature=temperature,
        tune=tune,
        tolerance=tolerance,
        scenarios=scenarios,
        sequences=sequences,
        rules=rules,
        tachometer_tolerance=tachometer_tolerance,
        operating_rpm=operating_rpm,
        source=source,
    )


def checked(
    elements: Iterable[Any],
    name: str,
    reference: Any,
    cycle: Any,
    rated_rpm: Any,
    *,
    temperature: Any = None,
    tune: Mapping[str, Any] | None,
    tolerance: Mapping[str, Any] | None,
    report: Mapping[str, str] | None = None,
    scenarios: Any,
    sequences: Any = None,
    rules: Sequence[str | File] = DEFAULT,
    tachometer_tolerance: Any = TACHOMETER,
    operating_rpm: Any = (),
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
    elements = [_at_temperature(element, temperature) for element in elements]
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
    try:
        chosen = choose(rules)
    except SceneError as error:
        errors += [f"{source}, [scene]: rules: {text}" for text in error.sentences]
        chosen = Chosen()
    errors += checks.shaft_rule_errors(parts, chosen)
    errors += checks.operating_errors(source, operating_rpm, chosen.names)
    numbers = {
        "revolutions_per_cycle": cycle,
        "rated_rpm": rated_rpm,
        "tachometer_tolerance": tachometer_tolerance,
        "temperature": temperature,
    }
    head_errors = []
    where = f"{source}, [scene]"
    for field in dataclasses.fields(Head):
        if field.name in numbers:
            value = numbers[field.name]
            head_errors += field_errors(where, field, value) or []
    errors += head_errors
    errors += checks.reference_errors(parts, reference, disks_read=disks_read)
    errors += checks.archer_errors(parts)
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
    _expand_blades(parts)
    rotors, ratio, locked = _gearing(parts, root, radii)
    errors += consistency.loop_errors(parts, locked)
    if not head_errors:
        errors += consistency.cycle_errors(parts, _harmonic_needs(parts, ratio), cycle)
    errors += consistency.hold_errors(parts, main_disk)
    errors += consistency.balance_errors(parts, ratio) if not locked else []
    errors += consistency.phase_errors(parts, ratio)
    errors += event_errors(parts)
    errors += checks.rated_errors(parts, rated_rpm)
    scenarios, scenario_errors = checks.read_scenarios(parts, scenarios)
    errors += scenario_errors
    sequences, sequence_errors = read_sequences(parts, sequences)
    errors += sequence_errors
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
        "sequences": sequences,
        "tune": tune or {},
        "tolerance": tolerance or {},
        "report": report or {},
    }
    head: dict[str, Any] = {
        key: json.dumps(table, default=str) for key, table in settings.items()
    }
    head |= {
        "name": name,
        "rated_rpm": None if rated_rpm is None else float(rated_rpm),
        "notes": notes,
        "rules": chosen,
        "tachometer_tolerance": float(tachometer_tolerance),
        "operating_rpm": tuple(map(float, operating_rpm)),
    }
    # Only now: nothing follows from keys with an error.
    for table in ("disk", *derived.LINKS):
        parts.tables[table] = [derived.completed(link) for link in parts.tables[table]]
    topology = _topology(parts, rotors, main_disk, float(cycle), ratio, head)
    train = DriveTrain(topology=topology, **tables.of_elements(parts.tables))
    texts = limits.limit_errors(train)
    if texts:
        raise SceneError(f"{source}, {text}" for text in texts)
    return contact_law.with_contact_law(train, parts.tables["mesh"])


def _expand_blades(parts: checks.Parts) -> None:
    """Put harmonics in the place of the blades of sound loads and torques."""
    for table in ("load", "torque"):
        elements = parts.tables[table]
        for i, element in enumerate(elements):
            fields = [field.name for field in dataclasses.fields(element)]
            if parts.usable(table, i, *fields):
                elements[i] = with_blades(element)


def _at_temperature(element: Any, temperature: Any) -> Any:
    """An element with numbers over the temperature at its own, or that of the air
    around it, or that of the scene.
    """
    if not isinstance(element, Shaft | Damper) or element.temperature is not None:
        return element
    if element.ambient is not None:
        temperature = element.ambient
    if temperature is None or not element.over_temperature:
        return element
    return dataclasses.replace(element, temperature=temperature)


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

    def need(table: str, i: int, key: str, factor: float | None, of: str = "") -> None:
        """Note the orders of rows, which turn ``factor`` times a revolution."""
        if factor is not None:
            needs.extend(
                (table, i, f"order {order:g}{of}", order * factor, "")
                for order in sound_orders(getattr(parts.tables[table][i], key))
            )

    for table, kind in EXCITATIONS.items():
        seat = dict(parts.seats(table))
        for i, element in enumerate(parts.tables[table]):
            own_ratio = ratio[seat[i]] if i in seat else None
            usable = partial(parts.usable, table, i)
            needs += [
                (table, i, *need) for need in kind.needs(element, own_ratio, usable)
            ]
    for i, ends in parts.links("mesh"):
        periods = _mesh_periods(parts, ends, ratio)
        turns_per_order = [(name, periods) for name in OF_PERIOD]
        turns_per_order += zip(OF_GEARS, (ratio[disk] for disk in ends), strict=True)
        for name, turns in turns_per_order:
            need("mesh", i, name, turns, f" of {name}")
    for i, disk in parts.seats("load"):
        need("load", i, "harmonics", ratio[disk])
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
    seated = ("damper", "ground", "load")
    seats = {table: tuple(parts.sits_on(table)) for table in (*seated, *EXCITATIONS)}
    fields: dict[str, Any] = {
        f"{table}_names": tuple(names)
        for table, names in parts.names.items()
        if table not in ("disk", "event", *EXCITATIONS)
    }
    fields |= {f"{table}_disk": seats[table] for table in seated}
    fields |= settings
    phased = [parts.phased(i) for i in range(len(elements["phase"]))]
    phased_disks = [
        [seats[table][i] for table in reversed(members) for i in members[table]]
        for members in phased
    ]
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
        fields[f"mesh_{name}"] = harmonics_of(rows, per_order)
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
        shaft_rules=tuple(shaft.rule or "" for shaft in elements["shaft"]),
        shaft_curves=tuple(
            (_curve(shaft.sn_curve), shaft.sn_source or "")
            for shaft in elements["shaft"]
        ),
        mesh_ends=mesh_ends,
        mesh_periods=tuple(periods),
        mesh_internal=tuple(mesh.kind == "internal" for mesh in meshes),
        mesh_backlash=tuple(mesh.backlash is not None for mesh in meshes),
        mesh_damping_law=tuple(mesh.damping_law for mesh in meshes),
        load_harmonics=harmonics_of(
            [load.harmonics for load in elements["load"]],
            [ratio[disk] * cycle for disk in seats["load"]],
        ),
        load_law=tuple(
            load.law or ("over_rpm" if load.over_rpm else "")
            for load in elements["load"]
        ),
        load_points=tuple(len(load.over_rpm) for load in elements["load"]),
        archer_loads=tuple(
            i for i, load in enumerate(elements["load"]) if load.archer is not None
        ),
        events=tuple(_event_seats(parts)),
        excitations=tuple(
            kind.seats(
                elements[table],
                parts.names[table],
                seats[table],
                [ratio[disk] for disk in seats[table]],
                cycle,
            )
            for table, kind in EXCITATIONS.items()
        ),
        phase_members=tuple(
            tuple(tuple(members[table]) for table in EXCITATIONS) for members in phased
        ),
        # They turn alike.
        phase_turn=tuple(rounded(ratio[disks[0]] * cycle) for disks in phased_disks),
        link_keys=derived.present_keys(
            [link for table in derived.LINKS for link in elements[table]]
        ),
        disk_keys=derived.present_keys(elements["disk"], derived.LIMITS_OF_DISKS),
        hz_links=tuple(i for i, link in enumerate(links) if link.over_hz),
        amplitude_links=tuple(i for i, link in enumerate(links) if link.over_amplitude),
        order_links=tuple(
            i
            for i, link in enumerate(links)
            if getattr(link, "order", None) is not None
        ),
        rpm_tables=tuple(
            (table, field, i, count)
            for table, members in elements.items()
            for field in ("damping", "stiffness")
            for i, element in enumerate(members)
            if (count := len(getattr(element, f"{field}_over_rpm", "")))
        ),
        springs=tuple(
            spring for i, link in enumerate(links) for spring in _springs(i, link)
        ),
        **fields,
    )


def _curve(rows: Sequence[Sequence[float]]) -> tuple[tuple[float, float], ...]:
    """Rows of a S-N curve as a topology holds them."""
    return tuple((float(cycles), float(stress)) for cycles, stress in rows)


def _event_seats(parts: checks.Parts) -> Iterator[EventSeat]:
    """Fixed parts of the events of a sound scene."""
    for event in parts.tables["event"]:
        pair = event.between
        shaft = "" if pair is None else parts.names["shaft"][shaft_of(parts, pair)]
        yield seat_of(event, parts.disk(event.disk), shaft)


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
