"""ZIP archives (.fmu, .ssp): read though nobody vouches for them, and written as the same bytes wherever."""

from __future__ import annotations

import hashlib
import io
import lzma
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from .plain import SystemFileError, write_atomically

MAXIMUM_BYTES = 2 * 2**30
"""An archive that unpacks to more is refused (a decompression bomb, or a mistake)."""
MAXIMUM_MEMBERS = 100_000
MAXIMUM_PART = 255
"""Bytes of the name of a file or folder that common file systems allow."""
MAXIMUM_NAME = 1000
"""Bytes of a member's path; systems allow 4096 with the folder that it is unpacked into."""

DATE = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip file can state
_COMPRESSION = 6  # 9 takes three times as long, 14 instead of 5 s with numpy and scipy, for 1 % less
_PERMISSIONS = {True: 0o100755, False: 0o100644}  # executable or not

_DAMAGE = (
    OSError,
    EOFError,
    NotImplementedError,  # zipfile: a compression or version that it does not know
    RuntimeError,
    ValueError,
    ArithmeticError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
)


def check_archive(path: Path) -> list[str]:
    """Names of the members, after checking that they can be unpacked into one folder and stay in it.

    Raises :class:`SystemFileError`: not a readable ZIP archive, an absolute path, a drive letter, ``..``, an empty
    part or a backslash in a name, a name that is too long, a link, a file that occurs twice or is a folder, too, a
    member that is encrypted or compressed by another method than deflate, too many bytes or members.
    """
    with _opened(path, "is not a readable ZIP archive") as archive:
        members = archive.infolist()
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
        if name in seen and not member.is_dir():  # CMake writes folders twice
            raise SystemFileError(path, f"member {name!r} occurs twice: the archive is not unpacked")
        seen.add(name)
    for name in sorted(seen):
        above = {str(folder) for folder in PurePosixPath(name).parents} | {name.rstrip("/")} - {name}
        if file := min(above & seen, default=None):
            raise SystemFileError(path, f"member {file!r} is a file and a folder: the archive is not unpacked")
    return sorted(seen)


def _objection(member: zipfile.ZipInfo) -> str | None:
    name = member.orig_filename
    if "\\" in name or ":" in name or "\0" in name or name.startswith("/") or not name:
        return "is not a relative path with forward slashes"
    encoded = name.encode(errors="replace")
    if len(encoded) > MAXIMUM_NAME or max(map(len, encoded.split(b"/"))) > MAXIMUM_PART:
        return f"is too long: at most {MAXIMUM_NAME} bytes, {MAXIMUM_PART} between two slashes, are unpacked"
    if ".." in PurePosixPath(name).parts:
        return "leaves the target folder"
    if str(PurePosixPath(name)) != name.removesuffix("/") or name in (".", "./"):
        return "has another path that means the same"
    if member.filename != name:
        return f"has a second name, {member.filename!r}"
    if stat.S_ISLNK(member.external_attr >> 16):
        return "is a link"
    if member.flag_bits & 0x1:
        return "is encrypted"
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):  # others may inflate to any size at once
        return "is compressed by another method than deflate, which FMI and SSP ask for"
    return None


@contextmanager
def _opened(path: Path, problem: str) -> Iterator[zipfile.ZipFile]:
    """An open archive; errors as in :func:`_explained`."""
    with _explained(path, problem), zipfile.ZipFile(path) as archive:
        yield archive


@contextmanager
def _explained(path: Path, problem: str) -> Iterator[None]:
    """What a damaged archive makes zipfile stumble over becomes a SystemFileError with this text."""
    try:
        if path.exists() and not path.is_file():  # a device or pipe may be read without end
            raise SystemFileError(path, f"{problem}: it is no ordinary file")
        yield
    except SystemFileError:
        raise
    except FileNotFoundError as error:
        raise SystemFileError(path, "is not there") from error
    except _DAMAGE as error:
        raise SystemFileError(path, f"{problem}: {error}") from error


def read_member(path: Path, name: str, maximum_bytes: int) -> bytes:
    """One member of a checked archive.  Raises :class:`SystemFileError` if missing, too large or damaged."""
    with _opened(path, f"{name} cannot be read") as archive:
        try:
            size = archive.getinfo(name).file_size
        except KeyError as error:
            raise SystemFileError(path, f"has no {name}") from error
        if size > maximum_bytes:
            raise SystemFileError(path, f"{name} has {size} bytes; at most {maximum_bytes} are read")
        return _inflate(archive, archive.getinfo(name))


def _inflate(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """Content of a member, of which no more is inflated than it claims to have."""
    with archive.open(member) as file:
        return file.read(member.file_size + 1)  # and one, so that the checksum is looked at


def check_content(path: Path) -> None:
    """Read all of a checked archive.  Raises :class:`SystemFileError` if a member is damaged."""
    with _opened(path, "has a damaged member") as archive:
        if name := archive.testzip():
            raise SystemFileError(path, f"member {name!r} is damaged: its checksum does not fit")


def extract(path: Path, folder: Path, wanted: Callable[[str], bool] = lambda _name: True) -> None:
    """Unpack an archive into ``folder`` after :func:`check_archive`.  Raises :class:`SystemFileError`.

    Nothing of a member but its name and content is used, so that this takes half as long as ``extractall``.

    ``wanted``: whether to unpack the member of a name.  To make a file may take longer than to write it.
    """
    check_archive(path)
    with _opened(path, f"cannot be unpacked into {folder}") as archive:
        made = {folder}
        folder.mkdir(parents=True, exist_ok=True)
        for member in archive.infolist():
            if not wanted(member.filename):
                continue
            target = folder / member.filename
            above = target if member.is_dir() else target.parent
            if above not in made:
                above.mkdir(parents=True, exist_ok=True)
                made.add(above)
            if not member.is_dir():
                target.write_bytes(_inflate(archive, member))


def read_all(path: Path) -> dict[PurePosixPath, bytes]:
    """All files of an archive after :func:`check_archive`.  Raises :class:`SystemFileError`."""
    check_archive(path)
    with _opened(path, "has a damaged member") as archive:
        members = [member for member in archive.infolist() if not member.is_dir()]
        return {PurePosixPath(member.filename): _inflate(archive, member) for member in members}


def compute_digest(files: Mapping[PurePosixPath, bytes]) -> bytes:
    """SHA-256 of names and contents."""
    total = hashlib.sha256()
    for name in sorted(files):
        total.update(f"{name}\0{len(files[name])}\0".encode())
        total.update(files[name])
    return total.digest()


def write_zip(path: Path, files: Mapping[PurePosixPath, bytes]) -> None:
    """Write a zip archive as of :func:`make_zip`.  Raises as :func:`write_atomically`."""
    write_atomically(path, make_zip(files))


def make_zip(files: Mapping[PurePosixPath, bytes], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A zip archive: entries sorted, dates and permissions fixed."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(str(name), DATE)
            entry.compress_type = compression
            entry.create_system = 3  # Unix, also where it is made elsewhere
            entry.external_attr = _PERMISSIONS[name.suffix in (".so", ".dylib", ".dll")] << 16
            archive.writestr(entry, files[name], compresslevel=_COMPRESSION)
    return content.getvalue()
