"""Rows on disk: part files that are complete or not there, and what is still missing.

A part is named by the plan's hash, its first and last case, and a digest of its content and the plan: one that a disk
has changed, or that is of another study, is refused.  Which cases are done is read from the parts alone: no
scheduler is asked.  Two parts may have the same case, as when a worker goes on while its study is resumed elsewhere:
the rows are equal but for the time they took, and one is taken.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from .rows import ANSWER, HISTOGRAM, TEXTS, Row

FOLDER = "parts"
HASH_DIGITS = 16  # of the plan's hash in a name
_NAME = re.compile(r"(?P<plan>[0-9a-f]{16})-(?P<first>\d+)-(?P<last>\d+)-(?P<digest>[0-9a-f]{16})\.parquet")


def encode_part(rows: Sequence[Row]) -> bytes:
    """A Parquet file of rows; a metric that a row has not is null."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = dict.fromkeys(name for row in rows for name in row)
    columns = {name: [row.get(name) for row in rows] for name in names}
    table = pa.table({name: pa.array(values, _find_type(name)) for name, values in columns.items()})
    content = io.BytesIO()
    pq.write_table(table, content)
    return content.getvalue()


def write_part(folder: Path, plan_hash: str, rows: Sequence[Row], content: bytes | None = None) -> Path:
    """Write rows of neighbouring cases into the output folder ``folder``; the path.

    They are on the disk before the file has its name.  Raises ``OSError``; nothing is left behind then.
    """
    first, last = rows[0]["case"], rows[-1]["case"]
    content, plan = encode_part(rows) if content is None else content, plan_hash[:HASH_DIGITS]
    path = folder / FOLDER / f"{plan}-{first:07d}-{last:07d}-{_digest(plan, content)}.parquet"
    write_durably(path, content)
    return path


def _digest(plan: str, content: bytes) -> str:
    return hashlib.blake2b(content, digest_size=8, key=plan.encode()).hexdigest()


def write_durably(path: Path, content: bytes) -> None:
    """Write a file that is complete or not there, also after a loss of power.  Raises ``OSError`` with the path."""
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            move_durably(Path(name), path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def move_durably(written: Path, path: Path) -> None:
    """Give a file its name in the same folder once it is on the disk: else the name may be there without the content.

    Raises ``OSError``.
    """
    _sync(written)
    os.replace(written, path)
    _sync(path.parent)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def list_parts(folder: Path, plan_hash: str) -> list[Path]:
    """The parts of a plan in the output folder ``folder``, by their first case."""
    return [
        path
        for path in sorted((folder / FOLDER).glob("*.parquet"))
        if (found := _NAME.fullmatch(path.name)) and found["plan"] == plan_hash[:HASH_DIGITS]
    ]


def read_rows(parts: Iterable[Path], *, histograms: bool = False) -> Any:
    """The rows of all parts in the order of their cases, each case once, as a ``pyarrow.Table``; None without parts.

    Histograms are left out unless they are wanted: they are some kilobytes a case, and :func:`read_texts` has them one
    after another.  Raises ``OSError`` for a part that cannot be read: delete it, and resume.
    """
    import pyarrow as pa

    tables = [_read(path) if histograms else _drop_histograms(_read(path)) for path in parts]
    if not tables:
        return None
    joined = pa.concat_tables(tables, promote_options="permissive")
    cases = joined["case"].to_numpy()
    seen: dict[int, int] = {}
    for place, case in enumerate(cases.tolist()):
        seen.setdefault(case, place)
    return joined.take(pa.array([seen[case] for case in sorted(seen)]))


def read_texts(parts: Iterable[Path], column: str) -> Iterator[str]:
    """The texts of a column, case by case, each case once; of one part after another, so that few are in memory.

    Raises ``OSError`` for a part that cannot be read.
    """
    seen: set[int] = set()
    for path in parts:
        table = _read(path)
        if column in table.column_names:
            for case, text in zip(table["case"].to_pylist(), table[column].to_pylist(), strict=True):
                if text is not None and case not in seen:
                    seen.add(case)
                    yield text


def _drop_histograms(table: Any) -> Any:
    return table.drop_columns([name for name in table.column_names if name.endswith(HISTOGRAM)])


def list_missing(folder: Path, plan_hash: str, cases: int) -> list[int]:
    """The cases of a plan that no part has, in order."""
    done = read_statuses(folder, plan_hash)
    return [index for index in range(cases) if index not in done]


def read_statuses(folder: Path, plan_hash: str) -> dict[int, str]:
    """The status of each case that a part has.  Raises ``OSError`` for a part that cannot be read."""
    found: dict[int, str] = {}
    for path in list_parts(folder, plan_hash):
        table = _read(path, ["case", "status"])
        found.update(zip(table["case"].to_pylist(), table["status"].to_pylist(), strict=True))
    return found


def _read(path: Path, columns: list[str] | None = None) -> Any:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        content, named = path.read_bytes(), _NAME.fullmatch(path.name)
        if named is None or _digest(named["plan"], content) != named["digest"]:
            raise KeyError("it is damaged, or of another study")
        table = pq.read_table(pa.BufferReader(content), columns=columns, partitioning=None)
        for name in table.column_names if columns is None else columns:
            if table.schema.field(name).type not in (_find_type(name), pa.null()):
                raise KeyError(f"{name} is of the type {table.schema.field(name).type}, expected {_find_type(name)}")
        for name in ("case", "status"):
            if table[name].null_count:
                raise KeyError(f"{name} is not in each row")
    except (OSError, KeyError, pa.ArrowInvalid) as error:
        problem = str(error.args[0] if isinstance(error, KeyError) else error).partition("\n")[0]
        raise OSError(f"{path}: {problem}: delete this part, and resume the study") from error
    return table


def _find_type(name: str) -> Any:
    import pyarrow as pa

    if name == "case":
        return pa.int64()
    return pa.string() if name in TEXTS or name.endswith((ANSWER, HISTOGRAM)) else pa.float64()
