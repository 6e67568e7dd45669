"""LineOfSightSensor: fine guidance sensor or beacon tracker, with noise, sampling, latency, field and lock."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.interface.ports import make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.sensors.line_of_sight import (
    DEFAULT_TRACKER,
    PAIRS,
    SECOND_PAIRS,
    Lock,
    TrackerNoise,
    relative_rows,
)
from ps_fmu.slavekit.author.elements import Delay, Element, Linear, Product, Sample, Watch, ring_size
from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, vector

LONGEST_LATENCY = 1000  # steps
INPUT: dict[str, Any] = {"causality": "input"}
OUTPUT: dict[str, Any] = {"causality": "output", "initially_depends_on": ()}  # nothing is measured before a step
MICRORAD: dict[str, Any] = {"display_unit": "urad", "nominal": 1e-6}
TO_INERTIAL = "unit quaternion, scalar first, to inertial axes"

# Places in `a`: products of the attitudes, target's attitude in P, products of that, error and place of the target
# (see Tracker.rows), the error as sampled; what is put out where there is lock: error and noise; time so far where lock
# is being acquired; the place over the distance that changes the lock; the constant 1, and 1 where there is lock, and
# where it is being acquired.
FIRST, RELATIVE, SECOND = slice(0, 16), slice(16, 20), slice(20, 29)
ERROR, PLACE, SAMPLED = slice(29, 32), slice(32, 36), slice(36, 39)
SEEN, NOISE, TIME, SHARE = slice(39, 42), slice(42, 45), slice(45, 46), slice(46, 50)
ONE, LOCKED, ACQUIRING = slice(50, 51), slice(51, 52), slice(52, 53)
LEAST_DISTANCE = 1e-30  # of Tracker.watch, so that one over it is finite


class LineOfSightSensor(Slave):
    """Measures the small rotation that takes the boresight of the payload to the target."""

    model_description = "Line-of-sight sensor: fine guidance sensor or beacon tracker along the boresight of P"
    n_states: ClassVar[int] = 1  # time in the acquisition field, s
    n_auxiliary: ClassVar[int] = ACQUIRING.stop
    n_memory: ClassVar[int] = 9 + ring_size(4, LONGEST_LATENCY)  # see the views made in _build
    block_rows: ClassVar[int] = 4096
    n_row: ClassVar[int] = 3  # noise of the sample that a step puts out, rad

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
        Port("target_visible", "input", type="Boolean", start=True, description="False: the target is hidden"),
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

    warned_scale: bool = False

    @refuse_parameters
    def configure(self) -> None:
        """Nothing is measured yet, and nothing is locked."""
        self.x[:] = self.y[:] = self.a[:] = self.memory[:] = 0.0
        self.a[ONE] = 1.0
        self._build()
        self.start[0] = self.start_time
        self.request_event()

    def before_map(self, h: float) -> Sequence[Element]:
        """Where the target is; what can change the lock; the sample.

        What depends on the lock are numbers, not elements and map: a step in which it changes makes none of these anew.
        """
        a, places = self.a, self.places
        payload, target, relative = (
            places(view) for view in (self.view("payload_attitude"), self.view("target_attitude"), a[RELATIVE])
        )
        locked, acquiring = places(a[LOCKED]), places(a[ACQUIRING])
        return (
            Product(payload[[i for i, _ in PAIRS]], target[[j for _, j in PAIRS]], a[FIRST]),
            Linear(a[FIRST], relative_rows(), a[RELATIVE]),
            Product(relative[[i for i, _ in SECOND_PAIRS]], relative[[j for _, j in SECOND_PAIRS]], a[SECOND]),
            Linear(self._find_sources(), self.tracker.rows, a[ERROR.start : PLACE.stop]),
            Product(a[PLACE], np.repeat(places(self.gain), 4), a[SHARE]),
            Watch(a[SHARE], self.centre, 1.0),
            Watch(self.x, self.zero, max(self.tracker.acquisition_time - 0.5 * h, 0.0)),
            self.sample,
            Product(
                np.concatenate([places(a[SAMPLED]), places(self.r), places(self.x)]),
                np.concatenate([np.repeat(locked, 6), acquiring]),
                a[SEEN.start : TIME.stop],
            ),
        )

    def step_map(self, h: float) -> NDArray[np.float64]:
        """[y; x] at the end of a step from [x; u; a] at its start."""
        step = np.zeros((5, 1 + self.u.size + self.a.size))
        auxiliary = step[:, 1 + self.u.size :]
        measured = np.diag([1.0, 1.0, float(self.tracker.roll_measured)])
        auxiliary[:3, SEEN] = auxiliary[:3, NOISE] = measured
        auxiliary[3, LOCKED] = 1.0
        auxiliary[4, TIME], auxiliary[4, ACQUIRING] = 1.0, h
        return step

    def after_map(self, h: float) -> Sequence[Element]:
        """The latency, of which the step itself is the first part."""
        latency = self.tracker.latency
        return (Delay(self.y, self.ring, latency, self.sample),) if latency else ()

    def rows(self, t: float, h: float, n: int) -> Generator[int, None, NDArray[np.float64]]:
        """Noise of the samples that the steps put out, (n, 3), rad, in parts."""
        yield 3  # the step at the end of the last table does nothing else
        numbers = self.tracker.sample_numbers(self.times(t, h, n) - self.start[0])
        yield 2
        return (yield from self.noise.in_parts(numbers))

    def event(self, t: float, h: float) -> bool:
        """The target comes into the field, has been there for long enough, or is lost."""
        place = self.tracker.look(self.payload, self.target, self.turned)
        before, visible = Lock(float(self.lock[0])), bool(self.visible[0])
        lock = self.tracker.judge(before, place, visible, float(self.x[0]) + 0.5 * h)
        if lock is not before:
            self.x[0] = 0.0
        centre, distance = self.tracker.watch(lock, place, visible)
        self.lock[0], self.gain[0] = lock.value, 1.0 / max(distance, LEAST_DISTANCE)
        self.centre[:] = centre * self.gain
        self.a[LOCKED], self.a[ACQUIRING] = lock is Lock.LOCKED, lock is Lock.ACQUIRING
        self._warn_of_scale(place)
        return False

    @refuse_parameters
    def restore(self) -> None:
        """Rebuild what the restored memory stands for."""
        self._build()

    def _build(self) -> None:
        self.tracker = take_values(DEFAULT_TRACKER, self.parameters())
        self.noise = TrackerNoise(self.tracker)
        memory = self.memory
        self.lock, self.centre, self.gain, self.start, self.clock, self.zero = (
            memory[0:1], memory[1:5], memory[5:6], memory[6:7], memory[7:8], memory[8:9],
        )  # fmt: skip
        self.ring = memory[9:]
        self.sample = Sample(self.a[ERROR], self.a[SAMPLED], self.clock, self.tracker.sample_time)
        self.payload, self.target, self.visible = (
            self.view(name) for name in ("payload_attitude", "target_attitude", "target_visible")
        )
        self.turned = self.view([f"{name}.{axis}" for name in ("line_of_sight", "payload_rotation") for axis in "xy"])

    def _find_sources(self) -> NDArray[np.int64]:
        """Places of what Tracker.rows takes."""
        return np.concatenate([self.places(view) for view in (self.a[SECOND], self.turned, self.a[ONE])])

    def _warn_of_scale(self, place: NDArray[np.float64]) -> None:
        if abs(place[3]) > 1.0 and not self.warned_scale:
            self.warned_scale = True
            norms = [float(np.linalg.norm(self.values(name))) for name in ("payload_attitude", "target_attitude")]
            self.warning(
                f"payload_attitude and target_attitude have the norms {norms[0]:.6g} and {norms[1]:.6g}: expected unit "
                "quaternions, scalar first; there is no lock as long as they are none"
            )
