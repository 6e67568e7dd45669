"""The file of a checkpoint: a ZIP archive, not compressed, of ``checkpoint.json`` and ``arrays.bin``.

The JSON holds the tree of the state; an array, or bytes, stands in it as ``{"$array": k}`` or ``{"$bytes": k}``, for
the k-th entry of the list ``arrays``: dtype, size and offset in ``arrays.bin``, where all lie one behind the other,
little endian.  Beside it stand the shape, and whether it lies there column by column.  Numbers that JSON has not are
``{"$number": "nan"}``.

A file may come from anywhere: nothing in it is executed, and no size in it is believed.
"""

from __future__ import annotations

import json
import math
import os
import struct
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .state import CheckpointError, DamagedCheckpointError, State

FORMAT = 1
HEAD, ARRAYS = "checkpoint.json", "arrays.bin"
MOST_HEAD_BYTES = 2**26
DTYPES = ("<f8", "<i8", "<i4", "|b1", "|u1")
"""Those of arrays that a checkpoint can hold."""
BEGUN = ".begun.part"
"""Name of the file, beside the others, that is written and then gets its name."""
_PLAIN = frozenset((type(None), bool, int, str))


def write_file(path: Path, tree: Mapping[str, State], *, over: bool = False) -> None:
    """Write a checkpoint so that ``path`` is complete or not there.  Raises OSError; nothing is left then.

    With ``over`` the file :data:`BEGUN` is there, and is written over: that takes two thirds of the time of a new one.
    """
    arrays: list[NDArray[Any]] = []
    content = _encode(tree, arrays)
    entries, offset = [], 0
    for array in arrays:
        entries.append({"dtype": array.dtype.str, "size": array.size, "offset": offset})
        offset += array.nbytes
    head = json.dumps({"format": FORMAT, "arrays": entries, "content": content}, allow_nan=False)
    begun = path.with_name(BEGUN)
    try:
        if not over:
            begun.unlink(missing_ok=True)
        with begun.open("r+b" if over else "xb") as file:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
                archive.writestr(zipfile.ZipInfo(HEAD), head)  # without the time: one state, the same bytes
                with archive.open(zipfile.ZipInfo(ARRAYS), "w", force_zip64=True) as member:
                    for array in arrays:
                        for part in _list_parts(array):
                            member.write(part.view(np.uint8).data)
            file.truncate()  # behind what was longer
            os.fsync(file.fileno())
        begun.replace(path)
    except BaseException:
        begun.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def read_file(path: Path) -> dict[str, State]:
    """The state in a checkpoint.  Raises :class:`CheckpointError` for a file that is none, or is damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            head, data = _read_member(archive, HEAD, MOST_HEAD_BYTES), _read_member(archive, ARRAYS, None)
        document = json.loads(head)
        if not isinstance(document, dict) or document.get("format") != FORMAT:
            found = document.get("format") if isinstance(document, dict) else None
            raise ValueError(f"expected the format {FORMAT}, found {found!r}")
        arrays = _read_arrays(document["arrays"], data)
        content = _decode(document["content"], arrays)
        if not isinstance(content, dict):
            raise ValueError("its content is no set of named values")
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (
        zipfile.BadZipFile, ValueError, KeyError, TypeError, IndexError, RecursionError, MemoryError,
        NotImplementedError, RuntimeError, OverflowError, EOFError, struct.error,
    ) as error:  # fmt: skip
        raise DamagedCheckpointError(path, f"is no checkpoint, or a damaged one: {error}") from error
    return content


def sync_folder(folder: Path) -> None:
    """Have the names in a folder on the disk, where the system can."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # Windows has no such handles
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _encode(value: State, arrays: list[NDArray[Any]]) -> Any:
    kind = type(value)
    if kind in _PLAIN:
        return value
    if kind is float:
        return value if math.isfinite(value) else {"$number": repr(value)}
    if isinstance(value, np.ndarray):
        columns = value.flags.f_contiguous and not value.flags.c_contiguous  # numpy sums in the order of the memory
        array = value.T if columns else value
        if array.dtype.str not in DTYPES:
            array = array.astype(value.dtype.newbyteorder("<"))
        if array.dtype.str not in DTYPES:
            raise TypeError(f"a checkpoint holds no array of {value.dtype}")
        arrays.append(array)
        return {"$array": len(arrays) - 1, "shape": list(value.shape), "by_columns": columns}
    if isinstance(value, bytes):
        arrays.append(np.frombuffer(value, np.uint8))
        return {"$bytes": len(arrays) - 1}
    if isinstance(value, np.generic):
        return _encode(value.item(), arrays)
    if isinstance(value, dict | Mapping):
        if wrong := [name for name in value if not isinstance(name, str) or name.startswith("$")]:
            raise TypeError(f"a checkpoint holds no entry named {wrong[0]!r}")
        return {name: _encode(item, arrays) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_encode(item, arrays) for item in value]
    for plain in (str, int, float):
        if isinstance(value, plain):
            return _encode(plain(value), arrays)
    raise TypeError(f"a checkpoint holds no {type(value).__name__}")


