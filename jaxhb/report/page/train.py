"""Parts of the page that tell what was computed: the train and its data, assumptions, versions."""

import io
import re

import numpy as np

from jaxhb.report.figures.sketch import plot_train
from jaxhb.report.page.excitation import excitation_tables, gas_words, torque_over_speed
from jaxhb.report.page.parts import table
from jaxhb.report.text.columns import NONE, Table
from jaxhb.report.text.mean_torques import mean_angles_of, plain_number
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
    topology, meshes = train.topology, train.meshes
    radius = [plain_number(1e3 * float(radius), digits=6) for radius in train.disks.radius]
    teeth = [[topology.teeth[disk] for disk in ends] for ends in topology.mesh_ends]
    gaps = np.where(topology.mesh_backlash, [meshes.backlash, meshes.epsilon, meshes.transition], np.nan)
    columns = {
        "mesh": topology.mesh_names,
        "kind": ["internal" if internal else "external" for internal in topology.mesh_internal],
        "radii mm": [" : ".join(radius[disk] for disk in ends) for ends in topology.mesh_ends],
        "teeth": [" : ".join(map(str, both)) if all(both) else NONE for both in teeth],
        "backlash mm": 1e3 * gaps[0],
        "epsilon": gaps[1],
        "transition": gaps[2],
        "damping law": topology.mesh_damping_law,
    }
    title = "Meshes: epsilon is the stiffness in the gap over that in contact, transition its width over the backlash"
    return table(title, columns)


def _cylinders(train):
    topology, cylinders = train.topology, train.cylinders
    bore, stroke, mass = (np.array(v) for v in (cylinders.bore, cylinders.stroke, cylinders.reciprocating_mass))
    columns = {
        "cylinder": topology.cylinder_names,
        "disk": [topology.disk_names[disk] for disk in topology.cylinder_disk],
        "firing angle deg": cylinders.firing_angle,
        "fires": ["yes" if fires else "no" for fires in topology.cylinder_fires],
        "gas torque from": [gas_words(topology, i) for i in range(len(topology.cylinder_names))],
        "bore mm": np.where(bore, 1e3 * bore, np.nan),
        "stroke mm": np.where(stroke, 1e3 * stroke, np.nan),
        # Without a stroke the rod is one that stands in for none.
        "rod mm": np.where(stroke > 0, 1e3 * np.array(cylinders.rod), np.nan),
        "recip. mass kg": np.where(mass, mass, np.nan),
    }
    return table("Cylinders", columns)


def _torques(report):
    train, files = report.train, report.files.get("torque")
    topology = train.topology
    columns = {
        "torque": topology.torque_names,
        "disk": [topology.disk_names[disk] for disk in topology.torque_disk],
        "mean N m": train.torques.mean,
        "orders": [len(orders) for orders in topology.torque_harmonics],
        "orders of": ["own" if own else "reference" for own in topology.torque_own],
        "factor over the speed": [torque_over_speed(train, i, files) for i in range(len(topology.torque_names))],
    }
    return table("Torques given by their orders, before the factor over the speed", columns)


def _loads(train):
    topology = train.topology
    columns = {
        "element": [*topology.load_names, *topology.ground_names],
        "disk": [topology.disk_names[disk] for disk in (*topology.load_disk, *topology.ground_disk)],
        "kind": ["load"] * len(topology.load_names) + ["ground"] * len(topology.ground_names),
        "": [f"share {plain_number(float(share), 6)}" for share in train.loads.share]
        + [f"{plain_number(float(stiffness), 6)} N m/rad" for stiffness in train.grounds.stiffness],
    }
    return table("Loads, which balance the mean power, and grounds", columns)


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
