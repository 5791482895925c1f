"""One speed as text, and several cases of it side by side: verdicts, and tables of
elements as specifications.
"""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from jaxhb.report import quantities
from jaxhb.report.answer import Answer, Case
from jaxhb.report.quantities import (
    Quantity,
    number,
    number_for_people,
)
from jaxhb.report.selection import cylinder_of, is_linear, train_name
from jaxhb.report.table import Column, Table
from jaxhb.report.text.certified import certificate_text
from jaxhb.report.text.columns import (
    NONE,
    WAYS,
    ratio,
)
from jaxhb.report.text.mean_torques import balance_line, mean_angles_of
from jaxhb.report.text.sentences import (
    firing_lines,
    misfire_text,
    motion_word,
    notes_text,
    status_lines,
    verdict,
)
from jaxhb.report.text.strength import (
    Share,
    answers_strength,
    at_same_speed,
    largest_shares,
    strength_text,
)
from jaxhb.results.quantities import VARIABLES, WITHOUT, names_of, variables_of
from jaxhb.results.record import PERCENT


def _of(head: str, variable: str, group: str = "") -> Column:
    """Column of a variable of data sets, by answer and name; numbers have the decimals
    of all others in the table in their unit, a way of their own takes SI units.
    """
    entry = VARIABLES[variable.removesuffix(WITHOUT)]
    return Column(
        head,
        WAYS[entry.way] if entry.way else entry.unit,
        lambda answer, name: number_for_people(answer, name, variable),
        group,
        unit="" if entry.way else entry.unit,
    )


def _listed(element: str) -> list[Column]:
    """Columns of the numbers that have one in the table of a kind of element."""
    return [
        _of(variable.column, variable.name)
        for variable in variables_of(element)
        if variable.column
    ]


def _against(head: str, variable: str) -> Column:
    """Column of the ratio of a number to the same without backlash."""
    return Column(
        head,
        ratio,
        lambda answer, name: (
            number(answer, name, variable),
            number(answer.without_backlash, name, variable),
        ),
    )


def _driver(answer: Answer, name: str) -> str:
    """The gear that drives a mesh; a dash where its mean force is zero."""
    topology = answer.topology
    side = answer.contacts[name].drive_side
    first, second = topology.mesh_ends[topology.mesh_names.index(name)]
    return topology.disk_names[first if side > 0 else second] if side else NONE


def _swings(signal: str) -> tuple[Column, ...]:
    """Columns of a torque with and without backlash."""
    half = f"{signal}_half_peak_to_peak"
    return (
        _of("mean", f"{signal}_mean", group=WITH),
        _of("peak", f"{signal}_peak", group=WITH),
        _of("half p-p", half, group=WITH),
        _of("peak", f"{signal}_peak{WITHOUT}", group="without"),
        _of("half p-p", f"{half}{WITHOUT}", group="without"),
        _against("ratio of half p-p", half),
    )


def _linear_swings(signal: str) -> tuple[Column, ...]:
    """Columns of a signal of a train without backlash."""
    return (
        _of("half peak-to-peak", f"{signal}_half_peak_to_peak"),
        _of("sum of amplitudes", f"{signal}_sum_of_amplitudes"),
    )


WITH = "with backlash"
FORCES = (
    _of("mean", "tooth_force_mean", group=WITH),
    _of("max", "tooth_force_max", group=WITH),
    _of("min", "tooth_force_min", group=WITH),
    _of("max", f"tooth_force_max{WITHOUT}", group="without"),
    _of("min", f"tooth_force_min{WITHOUT}", group="without"),
    _against("peak ratio", "tooth_force_peak"),
)
SPEEDS = (
    Column(
        "mean",
        "{:.6g}".format,
        lambda answer, name: number(answer, name, "speed_mean"),
        unit="rad/s",
    ),
    _of("half p-p", "speed_half_peak_to_peak"),
)
ACCELERATION = _of("acceleration", "acceleration_half_peak_to_peak")
"""Columns of the tables of meshes and disks by answer and name, in the unit for
people.
"""


