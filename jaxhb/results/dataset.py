"""Motions as labelled arrays of xarray: names, units, and nan where nothing is known. The only importer of xarray."""

from typing import TYPE_CHECKING, Any

import numpy as np

from jaxhb import __version__
from jaxhb.results.signal import Signal
from jaxhb.results.status import Status

if TYPE_CHECKING:
    from xarray import Dataset
else:
    Dataset = Any

SIGNALS = {
    "angle": ("disk", "rad", "vibratory angle"),
    "speed": ("disk", "rad/s", "speed of rotation"),
    "acceleration": ("disk", "rad/s2", "angular acceleration"),
    "torque": ("shaft", "N m", "torque of shafts and dampers"),
    "gear_torque": ("gear", "N m", "torque that a gear passes to its mates"),
    "tooth_force": ("mesh", "N", "tooth force, elastic and damping part"),
}
"""Dimension, unit and meaning of what vibrates."""

STATISTICS = {
    "mean": "mean of the ",
    "min": "smallest ",
    "max": "largest ",
    "half_peak_to_peak": "half peak-to-peak of the ",
    "sum_of_amplitudes": "sum of the amplitudes of all orders of the ",
}

WITH_ORDERS = ("angle", "torque", "gear_torque", "tooth_force")
"""Signals whose amplitudes and phases are given; those of speeds and accelerations follow from the angles."""

OF_ELEMENTS = {
    "irregularity": ("disk", "1", "cyclic irregularity, (largest - smallest speed) / mean speed"),
    "heat": ("shaft", "W", "mean power that a shaft or damper turns into heat"),
    "mesh_heat": ("mesh", "W", "mean power that the damping of a mesh turns into heat"),
    "separated_fraction": ("mesh", "1", "share of the time with the teeth apart"),
    "reverse_contact_fraction": ("mesh", "1", "share of the time on the flank that does not drive"),
    "impacts_per_cycle": ("mesh", "1", "entries into contact in a cycle of the excitation"),
    "hardest_impact": ("mesh", "m/s", "largest approach speed of an impact"),
    "load_torque": ("load", "N m", "mean torque of a load on its disk"),
    "ground_reaction": ("ground", "N m", "mean torque that a ground takes"),
}

OF_MOTIONS = {
    "kind": ("", "contact, periodic, subharmonic, irregular or unknown; solution: of jaxhb.solve"),
    "period": ("1", "period of the motion in cycles of the excitation, 0 where there is none"),
    "source": ("", "what the numbers are read from: harmonics, record, or nothing"),
    "status": ("", "status of the harmonic solution"),
    "harmonics": ("1", "highest harmonic of the motion over its period, 0 without a harmonic solution"),
    "residual": ("1", "residual of the equations"),
    "truncation_error": ("1", "truncation error over the largest tooth force"),
    "load_power": ("W", "power that the loads take"),
}

UNKNOWN = {"kind": "unknown", "source": "nothing", "status": "", "period": 0, "harmonics": 0}
"""Where there is no number."""


