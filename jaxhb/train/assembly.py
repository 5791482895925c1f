"""From checked elements to topology and tables of a drive train; all errors of a scene
are raised at once.
"""

import dataclasses
import json
import math
from collections.abc import Iterable
from typing import Any

from jaxhb.elements import checks, derived, meshing, value_checks
from jaxhb.elements.elements import Head, Mesh, SceneError
from jaxhb.equations.kinematics import OF_GEARS, OF_PERIOD
from jaxhb.excitation import gas
from jaxhb.train import connections, contact_law, tables, train_checks
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.topology import Topology

ORDERS, ORDERS_OF_TWO_STROKES = (
    12.0,
    15.0,
)  # largest that are kept of computed torques, where a scene says nothing


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
    beside = {
        "tune": tune,
        "tolerance": tolerance,
        "scenarios": scenarios,
        "source": source,
    }
    return checked(
        elements, name, reference, revolutions_per_cycle, rated_rpm, **beside
    )


def checked(
    elements,
    name,
    reference,
    cycle,
    rated_rpm,
    *,
    tune,
    tolerance,
    scenarios,
    source,
    notes=(),
    findings=(),
    complete=True,
    disks_read=True,
) -> DriveTrain:
    """As :func:`build`, with sentences found before; ``complete`` is False where tables
    of the scene were not read, and ``disks_read`` where disks or rings may be among
    them.

    Every check runs on what is sound, and all sentences are raised together.
    """
    parts = checks.Parts(elements, source, complete=complete)
    errors = [
        *findings,
        *parts.engine_errors,
        *checks.element_errors(parts),
        *checks.name_errors(parts),
    ]
    if too_large := value_checks.size_errors(parts):
        raise SceneError(dict.fromkeys([*errors, *too_large]))
    numbers = {"revolutions_per_cycle": cycle, "rated_rpm": rated_rpm}
    told = [
        (f, numbers.get(f.name)) for f in dataclasses.fields(Head) if f.name in numbers
    ]
    head_errors = [
        text
        for f, value in told
        for text in value_checks.field_errors(f"{source}, [scene]", f, value) or ()
    ]
    errors += head_errors + checks.reference_errors(
        parts, reference, disks_read=disks_read
    )
    errors += train_checks.connection_errors(parts)
    rotor = connections.pieces(len(parts.disk_names), train_checks.elastic_pairs(parts))
    errors += train_checks.reference_error(parts, reference, rotor)
    errors += train_checks.gear_errors(parts, rotor)
    errors += train_checks.inertia_errors(parts)
    main = 0 if reference is None and parts.disk_names else parts.disk(reference)
    # Without a reference the first disk stands for it if there is one rotor; else
    # speeds would be guessed.
    known = reference is not None or (parts.connected and max(rotor, default=0) == 0)
    radii = _exact_radii(parts)
    _expand_meshes(parts)
    rotors, ratio, locked = _gearing(parts, main if known else None, radii)
    errors += train_checks.loop_errors(parts, locked)
    if not head_errors:
        errors += train_checks.cycle_errors(parts, _harmonic_needs(parts, ratio), cycle)
    errors += train_checks.hold_errors(parts, main)
    errors += train_checks.balance_errors(parts, ratio) if not locked else []
    errors += train_checks.phase_errors(parts, ratio)
    errors += value_checks.rated_errors(parts, rated_rpm)
    scenarios, unknown = checks.read_scenarios(parts, scenarios)
    errors += unknown
    if errors:
        raise SceneError(
            dict.fromkeys(errors)
        )  # what cylinders of one engine share is said once
    disks = parts.tables["disk"]
    parts.tables["disk"] = [
        dataclasses.replace(d, radius=r) for d, r in zip(disks, radii, strict=False)
    ]
    # As text: a topology is hashed, and dictionaries are not.
    beside = {"scenarios": scenarios, "tune": tune or {}, "tolerance": tolerance or {}}
    head: dict[str, Any] = {
        key: json.dumps(table, default=str) for key, table in beside.items()
    }
    head |= {
        "name": name,
        "rated_rpm": None if rated_rpm is None else float(rated_rpm),
        "notes": notes,
    }
    topology = _topology(parts, rotors, main, float(cycle), ratio, head)
    # Only now: nothing follows from keys that a sentence was said about.
    for table in derived.LINKS:
        parts.tables[table] = [derived.completed(link) for link in parts.tables[table]]
    train = DriveTrain(topology=topology, **tables.of_elements(parts.tables))
    return contact_law.with_contact_law(train, parts.tables["mesh"])


