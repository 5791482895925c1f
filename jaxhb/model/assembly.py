"""From checked elements to topology and tables of a drive train; all errors of a scene are raised at once."""

from __future__ import annotations

import dataclasses
import json
import math

from jaxhb.model import checks, graph, tables, train_checks
from jaxhb.model.elements import SceneError
from jaxhb.model.topology import Topology


def assemble(elements, *, name, reference, revolutions_per_cycle, tune, source, findings=()) -> dict:
    """Check the elements and make the fields of a drive train; ``findings`` are sentences found before."""
    parts = checks.Parts(elements, source)
    cycle = revolutions_per_cycle
    errors = [*findings, *checks.element_errors(parts), *checks.name_errors(parts)]
    errors += _cycle_value_errors(source, cycle)
    references = checks.reference_errors(parts, reference)
    if references or _unnamed(parts):
        raise SceneError([*errors, *references])
    errors += train_checks.connection_errors(parts)
    rotor = graph.pieces(len(parts.disk_names), train_checks.elastic_pairs(parts))
    errors += train_checks.reference_error(parts, reference, rotor)
    errors += train_checks.gear_errors(parts, rotor) if _numeric(parts) else []
    if errors:
        raise SceneError(errors)
    errors += train_checks.inertia_errors(parts)
    reference_disk = parts.disk(reference) if reference is not None else 0
    parts = _with_exact_radii(parts)
    rotors, locked = _rotors(parts, reference_disk)
    errors += train_checks.loop_errors(parts, locked)
    ratio = [rotors.ratio[k] for k in rotors.rotor]
    needs = _harmonic_needs(parts, ratio)
    errors += train_checks.cycle_errors(parts, needs, cycle)
    errors += train_checks.hold_errors(parts, reference_disk)
    errors += train_checks.balance_errors(parts, ratio)
    if errors:
        raise SceneError(errors)
    topology = _topology(parts, rotors, reference_disk, name=name, cycle=float(cycle), tune=tune, ratio=ratio)
    return {"topology": topology} | _tables(parts)


def _numeric(parts) -> bool:
    """Tell whether radii and teeth can be computed with."""
    return all(
        value is None or checks.number_like(value) for d in parts.tables["disk"] for value in (d.radius, d.teeth)
    )


def _unnamed(parts) -> bool:
    """Tell whether names or ends are missing or stand twice, so that connections cannot be followed."""
    names = parts.disk_names
    pairs = [e.between for table in checks.LINKS for e in parts.tables[table]]
    seats = [e.disk for t in ("damper", "ground", "load", "torque", "cylinder") for e in parts.tables[t]]
    bad_pair = any(not (isinstance(p, tuple | list) and len(p) == 2) for p in pairs)
    if bad_pair or not all(isinstance(n, str) for n in [*names, *seats, *(end for p in pairs for end in p)]):
        return True
    return len(set(names)) < len(names)


def _cycle_value_errors(source, cycle) -> list[str]:
    """Check revolutions_per_cycle."""
    if checks.number_like(cycle) and math.isfinite(float(cycle)) and float(cycle) > 0.0:
        return []
    return [f"{source}, [scene]: revolutions_per_cycle is {cycle!r}, must be a number greater than 0. Correct it."]


def _with_exact_radii(parts):
    """Replace radii by those that the numbers of teeth make exact."""
    disks = parts.tables["disk"]
    teeth = [int(d.teeth or 0) for d in disks]
    exact = graph.exact_radii([d.radius for d in disks], teeth, parts.ends("mesh"))
    parts.tables["disk"] = [dataclasses.replace(d, radius=r) for d, r in zip(disks, exact, strict=True)]
    return parts


def _rotors(parts, reference_disk):
    """Find rotors, ratios and locked loops."""
    return graph.find_rotors(
        len(parts.disk_names),
        train_checks.elastic_pairs(parts),
        parts.ends("mesh"),
        [m.kind == "internal" for m in parts.tables["mesh"]],
        [d.radius for d in parts.tables["disk"]],
        reference_disk,
    )


def _harmonic_needs(parts, ratio) -> list[tuple]:
    """Harmonics per revolution of the reference rotor, whole over the cycle: (table, i, text, value)."""
    needs = []
    for i, (disk, torque) in enumerate(zip(parts.sits_on("torque"), parts.tables["torque"], strict=True)):
        factor = ratio[disk] if torque.orders_of == "own" else 1.0
        needs += [("torque", i, f"order {row[0]:g}", row[0] * factor) for row in torque.harmonics]
    for i, (disk, cylinder) in enumerate(zip(parts.sits_on("cylinder"), parts.tables["cylinder"], strict=True)):
        needs += [("cylinder", i, f"order {row[0]:g}", row[0] * ratio[disk]) for row in cylinder.gas_torque or ()]
        if cylinder.pressure is not None:
            turns = 2 if tables.is_four_stroke(cylinder.pressure) else 1
            text = f"one gas cycle of {turns} revolution{'s' if turns > 1 else ''}"
            needs.append(("cylinder", i, text, ratio[disk] / turns))
        if cylinder.stroke is not None and cylinder.reciprocating_mass > 0:
            needs.append(("cylinder", i, "order 1 of the reciprocating mass", ratio[disk]))
    return needs