def to_xarray(motions, topology, rpm, *, orders=None):
    """The data set of motions of one train, of one or along a dimension ``rpm``.

    Parameters
    ----------
    motions : sequence of Response or SteadyState, each of one speed
    topology : Topology
    rpm : float, or array ``(n,)``
        Without a dimension the data set has none for the one motion.
    orders : float, optional
        Highest order whose amplitudes are given; default: the highest of the motions of disks.

    Returns
    -------
    xarray.Dataset
        See :meth:`jaxhb.Response.to_xarray`.
    """
    try:
        import xarray
    except ImportError:
        raise ImportError('labelled arrays need xarray. Install it: pip install "jaxhb[data]"') from None
    read = [_numbers(motion, topology) for motion in motions]
    listed = [spectra[2] for row in read for spectra in row["spectra"].values()]
    order = np.unique(np.concatenate([own for own in listed if own is not None] or [np.zeros(0)]))
    order = order[: np.searchsorted(order, np.inf if orders is None else orders, side="right")]
    many, dims = np.ndim(rpm) > 0, {"rpm": np.asarray(rpm, dtype=float)} | _names(topology) | {"order": order}
    found, dims = {}, {name: own for name, own in dims.items() if np.size(own)}  # NetCDF has no empty dimension

    def keep(name, rows, own, unit, said):
        if not set(own) <= set(dims):
            return
        values = np.stack(rows) if many else rows[0]
        attributes = {"long_name": said} | ({"units": unit} if unit else {})
        found[name] = ((*(("rpm",) if many else ()), *own), values, attributes)

    for name, (unit, said) in OF_MOTIONS.items():
        keep(name, [np.asarray(row["motion"].get(name, UNKNOWN.get(name, np.nan))) for row in read], (), unit, said)
    for name, (dim, unit, said) in OF_ELEMENTS.items():
        keep(name, [_filled(row["elements"].get(name), len(dims.get(dim, ()))) for row in read], (dim,), unit, said)
    for name, (dim, unit, said) in SIGNALS.items():
        for statistic, words in STATISTICS.items():
            values = [_filled(row["signals"].get((name, statistic)), len(dims.get(dim, ()))) for row in read]
            keep(f"{name}_{statistic}", values, (dim,), unit, words + said)
    for name in WITH_ORDERS:
        dim, unit, said = SIGNALS[name]
        spectra = [_spectrum(row["spectra"].get(name), len(dims.get(dim, ())), order) for row in read]
        keep(f"{name}_amplitude", [a for a, _ in spectra], (dim, "order"), unit, f"one-sided amplitude, {said}")
        keep(f"{name}_phase", [b for _, b in spectra], (dim, "order"), "degree", f"phase of the cosine, {said}")
    units = {"rpm": {"units": "rpm", "long_name": "speed of the reference rotor"}}
    units["order"] = {"units": "1", "long_name": "order, per revolution of the reference rotor"}
    coordinates = {name: ((name,) if many or name != "rpm" else (), v, units.get(name, {})) for name, v in dims.items()}
    about = {"scene": topology.name, "revolutions_per_cycle": float(topology.revolutions_per_cycle)}
    return xarray.Dataset(found, coordinates, about | {"source": f"jaxhb {__version__}"})


def as_netcdf(data):
    """Bytes of a NetCDF file (version 3, which everything reads) of a data set."""
    return bytes(data.to_netcdf(engine="scipy", format="NETCDF3_64BIT"))


def _names(topology):
    gears = dict.fromkeys(topology.disk_names[disk] for ends in topology.mesh_ends for disk in ends)
    names = {
        "disk": topology.disk_names,
        "shaft": topology.shaft_names + topology.damper_names,
        "gear": tuple(gears),
        "mesh": topology.mesh_names,
        "load": topology.load_names,
        "ground": topology.ground_names,
    }
    return {dim: np.array(own, dtype=str) for dim, own in names.items()}


def _numbers(motion, topology):
    """What is known of one motion: by name of itself, of elements, of signals, and spectra."""
    response = getattr(motion, "response", motion)
    solved = response is not None and int(response.status) == Status.CONVERGED
    about = {"kind": getattr(motion, "kind", "solution"), "period": getattr(motion, "period", 1)}
    if response is not None:
        about |= {"status": Status(int(response.status)).name, "harmonics": int(response.highest_harmonic)}
        about |= {name: float(getattr(response, name)) for name in ("residual", "truncation_error", "load_power")}
    nothing = {"motion": about | {"source": "nothing"}, "elements": {}, "signals": {}, "spectra": {}}
    if not solved and getattr(motion, "record", None) is None:
        return nothing
    names = _names(topology)
    signals = _of_response(response, names) if solved else _of_record(motion.record, names, topology)
    contacts = [motion.mesh(name) for name in names["mesh"]]
    elements = {
        name: np.array([getattr(contact, name) for contact in contacts], dtype=float)
        for name in ("separated_fraction", "reverse_contact_fraction")
    }
    elements |= {name: np.array(values, dtype=float) for name, values in zip(*_impacts(contacts, motion), strict=True)}
    elements["irregularity"] = np.array([float(motion.irregularity(name)) for name in names["disk"]])
    for heat, dim in (("heat", "shaft"), ("mesh_heat", "mesh")):
        elements[heat] = np.array([float(motion.power(name)) for name in names[dim]])
    if solved:
        elements |= {"load_torque": np.asarray(response.load_torque)}
        elements |= {"ground_reaction": np.asarray(response.ground_reaction)}
    statistics = {(n, what): values for n, own in signals.items() for what, values in own["statistics"].items()}
    spectra = {name: own["spectrum"] for name, own in signals.items() if name in WITH_ORDERS}
    about["source"] = "harmonics" if solved else "record"
    return {"motion": about, "elements": elements, "signals": statistics, "spectra": spectra}


