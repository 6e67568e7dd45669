"""What a study keeps of its cases in the output folder: a file of all rows, and the signals of chosen cases."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import sqlite3
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

from ..cosim.checkpoint.files import sync_folder

Row = dict[str, Any]
"""``case``, ``status``, ``error``, ``warnings``, ``wall_s``, ``worker``, and the metrics by name."""

DONE, FAILED, KILLED, LATE = "done", "failed", "killed its process", "took too long"
"""Values of ``status``."""
TEXTS = ("status", "error", "warnings", "worker")
OWN = ("case", *TEXTS, "wall_s")
"""Columns of each row, beside the metrics."""
MEASURED = ("wall_s", "worker")
"""Columns that another run of the same case has otherwise."""
VERDICT = "verdict/"
"""Beginning of the name of a column of a requirement."""
ANSWER = "/answer"
"""End of the name of a column with an answer on a requirement."""
HISTOGRAM = "/histogram"
"""End of the name of a column with the histogram of a run, for a requirement that is judged over all cases."""
LONGEST_TEXT = 2000  # of an error or of warnings
MOST_REASONS = 3  # that a terminal gets to see

FILE = "rows.sqlite"  # in the output folder
SIGNALS = "signals"  # a folder there
WAIT_S = 60.0  # for another process that reads or writes the file
ROWS_AT_ONCE = 10_000  # that are in memory as Python objects

_NAME = re.compile(r"case-(?P<case>\d+)\.nc")
_VARYING = re.compile(r"(?<![\w.])[-+]?\d+(\.\d+)?(e[-+]?\d+)?\b|(/[^\s/:]+)+(?=/)")
"""In an error: numbers that are words of their own, and folders."""
_TABLE = "CREATE TABLE IF NOT EXISTS rows (number INTEGER PRIMARY KEY, content TEXT NOT NULL, digest TEXT NOT NULL)"


class VersionError(ValueError):
    """A worker has other releases of the packages that a row depends on."""


class StartError(RuntimeError):
    """The process for the cases did not get ready; the text has what it printed."""


class ClusterError(RuntimeError):
    """The cluster is lost, or cannot be had; the rows so far are kept."""


class TrialError(RuntimeError):
    """All cases that were tried before the others have failed; their rows are kept."""


class RowStore:
    """The rows of a study in its output folder.

    What is added is on the disk or not there, whatever ends the process.  A row carries a digest of its content and the
    plan: one that a disk has changed, or that is of another study, counts as missing.  Which cases are done is read
    from here alone: no scheduler is asked.  All methods raise ``OSError`` where the file cannot be read or written.
    """

    def __init__(self, folder: Path, plan_hash: str) -> None:
        self._path, self._key = folder / FILE, plan_hash.encode()[:64]

    def add(self, rows: Sequence[Row]) -> None:
        """Add rows; one of a case that is there already takes its place."""
        texts = [(row["case"], json.dumps(row)) for row in rows]
        with self._open() as connection:
            connection.executemany(
                "INSERT OR REPLACE INTO rows VALUES (?, ?, ?)",
                [(case, text, self._digest(case, text)) for case, text in texts],
            )

    def read(self, case: int | None = None) -> Iterator[Row]:
        """The rows in the order of their cases; or that of one case, if it is there."""
        if not self._path.exists():
            return
        only = "" if case is None else "WHERE number = ?"
        with self._open() as connection:
            found = connection.execute(f"SELECT * FROM rows {only} ORDER BY number", () if case is None else (case,))
            for number, content, digest in found:
                if self._digest(number, content) == digest:
                    yield json.loads(content)

    def read_statuses(self) -> dict[int, str]:
        """The status of each case that has a row."""
        return {row["case"]: row["status"] for row in self.read()}

    def read_table(self) -> Any:
        """All rows as a ``pyarrow.Table``, without histograms, which are some kilobytes a case; None without rows.

        A metric that a row has not is null.
        """
        import pyarrow as pa

        rows, tables = self.read(), []
        while some := list(islice(rows, ROWS_AT_ONCE)):
            names = dict.fromkeys(name for row in some for name in row if not name.endswith(HISTOGRAM))
            columns = {name: pa.array([row.get(name) for row in some], _find_type(name)) for name in names}
            tables.append(pa.table(columns))
        return pa.concat_tables(tables, promote_options="default") if tables else None

    def read_texts(self, column: str) -> Iterator[str]:
        """The texts of a column, case by case; those that are there."""
        return (row[column] for row in self.read() if row.get(column) is not None)

    def _digest(self, case: int, content: str) -> str:
        return hashlib.blake2b(f"{case} {content}".encode(), digest_size=8, key=self._key).hexdigest()

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        """The file; what the body changes is done at its end."""
        try:
            with closing(sqlite3.connect(self._path, timeout=WAIT_S)) as connection, connection:
                connection.execute(_TABLE)  # a process may have ended between making the file and this
                yield connection
        except sqlite3.Error as error:
            other = "" if isinstance(error, sqlite3.OperationalError) else ": delete this file, and resume the study"
            raise OSError(f"{self._path}: {error}{other}") from error


def _find_type(name: str) -> Any:
    import pyarrow as pa

    if name == "case":
        return pa.int64()
    return pa.string() if name in TEXTS or name.endswith(ANSWER) else pa.float64()


def list_reasons(failed: Iterable[tuple[int, str, str]]) -> list[str]:
    """Why cases failed, from their case, status and error: a line for each reason with its count, the commonest first.

    Errors that differ in numbers, or in the folders of their files, have one reason; the text is that of the first.
    """
    cases: dict[tuple[str, str], list[tuple[int, str]]] = {}
    for case, status, error in failed:
        text = " ".join(error.split())
        cases.setdefault((status, _VARYING.sub("", text)), []).append((case, text))
    common = sorted(cases.items(), key=lambda item: -len(item[1]))
    lines = [
        f"{len(found)} {status}, as case {found[0][0]}: {found[0][1]}"
        for (status, _), found in common[:MOST_REASONS]
    ]
    left = sum(len(found) for _, found in common[MOST_REASONS:])
    return lines + ([f"{left} for {len(common) - MOST_REASONS} other reasons"] if left else [])


def write_durably(path: Path, content: bytes) -> None:
    """Write a file that is complete or not there, also after a loss of power.  Raises ``OSError`` with the path."""
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(handle)
            os.replace(name, path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
        sync_folder(path.parent)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def check_free(folder: Path, needed: int, stored: int) -> None:
    """Raises ``OSError`` if the disk of the output folder has no room for the files; ``stored`` bytes are there."""
    free = shutil.disk_usage(folder).free
    if needed - stored > free:
        raise OSError(
            f"{folder}: the signals take some {(needed - stored) / 1e9:.3g} GB, and {free / 1e9:.3g} GB are free: "
            "store fewer cases or outputs, or rows further apart ([signals])"
        )


def name_file(case: int) -> str:
    """Name of the file of a case."""
    return f"case-{case:07d}.nc"


def list_stored(folder: Path) -> dict[int, Path]:
    """The files of the output folder ``folder`` by their case."""
    found = {}
    for path in sorted((folder / SIGNALS).glob("case-*.nc")):
        if match := _NAME.fullmatch(path.name):
            found[int(match["case"])] = path
    return found


def list_unstored(folder: Path, wanted: Iterable[int]) -> list[int]:
    """Those of the cases ``wanted`` that have no file."""
    stored = list_stored(folder)
    return sorted(case for case in set(wanted) if case not in stored)
