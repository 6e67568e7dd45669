"""Read XML from files that are not trusted.

A document type declaration is refused before anything in it is looked at, so there are no entities to expand
and no files to fetch.  Elements keep their line, so that an error can name it.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from xml.parsers import expat

from msgspec import Struct

from .plain import SystemFileError, read_bytes

MAXIMUM_BYTES = 16 * 2**20
"""Larger files are refused; the wiring of a thousand FMUs takes about 1 MiB."""
MAXIMUM_ELEMENTS = 1_000_000
"""They take 0.3 GB of memory, and may be of 4 bytes each in the file."""
MAXIMUM_DEPTH = 100
MAXIMUM_ATTRIBUTES = 1000
"""Of an element.  Other readers, asked later, take time with the square of their number: minutes for 200,000."""

NAMESPACES = {
    "http://ssp-standard.org/SSP1/SystemStructureDescription": "ssd",
    "http://ssp-standard.org/SSP1/SystemStructureCommon": "ssc",
    "http://ssp-standard.org/SSP1/SystemStructureParameterValues": "ssv",
    "http://ssp-standard.org/SSP1/SystemStructureParameterMapping": "ssm",
    "http://ssp-standard.org/SSP1/SystemStructureSignalDictionary": "ssb",
    "http://opensimulationplatform.com/SSP/OSPAnnotations": "osp",
    "http://opensimulationplatform.com/MSMI/OSPSystemStructure": "oss",
    "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd": "oms",
}


class Element(Struct, frozen=True):
    """An XML element; tags and attributes in a namespace of ``NAMESPACES`` carry its usual prefix."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = []  # of each its own: a Struct copies it
    pieces: list[str] | None = None
    """Its text, where that is asked for."""

    @property
    def text(self) -> str:
        """The text in it, without that of its children."""
        return "".join(self.pieces or ())

    def find(self, tag: str) -> Element | None:
        """First child of this tag."""
        return next((child for child in self.children if child.tag == tag), None)

    def all(self, tag: str) -> list[Element]:
        """Children of this tag."""
        return [child for child in self.children if child.tag == tag]

    def descendant(self, *tags: str) -> Element | None:
        """First child of the first tag, its first child of the second tag, and so on."""
        element: Element | None = self
        for tag in tags:
            element = element.find(tag) if element is not None else None
        return element


def read_xml(path: Path, texts: bool = False) -> Element:
    """Root element of a file, with the text in elements if asked for.

    Raises :class:`SystemFileError` if it cannot be read or parsed.
    """
    return parse_xml(read_bytes(path, MAXIMUM_BYTES), path, texts)


def parse_xml(data: bytes, path: Path, texts: bool = False) -> Element:
    """Root element of a document; ``path`` is named in errors (:class:`SystemFileError`)."""
    parser = expat.ParserCreate(namespace_separator=" ")
    roots: list[Element] = []
    opened: list[Element] = []
    add_prefix = lru_cache(maxsize=None)(_add_prefix)  # a document has few names, and many of each
    count = 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > MAXIMUM_ELEMENTS or len(opened) >= MAXIMUM_DEPTH:
            text = f"has more than {MAXIMUM_ELEMENTS} elements, or they are nested deeper than {MAXIMUM_DEPTH}"
            raise SystemFileError(path, text, parser.CurrentLineNumber)
        if len(attributes) > MAXIMUM_ATTRIBUTES:
            text = f"an element {_add_prefix(name)} has more than {MAXIMUM_ATTRIBUTES} attributes"
            raise SystemFileError(path, text, parser.CurrentLineNumber)
        named = {add_prefix(key): value for key, value in attributes.items()}
        element = Element(add_prefix(name), named, parser.CurrentLineNumber, [], [] if texts else None)
        (opened[-1].children if opened else roots).append(element)
        opened.append(element)

    def end(_name: str) -> None:
        opened.pop()

    def add_text(piece: str) -> None:
        pieces = opened[-1].pieces
        assert pieces is not None
        pieces.append(piece)

    def doctype(*_declaration: object) -> None:
        raise SystemFileError(
            path, "a document type declaration (DOCTYPE) is not accepted: remove it", parser.CurrentLineNumber
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = doctype
    if texts:
        parser.CharacterDataHandler = add_text
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise SystemFileError(path, f"is not well-formed XML: {error}", error.lineno) from error
    except (LookupError, UnicodeError, ValueError) as error:
        if isinstance(error, SystemFileError):
            raise
        raise SystemFileError(path, f"is in an encoding that cannot be read ({error}): use UTF-8") from error
    return roots[0]


def _add_prefix(name: str) -> str:
    """Expat's ``namespace name`` as ``prefix:name``; an unknown namespace stays as it is."""
    namespace, _, local = name.rpartition(" ")
    if not namespace:
        return name
    return f"{NAMESPACES.get(namespace, namespace)}:{local}"
