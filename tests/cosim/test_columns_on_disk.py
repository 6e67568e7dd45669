"""Rows of a netCDF variable: written and read in blocks of whole chunks."""

import netCDF4
import numpy as np
import pytest

from ps_fmu.cosim.recording.columns_on_disk import iterate_blocks, read_chunk_rows, read_rows, write_rows


@pytest.mark.parametrize("fast", [True, False])
def test_rows_on_disk_are_written_and_read_whatever_netcdf4_offers(tmp_path, fast):
    """Without the methods that netCDF4 does not document, by the documented way."""

    class Documented:
        def __init__(self, variable):
            self.variable, self.dtype = variable, variable.dtype

        def __setitem__(self, part, values):
            self.variable[part] = values

        def __getitem__(self, part):
            return self.variable[part]

    with netCDF4.Dataset(tmp_path / "rows.nc", "w") as file:
        file.createDimension("time", None)
        for kind in ("f8", "i4", "i1"):
            variable = file.createVariable(kind, kind, ("time",))
            one = variable if fast else Documented(variable)
            write_rows(one, 0, np.arange(3.0))
            write_rows(one, 3, np.arange(8.0)[::2])
            write_rows(one, 7, np.empty(0))
            np.testing.assert_array_equal(variable[:], [0, 1, 2, 0, 2, 4, 6])
            found = read_rows(one, 1, 5)
            assert found.dtype == variable.dtype
            np.testing.assert_array_equal(found, [1, 2, 0, 2])
            assert read_rows(one, 2, 2).size == 0


@pytest.mark.parametrize(
    ("rows", "chunk", "size"),
    [(0, 100, None), (25_000, 1, 10_000), (25_000, 4000, 8000), (25_000, 9500, 9500), (25_000, 14_999, 14_999),
     (2_500_000, 10**9, 10**6)],
)  # fmt: skip
def test_blocks_are_whole_chunks(rows, chunk, size):
    blocks = list(iterate_blocks(rows, chunk))
    assert [first for first, _ in blocks] == (list(range(0, rows, size)) if rows else [])
    assert [last for _, last in blocks] == [min(first + size, rows) for first, _ in blocks]


def test_chunks_of_a_file_are_told(tmp_path):
    path = tmp_path / "results.nc"
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", 5000)
        for name, options in (("one", {"contiguous": True}), ("many", {"chunksizes": (700,)})):
            data.createVariable(name, "f8", ("time",), **options)[:] = np.arange(5000.0)
    with netCDF4.Dataset(path) as data:
        assert [read_chunk_rows(data[name]) for name in ("one", "many")] == [1, 700]
