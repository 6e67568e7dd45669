"""A technical drawing as SVG: texts stay texts, and the colours follow the light or dark scheme of the reader.

Coordinates are pixels at full width, x to the right and y down.  The type is large enough for half that width, as on a
telephone.  A drawing depends on its data alone: the same data give the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

Point = tuple[float, float]

WIDTH = 700.0  # px: of a page of the documentation

# For a light and for a dark page.  Contrast of texts with the paper: 4.5 and more.
COLOURS = {
    "paper": ("#ffffff", "#14181e"),
    "ink": ("#222222", "#e6e6e6"),
    "soft": ("#555555", "#a9b0b8"),
    "grid": ("#d8dbdf", "#3a4149"),
    "raised": ("#f1f4f7", "#22282f"),
    "blue": ("#0068a3", "#56b4e9"),
    "orange": ("#b84e00", "#ff9a57"),
    "green": ("#00704f", "#2fcf9f"),
    "purple": ("#93407c", "#e6a3c8"),
    "pale-blue": ("#dfeef9", "#1b3345"),
    "pale-orange": ("#fbe8d9", "#46301d"),
    "pale-green": ("#dcf1e8", "#15382d"),
    "pale-purple": ("#f4e4f0", "#3d2738"),
}
SIZE = 15  # px
_HEAD = 9.0  # px: length of the head of an arrow
_LEADING = 1.25


class Drawing:
    """A picture that grows by its methods; :meth:`render` gives the text of the file.

    Parameters
    ----------
    title, description: what screen readers read.
    height: px.
    """

    def __init__(self, title: str, description: str, height: float) -> None:
        self.title, self.description, self.height = title, description, height
        self._parts: list[str] = []

    def line(
        self,
        points: Iterable[Point],
        colour: str = "ink",
        width: float = 1.5,
        *,
        dash: str = "",
        ends: str = "",
        opacity: float = 1.0,
    ) -> None:
        """Draw straight lines through the points; ``ends``: ">" for an arrow at the end, "<>" at both ends."""
        through = list(points)
        heads = []
        for sign, place, before in ((">", -1, -2), ("<", 0, 1)):
            if sign in ends:
                tip, tail = through[place], through[before]
                heads.append(_make_head(tip, tail, width))
                through[place] = _shorten(tip, tail, 0.7 * _HEAD)
        more = (f' stroke-dasharray="{dash}"' if dash else "") + (f' opacity="{opacity:g}"' if opacity < 1.0 else "")
        self._parts.append(f'<path class="s-{colour}" stroke-width="{width:g}"{more} d="M{_join(through)}"/>')
        for head in heads:
            self.area(head, colour)

    def area(self, points: Iterable[Point], fill: str, edge: str = "", *, opacity: float = 1.0) -> None:
        """Fill a polygon."""
        more = f' fill-opacity="{opacity:g}"' if opacity < 1.0 else ""
        self._parts.append(f'<path class="f-{fill}{f" s-{edge}" if edge else ""}"{more} d="M{_join(points)}Z"/>')

    def box(
        self, x: float, y: float, width: float, height: float, fill: str, edge: str = "", radius: float = 6
    ) -> None:
        """Draw a rectangle from its left upper corner."""
        kinds = f"f-{fill}" + (f" s-{edge}" if edge else "")
        self._parts.append(
            f'<rect class="{kinds}" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="{radius:g}"/>'
        )

    def disc(self, centre: Point, radius: float, fill: str, edge: str = "") -> None:
        """Draw a circle."""
        kinds = f"f-{fill}" + (f" s-{edge}" if edge else "")
        self._parts.append(f'<circle class="{kinds}" cx="{centre[0]:.1f}" cy="{centre[1]:.1f}" r="{radius:g}"/>')

    def mark_mass(self, centre: Point, radius: float = 7.0) -> None:
        """Draw the sign of a centre of mass: a disc with two black quarters."""
        x, y = centre
        self.disc(centre, radius, "paper", "ink")
        for sign in (1.0, -1.0):
            self._parts.append(
                f'<path class="f-ink" d="M{x:.1f},{y:.1f}l{sign * radius:.1f},0'
                f'a{radius:g},{radius:g} 0 0 0 {-sign * radius:.1f},{-radius * sign:.1f}Z"/>'
            )

    def text(
        self,
        x: float,
        y: float,
        text: str,
        colour: str = "ink",
        *,
        anchor: str = "middle",
        size: float = SIZE,
        bold: bool = False,
        halo: bool = False,
    ) -> None:
        """Write lines of text; y: middle of the first one.  anchor: "start", "middle" or "end" of the lines is at x.

        ``halo``: keep lines of the drawing off the letters.
        """
        kinds = f"f-{colour}" + (" halo" if halo else "") + (" bold" if bold else "")
        for k, line in enumerate(text.split("\n")):
            place = y + k * size * _LEADING + 0.35 * size
            self._parts.append(
                f'<text class="{kinds}" x="{x:.1f}" y="{place:.1f}" font-size="{size:g}" text-anchor="{anchor}">'
                f"{escape(line, quote=False)}</text>"
            )

    def render(self) -> str:
        """The file."""
        return "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {self.height:g}" width="{WIDTH:g}" '
                f'height="{self.height:g}" role="img" aria-labelledby="title description">',
                f'<title id="title">{escape(self.title, quote=False)}</title>',
                f'<desc id="description">{escape(self.description, quote=False)}</desc>',
                f"<style>\n{_STYLE}\n</style>",
                f'<rect class="f-paper" width="{WIDTH:g}" height="{self.height:g}" rx="8"/>',
                *self._parts,
                "</svg>\n",
            ]
        )


def arc(centre: Point, radius: float, first: float, last: float, points: int = 24) -> list[Point]:
    """Points on a circle from the angle ``first`` to ``last``, degrees from the x axis, positive upwards."""
    angles = [math.radians(first + (last - first) * k / (points - 1)) for k in range(points)]
    return [(centre[0] + radius * math.cos(a), centre[1] - radius * math.sin(a)) for a in angles]


def _make_head(tip: Point, tail: Point, width: float) -> list[Point]:
    """The head of an arrow to ``tip``."""
    half = 0.42 * _HEAD + 0.5 * width
    back = _shorten(tip, tail, _HEAD + width)
    length = math.dist(tip, tail) or 1.0
    across = half * (tip[1] - tail[1]) / length, -half * (tip[0] - tail[0]) / length
    return [tip, (back[0] + across[0], back[1] + across[1]), (back[0] - across[0], back[1] - across[1])]


def _shorten(tip: Point, tail: Point, by: float) -> Point:
    """The point ``by`` before the tip."""
    share = by / (math.dist(tip, tail) or 1.0)
    return tip[0] + share * (tail[0] - tip[0]), tip[1] + share * (tail[1] - tip[1])


def _join(points: Iterable[Point]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _list_rules(place: int) -> Sequence[str]:
    rules = [
        f".f-{name}{{fill:{values[place]}}}.s-{name}{{stroke:{values[place]}}}" for name, values in COLOURS.items()
    ]
    return [*rules, f".halo{{stroke:{COLOURS['paper'][place]}}}"]


_STYLE = "\n".join(
    [
        "path,rect,circle{fill:none;stroke-linejoin:round}",
        "text{font-family:system-ui,sans-serif}",
        ".bold{font-weight:600}",
        ".halo{stroke-width:4px;paint-order:stroke;stroke-linejoin:round}",
        *_list_rules(0),
        "@media (prefers-color-scheme:dark){",
        *_list_rules(1),
        "}",
    ]
)
