"""Names in results.nc for outputs of any name."""

from ps_fmu.runs.stored_names import make_stored_names


def test_names_for_netcdf():
    found = make_stored_names(["a/b", "a_b", "time", " x", "y ", "\t", "e\u0301", "+z", "0"])
    assert found == {
        "a/b": "a_b", "a_b": "a_b_2", "time": "time_2", " x": "_ x", "y ": "y", "\t": "_", "e\u0301": "\u00e9",
        "+z": "_+z", "0": "0",
    }  # fmt: skip
