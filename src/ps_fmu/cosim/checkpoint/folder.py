"""The checkpoints of one run in a folder: the last two, so that there is one whatever happens to the other."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from pathlib import Path

from .files import BEGUN, read_file, write_file
from .journal import Journal
from .state import CheckpointError, State

log = logging.getLogger("ps_fmu.cosim")

GENERATIONS = 2
_NAME = re.compile(r"row-(\d{1,18})\.zip")


class CheckpointFolder:
    """Checkpoints by the number of their row, ``row-000000120000.zip``, and journals, ``rows-0.bin``."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._written: set[Path] = set()  # what was there before may be a link to anywhere: it is not written over
        self._has_spare = False

    def write(self, index: int, tree: Mapping[str, State]) -> Path:
        """Write a checkpoint; of those before, all but the last make room.  Raises OSError: they are there then."""
        self.path.mkdir(parents=True, exist_ok=True)
        path = self.path / f"row-{index:012d}.zip"
        over, self._has_spare = self._has_spare, False
        write_file(path, tree, over=over)
        self._written.add(path)
        for old in self.list_files()[GENERATIONS:]:
            if old not in self._written:
                old.unlink(missing_ok=True)
                continue
            self._written.remove(old)
            old.replace(self.path / BEGUN)
            self._has_spare = True
        return path

    def list_files(self) -> list[Path]:
        """The files of checkpoints, the newest first."""
        if not self.path.is_dir():
            return []
        found = {path: match for path in self.path.iterdir() if (match := _NAME.fullmatch(path.name))}
        return sorted(found, key=lambda path: -int(found[path][1]))

    def read(self) -> tuple[Path, dict[str, State]] | None:
        """The newest checkpoint that is whole; None if there is none.

        Raises :class:`CheckpointError` if all are damaged.
        """
        files = self.list_files()
        for path in files:
            try:
                return path, read_file(path)
            except CheckpointError as error:
                if path == files[-1]:
                    raise
                log.warning("%s; the one before is taken", error)
        return None

    def open_journal(self, place: int, width: int, kept: Mapping[str, State] | None) -> Journal:
        """The journal of the observer at a place, begun, or gone on with.  Raises :class:`CheckpointError`."""
        self.path.mkdir(parents=True, exist_ok=True)
        return Journal(self.path / f"rows-{place}.bin", width, kept)

    def clear(self) -> None:
        """Remove all checkpoints and journals, as of an earlier run."""
        self._remove(self.list_files())

    def leave_last(self) -> None:
        """Remove what only a run that goes on needs: the journals and all checkpoints but the last."""
        self._remove(self.list_files()[1:])

    def _remove(self, files: list[Path]) -> None:
        self._has_spare = False
        for path in [*files, *self.path.glob("rows-*.bin"), self.path / BEGUN]:
            path.unlink(missing_ok=True)
