"""Meaning of critical speeds: amplitudes, torques and stresses of the order that is
critical there, beside their limits; Holzer's tables and vector sums of the modes that
matter.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jaxhb.elements.sentences import SceneError
from jaxhb.linear.critical import ELASTIC, Critical
from jaxhb.linear.cylinders.vector_sums import vector_sums
from jaxhb.linear.forced import ForcedResponse, forced_response
from jaxhb.linear.holzer import holzer_table
from jaxhb.linear.modal import Modes
from jaxhb.linear.strength import strength
from jaxhb.report.orders import OrderNames, order_names
from jaxhb.report.page.elements import forward_end
from jaxhb.report.page.parts import Block, Report
from jaxhb.report.table import Column, Table
from jaxhb.report.text.columns import NONE, plain_number
from jaxhb.report.text.linear import holzer_parts, in_contact, vector_text
from jaxhb.report.units import shown_unit
from jaxhb.results.quantities import VIBRATIONS
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.kinematics import speed_ratios

LEAST = 0.05
"""Share of a limit, without limits of the largest torque, below which a critical speed
is left out.
"""

FEWEST = 3  # critical speeds that are shown, however small they are
NODES = 2  # links that are named as places of nodes
HOLZER_DISKS = 60  # disks of a train that has Holzer's tables
HOLZER_MODES = 2  # of the modes with critical speeds


@dataclass(frozen=True)
class Passage:
    """A critical speed in the case in which it is worst.

    angle : amplitude in rad at the forward end; shaft : the one with the largest share
    of its limit, without limits with the largest torque; torque, stress : amplitudes of
    the order there, N m and Pa; limit : Pa; share : of the limit; nan where none is
    known
    """

    critical: Critical
    case: str
    angle: float
    shaft: str
    torque: float
    stress: float
    limit: float

    @property
    def share(self) -> float:
        """Stress over its limit."""
        return self.stress / self.limit


def critical_table(
    report: Report, criticals: Sequence[Critical], modes: Modes
) -> list[Block]:
    """Make the table of critical speeds with what their order alone does there, and say
    what is left out.
    """
    if not criticals:
        return []
    passages = _worst_passages(report, criticals)
    largest = max((passage.torque for passage in passages), default=0.0) or 1.0
    sizes = [
        passage.torque / largest if np.isnan(passage.share) else passage.share
        for passage in passages
    ]
    largest_sizes = sorted(sizes, reverse=True)[:FEWEST]
    shown = [
        passage
        for passage, size in zip(passages, sizes, strict=True)
        if size >= min(LEAST, *largest_sizes)
    ]
    judged = any(np.isfinite(passage.share) for passage in shown)
    several = len(report.cases) > 1
    names = order_names(report.train)
    at_nodes = {
        mode: nodes_text(report.train, modes, mode)
        for mode in {passage.critical.mode for passage in shown}
    }
    end = report.train.topology.disk_names[forward_end(report.train)]
    table = Table(
        "Critical speeds and what their order alone does there in the worst case:"
        f" amplitude of the angle of {end} (forward end), amplitudes of the shaft"
        f" with the largest {'share of its limit' if judged else 'torque'}",
        _columns(names, at_nodes, judged, several),
        shown,
        marked=[place for place, each in enumerate(shown) if each.share > 1],
    )
    of_what = "the limit" if judged else "the largest torque"
    count = len(passages) - len(shown)
    more = "more critical speed stays" if count == 1 else "more critical speeds stay"
    left_out = f"{count} {more} below {100 * LEAST:g} % of {of_what}: left out."
    return [table, *[left_out] * bool(count)]


def _columns(
    names: OrderNames, nodes: Mapping[int, str], judged: bool, several: bool
) -> list[Column]:
    """Columns of the table of critical speeds, by passages."""

    def number(value: float) -> str:
        return plain_number(value) if np.isfinite(value) else NONE

    factor, unit = shown_unit("rad")
    limits = [
        Column("stress {Pa}", "stress", lambda each: each.stress, unit="Pa"),
        Column("limit {Pa}", "stress", lambda each: each.limit, unit="Pa"),
        Column(
            "share",
            lambda share: f"{share:.2f}" if np.isfinite(share) else NONE,
            lambda each: each.share,
        ),
    ]
    return [
        Column("rpm", "{:.1f}".format, lambda each: each.critical.rpm),
        Column("order", names.number, lambda each: each.critical.order),
        Column("mode", read=lambda each: str(each.critical.mode)),
        Column("Hz", "{:.2f}".format, lambda each: each.critical.hz),
        Column("nodes in", read=lambda each: nodes[each.critical.mode], left=True),
        Column(f"angle {unit}", number, lambda each: factor * each.angle),
        Column("shaft", read=lambda each: each.shaft, left=True),
        Column("torque {N m}", "torque", lambda each: each.torque, unit="N m"),
        *limits * judged,
        *[Column("case", read=lambda each: each.case, left=True)] * several,
    ]


def _worst_passages(report: Report, criticals: Sequence[Critical]) -> list[Passage]:
    """Find the worst case of every critical speed, in their order."""
    of_cases = [
        _passages(case.title, case.answers[0].train, criticals) for case in report.cases
    ]
    return [
        max(row, key=lambda each: (np.nan_to_num(each.share), each.torque))
        for row in zip(*of_cases, strict=True)
    ]


def _passages(
    title: str, train: DriveTrain, criticals: Sequence[Critical]
) -> list[Passage]:
    """Compute what the orders of critical speeds do in one case."""
    response = forced_response(train, rpm=[float(each.rpm) for each in criticals])
    places = np.arange(len(criticals))
    topology = train.topology
    end = topology.disk_names[forward_end(train)]
    columns = [_order_column(response, end, each.order) for each in criticals]
    angles = VIBRATIONS["angle"].read(response, end).amplitudes[places, columns]
    shafts = topology.shaft_names
    if not shafts:
        return [
            Passage(critical, title, float(angle), NONE, 0.0, np.nan, np.nan)
            for critical, angle in zip(criticals, angles, strict=True)
        ]
    judged = strength(response, train=train)
    torques = np.zeros((len(shafts), len(criticals)))
    stresses = np.full_like(torques, np.nan)
    limits = np.full_like(torques, np.nan)
    for i, name in enumerate(shafts):
        signal = VIBRATIONS["torque"].read(response, name)
        torques[i] = signal.amplitudes[places, columns]
        row = judged.stresses.get(name)
        swing = np.asarray(signal.half_peak_to_peak)
        if row is not None:
            # Stress is in proportion to torque.
            stress_of_torque = np.asarray(row.stress) / np.where(swing > 0, swing, 1.0)
            stresses[i] = torques[i] * stress_of_torque
            limits[i] = np.nan if row.continuous is None else row.continuous
    shares = np.nan_to_num(stresses / limits, nan=-1.0)
    worst = [
        int(np.argmax(shares[:, k] if (shares[:, k] > 0).any() else torques[:, k]))
        for k in places
    ]
    return [
        Passage(
            critical,
            title,
            float(angles[k]),
            shafts[worst[k]],
            float(torques[worst[k], k]),
            float(stresses[worst[k], k]),
            float(limits[worst[k], k]),
        )
        for k, critical in enumerate(criticals)
    ]


def _order_column(response: ForcedResponse, name: str, order: float) -> int:
    """Find the number of an order among those of a response."""
    orders = np.asarray(VIBRATIONS["angle"].read(response, name).orders)
    return int(np.argmin(np.abs(orders - order)))


def nodes_text(train: DriveTrain, modes: Modes, mode: int) -> str:
    """Name the links in which a mode has its nodes.

    >>> import jaxhb
    >>> train = jaxhb.load_scene("six_cylinder_diesel")
    >>> nodes_text(train, jaxhb.natural_frequencies(train), 1)
    'cyl6|flywheel'
    """
    topology = train.topology
    ratios = np.asarray(speed_ratios(train))[np.array(topology.rotor)]
    shape = np.asarray(modes.shapes[mode]) / ratios
    first, second = np.array(topology.link_ends, dtype=int).reshape(-1, 2).T
    links = np.flatnonzero(shape[first] * shape[second] < 0)
    named = [topology.link_names[link] for link in links[:NODES]]
    more = f" and {len(links) - NODES} more" if len(links) > NODES else ""
    return ", ".join(named) + more or NONE


def modes_that_matter(
    train: DriveTrain, modes: Modes, kinds: Sequence[str], shown: Sequence[int]
) -> list[Block]:
    """Show Holzer's tables of the first modes that orders reach, and the vector sums of
    the firing.
    """
    topology = train.topology
    blocks: list[Block] = []
    try:
        if topology.n_disks <= HOLZER_DISKS:
            chosen = [k for k in shown if kinds[k] == ELASTIC][:HOLZER_MODES]
            hz = [float(modes.frequencies_hz[k]) for k in chosen]
            tables = [
                (k, holzer_table(train, hz=each))
                for k, each in zip(chosen, hz, strict=True)
            ]
            remark, *shown_tables = holzer_parts(
                tables, topology.title, in_contact(train)
            )
            blocks += [remark.replace("\n", " "), *shown_tables] if tables else []
    except SceneError:
        pass  # of closed loops there is no such table
    if any(topology.cylinders.fires):
        sums = vector_sums(train, modes=modes, numbers=list(shown))
        blocks += vector_text(sums, modes, order_names(train))
    return blocks
