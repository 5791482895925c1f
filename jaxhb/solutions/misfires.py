"""Every cylinder in turn not firing: the responses of all these trains over speed, and
the worst of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np

from jaxhb._executors import in_parts
from jaxhb._jax import Array, Numbers
from jaxhb._shown import brief
from jaxhb.elements.sentences import SceneError
from jaxhb.results.response import Response
from jaxhb.solutions.speeds import solve_speeds
from jaxhb.train.drivetrain import DriveTrain


@dataclass(frozen=True)
class Worst:
    """The largest value of a quantity with a misfire: the cylinder, the speed, and the
    value there with all cylinders firing, nan where that has no answer.
    """

    cylinder: str
    rpm: float
    value: float
    firing: float


@brief
@dataclass(frozen=True)
class Misfires:
    """Responses over speed: ``firing`` as the scene has it, ``responses`` by the
    cylinder that does not fire.
    """

    firing: Response
    responses: dict[str, Response]

    def worst(self, read: Callable[[Response], Array]) -> Worst:
        """The misfire and the speed, of those that converged, at which a quantity is
        largest.

        ``read`` : quantity of a response over speed, ``(n,)``, as ``lambda r:
        r.torque("a", "b").half_peak_to_peak``. ValueError if no speed converged.
        """
        names = list(self.responses)
        rows = [
            np.where(response.converged, np.asarray(read(response)), -np.inf)
            for response in self.responses.values()
        ]
        cylinder, speed = np.unravel_index(np.argmax(rows), np.shape(rows))
        if not np.isfinite(rows[cylinder][speed]):
            raise ValueError("no speed has converged with a misfire")
        firing = np.where(self.firing.converged, np.asarray(read(self.firing)), np.nan)[
            speed
        ]
        return Worst(
            names[cylinder],
            float(self.firing.rpm[speed]),
            float(rows[cylinder][speed]),
            float(firing),
        )


def misfire_each(
    train: DriveTrain,
    *,
    rpm: Numbers,
    harmonics: int | None = None,
    tolerance: float | None = None,
    solve: Callable[..., Response] = solve_speeds,
    executor: Executor | None = None,
) -> Misfires:
    """Solve at many speeds with all cylinders firing, and with each in turn not firing:
    :meth:`DriveTrain.misfires`.

    Parameters
    ----------
    train : DriveTrain
    rpm, harmonics, tolerance
        As for ``solve``.
    solve : callable
        :func:`jaxhb.solve_speeds`, or :func:`jaxhb.forced_response` for the linear
        train, which has no ``tolerance``.
    executor : concurrent.futures.Executor, optional
        Where the trains are solved, as :class:`jaxhb.Workers`.

    Raises
    ------
    SceneError
        If no cylinder fires, and as ``solve``.

    Examples
    --------
    >>> import jaxhb
    >>> misfires = jaxhb.misfire_each(
    ...     jaxhb.load_scene("six_cylinder_diesel"), rpm=[1200.0, 1800.0]
    ... )
    >>> worst = misfires.worst(lambda r: r.torque("cyl6", "flywheel").half_peak_to_peak)
    >>> worst.cylinder, worst.rpm, round(worst.value / worst.firing, 1)
    ('cylinder 2', 1800.0, 1.2)
    """
    return _each(
        train,
        train.misfires(),
        rpm,
        harmonics,
        tolerance,
        solve,
        executor,
        cut_off=False,
    )


def cut_off_each(
    train: DriveTrain,
    *,
    rpm: Numbers,
    harmonics: int | None = None,
    tolerance: float | None = None,
    solve: Callable[..., Response] = solve_speeds,
    executor: Executor | None = None,
) -> Misfires:
    """Solve with each cylinder in turn cut off, without compression too:
    :meth:`DriveTrain.cut_offs`.

    Arguments, errors and result are those of :func:`misfire_each`.

    >>> import jaxhb
    >>> cut_offs = jaxhb.cut_off_each(
    ...     jaxhb.load_scene("six_cylinder_diesel"),
    ...     rpm=[1800.0],
    ...     solve=jaxhb.forced_response,
    ... )
    >>> cut_offs.worst(
    ...     lambda r: r.torque("cyl6", "flywheel").half_peak_to_peak
    ... ).cylinder
    'cylinder 4'
    """
    return _each(
        train,
        train.cut_offs(),
        rpm,
        harmonics,
        tolerance,
        solve,
        executor,
        cut_off=True,
    )


def _each(
    train: DriveTrain,
    trains: Mapping[str, DriveTrain],
    rpm: Numbers,
    harmonics: int | None,
    tolerance: float | None,
    solve: Callable[..., Response],
    executor: Executor | None,
    *,
    cut_off: bool,
) -> Misfires:
    """Solve a train, and the ``trains`` by the cylinder that does not fire."""
    if not trains:
        raise SceneError(
            f"{train.topology.title}: no cylinder fires, so that none can misfire."
        )
    accuracy = {"harmonics": harmonics, "tolerance": tolerance}
    arguments = {"rpm": rpm} | {
        name: value for name, value in accuracy.items() if value is not None
    }
    cases = [alike(train, cut_off=cut_off), *trains.values()]
    parts = ((case,) for case in cases)
    responses = dict(in_parts(partial(solve, **arguments), parts, executor))
    misfiring = {name: responses[number] for number, name in enumerate(trains, 1)}
    return Misfires(responses[0], misfiring)


def alike(train: DriveTrain, *, cut_off: bool) -> DriveTrain:
    """The train with the array of injections, or of gas factors, that the trains of its
    misfires, or cut-offs, have.
    """
    field = "gas_factor" if cut_off else "injection"
    key = f"{train.topology.cylinder_names[0]}.{field}"
    return train.replace({key: train.value(key)})
