"""The mechanism, projected from the numbers of paper.toml, and the signs of roll, pitch and yaw."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ps_fmu.mechanism.parameters import Manipulator, Parameters, load
from ps_fmu.theory.loop import loop_at

from .drawing import Drawing, Point

COARSE, FINE, FRAME = "blue", "orange", "green"
AZIMUTH, ELEVATION = math.radians(-64.0), math.radians(21.0)  # of the eye: about z of B from x, above the base
SCALE = 590.0  # px per m
BASE_RADIUS, PLATFORM_RADIUS = 0.29, 0.135  # m, of the plates: drawn, no parameters

Place = Callable[[Sequence[float]], Point]


def draw_mechanism() -> Drawing:
    """Side view, view along the boresight, and the spacecraft that carries the mechanism."""
    drawing = Drawing(
        "The mechanism, its frames and signs",
        "Three coarse legs and three fine legs lead from joints on the base B, which is fixed on the bus, to joints on "
        "the platform P, which carries the payload. The boresight is z of P. Roll, pitch and yaw are right-handed "
        "turns about x, y and z. The centre of mass of the bus lies 2 m below B, between the solar arrays.",
        720.0,
    )
    parameters = load()
    _draw_side(drawing, parameters)
    _draw_plan(drawing, parameters.manipulator)
    _draw_spacecraft(drawing, parameters)
    _draw_legend(drawing)
    return drawing


def _draw_side(drawing: Drawing, parameters: Parameters) -> None:
    """The mechanism at its nominal pose from the side."""
    manipulator, payload = parameters.manipulator, parameters.payload
    across = np.array([-math.sin(AZIMUTH), math.cos(AZIMUTH), 0.0])
    toward = np.array([math.cos(AZIMUTH) * math.cos(ELEVATION), math.sin(AZIMUTH) * math.cos(ELEVATION), 0.0])
    toward[2] = math.sin(ELEVATION)
    up = np.cross(toward, across)
    nominal_B = manipulator.nominal_translation_B

    def place(point_B: Sequence[float]) -> Point:
        """px of a point in B [m]."""
        return 200.0 + SCALE * float(across @ point_B), 555.0 - SCALE * float(up @ point_B)

    def place_P(point_P: Sequence[float]) -> Point:
        """px of a point in P [m]."""
        return place(nominal_B + np.asarray(point_P))

    top = payload.truss_modes[0].position_P
    drawing.area(_ring(place, BASE_RADIUS), "raised", "soft")
    legs = [(leg, kind, n) for kind in (COARSE, FINE) for n, leg in enumerate(_list_legs(manipulator, kind), 1)]
    legs.sort(key=lambda leg: float(toward @ leg[0].base_joint_B))
    for leg, kind, number in legs[:3]:
        _draw_leg(drawing, place(leg.base_joint_B), place_P(leg.platform_joint_P), kind, number)
    drawing.area(_ring(place_P, PLATFORM_RADIUS), "raised", "soft")
    rim = _ring(place_P, PLATFORM_RADIUS, top[2])
    for side in (min(rim), max(rim)):
        drawing.line([side, (side[0], place_P((0.0, 0.0, 0.0))[1])], "soft", 1.0, dash="5 4")
    drawing.line(rim, "soft", 1.0, dash="5 4")
    for leg, kind, number in legs[3:]:
        _draw_leg(drawing, place(leg.base_joint_B), place_P(leg.platform_joint_P), kind, number)

    _draw_axis(drawing, place, (0.34, 0.0, 0.0), "x of B", (0, 18))
    _draw_axis(drawing, place, (0.0, 0.4, 0.0), "y of B", (30, 0))
    _draw_axis(drawing, place, (0.0, 0.0, 0.14), "z", (-11, 2))
    _draw_axis(drawing, place_P, (0.31, 0.0, 0.0), "x of P", (0, 18))
    _draw_axis(drawing, place_P, (0.0, 0.5, 0.0), "y of P", (30, 0))
    _draw_axis(drawing, place_P, (0.0, 0.0, 0.54), "z of P, boresight", (0, -14))
    for axis, at, name, shift in (
        (0, 0.25, "+roll", (0, -38)),
        (1, 0.43, "+pitch", (6, -32)),
        (2, 0.47, "+yaw", (54, 4)),
    ):
        turn = [np.roll((at, 0.045 * math.cos(a), 0.045 * math.sin(a)), axis) for a in np.linspace(-2.3, 2.0, 24)]
        drawing.line(map(place_P, turn), FRAME, 1.8, ends=">")
        centre = place_P(np.roll((at, 0.0, 0.0), axis))
        drawing.text(centre[0] + shift[0], centre[1] + shift[1], name, FRAME, halo=True)
    drawing.mark_mass(place_P(payload.com_P))
    _draw_truss_mass(drawing, place_P(top))


def _list_legs(manipulator: Manipulator, kind: str):
    return manipulator.coarse_legs if kind == COARSE else manipulator.fine_legs


def _ring(place: Place, radius: float, height: float = 0.0) -> list[Point]:
    """px of a circle about z [m]."""
    return [place((radius * math.cos(a), radius * math.sin(a), height)) for a in np.linspace(0.0, 2.0 * math.pi, 73)]


def _draw_leg(drawing: Drawing, base: Point, platform: Point, kind: str, number: int) -> None:
    """A leg with its joints, the number at the one on the base; a fine leg has its voice coil in the middle."""
    drawing.line([base, platform], "paper", 9.0)
    drawing.line([base, platform], kind, 5.0 if kind == COARSE else 3.0)
    if kind == FINE:
        drawing.line([_between(base, platform, 0.3), _between(base, platform, 0.6)], FINE, 12.0)
        drawing.line([_between(base, platform, 0.31), _between(base, platform, 0.59)], "pale-orange", 9.0)
    drawing.disc(platform, 4.5, "paper", kind)
    drawing.disc(base, 10.0, kind)
    drawing.text(*base, str(number), "paper", bold=True)


def _between(first: Point, last: Point, share: float) -> Point:
    return first[0] + share * (last[0] - first[0]), first[1] + share * (last[1] - first[1])


def _draw_axis(drawing: Drawing, place: Place, tip: Sequence[float], name: str, shift: Point) -> None:
    """An axis of a frame from its origin, m; the name is shifted from the tip by px."""
    end = place(tip)
    drawing.line([place((0.0, 0.0, 0.0)), end], FRAME, 2.0, ends=">")
    drawing.text(end[0] + shift[0], end[1] + shift[1], name, FRAME, halo=True)


def _draw_truss_mass(drawing: Drawing, centre: Point) -> None:
    x, y = centre
    drawing.area([(x, y - 8), (x + 8, y), (x, y + 8), (x - 8, y)], "purple", "paper")


def _draw_plan(drawing: Drawing, manipulator: Manipulator) -> None:
    """The joints, seen along the boresight from above."""
    origin, scale = (560.0, 190.0), 400.0  # px, px per m
    drawing.text(origin[0], 32.0, "seen from above, along -z", "soft")

    def place(point: Sequence[float]) -> Point:
        return origin[0] + scale * point[0], origin[1] - scale * point[1]

    drawing.disc(origin, scale * BASE_RADIUS, "raised", "soft")
    drawing.disc(origin, scale * PLATFORM_RADIUS, "paper", "soft")
    for kind in (COARSE, FINE):
        for number, leg in enumerate(_list_legs(manipulator, kind), 1):
            base, platform = place(leg.base_joint_B), place(leg.platform_joint_P)
            drawing.line([base, platform], kind, 3.0)
            drawing.disc(platform, 4.0, "paper", kind)
            drawing.disc(base, 10.0, kind)
            drawing.text(*base, str(number), "paper", bold=True)
    for axis, name, shift in (((0.16, 0.0), "x", (4, 14)), ((0.0, 0.16), "y", (14, 2))):
        tip = place(axis)
        drawing.line([origin, tip], FRAME, 2.0, ends=">")
        drawing.text(tip[0] + shift[0], tip[1] + shift[1], name, FRAME, halo=True)
    drawing.disc(origin, 5.0, "paper", FRAME)
    drawing.disc(origin, 2.0, FRAME)


def _draw_spacecraft(drawing: Drawing, parameters: Parameters) -> None:
    """The bus with its arrays, seen along x of B; a mode's mass and lever follow from its participation."""
    bus = parameters.bus
    origin, scale = (560.0, 395.0), 25.0  # px of B, px per m
    mode = bus.modes[0].participation_B
    arm, height = abs(mode[5] / mode[0]), mode[4] / mode[0]  # m: where the array's modal mass is

    def place(y: float, z: float) -> Point:
        return origin[0] + scale * y, origin[1] - scale * z

    left, below = place(-arm, height), place(0.0, bus.com_B[2])
    for side in (-1.0, 1.0):
        x, y = place(side * arm, height)
        drawing.line([(origin[0] + side * 50.0, y), (x, y)], "soft", 2.0)
        drawing.box(x - 42.0 if side > 0 else x - 18.0, y - 5.0, 60.0, 10.0, "pale-blue", "soft", 0)
        drawing.disc((x, y), 4.0, "soft")
    drawing.box(origin[0] - 50.0, origin[1], 100.0, 108.0, "raised", "soft", 2)
    drawing.area([(origin[0] - 13, origin[1]), (origin[0] + 13, origin[1]), (origin[0] + 6, origin[1] - 14),
                  (origin[0] - 6, origin[1] - 14)], "pale-orange", "soft")  # fmt: skip
    drawing.box(origin[0] - 6, origin[1] - 32, 12, 18, "paper", "soft", 0)
    drawing.mark_mass(below)
    drawing.line([(origin[0] + 28, origin[1]), (origin[0] + 28, below[1])], "ink", 1.2, ends="<>")
    drawing.text(origin[0] + 36, 0.5 * (origin[1] + below[1]), f"{-bus.com_B[2]:g} m", anchor="start", halo=True)
    drawing.text(left[0], left[1] + 24, f"array mode:\n{mode[0] ** 2:.1f} kg", "soft")
    drawing.text(origin[0] + 18, origin[1] - 22, "B, mechanism", FRAME, anchor="start")
    drawing.text(below[0], below[1] + 24, "bus")
    drawing.text(place(arm, height)[0] - 4, left[1] + 24, f"{arm:.1f} m\nout", "soft")
    drawing.text(origin[0], 548, "seen along -x", "soft")
    drawing.text(origin[0], 592, "Rz(yaw) Ry(pitch) Rx(roll) maps\ncomponents in P to those in B", FRAME)


