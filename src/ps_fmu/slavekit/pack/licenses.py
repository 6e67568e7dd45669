"""The folder ``documentation/licenses``: whose work an FMU contains, and the licence texts."""

from __future__ import annotations

import importlib.metadata
import platform
import re
import shutil
import subprocess
import sysconfig
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ... import __version__
from .errors import BuildError
from .sources import Files

_FOLDER = PurePosixPath("documentation", "licenses")
_PROJECT = Path(__file__).resolve().parents[4]
_TEXTS = re.compile(r"licen[cs]e|copying|notice|authors", re.IGNORECASE)
_NO_TEXT = b"No licence text was found on the machine that built this FMU: add it before you pass the FMU on.\n"


@dataclass(frozen=True)
class License:
    """A licence text: its name in the folder, what it holds for, the text itself."""

    name: str
    subject: str
    text: bytes


def write_licenses(licenses: Iterable[License], part: str = "") -> Files:
    """Write the folder: ``license.txt``, where FMI wants readers to begin, and the texts.

    Parameters
    ----------
    part: a folder in it, in an FMU of another author; ``license.txt`` then is about what was added.
    """
    folder = _FOLDER / part
    others = list(licenses)
    index = [f"{one.name}: {one.subject}\n" for one in others]
    head = f"ps_fmu {__version__} under the licence below, and work of others under the licences in this folder:\n\n"
    result = {folder / one.name: one.text for one in others}
    result[folder / "license.txt"] = "".join([head, *index, "\n", "-" * 80, "\n\n"]).encode() + _read_own()
    return result


def collect_source_licenses(sources: Files) -> Iterator[License]:
    """Licences of pythonfmu and of data of others, whose text lies beside them as ``<name>.license``."""
    version = importlib.metadata.version("pythonfmu")
    yield License("pythonfmu.txt", f"pythonfmu {version}, its library and its Python files", _read_text_of("pythonfmu"))
    for name, content in sorted(sources.items()):
        if name.suffix == ".license":
            yield License(f"{name.stem}.txt", f"data files {name.stem}*", content)


def collect_runtime_licenses(distributions: Iterable[str], libraries: Sequence[Path]) -> Iterator[License]:
    """Licences of this Python, of installed packages, and of shared libraries of the system."""
    yield License("python.txt", f"CPython {platform.python_version()}", _read_text_of_python())
    for distribution in distributions:
        version = importlib.metadata.version(distribution)
        for file in importlib.metadata.files(distribution) or ():
            if file.parts[0].endswith(".dist-info") and _TEXTS.search(file.name):
                inside = PurePosixPath(*file.parts[1:])
                name = inside.relative_to("licenses") if inside.parts[0] == "licenses" else inside
                subject = f"{distribution} {version} and the libraries that it brings"
                yield License(f"{distribution}/{name}", subject, Path(str(file.locate())).read_bytes())
    for path in libraries:
        yield License(f"{path.name}.txt", f"library {path.name}", _read_text_of_library(path) or _NO_TEXT)


def _read_own() -> bytes:
    """From the checkout, or from the metadata where the package is installed."""
    checkout = _PROJECT / "LICENSE"
    return checkout.read_bytes() if checkout.is_file() else _read_text_of("ps-fmu")


def _read_text_of(distribution: str) -> bytes:
    """The licence that an installed distribution carries."""
    metadata = importlib.metadata.distribution(distribution)
    text = metadata.read_text("licenses/LICENSE") or metadata.read_text("LICENSE")
    if text is None:
        raise BuildError(f"the installed {distribution} carries no licence text")
    return text.encode()


def _read_text_of_python() -> bytes:
    version = sysconfig.get_python_version()
    library = Path(sysconfig.get_path("stdlib"))
    for path in (library / "LICENSE.txt", Path(f"/usr/share/doc/python{version}/copyright")):
        if path.is_file():
            return path.read_bytes()
    raise BuildError(f"this Python has no licence text {library / 'LICENSE.txt'}")


def _read_text_of_library(path: Path) -> bytes | None:
    """What Debian and its kin say of the package that a file belongs to; None elsewhere."""
    if shutil.which("dpkg-query") is None:
        return None
    # Packages name their files with or without /usr, where the two are one.
    names = [str(path), str(path).removeprefix("/usr")]
    search = subprocess.run(["dpkg-query", "--search", *names], capture_output=True, text=True)
    package = search.stdout.partition(":")[0]
    text = Path("/usr/share/doc", package, "copyright")
    return text.read_bytes() if package and text.is_file() else None
