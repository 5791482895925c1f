"""Motions as labelled arrays of xarray: names, units, and nan where nothing is known.
The only importer of xarray.
"""

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
"""How what vibrates is read of a motion, its dimension, unit and meaning."""

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
"""Where there is no number."""


def to_xarray(motions, topology, rpm, *, orders=None):
    """The data set (:meth:`jaxhb.Response.to_xarray`) of Responses or SteadyStates of
    one train, along ``rpm`` ``(n,)`` or of one at a number; ``orders`` by default up to
    the highest of the motions of disks.
    """
    try:
        import xarray
    except ImportError:
        raise ImportError(
            'labelled arrays need xarray. Install it: pip install "jaxhb[data]"'
        ) from None
    read = [_numbers(motion, topology) for motion in motions]
    listed = [own for _, spectra in read for _, _, own, _ in spectra.values()]
    order = np.unique(np.concatenate(listed or [np.zeros(0)]))
    order = order[
        : np.searchsorted(order, np.inf if orders is None else orders, side="right")
    ]
    names = {dim: np.array(own, dtype=str) for dim, own in names_of(topology).items()}
    dims = {"rpm": np.asarray(rpm, dtype=float)} | names | {"order": order}
    dims = {
        name: own for name, own in dims.items() if np.size(own)
    }  # NetCDF has no empty dimension
    many, found = np.ndim(rpm) > 0, {}

    def keep(name, rows, own, unit, said):
        values = np.stack(rows) if many else rows[0]
        attributes = {"long_name": said} | ({"units": unit} if unit else {})
        found[name] = ((*(("rpm",) if many else ()), *own), values, attributes)

    for name, (unit, said) in OF_MOTIONS.items():
        keep(
            name,
            [
                np.asarray(values.get(name, UNKNOWN.get(name, np.nan)))
                for values, _ in read
            ],
            (),
            unit,
            said,
        )
    of_elements = OF_ELEMENTS | {
        f"{name}_{statistic}": (dim, unit, words + said)
        for name, (_, dim, unit, said) in SIGNALS.items()
        for statistic, words in STATISTICS.items()
    }
    for name, (dim, unit, said) in of_elements.items():
        if dim in dims:
            nothing = np.full(len(dims[dim]), np.nan)
            rows = [
                np.asarray(values.get(name, nothing), dtype=float) for values, _ in read
            ]
            keep(name, rows, (dim,), unit, said)
    for name in WITH_ORDERS:
        _, dim, unit, said = SIGNALS[name]
        if dim in dims and "order" in dims:
            spectra = [
                _spectrum(spectra.get(name), len(dims[dim]), order)
                for _, spectra in read
            ]
            keep(
                f"{name}_amplitude",
                [a for a, _ in spectra],
                (dim, "order"),
                unit,
                f"one-sided amplitude, {said}",
            )
            keep(
                f"{name}_phase",
                [b for _, b in spectra],
                (dim, "order"),
                "degree",
                f"phase of the cosine, {said}",
            )
    units = {"rpm": {"units": "rpm", "long_name": "speed of the reference rotor"}}
    units["order"] = {
        "units": "1",
        "long_name": "order, per revolution of the reference rotor",
    }
    coordinates = {
        name: ((name,) if many or name != "rpm" else (), v, units.get(name, {}))
        for name, v in dims.items()
    }
    about = {
        "scene": topology.name,
        "revolutions_per_cycle": float(topology.revolutions_per_cycle),
    }
    return xarray.Dataset(
        found, coordinates, about | {"source": f"jaxhb {__version__}"}
    )


def as_netcdf(data):
    """Bytes of a NetCDF file (version 3, which everything reads) of a data set."""
    return bytes(data.to_netcdf(engine="scipy", format="NETCDF3_64BIT"))


def names_of(topology):
    """Names of the elements of every dimension."""
    return {
        "disk": topology.disk_names,
        "shaft": topology.shaft_and_damper_names,
        "gear": topology.gear_names,
        "mesh": topology.mesh_names,
        "load": topology.load_names,
        "ground": topology.ground_names,
    }


