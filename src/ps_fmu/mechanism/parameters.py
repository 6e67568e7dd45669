"""The parameter set of the manipulator, its payload and its bus, as frozen dataclasses that check themselves.

SI units throughout.  A field's metadata holds its unit and a one-line description: the FMI variables, the
documentation and the error messages are made from them, so that each is written down once.  Frames: ``B`` is
the manipulator base on the bus, ``P`` the payload platform; ``R = Rz(yaw) Ry(pitch) Rx(roll)`` maps components
in P to components in B (eq 14 of the paper).

The values are in ``paper.toml``; :func:`load` reads them.
"""

from __future__ import annotations

import difflib
import pkgutil
import reprlib
import tomllib
from collections.abc import Iterable
from dataclasses import MISSING, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from .kinematics import LARGEST_CONDITION, Geometry, condition_number, platform_jacobian
from .modes import (
    MOST_BUS_MODES,
    MOST_PAYLOAD_MODES,
    MOST_TRUSS_MODES,
    BusMode,
    PayloadMode,
    TrussMode,
    check_modal_mass,
    fill_places,
)
from .quantities import Array, Checked, ParameterError, check_inertia, freeze, quantity

PAPER = Path(__file__).with_name("paper.toml")

#: Bytes of a parameter file that is read; paper.toml has 11 kB.
LONGEST_FILE = 1_000_000

#: Order of the low-pass M(s) that the isolator has states for.
LARGEST_ORDER = 9


@dataclass(frozen=True)
class LegPart(Checked):
    """The lower or the upper part of a leg, slender and symmetric about the leg's axis (eq A12)."""

    mass: float = quantity("kg", "Mass of this part of the leg", at_least=0.0)
    com_distance: float = quantity("m", "Distance of the centre of mass from the part's own joint, along the leg")
    radial_inertia: float = quantity(
        "kg.m2", "Moment of inertia of this part about a radial axis through its centre of mass", at_least=0.0
    )


@dataclass(frozen=True, eq=False)
class CoarseLeg(Checked):
    """A coarse leg: joints, lower and upper part."""

    base_joint_B: Array = quantity("m", "Joint on the base, in B", shape=(3,))
    platform_joint_P: Array = quantity("m", "Joint on the platform, in P", shape=(3,))
    lower: LegPart = quantity("", "Part at the base")
    upper: LegPart = quantity("", "Part at the platform")


@dataclass(frozen=True, eq=False)
class FineLeg(CoarseLeg):
    """A fine leg: a coarse leg's fields, and the suspension of its voice-coil actuator (eq 18)."""

    stiffness: float = quantity("N/m", "Axial stiffness of the diaphragm springs", above=0.0)
    damping: float = quantity("N.s/m", "Electromagnetic damping of the actuator", at_least=0.0)


@dataclass(frozen=True)
class CoarseRods(Checked):
    """Axial flexibility of the coarse rods; stiffness zero means rigid rods."""

    axial_stiffness: float = quantity("N/m", "Axial stiffness of each coarse rod; 0 = rigid", at_least=0.0)
    damping_ratio: float = quantity("1", "Damping ratio of each rod with the mass that it carries", at_least=0.0)


