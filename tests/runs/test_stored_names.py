"""Names in results.nc for outputs of any name."""

import netCDF4

from ps_fmu.cosim.rows import Column
from ps_fmu.runs.stored_rows import make_stored_names, rename_columns


def test_names_for_netcdf():
    found = make_stored_names(["a/b", "a_b", "time", " x", "y ", "\t", "e\u0301", "+z", "0"])
    assert found == {
        "a/b": "a_b", "a_b": "a_b_2", "time": "time_2", " x": "_ x", "y ": "y", "\t": "_", "e\u0301": "\u00e9",
        "+z": "_+z", "0": "0",
    }  # fmt: skip


def test_long_names_are_cut_and_told_apart(tmp_path):
    """As of Modelica: netCDF takes 256 bytes; the description has the whole name."""
    names = [f"plant.{'body.frame.' * 40}{end}" for end in ("x", "y")] + ["plant." + "\u00e4" * 300]
    found = make_stored_names(names)
    assert len(set(found.values())) == 3
    with netCDF4.Dataset(tmp_path / "a.nc", "w") as file:
        for name in found.values():
            file.createVariable(name, "f8", ())
    column = rename_columns([Column(names[0], "m", "Real", "Place")])[0]
    assert column.description == f"{names[0]}: Place"
