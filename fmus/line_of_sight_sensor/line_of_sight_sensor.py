"""LineOfSightSensor: fine guidance sensor or beacon tracker, with noise, sampling, latency, field and lock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.interface.ports import make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.sensors.line_of_sight import DEFAULT_TRACKER, PAIRS, SECOND_PAIRS, Lock, relative_rows
from ps_fmu.slavekit.author.elements import Delay, Element, Linear, Product, Sample, Watch, count_steps, ring_size
from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, vector

LONGEST_LATENCY = 1000  # steps
INPUT: dict[str, Any] = {"causality": "input"}
OUTPUT: dict[str, Any] = {"causality": "output", "initially_depends_on": ()}  # nothing is measured before a step
MICRORAD: dict[str, Any] = {"display_unit": "urad", "nominal": 1e-6}
TO_INERTIAL = "unit quaternion, scalar first, to inertial axes"

# Places in `a`: products of the attitudes, target's attitude in P, products of that, error and place of the target
# (see Tracker.rows), the error as sampled, the constant 1.
FIRST, RELATIVE, SECOND = slice(0, 16), slice(16, 20), slice(20, 29)
ERROR, PLACE, SAMPLED, ONE = slice(29, 32), slice(32, 36), slice(36, 39), slice(39, 40)


class LineOfSightSensor(Slave):
    """Measures the small rotation that takes the boresight of the payload to the target."""

    model_description = "Line-of-sight sensor: fine guidance sensor or beacon tracker along the boresight of P"
    n_states: ClassVar[int] = 1  # time in the acquisition field, s
    n_auxiliary: ClassVar[int] = 40
    n_memory: ClassVar[int] = 8 + ring_size(4, LONGEST_LATENCY)  # see the views made in _build
    block_rows: ClassVar[int] = 1024
    n_row: ClassVar[int] = 3  # noise of the sample that a step puts out, rad

    ports: ClassVar[tuple[Port, ...]] = (
        Port("payload_attitude.w", "input", "1", f"Attitude of P, {TO_INERTIAL}, w", start=1.0, nominal=1.0),
        *vector("payload_attitude", "xyz", "1", f"Attitude of P, {TO_INERTIAL}", nominal=1.0, **INPUT),
        *vector(
            "line_of_sight", "xy", "rad", "Small rotation of the boresight by vibration, with truss modes, in P",
            **INPUT, **MICRORAD,
        ),
        *vector(
            "payload_rotation", "xy", "rad", "The same of P itself; what line_of_sight has beyond it is added, in P",
            **INPUT, **MICRORAD,
        ),
        Port("target_attitude.w", "input", "1", f"Attitude of the target, {TO_INERTIAL}, w", start=1.0, nominal=1.0),
        *vector("target_attitude", "xyz", "1", f"Attitude of the target, {TO_INERTIAL}", nominal=1.0, **INPUT),
        Port("target_visible", "input", type="Boolean", start=True, description="False: something hides the target"),
        *vector(
            "line_of_sight_error", "xyz", "rad",
            "Measured small rotation that takes the payload to its target, in P; 0 without lock", **OUTPUT, **MICRORAD,
        ),
        Port("locked", type="Boolean", description="The target is measured", **OUTPUT),
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
        """Where the target is; what can change the lock; the sample."""
        a = self.a
        payload, target, relative = (
            self.places(view) for view in (self.view("payload_attitude"), self.view("target_attitude"), a[RELATIVE])
        )
        _, distance = self.tracker.watch(self._get_lock(), self.centre, self._is_visible())
        return (
            Product(payload[[i for i, _ in PAIRS]], target[[j for _, j in PAIRS]], a[FIRST]),
            Linear(a[FIRST], relative_rows(), a[RELATIVE]),
            Product(relative[[i for i, _ in SECOND_PAIRS]], relative[[j for _, j in SECOND_PAIRS]], a[SECOND]),
            Linear(self._find_sources(), self.tracker.rows(), a[ERROR.start : PLACE.stop]),
            Watch(a[PLACE], self.centre, distance),
            Watch(self.x, self.zero, max(self.tracker.acquisition_time - 0.5 * h, 0.0)),
            Sample(a[ERROR], a[SAMPLED], self.clock, count_steps("sample_time", self.tracker.sample_time, h)),
        )

    def step_map(self, h: float) -> NDArray[np.float64]:
        """[y; x] at the end of a step from [x; u; a; r] at its start."""
        step = np.zeros((5, 1 + self.u.size + self.a.size + self.n_row))
        auxiliary = step[:, 1 + self.u.size :]
        lock = self._get_lock()
        if lock is Lock.LOCKED:
            measured = np.diag([1.0, 1.0, float(self.tracker.roll_measured)])
            auxiliary[:3, SAMPLED] = auxiliary[:3, -self.n_row :] = measured
            auxiliary[3, ONE] = 1.0
        elif lock is Lock.ACQUIRING:
            step[4, 0] = 1.0
            auxiliary[4, ONE] = h
        return step

    def after_map(self, h: float) -> Sequence[Element]:
        """The latency, of which the step itself is the first part."""
        steps = count_steps("latency", self.tracker.latency, h, LONGEST_LATENCY)
        return (Delay(self.y, self.ring, steps - 1),) if steps > 1 else ()

    def rows(self, t: float, h: float, n: int) -> NDArray[np.float64]:
        """Noise of the samples that the steps put out, (n, 3), rad."""
        started = self.times(t, h, n) - h - self.start[0]
        return self.tracker.noise(self.tracker.sample_numbers(started))

    def event(self, t: float, h: float) -> bool:
        """The target comes into the field, has been there for long enough, or is lost."""
        turned = np.concatenate([self.values("line_of_sight"), self.values("payload_rotation")])
        place = self.tracker.look(self.values("payload_attitude"), self.values("target_attitude"), turned)
        before, visible = self._get_lock(), self._is_visible()
        lock = self.tracker.judge(before, place, visible, float(self.x[0]) + 0.5 * h)
        if lock is not before:
            self.x[0] = 0.0
        self.lock[0] = lock.value
        self.centre[:], _ = self.tracker.watch(lock, place, visible)
        self._warn_of_scale(place)
        self.remap()
        return False

    @refuse_parameters
    def restore(self) -> None:
        """Rebuild what the restored memory stands for."""
        self._build()

    def _build(self) -> None:
        self.tracker = take_values(DEFAULT_TRACKER, self.parameters())
        memory = self.memory
        self.lock, self.centre, self.start, self.clock, self.zero = (
            memory[0:1], memory[1:5], memory[5:6], memory[6:7], memory[7:8],
        )  # fmt: skip
        self.ring = memory[8:]

    def _get_lock(self) -> Lock:
        return Lock(float(self.lock[0]))

    def _is_visible(self) -> bool:
        return bool(self.value("target_visible"))

    def _find_sources(self) -> NDArray[np.int64]:
        """Places of what Tracker.rows takes."""
        turned = [self.places(self.view(name)) for name in ("line_of_sight", "payload_rotation")]
        return np.concatenate([self.places(self.a[SECOND]), *turned, self.places(self.a[ONE])])

    def _warn_of_scale(self, place: NDArray[np.float64]) -> None:
        if abs(place[3]) > 1.0 and not self.warned_scale:
            self.warned_scale = True
            norms = [float(np.linalg.norm(self.values(name))) for name in ("payload_attitude", "target_attitude")]
            self.warning(
                f"payload_attitude and target_attitude have the norms {norms[0]:.6g} and {norms[1]:.6g}: expected unit "
                "quaternions, scalar first; there is no lock as long as they are none"
            )
