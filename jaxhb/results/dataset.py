"""Motions as labelled arrays of xarray: names, units, and nan where nothing is known.
The only importer of xarray.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb import __version__
from jaxhb.results.motion import Motion
from jaxhb.results.quantities import (
    OF_MOTIONS,
    VARIABLES,
    VIBRATIONS,
    Vibration,
    names_of,
    read,
    variables_of,
)
from jaxhb.results.signal import Lines, Signal

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from xarray import Dataset

    from jaxhb._jax import Array, Numbers
    from jaxhb.train.topology import Topology

else:
    Dataset = Any


@dataclass(frozen=True)
class Spectrum:
    """Amplitudes and phases ``(elements, K)`` of a vibrating quantity, its orders
    ``(K,)``, and the amplitude of every other order; amplitudes ``(elements,)`` of
    ``lines`` by their frequency in Hz.
    """

    amplitudes: Array
    phases: Array
    orders: np.ndarray
    lacking: float
    lines: Mapping[float, Array] = field(default_factory=dict)

    def at(self, order: np.ndarray) -> np.ndarray:
        """Amplitudes and phases ``(2, elements, n)`` at the orders ``(n,)`` of a data
        set; of those that the motion lacks phases are nan.
        """
        present = np.isin(order, self.orders)
        places = np.searchsorted(self.orders, order)
        aligned = np.full(
            (2, len(self.amplitudes), len(order)), [[[self.lacking]], [[np.nan]]]
        )
        both = np.asarray([self.amplitudes, self.phases])
        aligned[:, :, present] = both[:, :, places[present]]
        return aligned


def to_xarray(
    motions: Sequence[Motion],
    topology: Topology,
    rpm: Numbers,
    *,
    orders: float | None = None,
) -> Dataset:
    """Data set (:meth:`jaxhb.Response.to_xarray`) of Responses or SteadyStates of one
    train along ``rpm`` ``(n,)``, or of a single one where ``rpm`` is a number; with
    orders up to ``orders``, by default up to the highest of the motions of disks.
    """
    try:
        import xarray
    except ImportError:
        raise ImportError(
            'labelled arrays need xarray. Install it: pip install "jaxhb[data]"'
        ) from None
    answers = [_numbers(motion, topology) for motion in motions]
    listed = [
        spectrum.orders for _, spectra in answers for spectrum in spectra.values()
    ]
    order = np.unique(np.concatenate(listed or [np.zeros(0)]))
    order = order[
        : np.searchsorted(order, np.inf if orders is None else orders, side="right")
    ]
    names = {
        dim: np.array(labels, dtype=str) for dim, labels in names_of(topology).items()
    }
    fixed_hz = {
        hz
        for _, spectra in answers
        for spectrum in spectra.values()
        for hz in spectrum.lines
    }
    dims = {"rpm": np.asarray(rpm, dtype=float)} | names | {"order": order}
    dims["line"] = np.array(sorted(fixed_hz))
    # NetCDF has no empty dimension.
    dims = {name: labels for name, labels in dims.items() if np.size(labels)}
    many = np.ndim(rpm) > 0
    leading_dims = ("rpm",) if many else ()
    variables = {}

    def add_variable(
        name: str,
        rows: Sequence[np.ndarray],
        row_dims: tuple[str, ...],
        unit: str,
        meaning: str,
    ) -> None:
        values = np.stack(rows) if many else rows[0]
        attributes = {"long_name": meaning} | ({"units": unit} if unit else {})
        variables[name] = ((*leading_dims, *row_dims), values, attributes)

    for variable in (*OF_MOTIONS, *VARIABLES.values()):
        row_dims = (variable.element,) if variable.element else ()
        if variable.meaning and {*row_dims} <= dims.keys():
            shape = [len(dims[dim]) for dim in row_dims]
            nothing = np.full(shape, variable.unknown)
            rows = [
                np.asarray(numbers.get(variable.name, nothing))
                for numbers, _ in answers
            ]
            add_variable(variable.name, rows, row_dims, variable.unit, variable.meaning)
    for name, vibration in VIBRATIONS.items():
        dim = vibration.element
        if vibration.orders and dim in dims and "order" in dims:
            nothing = np.full((2, len(dims[dim]), len(order)), np.nan)
            aligned = [
                spectra[name].at(order) if name in spectra else nothing
                for _, spectra in answers
            ]
            for place, (part, unit, words) in enumerate(
                (
                    ("amplitude", vibration.unit, "one-sided amplitude"),
                    ("phase", "degree", "phase of the cosine"),
                )
            ):
                add_variable(
                    f"{name}_{part}",
                    [values[place] for values in aligned],
                    (dim, "order"),
                    unit,
                    f"{words}, {vibration.meaning}",
                )
        if vibration.orders and dim in dims and fixed_hz:
            nothing = np.full(len(dims[dim]), np.nan)
            amplitudes = [
                np.stack(
                    [
                        spectra[name].lines.get(hz, nothing)
                        if name in spectra
                        else nothing
                        for hz in dims["line"].tolist()
                    ],
                    axis=-1,
                )
                for _, spectra in answers
            ]
            add_variable(
                f"{name}_line_amplitude",
                amplitudes,
                (dim, "line"),
                vibration.unit,
                f"one-sided amplitude at fixed frequencies, {vibration.meaning}",
            )
    units = {"rpm": {"units": "rpm", "long_name": "speed of the reference rotor"}}
    units["order"] = {
        "units": "1",
        "long_name": "order, per revolution of the reference rotor",
    }
    units["line"] = {"units": "Hz", "long_name": "fixed frequency of a torque"}
    coordinates = {
        name: ((name,) if many or name != "rpm" else (), labels, units.get(name, {}))
        for name, labels in dims.items()
    }
    about = {
        "scene": topology.name,
        "revolutions_per_cycle": float(topology.revolutions_per_cycle),
    }
    return xarray.Dataset(
        variables, coordinates, about | {"source": f"jaxhb {__version__}"}
    )


def trace_to_xarray(motion: Any, time: Array, rpm: Array, angle: Array) -> Dataset:
    """Data set (:meth:`jaxhb.Transient.to_xarray`) of the signals of a motion at
    instants ``(n,)`` s, with the speed in rpm and the rotation in rad of the reference
    rotor.
    """
    try:
        import xarray
    except ImportError:
        raise ImportError(
            'labelled arrays need xarray. Install it: pip install "jaxhb[data]"'
        ) from None
    topology = motion.topology
    # NetCDF has no empty dimension.
    names = {dim: labels for dim, labels in names_of(topology).items() if labels}
    variables = {}
    for name, vibration in VIBRATIONS.items():
        if name == "acceleration" or vibration.element not in names:
            continue  # a transient has no accelerations
        signals = [vibration.read(motion, each) for each in names[vibration.element]]
        values = np.stack([np.asarray(signal.values) for signal in signals], axis=1)
        attributes = {"long_name": vibration.meaning, "units": vibration.unit}
        variables[name] = (("time", vibration.element), values, attributes)
    reference = {
        "time": (time, "s", "time"),
        "rpm": (rpm, "rpm", "speed of the reference rotor"),
        "rotation": (angle, "rad", "angle that the reference rotor has turned"),
    }
    coordinates: dict[str, Any] = {
        name: ("time", np.asarray(values), {"units": unit, "long_name": meaning})
        for name, (values, unit, meaning) in reference.items()
    }
    worked = {vibration.element for vibration in VIBRATIONS.values()}
    coordinates |= {
        dim: np.array(labels, dtype=str)
        for dim, labels in names.items()
        if dim in worked
    }
    about = {
        "scene": topology.name,
        "revolutions_per_cycle": float(topology.revolutions_per_cycle),
        "source": f"jaxhb {__version__}",
    }
    return xarray.Dataset(variables, coordinates, about)


def _numbers(
    motion: Any, topology: Topology
) -> tuple[dict[str, Any], dict[str, Spectrum]]:
    """Numbers of one motion by name of the variable, as far as they are there, and
    spectra by name of the vibrating quantity.
    """
    response = motion.solution
    solved = response is not None and bool(response.converged)
    alone = motion is response  # of jaxhb.solve
    numbers: dict[str, Any] = {}
    if response is not None:
        numbers = {
            variable.name: getattr(response, variable.reader)
            for variable in OF_MOTIONS
            if variable.reader
        }
    numbers |= (
        {"kind": "solution", "period": 1}
        if alone
        else {"kind": motion.kind, "period": motion.period}
    )
    if not solved and (alone or motion.record is None):
        return numbers | {"source": "nothing"}, {}
    spectra = {}
    for element, names in names_of(topology).items():
        plain = [
            variable
            for variable in variables_of(element)
            if variable.meaning and variable.vibration is None
        ]
        if element in ("load", "ground"):
            if solved:
                numbers |= {
                    variable.name: getattr(response, variable.reader)
                    for variable in plain
                }
            continue
        rows = [read(motion, name, plain) for name in names]
        for variable in plain:
            numbers[variable.name] = [row[variable.name] for row in rows]
        for vibration in VIBRATIONS.values():
            # A record has no accelerations.
            recorded = solved or vibration.name != "acceleration"
            if vibration.element == element and names and recorded:
                signals = [vibration.read(motion, name) for name in names]
                whole = _together(signals) if solved else None
                numbers |= _statistics(vibration, signals, whole)
                if vibration.orders:
                    most = response.harmonics if solved else None
                    spectra[vibration.name] = _spectrum(signals, whole, most)
    return numbers | {"source": "harmonics" if solved else "record"}, spectra


def _together(signals: Sequence[Signal]) -> Signal:
    """Signals of one motion as one, with a leading axis."""
    first = signals[0]
    lines = None
    if first.lines is not None:
        every = [signal.lines for signal in signals if signal.lines is not None]
        lines = Lines(
            np.stack([each.hz for each in every]),
            np.stack([each.coefficients for each in every]),
        )
    return Signal(
        np.stack([signal.coefficients for signal in signals]),
        None,
        first.revolutions_per_cycle,
        first.resolution,
        lines=lines,
    )


def _statistics(
    vibration: Vibration, signals: Sequence[Any], whole: Signal | None
) -> dict[str, np.ndarray]:
    """Numbers ``(elements,)`` of signals, those of a solution as a ``whole``."""
    return {
        variable.name: np.broadcast_to(
            np.asarray(
                [variable.part(signal) for signal in signals]
                if whole is None
                else variable.part(whole),
                dtype=float,
            ),
            len(signals),
        )
        for variable in VARIABLES.values()
        if variable.meaning and variable.vibration is vibration
    }


def _spectrum(
    signals: Sequence[Any], whole: Signal | None, most: int | None
) -> Spectrum:
    """The :class:`Spectrum` of signals, those of a solution as a ``whole`` with
    ``most`` harmonics; recorded cycles have amplitudes without phases.
    """
    if whole is None:
        recorded = np.array([signal.amplitudes for signal in signals])
        phases = np.full(recorded.shape, np.nan)
        return Spectrum(recorded, phases, signals[0].orders, np.nan)
    # Tooth forces have more harmonics than the motion, whose orders the data set lists.
    amplitudes = whole.amplitudes[:, :most]
    # An order that is not there has no phase.
    phases = np.where(amplitudes > 0, whole.phases_deg[:, :most], np.nan)
    return Spectrum(amplitudes, phases, whole.orders[:most], 0.0, whole.by_line())
