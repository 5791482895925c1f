"""Parts of the page that tell what was computed: the train and its data, assumptions, versions."""

import io
import re

import numpy as np

from jaxhb.report.figures.sketch import plot_train
from jaxhb.report.page.excitation import excitation_tables, gas_words, torque_over_speed
from jaxhb.report.page.parts import Picture
from jaxhb.report.text.columns import NONE, Table, plain_number
from jaxhb.report.text.mean_torques import mean_angles_of
from jaxhb.report.text.scene_check import referred_tables

ASSUMPTIONS = (
    "Torsional vibration about a constant mean speed: disks are rigid, each has one angle; shafts, dampers and teeth"
    " are springs with damping. Bending, bearings and housing are not modelled.",
    "Every number of the scene is taken as exact: tolerances and wear are not covered.",
)
TEETH = (
    "Teeth are one spring along the pitch circle with a stiffness that does not change as the gears turn: contact"
    " ratio and errors of the profile are left out. With backlash there is a soft spring in the gap and a smooth"
    " transition to contact, as the table of meshes gives them.",
    "Tooth forces are transmitted forces, elastic and damping part together; the torque of a gear is that which it"
    " passes to its mates.",
    "'Without backlash' is the same train with all teeth in contact, a linear calculation.",
)
STEADY = (
    "Every speed is answered by what the train does after it has run long enough, started from teeth in contact; from"
    " another start another motion may be reached. Of motions that never repeat the numbers are extremes over the"
    " recorded cycles."
)
MISFIRE = (
    "A cylinder that does not fire has no gas torque at all: combustion and compression are both absent. Its"
    " inertia torque remains."
)
COMPRESSING = (
    'Compression without combustion is another calculation: --set "{name}.combustion.{by}=0" keeps the compression of'
    " this cylinder."
)
COMPRESSED = (
    "Compression without combustion is another calculation: give the cylinder the gas torque or pressure of a motored"
    " one, or a combustion model, whose heat or imep can be set to 0."
)
LINEAR = "No mesh has backlash: the train is linear, and every speed is answered by its one periodic motion."
ORBIT = "Every speed is answered by a periodic solution, whether or not the train runs in it (--orbit)."


def train_part(report):
    """Sketch, numbers as they are and referred, meshes, what excites and what loads the train."""
    train = report.train
    tables = [*referred_tables(train), _meshes(train), _cylinders(train), _torques(report), _loads(train)]
    return [*_sketch(train), *(table for table in tables if table), *excitation_tables(report)]


def _sketch(train):
    """A drawing in a list, a sentence where the train cannot be drawn."""
    try:
        figure = plot_train(train)
    except ValueError as refusal:
        return [f"No sketch: {refusal}"]
    content = io.StringIO()
    # The page has a date of its own.
    figure.savefig(content, format="svg", metadata={"Date": None})
    # Inside HTML an SVG has no XML head.
    svg = re.sub(r"\A.*?(?=<svg)", "", content.getvalue(), flags=re.DOTALL)
    return [Picture("Sketch of the train: rotors as lines of disks, gears in mesh as pitch circles that touch", svg)]


def _rows(title, heads, rows, left=()):
    return Table(title, heads, list(zip(*rows, strict=True)), left=left) if rows else None


def _number(value, factor=1.0):
    return plain_number(factor * float(value), digits=6)


def _meshes(train):
    topology, meshes, rows = train.topology, train.meshes, []
    for i, (name, (a, b)) in enumerate(zip(topology.mesh_names, topology.mesh_ends, strict=True)):
        radii = " : ".join(_number(train.disks.radius[disk], 1e3) for disk in (a, b))
        teeth = " : ".join(str(topology.teeth[disk]) for disk in (a, b))
        gap = [NONE] * 3
        if topology.mesh_backlash[i]:
            values = (meshes.backlash[i], 1e3), (meshes.epsilon[i], 1.0), (meshes.transition[i], 1.0)
            gap = [_number(value, factor) for value, factor in values]
        kind = "internal" if topology.mesh_internal[i] else "external"
        teeth = teeth if topology.teeth[a] and topology.teeth[b] else NONE
        rows.append([name, kind, radii, teeth, *gap, topology.mesh_damping_law[i]])
    heads = ["mesh", "kind", "radii mm", "teeth", "backlash mm", "epsilon", "transition", "damping law"]
    title = "Meshes: epsilon is the stiffness in the gap over that in contact, transition its width over the backlash"
    return _rows(title, heads, rows, left=(1,))


