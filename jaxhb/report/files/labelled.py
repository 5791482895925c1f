"""Answers as labelled arrays for NetCDF files: the motions, beside them the same without backlash."""

import numpy as np

from jaxhb.excitation.torques import listed_harmonic
from jaxhb.report.quantities import WITHOUT
from jaxhb.results.dataset import as_netcdf, to_xarray

COMPARED = ("torque", "gear_torque", "tooth_force")  # signals that are given without backlash too


DIMENSIONS = {"direction": "in which the sweep went", "case": "normal running, and with misfires"}
"""What several lists of answers are called in a file."""


def netcdf(found, orders, *, along=None, every=False):
    """The NetCDF file of answers: lists of them by name in ``found``, of trains with the same elements. ``along`` is
    the dimension of names, None of one list; ``orders`` the highest whose amplitudes are given, None: the highest of
    the excitation, or with ``every`` of the motions."""
    import xarray

    data = _labelled([answer for answers in found.values() for answer in answers], orders, every)
    if along is None:
        return [as_netcdf(data)]
    dim, ends = "value" if "value" in data.dims else "rpm", np.cumsum([0, *map(len, found.values())])
    sets = [data.isel({dim: slice(*ends[i : i + 2])}) for i in range(len(found))]
    names = xarray.Variable(along, list(found), {"long_name": DIMENSIONS[along]})
    return [as_netcdf(xarray.concat(sets, names, join="outer", combine_attrs="override"))]


def _labelled(answers, orders, every):
    topology, axis = answers[0].topology, answers[0].axis
    if orders is None and not every:
        orders = listed_harmonic(topology) / topology.revolutions_per_cycle
    data = to_xarray([answer.state for answer in answers], topology, [answer.rpm for answer in answers], orders=orders)
    data.attrs |= {"motions": "periodic solutions" if answers[0].orbit else "steady states"}
    flags, about = {None: -1, False: 0, True: 1}, {"long_name": "whether disturbances die away"}
    about |= {"flag_values": list(flags.values()), "flag_meanings": "not_known unstable stable"}
    data["stable"] = ("rpm", [flags[answer.stable] for answer in answers], about)
    about = {"units": "1", "long_name": "modulus over the period"}
    data["largest_multiplier"] = ("rpm", np.array([answer.multiplier for answer in answers], dtype=float), about)
    if any(topology.mesh_backlash):
        linear = to_xarray([answer.linear for answer in answers], topology, data.rpm.values, orders=0)
        names = [name for name in linear if str(name).startswith(tuple(f"{n}_" for n in COMPARED))]
        data = data.merge(linear[names].rename({name: f"{name}{WITHOUT}" for name in names}))
    if answers[0].value is not None:
        data = data.rename(rpm="value").assign_coords(value=[answer.place for answer in answers])
        data.value.attrs |= {"units": axis.unit, "long_name": axis.name}
        data.attrs |= {"rpm": answers[0].rpm}
    return data
