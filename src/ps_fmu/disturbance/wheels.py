"""Reaction-wheel harmonics with a speed profile.

Each harmonic is a vector in the wheel plane of amplitude C_i W^2 (W: wheel speed) that turns at h_i W.  It is a second
derivative, as the force of an unbalance is::

    f_i = -d2/dt2 [ R C_i / h_i^2 e_i ]    e_i: unit vector at the angle h_i theta + phase_i, theta' = W; R: fade-in
        = R C_i W^2 e_i - ...              the other terms act while the speed changes, W', and during the fade-in

So the momentum that it gives to a free body is bounded by that of a steady wheel, also after a run-up.  A speed that
jumps (a ramp of no duration) leaves momentum: there the second derivative would be an impulse, which is left out.

Order 1 is the imbalance: C_1 is the static imbalance U in kg.m, of the torque the dynamic imbalance D in kg.m2, so that
F = U W^2 and M = D W^2.  The other orders come from a CSV file, see :class:`HarmonicTable`.  The file beside this
module has the proportions of a small reaction wheel in the sample satellite of the spacecraft simulator S2E
(github.com/ut-issl/s2e-core), whose licence is beside it: there C_1 is 2.18e-7 kg.m and 6.30e-9 kg.m2, at order 1.01.

Left out: axial force, torque about the spin axis, structural modes of the wheel, gyroscopic moments.
"""

from __future__ import annotations

import csv
import pkgutil
import reprlib
from ctypes import addressof, c_int64
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..mechanism.parameters import Parameters
from ..mechanism.quantities import Array, Complex, ParameterError, quantity
from ..numerics import library
from ..numerics.library import find_address
from ..numerics.normal import Stream, make_key
from .kind import Kind, SharedSettings, Source
from .turning import Products, Speed, SpeedProfile, SpeedTable, plan_products


@dataclass(frozen=True, eq=False)
class Harmonics:
    """Orders h (n,) and coefficients C (n,) of one radial quantity."""

    orders: Array
    coefficients: Array