def _impacts(contacts, motion):
    """Numbers of impacts a cycle and the hardest of them, by name."""
    if contacts and hasattr(contacts[0], "impacts"):  # of a solution: impact by impact
        speeds = [[impact["speed"] for impact in contact.impacts] for contact in contacts]
        period = max(getattr(motion, "period", 1), 1)
        told = [len(own) / period for own in speeds], [max(own, default=0.0) for own in speeds]
    else:
        told = [c.impacts_per_cycle for c in contacts], [c.hardest_impact for c in contacts]
    return ("impacts_per_cycle", "hardest_impact"), told


def _of_response(response, names):
    """Statistics and spectra of a harmonic solution by signal."""
    by_disk = {name: [getattr(response, name)(disk) for disk in names["disk"]] for name in ("speed", "acceleration")}
    gears = [response.gear_torque(gear).coefficients for gear in names["gear"]]
    coefficients = {
        "angle": response.angles,
        "torque": response.torques,
        "gear_torque": np.stack(gears) if gears else np.zeros((0, response.angles.shape[-1])),
        "tooth_force": response.forces,
    } | {name: np.array([signal.coefficients for signal in own]) for name, own in by_disk.items()}
    turns, moving = response.topology.revolutions_per_cycle, response.angles.shape[-1]
    found = {}
    for name, values in coefficients.items():
        signal = Signal(np.asarray(values), None, turns, response.resolution)
        samples = signal.samples(signal.resolution) if len(values) else np.zeros((0, 1))
        low, high = samples.min(axis=-1), samples.max(axis=-1)
        statistics = {"mean": signal.mean, "min": low, "max": high, "half_peak_to_peak": (high - low) / 2}
        # Tooth forces have more harmonics than the motion, whose orders the data set lists.
        kept = Signal(signal.coefficients[:, :moving], None, turns, response.resolution)
        found[name] = {
            "statistics": statistics | {"sum_of_amplitudes": signal.sum_of_amplitudes},
            # An order that is not there has no phase.
            "spectrum": (kept.amplitudes, np.where(kept.amplitudes > 0, kept.phases_deg, np.nan), kept.orders, 0.0),
        }
    return found


def _of_record(record, names, topology):
    """The same of recorded cycles, which have amplitudes without phases, and no accelerations."""
    gears = [record.gears[topology.disk_index(gear)] for gear in names["gear"]]
    rows = {
        "angle": record.disks,
        "speed": record.speeds,
        "torque": record.torques,
        "gear_torque": gears,
        "tooth_force": record.forces,
    }
    found = {}
    for name, own in rows.items():
        statistics = {what: np.array([float(getattr(signal, what)) for signal in own]) for what in STATISTICS}
        spectrum = None
        if own:
            amplitudes = np.array([signal.amplitudes for signal in own])
            spectrum = amplitudes, np.full(amplitudes.shape, np.nan), own[0].orders, np.nan
        found[name] = {"statistics": statistics, "spectrum": spectrum or (None, None, None, np.nan)}
    return found


def _filled(values, count):
    return np.full(count, np.nan) if values is None else np.asarray(values, dtype=float)


def _spectrum(spectrum, count, order):
    """Amplitudes and phases ``(count, K)`` at the orders of the data set; orders that a motion lacks are 0 or nan."""
    amplitudes, phases, own, beyond = spectrum or (None, None, None, np.nan)
    if own is None:
        return np.full((count, len(order)), np.nan), np.full((count, len(order)), np.nan)
    there, places = np.isin(order, own), np.searchsorted(own, order)
    found = np.full((2, count, len(order)), [[[beyond]], [[np.nan]]])
    found[:, :, there] = np.asarray([amplitudes, phases])[:, :, places[there]]
    return found[0], found[1]