def element_table(
    title: str,
    element: str,
    columns: Sequence[Column],
    *answers: Answer,
    names: Sequence[str] | None = None,
    cases: Sequence[str] = (),
) -> Table:
    """A row for every element of a kind or of those ``names``, ``columns`` for every
    answer, under the titles of ``cases`` if there are any.
    """
    of_names = [Column(element, read=str)]
    for place, answer in enumerate(answers):
        for column in columns:
            assert column.read is not None  # by answer and name
            of_names.append(
                dataclasses.replace(
                    column,
                    way=column.way if callable(column.way) else (place, column.way),
                    read=partial(column.read, answer),
                    group=cases[place] if cases else column.group,
                )
            )
    return Table(title, of_names, names or names_of(answers[0].topology)[element])


def solve_text(answer: Answer) -> str:
    """The :class:`Answer` at one speed: verdict, kind of motion, tooth forces, torques
    of gears and shafts, notes.
    """
    topology = answer.topology
    means = [balance_line(answer.balance), f"mean angles: {mean_angles_of(topology)}"]
    head = [
        verdict(answer),
        "",
        f"{train_name(topology)} at {answer.rpm:g} rpm",
        *firing_lines(answer.train),
        *status_lines(answer),
        "; ".join(filter(None, means)),
    ]
    doubt = f"{answer.doubt.upper()}: " if answer.doubt else ""
    return "\n\n".join(
        [
            "\n".join(head),
            *(doubt + table for table in _tables(answer)),
            *certificate_text(answer),
            *strength_text({"": answers_strength([answer])}),
            *notes_text(answer),
        ]
    )


def _tables(answer: Answer) -> Iterator[Table]:
    """Tables of one speed: tooth forces and contact, torques, angles, speeds."""
    topology = answer.topology
    if topology.mesh_names:
        yield element_table(
            "Tooth force, {N} (elastic and damping; positive on the flank that drives,"
            " driven by: see Contact)",
            "mesh",
            FORCES,
            answer,
        )
        yield from peak_table(answer)
        yield element_table(
            "Contact, % of the time (separated: in the gap; reverse: on the flank that"
            " does not drive), impacts a cycle",
            "mesh",
            [*_listed("mesh"), Column("driven by", str, _driver)],
            answer,
        )
        yield from meshing_table(answer)
        yield element_table(
            "Torque that a gear passes to its mates, {N m}",
            "gear",
            [*_swings("gear_torque"), *_listed("gear")],
            answer,
        )
    if topology.shaft_and_damper_names:
        columns = (_of("mean", "torque_mean"), *_linear_swings("torque"))
        if any(topology.mesh_backlash):
            columns = _swings("torque")
        yield element_table(
            "Torque of shafts and dampers, {N m} (mean: its size)",
            "shaft",
            (*columns, *_listed("shaft")),
            answer,
        )
    if not topology.link_names:
        yield element_table(
            "Vibratory angle of disks, {rad}", "disk", _linear_swings("angle"), answer
        )
    if answer.known and answer.response is not None:
        yield element_table(
            "Speed of disks, {rad/s}; cyclic irregularity: (largest - smallest) / mean;"
            " acceleration, {rad/s2}, half p-p",
            "disk",
            [*SPEEDS, *_listed("disk"), ACCELERATION],
            answer,
        )


