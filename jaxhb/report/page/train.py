"""Parts of the page that tell what was computed: the train and its data, assumptions, versions."""

import io
import re

import numpy as np

from jaxhb.report.figures.sketch import plot_train
from jaxhb.report.page.excitation import excitation_tables, gas_words, torque_over_speed
from jaxhb.report.page.parts import table
from jaxhb.report.text.columns import NONE, Table, plain_number
from jaxhb.report.text.mean_torques import mean_angles_of
from jaxhb.report.text.scene_check import referred_tables


def train_data(report):
    """Sketch, numbers as they are and referred, meshes, what excites and what loads the train."""
    train, sketch, refusal = report.train, "", ""
    try:
        content = io.StringIO()
        # The page has a date of its own.
        plot_train(train).savefig(content, format="svg", metadata={"Date": None})
        # Inside HTML an SVG has no XML head.
        sketch = re.sub(r"\A.*?(?=<svg)", "", content.getvalue(), flags=re.DOTALL)
    except ValueError as error:
        refusal = str(error)
    tables = [*referred_tables(train), _meshes(train), _cylinders(train), _torques(report), _loads(train)]
    return {"sketch": sketch, "refusal": refusal, "tables": [*filter(None, tables), *excitation_tables(report)]}


def _meshes(train):
    topology, meshes, radius = train.topology, train.meshes, train.disks.radius
    gaps = np.where(topology.mesh_backlash, [meshes.backlash, meshes.epsilon, meshes.transition], np.nan)

    def teeth(i):
        both = [topology.teeth[disk] for disk in topology.mesh_ends[i]]
        return " : ".join(map(str, both)) if all(both) else NONE

    columns = {
        "mesh": lambda i: topology.mesh_names[i],
        "kind": lambda i: "internal" if topology.mesh_internal[i] else "external",
        "radii mm": lambda i: " : ".join(_number(1e3 * radius[disk]) for disk in topology.mesh_ends[i]),
        "teeth": teeth,
        "backlash mm": lambda i: 1e3 * gaps[0, i],
        "epsilon": lambda i: gaps[1, i],
        "transition": lambda i: gaps[2, i],
        "damping law": lambda i: topology.mesh_damping_law[i],
    }
    title = "Meshes: epsilon is the stiffness in the gap over that in contact, transition its width over the backlash"
    return table(title, range(len(topology.mesh_names)), columns)


def _number(value):
    return plain_number(float(value), digits=6)


def _cylinders(train):
    topology, cylinders = train.topology, train.cylinders
    columns = {
        "cylinder": lambda i: topology.cylinder_names[i],
        "disk": lambda i: topology.disk_names[topology.cylinder_disk[i]],
        "firing angle deg": lambda i: cylinders.firing_angle[i],
        "fires": lambda i: "yes" if topology.cylinder_fires[i] else "no",
        "gas torque from": lambda i: gas_words(topology, i),
        "bore mm": lambda i: 1e3 * cylinders.bore[i] or np.nan,
        "stroke mm": lambda i: 1e3 * cylinders.stroke[i] or np.nan,
        # Without a stroke the rod is one that stands in for none.
        "rod mm": lambda i: (1e3 * cylinders.rod[i] if cylinders.stroke[i] > 0 else 0.0) or np.nan,
        "recip. mass kg": lambda i: cylinders.reciprocating_mass[i] or np.nan,
    }
    return table("Cylinders", range(len(topology.cylinder_names)), columns)


def _torques(report):
    topology, torques = report.train.topology, report.train.torques
    columns = {
        "torque": lambda i: topology.torque_names[i],
        "disk": lambda i: topology.disk_names[topology.torque_disk[i]],
        "mean N m": lambda i: torques.mean[i],
        "orders": lambda i: len(topology.torque_harmonics[i]),
        "orders of": lambda i: "own" if topology.torque_own[i] else "reference",
        "factor over the speed": lambda i: torque_over_speed(report.train, i, report.files.get("torque")),
    }
    title = "Torques given by their orders, before the factor over the speed"
    return table(title, range(len(topology.torque_names)), columns)


def _loads(train):
    topology, rows = train.topology, []
    for name, disk, share in zip(topology.load_names, topology.load_disk, train.loads.share, strict=True):
        rows.append((name, topology.disk_names[disk], "load", f"share {_number(share)}"))
    for name, disk, stiff in zip(topology.ground_names, topology.ground_disk, train.grounds.stiffness, strict=True):
        rows.append((name, topology.disk_names[disk], "ground", f"{_number(stiff)} N m/rad"))
    return table("Loads, which balance the mean power, and grounds", rows, ["element", "disk", "kind", ""])


def assumptions(report):
    """What holds for every number of the page, and what made it."""
    topology, burning = report.train.topology, report.train.cylinders.combustion
    burnt = ""  # the number of a scene without which a cylinder compresses and does not burn
    if burning is not None:
        name = topology.cylinder_names[burning.seats[0]]
        burnt = f"{name}.combustion.{'imep' if burning.by_work[0] else 'heat'}"
    source = Table("Where this page comes from", ["", ""], list(zip(*report.facts.items(), strict=True)))
    return {
        "topology": topology,
        "orbit": report.cases[0].answers[0].orbit,
        "burnt": burnt,
        "mean_angles": mean_angles_of(topology),
        "source": source,
    }