def _cylinders(train):
    topology, cylinders, rows = train.topology, train.cylinders, []
    moving = np.asarray(cylinders.stroke) > 0  # else the rod is one that stands in for none
    lengths = [(length, 1e3) for length in (cylinders.bore, cylinders.stroke, np.where(moving, cylinders.rod, 0.0))]
    lengths.append((cylinders.reciprocating_mass, 1.0))
    for i, name in enumerate(topology.cylinder_names):
        disk = topology.disk_names[topology.cylinder_disk[i]]
        own = [_number(values[i], factor) if values[i] else NONE for values, factor in lengths]
        fires = "yes" if topology.cylinder_fires[i] else "no"
        source = gas_words(topology, i)
        rows.append([name, disk, _number(cylinders.firing_angle[i]), fires, source, *own])
    heads = ["cylinder", "disk", "firing angle deg", "fires", "gas torque from", "bore mm", "stroke mm", "rod mm"]
    return _rows("Cylinders", [*heads, "recip. mass kg"], rows, left=(1, 4))


def _torques(report):
    train, files, rows = report.train, (report.files or {}).get("torque"), []
    topology = train.topology
    for i, name in enumerate(topology.torque_names):
        disk = topology.disk_names[topology.torque_disk[i]]
        count = len(topology.torque_harmonics[i])
        own = "own" if topology.torque_own[i] else "reference"
        rows.append([name, disk, _number(train.torques.mean[i]), count, own, torque_over_speed(train, i, files)])
    heads = ["torque", "disk", "mean N m", "orders", "orders of", "factor over the speed"]
    return _rows("Torques given by their orders, before the factor over the speed", heads, rows, left=(1, 4, 5))


def _loads(train):
    topology = train.topology
    disks = topology.disk_names
    loads = zip(topology.load_names, topology.load_disk, np.asarray(train.loads.share), strict=True)
    grounds = zip(topology.ground_names, topology.ground_disk, np.asarray(train.grounds.stiffness), strict=True)
    rows = [[name, disks[disk], "load", f"share {_number(share)}"] for name, disk, share in loads]
    rows += [[name, disks[disk], "ground", f"{_number(stiffness)} N m/rad"] for name, disk, stiffness in grounds]
    return _rows("Loads, which balance the mean power, and grounds", ["element", "disk", "kind", ""], rows, (1, 2))


def assumptions_part(report):
    """What holds for every number of the page, and what made it."""
    train, answer = report.train, report.cases[0].answers[0]
    said = [*ASSUMPTIONS, *(TEETH if train.topology.mesh_names else ())]
    linear = not any(train.topology.mesh_backlash)
    said.append(LINEAR if linear else ORBIT if answer.orbit else STEADY)
    said += _misfiring(train) if train.topology.cylinder_names else []
    turns = train.topology.revolutions_per_cycle
    said.append(
        f"The excitation repeats after {turns:g} revolution{'s' * (turns != 1)} of the reference rotor. Speeds are"
        f" those of the reference rotor; mean angles: {mean_angles_of(train.topology)}."
    )
    facts = list((report.facts or {}).items())
    return [*said, *filter(None, [_rows("Where this page comes from", ["", ""], facts, left=(1,))])]


def _misfiring(train):
    """What a misfire is, and how to have one that compresses."""
    burning = train.cylinders.combustion
    if burning is None:
        return [f"{MISFIRE} {COMPRESSED}"]
    name = train.topology.cylinder_names[burning.seats[0]]
    return [f"{MISFIRE} {COMPRESSING.format(name=name, by='imep' if burning.by_work[0] else 'heat')}"]