def meshing_table(answer: Answer) -> list[Table]:
    """Gear whine, transmission error and rattle of the meshes that have a mesh period,
    in a list.
    """
    topology = answer.topology
    response = answer.response
    names = [
        name
        for name, periods in zip(
            topology.mesh_names, topology.mesh_periods, strict=True
        )
        if periods
    ]
    if not names or not answer.known:
        return []

    def whine(answer: Answer, name: str, k: int) -> float:
        return float(answer.whine(name)[k])

    def error(_: Answer, name: str) -> float:
        if response is None:
            return math.nan
        return 2e6 * float(response.transmission_error(name).half_peak_to_peak)

    def impacts(_: Answer, name: str) -> float:
        return math.nan if response is None else 1e3 * response.impact_energy(name)

    columns = [
        Column(
            "mesh Hz",
            "Hz",
            lambda answer, name: answer.mesh_order(name) * answer.rpm / 60,
        ),
        *(
            Column(f"order {k + 1} {{N}}", "N", partial(whine, k=k), unit="N")
            for k in range(3)
        ),
        Column("error p-p um", "um", error),
        Column("impacts mJ", "mJ", impacts),
    ]
    return [
        element_table(
            "Gear whine: tooth force at orders of the mesh period; loaded transmission"
            " error; energy of impacts a cycle",
            "mesh",
            columns,
            answer,
            names=names,
        )
    ]


def peak_table(answer: Answer, begin: str = "L") -> list[Table]:
    """Distribution of the largest tooth forces of recorded cycles, in a list; empty
    without a record. ``begin`` are the words before "argest" in the title.
    """
    if not answer.recorded:
        return []

    def peak(answer: Answer, name: str, i: int) -> float:
        return answer.force(name).per_cycle.peak[i]

    columns = [
        Column(f"{percentage} %", "N", partial(peak, i=i), unit="N")
        for i, percentage in enumerate(PERCENT)
    ]
    title = (
        f"{begin}argest tooth force of a cycle, {{N}}: 5, 50 and 95 % of the recorded"
        " cycles stay below"
    )
    if not answer.state.period:  # what repeats has the same extremes in every record
        columns.append(
            Column(
                "+-",
                "N",
                lambda answer, name: answer.force(name).spread.peak,
                unit="N",
            )
        )
        title += (
            "; +-: by how\nmuch the largest of another such record would differ (two"
            " standard deviations)"
        )
    return [element_table(title, "mesh", columns, answer)]


COMPARED = (
    _of("with", "tooth_force_peak"),
    _of("without", f"tooth_force_peak{WITHOUT}"),
    _of("separated %", "separated_fraction"),
    _of("reverse %", "reverse_contact_fraction"),
    _of("impact m/s", "hardest_impact"),
)
"""Columns of each of several cases that stand side by side."""


def cases_text(cases: Sequence[Case]) -> str:
    """Verdicts of all cases and speeds, then per speed tooth forces and torques side by
    side.
    """
    parts = [
        f"With {case.title}\n"
        + "\n".join(dict.fromkeys(f"  {verdict(answer)}" for answer in case.answers))
        for case in cases
    ]
    parts += firing_lines(*(case.answers[0].train for case in cases))
    for place, first in enumerate(cases[0].answers):
        lines = [f"==== {first.rpm:g} rpm ===="]
        for case in cases:
            answer = case.answers[place]
            # A linear train has one motion, and nothing of it is approximated.
            exact = is_linear(answer.topology) and answer.answered
            of_case = [] if exact else status_lines(answer)
            of_case.append(balance_line(answer.balance))
            lines += [f"  {case.title}", *(f"    {line}" for line in of_case if line)]
        parts += ["\n".join(lines), *speed_tables(cases, place)]
    for case in cases:
        for answer in case.answers:
            parts += certificate_text(answer)
    return "\n\n".join([*parts, *_below(cases)])


def _below(cases: Sequence[Case]) -> list[str]:
    """Stresses, tooth torques and heat of every case beside their limits, and notes."""
    return [
        *strength_text(
            {f"With {case.title}": answers_strength(case.answers) for case in cases}
        ),
        *notes_text(*(answer for case in cases for answer in case.answers)),
    ]


