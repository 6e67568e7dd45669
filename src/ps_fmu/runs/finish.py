"""The end of results.nc: its rows are compressed.

It is written beside the old one and takes its place in one go, so whoever interrupts it loses nothing: the rows are as
the recorder left them.  While a run goes on they are not compressed, see :mod:`ps_fmu.cosim.recording.recorder`.
"""

from __future__ import annotations

import shutil
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cosim.recording.columns_on_disk import iterate_blocks, read_chunk_rows, read_rows, write_rows
from ..reduction.columns import NETCDF_LOCK

LEVEL = 1  # of zlib, with shuffled bytes: 4 takes a sixth longer, for files 0.3 % smaller
WORTH = 0.6  # compressed over plain size up to which it is done
_SAMPLE_ROWS = 1000
_BLOCK_ROWS = 160_000


def finish_file(path: Path) -> None:
    """Compress a results.nc, if there is one.

    Columns are compressed where that halves them, or nearly so: those that are constant or slow, half of the default
    system's.  What is left is noise, which would shrink by a fifth and take four times as long.

    Raises OSError if it cannot be written; the file is there then, as the runs left it.
    """
    import netCDF4

    if not path.is_file():
        return
    size, free = path.stat().st_size, shutil.disk_usage(path.parent).free
    if size > free:
        raise OSError(f"{path}: stays as it is: {size / 1e6:.1f} MB needed to compress it, {free / 1e6:.1f} MB free")
    beside = path.with_name(f".{path.name}.part")
    try:
        beside.unlink(missing_ok=True)
        with NETCDF_LOCK, netCDF4.Dataset(path) as old, netCDF4.Dataset(beside, "w", format="NETCDF4") as new:
            _copy_group(old, new)
        beside.replace(path)
    except RuntimeError as error:  # of HDF5
        raise OSError(f"{path}: stays as it is, and cannot be compressed: {error}") from error
    finally:
        beside.unlink(missing_ok=True)


def _copy_group(old: Any, new: Any) -> None:
    """Attributes, dimensions, variables and groups; columns of rows are compressed where it is worth it.

    All is defined before the first value is written: HDF5 flushes all there is at a value that follows a definition,
    which took 0.25 s of 0.67 s for two runs of 1 s.
    """
    for variable, copied, rows in _define_group(old, new):
        if rows is None:
            copied[...] = np.asarray(variable[...], dtype=object if variable.dtype is str else None)
            continue
        for first, last in iterate_blocks(rows, read_chunk_rows(variable), _BLOCK_ROWS):
            write_rows(copied, first, read_rows(variable, first, last))


def _define_group(old: Any, new: Any) -> list[tuple[Any, Any, int | None]]:
    """As :func:`_copy_group`, without values; returns each variable, that which takes its values, and its rows if it
    has any.
    """
    pairs: list[tuple[Any, Any, int | None]] = []
    count = len(old.dimensions["time"]) if "time" in old.dimensions else 0
    new.setncatts({name: old.getncattr(name) for name in old.ncattrs()})
    for dimension in old.dimensions.values():
        new.createDimension(dimension.name, None if dimension.isunlimited() else len(dimension))
    for variable in old.variables.values():
        variable.set_auto_maskandscale(False)
        rows = variable.dimensions == ("time",)
        kept = _keep_rows(variable, count) if rows else {}
        copied = new.createVariable(variable.name, variable.dtype, variable.dimensions, **kept)
        for one in (variable, copied) if rows else ():  # by default up to 64 MB of each variable stay in memory
            one.set_var_chunk_cache(size=2 * read_chunk_rows(one) * 8, nelems=7)
        copied.set_auto_maskandscale(False)
        copied.setncatts({name: variable.getncattr(name) for name in variable.ncattrs()})
        pairs.append((variable, copied, count if rows else None))
    for name, group in old.groups.items():
        pairs += _define_group(group, new.createGroup(name))
    return pairs


def _keep_rows(variable: Any, count: int) -> dict[str, Any]:
    """How a column of ``count`` rows is stored: chunks as they are, but no longer than it is, compressed or not."""
    chunks = {"chunksizes": (max(1, min(read_chunk_rows(variable), count)),)}
    if count <= 3 * _SAMPLE_ROWS:
        sample = read_rows(variable, 0, count)
    else:
        starts = (0, count // 2, count - _SAMPLE_ROWS)
        sample = np.concatenate([read_rows(variable, first, first + _SAMPLE_ROWS) for first in starts])
    if not len(sample) or _compress(sample) > WORTH:
        return chunks
    return {**chunks, "zlib": True, "complevel": LEVEL, "shuffle": True}


def _compress(values: NDArray[Any]) -> float:
    """Compressed over plain size."""
    shuffled = np.ascontiguousarray(values.view(np.uint8).reshape(-1, values.itemsize).T)
    return len(zlib.compress(shuffled.tobytes(), LEVEL)) / shuffled.size
