"""The packages inside ps_fmu and what they import, read from the sources."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from .drawing import Drawing

PACKAGE = Path(__file__).resolve().parents[2] / "src" / "ps_fmu"
COMMANDS = "command line, API"  # the files at the top of the package
LEFT_OUT = ("product", "terminal", "native")  # where files lie, how errors are shown, compiled code: open to all
KINDS = {
    "physics": ("pale-green", "mechanism control actuators sensors disturbance theory interface numerics"),
    "co-simulation": ("pale-blue", "cosim slavekit fmucheck reduction files"),
    "results": ("pale-orange", "pointing requirements results"),
    "what users ask for": ("pale-purple", "runs scenarios studies analyses trades paper"),
}
X = {
    "paper": 130, "trades": 270, COMMANDS: 520, "analyses": 220, "scenarios": 340, "studies": 460, "runs": 320,
    "interface": 160, "fmucheck": 500, "requirements": 645, "theory": 55, "actuators": 54, "control": 153,
    "disturbance": 252, "sensors": 351, "cosim": 450, "slavekit": 549, "results": 646, "mechanism": 120,
    "numerics": 270, "files": 400, "reduction": 520, "pointing": 640,
}  # fmt: skip
"""px of packages in their rows, so that few arrows cross; others are put in the middle."""
IMPORT = re.compile(r"^ *from (\.+)([\w.]*) import (?:\(([^)]*)\)|(.*))", re.MULTILINE)
WIDTH, HEIGHT, ROW = 92.0, 34.0, 78.0  # px


def list_packages() -> list[str]:
    """The commands, and folders of the package that hold Python."""
    folders = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))
    return [COMMANDS, *(name for name in folders if name not in LEFT_OUT)]


def find_imports() -> dict[str, set[str]]:
    """Package -> packages that it imports from."""
    found: dict[str, set[str]] = {name: set() for name in list_packages()}
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE)
        package = place.parts[0] if len(place.parts) > 1 else COMMANDS
        if package not in found or place.name in ("child_processes.py", "terminal.py"):
            continue
        found[package].update(name for name in _list_imported(path, place) if name in found and name != package)
    return found


def _list_imported(path: Path, place: Path) -> Iterator[str]:
    """Packages that a file imports from."""
    for dots, module, several, names in IMPORT.findall(path.read_text(encoding="utf-8")):
        outer = place.parts[: len(place.parts) - len(dots)]
        for inner in [module] if module else re.findall(r"\w+", several or names):
            yield (*outer, *inner.split("."))[0]


def find_levels(imports: Mapping[str, set[str]]) -> dict[str, int]:
    """Package -> how many packages lie below it at most."""
    levels: dict[str, int] = {}

    def find(name: str) -> int:
        if name not in levels:
            levels[name] = max((find(below) + 1 for below in sorted(imports[name])), default=0)
        return levels[name]

    for name in imports:
        find(name)
    return levels


def reduce_arrows(imports: Mapping[str, set[str]]) -> Iterator[tuple[str, str]]:
    """The imports but for those that follow from others: from a to c where a imports b, and b imports c."""

    def reach(name: str) -> set[str]:
        return imports[name].union(*map(reach, imports[name]))

    for name, below in imports.items():
        for other in sorted(below):
            if not any(other in reach(third) for third in below if third != other):
                yield name, other


def draw_packages() -> Drawing:
    """Packages in rows, with arrows down to those that they import."""
    imports = find_imports()
    levels = find_levels(imports)
    top = max(levels.values())
    drawing = Drawing(
        "The packages of ps_fmu",
        "; ".join(f"{name} imports {', '.join(sorted(below))}" for name, below in imports.items() if below),
        ROW * (top + 1) + 50.0,
    )
    places = {name: (X.get(name, 350.0), 40.0 + ROW * (top - level)) for name, level in levels.items()}
    for name, below in reduce_arrows(imports):
        (x, y), (u, v) = places[name], places[below]
        drawing.line([(x, y + HEIGHT / 2), (u, v - HEIGHT / 2)], "blue", 1.2, ends=">")
    colours = {name: colour for colour, names in KINDS.values() for name in names.split()}
    for name, (x, y) in places.items():
        width = WIDTH if len(name) < 13 else 150.0
        drawing.box(x - width / 2, y - HEIGHT / 2, width, HEIGHT, colours.get(name, "paper"), "ink")
        drawing.text(x, y, name, size=14 if len(name) < 12 else 13)
    for k, (kind, (colour, _)) in enumerate(KINDS.items()):
        x, y = 30.0 + 165.0 * k, ROW * (top + 1) + 24.0
        drawing.box(x, y - 10, 26, 20, colour, "ink", 3)
        drawing.text(x + 34, y, kind, anchor="start", size=13)
    return drawing
