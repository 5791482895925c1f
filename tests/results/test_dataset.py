"""Labelled arrays: the numbers under names with units, nan where nothing converged, and
back from a file.
"""

import io

import numpy as np
import pytest

import jaxhb
from jaxhb.report.files.formats import FORMATS

xarray = pytest.importorskip("xarray")


def _netcdf(data):
    """The bytes of a data set as a file."""
    return b"".join(FORMATS["netcdf"].write("", data))


MESH = "gear a|gear b"
LIGHTER = {"drive.mean": 12.5, "brake.mean": -12.5}
"""Mean torques in N m with which the pair never repeats at 6000 rpm."""


@pytest.fixture(scope="module")
def pair():
    return jaxhb.load_scene("spur_pair")


@pytest.fixture(scope="module")
def sweep(pair):
    """A speed in contact and a speed at which the teeth hammer."""
    return jaxhb.steady_state(pair, rpm=[2000.0, 5000.0])


def test_the_numbers_equal_those_read_by_name(sweep):
    data = sweep.to_xarray()
    state = sweep[1]
    hammering = data.sel(rpm=5000.0)
    assert data.kind.values.tolist() == ["contact", "periodic"]
    assert hammering.status.item() == "CONVERGED"
    force = state.force(MESH)
    for name in ("mean", "min", "max", "half_peak_to_peak", "sum_of_amplitudes"):
        assert hammering[f"tooth_force_{name}"].sel(mesh=MESH).item() == pytest.approx(
            float(getattr(force, name)), rel=1e-12
        )
    amplitudes = hammering.tooth_force_amplitude.sel(mesh=MESH)
    assert amplitudes.sel(order=64).item() == pytest.approx(
        float(force.order(64.0)), rel=1e-12
    )
    assert hammering.gear_torque_max.sel(gear="gear b").item() == float(
        state.gear_torque("gear b").max
    )
    assert hammering.irregularity.sel(disk="gear a").item() == state.irregularity(
        "gear a"
    )
    assert hammering.mesh_heat.sel(mesh=MESH).item() == state.power(MESH)
    contact = state.mesh(MESH)
    assert hammering.separated_fraction.item() == contact.separated_fraction
    assert hammering.hardest_impact.item() == contact.hardest_impact > 0
    assert data.tooth_force_max.attrs["units"] == "N"
    assert data.order.attrs["units"] == "1"


def test_orders_that_a_motion_does_not_have_are_zero_without_a_phase(sweep):
    low = sweep.to_xarray().sel(rpm=2000.0, mesh=MESH)
    assert (low.tooth_force_amplitude.sel(order=slice(33, None)) < 1e-9).all()
    assert (low.tooth_force_amplitude.sel(order=slice(65, None)) == 0).sum() > 20
    assert np.isnan(low.tooth_force_phase).sum() > 20
    assert sweep.to_xarray(orders=64.0).order.values.tolist() == [32.0, 64.0]


def test_a_response_and_a_sweep_of_responses_have_the_same_labels(pair, sweep):
    solved = jaxhb.solve(pair, rpm=5000.0).to_xarray()
    linear = jaxhb.linear_response(pair, rpm=2000.0).to_xarray()
    labels = set(solved)
    assert labels == set(linear) == set(sweep.to_xarray()) == set(sweep[0].to_xarray())
    assert solved.rpm.item() == 5000.0
    assert "rpm" not in solved.tooth_force_max.dims
    assert solved.tooth_force_max.item() == pytest.approx(
        sweep[1].force(MESH).max, rel=1e-2
    )


@pytest.mark.slow
def test_numbers_that_did_not_converge_are_nan_and_the_status_says_why(pair):
    data = jaxhb.solve(pair, rpm=5000.0, harmonics=16, tolerance=1e-12).to_xarray()
    assert data.status.item() == "TOLERANCE_NOT_MET"
    assert data.source.item() == "nothing"
    beginnings = ("tooth", "gear", "angle", "speed", "mesh", "irreg", "separ")
    numbers = [name for name in data if name.startswith(beginnings)]
    assert len(numbers) > 20
    assert all(np.isnan(data[name]).all() for name in numbers)


@pytest.mark.slow
def test_an_irregular_motion_has_the_extremes_of_its_record_and_no_phases(pair):
    light = pair.replace(LIGHTER)
    state = jaxhb.steady_state(light, rpm=6000.0)
    data = state.to_xarray()
    assert data.kind.item() == "irregular"
    assert data.source.item() == "record"
    assert data.status.item() == ""
    assert data.tooth_force_max.item() == float(state.force(MESH).max)
    assert np.isnan(data.tooth_force_phase).all()
    assert np.isnan(data.acceleration_max).all()
    assert data.speed_max.sel(disk="gear a").item() == float(state.speed("gear a").max)
    assert data.tooth_force_amplitude.sel(order=32).item() == float(
        state.force(MESH).order(32.0)
    )


def test_a_netcdf_file_gives_the_arrays_back(sweep, tmp_path):
    data = sweep.to_xarray()
    file = tmp_path / "sweep.nc"
    file.write_bytes(_netcdf(data))
    with xarray.open_dataset(file, engine="scipy") as restored:
        assert restored.kind.values.tolist() == ["contact", "periodic"]
        np.testing.assert_array_equal(restored.tooth_force_max, data.tooth_force_max)
        assert restored.tooth_force_max.attrs["units"] == "N"
        assert (
            restored.sel(mesh=MESH, rpm=5000.0).tooth_force_max.item()
            == sweep[1].force(MESH).max
        )
    assert isinstance(_netcdf(sweep[0].to_xarray()), bytes)
    single = xarray.open_dataset(io.BytesIO(_netcdf(sweep[0].to_xarray())))
    assert single.rpm.item() == 2000.0


def test_without_xarray_the_sentence_names_the_extra(sweep, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "xarray", None)
    with pytest.raises(ImportError, match=r'pip install "jaxhb\[data\]"'):
        sweep.to_xarray()
