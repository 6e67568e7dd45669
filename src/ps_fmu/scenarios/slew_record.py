"""The record of a slew: where it arrives, how the bus reacts, what it shakes, and the histories for the figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..mechanism.rotations import orientation_rate_map, rotation_matrix
from ..results.observers.bins import Envelope, EnvelopeObserver
from ..results.observers.observer import ColumnObserver, NamedColumn
from ..results.observers.statistics import Arrival, ArrivalObserver
from ..runs.scenario import list_needs
from .jitter_record import ORIENTATION, REACHABLE, ROTATION

Array = NDArray[np.float64]

SETTLE_S = 60.0  # from the end of the profile to the judgement of the orientation
MOVING = "commander.moving"
RELATIVE = tuple(f"plant.relative_orientation.{angle}" for angle in ("roll", "pitch", "yaw"))
BUS_ROTATION, BUS_RATE, BUS_ACCELERATION, BUS_ANGULAR_ACCELERATION = (
    tuple(f"plant.{quantity}.{axis}" for axis in "xyz")
    for quantity in ("base_rotation", "base_angular_velocity", "base_acceleration", "base_angular_acceleration")
)
FINE = tuple(f"plant.fine_displacement_{leg}" for leg in (1, 2, 3))
FORCE = tuple(f"isolator.fine_force_{leg}" for leg in (1, 2, 3))
JUDGED = (
    *ORIENTATION,
    *RELATIVE,
    *BUS_ROTATION,
    *BUS_RATE,
    *BUS_ACCELERATION,
    *BUS_ANGULAR_ACCELERATION,
    *ROTATION,
    *FINE,
    *FORCE,
    REACHABLE,
)
SLEW_SIGNALS = (*JUDGED, MOVING)
"""What a :class:`SlewRecord` looks at."""
NEEDS = (
    *list_needs("output", *JUDGED[:-1]),
    *list_needs("output", REACHABLE, MOVING, type="Boolean"),
)
NONE = np.full(3, np.nan)


@dataclass(frozen=True, eq=False)
class Shares:
    """Why the platform's orientation on the bus is not the nominal one; (3,) each: roll, pitch, yaw, rad."""

    fine: Array  # relative less nominal orientation: fine legs and rod stretch
    bus: Array  # rotation of the bus
    jitter: Array  # rotation of the payload in inertial space

    @property
    def left(self) -> Array:
        """fine + bus - jitter: zero but for products of small angles."""
        return self.fine + self.bus - self.jitter


@dataclass(frozen=True, eq=False)
class Slew:
    """The record of one run."""

    arrival: Arrival  # of the columns JUDGED
    orientation: Envelope  # rad
    relative: Envelope  # rad
    bus: Envelope  # rad
    fine: Envelope  # m

    @property
    def reachable(self) -> bool:
        """The commander had accepted its target when the orientation was judged."""
        return bool(self.arrival.value(REACHABLE)[0] > 0.5)

    def final(self, names: Sequence[str]) -> Array:
        """Values of three columns when the orientation is judged, (3,)."""
        return self.arrival.value(*names)

    def during(self, names: Sequence[str], statistic: str) -> Array:
        """``rms``, ``peak``, ``mean`` or ``std`` of three columns while the profile runs, (3,); NaN if none ran."""
        return self._of(self.arrival.during, names, statistic)

    def after(self, names: Sequence[str], statistic: str) -> Array:
        """The same from the end of the profile to the end of the run."""
        return self._of(self.arrival.after, names, statistic)

    def peak(self, names: Sequence[str]) -> Array:
        """Largest magnitude of three columns from the start of the profile on, (3,)."""
        return np.fmax(self.during(names, "peak"), self.after(names, "peak"))

    @property
    def shares(self) -> Shares:
        """Of the final relative orientation."""
        nominal = self.final(ORIENTATION)
        rates = orientation_rate_map(nominal)  # small rotations in B to roll, pitch, yaw
        return Shares(
            fine=self.final(RELATIVE) - nominal,
            bus=rates @ self.final(BUS_ROTATION),
            jitter=rates @ rotation_matrix(nominal) @ self.final(ROTATION),
        )

    def _of(self, statistics: object, names: Sequence[str], statistic: str) -> Array:
        if statistics is None:
            return NONE
        values: Array = getattr(statistics, statistic)
        return values[[self.arrival.names.index(name) for name in names]]


class SlewRecord:
    """Makes a :class:`Slew` of a run; ``observers`` goes to the master."""

    def __init__(self, columns: Sequence[NamedColumn]) -> None:
        self._arrival = ArrivalObserver(columns, JUDGED, flag=MOVING, settle_s=SETTLE_S)
        self._envelopes = [EnvelopeObserver(columns, names) for names in (ORIENTATION, RELATIVE, BUS_ROTATION, FINE)]

    @property
    def observers(self) -> list[ColumnObserver]:
        """The observers, for :meth:`ps_fmu.cosim.Master.run`."""
        return [self._arrival, *self._envelopes]

    def result(self) -> Slew:
        """The record so far; raises ``ValueError`` if no row has been seen."""
        return Slew(self._arrival.result(), *(envelope.result() for envelope in self._envelopes))
