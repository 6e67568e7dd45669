"""results.nc as xarray datasets: names, components, units."""


import netCDF4
import numpy as np
import pytest

from ps_fmu.cosim import Column, Recorder
from ps_fmu.results.datasets import group_components, list_cases, read_case, shorten

COLUMNS = (
    Column("plant.rotation.x", "rad", "Real", "Rotation of P, in P, x"),
    Column("plant.rotation.y", "rad", "Real", "Rotation of P, in P, y"),
    Column("plant.rotation.z", "rad", "Real", "Rotation of P, in P, z"),
    Column("plant.force_1", "N", "Real", "Force of a leg, 1"),
    Column("plant.force_2", "N", "Real", "Force of a leg, 2"),
    Column("plant.force_3", "N", "Real", "Force of a leg, 3"),
    Column("plant.mass", "kg", "Real", "Mass, of all"),
    Column("sensors.mass", "kg", "Real", "Mass"),
    Column("sensors.axis", "1", "Real", "A name that a dimension has"),
    Column("sensors.value_1", "m", "Real", "One of another unit"),
    Column("sensors.value_2", "s", "Real", "than the other"),
    Column("sensors.alone_1", "m", "Real", "One, 1"),
    Column("sensors.inertia.xx", "kg.m2", "Real", "xx, in B, xx"),
    Column("sensors.inertia.yy", "kg.m2", "Real", "other words, yy"),
    Column("sensors.locked", "", "Boolean", "It is locked"),
)
STEP = 0.5


@pytest.fixture
def file(tmp_path):
    """Three rows of two cases; each value is its row times 100 plus its column, a Boolean that of an odd row."""
    path = tmp_path / "results.nc"
    time = np.arange(3) * STEP
    values = np.arange(3)[:, None] * 100.0 + np.arange(len(COLUMNS))
    values[:, -1] = [0, 1, 0]
    for number, case in enumerate(("passive", "active")):
        attributes = {"scenario": "isolation", "step_s": STEP}
        with Recorder(path, case, columns=COLUMNS, step=STEP, attributes=attributes, append=number > 0) as recorder:
            recorder.block(0, time, values + 1000.0 * number * (np.arange(len(COLUMNS)) < len(COLUMNS) - 1))
    return path


def test_cases_are_listed_in_their_order(file):
    assert list_cases(file) == ["passive", "active"]


def test_vectors_have_their_components_side_by_side(file):
    data = read_case(file, "passive")
    np.testing.assert_array_equal(data["time"], [0.0, 0.5, 1.0])
    rotation = data["rotation"]
    assert rotation.dims == ("time", "axis")
    np.testing.assert_array_equal(rotation, [[0, 1, 2], [100, 101, 102], [200, 201, 202]])
    np.testing.assert_array_equal(rotation.sel(axis="y", time=0.5), 101)
    np.testing.assert_array_equal(data["force"].sel(number=3), [5, 105, 205])
    np.testing.assert_array_equal(data["inertia"].sel(inertia_component="yy"), [13, 113, 213])
    np.testing.assert_array_equal(read_case(file, "active")["rotation"].sel(axis="z"), [1002, 1102, 1202])


def test_units_and_names_are_attributes(file):
    data = read_case(file, "passive")
    assert data["rotation"].attrs == {"units": "rad", "long_name": "Rotation of P, in P"}
    assert data["plant.mass"].attrs["long_name"] == "Mass, of all"
    assert data["inertia"].attrs == {"units": "kg.m2", "long_name": "xx, in B, xx"}  # not the same words
    assert data["time"].attrs == {"units": "s", "long_name": "simulated time", "axis": "T"}
    assert data.attrs == {"Conventions": "CF-1.11", "scenario": "isolation", "step_s": STEP}


def test_names_are_short_where_they_are_the_only_ones(file):
    data = read_case(file, "passive")
    assert {"plant.mass", "sensors.mass", "sensors.axis", "locked", "alone_1"} < set(data.data_vars)
    assert "mass" not in data
    assert list(data["axis"].values) == ["x", "y", "z"]


def test_what_has_different_units_is_no_vector(file):
    data = read_case(file, "passive")
    assert (data["value_1"].attrs["units"], data["value_2"].attrs["units"]) == ("m", "s")


def test_booleans_are_of_that_type(file):
    locked = read_case(file, "passive")["locked"]
    assert locked.dtype == bool
    assert locked.values.tolist() == [False, True, False]


def test_a_case_that_is_not_there_is_named_with_those_that_are(file):
    with pytest.raises(KeyError, match="no run 'idle'; there are passive, active"):
        read_case(file, "idle")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(OSError, match=r"results\.nc"):
        read_case(tmp_path / "results.nc", "passive")


def test_a_vector_needs_two_components_and_a_name_of_its_own():
    kinds = {"a.b_1": "m", "a.c": "m", "a.c_1": "m", "a.c_2": "m", "a_1": "m", "a_2": "m"}
    kinds |= {"a.t.hot": "K", "a.t.cold": "K", "a.cell_2": "V", "a.cell_7": "V"}
    assert group_components(kinds) == {name: {name: ""} for name in kinds}


def test_no_two_variables_get_the_same_name():
    names = ["a.x", "b.x", "a.y", "c.time", "d.number"]
    assert shorten(names) == {"a.x": "a.x", "b.x": "b.x", "a.y": "y", "c.time": "c.time", "d.number": "d.number"}


def test_every_number_of_the_file_is_in_the_dataset(file):
    data = read_case(file, "active")
    with netCDF4.Dataset(file) as stored:
        assert sum(variable.size for variable in data.data_vars.values()) == 3 * (len(stored["active"].variables) - 1)
