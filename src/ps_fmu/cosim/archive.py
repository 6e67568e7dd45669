"""Unpack ZIP archives (.fmu, .ssp) that nobody has vouched for."""

from __future__ import annotations

import lzma
import stat
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from .errors import SystemFileError

MAXIMUM_BYTES = 2 * 2**30
"""An archive that unpacks to more is refused (a decompression bomb, or a mistake)."""
MAXIMUM_MEMBERS = 100_000

_DAMAGE = (
    OSError,
    EOFError,
    NotImplementedError,
    RuntimeError,
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
)


def check_archive(path: Path) -> list[str]:
    """Names of the members, after checking that they can be unpacked into one folder and stay in it.

    Raises :class:`SystemFileError`: not a readable ZIP archive, an absolute path, a drive letter, ``..`` or a
    backslash in a name, a link, a name that occurs twice, an encrypted member, too many bytes or members.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except FileNotFoundError as error:
        raise SystemFileError(path, "is not there") from error
    except (OSError, ValueError, NotImplementedError, zipfile.BadZipFile) as error:
        raise SystemFileError(path, f"is not a readable ZIP archive: {error}") from error
    total = sum(member.file_size for member in members)
    if total > MAXIMUM_BYTES or len(members) > MAXIMUM_MEMBERS:
        raise SystemFileError(
            path,
            f"would unpack to {total} bytes in {len(members)} files; at most {MAXIMUM_BYTES} bytes and "
            f"{MAXIMUM_MEMBERS} files are unpacked",
        )
    seen: set[str] = set()
    for member in members:
        name = member.orig_filename
        if reason := _objection(member):
            raise SystemFileError(path, f"member {name!r} {reason}: the archive is not unpacked")
        if name in seen:
            raise SystemFileError(path, f"member {name!r} occurs twice: the archive is not unpacked")
        seen.add(name)
    return sorted(seen)


def _objection(member: zipfile.ZipInfo) -> str | None:
    name = member.orig_filename
    if "\\" in name or ":" in name or "\0" in name or name.startswith("/") or not name:
        return "is not a relative path with forward slashes"
    if ".." in PurePosixPath(name).parts:
        return "leaves the target folder"
    if stat.S_ISLNK(member.external_attr >> 16):
        return "is a link"
    if member.flag_bits & 0x1:
        return "is encrypted"
    return None


def read_member(path: Path, name: str, maximum_bytes: int) -> bytes:
    """One member of a checked archive.  Raises :class:`SystemFileError` if missing, too large or damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            size = archive.getinfo(name).file_size
            if size > maximum_bytes:
                raise SystemFileError(path, f"{name} has {size} bytes; at most {maximum_bytes} are read")
            return archive.read(name)
    except KeyError as error:
        raise SystemFileError(path, f"has no {name}") from error
    except _DAMAGE as error:
        raise SystemFileError(path, f"{name} cannot be read: {error}") from error


def extract(path: Path, folder: Path) -> None:
    """Unpack an archive into ``folder`` after :func:`check_archive`.  Raises :class:`SystemFileError`."""
    check_archive(path)
    try:
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
    except _DAMAGE as error:
        raise SystemFileError(path, f"cannot be unpacked into {folder}: {error}") from error