def _topology(parts, rotors, reference_disk, *, name, cycle, tune, ratio) -> Topology:
    """Collect the static half of the train."""
    t, names = parts.tables, {table: tuple(n) for table, n in parts.names.items()}
    seats = {k: tuple(parts.sits_on(k)) for k in ("damper", "ground", "load", "torque")}
    own = [ratio[d] if e.orders_of == "own" else 1.0 for d, e in zip(seats["torque"], t["torque"], strict=True)]
    return Topology(
        name=name,
        revolutions_per_cycle=cycle,
        disk_names=tuple(parts.disk_names),
        n_scene_disks=len(t["disk"]),
        teeth=tuple(int(d.teeth or 0) for d in t["disk"]),
        rotor=rotors.rotor,
        n_rotors=len(rotors.ratio),
        reference_rotor=rotors.rotor[reference_disk],
        rotor_path=rotors.path,
        shaft_names=names["shaft"],
        shaft_ends=tuple(parts.ends("shaft")),
        mesh_names=names["mesh"],
        mesh_ends=tuple(parts.ends("mesh")),
        mesh_internal=tuple(m.kind == "internal" for m in t["mesh"]),
        mesh_backlash=tuple(m.backlash is not None for m in t["mesh"]),
        mesh_damping_law=tuple(m.damping_law for m in t["mesh"]),
        damper_names=names["damper"],
        damper_disk=seats["damper"],
        ground_names=names["ground"],
        ground_disk=seats["ground"],
        load_names=names["load"],
        load_disk=seats["load"],
        torque_names=names["torque"],
        torque_disk=seats["torque"],
        torque_own=tuple(e.orders_of == "own" for e in t["torque"]),
        torque_harmonics=tuple(
            tuple(round(row[0] * f * cycle) for row in e.harmonics) for e, f in zip(t["torque"], own, strict=True)
        ),
        tune=json.dumps(tune or {}, default=str),
        **_cylinder_topology(parts, ratio, cycle),
    )


def _cylinder_topology(parts, ratio, cycle) -> dict:
    """Collect the static fields of the cylinders."""
    cylinders, disks = parts.tables["cylinder"], parts.sits_on("cylinder")
    turn = [ratio[d] * cycle for d in disks]
    turn = [float(round(v)) if train_checks.whole(v) else v for v in turn]
    turns = [2 if c.pressure and tables.is_four_stroke(c.pressure) else 1 for c in cylinders]
    given = [c.gas_torque is not None or c.gas_torque_mean is not None for c in cylinders]
    source = ["pressure" if c.pressure else "harmonics" if g else "none" for c, g in zip(cylinders, given, strict=True)]
    return {
        "cylinder_names": tuple(parts.names["cylinder"]),
        "cylinder_disk": tuple(disks),
        "cylinder_source": tuple(source),
        "cylinder_harmonics": tuple(
            tuple(round(row[0] * v) for row in c.gas_torque or ()) for c, v in zip(cylinders, turn, strict=True)
        ),
        "cylinder_step": tuple(
            round(v / k) if c.pressure else 0 for c, v, k in zip(cylinders, turn, turns, strict=True)
        ),
        "cylinder_turn": tuple(turn),
        "cylinder_gas_revolutions": tuple(turns),
        "cylinder_gas": tuple(
            math.floor(c.orders * k + 1e-9) if c.pressure else 0 for c, k in zip(cylinders, turns, strict=True)
        ),
        "cylinder_inertia": tuple(
            math.floor(c.orders + 1e-9) if c.stroke is not None and train_checks.whole(v) else 0
            for c, v in zip(cylinders, turn, strict=True)
        ),
        "cylinder_series": tuple(c.kinematics == "mendes2008" for c in cylinders),
        "cylinder_fires": tuple(c.fires for c in cylinders),
    }


def _tables(parts) -> dict:
    """Collect the numbers."""
    t, column = parts.tables, tables.column

    def plain(cls, table):
        return cls(**{f.name: column(t[table], f.name) for f in dataclasses.fields(cls)})

    return {
        "disks": plain(tables.Disks, "disk"),
        "shafts": plain(tables.Shafts, "shaft"),
        "meshes": tables.mesh_table(t["mesh"]),
        "dampers": plain(tables.Dampers, "damper"),
        "grounds": plain(tables.Grounds, "ground"),
        "loads": plain(tables.Loads, "load"),
        "torques": tables.torque_table(t["torque"]),
        "cylinders": tables.cylinder_table(t["cylinder"]),
    }