@dataclass(frozen=True, eq=False)
class HarmonicTable:
    """Orders h (n,) of a file with the coefficients C of radial force and torque (n, 2) there.

    The file has a header with the columns ``order [1]``, ``force [...]`` and ``torque [...]``, one of which may be
    missing.  ``relative``: of force and torque, whether coefficients are parts of the imbalance (unit 1), else they are
    in kg.m = N/(rad/s)^2 and kg.m2.
    """

    name: str
    orders: Array
    coefficients: Array
    relative: tuple[bool, bool]

    @classmethod
    def read(cls, text: str, name: str) -> HarmonicTable:
        """The content of a file; ``name`` is its name.

        Raises ParameterError, naming ``harmonics`` and the line: what is missing or no number, h <= 0 or C < 0, a unit
        that is not one of :data:`FORCE_UNITS` or :data:`TORQUE_UNITS`.
        """
        lines = csv.reader(text.splitlines())
        columns = [" ".join(field.split()).rstrip("]").partition(" [") for field in next(lines, [])]
        places = {column[0]: place for place, column in enumerate(columns)}
        if "order" not in places or not {"force", "torque"} & places.keys():
            expected = "'order [1]' and 'force [g.cm]' or 'torque [g.cm2]', or both"
            raise ParameterError("harmonics", f"{name}, line 1: expected the columns {expected}")
        scales = [1.0, 0.0, 0.0]
        for k, (kind, known) in enumerate((("order", {"1": 1.0}), ("force", FORCE_UNITS), ("torque", TORQUE_UNITS))):
            if kind in places:
                unit = columns[places[kind]][2].replace("^", "")
                if unit not in known:
                    problem = f"{kind} [{unit}]: expected one of the units {', '.join(known)}"
                    raise ParameterError("harmonics", f"{name}, line 1: {problem}")
                scales[k] = known[unit]
        rows = []
        kinds = ("order", "force", "torque")
        for number, fields in enumerate(lines, 2):
            if not "".join(fields).strip():
                continue
            try:
                given = [float(fields[places[kind]]) if kind in places else 0.0 for kind in kinds]
            except (ValueError, IndexError):
                problem = f"expected {len(columns)} numbers, got {reprlib.repr(fields)}"
                raise ParameterError("harmonics", f"{name}, line {number}: {problem}") from None
            if not (0.0 < given[0] < np.inf and min(given[1:]) >= 0.0 and max(given[1:]) < np.inf):
                problem = f"expected an order above 0 and coefficients of 0 or more, got {reprlib.repr(fields)}"
                raise ParameterError("harmonics", f"{name}, line {number}: {problem}")
            rows.append(given)
            if len(rows) > MOST_HARMONICS:
                raise ParameterError("harmonics", f"{name}: more than {MOST_HARMONICS} harmonics")
        found = np.array(rows).reshape(-1, 3) * scales
        relative = tuple(kind in places and columns[places[kind]][2] == "1" for kind in ("force", "torque"))
        return cls(name, found[:, 0], found[:, 1:], relative)  # type: ignore[arg-type]  # two of them

    @classmethod
    def read_file(cls, path: Path) -> HarmonicTable:
        """As :meth:`read`; raises ParameterError also for a file that is not there, too long or no text."""
        try:
            if not path.is_file():
                raise ParameterError("harmonics", f"no file {str(path)!r} (relative paths start at {Path.cwd()})")
            if path.stat().st_size > MOST_BYTES:
                raise ParameterError("harmonics", f"{path.name} has more than {MOST_BYTES} bytes")
            return cls.read(path.read_text(encoding="utf-8-sig"), path.name)
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise ParameterError("harmonics", f"{path.name} is no CSV file in UTF-8: {error}") from error

    def with_imbalance(self, imbalance: float, kind: int) -> Harmonics:
        """All harmonics of the force (``kind`` 0) or torque (1) with an imbalance, kg.m or kg.m2, at order 1.

        Raises ParameterError for an imbalance beside an order of the table that is as near to 1 as 2 %.
        """
        there = self.coefficients[:, kind] > 0.0
        orders, coefficients = self.orders[there], self.coefficients[there, kind]
        near = np.abs(orders - 1.0) < NEAR_ONE
        if imbalance and near.any():
            what = ("static_imbalance", "dynamic_imbalance")[kind]
            problem = f"{self.name} states order {orders[near][0]:g}, which is the imbalance, too"
            raise ParameterError(what, f"{problem}: set {what} to 0, or take that line out of the file")
        if self.relative[kind]:
            coefficients = imbalance * coefficients
        if not imbalance:
            return Harmonics(orders, coefficients)
        return Harmonics(np.concatenate([[1.0], orders]), np.concatenate([[imbalance], coefficients]))


_PER_RPM = (60.0 / (2.0 * np.pi)) ** 2  # (rad/s)2 over rpm2
FORCE_UNITS = {"kg.m": 1.0, "g.cm": 1e-5, "g.mm": 1e-6, "N/(rad/s)2": 1.0, "N/rpm2": _PER_RPM, "1": 1.0}
TORQUE_UNITS = {"kg.m2": 1.0, "g.cm2": 1e-7, "g.mm2": 1e-9, "N.m/(rad/s)2": 1.0, "N.m/rpm2": _PER_RPM, "1": 1.0}
MOST_HARMONICS, MOST_BYTES = 1000, 1_000_000
NEAR_ONE = 0.02  # orders as near to 1 as this are the imbalance
STATIC, DYNAMIC = 4.8e-6, 1.54e-6  # kg.m, kg.m2
"""Imbalance of a Honeywell HR16 of 100 N.m.s and 12 kg, 0.48 g.cm and 15.4 g.cm2: Constellation Series data sheet, as
quoted in Basilisk's ``simIncludeRW.py`` (github.com/AVSLab/basilisk)."""
# Read when the module is: an FMU's folder goes with its first instance, while others still run its code.
_PACKAGED = "wheel-harmonics.csv"
PACKAGED = HarmonicTable.read((pkgutil.get_data(__name__, _PACKAGED) or b"").decode(), _PACKAGED)  # from an archive
FORCE, TORQUE = PACKAGED.with_imbalance(STATIC, 0), PACKAGED.with_imbalance(DYNAMIC, 1)


