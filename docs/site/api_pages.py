"""The pages of the Python API: one for each public room of the package, with all of its modules."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import ModuleType

from python_names import resolve_import

# Room -> its title, in the order of the contents.  The others serve the command line and the paper.
ROOMS = {
    "ps_fmu.simulation": "A scenario in a few lines",
    "ps_fmu.pointing": "Pointing errors",
    "ps_fmu.requirements": "Requirements and verdicts",
    "ps_fmu.results": "Results",
    "ps_fmu.cosim": "Co-simulation master",
    "ps_fmu.slavekit.author": "Slaves with native steps",
    "ps_fmu.mechanism": "Mechanism",
    "ps_fmu.control": "Control",
    "ps_fmu.disturbance": "Disturbance",
    "ps_fmu.sensors": "Sensors",
    "ps_fmu.actuators": "Actuators",
    "ps_fmu.theory": "Closed forms",
    "ps_fmu.trades": "Design trades",
}
HEAD = """Python API
==========

``import ps_fmu`` loads nothing but what is used.  Docstrings give shapes, units, frames, errors and sources.  Arrays
are numpy's, values are in SI units unless a name or text says otherwise.

``ps_fmu.simulate`` and ``ps_fmu.Result`` are described with :mod:`ps_fmu.simulation`.  ``ps_fmu.pointing`` and
``ps_fmu.cosim`` offer what their tables list first under their own names: ``from ps_fmu.cosim import Master``.

.. toctree::
   :maxdepth: 1

"""


def write_pages(folder: Path) -> None:
    """Write ``index.rst`` and a page for each room into a folder that exists."""
    lines = [f"   {title} <{name}>" for name, title in ROOMS.items()]
    (folder / "index.rst").write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")
    for name, title in ROOMS.items():
        room = importlib.import_module(name)
        _write(folder / f"{name}.rst", _write_room(room, title, list_modules(room)))


def _write_room(room: ModuleType, title: str, modules: Sequence[str]) -> Iterator[str]:
    yield from (*_head(f"{title}: ``{room.__name__}``"), f".. automodule:: {room.__name__}")
    if modules:
        yield "   :no-members:"
    yield from ("", ".. py:currentmodule:: None")
    if offered := list_offered(room):
        yield from ("", ".. rubric:: Offered by the room itself", "", ".. autosummary::", "")
        yield from (f"   ~{place}" for place in offered)
    if modules:
        yield from ("", ".. rubric:: Modules", "", ".. autosummary::", "")
        yield from (f"   {module}" for module in modules)
    for module in modules:
        yield from ("", *_head(f"``{module}``", "-"), f".. automodule:: {module}")


def _head(text: str, line: str = "=") -> tuple[str, str, str]:
    return text, line * len(text), ""


def _write(path: Path, lines: Iterable[str]) -> None:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def list_modules(room: ModuleType) -> list[str]:
    """Full names of the public modules of a package, packages within it included; none for a module."""
    found = pkgutil.walk_packages(getattr(room, "__path__", []), f"{room.__name__}.")
    return [info.name for info in found if not any(part.startswith("_") for part in info.name.split("."))]


def list_offered(room: ModuleType) -> list[str]:
    """Where the names that a package offers are defined, sorted by name."""
    if not hasattr(room, "__path__"):
        return []
    found = (resolve_import(room.__name__, name) for name in sorted(getattr(room, "__all__", ())))
    return [place for place in found if place]
