"""One door to the numbers of answers: which may be read, and what replaces the rest.

A response keeps the last iterate of a solve that failed, whose numbers belong to no
motion. Two grades may be read:

- :func:`solved`: the equations are solved, with as many harmonics as there are
  (CONVERGED and TOLERANCE_NOT_MET);
- converged: their truncation error is within its limit besides, so that numbers need no
  mark of doubt.

A reader of answers does one of four things with the rest: it leaves them out and says
so (:func:`left_out`), refuses to go on without them (:func:`need_solved`,
:func:`jaxhb.check`), puts nan in their place (:func:`with_gaps`), or, where derivatives
go through them, zeros (:func:`with_zeros`).
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxhb._jax import Array, namespace
from jaxhb._shown import ranges
from jaxhb.results.status import AnyResponse, NotConverged, Status

OF_MOTION: tuple[str, ...] = (
    "angles",
    "torques",
    "elastic_torques",
    "deflections",
    "forces",
    "elastic_forces",
)
OF_MOTION += ("disk_power", "link_power", "input_power")
"""Fields of responses whose numbers belong to no motion where the equations are not
solved.
"""


def solved(status: Array | int) -> Any:
    """Whether the equations are solved, so that the numbers are those of a motion: for
    every status ``(...)``.
    """
    return status <= Status.TOLERANCE_NOT_MET


def need_solved(response: AnyResponse) -> AnyResponse:
    """Return the response at one speed; raise :class:`NotConverged` with a sentence
    where it solves no equations.
    """
    status = Status(int(response.status))
    if not solved(status):
        where = f"{response.topology.title} at {float(response.rpm):g} rpm"
        raise NotConverged(
            f"{where} is no periodic motion: {status.name}: {status.sentence}."
        )
    return response


def left_out(
    rpm: Array,
    status: Array,
    title: str,
    *,
    answered: Array | None = None,
    advice: Mapping[Status, str] | None = None,
) -> list[str]:
    """Return a sentence for each status of the speeds ``(n,)`` that are not
    ``answered``, by default those not solved; it ends with the ``advice`` for that
    status, or else with the sentence of the status itself.
    """
    rpm = np.atleast_1d(rpm)
    status = np.atleast_1d(status)
    lost = ~np.atleast_1d(solved(status) if answered is None else answered)
    sentences = []
    for failure in map(Status, np.unique(status[lost]).tolist()):
        speeds = ranges(rpm.tolist(), rpm[lost & (status == failure)].tolist())
        sentences.append(
            f"{title} at {speeds} rpm: {failure.name}:"
            f" {(advice or {}).get(failure, failure.sentence)}."
        )
    return sentences


def with_gaps(response: AnyResponse, *, doubtful: bool = False) -> AnyResponse:
    """Return the response of one or several speeds with nan for the motion where the
    equations have no answer, and, unless ``doubtful``, where it has too few harmonics.
    """
    readable = solved(response.status) if doubtful else response.converged
    return _masked(response, readable, np.nan)


def with_zeros(response: AnyResponse) -> AnyResponse:
    """Return the response with zeros where the equations are not solved: masked before
    it is read, so that no derivative is nan.
    """
    return _masked(response, solved(response.status), 0.0)


def _masked(response: AnyResponse, valid: Array, fill: float) -> AnyResponse:
    """Return the response with ``fill`` for the numbers of motions that are not
    ``valid`` ``(...)``.
    """
    if namespace(valid) is np and np.all(valid):
        return response

    def masked(values: Array) -> Array:
        xp = namespace(values, valid)
        shape = np.shape(valid) + (1,) * (np.ndim(values) - np.ndim(valid))
        return xp.where(xp.asarray(valid).reshape(shape), values, fill)

    def masked_numbers(holder: Any) -> dict[str, Any]:
        names = [name for name in OF_MOTION if hasattr(holder, name)]
        return {name: masked(getattr(holder, name)) for name in names}

    lines = response.lines
    if lines is not None:
        lines = dataclasses.replace(lines, **masked_numbers(lines))
    return dataclasses.replace(response, lines=lines, **masked_numbers(response))
