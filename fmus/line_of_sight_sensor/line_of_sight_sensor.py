"""LineOfSightSensor: fine guidance sensor or beacon tracker, with noise, sampling, latency, field and lock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.interface.ports import make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.numerics.library import Tracker, find_arithmetic
from ps_fmu.sensors.line_of_sight import (
    DEFAULT_TRACKER,
    PAIRS,
    SECOND_PAIRS,
    relative_rows,
)
from ps_fmu.slavekit.author.elements import Call, Delay, Element, Linear, Product, Sample, ring_size
from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, vector

LONGEST_LATENCY = 1000  # steps
INPUT: dict[str, Any] = {"causality": "input"}
OUTPUT: dict[str, Any] = {"causality": "output", "initially_depends_on": ()}  # nothing is measured before a step
MICRORAD: dict[str, Any] = {"display_unit": "urad", "nominal": 1e-6}
TO_INERTIAL = "unit quaternion, scalar first, to inertial axes"

# Places in `a`: products of the attitudes, target's attitude in P, products of that, error and place of the target
# (see Tracker.rows), the error as sampled; the constant 1.
FIRST, RELATIVE, SECOND = slice(0, 16), slice(16, 20), slice(20, 29)
ERROR, PLACE, SAMPLED, ONE = slice(29, 32), slice(32, 36), slice(36, 39), slice(39, 40)


class LineOfSightSensor(Slave):
    """Measures the small rotation that takes the boresight of the payload to the target."""

    model_description = "Line-of-sight sensor: fine guidance sensor or beacon tracker along the boresight of P"
    n_states: ClassVar[int] = 1  # time in the acquisition field, s
    n_auxiliary: ClassVar[int] = ONE.stop
    n_memory: ClassVar[int] = 3 + ring_size(4, LONGEST_LATENCY)  # start time (s), lock, clock; past outputs
    any_step: ClassVar[bool] = True

    ports: ClassVar[tuple[Port, ...]] = (
        Port("payload_attitude.w", "input", "1", f"Attitude of P, {TO_INERTIAL}, w", start=1.0, nominal=1.0),
        *vector("payload_attitude", "xyz", "1", f"Attitude of P, {TO_INERTIAL}", nominal=1.0, **INPUT),
        *vector(
            "line_of_sight", "xy", "rad", "Small rotation of the boresight by vibration, with truss modes, in P",
            **INPUT, **MICRORAD,
        ),
        *vector(
            "payload_rotation", "xy", "rad",
            "Small rotation of P by vibration, in P; line_of_sight minus this is added to the attitude",
            **INPUT, **MICRORAD,
        ),
        Port("target_attitude.w", "input", "1", f"Attitude of the target, {TO_INERTIAL}, w", start=1.0, nominal=1.0),
        *vector("target_attitude", "xyz", "1", f"Attitude of the target, {TO_INERTIAL}", nominal=1.0, **INPUT),
        Port(
            "target_visible", "input", type="Boolean", start=True, event=False,
            description="False: the target is hidden",
        ),
        *vector(
            "line_of_sight_error", "xyz", "rad",
            "Measured small rotation from the payload to its target, in P; 0 without lock", **OUTPUT, **MICRORAD,
        ),
        Port("locked", type="Boolean", description="True: the sensor tracks the target", **OUTPUT),
        *make_parameter_ports(DEFAULT_TRACKER),
    )  # fmt: skip

    terminals: ClassVar[tuple[Terminal, ...]] = (
        Terminal("attitude", ("payload_attitude", "line_of_sight", "payload_rotation"), "Where the payload looks"),
        Terminal("pointing_error", ("line_of_sight_error", "locked"), "What the sensor measures"),
    )

    @refuse_parameters
    def configure(self) -> None:
        """Nothing is measured yet, and nothing is locked."""
        self.x[:] = self.y[:] = self.a[:] = self.memory[:] = 0.0
        self.a[ONE] = 1.0
        self._build()
        self.start[0] = self.start_time

    def before_map(self, h: float) -> Sequence[Element]:
        """Where the target is; the sample; what the sensor makes of both."""
        a, places = self.a, self.places
        payload, target, relative = (
            places(view) for view in (self.view("payload_attitude"), self.view("target_attitude"), a[RELATIVE])
        )
        written = self.y, self.x, self.lock
        return (
            Product(payload[[i for i, _ in PAIRS]], target[[j for _, j in PAIRS]], a[FIRST]),
            Linear(a[FIRST], relative_rows(), a[RELATIVE]),
            Product(relative[[i for i, _ in SECOND_PAIRS]], relative[[j for _, j in SECOND_PAIRS]], a[SECOND]),
            Linear(self._find_sources(), self.tracker.rows, a[ERROR.start : PLACE.stop]),
            self.sample,
            Call(find_arithmetic().step_tracker, self._describe(), np.concatenate([*map(places, written)])),
        )

    def _describe(self) -> Tracker:
        """Arguments of the element that judges the lock, and puts out what is measured."""
        find, words, (start, lock) = self.layout.find, self.tracker.describe(), self.places(self.memory[:2]).tolist()
        words.place, words.sampled = self.layout.a.start + PLACE.start, self.layout.a.start + SAMPLED.start
        words.acquired, words.error, words.start, words.lock = self.layout.x.start, self.layout.y.start, start, lock
        words.visible, words.payload, words.target = map(
            find, ("target_visible", "payload_attitude.w", "target_attitude.w")
        )
        return words

    def step_map(self, h: float) -> None:
        """None: elements do all."""

    def after_map(self, h: float) -> Sequence[Element]:
        """The latency, of which the step itself is the first part."""
        latency = self.tracker.latency
        return (Delay(self.y, self.ring, latency, self.sample),) if latency else ()

    @refuse_parameters
    def restore(self) -> None:
        """Rebuild what the restored memory stands for."""
        self._build()

    def _build(self) -> None:
        self.tracker = take_values(DEFAULT_TRACKER, self.parameters())
        self.start, self.lock, self.clock, self.ring = np.split(self.memory, [1, 2, 3])
        self.sample = Sample(self.a[ERROR], self.a[SAMPLED], self.clock, self.tracker.sample_time)
        self.turned = self.view([f"{name}.{axis}" for name in ("line_of_sight", "payload_rotation") for axis in "xy"])

    def _find_sources(self) -> NDArray[np.int64]:
        """Places of what Tracker.rows takes."""
        return np.concatenate([self.places(view) for view in (self.a[SECOND], self.turned, self.a[ONE])])