def _expand_meshes(parts):
    """Put stiffness and orders in the place of the shorthands of sound meshes."""
    fields = [f.name for f in dataclasses.fields(Mesh)]
    disks = parts.tables["disk"]
    for i, ends in parts.links("mesh"):
        if not parts.usable("mesh", i, *fields) or any(d >= len(disks) for d in ends):
            continue
        mesh = parts.tables["mesh"][i]
        gears = [disks[d] for d in ends]
        known = all(
            parts.usable("disk", d, "radius", "teeth") and disks[d].radius for d in ends
        )
        if known and (mesh.width is None or all(gear.teeth for gear in gears)):
            parts.tables["mesh"][i] = meshing.expanded(mesh, gears)


def _exact_radii(parts) -> list:
    """Radii that the numbers of teeth make exact, None where absent, for disks and
    rings.
    """
    radius = [None] * len(parts.disk_names)
    teeth = [0] * len(parts.disk_names)
    for i, disk in enumerate(parts.tables["disk"]):
        if parts.usable("disk", i, "radius", "teeth") and disk.radius is not None:
            radius[i], teeth[i] = disk.radius, int(disk.teeth or 0)
    return connections.exact_radii(radius, teeth, parts.ends("mesh"))


def _gearing(parts, root: int | None, radii):
    """Find the rotors seen from disk ``root``, the speed ratio of each disk (None:
    unknown) and locked loops.
    """
    n = len(parts.disk_names)
    pairs = train_checks.elastic_pairs(parts)
    meshes = parts.links("mesh")
    ends = [pair for _, pair in meshes]
    internal = [parts.tables["mesh"][i].kind == "internal" for i, _ in meshes]
    numbers = [math.nan if r is None else r for r in radii]
    # Piece by piece: a locked loop is told wherever it lies.
    joined = connections.pieces(n, pairs + ends)
    starts = {joined[d]: d for d in reversed(range(n))}
    if root is not None:
        starts[joined[root]] = root
    kinds = all(parts.usable("mesh", i, "kind") for i, _ in meshes)
    gearing = connections.Gearing(n, pairs, ends, internal, numbers)
    geared = {gearing.rotor[d] for pair in ends for d in pair}
    rotors = None
    for start in starts.values():
        if start == root:
            rotors = gearing.rotors(gearing.lead(start))
        elif gearing.rotor[start] in geared:
            gearing.lead(start)
    # A kind that cannot be read leaves senses unknown, but not ratios.
    locked = [
        (meshes[m][0], disks, why)
        for m, disks, why in gearing.locked
        if kinds or "senses" not in why
    ]
    # Without meshes all disks turn alike, whatever the reference is.
    if parts.complete and not parts.tables["mesh"]:
        return rotors, [1.0] * n, locked
    if rotors is None or root is None:
        return rotors, [None] * n, locked
    reached = [
        k == rotors.rotor[root] or bool(path) for k, path in enumerate(rotors.path)
    ]
    values = [
        r if ok and math.isfinite(r) else None
        for r, ok in zip(rotors.ratio, reached, strict=True)
    ]
    return rotors, [values[k] for k in rotors.rotor], locked


