"""Rows of runs in memory, as results.nc would have them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..cosim import Column, Recorder
from ..cosim.recording.recorder import STORAGE, TIME_UNITS, UDUNITS
from ..cosim.recording.thinner import MemoryRecorder, Thinner
from ..results.datasets import StoredSignal


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
