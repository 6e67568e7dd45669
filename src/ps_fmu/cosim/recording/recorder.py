"""Results on disk while the simulation runs: netCDF-4, one group per run, one variable per output.

Time is a coordinate as the CF Conventions want it (section 4.4): seconds since a date.  A simulation has none, so the
date is a nominal one; the numbers are seconds of simulation.

Rows are not compressed here.  A chunk that is compressed changes its size, and so its place, with each write; of 60
processes killed while they wrote such files 9 left one that cannot be read, of 60 that wrote plain ones none.
"""

from __future__ import annotations

import shutil
import time as wall_clock
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from ...reduction.columns import NETCDF_LOCK, ColumnCopy
from ..checkpoint.state import RowJournal
from ..errors import RecorderError, UsageError
from ..rows import Array, Column
from .decimate import Decimator
from .delivery import Observer, write_rows
from .thinner import Thinner

CHUNK_ROWS = 4000
"""Rows of a chunk in the file, where nobody knows how many there will be."""
USUAL_CHUNK_ROWS = 20_000
"""And about so many where that is known.  A chunk costs 20 us for each column, and a kilobyte of it 0.3 us."""
MOST_CHUNK_BYTES = 2**26
"""But no more of all columns together: they wait in memory [B]."""
LEAST_CHUNK_ROWS = 100
"""However few are expected."""
LEAST_CHUNKS = 16
"""So many fit into the room that there is at the beginning."""
WRITE_BYTES = 2**23
"""So much is written at once in a long run [B], a chunk of rows at its beginning."""
METADATA_BYTES = 4096
"""Room for the index of the chunks and the attributes, per column."""
WRITE_INTERVAL_S = 1.0
"""Rows are written, too, when the last write was so long ago [s]."""
CONVENTIONS = "CF-1.11"
TIME_UNITS = "seconds since 2000-01-01 00:00:00"
"""The date is nominal: the values are seconds of simulation."""
FILTER = "filter"
"""Name of the group, within that of a run, that says how rows were filtered."""
UDUNITS = {"": "1", "-": "1", "deg": "degree", "%": "percent"}
"""FMI units that UDUNITS spells otherwise; it takes the rest (N.m, m/s2, kg.m2, N.s/m) as FMI writes them."""
STORAGE = {"Real": ("f8", 8), "Integer": ("i4", 4), "Enumeration": ("i4", 4), "Boolean": ("i1", 1)}