class WheelSource(Source):
    """Wrench of one wheel on the bus, faded in from rest over the rise time.

    Parameters
    ----------
    profile: speed over time.
    spin_axis_B: direction of the spin axis (3,), any length but zero.
    position_B: centre of the wheel (3,), m.
    seed: initial phases of the harmonics.
    scale: factor on force and torque.
    rise_time: s.
    force, torque: harmonics (default: those of the default wheel).
    """

    function: ClassVar[str] = "add_wheel"

    def __init__(
        self,
        profile: Speed,
        spin_axis_B: Array,
        position_B: Array,
        seed: tuple[int, ...],
        scale: float = 1.0,
        rise_time: float = 2.0,
        force: Harmonics | None = None,
        torque: Harmonics | None = None,
    ) -> None:
        self.force, self.torque = force, torque = force or FORCE, torque or TORQUE
        self.profile = profile
        self._orders = np.concatenate([force.orders, torque.orders])
        random = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed)))
        self._phases = 2.0 * np.pi * random.random(self._orders.size)
        one_B, other_B = wheel_plane(spin_axis_B)
        # Wrench at the origin per squared speed: along the one direction with the cosine, the other with the sine.
        along = np.stack([self._wrenches(v, position_B) for v in (one_B, other_B)], axis=1)  # (2, 2, 6)
        coefficients = np.concatenate([force.coefficients, torque.coefficients])
        lines = scale * coefficients * np.exp(1j * self._phases)
        is_torque = np.arange(self._orders.size) >= force.orders.size
        self._amplitudes = lines[:, np.newaxis] * (along[:, 0] - 1j * along[:, 1])[is_torque.astype(np.intp)]
        plan = plan_products(tuple(dict.fromkeys(self._orders.tolist())))  # force and torque share orders
        which = [plan.place[order] for order in self._orders.tolist()]
        turning, kept = _make_turning(plan, which, _integrate(lines, self._orders), force.orders.size, along)
        room = library.allocate(2 * library.PART * (turning.n_multiples + turning.n_products))
        self.words = library.Wheel(turning, profile.describe(rise_time), find_address(room))
        self.words.kept = kept, room, profile

    @property
    def orders(self) -> Array:
        """Harmonics h (n,), those of the force before those of the torque."""
        return self._orders

    def amplitudes(self, speed: float) -> Complex:
        """Complex amplitudes a (n, 6), N and N.m in B at its origin, of the harmonics at a constant speed, rad/s.

        After the fade-in the wrench is the real part of the sum of ``a_i exp(j h_i angle)``.
        """
        return np.asarray(speed**2 * self._amplitudes)

    @staticmethod
    def _wrenches(direction_B: Array, position_B: Array) -> Array:
        """Wrenches at the origin of a force and of a torque along a direction, (2, 6)."""
        of_force = np.concatenate([direction_B, np.cross(position_B, direction_B)])
        return np.stack([of_force, np.concatenate([np.zeros(3), direction_B])])


def _integrate(amplitudes: Complex, orders: Array) -> Complex:
    """Amplitudes of the sums over harmonics (k, ...) and over their first and second integrals, (3, k, ...)."""
    per_order = (1.0 / orders).reshape(-1, *[1] * (amplitudes.ndim - 1))
    return np.stack([amplitudes, 1j * per_order * amplitudes, per_order**2 * amplitudes])


def _make_turning(
    plan: Products, which: list[int], amplitudes: Complex, n_force: int, along: Array
) -> tuple[library.Turning, object]:
    """Sums of what turns with the multiples of an angle, and what has to live as long.

    Parameters
    ----------
    plan: how their multiples are made.
    which: of these, of each harmonic of the force, then of the torque.
    amplitudes: of each sum, (m, k).
    n_force: how many harmonics belong to the force.
    along: wrenches of force and torque along two directions, which go with the cosine and with the sine, (2, 2, 6).
    """
    multiples = np.array(plan.turned) / (2.0 * np.pi)
    products = (library.Product * len(plan.products))(*(library.Product(*product) for product in plan.products))
    places = (c_int64 * len(which))(*which)
    turning = library.Turning(
        find_address(multiples), addressof(products), addressof(places), find_address(amplitudes),
        len(plan.turned), len(products), n_force, len(which),
    )  # fmt: skip
    for row, wrench in zip(turning.along, along.reshape(4, 6).tolist(), strict=True):
        row[:] = wrench
    return turning, (multiples, products, places, amplitudes)


