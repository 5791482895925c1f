"""Motions as labelled arrays of xarray: names, units, and nan where nothing is known.
The only importer of xarray.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb import __version__
from jaxhb.results.signal import Signal
from jaxhb.results.status import Status

if TYPE_CHECKING:
    from collections.abc import Sequence

    from xarray import Dataset

    from jaxhb._jax import Array, Numbers
    from jaxhb.results.motion import Motion
    from jaxhb.results.response import Response
    from jaxhb.results.steady import SteadyState
    from jaxhb.train.topology import Topology

    Spectrum = tuple[Array, Array, np.ndarray, float]
else:
    Dataset = Any

SIGNALS = {
    "angle": ("disk", "disk", "rad", "vibratory angle"),
    "speed": ("speed", "disk", "rad/s", "speed of rotation"),
    "acceleration": ("acceleration", "disk", "rad/s2", "angular acceleration"),
    "torque": ("torque", "shaft", "N m", "torque of shafts and dampers"),
    "gear_torque": (
        "gear_torque",
        "gear",
        "N m",
        "torque that a gear passes to its mates",
    ),
    "tooth_force": ("force", "mesh", "N", "tooth force, elastic and damping part"),
}
"""Reader of a motion for every vibrating quantity, its dimension, unit and meaning."""

STATISTICS = {
    "mean": "mean of the ",
    "min": "smallest ",
    "max": "largest ",
    "half_peak_to_peak": "half peak-to-peak of the ",
    "sum_of_amplitudes": "sum of the amplitudes of all orders of the ",
}

WITH_ORDERS = ("angle", "torque", "gear_torque", "tooth_force")
"""Signals whose amplitudes and phases are given; those of speeds and accelerations
follow from the angles.
"""

CONTACT = (
    "separated_fraction",
    "reverse_contact_fraction",
    "impacts_per_cycle",
    "hardest_impact",
)

OF_ELEMENTS = {
    "irregularity": (
        "disk",
        "1",
        "cyclic irregularity, (largest - smallest speed) / mean speed",
    ),
    "heat": ("shaft", "W", "mean power that a shaft or damper turns into heat"),
    "mesh_heat": ("mesh", "W", "mean power that the damping of a mesh turns into heat"),
    "separated_fraction": ("mesh", "1", "share of the time with the teeth apart"),
    "reverse_contact_fraction": (
        "mesh",
        "1",
        "share of the time on the flank that does not drive",
    ),
    "impacts_per_cycle": (
        "mesh",
        "1",
        "entries into contact in a cycle of the excitation",
    ),
    "hardest_impact": ("mesh", "m/s", "largest approach speed of an impact"),
    "tooth_force_spread": (
        "mesh",
        "N",
        "two standard deviations of the largest absolute tooth force over records",
    ),
    "load_torque": ("load", "N m", "mean torque of a load on its disk"),
    "ground_reaction": ("ground", "N m", "mean torque that a ground takes"),
}

OF_MOTIONS = {
    "kind": (
        "",
        (
            "contact, periodic, subharmonic, irregular or unknown; solution: of"
            " jaxhb.solve"
        ),
    ),
    "period": (
        "1",
        "period of the motion in cycles of the excitation, 0 where there is none",
    ),
    "source": ("", "what the numbers are read from: harmonics, record, or nothing"),
    "status": ("", "status of the harmonic solution"),
    "harmonics": (
        "1",
        "highest harmonic of the motion over its period, 0 without a harmonic solution",
    ),
    "residual": ("1", "residual of the equations"),
    "truncation_error": ("1", "truncation error over the largest tooth force"),
    "load_power": ("W", "power that the loads take"),
}

UNKNOWN = {
    "kind": "unknown",
    "source": "nothing",
    "status": "",
    "period": 0,
    "harmonics": 0,
}
"""Values of variables for which there is no number."""


def to_xarray(
    motions: Sequence[Response | SteadyState],
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
    read = [_numbers(motion, topology) for motion in motions]
    listed = [
        motion_orders
        for _, spectra in read
        for _, _, motion_orders, _ in spectra.values()
    ]
    order = np.unique(np.concatenate(listed or [np.zeros(0)]))
    order = order[
        : np.searchsorted(order, np.inf if orders is None else orders, side="right")
    ]
    names = {
        dim: np.array(labels, dtype=str) for dim, labels in names_of(topology).items()
    }
    dims = {"rpm": np.asarray(rpm, dtype=float)} | names | {"order": order}
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

    for name, (unit, meaning) in OF_MOTIONS.items():
        unknown = UNKNOWN.get(name, np.nan)
        rows = [np.asarray(numbers.get(name, unknown)) for numbers, _ in read]
        add_variable(name, rows, (), unit, meaning)
    of_elements = OF_ELEMENTS | {
        f"{name}_{statistic}": (dim, unit, words + meaning)
        for name, (_, dim, unit, meaning) in SIGNALS.items()
        for statistic, words in STATISTICS.items()
    }
    for name, (dim, unit, meaning) in of_elements.items():
        if dim in dims:
            nothing = np.full(len(dims[dim]), np.nan)
            rows = [
                np.asarray(numbers.get(name, nothing), dtype=float)
                for numbers, _ in read
            ]
            add_variable(name, rows, (dim,), unit, meaning)
    for name in WITH_ORDERS:
        _, dim, unit, meaning = SIGNALS[name]
        if dim in dims and "order" in dims:
            aligned = [
                _spectrum(spectra.get(name), len(dims[dim]), order)
                for _, spectra in read
            ]
            add_variable(
                f"{name}_amplitude",
                [amplitudes for amplitudes, _ in aligned],
                (dim, "order"),
                unit,
                f"one-sided amplitude, {meaning}",
            )
            add_variable(
                f"{name}_phase",
                [phases for _, phases in aligned],
                (dim, "order"),
                "degree",
                f"phase of the cosine, {meaning}",
            )
    units = {"rpm": {"units": "rpm", "long_name": "speed of the reference rotor"}}
    units["order"] = {
        "units": "1",
        "long_name": "order, per revolution of the reference rotor",
    }
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


def as_netcdf(data: Dataset) -> bytes:
    """Bytes of a data set as a NetCDF file (version 3, which everything reads)."""
    return bytes(data.to_netcdf(engine="scipy", format="NETCDF3_64BIT"))


def names_of(topology: Topology) -> dict[str, tuple[str, ...]]:
    """Names of the elements of every dimension."""
    return {
        "disk": topology.disk_names,
        "shaft": topology.shaft_and_damper_names,
        "gear": topology.gear_names,
        "mesh": topology.mesh_names,
        "load": topology.load_names,
        "ground": topology.ground_names,
    }


def _numbers(
    motion: Any, topology: Topology
) -> tuple[dict[str, Any], dict[str, Spectrum]]:
    """Numbers of one motion by name of the variable, as far as they are there, and
    spectra by name of the signal.
    """
    response = motion.solution
    solved = response is not None and bool(response.converged)
    alone = motion is response  # of jaxhb.solve
    numbers: dict[str, Any] = (
        {"kind": "solution", "period": 1}
        if alone
        else {"kind": motion.kind, "period": motion.period}
    )
    if response is not None:
        numbers |= {
            "status": Status(int(response.status)).name,
            "harmonics": int(response.highest_harmonic),
        }
        numbers |= {
            name: float(getattr(response, name))
            for name in ("residual", "truncation_error", "load_power")
        }
    if not solved and (alone or motion.record is None):
        return numbers | {"source": "nothing"}, {}
    names = names_of(topology)
    signals, spectra = _signals(motion, names, response if solved else None)
    contacts = [motion.mesh(name) for name in names["mesh"]]
    for name in CONTACT:
        numbers[name] = [getattr(contact, name) for contact in contacts]
    numbers["irregularity"] = [
        float(motion.irregularity(name)) for name in names["disk"]
    ]
    for heat, dim in (("heat", "shaft"), ("mesh_heat", "mesh")):
        numbers[heat] = [float(motion.power(name)) for name in names[dim]]
    numbers["tooth_force_spread"] = [
        0.0 if solved else motion.force(name).spread.peak for name in names["mesh"]
    ]
    if solved:
        numbers |= {
            name: getattr(response, name) for name in ("load_torque", "ground_reaction")
        }
    return numbers | signals | {"source": "harmonics" if solved else "record"}, spectra


def _signals(
    motion: Motion, names: dict[str, tuple[str, ...]], response: Response | None
) -> tuple[dict[str, Any], dict[str, Spectrum]]:
    """Statistics and spectra of a motion; recorded cycles, without ``response``, have
    amplitudes without phases, and no accelerations.

    A spectrum holds amplitudes and phases ``(elements, K)``, orders ``(K,)``, and the
    amplitude of every other order.
    """
    statistics: dict[str, Any] = {}
    spectra: dict[str, Spectrum] = {}
    for name, (reader, dim, _, _) in SIGNALS.items():
        if not len(names[dim]) or (response is None and name == "acceleration"):
            continue
        signals = [getattr(motion, reader)(label) for label in names[dim]]
        if response is None:
            statistics |= {
                f"{name}_{statistic}": [
                    float(getattr(signal, statistic)) for signal in signals
                ]
                for statistic in STATISTICS
            }
            amplitudes: Array = np.array([signal.amplitudes for signal in signals])
            orders = signals[0].orders
            lacking = np.nan
            phases: Array = np.full(amplitudes.shape, np.nan)
        else:
            stacked = Signal(
                np.stack([signal.coefficients for signal in signals]),
                None,
                signals[0].revolutions_per_cycle,
                signals[0].resolution,
            )
            samples = stacked.samples(stacked.resolution)
            low = samples.min(axis=-1)
            high = samples.max(axis=-1)
            in_order = (
                stacked.mean,
                low,
                high,
                (high - low) / 2,
                stacked.sum_of_amplitudes,
            )
            statistics |= {
                f"{name}_{statistic}": values
                for statistic, values in zip(STATISTICS, in_order, strict=True)
            }
            # Tooth forces have more harmonics than the motion, whose orders the data
            # set lists.
            within = slice(response.harmonics)
            amplitudes = stacked.amplitudes[:, within]
            phases = stacked.phases_deg[:, within]
            orders = stacked.orders[within]
            # An order that is not there has no phase.
            phases = np.where(amplitudes > 0, phases, np.nan)
            lacking = 0.0
        if name in WITH_ORDERS:
            spectra[name] = amplitudes, phases, orders, lacking
    return statistics, spectra


def _spectrum(spectrum: Spectrum | None, count: int, order: np.ndarray) -> np.ndarray:
    """Amplitudes and phases ``(2, count, K)`` at the orders ``(K,)`` of the data set;
    orders that a motion lacks are 0 or nan.
    """
    if spectrum is None:
        return np.full((2, count, len(order)), np.nan)
    amplitudes, phases, motion_orders, lacking = spectrum
    present = np.isin(order, motion_orders)
    places = np.searchsorted(motion_orders, order)
    aligned = np.full((2, count, len(order)), [[[lacking]], [[np.nan]]])
    aligned[:, :, present] = np.asarray([amplitudes, phases])[:, :, places[present]]
    return aligned
