"""Where the parts of a system lie: sources in its files are checked before anything is opened."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from ...files.archive import MAXIMUM_BYTES, extract
from ...files.xmlfile import Element
from ..errors import MissingFmuError, SystemFileError
from ..structure import UnpackedFolder

SSD_NAME = "SystemStructure.ssd"
DEEPEST = 20
"""So many descriptions may refer to one another."""

MOST_ELEMENTS = 10_000
MOST_CONNECTORS = 1_000_000
MOST_SYSTEMS = 100
"""So many systems may lie in one another; Python's own limit of nested calls comes at twice as many."""


@dataclass
class Sources:
    """How sources of one system are found.

    ``resources``, ``outside`` and ``lenient``: see :func:`.reading.read_system`; ``unpacked``: the archives that have
    been opened, if any.
    """

    resources: Path | None = None
    outside: bool = False
    lenient: bool = False
    unpacked: UnpackedFolder | None = field(default=None)
    elements: int = 0
    """Those that have been read; descriptions that refer to one another could make any number."""
    connectors: int = 0
    depth: int = 0
    """Systems around what is being read."""
    folders: dict[Path, Path] = field(default_factory=dict)
    """Where archives inside of others have been unpacked: once each, however many components are in them."""
    unpacked_bytes: int = 0

    def locate(self, path: Path) -> Path:
        """A file as its user knows it."""
        return path if self.unpacked is None else self.unpacked.locate(path)

    def name_members(self) -> AbstractContextManager[None]:
        """See :meth:`..structure.UnpackedFolder.name_members`."""
        return nullcontext() if self.unpacked is None else self.unpacked.name_members()

    def open_archive(self, archive: Path) -> Path:
        """The folder with the content of an .ssp archive, also of one inside another."""
        if archive in self.folders:
            return self.folders[archive]
        if self.unpacked is None:
            self.unpacked = UnpackedFolder(archive)
            folder = self.unpacked.path
        else:
            folder = self.unpacked.add(archive)
        with self.name_members():
            extract(archive, folder)
        self.unpacked_bytes += sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        if self.unpacked_bytes > MAXIMUM_BYTES:
            text = f"the archives of the system unpack to more than {MAXIMUM_BYTES} bytes"
            raise SystemFileError(archive, text)
        self.folders[archive] = folder
        return folder

    def find(self, text: str, element: Element, ssd: Path) -> Path:
        """The place that a source means; whether there is a file is another question.

        Raises :class:`SystemFileError`: it is empty or leaves the folder of the description.
        """
        plain = text if (ssd.parent / text).is_file() and not self.outside else unquote(text)
        if self.outside and plain.startswith("file:"):
            plain = plain.removeprefix("file:").removeprefix("//")
        path = PurePosixPath(plain)
        malformed = not path.name or set(plain) & set("\\\0") or ":" in plain
        if malformed or (not self.outside and (path.is_absolute() or ".." in path.parts)):
            way = "; --outside lets a system use files elsewhere (in a study: outside = true)"
            hint = "" if malformed or self.outside else way
            text = f"source {text!r} is not a path inside the folder of the description{hint}"
            raise SystemFileError(ssd, text, element.line)
        return ssd.parent / path

    def find_fmu(self, text: str, element: Element, ssd: Path, what: str) -> Path:
        """The file of a component, which is there.  Raises :class:`SystemFileError`."""
        path = self.find(text, element, ssd)
        places = [path] if self.resources is None else [self.resources / path.name, path]
        for place in places:
            if place.is_file():
                return place.absolute()  # an FMU may change the working directory
        known = " and no ".join(str(self.locate(place)) for place in places)
        text = f"{what}: there is no FMU {known}; build it, or say where it is"
        raise MissingFmuError(ssd, text, element.line, path)