def _harmonic_needs(parts, ratio) -> list[tuple]:
    """Harmonics per revolution of the reference rotor, whole over the cycle: (table, i,
    text, value, key of mean).
    """
    needs = []

    def need(table, i, rows, factor, mean="", of=""):
        orders = _orders(rows) if factor is not None else ()
        needs.extend((table, i, f"order {o:g}{of}", o * factor, mean) for o in orders)

    seat = dict(parts.seats("torque"))
    for i, torque in enumerate(parts.tables["torque"]):
        if parts.usable("torque", i, "orders_of"):
            factor = (
                1.0
                if torque.orders_of != "own"
                else ratio[seat[i]]
                if i in seat
                else None
            )
            need("torque", i, torque.harmonics, factor, "mean")
    for i, ends in parts.links("mesh"):
        mesh = parts.tables["mesh"][i]
        periods = _mesh_periods(parts, ends, ratio)
        per_order = dict.fromkeys(OF_PERIOD, periods) | dict(
            zip(OF_GEARS, (ratio[d] for d in ends), strict=True)
        )
        for name, factor in per_order.items():
            need("mesh", i, getattr(mesh, name), factor, of=f" of {name}")
    for i, disk in parts.seats("load"):
        need("load", i, parts.tables["load"][i].harmonics, ratio[disk])
    for i, disk in parts.seats("cylinder"):
        cylinder = parts.tables["cylinder"][i]
        factor = ratio[disk]
        need("cylinder", i, cylinder.gas_torque, factor, "gas_torque_mean")
        if factor is None:
            continue
        if gas.source(cylinder) and parts.usable("cylinder", i, *gas.COMPUTED):
            turns = gas.gas_revolutions(cylinder)
            turns *= (
                int(cylinder.fires_every)
                if parts.usable("cylinder", i, "fires_every")
                else 1
            )
            text = f"one gas cycle of {turns} revolution{'s' if turns > 1 else ''}"
            needs.append(("cylinder", i, text, factor / turns, ""))
        moving = (
            parts.usable("cylinder", i, "stroke", "reciprocating_mass")
            and cylinder.stroke is not None
        )
        if moving and cylinder.reciprocating_mass > 0:
            needs.append(
                ("cylinder", i, "order 1 of the reciprocating mass", factor, "")
            )
    return needs


def _mesh_periods(parts, ends, ratio):
    """Mesh periods per revolution of the reference rotor, from the gear that has teeth;
    None where that is unknown.
    """
    disks = parts.tables["disk"]
    gears = [
        d
        for d in ends
        if d < len(disks) and ratio[d] is not None and parts.usable("disk", d, "teeth")
    ]
    return next((disks[d].teeth * ratio[d] for d in gears if disks[d].teeth), None)


def _orders(rows) -> list[float]:
    """Orders of the sound rows of a table of harmonics."""
    rows = (
        [row for row in rows if isinstance(row, tuple | list) and row]
        if isinstance(rows, tuple | list)
        else []
    )
    found = [float(row[0]) for row in rows if value_checks.number_like(row[0])]
    return [order for order in found if math.isfinite(order) and order > 0.0]


