"""results.nc while the runs of a scenario go on: it stays open between them.

To open it takes as long as a run of 0.3 s, because netCDF looks at each of its 700 variables, and to close it half of
that.  Between two runs all there is lies on the disk, so that whatever ends the process leaves it readable.

A dataset is closed by name alone: one that Python collects is closed in whatever thread collects it, and the libraries
of netCDF crash if another thread is in them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..reduction.columns import NETCDF_LOCK

_open: dict[Path, Any] = {}
"""The datasets that are open, also those of runs that were given up."""


class ResultsFile:
    """The open file, if there is one."""

    def __init__(self) -> None:
        self._dataset: Any = None
        self._path: Path | None = None

    def keep(self, path: Path, dataset: Any) -> None:
        """Take a dataset that is open for writing; another one is closed."""
        self.close()
        self._path, self._dataset = path, dataset
        _open[path] = dataset

    def find(self, path: Path) -> Any:
        """The dataset of a file, if that is the one, and is open; else None, and a run given up has it no longer."""
        if self._path == path and self._dataset is not None and self._dataset.isopen():
            return self._dataset
        _close(path)
        return None

    @contextmanager
    def read(self, path: Path) -> Iterator[Any]:
        """A dataset to read a file from: the open one, or one for the body.  Raises OSError if it cannot be read."""
        import netCDF4

        with NETCDF_LOCK:
            kept = self.find(path)
            if kept is not None:
                yield kept
                return
            with netCDF4.Dataset(path) as file:
                yield file

    @contextmanager
    def close_on_failure(self) -> Iterator[None]:
        """Close the file if the body fails: then nothing is added to it any longer."""
        try:
            yield
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file.  Safe to call twice."""
        dataset, self._dataset = self._dataset, None
        if dataset is not None and self._path is not None and _open.get(self._path) is dataset:
            _close(self._path)


def _close(path: Path) -> None:
    dataset = _open.pop(path, None)
    with NETCDF_LOCK:
        if dataset is not None and dataset.isopen():
            dataset.close()
