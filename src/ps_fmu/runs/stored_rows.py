"""Rows of runs: their names in results.nc, in memory as they would be there, and compressed at the end.

While a run goes on rows are not compressed, see :mod:`ps_fmu.cosim.recording.recorder`.
"""

from __future__ import annotations

import re
import shutil
import unicodedata
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cosim import Column, Recorder
from ..cosim.recording.delivery import iterate_blocks, read_chunk_rows, read_rows, write_rows
from ..cosim.recording.recorder import STORAGE, TIME_UNITS, UDUNITS
from ..cosim.recording.thinner import MemoryRecorder, Thinner
from ..reduction.columns import NETCDF_LOCK
from ..results.datasets import StoredSignal
from ..results.observers.bins import MeanObserver

_LONGEST = 240
"""Bytes of a name; netCDF has 256, and some are for numbers that tell equal beginnings apart."""
_FORBIDDEN = re.compile(r"[/\x00-\x1f\x7f]")


MOTION = tuple(
    f"plant.{quantity}.{part}"
    for quantity, parts in (
        ("orientation", ("roll", "pitch", "yaw")),
        *((name, "xyz") for name in ("base_position", "base_rotation", "payload_position", "payload_rotation")),
    )
    for part in parts
)
"""What moves the picture of the mechanism in a report."""
MOTION_BINS = 6000  # instants of that motion, at most: 1 MB in a report with two runs


def watch_motion(columns: Sequence[Column]) -> MeanObserver | None:
    """What averages the motion of base and payload in stored rows; None where not all columns of it are stored."""
    if not {column.name for column in columns}.issuperset(MOTION):
        return None
    return MeanObserver(columns, MOTION, bins=MOTION_BINS // 2)


def make_stored_names(names: Sequence[str]) -> dict[str, str]:
    """Names of netCDF variables for columns of any name, each once: netCDF has no slashes nor control characters.

    It begins with a letter, digit or underscore, ends with no space and is in Unicode's normal form C (NetCDF Users
    Guide, appendix B).  Long ones, as of Modelica, are cut.  None is ``time``.
    """
    stored: dict[str, str] = {}
    known = {"time"}
    for name in names:
        plain = unicodedata.normalize("NFC", _FORBIDDEN.sub("_", name)).rstrip()
        if not plain or (ord(plain[0]) < 128 and not (plain[0].isalnum() or plain[0] == "_")):
            plain = f"_{plain}"
        plain = plain.encode()[:_LONGEST].decode(errors="ignore").rstrip()
        unique, number = plain, 2
        while unique in known:
            unique, number = f"{plain}_{number}", number + 1
        known.add(unique)
        stored[name] = unique
    return stored


def rename_columns(columns: Sequence[Column], stored: Mapping[str, str] | None = None) -> list[Column]:
    """The columns as a file has them: one of another name than in the system says that in its description.

    ``stored``: of :func:`make_stored_names`, for all columns of the run; None: these are all.
    """
    names = make_stored_names([column.name for column in columns]) if stored is None else stored
    return [
        replace(column, name=names[column.name], description=_describe(column, names[column.name]))
        for column in columns
    ]


def _describe(column: Column, stored: str) -> str:
    return column.description if stored == column.name else f"{column.name}: {column.description}".rstrip(": ")


@dataclass(frozen=True, eq=False)
class KeptRun:
    """The rows of one run, with the attributes of its group in results.nc."""

    rows: MemoryRecorder
    attributes: Mapping[str, str | float]
    columns: Sequence[Column]  # all of the run, under the names that are stored
    step_s: float
    storage_step_s: float

    def list_signals(self) -> tuple[StoredSignal, dict[str, StoredSignal]]:
        """Time, and the columns by their names, as results.nc has them."""
        values = self.rows.values
        kinds = {name: np.dtype(bool if name == "Boolean" else kind) for name, (kind, _) in STORAGE.items()}
        return StoredSignal(self.rows.time, TIME_UNITS, "simulated time"), {
            column.name: StoredSignal(
                values[:, place].astype(kinds[column.type]),
                UDUNITS.get(column.unit, column.unit),
                column.description or column.name,
            )
            for place, column in enumerate(self.rows.columns)
        }


class KeptRows:
    """The rows of runs by their names."""

    def __init__(self) -> None:
        self._runs: dict[str, KeptRun] = {}

    def record(
        self,
        run: str,
        columns: Sequence[Column],
        step_s: float,
        storage_step_s: float,
        select: Sequence[str],
        attributes: Mapping[str, str | float],
    ) -> MemoryRecorder:
        """The observer that keeps the rows of a run; the arguments are those of :class:`..cosim.Recorder`."""
        rows = MemoryRecorder(Thinner(columns, step_s, storage_step_s, select))
        self._runs[run] = KeptRun(rows, dict(attributes), columns, step_s, storage_step_s)
        return rows

    def __getitem__(self, run: str) -> KeptRun:
        return self._runs[run]

    def __iter__(self) -> Iterator[str]:
        return iter(self._runs)

    def write(self, path: Path) -> None:
        """Write all runs into a results.nc that is there.

        Raises :class:`..cosim.errors.RecorderError`.
        """
        for run, kept in self._runs.items():
            names = [column.name for column in kept.rows.columns]
            with Recorder(
                path, run, columns=kept.columns, step=kept.step_s, storage_step=kept.storage_step_s, select=names,
                attributes=kept.attributes, append=True,
                rows=len(kept.rows.time) * round(kept.storage_step_s / kept.step_s),
            ) as recorder:  # fmt: skip
                recorder.store(kept.rows.time, kept.rows.values)


LEVEL = 1  # of zlib, with shuffled bytes: 4 takes a sixth longer, for files 0.3 % smaller
WORTH = 0.6  # compressed over plain size up to which it is done
MOST_COLUMNS = 1000  # of a run: to read one, netCDF looks at all of them, so that 10,000 would take 20 minutes
LEAST_BYTES = 4_000_000  # below, 0.16 s to write all anew would save less than half of it
_SAMPLE_ROWS = 1000
_BLOCK_ROWS = 160_000


def finish_file(path: Path, *, filled: bool = False) -> None:
    """Compress a results.nc, if there is one.

    Columns are compressed where that halves them, or nearly so: those that are constant or slow, half of the default
    system's.  What is left is noise, which would shrink by a fifth and take four times as long.  A file of more than
    :data:`MOST_COLUMNS` stays as it is, and one below :data:`LEAST_BYTES` where no chunk is longer than its column.

    ``filled``: no run has ended early, so that no chunk is; a small file is not opened then, which takes 30 ms.

    Raises OSError if it cannot be written; the file is there then, as the runs left it.
    """
    import netCDF4

    if not path.is_file():
        return
    size, free = path.stat().st_size, shutil.disk_usage(path.parent).free
    if filled and size < LEAST_BYTES:
        return
    if size > free:
        raise OSError(f"{path}: stays as it is: {size / 1e6:.1f} MB needed to compress it, {free / 1e6:.1f} MB free")
    beside = path.with_name(f".{path.name}.part")
    try:
        beside.unlink(missing_ok=True)
        with NETCDF_LOCK, netCDF4.Dataset(path) as old:
            groups = old, *old.groups.values()
            if max(len(group.variables) for group in groups) > MOST_COLUMNS:
                return
            times = [group["time"] for group in groups if "time" in group.variables]
            if size < LEAST_BYTES and all(read_chunk_rows(time) <= time.size for time in times):
                return
            with netCDF4.Dataset(beside, "w", format="NETCDF4") as new:
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