@dataclass(frozen=True, eq=False)
class Manipulator(Checked):
    """The six legs and the nominal pose."""

    nominal_translation_B: Array = quantity("m", "Origin of P at zero roll, pitch and yaw, in B", shape=(3,))
    coarse_stroke: Array = quantity("m", "Range of the coarse actuators about their nominal length", shape=(2,))
    coarse_legs: tuple[CoarseLeg, ...] = quantity("", "Coarse legs")
    fine_legs: tuple[FineLeg, ...] = quantity("", "Fine legs")
    coarse_rods: CoarseRods = quantity("", "Flexibility of the coarse rods")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.coarse_stroke[0] < 0.0 < self.coarse_stroke[1]:
            raise ParameterError(
                "coarse_stroke", f"min must be below 0 and max above, got {self.coarse_stroke.tolist()} m"
            )
        for name in ("coarse_legs", "fine_legs"):
            if len(getattr(self, name)) != 3:
                raise ParameterError(name, f"the mechanism has three, got {len(getattr(self, name))}")
        self._check_geometry()

    def _check_geometry(self) -> None:
        geometry = self.geometry
        names = [f"{kind}_leg_{i}" for kind in ("coarse", "fine") for i in (1, 2, 3)]
        for name, length in zip(names, geometry.nominal_lengths, strict=True):
            if length < 1e-3:  # m; a leg shorter than this has no direction worth the name
                raise ParameterError(name, f"its two joints coincide at the nominal pose (length {length:g} m)")
        condition = float("inf")  # all platform joints in one point
        if np.any(geometry.platform_joints_P):
            J_lp = platform_jacobian(geometry, geometry.nominal_translation_B, np.eye(3))
            condition = float(condition_number(geometry, J_lp))
        if not condition <= LARGEST_CONDITION:
            raise ParameterError(
                "geometry",
                f"the six legs are singular at the nominal pose (|J_lp| = 0, eq 12; condition number {condition:.1e}, "
                f"at most {LARGEST_CONDITION:.0e}); move the joints apart",
            )

    @cached_property
    def geometry(self) -> Geometry:
        """The joints as arrays."""
        legs: tuple[CoarseLeg, ...] = self.coarse_legs + self.fine_legs
        return Geometry(
            base_joints_B=np.array([leg.base_joint_B for leg in legs]),
            platform_joints_P=np.array([leg.platform_joint_P for leg in legs]),
            nominal_translation_B=self.nominal_translation_B,
            coarse_stroke=self.coarse_stroke,
        )


