"""The lift-off boundary: the speeds at which teeth first part, over a second number of
the train.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import brentq

from jaxhb._jax import Array, Numbers, refuse_tracers
from jaxhb._shown import brief
from jaxhb.elements.sentences import SceneError
from jaxhb.equations import fourier
from jaxhb.linear.forced import forced_response
from jaxhb.results.answers import left_out, need_solved
from jaxhb.results.response import Response
from jaxhb.results.status import NotConverged
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.train.changes import in_contact
from jaxhb.train.drivetrain import DriveTrain
from jaxhb.train.excitation import refuse_lines
from jaxhb.train.speeds import check_speed

# Samples per harmonic of the contact force, among which its smallest value is sought
SAMPLES = 64
TOLERANCE = 1e-9  # share of a speed to which a boundary is solved for


@brief
@dataclass(frozen=True)
class LiftOff:
    """Points at which the teeth of a mesh begin or cease to part; made by
    :func:`lift_off`.

    Parameters
    ----------
    over : str or None, the second number; value : ``(K,)`` of it, nan without
    rpm : ``(K,)``, of the reference rotor; mesh : tuple of K names
    parts : ``(K,)`` bool, whether the teeth part above this speed, and not below it
    never, always : values of the second number at which no teeth, or those of some
    mesh, part at every requested speed that has an answer
    left_out : tuple of str, a sentence for each value and status of speeds without an
    answer
    """

    over: str | None
    value: np.ndarray
    rpm: np.ndarray
    mesh: tuple
    parts: np.ndarray
    never: np.ndarray
    always: np.ndarray
    left_out: tuple[str, ...] = ()


def lift_off(
    train: DriveTrain, *, rpm: Numbers, over: str | None = None, values: Numbers = ()
) -> LiftOff:
    """Find the speeds at which teeth first part: where the smallest elastic force on a
    drive flank, all teeth in contact, is zero (a grazing of the motion in contact).

    Up to there the motion is that in contact: linear, or of teeth whose stiffness
    varies, or of shafts with stages, one solve a speed. Beyond, others may exist
    besides, and teeth that part may go on to do so below (:func:`jaxhb.steady_state`).

    Speeds without an answer, as an undamped resonance, are left out: ``left_out`` says
    so. :class:`SceneError` for speeds that are no rising sequence of two or more, and
    where the second number is none; :class:`NotConverged` where fewer than two speeds
    have an answer, as of a train whose mean torques do not balance.

    Parameters
    ----------
    train : DriveTrain, concrete, with backlash
    rpm : sequence of float ``(n,)``, rising
        Speeds of the reference rotor. Boundaries between neighbours are refined; two
        between neighbours are not seen.
    over : str, optional
        ``"NAME.FIELD"`` of a second number, as a mean torque, a stiffness or a damping.
    values : sequence of float, of the second number

    Examples
    --------
    From which speed on does the pair hammer?

    >>> pair = jaxhb.load_scene("spur_pair")
    >>> boundary = lift_off(pair, rpm=[3000.0, 4000.0, 5000.0])
    >>> boundary.mesh, boundary.parts.tolist(), boundary.rpm.round(-1).tolist()
    (('gear a|gear b',), [True], [4620.0])
    """
    refuse_tracers("lift_off", train, rpm, values)
    refuse_lines(train.topology)
    check_speed(train, rpm, many=True)
    rpm = np.asarray(rpm, dtype=float)
    if len(rpm) < 2 or (np.diff(rpm) <= 0).any():
        raise SceneError(
            f"{train.topology.title}: lift_off needs two speeds or more that rise:"
            f" {rpm.tolist()}."
        )
    gap_meshes = np.flatnonzero(train.topology.mesh_backlash)
    rows = []
    never = []
    always = []
    sentences = []
    for value in np.asarray(values, dtype=float).tolist() if over else [np.nan]:
        contact = in_contact(train.replace({over: value}) if over else train)
        motion = _in_contact_at(contact, rpm)
        place = f", {over} = {value:g}," if over else ""
        title = f"{contact.topology.title}{place}"
        sentences += left_out(rpm, motion.status, title)
        solved_rpm = rpm[motion.solved]
        margins = _margins(motion.elastic_forces[motion.solved])[:, gap_meshes]
        if len(solved_rpm) < 2:
            raise NotConverged(
                "lift_off needs two speeds with an answer or more: "
                + " ".join(sentences)
            )
        if (margins > 0).all():
            never.append(value)
        if (margins <= 0).all(axis=0).any():
            always.append(value)
        for index, mesh in zip(*np.nonzero(np.diff(margins > 0, axis=0)), strict=True):
            margin = partial(_margin, contact, gap_meshes[mesh])
            boundary = brentq(
                margin, solved_rpm[index], solved_rpm[index + 1], rtol=TOLERANCE
            )
            mesh_name = train.topology.mesh_names[gap_meshes[mesh]]
            rows.append((value, boundary, mesh_name, margins[index, mesh] > 0))
    return LiftOff(
        over=over,
        value=np.array([row[0] for row in rows]),
        rpm=np.array([row[1] for row in rows]),
        mesh=tuple(row[2] for row in rows),
        parts=np.array([row[3] for row in rows], bool),
        never=np.array(never),
        always=np.array(always),
        left_out=tuple(sentences),
    )


def _margin(train: DriveTrain, mesh: int, rpm: float) -> float:
    """Margin of one mesh at one speed."""
    motion = need_solved(_in_contact_at(train, np.array([rpm]))[0])
    return _margins(motion.elastic_forces)[mesh]


def _in_contact_at(train: DriveTrain, rpm: np.ndarray) -> Response:
    """The motion of a train in contact at speeds ``(n,)``."""
    if train.topology.linear_in_contact:
        return forced_response(train, rpm=rpm)
    return solve_speeds(train, rpm=rpm)


def _margins(force: Array) -> np.ndarray:
    """Smallest elastic force on the drive flank over the mean one, ``(..., M)``, from
    the coefficients of the force.
    """
    mean = force[..., 0].real
    values = np.sign(mean)[..., None] * fourier.synthesize(
        force, SAMPLES * force.shape[-1]
    )
    before = np.roll(values, 1, axis=-1)
    after = np.roll(values, -1, axis=-1)
    # The smallest value between samples: the vertex of the parabola through three of
    # them.
    bend = np.maximum(before - 2 * values + after, 1e-300)
    vertex = np.where(
        (values <= before) & (values <= after),
        values - (after - before) ** 2 / (8 * bend),
        values,
    )
    return vertex.min(axis=-1) / np.abs(mean)
