"""FMUs as pythonfmu's own builder makes them.  They may come from anywhere: nothing in them is believed unchecked."""

from __future__ import annotations

import io
import re
import stat
import zipfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from xml.etree.ElementTree import Element, ParseError, iterparse

from ...native import list_platforms
from .sources import Files

RESOURCES = PurePosixPath("resources")
DESCRIPTION = PurePosixPath("modelDescription.xml")
_MOST_FILES = 20_000
_MOST_BYTES = 1 << 29  # unpacked, of all files
_LONGEST_NAME = 255  # characters: what file systems take
_LARGEST_DESCRIPTION = 1 << 24  # bytes
_MOST_ELEMENTS = 1_000_000
_DEEPEST = 100  # levels; Python writes deep ones by recursion
_ENCODING = re.compile(rb"""^<\?xml[^>]*\bencoding\s*=\s*["']([\w.-]+)["']""")
_IDENTIFIER = re.compile(r"[A-Za-z_]\w{0,199}", re.ASCII)
_EXIT = b"finalizePythonInterpreter"  # pythonfmu's library has it from 0.7 on, and the launcher needs it


class StockError(RuntimeError):
    """A file that is no FMU of pythonfmu's builder; the text says why, in one line."""


@dataclass(frozen=True)
class Stock:
    """The parts of an FMU that :func:`read_stock` has checked."""

    files: Files
    description: Element
    model: str
    """The model identifier."""
    script: str
    """Name of the module with the slave."""


def read_stock(path: Path) -> Stock:
    """Read an FMU that ``pythonfmu build`` has made.  Raises StockError for every other file, OSError."""
    files = _read_archive(path)
    if DESCRIPTION not in files:
        raise StockError("this is not an FMU: it has no modelDescription.xml")
    description = _parse(files[DESCRIPTION])
    version = description.get("fmiVersion", "none")
    if description.tag != "fmiModelDescription" or version != "2.0":
        raise StockError(f"this is an FMU of FMI {version:.20}; expected FMI 2.0, the version of pythonfmu")
    if RESOURCES / "launcher.txt" in files:
        raise StockError("this FMU has a launcher already: use it as it is")
    interface = description.find("CoSimulation")
    if RESOURCES / "slavemodule.txt" not in files or interface is None:
        raise StockError("this FMU was not made by pythonfmu: it has no resources/slavemodule.txt or no co-simulation")
    model = interface.get("modelIdentifier", "")
    script = files[RESOURCES / "slavemodule.txt"].decode(errors="replace").partition("\n")[0].strip()
    for name, what in ((model, "modelIdentifier"), (script, "resources/slavemodule.txt")):
        if not _IDENTIFIER.fullmatch(name):
            raise StockError(f"{what} is {name[:40]!r}; expected a name of letters, digits and underscores")
    if RESOURCES / f"{script}.py" not in files:
        raise StockError(f"resources/{script}.py is missing, which resources/slavemodule.txt names")
    _check_libraries(files, model, description.get("generationTool", "an unknown tool"))
    return Stock(files, description, model, script)


def _read_archive(path: Path) -> Files:
    if path.exists() and not path.is_file():  # a pipe may be read without end
        raise StockError("this is no ordinary file; expected an FMU")
    try:
        with zipfile.ZipFile(path) as archive:
            members = [member for member in archive.infolist() if not member.is_dir()]
            if len(members) > _MOST_FILES or sum(member.file_size for member in members) > _MOST_BYTES:
                raise StockError(f"it has over {_MOST_FILES} files, or over {_MOST_BYTES >> 20} MB unpacked")
            files: Files = {}
            for member in members:
                name = _check_name(member)
                if name in files:
                    raise StockError(f"it has two files named {name}")
                files[name] = _read_member(archive, member)
            return files
    except (zipfile.BadZipFile, zipfile.LargeZipFile, NotImplementedError, EOFError, UnicodeError, ValueError) as error:
        raise StockError(f"this is not an FMU: it cannot be read as a zip archive ({error})") from None


def _check_name(member: zipfile.ZipInfo) -> PurePosixPath:
    """The name of a file that stays within the folder that the FMU is unpacked to."""
    name, path = member.filename, PurePosixPath(member.filename)
    shown = ascii(name[:60])
    if path.is_absolute() or ".." in path.parts or any(sign in name for sign in '\\:\0\n\r"') or name != str(path):
        raise StockError(f"the file name {shown} leads out of the archive or is no plain name")
    if len(name) > _LONGEST_NAME:
        raise StockError(f"the file name {shown}... is longer than {_LONGEST_NAME} characters")
    if stat.S_ISLNK(member.external_attr >> 16) or member.flag_bits & 1:
        raise StockError(f"the file {shown} is a symbolic link or encrypted")
    return path


def _read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """The content, which is as long as the archive says, or refused: it might not end."""
    try:
        with archive.open(member) as file:
            content = file.read(member.file_size + 1)
    except Exception as error:  # BadZipFile, OSError, zlib.error, lzma.LZMAError
        raise StockError(f"{member.filename[:60]} cannot be unpacked: {error}") from None
    if len(content) != member.file_size:
        raise StockError(f"{member.filename[:60]} has another length than the archive says")
    return content


def _parse(content: bytes) -> Element:
    """The root of a model description; entities, by which a small file can become a large one, are refused."""
    encoding = _ENCODING.match(content.removeprefix(b"\xef\xbb\xbf"))
    if len(content) > _LARGEST_DESCRIPTION:
        raise StockError(f"modelDescription.xml has over {_LARGEST_DESCRIPTION >> 20} MB")
    if b"\0" in content or (encoding is not None and encoding[1].lower() not in (b"utf-8", b"us-ascii")):
        raise StockError("modelDescription.xml is not in UTF-8, the encoding that FMI 2.0 asks for")
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise StockError("modelDescription.xml has a document type definition, which no FMU needs")
    count = depth = 0
    root = Element("")
    try:
        for event, element in iterparse(io.BytesIO(content), ("start", "end")):
            root = element  # the last event is the end of the root
            count += event == "start"
            depth += 1 if event == "start" else -1
            if count > _MOST_ELEMENTS or depth > _DEEPEST:
                raise StockError(f"modelDescription.xml has over {_MOST_ELEMENTS} elements or {_DEEPEST} levels")
    except ParseError as error:
        raise StockError(f"modelDescription.xml cannot be read: {error}") from None
    return root


def _check_libraries(files: Files, model: str, tool: str) -> None:
    """One library at least is pythonfmu's, of a release and for a platform that the launcher goes with."""
    libraries = {
        name.parent.name: content
        for name, content in files.items()
        if name.parts[0] == "binaries" and len(name.parts) == 3 and name.stem == model
    }
    known = list_platforms("launcher")
    usable = libraries.keys() & set(known)
    if not usable:
        found = ", ".join(sorted(libraries)) or "no platform at all"
        raise StockError(f"it has a library for {found[:80]}; there is a launcher for {', '.join(known)}")
    old = sorted(platform for platform in usable if _EXIT not in libraries[platform])
    if old:
        raise StockError(f"its library for {', '.join(old)}, by {tool[:40]}, is not of pythonfmu 0.7: build it anew")