def speed_tables(cases: Sequence[Case], place: int) -> list[Table]:
    """Tables of one speed: tooth forces, torques of gears and links (without links:
    angles), irregularity, heat.
    """
    answers = [case.answers[place] for case in cases]
    train = answers[0].train
    doubts = [f", {answer.doubt.upper()}".removesuffix(", ") for answer in answers]
    titles = [f"{case.title}{doubt}" for case, doubt in zip(cases, doubts, strict=True)]

    def table(title: str, quantity: Quantity, columns: Sequence[Column]) -> Table:
        return element_table(
            title,
            quantity.element,
            columns,
            *answers,
            names=quantity.names,
            cases=titles,
        )

    def swings(quantity: Quantity) -> Table:
        variable = quantity.variable
        columns = [_of(quantity.placeholder, variable)]
        if any(train.topology.mesh_backlash):
            columns = [
                _of("with", variable),
                _of("without", f"{variable}{WITHOUT}"),
                _against("ratio", variable),
            ]
        return table(f"{quantity.title}, {quantity.placeholder}", quantity, columns)

    tables = []
    links = train.topology.shaft_and_damper_names
    if train.topology.mesh_names:
        forces = table(
            "Largest tooth force, {N}, with and without backlash; share of the time"
            " separated and on the reverse flank",
            quantities.forces(train),
            COMPARED,
        )
        peaks = [
            peak
            for case in cases
            for peak in peak_table(case.answers[place], f"With {case.title}: l")
        ]
        tables += [forces, *peaks, swings(quantities.gear_torques(train))]
    if links or not tables:
        tables.append(
            swings((quantities.shaft_torques if links else quantities.angles)(train))
        )
    turning = quantities.irregularity(train)
    tables.append(table(turning.title, turning, [_of("%", turning.variable)]))
    heats = quantities.heat(train)
    if heats.names:
        tables.append(table(heats.title, heats, [_of("W", heats.variable)]))
    return tables


@dataclass(frozen=True)
class Hardest:
    """The element that is hit hardest at one speed: the quantity, its element, its
    value in SI units (nan and no element: no answer), the case and the place of the
    speed.
    """

    quantity: Quantity
    name: str | None
    value: float
    case: Case
    place: int

    @property
    def answer(self) -> Answer:
        """Answer at that speed."""
        return self.case.answers[self.place]

    @property
    def said(self) -> str:
        """Value, element and speed in words."""
        return (
            f"{self.quantity.said(self.value)} in {self.name} at"
            f" {self.answer.rpm:g} rpm"
        )


def hardest_at(case: Case, place: int) -> Hardest:
    """The :class:`Hardest` of one speed."""
    answer = case.answers[place]
    quantity = quantities.main_quantity(answer.train)
    name = quantity.largest(answer) if answer.answered else None
    value = quantity.read(answer, name) if name else float("nan")
    return Hardest(quantity, name, value, case, place)


def hardest_of(cases: Sequence[Case]) -> Hardest | None:
    """The :class:`Hardest` of all cases and speeds; None where no motion is known."""
    every = (
        hardest_at(case, place) for case in cases for place in range(len(case.answers))
    )
    return max(
        (hardest for hardest in every if hardest.name),
        key=lambda hardest: hardest.value,
        default=None,
    )


def worst_misfire(cases: Sequence[Case]) -> dict[str, Any] | None:
    """The record of the misfire that governs: with the largest share of a limit,
    without limits with the largest value of all; None where no motion is known.
    """
    governing = worst_misfires(cases)
    if governing:
        return next(iter(governing.values()))
    hardest = hardest_of(cases[1:])
    if hardest is None:
        return None
    assert hardest.name is not None  # speeds without an answer are left out
    quantity = hardest.quantity
    return {
        "cylinder": cylinder_of(hardest.case.title),
        "rpm": hardest.answer.rpm,
        "quantity": quantity.called,
        "of": hardest.name,
        "unit": quantity.entry.unit,
        "value": hardest.value,
        "firing": quantity.read(cases[0].answers[hardest.place], hardest.name),
    }


