"""The end of results.nc: the indices of all runs as tables in its root, and the rows compressed.

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
from .index_record import CONFIDENCE, PROBABILITIES, VECTORS, CaseIndices, IndexLog
from .origin import write_texts
from .results_file import ResultsFile

Array = NDArray[np.float64]

LEVEL = 1  # of zlib, with shuffled bytes: 4 takes a sixth longer, for files 0.3 % smaller
WORTH = 0.6  # compressed over plain size up to which it is done
_SAMPLE_ROWS = 1000
_BLOCK_ROWS = 160_000
_SYMBOLS = ("APE", "MPE", "RPE", "PDE")
_LABELS = {"axis": ("x", "y", "z"), "axis_xy": ("x", "y")}


def finish_file(path: Path, indices: IndexLog, results: ResultsFile | None = None) -> None:
    """Add the tables of the indices to a results.nc and compress it, if there is one.

    Columns are compressed where that halves them, or nearly so: those that are constant or slow, half of the default
    system's.  What is left is noise, which would shrink by a fifth and take four times as long.  ``results`` may
    have it open, and is closed if all goes well.

    Raises OSError if it cannot be written; the file is there then, as the runs left it.
    """
    import netCDF4

    results = results or ResultsFile()
    if not path.is_file():
        return
    size, free = path.stat().st_size, shutil.disk_usage(path.parent).free
    if size > free:
        raise OSError(f"{path}: stays as it is: {size / 1e6:.1f} MB needed to compress it, {free / 1e6:.1f} MB free")
    beside = path.with_name(f".{path.name}.part")
    try:
        beside.unlink(missing_ok=True)
        with NETCDF_LOCK, results.read(path) as old, netCDF4.Dataset(beside, "w", format="NETCDF4") as new:
            _copy_group(old, new)
            _write_tables(new, indices)
        results.close()
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


def _write_tables(file: Any, indices: IndexLog) -> None:
    """Bias, RMS, peak, quantiles and their bounds, by run, index and axis; NaN: the run is too short for the index."""
    cases = list(indices)
    if not cases:
        return
    write_texts(file, "case", cases, "run: the group with its rows")
    write_texts(file, "index", list(_SYMBOLS), "pointing error index of ECSS-E-ST-60-10C")
    file.createDimension("probability", len(PROBABILITIES))
    probability = file.createVariable("probability", "f8", ("probability",))
    probability.setncatts({"long_name": "share of the time", "units": "1"})
    probability[:] = PROBABILITIES
    for dimension, labels in _LABELS.items():
        write_texts(file, dimension, list(labels), "axis")
    for vector, (dimension, names) in VECTORS.items():
        found = [indices.of(case) for case in cases]
        if all(name in found[0].names for name in names):
            _write_vector(file, vector, dimension, names, found)


def _write_vector(file: Any, vector: str, dimension: str, names: tuple[str, ...], found: list[CaseIndices]) -> None:
    places = [found[0].names.index(name) for name in names]
    unit = found[0].units[places[0]]
    shape = (len(found), len(_SYMBOLS), len(names))
    plain: dict[str, Array] = {name: np.full(shape, np.nan) for name in ("bias", "rms", "peak")}
    stated: dict[str, Array] = {name: np.full((*shape, len(PROBABILITIES)), np.nan) for name in ("value", "bound")}
    for row, indices in enumerate(found):
        for column, symbol in enumerate(_SYMBOLS):
            if (one := indices.of(symbol)) is None:
                continue
            for name in plain:
                plain[name][row, column] = getattr(one, name)[places]
            for name in stated:
                stated[name][row, column] = [[getattr(each, name) for each in one.quantiles[k]] for k in places]
    about = {
        "bias": "mean",
        "rms": "root of the mean square",
        "peak": "largest magnitude",
        "value": "quantile of the magnitude over the time of the run",
        "bound": f"what the quantile stays below with {100.0 * CONFIDENCE:g} % confidence; infinite: run too short",
    }
    for name, values in {**plain, **stated}.items():
        dimensions = ("case", "index", dimension, *(["probability"] if name in stated else []))
        written = file.createVariable(f"{vector}_{'quantile' if name == 'value' else name}", "f8", dimensions)
        written.setncatts({"long_name": f"{names[0].rpartition('.')[0]}: {about[name]}", "units": unit})
        written[:] = values