def _draw_legend(drawing: Drawing) -> None:
    """What the marks mean."""
    drawing.line([(24, 660), (60, 660)], COARSE, 5.0)
    drawing.text(70, 660, "coarse leg: points the payload", anchor="start")
    drawing.line([(24, 690), (60, 690)], FINE, 3.0)
    drawing.line([(33, 690), (51, 690)], FINE, 12.0)
    drawing.line([(34, 690), (50, 690)], "pale-orange", 9.0)
    drawing.text(70, 690, "fine leg, voice coil: isolates", anchor="start")
    drawing.disc((328, 660), 4.5, "paper", "ink")
    drawing.text(342, 660, "joint", anchor="start")
    drawing.mark_mass((328, 690))
    drawing.text(342, 690, "centre of mass", anchor="start")
    _draw_truss_mass(drawing, (490, 660))
    drawing.text(504, 660, "mass of the truss modes", anchor="start")
    drawing.disc((490, 690), 4.0, "soft")
    drawing.text(504, 690, "mass of an array mode", anchor="start")


def draw_host_frames() -> Drawing:
    """Frames of a mechanism on a host's spacecraft, and what host and plant exchange."""
    parameters = load()
    locked = loop_at(parameters).model.dynamics.locked  # mass matrix, B axes at its origin
    drawing = Drawing(
        "The mechanism on the spacecraft of a host simulator",
        "The host moves the hub, whose body frame is H. The base B of the mechanism has a place and an orientation in "
        "H. The host gives the motion of B to the plant FMU. The plant gives back force and torque on the hub at the "
        f"origin of B, and the locked mass of legs and payload, {locked[0, 0]:.1f} kg, which the host adds to its hub. "
        f"Its centre of mass, locked_com, lies {locked[4, 0] / locked[0, 0]:.2f} m above the origin of B.",
        500.0,
    )
    # The hub, with B on a face that is turned about the axis towards the reader.
    hub, base, turn, scale = (160.0, 390.0), (262.0, 300.0), math.radians(-20.0), 260.0  # px, px; of B in H; px per m
    drawing.area([(50, 285), (221, 285), (303, 315), (303, 480), (50, 480)], "raised", "soft")

    def place(y: float, z: float) -> Point:
        """px of a point in B, m."""
        return (
            base[0] + scale * (y * math.cos(turn) - z * math.sin(turn)),
            base[1] - scale * (y * math.sin(turn) + z * math.cos(turn)),
        )

    height = float(parameters.manipulator.nominal_translation_B[2])
    for foot, head, kind in ((-0.16, -0.1, FINE), (-0.08, -0.02, COARSE), (0.08, 0.02, COARSE), (0.16, 0.1, FINE)):
        drawing.line([place(foot, 0.0), place(head, height)], kind, 3.5 if kind == COARSE else 2.5)
    corners = [place(-0.13, height), place(0.13, height), place(0.13, height + 0.38), place(-0.13, height + 0.38)]
    drawing.area(corners, "raised", "soft")
    for origin, tips, name, shift in (
        (hub, ((hub[0] + 75, hub[1]), (hub[0], hub[1] - 75)), "H", (-16, 12)),
        (base, (place(0.27, 0.0), place(0.0, 0.22)), "B", (4, 18)),
        (place(0.0, height), (place(0.27, height), place(0.0, height + 0.5)), "P", (12, 20)),
    ):
        for tip in tips:
            drawing.line([origin, tip], FRAME, 2.2, ends=">")
        drawing.text(origin[0] + shift[0], origin[1] + shift[1], name, FRAME, bold=True, halo=True)
    drawing.line([hub, base], "ink", 1.5, dash="5 4", ends=">")
    drawing.text(hub[0] + 52, hub[1] - 18, "mounting", anchor="start", halo=True)
    drawing.text(place(0.0, height + 0.5)[0], place(0.0, height + 0.5)[1] - 16, "boresight", FRAME)
    mark = place(*(float(moment / locked[0, 0]) for moment in (locked[3, 2], locked[4, 0])))  # mass times com_B: y, z
    drawing.line([mark, (190, mark[1])], "ink", 1.0)
    drawing.mark_mass(mark)
    drawing.text(184, mark[1], "locked_com", anchor="end")
    drawing.text(70, 460, "hub of the host", "soft", anchor="start")
    drawing.box(480, 60, 200, 66, "pale-blue", "ink")
    drawing.text(580, 82, "ManipulatorPlant", bold=True)
    drawing.text(580, 104, "base = prescribed", size=14)
    drawing.box(480, 400, 200, 66, "raised", "ink")
    drawing.text(580, 422, "host simulator", bold=True)
    drawing.text(580, 444, "hub, wheels, control", size=14)
    drawing.line([(510, 400), (510, 126)], "orange", 2.2, ends=">")
    drawing.text(
        500, 330, "acceleration,\nangular acceleration,\nangular velocity of B", "orange", anchor="end", size=14
    )
    drawing.line([(650, 126), (650, 400)], "blue", 2.2, ends=">")
    drawing.text(
        640, 180, "bus_force\nbus_torque\nlocked_mass\nlocked_com\nlocked_inertia", "blue", anchor="end", size=14
    )
    return drawing