@dataclass(frozen=True, eq=False)
class Payload(Checked):
    """Payload and platform as one body, and the modes of the payload's truss."""

    mass: float = quantity("kg", "Mass of payload and platform, truss included", above=0.0)
    com_P: Array = quantity("m", "Centre of mass of payload and platform, in P", shape=(3,))
    inertia_P: Array = quantity("kg.m2", "Inertia of payload and platform about their centre of mass, in P")
    truss_modes: tuple[TrussMode, ...] = quantity("", "Truss modes")
    modes: tuple[PayloadMode, ...] = quantity("", "Flexible modes beside those of the truss", default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set("inertia_P", check_inertia(self.inertia_P, "inertia"))
        named: list[tuple[str, TrussMode | PayloadMode]] = [
            *((f"truss_mode_{i}.mass", mode) for i, mode in enumerate(self.truss_modes, 1)),
            *((f"mode_{i}.participation", mode) for i, mode in enumerate(self.modes, 1)),
        ]
        participations = ((name, mode.participation_at(self.com_P)) for name, mode in named if mode.active)
        check_modal_mass(self.mass, self.inertia_P, participations)


@dataclass(frozen=True, eq=False)
class Bus(Checked):
    """The spacecraft bus (the paper's support module)."""

    mass: float = quantity("kg", "Mass of the bus", above=0.0)
    com_B: Array = quantity("m", "Centre of mass of the bus, in B", shape=(3,))
    inertia_B: Array = quantity("kg.m2", "Inertia of the bus about its centre of mass, in B")
    modes: tuple[BusMode, ...] = quantity("", "Flexible modes")

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set("inertia_B", check_inertia(self.inertia_B, "inertia"))
        check_modal_mass(
            self.mass,
            self.inertia_B,
            (
                (f"mode_{i}.participation", mode.participation_at(self.com_B))
                for i, mode in enumerate(self.modes, 1)
                if mode.active
            ),
        )


@dataclass(frozen=True)
class CoarseServo(Checked):
    """Position servo of each coarse actuator: second order, its command limited in rate."""

    frequency: float = quantity("Hz", "Natural frequency of the coarse servos", above=0.0)
    damping_ratio: float = quantity("1", "Damping ratio of the coarse servos", above=0.0)
    rate_limit: float = quantity("m/s", "Largest rate of the reference that a coarse servo follows", above=0.0)


@dataclass(frozen=True)
class Optics(Checked):
    """The optical payload as far as line of sight and image point need it: boresight along z of P."""

    focal_length: float = quantity("m", "Effective focal length: image-point displacement per radian", above=0.0)
    truss_sensitivity: float = quantity(
        "rad/m", "Rotation of the boresight per displacement of a truss mode's mass across it"
    )


@dataclass(frozen=True)
class FeedforwardFilters(Checked):
    """Filters of the practical controller (eq 55): Chebyshev II low-pass M(s), high-pass inside H1(s) and H2(s)."""

    lowpass_order: int = quantity(
        "1", "Order of the Chebyshev type II low-pass M(s), odd", at_least=1, at_most=LARGEST_ORDER
    )
    lowpass_stop_frequency: float = quantity("Hz", "Stop-band edge of the low-pass", above=0.0)
    lowpass_stop_attenuation: float = quantity(
        "dB", "Stop-band attenuation of the low-pass", above=0.0, at_most=200.0  # doubles hold 300
    )
    highpass_frequency: float = quantity("Hz", "Corner frequency of the second-order high-pass", above=0.0)
    highpass_damping_ratio: float = quantity("1", "Damping ratio of the second-order high-pass", above=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        # An even order passes 10^(-attenuation/20) straight through: an algebraic loop with the plant.
        if self.lowpass_order % 2 == 0:
            raise ParameterError("lowpass_order", f"expected an odd whole number, got {self.lowpass_order}")


@dataclass(frozen=True, eq=False)
class Noise(Checked):
    """Band-limited white disturbance wrench on the bus."""

    band: Array = quantity("Hz", "Lower and upper edge of the noise band", shape=(2,))
    wrench_psd_B: Array = quantity(
        "N2/Hz|N2.m/Hz|N2.m2/Hz",
        "One-sided power spectral density of force (f) and torque (t) at the bus centre of mass, in B",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.band[0] < self.band[1]:
            raise ParameterError("band", f"expected 0 < min < max, got {self.band.tolist()} Hz")
        psd = freeze(self.wrench_psd_B, (6, 6), "wrench_psd")
        if not np.allclose(psd, psd.T, rtol=0.0, atol=1e-9 * max(np.abs(psd).max(), 1e-300)):
            raise ParameterError("wrench_psd", "must be symmetric")
        if np.linalg.eigvalsh(psd)[0] < -1e-6 * max(np.trace(psd), 1e-300):
            raise ParameterError("wrench_psd", "must be positive semi-definite")
        self._set("wrench_psd_B", psd)


@dataclass(frozen=True, eq=False)
class Parameters:
    """Everything that the paper's system needs."""

    manipulator: Manipulator
    payload: Payload
    bus: Bus
    servo: CoarseServo
    optics: Optics
    filters: FeedforwardFilters
    known_com_P: Array
    noise: Noise

    def fill_places(self) -> Parameters:
        """The set with as many modes as the FMU of the plant holds: unused ones in the places that are left.

        Raises ParameterError for more modes than that; the text names them and the number that fits.
        """
        truss = fill_places("payload.truss_modes", self.payload.truss_modes, TrussMode, MOST_TRUSS_MODES)
        modes = fill_places("payload.modes", self.payload.modes, PayloadMode, MOST_PAYLOAD_MODES)
        of_bus = fill_places("bus.modes", self.bus.modes, BusMode, MOST_BUS_MODES)
        payload, bus = replace(self.payload, truss_modes=truss, modes=modes), replace(self.bus, modes=of_bus)
        return replace(self, payload=payload, bus=bus)


def load(path: Path | None = None, bus: str = "OSM") -> Parameters:
    """Read a parameter set.

    Parameters
    ----------
    path: a TOML file of the layout of ``paper.toml`` (default: that file).
    bus: which table below ``[bus]`` to take, ``"OSM"`` (original) or ``"LSM"`` (lighter support module).

    Raises
    ------
    ParameterError: an entry is missing, unknown or impossible; the text names it.
    """
    table = _PAPER_TABLE if path is None else read_table(path)
    path = PAPER if path is None else path
    buses = _entry(table, "bus", "")
    if not isinstance(buses, dict) or bus not in buses:
        raise ParameterError("bus", f"no table [bus.{bus}] in {path.name}")
    return make_parameters(table, buses[bus], f"bus.{bus}")


def read_table(path: Path) -> dict[str, Any]:
    """The content of a TOML file.  Raises ParameterError, naming the file: none, too long, or not TOML."""
    if not path.is_file():
        raise ParameterError(str(path), "there is no such file")
    if path.stat().st_size > LONGEST_FILE:
        raise ParameterError(str(path), f"has {path.stat().st_size} bytes; at most {LONGEST_FILE} are read")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ParameterError(str(path), f"not a TOML file: {error}") from error
    except RecursionError:
        raise ParameterError(str(path), "not a TOML file to read: its values are nested too deeply") from None


# Read when the module is: an FMU's folder goes with its first instance, while others still run its code.  By the
# module's loader: an FMU has its modules in an archive.
_PAPER_TABLE = tomllib.loads((pkgutil.get_data(__name__, PAPER.name) or b"").decode())


def make_parameters(table: dict[str, Any], bus: Any, bus_name: str) -> Parameters:
    """A parameter set from the tables of a file and the table of its bus; errors as in :func:`load`.

    ``bus_name``: how errors name the table of the bus.
    """
    return Parameters(
        manipulator=build(Manipulator, _entry(table, "manipulator", ""), "manipulator"),
        payload=build(Payload, _entry(table, "payload", ""), "payload"),
        bus=build(Bus, bus, bus_name),
        servo=build(CoarseServo, _entry(table, "servo", ""), "servo"),
        optics=build(Optics, _entry(table, "optics", ""), "optics"),
        filters=build(FeedforwardFilters, _entry(table, "filters", ""), "filters"),
        known_com_P=freeze(
            _entry(_entry(table, "isolator", ""), "known_com_P", "isolator"), (3,), "isolator.known_com_P"
        ),
        noise=build(Noise, _entry(table, "noise", ""), "noise"),
    )


_NESTED: dict[str, type] = {
    "lower": LegPart,
    "upper": LegPart,
    "coarse_legs": CoarseLeg,
    "fine_legs": FineLeg,
    "coarse_rods": CoarseRods,
    "truss_modes": TrussMode,
}
_MODES: dict[str, type] = {"Payload": PayloadMode, "Bus": BusMode}


def _entry(table: dict[str, Any], key: str, where: str) -> Any:
    try:
        return table[key]
    except (KeyError, TypeError):
        raise ParameterError(f"{where}.{key}".lstrip("."), "missing") from None


def refuse_unknown(table: Iterable[str], known: Iterable[str], where: str) -> None:
    """Raise ParameterError for a key of ``table`` that is not in ``known``, with the names that are nearest to it."""
    names = list(known)
    for key in table:
        if key not in names:
            near = difflib.get_close_matches(key, names, n=2, cutoff=0.6)
            hint = f"did you mean {' or '.join(near)}? " if near else ""
            name = f"{where}.{reprlib.repr(key)[1:-1]}".lstrip(".")
            raise ParameterError(name, f"unknown; {hint}expected one of {', '.join(names)}")


def build(cls: type, table: Any, where: str) -> Any:
    """An instance of a parameter class from a TOML table; errors have the entry's name behind ``where``."""
    if not isinstance(table, dict):
        raise ParameterError(where, f"expected a table, got {reprlib.repr(table)}")
    names = [f.name for f in fields(cls)]
    refuse_unknown(table, names, where)
    values: dict[str, Any] = {}
    for f in fields(cls):
        name = f.name
        if name not in table and f.default is not MISSING:
            continue
        value = _entry(table, name, where)
        nested = _MODES[cls.__name__] if name == "modes" else _NESTED.get(name)
        if nested is not None and isinstance(value, list):
            value = tuple(build(nested, item, f"{where}.{name}[{i}]") for i, item in enumerate(value, 1))
        elif nested is not None:
            value = build(nested, value, f"{where}.{name}")
        values[name] = value
    try:
        return cls(**values)
    except ParameterError as error:
        raise ParameterError(f"{where}.{error.name}", error.problem) from None
