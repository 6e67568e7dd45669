"""Draws rooms.svg: the rooms of the package and what they import, read from the sources.

Usage: python docs/draw_rooms.py [OUTPUT.svg|OUTPUT.png]
"""

import ast
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

PACKAGE = Path(__file__).parents[1] / "src" / "ps_fmu"
COMMANDS = "command line\nand Python API"  # the files at the top of the package
LEFT_OUT = ("product", "terminal", "native")  # where files lie, how errors are shown, compiled code: anybody may ask
KINDS = {
    "physics": ("#E7F3EC", "mechanism control actuators sensors disturbance theory interface numerics"),
    "co-simulation": ("#E8EFF9", "cosim slavekit fmucheck reduction"),
    "results": ("#FDF0E1", "pointing requirements results"),
    "what users ask for": ("#F5E9F3", "runs scenarios studies analyses trades paper"),
}
X = {
    "paper": 22, "trades": 44, COMMANDS: 74, "analyses": 32, "scenarios": 48, "studies": 64, "runs": 46,
    "interface": 23, "fmucheck": 76, "requirements": 90, "theory": 8, "cosim": 64, "results": 88, "actuators": 8,
    "control": 23.5, "disturbance": 39, "sensors": 54.5, "slavekit": 71, "mechanism": 20, "numerics": 43,
    "reduction": 64, "pointing": 88,
}  # fmt: skip
"""Where rooms stand in their rows, so that few arrows cross; others are put in the middle."""
INK, ARROW = "#222222", "#0072B2"
WIDTH, HEIGHT, ROW = 13.0, 5.0, 11.0  # hundredths of the figure's width


def list_rooms() -> list[str]:
    """Folders of the package that hold Python, and the commands."""
    folders = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))
    return [COMMANDS, *(name for name in folders if name not in LEFT_OUT)]


def find_imports() -> dict[str, set[str]]:
    """Room -> rooms that it imports from."""
    found: dict[str, set[str]] = {room: set() for room in list_rooms()}
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE)
        room = place.parts[0] if len(place.parts) > 1 else COMMANDS
        if room not in found or place.name in ("child_processes.py", "terminal.py"):
            continue
        for name in _list_imported(path, place):
            if name in found and name != room:
                found[room].add(name)
    return found


def _list_imported(path: Path, place: Path) -> Iterator[str]:
    """Rooms that a file imports from."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            outer = place.parts[: len(place.parts) - node.level]
            inner = node.module.split(".") if node.module else [alias.name for alias in node.names]
            yield (*outer, *inner)[0]


def find_levels(imports: Mapping[str, set[str]]) -> dict[str, int]:
    """Room -> how many rooms lie below it at most."""
    levels: dict[str, int] = {}

    def find(room: str) -> int:
        if room not in levels:
            levels[room] = max((find(below) + 1 for below in imports[room]), default=0)
        return levels[room]

    for room in imports:
        find(room)
    return levels


def reduce_arrows(imports: Mapping[str, set[str]]) -> Iterator[tuple[str, str]]:
    """The imports but for those that follow from others: from a to c where a imports b, and b imports c."""

    def reach(room: str) -> set[str]:
        return imports[room].union(*map(reach, imports[room]))

    for room, below in imports.items():
        for name in sorted(below):
            if not any(name in reach(other) for other in below if other != name):
                yield room, name


def draw(output: Path) -> None:
    """Write the picture."""
    imports = find_imports()
    levels = find_levels(imports)
    rows = [sorted(room for room in imports if levels[room] == level) for level in range(max(levels.values()) + 1)]
    places = {room: (X.get(room, 50), ROW * (level + 0.5)) for level, row in enumerate(rows) for room in row}
    colours = {room: colour for colour, names in KINDS.values() for room in names.split()}
    with rc_context({"svg.hashsalt": "rooms", "svg.fonttype": "none", "font.size": 10.0}):
        figure = Figure(figsize=(10.0, 0.1 * ROW * (len(rows) + 0.6)))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set(xlim=(0.0, 100.0), ylim=(-6.0, ROW * len(rows)), aspect="equal")
        axes.axis("off")
        for room, below in reduce_arrows(imports):
            (x, y), (u, v) = places[room], places[below]
            axes.add_patch(
                FancyArrowPatch(
                    (x, y - HEIGHT / 2), (u, v + HEIGHT / 2), arrowstyle="-|>", mutation_scale=11.0, color=ARROW,
                    lw=0.9, alpha=0.75, shrinkA=0.0, shrinkB=0.0,
                )
            )  # fmt: skip
        for room, (x, y) in places.items():
            corner = x - WIDTH / 2, y - HEIGHT / 2
            shape = FancyBboxPatch(
                corner, WIDTH, HEIGHT, boxstyle="round,pad=0,rounding_size=1", fc=colours.get(room, "#FFFFFF"), ec=INK
            )
            axes.add_patch(shape)
            axes.text(x, y, room, ha="center", va="center", color=INK, weight="bold")
        for k, (kind, (colour, _)) in enumerate(KINDS.items()):
            axes.text(14.0 + 24.0 * k, -3.5, kind, ha="center", va="center", bbox={"fc": colour, "ec": INK, "pad": 4.0})
        figure.savefig(output, dpi=150, metadata={"Date": None} if output.suffix == ".svg" else None)


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("rooms.svg"))