def wheel_plane(spin_axis: Array) -> tuple[Array, Array]:
    """Two unit vectors that form a right-handed triad with the spin axis."""
    axis = spin_axis / np.linalg.norm(spin_axis)
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    one = np.cross(helper, axis)
    one /= np.linalg.norm(one)
    return one, np.cross(axis, one)


@dataclass(frozen=True, eq=False)
class WheelSettings(Kind):
    """A reaction wheel: where it is and how its speed goes."""

    name: ClassVar[str] = "wheels"

    enabled: bool = quantity("", "True: the wheel acts")
    scale: float = quantity("1", "Factor on the wheel's force and torque", at_least=0.0)
    static_imbalance: float = quantity(
        "kg.m", "Static imbalance: radial force over squared speed at order 1", at_least=0.0, display="g.cm"
    )
    dynamic_imbalance: float = quantity(
        "kg.m2", "Dynamic imbalance: radial torque over squared speed at order 1", at_least=0.0, display="g.cm2"
    )
    harmonics: str = quantity("", "CSV file of the other orders; empty: proportions of a small wheel to the imbalance")
    spin_axis_B: Array = quantity("1", "Direction of the spin axis, in B", shape=(3,))
    position_B: Array = quantity("m", "Centre of the wheel, in B", shape=(3,))
    initial_speed: float = quantity("rad/s", "Speed before the ramp", display="rpm")
    final_speed: float = quantity("rad/s", "Speed after the ramp", display="rpm")
    ramp_start: float = quantity("s", "Time at which the speed begins to change")
    ramp_duration: float = quantity("s", "Duration of the change of speed", at_least=0.0)
    speed_profile: str = quantity(
        "", "CSV file with time [s] and speed [rpm], used in place of the ramp; empty: the ramp"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if np.linalg.norm(self.spin_axis_B) < 1e-9:
            raise ParameterError("spin_axis", "must not be the zero vector")

    @cached_property
    def tables(self) -> tuple[Harmonics, Harmonics]:
        """Harmonics of radial force and torque.  Raises ParameterError: the file cannot be used."""
        table = HarmonicTable.read_file(Path(self.harmonics)) if self.harmonics else PACKAGED
        return table.with_imbalance(self.static_imbalance, 0), table.with_imbalance(self.dynamic_imbalance, 1)

    @cached_property
    def profile(self) -> Speed:
        """How the speed goes.  Raises ParameterError: the file cannot be used."""
        if self.speed_profile:
            return SpeedTable.read(Path(self.speed_profile), "speed_profile")
        return SpeedProfile(self.initial_speed, self.final_speed, self.ramp_start, self.ramp_duration)

    @classmethod
    def make_defaults(cls, p: Parameters) -> tuple[WheelSettings, ...]:
        """Four wheels at the centre of mass of the bus, switched off: three along the axes of B, one skewed."""
        return tuple(
            cls(
                enabled=False,
                scale=1.0,
                static_imbalance=STATIC,
                dynamic_imbalance=DYNAMIC,
                harmonics="",
                spin_axis_B=np.array(axis),
                position_B=p.bus.com_B,
                initial_speed=200.0,  # rad/s
                final_speed=200.0,  # rad/s
                ramp_start=0.0,  # s
                ramp_duration=0.0,  # s
                speed_profile="",
            )
            for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0))
        )

    def make_source(self, shared: SharedSettings, number: int) -> WheelSource | None:
        """The wheel; its initial phases depend on seed and number.  Raises ParameterError for an unusable profile."""
        if not self.enabled:
            return None
        seed = make_key(Stream.WHEEL, shared.seed, number)
        place = self.spin_axis_B, self.position_B
        return WheelSource(self.profile, *place, seed, self.scale, shared.rise_time, *self.tables)

    def find_highest(self) -> tuple[float, str] | None:
        """The highest harmonic at the highest speed."""
        if not self.enabled:
            return None
        speed = self.profile.highest
        order = max(float(table.orders.max(initial=0.0)) for table in self.tables)
        return order * speed / (2.0 * np.pi), f"harmonic {order:g} of {speed:g} rad/s"