def worst_misfires(cases: Sequence[Case]) -> dict[str, dict[str, Any]]:
    """The record of the misfire that governs each element with a limit, by names, the
    largest share first.
    """
    normal = answers_strength(cases[0].answers)
    records: dict[str, dict[str, Any]] = {}
    for (key, name), worst in governing_misfires(cases).items():
        firing, firing_share = at_same_speed(worst, key, normal)
        record = {
            "cylinder": cylinder_of(worst.case),
            "rpm": worst.rpm,
            "quantity": worst.kind.called,
            "of": name,
            "unit": worst.kind.si_unit,
            "value": worst.value,
            "firing": firing,
            "share": worst.share,
            "firing_share": firing_share,
            "limit": worst.said,
        }
        records.setdefault(name, record)
    return records


def governing_misfires(cases: Sequence[Case]) -> dict[tuple[str, str], Share]:
    """The largest share of every limit over all misfires, as :func:`largest_shares`."""
    return largest_shares(
        {case.title: answers_strength(case.answers) for case in cases[1:]}
    )


def governing_table(cases: Sequence[Case]) -> Table | None:
    """The misfire that governs each element with a limit, beside normal running at the
    same speed; None without.
    """
    normal = answers_strength(cases[0].answers)
    rows = []
    for (key, name), worst in governing_misfires(cases).items():
        factor, unit = worst.kind.shown
        _, firing_share = at_same_speed(worst, key, normal)
        rows.append(
            [
                name,
                f"{worst.kind.called} {unit}",
                factor * worst.value,
                f"{worst.share:.2f}",
                f"{firing_share:.2f}" if math.isfinite(firing_share) else NONE,
                f"{worst.rpm:g}",
                worst.case,
            ]
        )
    if not rows:
        return None
    return Table(
        "The misfire with the largest share of the limit, element by element",
        [
            "element",
            Column("judged", left=True),
            Column("worst misfire", "number"),
            "share of its limit",
            "without it",
            "at rpm",
            Column("that of", left=True),
        ],
        rows,
    )


def misfires_text(cases: Sequence[Case]) -> str:
    """The worst misfire and that of each element with a limit, then per speed the
    element that each misfire hits hardest, against normal running.
    """
    worst = worst_misfire(cases)
    parts = [
        misfire_text(worst, cases[0].title)
        if worst
        else "No motion with a misfire is known.",
        *firing_lines(*(case.answers[0].train for case in cases)),
        governing_table(cases),
        *(_speed_table(cases, place) for place in range(len(cases[0].answers))),
        *_below(cases),
    ]
    return "\n\n".join(filter(None, parts))


def _speed_table(cases: Sequence[Case], place: int) -> Table:
    """A row for every case at one speed: what is hit hardest, against the first."""
    rows: list[list[Any]] = []
    for case in cases:
        hardest = hardest_at(case, place)
        quantity = hardest.quantity
        value = hardest.value
        firing = rows[0][1] if rows else value
        row = [case.title, value, (value, firing), hardest.name or NONE]
        if quantity.element == "mesh":
            row.append(motion_word(hardest.answer))
        rows.append(row + _largest_share(case.answers[place]))
    meshing = quantity.element == "mesh"
    limited = len(rows[0]) > 4 + meshing
    return Table(
        f"{quantity.title} at {cases[0].answers[place].rpm:g} rpm,"
        f" {quantity.placeholder}",
        [
            "",
            Column(quantity.placeholder, "number", unit=quantity.entry.unit),
            Column("ratio", ratio),
            Column("in", left=True),
            *[Column("motion", left=True)] * meshing,
            *["share of a limit"] * limited,
            *[Column("that of", left=True)] * limited,
        ],
        rows,
    )


def _largest_share(answer: Answer) -> list[str]:
    """The largest share of a limit at one speed and its element, two cells; none where
    the scene gives no limits.
    """
    strength = answers_strength([answer])
    if not strength:
        return []
    shares = largest_shares({"": strength})
    worst = next(iter(shares.values()), None)
    if worst is None:
        return [NONE, NONE]
    return [f"{worst.share:.2f}", f"{worst.kind.called} of {worst.name}"]
