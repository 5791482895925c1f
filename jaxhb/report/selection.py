"""Elements of a train to show: gears, shafts, and those that work hardest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jaxhb.report.answer import Answer, largest
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.omission import is_cut_off
from jaxhb.train.topology import Topology

NOT_FIRING = " not firing"
CUT_OFF = " cut off"
ALL_FIRING = "all cylinders firing"
AS_GIVEN = "the scene as given"


def case_title(train: DriveTrain, cylinder: str = "") -> str:
    """Name a train as it runs, or as one in which this cylinder does not fire or is cut
    off.
    """
    if cylinder:
        return f"{cylinder}{CUT_OFF if is_cut_off(train, cylinder) else NOT_FIRING}"
    names = train.topology.cylinder_names
    return (
        ALL_FIRING if names and train.topology.firing_cylinders == names else AS_GIVEN
    )


def idle_title(topology: Topology) -> str:
    """Name the cylinders that do not fire, "" where all do: ``cylinder 2 not firing,
    cylinder 4 cut off``.
    """
    cylinders = zip(
        topology.cylinder_names,
        topology.cylinders.fires,
        topology.cylinders.cut_off,
        strict=True,
    )
    idle: dict[str, list[str]] = {NOT_FIRING: [], CUT_OFF: []}
    for name, fires, cut_off in cylinders:
        if cut_off or not fires:
            idle[CUT_OFF if cut_off else NOT_FIRING].append(name)
    return ", ".join(
        f"{', '.join(names)}{fault}" for fault, names in idle.items() if names
    )


def misfiring(title: str) -> bool:
    """Tell whether a title is that of a case in which some cylinder does not fire or is
    cut off.
    """
    return title.endswith((NOT_FIRING, CUT_OFF))


def cylinder_of(title: str) -> str:
    """Return the cylinder of such a title."""
    return title.removesuffix(NOT_FIRING).removesuffix(CUT_OFF)


def train_name(topology: Topology) -> str:
    """Name the train, with the cylinders that do not fire."""
    return ", ".join(filter(None, [topology.title, idle_title(topology)]))


def meshes_of(topology: Topology, gear: str) -> tuple[str, ...]:
    """Return the names of the meshes of a gear."""
    disk = topology.disk_index(gear)
    return tuple(
        name
        for name, ends in zip(topology.mesh_names, topology.mesh_ends, strict=True)
        if disk in ends
    )


def most_apart(answer: Answer) -> str | None:
    """Find the mesh that is apart for the largest share of the time; None where all
    stay in contact or nothing is known.
    """
    name = largest(
        answer.topology.mesh_names,
        lambda mesh: answer.contacts[mesh].separated_fraction,
    )
    return (
        name if name is not None and answer.contacts[name].separated_fraction else None
    )


def hardest_shaft(answers: Sequence[Answer]) -> str | None:
    """Find the shaft or damper whose torque has the largest half peak-to-peak in any
    answer; None without.
    """
    certain = [answer for answer in answers if answer.answered] or [
        answer for answer in answers if answer.known
    ]
    links = answers[0].topology.shaft_and_damper_names
    return largest(
        links,
        lambda name: max(
            (answer.torque(name).half_peak_to_peak for answer in certain), default=0.0
        ),
    )


def heaviest(train: DriveTrain) -> str:
    """Find the disk of the reference rotor with the largest inertia, its flywheel."""
    topology = train.topology
    inertia = np.asarray(train.disks.inertia)
    disks = [
        i
        for i in range(topology.n_scene_disks)
        if topology.rotor[i] == topology.reference_rotor
    ]
    return topology.disk_names[max(disks, key=lambda i: inertia[i])]


def is_linear(topology: Topology) -> bool:
    """Tell whether the linear forced response is the whole answer: no mesh has backlash
    or varies, no shaft or damper has stages, stops, clearance or friction.
    """
    return not (
        any(topology.mesh_backlash) or topology.springs or topology.mesh_varies.any()
    )


def turning_disks(train: DriveTrain) -> tuple[str, ...]:
    """Return the disks whose irregularity is reported: the heaviest of the reference
    rotor, the gears, and those with a load.
    """
    topology = train.topology
    loaded = [topology.disk_names[disk] for disk in topology.load_disk]
    return tuple(dict.fromkeys([heaviest(train), *topology.gear_names, *loaded]))


def subject_of(
    answer: Answer, gear: str | None = None
) -> tuple[str | None, tuple[str, ...]]:
    """Choose the element to show over the cycle, and its meshes: a gear, by default of
    the gears of the reference rotor (of all, if it has none) the one whose torque
    swings most; without gears the shaft or damper whose torque swings most, or None.
    """
    topology = answer.topology
    motion = answer if answer.known else answer.without_backlash
    gears: Sequence[str] = [
        gear
        for gear in topology.gear_names
        if topology.rotor[topology.disk_index(gear)] == topology.reference_rotor
    ]
    gears = gears or topology.gear_names
    gear = (
        gear
        or largest(gears, lambda name: motion.gear_torque(name).half_peak_to_peak)
        or next(iter(gears), None)
    )
    return (gear, meshes_of(topology, gear)) if gear else (hardest_shaft([answer]), ())