class Recorder:
    """Store columns of a run in a group of a netCDF-4 file, as an observer.

    Rows are written and flushed during the run and each second of wall time, so that the file can be read after any end
    of the run.  An error or Ctrl-C loses no rows.  A killed process or a full disk loses the rows since the last write:
    at most one second of rows, and at most half as many rows as the file contains, or a chunk.  With ``storage_step``
    Reals are filtered before rows are left out (:class:`Decimator`), and Booleans and Integers are sampled; the
    subgroup ``filter`` contains the coefficients.

    Parameters
    ----------
    path: the file, which is replaced unless ``append``
    run: name of the group, for example ``"passive"``
    columns, step: columns and communication step, s, of the master
    storage_step: time between stored rows, s, a whole multiple of ``step``; by default ``step``
    select: names of the columns to store; by default all
    attributes: attributes of the group (numbers or text)
    append: add the group to an existing file
    rows: expected number of rows, if it is known; the run may have more or fewer

    Attributes: ``columns`` that are stored, and ``watching``: observers of the rows that are stored.

    Raises :class:`UsageError` for arguments that do not fit, :class:`RecorderError` if the file cannot be
    written.
    """

    def __init__(
        self,
        path: Path,
        run: str,
        *,
        columns: Sequence[Column],
        step: float,
        storage_step: float | None = None,
        select: Sequence[str] | None = None,
        attributes: Mapping[str, str | float] | None = None,
        append: bool = False,
        rows: int | None = None,
    ) -> None:
        self.path = Path(path)
        self._thinner = Thinner(columns, step, storage_step, select)
        self.factor = self._thinner.factor
        self._step = step
        self.columns = self._thinner.columns
        self._row_bytes = 8 + sum(STORAGE[column.type][1] for column in self.columns)
        chunk = CHUNK_ROWS if rows is None else find_chunk_rows(-(-rows // self.factor))
        # What does not fit in whole chunks is lost: of little room not much at once.
        most = int(min(self._find_room()) / LEAST_CHUNKS / self._row_bytes)
        most = min(most, MOST_CHUNK_BYTES // (8 * (1 + len(self.columns))))  # doubles of all types, in memory
        self._chunk = self._enough = max(LEAST_CHUNK_ROWS, min(chunk, most))
        # Values of a column side by side, time first: netCDF4 would copy each column from all over the rows.
        self._pending: Array = np.empty((1 + len(self.columns), self._enough))
        self._copy = ColumnCopy(range(len(self.columns)), len(self.columns))
        self._n_pending = 0
        self.watching: list[Observer] = []
        self._seen_early: int | None = None
        self._written = 0
        self._last_write = wall_clock.perf_counter()
        self._dataset: Any = None
        self._journal: RowJournal | None = None
        self._journaled = 0  # of the pending rows
        self._check_space(self._chunk)
        with self._guard():
            self._create(run, attributes or {}, append)

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """Take the next rows of the run.

        Raises :class:`UsageError` for rows that do not follow the last row, :class:`RecorderError` if the file cannot
        be written; rows that were flushed before stay readable.
        """
        if self._seen_early is not None:  # and they are in the file
            taken, self._seen_early = max(0, self._seen_early - first_index), None
            first_index, time, values = first_index + taken, time[taken:], values[taken:]
        self._take(first_index, time, values)

    def early(self, first_index: int, time: Array, values: Array) -> None:
        """Take rows that the next block repeats, and write all there are: they are safe when an FMU hangs.

        Raises as :meth:`block`.
        """
        taken = 0 if self._seen_early is None else max(0, self._seen_early - first_index)
        self._take(first_index + taken, time[taken:], values[taken:])
        self._seen_early = self._thinner.expected
        self._write()

    def _take(self, first_index: int, time: Array, values: Array) -> None:
        if self._dataset is None:
            raise RecorderError(f"{self.path}: is closed: record all rows before")
        if len(values) == 0:
            return
        try:
            stored = self._thinner.push(first_index, time, values)
        except UsageError as error:
            raise UsageError(f"{self.path}: {error}") from None
        self.store(*stored)

    @property
    def journal_width(self) -> int:
        """Numbers in a row of the journal of a checkpoint: the time, then the columns."""
        return 1 + len(self.columns)

    def use_journal(self, journal: RowJournal) -> None:
        """Add the rows that are stored to a journal, too: a file of netCDF that a kill has torn is not read again."""
        self._journal = journal

    def save_state(self) -> dict[str, Any]:
        """What a checkpoint keeps besides the journal, which has all rows that are stored now."""
        self._add_to_journal()
        return {**self._thinner.save_state(), "seen_early": self._seen_early}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Store the rows of the journal, and go on behind them.  Raises KeyError or ValueError: no such state."""
        self._thinner.check_state(state)
        journal, self._journal = self._journal, None
        assert journal is not None
        for rows in journal.read():
            self.store(np.ascontiguousarray(rows[:, 0]), rows[:, 1:])
        self._journal, self._journaled = journal, self._n_pending
        self._thinner.load_state(state)
        early = state["seen_early"]
        self._seen_early = None if early is None else int(early)

    def close(self) -> None:
        """Write pending rows and close the file; a second call does nothing.  Raises :class:`RecorderError`."""
        if self._dataset is None:
            return
        self.store(*self._thinner.finish())
        self._write()  # all is on the disk then
        with self._guard():
            self._dataset.close()
        self._dataset = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except RecorderError as second:
            if error is None:
                raise
            error.add_note(str(second))

    def _create(self, run: str, attributes: Mapping[str, str | float], append: bool) -> None:
        import netCDF4

        self.path.parent.mkdir(parents=True, exist_ok=True)
        if not append:
            self.path.unlink(missing_ok=True)  # whoever still reads an older result keeps it
        self._dataset = netCDF4.Dataset(self.path, "a" if append else "w", format="NETCDF4")
        self._dataset.Conventions = CONVENTIONS
        if run in self._dataset.groups:
            raise UsageError(f"{self.path}: there is a run {run!r} already: choose another name")
        group = self._dataset.createGroup(run)
        group.setncatts(dict(attributes))
        group.createDimension("time", None)
        time = Column("time", TIME_UNITS, "Real", "simulated time")
        self._variables = [self._variable(group, column) for column in (time, *self.columns)]
        self._variables[0].setncatts({"standard_name": "time", "axis": "T", "calendar": "standard"})
        _describe_filter(group.createGroup(FILTER), self._thinner.decimator, self._step)
        self._dataset.sync()

    def _variable(self, group: Any, column: Column) -> Any:
        kind = STORAGE[column.type][0]
        # Chunks are neither filled nor kept in memory: rows go straight into the file, which takes half of the time.
        # By default 64 MB of them stay in memory, per variable: gigabytes in all, as a run goes on.
        variable = group.createVariable(column.name, kind, ("time",), chunksizes=(self._chunk,), fill_value=False)
        variable.set_auto_maskandscale(False)
        variable.set_var_chunk_cache(size=1, nelems=1)
        variable.units = UDUNITS.get(column.unit, column.unit)
        variable.long_name = column.description or column.name
        if column.type == "Boolean":
            variable.flag_values = np.array([0, 1], dtype=np.int8)
            variable.flag_meanings = "false true"
        return variable

    def store(self, times: Array, rows: Array) -> None:
        """Store rows (n, columns) that are selected, filtered and thinned already, with their times (n,)."""
        for observer in self.watching if len(rows) else ():
            observer.block(self._written + self._n_pending, times, rows)
        taken = 0
        while taken < len(rows):
            begin = self._n_pending
            count = min(self._enough - begin, len(rows) - taken)
            self._pending[0, begin : begin + count] = times[taken : taken + count]
            part = np.ascontiguousarray(rows[taken : taken + count])
            self._copy.run(part, self._pending[1:, begin : begin + count])
            taken += count
            self._n_pending += count
            if self._n_pending == self._enough:
                self._write()
        if wall_clock.perf_counter() - self._last_write > WRITE_INTERVAL_S:
            self._write()

    def _find_enough(self) -> int:
        """How many rows are written next: those that fill a chunk, or some in a long run."""
        chunks = max(1, min(self._written // 2, WRITE_BYTES // self._row_bytes) // self._chunk)
        return chunks * self._chunk - self._written % self._chunk

    def _add_to_journal(self) -> None:
        """Many rows at once: they cost half as much as block by block."""
        if self._journal is not None and self._journaled < self._n_pending:
            self._journal.append(self._pending[:, self._journaled : self._n_pending].T)
        self._journaled = self._n_pending

    def _write(self) -> None:
        self._add_to_journal()
        count = self._n_pending
        self._last_write = wall_clock.perf_counter()
        if count == 0:
            return
        self._check_space(count)
        end = self._written + count
        with self._guard():
            for variable, column in zip(self._variables, self._pending[:, :count], strict=True):
                write_rows(variable, self._written, column)
            self._dataset.sync()
        # Not before: what Ctrl-C keeps from being written is written when the file is closed.
        self._written, self._n_pending, self._journaled = end, 0, 0
        self._enough = self._find_enough()
        if self._enough > self._pending.shape[1]:
            self._pending = np.empty((len(self._pending), self._enough))

    def _find_room(self) -> tuple[float, float]:
        """Bytes that are free on the disk, and by which the file may grow."""
        folder = next(parent for parent in self.path.absolute().parents if parent.exists())
        return shutil.disk_usage(folder).free, _get_file_size_limit(self.path)

    def _check_space(self, rows: int) -> None:
        """HDF5 does not recover from a write that fails half-way: refuse before it starts."""
        chunks = -(-(self._written + rows) // self._chunk) - -(-self._written // self._chunk)
        needed = chunks * self._chunk * self._row_bytes + METADATA_BYTES * (len(self.columns) + 16)
        free, limit = self._find_room()
        if needed > min(free, limit):
            reason = "the disk is full" if free <= limit else "the file size limit of this process is reached"
            self._release()
            raise RecorderError(
                f"{self.path}: {reason}: {needed / 1e6:.1f} MB needed, {min(free, limit) / 1e6:.1f} MB free. "
                f"{self._written} rows are stored.\n"
                "  Free some space, record fewer columns, or choose a larger storage step."
            )

    @contextmanager
    def _guard(self) -> Iterator[None]:
        """Turn what netCDF4 and HDF5 raise into an error that names the file; no other thread calls them meanwhile."""
        try:
            with NETCDF_LOCK:
                yield
        except (OSError, RuntimeError) as error:
            self._release()
            free = shutil.disk_usage(self.path.absolute().parent).free if self.path.parent.exists() else 0
            raise RecorderError(
                f"{self.path}: cannot be written: {error} ({free / 1e6:.1f} MB free on the disk). "
                f"{self._written} rows are stored."
            ) from error
        except UsageError:
            self._release()
            raise

    def _release(self) -> None:
        """Close the file after a failure that is already being reported."""
        dataset, self._dataset = self._dataset, None
        self._n_pending = self._journaled = 0
        if dataset is not None:
            with NETCDF_LOCK, suppress(OSError, RuntimeError):
                dataset.close()


def find_chunk_rows(stored: int) -> int:
    """Rows of a chunk in a file that gets so many rows: few chunks, of one size, that are nearly full."""
    return max(LEAST_CHUNK_ROWS, -(-stored // max(1, round(stored / USUAL_CHUNK_ROWS))))


def _describe_filter(group: Any, decimator: Decimator, step: float) -> None:
    """Write what the rows went through: attributes, and the taps of each stage."""
    filters = decimator.filters
    group.kind = "FIR low-pass of linear phase, Kaiser window, no delay" if filters else "none: every step is stored"
    for number, stage in enumerate(filters, 1):
        dimension = group.createDimension(f"tap_{number}", len(stage.taps))
        variable = group.createVariable(f"coefficients_{number}", "f8", (dimension.name,))
        variable.setncatts(
            {
                "long_name": f"taps of stage {number}, of which each {stage.factor}th row comes out; Reals only",
                "units": "1",
                "factor": np.int32(stage.factor),
                "order": np.int32(len(stage.taps) - 1),
                "sampling_step_s": step,
                "passband_hz": stage.pass_band / step,
                "cutoff_hz": 0.5 * (stage.pass_band + stage.stop_band) / step,  # where the gain is one half
                "stopband_hz": stage.stop_band / step,
                "stopband_attenuation_db": stage.attenuation_db,
            }
        )
        variable[:] = stage.taps
        step *= stage.factor


def _get_file_size_limit(path: Path) -> float:
    """Bytes by which the file may still grow (RLIMIT_FSIZE)."""
    try:
        import resource
    except ImportError:  # not on Windows
        return float("inf")
    soft, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    if soft == resource.RLIM_INFINITY:
        return float("inf")
    return soft - (path.stat().st_size if path.exists() else 0)