def _list_parts(array: NDArray[Any]) -> list[NDArray[Any]]:
    """The numbers of an array in the order of the file; a few long rows with gaps between them are not copied."""
    if array.ndim == 2 and len(array) < array.shape[1] and not array.flags.c_contiguous:
        return [np.ascontiguousarray(row) for row in array]
    return [np.ascontiguousarray(array).reshape(-1)]


def _decode(value: Any, arrays: list[NDArray[Any] | None]) -> State:
    if isinstance(value, list):
        return [_decode(item, arrays) for item in value]
    if not isinstance(value, dict):
        return value
    if "$array" in value:
        shape = [_read_count(n) for n in value["shape"]]
        return _take(arrays, value["$array"]).reshape(shape, order="F" if value["by_columns"] else "C")
    if "$bytes" in value:
        return _take(arrays, value["$bytes"]).tobytes()
    if "$number" in value:
        return float(value["$number"])
    return {name: _decode(item, arrays) for name, item in value.items()}


def _read_member(archive: zipfile.ZipFile, name: str, most: int | None) -> bytes:
    """A member, whose size is that in the file: what is compressed could be any size."""
    info = archive.getinfo(name)
    if info.compress_type != zipfile.ZIP_STORED or info.file_size != info.compress_size or info.flag_bits & 1:
        raise ValueError(f"{name} is compressed or encrypted")
    if most is not None and info.file_size > most:
        raise ValueError(f"{name} has {info.file_size} bytes, expected {most} at most")
    return archive.read(info)


def _take(arrays: list[NDArray[Any] | None], place: Any) -> NDArray[Any]:
    """An array, once: a short file that names one a million times must not fill the memory."""
    found, arrays[place] = arrays[_read_count(place)], None
    if found is None:
        raise ValueError(f"array {place} is there twice")
    return found


def _read_arrays(entries: Any, data: bytes) -> list[NDArray[Any] | None]:
    """The arrays, which lie one behind the other, so that all have the size of the file together."""
    arrays: list[NDArray[Any] | None] = []
    end = 0
    for entry in entries:
        if entry["offset"] != end:
            raise ValueError(f"an array begins at {entry['offset']!r}, the one before it ends at {end}")
        array = _read_array(entry, data)
        end += array.nbytes
        arrays.append(array)
    return arrays


def _read_array(entry: Any, data: bytes) -> NDArray[Any]:
    if entry["dtype"] not in DTYPES:
        raise ValueError(f"an array of {entry['dtype']!r}; expected one of {', '.join(DTYPES)}")
    dtype, size, offset = np.dtype(entry["dtype"]), _read_count(entry["size"]), _read_count(entry["offset"])
    if offset + size * dtype.itemsize > len(data):
        raise ValueError(f"an array ends behind the end of {ARRAYS}")
    return np.frombuffer(data, dtype, size, offset).astype(dtype.newbyteorder("="))


def _read_count(value: Any) -> int:
    if type(value) is not int or not 0 <= value < 2**48:
        raise ValueError(f"expected a whole number from 0 on, found {value!r}")
    return value
