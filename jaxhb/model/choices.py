"""Changes that are no numbers of a train, by ``"NAME.FIELD"``: laws of meshes, and teeth, with which radii follow."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxhb.model.elements import Mesh, SceneError, suggestion
from jaxhb.model.tables import FRIDMAN_EPSILON, FRIDMAN_TRANSITION

_WORDS = {f.name: f.metadata["words"] for f in dataclasses.fields(Mesh) if f.metadata["kind"] == "choice"}
_FRIDMAN = {"epsilon": FRIDMAN_EPSILON, "transition": FRIDMAN_TRANSITION}


def chosen(train, values, locate):
    """Take what is no number of the train from ``{"NAME.FIELD": value}``.

    Parameters
    ----------
    train : DriveTrain
    values : dict
    locate : callable, (topology, key) -> table, field, index

    Returns
    -------
    train : DriveTrain
        With these laws and numbers of teeth.
    numbers : dict
        The other values, and the numbers that follow: ``law`` sets ``epsilon`` and ``transition``, ``teeth`` the
        ``radius`` with the tooth pitch that the gear has.
    faults : list of str
    """
    numbers, faults, topology, radii = {}, [], train.topology, {}
    laws, teeth = list(topology.mesh_damping_law), list(topology.teeth)
    for key, value in values.items():
        try:
            table, field, index = locate(topology, key)
        except SceneError:  # told with the numbers
            table, field, index = None, None, None
        head = f"{topology.title}, replace {key!r}: "
        if table == "mesh" and field in ("law", "damping_law"):
            fault = _word_fault(topology, index, field, value)
            if field == "law" and not fault:
                name = topology.mesh_names[index]
                numbers |= {f"{name}.{own}": number for own, number in _FRIDMAN.items()}
            laws[index] = value if field == "damping_law" and not fault else laws[index]
        elif table == "disk" and field == "teeth":
            fault = _teeth_fault(topology, index, value)
            if not fault:
                radii[index] = np.asarray(train.disks.radius)[index] * int(value) / teeth[index]
                teeth[index] = int(value)
        else:
            numbers[key], fault = value, ""
        faults += [head + fault] if fault else []
    if laws == list(topology.mesh_damping_law) and not radii:
        return train, numbers, faults
    topology = dataclasses.replace(topology, mesh_damping_law=tuple(laws), teeth=tuple(teeth))
    numbers |= {f"{topology.disk_names[index]}.radius": radius for index, radius in radii.items()}
    return dataclasses.replace(train, topology=topology), numbers, faults


def scene_values(train, settings, locate):
    """What a scene file has to say of the settings ``{"NAME.FIELD": value}`` of a train that they made, by table, row
    and field."""
    found = {}
    for key, value in settings.items():
        table, field, index = locate(train.topology, key)
        if (table, field) == ("mesh", "law"):
            found |= {(table, index, own): number for own, number in _FRIDMAN.items()}
            continue
        found[table, index, field] = int(value) if field == "teeth" else value
        if field == "teeth":
            found[table, index, "radius"] = float(np.asarray(train.disks.radius)[index])
    return found


def _word_fault(topology, index, field, value):
    known = [word for word in _WORDS[field] if word]
    if not topology.mesh_backlash[index]:
        return "the mesh has no backlash, it is always in contact. Build the scene with a backlash."
    return "" if value in known else f"{field} is {value!r}.{suggestion(value, known)}"


def _teeth_fault(topology, index, value):
    if not topology.teeth[index]:
        return "the gear has no teeth in the scene, its ratio is that of the radii. Build the scene with teeth."
    good = isinstance(value, int | float | np.integer | np.floating) and value >= 1 and value == int(value)
    return "" if good else f"teeth is {value!r}, must be a whole number of at least 1."