def _numbers(motion, topology):
    """What is known of one motion: numbers by name of the variable, and spectra by name
    of the signal.
    """
    response = motion.solution
    solved = response is not None and bool(response.converged)
    alone = motion is response  # of jaxhb.solve
    found = (
        {"kind": "solution", "period": 1}
        if alone
        else {"kind": motion.kind, "period": motion.period}
    )
    if response is not None:
        found |= {
            "status": Status(int(response.status)).name,
            "harmonics": int(response.highest_harmonic),
        }
        found |= {
            name: float(getattr(response, name))
            for name in ("residual", "truncation_error", "load_power")
        }
    if not solved and (alone or motion.record is None):
        return found | {"source": "nothing"}, {}
    names = names_of(topology)
    signals, spectra = _signals(motion, names, response if solved else None)
    contacts = [motion.mesh(name) for name in names["mesh"]]
    for name in CONTACT:
        found[name] = [getattr(contact, name) for contact in contacts]
    found["irregularity"] = [float(motion.irregularity(name)) for name in names["disk"]]
    for heat, dim in (("heat", "shaft"), ("mesh_heat", "mesh")):
        found[heat] = [float(motion.power(name)) for name in names[dim]]
    found["tooth_force_spread"] = [
        0.0 if solved else motion.force(name).spread.peak for name in names["mesh"]
    ]
    if solved:
        found |= {
            name: getattr(response, name) for name in ("load_torque", "ground_reaction")
        }
    return found | signals | {"source": "harmonics" if solved else "record"}, spectra


def _signals(motion, names, response):
    """Statistics and spectra of a motion; recorded cycles, without ``response``, have
    amplitudes without phases, and no accelerations.
    """
    statistics = {}
    spectra = {}
    for name, (reader, dim, _, _) in SIGNALS.items():
        if not len(names[dim]) or (response is None and name == "acceleration"):
            continue
        own = [getattr(motion, reader)(label) for label in names[dim]]
        if response is None:
            statistics |= {
                f"{name}_{what}": [float(getattr(signal, what)) for signal in own]
                for what in STATISTICS
            }
            amplitudes = np.array([signal.amplitudes for signal in own])
            orders = own[0].orders
            lacking = np.nan
            phases = np.full(amplitudes.shape, np.nan)
        else:
            every = Signal(
                np.stack([s.coefficients for s in own]),
                None,
                own[0].revolutions_per_cycle,
                own[0].resolution,
            )
            samples = every.samples(every.resolution)
            low = samples.min(axis=-1)
            high = samples.max(axis=-1)
            found = every.mean, low, high, (high - low) / 2, every.sum_of_amplitudes
            statistics |= {
                f"{name}_{what}": values
                for what, values in zip(STATISTICS, found, strict=True)
            }
            # Tooth forces have more harmonics than the motion, whose orders the data
            # set lists.
            within = slice(response.harmonics)
            amplitudes = every.amplitudes[:, within]
            phases = every.phases_deg[:, within]
            orders = every.orders[within]
            # An order that is not there has no phase.
            phases = np.where(amplitudes > 0, phases, np.nan)
            lacking = 0.0
        if name in WITH_ORDERS:
            spectra[name] = amplitudes, phases, orders, lacking
    return statistics, spectra


def _spectrum(spectrum, count, order):
    """Amplitudes and phases ``(count, K)`` at the orders of the data set; orders that a
    motion lacks are 0 or nan.
    """
    if spectrum is None:
        return np.full((2, count, len(order)), np.nan)
    amplitudes, phases, own, beyond = spectrum
    there = np.isin(order, own)
    places = np.searchsorted(own, order)
    found = np.full((2, count, len(order)), [[[beyond]], [[np.nan]]])
    found[:, :, there] = np.asarray([amplitudes, phases])[:, :, places[there]]
    return found