def _topology(parts, rotors, reference_disk, cycle, ratio, head) -> Topology:
    """Collect the static half of the train; ``head`` : what the scene says of the
    whole.
    """
    t = parts.tables
    links = [*parts.tables["shaft"], *parts.tables["damper"]]
    seats = {
        table: tuple(parts.sits_on(table))
        for table in ("damper", "ground", "load", "torque", "cylinder")
    }
    own = [
        ratio[d] if e.orders_of == "own" else 1.0
        for d, e in zip(seats["torque"], t["torque"], strict=True)
    ]
    named: dict[str, Any] = {
        f"{table}_names": tuple(n)
        for table, n in parts.names.items()
        if table != "disk"
    }
    named |= {f"{table}_disk": disks for table, disks in seats.items()}
    turn = [_whole(ratio[d] * cycle) for d in seats["cylinder"]]

    def harmonics(rows, per_order):
        return tuple(
            tuple(round(row[0] * factor) for row in own)
            for own, factor in zip(rows, per_order, strict=True)
        )

    phased = [parts.phased(i) for i in range(len(t["phase"]))]
    for table in ("cylinder", "torque"):
        named[f"phase_{table}s"] = tuple(tuple(own[table]) for own in phased)
    on = [
        seats["cylinder" if own["cylinder"] else "torque"][
            [*own["cylinder"], *own["torque"]][0]
        ]
        for own in phased
    ]
    mesh_ends = tuple(parts.ends("mesh"))
    per_revolution = [_mesh_periods(parts, ends, ratio) or 0.0 for ends in mesh_ends]
    needed = [any(getattr(m, name) for name in OF_PERIOD) for m in t["mesh"]]
    periods = [
        round(p * cycle) if need else 0
        for p, need in zip(per_revolution, needed, strict=True)
    ]
    turns = [[ratio[ends[k]] * cycle for ends in mesh_ends] for k in (0, 1)]
    for field, per_order in zip(
        (*OF_PERIOD, *OF_GEARS), (periods, periods, *turns), strict=True
    ):
        named[f"mesh_{field}"] = harmonics(
            [getattr(m, field) for m in t["mesh"]], per_order
        )
    return Topology(
        revolutions_per_cycle=cycle,
        disk_names=tuple(parts.disk_names),
        n_scene_disks=len(t["disk"]),
        teeth=tuple(int(d.teeth or 0) for d in t["disk"]),
        rotor=rotors.rotor,
        n_rotors=len(rotors.ratio),
        reference_disk=reference_disk,
        reference_rotor=rotors.rotor[reference_disk],
        rotor_path=rotors.path,
        shaft_ends=tuple(parts.ends("shaft")),
        shaft_rules=tuple(shaft.rule for shaft in t["shaft"]),
        mesh_ends=mesh_ends,
        mesh_periods=tuple(periods),
        mesh_internal=tuple(m.kind == "internal" for m in t["mesh"]),
        mesh_backlash=tuple(m.backlash is not None for m in t["mesh"]),
        mesh_damping_law=tuple(m.damping_law for m in t["mesh"]),
        torque_own=tuple(e.orders_of == "own" for e in t["torque"]),
        torque_harmonics=harmonics(
            [e.harmonics for e in t["torque"]], [factor * cycle for factor in own]
        ),
        load_harmonics=harmonics(
            [e.harmonics for e in t["load"]], [ratio[d] * cycle for d in seats["load"]]
        ),
        cylinder_harmonics=harmonics([c.gas_torque or () for c in t["cylinder"]], turn),
        cylinder_turn=tuple(turn),
        phase_turn=tuple(_whole(ratio[disk] * cycle) for disk in on),
        cylinder_series=tuple(c.kinematics == "mendes2008" for c in t["cylinder"]),
        cylinder_fires=tuple(c.fires for c in t["cylinder"]),
        cylinder_cut_off=(False,) * len(t["cylinder"]),
        cylinder_every=tuple(int(c.fires_every) for c in t["cylinder"]),
        link_keys=derived.link_keys(
            [link for table in derived.LINKS for link in t[table]]
        ),
        hz_links=tuple(i for i, e in enumerate(links) if e.over_hz),
        amplitude_links=tuple(i for i, e in enumerate(links) if e.over_amplitude),
        order_links=tuple(
            i for i, e in enumerate(links) if getattr(e, "order", None) is not None
        ),
        springs=tuple(spring for i, e in enumerate(links) for spring in _springs(i, e)),
        **head,
        **named,
        **_computed_torques(t["cylinder"], turn),
    )


def _whole(number):
    """What is whole to 1e-6 is whole: ratios of radii round."""
    return float(round(number)) if train_checks.whole(number) else number


def _springs(link, element):
    """What acts beside the stiffness of a shaft or damper, as ``springs`` of the
    topology has it.
    """
    yield from (
        (link, name, 0)
        for name in ("clearance", "friction")
        if getattr(element, name) is not None
    )
    yield from (
        (link, name, row)
        for name in ("stages", "stops")
        for row in range(len(getattr(element, name)))
    )


def _computed_torques(cylinders, turn) -> dict:
    """Where the gas torque of each cylinder comes from, and how many harmonics are
    computed.
    """
    kinds = {"source": [], "step": [], "gas_revolutions": [], "gas": [], "inertia": []}
    for c, per_order in zip(cylinders, turn, strict=True):
        computed = gas.source(c)
        turns = gas.gas_revolutions(c)
        moves = None not in (c.stroke, c.rod) and train_checks.whole(per_order)
        kinds["source"].append(gas.source_word(c))
        kinds["step"].append(
            round(per_order / (turns * c.fires_every)) if computed else 0
        )
        kinds["gas_revolutions"].append(turns)
        # 1e-9 keeps a product that rounds below a whole number.
        orders = c.orders or (
            ORDERS_OF_TWO_STROKES if computed and turns == 1 else ORDERS
        )
        kinds["gas"].append(
            math.floor(orders * turns * c.fires_every + 1e-9) if computed else 0
        )
        kinds["inertia"].append(math.floor(orders + 1e-9) if moves else 0)
    return {f"cylinder_{kind}": tuple(values) for kind, values in kinds.items()}
